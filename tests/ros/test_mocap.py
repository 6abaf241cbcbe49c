"""Poses of the graph as motion capture: `--mocap ros:/TOPIC` and `--mocap tf:PARENT/FRAME`, and what is wrong with them by name."""

import json
import math
import signal
import subprocess
import threading
import time
import unittest
import urllib.request

import graph

GRAPH = graph.Graph()

import rospy  # noqa: E402
from geometry_msgs.msg import PoseStamped, TransformStamped  # noqa: E402
from std_msgs.msg import String  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

TOPIC = "/vrpn_client_node/Shoulderpad/pose"
NAN = float("nan")


def setUpModule():
    rospy.init_node("test_mocap", disable_signals=True)


def tearDownModule():
    GRAPH.close()


class Lab:
    """Sends a shoulder that breathes at 100 Hz, spoilt by whatever `spoil` is."""

    def __init__(self, send):
        self.send, self.spoil, self.offset = send, lambda values: values, 0.0
        self.over = threading.Event()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        count = 0
        while not self.over.wait(0.01):
            count += 1
            place = (2.0, 1.0, 1.4 + 0.004 * math.sin(0.02 * count))
            stamp = rospy.Time.from_sec(time.time() + self.offset)
            self.send(stamp, *self.spoil((place, (0.0, 0.0, 0.6, 0.8))))

    def close(self):
        self.over.set()
        self.thread.join()


class Mocap(unittest.TestCase):
    def serve(self, source):
        port = graph.free_port()
        process = GRAPH.spawn([graph.BINARY, "serve", "--no-record", "--no-browser", "--port", str(port), "--mocap", source],
                              f"serve-{port}.log", cwd=GRAPH.home)
        self.addCleanup(GRAPH.stop, process)
        self.url = f"http://127.0.0.1:{port}/api/tracking"
        return process

    def report(self):
        try:
            with urllib.request.urlopen(self.url, timeout=5) as answer:
                reports = json.load(answer)
        except OSError:
            return {"fault_name": "down", "fault": ""}
        return reports[0] if reports else {"fault_name": "down", "fault": ""}

    def wait(self, name, text=""):
        seen = {}

        def there():
            seen.clear()
            seen.update(self.report())
            return seen["fault_name"] == name and text in (seen["fault"] or "")

        try:
            graph.wait_until(there, f"{name!r} with {text!r}")
        except AssertionError as error:
            raise AssertionError(f"{error}; last: {seen}") from None
        return seen

    def spoil_each(self, lab):
        """Bad input by name; after each the stream is taken again."""
        lab.spoil = lambda values: ((NAN, 1.0, 1.4), values[1])
        self.wait("not_finite")
        lab.spoil = lambda values: (values[0], (0.0, 0.0, 0.0, 0.0))
        self.wait("no_rotation", "length 0.000")
        lab.spoil = lambda values: ([1000 * v for v in values[0]], values[1])
        self.wait("millimetres")
        lab.spoil = lambda values: values
        self.wait(None)
        lab.offset -= 3.0
        self.wait("time_back")

    def test_a_topic_of_poses_is_a_body_and_what_is_wrong_with_it_is_named(self):
        publisher = rospy.Publisher(TOPIC, PoseStamped, queue_size=10)
        other = rospy.Publisher("/vrpn_client_node/HololensSG/pose", PoseStamped, queue_size=10)
        wrong = rospy.Publisher("/words", String, queue_size=10)
        frame = ["optitrack_world"]

        def send(stamp, place, turn):
            message = PoseStamped()
            message.header.stamp, message.header.frame_id = stamp, frame[0]
            p, q = message.pose.position, message.pose.orientation
            (p.x, p.y, p.z), (q.x, q.y, q.z, q.w) = place, turn
            publisher.publish(message)
            other.publish(message)

        self.serve("ros:/teapot")
        self.wait("waiting", TOPIC)
        self.serve("ros:/words")
        self.wait("waiting", "carries std_msgs/String, expected geometry_msgs/PoseStamped")
        process = self.serve(f"ros:{TOPIC}")
        lab = Lab(send)
        try:
            self.wait(None)
            report = graph.wait_until(lambda: (lambda r: r if r.get("rate_hz", 0) > 60 else None)(self.report()), "a rate above 60 Hz")
            self.assertEqual(report["bodies"], ["/vrpn_client_node/HololensSG/pose", TOPIC])
            frame[0] = "map"
            self.wait("waiting", 'came in frame "optitrack_world" and come in "map"')
            frame[0] = "optitrack_world"
            self.wait(None)
            self.spoil_each(lab)
            done = subprocess.run([graph.BINARY, "doctor", "--json", "--mocap", f"ros:{TOPIC}", "--mocap", f"ros:{TOPIC}"],
                                  env=GRAPH.env, timeout=120, stdout=subprocess.PIPE, cwd=GRAPH.home)
            checks = [check for check in json.loads(done.stdout)["checks"] if TOPIC in check["name"]]
            self.assertEqual([check["status"] for check in checks], ["ok", "ok"], checks)
        finally:
            lab.close()
        self.wait("silent")
        GRAPH.stop(process, signal.SIGINT)
        graph.wait_until(lambda: not any("proact_mocap" in name and str(process.pid) in name for name in GRAPH.nodes()),
                         "the source gone from the graph")
        for each in (publisher, other, wrong):
            each.unregister()

    def test_a_frame_of_tf_is_a_body_through_fixed_and_moving_links(self):
        moving = rospy.Publisher("/tf", TFMessage, queue_size=10)
        fixed = rospy.Publisher("/tf_static", TFMessage, queue_size=10, latch=True)

        def message(parent, child, stamp, place, turn):
            stamped = TransformStamped()
            stamped.header.stamp, stamped.header.frame_id, stamped.child_frame_id = stamp, parent, child
            t, q = stamped.transform.translation, stamped.transform.rotation
            (t.x, t.y, t.z), (q.x, q.y, q.z, q.w) = place, turn
            return TFMessage(transforms=[stamped])

        def send(stamp, place, turn):
            moving.publish(message("optitrack_world", "Shoulderpad", stamp, place, turn))

        self.serve("tf:optitrack_world/base_link")
        self.wait("waiting", "nothing comes on /tf")
        lab = Lab(send)
        try:
            self.wait("waiting", 'there is no frame "base_link"; /tf tells of Shoulderpad, optitrack_world')
            fixed.publish(message("Shoulderpad", "base_link", rospy.Time.now(), (0.0, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0)))
            report = self.wait(None)
            self.assertAlmostEqual(report["tracking_from_body"]["translation"][2], 1.5, delta=0.01)
            self.assertEqual(report["bodies"], ["Shoulderpad", "base_link"])
            self.spoil_each(lab)
            self.wait(None)
        finally:
            lab.close()
        self.wait("silent")
        for publisher in (moving, fixed):
            publisher.unregister()


if __name__ == "__main__":
    unittest.main(verbosity=2)
