#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_auto.py PROGRAM ROOT: `render --max-error` selects the cheapest method of sufficient accuracy, and reports how."""
import json

from cli_test import main, need, one_object, run, sphere, test, text, works, write_obj

PICTURE = ['--size', '15mm', '--material', 'marble', '--width', '28', '--height', '21', '--msaa', '1', '--light-samples', '2',
           '--indirect-samples', '256']


def refused(folder, *arguments):
    done = run(folder, *arguments)
    need(done.returncode in (2, 3), arguments, 'ended with', done.returncode, done.stderr)
    return text(done.stderr)


def choose(folder, *options):
    return one_object(works(folder, 'render', 'ball.obj', *PICTURE, *options, '--json', '-q', '-o', 'ball.pfm'))


@test('a bound that all meet takes no scattering; one that none meets takes path-trace; between them the first that meets it')
def _(folder):
    write_obj(folder / 'ball.obj', *sphere())
    loose = choose(folder, '--max-error', '90%')
    need(loose['method'] == 'none' and len(loose['auto']['tried']) == 1, loose['auto'])
    tight = choose(folder, '--max-error', '0.5%')
    tried = tight['auto']['tried']
    need(tight['method'] == 'path-trace' and len(tried) > 5 and all(t['error'] + t['noise'] > 5e-3 for t in tried), tight['auto'])
    bound = 0.5 * (tried[0]['error'] + tried[1]['error'])
    middle = choose(folder, '--max-error', f'{100 * bound:.3f}%')
    need(tried[1]['error'] < tried[0]['error'] and middle['method'] == 'screen-space', middle['auto'], tried)
    need([t['method'] for t in middle['auto']['tried']] == ['none', 'screen-space'], middle['auto'])
    for a, b in zip(middle['auto']['tried'], tried):
        need(abs(a['error'] - b['error']) < 4 * (a['noise'] + b['noise']), a, b)


@test('the picture is the one of the method')
def _(folder):
    write_obj(folder / 'ball.obj', *sphere())
    answer = choose(folder, '-m', 'auto')
    need(answer['auto']['max_error'] == 0.08, answer['auto'])
    works(folder, 'render', 'ball.obj', *PICTURE, '-q', '-m', answer['method'], '-o', 'named.pfm')
    need((folder / 'ball.pfm').read_bytes() == (folder / 'named.pfm').read_bytes(), answer['method'])


@test('one line says what was chosen and why')
def _(folder):
    write_obj(folder / 'ball.obj', *sphere())
    said = works(folder, 'render', 'ball.obj', *PICTURE, '--max-error', '90%', '-o', 'ball.png').stderr
    said = text(said)
    need('none: ' in said and '% from path-trace on 28 x 21 pixels, 90 % are allowed' in said, said)
    need('samples per pixel' not in said, said)


@test('what does not go with it is refused')
def _(folder):
    write_obj(folder / 'ball.obj', *sphere())
    for options, what in ((['--max-error', '8'], 'percentage'), (['--max-error', '0%'], 'percentage'),
                          (['--max-error', '101%'], 'percentage'), (['--max-error', '8%', '-m', 'dipole'], '--method dipole'),
                          (['-m', 'auto', '--set', 'gaussians=2'], '--max-error'),
                          (['-m', 'auto', '--samples', '4'], '--max-error'), (['-m', 'auto', '--checkpoint', 'c'], '--checkpoint')):
        need(what in refused(folder, 'render', 'ball.obj', *PICTURE, *options, '-o', 'x.png'), options)
    opaque = {'pellucid': 1, 'mesh': 'ball.obj', 'unit': '1mm', 'materials': {'*': {'opaque': True}}}
    (folder / 'opaque.json').write_text(json.dumps(opaque))
    need('translucent' in refused(folder, 'render', 'opaque.json', '-m', 'auto', '-o', 'x.png'), 'opaque')
    need(not (folder / 'x.png').exists(), 'nothing is written')


main()
