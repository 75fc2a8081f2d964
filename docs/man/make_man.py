#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Makes the man pages from what the program says of itself: its help is the one home of commands, options and topics.

    make_man.py PROGRAM > PROGRAM.1
    make_man.py PROGRAM COMMAND > PROGRAM-COMMAND.1
    make_man.py PROGRAM --all FOLDER       all of them
    make_man.py PROGRAM --whole            commands and their options in one page
"""
import pathlib
import re
import subprocess
import sys

# The sections that close a page, by the topics of `help` that they hold.
SECTIONS = {'lengths': 'LENGTHS', 'output': 'OUTPUT', 'noise': 'NOISE',
            'exit-codes': '"EXIT STATUS"', 'environment': 'ENVIRONMENT', 'files': 'FILES'}

# What the page of another program refers to.
RELATED = ('pellucid', 'pellucid-render', 'pellucid-merge', 'mpirun')


def say(program, *arguments):
    return subprocess.run([program, *arguments], check=True, capture_output=True, text=True).stdout


def escape(text):
    text = text.replace('\\', r'\(rs').replace('-', r'\-').replace('`', r'\(ga').replace("'", r'\(aq')
    return re.sub(r'^([.])', r'\\&\1', text, flags=re.MULTILINE)


def commands(program):
    """Names in the order of `pellucid --help`."""
    return re.findall(r'^  ([a-z][a-z-]*) ', say(program, '--help').split('\n  -h, --help')[0], flags=re.MULTILINE)


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


def topic(program, name):
    """A topic as a section: paragraphs, then rows of a name and a text."""
    yield f'.SH {SECTIONS[name]}\n'
    rows, paragraph = [], []
    for line in say(program, 'help', name).splitlines()[2:] + ['']:
        if re.match(r'  (?:-\w, |    )--|--set ', line):  # an option or a knob of that name, which help has behind the topic
            break
        found = re.match(r'  (\S+(?: \S+)*)(?:  +(\S.*))?$', line)
        if found:
            rows.append([found[1], found[2] or ''])
        elif line.startswith(' ' * 22):
            rows[-1][1] += ' ' + line.strip()
        elif line:
            paragraph.append(line)
        elif paragraph:
            yield f'.PP\n{escape(" ".join(paragraph))}\n'
            paragraph = []
    for key, text in rows:
        yield f'.TP\n.B {escape(key)}\n{escape(text.strip())}\n'


def head_of(program, name, about):
    version = say(program, '--version').split()[1]
    yield '.\\" SPDX-License-Identifier: MIT\n.\\" Made by docs/man/make_man.py from the program\'s help.\n'
    yield f'.TH {escape(name.upper())} 1 "" "pellucid {version}" "User commands"\n.SH NAME\n'
    yield f'{escape(name)} \\- {escape(about)}\n.SH SYNOPSIS\n'


def synopsis(usage):
    command, rest = re.match(r'(\S+(?: [a-z]+)?) ?(.*)', usage).groups()
    yield f'.B {escape(command)}\n{escape(rest)}\n.br\n'


def command_list(called, helps):
    for name, (head, *_) in helps.items():
        yield f'.TP\n.BR {escape(called)}\\-{name} (1)\n{escape(head.split(" - ", 1)[1])}\n'
    yield '.SH OPTIONS\nof every command; those of one command are in its page:\n'
    yield from option_rows(common_options(helps))


def common_options(helps):
    return [o for o in next(iter(helps.values()))[4] if all(o in h[4] for h in helps.values())]


def whole_commands(_, helps):
    for name, (head, _, paragraphs, examples, _) in helps.items():
        yield f'.SS {name}\n{escape(head.split(" - ", 1)[1])}.\n'
        for paragraph in paragraphs:
            yield f'.PP\n{escape(paragraph)}\n'
        yield f'.PP\n.nf\n{escape(examples.rstrip())}\n.fi\n'
    common = common_options(helps)
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


def page(program, whole=False):
    called, about = say(program, '--help').split('\n', 1)[0].split(' - ', 1)
    helps = {name: split_help(say(program, name, '--help')) for name in commands(program)}
    yield from head_of(program, called, about)
    for _, usage, *_ in helps.values():
        yield from synopsis(usage)
    yield f'.B {escape(called)}\n\\-\\-help | \\-\\-version | help NAME\n.SH COMMANDS\n'
    yield from (whole_commands if whole else command_list)(called, helps)
    for name in SECTIONS:
        if not whole or name != 'files':  # what is installed is pellucid's
            yield from topic(program, name)
    if whole:
        others = ', '.join(f'\\fB{escape(name)}\\fP(1)' for name in RELATED)
        yield f'.SH "SEE ALSO"\n{others}\n'


def command_page(program, name):
    called = say(program, '--help').split(' - ', 1)[0]
    head, usage, paragraphs, examples, options = split_help(say(program, name, '--help'))
    yield from head_of(program, f'{called}-{name}', head.split(' - ', 1)[1])
    yield from synopsis(usage)
    yield '.SH DESCRIPTION\n' + (f'{escape(head.split(" - ", 1)[1])}.\n' if not paragraphs else '')
    for paragraph in paragraphs:
        yield f'.PP\n{escape(paragraph)}\n'
    yield '.SH OPTIONS\n'
    yield from option_rows(options)
    yield f'.SH EXAMPLES\n.nf\n{escape(examples.rstrip())}\n.fi\n'
    yield from topic(program, 'exit-codes')
    yield f'.SH "SEE ALSO"\n.BR {escape(called)} (1)\n'


def pages(program):
    """File name -> text of every page."""
    called = say(program, '--help').split(' - ', 1)[0]
    yield f'{called}.1', ''.join(page(program))
    for name in commands(program):
        yield f'{called}-{name}.1', ''.join(command_page(program, name))


def main():
    program = sys.argv[1]
    if sys.argv[2:3] == ['--all']:
        for name, text in pages(program):
            (pathlib.Path(sys.argv[3]) / name).write_text(text, encoding='utf-8')
    else:
        whole, command = sys.argv[2:3] == ['--whole'], sys.argv[2:3]
        sys.stdout.write(''.join(command_page(program, command[0]) if command and not whole else page(program, whole)))


if __name__ == '__main__':
    main()
