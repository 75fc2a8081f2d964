#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_completions.py PROGRAM ROOT: completions that the shells offer for a partial command line, in the shells themselves."""
import pathlib
import shutil
import subprocess
import sys

from cli_test import PROGRAM, Skip, clean_environment, main, need, test

ROOT = pathlib.Path(sys.argv[2])
FILES = {'bash': 'pellucid.bash', 'zsh': '_pellucid', 'fish': 'pellucid.fish'}
CASES = [ # words, completions that must be offered, completions that must not
    (['com'], {'compare'}, {'render'}),
    (['render', '--mat'], {'--material'}, {'--method'}),
    (['check', '--cro'], {'--cross-section'}, set()),
    (['check', '--turn'], set(), {'--turntable'}),
    (['render', 'a.obj', '-m', 'sc'], {'screen-space'}, {'image-space'}),
    (['render', 'a.obj', '--material', 'mar'], {'marble', 'mars.json'}, {'wax'}),
    (['view', '-m', 'image-space', '--set', 'sam'], {'samples='}, {'gaussians='}),
    (['materials', 'm'], {'marble', 'moon.obj'}, {'wax'}),
    (['methods', 'pa'], {'path-trace'}, {'render'}),
    (['render', 'mo'], {'moon.obj'}, {'mars.json'}),
    (['render', 'a.obj', '--from', 'b'], {'back'}, {'black', 'front'}),
    (['render', 'a.obj', '--studio', 'r'], {'rim'}, {'right', 'soft'}),
    (['view', 'a.obj', '--background', 'gr'], {'grey'}, {'white'}),
    (['check', 'a.obj', '--up', ''], {'y', 'z'}, {'mars.json'}),
    (['render', 'a.obj', '--normals', ''], {'file', 'smooth'}, {'mars.json'}),
    (['render', 'a.obj', '--engine', 'vu'], {'vulkan'}, {'cpu'}),
    (['render', 'a.obj', '--profile', 'pho'], {'photon-beam'}, {'dipole'}),
    (['render', 'a.obj', '--tonemap', ''], {'filmic'}, {'aces'}),
    (['compare', 'a.obj', '--tonemap', ''], {'aces', 'filmic', 'linear', 'reinhard'}, {'agx'}),
    (['profile', 'marble', '--export', 'gl'], {'glsl'}, {'hlsl'}),
    (['profile', 'marble', '--from', ''], set(), {'front', 'back'}),
    (['help', 'le'], {'lengths'}, {'layers'}),
    (['help', 'co'], {'compare'}, {'render'}),
    (['he'], {'help'}, {'render'}),
]
BASH_CASES = [ # what bash alone splits or quotes
    (['render', 'a.obj', '--material', '=', 'mar'], {'marble', 'mars.json'}, {'wax'}),
    (['check', 'two'], {'two words.obj'}, {'two', 'words.obj'}),
]


def shell(name, folder, script):
    program = shutil.which(name)
    if not program:
        raise Skip(f'{name} is not installed')
    done = subprocess.run([program, *(['--norc', '--noprofile'] if name == 'bash' else ['-f'] if name == 'zsh' else ['--no-config']), '-c',
                           script], cwd=folder, env=clean_environment(HOME=str(folder)), capture_output=True, text=True, timeout=60,
                          check=False)
    need(done.returncode == 0 and not done.stderr, name, done.returncode, done.stderr)
    return done.stdout


def install_completions(folder):
    for name in ('moon.obj', 'mars.json', 'two words.obj'):
        (folder / name).write_text('')


@test('the completions are what docs/completions/make_completions.py makes of the program')
def _(folder):
    for name, file in FILES.items():
        made = subprocess.run([sys.executable, ROOT / 'docs/completions/make_completions.py', PROGRAM, name], capture_output=True,
                              text=True, check=True, env=clean_environment()).stdout
        need(made == (ROOT / 'docs/completions' / file).read_text('utf-8'),
             f'run: docs/completions/make_completions.py PROGRAM {name} > docs/completions/{file}')


@test('bash')
def _(folder):
    install_completions(folder)
    for words, offered, not_offered in CASES + BASH_CASES:
        line = ' '.join(f"'{w}'" for w in ['pellucid', *words])
        got = set(shell('bash', folder, f"source '{ROOT}/docs/completions/pellucid.bash'; COMP_WORDS=({line}); COMP_CWORD={len(words)}; "
                        '_pellucid; printf "%s\\n" "${COMPREPLY[@]}"').splitlines())
        need(offered <= got and not got & not_offered, words, sorted(got))


# An interactive zsh in a pseudo-terminal would test more, but hang on a prompt; its functions report their completions.
ZSH = """
_describe() { print -rl -- $commands }
_arguments() { print -rl -- "$@"; _pellucid_knob; _pellucid_material }
compadd() { print -rl -- ${(P)@[-1]} }
_files() { }
complete_it() { source '%s' }
words=(pellucid %s) CURRENT=%d
complete_it
"""


@test('zsh')
def _(folder):
    file = ROOT / 'docs/completions/_pellucid'
    shell('zsh', folder, f"zsh -n '{file}'")
    for words, offered, _ in CASES:
        seen = shell('zsh', folder, ZSH % (file, ' '.join(words), len(words) + 1))
        need(all(word.rstrip('=') in seen for word in offered if '.' not in word), words, seen)
        need('gaussians' not in seen.split('\n') or 'image-space' not in words, words, 'offers the knobs of another method')


@test('fish')
def _(folder):
    install_completions(folder)
    for words, offered, not_offered in CASES:
        said = shell('fish', folder, f"source '{ROOT}/docs/completions/pellucid.fish'; complete -C 'pellucid {' '.join(words)}'")
        got = {line.split('\t')[0] for line in said.split('\n')}
        if '-m' not in words or '--set' not in words: # fish offers the knobs of all methods
            need(not got & not_offered, words, sorted(got))
        need(offered <= got, words, sorted(got))


sys.exit(main())
