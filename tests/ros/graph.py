"""A ROS graph for tests: its own master on its own port, nodes as processes, waiting for connections.

Nothing here sleeps for a guessed time: every wait ends when the thing waited for is there, or fails loudly.
"""

import atexit
import http.client
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import xml.parsers.expat
import xmlrpc.client

ROOT = os.path.abspath(os.path.join(os.path.dirname(__file__), "..", ".."))
BINARY = os.environ.get("PROACT_BINARY", os.path.join(ROOT, "target", "release", "proact"))
# A loaded machine may be slow; a missing thing must still fail in the end.
TIMEOUT_SECS = float(os.environ.get("PROACT_TIMEOUT_SECS") or "240")


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


# What a call to a node gives that has not registered yet, starts anew or is about to end.
NOT_YET = (OSError, xmlrpc.client.Error, http.client.HTTPException, xml.parsers.expat.ExpatError)


def wait_until(true, what, timeout=TIMEOUT_SECS):
    """Waits until true() is true; looks fifty times a second. A node that cannot be reached counts as false."""
    end, why = time.monotonic() + timeout, ""
    while time.monotonic() < end:
        try:
            value = true()
            if value:
                return value
            why = ""
        except NOT_YET as error:
            why = f": {error!r}"
        time.sleep(0.02)
    raise AssertionError(f"waited {timeout} s in vain for {what}{why}")


def message_packages():
    """Makes Python modules of this repository's message packages, as catkin would, and puts them in reach."""
    out = tempfile.mkdtemp(prefix="proact-messages-")
    atexit.register(shutil.rmtree, out, ignore_errors=True)
    src = os.path.join(ROOT, "ros1_ws", "src")
    subprocess.run([sys.executable, os.path.join(ROOT, "ros1_ws", "python_messages.py"), src, out], check=True)
    sys.path.insert(0, os.path.join(out, "lib"))
    return out


class Graph:
    """A master and the nodes started on it."""

    def __init__(self):
        self.port = free_port()
        self.uri = f"http://127.0.0.1:{self.port}/"
        self.home = tempfile.mkdtemp(prefix="proact-ros-")
        self.env = dict(
            os.environ, ROS_MASTER_URI=self.uri, ROS_IP="127.0.0.1", ROS_HOME=self.home,
            PATH="/usr/bin:/bin:" + os.environ["PATH"],
        )
        os.environ.update({key: self.env[key] for key in ("ROS_MASTER_URI", "ROS_IP", "ROS_HOME")})
        self.processes = []
        self.master = None
        self.start_master()

    def start_master(self):
        self.master = self.spawn(["rosmaster", "--core", "-p", str(self.port)], "master.log")
        wait_until(lambda: xmlrpc.client.ServerProxy(self.uri).getPid("/test")[0] == 1, "the master")
        # What roscore starts beside the master.
        self.rosout = self.spawn(["/usr/lib/rosout/rosout"], "rosout.log")

    def spawn(self, command, log, **kwargs):
        out = open(os.path.join(self.home, log), "a")
        process = subprocess.Popen(
            command, env=self.env, stdout=out, stderr=subprocess.STDOUT, start_new_session=True, **kwargs
        )
        process.log = out.name
        self.processes.append(process)
        return process

    def node(self, *words):
        """Starts `proact node WORDS`."""
        return self.spawn([BINARY, "node", *words], f"{words[0]}.log")

    def stop(self, process, how=signal.SIGINT):
        if process.poll() is None:
            os.killpg(process.pid, how)
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        return process.returncode

    def close(self):
        for process in reversed(self.processes):
            self.stop(process)

    def system_state(self):
        return xmlrpc.client.ServerProxy(self.uri).getSystemState("/test")[2]

    def nodes(self):
        return {node for kind in self.system_state() for _, nodes in kind for node in nodes}


class Inbox:
    """A rospy subscriber that keeps what comes."""

    def __init__(self, topic, kind, keep=None):
        import rospy

        self.messages = []
        self.times = []
        self.came = 0
        self.condition = threading.Condition()
        self.keep = keep
        self.subscriber = rospy.Subscriber(topic, kind, self._take, queue_size=1000, tcp_nodelay=True)
        self.topic = topic

    def _take(self, message):
        with self.condition:
            self.messages.append(message)
            self.times.append(time.monotonic())
            self.came += 1
            if self.keep and len(self.messages) > self.keep:
                del self.messages[0], self.times[0]
            self.condition.notify_all()

    def connected(self):
        """Whether a publisher answered: rospy counts a connection before it asks for one."""
        return any(connection.md5sum for connection in self.subscriber.impl.connections)

    def clear(self):
        with self.condition:
            self.messages.clear()
            self.times.clear()

    def wait(self, true=lambda message: True, timeout=TIMEOUT_SECS):
        """The first message, past or to come, for which true(message)."""
        end = time.monotonic() + timeout
        with self.condition:
            looked = 0
            while True:
                new = min(self.came - looked, len(self.messages))
                for message in self.messages[len(self.messages) - new:]:
                    if true(message):
                        return message
                looked = self.came
                if not self.condition.wait(max(0.0, end - time.monotonic())) and time.monotonic() >= end:
                    raise AssertionError(f"{self.topic}: waited {timeout} s in vain, {len(self.messages)} messages")

    def wait_count(self, count, timeout=TIMEOUT_SECS):
        wait_until(lambda: len(self.messages) >= count, f"{count} messages on {self.topic}", timeout)
