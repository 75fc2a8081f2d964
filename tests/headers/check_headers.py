#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""check_headers.py INCLUDE C-COMPILER [CXX-COMPILER]: each public header alone as C11 and C++17, and all of them in one file, either order.

Without a C++ compiler its tests are skipped. A header that declares exported things must do so as C for C++.
"""
import pathlib
import subprocess
import sys
import tempfile

FLAGS = ["-pedantic", "-Wall", "-Wextra", "-Wshadow", "-Wundef", "-Werror", "-fsyntax-only"]


def compiles(command, text):
    with tempfile.NamedTemporaryFile("w", suffix=".c", encoding="utf-8") as source:
        source.write(text)
        source.flush()
        run = subprocess.run([*command, *FLAGS, source.name], check=False, capture_output=True, text=True)
    return run.returncode == 0, run.stderr


def main():
    include = pathlib.Path(sys.argv[1])
    headers = sorted(p.relative_to(include).as_posix() for p in include.rglob("*.h"))
    languages = {"C11": [*sys.argv[2].split(), "-std=c11", "-xc"]}
    languages["C++17"] = [*sys.argv[3].split(), "-std=c++17", "-Wold-style-cast", "-xc++"] if sys.argv[3:] and sys.argv[3] else None
    units = {name: [name] for name in headers}
    units["all headers in order, then again"] = headers * 2
    units["all headers backwards"] = headers[::-1]
    results = [(bool(headers), "there are public headers", "")]
    for language, command in languages.items():
        for title, names in units.items():
            if command is None:
                results.append((True, f"{title} as {language} # SKIP there is no C++ compiler", ""))
                continue
            text = "".join(f"#include <{name}>\n" for name in names) + "extern int not_empty;\n"
            good, errors = compiles([*command, f"-I{include}"], text)
            results.append((good, f"{title} as {language}", errors))
    for name in headers:
        text = (include / name).read_text("utf-8")
        results.append(("PELL_API" not in text or 'extern "C"' in text, f"{name} declares its functions as C for C++", ""))
    print(f"1..{len(results)}")
    for i, (good, title, errors) in enumerate(results, 1):
        print(f"{'ok' if good else 'not ok'} {i} - {title}")
        for line in errors.splitlines():
            print(f"# {line}")
    return 0 if all(good for good, _, _ in results) else 1


if __name__ == "__main__":
    sys.exit(main())
