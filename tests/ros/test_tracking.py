"""A lab with trackers of its own: its frames in the place of ours, its gaze in its own frame, its armband."""

import math
import os
import re
import subprocess
import unittest

import graph

graph.message_packages()
GRAPH = graph.Graph()

import rospy  # noqa: E402
import tf2_ros  # noqa: E402
from gazebo_msgs.srv import GetModelState  # noqa: E402
from geometry_msgs.msg import TransformStamped, Vector3Stamped  # noqa: E402
from proact_msgs.msg import EmgSamples  # noqa: E402
from rosgraph_msgs.msg import Log  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

# Where the lab's headset has its origin in the world: a quarter of a turn to the left, and moved.
ORIGIN, YAW = (0.4, -0.3, 0.2), math.pi / 2
EYE, BLOCKS = (-0.5, 0.0, 1.5), ("redcylinder1", "redcylinder2", "bluecylinder1", "bluecylinder2")


def setUpModule():
    rospy.init_node("test_tracking", disable_signals=True)
    rospy.set_param("/use_sim_time", False)


def tearDownModule():
    GRAPH.close()


def turned_back(v):
    """A direction of the world in the lab's frame."""
    c, s = math.cos(-YAW), math.sin(-YAW)
    return (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])


def moved_back(p):
    """A point of the world in the lab's frame."""
    return turned_back([a - b for a, b in zip(p, ORIGIN)])


def lab_frame(parent, child):
    stamped = TransformStamped()
    stamped.header.stamp = rospy.Time.now()
    stamped.header.frame_id, stamped.child_frame_id = parent, child
    t, q = stamped.transform.translation, stamped.transform.rotation
    (t.x, t.y, t.z), (q.z, q.w) = ORIGIN, (math.sin(YAW / 2), math.cos(YAW / 2))
    return TFMessage(transforms=[stamped])


class Frames(unittest.TestCase):
    def test_frames_that_the_lab_publishes_are_left_out_and_its_own_take_their_place(self):
        moving, fixed = graph.Inbox("/tf", TFMessage), graph.Inbox("/tf_static", TFMessage)
        sim = GRAPH.node("sim", "--setup", "still", "_exclude_frames:=hololens_world_test, table")
        try:
            moving.wait_count(50)
            frames = {t.child_frame_id for m in moving.messages + [fixed.wait()] for t in m.transforms}
            self.assertIn("Shoulderpad", frames)
            self.assertFalse(frames & {"hololens_world_test", "table"}, frames)
            # A second subscriber of this process would get no latched message.
            fixed.subscriber.unregister()
            buffer = tf2_ros.Buffer(rospy.Duration(30))
            listener = tf2_ros.TransformListener(buffer)
            lab = rospy.Publisher("/tf", TFMessage, queue_size=10)

            def known():
                there = lab_frame("world", "hololens_world_test")
                # By the simulator's clock, as a lab's node with /use_sim_time.
                there.transforms[0].header.stamp = moving.messages[-1].transforms[0].header.stamp
                lab.publish(there)
                return buffer.can_transform("mpl_right_arm__wristz_link", "hololens_world_test", rospy.Time(0))

            graph.wait_until(known, "the lab's frame in one tree with the arm")
            found = buffer.lookup_transform("world", "hololens_world_test", rospy.Time(0)).transform
            self.assertAlmostEqual(found.rotation.z, math.sin(YAW / 2), places=6)
            listener.unregister()
            lab.unregister()
            moving.subscriber.unregister()
        finally:
            GRAPH.stop(sim)

    def test_a_frame_that_there_is_not_ends_the_node_with_those_that_there_are(self):
        for node in ("sim", "testbed"):
            done = subprocess.run([graph.BINARY, "node", node, "_exclude_frames:=teapot"], env=GRAPH.env, timeout=60,
                                  stderr=subprocess.PIPE, universal_newlines=True)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn('there is no frame "teapot", expected some of', done.stderr)
            self.assertIn("Shoulderpad_filtered", done.stderr)


class Gaze(unittest.TestCase):
    """A gaze in a frame of the lab's; what it means is told by the intent node."""

    @classmethod
    def setUpClass(cls):
        cls.log = graph.Inbox("/rosout", Log, keep=1000)
        cls.block = graph.Inbox("/block_id", String, keep=100)
        cls.seen = graph.Inbox("/gaze_direction_ros", Vector3Stamped, keep=100)
        cls.nodes = [GRAPH.node(name, "--method", "C", "--setup", "still", *words) for name, words in
                     (("sim", ["_exclude_frames:=hololens_world_test"]), ("intent", []))]
        cls.tf = rospy.Publisher("/tf", TFMessage, queue_size=10)
        cls.gaze = [rospy.Publisher(f"/gaze_{half}", Vector3Stamped, queue_size=10) for half in ("position", "direction")]
        for publisher in (cls.tf, *cls.gaze):
            graph.wait_until(lambda: publisher.get_num_connections() == 1, "the intent node as subscriber")
        rospy.wait_for_service("/gazebo/get_model_state", graph.TIMEOUT_SECS)
        get = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
        places = {name: get(name, "").pose.position for name in BLOCKS}
        cls.blocks = {name: (at.x, at.y, at.z) for name, at in places.items()}

    @classmethod
    def tearDownClass(cls):
        for node in cls.nodes:
            GRAPH.stop(node)

    def look(self, frame, position, direction):
        stamp = rospy.Time.now()
        for publisher, values in zip(self.gaze, (position, direction)):
            message = Vector3Stamped()
            message.header.stamp, message.header.frame_id = stamp, frame
            message.vector.x, message.vector.y, message.vector.z = values
            publisher.publish(message)

    def check(self, frame, there):
        """Looks at each block, from the lab's frame."""
        for name, place in self.blocks.items():
            direction = [b - a for a, b in zip(EYE, place)]
            self.block.clear()

            def tried():
                self.tf.publish(there)
                self.look(frame, moved_back(EYE), turned_back(direction))
                return self.block.messages and self.block.messages[-1].data == name

            graph.wait_until(tried, f"{name} meant by a gaze in {frame!r}")
            # The block and the gaze come on two topics; the gaze of the block before may still be the newest heard.
            length = math.sqrt(sum(v * v for v in direction))
            expected = tuple(v / length for v in direction)
            seen = self.seen.wait(lambda m: math.dist((m.vector.x, m.vector.y, m.vector.z), expected) < 1e-6)
            self.assertEqual(seen.header.frame_id, "world")

    def test_a_gaze_is_moved_from_the_frame_that_it_names_and_without_one_from_the_headsets_world(self):
        self.check("lab_tracker", lab_frame("world", "lab_tracker"))
        self.check("", lab_frame("world", "hololens_world_test"))

    def test_a_gaze_in_a_frame_that_is_unknown_or_silent_means_nothing(self):
        self.block.clear()

        def refused(text):
            self.look("teapot" if "teapot" in text else "silent", EYE, (1.0, 0.0, -0.5))
            return any("refused (gaze)" in m.msg and text in m.msg for m in self.log.messages)

        try:
            graph.wait_until(lambda: refused('there is no frame "teapot"'), "the refusal of an unknown frame")
        except AssertionError as error:
            said = [(m.name, m.msg) for m in list(self.log.messages) if "gaze" in m.msg][-5:]
            raise AssertionError(f"{error}; the log has {said}") from error
        self.tf.publish(lab_frame("world", "silent"))
        graph.wait_until(lambda: refused("/tf was last heard of it"), "the refusal of a frame that is silent")


class Armband(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.recordings, cls.model = (os.path.join(GRAPH.home, name) for name in ("recordings", "model.json"))
        # The third round is the one that a file source plays.
        subprocess.run([graph.BINARY, "emg", "train", "--source", "synthetic", "--no-realtime", "--min-rounds", "3",
                        "--out", cls.model, "--save", cls.recordings],
                       check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        cls.log = graph.Inbox("/rosout", Log, keep=1000)

    def setUp(self):
        self.said, self.samples = graph.Inbox("/emg", String), graph.Inbox("/proact/emg_samples", EmgSamples)
        self.sim = GRAPH.node("sim", "--setup", "still")

    def tearDown(self):
        for inbox in (self.said, self.samples):
            inbox.subscriber.unregister()
        GRAPH.stop(self.sim)

    def test_a_trained_model_reads_the_source_that_the_node_opens_itself(self):
        node = GRAPH.node("emg", "--model", self.model, "--emg-source", f"file:{self.recordings}")
        try:
            for gesture in ("hand_close", "hand_open", "wrist_extension", "wrist_flexion"):
                self.said.wait(lambda m: m.data == gesture)
            self.assertEqual([m.msg for m in self.log.messages if "refused (emg_samples)" in m.msg], [])
        finally:
            GRAPH.stop(node)

    def test_every_sample_of_an_armband_is_on_the_graph_and_its_end_is_told(self):
        band = GRAPH.spawn([graph.BINARY, "emg", "simulate", "--port", "0"], "band.log")
        listens = lambda: re.search(r"gforce-sim://[\d.]+:\d+", open(band.log).read())
        node = GRAPH.node("emg", "--model", self.model, "--emg-source", graph.wait_until(listens, "the armband").group())
        try:
            self.samples.wait_count(50)
            messages = list(self.samples.messages)
            first, last = messages[0], messages[-1]
            self.assertEqual({m.channels for m in messages}, {8})
            self.assertEqual(sum(len(m.data) for m in messages) // 8, last.counter + len(last.data) // 8 - first.counter)
            self.log.clear()
            GRAPH.stop(band)
            self.log.wait(lambda m: "refused (emg_stale)" in m.msg)
            self.assertIsNone(node.poll())
        finally:
            for process in (node, band):
                GRAPH.stop(process)

    def test_words_that_do_not_go_together_are_refused(self):
        none = os.path.join(GRAPH.home, "none.json")
        for words, expected in (
            (["emg", "--emg-source", "synthetic"], "--emg-model"),
            (["sim", "--emg-model", none], "for the node emg"),
            (["emg", "--emg-model", none], "proact emg train writes such a file"),
            (["emg", "--emg-model", none, "--emg-source", "synthetic", "_lockstep:=true"], "real time"),
        ):
            done = subprocess.run([graph.BINARY, "node", *words], env=GRAPH.env, timeout=60,
                                  stderr=subprocess.PIPE, universal_newlines=True)
            self.assertNotEqual(done.returncode, 0, words)
            self.assertIn(expected, done.stderr)


if __name__ == "__main__":
    unittest.main(verbosity=2)
