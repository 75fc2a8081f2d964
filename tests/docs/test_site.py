#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_site.py PROGRAM ROOT: the documentation as pages for a browser: all of it is there, links lead somewhere, the search finds; and the
page from paper to pixels names functions where they are."""
import json
import re
import shutil
import subprocess
import sys

from cli_test import ROOT, clean_environment, main, need, Skip, test

MAKE = ROOT / 'docs/site/make_site.py'


def python_with_markdown():
    for python in (sys.executable, 'python3', '/usr/bin/python3'):
        if shutil.which(python) and subprocess.run([python, '-c', 'import markdown'], capture_output=True, check=False).returncode == 0:
            return python
    raise Skip('there is no Python with Markdown (python3-markdown)')


def make(python, root, out):
    return subprocess.run([python, MAKE, root, out], capture_output=True, text=True, check=False, timeout=120)


def seen(browser, page, *more):
    """The page as a browser has it after its scripts."""
    done = subprocess.run([browser, '--headless', '--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage', *more, '--dump-dom', page],
                          capture_output=True, text=True, check=False, timeout=120, env=clean_environment())
    return done.stdout


@test('the site has every page of the documentation, no link of it is broken, and nothing of it asks the network')
def _(folder):
    done = make(python_with_markdown(), ROOT, folder / 'site')
    need(done.returncode == 0, done.stderr)
    pages = {p.relative_to(folder / 'site').as_posix() for p in (folder / 'site').rglob('*.html')}
    for path in [*(ROOT / 'docs/guide').glob('*.md'), *(ROOT / 'docs/adr').glob('*.md'), *(ROOT / 'src/methods').glob('*/README.md')]:
        need(path.relative_to(ROOT).with_suffix('.html').as_posix() in pages, path)
    for path in (ROOT / 'include/pellucid').glob('*.h'):
        need(f'include/pellucid/{path.name}.html' in pages, path)
        declared = set(re.findall(r'^PELL_API [^\n]*?\b(pell_\w+)\(', path.read_text('utf-8'), re.MULTILINE))
        page = (folder / f'site/include/pellucid/{path.name}.html').read_text('utf-8')
        need(declared <= set(re.findall(r'<b id="(pell_\w+)">', page)), path.name, declared)
    for path in sorted(pages):
        text = (folder / 'site' / path).read_text('utf-8')
        need('@BODY@' not in text and '@UP@' not in text, path)
        need(not re.search(r'<(?:script|img|link)[^>]*(?:src|href)="https?:', text), path)


@test('the page of speeds has every commit and method of docs/site/speed.json')
def _(folder):
    done = make(python_with_markdown(), ROOT, folder / 'site')
    need(done.returncode == 0, done.stderr)
    page = (folder / 'site/speed.html').read_text('utf-8')
    entries = json.loads((ROOT / 'docs/site/speed.json').read_text('utf-8'))
    need(entries == sorted(entries, key=lambda e: e['date']))
    for entry in entries:
        need(f'<code>{entry["commit"]}</code>' in page and entry['note'] in page, entry)
        for name, ratio in entry['frames'].items():
            need(f'<td>{ratio:.1f}</td>' in page and f'<figcaption>{name}</figcaption>' in page, name, ratio)


@test('a link that leads nowhere is an error that names the page')
def _(folder):
    python = python_with_markdown()
    root = folder / 'root'
    shutil.copytree(ROOT, root, ignore=shutil.ignore_patterns('build*', '.git', 'node_modules', 'out', 'assets'))
    page = root / 'docs/guide/first-picture.md'
    whole = page.read_text('utf-8')
    for planted in ('[a](no-such.md)', '[a](library.md#no-such)'):
        page.write_text(whole + '\n' + planted + '\n', 'utf-8')
        done = make(python, root, folder / 'site')
        need(done.returncode == 1 and 'docs/guide/first-picture.md: the link' in done.stderr and 'no-such' in done.stderr, planted, done)


@test('the search leads to the page by its title, its headings, its functions and options, in a browser')
def _(folder):
    browser = shutil.which('chromium')
    if not browser:
        raise Skip('there is no Chromium')
    need(make(python_with_markdown(), ROOT, folder / 'site').returncode == 0)
    index = (folder / 'site/index.html').as_uri()
    profile = f'--user-data-dir={folder / "profile"}'
    for words, page in (('sample elimination', 'src/methods/hierarchical/README.html'),
                        ('pell_kernel_chain_make', 'include/pellucid/kernel.h.html#pell_kernel_chain_make'),
                        ('pell_render_result', 'include/pellucid/render.h.html#pell_render_result'),
                        ('materials', 'docs/guide/materials.html'), ('profiles', 'docs/guide/profiles.html'),
                        ('python', 'docs/guide/python.html'), ('install', 'docs/guide/install.html'),
                        ('screen-space', 'src/methods/screen_space/README.html'), ('viewer', 'docs/guide/viewer.html'),
                        ('scene file', 'docs/guide/scene-file.html'), ('optics.h', 'include/pellucid/optics.h.html'),
                        ('--set', 'docs/guide/command-line.html'), ('--checkpoint', 'docs/guide/command-line.html'),
                        ('long runs', 'docs/guide/command-line.html#long-runs')):
        found = re.search(r'<ol id="found">(.*?)</ol>', seen(browser, f'{index}?search={words.replace(" ", "%20")}', profile), re.DOTALL)
        first = found and re.findall(r'href="([^"]*)"', found[1])
        need(first and (first[0] == page or first[0].split('#')[0] == page) and '<mark>' in found[1], words, first)
    need('No page has all of these words' in seen(browser, f'{index}?search=qwertzuiop', profile))
    need('<b>bold</b>' not in seen(browser, f'{index}?search=%3Cb%3Ebold%3C/b%3E', profile).split('<nav')[0], 'words become markup')


@test('the page from paper to pixels names functions where they are')
def _(folder):
    path = ROOT / 'docs/guide/paper-to-pixels.md'
    names, named = [], 0
    for match in re.finditer(r'`(\w+)`|\]\(([^)]+)\)', path.read_text('utf-8')):
        if match[1]:
            names.append(match[1])
            continue
        home = (path.parent / match[2]).resolve()
        if home.suffix in ('.h', '.c'):
            for name in names:
                need(re.search(rf'\b{name}\(', home.read_text('utf-8')), name, 'is not in', match[2])
                named += 1
            names = []
    need(named > 20 and not names, named, names)


if __name__ == '__main__':
    sys.exit(main())
