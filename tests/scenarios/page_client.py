"""A participant at the page, without a browser: a WebSocket that gets frames and sends gestures and gaze."""

import base64
import json
import os
import socket
import struct
import subprocess
import threading
import time


class PageClient:
    """A connection to `/live`. `receive_buffer` bytes small makes a slow reader of it."""

    def __init__(self, port, role="participant", receive_buffer=None):
        self.socket = socket.socket()
        self.writing = threading.Lock()
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(5)
        self.socket.connect(("127.0.0.1", port))
        key = base64.b64encode(os.urandom(16)).decode()
        host = f"127.0.0.1:{port}"
        self.socket.sendall(
            f"GET /live?role={role} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n\r\n".encode()
        )
        self.pending = b""
        while b"\r\n\r\n" not in self.pending:
            data = self.socket.recv(4096)
            if not data:
                raise ConnectionError(f"closed before an answer: {self.pending!r}")
            self.pending += data
        head, self.pending = self.pending.split(b"\r\n\r\n", 1)
        if b" 101 " not in head.split(b"\r\n")[0]:
            raise ConnectionError(head.decode(errors="replace"))

    def send(self, **message):
        self._write(0x1, json.dumps(message).encode())

    def _write(self, kind, data):
        mask = os.urandom(4)
        length = bytes([0x80 | len(data)]) if len(data) < 126 else bytes([0x80 | 126]) + struct.pack(">H", len(data))
        masked = bytes(byte ^ mask[k % 4] for k, byte in enumerate(data))
        # As a whole, whichever thread writes.
        with self.writing:
            self.socket.sendall(bytes([0x80 | kind]) + length + mask + masked)

    def _read_exactly(self, count):
        while len(self.pending) < count:
            data = self.socket.recv(1 << 16)
            if not data:
                raise ConnectionError("closed")
            self.pending += data
        taken, self.pending = self.pending[:count], self.pending[count:]
        return taken

    def receive(self):
        """The next message; none for one that is no JSON, such as a ping."""
        kind, length = self._read_exactly(2)
        length &= 0x7F
        if length == 126:
            length = struct.unpack(">H", self._read_exactly(2))[0]
        elif length == 127:
            length = struct.unpack(">Q", self._read_exactly(8))[0]
        data = self._read_exactly(length)
        if kind & 0x0F == 9:
            # As browsers do by themselves: whoever does not answer is taken to be gone.
            self._write(0xA, data)
        if kind & 0x0F == 8:
            raise ConnectionError("closed by the server")
        return json.loads(data) if kind & 0x0F == 1 else None

    def frame(self):
        """The next frame."""
        while True:
            message = self.receive()
            if message and message.get("type") == "frame":
                return message

    def close(self):
        self.socket.close()


class ServeProcess:
    """`proact serve` on a port of its own, in a process group of its own. Records go to the folder `out`, what it says to
    `out.log` beside that."""

    def __init__(self, proact, port, out, *words, env=None, prefix=()):
        command = [*prefix, str(proact), "serve", "--no-browser", "--exact-port", "--port", str(port)]
        command += ["--out", str(out)]
        self.port = port
        self.log = open(f"{out}.log", "w+")
        self.process = subprocess.Popen(
            [*command, *words], stdout=self.log, stderr=self.log, env=env, start_new_session=True
        )
        end = time.monotonic() + 60
        while "page: " not in self.output_text():
            if self.process.poll() is not None or time.monotonic() > end:
                raise RuntimeError(f"the server did not start: {self.output_text()}")
            time.sleep(0.02)

    def output_text(self):
        self.log.flush()
        with open(self.log.name) as log:
            return log.read()

    def stop(self, signal):
        """Sends a signal and waits; the exit code."""
        self.process.send_signal(signal)
        return self.process.wait(timeout=30)
