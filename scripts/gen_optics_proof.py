#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Regenerates the tables and figures of docs/guide/optics-proof.md.

    ninja -C build tests/optics/oracle_table tests/optics/layers_table
    scripts/gen_optics_proof.py build/tests/optics [PHOTONS]

The other side of the comparison is tests/expect/oracle. The text between a line `<!-- NAME -->` and `<!-- end -->` of the page is replaced
by the output of oracle_table; docs/images/proof-*.svg are drawn. Takes half a minute of a core for a million photons. Standard library
only.
"""
import html
import math
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE = ROOT / 'docs/guide/optics-proof.md'
IMAGES = ROOT / 'docs/images'

# Distinguishable without colour, too: dashes.
COLORS = ['#0072b2', '#d55e00', '#009e73', '#cc79a7', '#222222', '#e69f00']
DASHES = ['', '7 3', '2 2', '8 3 2 3', '', '4 4']
MODEL_STYLES = [0, 1, 2, 3, 5]
STYLE = 'font-family="DejaVu Sans, Helvetica, sans-serif"'


class Plot:
    """One pair of axes in an SVG, at (left, top), `width` by `height`; optionally logarithmic."""

    def __init__(self, box, x_range, y_range, log_x=True, log_y=True, title='', x_name='', y_name='', small=False):
        self.left, self.top, self.width, self.height = box
        self.x_range, self.y_range, self.log_x, self.log_y = x_range, y_range, log_x, log_y
        self.parts, self.size = [], 10 if small else 12
        self.frame(title, x_name, y_name)

    def fraction(self, value, ends, log):
        if log:
            value, ends = math.log(max(value, 1e-300)), [math.log(e) for e in ends]
        return (value - ends[0]) / (ends[1] - ends[0])

    def at(self, x, y):
        return (self.left + self.width * self.fraction(x, self.x_range, self.log_x),
                self.top + self.height * (1 - self.fraction(y, self.y_range, self.log_y)))

    def text(self, x, y, text, anchor='middle', turn=''):
        self.parts.append(f'<text x="{x:.1f}" y="{y:.1f}" font-size="{self.size}" text-anchor="{anchor}" {STYLE}{turn}>'
                          f'{html.escape(text)}</text>')

    def ticks(self, ends, log):
        if log:
            return [10.0 ** k for k in range(math.ceil(math.log10(ends[0]) - 1e-9), math.floor(math.log10(ends[1]) + 1e-9) + 1)]
        step = 10.0 ** math.floor(math.log10(ends[1] - ends[0]))
        step = next(s for s in (step / 5, step / 2, step) if (ends[1] - ends[0]) / s <= 6)
        return [k * step for k in range(math.ceil(ends[0] / step - 1e-9), math.floor(ends[1] / step + 1e-9) + 1)]

    def frame(self, title, x_name, y_name):
        right, bottom = self.left + self.width, self.top + self.height
        for x in self.ticks(self.x_range, self.log_x):
            px = self.at(x, self.y_range[0])[0]
            self.parts.append(f'<path d="M{px:.1f} {self.top}V{bottom}" stroke="#ddd"/>')
            self.text(px, bottom + self.size + 3, f'{x:g}')
        for y in self.ticks(self.y_range, self.log_y):
            py = self.at(self.x_range[0], y)[1]
            self.parts.append(f'<path d="M{self.left} {py:.1f}H{right}" stroke="#ddd"/>')
            self.text(self.left - 4, py + 0.35 * self.size, f'{y:g}', 'end')
        self.parts.append(f'<rect x="{self.left}" y="{self.top}" width="{self.width}" height="{self.height}" fill="none" stroke="#444"/>')
        self.text(self.left + self.width / 2, self.top - 6, title)
        self.text(self.left + self.width / 2, bottom + 2 * self.size + 8, x_name)
        x, y = self.left - 44, self.top + self.height / 2
        self.text(x, y, y_name, turn=f' transform="rotate(-90 {x} {y})"')

    def curve(self, points, style):
        inside = [(x, y) for x, y in points if self.x_range[0] * 0.9999 <= x <= self.x_range[1] * 1.0001 and (y > 0 or not self.log_y)]
        d = ' '.join(f'{"L" if i else "M"}{px:.1f} {min(max(py, self.top), self.top + self.height):.1f}'
                     for i, (px, py) in enumerate(self.at(x, y) for x, y in inside))
        dash = f' stroke-dasharray="{DASHES[style]}"' if DASHES[style] else ''
        self.parts.append(f'<path d="{d}" fill="none" stroke="{COLORS[style]}" stroke-width="1.5"{dash}/>')

    def dots(self, points, style=4):
        for x, y in points:
            if self.x_range[0] <= x <= self.x_range[1] and self.y_range[0] <= y <= self.y_range[1]:
                px, py = self.at(x, y)
                self.parts.append(f'<circle cx="{px:.1f}" cy="{py:.1f}" r="2.2" fill="none" stroke="{COLORS[style]}"/>')

    def bar(self, x, low, high):
        px, a = self.at(x, low)
        self.parts.append(f'<path d="M{px:.1f} {a:.1f}V{self.at(x, high)[1]:.1f}" stroke="{COLORS[4]}"/>')

    def legend(self, x, y, names, circles=''):
        for k, (name, style) in enumerate(names):
            dash = f' stroke-dasharray="{DASHES[style]}"' if DASHES[style] else ''
            line = y + k * (self.size + 5)
            self.parts.append(f'<path d="M{x} {line}h26" stroke="{COLORS[style]}" stroke-width="1.5"{dash}/>')
            self.text(x + 32, line + 4, name, 'start')
        if circles:
            line = y + len(names) * (self.size + 5)
            self.parts.append(f'<circle cx="{x + 13}" cy="{line}" r="2.2" fill="none" stroke="{COLORS[4]}"/>')
            self.text(x + 32, line + 4, circles, 'start')


def write(name, width, height, plots):
    body = '\n'.join(part for plot in plots for part in plot.parts)
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    (IMAGES / name).write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n<rect width="100%" height="100%" fill="white"/>\n'
                               f'{body}\n</svg>\n', 'utf-8')


def draw_appendix(rows):
    ours = [[float(v) for v in r[1:]] for r in rows if r[0] == 'appendix-a']
    theirs = [[float(v) for v in r[1:]] for r in rows if r[0] == 'pole']
    plot = Plot((64, 28, 560, 300), (1e-3, 20), (0.1, 10), title='Four Gaussians per pole, constants of appendix A',
                x_name='x = sigma_tr z', y_name='error (10), %')
    for kind in range(3):
        plot.curve([(r[0], r[1 + kind]) for r in ours], kind)
        plot.dots([(r[0], r[1 + kind]) for r in theirs])
    plot.legend(90, 262, [('as printed', 0), ('least squares', 1), ('least squares, energy kept', 2)], 'the oracle')
    write('proof-appendix-a.svg', 640, 375, [plot])


def number(text):
    return 1 / float(text[2:]) if text.startswith('1/') else float(text)


def draw_algebra(markdown):
    """From the second table of layers_table: v / bound | "R, T % (count)" for each block."""
    table = markdown.split('\n\n')[1].splitlines()
    blocks = [re.search(r'\d+', c)[0] for c in table[0].strip('| ').split(' | ')[1:]]
    lines = [[c.strip() for c in line.strip('| ').split('|')] for line in table[2:]]
    plots = []
    for part in range(2):
        plot = Plot((64 + 330 * part, 28, 260, 260), (1 / 300, 5), (1e-4, 10), title='R' if not part else 'T',
                    x_name='v / min(l, d - l)^2', y_name='error (10), %' if not part else '', small=True)
        for k, block in enumerate(blocks):
            points = [(number(c[0]), float(c[1 + k].split(' %')[0].split(', ')[part])) for c in lines]
            plot.curve(points, k)
            plot.dots(points, k)
        plot.curve([(0.25, 1e-4), (0.25, 10)], 5)
        if not part:
            plot.legend(76, 44, [(f'block {b}', k) for k, b in enumerate(blocks)] + [("the paper's bound", 5)])
        plots.append(plot)
    write('proof-algebra.svg', 670, 335, plots)


def draw_models(rows):
    media = []
    for kind, *row in rows:
        if kind == 'medium':
            media.append((f'{row[0]}, albedo {float(row[1]):.4g}', {}, []))
        elif kind == 'curve':
            media[-1][1].setdefault(row[0], []).append((float(row[1]), float(row[2])))
        elif kind == 'ring':
            media[-1][2].append([float(v) for v in row])
    plots = []
    for k, (title, curves, rings) in enumerate(media):
        peak = max(y for model in ('monte-carlo', 'photon-beam', 'dipole') for _, y in curves[model])
        top = next(t for t in (0.01, 0.02, 0.05, 0.1, 0.2, 0.25, 0.4, 0.5, 1) if t >= 1.1 * peak)
        plot = Plot((56 + 240 * (k % 4), 52 + 200 * (k // 4), 196, 150), (0.01, 100), (0, top), log_y=False, title=title, small=True)
        for style, points in enumerate(curves.values()):
            plot.curve(points, MODEL_STYLES[style])
        for r, flux, error in rings:
            plot.bar(r, max(flux - error, 0), flux + error)
        plot.dots([(r, flux) for r, flux, _ in rings])
        plots.append(plot)
    x = 56
    for style, model in enumerate(media[0][1]):
        plots[0].legend(x, 16, [(model, MODEL_STYLES[style])])
        x += 60 + 7 * len(model)
    plots[0].legend(x, 16, [], 'photons, with error bars')
    bottom = 52 + 200 * (len(media) // 4)
    plots[0].text(490, bottom, 'green channel; r in mean free paths; light per unit of ln r, 2 pi r^2 R(r)')
    write('proof-models.svg', 1000, bottom + 14, plots)


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    programs, photons = pathlib.Path(sys.argv[1]).resolve(), sys.argv[2] if len(sys.argv) == 3 else '1500000'

    def printed(program, *args):
        return subprocess.run([programs / program, *args], check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT).stdout

    page = PAGE.read_text('utf-8')
    curves = str(programs / 'oracle_table.csv')
    for name, args in (('compare', []), ('fits', []), ('models', [photons, curves])):
        tables = printed('oracle_table', name, *args)
        page, count = re.subn(rf'(<!-- {name} -->\n).*?(<!-- end -->)', lambda m, t=tables: f'{m[1]}\n{t}\n{m[2]}', page, flags=re.DOTALL)
        if count != 1:
            sys.exit(f'{PAGE}: {count} places for {name}')
    PAGE.write_text(page, 'utf-8')
    rows = [line.split(',') for line in pathlib.Path(curves).read_text('utf-8').splitlines()]
    draw_appendix(rows)
    draw_models(rows)
    draw_algebra(printed('layers_table'))


if __name__ == '__main__':
    main()
