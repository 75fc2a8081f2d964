#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Makes the completions of a shell from what the program says of itself: --help, `help topics`, and `methods`, `materials` and `info` with
--json.

    make_completions.py PROGRAM bash|zsh|fish
"""
import json
import pathlib
import re
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / 'man'))
from make_man import commands, say, split_help  # noqa: E402

MADE = '# SPDX-License-Identifier: MIT\n# Made by docs/completions/make_completions.py from what the program says of itself.\n'


class Program:
    """Commands with their options, (letter or '', name, value or '', text), and the names that values may be."""

    def __init__(self, path):
        self.commands = {}
        for name in commands(path):
            head, usage, _, _, options = split_help(say(path, name, '--help'))
            rows = []
            for option, text in options:
                letter, word, value = re.fullmatch(r'(?:(-\w), ?)?(--[\w-]+)(?: (\S+))?', option).groups()
                rows.append((letter or '', word, value or '', text.strip()))
            self.commands[name] = (head.split(' - ', 1)[1], usage.split()[2:3], rows)
        methods = json.loads(say(path, 'methods', '--json'))['methods']
        self.methods = ['none', *(m['name'] for m in methods)]
        self.knobs = {m['name']: [k['name'] for k in m['knobs']] for m in methods}
        self.materials = [m['name'] for m in json.loads(say(path, 'materials', '--json'))['materials']]
        self.choices = json.loads(say(path, 'info', '--json'))['choices']
        self.choices |= {'method': self.methods, 'material': self.materials, 'methods': [*self.methods, 'all'],
                         'reference': self.methods[1:], 'compare': [*self.choices['model'], 'all']}
        topics = re.findall(r'^  ([a-z][a-z-]*) ', say(path, 'help', 'topics'), flags=re.MULTILINE)
        self.help = list(dict.fromkeys([*self.commands, *topics, 'topics']))

    def words_of(self, command, option, value):
        """Names that the option's value may be."""
        if not value or value in ('N', 'LENGTH') or is_file(value) and option != '--material':
            return []
        return self.choices.get(f'{command}/{option[2:]}', self.choices.get(option[2:], []))

    def named(self):
        """(options, commands, names that their value may be) for each option that has names; commands ['*']: all that have it."""
        found = {}
        for command, (_, _, rows) in self.commands.items():
            for letter, word, value, _ in rows:
                found.setdefault((letter, word), {}).setdefault(tuple(self.words_of(command, word, value)), []).append(command)
        for (letter, word), sets in sorted(found.items()):
            for words, commands_ in sets.items():
                if words and word != '--material':
                    yield [o for o in (letter, word) if o], commands_ if len(sets) > 1 else ['*'], words


def is_file(value):
    return 'FILE' in value or 'FOLDER' in value


HELP = 'about a command or a topic'
FILES = 'compgen -f -- "$current"'


def bash_list(*commands):
    """Lines of commands, each one word, as what is offered: names of files may hold blanks."""
    return f'mapfile -t COMPREPLY < <({"; ".join(commands)})'


def bash(p):
    yield MADE
    yield '_pellucid()\n{\n    local current=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]}\n'
    yield '    local command=${COMP_WORDS[1]} method=screen-space i\n    COMPREPLY=()\n'
    # --option=value comes as three words
    yield '    if [ "$current" = = ]; then current=; elif [ "$before" = = ]; then before=${COMP_WORDS[COMP_CWORD-2]}; fi\n'
    yield '\n    if [ "$COMP_CWORD" = 1 ]; then\n'
    yield f'        COMPREPLY=($(compgen -W "{" ".join([*p.commands, "help"])} --help --version" -- "$current"))\n        return\n    fi\n'
    yield '    [ "$command" = help ] && { COMPREPLY=($(compgen -W "' + ' '.join(p.help) + '" -- "$current")); return; }\n'
    yield '    for ((i = 2; i < COMP_CWORD - 1; i++)); do\n'
    yield '        case ${COMP_WORDS[i]} in -m | --method) method=${COMP_WORDS[i+1]} ;; esac\n    done\n'
    yield '    case $command:$before in\n'
    for options, commands_, words in p.named():
        names = ' | '.join(f'{c}:{o}' for o in options for c in commands_)
        yield f'    {names}) COMPREPLY=($(compgen -W "{" ".join(words)}" -- "$current")); return ;;\n'
    yield '    esac\n'
    yield '    case $before in\n'
    materials = f'compgen -W "{" ".join(p.materials)}" -- "$current"'
    yield f'    --material) {bash_list(materials, FILES)}; return ;;\n'
    yield '    --set)\n        compopt -o nospace +o filenames 2>/dev/null\n        case $method in\n'
    for method, knobs in p.knobs.items():
        yield f'        {method}) COMPREPLY=($(compgen -S = -W "{" ".join(knobs)}" -- "$current")) ;;\n'
    yield '        esac\n        return ;;\n'
    files = sorted({o for _, _, rows in p.commands.values() for letter, word, value, _ in rows if is_file(value) and word != '--material'
                    for o in (letter, word) if o})
    others = sorted({o for _, _, rows in p.commands.values() for letter, word, value, _ in rows
                     if value and not is_file(value) and word not in ('--material', '--set') for o in (letter, word) if o})
    yield f'    {" | ".join(files)}) {bash_list(FILES)}; return ;;\n'
    yield f'    {" | ".join(others)}) return ;;\n    esac\n'
    yield '    case $current in\n    -*)\n        case $command in\n'
    for name, (_, _, rows) in p.commands.items():
        yield f'        {name}) COMPREPLY=($(compgen -W "{" ".join(word for _, word, _, _ in rows)}" -- "$current")) ;;\n'
    yield '        esac\n        return ;;\n    esac\n    case $command in\n'
    yield f'    methods) COMPREPLY=($(compgen -W "{" ".join(p.knobs)}" -- "$current")) ;;\n'
    yield f'    materials | profile) {bash_list(materials, FILES)} ;;\n'
    yield f'    *) {bash_list(FILES)} ;;\n'
    yield '    esac\n}\ncomplete -o filenames -F _pellucid pellucid\n'


def quoted(text):
    """Inside '...' of zsh and fish."""
    return text.replace("'", "\u2019")


def zsh_text(text):
    return re.sub(r'([\[\]:\\])', r'\\\1', quoted(text))


def zsh(p):
    yield '#compdef pellucid\n' + MADE
    yield '_pellucid_material()\n{\n    local -a materials\n'
    yield f'    materials=({" ".join(p.materials)})\n    compadd -a materials\n    _files\n}}\n'
    yield '_pellucid_knob()\n{\n    compadd -S = -a knobs\n}\n'
    yield 'local -a commands\ncommands=(\n'
    for name, (summary, _, _) in p.commands.items():
        yield f"    '{name}:{zsh_text(summary)}'\n"
    yield f"    'help:{HELP}'\n"
    yield ')\nif (( CURRENT == 2 )); then\n    _describe command commands\n    return\nfi\n'
    yield f'if [[ $words[2] == help ]]; then\n    local -a topics\n    topics=({" ".join(p.help)})\n    compadd -a topics\n    return\nfi\n'
    yield 'local chosen=$words[2]\nlocal method=screen-space\n(( words[(I)-m] )) && method=$words[words[(I)-m]+1]\n'
    yield '(( words[(I)--method] )) && method=$words[words[(I)--method]+1]\nlocal -a knobs\ncase $method in\n'
    for method, knobs in p.knobs.items():
        yield f'{method}) knobs=({" ".join(knobs)}) ;;\n'
    yield 'esac\nshift words\n(( CURRENT-- ))\ncase $chosen in\n'
    for name, (_, arguments, rows) in p.commands.items():
        yield f'{name})\n    _arguments -s'
        for letter, word, value, text in rows:
            words = p.words_of(name, word, value)
            action = (':material:_pellucid_material' if word == '--material' else ':knob:_pellucid_knob' if word == '--set' else
                      f":{zsh_text(value.lower())}:({' '.join(words)})" if words else
                      f':{value.lower()}:_files' if is_file(value) else f':{zsh_text(value.lower())}:' if value else '')
            for option in [word, *([letter] if letter else [])]:
                yield f" \\\n        '*{option}[{zsh_text(text)}]{action}'"
        what = {'methods': ':method:(' + ' '.join(p.knobs) + ')', 'materials': ':material:_pellucid_material',
                'profile': ':material:_pellucid_material'}
        if arguments and not arguments[0].startswith('[OPTIONS'):
            yield f" \\\n        '*{what.get(name, ':file:_files')}'"
        yield '\n    ;;\n'
    yield 'esac\n'


def fish(p):
    yield MADE
    yield 'complete -c pellucid -f\n'
    first = '__fish_use_subcommand'
    for name, (summary, _, _) in p.commands.items():
        yield f"complete -c pellucid -n {first} -a {name} -d '{quoted(summary)}'\n"
    yield f"complete -c pellucid -n {first} -a help -d '{HELP}'\n"
    yield f"complete -c pellucid -n '__fish_seen_subcommand_from help' -a '{' '.join(p.help)}'\n"
    for name, (_, arguments, rows) in p.commands.items():
        seen = f"'__fish_seen_subcommand_from {name}'"
        for letter, word, value, text in rows:
            words = p.words_of(name, word, value)
            if word == '--set':
                words = sorted({f'{knob}=' for knobs in p.knobs.values() for knob in knobs})
            line = f'complete -c pellucid -n {seen} -l {word[2:]}' + (f' -s {letter[1:]}' if letter else '')
            line += (' -r -F' if is_file(value) else ' -x' if value else '') + (f" -a '{' '.join(words)}'" if words else '')
            yield f"{line} -d '{quoted(text)}'\n"
        names = {'methods': list(p.knobs), 'materials': p.materials, 'profile': p.materials}.get(name, [])
        if names:
            yield f"complete -c pellucid -n {seen} -a '{' '.join(names)}'\n"
        if arguments and name not in ('methods', 'info'):
            yield f'complete -c pellucid -n {seen} -F\n'


def main():
    sys.stdout.write(''.join({'bash': bash, 'zsh': zsh, 'fish': fish}[sys.argv[2]](Program(sys.argv[1]))))


if __name__ == '__main__':
    main()
