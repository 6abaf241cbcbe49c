"""Bags of separate nodes, recorded by rosbag, beside the same trials recomputed from the records of one process."""

import csv
import json
import os
import subprocess
import tempfile
import unittest

import graph

graph.message_packages()
GRAPH = graph.Graph()

import rospy  # noqa: E402

NODES = ["sim", "emg", "intent", "method", "participant"]
# In lock-step the trial of the nodes is that of one process, tick by tick. A trial each of two methods, and one of the `original` profile.
TRIALS = [["--method", "C", "--seed", "3"], ["--method", "D", "--seed", "1"],
          ["--method", "D", "--seed", "1", "--setup", "still", "--profile", "original"]]
LIMIT_SECS = 25
TOPICS = ["/clock", "/emg", "/gaze_position_ros", "/gaze_direction_ros", "/mpl_right_arm/wrapped_joint_states",
          "/gazebo/model_states", "/grasp_event_republisher/grasp_events"]
# A recorder receives a message some milliseconds after its stamp, each topic by a connection of its own. A state may so be sampled a
# grid step (20 ms) later than it was, and the bag begins with the first message, not with the first tick: times differ by up to three
# steps. Ways are low-passed at 6 Hz, which leaves some per cent of what such steps add; differences of times, and sums at 10 Hz, differ by a step.
TIMES_S = 0.06
SHARE = 0.10
# What is near zero has no share: as much as the hand goes in a grid step at 0.5 m/s, m.
LEAST_M = 0.01
COLUMNS_S = ["seconds"]
COLUMNS_M = ["shoulder_sum10_m", "shoulder_path_m", "hand_path_m"]


def setUpModule():
    rospy.init_node("test_scores", disable_signals=True)
    # rosbag stamps what it receives by /clock.
    rospy.set_param("/use_sim_time", True)


def tearDownModule():
    GRAPH.close()


def phases(dir_or_bag, out):
    answer = subprocess.run([graph.BINARY, "analyze", dir_or_bag, "--out", out, "--json"], stdout=subprocess.PIPE, check=True,
                            universal_newlines=True)
    faults = json.loads(answer.stdout)["faults"]
    with open(os.path.join(out, "data", "phases.csv")) as file:
        return faults, list(csv.DictReader(file))


class Scores(unittest.TestCase):
    def record(self, folder, words):
        """The bag of the nodes, and the record of the same trial in one process."""
        words = [*words, "--set", f"limit_secs={LIMIT_SECS}"]
        record, bag = os.path.join(folder, "record"), os.path.join(folder, "participant1-mode4-trial1.bag")
        subprocess.run([graph.BINARY, "demo", "--headless", "--out", record, *words], check=True, stdout=subprocess.DEVNULL,
                       stderr=subprocess.DEVNULL)
        recorder = GRAPH.spawn(["/usr/bin/rosbag", "record", "-O", bag, *TOPICS], "record.log")
        graph.until(lambda: any(n.startswith("/record") for n in GRAPH.nodes()), "rosbag record")
        digest = os.path.join(folder, "digest")
        nodes = [GRAPH.node(name, *words, "_lockstep:=true", *([f"_digest:={digest}"] if name == "sim" else []))
                 for name in NODES]
        last = 100 * (LIMIT_SECS * 10 - 1)

        def ended():
            if not os.path.exists(digest):
                return False
            with open(digest) as lines:
                return any(json.loads(line)["tick"] >= last for line in lines if line.endswith("\n"))

        try:
            graph.until(ended, "the last span", patience=60.0 + 20.0 * LIMIT_SECS)
        finally:
            for node in nodes:
                GRAPH.stop(node)
            GRAPH.stop(recorder)
        # rosbag's own process closes the bag after the one that was started has ended.
        graph.until(lambda: os.path.exists(bag), "the closed bag")
        return record, bag

    def test_a_bag_of_nodes_has_the_motion_of_the_recomputed_trial(self):
        for words in TRIALS:
            with self.subTest(" ".join(words)), tempfile.TemporaryDirectory() as folder:
                record, bag = self.record(folder, words)
                _, expected = phases(record, os.path.join(folder, "of_record"))
                faults, found = phases(bag, os.path.join(folder, "of_bag"))
                self.assertEqual(faults, [])
                self.assertEqual([(p["phase"], p["block"]) for p in found], [(p["phase"], p["block"]) for p in expected])
                self.assertTrue(found, "a pick at least")
                for bag_phase, phase in zip(found, expected):
                    self.assertIn("bag_only", bag_phase["flaw"])
                    for column in COLUMNS_S:
                        self.assertAlmostEqual(float(bag_phase[column]), float(phase[column]), delta=TIMES_S)
                    for column in COLUMNS_M:
                        value = float(phase[column])
                        self.assertAlmostEqual(float(bag_phase[column]), value, delta=max(SHARE * value, LEAST_M), msg=column)


if __name__ == "__main__":
    unittest.main(verbosity=2)
