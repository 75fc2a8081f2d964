# SPDX-License-Identifier: MIT
"""A page of `pellucid view` without a browser: the program, its address, and a WebSocket (RFC 6455). Standard library only."""
import base64
import hashlib
import http.client
import json
import os
import re
import select
import signal
import socket
import struct
import subprocess
import time
import urllib.parse

from cli_test import PROGRAM, SANITIZED, clean_environment, need, text

PATIENCE = 240.0 if SANITIZED else 60.0
QUICK = ['--width', '160', '--height', '90', '--msaa', '1', '--light-samples', '2', '--indirect-samples', '256']


class Closed(Exception):
    """The program has closed the connection; the arguments are its code and reason."""


class Viewer:
    """The program while it serves."""

    def __init__(self, folder, *arguments, **variables):
        self.process = subprocess.Popen([PROGRAM, 'view', *arguments, '--no-open'], cwd=folder, env=clean_environment(**variables),
                                        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE)
        line = text(self.process.stdout.readline()) if ready else ''
        found = re.fullmatch(r'http://([\d.]+):(\d+)/\?token=([0-9a-f]{32})\n', line)
        if not found:
            self.process.kill()
            raise AssertionError(f'no address: {line!r} {text(self.process.stderr.read())}')
        self.host, self.port, self.token = found[1], int(found[2]), found[3]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.end()
        self.process.stdout.close()
        self.process.stderr.close()

    def end(self, number=signal.SIGINT):
        self.process.send_signal(number)
        try:
            return self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise

    def get(self, path, **headers):
        return self.ask('GET', path, **headers)

    def ask(self, method, path, body=None, **headers):
        connection = http.client.HTTPConnection(self.host, self.port, timeout=PATIENCE)
        try:
            try:
                connection.request(method, path, body=body, headers=headers)
            except ConnectionError: # the answer came before the end of the body
                pass
            answer = connection.getresponse()
            return answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
        except (http.client.HTTPException, OSError):
            return 0, {}, b''
        finally:
            connection.close()

    def page(self, **options):
        return Page(self, **options)

    def open_files(self):
        return len(os.listdir(f'/proc/{self.process.pid}/fd'))

    def cpu_seconds(self):
        with open(f'/proc/{self.process.pid}/stat', encoding='ascii') as file:
            fields = file.read().rsplit(')', 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


class Page:
    """A connection. It acknowledges every image, unless `lazy`."""

    def __init__(self, viewer, token=None, host=None, origin=None, lazy=False, protocol='pellucid', upgrade='websocket'):
        self.socket = socket.create_connection((viewer.host, viewer.port), timeout=PATIENCE)
        self.lazy, self.buffer, self.number = lazy, b'', 0
        key = base64.b64encode(os.urandom(16)).decode('ascii')
        query = urllib.parse.urlencode({'token': viewer.token if token is None else token})
        lines = [f'GET /?{query} HTTP/1.1', f'Host: {host or f"{viewer.host}:{viewer.port}"}', f'Upgrade: {upgrade}', 'Connection: Upgrade',
                 f'Sec-WebSocket-Key: {key}', 'Sec-WebSocket-Version: 13']
        if protocol:
            lines.append(f'Sec-WebSocket-Protocol: {protocol}')
        if origin:
            lines.append(f'Origin: {origin}')
        self.socket.sendall('\r\n'.join(lines + ['', '']).encode('ascii'))
        head = b''
        while b'\r\n\r\n' not in head:
            try:
                more = self.socket.recv(1)
            except ConnectionResetError:
                more = b''
            if not more:
                raise Closed(0, 'refused')
            head += more
        if not head.startswith(b'HTTP/1.1 101'):
            raise Closed(0, text(head.split(b'\r\n')[0]))
        accept = base64.b64encode(hashlib.sha1((key + '258EAFA5-E914-47DA-95CA-C5AB0DC85B11').encode('ascii')).digest())
        need(accept in head, 'the handshake is wrong:', head)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def send_bytes(self, data, opcode=1, final=True):
        mask = os.urandom(4)
        head = bytes([(0x80 if final else 0) | opcode])
        size = len(data)
        head += bytes([0x80 | size]) if size < 126 else bytes([0x80 | 126]) + struct.pack('>H', size) if size < 65536 else \
            bytes([0x80 | 127]) + struct.pack('>Q', size)
        masked = (int.from_bytes(data, 'big') ^ int.from_bytes((mask * (size // 4 + 1))[:size], 'big')).to_bytes(size, 'big')
        self.socket.sendall(head + mask + masked)

    def send(self, message):
        self.send_bytes(json.dumps(message).encode('utf-8'))

    def take(self, size):
        while len(self.buffer) < size:
            more = self.socket.recv(1 << 16)
            if not more:
                raise Closed(0, 'the connection is gone')
            self.buffer += more
        data, self.buffer = self.buffer[:size], self.buffer[size:]
        return data

    def receive(self):
        """The next message: its JSON, and the attached file (b'' if none)."""
        data, binary = b'', False
        while True:
            first, second = self.take(2)
            size = second & 0x7f
            size = struct.unpack('>H', self.take(2))[0] if size == 126 else struct.unpack('>Q', self.take(8))[0] if size == 127 else size
            part, opcode = self.take(size), first & 0xf
            if opcode == 8:
                raise Closed(struct.unpack('>H', part[:2])[0] if len(part) >= 2 else 0, text(part[2:]))
            if opcode == 9: # a ping: a client that does not answer is taken for gone
                self.send_bytes(part, opcode=10)
            if opcode in (9, 10):
                continue
            binary = binary or opcode == 2
            data += part
            if first & 0x80:
                break
        if not binary:
            return json.loads(data), b''
        length = struct.unpack('<I', data[:4])[0]
        head = json.loads(data[4:4 + length])
        if head['type'] == 'picture' and not self.lazy:
            self.send({'type': 'ack', 'serial': head['serial']})
        return head, data[4 + length:]

    def until(self, wanted, seen=None):
        """The first message for which `wanted` holds. Those before it are added to `seen`."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            head, file = self.receive()
            if wanted(head):
                return head, file
            if seen is not None:
                seen.append(head)
        raise AssertionError('it did not come')

    def view(self, state, moving=False):
        self.number += 1
        self.send({'type': 'view', 'id': self.number, 'moving': moving, 'state': state})
        return self.number

    def hello(self):
        return self.until(lambda m: m['type'] == 'hello')[0]

    def still(self, state):
        """Sends a view and waits for its finished image."""
        number = self.view(state)
        return self.until(lambda m: m['type'] == 'picture' and m['picture'] == 0 and m['id'] == number and m['still'])

    def saved(self, form):
        self.number += 1
        self.send({'type': 'save', 'id': self.number, 'format': form})
        return self.until(lambda m: m['type'] == 'file' and m['id'] == self.number)[1]
