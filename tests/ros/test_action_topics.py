"""The actions of `node sim` as tools see them, beside a server of roscpp's actionlib: the five topics that rqt_graph takes for
one action, their types, who publishes and who subscribes, and a status list at a steady rate."""

import os
import re
import subprocess
import unittest

import graph

graph.message_packages()
GRAPH = graph.Graph()

import rospy  # noqa: E402
from actionlib_msgs.msg import GoalStatusArray  # noqa: E402

OURS = {
    "/mpl_right_arm/arm_controller/follow_joint_trajectory": "control_msgs/FollowJointTrajectory",
    "/mpl_right_arm/hand_controller/follow_joint_trajectory": "control_msgs/FollowJointTrajectory",
    "/grasp": "mpl_control/grasp",
}
REFERENCE = "/reference"
PARTS = ("goal", "cancel", "status", "feedback", "result")
STATUS_SECS = 0.2


def setUpModule():
    source = os.path.join(os.path.dirname(__file__), "roscpp_client")
    build = os.path.join(graph.ROOT, "build", "roscpp_client")
    for command in (["cmake", "-S", source, "-B", build, "-DPYTHON_EXECUTABLE=/usr/bin/python3"],
                    ["cmake", "--build", build, "--target", "action_server"]):
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=GRAPH.env)
    rospy.init_node("test_action_topics", disable_signals=True)
    GRAPH.node("sim", "--setup", "still")
    # The reference's status timer runs on the clock of the simulator, as ours does.
    rospy.wait_for_message("/mpl_right_arm/joint_states", rospy.AnyMsg, graph.TIMEOUT_SECS)
    GRAPH.spawn([os.path.join(build, "action_server"), REFERENCE], "reference.log")
    rospy.wait_for_message(f"{REFERENCE}/status", rospy.AnyMsg, graph.TIMEOUT_SECS)


def tearDownModule():
    GRAPH.close()


def described(node, action, kind):
    """What `rosnode info` says of the topics of an action, by section and part."""
    done = subprocess.run(["/usr/bin/rosnode", "info", node], env=GRAPH.env, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, universal_newlines=True, timeout=graph.TIMEOUT_SECS)
    assert done.returncode == 0 and "ERROR" not in done.stdout, done.stdout
    sections, found = re.split(r"^(Publications|Subscriptions|Services|contacting)", done.stdout, flags=re.MULTILINE), {}
    for title, text in zip(sections[1::2], sections[2::2]):
        for part in PARTS:
            line = re.search(rf"^ \* {action}/{part} \[(.*)\]$", text, re.MULTILINE)
            if line and title in ("Publications", "Subscriptions"):
                found[part] = (title, line.group(1).replace(kind, "KIND"))
    connected = re.findall(rf"^ \* topic: {action}/(\w+)\n    \* to: (\S+)\n    \* direction: outbound", done.stdout, re.MULTILINE)
    return found, connected


class ActionTopics(unittest.TestCase):
    def test_rosnode_info_lists_the_five_topics_as_for_a_server_of_roscpp(self):
        expected, _ = described("/reference_server", REFERENCE, "actionlib/Test")
        self.assertEqual(sorted(expected), sorted(PARTS))
        for action, kind in OURS.items():
            self.assertEqual(described("/proact_sim", action, kind)[0], expected, action)

    def test_rosnode_info_names_who_is_connected(self):
        inbox = graph.Inbox("/grasp/status", GoalStatusArray)
        inbox.wait()
        _, connected = described("/proact_sim", "/grasp", "mpl_control/grasp")
        self.assertEqual([part for part, _ in connected], ["status"])
        # rosnode shows names or addresses of the other end.
        self.assertTrue(connected[0][1].strip("/"), connected)
        inbox.subscriber.unregister()

    def test_rqt_graph_can_group_each_action(self):
        # It groups NAME/feedback with the four other topics of that name.
        publishers, subscribers, _ = GRAPH.system_state()
        topics = {topic for topic, _ in publishers + subscribers}
        names = {topic[: -len("/feedback")] for topic in topics if topic.endswith("/feedback")}
        complete = {name for name in names if all(f"{name}/{part}" in topics for part in PARTS)}
        self.assertEqual(complete, set(OURS) | {REFERENCE})

    def test_status_comes_at_once_and_then_at_the_rate_of_actionlib(self):
        inboxes = {name: graph.Inbox(f"{name}/status", GoalStatusArray) for name in (*OURS, REFERENCE)}
        for name, inbox in inboxes.items():
            inbox.wait_count(12)
            # The first is the latched one, from any time before.
            stamps = [m.header.stamp.to_sec() for m in inbox.messages[1:12]]
            steps = [b - a for a, b in zip(stamps, stamps[1:])]
            if name != REFERENCE:
                for step in steps:
                    self.assertAlmostEqual(step, STATUS_SECS, places=6, msg=name)
            mean = sum(steps) / len(steps)
            self.assertAlmostEqual(mean, STATUS_SECS, delta=0.02, msg=name)


if __name__ == "__main__":
    unittest.main(verbosity=2)
