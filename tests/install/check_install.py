#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""check_install.py BUILD SOURCE C-COMPILER [CXX-COMPILER [PYTHON PREFIX]]: installs into a scratch folder, builds a user's
program against that alone.

The program knows only what pkg-config tells it. It is built as C11 and, where there is a compiler, as C++17, and run. The projects of
examples/projects are built by CMake, where it is installed, and by Meson, and run. PYTHON is the one that the package is for.
"""
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent


class Fault(Exception):
    pass


def run(command, **options):
    done = subprocess.run(command, check=False, capture_output=True, text=True, **options)
    if done.returncode != 0:
        raise Fault(f"{' '.join(map(str, command))}: exit status {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


class Installed:
    def __init__(self, build, scratch):
        self.root = scratch / "root"
        run(["meson", "install", "-C", build, "--no-rebuild", "--destdir", str(self.root)])
        found = list(self.root.rglob("pellucid.pc"))
        if len(found) != 1:
            raise Fault(f"pellucid.pc was installed {len(found)} times")
        self.env = {**os.environ, "PKG_CONFIG_PATH": str(found[0].parent), "PKG_CONFIG_SYSROOT_DIR": str(self.root)}
        self.libraries = sorted({p.parent for p in self.root.rglob("libpellucid.so*")})

    def flags(self, *options):
        return run(["pkg-config", *options, "pellucid"], env=self.env).split()

    def build_and_run(self, command, scratch):
        program = scratch / "user"
        source = HERE / "user.c"
        run([*command, str(source), "-xnone", "-o", str(program), *self.flags("--cflags"), *self.flags("--libs"), "-lm"], cwd=scratch)
        env = {**os.environ, "LD_LIBRARY_PATH": os.pathsep.join(map(str, self.libraries))}
        return run([str(program)], env=env, cwd=scratch)


    def run_project(self, source, scratch, configure, build):
        """Configures and builds a copy of a project outside of the tree, and runs its program."""
        shutil.copytree(source / "examples", scratch / "examples", dirs_exist_ok=True)
        run(configure, env=self.env)
        run(build, env=self.env)
        folder = pathlib.Path(build[build.index("--build") + 1] if "--build" in build else build[build.index("-C") + 1])
        env = {**os.environ, "LD_LIBRARY_PATH": os.pathsep.join(map(str, self.libraries))}
        said = run([str(folder / "profile")], env=env, cwd=folder)
        if "marble" not in said.lower() and "R(" not in said:
            raise Fault(f"the program says {said!r}")
        self.check_static(folder / "profile-static", said)

    @staticmethod
    def check_static(program, said):
        """A program that was linked to the archive prints the same, where our shared library is absent."""
        alone = run([str(program)], cwd=program.parent)
        if alone != said:
            raise Fault(f"{program.name} says {alone!r}, with the shared library {said!r}")
        if "libpellucid" in run(["ldd", str(program)]):
            raise Fault(f"{program.name} needs the shared library")

    def build_static(self, command, scratch):
        program = scratch / "user-static"
        flags = [f for f in self.flags("--static", "--libs") if f != "-lpellucid"]
        archive = next(self.root.rglob("libpellucid.a"))
        run([*command, str(HERE / "user.c"), "-o", str(program), *self.flags("--cflags"), str(archive), *flags, "-lm"], cwd=scratch)
        if "libpellucid" in run(["ldd", str(program)]):
            raise Fault("the program needs the shared library")
        return run([str(program)], cwd=scratch)

    def cmake(self, source, scratch):
        project, folder = scratch / "examples/projects/cmake", scratch / "by-cmake"
        prefix = next(self.root.rglob("PellucidConfig.cmake"))
        command = ["cmake", "-G", "Ninja", f"-DPellucid_DIR={prefix.parent}"]
        self.run_project(source, scratch, [*command, "-S", str(project), "-B", str(folder)], ["cmake", "--build", str(folder)])
        wrong = scratch / "wrong"
        wrong.mkdir()
        text = (project / "CMakeLists.txt").read_text("utf-8")
        (wrong / "CMakeLists.txt").write_text(text.replace("Pellucid 0.1", "Pellucid 99.1"), "utf-8")
        done = subprocess.run([*command, "-S", str(wrong), "-B", str(wrong / "build")], check=False, capture_output=True, text=True)
        if done.returncode == 0:
            raise Fault("CMake finds version 99.1, which is not installed")

    def meson(self, source, scratch):
        project, folder = scratch / "examples/projects/meson", scratch / "by-meson"
        self.run_project(source, scratch, ["meson", "setup", str(folder), str(project)], ["ninja", "-C", str(folder)])


def check_names(archive):
    """The archive's global names can't be a user's: all begin with pell_."""
    lines = [line.split() for line in run(["nm", "-g", "-P", "--defined-only", str(archive)]).splitlines()]
    names = {line[0] for line in lines if len(line) > 2}
    strange = sorted(name for name in names if not name.startswith("pell_"))
    if strange or "pell_version_string" not in names:
        raise Fault(f"{archive.name} defines {', '.join(strange[:20]) or 'nothing of ours'}")


def check_makefile(source):
    """Folders whose names have spaces reach the commands of the Makefile as one word."""
    given = {"BUILD": "a build", "PREFIX": "/a prefix", "DESTDIR": "/a root"}
    command = ["make", "-n", "-C", str(source), *(f"{name}={value}" for name, value in given.items())]
    said = "".join(run([*command, target]) for target in ("build", "demo", "test", "shaders", "soak", "install", "uninstall"))
    words = [word for line in said.splitlines() if not line.startswith("make") for word in shlex.split(line)]
    for name, value in given.items():
        if not any(value in word for word in words) or said.count(value) != sum(word.count(value) for word in words):
            raise Fault(f"{name} with a space is torn: {said}")
    if "scripts/demo.sh" not in words or words[words.index("scripts/demo.sh") + 1] != given["BUILD"]:
        raise Fault("the demo does not know the build folder")


def check_files(installed, source):
    public = {p.relative_to(source / "include").as_posix() for p in (source / "include").rglob("*.h")} | {"pellucid/version.h"}
    there = {p.as_posix().split("/include/", 1)[1] for p in installed.root.rglob("*.h")}
    if public != there:
        raise Fault(f"public headers {sorted(public ^ there)} are installed wrongly")
    if installed.libraries and not any(p.name.count(".") >= 3 for p in installed.root.rglob("libpellucid.so.*")):
        raise Fault("the shared library has no version in its name")
    programs = [p for p in installed.root.rglob("bin/pellucid")]
    if len(programs) != 1:
        raise Fault("the program is not installed")
    env = {**os.environ, "LD_LIBRARY_PATH": os.pathsep.join(map(str, installed.libraries))}
    run([str(programs[0]), "methods"], env=env)
    strays = [p for p in installed.root.rglob("*") if p.is_file() and "test" in p.name]
    if strays:
        raise Fault(f"tests are installed: {strays}")


def check_python(installed, python, prefix):
    """The extension finds the library by itself, where the dynamic loader does not look; a package of a distribution (/usr) has no run
    path."""
    extension = next(installed.root.rglob("pellucid/_pellucid*.so"))
    said = run(["readelf", "-d", str(extension)])
    if prefix == "/usr":
        if "PATH" in said:
            raise Fault(f"below /usr the extension has a run path: {said}")
        return
    env = {k: v for k, v in os.environ.items() if k != "LD_LIBRARY_PATH"}
    found = run([python, "-c", "import pellucid; print(pellucid.__file__)"],
                env={**env, "PYTHONPATH": str(extension.parent.parent)}, cwd=installed.root)
    if str(installed.root) not in found:
        raise Fault(f"imported {found!r}")


def check_removal(build, source, scratch):
    """Files that were installed twice, and imported, are removed without a trace; files that existed before remain."""
    root, kept = scratch / "removed", scratch / "installed.txt"
    before = root / "opt" / "mine.txt"
    before.parent.mkdir(parents=True)
    before.write_text("mine")
    for _ in range(2):
        run(["meson", "install", "-C", build, "--no-rebuild", "--destdir", str(root)])
        run([str(source / "scripts/installed.py"), "remember", str(pathlib.Path(build) / "meson-logs/install-log.txt"), str(kept)])
    for module in root.rglob("pellucid/__init__.py"):
        run([sys.executable, "-m", "compileall", "-q", str(module.parent)])
    if not list(root.rglob("bin/pellucid")):
        raise Fault("nothing was installed")
    run([str(source / "scripts/installed.py"), "remove", str(kept)])
    left = [str(p) for p in root.rglob("*") if p != before and p != before.parent]
    if left or not before.exists() or kept.exists():
        raise Fault(f"is left: {left}")
    run([str(source / "scripts/installed.py"), "remove", str(kept)])


def check_version(installed):
    version = run(["pkg-config", "--modversion", "pellucid"], env=installed.env).strip()
    header = next(installed.root.rglob("pellucid/version.h")).read_text("utf-8")
    defined = dict(re.findall(r"^#define PELL_VERSION_(\w+) (.*)$", header, re.MULTILINE))
    numbers = ".".join(defined[name] for name in ("MAJOR", "MINOR", "PATCH"))
    if not version == numbers == defined["STRING"].strip('"'):
        raise Fault(f"pkg-config says {version}, the header {numbers} and {defined['STRING']}")


def main():
    build, source, cc = sys.argv[1], pathlib.Path(sys.argv[2]), sys.argv[3].split()
    cxx = sys.argv[4].split() if sys.argv[4:] and sys.argv[4] else None
    python, prefix = sys.argv[5:7] if sys.argv[6:] else ("", "")
    if not shutil.which("pkg-config"):
        print("1..0 # SKIP pkg-config is not installed")
        return 0
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        scratch = pathlib.Path(folder)
        try:
            installed = Installed(build, scratch)
        except Fault as fault:
            print("1..1\nnot ok 1 - the library installs")
            print("# " + str(fault).replace("\n", "\n# "))
            return 1
        archive = next(installed.root.rglob("libpellucid.a"), None) # none with -Ddefault_library=shared
        tests = {
            "headers, library and program are installed, and nothing else": lambda: check_files(installed, source),
            "pkg-config and the headers tell the same version": lambda: check_version(installed),
            "the archive's names are ours": (lambda: check_names(archive)) if archive else None,
            "the Makefile quotes folders": lambda: check_makefile(source),
            "a C11 program builds and renders": lambda: installed.build_and_run([*cc, "-std=c11", "-Wall", "-Wextra", "-Werror"], scratch),
            "a C11 program builds and renders with the archive, by pkg-config --static":
                (lambda: installed.build_static([*cc, "-std=c11"], scratch)) if archive else None,
            "a C++17 program builds and renders":
                (lambda: installed.build_and_run([*cxx, "-xc++", "-std=c++17", "-Wall", "-Wextra", "-Werror"], scratch)) if cxx else None,
        }
        tests["Python imports the package that was installed"] = (lambda: check_python(installed, python, prefix)) if python else None
        tests["what was installed is removed without a trace"] = lambda: check_removal(build, source, scratch)
        lacks = {"Python imports the package that was installed": "the build has no Python package",
                 "a C++17 program builds and renders": "there is no C++ compiler",
                 "a project finds it by CMake, in its own version alone": "CMake or the archive is not installed"}
        tests["a project finds it by CMake, in its own version alone"] = \
            (lambda: installed.cmake(source, scratch)) if archive and shutil.which("cmake") else None
        tests["a project finds it by Meson"] = (lambda: installed.meson(source, scratch)) if archive else None
        print(f"1..{len(tests)}")
        for i, (title, test) in enumerate(tests.items(), 1):
            try:
                if test:
                    test()
                print(f"ok {i} - {title}" + ("" if test else f" # SKIP {lacks.get(title, 'no archive is installed')}"))
            except Fault as fault:
                failed += 1
                print(f"not ok {i} - {title}")
                print("# " + str(fault).strip().replace("\n", "\n# "))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
