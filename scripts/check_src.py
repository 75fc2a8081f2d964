#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Checks the project's rules that a script can verify, over the whole tree; one test in TAP for each rule.

check_src.py [ROOT]       checks the tree
check_src.py --self-test  plants a fault for each rule in a scratch tree and shows that the rule finds it, and only that rule
"""
import pathlib
import re
import sys
import tempfile

# A room may include from those before it, and from itself.
ROOMS = ["shared", "base", "math", "optics", "image", "scene", "visibility", "lights", "transport", "vulkan", "render", "methods",
         "compare", "cli", "viewer"]
FACES = {"cli", "viewer"}  # programs: they may print and exit

CODE = {".c", ".h"}
TEXT = CODE | {".in", ".py", ".sh", ".build", ".txt", ".md", ".comp", ".vert", ".frag", ".glsl", ".js", ".mjs", ".css"}
FOLDERS = [".ci", "bench", "data", "docs", "examples", "fuzz", "include", "integrations", "scripts", "src", "tests", "tools"]
WIDTH = 140

# Calls the library may not make, and why.
BANNED = {
    call: why
    for why, calls in {
        "the library never prints: use the log": "printf fprintf vprintf vfprintf puts fputs putchar perror",
        "the library never ends its host's process": "abort exit _exit quick_exit",
        "use pell_alloc and its kin": "malloc calloc realloc aligned_alloc posix_memalign free strdup strndup",
        "use snprintf, memcpy or pell_text": "strcpy strcat strncpy strncat sprintf vsprintf gets alloca",
        "use pell_parse_number or pell_parse_int: locales, overflow":
            "atoi atol atoll atof strtol strtoll strtoul strtoull strtod strtof scanf sscanf fscanf",
        "hidden shared state": "strtok rand srand random localtime gmtime strerror setlocale setenv",
        "the library runs no programs": "system popen",
        "files go through src/base/file.h": "fopen freopen open creat mkstemp tmpfile",
    }.items()
    for call in calls.split()
}
ALLOWED = {  # path: calls it may make
    "src/base/alloc.c": {"posix_memalign", "free"},
    "src/base/context.c": {"posix_memalign", "free"},
    "src/base/file.c": {"open"},
    "src/base/text.c": {"strtod"},
    "src/image/exr_read.c": {"calloc"},  # OpenEXR's hook gets no pointer of ours
}

UNFINISHED = re.compile(r"\b(TO" r"DO|FIX" r"ME|XX" r"X|HA" r"CK|WI" r"P|un" r"implemented|not (?:yet )?im" r"plemented|place" r"holder|"
                        r"st" r"ub)\b")
MACHINE = re.compile(r"(?:^|[^\w.])/(?:w[o]rk|f[a]rm|r[o]ot|h[o]me/\w+)/|https?://[\w.-]*(?:deb[i]an|npmj[s]|pyp[i]|docker[.]i[o])\b")


def strip_code(text):
    """The code with comments and the insides of strings blanked; lines stay lines."""
    def blank(match):
        found = match[0]
        if found[0] in "\"'":
            return found[0] * 2
        return re.sub(r"[^\n]", " ", found)
    return re.sub(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'', blank, text, flags=re.DOTALL)


class Tree:
    """All files the rules look at, by path from the root."""

    def __init__(self, root):
        self.root = pathlib.Path(root)
        self.files = {}
        found = [p for p in self.root.glob("*") if p.is_file()]
        for folder in FOLDERS:
            found += [p for p in (self.root / folder).rglob("*")
                      if p.is_file() and not p.is_symlink() and not {"__pycache__", "node_modules"} & set(p.parts)]
        for path in sorted(found):
            if path.suffix in TEXT or path.name in ("Makefile", "run", "meson_options.txt") or path.name.startswith("meson."):
                self.files[path.relative_to(self.root).as_posix()] = path.read_bytes().decode("utf-8", "replace")

    def code(self, folder):
        return {n: t for n, t in self.files.items() if n.startswith(folder) and pathlib.PurePath(n).suffix in CODE}


def lines(text):
    return enumerate(text.split("\n"), 1)


def room_of(name):
    parts = name.split("/")
    return parts[1] if parts[0] == "src" and len(parts) > 2 else None


def rule_include_order(tree):
    """a room includes only rooms before it, and one method no other"""
    for name, text in tree.code("src/").items():
        room, own = room_of(name), pathlib.PurePosixPath(name).parent
        if room not in ROOMS:
            yield name, 1, f"'{room}' is no known room"
            continue
        for n, line in lines(text):
            found = re.match(r'\s*#\s*include\s+"([^"]+)"', line)
            if not found:
                continue
            target = found[1]
            other = target.split("/")[0]
            if (tree.root / own / target).exists():
                other, path = room, (own / target).as_posix()
            else:
                path = "src/" + target
            if ".." in target:
                yield name, n, f'"{target}": include from the root of src'
            elif other not in ROOMS:
                yield name, n, f'"{target}": neither beside this file nor in a known room'
            elif ROOMS.index(other) > ROOMS.index(room):
                yield name, n, f'"{target}": {room} may not know {other}'
            elif room == other == "methods" and path.count("/") > 2 and path.split("/")[2] != name.split("/")[2]:
                yield name, n, f'"{target}": a method may not know another; ask the renderer for it by name'
    for name, text in tree.code("include/").items():
        for n, line in lines(text):
            if re.match(r'\s*#\s*include\s+"', line):
                yield name, n, "public headers include public and standard headers only, in angle brackets"


def rule_banned_calls(tree):
    """the library calls nothing that prints, ends the process, or bypasses its allocator, files and parsers"""
    call = re.compile(r"(?<![\w.>])(" + "|".join(BANNED) + r")\s*\(")
    for name, text in tree.code("src/").items():
        if room_of(name) in FACES:
            continue
        for n, line in lines(strip_code(text)):
            for found in call.finditer(line):
                if found[1] not in ALLOWED.get(name, ()):
                    yield name, n, f"{found[1]}(): {BANNED[found[1]]}"


def rule_counts(tree):
    """the ending of a plural is pell_counted's"""
    for name, text in tree.code("src/").items():
        for n, line in lines(text):
            if re.search(r'[!=]= 1 \? "s?" : "s?"', line):
                yield name, n, "a plural by hand: pell_counted makes it"


def rule_licence_line(tree):
    """every source file begins with its licence"""
    for name, text in tree.files.items():
        if pathlib.PurePath(name).suffix == ".md" or name.startswith("data/") or name.endswith(".txt") and "package" not in name:
            continue
        head = text.split("\n")[:2]
        if not text.startswith("#!"):
            head = head[:1]
        if not any("SPDX-License-Identifier: MIT" in line for line in head):
            yield name, 1, "the first line must be SPDX-License-Identifier: MIT"


def rule_white_space(tree):
    """no tabs, no space at line ends, lines of 140 columns, one newline at the end"""
    for name, text in tree.files.items():
        suffix = pathlib.PurePath(name).suffix
        if name.startswith("data/") or suffix == ".txt" and "package" not in name:
            continue
        for n, line in lines(text):
            if "\r" in line:
                yield name, n, "carriage return"
            if "\t" in line and name != "Makefile":
                yield name, n, "tab"
            if line != line.rstrip():
                yield name, n, "space at the end of the line"
            if len(line) > WIDTH and suffix != ".md":
                yield name, n, f"{len(line)} columns, {WIDTH} are allowed"
        if text and (not text.endswith("\n") or text.endswith("\n\n")):
            yield name, text.count("\n") + 1, "the file must end in one newline"


def rule_finished(tree):
    """no words of unfinished work"""
    for name, text in tree.files.items():
        for n, line in lines(text):
            found = UNFINISHED.search(line)
            if found:
                yield name, n, f"'{found[0]}': finish it, or write an issue"


def rule_no_machine(tree):
    """no paths of a machine, no hosts of a package registry"""
    for name, text in tree.files.items():
        for n, line in lines(text):
            found = MACHINE.search(line)
            if found:
                yield name, n, f"'{found[0].strip()}'"


def rule_header_guards(tree):
    """every header has a guard of its own"""
    seen = {}
    for name, text in {**tree.code("include/"), **tree.code("src/"), **tree.code("tests/")}.items():
        if not name.endswith(".h"):
            continue
        guard = re.search(r"^#ifndef (\w+)\n#define \1$", text, re.MULTILINE)
        if not guard:
            if "/* no guard:" not in text:
                yield name, 1, "#ifndef NAME, #define NAME is missing"
        elif guard[1] in seen:
            yield name, 1, f"the guard {guard[1]} is that of {seen[guard[1]]}, too"
        else:
            seen[guard[1]] = name


def rule_public_heads(tree):
    """every public header opens with its units, ownership, errors and threads"""
    for name, text in tree.files.items():
        if name.startswith("include/") and name.endswith((".h", ".h.in")):
            head = text.partition("*/")[0]
            for word in ("Units", "Ownership", "Errors", "Threads"):
                if not re.search(rf"^ \* {word} +\S", head, re.MULTILINE):
                    yield name, 1, f"the comment that it opens with has no line '{word}'"


# What a file, a function and a list of arguments of src/ may be long.
FILE_LINES, FUNCTION_LINES, ARGUMENTS = 700, 100, 8


def functions(code):
    """(name, first line, lines, arguments) of every function that code without comments defines."""
    head = re.compile(r"^(?![#}\s])([^;{}=#]*?)\b(\w*[a-z]\w*)\(([^;{}]*)\)\s*\n\{", re.MULTILINE)
    for found in head.finditer(code):
        end = code.find("\n}", found.end())
        depth, count = 0, 0 if found[3].strip() in ("", "void") else 1
        for c in found[3]:
            depth += (c in "([") - (c in ")]")
            count += c == "," and depth == 0
        yield found[2], code.count("\n", 0, found.start()) + 1, code.count("\n", found.start(), end + 2) + 1, count


def rule_sizes(tree):
    """files of src have 700 lines at most, functions 100 lines and 8 arguments"""
    for name, text in tree.code("src/").items():
        length = text.count("\n")
        if length > FILE_LINES:
            yield name, length, f"{length} lines, {FILE_LINES} are allowed: cut it along its concepts"
        for function, n, size, arguments in functions(strip_code(text)):
            if size > FUNCTION_LINES:
                yield name, n, f"{function}() has {size} lines, {FUNCTION_LINES} are allowed"
            if arguments > ARGUMENTS:
                yield name, n, f"{function}() takes {arguments} arguments, {ARGUMENTS} are allowed: a struct says more"


# Words that the field does not use for these concepts, and the field's own: docs/guide/conventions.md, "Glossary".
WORDS = [(re.compile(words, re.IGNORECASE), better) for words, better in [
    (r"(?<![A-Za-z])lamps?(?![A-Za-z])", "light"),
    (r"(?<![A-Za-z])strat(?:a|um)(?![A-Za-z])", "medium layers"),
    (r"(?<![A-Za-z])emitters(?![A-Za-z])", "light sampling"),
    (r"(?<![A-Za-z])bodies(?![A-Za-z])", "solids"),
    (r"\ba (?:\w+ )?thing\b|\bthe (?:\w+ )?thing\b|\bthings (?:are|that|with|without|many|get)\b", "object"),
    (r"\bthe eye(?:'s)?\b", "camera"),
    (r"(?<!triangle )(?<!or )(?<!and )(?<!for )\bfans?\b(?! of)", "light grid"),
    (r"\brelights?\b", "survives light change"),
    (r"\bslides?\b", "projected image"),
    (r"\bhangs on\b", "depends on"),
    (r"\bturned inside out\b|\b(?:its|the) inside out\b", "with inverted normals"),
    (r"\blight from behind\b|\bcomes through\b", "transmission, transmitted light"),
    (r"\bis told\b", "is reported"),
]]
WORDS_KEPT = [(re.compile(where), re.compile(words, re.IGNORECASE), why) for where, words, why in [
    (r"scripts/check_src\.py", r".", "holds the words"),
    (r"CHANGELOG\.md|docs/adr/.*", r".", "history"),
    (r"data/.*|examples/.*|tests/assets/.*", r".", "names that the authors of assets gave"),
    (r"scripts/(?:make|draw)_.*", r".", "anatomy of animals, names of lights in drawn scenes"),
    (r"src/compare/.*|docs/guide/compare\.md", r"eye", "FLIP models a viewer's eye"),
    (r".*", r"[\"'`]lamps?|lamps?=|`lamps`|lamps[\"']", "the knob `lamps` of layered, names of lights in files"),
    (r"src/scene/(?:gltf|mesh)/.*", r"fan", "triangle fans"),
    (r"src/scene/ply\..*|tests/scene/test_ply\.c", r"bod", "the data part of a file"),
    (r"tests/.*", r"^static void \w+\(void \*\*state\)|cmocka_unit_test|^@test\(", "names of tests"),
    (r"tests/browser/.*", r"^\s+'[^']*',$", "names of tests"),
]]


def rule_words(tree):
    """identifiers, comments and messages use the field's words"""
    for name, text in tree.files.items():
        kept = [words for where, words, _ in WORDS_KEPT if where.fullmatch(name)]
        for n, line in lines(text):
            for words, better in WORDS:
                found = words.search(line)
                if found and not any(k.search(line) for k in kept):
                    yield name, n, f"'{found[0]}': say {better}"


def declared_names(header):
    """Functions and constants that a header without comments declares for other files."""
    for part in re.split(r"[;{}]", re.sub(r"(?m)^\s*#(?:.*\\\n)*.*", "", header)):
        found = re.match(r"\s*(?!static\b)[A-Za-z_][\w\s*,()]*?\b(?!PELL_)([a-z]\w+)\s*\(", part) or \
            re.match(r"\s*extern const [\w\s*]*?\b(\w+)\s*(?:\[.*)?$", part, re.DOTALL)
        if found:
            yield found[1]


def dependencies(tree):
    """file -> {file it depends on: a name that the latter defines}, for the source files of src/."""
    codes = {n: strip_code(t) for n, t in {**tree.code("src/"), **tree.code("include/")}.items()}
    shared = {w for n, t in codes.items() if n.endswith(".h") for w in declared_names(t)}
    home = {}
    for name, code in codes.items():
        if name.endswith(".c"):
            for found in re.finditer(r"^(?!static\b|extern\b|struct \w+ \{|enum \w* ?\{)[a-zA-Z_][\w \*\n]*?\b(\w+)"
                                     r"(?:\([^;{}]*\)\s*\{|(?:\[[^\]]*\])*\s*=)", code, re.MULTILINE):
                home.setdefault(found[1], name)
    return {name: {home[w]: w for w in set(re.findall(r"(?<!struct )(?<!enum )\b[a-z]\w+\b", code)) & shared
                   if home.get(w, name) != name}
            for name, code in codes.items() if name.endswith(".c")}


def rule_circles(tree):
    """no two files of src need each other: a file needs the one that defines what it calls"""
    needs = dependencies(tree)
    reach = {}
    for name in needs:
        todo, seen = list(needs[name]), set()
        while todo:
            other = todo.pop()
            if other not in seen:
                seen.add(other)
                todo += needs.get(other, ())
        reach[name] = seen
    for name in needs:
        circle = {o for o in reach[name] if name in reach.get(o, ())} | {name}
        if name in reach[name]:
            calls = ", ".join(f"{w} of {o}" for o, w in sorted(needs[name].items()) if o in circle)
            yield name, 1, f"is in a circle of {len(circle)} files by {calls}"


RULES = [rule_include_order, rule_banned_calls, rule_licence_line, rule_white_space, rule_finished, rule_no_machine, rule_header_guards,
         rule_sizes, rule_circles, rule_public_heads, rule_words, rule_counts]


def check(root):
    tree = Tree(root)
    return {rule: list(rule(tree)) for rule in RULES}


# --- Self-test: (rule that must find it, file, text) ---------------------------------------------------------------------------------

SPDX = "/* SPDX-License-Identifier: MIT */\n"
HEAD = "/* SPDX-License-Identifier: MIT\n * Units      mm\n * Ownership  none\n * Errors     none\n * Threads    safe\n */\n"
CLEAN = {
    "src/base/base.h": SPDX + "#ifndef A_H\n#define A_H\n#endif\n",
    "src/methods/one/one.h": SPDX + "#ifndef ONE_H\n#define ONE_H\n#endif\n",
    "src/methods/two/two.c": SPDX + '#include "base/base.h"\n\n/* printf("x"); exit(1); */\nconst char *t = "printf(1)";\n'
                                    "void f(struct a *a)\n{\n    a->allocator.free(a);\n    pell_free(a, snprintf(0, 0, t));\n}\n",
    "src/methods/two/two_kernel.c": SPDX + '#include "two.h"\n',
    "src/methods/two/two.h": SPDX + "#ifndef TWO_H\n#define TWO_H\nvoid two_f(void);\nvoid two_g(void) PELL_PURE(1);\n#endif\n",
    "src/methods/two/f.c": SPDX + "/* two_h() */\nvoid two_f(void)\n{\n    two_g();\n}\n",
    "src/cli/main.c": SPDX + '#include "render/camera_view.h"\nvoid f(void)\n{\n    printf("%d", 1);\n    exit(2);\n}\n',
    "include/pellucid/a.h": HEAD + "#ifndef PUBLIC_A_H\n#define PUBLIC_A_H\n#include <pellucid/common.h>\n#endif\n",
    "Makefile": "# SPDX-License-Identifier: MIT\nall:\n\ttrue\n",
    "scripts/x.sh": "#!/bin/sh\n# SPDX-License-Identifier: MIT\n",
}
FAULTS = [
    (rule_include_order, "src/math/bad.c", SPDX + '#include "render/camera_view.h"\n'),
    (rule_include_order, "src/base/bad.c", SPDX + '#include "math/vec.h"\n'),
    (rule_include_order, "src/shared/bad.h", SPDX + '#ifndef BAD_H\n#define BAD_H\n#include "base/base.h"\n#endif\n'),
    (rule_include_order, "src/methods/two/bad.c", SPDX + '#include "methods/one/one.h"\n'),
    (rule_include_order, "src/methods/two/bad.c", SPDX + '#include "../one/one.h"\n'),
    (rule_include_order, "src/optics/bad.c", SPDX + '#include "nowhere.h"\n'),
    (rule_include_order, "src/kitchen/bad.c", SPDX),
    (rule_include_order, "include/pellucid/b.h", HEAD + '#ifndef B_H\n#define B_H\n#include "base/base.h"\n#endif\n'),
    (rule_licence_line, "src/base/bad.c", "int a;\n"),
    (rule_licence_line, "scripts/bad.py", "#!/usr/bin/env python3\nprint()\n"),
    (rule_licence_line, "src/base/meson.build", "x = 1\n"),
    (rule_white_space, "src/base/bad.c", SPDX + "\tint a;\n"),
    (rule_white_space, "src/base/bad.c", SPDX + "int a; \n"),
    (rule_white_space, "src/base/bad.c", SPDX + "int a;\r\n"),
    (rule_white_space, "src/base/bad.c", SPDX + "int a" + " " * WIDTH + ";\n"),
    (rule_white_space, "src/base/bad.c", SPDX + "int a;"),
    (rule_finished, "src/base/bad.c", SPDX + "/* TO" "DO: more */\n"),
    (rule_finished, "docs/bad.md", "This is a place" "holder.\n"),
    (rule_finished, "tests/bad.c", SPDX + "/* a st" "ub */\n"),
    (rule_no_machine, "docs/bad.md", "see /wo" "rk/main/x\n"),
    (rule_no_machine, "src/base/bad.c", SPDX + 'const char *p = "/ho' 'me/someone/x";\n'),
    (rule_no_machine, "scripts/bad.sh", "# SPDX-License-Identifier: MIT\nget https://deb.deb" "ian.org/x\n"),
    (rule_public_heads, "include/pellucid/b.h", HEAD.replace("Errors ", "Faults ") + "#ifndef B_H\n#define B_H\n#endif\n"),
    (rule_public_heads, "include/pellucid/b.h.in", HEAD.replace(" * Units      mm\n", "")),
    (rule_public_heads, "include/pellucid/b.h", SPDX + "#ifndef B_H\n#define B_H\n/* Units Ownership Errors Threads */\n#endif\n"),
    (rule_header_guards, "src/base/bad.h", SPDX + "int a;\n"),
    (rule_header_guards, "src/math/bad.h", SPDX + "#ifndef A_H\n#define A_H\n#endif\n"),
    (rule_sizes, "src/base/bad.c", SPDX + "/* a */\n" * 700),
    (rule_sizes, "src/base/bad.c", SPDX + "static int f(int a)\n{\n" + "    a++;\n" * 98 + "}\n"),
    (rule_sizes, "src/base/bad.c",
     SPDX + "static int f(int a, int b, int c, int d,\n             int e, int g, int h, int (*i)(int, int), int j)\n{\n}\n"),
    (rule_counts, "src/base/bad.c", SPDX + 'void f(int n)\n{\n    g("%d row%s", n, n == 1 ? "" : "s");\n}\n'),
    (rule_circles, "src/methods/two/bad.c", SPDX + "void two_g(void)\n{\n    two_f();\n}\n"),
]
FAULTS += [(rule_words, "src/base/bad.c", SPDX + f"/* {words} */\n") for words in [
    "a lamp", "pell_lamp_create", "num_lamps", "strata", "pell_stratum", "emitters.h", "two bodies", "the largest thing", "a thing",
    "things that are closed", "what the eye sees", "the light's fan", "relights", "a slide", "hangs on it", "turned inside out",
    "has the inside out", "light from behind", "what comes through", "is told"]]
FAULTS += [(rule_banned_calls, "src/base/bad.c", SPDX + f"void f(void)\n{{\n    {name} (x);\n}}\n") for name in BANNED]
FAULTS += [
    (rule_banned_calls, "src/optics/bad.c", SPDX + 'void f(void)\n{\n    g("/*"); exit(1); g("*/");\n}\n'),
]


def self_test():
    bad = 0
    print(f"1..{len(FAULTS) + 1}")
    for i, (rule, name, text) in enumerate([(None, None, None), *FAULTS], 1):
        with tempfile.TemporaryDirectory() as root:
            for path, content in {**CLEAN, **({name: text} if name else {})}.items():
                target = pathlib.Path(root, path)
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(content, "utf-8", newline="")
            found = {r.__name__ for r, faults in check(root).items() if faults}
        good = found == ({rule.__name__} if rule else set())
        bad += not good
        title = f"{rule.__name__[5:]} finds {name} {text.splitlines()[-1].strip()[:40]!r}" if rule else "a clean tree passes"
        print(f"{'ok' if good else 'not ok'} {i} - {title}".replace("#", "hash "))
        if not good:
            print(f"# found: {found}")
    return 1 if bad else 0


def main():
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    results = check(sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).parent.parent)
    print(f"1..{len(results)}")
    for i, (rule, faults) in enumerate(results.items(), 1):
        print(f"{'not ok' if faults else 'ok'} {i} - {rule.__doc__}")
        for name, n, what in faults:
            print(f"# {name}:{n}: {what}")
    return 1 if any(results.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
