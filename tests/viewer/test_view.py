#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""test_view.py PROGRAM ROOT: `pellucid view` from outside: access control, messages to a page, and images identical to those of
`render`."""
import base64
import json
import resource
import shutil
import signal
import socket
import struct
import subprocess
import time

from cli_test import ROOT, SANITIZED, Skip, main, need, one_object, png_pixels, run, sphere, test, works, write_obj, write_scene
from viewer_test import PATIENCE, QUICK, Closed, Viewer

# Under a sanitizer the atlas alone takes minutes.
METHODS = ['screen-space', 'image-space', 'none']
if not SANITIZED:
    METHODS += ['texture-space', 'convolution', 'layered', 'hierarchical', 'dipole', 'single-scatter']

# Knobs with which the most expensive methods render a small image quickly.
FEW = {'dipole': {'error': '1', 'most': '128'}, 'single-scatter': {'most': '256'}}

# The program's initial state.
BEGIN = {'method': 'screen-space', 'knobs': {},
         'settings': {'width': '160', 'height': '90', 'msaa': '1', 'light-samples': '2', 'indirect-samples': '256'}}


def ball(folder):
    write_obj(folder / 'ball.obj', *sphere())
    return ['ball.obj', '--unit', '1mm', '--material', 'marble', *QUICK]


def write_moving_gltf(path):
    """A ball of 20 mm that rises by 20 mm in a second, and two cameras."""
    points, triangles = sphere(radius=0.01)
    parts = [struct.pack(f'<{3 * len(points)}f', *(x for p in points for x in p)),
             struct.pack(f'<{3 * len(triangles)}I', *(i for t in triangles for i in t)), struct.pack('<2f', 0, 1),
             struct.pack('<6f', 0, 0, 0, 0, 0.02, 0)]
    starts = [sum(len(p) for p in parts[:i]) for i in range(4)]
    accessors = [(5126, len(points), 'VEC3'), (5125, 3 * len(triangles), 'SCALAR'), (5126, 2, 'SCALAR'), (5126, 2, 'VEC3')]
    path.write_text(json.dumps({
        'asset': {'version': '2.0'}, 'buffers': [{'byteLength': sum(map(len, parts)), 'uri': 'data:application/octet-stream;base64,' +
                                                  base64.b64encode(b''.join(parts)).decode('ascii')}],
        'bufferViews': [{'buffer': 0, 'byteOffset': start, 'byteLength': len(part)} for start, part in zip(starts, parts)],
        'accessors': [{'bufferView': i, 'componentType': kind, 'count': count, 'type': of, 'min': [-1] * n, 'max': [1] * n}
                      for i, (kind, count, of) in enumerate(accessors) for n in [3 if of == 'VEC3' else 1]],
        'meshes': [{'primitives': [{'attributes': {'POSITION': 0}, 'indices': 1}]}],
        'cameras': [{'name': n, 'type': 'perspective', 'perspective': {'yfov': 0.5, 'znear': 0.01}} for n in ('left', 'right')],
        'nodes': [{'mesh': 0}, {'name': 'left', 'camera': 0, 'translation': [-0.01, 0, 0.1]},
                  {'name': 'right', 'camera': 1, 'translation': [0.02, 0.01, 0.08]}],
        'scenes': [{'nodes': [0, 1, 2]}], 'scene': 0,
        'animations': [{'name': 'stay', 'channels': [], 'samplers': []},
                       {'name': 'rise', 'channels': [{'sampler': 0, 'target': {'node': 0, 'path': 'translation'}}],
                        'samplers': [{'input': 2, 'output': 3}]}]}))


def renders_the_same(folder, page, png, name, *options):
    """The scene that the page saves, rendered by `render`, has the pixels of the page's finished image."""
    (folder / name).write_bytes(page.saved('scene'))
    works(folder, 'render', name, *options, '-o', f'{name}.png')
    need(png_pixels((folder / f'{name}.png').read_bytes()) == png_pixels(png), name, 'renders other pixels:', (folder / name).read_text())


@test('the page is served to those with the token, under a strict policy')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer:
        status, headers, body = viewer.get(f'/?token={viewer.token}')
        need(status == 200 and b'<canvas' in body and headers['content-type'].startswith('text/html'), status, headers)
        policy = headers['content-security-policy']
        need("default-src 'none'" in policy and 'unsafe' not in policy and '*' not in policy, policy)
        need(headers['x-content-type-options'] == 'nosniff' and headers['cache-control'] == 'no-store', headers)
        for path in ('/main.js', '/style.css'):
            need(viewer.get(path)[0] == 200, path)
        for path in ('/', '/?token=', f'/?token={viewer.token[:-1]}', f'/?token={viewer.token}0', '/?token=' + '0' * 32):
            need(viewer.get(path)[0] in (0, 403), path, 'is served')
        for path in ('/ball.obj', '/../ball.obj', '/%2e%2e/ball.obj', '/main.js/', '//etc/passwd'):
            need(viewer.get(path)[0] in (0, 403, 404), path, 'is served')
        for host in ('example.org', 'example.org:80', f'127.0.0.1.example.org:{viewer.port}', '[::1', '127.0.0.1:80x'):
            need(viewer.get(f'/?token={viewer.token}', Host=host)[0] in (0, 400, 403), host, 'is served')
        for host in ('localhost', f'localhost:{viewer.port}', '127.0.0.1:9', '[::1]:9'):
            need(viewer.get(f'/?token={viewer.token}', Host=host)[0] == 200, host, 'is refused')


@test('only a page that was served, and knows the token, may connect')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer:
        here = f'http://{viewer.host}:{viewer.port}'
        for options in ({'token': ''}, {'token': 'f' * 32}, {'origin': 'http://example.org'}, {'origin': 'null'}, {'origin': f'{here}0'},
                        {'host': 'example.org', 'origin': 'http://example.org'}):
            try:
                with viewer.page(**options):
                    raise AssertionError(f'{options} is let in')
            except Closed:
                pass
        with viewer.page(origin=here) as page:
            need(page.hello()['input'] == 'ball.obj', 'hello')


@test('no connection becomes anything but a page')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer:
        for wrong in ({'protocol': None}, {'protocol': 'http'}, {'protocol': 'files'}, {'protocol': 'pellucid, http'},
                      {'protocol': 'Pellucid'}, {'upgrade': 'h2c'}, {'upgrade': 'h2c', 'protocol': None}):
            for token in (None, ''):
                try:
                    with viewer.page(token=token, **wrong):
                        raise AssertionError(f'{wrong} is let in')
                except Closed:
                    pass
        with viewer.page() as page:
            page.hello()


@test('connections without a token, more than there may be files, end soon and keep out no page')
def _(folder):
    handshake = ('GET / HTTP/1.1\r\nHost: example.org\r\nOrigin: http://example.org\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n'
                 'Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n')
    with Viewer(folder, *ball(folder)) as viewer, viewer.page() as page:
        state = page.hello()['state']
        resource.prlimit(viewer.process.pid, resource.RLIMIT_NOFILE, (512, 512))
        for begin in ('', 'GET / HTTP/1.1\r\nHo', handshake, f'{handshake}\r\n', f'{handshake}Sec-WebSocket-Protocol: files\r\n\r\n'):
            before, others = viewer.open_files(), []
            for _ in range(600):
                others.append(socket.create_connection((viewer.host, viewer.port), timeout=PATIENCE))
                try:
                    others[-1].sendall(begin.encode('ascii'))
                except ConnectionError:
                    pass
            need(viewer.get(f'/?token={viewer.token}')[0] == 200, repr(begin), 'keep out the page')
            with viewer.page() as more:
                more.hello()
            need(viewer.open_files() < before + 100, viewer.open_files(), 'files are open, before', before)
            spent = viewer.cpu_seconds()
            time.sleep(0.5)
            need(viewer.cpu_seconds() - spent < 0.1, repr(begin), 'keep the processor busy')
            for one in others:
                one.close()
        page.still(state)
        silent = socket.create_connection((viewer.host, viewer.port), timeout=PATIENCE)
        need(silent.recv(1) == b'', 'a connection that asks for nothing stays')
        silent.close()


@test('what is no request for a page is refused at once')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer:
        start = time.monotonic()
        for method in ('POST', 'PUT', 'PATCH', 'DELETE', 'OPTIONS'):
            for body in (None, b'x', b'x' * 10000, b'x' * 1000000):
                status, headers, _ = viewer.ask(method, '/main.js', body)
                need(status == 405 and headers['allow'] == 'GET, HEAD' and headers['connection'] == 'close', method, status, headers)
        status, headers, _ = viewer.ask('POST', '/main.js', **{'Content-Length': '1000'}) # and no body
        need(status == 405, status, headers)
        need(viewer.ask('GET', '/main.js', b'body')[0] == 400, 'a body')
        size = len(viewer.get('/main.js')[2])
        status, headers, body = viewer.ask('HEAD', '/main.js')
        need(status == 200 and int(headers['content-length']) == size and body == b'', status, headers)
        need(time.monotonic() - start < PATIENCE / 4, time.monotonic() - start, 's')


@test('hello has every method, knob, setting and material of the tables')
def _(folder):
    with Viewer(folder, *ball(folder), '-m', 'image-space', '--set', 'samples=40') as viewer, viewer.page() as page:
        hello = page.hello()
        listed = one_object(works(folder, 'methods', '--json'))['methods']
        need([m['name'] for m in hello['methods']] == [m['name'] for m in listed] + ['none'], 'methods')
        need([m['knobs'] for m in hello['methods']][:-1] == [m['knobs'] for m in listed], 'knobs')
        materials = one_object(works(folder, 'materials', '--json'))['materials']
        need(hello['materials'] == materials and len(materials) > 50, 'materials')
        need({'width', 'msaa', 'bounces'} < {s['name'] for s in hello['settings']}, hello['settings'])
        state = hello['state']
        need(state['method'] == 'image-space' and state['knobs'] == {'samples': '40'}, state)
        need(state['settings']['width'] == '160' and 'bloom' not in state['settings'], state)


@test('a view comes soon and small, then as render draws it')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer, viewer.page() as page:
        state = page.hello()['state']
        number = page.view(state, moving=True)
        head, file = page.until(lambda m: m['type'] == 'picture')
        need(head['id'] == number and head['mime'] == 'image/jpeg' and file[:2] == b'\xff\xd8' and not head['still'], head)
        need(head['width'] < 160 and head['stages'] and head['ms'] > 0.0, head)
        head, png = page.still(state)
        need((head['width'], head['height'], head['mime']) == (160, 90, 'image/png'), head)
        renders_the_same(folder, page, png, 'view.json')
        # Without tone settings of its own the command line meters the finished image, and the viewer the first one: otherwise the same
        # pixels.
        works(folder, 'render', *ball(folder), '--exposure', repr(head['exposure']), '--white', repr(head['white']), '-o', 'plain.png')
        need(png_pixels((folder / 'plain.png').read_bytes()) == png_pixels(png), 'not what the command line renders')


@test('camera, lights, material, method and settings of a page are saved bit by bit')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer, viewer.page() as page:
        state = page.hello()['state']
        _, before = page.still(state)
        with viewer.page() as other:
            other.hello()
            other.view(state)
            facts = other.until(lambda m: m['type'] == 'scene')[0]
        need(len(facts['lights']) == 3 and facts['lights'][0]['type'] == 'rect', facts)
        state['camera'] = {'from': ['31.5mm', '40.25mm', '-101mm'], 'to': ['1mm', '0mm', '-2.5mm'], 'up': [0, 1, 0], 'fov_deg': 24.3}
        _, moved = page.still(state)
        need(moved != before, 'the camera changes nothing')
        renders_the_same(folder, page, moved, 'moved.json')
        light = {**facts['lights'][0], 'at': ['100mm', '-20.1mm', '33mm'], 'to': ['0mm', '0mm', '0mm'], 'radiance': [9.5, 3, 1]}
        light.pop('up')
        state['lights'] = [light] + facts['lights'][1:]
        for step in range(3): # like a mouse drag
            light['at'][0] = f'{100 + step}mm'
            page.view(state, moving=True)
        _, lit = page.still(state)
        need(lit != moved, 'the light changes nothing')
        renders_the_same(folder, page, lit, 'lit.json')
        state['materials'] = {'*': {'sigma_a': [0.01, 0.1, 0.5], 'sigma_s_reduced': [1.5, 1.2, 1.0], 'eta': 1.4}}
        state |= {'method': 'image-space', 'knobs': {'samples': '30'}, 'settings': state['settings'] | {'msaa': '2', 'bounces': '0'}}
        _, waxy = page.still(state)
        need(waxy != lit, 'the material changes nothing')
        renders_the_same(folder, page, waxy, 'waxy.json')
        _, back = page.still(BEGIN)
        need(png_pixels(back) == png_pixels(before), 'the way back leads elsewhere')
        need(page.saved('exr')[:4] == b'\x76\x2f\x31\x01', 'no EXR')


@test('a scene file is shown with its own camera, lights, ground and options, and saved')
def _(folder):
    write_obj(folder / 'bunny.obj', *sphere())
    (folder / 'scene.json').write_text(json.dumps({
        'pellucid': 1, 'mesh': 'bunny.obj', 'unit': '1mm', 'camera': {'from': [20, 30, 120], 'fov_deg': 30}, 'ground': True,
        'lights': [{'type': 'point', 'at': [60, 80, 100], 'intensity': [0.9, 0.8, 0.7]}, {'type': 'environment', 'color': [0.2, 0.3, 0.4]}],
        'materials': {'*': {'preset': 'wholemilk'}},
        'render': {'method': 'image-space', 'width': 120, 'height': 80, 'msaa': 1, 'knobs': {'samples': 20}, 'indirect-samples': 256}}))
    with Viewer(folder, 'scene.json') as viewer, viewer.page() as page:
        state = page.hello()['state']
        need(state['method'] == 'image-space' and state['settings']['height'] == '80', state)
        _, png = page.still(state)
        renders_the_same(folder, page, png, 'saved.json')
        state['camera'] = {'from': ['-70mm', '30mm', '90mm'], 'to': ['0mm', '0mm', '0mm'], 'up': [0, 1, 0], 'fov_deg': 30}
        page.view(state, moving=True)
        _, png = page.still(state)
        renders_the_same(folder, page, png, 'turned.json')


@test('sides, studios, environments and backgrounds of the command line are shown as `render` draws them, and saved')
def _(folder):
    ball(folder)
    points, triangles = sphere()
    write_obj(folder / 'egg.obj', [(x, y, 1.4 * z + 0.3 * y) for x, y, z in points], triangles)
    small = ['--width', '64', '--height', '36']
    works(folder, 'render', *ball(folder), *small, '--background', '#80a0ff', '-o', 'sky.exr')
    (folder / 'below').mkdir()
    (folder / 'below' / 'egg.obj').write_bytes((folder / 'egg.obj').read_bytes())
    cases = [('egg.obj', ['--from', '34', '--studio', 'window']),
             ('egg.obj', ['--up', 'z', '--from', '100,-20', '--studio', 'back', '--background', 'white']),
             ('egg.obj', ['--environment', 'sky.exr', '--environment-rotate', '75', '--environment-scale', '0.5']),
             ('below/egg.obj', ['--environment', 'sky.exr', '--background', '#102030'])]
    for number, (mesh, options) in enumerate(cases[::3] if SANITIZED else cases):
        arguments = [mesh, '--unit', '1mm', '--material', 'wholemilk', '--exposure', '0.3', '--white', '1.5', *QUICK, *small, *options]
        works(folder, 'render', *arguments, '-o', f'direct-{number}.png')
        with Viewer(folder, *arguments) as viewer, viewer.page() as page:
            state = page.hello()['state']
            _, png = page.still(state)
            need(png_pixels((folder / f'direct-{number}.png').read_bytes()) == png_pixels(png), options, 'renders other pixels')
            if '/' not in mesh: # an environment outside the scene's folder is named by its absolute path, which scene files must not use
                renders_the_same(folder, page, png, f'saved-{number}.json')
            state['camera'] = {'from': ['31.5mm', '40.25mm', '-101mm'], 'to': ['1mm', '0mm', '-2.5mm'], 'up': [0, 1, 0], 'fov_deg': 24.3}
            _, moved = page.still(state)
            need(moved != png, options, 'the camera changes nothing')
            if '/' not in mesh:
                renders_the_same(folder, page, moved, f'moved-{number}.json')
            else: # the only file that it may reference there
                state['lights'] = [{'type': 'environment', 'image': str(folder / 'direct-0.png')}] * 2
                page.view(state)
                need('absolute path' in page.until(lambda m: m['type'] == 'message')[0]['what'], 'a page may name any file')


@test('the options of the command line that the page does not change are in the saved scene, or go with it')
def _(folder):
    write_obj(folder / 'egg.obj', *sphere())
    (folder / 'leaf.obj').write_text('v -20 -10 0\nv 20 -10 0\nv 20 10 0\nv -20 10 5\nf 1 2 3\nf 1 3 4\n')
    (folder / 'own.json').write_text(json.dumps({'sigma_a': [0.01, 0.1, 0.5], 'sigma_s_reduced': [1.5, 1.2, 1.0], 'eta': 1.4}))
    (folder / 'two.json').write_text(json.dumps({'pellucid': 1, 'unit': '1mm', 'meshes': ['egg.obj', {'path': 'leaf.obj', 'size': '90mm'}],
                                                 'camera': {'from': [20, 30, 120], 'fov_deg': 40}}))
    write_moving_gltf(folder / 'moving.gltf')
    small = ['--width', '64', '--height', '36', '--threads', '2', '--limit', 'depth=128']
    cases = [('egg.obj', ['--unit', '1mm', '--normals', 'flat', '--material', 'own.json']),
             ('leaf.obj', ['--size', '40mm', '--thicken', '0.5mm', '--normals', 'smooth', '--from', '20,30']),
             ('two.json', ['--thicken', '1mm', '--normals', 'flat', '--background', 'white', '--camera', 'scene file']),
             ('moving.gltf', ['--time', '0.5', '--animation', 'rise', '--camera', 'right'])]
    for number, (mesh, options) in enumerate(cases):
        arguments = [mesh, *QUICK, *small, *options, '--exposure', '0.3', '--white', '1.5']
        works(folder, 'render', *arguments, '-o', f'direct-{number}.png')
        with Viewer(folder, *arguments) as viewer, viewer.page() as page:
            hello = page.hello()
            need(hello['path'] == mesh, hello['path'])
            given = [[f'--{o["name"]}', o['value']] for o in hello['options']]
            listed = {**dict(zip(options[::2], options[1::2])), '--threads': '2', '--limit': 'depth=128'}
            need(dict(given) == listed and len(given) == len(listed), given, listed)
            _, png = page.still(hello['state'])
            need(png_pixels((folder / f'direct-{number}.png').read_bytes()) == png_pixels(png), options, 'shows other pixels')
            rest = [word for o, pair in zip(hello['options'], given) if not o['saved'] for word in pair]
            need(set(rest[::2]) == {'--threads', '--limit'} | ({'--material'} if 'own.json' in options else set()), rest)
            renders_the_same(folder, page, png, f'saved-{number}.json', *rest)


@test('every method draws, and one beside another')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer, viewer.page() as page:
        state = page.hello()['state']
        state['settings'] |= {'width': '32', 'height': '18'}
        seen = set()
        for method in METHODS:
            seen.add(page.still(state | {'method': method, 'knobs': FEW.get(method, {})})[1])
        need(len(seen) >= len(METHODS) - 1, 'methods draw the same')
        number = page.view(state | {'other': {'method': 'none', 'knobs': {}}})
        other = page.until(lambda m: m['type'] == 'picture' and m['picture'] == 1 and m['id'] == number and m['still'])[1]
        need(png_pixels(other)[:2] == (32, 18), 'the other picture')


@test('a newer view cuts short what a reference draws')
def _(folder):
    with Viewer(folder, *ball(folder), '-m', 'path-trace', '--width', '320', '--height', '180') as viewer, viewer.page() as page:
        state = page.hello()['state']
        page.view(state)
        page.until(lambda m: m['type'] == 'picture')
        page.until(lambda m: m['type'] == 'progress') # of the finished one, which would take a minute
        start, seen = time.monotonic(), []
        number = page.view(state | {'method': 'none', 'knobs': {}})
        page.until(lambda m: m['type'] == 'picture' and m['id'] == number, seen)
        need(not any(m['type'] in ('message', 'failed') for m in seen), seen)
        need(time.monotonic() - start < (60.0 if SANITIZED else 5.0), time.monotonic() - start, 's')


@test('a reference accumulates, and the error against it gets an uncertainty')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer, viewer.page() as page:
        state = page.hello()['state']
        state['settings'] |= {'width': '48', 'height': '27'}
        number = page.view(state | {'truth': 'path-trace', 'other': {'method': 'none', 'knobs': {}}})
        kinds = []
        first = page.until(lambda m: m['type'] == 'truth', kinds)[0]
        need(first['id'] == number and first['batches'] == 1 and first['a']['rel_mse_error'] is None, first)
        later = page.until(lambda m: m['type'] == 'truth' and m['batches'] > 2, kinds)[0]
        need(later['a']['rel_mse_error'] > 0.0 and later['noise'] > 0.0, later)
        need(later['b']['rel_mse'] > 0.0 and later['a']['flip'] >= 0.0, later)
        need({2, 3, 4} <= {m['picture'] for m in kinds if m['type'] == 'picture'}, 'pictures of reference and errors')
        number = page.view(state | {'truth': 'hierarchical'})
        done = page.until(lambda m: m['type'] == 'truth' and m['id'] == number)[0]
        need(done['done'] and not done['random'], done)
        page.until(lambda m: m['type'] == 'rest')


@test('a wrong value is said with its place, and the last picture stays')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer, viewer.page() as page:
        state = page.hello()['state']
        good = page.still(state)[1]
        for wrong, word in (({'method': 'scren-space'}, 'screen-space'), ({'knobs': {'gaussians': '99'}}, '99'),
                            ({'settings': {'msaa': '0'}}, 'msaa'), ({'camera': {'from': [0, 0, 0], 'to': [0, 0, 0]}}, 'direction'),
                            ({'camera': {'from': ['1', '2mm', '3mm']}}, 'unit'), ({'materials': {'*': {'preset': 'mable'}}}, 'marble'),
                            ({'lights': [{'type': 'environment', 'image': '../secret.hdr'}]}, 'secret'),
                            ({'lights': [{'type': 'environment', 'image': '/etc/passwd'}]}, 'passwd'),
                            ({'materials': {'*': {'layers': 3}}}, 'array'), ({'truth': 'nothing'}, 'nothing')):
            number, seen = page.view(state | wrong), []
            page.until(lambda m, n=number: m['type'] == 'failed' and m['id'] == n, seen)
            said = ' '.join(m['what'] + m['hint'] for m in seen if m['type'] == 'message')
            need(word in said, wrong, 'says', said)
        need(page.still(state)[1] == good, 'the view is not what it was')


@test('messages that are damaged, too long or too many end the page, not the program')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer:
        deep = b'[' * 5000
        for data in (b'', b'{', b'[]', b'\xff\xfe', b'{"type": "view"}', b'{"type": "fly", "id": 1}', deep,
                     b'{"type": "ack", "serial": 99}', b'{"type": "ack", "serial": -1}', b'{"type": "ack", "serial": 1e99}',
                     b'{"type": "pick", "id": 1, "x": 7, "y": 0}',
                     b'{"type": "view", "id": 1, "state": {"knobs": {"a": 1}}}', b'{"type": "view", "id": 1, "state": {"folder": "/"}}',
                     b'{"type": "view", "id": 1, "state": {"knobs": {' + b','.join(b'"%d": ""' % i for i in range(100)) + b'}}}',
                     b'{"type": "save", "id": 1}', b' ' * (300 << 10)):
            with viewer.page() as page:
                page.hello()
                page.send_bytes(data)
                try:
                    page.until(lambda m: False)
                except (Closed, ConnectionError):
                    continue
                raise AssertionError(data[:60])
        with viewer.page() as page:
            page.hello()
            page.send_bytes(b'{}', opcode=2)
            try:
                page.until(lambda m: False)
                raise AssertionError('binary')
            except (Closed, ConnectionError):
                pass
        with viewer.page() as page:
            state = page.hello()['state']
            for i in range(200):
                page.view(state | {'settings': state['settings'] | {'seed': str(i % 3)}}, moving=i < 199)
            number = page.number
            seen = []
            page.until(lambda m: m['type'] == 'picture' and m['still'] and m['id'] == number, seen)
            need(len([m for m in seen if m['type'] == 'picture']) < 150, 'old views are drawn')


@test('of many saves at once eight are made, the others are refused with a word, and of many profiles the last one comes')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer, viewer.page() as page:
        state = page.hello()['state']
        page.still(state)
        slow = state | {'settings': state['settings'] | {'msaa': '8'}}
        page.view(slow)
        page.until(lambda m: m['type'] == 'picture')
        for i in range(100, 140):
            page.send({'type': 'save', 'id': i, 'format': 'exr'})
        answers = {}
        while len(answers) < 40:
            seen = []
            head, _ = page.until(lambda m: m['type'] in ('file', 'unsaved'), seen)
            answers[head['id']] = (head['type'], [m['hint'] for m in seen if m['type'] == 'message'])
        made = [i for i, (kind, _) in answers.items() if kind == 'file']
        need(8 <= len(made) < 40 and 100 in made, answers)
        need(all('again' in ' '.join(said) for kind, said in answers.values() if kind == 'unsaved'), answers)
        for i in range(200, 240):
            page.send({'type': 'profile', 'id': i, 'medium': {'sigma_a': [0.01, 0.02, 0.03], 'sigma_s_reduced': [1, 1, 1 + i]}})
        page.until(lambda m: m['type'] == 'profile' and m['id'] == 239)


@test('nine pages are one too many; a page that is closed makes room; one that never answers gets two pictures')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer:
        pages = [viewer.page(lazy=i == 0) for i in range(8)]
        states = [p.hello()['state'] for p in pages]
        try:
            with viewer.page() as ninth:
                ninth.hello()
            raise AssertionError('the ninth page is let in')
        except Closed as closed:
            need('too many pages' in closed.args[1], closed.args)
        pages[7].socket.close()
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            try:
                with viewer.page() as page:
                    page.hello()
                break
            except Closed:
                time.sleep(0.05)
        else:
            raise AssertionError('a closed page makes no room')
        for _ in range(5):
            pages[0].view(states[0], moving=True)
        pages[0].view(states[0])
        for page, state in zip(pages[1:7], states[1:7]):
            page.still(state)
        time.sleep(0.5)
        pages[0].socket.setblocking(False)
        pictures = 0
        try:
            while True:
                pictures += pages[0].receive()[0]['type'] == 'picture'
        except BlockingIOError:
            pass
        need(pictures == 2, pictures, 'pictures are under way to a page that does not answer')
        for page in pages:
            page.socket.close()


@test('files that change are read again; what is wrong in them is said')
def _(folder):
    write_obj(folder / 'bunny.obj', *sphere())
    write_scene(folder / 'scene.json', width=96, height=54, msaa=1)
    with Viewer(folder, 'scene.json') as viewer, viewer.page() as page:
        state = page.hello()['state']
        before = page.still(state)[1]
        write_obj(folder / 'bunny.obj', *sphere(radius=12.0))
        page.until(lambda m: m['type'] == 'scene')
        after = page.until(lambda m: m['type'] == 'picture' and m['still'])[1]
        need(before != after, 'a smaller ball looks the same')
        (folder / 'bunny.obj').write_text('v 0 0 nought\n')
        page.until(lambda m: m['type'] == 'message' and m['level'] == 'error' and 'bunny.obj' in m['where'])
        write_obj(folder / 'bunny.obj', *sphere())
        need(page.until(lambda m: m['type'] == 'picture' and m['still'])[1] == before, 'the ball does not come back')


@test('files in folders below are read again, too')
def _(folder):
    (folder / 'meshes' / 'balls').mkdir(parents=True)
    write_obj(folder / 'meshes' / 'balls' / 'ball.obj', *sphere())
    (folder / 'scene.json').write_text(json.dumps({'pellucid': 1, 'mesh': 'meshes/balls/ball.obj', 'unit': '1mm',
                                                   'materials': {'*': {'preset': 'marble'}},
                                                   'render': {'width': 96, 'height': 54, 'msaa': 1}}))
    with Viewer(folder, 'scene.json') as viewer, viewer.page() as page:
        before = page.still(page.hello()['state'])[1]
        write_obj(folder / 'meshes' / 'balls' / 'ball.obj', *sphere(radius=12.0))
        page.until(lambda m: m['type'] == 'scene')
        need(page.until(lambda m: m['type'] == 'picture' and m['still'])[1] != before, 'a smaller ball looks the same')


@test('a shader in the folder of PELL_SHADERS is in use once it is written; a damaged one is said, and changes nothing')
def _(folder):
    if not any(e['name'] == 'vulkan' for e in one_object(works(folder, 'info', '--json'))['engines']) or not shutil.which('glslc'):
        raise Skip('there is no Vulkan device, or no glslc')
    (folder / 'my').mkdir()
    source = (ROOT / 'src/methods/screen_space/load.comp').read_text()
    (folder / 'load.comp').write_text(source.replace('entered = light[i]', 'entered = vec3(0.2, 1.0, 1.0) * light[i]'))
    subprocess.run(['glslc', '--target-env=vulkan1.3', '-I', str(ROOT / 'src'), '-fshader-stage=compute', 'load.comp', '-o', 'load.spv'],
                   cwd=folder, check=True)
    with Viewer(folder, *ball(folder), '--engine', 'vulkan', PELL_SHADERS='my') as viewer, viewer.page() as page:
        before = page.still(page.hello()['state'])[1]
        (folder / 'load.spv').rename(folder / 'my/screen_space_load.spv')
        after = page.until(lambda m: m['type'] == 'picture' and m['still'])[1]
        need(after != before, 'the shader is not in use')
        (folder / 'my/screen_space_load.spv').write_bytes(b'no shader')
        page.until(lambda m: m['type'] == 'message' and m['level'] == 'warning' and 'screen_space_load.spv' in m['where'])
        need(page.until(lambda m: m['type'] == 'picture' and m['still'])[1] == after, 'a damaged shader changes the picture')


@test('a click says what is there')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer, viewer.page() as page:
        page.still(page.hello()['state'])
        page.send({'type': 'pick', 'id': 5, 'x': 0.5, 'y': 0.5})
        hit = page.until(lambda m: m['type'] == 'picked')[0]
        need(hit['id'] == 5 and hit['preset'] == 'marble' and abs(hit['at'][2] - 20.0) < 1.0, hit)
        need(len(hit['profile']['R']) == 3 and all(r > 0 for r in hit['profile']['R'][0]), hit)
        page.send({'type': 'pick', 'id': 6, 'x': 0.01, 'y': 0.01})
        need('at' not in page.until(lambda m: m['type'] == 'picked')[0], 'something in the corner')


@test('the profile bench has what `pellucid profile` prints')
def _(folder):
    wax = json.loads((folder / 'wax.json').read_text())
    with Viewer(folder, *ball(folder)) as viewer, viewer.page() as page:
        page.hello()
        page.send({'type': 'profile', 'id': 3, 'medium': wax, 'gaussians': 4})
        got = page.until(lambda m: m['type'] == 'profile')[0]
        printed = one_object(works(folder, 'profile', 'wax.json', '--json'))
        need([m['name'] for m in got['models']][:1] == ['dipole'] and len(got['models']) >= 4, [m['name'] for m in got['models']])
        for c, channel in enumerate(printed['channels']):
            need(abs(got['models'][0]['total'][c] / channel['rd_total'] - 1.0) < 1e-6, c, got['models'][0]['total'], channel['rd_total'])
            need(abs(got['fit']['error'][c] / channel['fit']['error'] - 1.0) < 1e-3, c, got['fit']['error'], channel['fit']['error'])
        page.send({'type': 'profile', 'id': 4, 'medium': {'sigma_a': [-1, 0, 0], 'sigma_s_reduced': [1, 1, 1]}})
        need('-1' in page.until(lambda m: m['type'] == 'message')[0]['what'], 'a negative coefficient')
        slab = got['slab']
        for c in range(3):
            need(all(a >= b for a, b in zip(slab['T'][c], slab['T'][c][1:])) and slab['T'][c][0] > 0.5, 'T of slabs', slab['T'][c])
        page.send({'type': 'profile', 'id': 5, 'medium': wax, 'gaussians': 4, 'export': 'glsl'})
        head, code = page.until(lambda m: m['type'] == 'file')
        lines = works(folder, 'profile', 'wax.json', '--export', 'glsl').stdout.decode().splitlines()
        shown = [line.replace('material', 'wax') for line in code.decode().splitlines()]
        need(head['format'] == 'glsl' and len(lines) > 40 and shown[1:] == lines[1:], 'the code is not that of profile --export')
        page.send({'type': 'profile', 'id': 6, 'medium': wax, 'gaussians': 4, 'export': 'fortran'})
        need(page.until(lambda m: m['type'] == 'unsaved')[0]['id'] == 6, 'another language')
        page.send({'type': 'profile', 'id': 7, 'material': {'skin': {'melanin': 0.2, 'epidermis_mm': 0.15}}})
        skin = page.until(lambda m: m['type'] == 'profile' and m['id'] == 7)[0]
        need([layer['name'] for layer in skin['layers']] == ['epidermis', 'dermis'], skin['layers'])
        need(skin['layers'][0]['thickness_mm'] == 0.15 and skin['layers'][1]['thickness_mm'] is None, skin['layers'])
        need(0.0 < skin['models'][0]['total'][2] < skin['models'][0]['total'][0] < 1.0, 'skin is red', skin['models'][0]['total'])
        page.send({'type': 'profile', 'id': 8, 'material': {'skin': {'melanin': 0.2}}, 'export': 'glsl'})
        try:
            page.until(lambda m: m['type'] in ('file', 'unsaved'))
            need(False, 'only media are exported')
        except Closed:
            pass


@test('a restarted program with the same port and token file is found again; its file is private')
def _(folder):
    arguments = [*ball(folder), '--token-file', 'token']
    with Viewer(folder, *arguments) as viewer:
        token, port = viewer.token, viewer.port
    need((folder / 'token').read_text() == f'{token}\n' and (folder / 'token').stat().st_mode & 0o777 == 0o600, 'the file of the token')
    with Viewer(folder, *arguments, '--port', str(port)) as viewer, viewer.page(token=token) as page:
        page.hello()
    (folder / 'token').chmod(0o644)
    with Viewer(folder, *arguments) as viewer:
        need(viewer.token == token, 'another token')
        viewer.end()
        need(b'0644' in (said := viewer.process.stderr.read()) and b'chmod 600' in said, said)
    (folder / 'token').chmod(0o600)
    with Viewer(folder, *arguments) as viewer:
        viewer.end()
        need(b'chmod' not in (said := viewer.process.stderr.read()), said)
    for wrong in ('', 'secret\n', 'g' * 32, 'a' * 33):
        (folder / 'token').write_text(wrong)
        done = run(folder, 'view', *arguments)
        need(done.returncode == 3 and b'token' in done.stderr and b'32' in done.stderr, wrong, done)
    done = run(folder, 'view', *ball(folder), '--token-file', 'no/such/folder')
    need(done.returncode == 3 and b'no/such/folder' in done.stderr, done)


@test('a report of the errors is what `compare` writes')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer, viewer.page() as page:
        page.hello()
        page.view(BEGIN)
        page.send({'type': 'save', 'id': 90, 'format': 'report'})
        need('reference' in page.until(lambda m: m['type'] == 'message')[0]['hint'], 'a report without a reference')
        small = BEGIN['settings'] | {'width': '48', 'height': '27'}
        page.view(BEGIN | {'truth': 'dipole', 'other': {'method': 'none', 'knobs': {}}, 'settings': small})
        numbers = page.until(lambda m: m['type'] == 'truth')[0]
        page.send({'type': 'save', 'id': 91, 'format': 'report'})
        head, report = page.until(lambda m: m['type'] == 'file')
        text = report.decode()
        data = json.loads(text.split('<script type="application/json" id="data">')[1].split('</script>')[0])
        need(head['format'] == 'report' and [p['name'] for p in data['pictures']] == ['dipole', 'screen-space', 'none'], data['pictures'])
        for test_, picture in (('a', data['pictures'][1]), ('b', data['pictures'][2])):
            got = picture['metrics']['object']['flip']
            need(abs(got - numbers[test_]['flip']) < 1e-6, test_, got, numbers[test_]['flip'])


@test('it ends by itself when no page is open for a while, whether one has come or not, and not while one is open')
def _(folder):
    for come in (False, True):
        with Viewer(folder, *ball(folder), '--end-after', '1.5s') as viewer:
            if come:
                with viewer.page() as page:
                    page.hello()
                    time.sleep(3.0)
                    page.still(BEGIN)
            need(viewer.process.wait(PATIENCE) == 0, come)
            need(b'--end-after' in (said := viewer.process.stderr.read()), come, said)
    for wrong in ('5', 'soon', '0s'):
        done = run(folder, 'view', 'nothing.obj', '--no-open', '--end-after', wrong)
        need(done.returncode == 2 and b'--end-after' in done.stderr and b'nothing.obj' not in done.stderr, wrong, done)


@test('at rest it takes no time; Ctrl-C ends it, also while it renders')
def _(folder):
    with Viewer(folder, *ball(folder)) as viewer:
        with viewer.page() as page:
            page.still(page.hello()['state'])
            page.until(lambda m: m['type'] == 'rest')
            before = viewer.cpu_seconds()
            time.sleep(2.0)
            spent = viewer.cpu_seconds() - before
            need(spent <= 0.03, spent, 's of the processor in two seconds of rest')
            page.view(BEGIN | {'settings': {'msaa': '64', 'light-samples': '1024'}})
            page.until(lambda m: m['type'] == 'picture')
            need(viewer.end() == 0, 'Ctrl-C')
    with Viewer(folder, *ball(folder)) as viewer:
        need(viewer.end(signal.SIGTERM) == 0, 'SIGTERM')


@test('wrong input, a port that is taken and an address that is none end it with a word')
def _(folder):
    arguments = ball(folder)
    for wrong, code, word in ((['ball.obj'], 2, b'--size'), (['nothing.obj'], 3, b'nothing.obj'),
                              ([*arguments, '--set', 'lod=no'], 2, b'lod'),
                              ([*arguments, '--port', '70000'], 2, b'65535')):
        done = run(folder, 'view', *wrong, '--no-open')
        need(done.returncode == code and word in done.stderr, wrong, done.returncode, done.stderr)
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        # before the scene is read: a missing file gives no message
        for wrong, word in ((['--listen', 'here'], b'here'), (['--port', port], b'another program'), (['--set', 'methd=1'], b'--method')):
            done = run(folder, 'view', 'nothing.obj', '--no-open', *wrong)
            need(done.returncode == 2 and word in done.stderr and b'nothing.obj' not in done.stderr, wrong, done.stderr)


if __name__ == '__main__':
    main()
