#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_profile.py PROGRAM ROOT: `pellucid profile`: its numbers, tables, plots and code, and refusals."""
import csv
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree

from cli_test import PROGRAM, Skip, clean_environment, main, names, need, one_object, png_pixels, release_only, run, test, text, works

MARBLE = {'sigma_a': [0.0021, 0.0041, 0.0071], 'sigma_s_reduced': [2.19, 2.62, 3.0], 'eta': 1.5}


def near(a, b, tolerance):
    return abs(a - b) <= tolerance * max(abs(a), abs(b), 1e-300)


def profile(folder, *arguments):
    return one_object(works(folder, 'profile', *arguments, '--json'))


def dipole(r, sigma_a, sigma_s, A):
    """Jensen et al. 2001, eq. (4)."""
    st = sigma_a + sigma_s
    str_ = math.sqrt(3 * sigma_a * st)
    zr = 1 / st
    zv = zr * (1 + 4 * A / 3)
    total = 0.0
    for z in (zr, zv):
        d = math.hypot(r, z)
        total += z * (1 + str_ * d) * math.exp(-str_ * d) / d ** 3
    return sigma_s / st / (4 * math.pi) * total


def fdr(eta, n=20000):
    """Fresnel reflectance averaged over a diffuse hemisphere, from inside; midpoints in cos^2."""
    total = 0.0
    for i in range(n):
        mu2 = (i + 0.5) / n
        sin2 = (1 - mu2) * eta * eta
        if sin2 >= 1:
            total += 1
            continue
        mu, mt = math.sqrt(mu2), math.sqrt(1 - sin2)
        rs, rp = (eta * mu - mt) / (eta * mu + mt), (mu - eta * mt) / (mu + eta * mt)
        total += 0.5 * (rs * rs + rp * rp)
    return total / n


# --- Numbers ------------------------------------------------------------------------------------------------------------------------

@test('profile --json: the keys of the guide, the dipole of the paper, its total, and a fit that keeps it')
def _(folder):
    answer = profile(folder, 'marble')
    need({'material', 'model', 'eta', 'mean_free_path', 'diffuse_mean_free_path', 'channels'} <= set(answer), answer.keys())
    need(answer['material'] == 'marble' and answer['model'] == 'dipole' and answer['eta'] == 1.5, answer)
    f = fdr(1.5)
    A = (1 + f) / (1 - f)
    for c, channel in enumerate(answer['channels']):
        need(channel['channel'] == 'rgb'[c], channel['channel'])
        a, s = MARBLE['sigma_a'][c], MARBLE['sigma_s_reduced'][c]
        need(near(channel['sigma_tr'], math.sqrt(3 * a * (a + s)), 1e-8), channel['sigma_tr'])
        need(len(channel['r_mm']) == 64 == len(channel['R']) and channel['r_mm'] == sorted(channel['r_mm']), len(channel['R']))
        for r, R in zip(channel['r_mm'], channel['R']):
            need(near(R, dipole(r, a, s, A), 2e-3), r, R, dipole(r, a, s, A))  # Fdr here is a sum of midpoints
        fit = channel['fit']
        need(fit['k'] == len(fit['gaussians']) == 4 and 0 < fit['error'] < 0.05, fit)
        need(near(sum(g['weight'] for g in fit['gaussians']), channel['rd_total'], 1e-7), fit, channel['rd_total'])
        # error (10), integrated here over the printed radii in log r
        above = below = 0.0
        for i, (r, R) in enumerate(zip(channel['r_mm'], channel['R'])):
            G = sum(g['weight'] * math.exp(-r * r / (2 * g['variance_mm2'])) / (2 * math.pi * g['variance_mm2']) for g in fit['gaussians'])
            above, below = above + r * r * (R - G) ** 2, below + r * r * R * R
        need(near(math.sqrt(above / below), fit['error'], 0.05), math.sqrt(above / below), fit['error'])


@test('each Gaussian more lowers the error; shared variances are shared; a free fit errs less and may lose light')
def _(folder):
    errors = []
    for k in (1, 2, 3, 4, 6, 8):
        channels = profile(folder, 'marble', '--gaussians', str(k))['channels']
        errors.append([c['fit']['error'] for c in channels])
    need(all(b < a for x, y in zip(errors, errors[1:]) for a, b in zip(x, y)), errors)
    own, shared = profile(folder, 'skin1'), profile(folder, 'skin1', '--shared')
    variances = [[g['variance_mm2'] for g in c['fit']['gaussians']] for c in shared['channels']]
    need(variances[0] == variances[1] == variances[2], variances)
    need(sum(c['fit']['error'] ** 2 for c in shared['channels']) > sum(c['fit']['error'] ** 2 for c in own['channels']), 'sharing is dear')
    free = profile(folder, 'skin1', '--free')
    for a, b in zip(free['channels'], own['channels']):
        need(a['fit']['error'] <= b['fit']['error'] * (1 + 1e-6), a['fit'], b['fit'])
    need('fit' not in profile(folder, 'skin1', '--gaussians', '0')['channels'][0], 'no fit was asked for')
    both = profile(folder, 'skin1', '--gaussians', '2,4')['channels'][0]
    need([f['k'] for f in both['fits']] == [2, 4] and both['fit'] == both['fits'][0], both['fits'])


@test('eta and roughness change what they should; radii follow --from, --to and --points')
def _(folder):
    plain, matched = profile(folder, 'marble'), profile(folder, 'marble', '--eta', '1')
    need(plain['eta'] == 1.5 and matched['eta'] == 1, matched['eta'])
    need(matched['channels'][0]['rd_total'] > plain['channels'][0]['rd_total'], 'nothing holds light back')
    rough = profile(folder, 'marble', '--roughness', '0.9')['channels'][0]['rd_total']
    need(rough != plain['channels'][0]['rd_total'], rough)
    r = profile(folder, 'marble', '--from', '0.1mm', '--to', '1cm', '--points', '5')['channels'][0]['r_mm']
    need(len(r) == 5 and all(near(a, b, 1e-8) for a, b in zip(r, (0.1, 10 ** -0.5, 1, 10 ** 0.5, 10))), r)


@test('every model makes every medium; comparing names the reference and how far each is')
def _(folder):
    for material in ('marble', 'ketchup', 'skin1'):
        answer = profile(folder, material, '--compare', 'all', '--points', '9')
        models = [m['model'] for m in answer['compare']]
        need(models[0] == 'dipole' and len(set(models)) == len(models) >= 2, models)
        need(answer['reference'] == ('monte-carlo' if 'monte-carlo' in models else 'dipole'), answer['reference'])
        for m in answer['compare']:
            for c in m['channels']:
                need(0 < c['rd_total'] <= 1 and len(c['R']) == 9 and all(v >= 0 for v in c['R']), m['model'], c)
                need((c['distance'] == 0) == (m['model'] == answer['reference']), m['model'], c['distance'])
    alone = profile(folder, 'marble', '--model', models[-1], '--points', '9')
    compared = profile(folder, 'marble', '--compare', models[-1], '--points', '9')['compare'][1]
    need(alone['model'] == models[-1] == compared['model'], compared)
    need(alone['channels'][1]['rd_total'] == compared['channels'][1]['rd_total'], compared)


# --- Tables -------------------------------------------------------------------------------------------------------------------------

@test('--csv is read again: the same profile within what a table of its rows can hold')
def _(folder):
    works(folder, 'profile', 'skin1', '--csv', '--points', '400', '--from', '0.001mm', '--to', '60mm', '-o', 'skin.csv')
    rows = list(csv.reader((folder / 'skin.csv').open(encoding='ascii')))
    need(rows[0] == ['r_mm', 'R', 'G', 'B'] and len(rows) == 401 and all(len(r) == 4 for r in rows), rows[0])
    medium, table = profile(folder, 'skin1'), profile(folder, 'skin.csv')
    need(table['model'] == 'table' and table['eta'] is None and table['mean_free_path'] == [None] * 3, table['eta'])
    for a, b in zip(medium['channels'], table['channels']):
        need(near(a['rd_total'], b['rd_total'], 1e-3), a['rd_total'], b['rd_total'])
        need(near(a['fit']['error'], b['fit']['error'], 0.05), a['fit'], b['fit'])
    need(text(works(folder, 'profile', 'skin1', '--csv', '--points', '400', '--from', '0.001mm', '--to', '60mm').stdout) ==
         (folder / 'skin.csv').read_text('ascii'), 'stdout and the file differ')


@test('tables: comments, a mark of byte order, blanks, two columns, ends of line of any kind')
def _(folder):
    (folder / 'a.csv').write_bytes(b'\xef\xbb\xbf# mine\r\nr_mm, R\r\n\r\n0 , 0.2\r\n1,0.1\r\n 2, 0\r\n')
    answer = profile(folder, 'a.csv', '--gaussians', '2')
    totals = [c['rd_total'] for c in answer['channels']]
    need(totals[0] == totals[1] == totals[2] and 0.8 < totals[0] < 0.9, totals)
    (folder / 'b.csv').write_bytes(b'0,0.2,0.2,0\r1,0.1,0.1,0\r2,0,0,0')
    other = [c['rd_total'] for c in profile(folder, 'b.csv', '--gaussians', '2')['channels']]
    need(other[0] == totals[0] and other[2] == 0, other)


BAD_TABLES = {
    'nothing': (b'', '1', 'at least 2'),
    'one row': (b'r_mm,R,G,B\n0,1,1,1\n', '2', 'at least 2'),
    'a word': (b'r_mm,R,G,B\n0,0.1,0.1,0.1\n1,0.1,much,0.1\n', '3', '"much"'),
    'nan': (b'0,0.1,0.1,0.1\n1,nan,0.1,0.1\n', '2', '"nan"'),
    'infinity': (b'0,0.1,0.1,0.1\n1,1e999,0.1,0.1\n', '2', '1e999'),
    'an empty cell': (b'0,0.1,0.1,0.1\n1,,0.1,0.1\n', '2', '""'),
    'three columns': (b'0,0.1,0.1\n1,0.1,0.1\n', '1', '3 columns'),
    'five columns': (b'0,1,1,1,1\n', '1', 'more than 4'),
    'columns that change': (b'0,0.1,0.1,0.1\n1,0.1\n', '2', 'has 2 columns'),
    'radii in cm': (b'r_cm,R,G,B\n0,1,1,1\n1,1,1,1\n', '1', 'must be r_mm'),
    'a name that is not known': (b'r_mm,R,G,rot\n0,1,1,1\n1,1,1,1\n', '1', '"rot"'),
    'a column twice': (b'r_mm,R,G,R\n0,1,1,1\n1,1,1,1\n', '1', 'two columns "R"'),
    'no blue': (b'r_mm,R,G\n0,1,1\n1,1,1\n', '1', 'no column "B"'),
    'no radii': (b'x_R,R,G,B\n0,1,1,1\n1,1,1,1\n', '1', 'no column "r_mm"'),
    'too few cells under names': (b'r_mm,R,tr_R\n0,1\n', '2', 'has 2 columns, the lines before have 3'),
    'one radius twice': (b'0,0.1\n1,0.1\n1,0.1\n', '3', 'r_mm is 1, must be more than 1'),
    'radii in metres': (b'0,1e10\n1e-9,1e10\n', '2', 'r_mm ends at 1e-09'),
    'radii that fall': (b'0,0.1,0.1,0.1\n2,0.1,0.1,0.1\n1,0.1,0.1,0.1\n', '3', 'r_mm is 1'),
    'a negative radius': (b'-1,0.1,0.1,0.1\n2,0.1,0.1,0.1\n', '1', 'r_mm is -1'),
    'a negative value': (b'0,0.1,0.1,0.1\n1,0.1,-0.1,0.1\n2,0,0,0\n', '2', 'G is -0.1'),
    'too much light': (b'0,10,0.1,0.1\n1,10,0.1,0.1\n2,0,0,0\n', '', 'of channel R'),
    'two lines of names': (b'r_mm,R,G,B\nr_mm,R,G,B\n0,0,0,0\n', '2', '"r_mm"'),
    'a NUL': (b'0,0.1,0.1,0.1\n1\x00,0.1,0.1,0.1\n', '2', 'no number'),
    'bytes': (bytes(range(128, 256)) * 20, '1', 'no column'),
}


@test('bad tables: exit 3, the file, the line, the value')
def _(folder):
    for title, (data, line, part) in BAD_TABLES.items():
        (folder / 't.csv').write_bytes(data)
        done = run(folder, 'profile', 't.csv', '-o', 'out.svg')
        said = text(done.stderr)
        need(done.returncode == 3 and f't.csv:{line}' in said and part in said and said.count('error: ') == 1, title, done.returncode, said)
        need('out.svg' not in names(folder), title, 'left a plot')
        error = one_object(run(folder, 'profile', 't.csv', '--json'))['error']
        need('t.csv' in error['where'] and part in error['what'], title, error)
    (folder / 'long.csv').write_text(''.join(f'{i},0,0,0\n' for i in range(70000)), 'ascii')
    done = run(folder, 'profile', 'long.csv')
    need(done.returncode == 3 and b'65536' in done.stderr, done.stderr)


@test('columns are found by their names, in any order; those of other profiles are passed over')
def _(folder):
    (folder / 'a.csv').write_text('0,0.2,0.1,0.05\n0.5,0.1,0.08,0.04\n1,0,0,0\n', 'ascii')
    (folder / 'b.csv').write_text('B,tr_R,G,r_mm,dipole_G,R\n0.05,x,0.1,0,9,0.2\n0.04,1,0.08,0.5,,0.1\n0,0,0,1,0,0\n', 'ascii')
    a, b = (profile(folder, name, '--gaussians', '0')['channels'] for name in ('a.csv', 'b.csv'))
    need(a == b and a[0]['rd_total'] > a[1]['rd_total'] > a[2]['rd_total'], a, b)


ROUND_TRIPS = [(name, model) for name in ('marble', 'skin1', 'ketchup', 'spectralon', 'wholemilk', 'coke', 'clorox', 'skimmilk', 'cream')
               for model in ('dipole', 'better-dipole', 'normalized-diffusion', 'photon-beam', 'monte-carlo')]
ROUND_TRIPS += [(name, None) for name in ('leaf', 'skin-3layer', 'skin-6gaussian', 'apple-skin')]


@test('a table of the default radii holds the light, whatever the model: within half a percent when read again')
def _(folder):
    release_only()
    for name, model in ROUND_TRIPS:
        words = [name, *(['--model', model] if model else [])]
        works(folder, 'profile', *words, '--csv', '-o', 't.csv')
        read = profile(folder, 't.csv', '--gaussians', '0', '--points', '2')['channels']
        made = profile(folder, *words, '--gaussians', '0', '--points', '9')['channels']
        for a, b in zip(made, read):
            need(near(a['rd_total'], b['rd_total'], 5e-3), words, a['channel'], a['rd_total'], b['rd_total'])
        need(all(c['R'][-1] <= 1e-3 * max(c['R']) for c in made), words, 'no fall-off')


@test('tables of several models and of one wavelength have headings that are read again')
def _(folder):
    works(folder, 'profile', 'marble', '--compare', 'all', '--csv', '-o', 'all.csv')
    head = (folder / 'all.csv').read_text('ascii').splitlines()[0].split(',')
    need(head[:7] == ['r_mm', 'R', 'G', 'B', 'better-dipole_R', 'better-dipole_G', 'better-dipole_B'], head)
    need(near(profile(folder, 'all.csv')['channels'][0]['rd_total'], profile(folder, 'marble')['channels'][0]['rd_total'], 5e-3), head)
    wave = ['--wavelength', '500nm', '--solver', 'all']
    works(folder, 'profile', *wave, '--csv', '-o', 'wave.csv')
    head = (folder / 'wave.csv').read_text('ascii').splitlines()[0].split(',')
    need(head[:5] == ['r_mm', 'epidermis', 'dermis', 'skin', 'gaussian_epidermis'], head)
    for a, b in zip(profile(folder, *wave)['channels'], profile(folder, 'wave.csv')['channels']):
        need(near(a['rd_total'], b['rd_total'], 5e-3), a['rd_total'], b['rd_total'])
    code = text(works(folder, 'profile', '--wavelength', '500nm', '--export', 'c').stdout)
    need('Channels: epidermis, dermis, skin.' in code and 'red' not in code, code[:300])
    answer = json.loads(text(works(folder, 'profile', '--wavelength', '500nm', '--export', 'json').stdout))
    need(answer['channels'] == ['epidermis', 'dermis', 'skin'], answer['channels'])


@test('an answer that can not be written: exit 1; a reader that goes away: exit 1 without a word')
def _(folder):
    for more in ([], ['--json'], ['--csv'], ['--export', 'c'], ['--export', 'json']):
        with open('/dev/full', 'wb') as full:
            done = run(folder, 'profile', 'marble', *more, stdout=full, stderr=subprocess.PIPE, capture_output=False)
        need(done.returncode == 1 and done.stderr, more, done.returncode, done.stderr)
        read, write = os.pipe()
        os.close(read)
        done = run(folder, 'profile', 'marble', *more, stdout=write, stderr=subprocess.PIPE, capture_output=False)
        os.close(write)
        need(done.returncode == 1 and not done.stderr, more, done.returncode, done.stderr)


@test('a material file keeps its title, note and source; what steers a terminal is not printed')
def _(folder):
    (folder / 'w.json').write_text(json.dumps({**MARBLE, 'title': 'My wax', 'note': 'warm\x1b[31m', 'source': 'my bench', 'family': 'own'}),
                                   'ascii')
    m = one_object(works(folder, 'materials', 'w.json', '--json'))['materials'][0]
    need((m['title'], m['source'], m['family']) == ('My wax', 'my bench', 'own') and 'warm' in m['note'], m)
    shown = text(works(folder, 'materials', 'w.json').stdout)
    need(all(w in shown for w in ('My wax', 'my bench', 'warm')) and '\x1b' not in shown, shown)


@test('faults of material files name what is wrong: a layer that does not scatter, a concentration, a NUL')
def _(folder):
    layer = {'sigma_a': [1, 1, 1], 'sigma_s_reduced': [0, 0, 0], 'thickness_mm': 'infinite'}
    rows = (({'kind': 'layers', 'layers': [layer]}, '/layers/0', 'sigma_s_reduced'),
            ({'same_medium_as': 'marble', 'concentration': 0}, '/concentration', 'is 0, allowed: above 0, at most 1000'),
            ({'same_medium_as': 'marble', 'concentration': 1001}, '/concentration', 'is 1001, allowed: above 0, at most 1000'),
            ({**MARBLE, 'note': 'a\0b'}, 'f.json', 'u0000'))
    for data, where, what in rows:
        (folder / 'f.json').write_text(json.dumps(data), 'ascii')
        done = run(folder, 'profile', 'f.json', '--json')
        error = one_object(done)['error']
        need(done.returncode == 3 and where in error['where'] and what in error['what'] and 'JSON_' not in error['what'], data, error)


@test('a free fit never makes light, whatever the model')
def _(folder):
    (folder / 'white.json').write_text(json.dumps({'sigma_a': [0, 1e-6, 1e-4], 'sigma_s_reduced': [1, 2, 3], 'eta': 1.3}), 'ascii')
    for model in ('dipole', 'better-dipole', 'normalized-diffusion', 'photon-beam', 'monte-carlo'):
        for more in ([], ['--shared']):
            for channel in profile(folder, 'white.json', '--model', model, '--free', '--gaussians', '1,2,4,8', *more)['channels']:
                for fit in channel['fits']:
                    need(sum(g['weight'] for g in fit['gaussians']) <= 1 + 1e-9, model, fit)


@test('render --profile for a material without coefficients: one warning that names it')
def _(folder):
    small = ['--size', '70mm', '--width', '32', '--height', '18', '--msaa', '1', '--light-samples', '1', '-o', 'o.png']
    said = text(works(folder, 'render', 'bunny.obj', '--material', 'skin-6gaussian', '--profile', 'photon-beam', *small).stderr)
    need(said.count('has no coefficients') == 1 and 'photon-beam' in said, said)
    for material, more in (('marble', ['--profile', 'photon-beam']), ('skin-6gaussian', [])):
        said = text(works(folder, 'render', 'bunny.obj', '--material', material, *more, *small).stderr)
        need('has no coefficients' not in said, material, said)


# --- Refusals -------------------------------------------------------------------------------------------------------------------------

FAULTS = {
    'nothing to make a profile of': ([], 2, 'MATERIAL|FILE is missing', ''),
    'a material that is not there': (['marbel'], 2, 'marbel', 'marble'),
    'a word that is no material': (['zzzzqq'], 2, 'must be a built-in material, a material file', 'pellucid materials'),
    'taps without an export': (['marble', '--taps', '25'], 2, '--export', ''),
    'a rank without an export': (['marble', '--rank', '2'], 2, '--export', ''),
    'a rank of 4': (['marble', '--export', 'c', '--rank', '4'], 2, '[1, 3]', ''),
    'a way to fit without a fit': (['marble', '--shared', '--gaussians', '0'], 2, '--gaussians 0', ''),
    'a fit in a table': (['marble', '--csv', '--free'], 2, '--csv, which contains no fits', ''),
    'points of an export': (['marble', '--export', 'c', '--points', '9'], 2, 'no effect', ''),
    'models in an export': (['marble', '--export', 'c', '--compare', 'all'], 2, 'one profile', ''),
    'two fits in an export': (['marble', '--export', 'c', '--gaussians', '2,4'], 2, 'one fit', ''),
    'three solvers in an export': (['leaf', '--export', 'c', '--solver', 'all'], 2, 'one profile', ''),
    'melanin twice': (['--skin', 'melanin=0.1,melanin=0.2'], 2, 'melanin twice', ''),
    'a model that is not there': (['marble', '--model', 'dipol'], 2, 'dipol', 'dipole'),
    'a model to compare that is not there': (['marble', '--compare', 'dipole,betterdipole'], 2, 'betterdipole', 'better-dipole'),
    'no model to compare': (['marble', '--compare', ''], 2, '--compare', ''),
    'an eta that is no number': (['marble', '--eta', 'glass'], 2, '"glass"', ''),
    'an eta of nan': (['marble', '--eta', 'nan'], 2, '"nan"', ''),
    'an eta out of range': (['marble', '--eta', '4.1'], 2, '[0.25, 4]', ''),
    'a negative roughness': (['marble', '--roughness', '-0.1'], 2, '[0, 1]', ''),
    'a roughness over 1': (['marble', '--roughness', '1.0001'], 2, '[0, 1]', ''),
    'eleven Gaussians': (['marble', '--gaussians', '11'], 2, '[1, 10]', ''),
    'minus one Gaussian': (['marble', '--gaussians', '-1'], 2, '[1, 10]', ''),
    'half a Gaussian': (['marble', '--gaussians', '2.5'], 2, '"2.5"', ''),
    'a list of Gaussians with a hole': (['marble', '--gaussians', '2,,4'], 2, '[1, 10]', ''),
    'too many fits': (['marble', '--gaussians', '1,2,3,4,5'], 2, 'at most 4', ''),
    'a radius without a unit': (['marble', '--from', '1'], 2, 'has no unit', 'mm'),
    'radii the wrong way round': (['marble', '--from', '2mm', '--to', '1mm'], 2, 'no range', ''),
    'one radius': (['marble', '--points', '1'], 2, '--points', ''),
    'too many radii': (['marble', '--points', '4097'], 2, '[0, 4096]', ''),
    'an ending that is not drawn': (['marble', '-o', 'a.jpg'], 2, 'a.jpg', ''),
    'a plot in no folder': (['marble', '-o', 'no/a.svg'], 3, 'no/a.svg', ''),
    'a plot and json on stdout': (['marble', '--json', '--csv'], 2, '--csv', ''),
    'a language that is not written': (['marble', '--export', 'rust'], 2, '"rust"', ''),
    'an even number of taps': (['marble', '--export', 'c', '--taps', '4'], 2, 'must be odd', ''),
    'too many taps': (['marble', '--export', 'c', '--taps', '67'], 2, '[3, 65]', ''),
    'weights without a plot': (['marble', '--weighted'], 2, '--weighted', '-o'),
    'a model of a sum of Gaussians': (['skin-6gaussian', '--model', 'dipole'], 2, 'sum of Gaussians', ''),
    'a solver of a medium': (['marble', '--solver', 'hankel'], 2, 'none', ''),
    'layers of a medium': (['--layers', 'marble'], 2, 'has no layers', ''),
    'layers that are not there': (['--layers', 'no.json'], 3, 'no.json', ''),
    'a material and layers': (['marble', '--layers', 'skin-3layer'], 2, 'one of them', ''),
    'a material and skin': (['marble', '--skin', 'default'], 2, 'one of them', ''),
    'skin of something unknown': (['--skin', 'melamin=0.1'], 2, 'melamin', 'melanin'),
    'skin without a value': (['--skin', 'melanin'], 2, 'melanin', ''),
    'too much melanin': (['--skin', 'melanin=1.5'], 2, 'melanin', ''),
    'melanin of nan': (['--skin', 'melanin=nan'], 2, 'nan', ''),
    'an epidermis without a unit': (['--skin', 'epidermis=1'], 2, 'no unit', 'mm'),
    'a solver that is not there': (['--skin', 'default', '--solver', 'henkel'], 2, 'henkel', 'hankel'),
    'a wavelength without a unit': (['--wavelength', '500'], 2, 'no unit', '500nm'),
    'a wavelength that is not seen': (['--wavelength', '900nm'], 2, '[380nm, 780nm]', ''),
    'a model for skin': (['--skin', 'default', '--model', 'dipole'], 2, '--model', '--solver'),
    'the input as output': (['t.csv', '--csv', '-o', 't.csv'], 2, 'is the input', ''),
    'a table that is not there': (['no.csv'], 3, 'no.csv', ''),
    'a broken material file': (['bad.json'], 3, 'bad.json', ''),
}


def fault_test(title, arguments, code, what, hint):
    @test(f'{title}: exit {code}, in words and in JSON')
    def check(folder):
        (folder / 't.csv').write_text('0,0.1\n1,0.1\n', 'ascii')
        (folder / 'bad.json').write_text('{"sigma_a": [1, -1, 1], "sigma_s_reduced": [1, 1, 1]}', 'ascii')
        words = ['profile', *arguments]
        before = names(folder)
        plain, jason = run(folder, *words), run(folder, *words, *(() if '--json' in words else ('--json',)))
        said = text(plain.stderr)
        if '--json' not in words:
            need(plain.returncode == code and said.count('error: ') == 1 and what in said and hint in said, plain.returncode, said)
            need(not plain.stdout, plain.stdout[:500])
        if '--csv' not in words and '--export' not in words:
            error = one_object(jason)['error']
            need(jason.returncode == code and what in error['where'] + ' ' + error['what'], jason.returncode, error)
            need(hint in error['hint'], error)
        need(names(folder) == before, 'left', set(names(folder)) - set(before))


for case, (given, exit_code, about, advice) in FAULTS.items():
    fault_test(case, given, exit_code, about, advice)


# --- Plots --------------------------------------------------------------------------------------------------------------------------

def words_of_pdf(folder, name):
    if not shutil.which('pdftotext'):
        return None
    return text(subprocess.run(['pdftotext', '-layout', name, '-'], cwd=folder, capture_output=True, check=True).stdout)


@test('plots: SVG is XML of the size, PNG has colours of the three curves, PDF has the words; the same plot is the same bytes')
def _(folder):
    for name, more in (('one.svg', []), ('one.png', []), ('one.pdf', []), ('fits.svg', ['--gaussians', '2,4', '--weighted']),
                       ('models.png', ['--compare', 'all']), ('plain.svg', ['--gaussians', '0'])):
        done = works(folder, 'profile', 'marble', *more, '-o', name)
        need(b'warning' not in done.stderr, done.stderr)
        first = (folder / name).read_bytes()
        works(folder, 'profile', 'marble', *more, '-o', name, '-q')
        need(first == (folder / name).read_bytes(), name, 'differs from run to run')
        if name.endswith('.svg'):
            tree = xml.etree.ElementTree.fromstring(first)
            need(tree.tag.endswith('svg') and float(tree.get('width').rstrip('pt')) >= 700, tree.attrib)
            paths = [e for e in tree.iter() if e.tag.endswith('path')]
            need(max(len(e.get('d')) for e in paths) > 4000, 'no long curve')
    width, height, channels, data = png_pixels((folder / 'one.png').read_bytes())
    need((width, height) == (1520, 1280), width, height)
    colours = {data[i:i + 3] for i in range(0, len(data), channels)}
    for wanted in ((213, 94, 0), (0, 158, 115), (0, 114, 178)):
        need(any(all(abs(a - b) <= 2 for a, b in zip(c, wanted)) for c in colours), wanted, 'is nowhere')
    need(png_pixels((folder / 'models.png').read_bytes())[0] == 2360, 'three panels')
    words = words_of_pdf(folder, 'one.pdf')
    if words is not None:
        for part in ('marble: dipole', 'r, mm', 'red', '4 Gaussians', 'mean free path', '1.64'):
            need(part in words, part, words)


@test('an old plot stays when a new one fails')
def _(folder):
    works(folder, 'profile', 'marble', '-o', 'a.svg')
    before = (folder / 'a.svg').read_bytes()
    need(run(folder, 'profile', 'marbel', '-o', 'a.svg').returncode == 2 and (folder / 'a.svg').read_bytes() == before, 'it changed')
    need(run(folder, 'profile', 'marble', '-o', 'a.svg', '--limit', 'memory-bytes=1048576').returncode in (0, 5), 'exit code')
    need(len([n for n in names(folder) if 'tmp' in n]) == 0, names(folder))


# --- Layers -------------------------------------------------------------------------------------------------------------------------

@test('skin: three solvers agree on totals; melanin darkens; one wavelength has epidermis, dermis and both')
def _(folder):
    answer = profile(folder, '--skin', 'default', '--solver', 'all', '--points', '9')
    need([m['model'] for m in answer['compare']] == ['hankel', 'gaussian', 'analytic'], answer['compare'])
    for m in answer['compare'][1:]:
        for a, b in zip(m['channels'], answer['channels']):
            need(near(a['rd_total'], b['rd_total'], 1e-3), m['model'], a['rd_total'], b['rd_total'])
    light, dark = (profile(folder, '--skin', f'melanin={m},epidermis=0.1mm', '--points', '9')['channels'] for m in (0.02, 0.3))
    need(all(a['rd_total'] > b['rd_total'] for a, b in zip(light, dark)), 'melanin does not darken')
    figure = profile(folder, '--wavelength', '500nm', '--solver', 'gaussian', '--points', '9')
    need([c['channel'] for c in figure['channels']] == ['epidermis', 'dermis', 'skin'], figure)
    epidermis, dermis, both = (c['rd_total'] for c in figure['channels'])
    need(epidermis < both < epidermis + dermis, epidermis, dermis, both)
    works(folder, 'profile', '--wavelength', '500nm', '--solver', 'all', '-o', 'figure.svg')


@test('a built-in stack without --layers and with it are the same')
def _(folder):
    a, b = profile(folder, 'skin-3layer', '--points', '5'), profile(folder, '--layers', 'skin-3layer', '--points', '5')
    need(a['channels'] == b['channels'] and a['model'] == 'hankel', a['model'])


@test('a slab: R, T, and less than all of the light; its CSV has both')
def _(folder):
    (folder / 'slab.json').write_text(json.dumps({'kind': 'layers', 'eta': 1.3, 'layers': [
        {'name': 'film', 'sigma_a': [0.1, 0.2, 0.3], 'sigma_s_reduced': [4, 4, 4], 'eta': 1.3, 'thickness_mm': 1}]}), 'ascii')
    answer = profile(folder, '--layers', 'slab.json', '--points', '9')
    for c in answer['channels']:
        need(0 < c['td_total'] < c['rd_total'] and c['td_total'] + c['rd_total'] < 1 and len(c['T']) == 9, c)
    need(answer['channels'][0]['td_total'] > answer['channels'][2]['td_total'], 'absorption')
    head = text(works(folder, 'profile', '--layers', 'slab.json', '--csv').stdout).splitlines()[0]
    need(head == 'r_mm,R,G,B,tr_R,tr_G,tr_B', head)
    shown = text(works(folder, 'profile', 'slab.json', '-o', 'slab.pdf').stdout)
    need(shown.count('T(r), 1/mm^2') == 1 and 'T(r)' in text(works(folder, 'profile', 'slab.json', '--gaussians', '0').stdout), shown)
    words = words_of_pdf(folder, 'slab.pdf')
    need(words is None or 'total transmittance' in words, words)
    works(folder, 'profile', 'slab.json', '--csv', '-o', 'slab.csv')
    for a, b in zip(answer['channels'], profile(folder, 'slab.csv')['channels']):
        need(near(a['rd_total'], b['rd_total'], 5e-3), a['rd_total'], b['rd_total'])


# --- Code ---------------------------------------------------------------------------------------------------------------------------

CHECK = r'''
#include "kernel.h"
#include <stdio.h>
int main(void)
{
    for (int c = 0; c < 3; c++) {
        double taps = 0.0, ring = 0.0;
        for (int i = 0; i < marble_taps; i++)
            taps += marble_tap_weight[i][c];
        const double dr = marble_table_mm / marble_texels;
        for (int i = 0; i < marble_texels; i++)
            ring += marble_table[i][c] * 3.14159265358979 * dr * dr * (2 * i + 1);
        printf("%.9g %.9g %.9g %.9g %.9g\n", marble_profile(c, 0.1f), marble_profile(c, 1.0f), taps * taps, ring,
               marble_tap_offset[marble_taps / 2]);
    }
    return 0;
}
'''


@test('an export whose separable kernel is far off says so, and what is nearer')
def _(folder):
    said = text(works(folder, 'profile', 'wholemilk', '--export', 'glsl', '-o', 'a.glsl').stderr)
    need('separable kernel of rank 1 has an error of 1' in said and '--rank' in said, said)
    said = text(works(folder, 'profile', 'wholemilk', '--export', 'glsl', '--rank', '2', '-o', 'a.glsl').stderr)
    need('separable' not in said, said)


def exported(folder, language, *more):
    works(folder, 'profile', 'marble', '--export', language, *more, '-o', f'kernel.{language}')
    return (folder / f'kernel.{language}').read_text('ascii')


@test('--export c compiles without a warning as C, and as C++ where a compiler is; both compute what --json says')
def _(folder):
    compiler = shutil.which('cc') or shutil.which('gcc')
    if not compiler:
        raise Skip('there is no C compiler')
    strict = ['-Wall', '-Wextra', '-Werror', '-pedantic', '-lm']
    plus = shutil.which('c++') or shutil.which('g++')
    for more in ([], ['--shared', '--taps', '9']):
        exported(folder, 'c', *more)
        said = re.search(r'It holds ([\d.]+) ([\d.]+) ([\d.]+) % of the light', (folder / 'kernel.c').read_text('ascii'))
        fractions = [float(v) for v in said.groups()]
        (folder / 'kernel.c').rename(folder / 'kernel.h')
        (folder / 'check.c').write_text(CHECK, 'ascii')
        subprocess.run([compiler, '-std=c99', 'check.c', '-o', 'check', *strict], cwd=folder, check=True, timeout=60)
        said = text(subprocess.run([folder / 'check'], capture_output=True, check=True).stdout)
        if plus:
            subprocess.run([plus, '-std=c++11', '-x', 'c++', 'check.c', '-o', 'check', *strict], cwd=folder, check=True, timeout=60)
            need(text(subprocess.run([folder / 'check'], capture_output=True, check=True).stdout) == said, 'as C++ it says otherwise')
        rows = [list(map(float, line.split())) for line in said.splitlines()]
        channels = profile(folder, 'marble', *[m for m in more if m == '--shared'])['channels']
        for row, channel in zip(rows, channels):
            for value, r in zip(row, (0.1, 1.0)):
                G = sum(g['weight'] * math.exp(-r * r / (2 * g['variance_mm2'])) / (2 * math.pi * g['variance_mm2'])
                        for g in channel['fit']['gaussians'])
                need(near(value, G, 1e-5), value, G)
            need(near(row[2], channel['rd_total'], 1e-5), 'taps sum to', row[2], channel['rd_total'])
            need(0.95 * channel['rd_total'] < row[3] <= channel['rd_total'], 'rings sum to', row[3])
            need(near(row[3] / channel['rd_total'], fractions.pop(0) / 100, 2e-4), 'the comment says another share')
            need(row[4] == 0, 'the middle tap')


@test('--export c compiles without a warning where nothing of it is used, by gcc and by clang')
def _(folder):
    compilers = [c for c in ('gcc', 'clang') if shutil.which(c)]
    if not compilers:
        raise Skip('there is no C compiler')
    for more in ([], ['--shared'], ['--rank', '2'], ['--gaussians', '0'], ['--gaussians', '1']):
        exported(folder, 'c', *more)
        for compiler in compilers:
            for language in ('-std=c99', '-std=c11', *(['-xc++'] if shutil.which('g++') else [])):
                done = subprocess.run([compiler, language, '-Wall', '-Wextra', '-Wconversion', '-pedantic', '-c', 'kernel.c', '-o', 'k.o'],
                                      cwd=folder, capture_output=True, timeout=60, check=False)
                need(done.returncode == 0 and not done.stderr, compiler, language, more, done.stderr)


@test('--export glsl compiles where a compiler is')
def _(folder):
    tool = shutil.which('glslangValidator')
    code = exported(folder, 'glsl', '--shared', '--gaussians', '3')
    (folder / 'k.frag').write_text('#version 450\nlayout(binding = 0) uniform sampler2D image;\n'
                                   'layout(location = 0) out vec4 color;\n' + code +
                                   'void main() { color = vec4(marble_blur(image, vec2(0.5), vec2(0.01)) + marble_profile(1.0), 1.0); }\n',
                                   'ascii')
    if tool:
        subprocess.run([tool, '-V', 'k.frag', '-o', 'k.spv'], cwd=folder, check=True, capture_output=True, timeout=60)


def constants(code, name):
    """The numbers of an array or scalar, in order."""
    body = re.search(rf'marble_{name}(?:\[\d+\])* = ([^;]*);', code)[1]
    return [float(v) for v in re.findall(r'-?\d[\d.]*(?:e[-+]?\d+)?', re.sub(r'(?:vec3|float)(?:\[\])?\(', '(', body))]


@test('each language of --export holds the same numbers, and they are those of --json')
def _(folder):
    def flat(rows):
        return [v for row in rows for v in row]
    arguments = ['--shared', '--gaussians', '3', '--taps', '11']
    kernel, channels = json.loads(exported(folder, 'json', *arguments)), profile(folder, 'marble', *arguments[:3])['channels']
    variances, weights = (flat(zip(*([g[key] for g in c['fit']['gaussians']] for c in channels))) for key in ('variance_mm2', 'weight'))
    chain, separable = kernel['chain'], kernel['separable']
    wanted = {'variance': variances, 'weight': weights, 'blur_sd': [math.sqrt(v) for v in chain['step_mm2']],
              'blur_blend': flat(chain['blend']), 'blur_total': [c['rd_total'] for c in channels], 'tap_offset': separable['offset_mm'],
              'tap_weight': flat(separable['weight']), 'table_mm': [kernel['table']['r_max_mm']], 'table': flat(kernel['table']['R'])}
    need(len(separable['offset_mm']) == 11 == len(separable['weight']) and len(weights) == 9 and len(kernel['table']['R']) == 64, kernel)
    given = kernel['gaussians']
    found = flat(given['variance_mm2']) + flat(given['weight'])
    need(len(found) == 18 and all(near(a, b, 1e-8) for a, b in zip(found, variances + weights)), given)
    for language in ('c', 'glsl', 'hlsl'):
        code = exported(folder, language, *arguments)
        need(code.count('{') == code.count('}') and code.count('(') == code.count(')'), language, 'brackets')
        for name, values in wanted.items():
            found = constants(code, name)
            need(len(found) == len(values) and all(near(a, b, 2e-7) or abs(a - b) < 1e-30 for a, b in zip(found, values)),
                 language, name, found, values)


@test('--rank: terms of two passes each, which lose less, keep the light, and say in each language the same')
def _(folder):
    total, errors = [c['rd_total'] for c in profile(folder, 'marble')['channels']], []
    for rank in (1, 2, 3):
        kernel = json.loads(exported(folder, 'json', '--rank', str(rank), '--taps', '21'))['separable']
        weights = [kernel['weight'][k * 21:k * 21 + 21] for k in range(rank)]
        need(kernel['rank'] == rank == len(kernel['sign']) and len(kernel['weight']) == 21 * rank, kernel)
        for c in range(3):
            light = sum(sign[c] * sum(w[c] for w in term) ** 2 for sign, term in zip(kernel['sign'], weights))
            need(near(light, total[c], 1e-6), 'rank', rank, 'keeps', light, total[c])
        errors.append(kernel['error'])
        for language in ('c', 'glsl', 'hlsl'):
            code = exported(folder, language, '--rank', str(rank), '--taps', '21')
            found = constants(code, 'tap_weight')
            need(len(found) == 63 * rank and all(near(a, b, 2e-7) or abs(a - b) < 1e-30
                                                 for a, b in zip(found, [v for row in kernel['weight'] for v in row])), language)
            need(('terms' in code) == (rank > 1) and code.count('(') == code.count(')'), code)
            if rank > 1:
                need(constants(code, 'tap_sign') == [v for row in kernel['sign'] for v in row], language)
        tool = shutil.which('glslangValidator')
        if tool:
            term = ', 1' if rank > 1 else ''
            code = exported(folder, 'glsl', '--rank', str(rank))
            (folder / 'r.frag').write_text('#version 450\nlayout(binding = 0) uniform sampler2D image;\n'
                                           f'layout(location = 0) out vec4 color;\n{code}void main()\n'
                                           f'{{ color = vec4(marble_blur(image, vec2(0.5), vec2(0.01){term}), 1.0); }}\n', 'ascii')
            subprocess.run([tool, '-V', 'r.frag', '-o', 'r.spv'], cwd=folder, check=True, capture_output=True, timeout=60)
    need(all(a > b for one, two in zip(errors, errors[1:]) for a, b in zip(one, two)), errors)


@test('names of files that are no identifiers still give code')
def _(folder):
    (folder / '2 wax!.json').write_text(json.dumps(MARBLE), 'ascii')
    code = text(works(folder, 'profile', './2 wax!.json', '--export', 'c').stdout)
    need('m2_wax_gaussians = 4' in code, code[:400])


# --- Ctrl-C -------------------------------------------------------------------------------------------------------------------------

def interrupted(folder, delay, *arguments):
    child = subprocess.Popen([PROGRAM, *arguments], cwd=folder, env=clean_environment(), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    time.sleep(delay)
    alive = child.poll() is None
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=60)
    return alive, child.returncode, out, err


@test('Ctrl-C at any time: exit 130 and nothing but that, or the whole answer; a wait for a pipe\'s reader ends')
def _(folder):
    long = ['profile', 'ketchup', '--compare', 'all', '--gaussians', '10,9,8,7', '--shared', '--points', '4096']
    before, begin = names(folder), time.monotonic()
    whole = works(folder, *long, '--json').stdout
    seconds, stopped = time.monotonic() - begin, 0
    for i in range(64):
        if i >= 8 and stopped:
            break
        more = (['--json'], ['-o', 'a.svg'])[i % 2]
        _, code, out, err = interrupted(folder, seconds * (i * 7 % 31 + 1) / 32, *long, *more)
        if code == -signal.SIGINT:
            continue  # before the program had installed its handler
        need(code in (0, 130), code, err)
        stopped += code == 130
        if i % 2 and code == 130:
            need(not out and names(folder) == before and b'nothing was written' in err, out[:200], names(folder), err)
        elif code == 130:
            need(json.loads(out)['error']['code'] == 'cancelled' and not err, out[:300], err)
        elif i % 2:
            need((folder / 'a.svg').read_bytes().endswith(b'</svg>\n'), 'half a plot')
            (folder / 'a.svg').unlink()
        else:
            need(out == whole, 'half an answer')
    need(stopped, 'it never stopped in', seconds)
    os.mkfifo(folder / 'pipe.svg')
    alive, code, out, err = interrupted(folder, max(1.0, 4 * seconds), *long, '-o', 'pipe.svg')
    need(alive and code == 130 and not out and names(folder) == sorted([*before, 'pipe.svg']), alive, code, err)


if __name__ == '__main__':
    sys.exit(main())
