"""Clients of ROS 2 at `proact node rosbridge`, beside `node sim`: topics and services by the names of ROS 2, and goals for the
actions of arm and hand. Only the clients' side of ROS 2 is there: no ROS 2 was run."""

import os
import signal
import subprocess
import unittest

import graph

graph.message_packages()
GRAPH = graph.Graph()

import rospy  # noqa: E402
from bridge_client import Client, listens  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402
from std_srvs.srv import SetBool, SetBoolResponse  # noqa: E402

PORT = graph.free_port()
ROSLIBPY = os.environ.get("PROACT_ROSLIBPY_PYTHON", os.path.join(graph.ROOT, "build", "peers", "bin", "python"))
ARM = ["mpl_right_arm__" + n for n in "shoulder humerus elbow forearm wristy wristx wristz".split()]
FOLLOW = "/mpl_right_arm/arm_controller/follow_joint_trajectory"
ACTIONS = {FOLLOW, FOLLOW.replace("arm_controller", "hand_controller"), "/grasp"}
SUCCEEDED, CANCELED = 4, 5


def setUpModule():
    global SIM, CLIENT
    rospy.init_node("test_ros2_clients", disable_signals=True)
    SIM = GRAPH.node("sim", "--setup", "still")
    GRAPH.node("rosbridge", f"_port:={PORT}")
    graph.wait_until(lambda: listens(PORT), "the server's port")
    CLIENT = Client(PORT)
    CLIENT.send("subscribe", topic="/mpl_right_arm/joint_states", type="sensor_msgs/msg/JointState", queue_length=1)
    CLIENT.topic("/mpl_right_arm/joint_states")
    servers = lambda: set(CLIENT.call("/rosapi/action_servers")[1]["action_servers"])
    graph.wait_until(lambda: ACTIONS <= servers(), "the simulator's actions")


def tearDownModule():
    GRAPH.close()


def arm_now():
    with CLIENT.condition:
        latest = next(m["msg"] for m in reversed(CLIENT.messages) if m.get("topic") == "/mpl_right_arm/joint_states")
    return [latest["position"][latest["name"].index(name)] for name in ARM]


def trajectory(secs, positions):
    """In the form of ROS 2: nothing but what is meant, times with sec and nanosec."""
    time = {"sec": int(secs), "nanosec": round(1e9 * (secs % 1))}
    point = {"positions": positions, "velocities": [0.0] * len(positions), "time_from_start": time}
    return {"trajectory": {"joint_names": ARM, "points": [point]}}


class Goal:
    """A goal of a client."""

    def __init__(self, args, action=FOLLOW, kind="control_msgs/action/FollowJointTrajectory", client=None):
        self.client, self.action = client or CLIENT, action
        self.id = f"goal-{next(self.client.ids)}"
        self.client.send("send_action_goal", id=self.id, action=action, action_type=kind, args=args, feedback=True)

    def feedback(self):
        return self.client.wait(lambda m: m["op"] == "action_feedback" and m["id"] == self.id)["values"]

    def end(self):
        answer = self.client.wait(lambda m: m["op"] == "action_result" and m["id"] == self.id)
        return answer["result"], answer["status"], answer["values"]

    def cancel(self):
        self.client.send("cancel_action_goal", id=self.id, action=self.action)


def bent(by):
    positions = arm_now()
    positions[3] += by
    return positions


class Ros2(unittest.TestCase):
    def test_topics_have_the_form_of_ros_2_only_where_it_is_asked_for(self):
        got = CLIENT.topic("/mpl_right_arm/joint_states")
        self.assertEqual(set(got["header"]), {"stamp", "frame_id"})
        self.assertEqual(set(got["header"]["stamp"]), {"sec", "nanosec"})
        CLIENT.send("subscribe", topic="/tf", type="tf2_msgs/msg/TFMessage")
        for transform in CLIENT.topic("/tf")["transforms"]:
            self.assertEqual(set(transform["header"]["stamp"]), {"sec", "nanosec"})
        other = Client(PORT)
        other.send("subscribe", topic="/mpl_right_arm/joint_states", type="sensor_msgs/JointState")
        self.assertEqual(set(other.topic("/mpl_right_arm/joint_states")["header"]), {"seq", "stamp", "frame_id"})
        other.close()

    def test_a_message_of_ros_2_reaches_a_node(self):
        poses = graph.Inbox("/lab/pose", PoseStamped)
        CLIENT.send("advertise", topic="/lab/pose", type="geometry_msgs/msg/PoseStamped", latch=True)
        header = {"stamp": {"sec": 3, "nanosec": 4}, "frame_id": "world"}
        CLIENT.send("publish", topic="/lab/pose", msg={"header": header, "pose": {"position": {"x": 0.5}}})
        got = poses.wait()
        self.assertEqual((got.header.stamp, got.pose.position.x), (rospy.Time(3, 4), 0.5))

    def test_services_by_the_names_of_ros_2_both_ways(self):
        served = rospy.Service("/lab/lamp", SetBool, lambda r: SetBoolResponse(r.data, "by a node"))
        self.assertEqual(CLIENT.call("/lab/lamp", data=True), (True, {"success": True, "message": "by a node"}))
        # The bridge looks at the graph once a second.
        kind = lambda: CLIENT.call("/rosapi/service_type", service="/lab/lamp")[1]["type"]  # noqa: E731
        graph.wait_until(lambda: kind() == "std_srvs/srv/SetBool", "the type of the service")
        served.shutdown()
        provider = Client(PORT)
        provider.send("advertise_service", service="/web/lamp", type="std_srvs/srv/SetBool")
        rospy.wait_for_service("/web/lamp", graph.TIMEOUT_SECS)
        self.assertEqual(provider.call("/rosapi/topic_type", topic="/tf")[1]["type"], "tf2_msgs/msg/TFMessage")
        provider.close()

    def test_a_goal_moves_the_arm_with_feedback_and_succeeds(self):
        target = bent(0.2)
        goal = Goal(trajectory(0.5, target))
        feedback = goal.feedback()
        self.assertEqual(feedback["joint_names"], ARM)
        self.assertEqual(set(feedback["header"]["stamp"]), {"sec", "nanosec"})
        self.assertEqual(set(feedback["desired"]["time_from_start"]), {"sec", "nanosec"})
        done, status, values = goal.end()
        self.assertEqual((done, status, values["error_code"]), (True, SUCCEEDED, 0))
        graph.wait_until(lambda: max(abs(a - b) for a, b in zip(arm_now(), target)) < 0.05, "the arm at its goal")

    def test_a_goal_is_cancelled(self):
        goal = Goal(trajectory(30, bent(-0.2)))
        goal.feedback()
        goal.cancel()
        self.assertEqual(goal.end()[:2], (True, CANCELED))

    def test_the_hand_closes_and_opens(self):
        for instruct in (1, 2):
            end = Goal({"instruct": instruct}, "/grasp", "mpl_control/action/grasp").end()
            self.assertEqual(end, (True, SUCCEEDED, {"done": 1}))

    def test_goals_that_cannot_be_are_refused_with_the_reason(self):
        for args, reason in [(trajectory(1, [None] * 7), "nan"), ({}, "no points"), ({"x": 1}, "only the fields"),
                             ({"trajectory": {"points": [{"time_from_start": {"sec": 1e300}}]}}, "time_from_start"),
                             ([1, 2, 3, 4, 5], "at most 4"), ("x", "expected an object")]:
            done, _, values = Goal(args).end()
            self.assertFalse(done, args)
            self.assertIn(reason, values.lower())
        goal = Goal({}, "/mpl_left_arm/arm_controller/follow_joint_trajectory")
        done, _, values = goal.end()
        self.assertFalse(done)
        for action in ACTIONS:
            self.assertIn(action, values)
        status = CLIENT.wait(lambda m: m["op"] == "status" and m.get("id") == goal.id)
        self.assertEqual((status["level"], status["msg"]), ("error", values))
        done, _, values = Goal({}, FOLLOW, "mpl_control/action/grasp").end()
        self.assertFalse(done)
        self.assertIn("control_msgs/FollowJointTrajectory", values)

    def test_the_goals_of_a_client_that_goes_are_cancelled(self):
        other = Client(PORT)
        goal = Goal(trajectory(30, bent(0.2)), client=other)
        goal.feedback()
        other.close()
        # Its place is free: the next goal of another client ends by itself, and nothing moves the arm away after it.
        target = bent(0.1)
        self.assertEqual(Goal(trajectory(0.5, target)).end()[:2], (True, SUCCEEDED))
        self.assertLess(max(abs(a - b) for a, b in zip(arm_now(), target)), 0.05)

    @unittest.skipUnless(os.path.exists(ROSLIBPY), "roslibpy is not installed; ./proact peers installs it")
    def test_roslibpys_action_client_moves_the_arm(self):
        script = """
import json, sys, threading, roslibpy
client = roslibpy.Ros(host="127.0.0.1", port=int(sys.argv[1]))
client.run(timeout=30)
action = roslibpy.ActionClient(client, sys.argv[2], "control_msgs/action/FollowJointTrajectory")
ended, feedback, done = [], [], threading.Event()
take = lambda result: (ended.append(dict(result)), done.set())
action.send_goal(roslibpy.Goal(json.loads(sys.argv[3])), take, feedback.append, take)
assert done.wait(60), "no end"
assert ended[0]["status"] == roslibpy.GoalStatus.SUCCEEDED, ended
assert ended[0]["values"]["error_code"] == 0 and feedback, ended
client.terminate()
"""
        import json

        goal = json.dumps(trajectory(0.5, bent(-0.1)))
        subprocess.run([ROSLIBPY, "-c", script, str(PORT), FOLLOW, goal], check=True, timeout=180)

    def test_z_a_goal_fails_when_its_server_dies(self):
        goal = Goal(trajectory(60, bent(0.2)))
        goal.feedback()
        GRAPH.stop(SIM, signal.SIGKILL)
        done, _, values = goal.end()
        self.assertFalse(done)
        self.assertIn("its server is gone", values)


if __name__ == "__main__":
    unittest.main(verbosity=2)
