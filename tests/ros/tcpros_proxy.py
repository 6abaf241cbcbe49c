"""A bad network between a publisher and a subscriber: bytes of one topic, held back, delayed, slowed down or cut off.

`TopicProxy` publishes a topic under another name, for a subscriber that is remapped to it. It passes on what the publisher sends, byte
for byte, with the publisher's own header: the subscriber sees the publisher's name.
"""

import collections
import itertools
import os
import socket
import struct
import threading
import time
import xmlrpc.client
import xmlrpc.server

CHUNK = 65536
# How often a delayed line is looked at, s.
POLL_PERIOD_SECS = 0.002
NUMBERS = itertools.count(1)


class TopicProxy:
    """`source` as `topic`, of type `kind` such as std_msgs/String. The source need not be published yet."""

    def __init__(self, source, topic, kind):
        self.source, self.topic = source, topic
        self.name = f"/link_{os.getpid()}_{next(NUMBERS)}"
        self.state = "open"
        self.delay, self.rate = 0.0, 0.0
        self.lines = []
        self.lock = threading.Lock()
        self.listener = socket.create_server(("127.0.0.1", 0))
        threading.Thread(target=self.accept, daemon=True).start()
        self.server = Server(("127.0.0.1", 0), logRequests=False, allow_none=True)
        port = self.listener.getsockname()[1]
        answer = lambda value: lambda *_: [1, "", value]
        self.server.register_function(lambda *_: [1, "", self.bus_info()], "getBusInfo")
        for method, value in [("getPid", os.getpid()), ("publisherUpdate", 0), ("paramUpdate", 0), ("shutdown", 0),
                              ("requestTopic", ["TCPROS", "127.0.0.1", port])]:
            self.server.register_function(answer(value), method)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.uri = f"http://127.0.0.1:{self.server.server_address[1]}/"
        self.master().registerPublisher(self.name, topic, kind, self.uri)

    @staticmethod
    def master():
        """One for each call: a proxy is not for several threads."""
        return xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])

    def open(self):
        """Everything passes at once; what was held back comes now."""
        self.set("open")

    def hold(self):
        """Nothing comes; it is kept."""
        self.set("held")

    def slow(self, bytes_per_second):
        """A line of so few bytes a second."""
        self.rate = bytes_per_second
        self.set("slow")

    def delay_by(self, seconds):
        """Everything comes so much later."""
        self.delay = seconds
        self.set("late")

    def disconnect(self):
        """The connection is reset, and none is taken, until `open`."""
        self.set("cut")
        with self.lock:
            lines, self.lines = self.lines, []
        for line in lines:
            line.reset()

    def set(self, state):
        self.state = state

    def connected(self):
        with self.lock:
            self.lines = [line for line in self.lines if not line.ended]
            return bool(self.lines)

    def bus_info(self):
        """Whom this publisher sends to, as nodes tell it."""
        with self.lock:
            there = [line.name for line in self.lines if not line.ended]
        return [[number, name, "o", "TCPROS", self.topic, True] for number, name in enumerate(there)]

    def close(self):
        self.master().unregisterPublisher(self.name, self.topic, self.uri)
        self.disconnect()
        self.listener.close()
        self.server.shutdown()
        self.server.server_close()

    def accept(self):
        while True:
            try:
                subscriber, _ = self.listener.accept()
            except OSError:
                return
            if self.state == "cut":
                subscriber.close()
                continue
            threading.Thread(target=self.serve, args=(subscriber,), daemon=True).start()

    def serve(self, subscriber):
        try:
            fields = read_header(subscriber)
            fields["topic"] = self.source
            publisher = socket.create_connection(self.find_publisher())
            publisher.sendall(write_header(fields))
        except OSError:
            subscriber.close()
            return
        line = ProxyConnection(self, publisher, subscriber, fields.get("callerid", ""))
        with self.lock:
            self.lines.append(line)
        line.run()

    def find_publisher(self):
        """Where the source is published. A subscriber may come before it."""
        while True:
            publishers = dict(self.master().getSystemState(self.name)[2][0]).get(self.source, [])
            for node in publishers:
                uri = self.master().lookupNode(self.name, node)[2]
                _, _, (_, host, port) = xmlrpc.client.ServerProxy(uri).requestTopic(self.name, self.source, [["TCPROS"]])
                return host, port
            time.sleep(0.05)


class ProxyConnection:
    """One connection of a subscriber through a link."""

    def __init__(self, link, publisher, subscriber, name):
        self.link, self.publisher, self.subscriber, self.name = link, publisher, subscriber, name
        self.ended = False
        # When each piece came, and what.
        self.waiting = collections.deque()
        for end in (publisher, subscriber):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def reset(self):
        for end in (self.publisher, self.subscriber):
            try:
                end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                end.shutdown(socket.SHUT_RDWR)
            except OSError:
                # It has ended by itself.
                pass
            end.close()

    def run(self):
        self.publisher.settimeout(POLL_PERIOD_SECS)
        # The publisher's header passes whatever becomes of the messages.
        try:
            self.subscriber.sendall(self.header())
            while True:
                piece = self.read()
                if piece == b"":
                    break
                if piece:
                    self.waiting.append((time.monotonic(), piece))
                self.write()
        except (OSError, ValueError):
            pass
        self.ended = True
        for end in (self.publisher, self.subscriber):
            end.close()

    def read(self):
        try:
            return self.publisher.recv(CHUNK)
        except socket.timeout:
            return None

    def header(self):
        text = b""
        while len(text) < 4 or len(text) < 4 + struct.unpack("<I", text[:4])[0]:
            piece = self.read()
            if piece == b"":
                raise OSError("the publisher ended the connection")
            text += piece or b""
        end = 4 + struct.unpack("<I", text[:4])[0]
        if text[end:]:
            self.waiting.append((time.monotonic(), text[end:]))
        return text[:end]

    def write(self):
        link = self.link
        budget = int(link.rate * POLL_PERIOD_SECS) + 1
        while self.waiting and link.state != "held":
            came, piece = self.waiting[0]
            if link.state == "late" and time.monotonic() < came + link.delay:
                return
            if link.state == "slow":
                if budget <= 0:
                    return
                part, rest = piece[:budget], piece[budget:]
                budget -= len(part)
                self.subscriber.sendall(part)
                self.waiting.popleft()
                if rest:
                    self.waiting.appendleft((came, rest))
                continue
            self.subscriber.sendall(piece)
            self.waiting.popleft()


class Server(xmlrpc.server.SimpleXMLRPCServer):
    allow_reuse_address = True


def read_header(connection):
    def exactly(count):
        text = b""
        while len(text) < count:
            piece = connection.recv(count - len(text))
            if not piece:
                raise OSError("the subscriber ended the connection")
            text += piece
        return text

    rest, fields = exactly(*struct.unpack("<I", exactly(4))), {}
    while rest:
        length, = struct.unpack("<I", rest[:4])
        key, _, value = rest[4:4 + length].decode().partition("=")
        fields[key], rest = value, rest[4 + length:]
    return fields


def write_header(fields):
    parts = [f"{key}={value}".encode() for key, value in fields.items()]
    body = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    return struct.pack("<I", len(body)) + body
