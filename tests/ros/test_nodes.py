"""One node a stage: the trial of separate nodes equals the trial in one process, and a node that dies stops the arm."""

import json
import os
import signal
import subprocess
import time
import unittest

import graph

graph.message_packages()
GRAPH = graph.Graph()

import rospy  # noqa: E402
from gazebo_msgs.srv import GetModelState  # noqa: E402
from proact_msgs.msg import View  # noqa: E402
from rosgraph_msgs.msg import Log  # noqa: E402
from sensor_msgs.msg import JointState, Joy  # noqa: E402
from std_msgs.msg import Int8, String  # noqa: E402
from std_srvs.srv import Empty  # noqa: E402

STAGES = ["emg", "intent", "method", "participant"]
ARM = ["mpl_right_arm__" + n for n in "shoulder humerus elbow forearm wristy wristx wristz".split()]
METHODS = os.environ.get("PROACT_METHODS", "D").split(",")
LOG = None


def setUpModule():
    global LOG
    rospy.init_node("test_nodes", disable_signals=True)
    LOG = graph.Inbox("/rosout", Log, keep=5000)


def tearDownModule():
    GRAPH.close()


def headless(*words):
    done = subprocess.run([graph.BINARY, "demo", "--headless", "--no-record", "--json", *words],
                          stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True, universal_newlines=True)
    return json.loads(done.stdout)


class Nodes:
    """The simulator and its stages, each a process that is started again when it dies, as roslaunch does."""

    def __init__(self, *words, leave_out=()):
        self.words = words
        self.processes = {name: GRAPH.node(name, *words) for name in ["sim", *STAGES] if name not in leave_out}

    def kill(self, name):
        """Ends one at once and starts it again."""
        process = self.processes[name]
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def start(self, name):
        self.processes[name] = GRAPH.node(name, *self.words)

    def stop(self):
        for process in self.processes.values():
            GRAPH.stop(process)
        graph.until(lambda: not any(n.startswith("/proact_") for n in GRAPH.nodes()), "all nodes gone")


class Trial(unittest.TestCase):
    def test_a_trial_of_separate_nodes_moves_the_same_blocks_as_the_trial_in_one_process(self):
        for method in METHODS:
            with self.subTest(method=method):
                words = ["--method", method, "--seed", "1"]
                alone = headless(*words)
                result = graph.Inbox("/proact/result", String)
                nodes = Nodes(*words)
                try:
                    over = json.loads(result.wait(patience=400.0).data)
                finally:
                    nodes.stop()
                    result.subscriber.unregister()
                outcomes = lambda trial: [(b["block"], b["outcome"]) for b in trial["outcomes"]]
                print(f"{method}: {over['sim_seconds']:.1f} s as nodes, {alone['sim_seconds']:.1f} s in one process")
                self.assertEqual(over["arrangement"], alone["arrangement"])
                self.assertEqual(outcomes(over), outcomes(alone))
                # Messages take their time, and plans that come late on a loaded machine too: seconds, not blocks.
                self.assertAlmostEqual(over["sim_seconds"], alone["sim_seconds"], delta=0.25 * alone["sim_seconds"])


class Faults(unittest.TestCase):
    """One trial in which every node dies once, and the master too."""

    @classmethod
    def setUpClass(cls):
        cls.states = graph.Inbox("/mpl_right_arm/joint_states", JointState, keep=3000)
        cls.view = graph.Inbox("/proact/method", View, keep=3000)
        cls.nodes = Nodes("--method", "D", "--seed", "1")

    @classmethod
    def tearDownClass(cls):
        cls.nodes.stop()

    def speed(self, message):
        return max(abs(message.velocity[message.name.index(joint)]) for joint in ARM)

    def wait_for_motion(self):
        """The arm follows a plan: what was seen before does not count."""
        self.view.clear()
        self.states.clear()
        self.view.wait(lambda m: json.loads(m.json)["planner"]["state"] == "executing")
        self.states.wait(lambda m: self.speed(m) > 0.1)

    def test_a_stage_that_dies_stops_the_arm_and_the_trial_goes_on_when_it_is_back(self):
        for name in STAGES:
            with self.subTest(node=name):
                self.wait_for_motion()
                others = {n: p for n, p in self.nodes.processes.items() if n != name}
                self.nodes.kill(name)
                killed = self.states.messages[-1].header.stamp.to_sec()
                self.states.wait(lambda m: m.header.stamp.to_sec() > killed + 1.0)
                after = [m for m in self.states.messages if m.header.stamp.to_sec() > killed]
                moving = [m.header.stamp.to_sec() - killed for m in after if self.speed(m) > 0.05]
                stopped = max(moving, default=0.0)
                print(f"{name} killed: the arm moves for {1000 * stopped:.0f} ms more")
                self.assertLess(stopped, 0.2)
                self.assertEqual([n for n, p in others.items() if p.poll() is not None], [])
                self.nodes.start(name)
        # The trial goes on with all of them.
        self.wait_for_motion()

    def test_b_after_a_master_restart_all_are_back_and_wait_for_the_word_to_go_on(self):
        self.wait_for_motion()
        pids = {n: p.pid for n, p in self.nodes.processes.items()}
        GRAPH.stop(GRAPH.rosout, signal.SIGKILL)
        GRAPH.stop(GRAPH.master, signal.SIGKILL)
        GRAPH.start_master()
        began = time.monotonic()
        names = {f"/proact_{name}" for name in ["sim", *STAGES]}
        graph.until(lambda: names <= GRAPH.nodes(), "all nodes on the new master")
        print(f"all nodes registered again {time.monotonic() - began:.2f} s after the master was back")
        get = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
        rospy.wait_for_service("/gazebo/unpause_physics", graph.PATIENCE)
        before = get("bluecylinder1", "").pose
        clock = self.states.messages[-1].header.stamp
        self.assertEqual(get("bluecylinder1", "").pose, before)
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        self.states.wait(lambda m: m.header.stamp > clock)
        self.wait_for_motion()
        self.assertEqual({n: p.pid for n, p in self.nodes.processes.items() if p.poll() is None}, pids)

    def test_c_a_simulator_that_is_started_again_finds_the_stages_waiting(self):
        self.nodes.kill("sim")
        self.nodes.start("sim")
        LOG.wait(lambda m: "refused (time)" in m.msg and "goes back" in m.msg)
        self.wait_for_motion()
        alive = [n for n, p in self.nodes.processes.items() if p.poll() is None]
        self.assertEqual(sorted(alive), sorted(["sim", *STAGES]))


class Replaced(unittest.TestCase):
    """The person's part and the intent stage's taken by somebody else's topics."""

    def test_a_joystick_drives_method_a_without_emg_and_intent(self):
        states = graph.Inbox("/mpl_right_arm/joint_states", JointState, keep=200)
        modes = graph.Inbox("/mode", Int8, keep=100)
        joy = rospy.Publisher("/joy", Joy, queue_size=1)
        nodes = Nodes("--method", "A", "--setup", "still", leave_out=("emg", "intent", "participant"))
        try:
            modes.wait(lambda m: m.data == 0)
            graph.until(lambda: joy.get_num_connections() == 1, "the method as subscriber")
            angle = lambda: states.messages[-1].position[states.messages[-1].name.index(ARM[0])]
            start = angle()
            pushed = Joy(axes=[0.0, 1.0], buttons=[0] * 12)

            def push(message, true, what):
                # As joy_node repeats itself.
                graph.until(lambda: (joy.publish(message), true())[1], what)

            push(pushed, lambda: angle() > start + 0.1, "the shoulder flexed by the stick")
            rest = Joy(axes=[0.0, 0.0], buttons=[0] * 12)
            push(rest, lambda: abs(states.messages[-1].velocity[states.messages[-1].name.index(ARM[0])]) < 0.02, "rest")
            next_mode = Joy(axes=[0.0, 0.0], buttons=[int(k == 11) for k in range(12)])
            push(next_mode, lambda: any(m.data == 1 for m in modes.messages), "the next joint")
        finally:
            nodes.stop()

    def test_foreign_intent_and_gestures_make_method_c_plan(self):
        view = graph.Inbox("/proact/method", View, keep=200)
        emg = rospy.Publisher("/emg", String, queue_size=1)
        block = rospy.Publisher("/block_id", String, queue_size=1)
        nodes = Nodes("--method", "C", "--setup", "still", leave_out=("emg", "intent", "participant"))
        try:
            for publisher in (emg, block):
                graph.until(lambda: publisher.get_num_connections() == 1, "the method as subscriber")

            def make(gesture, true, what):
                def tried():
                    block.publish("bluecylinder2")
                    emg.publish(gesture)
                    return view.messages and true(json.loads(view.messages[-1].json))

                graph.until(tried, what)

            make("no_motion", lambda v: v["target"]["block"] == "blue2", "blue 2 highlighted")
            make("wrist_flexion", lambda v: v["target"]["locked"], "blue 2 locked")
            make("wrist_extension", lambda v: v["planner"]["state"] == "executing", "a plan that is followed")
            make("no_motion", lambda v: v["planner"]["state"] != "executing", "the arm stopped")
            emg.publish("")
            LOG.wait(lambda m: "refused (emg)" in m.msg)
            block.publish("teapot")
            LOG.wait(lambda m: "refused (block_id)" in m.msg and "teapot" in m.msg)
        finally:
            nodes.stop()


if __name__ == "__main__":
    unittest.main(verbosity=2)
