"""`proact node testbed`: a whole trial on a graph, recorded by rosbag, drawn by rviz."""

import json
import os
import shutil
import signal
import subprocess
import time
import unittest

import graph

MODULES = os.path.join(graph.message_packages(), "lib")
GRAPH = graph.Graph()

import actionlib  # noqa: E402
import rosbag  # noqa: E402
import rospy  # noqa: E402
from actionlib_msgs.msg import GoalStatus  # noqa: E402
from control_msgs.msg import FollowJointTrajectoryAction, FollowJointTrajectoryGoal  # noqa: E402
from geometry_msgs.msg import Vector3Stamped  # noqa: E402
from mpl_control.msg import graspAction, graspGoal  # noqa: E402
from proact_msgs.msg import Frame  # noqa: E402
from rosgraph_msgs.msg import Clock, Log  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint  # noqa: E402

# Its place in proact_types::Gesture::ALL.
WRIST_EXTENSION = 3
SHOTS = os.path.join(graph.ROOT, "build", "ros")


def setUpModule():
    rospy.init_node("test_testbed", disable_signals=True)


def tearDownModule():
    GRAPH.close()


def headless(*words):
    done = subprocess.run([graph.BINARY, "demo", "--headless", "--no-record", "--json", *words],
                          stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True, universal_newlines=True)
    return json.loads(done.stdout)


class Testbed(unittest.TestCase):
    def test_a_recorded_trial_over_ros_moves_the_same_blocks_as_the_trial_in_one_process(self):
        words = ["--method", "D", "--seed", "1"]
        alone = headless(*words)
        result = graph.Inbox("/proact/result", String)
        bag = os.path.join(GRAPH.home, "trial.bag")
        topics = ["/clock", "/tf", "/tf_static", "/emg", "/gaze_position", "/gaze_direction",
                  "/mpl_right_arm/wrapped_joint_states", "/gazebo/model_states",
                  "/grasp_event_republisher/grasp_events", "/move_group/motion_plan_request",
                  "/mpl_right_arm/arm_controller/command"]
        recorder = GRAPH.spawn(["/usr/bin/rosbag", "record", "-O", bag, *topics], "record.log")
        graph.wait_until(lambda: any(n.startswith("/record") for n in GRAPH.nodes()), "rosbag record")
        node = GRAPH.node("testbed", *words)
        over = json.loads(result.wait(timeout=360.0).data)
        self.assertEqual(over["arrangement"], alone["arrangement"])
        outcomes = lambda trial: [(b["block"], b["outcome"]) for b in trial["outcomes"]]
        self.assertEqual(outcomes(over), outcomes(alone))
        # Plans that come late on a loaded machine cost time, not blocks.
        self.assertAlmostEqual(over["sim_seconds"], alone["sim_seconds"], delta=0.25 * alone["sim_seconds"])
        graph.wait_until(lambda: node.poll() is not None, "the node's end")
        self.assertEqual(node.returncode, 0)
        GRAPH.stop(recorder)
        # rosbag's own process closes the bag after the one that was started has ended.
        graph.wait_until(lambda: os.path.exists(bag), "the closed bag")
        self.check_bag(bag, topics)

    def check_bag(self, path, topics):
        env = dict(GRAPH.env, PYTHONPATH=MODULES)
        check = subprocess.run(["/usr/bin/rosbag", "check", path], env=env, stdout=subprocess.PIPE, universal_newlines=True)
        self.assertEqual(check.returncode, 0)
        # Definitions that differ in their comments alone are "migrations" that need no rule.
        self.assertNotIn("rules missing", check.stdout)
        with rosbag.Bag(path) as bag:
            info = bag.get_type_and_topic_info().topics
            for topic in topics:
                self.assertIn(topic, info, sorted(info))
            attached = [m.attached for _, m, _ in bag.read_messages("/grasp_event_republisher/grasp_events")]
            self.assertEqual(attached[:2], [True, False])
            goals = [m.goal_constraints[0].name for _, m, _ in bag.read_messages("/move_group/motion_plan_request")]
            self.assertTrue(goals[0].startswith("pick") and "place" in goals, goals)
            carried = [len(m.start_state.attached_collision_objects) for _, m, _ in
                       bag.read_messages("/move_group/motion_plan_request") if m.goal_constraints[0].name == "place"]
            self.assertEqual(set(carried), {1})

    def test_inputs_played_from_a_bag_drive_the_node(self):
        path = os.path.join(GRAPH.home, "inputs.bag")
        with rosbag.Bag(path, "w") as bag:
            for k in range(200):
                t = rospy.Time(2000 + 0.05 * k)
                gesture = "wrist_extension" if 40 <= k < 160 else "no_motion"
                bag.write("/emg", String(data=gesture), t)
        frames = graph.Inbox("/mpl_right_arm/joint_states", JointState)
        gestures = graph.Inbox("/proact/frame", Frame)
        log = graph.Inbox("/rosout", Log, keep=1000)
        node = GRAPH.node("testbed", "--live", "--method", "A", "--setup", "still", "_keep_running:=true")
        gestures.wait_count(5)
        first = dict(zip(frames.messages[0].name, frames.messages[0].position))
        player = GRAPH.spawn(["/usr/bin/rosbag", "play", "-q", "--wait-for-subscribers", path], "play.log")
        gestures.wait(lambda m: m.view.gesture == WRIST_EXTENSION)
        moved = lambda m: abs(dict(zip(m.name, m.position))["mpl_right_arm__shoulder"] - first["mpl_right_arm__shoulder"])
        frames.wait(lambda m: moved(m) > 0.1)
        graph.wait_until(lambda: player.poll() is not None, "the end of the bag")
        wrong = rospy.Publisher("/emg", String, queue_size=1)
        graph.wait_until(lambda: wrong.get_num_connections() == 1, "the node as subscriber")
        wrong.publish("")
        log.wait(lambda m: "refused (emg)" in m.msg)
        GRAPH.stop(node)

    def test_goals_of_others_move_arm_and_hand_until_the_method_commands_them(self):
        states = graph.Inbox("/mpl_right_arm/joint_states", JointState, keep=2000)
        node = GRAPH.node("testbed", "--live", "--method", "A", "--setup", "still", "_keep_running:=true")
        arm = actionlib.SimpleActionClient("/mpl_right_arm/arm_controller/follow_joint_trajectory", FollowJointTrajectoryAction)
        grasp = actionlib.SimpleActionClient("/grasp", graspAction)
        timeout = rospy.Duration(graph.TIMEOUT_SECS)
        self.assertTrue(arm.wait_for_server(timeout) and grasp.wait_for_server(timeout))
        states.wait_count(1)
        joints = ["mpl_right_arm__" + n for n in "shoulder humerus elbow forearm wristy wristx wristz".split()]
        now = lambda name: dict(zip(states.messages[-1].name, states.messages[-1].position))[name]
        elbow, finger = "mpl_right_arm__forearm", "mpl_right_arm__middle1"

        def to(by, seconds):
            positions = [now(name) + (by if name == elbow else 0.0) for name in joints]
            point = JointTrajectoryPoint(positions=positions, velocities=[0.0] * 7, time_from_start=rospy.Duration(seconds))
            return FollowJointTrajectoryGoal(trajectory=JointTrajectory(joint_names=list(joints), points=[point]))

        # To its end.
        start = now(elbow)
        self.assertEqual(arm.send_goal_and_wait(to(0.2, 1.5), timeout), GoalStatus.SUCCEEDED)
        self.assertAlmostEqual(now(elbow), start + 0.2, delta=0.02)
        # Cancelled half way, and refused: the arm stays.
        arm.send_goal(to(0.3, 3.0))
        states.wait(lambda m: now(elbow) > start + 0.25)
        arm.cancel_goal()
        self.assertTrue(arm.wait_for_result(timeout))
        self.assertEqual(arm.get_state(), GoalStatus.PREEMPTED)
        bad = to(0.1, 1.0)
        bad.trajectory.joint_names[0] = "nose"
        self.assertEqual(arm.send_goal_and_wait(bad, timeout), GoalStatus.REJECTED)
        self.assertLess(now(elbow), start + 0.4)
        # The hand, by the original's action.
        opened = now(finger)
        self.assertEqual(grasp.send_goal_and_wait(graspGoal(instruct=1), timeout), GoalStatus.SUCCEEDED)
        self.assertEqual(grasp.get_result().done, 1)
        self.assertGreater(abs(now(finger) - opened), 0.2)
        self.assertEqual(grasp.send_goal_and_wait(graspGoal(instruct=2), timeout), GoalStatus.SUCCEEDED)
        self.assertAlmostEqual(now(finger), opened, delta=0.05)
        # The method commands the arm: the goal is over, and the arm goes where the gesture says.
        emg = rospy.Publisher("/emg", String, queue_size=1)
        graph.wait_until(lambda: emg.get_num_connections() == 1, "the node as subscriber")
        shoulder = now("mpl_right_arm__shoulder")
        arm.send_goal(to(-0.3, 20.0))
        graph.wait_until(lambda: arm.get_state() == GoalStatus.ACTIVE, "the goal at work")
        gesture = String(data="no_motion")
        frames = graph.Inbox("/proact/frame", Frame)
        beat = rospy.Timer(rospy.Duration(0.05), lambda _: emg.publish(gesture))
        try:
            frames.wait_count(30)
            gesture.data = "wrist_extension"
            self.assertTrue(arm.wait_for_result(timeout))
            self.assertEqual(arm.get_state(), GoalStatus.PREEMPTED)
            self.assertIn("the method", arm.get_goal_status_text())
            left = now(elbow)
            states.wait(lambda m: abs(now("mpl_right_arm__shoulder") - shoulder) > 0.1)
            self.assertAlmostEqual(now(elbow), left, delta=0.01)
        finally:
            beat.shutdown()
        GRAPH.stop(node)

    @unittest.skipUnless(shutil.which("Xvfb") and shutil.which("rviz"), "no Xvfb or rviz")
    def test_rviz_draws_arm_box_and_blocks(self):
        os.makedirs(SHOTS, exist_ok=True)
        src = os.path.join(graph.ROOT, "ros1_ws", "src")
        GRAPH.env["ROS_PACKAGE_PATH"] = src + ":/usr/share"
        urdf = open(os.path.join(src, "proact_description", "arms", "mpl_right", "arm.urdf")).read()
        rospy.set_param("/robot_description", urdf)
        rospy.set_param("/use_sim_time", True)
        publisher = GRAPH.spawn(
            ["/usr/lib/robot_state_publisher/robot_state_publisher",
             "joint_states:=/mpl_right_arm/wrapped_joint_states"], "rsp.log")
        node = GRAPH.node("testbed", "--method", "D", "--seed", "1", "_publish_links:=false")
        shot = os.path.join(SHOTS, "rviz.png")
        display = f":{90 + os.getpid() % 100}"
        screen = GRAPH.spawn(["Xvfb", display, "-screen", "0", "1200x800x24"], "xvfb.log")
        GRAPH.env["DISPLAY"] = display
        graph.wait_until(lambda: os.path.exists(f"/tmp/.X11-unix/X{display[1:]}"), "the virtual display")
        layout = os.path.join(src, "proact_bringup", "rviz", "proact.rviz")
        rviz = GRAPH.spawn(["/usr/bin/rviz", "-d", layout], "rviz.log")
        graph.wait_until(lambda: any("rviz" in n for n in GRAPH.nodes()), "rviz")

        def colours():
            taken = subprocess.run(["import", "-window", "root", shot], env=GRAPH.env, stderr=subprocess.DEVNULL)
            if taken.returncode != 0:
                return {}
            text = subprocess.run(["convert", shot, "-resize", "300x200", "txt:-"], stdout=subprocess.PIPE,
                                  universal_newlines=True).stdout
            found = {"red": 0, "blue": 0, "wood": 0, "arm": 0}
            for line in text.splitlines()[1:]:
                r, g, b = (int(v) for v in line.split("#")[1][:6] and
                           [line.split("#")[1][k:k + 2] for k in (0, 2, 4)] and
                           [str(int(line.split("#")[1][k:k + 2], 16)) for k in (0, 2, 4)])
                if r > 110 and g < 70 and b < 70:
                    found["red"] += 1
                elif b > 90 and r < 60 and g < 90:
                    found["blue"] += 1
                elif 20 < r - b < 90 and r > g > b:
                    found["wood"] += 1
                elif r > 120 and abs(r - g) < 12 and abs(g - b) < 12:
                    found["arm"] += 1
            return found

        seen = {}

        def drawn():
            seen.update(colours())
            return all(seen.get(k, 0) > 8 for k in ("red", "blue", "wood", "arm"))

        try:
            graph.wait_until(drawn, "red and blue blocks, the box and the arm in the picture", 90)
        finally:
            print("pixels of 60000:", seen, "picture:", shot)
            for process in (rviz, node, publisher, screen):
                GRAPH.stop(process)


if __name__ == "__main__":
    unittest.main(verbosity=2)
