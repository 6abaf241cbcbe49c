"""Every topic, action and service of the original by name and type: offered by our nodes, or named here with the reason."""

import time
import unittest

import graph

graph.message_packages()
GRAPH = graph.Graph()

import rosservice  # noqa: E402
import rospy  # noqa: E402

TOPICS = {
    "/emg": "std_msgs/String",
    "/joy": "sensor_msgs/Joy",
    "/mode": "std_msgs/Int8",
    "/success": "std_msgs/Bool",
    "/grasp_status": "std_msgs/Bool",
    "/grasp_event_republisher/grasp_events": "gazebo_grasp_plugin_ros/GazeboGraspEvent",
    "/selection_frozen": "std_msgs/Bool",
    "/block_id": "std_msgs/String",
    "/current_block": "std_msgs/String",
    "/gaze_position": "geometry_msgs/Vector3Stamped",
    "/gaze_direction": "geometry_msgs/Vector3Stamped",
    "/gaze_table_hit_location": "geometry_msgs/Vector3Stamped",
    "/gaze_table_hit_location_logging": "geometry_msgs/Vector3Stamped",
    "/place_location_selected": "geometry_msgs/PoseStamped",
    **{f"/{block}_dist": "std_msgs/Float64" for block in ("red1", "red2", "blue1", "blue2")},
    "/gaze_position_ros": "geometry_msgs/Vector3Stamped",
    "/gaze_direction_ros": "geometry_msgs/Vector3Stamped",
    "/hololens/head": "geometry_msgs/PoseStamped",
    "/hololens_unity_camera_pose_ros": "geometry_msgs/PoseStamped",
    "/mpl_right_arm/base_pose": "geometry_msgs/PoseStamped",
    **{f"/{block}_pose_msg": "geometry_msgs/PoseStamped"
       for block in ("red_block1", "red_block2", "blue_block1", "blue_block2")},
    "/mpl_right_arm/joint_states": "sensor_msgs/JointState",
    "/mpl_right_arm/wrapped_joint_states": "sensor_msgs/JointState",
    **{f"/mpl_right_arm/j{k}_controller/command": "trajectory_msgs/JointTrajectory" for k in range(7)},
    "/mpl_right_arm/arm_controller/command": "trajectory_msgs/JointTrajectory",
    "/grasp/goal": "mpl_control/graspActionGoal",
    "/Shoulderpad_filtered_pose": "geometry_msgs/PoseStamped",
    "/gazebo/set_link_state": "gazebo_msgs/LinkState",
    "/rosout": "rosgraph_msgs/Log",
    "/clock": "rosgraph_msgs/Clock",
    "/tf": "tf2_msgs/TFMessage",
    "/tf_static": "tf2_msgs/TFMessage",
    "/gazebo/model_states": "gazebo_msgs/ModelStates",
    "/gazebo/link_states": "gazebo_msgs/LinkStates",
    "/move_group/motion_plan_request": "moveit_msgs/MotionPlanRequest",
}
TOPICS_NOT_HERE = {
    "/gaze_hit_location_unity": "from the headset: where its engine's ray met its own shapes",
    "/gaze_target_object": "from the headset: the name of its own shape",
    "/rosworld_pose_msg": "from rosbridge, where a headset is",
    "/table_pose_msg": "nothing in the original's build takes it",
    "/Clipboard_filtered_pose": "from the lab's motion capture",
    "/Hololens_filtered_pose": "from the lab's motion capture",
    "/pickplace/visualization_marker": "advertised by the original, and never sent",
    "/holocam/compressed": "switched off in the original's build",
    "/holocam/webcam_to_world": "switched off in the original's build",
}
ACTIONS = {
    "/grasp": "mpl_control/grasp",
    "/mpl_right_arm/arm_controller/follow_joint_trajectory": "control_msgs/FollowJointTrajectory",
    "/mpl_right_arm/hand_controller/follow_joint_trajectory": "control_msgs/FollowJointTrajectory",
}
ACTIONS_NOT_HERE = {"/move_group": "MoveIt's own", "/execute_trajectory": "MoveIt's own"}
SERVICES = {
    "/gazebo/get_model_state": "gazebo_msgs/GetModelState",
    "/gazebo/get_link_state": "gazebo_msgs/GetLinkState",
    "/gazebo/set_model_state": "gazebo_msgs/SetModelState",
    "/gazebo/set_link_state": "gazebo_msgs/SetLinkState",
    "/gazebo/spawn_urdf_model": "gazebo_msgs/SpawnModel",
    "/gazebo/spawn_sdf_model": "gazebo_msgs/SpawnModel",
    "/gazebo/pause_physics": "std_srvs/Empty",
    "/gazebo/unpause_physics": "std_srvs/Empty",
    "/gazebo/reset_world": "std_srvs/Empty",
    "/mpl_right_arm/controller_manager/load_controller": "controller_manager_msgs/LoadController",
    "/mpl_right_arm/controller_manager/switch_controller": "controller_manager_msgs/SwitchController",
}
SERVICES_NOT_HERE = {
    "/fix_world": "from rosbridge, where a headset is",
    "/gazebo/set_model_configuration": "the arm goes where its controllers lead it, never in a jump",
    "/file_server/get_file": "the editor's own",
    "/file_server/save_file": "the editor's own",
    "/service_response_test": "switched off in the original's build",
}


def tearDownModule():
    GRAPH.close()


class Names(unittest.TestCase):
    topics, services = {}, {}

    @classmethod
    def setUpClass(cls):
        rospy.init_node("test_names", disable_signals=True)
        nodes = [GRAPH.node(name, "--method", "D", "--setup", "still")
                 for name in ("sim", "emg", "intent", "method", "participant")]
        alive = {f"/proact_{name}" for name in ("sim", "emg", "intent", "method", "participant")}
        graph.wait_until(lambda: alive <= GRAPH.nodes(), "all nodes")
        cls.wait_for_names()
        # The whole testbed tells of the head as well.
        for node in nodes:
            GRAPH.stop(node)
        nodes = [GRAPH.node("testbed", "--method", "D", "--setup", "still")]
        graph.wait_until(lambda: "/proact_testbed" in GRAPH.nodes(), "the testbed")
        cls.wait_for_names()
        GRAPH.stop(nodes[0])

    @classmethod
    def wait_for_names(cls):
        """All that there is, when nothing new has come for a second."""
        before, since = None, time.monotonic()

        def settled():
            nonlocal before, since
            publishers, subscribers, services = GRAPH.system_state()
            ours = lambda names: any(name.startswith("/proact_") for name in names)
            now = ({topic for topic, names in publishers + subscribers if ours(names)},
                   {service for service, names in services if ours(names)})
            if now != before:
                before, since = now, time.monotonic()
            return time.monotonic() - since > 1.0

        graph.wait_until(settled, "the end of registrations")
        types = dict(rospy.get_master().target.getTopicTypes("/test")[2])
        cls.topics.update({topic: types.get(topic) for topic in before[0]})
        cls.services.update({name: rosservice.get_service_type(name) for name in before[1]})

    def test_topics(self):
        got = {topic: self.topics.get(topic) for topic in TOPICS}
        self.assertEqual(got, TOPICS)

    def test_actions(self):
        for name, kind in ACTIONS.items():
            parts = {part: self.topics.get(f"{name}/{part}") for part in ("goal", "result", "feedback")}
            self.assertEqual(parts, {part: f"{kind}Action{part.title()}" for part in parts})
            self.assertEqual(self.topics.get(f"{name}/status"), "actionlib_msgs/GoalStatusArray")
            self.assertEqual(self.topics.get(f"{name}/cancel"), "actionlib_msgs/GoalID")

    def test_services(self):
        got = {service: self.services.get(service) for service in SERVICES}
        self.assertEqual(got, SERVICES)

    def test_what_is_said_to_be_elsewhere_is_not_here(self):
        for name in (*TOPICS_NOT_HERE, *(f"{name}/goal" for name in ACTIONS_NOT_HERE)):
            self.assertNotIn(name, self.topics)
        for name in SERVICES_NOT_HERE:
            self.assertNotIn(name, self.services)


if __name__ == "__main__":
    unittest.main(verbosity=2)
