#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""soak.py PROGRAM [--hours H | --seconds S] [--seed N] [--jobs N] [--keep FOLDER]: runs the program for hours on invalid
input: files with changed bytes, random scenes by every method, too little memory, and kills. A case is its seed: --seed N --cases 1 runs it
again. Failing cases are kept in a folder, with their commands. Standard library only."""
import argparse
import array
import json
import math
import os
import pathlib
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
METHODS = ('none', 'screen-space', 'image-space', 'texture-space', 'convolution', 'layered', 'hierarchical', 'dipole', 'single-scatter',
           'path-trace')
# `points` of hierarchical: its time depends on the surface in units of the mean free path, minutes for an object of 80 mm
FEW = {'dipole': ['--samples', '128'], 'path-trace': ['--samples', '2'], 'single-scatter': ['--samples', '128'],
       'hierarchical': ['--set', 'points=100000']}
SANITIZED = 'PELL_SANITIZED' in os.environ # which reserve terabytes of addresses: memory has no limit there
SECONDS = 120 # of processor time, of one run: others may use the machine
HANGS = 20 * SECONDS # a run that has not ended by then is not working but waiting
MEMORY = 4 << 30
SMALL = ['--width', '40', '--height', '30', '--msaa', '1', '--light-samples', '2', '--bounces', '1', '--indirect-samples', '256']
READERS = {'gltf': '.glb', 'obj': '.obj', 'ply': '.ply', 'stl': '.stl', 'scene': '.json', 'image': None, 'material': '.json',
           'profile_table': '.csv', 'mtl': '.mtl'}


class Wrong(Exception):
    """A run's misbehaviour."""


def run(program, folder, command, memory=MEMORY, kill_after=None):
    """The exit code and the output; Wrong for a signal, a run that does not end, or another code."""
    def limited():
        if not SANITIZED:
            resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
    child = subprocess.Popen([program, *command], cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                             preexec_fn=limited)
    try:
        said = child.communicate(timeout=kill_after or HANGS)[1]
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
        if kill_after:
            return None, b''
        raise Wrong(f'{command}: did not end in {HANGS} s') from None
    if child.returncode == -signal.SIGXCPU:
        raise Wrong(f'{command}: took over {SECONDS} s of processor time')
    if child.returncode not in (0, 2, 3, 4, 5):
        raise Wrong(f'{command}: ended with {child.returncode}: {said[-500:]!r}')
    if child.returncode and b'error' not in said and b'usage' not in said:
        raise Wrong(f'{command}: ended with {child.returncode} and said no error: {said[-500:]!r}')
    return child.returncode, said


def need_finite(path):
    """Of a PFM."""
    kind, size, scale, data = path.read_bytes().split(b'\n', 3)
    width, height = map(int, size.split())
    values = array.array('f', data)
    if kind != b'PF' or float(scale) >= 0 or len(values) != 3 * width * height:
        raise Wrong(f'{path.name} is no whole picture')
    if not all(math.isfinite(v) and v >= 0 for v in values):
        raise Wrong(f'{path.name} holds a value that is no number, or is negative')


# --- Generated input -------------------------------------------------------------------------------------------------------------------

def ball(pick, name, path):
    """A deformed ball, sometimes open, as OBJ; from a few to some thousand triangles, anywhere, of any size."""
    rows, columns = pick.randint(2, 40), pick.randint(3, 60)
    dent, scale, offset = pick.uniform(0, 0.9), 10 ** pick.uniform(-3, 3), [pick.uniform(-3, 3) for _ in range(3)]
    lines = [f'o {name}']
    for i in range(rows + 1):
        for j in range(columns):
            a, b = math.pi * (i / rows - 0.5), 2 * math.pi * j / columns
            r = scale * (1 + dent * math.sin(3 * a + pick.random() * 0.1) * math.cos(2 * b))
            lines.append(f'v {offset[0] + r * math.cos(a) * math.sin(b):.7g} {offset[1] + r * math.sin(a):.7g} '
                         f'{offset[2] + r * math.cos(a) * math.cos(b):.7g}')
    for i in range(rows if pick.random() < 0.8 else max(1, rows // 2)):
        for j in range(columns):
            k = (j + 1) % columns
            corners = (i * columns + j, i * columns + k, (i + 1) * columns + k, (i + 1) * columns + j)
            lines.append('f ' + ' '.join(str(1 + n) for n in corners))
    path.write_text('\n'.join(lines) + '\n', 'ascii')


def random_scene(pick, folder, materials):
    ball(pick, 'ball', folder / 'ball.obj')
    scene = {'pellucid': 1, 'mesh': 'ball.obj', 'size': f'{10 ** pick.uniform(-1, 3):.4g}mm',
             'materials': {'*': {'preset': pick.choice(materials)}}}
    if pick.random() < 0.3:
        scene['materials']['*'] = {'sigma_a': [10 ** pick.uniform(-6, 1) for _ in range(3)],
                                   'sigma_s_reduced': [10 ** pick.uniform(-3, 3) for _ in range(3)], 'eta': pick.uniform(1, 2)}
    if pick.random() < 0.2: # a sheet under it, lit from both sides
        scene['background'] = {'color': [0.2, 0.2, 0.2], 'ground': {'opaque': True, 'color': [pick.random() for _ in range(3)],
                                                                    'diffuse_transmission': pick.random()}}
    (folder / 's.json').write_text(json.dumps(scene), 'ascii')
    method = pick.choice(METHODS)
    return ['render', 's.json', '-m', method, *FEW.get(method, []), *SMALL, '--seed', str(pick.randint(0, 1 << 30)), '-q', '-o', 'a.pfm']


def mutated(pick, data):
    data = bytearray(data)
    for _ in range(pick.choice((1, 1, 2, 4, 16))):
        if not data:
            break
        at, choice = pick.randrange(len(data)), pick.random()
        if choice < 0.4:
            data[at] = pick.randrange(256)
        elif choice < 0.55:
            data[at] ^= 1 << pick.randrange(8)
        elif choice < 0.65:
            del data[at:at + pick.choice((1, 4, 64))]
        elif choice < 0.75:
            data[at:at] = data[at:at + pick.choice((1, 4, 64))]
        elif choice < 0.85:
            data[at:at + 4] = pick.choice((b'\xff\xff\xff\xff', b'\0\0\0\x80', b'\xff\xff\xff\x7f', b'1e99', b'-1  ', b'nan '))
        elif choice < 0.95:
            data[at:at] = pick.choice((b'9' * 30, b'-', b'"', b'[' * 40, b'\0', b'/1/1/1', b'1e-320'))
        else:
            del data[at:]
    return bytes(data)


# --- Cases -----------------------------------------------------------------------------------------------------------------------------

def mutant(pick, program, folder, stock):
    kind, seed = pick.choice(stock['files'])
    name = 'm' + (READERS[kind] or seed.suffix or '.png')
    (folder / name).write_bytes(mutated(pick, seed.read_bytes()))
    size = ['--size', '10mm'] if kind in ('obj', 'ply', 'stl') else []
    if kind == 'image':
        command = ['compare', name, name, '-q']
    elif kind in ('material', 'profile_table'):
        command = ['profile', name, '-q']
    elif kind == 'mtl':
        ball(pick, 'ball', folder / 'ball.obj')
        (folder / 'ball.obj').write_text(f'mtllib {name}\nusemtl a\n' + (folder / 'ball.obj').read_text('ascii'), 'ascii')
        command = ['check', 'ball.obj', '--size', '10mm']
    elif pick.random() < 0.5:
        command = ['check', name, *size]
    else:
        command = ['render', name, *size, '-m', pick.choice(METHODS[:6]), *SMALL, '-q', '-o', 'a.pfm']
    code = run(program, folder, [*command, '--limit', 'memory-bytes=1000000000'] if 'compare' not in command and 'profile' not in command
               else command)[0]
    if 'render' in command and code == 0:
        need_finite(folder / 'a.pfm')


def scene(pick, program, folder, stock):
    code, said = run(program, folder, random_scene(pick, folder, stock['materials']))
    if code not in (0, 3): # 3: a size or coefficient that is refused with its reason
        raise Wrong(f'a random scene ended with {code}: {said[-500:]!r}')
    if code == 0:
        need_finite(folder / 'a.pfm')


def starved(pick, program, folder, stock):
    command = random_scene(pick, folder, stock['materials']) + ['--threads', str(pick.choice((1, 2, 7)))]
    memory = pick.randint(60, 400) << 20
    try:
        code, said = run(program, folder, command, memory)
    except Wrong as fault:
        if 'ended with 127' in str(fault): # the program's own libraries could not be loaded
            return
        raise Wrong(f'{memory >> 20} MiB: {fault}') from None
    if code not in (0, 3, 5):
        raise Wrong(f'{memory >> 20} MiB: {command} ended with {code}: {said[-500:]!r}')


def killed(pick, program, folder, stock):
    ball(pick, 'ball', folder / 'ball.obj')
    command = ['render', 'ball.obj', '--size', '20mm', '--material', pick.choice(stock['materials']), '-m', 'path-trace', '--samples', '4',
               *SMALL, '-q']
    state = ['--checkpoint', 'a.ckpt', '--checkpoint-every', '10ms']
    if run(program, folder, [*command, '-o', 'whole.pfm'])[0] != 0:
        return
    for _ in range(3):
        run(program, folder, [*command, *state, '-o', 'a.pfm'], kill_after=pick.uniform(0.01, 0.5))
    code, said = run(program, folder, [*command, *state, '-o', 'a.pfm'])
    if code != 0 or (folder / 'a.pfm').read_bytes() != (folder / 'whole.pfm').read_bytes():
        raise Wrong(f'{command}: what goes on after kills ends with {code} or other bits: {said[-500:]!r}')


CASES = (mutant, mutant, mutant, mutant, scene, scene, starved, killed)


# --- The run ---------------------------------------------------------------------------------------------------------------------------

class Soak:
    def __init__(self, arguments, stock):
        self.arguments, self.stock, self.lock = arguments, stock, threading.Lock()
        self.next, self.counts, self.wrong, self.slowest = arguments.seed, {}, 0, 0.0
        self.end = time.monotonic() + (arguments.seconds or 3600 * arguments.hours)

    def take(self):
        with self.lock:
            if time.monotonic() > self.end or (self.arguments.cases and self.next >= self.arguments.seed + self.arguments.cases):
                return None
            self.next += 1
            return self.next - 1

    def one(self, seed):
        pick = random.Random(seed)
        case = pick.choice(CASES)
        begin, fault = time.monotonic(), None
        folder = pathlib.Path(tempfile.mkdtemp(prefix='pellucid-soak-'))
        try:
            case(pick, self.arguments.program, folder, self.stock)
        except Wrong as wrong:
            fault = str(wrong)
        with self.lock:
            self.counts[case.__name__] = self.counts.get(case.__name__, 0) + 1
            self.slowest = max(self.slowest, time.monotonic() - begin)
            if fault:
                self.wrong += 1
                kept = pathlib.Path(self.arguments.keep) / f'{case.__name__}-{seed}'
                shutil.copytree(folder, kept, dirs_exist_ok=True)
                (kept / 'what.txt').write_text(f'{fault}\nagain: {sys.argv[0]} PROGRAM --seed {seed} --cases 1\n', 'utf-8')
                print(f'WRONG: seed {seed}, {case.__name__}: {fault}\n  kept in {kept}', flush=True)
        shutil.rmtree(folder)

    def work(self):
        while (seed := self.take()) is not None:
            self.one(seed)

    def line(self):
        with self.lock:
            parts = ', '.join(f'{n} {name}' for name, n in sorted(self.counts.items()))
            print(f'{sum(self.counts.values())} cases ({parts}), slowest {self.slowest:.1f} s, {self.wrong} wrong; next seed {self.next}',
                  flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('program')
    parser.add_argument('--hours', type=float, default=2.0)
    parser.add_argument('--seconds', type=float, default=0.0)
    parser.add_argument('--seed', type=int, default=int(time.time()))
    parser.add_argument('--cases', type=int, default=0, help='at most so many')
    parser.add_argument('--jobs', type=int, default=os.cpu_count() or 1)
    parser.add_argument('--keep', default='soak-wrong')
    arguments = parser.parse_args()
    arguments.program = os.path.abspath(arguments.program)
    listed = json.loads(subprocess.run([arguments.program, 'materials', '--json'], check=True, capture_output=True).stdout)
    files = [(kind, path) for room in ('scene', 'image') for kind in READERS
             for path in sorted((ROOT / 'fuzz' / room / 'corpus' / kind).glob('*')) if path.is_file()]
    stock = {'materials': [m['name'] for m in listed['materials']], 'files': files}
    if not files:
        sys.exit('no seeds in fuzz/')
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    print(f'soak of {arguments.program}: first seed {arguments.seed}, {arguments.jobs} at a time', flush=True)
    soak = Soak(arguments, stock)
    threads = [threading.Thread(target=soak.work) for _ in range(arguments.jobs)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        for thread in threads:
            thread.join(60 / len(threads))
        soak.line()
    return 1 if soak.wrong else 0


sys.exit(main())
