"""The parameter compat: single quirks of the original, for comparison with recordings of it."""

import subprocess
import unittest

import graph

graph.message_packages()
GRAPH = graph.Graph()

import actionlib  # noqa: E402
import rospy  # noqa: E402
import tf2_ros  # noqa: E402
from actionlib_msgs.msg import GoalStatus  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402
from mpl_control.msg import graspAction, graspGoal  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

COMPAT_OPTIONS = "slow_poses,bare_poses,resent_constants,grasp_succeeds"


def setUpModule():
    rospy.init_node("test_compat", disable_signals=True)
    rospy.set_param("/use_sim_time", False)


def tearDownModule():
    GRAPH.close()


class Compat(unittest.TestCase):
    def test_a_simulator_with_quirks_speaks_as_the_original_did(self):
        poses = graph.Inbox("/red_block1_pose_msg", PoseStamped)
        frames, fixed = graph.Inbox("/tf", TFMessage), graph.Inbox("/tf_static", TFMessage)
        sim = GRAPH.node("sim", "--setup", "still", f"_compat:={COMPAT_OPTIONS}")
        poses.wait_count(5)
        stamps = [m.header.stamp.to_sec() for m in poses.messages]
        self.assertEqual({round(b - a, 3) for a, b in zip(stamps, stamps[1:])}, {0.1})
        self.assertEqual({m.header.frame_id for m in poses.messages}, {""})
        # Constants: not latched, but on /tf, a tenth of a second ahead of what moves.
        self.assertNotIn("world", [t.child_frame_id for t in fixed.wait().transforms])
        constants = frames.wait(lambda m: any(t.child_frame_id == "world" for t in m.transforms))
        self.assertEqual({t.child_frame_id for t in constants.transforms}, {"world", "hololens_world_test"})
        before = frames.messages[frames.messages.index(constants) - 1]
        ahead = constants.transforms[0].header.stamp - before.transforms[0].header.stamp
        self.assertAlmostEqual(ahead.to_sec(), 0.1, places=6)
        # The whole tree is there all the same. A second subscriber of this process would get no latched message.
        fixed.subscriber.unregister()
        buffer = tf2_ros.Buffer(rospy.Duration(30))
        tf2_ros.TransformListener(buffer)
        graph.wait_until(lambda: buffer.can_transform("optitrack_world", "redcylinder1", rospy.Time(0)), "the tree")

        client = actionlib.SimpleActionClient("/grasp", graspAction)
        self.assertTrue(client.wait_for_server(rospy.Duration(graph.TIMEOUT_SECS)))
        client.send_goal(graspGoal(instruct=1))
        graph.wait_until(lambda: client.get_state() == GoalStatus.ACTIVE, "the hand closing")
        client.cancel_goal()
        self.assertTrue(client.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS)))
        self.assertEqual((client.get_state(), client.get_result().done), (GoalStatus.SUCCEEDED, 1))
        GRAPH.stop(sim)

    def test_the_heads_quaternion_has_its_numbers_in_the_wrong_places(self):
        turned = {}
        for arguments in ([], ["_compat:=head_quaternion"]):
            heads = graph.Inbox("/hololens_unity_camera_pose_ros", PoseStamped)
            node = GRAPH.node("testbed", "--method", "D", "--seed", "1", *arguments)
            heads.wait_count(150)
            turned[len(arguments)] = {m.header.stamp.to_nsec(): m.pose.orientation for m in heads.messages}
            GRAPH.stop(node)
            heads.subscriber.unregister()
        # The person leans, so the first instant that both runs have told is compared.
        first = min(turned[0].keys() & turned[1].keys())
        right, wrong = turned[0][first], turned[1][first]
        for got, expected in zip((wrong.x, wrong.y, wrong.z, wrong.w), (right.w, right.x, right.y, right.z)):
            self.assertAlmostEqual(got, expected, places=9)
        self.assertGreater(abs(right.w - right.x), 0.1)

    def test_an_unknown_quirk_ends_the_node_with_one_line_that_names_the_known_ones(self):
        done = subprocess.run([graph.BINARY, "node", "sim", "_compat:=teapot"], env=GRAPH.env, timeout=60,
                              stderr=subprocess.PIPE, universal_newlines=True)
        self.assertNotEqual(done.returncode, 0)
        log_lines = [line for line in done.stderr.splitlines() if line.startswith("proact:")]
        self.assertEqual(len(log_lines), 1, done.stderr)
        self.assertTrue("teapot" in log_lines[0] and "slow_poses" in log_lines[0], log_lines)


if __name__ == "__main__":
    unittest.main(verbosity=2)
