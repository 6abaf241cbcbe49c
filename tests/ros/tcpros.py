"""Subscribers by plain sockets, for tests that need many of them, or ones that stop: TCPROS without a ROS client library."""

import selectors
import socket
import struct
import threading
import time
import xmlrpc.client

import graph


def node_proxy(uri, node):
    """The XML-RPC server of a node."""
    return xmlrpc.client.ServerProxy(xmlrpc.client.ServerProxy(uri).lookupNode("/test", node)[2])


def connections(uri, node, topic=None):
    """Names of the nodes that `node` publishes to, once for each connection; none from one that is not up yet."""
    code, _, found = node_proxy(uri, node).getBusInfo("/test")
    if code != 1:
        return []
    return [entry[1] for entry in found if entry[2] == "o" and topic in (None, entry[4])]


def header(fields):
    rows = b"".join(struct.pack("<I", len(row)) + row
                    for row in (f"{key}={value}".encode() for key, value in fields.items()))
    return struct.pack("<I", len(rows)) + rows


def read_exactly(stream, count):
    parts = b""
    while len(parts) < count:
        part = stream.recv(count - len(parts))
        if not part:
            raise EOFError
        parts += part
    return parts


def read_header(stream):
    rest, fields = read_exactly(stream, *struct.unpack("<I", read_exactly(stream, 4))), {}
    while rest:
        (length,) = struct.unpack_from("<I", rest)
        key, value = rest[4:4 + length].decode(errors="replace").split("=", 1)
        fields[key], rest = value, rest[4 + length:]
    return fields


def connect(uri, node, topic, kind, name, md5=None, type_name=None, receive_bytes=None):
    """A socket to the publisher `node` of `topic`, and the header that it answered."""
    # A node registers a topic with the master a moment before it serves it.
    ask = lambda: node_proxy(uri, node).requestTopic(name, topic, [["TCPROS"]])  # noqa: E731
    _, host, port = graph.wait_until(lambda: [answer for answer in [ask()] if answer[0] == 1], f"{topic} of {node}")[0][2]
    stream = socket.socket()
    if receive_bytes:
        stream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
    stream.settimeout(graph.TIMEOUT_SECS)
    stream.connect((host, port))
    stream.sendall(header({"callerid": name, "topic": topic, "md5sum": md5 or kind._md5sum,
                           "type": type_name or kind._type, "tcp_nodelay": "1"}))
    return stream, read_header(stream)


class Subscriber:
    """Reads messages, keeps what `read` gives for each, and can stop to take any."""

    def __init__(self, readers, stream, name, read):
        self.readers, self.stream, self.name, self.read = readers, stream, name, read
        self.rest, self.values, self.closed = b"", [], False

    def stop(self):
        self.readers.unwatch(self)

    def resume(self):
        self.readers.watch(self)

    def take(self):
        try:
            part = self.stream.recv(1 << 20)
        except ConnectionResetError:
            part = b""
        if not part:
            self.closed = True
            self.readers.unwatch(self)
            return
        self.rest += part
        at = 0
        while len(self.rest) - at >= 4:
            (length,) = struct.unpack_from("<I", self.rest, at)
            if len(self.rest) - at - 4 < length:
                break
            self.values.append(self.read(self.rest[at + 4:at + 4 + length]))
            at += 4 + length
        self.rest = self.rest[at:]


class Readers:
    """One thread for all subscribers."""

    def __init__(self, uri, node):
        self.uri, self.node, self.count = uri, node, 0
        self.selector = selectors.DefaultSelector()
        self.lock = threading.RLock()
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self):
        while True:
            # Changes of what is watched are seen at the next turn.
            for key, _ in self.selector.select(timeout=0.05):
                with self.lock:
                    if key.fileobj in self.selector.get_map():
                        key.data.take()
            if not self.selector.get_map():
                time.sleep(0.05)

    def watch(self, subscriber):
        with self.lock:
            self.selector.register(subscriber.stream, selectors.EVENT_READ, subscriber)

    def unwatch(self, subscriber):
        with self.lock:
            self.selector.unregister(subscriber.stream)

    def subscribe(self, topic, kind, read, stopped=False, receive_bytes=None, name=None):
        """A subscriber that reads; `stopped`: one that takes nothing after the header."""
        self.count += 1
        name = name or f"/raw_{self.count}"
        stream, answer = connect(self.uri, self.node, topic, kind, name, receive_bytes=receive_bytes)
        assert "error" not in answer, answer
        subscriber = Subscriber(self, stream, name, read)
        if not stopped:
            self.watch(subscriber)
        return subscriber


def close(*subscribers):
    for subscriber in subscribers:
        try:
            subscriber.stop()
        except KeyError:
            pass
        subscriber.stream.close()
