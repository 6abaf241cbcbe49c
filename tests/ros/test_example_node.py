"""What a control node reads, and the example of one: the commands of docs/ros_method.md as they stand there.

`--all` carries all four blocks, which takes two minutes; without it the first one.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree

import graph

graph.message_packages()
GRAPH = graph.Graph()

import rospy  # noqa: E402
import tf2_ros  # noqa: E402
from geometry_msgs.msg import TransformStamped  # noqa: E402
from std_msgs.msg import String  # noqa: E402

ALL = "--all" in sys.argv
PAGE = os.path.join(graph.ROOT, "docs", "ros_method.md")
ARM = os.path.join(graph.ROOT, "ros1_ws", "src", "proact_description", "arms", "mpl_right")
# A comment before a block says whether it runs to its end or goes on beside the next ones.
BLOCK = re.compile(r"^<!-- ros: (run|start) -->\n```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# Four blocks take some 100 s of simulated time; a loaded machine has several seconds for one of those.
TIMEOUT_SECS = 900


class Page:
    """The folder in which the commands of the page are typed: the program and the repository's folders."""

    def __init__(self):
        self.folder = tempfile.TemporaryDirectory()
        place = self.folder.name
        os.symlink(os.path.abspath(graph.BINARY), os.path.join(place, "proact"))
        for name in ("ros1_ws", "examples"):
            os.symlink(os.path.join(graph.ROOT, name), os.path.join(place, name))
        # A shell of the reader's has none of this test's modules.
        GRAPH.env.update(HOME=place)
        self.options = {"cwd": place}

    def start(self, script):
        return GRAPH.spawn(["bash", "-ec", script], "page.log", **self.options)

    def run(self, script):
        done = subprocess.run(["bash", "-ec", script], env=GRAPH.env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              universal_newlines=True, timeout=TIMEOUT_SECS, **self.options)
        assert done.returncode == 0, f"exit code {done.returncode} of\n{script}\n{done.stdout[-4000:]}"
        return done.stdout


def pose(group, name):
    """Joints and angles of a pose in the SRDF file."""
    srdf = xml.etree.ElementTree.parse(os.path.join(ARM, "arm.srdf")).getroot()
    state = next(s for s in srdf.iter("group_state") if (s.get("group"), s.get("name")) == (group, name))
    return {joint.get("name"): float(joint.get("value")) for joint in state}


class ControlNode(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.page = Page()
        rospy.init_node("test_example_node", disable_signals=True)
        cls.target = graph.Inbox("/proact/target", TransformStamped)
        cls.score = graph.Inbox("/proact/score", String)
        cls.result = graph.Inbox("/proact/result", String)
        with open(PAGE, encoding="utf-8") as page:
            blocks = BLOCK.findall(page.read())
        # Messages are built before the simulator starts: the time of its trial runs from there.
        (_, messages), (kind, cls.simulator), (_, cls.carry) = blocks
        assert kind == "start", blocks
        cls.page.run(messages)
        cls.running = cls.page.start(cls.simulator)
        cls.first = cls.target.wait()

    @classmethod
    def tearDownClass(cls):
        GRAPH.close()
        cls.page.folder.cleanup()

    def test_1_the_first_target_is_that_of_the_first_object_of_the_order(self):
        self.assertEqual((self.first.header.frame_id, self.first.child_frame_id), ("world", "redcylinder1"))
        at = self.first.transform.translation
        for got, expected in zip((at.x, at.y, at.z), (0.058, 0.2083, 1.04)):
            self.assertAlmostEqual(got, expected, places=9)

    def test_1_the_parameters_say_what_the_task_and_the_description_say(self):
        objects = rospy.get_param("/proact/objects")
        self.assertEqual([o["name"] for o in objects], ["red1", "red2", "blue1", "blue2"])
        self.assertEqual(objects[2]["frame"], "bluecylinder1")
        self.assertEqual(objects[2]["pose_topic"], "/blue_block1_pose_msg")
        self.assertEqual((objects[0]["shape"], objects[0]["size"]), ("cylinder", [0.05, 0.05, 0.05]))
        self.assertEqual((objects[0]["target"], objects[0]["target_radius"]), ([0.058, 0.2083, 1.015], 0.05))
        hand = rospy.get_param("/proact/hand")
        self.assertEqual(hand["tip_link"], "mpl_right_arm__wristz_link")
        grasp = hand["grasps"][objects[0]["grasp"]]
        self.assertLess(grasp["widths"][0], 0.05)
        for name in ("open", "closed"):
            self.assertEqual(dict(zip(hand["joints"], grasp[name])), pose("mpl_hand", name))
        task = rospy.get_param("/proact/task")
        self.assertEqual((task["name"], task["table_height"], task["limit_secs"]), ("modified_bbt", 1.015, 300.0))
        self.assertEqual(sorted(task["put_down"]), ["max", "min"])
        with open(os.path.join(ARM, "arm.urdf"), encoding="utf-8") as urdf:
            self.assertEqual(rospy.get_param("/robot_description"), urdf.read())

    def test_1_the_grasp_centre_is_a_frame_on_the_link_that_carries_the_hand(self):
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer)
        hand = rospy.get_param("/proact/hand")
        graph.wait_until(lambda: buffer.can_transform(hand["tip_link"], "grasp_centre", rospy.Time(0)), "the grasp centre")
        at = buffer.lookup_transform(hand["tip_link"], "grasp_centre", rospy.Time(0)).transform.translation
        for got, expected in zip((at.x, at.y, at.z), hand["grasps"][-1]["centre"]):
            self.assertAlmostEqual(got, expected, places=9)
        # It hangs on the arm, whoever publishes the arm's frames.
        graph.wait_until(lambda: buffer.can_transform("world", "grasp_centre", rospy.Time(0)), "the grasp centre in world")
        listener.unregister()

    def test_2_the_commands_of_the_page_bring_a_block_to_its_target(self):
        self.assertIn("on_target", self.page.run(self.carry))
        score = json.loads(self.score.wait(lambda m: json.loads(m.data)["on_target"] == 1).data)
        outcomes = {line["block"]: line["outcome"] for line in score["outcomes"]}
        self.assertEqual(outcomes["red1"], "on_target", score)
        self.target.wait(lambda m: m.child_frame_id == "bluecylinder1")

    @unittest.skipUnless(ALL, "--all takes two minutes")
    def test_3_without_a_number_it_brings_all_of_them(self):
        GRAPH.stop(self.running)
        graph.wait_until(lambda: "/proact_sim" not in GRAPH.nodes(), "the simulator gone")
        self.result.clear()
        # A loaded machine is not to run into the limit of the trial.
        self.page.start(self.simulator.strip() + " --set limit_secs=3000")
        self.target.wait(lambda m: m.child_frame_id == "redcylinder1" and m is not self.first)
        self.page.run(self.carry.replace("carry_blocks.py 1", "carry_blocks.py"))
        result = json.loads(self.result.wait().data)
        self.assertEqual((result["score"], result["score_name"]), (4.0, "blocks on target"), result)
        self.target.wait(lambda m: m.child_frame_id == "")


if __name__ == "__main__":
    unittest.main(argv=[word for word in sys.argv if word != "--all"], verbosity=2)
