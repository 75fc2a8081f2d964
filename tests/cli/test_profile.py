#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_profile.py PROGRAM ROOT: `pellucid profile`: its numbers, tables, plots and code, and what it refuses; `pellucid bench profiles`."""
import csv
import json
import math
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree

from cli_test import Skip, main, names, need, one_object, png_pixels, run, test, text, works

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
    """The average of Fresnel's reflectance over a diffuse hemisphere, from inside; midpoints in cos^2."""
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
    beside = profile(folder, 'marble', '--compare', models[-1], '--points', '9')['compare'][1]
    need(alone['model'] == models[-1] == beside['model'] and alone['channels'][1]['rd_total'] == beside['channels'][1]['rd_total'], beside)


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
    'radii that fall': (b'0,0.1,0.1,0.1\n2,0.1,0.1,0.1\n1,0.1,0.1,0.1\n', '3', 'r_mm is 1'),
    'a negative radius': (b'-1,0.1,0.1,0.1\n2,0.1,0.1,0.1\n', '1', 'r_mm is -1'),
    'a negative value': (b'0,0.1,0.1,0.1\n1,0.1,-0.1,0.1\n2,0,0,0\n', '2', 'G is -0.1'),
    'too much light': (b'0,10,0.1,0.1\n1,10,0.1,0.1\n2,0,0,0\n', '', 'of channel R'),
    'two lines of names': (b'r_mm,R,G,B\nr_mm,R,G,B\n0,0,0,0\n', '2', '"r_mm"'),
    'a NUL': (b'0,0.1,0.1,0.1\n1\x00,0.1,0.1,0.1\n', '2', 'no number'),
    'bytes': (bytes(range(128, 256)) * 20, '', 'at least 2'),
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


# --- What is refused ------------------------------------------------------------------------------------------------------------------

FAULTS = {
    'nothing to make a profile of': ([], 2, 'MATERIAL|FILE is missing', ''),
    'a material that is not there': (['marbel'], 2, 'marbel', 'marble'),
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
    'a wavelength without a unit': (['--wavelength', '500'], 2, 'no unit', ''),
    'a wavelength that is not seen': (['--wavelength', '900nm'], 2, '[380nm, 780nm]', ''),
    'a model for skin': (['--skin', 'default', '--model', 'dipole'], 2, '--model', '--solver'),
    'the input as output': (['t.csv', '--csv', '-o', 't.csv'], 2, 'is the input', ''),
    'a table that is not there': (['no.csv'], 3, 'no.csv', ''),
    'a broken material file': (['bad.json'], 3, 'bad.json', ''),
    'a bench that is not there': (None, 2, 'profils', 'profiles'),
}


def fault_test(title, arguments, code, what, hint):
    @test(f'{title}: exit {code}, in words and in JSON')
    def check(folder):
        (folder / 't.csv').write_text('0,0.1\n1,0.1\n', 'ascii')
        (folder / 'bad.json').write_text('{"sigma_a": [1, -1, 1], "sigma_s_reduced": [1, 1, 1]}', 'ascii')
        words = ['bench', 'profils'] if arguments is None else ['profile', *arguments]
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
    need(head == 'r_mm,R,G,B,T R,T G,T B', head)
    works(folder, 'profile', '--layers', 'slab.json', '-o', 'slab.svg')


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


def exported(folder, language, *more):
    works(folder, 'profile', 'marble', '--export', language, *more, '-o', f'kernel.{language}')
    return (folder / f'kernel.{language}').read_text('ascii')


@test('--export c compiles without a warning as C and C++, and its numbers are those of --json')
def _(folder):
    compiler = shutil.which('cc') or shutil.which('gcc')
    if not compiler:
        raise Skip('there is no C compiler')
    for more in ([], ['--shared', '--taps', '9']):
        exported(folder, 'c', *more)
        (folder / 'kernel.c').rename(folder / 'kernel.h')
        (folder / 'check.c').write_text(CHECK, 'ascii')
        subprocess.run([compiler, '-std=c99', '-Wall', '-Wextra', '-Wno-unused-const-variable', '-Wno-unused-variable', '-Werror',
                        '-pedantic', 'check.c', '-o', 'check', '-lm'], cwd=folder, check=True, timeout=60)
        rows = [list(map(float, line.split())) for line in text(subprocess.run([folder / 'check'], capture_output=True,
                                                                               check=True).stdout).splitlines()]
        channels = profile(folder, 'marble', *[m for m in more if m == '--shared'])['channels']
        for row, channel in zip(rows, channels):
            for value, r in zip(row, (0.1, 1.0)):
                G = sum(g['weight'] * math.exp(-r * r / (2 * g['variance_mm2'])) / (2 * math.pi * g['variance_mm2'])
                        for g in channel['fit']['gaussians'])
                need(near(value, G, 1e-5), value, G)
            need(near(row[2], channel['rd_total'], 1e-5), 'taps sum to', row[2], channel['rd_total'])
            need(0.95 * channel['rd_total'] < row[3] <= channel['rd_total'], 'rings sum to', row[3])
            need(row[4] == 0, 'the middle tap')


@test('--export json, glsl and hlsl hold the same numbers; GLSL compiles where a compiler is')
def _(folder):
    kernel = json.loads(exported(folder, 'json', '--shared', '--gaussians', '3'))
    need(len(kernel['separable']['offset_mm']) == 25 == len(kernel['separable']['weight']), kernel['separable'])
    need(len(kernel['table']['R']) == 64, kernel.keys())
    need(len(kernel['gaussians']['weight']) == 3 == len(kernel['chain']['blend']), kernel['gaussians'])
    for language in ('glsl', 'hlsl'):
        code = exported(folder, language, '--shared', '--gaussians', '3')
        numbers = [float(v) for v in re.findall(r'-?\d+(?:\.\d+)?(?:e-?\d+)?', code.split('marble_weight')[1].split(';')[0].split('=')[1])]
        wanted = [v for row in kernel['gaussians']['weight'] for v in row]
        numbers = numbers if len(numbers) == len(wanted) else [v for v in numbers if v != 3][:len(wanted)]
        need(len(numbers) >= 9 and all(any(near(w, n, 1e-5) for n in numbers) for w in wanted), language, numbers, wanted)
        need(code.count('{') == code.count('}') and code.count('(') == code.count(')'), language, 'brackets')
    tool = shutil.which('glslangValidator')
    code = exported(folder, 'glsl', '--shared', '--gaussians', '3')
    (folder / 'k.frag').write_text('#version 450\nlayout(binding = 0) uniform sampler2D image;\n'
                                   'layout(location = 0) out vec4 color;\n' + code +
                                   'void main() { color = vec4(marble_blur(image, vec2(0.5), vec2(0.01)) + marble_profile(1.0), 1.0); }\n',
                                   'ascii')
    if tool:
        subprocess.run([tool, '-V', 'k.frag', '-o', 'k.spv'], cwd=folder, check=True, capture_output=True, timeout=60)


@test('names of files that are no identifiers still give code')
def _(folder):
    (folder / '2 wax!.json').write_text(json.dumps(MARBLE), 'ascii')
    code = text(works(folder, 'profile', './2 wax!.json', '--export', 'c').stdout)
    need('m2_wax_gaussians = 4' in code, code[:400])


# --- Bench --------------------------------------------------------------------------------------------------------------------------

@test('bench profiles: rows of fits, layers and evaluation, with ratios and errors')
def _(folder):
    answer = one_object(works(folder, 'bench', 'profiles', '--repeats', '2', '--json'))
    rows = {r['name']: r for r in answer['rows']}
    need(answer['bench'] == 'profiles' and answer['repeats'] == 2, answer)
    for name in ('fit by appendix A, RGB', 'fit of 6 Gaussians, RGB, shared', 'three layers, Hankel', 'three layers, Gaussians',
                 'R(r) of dipole, one by one', 'R(r) of dipole, vectorised'):
        need(name in rows and rows[name]['ms'] > 0, name, sorted(rows))
    row = rows['three layers, Gaussians']
    need(near(row['ratio'], row['ms'] / rows[row['ratio_to']]['ms'], 1e-6) and 0 < row['error'] < 0.5, row)
    need(rows['fit of 6 Gaussians, RGB, shared']['error'] < rows['fit of 4 Gaussians, RGB, shared']['error'] < 0.1, rows)
    need(rows['R(r) of dipole, vectorised']['each_ns'] > 0, rows)
    shown = text(works(folder, 'bench', 'profiles', '--repeats', '1').stdout)
    need('three layers, Hankel' in shown and ' x ' in shown, shown)


if __name__ == '__main__':
    sys.exit(main())
