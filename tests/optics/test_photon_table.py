#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""pell-photon-table and gen_profiles.py: the same bytes for any number of threads and stops, and refusals of damaged files."""
import json
import os
import subprocess
import sys
import tempfile

program, generator, header, shipped = sys.argv[1:5]
checks = []
PHOTONS = ['--photons', '8000', '--quiet']


def check(name, ok, detail=''):
    checks.append(ok)
    print(f'{"ok" if ok else "not ok"} {len(checks)} - {name}')
    if not ok and detail:
        print('# ' + str(detail).replace('\n', '\n# '))


def run(*args):
    return subprocess.run([program, *args], capture_output=True, text=True, timeout=120)


def read(path):
    with open(path, 'rb') as file:
        return file.read()


def generate(path, output):
    return subprocess.run([sys.executable, generator, '--header', header, '--output', output, path], capture_output=True, text=True)


with tempfile.TemporaryDirectory() as folder:
    def at(name):
        return os.path.join(folder, name)

    one = run(*PHOTONS, '--threads', '1', '--output', at('one.json'))
    check('one thread makes a table', one.returncode == 0, one.stderr)
    three = run(*PHOTONS, '--threads', '3', '--output', at('three.json'))
    check('three threads make the same bytes', three.returncode == 0 and read(at('one.json')) == read(at('three.json')), three.stderr)

    states = []
    for stop in (['--stop-after', '30'], ['--stop-after', '70'], ['--output', at('resumed.json')]):
        r = run(*PHOTONS, '--threads', '2', '--resume', at('state'), *stop)
        states.append(r.returncode)
    check('resumed twice, the same bytes', states == [0, 0, 0] and read(at('one.json')) == read(at('resumed.json')), states)

    other = run(*PHOTONS, '--seed', '2', '--output', at('other.json'))
    check('another seed, other numbers', other.returncode == 0 and read(at('one.json')) != read(at('other.json')), other.stderr)

    r = run(*PHOTONS, '--seed', '2', '--resume', at('state'))
    check('a state of another seed is refused', r.returncode == 1 and 'seed' in r.stderr, r.stderr)
    with open(at('cut'), 'wb') as file:
        file.write(read(at('state'))[:-1])
    r = run(*PHOTONS, '--resume', at('cut'))
    check('a cut state is refused', r.returncode == 1 and 'no state' in r.stderr, r.stderr)
    r = run(*PHOTONS, '--stop-after', '0', '--output', at('none.json'))
    check('no table of nothing', r.returncode == 1 and 'batches' in r.stderr and not os.path.exists(at('none.json')), r.stderr)
    r = run('--photons', '1', '--quiet', '--output', at('none.json'))
    check_few = r.returncode == 1 and 'too few' in r.stderr and not os.path.exists(at('none.json'))
    check('no table of too few photons', check_few, r.stderr)
    r = run('--photons', '0')
    check('a number out of range is a wrong use', r.returncode == 2 and r.stderr.count('\n') == 1, r.stderr)
    r = run('--help')
    check('--help tells the options', r.returncode == 0 and '--resume' in r.stdout and '--seed' in r.stdout, r.stdout)

    r = generate(at('one.json'), at('one.c'))
    check('what it makes becomes C', r.returncode == 0 and b'pell_photon_table_data' in read(at('one.c')), r.stderr)
    r = generate(shipped, at('shipped.c'))
    check('what ships becomes C', r.returncode == 0, r.stderr)
    check('what ships is small', len(read(shipped)) < 400000, len(read(shipped)))

    with open(shipped, encoding='utf-8') as file:
        good = json.load(file)

    def damaged(name, word, change):
        table = json.loads(json.dumps(good))
        change(table)
        with open(at('bad.json'), 'w', encoding='utf-8') as file:
            json.dump(table, file)
        r = generate(at('bad.json'), at('bad.c'))
        check(f'refused: {name}', r.returncode == 1 and word in r.stderr and 'Traceback' not in r.stderr, r.stderr)

    damaged('a missing axis', 'eta', lambda t: t.pop('eta'))
    damaged('an axis that falls', 'g:', lambda t: t['g'].reverse())
    damaged('a row too few', 'rows', lambda t: t['rows'].pop())
    damaged('a number of more than 16 bits', 'rows[5]', lambda t: t['rows'][5][1].__setitem__(3, 40000))
    damaged('a total above 1', 'rows[0]', lambda t: t['rows'][0][0].__setitem__(0, 1.5))
    damaged('an error that is no number', 'rows[2]', lambda t: t['rows'][2][2].__setitem__(0, None))

print(f'1..{len(checks)}')
sys.exit(0 if all(checks) else 1)
