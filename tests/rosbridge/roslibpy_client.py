"""roslibpy as a client of `proact serve --rosbridge`:

    python tests/rosbridge/roslibpy_client.py PORT

Exits 0 only if everything was seen.
"""

import sys
import threading

import roslibpy

LIMIT_SECS = 20


def messages(client, name, message_type, count=1, **options):
    """The first `count` messages of a topic."""
    got, enough = [], threading.Event()
    topic = roslibpy.Topic(client, name, message_type, **options)

    def take(message):
        got.append(message)
        if len(got) >= count:
            enough.set()

    topic.subscribe(take)
    assert enough.wait(LIMIT_SECS), f"{name}: {len(got)} of {count} messages"
    topic.unsubscribe()
    return got[:count]


def main():
    port = int(sys.argv[1])
    client = roslibpy.Ros(host="127.0.0.1", port=port)
    client.run(timeout=LIMIT_SECS)

    # The scene.
    states = "/mpl_right_arm/wrapped_joint_states"
    first, second = messages(client, states, "sensor_msgs/JointState", 2)
    assert len(first["name"]) == len(first["position"]) == 27
    assert second["header"]["seq"] > first["header"]["seq"]

    # Ten a second instead of sixty.
    few = messages(client, states, "sensor_msgs/JointState", 3, throttle_rate=100, queue_length=1)
    stamps = [m["header"]["stamp"]["secs"] + 1e-9 * m["header"]["stamp"]["nsecs"] for m in few]
    assert stamps[2] - stamps[0] > 0.1, stamps

    # Publish and hear it back.
    heard = threading.Event()
    chat = roslibpy.Topic(client, "/chat", "std_msgs/String")
    chat.subscribe(lambda message: heard.set() if message["data"] == "grüß Gott" else None)
    chat.publish(roslibpy.Message({"data": "grüß Gott"}))
    assert heard.wait(LIMIT_SECS), "own message"

    # A service that this client offers and calls.
    adder = roslibpy.Service(client, "/add_py", "my_pkg/Add")

    def add(request, response):
        response["sum"] = request["a"] + request["b"]
        return True

    adder.advertise(add)
    answer = roslibpy.Service(client, "/add_py", "my_pkg/Add").call(
        roslibpy.ServiceRequest({"a": 2, "b": 3}), timeout=LIMIT_SECS
    )
    assert answer["sum"] == 5, answer

    # rosapi.
    assert states in client.get_topics()
    assert client.get_topic_type("/mode") == "std_msgs/Int8"
    assert "/fix_world" in client.get_services()
    assert "/proact" in client.get_nodes()
    assert client.get_time()["secs"] > 1_600_000_000

    client.terminate()
    print("roslibpy: scene, throttle, topics, services and rosapi")


if __name__ == "__main__":
    main()
