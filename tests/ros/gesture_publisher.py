"""Somebody's node: publishes a word on /emg at 20 Hz of the graph's time.

Reads the word to publish from its input, a line each; an empty one is silence. Tells on its output each message before
it goes out: simulated ms and word.
"""

import sys
import threading

import rospy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

PERIOD_MS = 50

word = ""
due = 0
rospy.init_node("speaker", anonymous=True)
emg = rospy.Publisher("/emg", String, queue_size=1, tcp_nodelay=True)


def publish_gesture(message):
    global due
    now = message.clock.to_nsec() // 1_000_000
    if word and now >= due:
        due = now + PERIOD_MS
        print(now, word, flush=True)
        emg.publish(word)


def read_gestures():
    global word
    for line in sys.stdin:
        word = line.strip()


rospy.Subscriber("/clock", Clock, publish_gesture, tcp_nodelay=True)
threading.Thread(target=read_gestures, daemon=True).start()
rospy.spin()
