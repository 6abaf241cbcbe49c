"""`proact node rosbridge`: clients of rosbridge on one side, rospy nodes on the other, topics and services both ways."""

import os
import signal
import subprocess
import threading
import unittest

import graph

graph.message_packages()
GRAPH = graph.Graph()

import rospy  # noqa: E402
from bridge_client import Client as BridgeClient, listens  # noqa: E402
from actionlib_msgs.msg import GoalStatus  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402
from proact_msgs.msg import EmgSamples  # noqa: E402
from rosgraph_msgs.msg import Log  # noqa: E402
from sensor_msgs.msg import CompressedImage, JointState  # noqa: E402
from std_msgs.msg import Float64, String  # noqa: E402
from std_srvs.srv import SetBool, SetBoolResponse, Trigger  # noqa: E402

PORT = graph.free_port()
# Where ./proact peers installs roslibpy, unless told otherwise.
ROSLIBPY = os.environ.get("PROACT_ROSLIBPY_PYTHON", os.path.join(graph.ROOT, "build", "peers", "bin", "python"))


def setUpModule():
    global NODE, LOG, CLIENT
    rospy.init_node("test_rosbridge", disable_signals=True)
    LOG = graph.Inbox("/rosout", Log, keep=1000)
    NODE = GRAPH.node("rosbridge", f"_port:={PORT}")
    graph.wait_until(lambda: listens(PORT), "the server's port")
    CLIENT = Client()


def tearDownModule():
    GRAPH.close()


def Client():
    return BridgeClient(PORT)


class Bridge(unittest.TestCase):
    def test_a_topic_of_a_node_reaches_a_client_that_subscribed_before_and_one_that_came_later(self):
        CLIENT.send("subscribe", topic="/lab/joints", type="sensor_msgs/JointState")
        publisher = rospy.Publisher("/lab/joints", JointState, queue_size=10, latch=True)
        message = JointState(name=["a", "b"], position=[0.1, float("nan")], velocity=[], effort=[-1e300])
        message.header.stamp, message.header.frame_id = rospy.Time(12, 34), "grüße"
        publisher.publish(message)
        got = CLIENT.topic("/lab/joints")
        self.assertEqual(got["name"], ["a", "b"])
        self.assertEqual(got["position"], [0.1, None])
        self.assertEqual(got["effort"], [-1e300])
        self.assertEqual(got["header"]["stamp"], {"secs": 12, "nsecs": 34})
        self.assertEqual(got["header"]["frame_id"], "grüße")
        later = Client()
        later.send("subscribe", topic="/lab/joints")
        self.assertEqual(later.topic("/lab/joints"), got, "a latched message waits for whoever comes")
        later.close()

    def test_a_topic_of_a_client_reaches_a_node_with_the_sums_that_it_expects(self):
        poses = graph.Inbox("/lab/pose", PoseStamped)
        status = graph.Inbox("/lab/status", GoalStatus)
        image = graph.Inbox("/lab/image", CompressedImage)
        CLIENT.send("advertise", topic="/lab/pose", type="geometry_msgs/PoseStamped", latch=True)
        CLIENT.send("publish", topic="/lab/pose", msg={"header": {"frame_id": "world"}, "pose": {"position": {"x": 0.25}}})
        got = poses.wait()
        self.assertEqual((got.header.frame_id, got.pose.position.x, got.pose.orientation.w), ("world", 0.25, 0.0))
        # A type with constants, whose sum they are part of, and bytes in base64.
        for topic, kind, message in [("/lab/status", "actionlib_msgs/GoalStatus", {"status": 3, "text": "done"}),
                                     ("/lab/image", "sensor_msgs/CompressedImage", {"format": "png", "data": "AAH/"})]:
            CLIENT.send("advertise", topic=topic, type=kind, latch=True)
            CLIENT.send("publish", topic=topic, msg=message)
        self.assertEqual((status.wait().status, status.wait().text), (GoalStatus.SUCCEEDED, "done"))
        self.assertEqual(image.wait().data, b"\x00\x01\xff")

    def test_a_client_publishes_without_advertising_where_a_node_has_named_the_type(self):
        numbers = graph.Inbox("/lab/number", Float64)
        # The first message makes the connection, so it may come before the subscriber does.
        graph.wait_until(lambda: (CLIENT.send("publish", topic="/lab/number", msg={"data": 2.5}), numbers.messages)[1],
                         "a number on the graph")
        self.assertEqual(numbers.messages[0].data, 2.5)

    def test_types_that_only_this_machine_or_the_publisher_knows_pass(self):
        CLIENT.send("subscribe", topic="/lab/samples")
        samples = rospy.Publisher("/lab/samples", EmgSamples, queue_size=10, latch=True)
        samples.publish(EmgSamples(counter=2**40, channels=2, data=[1.0, -1.0]))
        got = CLIENT.topic("/lab/samples")
        self.assertEqual((got["counter"], got["channels"], got["data"]), (2**40, 2, [1.0, -1.0]))

    def test_clients_hear_each_other_and_no_message_twice(self):
        other = Client()
        other.send("subscribe", topic="/lab/chat", type="std_msgs/String")
        CLIENT.send("advertise", topic="/lab/chat", type="std_msgs/String")
        # In the other's own order: when it hears of the service it has subscribed.
        other.call("/rosapi/get_time")
        inbox = graph.Inbox("/lab/chat", String)
        graph.wait_until(inbox.connected, "the bridge as publisher")
        for n in range(50):
            CLIENT.send("publish", topic="/lab/chat", msg={"data": str(n)})
        other.topic("/lab/chat", lambda m: m["data"] == "49")
        inbox.wait(lambda m: m.data == "49")
        expected = [str(n) for n in range(50)]
        self.assertEqual([m["msg"]["data"] for m in other.messages if m["op"] == "publish"], expected)
        self.assertEqual([m.data for m in inbox.messages], expected)
        other.close()

    def test_a_client_calls_a_service_of_a_node(self):
        served = rospy.Service("/lab/light", SetBool, lambda r: SetBoolResponse(not r.data, f"was {r.data}"))
        self.assertEqual(CLIENT.call("/lab/light", data=True), (True, {"success": False, "message": "was True"}))
        served.shutdown()

        def broken(_):
            raise ValueError("no bulb")

        served = rospy.Service("/lab/broken", Trigger, broken)
        done, reason = CLIENT.call("/lab/broken")
        self.assertFalse(done)
        self.assertIn("no bulb", reason)
        done, reason = CLIENT.call("/lab/nobody")
        self.assertEqual((done, reason), (False, "service /lab/nobody is offered by nobody"))
        done, reason = CLIENT.call("/lab/broken", colour="red")
        self.assertFalse(done)
        self.assertIn("colour", reason)
        served.shutdown()

    def test_a_node_calls_a_service_of_a_client(self):
        provider = Client()
        provider.send("advertise_service", service="/web/light", type="std_srvs/SetBool")
        rospy.wait_for_service("/web/light", graph.TIMEOUT_SECS)
        light = rospy.ServiceProxy("/web/light", SetBool)
        answers = []
        caller = threading.Thread(target=lambda: answers.append(light(True)))
        caller.start()
        asked = provider.wait(lambda m: m["op"] == "call_service")
        self.assertEqual(asked["args"], {"data": True})
        provider.send("service_response", service="/web/light", id=asked["id"], result=True,
                      values={"success": True, "message": "on"})
        caller.join(graph.TIMEOUT_SECS)
        self.assertEqual((answers[0].success, answers[0].message), (True, "on"))
        # It leaves; so does its service.
        provider.close()
        graph.wait_until(lambda: "/web/light" not in [name for name, _ in GRAPH.system_state()[2]], "the service gone")

    def test_a_type_that_the_graph_contradicts_is_refused(self):
        inbox = graph.Inbox("/lab/number2", Float64)
        # The bridge asks the master once a second at most.
        known = lambda: CLIENT.call("/rosapi/topic_type", topic="/lab/number2")[1]["type"]
        graph.wait_until(lambda: known() == "std_msgs/Float64", "the type of the topic")
        CLIENT.send("advertise", topic="/lab/number2", type="std_msgs/String", id="wrong")
        status = CLIENT.wait(lambda m: m["op"] == "status" and m.get("id") == "wrong")
        self.assertIn("std_msgs/Float64", status["msg"])
        inbox.subscriber.unregister()

    def test_rosapi_names_what_the_graph_has(self):
        done, values = CLIENT.call("/rosapi/topics")
        self.assertTrue(done)
        types = dict(zip(values["topics"], values["types"]))
        self.assertEqual(types["/rosout"], "rosgraph_msgs/Log")
        done, values = CLIENT.call("/rosapi/nodes")
        self.assertIn("/test_rosbridge", values["nodes"])
        done, values = CLIENT.call("/rosapi/publishers", topic="/rosout")
        self.assertIn("/test_rosbridge", values["publishers"])
        done, values = CLIENT.call("/rosapi/services")
        self.assertIn("/test_rosbridge/get_loggers", values["services"])
        # Its node is asked; the details come from the installed packages.
        done, values = CLIENT.call("/rosapi/service_type", service="/test_rosbridge/get_loggers")
        self.assertEqual((done, values), (True, {"type": "roscpp/GetLoggers"}))
        done, values = CLIENT.call("/rosapi/service_response_details", type="std_srvs/Trigger")
        self.assertEqual(values["typedefs"][0]["fieldnames"], ["success", "message"])
        done, values = CLIENT.call("/rosapi/message_details", type="control_msgs/JointTolerance")
        self.assertEqual(values["typedefs"][0]["fieldnames"], ["name", "position", "velocity", "acceleration"])

    @unittest.skipUnless(os.path.exists(ROSLIBPY), "roslibpy is not installed; ./proact peers installs it")
    def test_roslibpy_talks_with_a_node(self):
        served = rospy.Service("/lab/py", SetBool, lambda r: SetBoolResponse(r.data, "by rospy"))
        echo = rospy.Publisher("/lab/echo", String, queue_size=10)
        ask = rospy.Subscriber("/lab/ask", String, lambda m: echo.publish(m.data.upper()))
        script = """
import sys, threading, time, roslibpy
client = roslibpy.Ros(host="127.0.0.1", port=int(sys.argv[1]))
client.run(timeout=30)
heard = threading.Event()
roslibpy.Topic(client, "/lab/echo", "std_msgs/String").subscribe(lambda m: m["data"] == "MOVE" and heard.set())
ask = roslibpy.Topic(client, "/lab/ask", "std_msgs/String")
ask.advertise()
end = time.monotonic() + 60
while not heard.wait(0.1):
    assert time.monotonic() < end, "no answer on /lab/echo"
    ask.publish(roslibpy.Message({"data": "move"}))
answer = roslibpy.Service(client, "/lab/py", "std_srvs/SetBool").call(roslibpy.ServiceRequest({"data": True}), timeout=30)
assert answer == {"success": True, "message": "by rospy"}, answer
client.terminate()
"""
        subprocess.run([ROSLIBPY, "-c", script, str(PORT)], check=True, timeout=180)
        served.shutdown()
        ask.unregister()

    def test_z_after_a_master_restart_clients_and_new_nodes_find_each_other(self):
        CLIENT.send("advertise", topic="/lab/again", type="std_msgs/String", latch=True)
        CLIENT.send("publish", topic="/lab/again", msg={"data": "still here"})
        graph.wait_until(lambda: "/lab/again" in [name for name, _ in GRAPH.system_state()[0]], "the topic")
        GRAPH.stop(GRAPH.rosout, signal.SIGKILL)
        GRAPH.stop(GRAPH.master, signal.SIGKILL)
        GRAPH.start_master()
        graph.wait_until(lambda: "/proact_rosbridge" in GRAPH.nodes(), "the bridge on the new master")
        again = graph.Inbox("/lab/again", String)
        self.assertEqual(again.wait().data, "still here")
        self.assertEqual(GRAPH.stop(NODE), 0)


if __name__ == "__main__":
    unittest.main(verbosity=2)
