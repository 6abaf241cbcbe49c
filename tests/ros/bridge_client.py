"""A client of rosbridge for the tests: JSON over a WebSocket, nothing else."""

import itertools
import json
import socket
import threading

import graph
import websocket


def listens(port):
    """Whether a server listens there."""
    with socket.socket() as s:
        return s.connect_ex(("127.0.0.1", port)) == 0


class Client:
    """Keeps what comes."""

    def __init__(self, port):
        self.socket = websocket.create_connection(f"ws://127.0.0.1:{port}/", timeout=graph.TIMEOUT_SECS)
        self.messages, self.condition = [], threading.Condition()
        threading.Thread(target=self.listen, daemon=True).start()
        self.ids = itertools.count()

    def listen(self):
        try:
            while True:
                message = json.loads(self.socket.recv())
                with self.condition:
                    self.messages.append(message)
                    self.condition.notify_all()
        except (websocket.WebSocketException, OSError, ValueError):
            pass

    def send(self, op, **fields):
        self.socket.send(json.dumps(dict(fields, op=op)))

    def wait(self, true):
        with self.condition:
            found = lambda: next((m for m in self.messages if true(m)), None)
            if not self.condition.wait_for(lambda: found() is not None, graph.TIMEOUT_SECS):
                raise AssertionError(f"waited in vain; the last of {len(self.messages)}: {self.messages[-3:]}")
            return found()

    def topic(self, name, true=lambda msg: True):
        return self.wait(lambda m: m["op"] == "publish" and m["topic"] == name and true(m["msg"]))["msg"]

    def call(self, service, /, **args):
        name = f"call-{next(self.ids)}"
        self.send("call_service", service=service, id=name, args=args)
        answer = self.wait(lambda m: m["op"] == "service_response" and m.get("id") == name)
        return answer["result"], answer["values"]

    def close(self):
        self.socket.close()
