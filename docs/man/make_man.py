#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Makes the man page from what the program says of itself: its --help is the one home of commands and options.

    make_man.py PROGRAM > PROGRAM.1
"""
import re
import subprocess
import sys

CLOSING = r'''.SH LENGTHS
A length always carries its unit: 70mm, 7cm, 0.07m, 2in. A bare number is refused: how deep light goes into an object is a length, and
without a scale the picture would be arbitrary.
.SH OUTPUT
Results go to standard output, messages and progress to standard error. With
.B \-\-json
standard output holds exactly one JSON object, which is {"error": {"code", "where", "what", "hint"}} after a failure.
A file is written under a temporary name and renamed when it is whole; what was there before stays until then.
.SH "EXIT STATUS"
.TP
.B 0
Success.
.TP
.B 1
Failed: the answer could not be written, for example.
.TP
.B 2
Wrong usage: an unknown command, option, method, material or knob, a value out of range, a mesh without a unit.
.TP
.B 3
Bad input: a file is missing, damaged, of an unknown format, over a limit, or can't be written;
.B check
found a problem that is an error.
.TP
.B 4
The engine or device asked for is not there.
.TP
.B 5
Out of memory, or over the limit memory\-bytes.
.TP
.B 75
ended by a time limit or SIGTERM, and resumable from its checkpoint
.TP
.B 130
Interrupted (Ctrl\-C). Nothing half\-written is left; a second Ctrl\-C stops at once.
.SH ENVIRONMENT
.TP
.B NO_COLOR
If set and not empty: no colours. There are none either where the output is no terminal, or TERM is dumb.
.TP
.B PELL_SIMD
base, v2, v3 or v4: the highest level of vector instructions to use. All levels give the same bits.
.SH FILES
.TP
.I PREFIX/share/pellucid/bench
The scenes of
.BR bench .
.TP
.I PREFIX/share/pellucid/examples
Scene files to start from.
'''


def say(program, *arguments):
    return subprocess.run([program, *arguments], check=True, capture_output=True, text=True).stdout


def escape(text):
    text = text.replace('\\', r'\(rs').replace('-', r'\-').replace('`', r'\(ga').replace("'", r'\(aq')
    return re.sub(r'^([.])', r'\\&\1', text, flags=re.MULTILINE)


def commands(program):
    """Names in the order of `pellucid --help`."""
    return re.findall(r'^  ([a-z][a-z-]*) ', say(program, '--help').split('Start here')[0], flags=re.MULTILINE)


def split_help(text):
    """The parts of a command's help: head, usage, paragraphs, examples, [(option, text)]."""
    head, rest = text.split('\n\nusage: ', 1)
    usage, rest = rest.split('\n\n', 1)
    body, rest = rest.split('Examples\n', 1)
    examples, rest = rest.split('\nOptions\n', 1)
    options = []
    for line in rest.splitlines():
        found = re.match(r'  (?:-\w, |    )(--\S+(?: \S+)?)(?:  +(.*))?$', line) or re.match(r'  (?:-\w, |    )(--\S+ \S+) (.*)$', line)
        if found:
            options.append([line[2:6].strip() + (' ' if line[2] == '-' else '') + found[1], found[2] or ''])
        else:
            options[-1][1] += ' ' + line.strip()
    return head, usage, [' '.join(p.split('\n')) for p in body.strip().split('\n\n') if p], examples, options


def option_rows(options):
    for name, text in options:
        yield '.TP\n'
        yield f'.B {escape(name)}\n{escape(text.strip())}\n'


def page(program):
    version = say(program, '--version').split()[1]
    called, about = say(program, '--help').split('\n', 1)[0].split(' - ', 1)
    helps = {name: split_help(say(program, name, '--help')) for name in commands(program)}
    yield '.\\" SPDX-License-Identifier: MIT\n.\\" Made by docs/man/make_man.py from the program\'s --help.\n'
    yield f'.TH {escape(called.upper())} 1 "" "pellucid {version}" "User commands"\n.SH NAME\n'
    yield f'{escape(called)} \\- {about}\n.SH SYNOPSIS\n'
    for _, usage, *_ in helps.values():
        yield f'.B {escape(usage.split(" ", 1)[0])}\n{escape(usage.split(" ", 1)[1])}\n.br\n'
    yield f'.B {escape(called)}\n\\-\\-help | \\-\\-version\n.SH COMMANDS\n'
    for name, (head, _, paragraphs, examples, _) in helps.items():
        yield f'.SS {name}\n{escape(head.split(" - ", 1)[1])}.\n'
        for paragraph in paragraphs:
            yield f'.PP\n{escape(paragraph)}\n'
        yield f'.PP\n.nf\n{escape(examples.rstrip())}\n.fi\n'
    common = [o for o in next(iter(helps.values()))[4] if all(o in h[4] for h in helps.values())]
    yield '.SH OPTIONS\n.SS "of every command"\n'
    yield from option_rows(common)
    shown = [o[0] for o in common]
    for name, help_ in helps.items():
        rows = [o for o in help_[4] if o[0] not in shown]
        again = [o for o in help_[4] if o[0] in shown and o not in common]
        if not rows and not again:
            continue
        yield f'.SS "of {name}"\n'
        yield from option_rows(rows)
        if again:
            names = ', '.join(escape(re.sub(r'.*(--\S+).*', r'\1', o[0])) for o in again)
            yield f'.PP\nAs above: {names}.\n'
        shown += [o[0] for o in rows]
    yield CLOSING


def main():
    sys.stdout.write(''.join(page(sys.argv[1])))


if __name__ == '__main__':
    main()
