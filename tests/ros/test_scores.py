"""Scores from a bag of separate nodes, column by column beside those of the same trial recomputed from its input log."""

import collections
import csv
import json
import os
import subprocess
import tempfile
import threading
import unittest

import graph

graph.message_packages()
GRAPH = graph.Graph()

import rosbag  # noqa: E402
import rospy  # noqa: E402
from gazebo_grasp_plugin_ros.msg import GazeboGraspEvent  # noqa: E402
from gazebo_msgs.msg import ModelStates  # noqa: E402
from geometry_msgs.msg import Vector3Stamped  # noqa: E402
from proact_msgs.msg import Decision, State  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import String  # noqa: E402

NODES = ["sim", "emg", "intent", "method", "participant"]
JOINTS = "/mpl_right_arm/wrapped_joint_states"
GAZE = ["/gaze_position_ros", "/gaze_direction_ros"]
OBJECTS, GRASPS, EMG = "/gazebo/model_states", "/grasp_event_republisher/grasp_events", "/emg"
TYPES = {JOINTS: JointState, GAZE[0]: Vector3Stamped, GAZE[1]: Vector3Stamped, OBJECTS: ModelStates, GRASPS: GazeboGraspEvent,
         EMG: String}
# The simulator's period, and the time at which its clock starts.
PERIOD_MS = 10
START = rospy.Time(1000)
# Methods with the mode that a bag's name has for them. Of A and B half a minute is too short for a block.
TRIALS = [("A", 1, 6, []), ("B", 2, 6, []), ("C", 3, 12, []), ("D", 4, 20, ["--profile", "original"])]
# The nodes' trial is that of one process, tick by tick, and so are the numbers of its bag. Joints are wrapped into a turn and unwrapped
# again, which costs the last digits of sums.
TOLERANCE = 1e-9
# What a bag tells of when something began is known to one of its instants, 20 ms apart.
TIME_TOLERANCES = {"pick_s": 0.02, "place_s": 0.02, "gesture_to_motion_ms": 20.0, "false_trigger_ms": 20.0, "time_s": 0.02, "detail": 20.0}
# What a bag of the original's topics does not tell: who, in which trial, and what planner and grasp rule did.
COLUMNS_NOT_ON_TOPICS = {"participant", "arrangement", "seed", "arm", "setup", "end_reason", "mark", "gesture_source", "unsolved_ticks", "record",
                         "digest", "flaw", "attempts", "failed_grasps", "plan_failures", "stops"}


def setUpModule():
    rospy.init_node("test_scores", disable_signals=True)


def tearDownModule():
    GRAPH.close()


class Recorder:
    """Records a trial in lock-step. rosbag stamps what it receives when it receives it, which in lock-step is some ticks later. This
    recorder stamps with the tick that a message was sent in. The participant gets the state of a tick through it, and only when all
    messages of the tick are there, so that none is lost or late."""

    def __init__(self, last):
        self.last = last
        self.changed = threading.Condition()
        self.state, self.passed, self.decision = None, False, 0
        self.got = collections.defaultdict(list)
        # Ticks of the messages without a stamp, by the typed messages.
        self.ticks = {JOINTS: [], OBJECTS: [], GRASPS: [], EMG: []}
        self.participant = rospy.Publisher("/held/state", State, queue_size=100)
        subscribe = rospy.Subscriber
        self.listeners = [subscribe(topic, kind, self.take, topic, queue_size=1000) for topic, kind in TYPES.items()]
        self.listeners += [subscribe("/proact/decision", Decision, self.take_decision, queue_size=1000),
                           subscribe("/proact/state", State, self.take_state, queue_size=1000)]

    def is_connected(self):
        connections = [topic.get_num_connections() for topic in [self.participant, *self.listeners]]
        return all(connections)

    def take(self, message, topic):
        with self.changed:
            self.got[topic].append(message)
            self.pass_on()

    def take_decision(self, decision):
        with self.changed:
            # In lock-step a node says its last message again when somebody seems not to have heard it.
            if decision.tick > self.decision:
                self.decision = decision.tick
                if decision.message >= 0:
                    self.ticks[EMG].append(decision.tick)
            self.pass_on()

    def take_state(self, state):
        with self.changed:
            if self.state is None or state.tick > self.state.tick:
                kinds = [json.loads(event)["event"] for event in state.events]
                self.ticks[GRASPS] += [state.tick for kind in kinds if kind in ("object_attached", "object_released")]
                if state.tick and state.tick % PERIOD_MS == 0:
                    self.ticks[JOINTS].append(state.tick)
                    self.ticks[OBJECTS].append(state.tick)
            self.state, self.passed = state, False
            self.pass_on()

    def pass_on(self):
        state = self.state
        if state is None or self.passed or self.decision < state.tick or any(len(self.got[t]) < len(self.ticks[t]) for t in self.ticks):
            return
        self.passed = True
        self.changed.notify_all()
        if state.tick < self.last:
            self.participant.publish(state)

    def wait(self, timeout):
        """Until the last tick is there; none comes after it."""
        with self.changed:
            if not self.changed.wait_for(lambda: self.passed and self.state.tick >= self.last, timeout):
                raise AssertionError(f"tick {self.state and self.state.tick} of {self.last} after {timeout} s")

    def close(self):
        for topic in [self.participant, *self.listeners]:
            topic.unregister()

    def write(self, path):
        stamped = []
        for topic, messages in self.got.items():
            if topic in GAZE or topic == JOINTS:
                stamped += [(message.header.stamp, topic, message) for message in messages]
            else:
                assert len(messages) == len(self.ticks[topic]), topic
                stamped += [(START + rospy.Duration(0, tick * 1000000), topic, message)
                            for tick, message in zip(self.ticks[topic], messages)]
        stamped.sort(key=lambda entry: entry[0])
        with rosbag.Bag(path, "w") as bag:
            # A bag's time counts from its first message.
            bag.write("/clock", Clock(START), START)
            for stamp, topic, message in stamped:
                bag.write(topic, message, stamp)


def tables(source, out):
    """Faults of the report, and its tables: of each the rows, by column."""
    answer = subprocess.run([graph.BINARY, "analyze", source, "--out", out, "--json"], stdout=subprocess.PIPE, check=True,
                            universal_newlines=True)
    data, found = os.path.join(out, "data"), {}
    for name in sorted(os.listdir(data)):
        if name.endswith(".csv"):
            with open(os.path.join(data, name)) as file:
                found[name] = list(csv.DictReader(file))
    return json.loads(answer.stdout)["faults"], found


class Scores(unittest.TestCase):
    def record(self, folder, mode, words):
        """The record of a trial in one process, and a bag of the same trial by nodes."""
        record, bag = os.path.join(folder, "record"), os.path.join(folder, f"participant1-mode{mode}-trial1.bag")
        subprocess.run([graph.BINARY, "demo", "--headless", "--out", record, *words], check=True, stdout=subprocess.DEVNULL)
        with open(os.path.join(record, "digests.log")) as log:
            last = max(json.loads(line.split(" ", 1)[1])["tick"] for line in log)
        recorder = Recorder(last)
        nodes = [GRAPH.node(name, *words, "_lockstep:=true", *(["proact/state:=/held/state"] if name == "participant" else []))
                 for name in NODES]
        try:
            graph.wait_until(recorder.is_connected, "connections to every topic")
            recorder.wait(60.0 + 0.02 * last)
        finally:
            for node in nodes:
                GRAPH.stop(node)
            recorder.close()
        recorder.write(bag)
        return record, bag

    def is_same(self, column, found, expected):
        if found == expected:
            return True
        try:
            # Details of faults are such as `150 ms`.
            numbers = [float(cell[:-3] if cell.endswith(" ms") else cell) for cell in (found, expected)]
            return abs(numbers[0] - numbers[1]) <= TIME_TOLERANCES.get(column, TOLERANCE)
        except ValueError:
            return False

    def test_every_column_of_every_table_is_that_of_the_recomputed_trial(self):
        for method, mode, seconds, words in TRIALS:
            words = ["--method", method, "--seed", "3", "--set", f"limit_secs={seconds}", *words]
            with self.subTest(" ".join(words)), tempfile.TemporaryDirectory() as folder:
                record, bag = self.record(folder, mode, words)
                _, expected = tables(record, os.path.join(folder, "of_record"))
                faults, found = tables(bag, os.path.join(folder, "of_bag"))
                self.assertEqual(faults, [])
                self.assertEqual(found.keys(), expected.keys())
                # A trial with a pick and a place, where one was long enough.
                self.assertEqual(bool(expected["phases.csv"]), seconds > 10)
                for table in found:
                    self.assertEqual(len(found[table]), len(expected[table]), table)
                    for place, (ours, theirs) in enumerate(zip(found[table], expected[table])):
                        self.assertEqual(ours.keys(), theirs.keys())
                        wrong = {column: (ours[column], theirs[column]) for column in ours if column not in COLUMNS_NOT_ON_TOPICS
                                 and not self.is_same(column, ours[column], theirs[column])}
                        self.assertEqual(wrong, {}, f"{table}, row {place}")


if __name__ == "__main__":
    unittest.main(verbosity=2)
