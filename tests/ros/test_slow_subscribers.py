"""One stopped, slow or unreachable subscriber takes nothing from the others, from the node, or from its memory.

What is compared are stamps and counts, not times: the others get every instant of the simulator, also while messages are
dropped for the slow one, which `/statistics` says.

`--soak SECONDS`: a subscriber that stops and goes on at random, in place of the tests.
"""

import os
import random
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import unittest
import xmlrpc.client
import xmlrpc.server

import graph
import tcpros

graph.message_packages()
GRAPH = graph.Graph()

import rospy  # noqa: E402
from proact_msgs.msg import State  # noqa: E402
from rosgraph_msgs.msg import Clock, Log, TopicStatistics  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

NODE = "/proact_sim"
# Simulated time from one instant to the next, ns.
STEP = 10_000_000
# Instants that the others must have got while messages are dropped for the slow one.
INSTANTS = 300
# A receive buffer that /tf fills in a second.
SMALL = 4096
# Growth of the node's memory with stopped subscribers, kB. A queue of 100 messages of /tf has 0.5 MB, and all subscribers
# share its messages.
GROWTH = 8192


def stamp_at(offset):
    """Reads the stamp at `offset` of a message, ns."""
    def read(message):
        sec, nsec = struct.unpack_from("<II", message, offset)
        return sec * 1_000_000_000 + nsec
    return read


CLOCK = ("/clock", Clock, stamp_at(0))
# The first transform's header, after the number of transforms.
TF = ("/tf", TFMessage, stamp_at(8))
STATE = ("/proact/state", State, stamp_at(4))


def setUpModule():
    global SIM, READERS, LOG, STATISTICS
    rospy.init_node("test_slow_subscribers", disable_signals=True)
    LOG = graph.Inbox("/rosout", Log, keep=2000)
    SIM = GRAPH.node("sim", "--setup", "still")
    graph.wait_until(lambda: any("/clock" == topic for topic, _ in GRAPH.system_state()[0]), "the simulator")
    READERS = tcpros.Readers(GRAPH.uri, NODE)
    STATISTICS = graph.Inbox("/statistics", TopicStatistics, keep=2000)


def tearDownModule():
    GRAPH.close()


def memory_kb(process):
    """Resident memory of the simulator: the first process of its group."""
    with open(f"/proc/{process.pid}/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))


def dropped(name, topic):
    """Messages that were dropped for a subscriber, as /statistics has it."""
    return sum(m.dropped_msgs for m in list(STATISTICS.messages) if (m.node_sub, m.topic) == (name, topic))


def stop_process(process, how):
    os.killpg(process.pid, how)


def connected(prefix, topic):
    """The one subscriber of a topic whose name begins so, once it is connected."""
    def found():
        return [name for name in tcpros.connections(GRAPH.uri, NODE, topic) if name.startswith(prefix)]
    return graph.wait_until(found, f"{prefix} at {topic}")[0]


class Beside(unittest.TestCase):
    def lose_nothing(self, others, instants=INSTANTS):
        """Waits for so many more instants at each of `others`; every one of all that they got is there, in order."""
        counts = [len(other.values) for other in others]
        for other, count in zip(others, counts):
            graph.wait_until(lambda: len(other.values) >= count + instants, f"{instants} messages for {other.name}")
        for other in others:
            # Between the instants /proact/state also comes with each frame.
            got = [value for value in list(other.values) if value % STEP == 0]
            steps = {later - earlier for earlier, later in zip(got, got[1:])}
            self.assertEqual(steps, {STEP}, f"{other.name} of {len(others)}")

    def check_beside(self, what, count):
        topic = what[0]
        others = [READERS.subscribe(*what) for _ in range(count)]
        for other in others:
            graph.wait_until(lambda: other.values, other.name)
        slow = READERS.subscribe(*what, stopped=True, receive_bytes=SMALL)
        try:
            graph.wait_until(lambda: dropped(slow.name, topic) > 0, f"messages of {topic} dropped for {slow.name}")
            self.lose_nothing(others)
            self.assertEqual([dropped(other.name, topic) for other in others], [0] * count)
            # It goes on, with what comes now.
            last = others[0].values[-1]
            slow.resume()
            graph.wait_until(lambda: slow.values and slow.values[-1] > last, f"{slow.name} goes on")
            self.assertEqual(slow.values, sorted(slow.values))
            self.lose_nothing(others, 10)
        finally:
            tcpros.close(slow, *others)

    def test_a_stopped_subscriber_of_tf_beside_1_5_and_20(self):
        for count in (1, 5, 20):
            with self.subTest(count):
                self.check_beside(TF, count)

    def test_a_stopped_subscriber_of_the_state(self):
        self.check_beside(STATE, 5)

    def test_rostopic_echo_is_stopped_and_goes_on(self):
        other = READERS.subscribe(*TF)
        echo = GRAPH.spawn(["rostopic", "echo", "/tf/transforms[0]/header/stamp"], "echo.log")
        name = connected("/rostopic", "/tf")
        size = lambda: os.path.getsize(echo.log)  # noqa: E731
        graph.wait_until(size, "rostopic echo")
        stop_process(echo, signal.SIGSTOP)
        try:
            graph.wait_until(lambda: dropped(name, "/tf") > 0, f"messages dropped for {name}")
            self.lose_nothing([other])
            before, last = size(), other.values[-1]
            stop_process(echo, signal.SIGCONT)

            def newest():
                with open(echo.log) as log:
                    log.seek(before)
                    secs = [int(line.split()[1]) for line in log.read().splitlines() if line.startswith("secs: ")]
                return max(secs, default=0)

            graph.wait_until(lambda: newest() >= last // 1_000_000_000, "rostopic echo goes on")
            self.lose_nothing([other], 10)
        finally:
            GRAPH.stop(echo, signal.SIGKILL)
            tcpros.close(other)

    def test_a_callback_of_50_ms_beside_a_second_subscriber(self):
        other = READERS.subscribe(*TF)
        code = ("import rospy, time; from tf2_msgs.msg import TFMessage\n"
                "def slow(message): time.sleep(0.05); print(message.transforms[0].header.stamp.to_nsec(), flush=True)\n"
                "rospy.init_node('slow_callback'); rospy.Subscriber('/tf', TFMessage, slow); rospy.spin()\n")
        slow = GRAPH.spawn(["/usr/bin/python3", "-W", "ignore", "-c", code], "slow.log")
        try:
            connected("/slow_callback", "/tf")

            def came():
                with open(slow.log) as log:
                    return [int(line) for line in log if line.endswith("\n") and line.strip().isdigit()]

            graph.wait_until(lambda: len(came()) >= 20, "the slow callback")
            self.lose_nothing([other], 2 * INSTANTS)
            count = len(came())
            graph.wait_until(lambda: len(came()) > count, "the slow callback goes on")
            self.assertEqual(came(), sorted(came()))
        finally:
            GRAPH.stop(slow, signal.SIGKILL)
            tcpros.close(other)

    def test_memory_is_bounded_with_twenty_stopped_subscribers(self):
        other = READERS.subscribe(*TF)
        slow = [READERS.subscribe(*what, stopped=True, receive_bytes=SMALL) for what in (TF, STATE) for _ in range(10)]
        try:
            for one, topic in zip(slow, [TF[0]] * 10 + [STATE[0]] * 10):
                graph.wait_until(lambda: dropped(one.name, topic) > 0, f"messages dropped for {one.name}")
            before = memory_kb(SIM)
            self.lose_nothing([other], 4 * INSTANTS)
            grown = memory_kb(SIM) - before
            print(f"memory: {before} kB with twenty stopped subscribers, {grown:+} kB after {4 * INSTANTS} instants")
            self.assertLess(grown, GROWTH)
        finally:
            tcpros.close(other, *slow)

    def test_a_subscriber_that_takes_nothing_is_closed_after_the_parameter_s_time(self):
        uri = GRAPH.uri
        node = GRAPH.node("sim", "--setup", "still", "__name:=hasty", "__ns:=/hasty", "/clock:=/hasty/clock", "/tf:=/hasty/tf",
                          "_write_timeout_secs:=0.5", "_queue_size:=3")
        try:
            graph.wait_until(lambda: "/hasty/hasty" in GRAPH.nodes() and any(
                topic == "/hasty/tf" for topic, _ in GRAPH.system_state()[0]), "the second simulator")
            readers = tcpros.Readers(uri, "/hasty/hasty")
            slow = readers.subscribe("/hasty/tf", TFMessage, TF[2], stopped=True, receive_bytes=SMALL)
            LOG.wait(lambda m: m.msg == f"closed {slow.name}, which took nothing of /hasty/tf for 500ms")
            self.assertEqual(tcpros.connections(uri, "/hasty/hasty", "/hasty/tf"), [])
        finally:
            GRAPH.stop(node)

    def test_a_node_that_was_closed_connects_again_once_it_runs(self):
        sim = GRAPH.node("sim", "--setup", "still", "__name:=sim", "__ns:=/brief", "/clock:=/brief/clock", "/tf:=/brief/tf",
                         "_write_timeout_secs:=0.5")
        stage = GRAPH.node("participant", "--setup", "still", "__name:=stage", "__ns:=/brief", "/clock:=/brief/clock")
        of_stage = lambda: "/brief/stage" in (  # noqa: E731
            tcpros.connections(GRAPH.uri, "/brief/sim", "/brief/proact/state") if "/brief/sim" in GRAPH.nodes() else [])
        try:
            graph.wait_until(of_stage, "the stage at its simulator")
            # Long enough for the stage to have looked whom the simulator sends to, which it does every second.
            time_there = tcpros.Readers(GRAPH.uri, "/brief/sim").subscribe("/brief/clock", Clock, CLOCK[2])
            graph.wait_until(lambda: time_there.values and time_there.values[-1] - time_there.values[0] > 8_000_000_000, "8 s")
            stop_process(stage, signal.SIGSTOP)
            LOG.wait(lambda m: m.msg.startswith("closed /brief/stage, which took nothing of /brief/proact/"))
            closed = {m.msg.split()[6] for m in LOG.messages if m.msg.startswith("closed /brief/stage")}
            stop_process(stage, signal.SIGCONT)
            for topic in closed:
                LOG.wait(lambda m: m.name == "/brief/stage" and m.msg.startswith(f"{topic}: connecting again"))
            graph.wait_until(lambda: all("/brief/stage" in tcpros.connections(GRAPH.uri, "/brief/sim", topic)
                                         for topic in closed), "the connections")
        finally:
            GRAPH.stop(stage)
            GRAPH.stop(sim)

    def test_a_machine_that_went_off_the_network(self):
        if os.geteuid() != 0:
            self.skipTest("network namespaces need root")
        space, here, there = "proact_slow", "proact_a", "proact_b"
        run = lambda *words: subprocess.run(words, check=True)  # noqa: E731
        inside = lambda *words: run("ip", "netns", "exec", space, *words)  # noqa: E731
        try:
            subprocess.run(["ip", "netns", "del", space], stderr=subprocess.DEVNULL)
            run("ip", "netns", "add", space)
            run("ip", "link", "add", here, "type", "veth", "peer", "name", there, "netns", space)
            run("ip", "addr", "add", "10.77.51.1/24", "dev", here)
            run("ip", "link", "set", here, "up")
            inside("ip", "addr", "add", "10.77.51.2/24", "dev", there)
            inside("ip", "link", "set", there, "up")
            # A container may have both ends and let nothing through.
            with socket.create_server(("10.77.51.1", 0)) as server:
                inside("/usr/bin/python3", "-c",
                       f"import socket; socket.create_connection(('10.77.51.1', {server.getsockname()[1]}), 20).close()")
        except (OSError, subprocess.CalledProcessError) as error:
            if shutil.which("ip"):
                subprocess.run(["ip", "netns", "del", space])
            self.skipTest(f"no network namespaces here: {error}")
        node = far = None
        try:
            # A simulator that other machines reach, at an address of its own.
            env = dict(GRAPH.env, ROS_IP="10.77.51.1")
            with open(os.path.join(GRAPH.home, "far.log"), "w") as log:
                node = subprocess.Popen(
                    [graph.BINARY, "node", "sim", "--setup", "still", "__name:=wide", "__ns:=/wide", "/clock:=/wide/clock",
                     "/tf:=/wide/tf", "_write_timeout_secs:=3"], env=env, stdout=log, stderr=log, start_new_session=True)
            graph.wait_until(lambda: "/wide/wide" in GRAPH.nodes() and any(
                topic == "/wide/tf" for topic, _ in GRAPH.system_state()[0]), "the simulator of the network")
            readers = tcpros.Readers(GRAPH.uri, "/wide/wide")
            other = readers.subscribe("/wide/tf", TFMessage, TF[2])
            _, host, port = tcpros.node_proxy(GRAPH.uri, "/wide/wide").requestTopic("/far", "/wide/tf", [["TCPROS"]])[2]
            asks = tcpros.header({"callerid": "/far", "topic": "/wide/tf", "md5sum": "*", "type": "*"})
            code = (f"import socket, sys; s = socket.create_connection(({host!r}, {port})); s.sendall({asks!r})\n"
                    "while s.recv(65536): print('came', flush=True)\n")
            far = subprocess.Popen(["ip", "netns", "exec", space, "/usr/bin/python3", "-c", code],
                                   stdout=subprocess.PIPE, start_new_session=True)
            self.assertEqual(far.stdout.readline(), b"came\n")
            # From now on no packet comes back, and no end of the connection either.
            inside("ip", "link", "set", there, "down")
            LOG.wait(lambda m: m.msg == "closed /far, which took nothing of /wide/tf for 3s")
            self.lose_nothing([other])
        finally:
            if far:
                os.killpg(far.pid, signal.SIGKILL)
            if node:
                os.killpg(node.pid, signal.SIGINT)
                node.wait(graph.TIMEOUT_SECS)
            subprocess.run(["ip", "netns", "del", space])

    def test_a_wrong_sum_or_type_is_answered_and_logged_once(self):
        wrong = "0123456789abcdef0123456789abcdef"
        for topic, kind, _ in (TF, CLOCK):
            for md5, type_name in ((wrong, kind._type), (kind._md5sum, "lab/Other")):
                name = f"/wrong{topic.replace('/', '_')}_{md5[:4]}"
                expected = (f"{topic}: {name} expects {type_name} with MD5 sum {md5}, {NODE} publishes {kind._type} "
                            f"with MD5 sum {kind._md5sum}")
                for _ in range(3):
                    stream, answer = tcpros.connect(GRAPH.uri, NODE, topic, kind, name, md5, type_name)
                    self.assertEqual(answer, {"error": expected})
                    self.assertEqual(stream.recv(1), b"", "the connection ends")
                    stream.close()
                LOG.wait(lambda m: m.msg == f"refused a subscriber: {expected}")
        self.assertEqual(len([m for m in LOG.messages if "/wrong_tf_0123 expects" in m.msg]), 1)

    def test_a_publisher_of_another_type_is_logged_once(self):
        wrong = rospy.Publisher("/proact/command", String, queue_size=1)
        try:
            begin = "/proact/command: /test_slow_subscribers publishes std_msgs/String with MD5 sum " + String._md5sum
            LOG.wait(lambda m: m.msg.startswith(f"{begin}, this node expects proact_msgs/Command with MD5 sum"))
            time.sleep(3)
            self.assertEqual(len([m for m in LOG.messages if m.msg.startswith(begin)]), 1)
        finally:
            wrong.unregister()

    def test_statistics_of_what_is_dropped(self):
        slow = READERS.subscribe(*TF, stopped=True, receive_bytes=SMALL)
        try:
            graph.wait_until(lambda: dropped(slow.name, "/tf") > 100, "two reports")
            reports = [m for m in STATISTICS.messages if m.node_sub == slow.name]
            for report in reports:
                self.assertEqual((report.topic, report.node_pub), ("/tf", NODE))
                self.assertGreater(report.dropped_msgs, 0)
                self.assertLess(report.window_start, report.window_stop)
            # One line for the connection, however many reports.
            line = f"{slow.name} takes /tf too slowly"
            LOG.wait(lambda m: m.msg.startswith(line))
            graph.wait_until(lambda: dropped(slow.name, "/tf") > 300, "more reports")
            self.assertEqual(len([m for m in LOG.messages if m.msg.startswith(line)]), 1)
        finally:
            tcpros.close(slow)


class LatePublisher:
    """A publisher of /late/clock that refuses the first request of it, as a node does that is not ready."""

    def __init__(self):
        self.requests, self.nodes = 0, []
        self.topics = socket.create_server(("127.0.0.1", 0))
        self.calls = xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        for name in ("requestTopic", "getBusInfo", "publisherUpdate", "paramUpdate"):
            self.calls.register_function(getattr(self, name), name)
        for work in (self.calls.serve_forever, self.accept):
            threading.Thread(target=work, daemon=True).start()
        self.uri = "http://127.0.0.1:{}/".format(self.calls.server_address[1])
        self.master = xmlrpc.client.ServerProxy(GRAPH.uri)
        self.master.registerPublisher("/late_publisher", "/late/clock", Clock._type, self.uri)

    def requestTopic(self, _caller, _topic, _protocols):
        self.requests += 1
        if self.requests == 1:
            return [-1, "not yet", 0]
        return [1, "ready", ["TCPROS", "127.0.0.1", self.topics.getsockname()[1]]]

    def getBusInfo(self, _caller):
        return [1, "", [[at, node, "o", "TCPROS", "/late/clock", True] for at, node in enumerate(self.nodes)]]

    def publisherUpdate(self, *_):
        return [1, "", 0]

    paramUpdate = publisherUpdate

    def accept(self):
        while True:
            stream, _ = self.topics.accept()
            asked = tcpros.read_header(stream)
            stream.sendall(tcpros.header({"callerid": "/late_publisher", "type": Clock._type, "md5sum": Clock._md5sum}))
            # What only compares types asks for any.
            if asked["md5sum"] != "*":
                self.nodes.append(asked["callerid"])

    def close(self):
        self.master.unregisterPublisher("/late_publisher", "/late/clock", self.uri)
        self.calls.shutdown()


class OneConnection(unittest.TestCase):
    def test_a_publisher_that_refuses_the_first_request_is_asked_again(self):
        late = LatePublisher()
        stage = GRAPH.node("participant", "--setup", "still", "__name:=stage", "__ns:=/late", "/clock:=/late/clock")
        try:
            graph.wait_until(lambda: "/late/stage" in late.nodes, "the stage at the late publisher")
        finally:
            GRAPH.stop(stage)
            late.close()

    def test_a_subscriber_has_one_connection_after_a_restart_of_the_master(self):
        node = GRAPH.node("participant", "--setup", "still")
        clocks = lambda: [name for name in tcpros.connections(GRAPH.uri, NODE, "/clock")  # noqa: E731
                          if name == "/proact_participant"]
        try:
            # It runs, and has looked at the master: one that is restarted while a node starts ends the node.
            beats = graph.Inbox("/proact/heartbeat", String)
            beats.wait_count(300)
            graph.wait_until(lambda: clocks() == ["/proact_participant"], "the participant at /clock")
            # What a master that comes up says to a subscriber before and after the publisher is back: rosrust connects again.
            slave = tcpros.node_proxy(GRAPH.uri, "/proact_participant")
            sim = xmlrpc.client.ServerProxy(GRAPH.uri).lookupNode("/test", NODE)[2]
            for publishers in ([], [sim], [], [sim]):
                self.assertEqual(slave.publisherUpdate("/master", "/clock", publishers)[0], 1)
            graph.wait_until(lambda: clocks() == ["/proact_participant"], "one connection")
            GRAPH.stop(GRAPH.master)
            GRAPH.stop(GRAPH.rosout)
            GRAPH.start_master()
            graph.wait_until(lambda: {NODE, "/proact_participant"} <= GRAPH.nodes(), "both nodes again")
            graph.wait_until(lambda: any(topic == "/clock" and {NODE} == set(nodes)
                                         for topic, nodes in GRAPH.system_state()[0]), "/clock again")
            graph.wait_until(lambda: clocks() == ["/proact_participant"], "one connection after the restart")
        finally:
            GRAPH.stop(node)

    def test_a_second_node_of_the_name_ends_the_first_with_a_line(self):
        words = ["sim", "--setup", "still", "__name:=sim", "__ns:=/twin", "/clock:=/twin/clock", "/tf:=/twin/tf"]
        first = GRAPH.node(*words)
        second = None
        try:
            graph.wait_until(lambda: any(topic == "/twin/clock" for topic, _ in GRAPH.system_state()[0]), "the first")
            # The first has registered everything: two nodes that register at the same time end each other, by the master's rule.
            time_there = tcpros.Readers(GRAPH.uri, "/twin/sim").subscribe("/twin/clock", Clock, CLOCK[2])
            graph.wait_until(lambda: time_there.values, "the first's time")
            second = GRAPH.node(*words)
            graph.wait_until(lambda: first.poll() is not None, "the end of the first")
            with open(first.log) as log:
                lines = [line for line in log if "this node was asked to shut down" in line]
            self.assertEqual(len(lines), 1, lines)
            self.assertIn("[/twin/sim] Reason: new node registered with same name", lines[0])
            graph.wait_until(lambda: "/twin/sim" in GRAPH.nodes(), "the second")
            self.assertIsNone(second.poll())
        finally:
            for node in filter(None, [first, second]):
                GRAPH.stop(node)


def soak(seconds):
    """A subscriber of /tf stops and goes on at random; every tick of /clock comes, and memory stays flat."""
    chance = random.Random(51)
    clock, steady = READERS.subscribe(*CLOCK), READERS.subscribe(*TF)
    slow = READERS.subscribe(*TF, receive_bytes=SMALL)
    began, report, first, going, changes, closed = time.monotonic(), 0.0, None, True, 0, []
    while time.monotonic() - began < seconds:
        # Long enough, now and then, to fill what the kernel keeps for a connection, and less than the 60 s after which it is closed.
        # The reader needs a moment to take anything after it goes on.
        time.sleep(chance.uniform(1.0, 8.0) if going else chance.uniform(0.05, 45.0))
        assert not clock.closed and not steady.closed, "a connection was closed"
        if slow.closed:
            # It took too little for too long. A ROS client connects again.
            closed, going, slow = closed + [slow], False, READERS.subscribe(*TF, stopped=True, receive_bytes=SMALL)
        (slow.stop if going else slow.resume)()
        going, changes = not going, changes + 1
        now, memory = time.monotonic() - began, memory_kb(SIM)
        # The node's start is over by then.
        if first is None and now > min(60.0, seconds / 4):
            first = memory
        if now >= report:
            report = now + 60.0
            print(f"{now:6.0f} s: {len(clock.values)} ticks of /clock, {changes} changes, {memory} kB", flush=True)
    for other in (clock, steady):
        steps = {later - earlier for earlier, later in zip(other.values, other.values[1:])}
        assert steps == {STEP}, (other.name, steps)
    lost = sum(dropped(other.name, "/tf") for other in [slow, *closed])
    grown = memory_kb(SIM) - first
    print(f"{seconds:.0f} s: {len(clock.values)} ticks of /clock and none missed, {lost} messages dropped for the slow one, "
          f"{changes} changes, {len(closed)} times closed and connected again, memory {first} {grown:+} kB")
    assert lost > 0, "the slow one was never slow"
    assert grown < GROWTH, grown


if __name__ == "__main__":
    if "--soak" in sys.argv:
        setUpModule()
        try:
            soak(float(sys.argv[sys.argv.index("--soak") + 1]))
        finally:
            tearDownModule()
    else:
        unittest.main(verbosity=2)
