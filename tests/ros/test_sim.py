"""`proact node sim` as Debian's rospy and roscpp clients see it."""

import json
import math
import os
import signal
import statistics
import subprocess
import threading
import time
import unittest

import graph

graph.message_packages()
GRAPH = graph.Graph()

import actionlib  # noqa: E402
import rospy  # noqa: E402
import tf2_ros  # noqa: E402
from actionlib_msgs.msg import GoalID, GoalStatus  # noqa: E402
from control_msgs.msg import (  # noqa: E402
    FollowJointTrajectoryAction, FollowJointTrajectoryActionGoal, FollowJointTrajectoryActionResult,
    FollowJointTrajectoryGoal, FollowJointTrajectoryResult, JointTolerance,
)
from controller_manager_msgs.srv import ListControllers, LoadController, SwitchController  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from gazebo_grasp_plugin_ros.msg import GazeboGraspEvent  # noqa: E402
from gazebo_msgs.msg import LinkState, LinkStates, ModelState, ModelStates  # noqa: E402
from gazebo_msgs.srv import GetLinkState, GetModelState, SetLinkState, SetModelState, SpawnModel  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402
from mpl_control.msg import graspAction, graspGoal  # noqa: E402
from rosgraph_msgs.msg import Clock, Log  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from std_srvs.srv import Empty  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint  # noqa: E402

ARM = ["mpl_right_arm__" + n for n in "shoulder humerus elbow forearm wristy wristx wristz".split()]
ACTION = "/mpl_right_arm/arm_controller/follow_joint_trajectory"


# Parent and child of what is told of without a tracked head: the table in docs/ros1.md.
ORIGINAL_FRAMES = {
    ("optitrack_world", "Clipboard"),
    ("optitrack_world", "Clipboard_filtered"),
    ("optitrack_world", "Shoulderpad"),
    ("optitrack_world", "Shoulderpad_filtered"),
    ("optitrack_world", "ShoulderpadL"),
    ("Clipboard_filtered", "tabletag_ros"),
    ("tabletag_ros", "world"),
    ("world", "table"),
    ("world", "hololens_world_test"),
    ("Shoulderpad", "base_link"),
}


def setUpModule():
    global SIM, STATES, LOG, DIAGNOSTICS
    rospy.init_node("test_sim", disable_signals=True)
    STATES = graph.Inbox("/mpl_right_arm/joint_states", JointState, keep=2000)
    LOG = graph.Inbox("/rosout", Log, keep=2000)
    DIAGNOSTICS = graph.Inbox("/diagnostics", DiagnosticArray, keep=50)
    SIM = GRAPH.node("sim", "--setup", "still")
    STATES.wait_count(1)


def tearDownModule():
    GRAPH.close()


def arm_now():
    message = STATES.messages[-1]
    return [message.position[message.name.index(n)] for n in ARM]


def arm_speed():
    message = STATES.messages[-1]
    return max(abs(message.velocity[message.name.index(n)]) for n in ARM)


def trajectory(*points, names=ARM):
    message = JointTrajectory(joint_names=list(names))
    for time_secs, positions in points:
        message.points.append(JointTrajectoryPoint(
            positions=positions, velocities=[0.0] * len(positions), time_from_start=rospy.Duration(time_secs)))
    return message


def bent(by, joint=3):
    q = arm_now()
    q[joint] += by
    return q


def client(kind=FollowJointTrajectoryAction, name=ACTION):
    c = actionlib.SimpleActionClient(name, kind)
    assert c.wait_for_server(rospy.Duration(graph.TIMEOUT_SECS)), f"no server {name}"
    return c


class Simulator(unittest.TestCase):
    def test_joints_and_frames_come_at_the_set_rate_with_one_stamp(self):
        tf = graph.Inbox("/tf", TFMessage)
        tf.wait_count(1)
        first = tf.messages[0].transforms[0].header.stamp
        tf.wait_count(500)
        stamps = [m.transforms[0].header.stamp for m in tf.messages[:500]]
        # By the node's own stamps: exactly one instant every 10 ms.
        steps = {round((b - a).to_sec() * 1000) for a, b in zip(stamps, stamps[1:])}
        self.assertEqual(steps, {10}, first)
        for message in tf.messages[:50]:
            self.assertEqual(len({t.header.stamp.to_nsec() for t in message.transforms}), 1)
        STATES.wait(lambda m: m.header.stamp == stamps[-1])
        message = STATES.messages[-1]
        self.assertEqual(len(message.name), 27)
        self.assertEqual(message.name, sorted(message.name))
        tf.subscriber.unregister()

    # Before test_tf2, whose listener stays: what was said once is not said again to a second listener in one process.
    def test_frames_of_the_original_hang_where_it_has_them(self):
        moving, fixed = graph.Inbox("/tf", TFMessage), graph.Inbox("/tf_static", TFMessage)
        moving.wait_count(2)
        frames = {(t.header.frame_id, t.child_frame_id)
                for m in moving.messages + [fixed.wait()] for t in m.transforms}
        self.assertEqual(ORIGINAL_FRAMES - frames, set())
        # One parent each: whoever counts on the original's tree gets one tree.
        children = [child for _, child in frames]
        self.assertEqual(len(children), len(set(children)))
        moving.subscriber.unregister()
        fixed.subscriber.unregister()

    def test_tf2_leads_from_every_frame_of_the_original_to_the_world(self):
        buffer = tf2_ros.Buffer(rospy.Duration(30))
        tf2_ros.TransformListener(buffer)
        frames = ["optitrack_world", "Clipboard_filtered", "tabletag_ros", "table", "Shoulderpad",
                  "Shoulderpad_filtered", "base_link", "hololens_world_test", "redcylinder1", "bluecylinder2",
                  "mpl_right_arm__forequarter_link", "mpl_right_arm__wristz_link", "mpl_right_arm__thumb3_link"]
        for frame in frames:
            graph.wait_until(lambda: buffer.can_transform("world", frame, rospy.Time(0)), frame)
        models = graph.Inbox("/gazebo/model_states", ModelStates)
        pose = models.wait().pose[0].position
        got = buffer.lookup_transform("world", "base_link", rospy.Time(0)).transform.translation
        for axis in "xyz":
            self.assertAlmostEqual(getattr(got, axis), getattr(pose, axis), delta=1e-9)
        # The tip by tf2 is the tip by the simulator's own links.
        links = graph.Inbox("/gazebo/link_states", LinkStates)
        message = links.wait()
        tip = message.pose[message.name.index("mpl_right_arm::mpl_right_arm__wristz_link")].position
        got = buffer.lookup_transform("world", "mpl_right_arm__wristz_link", rospy.Time(0)).transform.translation
        for axis in "xyz":
            # The arm holds still but for its controllers' last micrometres.
            self.assertAlmostEqual(getattr(got, axis), getattr(tip, axis), delta=1e-5)
        models.subscriber.unregister()
        links.subscriber.unregister()

    def test_who_comes_later_lives_on_simulated_time(self):
        self.assertIs(rospy.get_param("/use_sim_time"), True)
        code = ("import rospy; rospy.init_node('late'); rospy.sleep(0.1); "
                "print(rospy.get_time() < 1e6)")
        late = subprocess.run(["/usr/bin/python3", "-c", code], env=GRAPH.env, capture_output=True, text=True,
                              timeout=graph.TIMEOUT_SECS)
        self.assertEqual(late.stdout.strip(), "True", late.stderr)

    def test_a_goal_with_a_stamp_ahead_waits_for_it(self):
        clock = graph.Inbox("/clock", Clock, keep=10)
        clock.wait_count(1)
        c, goal = client(), FollowJointTrajectoryGoal(trajectory=trajectory((0.5, bent(0.2))))
        # The test before may leave it near its target and still moving.
        graph.wait_until(lambda: arm_speed() < 0.001, "the arm at rest")
        begun = clock.messages[-1].clock
        goal.trajectory.header.stamp = begun + rospy.Duration(1.0)
        before = arm_now()[3]
        c.send_goal(goal)
        STATES.wait(lambda m: m.header.stamp > begun + rospy.Duration(0.7))
        # By their stamps: on a busy machine this test may read them after the goal has begun.
        early = [m for m in list(STATES.messages) if begun < m.header.stamp < begun + rospy.Duration(1.0)]
        elbow = [m.position[m.name.index(ARM[3])] for m in early]
        self.assertTrue(elbow)
        self.assertLess(max(abs(angle - before) for angle in elbow), 0.01, "it has not begun")
        self.assertTrue(c.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS)))
        self.assertEqual(c.get_state(), GoalStatus.SUCCEEDED, c.get_goal_status_text())
        self.assertGreaterEqual(clock.messages[-1].clock, begun + rospy.Duration(1.4))
        self.assertAlmostEqual(arm_now()[3], before + 0.2, delta=0.02)
        # A stamp of the wall's clock.
        goal.trajectory.header.stamp = rospy.Time.from_sec(time.time())
        c.send_goal(goal)
        self.assertTrue(c.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS)))
        self.assertEqual(c.get_state(), GoalStatus.REJECTED)
        self.assertIn("/use_sim_time", c.get_goal_status_text())

    def test_a_trajectory_goal_is_followed_with_feedback_and_succeeds(self):
        c, feedback = client(), []
        target = bent(0.2)
        c.send_goal(FollowJointTrajectoryGoal(trajectory=trajectory((1.0, target))), feedback_cb=feedback.append)
        self.assertTrue(c.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS)))
        self.assertEqual(c.get_state(), GoalStatus.SUCCEEDED)
        self.assertEqual(c.get_result().error_code, FollowJointTrajectoryResult.SUCCESSFUL)
        self.assertGreater(len(feedback), 5)
        self.assertEqual(feedback[0].joint_names, ARM)
        graph.wait_until(lambda: max(abs(a - b) for a, b in zip(arm_now(), target)) < 0.05, "the arm at its goal")

    def test_a_trajectory_in_moveits_shape_is_followed_in_every_joint(self):
        # Many points with positions, velocities and accelerations, as its time parameteriser writes them.
        start, duration, count = arm_now(), 1.2, 25
        by = [-0.05, -0.04, 0.05, 0.15, -0.1, 0.03, -0.06]
        message = JointTrajectory(joint_names=list(reversed(ARM)))
        message.header.frame_id = "world"
        for k in range(count):
            s = k / (count - 1)
            shape = (10 * s**3 - 15 * s**4 + 6 * s**5, (30 * s**2 - 60 * s**3 + 30 * s**4) / duration,
                     (60 * s - 180 * s**2 + 120 * s**3) / duration**2)
            point = JointTrajectoryPoint(time_from_start=rospy.Duration(s * duration))
            point.positions = [q + d * shape[0] for q, d in zip(start, by)][::-1]
            point.velocities = [d * shape[1] for d in by][::-1]
            point.accelerations = [d * shape[2] for d in by][::-1]
            message.points.append(point)
        c, errors = client(), []
        c.send_goal(FollowJointTrajectoryGoal(trajectory=message),
                    feedback_cb=lambda f: errors.append(max(map(abs, f.error.positions))))
        self.assertTrue(c.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS)))
        self.assertEqual(c.get_state(), GoalStatus.SUCCEEDED, c.get_goal_status_text())
        self.assertLess(max(errors), 0.05, "the arm stays on the path")
        target = [q + d for q, d in zip(start, by)]
        graph.wait_until(lambda: max(abs(a - b) for a, b in zip(arm_now(), target)) < 0.02, "every joint at its goal")

    def test_a_new_goal_preempts_and_a_cancel_holds_the_arm(self):
        first, second = client(), client()
        first.send_goal(FollowJointTrajectoryGoal(trajectory=trajectory((3.0, bent(-0.3)))))
        graph.wait_until(lambda: first.get_state() == GoalStatus.ACTIVE, "the first goal")
        second.send_goal(FollowJointTrajectoryGoal(trajectory=trajectory((4.0, bent(0.3)))))
        self.assertTrue(first.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS)))
        self.assertEqual(first.get_state(), GoalStatus.PREEMPTED)
        graph.wait_until(lambda: second.get_state() == GoalStatus.ACTIVE, "the second goal")
        second.cancel_goal()
        self.assertTrue(second.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS)))
        self.assertEqual(second.get_state(), GoalStatus.PREEMPTED)
        self.assert_arm_comes_to_rest()

    def test_a_path_tolerance_that_is_left_aborts_the_goal(self):
        c = client()
        goal = FollowJointTrajectoryGoal(trajectory=trajectory((0.05, bent(0.5))))
        # The joint may turn 0.5 rad/s; this path asks for ten.
        goal.path_tolerance = [JointTolerance(name=ARM[3], position=0.05)]
        self.assertEqual(c.send_goal_and_wait(goal, rospy.Duration(graph.TIMEOUT_SECS)), GoalStatus.ABORTED)
        self.assertEqual(c.get_result().error_code, FollowJointTrajectoryResult.PATH_TOLERANCE_VIOLATED)
        self.assertIn("forearm", c.get_result().error_string)

    def test_bad_goals_are_rejected_with_ros_controls_codes(self):
        c = client()
        nan = bent(0.1)
        nan[2] = math.nan
        past = trajectory((0.5, bent(0.1)))
        past.header.stamp = rospy.Time(1000, 1)
        cases = [
            (trajectory((1.0, nan)), FollowJointTrajectoryResult.INVALID_GOAL, "nan"),
            (trajectory((1.0, bent(0.1)[:6])), FollowJointTrajectoryResult.INVALID_GOAL, "expected 7"),
            (trajectory((1.0, bent(0.1)), names=ARM[:6] + ["nose"]), FollowJointTrajectoryResult.INVALID_JOINTS, "nose"),
            (trajectory((1.0, bent(0.1)), (0.5, bent(0.1))), FollowJointTrajectoryResult.INVALID_GOAL, "more than 1"),
            (trajectory(), FollowJointTrajectoryResult.INVALID_GOAL, "no points"),
            (past, FollowJointTrajectoryResult.OLD_HEADER_TIMESTAMP, "before it came"),
        ]
        graph.wait_until(lambda: STATES.messages[-1].header.stamp.to_sec() > 1001, "a second of simulated time")
        for message, code, reason in cases:
            state = c.send_goal_and_wait(FollowJointTrajectoryGoal(trajectory=message), rospy.Duration(graph.TIMEOUT_SECS))
            self.assertEqual(state, GoalStatus.REJECTED, reason)
            self.assertEqual(c.get_result().error_code, code, reason)
            self.assertIn(reason, c.get_result().error_string.lower())
        LOG.wait(lambda m: "refused (trajectory)" in m.msg)
        DIAGNOSTICS.wait(lambda m: any(v.key == "trajectory refused" for s in m.status for v in s.values))

    def test_a_command_topic_moves_the_arm_and_bad_commands_do_not(self):
        publisher = rospy.Publisher("/mpl_right_arm/arm_controller/command", JointTrajectory, queue_size=5)
        graph.wait_until(lambda: publisher.get_num_connections() == 1, "the simulator as subscriber")
        target = bent(-0.1)
        publisher.publish(trajectory((0.5, target)))
        graph.wait_until(lambda: abs(arm_now()[3] - target[3]) < 0.02, "the arm at the commanded angle")
        LOG.clear()
        still = arm_now()
        publisher.publish(trajectory((0.5, [math.inf] * 7)))
        LOG.wait(lambda m: "refused" in m.msg or "inf" in m.msg)
        self.assertLess(max(abs(a - b) for a, b in zip(arm_now(), still)), 0.02)

    def test_grasp_closes_and_opens_reports_and_can_be_cancelled(self):
        c = client(graspAction, "/grasp")
        for instruct in (1, 2):
            state = c.send_goal_and_wait(graspGoal(instruct=instruct), rospy.Duration(graph.TIMEOUT_SECS))
            self.assertEqual((state, c.get_result().done), (GoalStatus.SUCCEEDED, 1))
        self.assertEqual(c.send_goal_and_wait(graspGoal(instruct=3), rospy.Duration(5)), GoalStatus.REJECTED)
        c.send_goal(graspGoal(instruct=1))
        graph.wait_until(lambda: c.get_state() == GoalStatus.ACTIVE, "the hand closing")
        c.cancel_goal()
        self.assertTrue(c.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS)))
        self.assertEqual((c.get_state(), c.get_result().done), (GoalStatus.PREEMPTED, 0))
        c.send_goal_and_wait(graspGoal(instruct=2), rospy.Duration(graph.TIMEOUT_SECS))

    def test_a_hand_trajectory_ends_a_grasp_only_when_it_is_valid(self):
        grasp = client(graspAction, "/grasp")
        hand = client(name="/mpl_right_arm/hand_controller/follow_joint_trajectory")
        grasp.send_goal(graspGoal(instruct=1))
        graph.wait_until(lambda: grasp.get_state() == GoalStatus.ACTIVE, "the hand closing")
        bad = FollowJointTrajectoryGoal(trajectory=trajectory((1.0, [0.0]), names=["nose"]))
        self.assertEqual(hand.send_goal_and_wait(bad, rospy.Duration(graph.TIMEOUT_SECS)), GoalStatus.REJECTED)
        self.assertTrue(grasp.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS)))
        self.assertEqual((grasp.get_state(), grasp.get_result().done), (GoalStatus.SUCCEEDED, 1))
        grasp.send_goal(graspGoal(instruct=2))
        graph.wait_until(lambda: grasp.get_state() == GoalStatus.ACTIVE, "the hand opening")
        now = dict(zip(STATES.messages[-1].name, STATES.messages[-1].position))
        fingers = [name for name in now if name not in ARM]
        good = trajectory((0.5, [now[f] for f in fingers]), names=fingers)
        hand.send_goal(FollowJointTrajectoryGoal(trajectory=good))
        self.assertTrue(grasp.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS)))
        self.assertEqual((grasp.get_state(), grasp.get_result().done), (GoalStatus.PREEMPTED, 0))
        hand.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS))
        grasp.send_goal_and_wait(graspGoal(instruct=2), rospy.Duration(graph.TIMEOUT_SECS))

    def test_the_same_goal_twice_and_a_goal_behind_its_cancel_leave_the_arm_alone(self):
        goals = rospy.Publisher(f"{ACTION}/goal", FollowJointTrajectoryActionGoal, queue_size=5)
        cancels = rospy.Publisher(f"{ACTION}/cancel", GoalID, queue_size=5)
        results = graph.Inbox(f"{ACTION}/result", FollowJointTrajectoryActionResult)
        graph.wait_until(lambda: goals.get_num_connections() and cancels.get_num_connections(), "the simulator")
        target = bent(0.2)
        twice = FollowJointTrajectoryActionGoal()
        twice.goal_id.id = "twice"
        twice.goal.trajectory = trajectory((2.0, target))
        goals.publish(twice)
        begun = arm_now()[3]
        graph.wait_until(lambda: abs(arm_now()[3] - begun) > 0.03, "the arm on its way")
        goals.publish(twice)
        late = FollowJointTrajectoryActionGoal()
        late.goal_id.id = "late"
        late.goal.trajectory = trajectory((1.0, bent(-0.2)))
        cancels.publish(GoalID(id="late"))
        rospy.sleep(0.1)
        goals.publish(late)
        ended = lambda name, state: lambda m: (m.status.goal_id.id, m.status.status) == (name, state)
        results.wait(ended("late", GoalStatus.RECALLED))
        results.wait(ended("twice", GoalStatus.SUCCEEDED))
        self.assertLess(abs(arm_now()[3] - target[3]), 0.02)

    def test_a_best_effort_switch_with_a_bad_name_ends_the_goal_of_what_it_stops(self):
        switch = rospy.ServiceProxy("/mpl_right_arm/controller_manager/switch_controller", SwitchController)
        c = client()
        c.send_goal(FollowJointTrajectoryGoal(trajectory=trajectory((3.0, bent(-0.2)))))
        graph.wait_until(lambda: c.get_state() == GoalStatus.ACTIVE, "the goal")
        try:
            self.assertTrue(switch(stop_controllers=["arm_controller", "nonsense"], strictness=1).ok)
            self.assertTrue(c.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS)))
            self.assertEqual(c.get_state(), GoalStatus.ABORTED)
        finally:
            switch(start_controllers=["arm_controller"], strictness=1)

    def test_controllers_are_loaded_and_switched_as_the_originals_script_does(self):
        services = "/mpl_right_arm/controller_manager/"
        listed = rospy.ServiceProxy(services + "list_controllers", ListControllers)
        states = lambda: {c.name: c.state for c in listed().controller}
        switch = rospy.ServiceProxy(services + "switch_controller", SwitchController)
        names = [f"j{k}_controller" for k in range(7)]
        self.assertEqual(states()["arm_controller"], "running")
        self.assertFalse(switch(start_controllers=names, stop_controllers=["arm_controller"], strictness=2).ok)
        self.assertEqual(states()["arm_controller"], "running", "a strict switch that fails changes nothing")
        load = rospy.ServiceProxy(services + "load_controller", LoadController)
        self.assertTrue(all(load(name).ok for name in names))
        self.assertFalse(load("nonsense").ok)
        # Both at once would fight over the joints.
        self.assertFalse(switch(start_controllers=names, stop_controllers=[], strictness=2).ok)
        self.assertTrue(switch(start_controllers=names, stop_controllers=["arm_controller"], strictness=2).ok)
        self.assertEqual({states()[n] for n in names}, {"running"})
        publisher = rospy.Publisher("/mpl_right_arm/j3_controller/command", JointTrajectory, queue_size=1)
        graph.wait_until(lambda: publisher.get_num_connections() == 1, "the simulator as subscriber")
        target = arm_now()[3] + 0.1
        publisher.publish(trajectory((0.3, [target]), names=[ARM[3]]))
        graph.wait_until(lambda: abs(arm_now()[3] - target) < 0.02, "one joint at its angle")
        self.assertTrue(switch(start_controllers=["arm_controller"], stop_controllers=names, strictness=2).ok)

    def test_a_links_state_is_that_of_tf_and_blocks_are_put_where_gazebos_services_say(self):
        link = rospy.ServiceProxy("/gazebo/get_link_state", GetLinkState)
        tip = "mpl_right_arm::mpl_right_arm__wristz_link"
        answer = link(tip, "world")
        self.assertTrue(answer.success, answer.status_message)
        self.assertEqual((answer.link_state.link_name, answer.link_state.reference_frame), (tip, "world"))
        links = graph.Inbox("/gazebo/link_states", LinkStates, keep=10)
        links_now = links.wait(lambda m: tip in m.name)
        links.subscriber.unregister()
        expected = links_now.pose[links_now.name.index(tip)].position
        got = answer.link_state.pose.position
        for axis in "xyz":
            self.assertAlmostEqual(getattr(got, axis), getattr(expected, axis), delta=2e-3)
        # Seen from itself it is at the origin, by its name alone too.
        own = link("mpl_right_arm__wristz_link", tip).link_state.pose
        self.assertAlmostEqual(abs(own.orientation.w), 1.0, places=9)
        self.assertFalse(link("mpl_right_arm::teapot", "").success)
        self.assertFalse(link(tip, "teapot").success)

        get = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
        put = rospy.ServiceProxy("/gazebo/set_model_state", SetModelState)
        home = get("redcylinder1", "").pose
        asked = ModelState(model_name="redcylinder1", pose=get("redcylinder1", "").pose, reference_frame="world")
        asked.pose.position.x, asked.pose.position.y, asked.pose.position.z = 0.0, 0.27, 1.10
        answer = put(asked)
        self.assertTrue(answer.success, answer.status_message)
        graph.wait_until(lambda: abs(get("redcylinder1", "").pose.position.z - 1.04) < 2e-3, "the block fallen to the table")
        self.assertAlmostEqual(get("redcylinder1", "").pose.position.y, 0.27, delta=0.01)
        asked.pose.position.z = 1.0
        self.assertIn("mm inside", put(asked).status_message)
        self.assertAlmostEqual(get("redcylinder1", "").pose.position.z, 1.04, delta=2e-3)
        for model, z, expected in (("mpl_right_arm", 2.0, "only redcylinder1"), ("redcylinder1", math.nan, "nan")):
            asked.model_name, asked.pose.position.z = model, z
            refused = put(asked)
            self.assertFalse(refused.success)
            self.assertIn(expected, refused.status_message.lower())
        for service in ("spawn_urdf_model", "spawn_sdf_model"):
            spawn = rospy.ServiceProxy(f"/gazebo/{service}", SpawnModel)
            self.assertTrue(spawn("redcylinder1", "", "", home, "world").success)
            self.assertIn("cannot be put", spawn("teapot", "", "", home, "world").status_message)
        self.assertAlmostEqual(get("redcylinder1", "").pose.position.y, home.position.y, delta=0.01)

    def test_the_base_moves_and_gazebos_services_answer(self):
        get = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
        self.assertAlmostEqual(get("redcylinder1", "ground_plane").pose.position.z, 1.04, delta=2e-3)
        self.assertFalse(get("teapot", "").success)
        before = get("mpl_right_arm", "world").pose
        link = LinkState(link_name="mpl_right_arm::base_link", pose=before, reference_frame="world")
        link.pose.position.z += 0.02
        publisher = rospy.Publisher("/gazebo/set_link_state", LinkState, queue_size=1)
        graph.wait_until(lambda: publisher.get_num_connections() == 1, "the simulator as subscriber")
        publisher.publish(link)
        height = link.pose.position.z
        graph.wait_until(lambda: abs(get("mpl_right_arm", "").pose.position.z - height) < 1e-6, "the base at its new height")
        link.pose.position.z = math.nan
        answer = rospy.ServiceProxy("/gazebo/set_link_state", SetLinkState)(link)
        self.assertFalse(answer.success)
        self.assertIn("nan", answer.status_message.lower())
        link.link_name = "mpl_right_arm::nose"
        self.assertFalse(rospy.ServiceProxy("/gazebo/set_link_state", SetLinkState)(link).success)

    def test_pause_stops_time_and_unpause_goes_on(self):
        clock = graph.Inbox("/clock", Clock, keep=100)
        clock.wait_count(3)
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        # Whatever was on its way has come when a second call has been answered.
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        graph.wait_until(lambda: time.monotonic() - clock.times[-1] > 0.3, "silence")
        paused = clock.messages[-1].clock
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        after = clock.wait(lambda m: m.clock > paused).clock
        self.assertLess((after - paused).to_sec(), 0.1)
        clock.subscriber.unregister()

    def test_time_that_goes_back_and_a_flood_are_refused_and_counted(self):
        publisher = rospy.Publisher("/Shoulderpad_filtered_pose", PoseStamped, queue_size=1)
        graph.wait_until(lambda: publisher.get_num_connections() == 1, "the simulator as subscriber")
        pose = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)("mpl_right_arm", "").pose
        message = PoseStamped(pose=pose)
        message.header.stamp = rospy.Time(4000)

        def backwards():
            # To and fro: whichever message is lost, one step back arrives.
            message.header.stamp = rospy.Time(9000 - message.header.stamp.secs)
            publisher.publish(message)
            return self.refused("time")

        graph.wait_until(backwards, "the refusal of time going back")
        flood = rospy.Publisher("/proact/heartbeat", String, queue_size=100000)
        graph.wait_until(lambda: flood.get_num_connections() == 1, "the simulator as subscriber")

        def pour():
            for _ in range(2000):
                flood.publish("flood")
            return self.refused("flood")

        graph.wait_until(pour, "the refusal of a flood")
        flood.unregister()

    def test_a_sender_that_promised_to_speak_and_falls_silent_stops_the_arm(self):
        beat = rospy.Publisher("/proact/heartbeat", String, queue_size=10)
        graph.wait_until(lambda: beat.get_num_connections() == 1, "the simulator as subscriber")
        c = client()
        c.send_goal(FollowJointTrajectoryGoal(trajectory=trajectory((6.0, bent(0.5)))))
        graph.wait_until(lambda: c.get_state() == GoalStatus.ACTIVE, "the goal")
        beat.publish("alive")
        self.assertTrue(c.wait_for_result(rospy.Duration(graph.TIMEOUT_SECS)))
        self.assertEqual(c.get_state(), GoalStatus.ABORTED)
        self.assertIn("silent", c.get_goal_status_text())
        self.assert_arm_comes_to_rest()

    def test_a_roscpp_client_follows_a_trajectory_too(self):
        source = os.path.join(os.path.dirname(__file__), "roscpp_client")
        build = os.path.join(graph.ROOT, "build", "roscpp_client")
        for command in (["cmake", "-S", source, "-B", build, "-DPYTHON_EXECUTABLE=/usr/bin/python3"], ["cmake", "--build", build]):
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=GRAPH.env)
        done = subprocess.run([os.path.join(build, "roscpp_client")], env=GRAPH.env, timeout=120,
                              stdout=subprocess.PIPE, universal_newlines=True)
        self.assertEqual(done.returncode, 0, done.stdout)

    def test_reset_puts_the_blocks_and_the_arm_back(self):
        before = arm_now()
        rospy.ServiceProxy("/gazebo/reset_world", Empty)()
        get = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
        self.assertAlmostEqual(get("bluecylinder1", "").pose.position.z, 1.04, delta=2e-3)
        graph.wait_until(lambda: abs(arm_now()[0] - 1.029) < 0.02, f"the arm at its start pose, not {before}")

    def refused(self, kind):
        return any(v.key == f"{kind} refused" for m in list(DIAGNOSTICS.messages) for s in m.status for v in s.values)

    def assert_arm_comes_to_rest(self):
        def rests():
            message = STATES.messages[-1]
            return max(abs(message.velocity[message.name.index(n)]) for n in ARM) < 0.02

        graph.wait_until(rests, "the arm at rest")


class TheEnd(unittest.TestCase):
    """Last by name, because they take the master away."""

    def test_without_a_master_the_node_ends_with_one_line(self):
        env = dict(GRAPH.env, ROS_MASTER_URI=f"http://127.0.0.1:{graph.free_port()}/")
        done = subprocess.run([graph.BINARY, "node", "sim"], env=env, timeout=60,
                              stderr=subprocess.PIPE, universal_newlines=True)
        self.assertNotEqual(done.returncode, 0)
        self.assertNotIn("panicked", done.stderr)
        log_lines = [line for line in done.stderr.splitlines() if line.startswith("proact:")]
        self.assertEqual(len(log_lines), 1, done.stderr)
        self.assertIn("no ROS master", log_lines[0])

    def test_zz_after_a_master_restart_the_node_is_back_paused_with_its_blocks(self):
        get = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
        before = get("redcylinder2", "").pose
        GRAPH.stop(GRAPH.rosout, signal.SIGKILL)
        GRAPH.stop(GRAPH.master, signal.SIGKILL)
        GRAPH.start_master()
        came_back = time.monotonic()
        graph.wait_until(lambda: "/proact_sim" in GRAPH.nodes(), "the node on the new master")
        took = time.monotonic() - came_back
        graph.wait_until(lambda: any(name == "/gazebo/unpause_physics" for name, _ in GRAPH.system_state()[2]), "services")
        print(f"registered again {took:.2f} s after the master was back")
        self.assertEqual(get("redcylinder2", "").pose, before)
        clock = graph.Inbox("/clock", Clock, keep=100)
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        clock.wait_count(3)
        self.assertIsNone(SIM.poll(), "the same process goes on")

    def test_zzz_the_node_leaves_the_graph_when_it_is_asked_to_end(self):
        self.assertEqual(GRAPH.stop(SIM), 0, open(SIM.log).read()[-2000:])
        graph.wait_until(lambda: "/proact_sim" not in GRAPH.nodes(), "the node gone from the master")

    def test_zzzy_a_node_that_lives_on_simulated_time_leaves_the_graph_too(self):
        def run_and_end():
            sim = GRAPH.node("sim", "--setup", "still")
            # Its loop answers. No topic would tell: rospy does not register again with a master that was restarted, so what
            # this process has listened to before stays silent.
            rospy.wait_for_service("/gazebo/unpause_physics", graph.TIMEOUT_SECS)
            graph.wait_until(lambda: "/proact_sim" in GRAPH.nodes(), "the node at the master")
            rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
            during = rospy.get_param("/use_sim_time", None)
            self.assertEqual(GRAPH.stop(sim), 0, open(sim.log).read()[-2000:])
            graph.wait_until(lambda: "/proact_sim" not in GRAPH.nodes(), "the node gone from the master")
            return during, rospy.get_param("/use_sim_time", None)
        rospy.set_param("/use_sim_time", True)
        self.assertEqual(run_and_end(), (True, True), "who did not set it leaves it")
        rospy.delete_param("/use_sim_time")
        self.assertEqual(run_and_end(), (True, None), "who set it takes it away")

    def test_zzzz_a_trial_ends_when_the_time_of_its_configuration_is_up(self):
        result = graph.Inbox("/proact/result", String)
        GRAPH.node("sim", "--setup", "still", "--set", "limit_secs=2")
        self.assertAlmostEqual(json.loads(result.wait().data)["sim_seconds"], 2.0, delta=0.01)


if __name__ == "__main__":
    unittest.main(verbosity=2)
