"""Every launch file can be read, with its arguments either way, and names the nodes that it is for."""

import os
import subprocess
import unittest

import graph

LAUNCH = os.path.join(graph.ROOT, "ros1_ws", "src", "proact_bringup", "launch")
STAGES = {"/proact_sim", "/proact_emg", "/proact_intent", "/proact_method", "/proact_participant"}
FRAMES = "/robot_state_publisher"
NODES = [
    ("description.launch", [], {FRAMES}),
    ("nodes.launch", [], STAGES | {FRAMES}),
    ("nodes.launch", ["sim:=false", "task:=true"], STAGES - {"/proact_sim"} | {"/proact_task", FRAMES}),
    ("nodes.launch", ["sim:=false", "description:=false"], STAGES - {"/proact_sim"}),
    ("nodes.launch", ["intent:=false", "rviz:=true"], STAGES - {"/proact_intent"} | {FRAMES, "/rviz"}),
    ("rosbridge.launch", ["port:=9191"], {"/proact_rosbridge"}),
    ("rviz.launch", [], {"/rviz"}),
    ("sim.launch", ["paused:=true"], {"/proact_sim", FRAMES}),
    ("testbed.launch", [], {"/proact_testbed", FRAMES}),
    ("testbed.launch", ["live:=true", "rviz:=true"], {"/proact_testbed", FRAMES, "/rviz"}),
    ("two_machines.launch", ["host:=simulator", "user:=lab"], {"/proact_sim", "/rviz"}),
]


class Launch(unittest.TestCase):
    def test_every_file_names_its_nodes(self):
        env = dict(os.environ, ROS_PACKAGE_PATH=os.path.join(graph.ROOT, "ros1_ws", "src") + ":/usr/share")
        for name, words, expected in NODES:
            with self.subTest(file=name, words=words):
                done = subprocess.run(["/usr/bin/roslaunch", "--nodes", os.path.join(LAUNCH, name), *words], env=env,
                                      stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
                self.assertEqual(set(done.stdout.split()), expected, done.stdout)

    def test_none_is_left_out(self):
        self.assertEqual(sorted({name for name, _, _ in NODES}), sorted(os.listdir(LAUNCH)))


if __name__ == "__main__":
    unittest.main(verbosity=2)
