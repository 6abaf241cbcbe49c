"""The MoveIt configuration says what the description says: Debian 12 has no move_group that could complain."""

import os
import re
import unittest
import xml.etree.ElementTree as xml

import graph
import yaml

SOURCES = os.path.join(graph.ROOT, "ros1_ws", "src")
ARM = os.path.join(SOURCES, "proact_description", "arms", "mpl_right")


def config(name):
    with open(os.path.join(SOURCES, "proact_moveit_config", "config", name), encoding="utf-8") as file:
        return yaml.safe_load(file)


class MoveIt(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        urdf = xml.parse(os.path.join(ARM, "arm.urdf")).getroot()
        cls.joints = {joint.get("name"): joint for joint in urdf.findall("joint")}
        srdf = xml.parse(os.path.join(ARM, "arm.srdf")).getroot()
        cls.groups = {group.get("name"): [joint.get("name") for joint in group.findall("joint")]
                      for group in srdf.findall("group")}

    def test_groups_are_those_of_the_description(self):
        self.assertEqual(set(self.groups), {"mpl_arm", "mpl_hand"})
        for joints in self.groups.values():
            self.assertLessEqual(set(joints), set(self.joints))
        self.assertLessEqual(set(config("kinematics.yaml")), set(self.groups))
        planning = config("ompl_planning.yaml")
        planners = planning.pop("planner_configs")
        self.assertEqual(set(planning), set(self.groups))
        for settings in planning.values():
            self.assertLessEqual({settings["default_planner_config"], *settings["planner_configs"]}, set(planners))
        evaluator = re.fullmatch(r"joints\((.*)\)", planning["mpl_arm"]["projection_evaluator"])
        self.assertLessEqual(set(evaluator.group(1).split(",")), set(self.groups["mpl_arm"]))

    def test_controllers_have_the_joints_of_the_groups_in_their_order(self):
        controllers = {entry["name"]: entry for entry in config("controllers.yaml")["controller_list"]}
        for name, group in [("arm_controller", "mpl_arm"), ("hand_controller", "mpl_hand")]:
            entry = controllers.pop(f"/mpl_right_arm/{name}")
            self.assertEqual(entry["joints"], self.groups[group])
            self.assertEqual((entry["action_ns"], entry["type"]), ("follow_joint_trajectory", "FollowJointTrajectory"))
        self.assertEqual(controllers, {})

    def test_speeds_are_those_of_the_description(self):
        limits = config("joint_limits.yaml")["joint_limits"]
        self.assertEqual(set(limits), {joint for joints in self.groups.values() for joint in joints})
        for name, limit in limits.items():
            described = float(self.joints[name].find("limit").get("velocity"))
            self.assertEqual((limit["has_velocity_limits"], limit["max_velocity"]), (True, described), name)
            self.assertGreater(limit["max_acceleration"], 0.0, name)


if __name__ == "__main__":
    unittest.main(verbosity=2)
