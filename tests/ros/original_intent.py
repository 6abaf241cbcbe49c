"""Doubles of the original's intent nodes, with its publishing rules: `interpret 0` (gaze, method C), `interpret 1` (gaze and colour,
method D) and `log` (all methods).

With each gaze `interpret` publishes /gaze_table_hit_location_logging if the gaze is not level, /gaze_table_hit_location only where it
meets the table between partition and wall, and /block_id. `log` publishes gaze and distances for a bag. Frames are not asked for:
gaze is in hololens_world_test, whatever it says.
"""

import math
import sys

import message_filters
import rospy
import tf2_ros
from gazebo_grasp_plugin_ros.msg import GazeboGraspEvent
from geometry_msgs.msg import Vector3, Vector3Stamped
from std_msgs.msg import Float64, Header, String

BLOCKS = ["redcylinder1", "redcylinder2", "bluecylinder1", "bluecylinder2"]
TABLE_Z = 1.015
# Where blocks are put down, in `world`.
PLACE_X, PLACE_Y = (-0.125, 0.125), (0.0275, 0.275)
LEVEL = 1e-4
SIGMA = 0.1
WEIGHTS = {"red": [0.45, 0.45, 0.15, 0.15], "blue": [0.15, 0.15, 0.45, 0.45]}
QUEUE = 10
SLOP_S = 0.1


def rotate(q, v):
    """`v` turned by a quaternion."""
    t = [2 * (q.y * v[2] - q.z * v[1]), 2 * (q.z * v[0] - q.x * v[2]), 2 * (q.x * v[1] - q.y * v[0])]
    return [v[0] + q.w * t[0] + q.y * t[2] - q.z * t[1],
            v[1] + q.w * t[1] + q.z * t[0] - q.x * t[2],
            v[2] + q.w * t[2] + q.x * t[1] - q.y * t[0]]


class Gaze:
    """Pairs of position and direction, in `world`, with the distance of each block in the picture."""

    def __init__(self, take):
        self.take = take
        self.frames = tf2_ros.Buffer()
        self.listener = tf2_ros.TransformListener(self.frames)
        halves = [message_filters.Subscriber(topic, Vector3Stamped, queue_size=1)
                  for topic in ("/gaze_position", "/gaze_direction")]
        self.pairs = message_filters.ApproximateTimeSynchronizer(halves, QUEUE, SLOP_S)
        self.pairs.registerCallback(self.look)

    def transform(self, frame):
        """The newest; waits for the first."""
        while not rospy.is_shutdown():
            try:
                return self.frames.lookup_transform("world", frame, rospy.Time(0)).transform
            except tf2_ros.TransformException:
                rospy.rostime.wallsleep(0.2)

    def look(self, position, direction):
        headset = self.transform("hololens_world_test")
        p, d = ([v.x, v.y, v.z] for v in (position.vector, direction.vector))
        t = headset.translation
        eye = [a + b for a, b in zip(rotate(headset.rotation, p), (t.x, t.y, t.z))]
        ray = rotate(headset.rotation, d)
        distances = []
        for name in BLOCKS:
            block = self.transform(name).translation
            way = [block.x - eye[0], block.y - eye[1], block.z - eye[2]]
            cosine = sum(a * b for a, b in zip(way, ray)) / math.sqrt(sum(a * a for a in way))
            distances.append(math.sqrt(max(0.0, 1 - cosine * cosine)) / cosine)
        self.take(eye, ray, distances)


def stamped(values):
    return Vector3Stamped(header=Header(stamp=rospy.Time.now()), vector=Vector3(*values))


class Interpreter:
    def __init__(self, by_colour):
        self.by_colour = by_colour
        self.due = "red"
        self.block = rospy.Publisher("/block_id", String, queue_size=1)
        self.hit = rospy.Publisher("/gaze_table_hit_location", Vector3Stamped, queue_size=1)
        self.logged_hit = rospy.Publisher("/gaze_table_hit_location_logging", Vector3Stamped, queue_size=1)
        rospy.Subscriber("/grasp_event_republisher/grasp_events", GazeboGraspEvent, self.grasp, queue_size=1)
        self.gaze = Gaze(self.interpret)

    def grasp(self, event):
        """Each grasp and each release: the other colour is due."""
        if event.object.startswith("red"):
            self.due = "blue"
        elif event.object.startswith("blue"):
            self.due = "red"

    def interpret(self, eye, ray, distances):
        if abs(ray[2]) > LEVEL:
            way = (TABLE_Z - eye[2]) / ray[2]
            x, y = eye[0] + way * ray[0], eye[1] + way * ray[1]
            self.logged_hit.publish(stamped((x, y, TABLE_Z)))
            if PLACE_X[0] < x < PLACE_X[1] and PLACE_Y[0] < y < PLACE_Y[1]:
                self.hit.publish(stamped((x, y, TABLE_Z)))
        scores = [math.exp(-(d * d) / (2 * SIGMA * SIGMA)) for d in distances]
        if self.by_colour:
            total = sum(scores) or 1.0
            scores = [score / total * weight for score, weight in zip(scores, WEIGHTS[self.due])]
        self.block.publish(BLOCKS[scores.index(max(scores))])


class Logger:
    def __init__(self):
        vector = lambda topic: rospy.Publisher(topic, Vector3Stamped, queue_size=1)
        self.position, self.direction = vector("/gaze_position_ros"), vector("/gaze_direction_ros")
        self.distances = [rospy.Publisher(f"/{name}_dist", Float64, queue_size=1) for name in ("red1", "red2", "blue1", "blue2")]
        self.gaze = Gaze(self.log)

    def log(self, eye, ray, distances):
        self.position.publish(stamped(eye))
        self.direction.publish(stamped(ray))
        for publisher, distance in zip(self.distances, distances):
            publisher.publish(distance)


if __name__ == "__main__":
    rospy.init_node("gaze_sync_node" if sys.argv[1] == "interpret" else "gaze_log_node")
    node = Interpreter(sys.argv[2] == "1") if sys.argv[1] == "interpret" else Logger()
    rospy.spin()
