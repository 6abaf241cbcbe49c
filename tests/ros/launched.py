"""Launches the installed workspace: the simulator with robot_state_publisher, and what respawns."""

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

g = graph.Graph()
try:
    import rospy
    from sensor_msgs.msg import JointState
    from tf2_msgs.msg import TFMessage

    # The workspace's own Python modules, made by catkin.
    from control_msgs.msg import FollowJointTrajectoryAction  # noqa: F401

    g.spawn(["/usr/bin/roslaunch", "proact_bringup", "sim.launch"], "launch.log")
    rospy.init_node("launched", disable_signals=True)
    states = graph.Inbox("/mpl_right_arm/joint_states", JointState, keep=500)
    frames = graph.Inbox("/tf", TFMessage, keep=500)
    states.wait_count(10)
    frames.wait(lambda m: any(t.child_frame_id == "mpl_right_arm__thumb3_link" for t in m.transforms))
    print("launched: joint states from proact_sim, the arm's frames from robot_state_publisher")

    api = xmlrpc.client.ServerProxy(xmlrpc.client.ServerProxy(g.uri).lookupNode("/t", "/proact_sim")[2])
    pid = api.getPid("/t")[2]
    last = states.messages[-1].header.stamp
    os.kill(pid, signal.SIGKILL)
    states.wait(lambda m: m.header.stamp < last)
    print("killed: roslaunch started it again")
finally:
    g.close()
