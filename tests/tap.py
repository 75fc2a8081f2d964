#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Runs one test program and hands its TAP on, with skipped tests as TAP has them.

cmocka 1.1 prints "not ok 3 # SKIP name" for a skipped test, which Meson counts as a failure; it becomes "ok 3 - name # SKIP reason".
The reason is the comment "# skipped: ..." in front of it. Everything else, and the exit status, passes unchanged.
"""
import os
import re
import signal
import subprocess
import sys


def main():
    reason = ""
    with subprocess.Popen(sys.argv[1:], stdout=subprocess.PIPE) as child:
        signal.signal(signal.SIGTERM, lambda *_: child.terminate())
        for line in child.stdout:
            text = line.decode("utf-8", "replace")
            skipped = re.match(r"not ok (\d+) # SKIP (.*)", text)
            if skipped:
                text = f"ok {skipped[1]} - {skipped[2]} # SKIP {reason}\n"
            reason = text[11:].strip() if text.startswith("# skipped: ") else reason if text.startswith("#") else ""
            sys.stdout.write(text)
            sys.stdout.flush()
    if child.returncode < 0:
        signal.signal(-child.returncode, signal.SIG_DFL)
        os.kill(os.getpid(), -child.returncode)
    return child.returncode


if __name__ == "__main__":
    sys.exit(main())
