#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_usage.py PROGRAM ROOT: command-line arguments and responses: exit codes, messages, JSON, help, man page, guide."""
import json
import os
import fcntl
import pty
import re
import shlex
import shutil
import struct
import subprocess
import sys
import termios

from cli_test import (PROGRAM, ROOT, SANITIZED, SMALL, Skip, clean_environment, finite, main, names, need, one_object, png_pixels,
                      release_only, run, sphere, test, text, works, write_obj, write_scene)
from viewer_test import Viewer

LONG = 'x' * 100000
COMMANDS = ['render', 'merge', 'check', 'bake-layers', 'methods', 'materials', 'profile', 'bench', 'compare', 'info']
if subprocess.run([PROGRAM, 'view', '--help'], capture_output=True, check=False).returncode == 0:
    COMMANDS.append('view')
MESH = ['render', 'bunny.obj', '--size', '70mm', *SMALL, '-o', 'out.png']

SIDES = 'front, right, back, left, top, 34, or AZIMUTH,ELEVATION'

# Title: arguments, exit code, and the expected code, position, text and hint of the error.
FAULTS = {
    'a command that is not there': (['rendr'], 2, 'rendr', 'render'),
    'help of a command that is not there': (['help', 'chek'], 2, 'chek', 'check'),
    'an option that is not there': ([*MESH, '--materal', 'x'], 2, '--materal', '--material'),
    'an option with one dash for two': ([*MESH, '-size', '70mm'], 2, '', '--size'),
    'an option of another command': (['methods', '--size', '70mm'], 2, '--size', ''),
    'an option without its value': (['render', 'bunny.obj', '--size'], 2, 'value', '--help'),
    'no input': (['render'], 2, 'INPUT', ''),
    'two inputs': (['render', 'a.obj', 'b.obj'], 2, 'b.obj', ''),
    'an empty input': (['render', ''], 2, 'empty', ''),
    'a mesh without a unit': (['render', 'bunny.obj', '-o', 'out.png'], 2, 'have no unit', '--size 70mm'),
    'checking a mesh without a unit': (['check', 'bunny.obj'], 2, 'have no unit', '--size 70mm'),
    'a size without a unit': (['render', 'bunny.obj', '--size', '70'], 2, '"70" has no unit', '70mm'),
    'a size that is no number': (['render', 'bunny.obj', '--size', 'nanmm'], 2, 'nanmm', ''),
    'a size of nothing': (['render', 'bunny.obj', '--size', '0mm'], 2, '0mm', ''),
    'an infinite size': (['render', 'bunny.obj', '--size', '1e999mm'], 2, '1e999mm', ''),
    'an absurd size': (['render', 'bunny.obj', '--size', '1e300mm'], 2, '--size', ''),
    'an empty size': (['render', 'bunny.obj', '--size', ''], 2, '--size', ''),
    'a size and a unit': ([*MESH, '--unit', '1mm'], 2, '--unit', ''),
    'a material that is not there': ([*MESH, '--material', 'wholemilc'], 2, 'wholemilc', 'wholemilk'),
    'an empty material': ([*MESH, '--material', ''], 2, '--material', ''),
    'a material file that is not there': ([*MESH, '--material', 'no.json'], 3, 'no.json', ''),
    'a method that is not there': ([*MESH, '-m', 'screenspace'], 2, 'screenspace', 'screen-space'),
    'an empty method': ([*MESH, '-m', ''], 2, '--method', 'screen-space'),
    'a knob that is not there': ([*MESH, '--set', 'lodd=1'], 2, 'lodd', 'lod'),
    'a knob that is not there, said before the scene is read':
        (['render', 'no.obj', '-m', 'screen-space', '--set', 'lodd=1'], 2, 'lodd', 'lod'),
    'a knob without a method, said before the mesh is read': (['render', 'no.obj', '--set', 'lodd=1'], 2, 'lodd', 'lod'),
    'a knob of no method, said before the scene is read': (['render', 'no.json', '--set', 'qwertz=1'], 2, 'qwertz', 'methods NAME'),
    'a knob of another method': ([*MESH, '--set', 'most=8'], 2, 'screen-space has no knob "most"', 'dipole'),
    'a knob of another method of a scene file': (['render', 'other.json', '-o', 'out.png'], 3, 'other.json', 'dipole'),
    'a knob that is an option': ([*MESH, '--set', 'methd=dipole'], 2, 'methd', '"--method"'),
    'a knob that is an option of render': ([*MESH, '--set', 'bounces=4'], 2, 'screen-space has no knob "bounces"',
                                           'did you mean the option "--bounces"?'),
    'a knob of no method that is an option': ([*MESH, '-m', 'none', '--set', 'bounces=4'], 2, 'none has no knobs',
                                              'did you mean the option "--bounces"?'),
    'a knob of compare that is an option': (['compare', 'no.obj', '--set', 'bounces=4'], 2, 'bounces',
                                            'did you mean the option "--bounces"?'),
    'a knob of a scene file that belongs beside the knobs': (['render', 'beside.json', '-o', 'out.png'], 3,
                                                            'beside.json:/render/knobs/bounces', 'did you mean "bounces" beside "knobs"?'),
    'a knob of a scene file beside the knobs': (['render', 'inside.json', '-o', 'out.png'], 3, '"render" has no key "gaussians"',
                                                'write it into "knobs"'),
    'a key of a scene file near one': (['render', 'near.json', '-o', 'out.png'], 3, '"render" has no key "widht"',
                                       'did you mean "width"? `pellucid render --help`'),
    'a key of a scene file far from all': (['render', 'far.json', '-o', 'out.png'], 3, '"render" has no key "foo"',
                                           'the keys are method, knobs, samples, '),
    'a setting that is an option': ([*MESH, '--set', 'width=640'], 2, 'width', '"--width"'),
    'a knob that is not a number': ([*MESH, '--set', 'lod=nan'], 2, 'lod = nan', ''),
    'a knob out of range': ([*MESH, '--set', 'gaussians=11'], 2, '[1, 10]', ''),
    'a knob without a name': ([*MESH, '--set', '='], 2, 'NAME=VALUE', ''),
    'a knob without a value': ([*MESH, '--set', 'lod'], 2, 'NAME=VALUE', ''),
    'a knob with an empty value': ([*MESH, '--set', 'lod='], 2, 'lod', ''),
    'a knob for no method': ([*MESH, '-m', 'none', '--set', 'lod=1'], 2, 'none', ''),
    'a width out of range': ([*MESH, '--width', '1e9'], 2, '[1, 16384] px', ''),
    'a width of 0': ([*MESH, '--width', '0'], 2, '[1, 16384] px', ''),
    'a width that is no whole number': ([*MESH, '--width', '1.5'], 2, '1.5', ''),
    'too many samples': ([*MESH, '--msaa', '65'], 2, '[1, 64]', ''),
    'a negative seed': ([*MESH, '--seed', '-1'], 2, 'seed = -1', ''),
    'a tone curve that is not there': ([*MESH, '--tonemap', 'reinhart'], 2, 'reinhart', 'reinhard'),
    'too many threads': ([*MESH, '--threads', '99999999999999999999'], 2, '[0, 256]', ''),
    'threads that are no number': ([*MESH, '--threads', 'many'], 2, 'many', ''),
    'a negative turntable': ([*MESH, '--turntable', '-1'], 2, '-1', ''),
    'a time that is no number': ([*MESH, '--time', 'soon'], 2, '"soon" is not a number of seconds', ''),
    'a time that is not a number': ([*MESH, '--time', 'nan'], 2, '--time', ''),
    'a camera that is not there': ([*MESH, '--camera', 'front'], 2, 'front', ''),
    'an axis that is not there': ([*MESH, '--up', 'w'], 2, '--up', ''),
    'normals that are not there': ([*MESH, '--normals', 'smoth'], 2, 'smoth', 'smooth'),
    'a side that is not there': ([*MESH, '--from', 'frond'], 2, 'frond', 'front'),
    'a side that is far from every name': ([*MESH, '--from', 'qwertz'], 2, 'qwertz', SIDES),
    'a side that is near a name, and the others': ([*MESH, '--from', 'frond'], 2, '"frond"', 'top, 34, or AZIMUTH,ELEVATION'),
    'a side that is no angle': ([*MESH, '--from', '30,x'], 2, '--from', SIDES + ' in degrees: 35,15'),
    'a side above the zenith': ([*MESH, '--from', '30,91'], 2, '[-90, 90]', ''),
    'a side and a camera': ([*MESH, '--from', 'left', '--camera', 'front'], 2, '--from', 'one of them'),
    'a studio that is not there': ([*MESH, '--studio', 'sofd'], 2, 'sofd', 'soft'),
    'a background that is not there': ([*MESH, '--background', 'whit'], 2, 'whit', 'white'),
    'a background that is no colour': ([*MESH, '--background', '#12345g'], 2, '#12345g',
                                     '#RRGGBB, in hexadecimal digits: #f4f1ec'),
    'an environment behind a scene without one': ([*MESH, '--background', 'environment'], 2, '--background', '--environment FILE'),
    'an environment that is not there': ([*MESH, '--environment', 'no.hdr'], 3, 'no.hdr', ''),
    'an environment and a studio': ([*MESH, '--environment', 'no.hdr', '--studio', 'rim'], 2, '--environment', 'one of them'),
    'a turn of no environment': ([*MESH, '--environment-rotate', '90'], 2, '--environment-rotate', ''),
    'a turn that is no number': ([*MESH, '--environment', 'no.hdr', '--environment-rotate', 'left'], 2, '"left"', ''),
    'an environment without light': ([*MESH, '--environment', 'no.hdr', '--environment-scale', '0'], 2, 'above 0', ''),
    'an environment of less than no light': ([*MESH, '--environment', 'no.hdr', '--environment-scale', '-1'], 2, 'is -1', ''),
    'a log level that is not there': ([*MESH, '--log-level', 'loud'], 2, 'loud', ''),
    'samples of a pixel': ([*MESH, '-m', 'hierarchical', '--samples', '64'], 2, 'has no number of samples', 'path-trace'),
    'a time limit of a method that has none': ([*MESH, '-m', 'single-scatter', '--time-limit', '5s'], 2, 'has no time limit',
                                               'a larger --target-error or fewer --samples shortens single-scatter'),
    'a letter in place of a value': ([*MESH, '--tonemap', '-o', 'x.png'], 2, '"-o" follows', ''),
    'an option in place of a value': ([*MESH, '--normals', '--width', '64'], 2, '"--width" follows', ''),
    'a limit that is not there': ([*MESH, '--limit', 'file_bytes=1'], 2, 'there is no limit "file_bytes"',
                                  'did you mean "file-bytes"? The limits are file-bytes, memory-bytes, image-pixels, '),
    'a limit far from every name': ([*MESH, '--limit', 'foo=1'], 2, 'there is no limit "foo"', 'The limits are file-bytes, memory-bytes, '),
    'a limit out of range': ([*MESH, '--limit', 'depth=0'], 2, 'depth = 0', ''),
    'an ending that is not written': (['render', 'bunny.obj', '--size', '70mm', '-o', 'a.jpg'], 2, 'a.jpg', 'format'),
    'a format that is not written': ([*MESH, '--format', 'pngg'], 2, 'pngg', 'png'),
    'a mesh from standard input': (['render', '-', '--size', '70mm', '-o', 'out.png'], 2, 'standard input', 'file'),
    'the input as output': ([*MESH, '--format', 'png', '-o', 'bunny.obj'], 2, 'is the input', ''),
    'an image as the scene': (['render', 'shot.png'], 2, '"shot.png" is an image; INPUT must be a mesh', 'pellucid compare A B'),
    'stdout for a turntable': ([*MESH, '-o', '-', '--format', 'png', '--turntable', '2'], 2, '- writes one image', ''),
    'an output name that is too long': ([*MESH, '-o', LONG + '.png'], 2, 'too long', ''),
    'an engine that is unknown': ([*MESH, '--engine', 'vulcan'], 2, 'vulcan', 'vulkan'),
    'a Vulkan device for another engine': ([*MESH, '--device', '0'], 2, '--device', ''),
    'a material to list that is not there': (['materials', 'marbel'], 2, 'marbel', 'marble'),
    'a method to list that is not there': (['methods', 'screen_space'], 2, 'screen_space', 'screen-space'),
    'a bench that is not there': (['bench', 'screenspace'], 2, 'screenspace', 'screen-space'),
    'a bench that moved to a program of its own': (['bench', 'deon-1'], 2, 'build/bench/pellucid-bench deon-1', ''),
    'a long text for everything': ([*MESH, '--material', LONG, '--set', LONG + '=1'], 2, 'xxx', ''),
    'a long command': ([LONG], 2, 'xxx', ''),
    'a checkpoint of a method that keeps none, said before the mesh is read':
        (['render', 'no.obj', '--checkpoint', 'a.ckpt'], 2, 'screen-space keeps no checkpoint', 'path-trace'),
    'a checkpoint of the method that a scene file names, said before its mesh is read':
        (['render', 'nomesh.json', '--checkpoint', 'a.ckpt'], 2, 'texture-space keeps no checkpoint', 'path-trace'),
    'a part of a method that keeps no checkpoint, said before the mesh is read':
        (['render', 'no.obj', '--sample-range', '0:4'], 2, '--sample-range', '-m path-trace'),
    'a part without a checkpoint, said before the mesh is read':
        (['render', 'no.obj', '-m', 'path-trace', '--tile-range', '0:4'], 2, '--tile-range', '--checkpoint part.ckpt'),
    'a part that is no range, said before the mesh is read':
        (['render', 'no.obj', '-m', 'path-trace', '--checkpoint', 'a.ckpt', '--sample-range', '9'], 2, '"9", must be A:B', ''),
    'a part of an error, said before the mesh is read':
        (['render', 'no.obj', '-m', 'path-trace', '--checkpoint', 'a.ckpt', '--tile-range', '0/2', '--target-error', '5%'], 2,
         'does not go with --target-error', ''),
    'a checkpoint of many images, said before the mesh is read':
        (['render', 'no.obj', '-m', 'path-trace', '--checkpoint', 'a.ckpt', '--turntable', '3'], 2, '--turntable', ''),
    'an interval without a checkpoint, said before the mesh is read':
        (['render', 'no.obj', '--checkpoint-every', '9s'], 2, 'needs --checkpoint FILE', ''),
    'intermediate images of a turntable, said before the mesh is read':
        (['render', 'no.obj', '--dump', 'out', '--turntable', '3'], 2, 'does not go with --turntable', ''),
    'a material that is not there, said before the mesh is read': (['render', 'half.obj', '--size', '1mm', '--material', 'wholemilc'], 2,
                                                                  'wholemilc', 'wholemilk'),
    'an environment that is not there, said before the mesh is read':
        (['render', 'half.obj', '--size', '1mm', '--environment', 'no.hdr'], 3, 'no.hdr', ''),
    'a file that is not there': (['render', 'no.obj', '--size', '70mm', '-o', 'out.png'], 3, 'no.obj', ''),
    'a folder for a file': (['render', '.', '--size', '70mm', '-o', 'out.png'], 3, 'folder', ''),
    'a file of an unknown kind': (['check', 'kind.off', '--size', '70mm'], 3, 'OFF', ''),
    'a damaged glTF': (['render', 'bad.gltf', '-o', 'out.png'], 3, 'bad.gltf', ''),
    'a damaged OBJ': (['render', 'bad.obj', '--size', '70mm', '-o', 'out.png'], 3, 'bad.obj', ''),
    'a scene file with an unknown key': (['check', 'key.json'], 3, 'key.json', 'mesh'),
    'a scene file with a size that is a number': (['check', 'number.json'], 3, 'number.json:/size', '"90mm"'),
    'a scene file with a size of less than nothing': (['check', 'negative.json'], 3, 'a number without a unit', '"70mm"'),
    'a scene file with a mesh elsewhere': (['check', 'absolute.json'], 3, 'absolute path', '--allow-outside'),
    'a scene file with an unknown method': (['render', 'method.json', '-o', 'out.png'], 3, 'method.json', 'screen-space'),
    'a scene file with a width out of range': (['render', 'width.json', '-o', 'out.png'], 3, 'width.json', ''),
    'a scene file with an unknown knob': (['render', 'knob.json', '-o', 'out.png'], 3, 'knob.json', 'lod'),
    'a scene file with knobs of no method': (['render', 'none.json', '-o', 'out.png'], 3, 'none.json', ''),
    'a file over the limit': ([*MESH, '--limit', 'file-bytes=100'], 3, 'bunny.obj', '--limit file-bytes=N'),
    'an output in no folder': ([*MESH, '-o', 'no/out.png'], 3, 'no/out.png', ''),
    'an output that is a folder': ([*MESH, '--format', 'png', '-o', '.'], 3, 'folder', ''),
    'a Vulkan device that is not there': ([*MESH, '--engine', 'vulkan', '--device', 'no such'], 4, 'no Vulkan device', ''),
    'a Vulkan device of info that is not there': (['info', '--engine', 'vulkan', '--device', '99'], 4, 'no Vulkan device', ''),
    'a method on an engine that it has not': ([*MESH, '--engine', 'vulkan', '-m', 'layered'], 4, 'vulkan', ''),
    'triangles over the limit': (['check', 'bunny.obj', '--size', '70mm', '--limit', 'triangles=3'], 3, 'triangles', '--limit triangles=N'),
    'an image over the limit': ([*MESH, '--limit', 'image-pixels=99'], 3, 'at most 99 pixels', '--limit image-pixels=N'),
    'too little memory': ([*MESH, '--limit', 'memory-bytes=1048576', '--width', '640', '--height', '360'], 5, 'memory',
                          '--limit memory-bytes=N'),
    'too little memory for the picture': ([*MESH, '--limit', 'memory-bytes=100000000', '--width', '16384', '--height', '16384'], 5,
                                          'memory', '--limit memory-bytes=N'),
}
CODES = {2: 'invalid value', 4: 'engine or device not available', 5: 'out of memory'}


def break_files(folder):
    (folder / 'kind.off').write_bytes(b'OFF\n')
    (folder / 'bad.gltf').write_bytes(b'{"asset": {"version": "2.0"}, "nodes": 7}')
    (folder / 'bad.obj').write_bytes(b'v 1 2 oops\nf 1 2 3\n')
    (folder / 'half.obj').write_bytes(b'v 1 2 oops\n')
    (folder / 'nomesh.json').write_text('{"pellucid": 1, "mesh": "no.obj", "size": "1mm", "render": {"method": "texture-space"}}', 'ascii')
    (folder / 'key.json').write_text('{"pellucid": 1, "mesh": "bunny.obj", "unit": "1mm", "mehs": 1}', 'ascii')
    for name, scene in (('number', {'mesh': 'bunny.obj', 'size': 90}), ('negative', {'mesh': 'bunny.obj', 'size': -90}),
                        ('absolute', {'mesh': '/bunny.obj', 'size': '90mm'})):
        (folder / f'{name}.json').write_text(json.dumps({'pellucid': 1, **scene}), 'ascii')
    write_scene(folder / 'method.json', method='screenspace')
    write_scene(folder / 'width.json', width=0.5)
    write_scene(folder / 'knob.json', knobs={'lodd': 1})
    write_scene(folder / 'other.json', knobs={'most': 1})
    write_scene(folder / 'none.json', method='none', knobs={'lod': 1})
    write_scene(folder / 'beside.json', knobs={'bounces': 4})
    write_scene(folder / 'inside.json', gaussians=4)
    write_scene(folder / 'near.json', widht=4)
    write_scene(folder / 'far.json', foo=4)


def one_form(said):
    """A line "error: PLACE: TEXT", where there is a position, and at most one more with a hint, indented; notes may precede it."""
    lines = said.splitlines()
    at = [i for i, line in enumerate(lines) if line.startswith('error: ')]
    return len(at) == 1 and re.match(r'error: [^ ]', lines[at[0]]) and [line[:2] for line in lines[at[0] + 1:]] in ([], ['  '])


def fault_test(title, arguments, code, what, hint):
    @test(f'{title}: exit {code}, in words and in JSON')
    def check(folder):
        break_files(folder)
        before = names(folder)
        at = len(arguments) if arguments[0] == 'help' else 1
        plain, jason = run(folder, *arguments), run(folder, *arguments[:at], '--json', *arguments[at:])
        need(plain.returncode == code, 'exit', plain.returncode, plain.stderr)
        said = text(plain.stderr)
        need(said.count('error: ') == 1 and one_form(said), said)
        need(what in said and hint in said and not plain.stdout, 'said', said[:1000], plain.stdout[:1000])
        need(jason.returncode == code, 'with --json exit', jason.returncode)
        error = one_object(jason)['error']
        need(sorted(error) == ['code', 'hint', 'what', 'where'] and all(isinstance(v, str) for v in error.values()), error)
        need(what in error['where'] + ' ' + error['what'] and hint in error['hint'], error)
        need(b'error: ' not in jason.stderr, jason.stderr)
        need(error['code'] == CODES.get(code, error['code']) and error['code'] != 'ok', error)
        need(len(text(plain.stderr)) < 20000 and names(folder) == before, 'left', set(names(folder)) - set(before))


for number, (case, (given, exit_code, about, advice)) in enumerate(FAULTS.items()):
    if not SANITIZED or number % 3 == 0: # reading and reporting is the same code
        fault_test(case, given, exit_code, about, advice)


@test('an option of on|off that stands alone is on, before another option and at the end')
def _(folder):
    works(folder, *MESH, '--dof', 'off', '-o', 'off.png', '--curvature', 'off')
    works(folder, *MESH, '--dof', 'on', '-o', 'on.png', '--curvature', 'on')
    works(folder, *MESH, '--dof', '-o', 'alone.png', '--curvature')
    off, on, alone = ((folder / f'{name}.png').read_bytes() for name in ('off', 'on', 'alone'))
    need(png_pixels(on) == png_pixels(alone) != png_pixels(off), 'pictures')


@test('--max-error is refused before the mesh is read: a wrong number, another method, an engine without path-trace')
def _(folder):
    for given, code, told in ((['5'], 2, '"5" is no percentage'), (['5%', '-m', 'layered'], 2, 'it does not go with --method layered'),
                              (['5%', '--engine', 'vulkan'], 4, 'path-trace, which runs only on the engine cpu')):
        done = run(folder, 'render', 'no.obj', '--max-error', *given)
        need(done.returncode == code and told in text(done.stderr) and 'no.obj' not in text(done.stderr), given, done)


@test('a build without the viewer says so, and how to get it')
def _(folder):
    if b'  view ' in works(folder, '--help').stdout:
        raise Skip('this build has the viewer')
    for words in (['view'], ['view', 'ball.obj'], ['help', 'view']):
        done = run(folder, *words)
        need(done.returncode == 2 and b'no viewer' in done.stderr and b'libwebsockets-dev' in done.stderr, words, done)


@test('no command at all: the usage on stderr, exit 2')
def _(folder):
    done = run(folder)
    need(done.returncode == 2 and not done.stdout and b'usage: pellucid' in done.stderr, done)


@test('bytes that are no UTF-8 or steer a terminal are shown harmless')
def _(folder):
    for argument in (b'a\xff\x1b[31m\xc3.obj', b'--\xfe\x1b]0;x\x07', b'-\xc3'):
        for more in ([], ['--json']):
            done = run(folder, b'render', argument, '--size', '1mm', '-o', 'out.png', *more)
            need(done.returncode in (2, 3), done)
            need(b'\x1b' not in done.stdout + done.stderr and b'\xff' not in done.stdout + done.stderr, done)
            (done.stdout + done.stderr).decode('utf-8')
            if more:
                one_object(done)
    bad = os.path.join(os.fsencode(folder), b'n\xff\x1b.obj')
    os.rename(folder / 'bunny.obj', bad)
    for more in ([], ['--json']):
        done = works(folder, b'check', bad, '--size', '70mm', *more)
        need(b'\x1b' not in done.stdout + done.stderr, done)
        works(folder, b'render', bad, '--size', '70mm', *SMALL, *more)


@test('check finds methods and knobs that are not there, as render does')
def _(folder):
    for entry, word in (({'method': 'convolutoin'}, 'convolution'), ({'method': 'convolution', 'knobs': {'plains': 3}}, 'planes'),
                        ({'method': 'layered', 'knobs': {'samples': -1}}, 'samples'), ({'tonemap': 'rienhard'}, 'reinhard')):
        (folder / 'wrong.json').write_text(json.dumps({'pellucid': 1, 'mesh': 'bunny.obj', 'size': '70mm', 'render': entry}))
        for command in ('check', 'render'):
            done = run(folder, command, 'wrong.json')
            need(done.returncode == 3 and word in text(done.stderr) and not (folder / 'wrong.png').exists(), command, entry, done)


@test('--set overrides an option of the scene file that stands for the same knob')
def _(folder):
    scene = {'pellucid': 1, 'mesh': 'bunny.obj', 'size': '70mm', 'render': {'method': 'path-trace', 'samples': 3}}
    (folder / 'traced.json').write_text(json.dumps(scene))
    for name, *more in (('set.pfm', '--set', 'samples=1'), ('option.pfm', '--samples', '1'), ('file.pfm',)):
        works(folder, 'render', 'traced.json', *SMALL, *more, '-o', name)
    need((folder / 'set.pfm').read_bytes() == (folder / 'option.pfm').read_bytes() != (folder / 'file.pfm').read_bytes())


@test('check reports the size once')
def _(folder):
    done = works(folder, 'check', 'bunny.obj', '--size', '70mm', '--material', 'marble')
    said = text(done.stdout + done.stderr)
    need(said.count('70 x 70 x 70 mm') == 1 and not done.stderr, done.stdout, done.stderr)


@test('one is one: a scene of one triangle, one part and one problem')
def _(folder):
    (folder / 'one.obj').write_text('v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n', 'ascii')
    (folder / 'fin.obj').write_text('v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 1 1 1\nf 1 2 3\nf 2 1 4\nf 1 2 5\nl 1 2\n', 'ascii')
    for name in ('one.obj', 'fin.obj'):
        for arguments in (['check', name, '--size', '70mm', '--material', 'marble'],
                          ['render', name, '--size', '70mm', *SMALL, '--threads', '1', '-o', 'one.png']):
            done = works(folder, *arguments)
            said = text(done.stdout + done.stderr)
            need(not re.search(r'(?<![\d.])1 (?!has|is)\w+s\b', said), said)
            need(not re.search(r'(?<![\d.])1 \w+ (are|have)\b', said), said)
    said = text(works(folder, 'check', 'fin.obj', '--size', '70mm', '--material', 'marble').stdout)
    need('1 edge has more than two triangles' in ' '.join(said.split()), said)


@test('check says where the things are, as its JSON does')
def _(folder):
    (low, high) = one_object(works(folder, 'check', 'bunny.obj', '--size', '70mm', '--json'))['bounds_mm']
    said = text(works(folder, 'check', 'bunny.obj', '--size', '70mm').stdout).splitlines()[1]
    numbers = [float(n) for n in re.findall(r'[-+0-9.e]+(?=[,)])', said)]
    need(len(numbers) == 6 and all(abs(a - b) < 1e-3 * max(1, abs(b)) for a, b in zip(numbers, low + high)), said, low, high)


@test('names in a file that steer a terminal are shown harmless')
def _(folder):
    mesh = (folder / 'bunny.obj').read_bytes()
    (folder / 'bunny.obj').write_bytes(mesh.replace(b'\nf ', b'\no \x1b[31mred\xff\nusemtl \x1b[32mgreen\nf ', 1))
    for more in ([], ['--json']):
        done = works(folder, 'check', 'bunny.obj', '--size', '70mm', *more)
        need(b'\x1b' not in done.stdout + done.stderr and b'\xff' not in done.stdout + done.stderr, done)
    one_object(done)


# --- JSON ---------------------------------------------------------------------------------------------------------------------------

def keys(value, wanted):
    missing = set(wanted.split()) - set(value)
    need(not missing, 'without', missing, value)


@test('render --json: the keys of the guide, numbers that fit, nothing on stderr')
def _(folder):
    done = works(folder, *MESH, '--json', '--stats')
    answer = one_object(done)
    keys(answer, 'image method engine width height seconds load_seconds stages warnings')
    need(answer['image'] == 'out.png' and answer['method'] == 'screen-space' and answer['engine'] == 'cpu', answer)
    need((answer['width'], answer['height']) == (48, 27) and answer['seconds'] > 0 and answer['load_seconds'] > 0, answer)
    need(answer['warnings'] == [] and not done.stderr, done.stderr)
    for stage in answer['stages']:
        keys(stage, 'name ms bytes copy_ms pixels rays')
    need({'surface', 'irradiance', 'composite', 'post'} <= {s['name'] for s in answer['stages']}, answer['stages'])
    need(sum(s['ms'] for s in answer['stages']) <= 1000 * answer['seconds'] + 1, 'stages take longer than the frame')


@test('render --json --quiet still tells the warnings, and plain render prints them')
def _(folder):
    vertices, faces = sphere()
    write_obj(folder / 'bunny.obj', vertices, faces[:-20])
    answer = one_object(works(folder, *MESH, '--json', '--quiet', '--log-level', 'error'))
    need(any('open' in w for w in answer['warnings']), answer['warnings'])
    need(b'warning: ' in works(folder, *MESH).stderr)
    need(works(folder, *MESH, '--quiet').stderr == b'' and works(folder, *MESH, '--log-level', 'error').stderr.count(b'warning') == 0)


@test('methods --json and methods NAME --json: every knob with its row')
def _(folder):
    every, one = (one_object(works(folder, 'methods', *more, '--json'))['methods'] for more in ([], ['screen-space']))
    need(one == [m for m in every if m['name'] == 'screen-space'] and len(one) == 1, one)
    column = [line.split()[3] for line in text(works(folder, 'methods').stdout).splitlines()]
    need(column == [m['runs_on'] for m in every] + ['-'], column)
    need(next(m for m in every if m['name'] == 'convolution')['ignores'] == ["layers' depth maps"], every)
    for method in every:
        keys(method, 'name title kind engines runs_on ignores citation knobs')
        need((method['runs_on'] == 'planes') == (method['name'] in ('screen-space', 'image-space')), method)
        need(method.get('planes_with') == ('surfaces=1' if method['name'] == 'convolution' else None), method)
        need(method['kind'] in ('method', 'reference') and 'cpu' in method['engines'] and method['knobs'][0]['name'] == 'as', method)
        shown = text(works(folder, 'methods', method['name']).stdout)
        need('Runs on: ' + {'planes': 'planes', 'scene': 'a whole scene'}[method['runs_on']] in shown, shown)
        need(', '.join(method['ignores']) in ' '.join(shown.split()), shown)
        for knob in method['knobs']:
            keys(knob, 'name unit type default min max help')
            if knob['type'] in ('int', 'float'):
                need(knob['min'] <= knob['default'] <= knob['max'], knob)
            if knob['type'] == 'int':
                need(all(isinstance(knob[k], int) for k in ('min', 'max', 'default')), knob)
            if knob['type'] == 'enum':
                need(knob['default'] in knob['choices'], knob)


@test('materials --json and materials NAME --json: coefficients, lengths, sources')
def _(folder):
    every, one = (one_object(works(folder, 'materials', *more, '--json'))['materials'] for more in ([], ['wholemilk']))
    need([m['name'] for m in one] == ['wholemilk'] and one[0] in every and len(every) >= 12, one)
    need(one[0]['sigma_a'] == [0.0011, 0.0024, 0.014] and one[0]['sigma_s_reduced'] == [2.55, 3.21, 3.77] and one[0]['eta'] == 1.3, one)
    need(abs(one[0]['mean_free_path'][0] - 1 / (0.0011 + 2.55)) < 1e-8, one)
    need(abs(one[0]['diffuse_mean_free_path'][2] - (3 * 0.014 * (0.014 + 3.77)) ** -0.5) < 1e-7, one)
    for material in every:
        keys(material, 'name sigma_a sigma_s_reduced g eta source')
        need(material['source'] and (material['kind'] == 'medium') == ('mean_free_path' in material), material)


@test('materials NAME prints both lengths and the source; lists fit 100 columns')
def _(folder):
    shown = text(works(folder, 'materials', 'wholemilk').stdout)
    for part in ('mean free path', 'diffuse mean free path', '0.392', '6.575', 'Source: ', 'Jensen'):
        need(part in shown, part, shown)
    lists = [['materials'], ['materials', 'skin'], ['methods'], ['methods', 'screen-space'], ['methods', 'none'], ['info'], ['--help']]
    for arguments in [['materials', 'wholemilk'], *lists, *([c, '--help'] for c in COMMANDS)]:
        for line in text(works(folder, *arguments).stdout).splitlines():
            need(len(line) <= 100, f'{arguments}: {len(line)} columns:', line)


@test('info --json: engine, limits, formats, build')
def _(folder):
    answer = one_object(works(folder, 'info', '--threads', '2', '--json'))
    keys(answer, 'version build engines devices limits image_formats')
    cpu = answer['engines'][0]
    need(cpu['name'] == 'cpu' and cpu['threads'] == 2 and cpu['simd'] in cpu['simd_levels'], cpu)
    need(answer['limits']['file-bytes'] == 2 ** 31 and answer['image_formats']['write'] == ['png', 'exr', 'hdr', 'pfm'], answer)
    for device in answer['devices']:
        keys(device, 'name kind vulkan memory missing preferred why')
        need(bool(device['why']) == device['preferred'] and not (device['preferred'] and device['missing']), device)
    need(sum(device['preferred'] for device in answer['devices']) <= 1, answer['devices'])
    lowered = one_object(works(folder, 'info', '--json', env=clean_environment(PELL_SIMD='base')))
    need(lowered['engines'][0]['simd'] == 'base', lowered)


@test('PELL_SIMD that names no level is warned of once, and the levels are named')
def _(folder):
    env = clean_environment(PELL_SIMD='avx9')
    usual = one_object(works(folder, 'info', '--json'))['engines'][0]['simd']
    for arguments in (['info', '--json'], MESH, ['profile', 'marble'], ['compare', 'a.png', 'a.png']):
        works(folder, 'render', 'bunny.obj', '--size', '70mm', *SMALL, '-o', 'a.png')
        done = works(folder, *arguments, env=env)
        need(text(done.stderr).count('warning: PELL_SIMD: "avx9" is ignored, must be base, v2, v3 or v4') == 1, arguments, done.stderr)
        need(b'PELL_SIMD' not in works(folder, *arguments, env=clean_environment(PELL_SIMD='')).stderr, arguments)
    need(one_object(works(folder, 'info', '--json', env=env))['engines'][0]['simd'] == usual)


@test('check --json and check: a closed ball')
def _(folder):
    answer = one_object(works(folder, 'check', 'bunny.obj', '--size', '70mm', '--material', 'wholemilk', '--json'))
    keys(answer, 'meshes triangles bounds_mm materials problems')
    need(answer['meshes'] == 1 and answer['triangles'] == len(sphere()[1]), answer)
    extent = [b - a for a, b in zip(*answer['bounds_mm'])]
    need(abs(max(extent) - 70) < 1e-3 and abs(answer['mm_per_unit'] - 1.75) < 1e-6, extent)
    ball = answer['objects'][0]
    need(ball['closed'] and ball['outward'] and ball['components'] == 1 and ball['boundary_edges'] == 0, ball)
    need(0.8 < ball['volume_mm3'] / (3.14159 / 6 * 70 ** 3) < 1, ball)
    need(answer['materials'][0]['preset'] == 'wholemilk' and answer['materials'][0]['color_from'] == 'profile', answer)
    need({p['severity'] for p in answer['problems']} <= {'note'}, answer['problems'])
    shown = text(works(folder, 'check', 'bunny.obj', '--size', '70mm', '--material', 'wholemilk').stdout)
    for part in ('70 x 70 x 70 mm', 'closed', 'wholemilk', 'mean free path', 'diffuse mean free path', 'colour from', '0 problems'):
        need(part in shown, part, shown)


@test('check reports what is wrong with an object, on stdout alone')
def _(folder):
    vertices, faces = sphere()
    write_obj(folder / 'open.obj', vertices, faces[:-20])
    write_obj(folder / 'inside.obj', vertices, [f[::-1] for f in faces])
    for name, size, material, part in (('open.obj', '70mm', 'wholemilk', 'open'), ('inside.obj', '70mm', 'wholemilk', 'inverted normals'),
                                       ('bunny.obj', '0.2mm', 'chicken1', 'is the size right'), ('bunny.obj', '5km', 'marble', 'unit')):
        done = works(folder, 'check', name, '--size', size, '--material', material)
        need(part in ' '.join(text(done.stdout).split()) and '\n0 problems' not in text(done.stdout), name, done.stdout)
        need(b'warning' not in done.stderr, done.stderr)
        answer = one_object(works(folder, 'check', name, '--size', size, '--material', material, '--json'))
        need(any(p['severity'] == 'warning' and part in p['what'] for p in answer['problems']), answer['problems'])
    need(answer['objects'][0]['closed'], answer)


@test('bench screen-space: a row per stage, frame, one thread, the distance; --json')
def _(folder):
    small = ['--repeats', '2', '--width', '160', '--height', '90', '--threads', '2']
    answer = one_object(works(folder, 'bench', 'screen-space', *small, '--json'))
    keys(answer, 'bench engine device threads build rows covered')
    need(answer['bench'] == 'screen-space' and answer['engine'] == 'cpu' and answer['threads'] == 2 and answer['repeats'] == 2, answer)
    rows = {r['name']: r for r in answer['rows']}
    for row in answer['rows']:
        keys(row, 'name ms pixels bytes copy_ms')
    need({'surface', 'irradiance', 'blur 4', 'composite', 'post', 'frame', 'frame cold', 'frame by one thread',
          'frame at 2 x the distance', 'frame at 4 x the distance'} <= set(rows), sorted(rows))
    need(0.15 < answer['covered'] < 0.45, answer['covered'])
    need(rows['blur 4']['copy_ms'] > 0 and rows['blur 4']['ratio_to'] == 'copy', rows['blur 4'])
    need(abs(rows['blur 4']['ratio'] * rows['blur 4']['copy_ms'] - rows['blur 4']['ms']) < 1e-3, rows['blur 4'])
    shown = text(works(folder, 'bench', *small).stdout)
    need('% of the image' in shown and re.search(r'^frame +\d', shown, re.MULTILINE), shown)
    works(folder, 'bench', './scene.json', *SMALL, '--repeats', '1', '--json')


@test('bench finds its scenes beside a program that was built, installed or linked to')
def _(folder):
    for program, scenes in (('a/bin/pellucid', 'a/share/pellucid/bench'), ('b/src/cli/pellucid', 'b/bench'), ('c/pellucid', 'c/bench')):
        (folder / program).parent.mkdir(parents=True)
        (folder / scenes).mkdir(parents=True)
        shutil.copy(PROGRAM, folder / program)
        for name in ('bunny.obj', 'scene.json'):
            shutil.copy(folder / name, folder / scenes / name)
        link = folder / program.split('/', maxsplit=1)[0] / 'link'
        link.symlink_to(folder / program)
        for path in (folder / program, link):
            done = subprocess.run([path, 'bench', 'scene', *SMALL, '--repeats', '1', '--json'], cwd='/', env=clean_environment(),
                                  capture_output=True, check=False)
            need(done.returncode == 0 and one_object(done)['bench'] == 'scene', path, done.stderr)


# --- Help, man page, guide ----------------------------------------------------------------------------------------------------------

def help_of(folder, command):
    return text(works(folder, command, '--help').stdout)


def options_of(shown):
    return set(re.findall(r'^  (?:-\w, |    )--([a-z-]+)', shown.split('\nOptions\n')[1], re.MULTILINE))


@test('the program tells of itself: --help, -h, help, --version')
def _(folder):
    first = works(folder, '--help').stdout
    need(first == works(folder, '-h').stdout == works(folder, 'help').stdout, 'three kinds of help')
    for command in COMMANDS:
        need(re.search(rf'^  {command} ', text(first), re.MULTILINE), command)
        shown = works(folder, command, '--help').stdout
        need(works(folder, 'help', command).stdout == shown == works(folder, command, '-h').stdout, command)
        for version in ('-V', '--version'):
            need(works(folder, command, version).stdout == works(folder, version).stdout, command, version)
            need(one_object(works(folder, command, version, '--json')) == one_object(works(folder, version, '--json')), command)
    need('standard error' in text(works(folder, 'help', 'relative', 'error').stdout))
    need('--layers FILE' in text(works(folder, 'help', 'layers').stdout), 'a topic hides an option of its name')
    need(re.fullmatch(r'pellucid \d+\.\d+\.\d+\n', text(works(folder, '--version').stdout)))


@test('each command takes the options of its help and no others')
def _(folder):
    release_only('words, which are the same in every build')
    every = {c: options_of(help_of(folder, c)) for c in COMMANDS}
    options = sorted(set().union(*every.values()))
    step = 4 # all of them are read by the same code; each is tested with a few commands
    for first, (command, own) in enumerate(every.items()):
        need({'help', 'json', 'quiet', 'log-level'} <= own, command, own)
        for option in options[first % step::step]:
            done = run(folder, command, f'--{option}', '--no-such-option')
            known = b'--no-such-option' in done.stderr or done.stdout or b'--' + option.encode() + b': unknown option' not in done.stderr
            need(bool(known) == (option in own), f'{command} --{option}', done.stderr)


@test('options of the viewer and of parts of images stay with their commands')
def _(folder):
    if 'view' not in COMMANDS:
        raise Skip('this build has no viewer')
    viewers, parts = {'port', 'listen', 'no-open'}, {'sample-range', 'tile-range', 'frame-range'}
    need(viewers <= options_of(help_of(folder, 'view')) and parts <= options_of(help_of(folder, 'render')), 'options are missing')
    need(not parts & options_of(help_of(folder, 'view')) and not viewers & options_of(help_of(folder, 'render')), 'options are shared')


@test('a later option wins, an option twice leaks nothing')
def _(folder):
    works(folder, *MESH, '--size', '1mm', '--size=80mm', '-o', 'first.png', '-o', 'second.png', '--threads', '1', '--threads', '2', '-q')
    need('second.png' in names(folder) and 'first.png' not in names(folder) and 'out.png' not in names(folder), names(folder))


def example_lines(shown):
    return [line[2:] for line in shown.split('Examples\n')[1].split('\nOptions')[0].splitlines()]


def run_examples(folder, lines):
    need(lines, 'no examples')
    for line in lines: # those of the guide's pages are run by tests/docs
        words = shlex.split(line, comments=True)
        need(words[0] == 'pellucid', line)
        if words[1] == 'view' and 'view' not in COMMANDS:
            continue
        if words[1] == 'view':
            with Viewer(folder, *[w for w in words[2:] if w not in ('--port', '8000')], *SMALL) as viewer:
                need(viewer.end() == 0, line)
            continue
        small = {'render': SMALL, 'bench': [*SMALL, '--repeats', '1']}.get(words[1], [])
        small = SMALL if words[1] == 'compare' and not any(w.endswith('.exr') for w in words) else small  # of a scene
        done = works(folder, *words[1:], *small)
        if words[1] == 'render' and '-o' in words and '--turntable' not in words and '--frames' not in words:
            need((folder / words[words.index('-o') + 1]).stat().st_size > 100, line)
        need(words[1] in ('render', 'merge', 'profile') or done.stdout, line)


@test('every example of the help runs')
def _(folder):
    release_only('commands that have tests of their own')
    for command in COMMANDS:
        run_examples(folder, example_lines(help_of(folder, command)))
    need({'bunny.png', 'plain.png', 'head.exr', 'scene.png', 'turn_0000.png', 'turn_0003.png'} <= set(names(folder)), names(folder))


@test('help NAME explains commands, topics, options, methods, knobs and materials, and names the nearest of what it does not know')
def _(folder):
    topics = re.search(r'a material, or (.*?) -V,', ' '.join(works(folder, 'help').stdout.decode().split()))[1].split(', ')
    need({'lengths', 'scenes', 'exit-codes'} <= set(topics), topics)
    for name, listed in [(t, f'pellucid help {t} - ') for t in topics] + [
            ('check', 'usage: pellucid check'), ('msaa', 'of render, bench, compare'), ('--msaa', '--msaa N'),
            ('-m', '--method'), ('taps', 'of profile'), ('screen-space', 'Jimenez'), ('lod', '--set lod=VALUE'),
            ('wholemilk', 'Jensen et al. 2001'), ('exit-codes', '  130 '), ('scenes', '"pellucid": 1')]:
        need(listed in works(folder, 'help', name).stdout.decode(), name, listed)
    for name, topic in (('units', 'lengths'), ('size', 'lengths'), ('scene', 'scenes'), ('exit codes', 'exit-codes'),
                        ('exitcodes', 'exit-codes'), ('knob', 'knobs'), ('env', 'environment'), ('stdout', 'output'), ('layer', 'layers')):
        need(works(folder, 'help', *name.split()).stdout.decode().startswith(f'pellucid help {topic} - '), name, topic)
    need('--size LENGTH' in works(folder, 'help', 'size').stdout.decode(), 'a topic hides an option of its alias')
    for command in ('materials', 'methods'):
        need(works(folder, 'help', command).stdout == works(folder, command, '--help').stdout, command)
    listed = works(folder, 'help', 'topics').stdout.decode()
    need(all(f'\n  {t} ' in listed for t in topics if t != 'topics'), listed)
    for name in ('lenghts', 'qwertz'):
        need('topics: ' + ', '.join(topics) in run(folder, 'help', name).stderr.decode(), name)
    for name, nearest in (('rendr', 'help render'), ('exitcods', 'help exit-codes'), ('--msa', 'help msaa'), ('marbel', 'help marble'),
                          ('', '--help')):
        done = run(folder, 'help', name)
        need(done.returncode == 2 and f'there is no help about "{name}"' in done.stderr.decode(), name, done)
        need(nearest in done.stderr.decode(), name, done)
    with_unit = re.search(r'  \{\n.*\n  \}\n', works(folder, 'help', 'scenes').stdout.decode(), re.DOTALL)[0]
    (folder / 'told.json').write_text(with_unit)
    works(folder, 'check', 'told.json')


@test('the man pages are those that docs/man/make_man.py makes of the help')
def _(folder):
    release_only('words, which are the same in every build')
    subprocess.run([sys.executable, ROOT / 'docs/man/make_man.py', PROGRAM, '--all', folder], check=True, env=clean_environment())
    pages = {name for name in names(folder) if name.endswith('.1')}
    need(pages == {'pellucid.1', *(f'pellucid-{command}.1' for command in COMMANDS)}, pages)
    for name in sorted(pages):
        need((folder / name).read_text('utf-8') == (ROOT / 'docs/man' / name).read_text('utf-8'),
             f'{name}: run docs/man/make_man.py PROGRAM --all docs/man')
    for page in (ROOT / 'docs/man').glob('*.1'):
        need('\n.B of ' not in page.read_text('utf-8'), page.name, 'takes the commands of an option for a row of a topic')
    for command in COMMANDS:
        page = (folder / f'pellucid-{command}.1').read_text('utf-8')
        for option in options_of(help_of(folder, command)):
            need('\\-\\-' + option.replace('-', '\\-') in page, command, f'--{option}')
    # the page of pellucid-mpi is made where there is an MPI; its render has the options of this one except --max-error
    sys.path.insert(0, str(ROOT / 'docs/man'))
    make_man = __import__('make_man')
    page = (ROOT / 'docs/man/pellucid-mpi.1').read_text('utf-8')
    for row in make_man.option_rows(make_man.split_help(help_of(folder, 'render'))[4]):
        need(row == '.TP\n' or 'max\\-error' in row or row in page, 'pellucid-mpi.1 lacks', row)
    page = (folder / 'pellucid.1').read_text('utf-8')
    for code in ('0', '1', '2', '3', '4', '5', '75', '130'):
        need(f'\n.B {code}\n' in page, 'exit code', code)


@test('the guide names every command, exit code and JSON key, and only options that are there')
def _(folder):
    release_only('words, which are the same in every build')
    guide = (ROOT / 'docs/guide/command-line.md').read_text('utf-8')
    for command in COMMANDS:
        need(f'| `{command}' in guide, command)
    for code in (0, 1, 2, 3, 4, 5, 75, 130):
        need(f'\n| {code} |' in guide, 'exit code', code)
    there = set().union(*(options_of(help_of(folder, c)) for c in COMMANDS))
    for option in re.findall(r'--([a-z][a-z-]*)', guide):
        need(option in there, f'--{option} is not there')
    for command, arguments in (('render', MESH[1:]), ('check', ['scene.json']), ('methods', []), ('materials', []), ('info', []),
                               ('bench', ['./scene.json', '--repeats', '1', *SMALL])):
        row = re.search(rf'^\| `{command}` \| (`.*) \|$', guide, re.MULTILINE)[1]
        listed = set(re.findall(r'`([a-z_]+)`', row))
        need(set(one_object(works(folder, command, *arguments, '--json'))) <= listed, command, 'has keys that the guide does not tell')


# --- Streams ------------------------------------------------------------------------------------------------------------------------

def on_terminal(folder, arguments, env, both=False, columns=None):
    """stderr, or both, are a terminal; returns (stdout, the terminal's content)."""
    ours, theirs = pty.openpty()
    if columns:
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack('HHHH', 40, columns, 0, 0))
    child = subprocess.Popen([PROGRAM, *arguments], cwd=folder, env=env, stdin=subprocess.DEVNULL, stderr=theirs,
                             stdout=theirs if both else subprocess.PIPE)
    os.close(theirs)
    got = b''
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        got += part
    os.close(ours)
    return child.communicate()[0], got, child.returncode


@test('no escape sequences where the output is no terminal, NO_COLOR is set or the terminal is dumb')
def _(folder):
    commands = [['render', 'no.obj', '--size', '70mm', '-o', 'o.png'], ['check', 'bunny.obj', '--size', '1mm'], ['materials', 'skin'],
                ['methods', 'screen-space'], ['info']]
    for arguments in commands:
        done = run(folder, *arguments)
        need(b'\x1b' not in done.stdout + done.stderr, arguments, done)
        _, plain, _ = on_terminal(folder, arguments, clean_environment(NO_COLOR='1'), both=True)
        _, dumb, _ = on_terminal(folder, arguments, clean_environment(TERM='dumb'), both=True)
        need(b'\x1b' not in plain + dumb, arguments, plain, dumb)
        out, _, _ = on_terminal(folder, arguments, clean_environment())
        need(b'\x1b' not in out, 'stdout is a pipe:', arguments, out)
        _, colored, _ = on_terminal(folder, arguments, clean_environment(NO_COLOR=''), both=True)
        need(b'\x1b[' in colored, 'no colour on a terminal:', arguments, colored)


@test('on a terminal of 60 columns help, lists and messages break between words, and all of it is ASCII')
def _(folder):
    for arguments in [['--help'], ['methods'], ['materials'], ['methods', 'path-trace'], ['help', 'noise'], ['info'],
                      ['check', 'no-such-file-of-this-name-in-any-folder.obj', '--size', '70mm'], *([c, '--help'] for c in COMMANDS)]:
        _, shown, _ = on_terminal(folder, arguments, clean_environment(NO_COLOR='1'), both=True, columns=60)
        lines = shown.decode('ascii').replace('\r\n', '\n').split('\n')
        wide = [line for line in lines if len(line) > 60 and 'mean free path' not in line and not line.startswith('Published profiles')]
        need(len(lines) > 1 and not wide, arguments, wide)
        _, usual, _ = on_terminal(folder, arguments, clean_environment(NO_COLOR='1'), both=True, columns=200)
        words = [[w for w in t.decode().split() if w not in ('\\', '#')] for t in (usual, shown)]
        need(words[0] == words[1] or arguments == ['materials'], arguments, shown)


@test('help breaks at 40 columns between words, and its examples as a shell takes them')
def _(folder):
    for arguments in [['--help'], ['help', 'scenes'], *([c, '--help'] for c in COMMANDS)]:
        shown, usual = (on_terminal(folder, arguments, clean_environment(NO_COLOR='1'), both=True, columns=n)[1].decode('ascii')
                        .replace('\r\n', '\n') for n in (40, 200))
        wide = [line for line in shown.split('\n') if len(line) > 40]
        need(not wide, arguments, wide)
        words = [[w for w in t.split() if w not in ('\\', '#')] for t in (shown, usual)]
        need(words[0] == words[1], arguments, shown)
        if 'Examples' in shown:
            examples = [[shlex.split(line, comments=True) for line in re.sub(r'\\\n', '', t.split('Examples\n')[1].split('\n\nOptions')[0])
                         .splitlines()] for t in (shown, usual)]
            need([e for e in examples[0] if e] == examples[1], arguments, shown)


@test('what a render says of itself: the names of the images, one thread, an option that is given twice')
def _(folder):
    done = works(folder, 'render', 'scene.json', '--turntable', '2', '-o', 'turn.png', *SMALL, '--threads', '1').stderr.decode()
    need('turn_0000.png to turn_0001.png, 2 images: ' in done and '(1 thread)' in done and 'turn.png' not in done, done)
    done = works(folder, 'render', 'bunny.obj', '--size', '70mm', '--size', '80mm', '-o', 'one.png', *SMALL).stderr.decode()
    need('--size: is given more than once: the last, "80mm", counts' in done and ' 80 ' in done, done)
    done = works(folder, *MESH, '--set', 'lod=2', '--set', 'gaussians=3', '--limit', 'depth=9', '--limit', 'items=99').stderr.decode()
    need('more than once' not in done, done)


@test('a progress bar with rate and time left on a terminal, cleared at the end')
def _(folder):
    width, height = (64, 36) if SANITIZED else (160, 90) # it must take a while
    _, got, code = on_terminal(folder, ['render', 'scene.json', '--turntable', '12', '-o', 't.png', '--width', str(width), '--height',
                                        str(height), '--threads', '1', '--light-samples', '64'], clean_environment())
    need(code == 0, got)
    need(re.search(rb'\rrender \[#* *\] +\d+ %, [0-9.e+]+ %/s, \d+ s left', got), 'no bar in', got)
    last = text(got).split('\r')[-4:]  # the bar was cleared, then one message of two lines
    need(re.search(rb'\r {20,}\r[^\r]*t_0000', got), 'the bar was not cleared in', got)
    need(f't_0000.png to t_0011.png, 12 images: {width} x {height}' in ''.join(last), last)
    _, quiet, _ = on_terminal(folder, [*MESH, '--quiet'], clean_environment())
    need(quiet == b'', quiet)


@test('--quiet prints nothing on success')
def _(folder):
    done = works(folder, *MESH, '--quiet')
    need(not done.stdout and not done.stderr and 'out.png' in names(folder), done)


@test('render says in one line what it did, on stderr; --stats prints the stages there')
def _(folder):
    done = works(folder, *MESH, '--stats')
    need(not done.stdout, done.stdout)
    need(re.search(rb'^out.png: 48 x 27, screen-space on engine cpu \(\d+ threads\), ', done.stderr, re.MULTILINE), done.stderr)
    need(re.search(rb'^surface +\d', done.stderr, re.MULTILINE) and re.search(rb'^frame +\d', done.stderr, re.MULTILINE), done.stderr)
    need(b'surface' not in works(folder, *MESH).stderr)


@test('an answer that can not be written: exit 1')
def _(folder):
    with open('/dev/full', 'wb') as full:
        for arguments in (['materials'], ['materials', '--json'], ['--help'], ['render', '--help'], ['--version'], ['check', 'scene.json']):
            done = run(folder, *arguments, stdout=full, stderr=subprocess.PIPE, capture_output=False)
            said = text(done.stderr).splitlines()
            need(done.returncode == 1 and said[-1:] == ["error: standard output: the answer can't be written"], arguments, done)


@test('a reader that goes away is no crash')
def _(folder):
    for arguments, codes in ((['materials'], (0, 1)), ([*MESH, '--format', 'pfm', '--width', '400', '--height', '300', '-o', '-'], (1,))):
        read, write = os.pipe()
        os.close(read)
        done = run(folder, *arguments, stdout=write, stderr=subprocess.PIPE, capture_output=False)
        os.close(write)
        need(done.returncode in codes, arguments, done.returncode, done.stderr)


@test('numbers in all answers are finite, whatever the scene')
def _(folder):
    (folder / 'flat.obj').write_text('v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n', 'ascii')
    (folder / 'clear.json').write_text(json.dumps({
        'pellucid': 1, 'mesh': 'bunny.obj', 'unit': '1mm',
        'materials': {'*': {'sigma_a': [0, 0, 0], 'sigma_s_reduced': [1, 1, 1], 'eta': 1}}}), 'ascii')
    for arguments in (['check', 'flat.obj', '--size', '1mm'], ['check', 'clear.json'],
                      ['render', 'flat.obj', '--size', '1mm', *SMALL, '-o', 'a.png'], ['render', 'clear.json', *SMALL, '-o', 'b.exr']):
        finite(one_object(works(folder, *arguments, '--json')))


sys.exit(main())
