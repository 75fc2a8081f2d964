#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_memory.py PROGRAM ROOT: behaviour where the machine provides less memory than is needed."""
import resource
import signal
import subprocess
import sys

from cli_test import PROGRAM, SANITIZED, Skip, clean_environment, main, need, sphere, test, write_obj

MIB = 1 << 20
OUT_OF_MEMORY = 5


def starved(folder, limit, *arguments):
    """Runs with an address space of `limit` MiB; returns the exit code and the messages."""
    def limited():
        resource.setrlimit(resource.RLIMIT_AS, (int(limit * MIB), int(limit * MIB)))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    done = subprocess.run([PROGRAM, 'render', 'ball.obj', '--size', '40mm', '--material', 'marble', '--width', '16', '--height', '9',
                           '--msaa', '1', '-q', '-o', 'a.png', *arguments], cwd=folder, env=clean_environment(), check=False,
                          preexec_fn=limited, stdin=subprocess.DEVNULL, capture_output=True, timeout=60)
    return done.returncode, done.stderr


def enough(folder, *arguments):
    """The least number of MiB that suffices, to 2."""
    low, high = 0, 2048
    while high - low > 2:
        middle = (low + high) // 2
        low, high = (low, middle) if starved(folder, middle, *arguments)[0] == 0 else (middle, high)
    return high


@test('an address space that is too small, in steps of some MiB: exit code 5 and one error, whatever the threads')
def _(folder):
    if SANITIZED:
        raise Skip('a sanitizer has an address space of its own')
    write_obj(folder / 'ball.obj', *sphere(rows=60, columns=100))
    for threads, method, below, step in (('1', 'none', 60, 3), ('2', 'none', 60, 3), ('7', 'none', 60, 3), ('1', 'texture-space', 160, 10)):
        top = enough(folder, '--threads', threads, '-m', method)
        for limit in range(top - below, top, step):
            code, said = starved(folder, limit, '--threads', threads, '-m', method)
            need(code in (0, OUT_OF_MEMORY), threads, 'threads,', limit, 'MiB:', signal.Signals(-code).name if code < 0 else code, said)
            need(code == 0 or (said.count(b'error: ') == 1 and b'terminate' not in said), threads, 'threads,', limit, 'MiB:', said)


@test('little more than the program and its threads take, in steps of 192 KiB: the stack is there, too')
def _(folder):
    if SANITIZED:
        raise Skip('a sanitizer has an address space of its own')
    write_obj(folder / 'ball.obj', *sphere(rows=10, columns=16))
    arguments = ['--threads', '7', '-m', 'none']
    low, high = 0, 1024 # MiB: too little for the dynamic loader, and enough for a message
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if starved(folder, middle, *arguments)[0] in (0, OUT_OF_MEMORY) else (middle, high)
    for limit in range(16 * (high + 1), 16 * (high + 48), 3):
        code, said = starved(folder, limit / 16, *arguments)
        need(code in (0, OUT_OF_MEMORY), limit / 16, 'MiB:', signal.Signals(-code).name if code < 0 else code, said)


sys.exit(main())
