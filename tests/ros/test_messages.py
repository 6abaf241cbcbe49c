"""The MD5 sums of our message packages are the published ones, and those of Debian's packages where it has them."""

import glob
import hashlib
import os
import unittest

import graph

graph.message_packages()

# From the generated code of the packages that these stand for. A sum covers what the message holds.
PUBLISHED = {
    "control_msgs.msg.FollowJointTrajectoryAction": "bc4f9b743838566551c0390c65f1a248",
    "control_msgs.msg.JointTrajectoryControllerState": "10817c60c2486ef6b33e97dcd87f4474",
    "controller_manager_msgs.msg.ControllerState": "aeb6b261d97793ab74099a3740245272",
    "controller_manager_msgs.srv.ListControllersRequest": "d41d8cd98f00b204e9800998ecf8427e",
    "controller_manager_msgs.srv.ListControllersResponse": "1341feb2e63fa791f855565d0da950d8",
    "controller_manager_msgs.srv.LoadControllerRequest": "c1f3d28f1b044c871e6eff2e9fc3c667",
    "controller_manager_msgs.srv.LoadControllerResponse": "6f6da3883749771fac40d6deb24a8c02",
    "controller_manager_msgs.srv.SwitchControllerRequest": "36d99a977432b71d4bf16ce5847949d7",
    "controller_manager_msgs.srv.SwitchControllerResponse": "6f6da3883749771fac40d6deb24a8c02",
    "controller_manager_msgs.srv.UnloadControllerRequest": "c1f3d28f1b044c871e6eff2e9fc3c667",
    "controller_manager_msgs.srv.UnloadControllerResponse": "6f6da3883749771fac40d6deb24a8c02",
    "gazebo_grasp_plugin_ros.msg.GazeboGraspEvent": "a5b6c6f554465c6bcbcad9409a41137a",
    "gazebo_msgs.msg.LinkState": "0818ebbf28ce3a08d48ab1eaa7309ebe",
    "gazebo_msgs.msg.LinkStates": "48c080191eb15c41858319b4d8a609c2",
    "gazebo_msgs.msg.ModelState": "9330fd35f2fcd82d457e54bd54e10593",
    "gazebo_msgs.msg.ModelStates": "48c080191eb15c41858319b4d8a609c2",
    "gazebo_msgs.srv.GetLinkStateRequest": "7551675c30aaa71f7c288d4864552001",
    "gazebo_msgs.srv.GetLinkStateResponse": "8ba55ad34f9c072e75c0de57b089753b",
    "gazebo_msgs.srv.GetModelStateRequest": "19d412713cefe4a67437e17a951e759e",
    "gazebo_msgs.srv.GetModelStateResponse": "ccd51739bb00f0141629e87b792e92b9",
    "gazebo_msgs.srv.SetLinkStateRequest": "22a2c757d56911b6f27868159e9a872d",
    "gazebo_msgs.srv.SetLinkStateResponse": "2ec6f3eff0161f4257b808b12bc830c2",
    "gazebo_msgs.srv.SetModelConfigurationRequest": "160eae60f51fabff255480c70afa289f",
    "gazebo_msgs.srv.SetModelConfigurationResponse": "2ec6f3eff0161f4257b808b12bc830c2",
    "gazebo_msgs.srv.SetModelStateRequest": "cb042b0e91880f4661b29ea5b6234350",
    "gazebo_msgs.srv.SetModelStateResponse": "2ec6f3eff0161f4257b808b12bc830c2",
    "gazebo_msgs.srv.SpawnModelRequest": "6d0eba5753761cd57e6263a056b79930",
    "gazebo_msgs.srv.SpawnModelResponse": "2ec6f3eff0161f4257b808b12bc830c2",
    "moveit_msgs.msg.CollisionObject": "dbba710596087da521c07564160dfccb",
    "moveit_msgs.msg.MotionPlanRequest": "83f3d7b1d47a538f7659e0de9dae7980",
    "moveit_msgs.msg.RobotState": "968156f4aa4cb4018f1f2293eebcea8f",
    "object_recognition_msgs.msg.ObjectType": "ac757ec5be1998b0167e7efcda79e3cf",
    "shoulder_localization.srv.adjustHeight": "e59cdc9605d309f43ffc7f3b149d0cd2",
    "shoulder_localization.srv.fixWorld": "c33bde85c17aa9cf43fdef4f2e837c2f",
}

# The original's own action has no published sum: its definition is known, and a sum is that of the fields.
GRASP = {"graspGoal": b"int32 instruct", "graspResult": b"int32 done", "graspFeedback": b"int32 doing"}


def python_class(path):
    package, kind, name = path.split(".")
    return getattr(__import__(f"{package}.{kind}", fromlist=[name]), name)


class Messages(unittest.TestCase):
    def test_sums_of_message_only_packages_are_the_published_ones(self):
        for path, expected in PUBLISHED.items():
            self.assertEqual(python_class(path)._md5sum, expected, path)

    def test_the_sums_of_the_grasp_action_follow_from_its_definition(self):
        for name, fields in GRASP.items():
            self.assertEqual(python_class(f"mpl_control.msg.{name}")._md5sum, hashlib.md5(fields).hexdigest(), name)

    def test_every_message_that_we_define_for_others_is_compared(self):
        """It is in the table itself, or a part of one that is."""
        compared, waiting = set(), [*PUBLISHED, *(f"mpl_control.msg.{name}" for name in GRASP)]
        while waiting:
            path = waiting.pop()
            if path not in compared:
                compared.add(path)
                # A service as a whole has no fields of its own.
                for kind in getattr(python_class(path), "_slot_types", []):
                    if "/" in kind:
                        package, name = kind.split("[")[0].split("/")
                        waiting.append(f"{package}.msg.{name}")
        own = os.path.join(graph.ROOT, "ros1_ws", "src", "compat")
        for package in os.listdir(own):
            for file in glob.glob(os.path.join(own, package, "*", "*.*")):
                name, kind = os.path.splitext(os.path.basename(file))
                needed = {
                    ".msg": [f"msg.{name}"],
                    ".action": [f"msg.{name}{part}" for part in ("Goal", "Result", "Feedback")],
                    ".srv": [f"srv.{name}Request", f"srv.{name}Response"],
                }.get(kind, [])
                whole = f"{package}.srv.{name}" in compared
                missing = [path for path in needed if f"{package}.{path}" not in compared and not whole]
                self.assertEqual(missing, [], package)

    def test_a_package_that_is_installed_has_the_sums_of_ours(self):
        # Debian has none of them today; where a distribution brings one, it must be interchangeable.
        own = os.path.join(graph.ROOT, "ros1_ws", "src", "compat")
        for package in os.listdir(own):
            for installed in glob.glob(f"/opt/ros/*/share/{package}/msg/*.msg"):
                name = os.path.basename(installed)
                ours = os.path.join(own, package, "msg", name)
                if os.path.exists(ours):
                    fields = lambda path: [w.split("#")[0].split() for w in open(path) if w.split("#")[0].strip()]
                    self.assertEqual(fields(installed), fields(ours), name)


if __name__ == "__main__":
    unittest.main(verbosity=2)
