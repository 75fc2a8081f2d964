#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""check_headers.py INCLUDE MADE C-COMPILER [CXX-COMPILER]: each public header alone as C11 and C++17, and all in one file, either order.

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
    folders = [pathlib.Path(folder) for folder in sys.argv[1:3]]  # of the source, and of the build, where version.h is generated
    found = {p.relative_to(folder).as_posix(): p for folder in folders for p in folder.rglob("*.h")}
    headers = sorted(found)
    languages = {"C11": [*sys.argv[3].split(), "-std=c11", "-xc"]}
    languages["C++17"] = [*sys.argv[4].split(), "-std=c++17", "-Wold-style-cast", "-xc++"] if sys.argv[4:] and sys.argv[4] else None
    units = {name: [name] for name in headers}
    units["all headers in order, then again"] = headers * 2
    units["all headers backwards"] = headers[::-1]
    every = found["pellucid/pellucid.h"].read_text("utf-8") + found["pellucid/optics.h"].read_text("utf-8")
    missing = [name for name in headers if f"#include <{name}>" not in every and name != "pellucid/pellucid.h"]
    results = [(len(headers) > 20, "there are public headers", ""),
               (not missing, "pellucid.h includes all of them", "\n".join(missing))]
    for language, command in languages.items():
        for title, names in units.items():
            if command is None:
                results.append((True, f"{title} as {language} # SKIP there is no C++ compiler", ""))
                continue
            text = "".join(f"#include <{name}>\n" for name in names) + "extern int not_empty;\n"
            good, errors = compiles([*command, *(f"-I{folder}" for folder in folders)], text)
            results.append((good, f"{title} as {language}", errors))
    for name in headers:
        text = found[name].read_text("utf-8")
        results.append(("PELL_API" not in text or 'extern "C"' in text, f"{name} declares its functions as C for C++", ""))
    print(f"1..{len(results)}")
    for i, (good, title, errors) in enumerate(results, 1):
        print(f"{'ok' if good else 'not ok'} {i} - {title}")
        for line in errors.splitlines():
            print(f"# {line}")
    return 0 if all(good for good, _, _ in results) else 1


if __name__ == "__main__":
    sys.exit(main())
