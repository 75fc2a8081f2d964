#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_docs.py PROGRAM ROOT EXAMPLES PROFILE RENDER PASS KERNEL: tests the documentation: links,
commands, scenes, tables, code.

EXAMPLES is the folder of built example scenes; the last four are the programs of examples/library.
"""
import json
import os
import pathlib
import re
import shlex
import shutil
import signal
import struct
import subprocess
import sys
import zlib

from cli_test import PROGRAM, ROOT, SMALL, clean_environment, exr_header, main, need, one_object, run, Skip, sphere, test, text, works

EXAMPLES = pathlib.Path(sys.argv[3]).resolve()
PROFILE, RENDER, PASS, KERNEL = (os.path.abspath(p) for p in sys.argv[4:8])
GUIDE = ROOT / 'docs/guide'
PAGES = sorted([*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md'), *(ROOT / 'src').rglob('*.md')])


def page(name):
    return (GUIDE / name).read_text('utf-8')


def blocks(markdown, language):
    return re.findall(rf'^```{language}\n(.*?)^```$', markdown, re.MULTILINE | re.DOTALL)


def without_code(markdown):
    return re.sub(r'`[^`\n]*`', '', re.sub(r'^```.*?^```$|^    .*$', '', markdown, flags=re.MULTILINE | re.DOTALL))


def rows(markdown, heading):
    """Cells of the table rows below a heading, down to the next."""
    part = re.search(rf'^#+ {re.escape(heading)}\n(.*?)(?=^#|\Z)', markdown, re.MULTILINE | re.DOTALL)
    need(part, 'no heading', heading)
    cells = [[c.strip() for c in line.strip('|').split(' | ')] for line in part[1].splitlines() if line.startswith('|')]
    return [c for c in cells if not set(c[0]) <= set('-| ')][1:]


# --- Links ----------------------------------------------------------------------------------------------------------------------------

def anchors(path):
    found = set()
    plain = re.sub(r'^```.*?^```$', '', path.read_text('utf-8'), flags=re.MULTILINE | re.DOTALL)
    for heading in re.findall(r'^#+ (.*)$', plain, re.MULTILINE):
        found.add(re.sub(r'[^\w\- ]', '', heading.strip().lower()).replace(' ', '-'))
    return found


def broken_links(path, markdown):
    for target in re.findall(r'\]\(([^)\s]+)\)', without_code(markdown)):
        if re.match(r'[a-z]+:', target):
            continue
        name, _, anchor = target.partition('#')
        there = (path.parent / name).resolve() if name else path
        if not there.exists() or ROOT not in (there, *there.parents):
            yield target
        elif anchor and anchor not in anchors(there):
            yield target


@test('links between pages, to headings and to pictures lead somewhere')
def _(folder):
    for path in PAGES:
        broken = list(broken_links(path, path.read_text('utf-8')))
        need(not broken, path.name, 'has broken links:', broken)
    planted = '[a](no-such.md) [b](library.md#no-such) [c](library.md#scene-and-render-an-image-in-memory) `[d](no.md)` [e](../../../x)'
    need(list(broken_links(GUIDE / 'methods.md', planted)) == ['no-such.md', 'library.md#no-such', '../../../x'], 'the check finds nothing')


@test('every page of the guide and every decision can be reached from the README')
def _(folder):
    seen, todo = set(), [ROOT / 'README.md']
    while todo:
        path = todo.pop()
        if path in seen or path.suffix != '.md' or not path.is_file():
            if path.is_dir():
                seen.update(path.glob('*.md'))
            continue
        seen.add(path)
        todo += [(path.parent / t.partition('#')[0]).resolve() for t in re.findall(r'\]\(([^#)\s][^)\s]*)\)', path.read_text('utf-8'))]
    lost = {p for p in (ROOT / 'docs').rglob('*.md')} - seen
    need(not lost, 'unreachable:', sorted(p.name for p in lost))


@test('files and make targets that the documentation names are there')
def _(folder):
    targets = set(re.findall(r'^([a-z-]+):', (ROOT / 'Makefile').read_text('utf-8'), re.MULTILINE))
    roots = '|'.join(['bench', 'data', 'docs', 'examples', 'fuzz', 'include', 'integrations', 'scripts', 'src', 'tests', r'\.ci',
                      'pellucid'])
    count = 0
    for path in PAGES:
        markdown = path.read_text('utf-8')
        for name in re.findall(rf'`((?:{roots})/[\w./-]+)`', markdown):
            if re.search(r'[A-Z]{4}|NAME|ROOM', name.replace('README', '').replace('CONTRIBUTING', '')):
                continue  # a pattern, as in src/methods/NAME/
            count += 1
            there = ROOT / ('include/' + name if name.startswith('pellucid/') else name)
            made = [there.with_suffix('.c'), there.with_suffix('.h.in')]  # a program by its source, a generated header by its source
            need(there.exists() or any(p.exists() for p in made), path.name, 'names', name)
        for target in re.findall(r'(?:^    |`)make ([a-z-]+)', markdown, re.MULTILINE):
            count += 1
            need(target in targets, path.name, 'names make', target)
    need(count > 20, count)


@test('decisions are numbered without gaps and say context, decision and cost')
def _(folder):
    decisions = sorted((ROOT / 'docs/adr').glob('*.md'))
    for number, path in enumerate(decisions, 1):
        markdown = path.read_text('utf-8')
        need(path.name.startswith(f'{number:04}-') and markdown.startswith(f'# {number}. '), path.name)
        for part in ('Context', 'Decision', 'Cost'):
            need(f'\n**{part}.** ' in markdown, path.name, 'has no', part)


# --- What the examples name ---------------------------------------------------------------------------------------------------------

def png(size, rgba):
    """A grey-to-colour ramp with alpha."""
    lines = b''.join(b'\0' + bytes(v * (x + 8) // (size + 8) for x in range(size) for v in rgba) for _ in range(size))
    def chunk(kind, body):
        return struct.pack('>I', len(body)) + kind + body + struct.pack('>I', zlib.crc32(kind + body))
    header = struct.pack('>IIBBBBB', size, size, 8, 6, 0, 0, 0)
    return b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', header) + chunk(b'IDAT', zlib.compress(lines)) + chunk(b'IEND', b'')


def write_head(path):
    """A ball as glTF: UVs, the material "skin" with its own textures, a camera "front"."""
    vertices, faces = sphere()
    uv = [(0.5 + 0.01 * x, 0.5 - 0.01 * y) for x, y, _ in vertices]
    data = b''.join(struct.pack('<3f', *(0.005 * c for c in v)) for v in vertices), b''.join(struct.pack('<2f', *t) for t in uv), \
        b''.join(struct.pack('<3H', *f) for f in faces)
    low, high = ([0.005 * f(v[c] for v in vertices) for c in range(3)] for f in (min, max))
    starts = [sum(map(len, data[:i])) for i in range(3)]
    path.with_suffix('.bin').write_bytes(b''.join(data))
    path.write_text(json.dumps({
        'asset': {'version': '2.0'}, 'scene': 0, 'scenes': [{'nodes': [0, 1]}],
        'nodes': [{'mesh': 0, 'name': 'head'}, {'camera': 0, 'name': 'front', 'translation': [0, 0, 1]}],
        'cameras': [{'name': 'front', 'type': 'perspective', 'perspective': {'yfov': 0.4, 'znear': 0.01}}],
        'meshes': [{'primitives': [{'attributes': {'POSITION': 0, 'TEXCOORD_0': 1}, 'indices': 2, 'material': 0}]}],
        'materials': [{'name': 'skin', 'pbrMetallicRoughness': {'baseColorTexture': {'index': 0}, 'metallicFactor': 0}}],
        'textures': [{'source': 0}], 'images': [{'uri': 'skin.png'}],
        'accessors': [{'bufferView': 0, 'componentType': 5126, 'count': len(vertices), 'type': 'VEC3', 'min': low, 'max': high},
                      {'bufferView': 1, 'componentType': 5126, 'count': len(vertices), 'type': 'VEC2'},
                      {'bufferView': 2, 'componentType': 5123, 'count': 3 * len(faces), 'type': 'SCALAR'}],
        'bufferViews': [{'buffer': 0, 'byteOffset': s, 'byteLength': len(d)} for s, d in zip(starts, data)],
        'buffers': [{'byteLength': sum(map(len, data)), 'uri': path.with_suffix('.bin').name}]}), 'ascii')


def furnish_more(folder):
    """All files that the pages' scenes and commands name, next to bunny.obj. The scenes are those of the pages themselves."""
    ball = (folder / 'bunny.obj').read_text('ascii')
    for name in ('ball.obj', 'yours.obj'):
        (folder / name).write_text(ball, 'ascii')
    write_head(folder / 'head.gltf')
    for name, color in (('skin', (230, 170, 150, 255)), ('mask', (255, 255, 255, 255)), ('maps', (200, 128, 200, 255)),
                        ('bumps', (128, 128, 255, 255)), ('glass', (255, 90, 60, 255))):
        (folder / f'{name}.png').write_bytes(png(8, color))
    scenes = blocks(page('first-picture.md'), 'json')
    (folder / 'scene.json').write_text(scenes[0], 'utf-8')
    (folder / 'portrait.json').write_text(next(s for s in scenes if 'head.gltf' in s), 'utf-8')
    (folder / 'wax.json').write_text(next(b for b in blocks(page('materials.md'), 'json') if '"wax"' in b), 'utf-8')
    (folder / 'build').mkdir()
    (folder / 'build/examples').symlink_to(EXAMPLES)


def commands(markdown):
    """Complete commands only: no parts of a job script, with variables or further lines."""
    lines = [line.strip() for line in markdown.splitlines() if re.match(r'    (\./)?pellucid [a-z]', line) and 'COMMAND' not in line]
    return [line for line in lines if '$' not in line and line[-1] not in '\\&']


def with_few_samples(words):
    """8 paths per pixel, and some thousand points on a surface, show whether a command runs; pages use settings for final images."""
    words = [re.sub(r'(?<=samples=)\d+', lambda n: str(min(int(n[0]), 8)), w) for w in words]
    words = [str(min(int(w), 8)) if before == '--samples' else w for before, w in zip(['', *words], words)]
    return words + (['--set', 'points=4096'] if words[1] == 'render' and 'hierarchical' in words else [])


def serves(folder, *arguments):
    """A command that runs until it is interrupted: it prints an address, and Ctrl-C ends it."""
    with subprocess.Popen([PROGRAM, *arguments, '--no-open'], cwd=folder, env=clean_environment(), text=True, stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)) as child:
        said = ''
        for line in child.stdout:
            said += line
            if 'http://' in line:
                break
        child.send_signal(signal.SIGINT)
        said += child.communicate(timeout=60)[0]
    need('http://' in said, arguments, said)


def command_test(path):
    @test(f'the commands of {path.name} run, with small pictures of few samples')
    def check(folder):
        furnish_more(folder)
        lines = commands(path.read_text('utf-8'))
        for line in lines:
            words = with_few_samples(shlex.split(line, comments=True))
            if words[1] == 'view':
                serves(folder, *words[1:])
                continue
            small = {'render': SMALL, 'bench': [*SMALL, '--repeats', '1']}.get(words[1], [])
            small = SMALL if words[1] == 'compare' and not any(w.endswith('.exr') for w in words) else small  # of a scene
            works(folder, *words[1:], *small)
            if words[1] == 'render' and '-o' in words and '--turntable' not in words:
                need((folder / words[words.index('-o') + 1]).stat().st_size > 100, line)


for found in [ROOT / 'README.md', *sorted(GUIDE.glob('*.md'))]:
    if commands(found.read_text('utf-8')):
        command_test(found)


# Options of other programs: Slurm's, MPI's, apt-get's; converters'.
OTHERS = {
    'cluster.md': {
        'array', 'bind-to', 'cpus-per-task', 'dependency', 'map-by', 'mca', 'no-install-recommends', 'nodes', 'ntasks-per-node',
        'open-mode', 'parsable', 'requeue', 'signal', 'wrap',
    },
    'engines.md': {'target-env'},
    'scene-file.md': {'compression', 'formats', 'python-expr'},
}


@test('every option that the documentation names is one of the program')
def _(folder):
    names = re.findall(r'^  ([a-z][a-z-]*) ', text(works(folder, '--help').stdout), re.MULTILINE)
    need('render' in names and 'info' in names, names)
    helps = ''.join(text(works(folder, c, '--help').stdout) for c in names if c != 'pellucid')
    there = set(re.findall(r'--([a-z][a-z-]*)', helps)) | {'help', 'version'}
    for path in [ROOT / 'README.md', *GUIDE.glob('*.md')]:
        markdown = '\n'.join(line for line in path.read_text('utf-8').splitlines() if not line.startswith('    cc '))
        strange = set(re.findall(r'(?<![\w-])--([a-z][a-z-]*)', markdown)) - there - OTHERS.get(path.name, set())
        need(not strange, path.name, 'names the options', strange)


@test('the shaders of the page on engines compile with the kernels that its commands export')
def _(folder):
    glslc = shutil.which('glslc')
    if not glslc:
        raise Skip('there is no glslc')
    markdown = page('engines.md')
    exports = [shlex.split(line)[1:] for line in commands(markdown) if '--export' in line]
    need(len(exports) == 2, exports)
    for words in exports:
        works(folder, *words)
    for language in ('glsl', 'hlsl'):
        found = blocks(markdown, language)
        need(len(found) == 1, language, len(found))
        for kernel, good in (('skin_taps', True), ('skin_tops', False)):
            (folder / 'pass').write_text(found[0].replace('skin_taps', kernel), 'ascii')
            done = subprocess.run([glslc, '-x', language, '-fshader-stage=fragment', '-Werror', '-I', folder, 'pass', '-o', 'pass.spv'],
                                  cwd=folder, capture_output=True, timeout=60, check=False)
            need((done.returncode == 0) == good, language, kernel, done.stderr)


# --- Scene and material files ---------------------------------------------------------------------------------------------------------

@test('every JSON block of the guide is a scene or a material file that loads without a warning')
def _(folder):
    furnish_more(folder)
    count = 0
    for path in sorted(GUIDE.glob('*.md')):
        for number, block in enumerate(blocks(path.read_text('utf-8'), 'json'), 1):
            block_name, data = f'{path.name}, block {number}:', json.loads(block)
            (folder / 'block.json').write_text(block, 'utf-8')
            arguments = ['block.json'] if 'pellucid' in data else ['bunny.obj', '--size', '70mm', '--material', 'block.json']
            answer = one_object(works(folder, 'check', *arguments, '--json'))
            problems = [p for p in answer['problems'] if p['severity'] != 'note']
            need(not problems, block_name, problems)
            if 'pellucid' in data:
                works(folder, 'render', 'block.json', *SMALL, '-o', 'block.png')
            count += 1
    need(count >= 10, count)


def schema_properties(schema):
    """For each object of the schema: its property names."""
    objects = {'': schema} | {k: v for k, v in schema['$defs'].items() if 'properties' in v}
    return {name: set(object_['properties']) for name, object_ in objects.items()}


@test('the scene page names every key and every choice of the schema, and no key that is not there')
def _(folder):
    schema = json.loads((ROOT / 'data/scene.schema.json').read_text('utf-8'))
    markdown = page('scene-file.md')
    prose = re.sub(r'^```.*?^```$', '', markdown, flags=re.MULTILINE | re.DOTALL)
    words = set(re.findall(r'[$\w]+', ' '.join(re.findall(r'`([^`\n]+)`', prose))))
    objects = schema_properties(schema)
    for name, properties in objects.items():
        need(properties <= words, 'the page does not name', sorted(properties - words), 'of', name or 'the top level')
    tables = {'Top level': [''], 'Meshes': ['mesh'], 'Camera': ['camera', 'camera_side'], 'Background and ground': ['background'],
              'Render': ['render', ''], 'Materials': ['material', 'textures'], 'Layers': ['layer', 'material']}
    options = set(re.findall(r'--([a-z-]+)', text(works(folder, 'render', '--help').stdout)))
    for heading, names in tables.items():
        known = set().union(*(objects[n] for n in names)) | (options if heading == 'Render' else set())
        for row in rows(markdown, heading):
            for key in re.findall(r'`([$\w-]+)`', row[0]):
                need(key in known, heading, 'has the key', key)
    for kind in (k[6:] for k in objects if k.startswith('light_')):
        need(f'`{kind}`' in prose or f'"{kind}"' in prose, 'light', kind)
    for choice in ('ggx', 'kelemen', 'phong', 'blinn-phong', 'profile', 'texture', 'environment', 'transparent'):
        need(f'"{choice}"' in prose, choice)


@test('the material page says the numbers of the built-in materials, and names them all')
def _(folder):
    materials = {m['name']: m for m in one_object(works(folder, 'materials', '--json'))['materials']}
    listed = {r[0].strip('`'): r for r in rows(page('materials.md'), 'What ships') if r[0].startswith('`')}
    need(set(listed) == set(materials), 'differ:', sorted(set(listed) ^ set(materials)))

    def three(values):
        return ' '.join('infinite' if v is None else f'{v:.3g}' for v in values)
    for name, m in materials.items():
        if m['kind'] == 'medium':
            row = [f'`{name}`', m['title'], three(m['mean_free_path']), three(m['diffuse_mean_free_path']), f"{m['eta']:g}"]
            need(listed[name] == row, 'should be', row)


@test('a material file: what is unsaid, and that reduced and unreduced scattering can not be mixed up')
def _(folder):
    def check(**data):
        (folder / 'm.json').write_text(json.dumps({'sigma_a': [0.01] * 3} | data), 'ascii')
        return run(folder, 'check', 'bunny.obj', '--size', '70mm', '--material', 'm.json', '--json')
    plain = one_object(check(sigma_s_reduced=[1, 1, 1]))['materials'][0]
    need((plain['eta'], plain['color_from'], plain['opaque']) == (1.3, 'profile', False), plain)
    turned = one_object(check(sigma_s=[10, 10, 10], g=0.9))['materials'][0]
    need(max(abs(a - b) for a, b in zip(plain['mean_free_path'], turned['mean_free_path'])) < 1e-6, turned)
    with_g = one_object(check(sigma_s_reduced=[1, 1, 1], g=0.9))['materials'][0]
    need(with_g['mean_free_path'] == plain['mean_free_path'], 'g changed what is reduced')
    for data in ({'sigma_s': [1, 1, 1]}, {'sigma_s': [1, 1, 1], 'sigma_s_reduced': [1, 1, 1], 'g': 0}):
        need(check(**data).returncode == 3, data)


# --- Methods, messages ----------------------------------------------------------------------------------------------------------------

@test('every registered method is on the method page and in the README, with its page, its title and its engines')
def _(folder):
    listed = {re.match(r'`([\w-]+)`', r[0])[1]: r for r in rows(page('methods.md'), 'Methods')}
    readme = (ROOT / 'README.md').read_text('utf-8')
    methods = one_object(works(folder, 'methods', '--json'))['methods']
    need(set(listed) == {m['name'] for m in methods} | {'none'}, sorted(listed))
    for m in methods:
        row = ' '.join(listed[m['name']])
        readme_of = f"../../src/methods/{m['name'].replace('-', '_')}/README.md"
        need(readme_of in row and (GUIDE / readme_of).exists(), row)
        need(m['title'] in row and all(e in row for e in m['engines']) and f"`{m['name']}`" in readme, row)
        need(m['citation'][-4:] in row, m['citation'])


# Message of the troubleshooting page: a command that causes it. SCENE is followed by keys that override a valid scene.
SCENE, BALL = object(), ['bunny.obj', '--size', '70mm']
MESSAGES = {
    'the surface is open': ['render', 'open.obj', '--size', '70mm', *SMALL],
    'is longer than the object is thick': ['render', 'bunny.obj', '--size', '1mm', '--material', 'chicken1', *SMALL],
    'scattering is not visible': ['render', 'bunny.obj', '--size', '9m', *SMALL],
    'no material is translucent': [SCENE, {'materials': {'*': {'opaque': True}}}],
    'no material is called': [SCENE, {'materials': {'Skim': {'preset': 'skin'}}}],
    "can't be used and is left out": [SCENE, {'materials': {'*': {'preset': 'marble', 'textures': {'baseColor': 'a.xyz'}}}}],
    'the light on the visible surfaces is negligible':
        ['render', *BALL, '--environment', 'sky.pfm', '--environment-scale', '1e-30', *SMALL],
    'nothing is in view': ['render', 'flat.obj', '--size', '70mm', *SMALL],
    'names no material: marble is used': ['check', *BALL],
    'OBJ files have no unit': ['check', 'bunny.obj'],
    'has no unit': ['check', 'bunny.obj', '--size', '70'],
    'there is no material': ['check', *BALL, '--material', 'milk'],
    'there is no method': ['render', *BALL, '-m', 'sss'],
    'must end in .png, .exr, .hdr or .pfm': ['render', *BALL, '-o', 'a.jpg'],
    'unknown key': [SCENE, {'lamps': []}],
    'has sigma_s without g': [SCENE, {'materials': {'*': {'sigma_a': [1, 1, 1], 'sigma_s': [1, 1, 1]}}}],
    "leads out of the scene's folder": [SCENE, {'mesh': '../bunny.obj'}],
    'a length without a unit could mean anything': [SCENE, {'materials': {'*': {'color': [1, 1, 1], 'mean_free_path': 1}}}],
    "can't be read": [SCENE, {'background': {'image': 'a.xyz'}}],
    'is one of the files that were read': ['render', 'scene.json', '--format', 'png', '-o', 'bunny.obj', *SMALL],
    'is the environment, but no light is one': [SCENE, {'background': 'environment'}],
    'must have depth_scale': [SCENE, {'materials': {'*': {'layers': [{'sigma_a': [1, 1, 1], 'sigma_t': [2, 2, 2], 'depth': 'a.png#r'}]}}}],
    'must have two of sigma_a, sigma_s and sigma_t': [SCENE, {'materials': {'*': {'layers': [{'sigma_a': [1, 1, 1]}]}}}],
    'no Vulkan device': ['render', *BALL, '--engine', 'vulkan', '--device', '99'],
    'allowed are glTF (.gltf, .glb), OBJ, PLY, STL and scene files (.json)': ['check', 'a.xyz'],
    'raise the limit': ['check', *BALL, '--limit', 'file-bytes=10'],
    'the mean free path of': ['render', 'bunny.obj', '--size', '1mm', '--material', 'chicken1', *SMALL],
}


@test('every message on the troubleshooting page is one that the program says')
def _(folder):
    markdown = page('troubleshooting.md')
    documented = {m for heading in ('Warnings', 'Errors') for r in rows(markdown, heading) for m in re.findall(r'`([^`]+)`', r[0])}
    need(documented == set(MESSAGES), 'differ:', sorted(documented ^ set(MESSAGES)))
    mesh = (folder / 'bunny.obj').read_text('ascii').splitlines(True)
    (folder / 'open.obj').write_text(''.join(mesh[:-20]), 'ascii')
    (folder / 'flat.obj').write_text('v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n', 'ascii')
    (folder / 'a.xyz').write_text('0 0 0\n', 'ascii')
    (folder / 'sky.pfm').write_bytes(b'PF\n2 1\n-1.0\n' + struct.pack('<6f', *6 * [1.0]))
    for message, arguments in MESSAGES.items():
        if arguments[0] is SCENE:
            (folder / 's.json').write_text(json.dumps({'pellucid': 1, 'mesh': 'bunny.obj', 'size': '70mm'} | arguments[1]), 'ascii')
            arguments = ['check', 's.json']
        done = run(folder, *arguments)
        said = re.sub(r'\s+', ' ', text(done.stdout) + text(done.stderr))
        need(message in said, message, 'is not said:', said)


# --- The library ----------------------------------------------------------------------------------------------------------------------

def program(folder, *command):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False, env=clean_environment())
    need(done.returncode == 0, pathlib.Path(command[0]).name, 'ended with', done.returncode, done.stderr)
    return done.stdout


@test('the code on the library page stands in the example programs, each under 100 lines')
def _(folder):
    sources = {p.name: p.read_text('utf-8') for p in (ROOT / 'examples/library').glob('*.c')}
    markdown = page('library.md')
    code = blocks(markdown, 'c')
    need(len(sources) == 4 and len(code) >= 10, len(code))
    for block in code:
        need(any(block in source for source in sources.values()), 'is in no example:', block)
    for name, source in sources.items():
        need(f'`examples/library/{name}`' in markdown and source.count('\n') < 100, name)
        need(any(block in source for block in code), 'the page shows nothing of', name)


@test('the method of the guide compiles as it stands on the page')
def _(folder):
    code = blocks(page('add-a-method.md'), 'c')
    need(len(code) == 3, len(code))
    for block in code:
        (folder / re.search(r'\* (\w+\.[ch]) - ', block)[1]).write_text(block.replace('methods/box_blur/', ''), 'utf-8')
    for name in ('method.c', 'cpu.c'):
        include = [f'-I{path}' for path in (ROOT / 'include', EXAMPLES.parent / 'include', ROOT / 'src')]
        flags = ['-std=c11', '-D_POSIX_C_SOURCE=200809L', '-Wall', '-Wextra', '-Wno-missing-field-initializers', '-Werror', '-fsyntax-only']
        command = [*shlex.split(os.environ.get('CC', 'cc')), *flags, *include, name]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        need(done.returncode == 0, name, done.stderr)


@test('the programs of examples/ compile without a warning, by gcc and by clang')
def _(folder):
    include = [f'-I{path}' for path in (ROOT / 'include', EXAMPLES.parent / 'include')]
    flags = ['-std=c11', '-Wall', '-Wextra', '-Wconversion', '-pedantic', '-fsyntax-only']
    for compiler in filter(shutil.which, ('gcc', 'clang')):
        for source in sorted((ROOT / 'examples').rglob('*.c')):
            done = subprocess.run([compiler, *flags, *include, source], cwd=folder, capture_output=True, text=True, check=False)
            if 'vulkan/vulkan' in done.stderr:
                continue  # its headers are not installed
            need(done.returncode == 0 and not done.stderr, compiler, source.name, done.stderr)


@test('profile: the lengths and totals that `materials` prints, weights that sum to the total')
def _(folder):
    out = program(folder, PROFILE, 'wholemilk')
    milk = one_object(works(folder, 'materials', 'wholemilk', '--json'))['materials'][0]
    for c, name in enumerate('RGB'):
        line = re.search(rf'^{name} +([\d.]+) mm +([\d.]+) mm +([\d.]+) +([\d.]+) +([\d.]+) +([\d.]+)%$', out, re.MULTILINE)
        need(line, out)
        mean, diffuse, total, near, far, inside = map(float, line.groups())
        need(abs(mean - milk['mean_free_path'][c]) < 1e-4 and abs(diffuse - milk['diffuse_mean_free_path'][c]) < 1e-4, line[0])
        weights = [float(w.split()[c]) for w in re.findall(r'weights +(.*)', out)]
        need(len(weights) == 4 and abs(sum(weights) - total) < 3e-4 and near > far and 0 < inside < 100, line[0])
    program(folder, PROFILE)
    need(subprocess.run([PROFILE, 'skin'], capture_output=True, check=False).returncode == 2, 'skin has no coefficients')


@test('kernel: rings hold 99 % of the light, taps multiply to the total, melanin darkens')
def _(folder):
    totals = []
    for melanin in ('0.02', '0.3'):
        out = program(folder, KERNEL, melanin)
        total = list(map(float, re.search(r'^total (.*)$', out, re.MULTILINE)[1].split()))
        taps = [list(map(float, line.split())) for line in out.split('taps:')[1].split('\n\n')[0].splitlines()[1:]]
        need(len(taps) == 17 and all(abs(sum(t[1 + c] for t in taps) ** 2 - total[c]) < 1e-3 for c in range(3)), taps, total)
        inside, whole = map(float, re.search(r'rings hold ([\d.]+) of ([\d.]+)', out).groups())
        need(abs(inside - 0.99 * whole) < 2e-3 and abs(whole - total[0]) < 2e-4, inside, whole)
        radii = list(map(float, re.search(r'equal light, red: (.*)$', out, re.MULTILINE)[1].split()))
        need(len(radii) == 8 and radii == sorted(radii) and radii[0] > 0, radii)
        totals.append(total)
    need(all(a > b for a, b in zip(*totals)), totals)
    need(subprocess.run([KERNEL, '2'], capture_output=True, check=False).returncode == 2, 'melanin 2')


@test('render: a picture in memory, and an EXR with the channels it lists')
def _(folder):
    out = program(folder, RENDER, 'bunny.obj', '70', 'marble', 'out.exr')
    listed = re.search(r'^channels: (.*)$', out, re.MULTILINE)[1].split()
    attributes, channels, _ = exr_header((folder / 'out.exr').read_bytes())
    need(sorted(listed) == sorted(name for name, _ in channels) and len(listed) >= 20, listed, channels)
    need('0 pixels set to 0' in out and all(float(v) > 0 for v in re.search(r'middle: (\S+) (\S+) (\S+) W', out).groups()), out)


@test('pass: planes of a caller, within 0.5 % of the closed form, red reaching farther than blue')
def _(folder):
    out = program(folder, PASS)
    table = [list(map(float, line.split())) for line in out.splitlines() if re.match(r' +-?\d', line)]
    need(len(table) >= 7 and all(a[c] < b[c] for a, b in zip(table, table[1:]) for c in (1, 2, 3)), out)
    need(all(row[1] > row[3] for row in table if row[0] < 0), out)
    need(float(re.search(r'closed form: ([\d.]+)', out)[1]) < 0.5, out)


# --- Versions, papers -----------------------------------------------------------------------------------------------------------------

@test('meson.build, CITATION.cff and the program tell the same version, and the changelog has it')
def _(folder):
    version = re.search(r"version: '([\d.]+)'", (ROOT / 'meson.build').read_text('utf-8'))[1]
    need(f'\nversion: {version}\n' in (ROOT / 'CITATION.cff').read_text('utf-8'), 'CITATION.cff')
    need(re.search(rf'^## {re.escape(version)}\b', (ROOT / 'CHANGELOG.md').read_text('utf-8'), re.MULTILINE), 'CHANGELOG.md')
    need(version in text(works(folder, '--version').stdout))


@test('what the code cites by author and year is in references.bib')
def _(folder):
    bib = {}
    for entry in re.split(r'^@', (ROOT / 'docs/references.bib').read_text('utf-8'), flags=re.MULTILINE)[1:]:
        author, year = re.search(r'author = \{(.*)\},$', entry, re.MULTILINE)[1], re.search(r'year = \{(\d+)\}', entry)[1]
        key = re.match(r'\w+\{(\w+),', entry)[1]
        need(year in key and entry.count('{') == entry.count('}'), key)
        bib.setdefault(year, []).append(re.sub(r'\{?\\.\{?(\w)\}?\}?', r'\1', author))
    name = r"(?:d')?[A-Z][a-z][A-Za-z-]+"
    cited = re.compile(rf"({name}(?:(?:,? (?:and )?{name})*| et al\.)) \(?(1[89]\d\d|20[0-2]\d)\b")
    missing, count = set(), 0
    for path in [*(ROOT / 'src').rglob('*.[ch]'), *(ROOT / 'src').rglob('*.md'), *(ROOT / 'include').rglob('*.h'), *GUIDE.glob('*.md'),
                 *(ROOT / 'docs/adr').glob('*.md')]:
        for names, year in cited.findall(re.sub(r'\s*\n(?: \*)? *', ' ', path.read_text('utf-8'))):
            count += 1
            if not any(author in authors for author in re.findall(name, names) for authors in bib.get(year, [])):
                missing.add(f'{names} {year} ({path.name})')
    need(not missing, 'missing:', sorted(missing))
    need(count > 20, count)


if __name__ == '__main__':
    sys.exit(main())
