#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""installed.py remember LOG LIST: adds the files of an installation (Meson's install-log.txt) to LIST, and reports where the loader
does not find the library, unless the files are for elsewhere (DESTDIR).
   installed.py remove LIST: removes all of it, the byte code that Python has left next to it, and the folders that it made and that are
empty then; and LIST.

Meson's own log lists only the last installation: after a second one it has no folders, and after the tests, which install into a
scratch folder, nothing else."""
import os
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent


def tell_loader(paths):
    for folder in sorted({p.parent for p in map(pathlib.Path, paths) if p.name == 'libpellucid.so'}):
        subprocess.run([HERE / 'loader.sh', folder], check=False)


def remember(log, kept):
    there = kept.read_text('utf-8').splitlines() if kept.exists() else []
    new = [line for line in log.read_text('utf-8').splitlines() if line and not line.startswith('#')]
    kept.write_text('\n'.join(dict.fromkeys(there + new)) + '\n', 'utf-8')
    if not os.environ.get('DESTDIR'):
        tell_loader(new)


def remove_file(path):
    path.unlink(missing_ok=True)
    if path.suffix == '.py':
        cache = path.parent / '__pycache__'
        for compiled in cache.glob(path.stem + '.*.pyc'):
            compiled.unlink()
        if cache.is_dir() and not any(cache.iterdir()):
            cache.rmdir()


def remove(kept):
    """False where a file could not be removed; it stays in the list."""
    if not kept.exists():
        print('nothing is installed from this build')
        return True
    paths = [pathlib.Path(line) for line in kept.read_text('utf-8').splitlines()]
    folders = [p for p in paths if p.is_dir() and not p.is_symlink()]
    left = []
    for path in paths:
        if path in folders:
            continue
        try:
            remove_file(path)
        except OSError as error:
            left.append(path)
            print(f'{path}: {error.strerror}', file=sys.stderr)
    tell_loader(paths)
    for folder in sorted(folders, key=lambda p: len(p.parts), reverse=True):
        if not any(folder.iterdir()):
            folder.rmdir()
    if left:
        kept.write_text('\n'.join(map(str, left + folders)) + '\n', 'utf-8')
        return False
    kept.unlink()
    print(f'removed: {len(paths) - len(folders)} files')
    return True


def main():
    if sys.argv[1:2] == ['remember'] and len(sys.argv) == 4:
        remember(pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3]))
        return 0
    if sys.argv[1:2] == ['remove'] and len(sys.argv) == 3:
        return 0 if remove(pathlib.Path(sys.argv[2])) else 1
    print(__doc__, file=sys.stderr)
    return 2


if __name__ == '__main__':
    sys.exit(main())
