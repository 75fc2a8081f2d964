#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_parts.py PROGRAM ROOT: parts of images and sequences, rendered by separate runs, and their merging: bit-identical to one run, or
a refusal that names the problem and leaves every file unchanged."""
import json
import os
import resource
import signal
import struct
import subprocess
import sys
import time

from cli_test import EVENTS, PROGRAM, Skip, clean_environment, main, names, need, one_object, png_pixels, run, test, text, works

TRACE = ['render', 'bunny.obj', '--unit', '1mm', '--material', 'marble', '-m', 'path-trace', '--set', EVENTS, '--set',
         'acceleration=none', '--width', '40', '--height', '30', '--msaa', '2', '--light-samples', '1',
         '--indirect-samples', '256']
FEW = [*TRACE, '--samples', '28']


def content_hash(data):
    """As src/base/hash.h has it, from 0."""
    value = 0
    for word in [len(data), *(w for w, in struct.iter_unpack('<Q', data + bytes(-len(data) % 8)))] + ([0] if len(data) % 8 == 0 else []):
        value = (value ^ word) * 0x9E3779B97F4A7C15 & 0xFFFFFFFFFFFFFFFF
        value ^= value >> 32
    return value


def part(folder, name, *more):
    before = set(names(folder))
    done = works(folder, *FEW, '--checkpoint', name, *more)
    need(set(names(folder)) - before == {name}, 'other files than the part:', names(folder))
    return done


def same(folder, a, b):
    need((folder / a).read_bytes() == (folder / b).read_bytes(), a, 'and', b, 'differ')


def same_channels(folder, a, b):
    answer = one_object(works(folder, 'compare', a, b, '--layer', 'variance', '--mask', 'none', '--json'))
    need(answer['methods'][0]['mse'] == 0.0, 'the error bars differ:', answer)


@test('an array of seven parts of samples, merged in any order by any number of threads, has the bits of one run')
def _(folder):
    works(folder, *FEW, '-o', 'whole.pfm')
    for i in range(7):
        part(folder, f'p{i}.ckpt', '--sample-range', f'{i}/7', '--threads', str(1 + i % 3))
    works(folder, 'merge', *(f'p{i}.ckpt' for i in (4, 0, 6, 2, 1, 5, 3)), '-o', 'merged.pfm')
    same(folder, 'whole.pfm', 'merged.pfm')
    works(folder, 'merge', *(f'p{i}.ckpt' for i in (0, 2, 4)), '--partial', '--checkpoint', 'some.ckpt')
    works(folder, 'merge', 'p6.ckpt', 'p5.ckpt', 'some.ckpt', 'p1.ckpt', 'p3.ckpt', '-o', 'again.pfm', '--threads', '1')
    same(folder, 'whole.pfm', 'again.pfm')
    works(folder, *FEW, '--checkpoint', 'some.ckpt', '-o', 'resumed.pfm')  # a render completes a partial merge
    same(folder, 'whole.pfm', 'resumed.pfm')


@test('parts of tiles, of tiles and samples, and A:B ranges have the bits of one run, too')
def _(folder):
    works(folder, *FEW, '-o', 'whole.pfm')
    part(folder, 'a.ckpt', '--tile-range', '0:7')
    part(folder, 'b.ckpt', '--tile-range', '7:20', '--sample-range', '0:10')
    part(folder, 'c.ckpt', '--tile-range', '7:20', '--sample-range', '10:28')
    works(folder, 'merge', 'c.ckpt', 'a.ckpt', 'b.ckpt', '-o', 'merged.pfm')
    same(folder, 'whole.pfm', 'merged.pfm')
    for i in range(3):
        part(folder, f't{i}.ckpt', '--tile-range', f'{i}/3')
    done = works(folder, 'merge', 't2.ckpt', 't0.ckpt', 't1.ckpt', '-o', 'tiles.pfm', '--json')
    need(one_object(done)['image'] == 'tiles.pfm', done.stdout)
    same(folder, 'whole.pfm', 'tiles.pfm')


@test('gaps and overlaps are told; --partial takes gaps, with larger error bars')
def _(folder):
    for i in range(4):
        part(folder, f'p{i}.ckpt', '--sample-range', f'{i}/4')
    before = {n: (folder / n).read_bytes() for n in names(folder)}
    done = run(folder, 'merge', 'p0.ckpt', 'p2.ckpt', 'p3.ckpt', '-o', 'no.pfm')
    need(done.returncode == 3 and b'samples 6:14 are missing' in done.stderr and b'--partial' in done.stderr, done.stderr)
    done = run(folder, 'merge', 'p0.ckpt', 'p1.ckpt', 'p2.ckpt', 'p3.ckpt', 'p1.ckpt', '-o', 'no.pfm')
    need(done.returncode == 3 and b'p1.ckpt: overlaps' in done.stderr and b'sample 6 of tile' in done.stderr, done.stderr)
    need({n: (folder / n).read_bytes() for n in names(folder)} == before, 'files changed')
    works(folder, 'merge', *(n for n in before if n.endswith('.ckpt')), '-o', 'whole.exr')
    done = works(folder, 'merge', 'p0.ckpt', '--partial', '-o', 'some.exr')
    need(b'a partial image' in done.stderr and b'6:28' in done.stderr, done.stderr)
    works(folder, 'merge', 'p0.ckpt', '--partial', '-o', 'some.pfm')
    works(folder, *TRACE, '--samples', '6', '-o', 'six.pfm')  # the partial image is that of its samples
    same(folder, 'some.pfm', 'six.pfm')
    works(folder, *TRACE, '--samples', '6', '-o', 'six.exr')
    same_channels(folder, 'some.exr', 'six.exr')
    part(folder, 'tiles.ckpt', '--tile-range', '0:10')
    done = works(folder, 'merge', 'tiles.ckpt', '--partial', '-o', 'tiles.pfm')
    need(b'have none and are black' in done.stderr, done.stderr)


@test('a part of another seed, scene, knob, size or version, and a damaged one, are refused by name; nothing is lost')
def _(folder):
    part(folder, 'a.ckpt', '--sample-range', '0/2')
    part(folder, 'seed.ckpt', '--sample-range', '1/2', '--seed', '5')
    part(folder, 'knob.ckpt', '--sample-range', '1/2', '--set', 'events=33')
    part(folder, 'scene.ckpt', '--sample-range', '1/2', '--material', 'skin1')
    part(folder, 'size.ckpt', '--sample-range', '1/2', '--width', '41')
    part(folder, 'b.ckpt', '--sample-range', '1/2')
    good = (folder / 'b.ckpt').read_bytes()
    old = good[:88] + b'0.0.9'.ljust(32, b'\0') + good[120:-8]
    (folder / 'version.ckpt').write_bytes(old + struct.pack('<Q', content_hash(old)))
    form = good[:8] + struct.pack('<I', 99) + good[12:-8]
    (folder / 'form.ckpt').write_bytes(form + struct.pack('<Q', content_hash(form)))
    (folder / 'cut.ckpt').write_bytes(good[:-1000])
    (folder / 'bit.ckpt').write_bytes(good[:3000] + bytes([good[3000] ^ 4]) + good[3001:])
    (folder / 'text.ckpt').write_text('{}', 'ascii')
    before = {n: (folder / n).read_bytes() for n in names(folder)}
    for name, word in (('seed', 'another seed: 5, not 0'), ('knob', 'knob events is 33'), ('scene', 'another scene'), ('size', '41 x 30'),
                       ('version', 'version 0.0.9'), ('form', 'version 99'), ('cut', 'cut off'), ('bit', 'hash'),
                       ('text', 'no checkpoint'), ('nothing', 'nothing.ckpt')):
        for order in (['a.ckpt', f'{name}.ckpt'], [f'{name}.ckpt', 'a.ckpt']):
            done = run(folder, 'merge', *order, '-o', 'no.pfm', '--json')
            error = one_object(done)['error']
            need(done.returncode == 3, order, done.returncode, done.stdout)
            if order[0] == 'a.ckpt':
                need(f'{name}.ckpt' in error['where'] and word in error['where'] + error['what'], error)
    need({n: (folder / n).read_bytes() for n in names(folder)} == before, 'files changed')
    for name, word in (('version', 'version 0.0.9'), ('cut', 'cut off')):
        done = run(folder, *FEW, '--sample-range', '1/2', '--checkpoint', f'{name}.ckpt')
        need(done.returncode == 3 and word in text(done.stderr), done.returncode, done.stderr)
    need({n: (folder / n).read_bytes() for n in names(folder)} == before, 'files changed')
    works(folder, 'merge', 'b.ckpt', 'a.ckpt', '-o', 'good.pfm')


@test('a note that names a hostile command does nothing but fail')
def _(folder):
    part(folder, 'a.ckpt', '--sample-range', '0:28')
    before = set(names(folder))
    good = (folder / 'a.ckpt').read_bytes()
    size, = struct.unpack('<I', good[44:48])
    for words in (['--help'], ['bunny.obj', '--nonsense'], [], ['/etc/passwd'], ['bunny.obj', '-o', 'evil.pfm', '--dump', 'evil'],
                  ['bunny.obj', 3], {'a': 1}, ['a', 'b', 'c']):
        note = json.dumps(words).encode('ascii')
        data = good[:44] + struct.pack('<I', len(note)) + good[48:120] + note + good[120 + size:-8]
        (folder / 'bad.ckpt').write_bytes(data + struct.pack('<Q', content_hash(data)))
        done = run(folder, 'merge', 'bad.ckpt', '-o', 'no.pfm')
        need(done.returncode in (2, 3) and done.stderr and not done.stdout, words, done.returncode, done.stderr)
    need(set(names(folder)) - before == {'bad.ckpt'}, names(folder))


@test('a full disk: the part is refused with an error, and the file that was there stays')
def _(folder):
    part(folder, 'a.ckpt', '--sample-range', '0:4')
    before = (folder / 'a.ckpt').read_bytes()

    def small():
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
    for more in (['--checkpoint', 'a.ckpt'], ['--checkpoint', 'new.ckpt']):
        done = subprocess.run([PROGRAM, *FEW, '--sample-range', '0:8', *more], cwd=folder, env=clean_environment(), capture_output=True,
                              preexec_fn=small, check=False)
        need(done.returncode != 0 and b'.ckpt' in done.stderr, done.returncode, done.stderr)
    need((folder / 'a.ckpt').read_bytes() == before and 'new.ckpt' not in names(folder), names(folder))
    if os.geteuid() != 0:
        raise Skip('a small file system needs root')
    (folder / 'disk').mkdir()
    if subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=64k', 'tmpfs', folder / 'disk'], check=False, capture_output=True).returncode:
        raise Skip('no file system may be mounted here')
    try:
        done = run(folder, *FEW, '--sample-range', '0:8', '--checkpoint', 'disk/a.ckpt')
        need(done.returncode == 3 and b'disk/a.ckpt' in done.stderr and b'o space' in done.stderr, done.returncode, done.stderr)
        need([n for n in names(folder / 'disk') if not n.endswith('.lock')] == [], names(folder / 'disk'))
    finally:
        subprocess.run(['umount', folder / 'disk'], check=False)


@test('a time limit, SIGTERM and SIGHUP end with 75, the same command goes on; Ctrl-C with 130')
def _(folder):
    done = run(folder, *TRACE, '--samples', '100000', '--time-limit', '300ms', '--sample-range', '0/2', '--checkpoint', 'a.ckpt', '--json')
    need(done.returncode == 75 and one_object(done)['resumable'] is True and one_object(done)['image'] is None, done.returncode,
         done.stdout)
    done = run(folder, *TRACE, '--samples', '100000', '--time-limit', '300ms', '-o', 'b.pfm')
    need(done.returncode == 0, 'without a checkpoint a time limit is an end as any', done.returncode)
    for number, code, threads in ((signal.SIGTERM, 75, '2'), (signal.SIGHUP, 75, '2'), (signal.SIGINT, 130, '1')):
        # A job in the background or under nohup ignores some signals, and its children inherit that.
        child = subprocess.Popen([PROGRAM, *TRACE, '--samples', '100000000', '--checkpoint', 'c.ckpt', '-o', 'c.pfm', '--progress', 'json',
                                  '--threads', threads], cwd=folder, env=clean_environment(), stderr=subprocess.PIPE,
                                 preexec_fn=lambda: signal.signal(number, signal.SIG_DFL))
        line, err = b'begin', b''
        while line and not line.startswith(b'{'):  # all pixels have samples by then
            line = child.stderr.readline()
            err += line
        child.send_signal(number)
        err += child.communicate(timeout=60)[1]
        need(child.returncode == code and (folder / 'c.ckpt').exists() and (folder / 'c.pfm').exists(), child.returncode, err)
        lines = [json.loads(line)['progress'] for line in text(err).splitlines() if line.startswith('{')]
        need(lines and all(set(p) == {'task', 'fraction', 'seconds', 'seconds_left'} for p in lines), err)
    done = works(folder, 'merge', 'c.ckpt', '--partial', '-o', 'm.pfm')  # the second sample of the multisample is empty there
    need(b'1 of 2 samples of the multisample' in done.stderr, done.stderr)
    same(folder, 'c.pfm', 'm.pfm')
    done = works(folder, *TRACE, '--samples', '4', '--checkpoint', 'c.ckpt', '-o', 'c.pfm')
    need(b'--samples' in done.stderr and b'the image has their noise' in done.stderr, done.stderr)
    works(folder, *TRACE, '--samples', '8', '--checkpoint', 'd.ckpt', '-o', 'd.pfm')
    done = works(folder, *TRACE, '--samples', '4', '--checkpoint', 'd.ckpt', '-o', 'd4.pfm')
    need(b'8 samples per pixel are in the checkpoint already, 4 were asked for: none is added' in done.stderr, done.stderr)
    same(folder, 'd.pfm', 'd4.pfm')
    need(b'already' not in works(folder, *TRACE, '--samples', '16', '--checkpoint', 'd.ckpt', '-o', 'd.pfm').stderr)
    need(not [n for n in names(folder) if n.endswith('.lock')], names(folder))
    child = subprocess.Popen([PROGRAM, *TRACE, '--width', '2000', '--height', '1500', '--samples', '100000000', '--checkpoint', 'e.ckpt',
                              '-o', 'e.pfm'], cwd=folder, env=clean_environment(), stderr=subprocess.PIPE)
    time.sleep(0.5)
    child.send_signal(signal.SIGTERM)  # before all pixels have a sample
    _, err = child.communicate(timeout=60)
    need(child.returncode == 75 and not (folder / 'e.pfm').exists() and b'the same command resumes it' in err, child.returncode, err)


@test('a checkpoint that can not be written at the end: the picture is, one error says so, and the exit code')
def _(folder):
    def small():
        resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
    for more in ([], ['-q'], ['-q', '--time-limit', '300ms', '--samples', '100000000']):
        done = subprocess.run([PROGRAM, *FEW, '--checkpoint', 'a.ckpt', '-o', 'a.png', *more], cwd=folder, env=clean_environment(),
                              capture_output=True, preexec_fn=small, check=False)
        need(done.returncode == 3 and done.stderr.count(b'error: a.ckpt: can\'t be written') == 1, more, done.returncode, done.stderr)
        need('-q' not in more or done.stderr.count(b'\n') == 1, done.stderr)
        need((folder / 'a.png').read_bytes()[:4] == b'\x89PNG' and 'a.ckpt' not in names(folder), names(folder))


@test('what a killed run left is removed after an hour, and nothing else')
def _(folder):
    dead = subprocess.Popen([sys.executable, '-c', ''])
    dead.wait()
    old, young, running = (folder / f'.pellucid-{pid:x}-{i:x}-0.tmp' for i, pid in enumerate((dead.pid, dead.pid, os.getpid())))
    other = folder / f'.pellucid-{dead.pid:x}-0-0.tmp.png'
    for path in (old, young, running, other):
        path.write_bytes(b'half')
    for path in (old, running, other):
        os.utime(path, (path.stat().st_mtime - 7200,) * 2)
    works(folder, *FEW, '-o', 'a.png')
    need(not old.exists() and young.exists() and running.exists() and other.exists(), sorted(os.listdir(folder)))


@test('two runs on one checkpoint: the second is told who has it, and changes nothing')
def _(folder):
    child = subprocess.Popen([PROGRAM, *TRACE, '--samples', '100000000', '--checkpoint', 'c.ckpt', '-o', 'c.pfm'], cwd=folder,
                             env=clean_environment(), stderr=subprocess.PIPE)
    while not (folder / 'c.ckpt.lock').exists() or not (folder / 'c.ckpt.lock').read_bytes():
        time.sleep(0.01)
    done = run(folder, *TRACE, '--samples', '4', '--checkpoint', 'c.ckpt', '-o', 'd.pfm')
    need(done.returncode == 3 and f'process {child.pid}' in text(done.stderr) and 'd.pfm' not in names(folder), done.stderr)
    child.kill()
    child.communicate()
    works(folder, *TRACE, '--samples', '4', '--checkpoint', 'c.ckpt', '-o', 'd.pfm')  # the lock of a dead process does not count
    need('c.ckpt.lock' not in names(folder), names(folder))


@test('ranges are checked: what is no range, is empty, ends beyond the whole, or needs something else')
def _(folder):
    for option, value, word in (('--sample-range', '3', 'A:B'), ('--sample-range', '3:3', 'empty'), ('--sample-range', '1:4', 'msaa'),
                                ('--sample-range', '0:1000', 'beyond'), ('--sample-range', '7/7', '0/7'), ('--sample-range', '-1:4', 'A:B'),
                                ('--sample-range', '0/1000', 'empty'), ('--tile-range', '0:1000', 'beyond'), ('--tile-range', 'x', 'A:B'),
                                ('--tile-range', '99999999999:2', 'A:B'), ('--frame-range', '0/2', '--turntable')):
        done = run(folder, *FEW, option + '=' + value, '--checkpoint', 'no.ckpt')
        need(done.returncode == 2 and option in text(done.stderr) and word in text(done.stderr), option, value, done.stderr)
    for more, word in ((['--sample-range', '0/2'], 'checkpoint'), (['--tile-range', '0/2', '--target-error', '5%', '--checkpoint', 'a'],
                                                          'error'),
                       (['--sample-range', '0/2', '--checkpoint', 'a', '-m', 'dipole'], 'dipole')):
        done = run(folder, *FEW, *more)
        need(done.returncode == 2 and word in text(done.stderr), more, done.stderr)
    done = run(folder, 'merge', 'a.ckpt')
    need(done.returncode == 2 and b'--output' in done.stderr, done.stderr)
    need(not [n for n in names(folder) if n.endswith('.ckpt')], names(folder))


@test('--frame-range: views and frames by several jobs are those of one run, with its exposure')
def _(folder):
    small = ['--width', '40', '--height', '30', '--msaa', '1', '--light-samples', '1', '--indirect-samples', '256']
    for ending in ('png', 'pfm'):
        works(folder, 'render', 'bunny.obj', '--unit', '1mm', '--turntable', '5', *small, '-o', f'all.{ending}')
        for i in range(3):
            done = works(folder, 'render', 'bunny.obj', '--unit', '1mm', '--turntable', '5', *small, '--frame-range', f'{i}/3', '-o',
                         f'part.{ending}', '--json')
            need(len(one_object(done)['images']) in (1, 2), done.stdout)
        for i in range(5):
            whole, one = ((folder / f'{name}_000{i}.{ending}').read_bytes() for name in ('all', 'part'))
            need(png_pixels(whole) == png_pixels(one) if ending == 'png' else whole == one, ending, i, 'differ')
    works(folder, 'render', 'head.gltf', '--frames', '0:1:0.5', *small, '-o', 'all.pfm')
    works(folder, 'render', 'head.gltf', '--frames', '0:1:0.5', *small, '--frame-range', '1:3', '-o', 'part.pfm')
    need('part_0000.pfm' in names(folder) and (folder / 'part_0002.pfm').read_bytes() == (folder / 'all_0002.pfm').read_bytes(), 'differ')
    small += ['-m', 'texture-space', '--set', 'size=128', '--exposure', '1']  # computes the surface layout in the first frame
    works(folder, 'render', 'head.gltf', '--frames', '0:1:0.5', *small, '-o', 'all.pfm')
    works(folder, 'render', 'head.gltf', '--frames', '0:1:0.5', *small, '--frame-range', '1:3', '-o', 'part.pfm')
    need((folder / 'part_0002.pfm').read_bytes() == (folder / 'all_0002.pfm').read_bytes(), 'of a layout differ')


@test('compare over a list of scenes: a folder each, by several jobs as by one; a line that names no scene ends it')
def _(folder):
    (folder / 'second.json').write_bytes((folder / 'scene.json').read_bytes())
    (folder / 'list.txt').write_text('scene.json\n\nsecond.json\n', 'ascii')
    small = ['--width', '32', '--height', '24', '--msaa', '1', '--light-samples', '1', '--indirect-samples', '256', '--methods',
             'none,screen-space', '--reference', 'dipole:error=1', '--set', 'gaussians=3']
    works(folder, 'compare', 'list.txt', *small, '-o', 'all')
    for i in range(2):
        works(folder, 'compare', 'list.txt', *small, '-o', 'parts', '--scene-range', f'{i}/2')
    for name in ('scene', 'second'):
        whole, one = (json.loads((folder / where / name / 'metrics.json').read_text('utf-8')) for where in ('all', 'parts'))
        need([m['mse'] for m in whole['methods']] == [m['mse'] for m in one['methods']] and len(whole['methods']) == 2, whole, one)
        need((folder / 'all' / name / 'report.html').exists(), names(folder / 'all' / name))
    (folder / 'bad.txt').write_text('nothing.json\n', 'ascii')
    (folder / 'empty.txt').write_text('\n', 'ascii')
    for arguments, code, word in ((['bad.txt', '-o', 'no'], 3, 'nothing.json'), (['empty.txt', '-o', 'no'], 3, 'no scene'),
                                  (['list.txt'], 2, '--output'), (['list.txt', '-o', 'no', '--json'], 2, '--json'),
                                  (['scene.json', '--scene-range', '0/2'], 2, '--scene-range')):
        done = run(folder, 'compare', *arguments, *small)
        need(done.returncode == code and word in text(done.stderr + done.stdout), arguments, done.returncode, done.stderr)


sys.exit(main())
