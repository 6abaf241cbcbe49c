"""Launches the installed workspace: the simulator with robot_state_publisher, and what respawns; then every other launch
file that needs no screen and no second machine."""

import json
import os
import signal
import subprocess
import sys
import xmlrpc.client

import graph

setup = sys.argv[1]
out = subprocess.run(["sh", "-c", f". {setup} && env -0"], stdout=subprocess.PIPE, check=True).stdout
for pair in out.split(b"\0"):
    name, _, value = pair.decode().partition("=")
    if name in ("CMAKE_PREFIX_PATH", "ROS_PACKAGE_PATH", "PYTHONPATH", "LD_LIBRARY_PATH"):
        os.environ[name] = value
# A setup file names the workspace alone; robot_state_publisher is Debian's.
os.environ["ROS_PACKAGE_PATH"] += ":/usr/share"
for path in os.environ["PYTHONPATH"].split(":"):
    sys.path.insert(0, path)

import websocket  # noqa: E402


def launch(g, *words):
    g.spawn(["/usr/bin/roslaunch", "proact_bringup", *words], "launch.log")


def simulator():
    g = graph.Graph()
    try:
        import rospy
        from sensor_msgs.msg import JointState
        from tf2_msgs.msg import TFMessage

        # The workspace's own Python modules, made by catkin.
        from control_msgs.msg import FollowJointTrajectoryAction  # noqa: F401

        launch(g, "sim.launch")
        rospy.init_node("launched", disable_signals=True)
        states = graph.Inbox("/mpl_right_arm/joint_states", JointState, keep=500)
        frames = graph.Inbox("/tf", TFMessage, keep=500)
        states.wait_count(10)
        frames.wait(lambda m: any(t.child_frame_id == "mpl_right_arm__thumb3_link" for t in m.transforms))
        print("sim.launch: joint states from proact_sim, the arm's frames from robot_state_publisher")

        api = xmlrpc.client.ServerProxy(xmlrpc.client.ServerProxy(g.uri).lookupNode("/t", "/proact_sim")[2])
        pid = api.getPid("/t")[2]
        last = states.messages[-1].header.stamp
        os.kill(pid, signal.SIGKILL)
        states.wait(lambda m: m.header.stamp < last)
        print("killed: roslaunch started it again")
    finally:
        g.close()


def wait_for_message(g, topic):
    """The topic has a message; rostopic waits for its publisher."""
    done = subprocess.run(["/usr/bin/rostopic", "echo", "-n", "1", "--noarr", topic], env=g.env, timeout=graph.TIMEOUT_SECS,
                          stdout=subprocess.PIPE, check=True, universal_newlines=True)
    assert done.stdout.strip(), topic


def testbed():
    g = graph.Graph()
    try:
        launch(g, "testbed.launch", "method:=D")
        wait_for_message(g, "/emg")
        wait_for_message(g, "/mpl_right_arm/wrapped_joint_states")
        wait_for_message(g, "/tf")
        print("testbed.launch: a trial runs")
    finally:
        g.close()


def nodes():
    g = graph.Graph()
    try:
        launch(g, "nodes.launch", "method:=C", "rate:=200")
        for topic in ("/emg", "/block_id", "/proact/method"):
            wait_for_message(g, topic)
        stages = {f"/proact_{name}" for name in ("sim", "emg", "intent", "method", "participant")}
        assert stages <= g.nodes(), g.nodes()
        print("nodes.launch: the stages speak to each other")

        port = graph.free_port()
        launch(g, "rosbridge.launch", f"port:={port}")

        def connected():
            try:
                return websocket.create_connection(f"ws://127.0.0.1:{port}", timeout=graph.TIMEOUT_SECS)
            except OSError:
                return None

        client = graph.wait_until(connected, "rosbridge")
        client.send(json.dumps({"op": "subscribe", "topic": "/mpl_right_arm/joint_states"}))
        message = json.loads(client.recv())
        assert len(message["msg"]["name"]) == 27, message
        client.close()
        print("rosbridge.launch: a client gets the graph's joint states")
    finally:
        g.close()


for part in (simulator, testbed, nodes):
    part()
