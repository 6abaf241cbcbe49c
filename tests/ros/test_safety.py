"""Whatever moves the arm stops it when it dies or freezes: other people's nodes, in the graph's simulated time."""

import itertools
import json
import os
import random
import signal
import subprocess
import threading
import unittest

import graph

graph.message_packages()
GRAPH = graph.Graph()

import rospy  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from gazebo_msgs.srv import GetModelState  # noqa: E402
from geometry_msgs.msg import PoseStamped, Vector3, Vector3Stamped  # noqa: E402
from proact_msgs.msg import EmgSamples, Frame, View  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import JointState, Joy  # noqa: E402
from std_msgs.msg import Header, String  # noqa: E402
from std_srvs.srv import Empty  # noqa: E402

ARM = ["mpl_right_arm__" + n for n in "shoulder humerus elbow forearm wristy wristx wristz".split()]
# In typed messages a name is its place in Gesture::ALL, InputSource::ALL or StopCause::ALL of proact_types.
GESTURES = "hand_close hand_open no_motion wrist_extension wrist_flexion".split()
SOURCES = "armband gesture_topic page eye_tracker shoulder_tracker limb_tracker stage participant method".split()
CAUSES = "silent closed frozen flat railed noiseless lossy wrong_rate lost".split()
# From the first value that is missing or wrong to the arm at rest, simulated ms.
LIMIT = 250
# Gaze may rest for a second before.
GAZE_LIMIT = 1000 + LIMIT
DECISION = 50
# rad/s: below, the arm is at rest; above, it moves as method A does (0.4) or as a plan does.
REST_SPEED_RAD_PER_S = 0.01
MOVING_SPEEDS_RAD_PER_S = {"A": 0.35, "C": 0.1}
# The arm is watched for so long after it stopped, and while a gesture is held that must not move it, simulated ms.
OBSERVATION_MS = 250


def setUpModule():
    rospy.init_node("test_safety", disable_signals=True)


def tearDownModule():
    GRAPH.close()


def millis(stamp):
    return stamp.to_nsec() // 1_000_000


def speed(message):
    return max(abs(message.velocity[message.name.index(joint)]) for joint in ARM)


class GesturePublisher:
    """`gesture_publisher.py` as a process of its own."""

    def __init__(self):
        path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "gesture_publisher.py")
        self.process = subprocess.Popen(["/usr/bin/python3", path], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        env=GRAPH.env, start_new_session=True, universal_newlines=True)
        GRAPH.processes.append(self.process)
        self.said = []
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        for line in self.process.stdout:
            at, word = line.split()
            self.said.append((int(at), word))

    def set_gesture(self, word):
        self.process.stdin.write(word + "\n")
        self.process.stdin.flush()

    def end(self, how):
        """Ends it by a signal, whose answer is awaited."""
        os.killpg(self.process.pid, how)
        self.process.wait(graph.TIMEOUT_SECS)
        self.reader.join(graph.TIMEOUT_SECS)

    def last(self, word):
        """When it said `word` last."""
        return max(at for at, said in self.said if said == word)


class ClockedCallback:
    """Publishes at each tick of /clock what `make(ms)` answers: messages by publisher."""

    def __init__(self, make):
        self.make = make
        self.subscriber = rospy.Subscriber("/clock", Clock, self.tick, tcp_nodelay=True)

    def tick(self, message):
        for publisher, each in self.make(millis(message.clock)):
            publisher.publish(each)

    def stop(self):
        self.subscriber.unregister()


class Safety(unittest.TestCase):
    """Nodes that move the arm, and what is seen of them."""

    method, nodes, view_topic, view_type = "A", (), "/proact/method", View

    @classmethod
    def setUpClass(cls):
        cls.states = graph.Inbox("/mpl_right_arm/joint_states", JointState, keep=20000)
        cls.view = graph.Inbox(cls.view_topic, cls.view_type, keep=20000)
        cls.diagnostics = graph.Inbox("/diagnostics", DiagnosticArray, keep=100)
        cls.start()
        first = cls.states.wait()
        cls.start_angle = first.position[first.name.index(ARM[0])]

    @classmethod
    def start(cls):
        words = ["--method", cls.method, "--setup", "still"]
        cls.processes = [GRAPH.node(*name.split(), *words) for name in cls.nodes]
        cls.view.wait()

    @classmethod
    def tearDownClass(cls):
        cls.stop()
        for inbox in (cls.states, cls.view, cls.diagnostics):
            inbox.subscriber.unregister()

    @staticmethod
    def gesture(message):
        """The name of the gesture in a view."""
        return json.loads(message.json)["gesture"]

    @staticmethod
    def stopped(message):
        """Which source died and how, in a view; none while the arm may move."""
        stop = json.loads(message.json)["stop"]
        return stop and (stop["source"], stop["cause"])

    @classmethod
    def stop(cls):
        for process in cls.processes:
            GRAPH.stop(process)
        graph.wait_until(lambda: not any(n.startswith("/proact_") for n in GRAPH.nodes()), "all nodes gone")

    def now(self):
        return millis(self.states.messages[-1].header.stamp)

    def wait_until(self, at):
        self.states.wait(lambda m: millis(m.header.stamp) >= at)

    def wait_for_motion(self):
        """The arm moves; what was seen before does not count."""
        self.states.clear()
        self.view.clear()
        try:
            self.states.wait(lambda m: speed(m) > MOVING_SPEEDS_RAD_PER_S[self.method])
        except AssertionError as error:
            raise AssertionError(f"{error}; the last view is {self.view.messages[-1]}") from error

    def wait_for_rest(self):
        self.states.clear()
        self.states.wait(lambda m: speed(m) < REST_SPEED_RAD_PER_S)

    def moved_after(self, begin):
        """When the arm moved last after `begin`, in ms since then."""
        seen = [(millis(m.header.stamp) - begin, speed(m)) for m in list(self.states.messages)]
        return max((at for at, fast in seen if at > 0 and fast > REST_SPEED_RAD_PER_S), default=0)

    def check_stop(self, case, first, limit=LIMIT):
        """The arm is at rest within `limit` ms of `first` and stays so."""
        self.wait_until(first + limit + OBSERVATION_MS)
        took = self.moved_after(first)
        print(f"{type(self).__name__}, {case}: at rest {took} ms after the first that is missing or wrong")
        self.assertGreater(took, 50, "something else stopped it")
        self.assertLess(took, limit)

    def check_held(self, watched=OBSERVATION_MS):
        """Nothing moves the arm for a while."""
        begin = self.now()
        self.wait_until(begin + watched)
        self.assertEqual(self.moved_after(begin), 0)

    def wait_for_stop(self, source, *causes):
        self.view.wait(lambda m: self.stopped(m) in [(source, cause) for cause in causes])

    def wait_for_release(self):
        self.view.clear()
        self.view.wait(lambda m: self.stopped(m) is None)

    def wait_for_diagnosis(self, kind, text):
        def has_reason(message):
            values = {v.key: v.value for status in message.status for v in status.values}
            return text in values.get(f"{kind} last", "")

        self.diagnostics.wait(has_reason)


class GestureTopic:
    """Somebody's /emg into the nodes below."""

    @classmethod
    def setUpClass(cls):
        # One that was killed is registered for ever.
        speakers = lambda: {name for name in dict(GRAPH.system_state()[0]).get("/emg", []) if "speaker" in name}
        before = speakers()
        # One each that goes on living, is shut down, is killed.
        cls.speakers = [GesturePublisher() for _ in range(3)]
        super().setUpClass()
        graph.wait_until(lambda: len(speakers() - before) == 3, "three publishers of /emg")

    @classmethod
    def tearDownClass(cls):
        for speaker in cls.speakers:
            GRAPH.stop(speaker.process)
        super().tearDownClass()

    def test_a_gesture_topic_that_dies_stops_the_arm_until_it_is_back_and_relaxed(self):
        living, leaving, killed = self.speakers
        for case, speaker, die in [
            ("silent", living, lambda: living.set_gesture("")),
            ("garbage", living, lambda: living.set_gesture("waving")),
            ("shut down", leaving, lambda: leaving.end(signal.SIGINT)),
            ("killed", killed, lambda: killed.end(signal.SIGKILL)),
        ]:
            with self.subTest(case=case):
                if speaker is not living:
                    living.set_gesture("")
                speaker.set_gesture("no_motion")
                self.wait_until(self.now() + 100)
                self.wait_for_release()
                speaker.set_gesture("wrist_extension")
                self.wait_for_motion()
                die()
                self.wait_for_stop("gesture_topic", "silent")
                self.check_stop(case, speaker.last("wrist_extension") + DECISION)
                # A gesture that is held all the time does not start the arm.
                self.view.clear()
                living.set_gesture("wrist_extension")
                self.view.wait(lambda m: self.gesture(m) == "wrist_extension")
                self.check_held()
                living.set_gesture("no_motion")
                self.wait_for_release()
                self.go_back(living)
        self.wait_for_diagnosis("stop", "the gesture topic is silent")

    def go_back(self, speaker):
        """The other way, so that the joint does not come to its limit."""
        speaker.set_gesture("wrist_flexion")
        self.states.clear()
        self.states.wait(lambda m: m.position[m.name.index(ARM[0])] < self.start_angle)
        speaker.set_gesture("no_motion")
        self.wait_for_rest()


class GestureTopicOfMethod(GestureTopic, Safety):
    nodes = ("sim", "method")

    def test_b_a_joystick_may_rest_but_not_fall_silent(self):
        self.speakers[0].set_gesture("")
        self.view.clear()
        self.wait_for_stop("gesture_topic", "silent")
        out, pushed, last = rospy.Publisher("/joy", Joy, queue_size=1, tcp_nodelay=True), 1.0, [0]
        graph.wait_until(lambda: out.get_num_connections() == 1, "the method as subscriber")

        def repeat(now):
            # As joy_node does with autorepeat_rate 20.
            if now % DECISION or pushed is None:
                return []
            last[0] = now
            return [(out, Joy(axes=[0.0, pushed], buttons=[0] * 12))]

        joystick = ClockedCallback(repeat)
        try:
            self.check_held()
            pushed = 0.0
            self.wait_for_release()
            self.wait_until(self.now() + 500)
            self.assertIsNone(self.stopped(self.view.messages[-1]))
            pushed = 1.0
            self.wait_for_motion()
            pushed = None
            self.wait_for_stop("gesture_topic", "silent")
            self.check_stop("joystick silent", last[0] + DECISION)
        finally:
            joystick.stop()
            out.unregister()

    def test_c_a_tracked_shoulder_that_freezes_or_falls_silent_after_it_has_moved_stops_the_arm(self):
        speaker = self.speakers[0]
        speaker.set_gesture("no_motion")
        self.wait_for_release()
        get = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
        mount = get("mpl_right_arm", "").pose
        height, live, last = mount.position.z, "moving", [0]
        out = rospy.Publisher("/Shoulderpad_filtered_pose", PoseStamped, queue_size=1, tcp_nodelay=True)
        graph.wait_until(lambda: out.get_num_connections() == 2, "simulator and method as subscribers")

        def track(now):
            if live == "moving":
                # The trunk sways, a millimetre in a second.
                mount.position.z = height + 1e-6 * abs(now % 2000 - 1000)
                last[0] = now
            header = Header(stamp=rospy.Time(now // 1000, now % 1000 * 1_000_000), frame_id="world")
            return [] if live == "silent" else [(out, PoseStamped(header=header, pose=mount))]

        tracker = ClockedCallback(track)
        try:
            for case in ("frozen", "silent"):
                with self.subTest(case=case):
                    speaker.set_gesture("wrist_extension")
                    self.wait_for_motion()
                    live = case
                    self.wait_until(self.now() + 20)
                    self.check_stop(f"shoulder {case}", last[0] + 10)
                    self.wait_for_stop("shoulder_tracker", case)
                    live = "moving"
                    self.check_held()
                    speaker.set_gesture("no_motion")
                    self.wait_for_release()
                    self.go_back(speaker)
            self.wait_for_diagnosis("stop", "the shoulder tracker is silent")
        finally:
            tracker.stop()
            out.unregister()


class GestureTopicOfTestbed(GestureTopic, Safety):
    nodes, view_topic, view_type = ("testbed --live",), "/proact/frame", Frame

    @staticmethod
    def gesture(message):
        return GESTURES[message.view.gesture]

    @staticmethod
    def stopped(message):
        return next(((SOURCES[stop.source], CAUSES[stop.cause]) for stop in message.view.stop), None)


class Armband(Safety):
    """Samples of a participant, recorded and played again by somebody's node, through all stages to the arm."""

    nodes = ("sim", "emg", "method")
    # A message each.
    PACKET = 10

    @classmethod
    def setUpClass(cls):
        cls.recorded = cls.record()
        super().setUpClass()
        cls.out = rospy.Publisher("/proact/emg_samples", EmgSamples, queue_size=20, tcp_nodelay=True)
        graph.wait_until(lambda: cls.out.get_num_connections() == 1, "the EMG stage as subscriber")

    @classmethod
    def record(cls):
        """Samples of a participant's armband while the hand rested, and while a gesture was held."""
        samples, decisions = graph.Inbox("/proact/emg_samples", EmgSamples), []
        emg = rospy.Subscriber("/emg", String, lambda m: decisions.append((samples.came, m.data)))
        node = lambda name: GRAPH.node(name, "--method", cls.method, "--setup", "still")
        # Before the method shows anything, the person does nothing.
        cls.processes = [node(name) for name in ("sim", "emg", "participant")]
        samples.wait_count(500 // cls.PACKET)
        rest = samples.came
        cls.processes.append(node("method"))
        held = lambda: [at for at, word in list(decisions) if word == "wrist_extension"]
        graph.wait_until(lambda: len(held()) > 12, "a gesture that is held")
        cls.stop()
        for subscriber in (emg, samples.subscriber):
            subscriber.unregister()
        # The stage names a gesture some windows late.
        part = lambda begin, end: [m.data[k:k + m.channels] for m in samples.messages[begin:end]
                                   for k in range(0, len(m.data), m.channels)]
        return {"no_motion": part(0, rest), "wrist_extension": part(held()[0], held()[11] - 200 // cls.PACKET)}

    def test_an_armband_that_dies_stops_the_arm_until_it_is_back_and_relaxed(self):
        self.play("no_motion")
        armband = ClockedCallback(self.packet)
        try:
            for case, reason in [("silent", "silent"), ("constant", "repeats"), ("last packet again", "repeats"),
                               ("zeros", "repeats"), ("half of the packets", "lost"), ("half the rate", "the armband")]:
                with self.subTest(case=case):
                    self.wait_for_release()
                    # From the start again, so that the joint does not come to its limit.
                    rospy.ServiceProxy("/gazebo/reset_world", Empty)()
                    self.wait_until(self.now() + 400)
                    self.play("wrist_extension")
                    self.wait_for_motion()
                    self.diagnostics.clear()
                    self.first, self.fault = None, case
                    self.check_stop(case, graph.wait_until(lambda: self.first, "the first sample that is wrong"))
                    self.fault = None
                    # The gesture is held all the time: long enough to be recognised again.
                    self.check_held(500)
                    self.wait_for_diagnosis("emg_stale", reason)
                    self.play("no_motion")
        finally:
            armband.stop()

    counter, fault, first, last, odd = 0, None, None, None, False

    def play(self, gesture):
        self.samples = itertools.cycle(self.recorded[gesture])

    def packet(self, now):
        """The next message, as whatever is broken leaves it."""
        samples = list(itertools.islice(self.samples, self.PACKET))
        if self.fault and self.first is None:
            # A message holds the samples of the time before it.
            self.first, self.odd = now - self.PACKET + 1, False
        if self.fault is None:
            self.last = samples
        elif self.fault == "constant":
            samples = self.last[-1:] * self.PACKET
        elif self.fault == "last packet again":
            samples = self.last
        elif self.fault == "zeros":
            samples = [[0.0] * len(sample) for sample in samples]
        elif self.fault == "half the rate":
            del samples[::2]
        counter, self.counter = self.counter, self.counter + len(samples)
        self.odd = not self.odd
        if self.fault == "silent" or self.fault == "half of the packets" and self.odd:
            return []
        data = list(itertools.chain.from_iterable(samples))
        return [(self.out, EmgSamples(header=Header(), counter=counter, channels=len(samples[0]), data=data))]


class Gaze(Safety):
    """Somebody's gestures and gaze into method C."""

    method, nodes = "C", ("sim", "intent", "method")

    def test_an_eye_tracker_that_freezes_or_falls_silent_stops_a_motion_that_follows_it(self):
        queue = {"queue_size": 10, "tcp_nodelay": True}
        emg = rospy.Publisher("/emg", String, **queue)
        rays = [rospy.Publisher(topic, Vector3Stamped, **queue) for topic in ("/gaze_position", "/gaze_direction")]
        # Gaze has the intent stage, and the method in case that somebody else infers.
        for publisher, count in [(emg, 1), *((ray, 2) for ray in rays)]:
            graph.wait_until(lambda: publisher.get_num_connections() == count, "the subscribers of each")
        block = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)("redcylinder1", "").pose.position
        eye = Vector3(-0.4, 0.3, 1.6)
        way = Vector3(block.x - eye.x, block.y - eye.y, block.z - eye.z)
        noise, first = random.Random(1), {}

        def look(now):
            messages = [(emg, self.word)] if now % DECISION == 0 else []
            if now % 20:
                return messages
            if self.eye == "live":
                way.x += noise.uniform(-1e-4, 1e-4)
            else:
                first.setdefault(self.eye, now)
            header = Header(stamp=rospy.Time(now // 1000, now % 1000 * 1_000_000))
            if self.eye != "silent":
                messages += [(out, Vector3Stamped(header=header, vector=v)) for out, v in zip(rays, (eye, way))]
            return messages

        shown = lambda true: self.view.wait(lambda m: true(json.loads(m.json)))
        self.word, self.eye = "no_motion", "live"
        person = ClockedCallback(look)
        try:
            shown(lambda v: v["target"]["object"] == 0)
            self.word = "wrist_flexion"
            shown(lambda v: v["target"]["locked"])
            for case in ("frozen", "silent"):
                with self.subTest(case=case):
                    self.word = "no_motion"
                    self.wait_for_release()
                    self.word = "wrist_extension"
                    self.wait_for_motion()
                    self.eye = case
                    graph.wait_until(lambda: case in first, case)
                    self.check_stop(f"gaze {case}", first[case], GAZE_LIMIT)
                    self.assertGreater(self.moved_after(first[case]), 900, "it was not the end of the path")
                    self.wait_for_stop("eye_tracker", case)
                    self.eye = "live"
                    self.check_held()
            self.wait_for_diagnosis("stop", "the eye tracker is silent")
        finally:
            person.stop()


def load_tests(loader, _tests, _pattern):
    classes = (GestureTopicOfMethod, GestureTopicOfTestbed, Armband, Gaze)
    return unittest.TestSuite(loader.loadTestsFromTestCase(each) for each in classes)


if __name__ == "__main__":
    unittest.main(verbosity=2)
