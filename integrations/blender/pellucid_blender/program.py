# SPDX-License-Identifier: MIT
"""Finding and running the program `pellucid`."""
import json
import os
import shutil
import subprocess
import threading


class Trouble(Exception):
    """An error that the user can correct: the text says what, where and how."""


def find(wanted):
    """The program's path: the one of the preferences, or the first of PATH."""
    name = wanted.strip() or 'pellucid'
    path = shutil.which(os.path.expanduser(name))
    if path:
        return path
    if wanted.strip():
        raise Trouble(f'"{wanted}" is no program. Correct "Program" in Preferences, Add-ons, Pellucid, or clear it to search PATH')
    raise Trouble('The program pellucid was not found in PATH. Install it, or set "Program" in Preferences, Add-ons, Pellucid')


def start(program, arguments, folder, output=subprocess.PIPE):
    """Starts the program; its messages go to a file, so that a full pipe blocks nobody."""
    with open(os.path.join(folder, 'messages.txt'), 'wb') as messages:
        try:
            return subprocess.Popen([program, *arguments], stdin=subprocess.DEVNULL, stdout=output, stderr=messages, cwd=folder)
        except OSError as fault:
            raise Trouble(f'{program} does not start: {fault.strerror}') from fault


def messages(folder):
    with open(os.path.join(folder, 'messages.txt'), encoding='utf-8', errors='replace') as file:
        return [line.strip() for line in file if line.strip()]


def finish(process, folder):
    """Raises an error for a failed run, with its messages; returns its warnings."""
    said = messages(folder)
    if process.returncode:
        first = next((i for i, line in enumerate(said) if line.startswith('error')), 0)
        about = '; '.join(line.removeprefix('error: ') for line in said[first:][:4]) or 'it said nothing'
        ended = f'with exit code {process.returncode}' if process.returncode > 0 else f'by signal {-process.returncode}'
        raise Trouble(f'pellucid ended {ended}: {about}')
    return [line for line in said if line.startswith('warning')]


def stop(process):
    """Ends a process that still runs, by force if it does not end in two seconds; None: there is none."""
    if process is None or process.poll() is not None:
        return
    process.terminate()
    try:
        process.wait(2)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def names(program, kind):
    """(name, title) of the built-in materials or of the methods, sorted by name."""
    done = subprocess.run([program, kind, '--json'], stdin=subprocess.DEVNULL, capture_output=True, timeout=60, check=False)
    try:
        return sorted((row['name'], row['title']) for row in json.loads(done.stdout)[kind])
    except (ValueError, KeyError, TypeError) as fault:
        raise Trouble(f'{program} does not list its {kind} by "{kind} --json" (exit code {done.returncode}): '
                      'is it another program, or too old?') from fault


class Names(threading.Thread):
    """Asks for names in the background: a field of a panel must not wait for a program. `found`: None until they are there."""

    def __init__(self, program, kind):
        super().__init__(daemon=True)
        self.program, self.kind, self.found = program, kind, None

    def run(self):
        try:
            self.found = names(self.program, self.kind)
        except (Trouble, OSError, subprocess.SubprocessError):
            pass # a render reports the reason; the next search asks again
