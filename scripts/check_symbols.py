#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Checks the symbols of a build folder with nm; one test in TAP for each rule.

check_symbols.py BUILD        checks the libraries there
check_symbols.py --self-test  builds libraries with planted faults and shows that each is found
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

CC = os.environ.get("CC", "cc").split()


def symbols(path, *options):
    """(object, name, type, section) of each defined symbol."""
    output = subprocess.run(["nm", "-f", "sysv", "--defined-only", *options, str(path)], check=True, capture_output=True, text=True).stdout
    member = ""
    for line in output.splitlines():
        head = re.match(r"(?:Symbols|Undefined symbols) from .*?\[?([^\[\]/:]+)\]?:$", line)
        if head:
            member = head[1]
        row = [column.strip() for column in line.split("|")]
        if len(row) == 7 and row[0] != "Name":
            yield member, row[0], row[2], row[6]


def shared_library(build):
    return [p for p in build.rglob("libpellucid.so*") if p.is_file() and not p.is_symlink() and p.suffix != ".symbols"]


def rule_exports(build):
    """the shared library exports only pell_ names"""
    found = shared_library(build)
    if not found:
        return None
    names = [(path.name, name) for path in found for _, name, _, _ in symbols(path, "-D", "--extern-only")]
    return [f"{path}: {name}" for path, name in names if not name.startswith("pell_")]


def rule_declared(build):
    """the shared library has everything that the public headers declare"""
    found = shared_library(build)
    if not found:
        return None
    declared = set()
    for header in [*(ROOT / "include").rglob("*.h"), *(build / "include").rglob("*.h")]:
        text = re.sub(r"/\*.*?\*/", "", header.read_text("utf-8"), flags=re.DOTALL)
        declared |= set(re.findall(r"\bPELL_API\b[^;(\[]*?\b(pell_\w+)\s*[(\[;]", text))
    exported = {name for path in found for _, name, _, _ in symbols(path, "-D", "--extern-only")}
    return [f"{name} is declared, but not there" for name in sorted(declared - exported)]


def rule_packaged(build):
    """the symbols file of the Debian package lists what the shared library exports"""
    found, listed = shared_library(build), ROOT / "debian" / "libpellucid0.symbols"
    if not found or not listed.exists():
        return None
    packaged = set(re.findall(r"^ (\w+)@", listed.read_text("utf-8"), re.MULTILINE))
    exported = {name for path in found for _, name, _, _ in symbols(path, "-D", "--extern-only") if name.startswith("pell_")}
    return [*(f"{listed.name} lacks {name}" for name in sorted(exported - packaged)),
            *(f"{listed.name} has {name}, which is not exported" for name in sorted(packaged - exported))]


def rule_constant(build):
    """the library has no variables: what is not on a stack or in an object is constant"""
    archives = sorted((build / "src").rglob("libpell_*.a")) if (build / "src").is_dir() else []
    if not archives:
        return None
    bad = []
    for path in archives:
        if path.name in ("libpell_cli.a", "libpell_viewer.a"):
            continue
        for member, name, _, section in symbols(path):
            if re.match(r"\.(t?bss|t?data)\b(?!\.rel\.ro)|\*COM\*", section):
                bad.append(f"{path.name}({member}): {name} in {section}")
    return bad


def rule_methods(build):
    """a method's folder defines one pell_method_NAME; other names begin with NAME, its initials or its first word (behind pell_ or not)"""
    sources, objects = ROOT / "src" / "methods", build / "src" / "methods"
    names = sorted(p.name for p in sources.iterdir() if p.is_dir()) if sources.is_dir() else []
    folders = {}
    for path in sorted(objects.rglob("*.o")):  # Meson joins a source's folders with '_' in front of its name
        path_in_build = path.relative_to(objects).as_posix()
        for name in names:
            if re.search(rf"(?:^|[/_]){name}[/_]", path_in_build):
                folders.setdefault(name, []).append(path)
    if not folders:
        return None
    bad, first = [], [folder.split("_")[0] for folder in folders]
    for folder, paths in folders.items():
        names = {name for path in paths for _, name, _, _ in symbols(path, "--extern-only")}
        methods = {name for name in names if name.startswith("pell_method_")}
        if methods != {f"pell_method_{folder}"}:
            bad.append(f"{folder}: defines {', '.join(sorted(methods)) or 'no pell_method_' + folder}")
        words = folder.split("_")
        initials = "".join(word[0] for word in words)
        marks = [folder] + ([initials] if len(initials) > 1 else []) + ([words[0]] if first.count(words[0]) == 1 else [])
        own = tuple(front + mark + "_" for mark in marks for front in ("", "pell_"))
        bad += [f"{folder}: {name}" for name in sorted(names - methods) if not name.startswith(own)]
    return bad


ROOT = pathlib.Path(__file__).resolve().parent.parent
RULES = [rule_exports, rule_declared, rule_packaged, rule_constant, rule_methods]


def report(results):
    print(f"1..{len(results)}")
    for i, (rule, bad) in enumerate(results.items(), 1):
        if bad is None:
            print(f"ok {i} - {rule.__doc__} # SKIP there is nothing of it in this build")
        else:
            print(f"{'not ok' if bad else 'ok'} {i} - {rule.__doc__}")
            for line in bad:
                print(f"# {line}")
    return 1 if any(results.values()) else 0


# --- Self-test --------------------------------------------------------------------------------------------------------------------

HEADER = """#define PELL_API __attribute__((visibility("default")))
struct pell_thing;
PELL_API extern const char *const pell_names[];
PELL_API const struct pell_thing *pell_find(struct pell_thing *thing,
                                            int n);
/* PELL_API int pell_comment(void); */
"""
REST = """const char *const pell_names[] = {"a"};
const struct pell_thing *pell_find(struct pell_thing *thing, int n) { return n ? thing : 0; }
"""
CLEAN = HEADER + """const int pell_method_one = 1;
extern const char *const one_names[];
const char *const one_names[] = {"a"};
static const int k = 2;
int one_f(void);
int one_f(void) { return k; }
"""
FAULTS = [
    (rule_declared, "PELL_API int pell_forgotten(void);"),
    (rule_declared, "PELL_API extern const int pell_forgotten[];"),
    (rule_exports, '__attribute__((visibility("default"))) int one_helper(void); int one_helper(void) { return 1; }'),
    (rule_packaged, '__attribute__((visibility("default"))) int pell_one_added(void); int pell_one_added(void) { return 1; }'),
    (rule_constant, "int one_g(void); int one_g(void) { static int calls; return ++calls; }"),
    (rule_constant, "static int level = 3; int one_g(int x); int one_g(int x) { return level += x; }"),
    (rule_constant, "static _Thread_local int level = 3; int one_g(int x); int one_g(int x) { return level += x; }"),
    (rule_methods, "int helper(void); int helper(void) { return 1; }"),
    (rule_methods, "const int pell_method_two = 1;"),
]


def build_fault(folder, code):
    """What Meson would leave of src/methods/one/one.c: an object, an archive, a shared library."""
    parts = folder / "build" / "src" / "methods" / "libpell_methods.a.p"
    parts.mkdir(parents=True)
    (folder / "src" / "methods" / "one").mkdir(parents=True)
    (folder / "include").mkdir()
    (folder / "debian").mkdir()
    listed = "libone.so.0 libone0 #MINVER#\n pell_find@Base 0.1.0\n pell_names@Base 0.1.0\n"
    (folder / "debian" / "libpellucid0.symbols").write_text(listed, "utf-8")
    header, source = folder / "include" / "one.h", folder / "src" / "methods" / "one" / "one.c"
    header.write_text("".join(line + "\n" for line in code.splitlines() if "PELL_API" in line or "int n);" in line), "utf-8")
    source.write_text(code, "utf-8")
    (folder / "rest.c").write_text(HEADER + REST, "utf-8")
    objects = [str(parts / "one_one.c.o"), str(parts / "rest.c.o")]
    for path, target in zip((source, folder / "rest.c"), objects):
        subprocess.run([*CC, "-c", "-fPIC", "-fvisibility=hidden", str(path), "-o", target], check=True)
    subprocess.run(["ar", "rcs", str(parts.parent / "libpell_methods.a"), *objects], check=True)
    subprocess.run([*CC, "-shared", *objects, "-o", str(folder / "build" / "libpellucid.so.0")], check=True)


def self_test():
    global ROOT
    bad = 0
    print(f"1..{len(FAULTS) + 1}")
    for i, (rule, fault) in enumerate([(None, ""), *FAULTS], 1):
        with tempfile.TemporaryDirectory() as scratch:
            ROOT = pathlib.Path(scratch)
            build_fault(ROOT, CLEAN + fault)
            results = {r: r(ROOT / "build") for r in RULES}
        found = {r for r, lines in results.items() if lines}
        good = None not in results.values() and found == ({rule} if rule else set())
        bad += not good
        title = f"{rule.__name__[5:]} finds {fault[:60]}" if rule else "a clean build passes"
        print(f"{'ok' if good else 'not ok'} {i} - {title}")
        if not good:
            print(f"# {[(r.__name__, b) for r, b in results.items()]}")
    return 1 if bad else 0


def main():
    if not shutil.which("nm"):
        print("1..0 # SKIP nm is not installed")
        return 0
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    return report({rule: rule(pathlib.Path(sys.argv[1])) for rule in RULES})


if __name__ == "__main__":
    sys.exit(main())
