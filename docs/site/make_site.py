#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""make_site.py ROOT FOLDER [OPTICS.js]: the documentation as pages for a browser, which need no server and no network. OPTICS.js
(bench/make_optics.py) adds the profile bench.

Pages of Markdown, the public headers as the reference of the library, and the source files that pages point to. A link that leads nowhere
is an error. Needs python3-markdown.
"""
import html
import json
import pathlib
import re
import shutil
import sys

import markdown

HERE = pathlib.Path(__file__).resolve().parent
TITLE = 'Pellucid'
# Title of a group in the list of pages, and the pages in it: files in their order, or patterns.
GROUPS = [
    ('Start', ['README.md', 'docs/guide/first-picture.md', 'docs/guide/command-line.md', 'docs/guide/scene-file.md',
               'docs/guide/viewer.md', 'docs/gallery.md', 'docs/guide/troubleshooting.md']),
    ('Light below surfaces', ['docs/guide/paper-to-pixels.md', 'docs/guide/paper-figures.md', 'docs/guide/paper-coverage.md',
                              'docs/guide/materials.md',
                              'docs/guide/profiles.md', 'docs/guide/optics-proof.md', 'docs/guide/conventions.md']),
    ('Methods', ['docs/guide/methods.md', 'docs/guide/choosing.md', 'docs/guide/compare.md', 'docs/guide/denoising.md',
                 'src/methods/*/README.md']),
    ('Programs', ['docs/guide/install.md', 'docs/guide/library.md', 'docs/guide/python.md', 'docs/guide/blender.md',
                  'docs/guide/engines.md', 'docs/guide/cluster.md']),
    ('Reference', ['include/pellucid/*.h']),
    ('Inside', ['docs/architecture.md', 'docs/guide/add-a-method.md', 'docs/security.md', 'docs/errata.md', 'CONTRIBUTING.md',
                'CHANGELOG.md', 'bench/README.md', 'docs/adr/*.md']),
]
BENCH, BENCH_GROUP = 'bench.html', 'Light below surfaces'
SPEED, SPEED_GROUP = 'speed.html', 'Inside'
OPTIONS = 'docs/guide/command-line.md'  # where who searches for an option is led first
LESS = 0.5  # what a page of the last group counts in a search: whoever uses Pellucid is looking for another
PICTURES = {'.png', '.svg', '.webp', '.jpg', '.gif'}


class Fault(Exception):
    """What keeps the site from being made."""


def slug(text, _separator='-'):
    """The anchor of a heading, as code hosts make it."""
    return re.sub(r'[^\w\- ]', '', text.strip().lower()).replace(' ', '-')


def expand(root, patterns):
    for pattern in patterns:
        found = sorted(p.relative_to(root).as_posix() for p in root.glob(pattern))
        if not found:
            raise Fault(f'{pattern}: there is no such page')
        yield from found


def address(path):
    """Of the page that a file becomes."""
    return 'index.html' if path == 'README.md' else re.sub(r'\.md$', '', path) + '.html'


def way(from_page, to):
    """Relative link between two files of the site."""
    up = from_page.count('/')
    return '../' * up + to


def title_of(path, text):
    if path.endswith('.h'):
        return path.removeprefix('include/')
    return re.sub(r'[`*]', '', re.search(r'^# (.*)$', text, re.MULTILINE)[1])


def header_page(path, text):
    """A public header: its first comment as text, then the declarations with theirs, by sections."""
    head = re.search(r'/\*.*?\n \*\n(.*?)\*/', text, re.DOTALL)
    about = re.sub(r'^ \* ?', '', head[1], flags=re.MULTILINE).rstrip()
    rest = text[head.end():]
    rest = re.sub(r'#ifndef \w+_H\n#define \w+_H\n', '', rest, count=1)
    rest = re.sub(r'#ifdef __cplusplus\n.*?#endif\n', '', rest, flags=re.DOTALL)
    rest = re.sub(r'\n#endif\s*$', '\n', rest)
    parts = re.split(r'^/\* --- (.*?) -+ \*/$', rest, flags=re.MULTILINE)
    out = [f'<h1>{html.escape(title_of(path, text))}</h1>', f'<pre class="about">{html.escape(about)}</pre>']
    for i, part in enumerate(parts):
        if i % 2:
            out.append(f'<h2 id="{slug(part)}">{html.escape(part)}</h2>')
            continue
        code = html.escape(part.strip('\n'), quote=False)
        if not code:
            continue
        code = re.sub(r'/\*.*?\*/', lambda m: f'<span class="c">{m[0]}</span>', code, flags=re.DOTALL)
        # a name that is declared is a place to point to
        code = re.sub(r'^(PELL_API [^\n]*?)\b(pell_\w+)(?=\()', r'\1<b id="\2">\2</b>', code, flags=re.MULTILINE)
        code = re.sub(r'^((?:struct|enum) )(pell_\w+)(?= \{)', r'\1<b id="\2">\2</b>', code, flags=re.MULTILINE)
        out.append(f'<pre class="api"><code>{code}</code></pre>')
    return '\n'.join(out)


def source_page(path, text):
    lines = ''.join(f'<span id="L{i}">{html.escape(line)}\n</span>' for i, line in enumerate(text.splitlines(), 1))
    return f'<h1>{html.escape(path)}</h1>\n<pre class="source"><code>{lines}</code></pre>'


def folder_page(root, path):
    names = sorted(p for p in (root / path).iterdir() if not p.name.startswith('.') and p.name != '__pycache__')
    items = ''.join(f'<li><code>{html.escape(p.name)}{"/" if p.is_dir() else ""}</code></li>' for p in names)
    return f'<h1>{html.escape(path)}/</h1>\n<ul>{items}</ul>'


def speed_chart(name, entries):
    """A method's frames as columns, one for each commit."""
    values = [e['frames'].get(name) for e in entries]
    width, height, gap = 64, 120, 18
    most = max(v for v in values if v is not None)
    out = [f'<svg class="speed" viewBox="0 0 {(width + gap) * len(values)} {height + 46}" role="img" aria-label="{html.escape(name)}">']
    for i, (entry, value) in enumerate(zip(entries, values)):
        x = i * (width + gap)
        if value is not None:
            high = height * value / most
            out.append(f'<rect x="{x}" y="{height + 16 - high:.1f}" width="{width}" height="{high:.1f}"/>'
                       f'<text x="{x + width / 2:g}" y="{height + 10 - high:.1f}">{value:.1f}</text>')
        out.append(f'<text x="{x + width / 2:g}" y="{height + 34}">{entry["commit"]}</text>')
    return '\n'.join(out + ['</svg>'])


def speed_page(entries):
    names = list(entries[-1]['frames'])
    head = ''.join(f'<th>{html.escape(n)}</th>' for n in names)
    rows = ''.join(f'<tr><td>{e["date"]}</td><td><code>{e["commit"]}</code></td><td>{html.escape(e["note"])}</td>'
                   + ''.join(f'<td>{e["frames"][n]:.1f}</td>' if n in e['frames'] else '<td></td>' for n in names) + '</tr>'
                   for e in reversed(entries))
    charts = ''.join(f'<figure><figcaption>{html.escape(n)}</figcaption>{speed_chart(n, entries)}</figure>' for n in names)
    return ('<h1>Speed by commit</h1>\n<p>The time of a warm frame, as a multiple of the time that Embree needs for the same camera rays '
            'in the same run: a faster or a busier machine changes it little. The scene is <code>bench/screen-space.json</code>, 1280 x '
            '720 with one sample per pixel. <code>bench/record.py</code> measures it.</p>\n'
            f'<div class="speeds">{charts}</div>\n<h2>All figures</h2>\n<table><thead><tr><th>date</th><th>commit</th><th>since '
            f'the one before</th>{head}</tr></thead><tbody>{rows}</tbody></table>')


class Site:
    def __init__(self, root, out, optics=None):
        self.root, self.out, self.optics = root, out, optics
        self.groups = [(title, list(expand(root, patterns))) for title, patterns in GROUPS]
        self.listed = [p for _, pages in self.groups for p in pages]
        self.titles = {p: title_of(p, (root / p).read_text('utf-8')) for p in self.listed}
        self.waiting, self.made, self.anchors, self.links, self.index = list(self.listed), set(), {}, [], []

    def render(self, text):
        made = markdown.Markdown(extensions=['tables', 'fenced_code', 'toc', 'sane_lists'],
                                 extension_configs={'toc': {'slugify': slug, 'permalink': False}})
        # Markdown wants an empty line before a list that follows a paragraph; code hosts don't
        text = re.sub(r'^((?!\s*[-*] |\s*\d+\. |\||#).+)\n(?=[-*] |\d+\. )', r'\1\n\n', text, flags=re.MULTILINE)
        return made.convert(text).replace('\\|', '|')  # in tables Markdown keeps the backslash of a bar in code

    def resolve(self, path, target):
        """Where a link of a file leads: the address on the site, after asking for what lies there."""
        name, _, anchor = target.partition('#')
        if not name:
            return '#' + anchor
        there = (self.root / path).parent / name
        if not there.exists():
            raise Fault(f'{path}: the link {target} leads nowhere')
        to = there.resolve().relative_to(self.root.resolve()).as_posix()
        if there.is_dir() and (there / 'README.md').exists():
            to += '/README.md'
        if pathlib.PurePath(to).suffix in PICTURES:
            kept = self.out / to
            kept.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.root / to, kept)
            return way(path, to)
        if to not in self.waiting:
            self.waiting.append(to)
        return way(path, address(to)) + ('#' + anchor if anchor else '')

    def relink(self, path, page):
        def one(match):
            target = html.unescape(match[2])
            if re.match(r'[a-z]+:', target):
                return match[0]
            to = self.resolve(path, target)
            self.links.append((path, target, to))
            return f'{match[1]}="{html.escape(to)}"'
        return re.sub(r'\b(href|src)="([^"]*)"', one, page)

    def body_of(self, path):
        there = self.root / path
        if there.is_dir():
            return folder_page(self.root, path)
        text = there.read_text('utf-8')
        if path.endswith('.md'):
            return self.relink(path, self.render(text))
        return header_page(path, text) if path in self.titles else source_page(path, text)

    def menu(self, path):
        out = []
        for title, pages in self.groups:
            open_ = ' open' if path in pages or title in ('Start', 'Methods') \
                or (path, title) in ((BENCH, BENCH_GROUP), (SPEED, SPEED_GROUP)) else ''
            items = ''
            for group, page, name in ((BENCH_GROUP, BENCH, 'Profile bench'), (SPEED_GROUP, SPEED, 'Speed by commit')):
                if title == group and (page != BENCH or self.optics):
                    here = ' aria-current="page"' if path == page else ''
                    items += f'<li><a href="{way(path, page)}"{here}>{name}</a></li>'
            for p in pages:
                here = ' aria-current="page"' if p == path else ''
                items += f'<li><a href="{way(path, address(p))}"{here}>{html.escape(self.titles[p])}</a></li>'
            out.append(f'<details{open_}><summary>{title}</summary><ul>{items}</ul></details>')
        return '\n'.join(out)

    def add(self, path):
        body = self.body_of(path)
        title = self.titles.get(path, path)
        self.write(path, self.out / address(path), title if path == 'README.md' else f'{title} - {TITLE}', body)
        self.anchors[address(path)] = set(re.findall(r'\bid="([^"]*)"', body))
        if path in self.titles:
            plain = re.sub(r'\s+', ' ', html.unescape(re.sub(r'<[^>]*>', ' ', body)))
            headings = [(i, html.unescape(re.sub(r'<[^>]*>', '', h)))
                        for i, h in re.findall(r'<h[1-4](?: id="([^"]*)")?[^>]*>(.*?)</h[1-4]>', body)]
            names = re.findall(r'<b id="(\w+)">', body)
            if path == OPTIONS:
                names = sorted(set(re.findall(r'(?<![\w-])--[a-z][a-z-]*', plain)))
            weight = LESS if path in self.groups[-1][1] else 1
            self.index.append({'to': address(path), 'title': title, 'headings': headings, 'names': names, 'weight': weight, 'text': plain})

    def write(self, path, to, title, body):
        page = (HERE / 'page.html').read_text('utf-8')
        for key, value in (('TITLE', html.escape(title)), ('UP', '../' * path.count('/')), ('MENU', self.menu(path)), ('BODY', body)):
            page = page.replace(f'@{key}@', value)
        to.parent.mkdir(parents=True, exist_ok=True)
        to.write_text(page, 'utf-8')

    def add_bench(self):
        """The profile bench: the materials with coefficients, the optics, the viewer's plot and the page's own script."""
        body = (HERE / 'bench/bench.html').read_text('utf-8')
        materials = {}
        for path in sorted((self.root / 'data/materials').glob('*.json')):
            m = json.loads(path.read_text('utf-8'))
            if 'sigma_a' in m and 'sigma_s_reduced' in m:
                materials[path.stem] = {'title': m['title'], **{k: m[k] for k in ('sigma_a', 'sigma_s_reduced', 'eta')}}
        plot = (self.root / 'src/viewer/page/plot.js').read_text('utf-8')
        script = '\n'.join((f'const MATERIALS = {json.dumps(materials)};', re.sub(r'^export ', '', plot, flags=re.MULTILINE),
                            (HERE / 'bench/bench.js').read_text('utf-8')))
        shutil.copyfile(self.optics, self.out / 'optics.js')
        (self.out / 'bench.js').write_text(script, 'utf-8')
        self.write(BENCH, self.out / BENCH, f'Profile bench - {TITLE}',
                   body + '<script src="optics.js"></script>\n<script src="bench.js"></script>')
        self.add_to_search(BENCH, 'Profile bench', body)

    def add_speed(self):
        """The times of frames that bench/record.py has measured, commit by commit."""
        body = speed_page(json.loads((self.root / 'docs/site/speed.json').read_text('utf-8')))
        self.write(SPEED, self.out / SPEED, f'Speed by commit - {TITLE}', body)
        self.add_to_search(SPEED, 'Speed by commit', body)

    def add_to_search(self, page, title, body):
        plain = re.sub(r'\s+', ' ', html.unescape(re.sub(r'<[^>]*>', ' ', body)))
        self.index.append({'to': page, 'title': title, 'headings': [('', title)], 'names': [], 'weight': 1, 'text': plain})

    def make(self):
        self.out.mkdir(parents=True, exist_ok=True)
        while self.waiting:
            path = self.waiting.pop(0)
            if path not in self.made:
                self.made.add(path)
                self.add(path)
        if self.optics:
            self.add_bench()
        self.add_speed()
        for name in ('site.css', 'site.js'):
            shutil.copyfile(HERE / name, self.out / name)
        (self.out / 'search.js').write_text('const PAGES = ' + json.dumps(self.index, ensure_ascii=False) + ';\n', 'utf-8')
        for path, target, to in self.links:
            name, _, anchor = to.partition('#')
            page = pathlib.PurePosixPath(address(path)).parent / name if name else pathlib.PurePosixPath(address(path))
            parts = []
            for part in page.parts:
                parts = parts[:-1] if part == '..' else parts + [part]
            there = '/'.join(parts)
            if not (self.out / there).is_file() or (anchor and anchor not in self.anchors[there]):
                raise Fault(f'{path}: the link {target} leads nowhere')
        return len(self.made)


def main():
    root, out = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2])
    try:
        count = Site(root, out, sys.argv[3] if len(sys.argv) > 3 else None).make()
    except Fault as fault:
        print(f'make_site.py: {fault}', file=sys.stderr)
        return 1
    print(f'{count} pages: {out / "index.html"}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
