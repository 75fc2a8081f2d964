#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_examples.py PROGRAM ROOT EXAMPLES BENCH: every shipped scene renders; every mesh of ../shared renders, or is refused for a reason
that its message states. EXAMPLES and BENCH are the build's folders with the scenes and the meshes that they name."""
import os
import pathlib
import re
import sys
import time

from cli_test import ROOT, SANITIZED, Skip, main, need, one_object, png_pixels, run, test, text, works

EXAMPLES, BENCH = (pathlib.Path(os.path.abspath(p)) for p in sys.argv[3:5])
QUICK = ['--width', '96', '--height', '72', '--msaa', '1', '--light-samples', '4', '--ambient-samples', '4', '--indirect-samples', '512']

# Files that are unsupported, by the required message.
REFUSED = {}
# Files that show nothing, and why.
DARK = {'generated/paper_lantern.gltf': 'its only light is enclosed by the opaque ball around it'}


def looks_like_something(png):
    """The image is not constant, and the middle differs from the upper left corner."""
    width, height, channels, data = png_pixels(png)
    colours = {data[i:i + channels] for i in range(0, len(data), channels)}
    need(len(colours) > 40, len(colours), 'colours')
    shown = [sum(data[i:i + 3]) for i in range(0, len(data), channels)]
    bright, dark = sum(v > 90 for v in shown), sum(v > 750 for v in shown)
    need(bright > 0.02 * len(shown), 'the picture is dark')
    need(dark < 0.5 * len(shown), 'the picture is burnt out')
    return width, height


def scene_test(path):
    @test(f'{path.parent.name}/{path.name} renders, with scattering and without')
    def _(folder):
        built = (EXAMPLES if path.parent.name == 'examples' else BENCH) / path.name
        need(built.exists(), built.name, 'is not in the build folder')
        seen = []
        for method in ('screen-space',) if SANITIZED else ('screen-space', 'none'):
            done = works(folder, 'render', str(built), *QUICK, '-m', method, '-o', f'{method}.png')
            warnings = [line for line in done.stderr.lower().splitlines() if b'warning' in line]
            known = (b'scattering is not visible', b'about scattering too small to see', b"ignores its layers' depth maps")
            need(all(any(k in line for k in known) for line in warnings), done.stderr)
            data = (folder / f'{method}.png').read_bytes()
            need(looks_like_something(data) == (96, 72), 'size')
            seen.append(png_pixels(data))
        need(SANITIZED or seen[0] != seen[1], 'scattering changes nothing')
        answer = one_object(works(folder, 'check', str(built), '--json'))
        need(answer['triangles'] > 0, answer)


# Scenes of bench/ differ in numbers of objects and lights, which sanitizers gain nothing from.
for scene in sorted([*(ROOT / 'examples').glob('*.json'), *([] if SANITIZED else (ROOT / 'bench').glob('*.json'))]):
    scene_test(scene)


@test('there are examples')
def _(folder):
    need(len(list((ROOT / 'examples').glob('*.json'))) >= 4 and list((ROOT / 'bench').glob('*.json')), 'none found')


@test('the wave runs, and comes back after its period of two seconds')
def _(folder):
    wave = str(EXAMPLES / 'wave.json')
    answer = one_object(works(folder, 'render', wave, *QUICK, '--frames', '0:2:0.5', '-o', 'w.png', '--json'))
    need(answer['images'] == [f'w_{i:04d}.png' for i in range(5)], answer)
    frames = [png_pixels((folder / name).read_bytes()) for name in answer['images']]
    need(frames[0] == frames[4] and len({frame[3] for frame in frames}) == 4, 'the times are not apart, or the last is not the first')
    works(folder, 'render', wave, *QUICK, '-o', 'still.png')
    need(png_pixels((folder / 'still.png').read_bytes()) == frames[0], 'the scene file says the time 0')
    bounds = one_object(works(folder, 'check', wave, '--time', '0.3', '--json'))['bounds_mm']
    need(abs(bounds[1][1] - bounds[0][1] - 24.0) < 0.05, bounds, 'a strip of 8 mm in a wave of 16')
    for wrong, word in ((['--frames', '0:2'], b'FROM:TO:STEP'), (['--frames', '2:0:1'], b'backwards'),
                        (['--frames', '0:1e9:1'], b'at most'),
                        (['--frames', '0:1:1', '--time', '1'], b'--time'), (['--frames', '0:1:1', '--turntable', '2'], b'--turntable'),
                        (['--frames', '0:1:1', '--format', 'png', '-o', '-'], b'--frames'),
                        (['--turntable', '2', '-o', '-'], b'--turntable'), (['--animation', 'wvae'], b'"wave"'),
                        (['--time', 'soon'], b'seconds')):
        done = run(folder, 'render', wave, *QUICK, *wrong)
        need(done.returncode == 2 and word in done.stderr, wrong, done.returncode, done.stderr)


# --- Files of other programs ----------------------------------------------------------------------------------------------------------

def asset(root, path, folder):
    """A row of the table: the result of one file."""
    name = str(path.relative_to(root))
    sized = ['--size', '100mm'] if path.suffix in ('.obj', '.ply') else []
    begin = time.monotonic()
    done = run(folder, 'render', str(path), *sized, '--material', 'skin1', *QUICK, '-o', 'a.png')
    seconds = time.monotonic() - begin
    said = re.sub(r'\s+', ' ', text(done.stderr).replace(str(root), '..')).strip()
    if done.returncode == 0:
        need(name not in REFUSED, name, 'renders now: take it off the list')
        if name not in DARK:
            looks_like_something((folder / 'a.png').read_bytes())
        warnings = text(done.stderr).count('warning:')
        return f'{name}: renders in {seconds:.1f} s, warnings: {warnings}' + (f', dark: {DARK[name]}' if name in DARK else '')
    need(done.returncode == 3 and name in REFUSED and REFUSED[name] in said, name, 'ended with', done.returncode, said)
    need(not (folder / 'a.png').exists(), name, 'is refused and a picture is there')
    return f'{name}: refused ({done.returncode}): {said[:160]}'


@test('every mesh of ../shared renders, or is refused for a stated reason')
def _(folder):
    shared = os.environ.get('PELL_SHARED')
    root = pathlib.Path(shared or '.') / 'assets'
    if not shared or not root.exists():
        raise Skip('shared/assets is not there')
    files = sorted(p for p in root.rglob('*') if p.suffix in ('.gltf', '.glb', '.obj', '.ply'))
    need(len(files) > 10, len(files), 'files')
    faults = []
    for path in files[::4] if SANITIZED else files: # tests/scene and the fuzz targets cover the readers
        try:
            print('# ' + re.sub(r'[^ -~]', '?', asset(root, path, folder)))
        except AssertionError as fault:
            faults.append(str(fault))
        if (folder / 'a.png').exists():
            (folder / 'a.png').unlink()
    need(not faults, '\n'.join(faults))


@test('an object whose shape is rounded away far from the origin is told, and ends')
def _(folder):
    (folder / 'cube.obj').write_bytes((EXAMPLES / 'cube.obj').read_bytes())
    (folder / 'far.json').write_text('{"pellucid":1,"meshes":[{"path":"cube.obj","size":"20mm","translate":["1e10mm",0,0]}],'
                                     '"materials":{"*":{"preset":"marble"}}}', 'utf-8')
    done = run(folder, 'render', 'far.json', '-m', 'none', *QUICK, '-o', 'a.png', timeout=120)
    need(done.returncode == 0 and b'its shape is lost' in done.stderr, done.returncode, done.stderr)


@test('meshes without a unit are refused, with the reason and what to do')
def _(folder):
    for arguments in (['bunny.obj'], [str(EXAMPLES / 'cube.obj')]):
        done = run(folder, 'render', *arguments, '-o', 'a.png')
        need(done.returncode == 2 and b'--size' in done.stderr and b'--unit' in done.stderr, done.returncode, done.stderr)


sys.exit(main())
