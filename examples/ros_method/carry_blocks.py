#!/usr/bin/env python3
"""A control node for ROS 1 in the place of ProACT's `method`: carries each object that the task asks for to its target.

    carry_blocks.py [COUNT]     how many objects to carry; all by default

The hand goes along straight lines: above the object, down, grip, up, across, down, release, up. Damped least squares on the
arm's Jacobian give the joint angles of each point. There is no planner: obstacles beside the lines are not seen.

Lengths are in metres, angles in radians. `a_from_b` is a 4 x 4 matrix that takes points of frame b to frame a.
"""

import argparse
import sys
import xml.etree.ElementTree

import actionlib
import numpy as np
import rospy
import tf2_ros
from control_msgs.msg import FollowJointTrajectoryAction, FollowJointTrajectoryGoal
from geometry_msgs.msg import TransformStamped
from mpl_control.msg import graspAction, graspGoal
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from trajectory_msgs.msg import JointTrajectoryPoint

UP = np.array([0.0, 0.0, 1.0])
STEP_M = 0.01  # from one point of a line to the next, m
CLEARANCE_M = 0.23  # height of the grasp centre on the way, m above the table: a block in hand clears the partition by 5 cm
SPEED_FRACTION = 0.8  # of the joints' speed limits
ORIENTATION_WEIGHT = 0.02  # of the hand's orientation beside its position, m/rad: to reach a far object the hand may lean
DAMPING = 0.02
POSTURE_FRACTION = 0.05  # of the way back to the posture of the start, in each iteration: the elbow keeps its place
TOLERANCE = 0.005  # a solution this near counts, m
LIMIT_MARGIN = 0.01  # angles stay this far from the joints' limits, rad
CLOSE, OPEN = 1, 2  # `instruct` of the action /grasp


def transform(rotation, translation):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def rotation(axis, angle):
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def matrix_of(message):
    """The matrix of a geometry_msgs/Transform."""
    t, q = message.translation, message.rotation
    axis, sine = np.array([q.x, q.y, q.z]), np.linalg.norm([q.x, q.y, q.z])
    turn = rotation(axis / sine, 2 * np.arctan2(sine, q.w)) if sine > 0 else np.eye(3)
    return transform(turn, [t.x, t.y, t.z])


# Axes of the grasp centre in world: z up, and the fingers, along -y, away from the person.
UPRIGHT = rotation(UP, np.pi / 2)


class Arm:
    """The joints from `base` to `tip` as the URDF has them, with the grasp centre at their end."""

    def __init__(self, urdf, base, tip, tip_from_grasp):
        joints = xml.etree.ElementTree.fromstring(urdf).findall("joint")
        joint_to = {joint.find("child").get("link"): joint for joint in joints}
        chain = []
        while tip != base:
            chain.insert(0, joint_to[tip])
            tip = chain[0].find("parent").get("link")
        self.chain, self.names, limits = [], [], []
        for joint in chain:
            origin, axis, limit = (joint.find(part) for part in ("origin", "axis", "limit"))
            roll, pitch, yaw = numbers(origin, "rpy")
            turn = rotation(UP, yaw) @ rotation([0, 1, 0], pitch) @ rotation([1, 0, 0], roll)
            moves = joint.get("type") != "fixed"
            self.chain.append((transform(turn, numbers(origin, "xyz")), numbers(axis, "xyz") if moves else None))
            if moves:
                self.names.append(joint.get("name"))
                limits.append([float(limit.get(key)) for key in ("lower", "upper", "velocity")])
        self.lower, self.upper, self.speed = np.array(limits).T
        self.tip_from_grasp = tip_from_grasp
        self.rest = (self.lower + self.upper) / 2  # the posture that `inverse_kinematics` keeps to

    def forward_kinematics(self, angles, world_from_base):
        """`world_from_grasp`, and the Jacobian of the grasp centre, 6 x joints: linear above angular, in world."""
        pose, angle, axes, origins = world_from_base, iter(angles), [], []
        for parent_from_joint, axis in self.chain:
            pose = pose @ parent_from_joint
            if axis is not None:
                axes.append(pose[:3, :3] @ axis)
                origins.append(pose[:3, 3])
                pose = pose @ transform(rotation(axis, next(angle)), np.zeros(3))
        grasp = pose @ self.tip_from_grasp
        return grasp, np.vstack([np.cross(axes, grasp[:3, 3] - origins).T, np.transpose(axes)])

    def inverse_kinematics(self, angles, world_from_base, point):
        """Angles near `angles` that bring the grasp centre to `point`, with the hand as UPRIGHT has it as far as the limits let it."""
        for _ in range(100):
            grasp, jacobian = self.forward_kinematics(angles, world_from_base)
            away = point - grasp[:3, 3]
            turn = 0.5 * np.cross(grasp[:3, :3], UPRIGHT, axis=0).sum(axis=1)
            error = np.concatenate([away, ORIENTATION_WEIGHT * turn])
            jacobian[3:] *= ORIENTATION_WEIGHT
            change = self.damped_step(angles, jacobian, error)
            angles = angles + change
            if np.abs(change).max() < 1e-4:
                break
        if np.linalg.norm(away) > TOLERANCE:
            raise RuntimeError(f"the arm cannot reach {point}: {np.linalg.norm(away):.3f} m are left")
        return angles

    def damped_step(self, angles, jacobian, error):
        free = np.ones(len(angles), bool)
        while True:
            columns = jacobian * free
            inverse = columns.T @ np.linalg.inv(columns @ columns.T + DAMPING**2 * np.eye(6))
            # What moves the grasp centre; beside it, as far as that does not, back to `rest`.
            back = free * POSTURE_FRACTION * (self.rest - angles)
            change = inverse @ error + back - inverse @ (columns @ back)
            change *= min(1.0, 0.1 / max(np.abs(change).max(), 1e-9))
            after = angles + change
            # A joint that would leave its limits stays, and the others do without it.
            stuck = free & ((after < self.lower + LIMIT_MARGIN) | (after > self.upper - LIMIT_MARGIN))
            if not stuck.any():
                return change
            free &= ~stuck

    def straight_path(self, angles, world_from_base, end):
        """Angles along the straight line of the grasp centre to `end`, the present ones first."""
        start = self.forward_kinematics(angles, world_from_base)[0][:3, 3]
        count = max(2, int(np.linalg.norm(end - start) / STEP_M))
        path = [angles]
        # The first step also turns the hand upright, where it is not.
        for share in np.linspace(0, 1, count + 1)[1:]:
            path.append(self.inverse_kinematics(path[-1], world_from_base, start + share * (end - start)))
        return np.array(path)

    def trajectory(self, path):
        """The goal that follows `path`, from rest to rest within the speed limits."""
        # When each point is passed at the highest speed; then slower at both ends. The middle of a half cosine is pi / 2 times
        # as fast as its mean.
        least = (np.abs(np.diff(path, axis=0)) / (SPEED_FRACTION * self.speed)).max(axis=1) + 1e-3
        share = np.concatenate([[0], np.cumsum(least)]) / least.sum()
        times = 0.5 * least.sum() * np.arccos(1 - 2 * np.clip(share, 0, 1))
        speeds = np.gradient(path, times, axis=0)
        speeds[0] = speeds[-1] = 0
        goal = FollowJointTrajectoryGoal()
        goal.trajectory.joint_names = self.names
        for time, angles, speed in zip(times, path, speeds):
            point = JointTrajectoryPoint(positions=angles, velocities=speed, time_from_start=rospy.Duration(time))
            goal.trajectory.points.append(point)
        return goal


def numbers(element, key):
    return np.array([float(word) for word in element.get(key, "0 0 0").split()]) if element is not None else np.zeros(3)


class Node:
    def __init__(self):
        self.tf = tf2_ros.Buffer()
        self.listener = tf2_ros.TransformListener(self.tf)
        self.arm_client = client("/mpl_right_arm/arm_controller/follow_joint_trajectory", FollowJointTrajectoryAction)
        self.hand_client = client("/grasp", graspAction)
        tip = rospy.get_param("/proact/hand")["tip_link"]
        tip_from_grasp = self.frame(tip, "grasp_centre")
        self.arm = Arm(rospy.get_param("/robot_description"), "base_link", tip, tip_from_grasp)
        self.arm.rest = self.angles()
        self.travel_height = rospy.get_param("/proact/task")["table_height"] + CLEARANCE_M
        # The target is latched: the last one comes at once.
        self.target = None
        rospy.Subscriber("/proact/target", TransformStamped, self.on_target)

    def on_target(self, message):
        self.target = message

    def frame(self, parent, child):
        return matrix_of(self.tf.lookup_transform(parent, child, rospy.Time(), rospy.Duration(10)).transform)

    def angles(self):
        state = rospy.wait_for_message("/mpl_right_arm/joint_states", JointState)
        return np.array([state.position[state.name.index(name)] for name in self.arm.names])

    def go_to(self, x, y, z):
        """Moves the grasp centre to a point of world along a straight line."""
        path = self.arm.straight_path(self.angles(), self.frame("world", "base_link"), np.array([x, y, z]))
        wait_for_result(self.arm_client, self.arm.trajectory(path))

    def carry(self, target):
        """Carries the object whose frame is the target's child to where the target says."""
        x, y, z = self.frame("world", target.child_frame_id)[:3, 3]
        to = target.transform.translation
        self.go_to(x, y, self.travel_height)
        self.go_to(x, y, z)
        wait_for_result(self.hand_client, graspGoal(instruct=CLOSE))
        if not rospy.wait_for_message("/grasp_status", Bool).data:
            raise RuntimeError(f"the hand closed, and {target.child_frame_id} is not in it")
        self.go_to(x, y, self.travel_height)
        self.go_to(to.x, to.y, self.travel_height)
        self.go_to(to.x, to.y, to.z)
        wait_for_result(self.hand_client, graspGoal(instruct=OPEN))
        self.go_to(to.x, to.y, self.travel_height)

    def run(self, most):
        carried = 0
        while not rospy.is_shutdown() and (most == 0 or carried < most):
            while self.target is None and not rospy.is_shutdown():
                rospy.sleep(0.05)
            target = self.target
            if not target.child_frame_id:
                break
            rospy.loginfo("carrying %s", target.child_frame_id)
            self.carry(target)
            carried += 1
        rospy.loginfo("carried %d objects", carried)


def client(name, kind):
    """A client of an action whose server is there."""
    own = actionlib.SimpleActionClient(name, kind)
    own.wait_for_server()
    return own


def wait_for_result(action, goal):
    """Sends a goal and waits for its end."""
    state = action.send_goal_and_wait(goal)
    if state != actionlib.GoalStatus.SUCCEEDED:
        raise RuntimeError(f"{action.action_client.ns} ended with state {state}: {action.get_goal_status_text()}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Carries each object that the task asks for to its target.")
    parser.add_argument("count", nargs="?", type=int, default=0, help="how many objects to carry; all by default")
    options = parser.parse_args(rospy.myargv(sys.argv)[1:])
    rospy.init_node("carry_blocks")
    try:
        Node().run(options.count)
    except RuntimeError as error:
        rospy.logerr(str(error))
        sys.exit(1)
