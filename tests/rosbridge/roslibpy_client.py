"""roslibpy as a client of `proact serve --rosbridge`:

    python tests/rosbridge/roslibpy_client.py PORT

Exits 0 only if everything was seen.
"""

import sys
import threading

import roslibpy
import roslibpy.ros1.actionlib as actionlib

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


def seconds(stamp):
    """A time as either ROS writes it."""
    return stamp["sec"] + 1e-9 * stamp["nanosec"] if "sec" in stamp else stamp["secs"] + 1e-9 * stamp["nsecs"]


def check(client, ros2):
    """Topics, services and rosapi, with types as ROS 1 or ROS 2 names them."""

    def msg(name):
        return name.replace("/", "/msg/") if ros2 else name

    # The scene.
    states = "/mpl_right_arm/wrapped_joint_states"
    first, second = messages(client, states, msg("sensor_msgs/JointState"), 2)
    assert len(first["name"]) == len(first["position"]) == 27
    assert set(first["header"]) == ({"stamp", "frame_id"} if ros2 else {"seq", "stamp", "frame_id"})
    assert set(first["header"]["stamp"]) == ({"sec", "nanosec"} if ros2 else {"secs", "nsecs"})
    assert seconds(second["header"]["stamp"]) > seconds(first["header"]["stamp"])

    # Ten a second instead of sixty.
    few = messages(client, states, msg("sensor_msgs/JointState"), 3, throttle_rate=100, queue_length=1)
    stamps = [seconds(m["header"]["stamp"]) for m in few]
    assert stamps[2] - stamps[0] > 0.1, stamps

    # Publish and hear it back.
    received = threading.Event()
    chat = roslibpy.Topic(client, "/chat", msg("std_msgs/String"))
    chat.subscribe(lambda message: received.set() if message["data"] == "grüß Gott" else None)
    chat.publish(roslibpy.Message({"data": "grüß Gott"}))
    assert received.wait(LIMIT_SECS), "own message"

    # A service that this client offers and calls.
    service_type = "my_pkg/srv/Add" if ros2 else "my_pkg/Add"
    adder = roslibpy.Service(client, "/add_py", service_type)

    def add(request, response):
        response["sum"] = request["a"] + request["b"]
        return True

    adder.advertise(add)
    answer = roslibpy.Service(client, "/add_py", service_type).call(
        roslibpy.ServiceRequest({"a": 2, "b": 3}), timeout=LIMIT_SECS
    )
    assert answer["sum"] == 5, answer

    # rosapi.
    assert states in client.get_topics()
    assert client.get_topic_type("/mode") == msg("std_msgs/Int8")
    assert client.get_service_type("/add_py") == service_type
    assert "/fix_world" in client.get_services()
    assert "/proact" in client.get_nodes()
    # roslibpy's own get_time reads ROS 1's form only.
    clock = roslibpy.Service(client, "/rosapi/get_time", "rosapi/GetTime")
    assert seconds(clock.call(roslibpy.ServiceRequest(), timeout=LIMIT_SECS)["time"]) > 1_600_000_000
    assert ros2 or client.get_time()["secs"] > 1_600_000_000


def check_actions(client, owner):
    """Goals of a client of ROS 2 for an action server of ROS 1, which another client is."""
    server = actionlib.SimpleActionServer(owner, "/lab/count_py", "lab_msgs/CountAction")

    def count(goal):
        if goal["to"] == 3:
            server.send_feedback({"at": 2, "left": {"secs": 1, "nsecs": 5}})
            server.set_succeeded({"at": 3})

    server.start(count)
    server.on("cancel", server.set_preempted)
    servers = roslibpy.Service(client, "/rosapi/action_servers", "rosapi/GetActionServers")
    for _ in range(1000):
        if "/lab/count_py" in servers.call(roslibpy.ServiceRequest(), timeout=LIMIT_SECS)["action_servers"]:
            break
    else:
        raise AssertionError("the action server is not known")

    def goal(name, action_type, values, cancel=False):
        """How a goal ends, and the feedback meanwhile."""
        action = roslibpy.ActionClient(client, name, action_type)
        ended, feedback = [], []
        done = threading.Event()

        def end(kind):
            return lambda result: (ended.append((kind, dict(result))), done.set())

        name = action.send_goal(roslibpy.Goal(values), end("result"), lambda f: feedback.append(dict(f)), end("error"))
        if cancel:
            action.cancel_goal(name)
        assert done.wait(LIMIT_SECS), f"{name}: no end"
        kind, result = ended[0]
        return kind, result["status"].name, result["values"], feedback

    action_type = "lab_msgs/action/Count"
    kind, status, values, feedback = goal("/lab/count_py", action_type, {"to": 3})
    assert (kind, status, values) == ("result", "SUCCEEDED", {"at": 3}), (kind, status, values)
    assert feedback == [{"at": 2, "left": {"sec": 1, "nanosec": 5}}], feedback
    kind, status, _, _ = goal("/lab/count_py", action_type, {"to": 10**9}, cancel=True)
    assert (kind, status) == ("result", "CANCELED"), (kind, status)
    kind, _, values, _ = goal("/lab/nothing", action_type, {})
    assert kind == "error" and "/lab/count_py" in values, values


def connect(port):
    client = roslibpy.Ros(host="127.0.0.1", port=port)
    client.run(timeout=LIMIT_SECS)
    return client


def main():
    port = int(sys.argv[1])
    # The first client starts roslibpy's event loop, and only it can end the loop.
    first = connect(port)
    for ros2 in [False, True]:
        client = connect(port)
        check(client, ros2)
        client.close()
        print(f"roslibpy, ROS {2 if ros2 else 1}: scene, throttle, topics, services and rosapi")
    client, owner = connect(port), connect(port)
    check_actions(client, owner)
    print("roslibpy, ROS 2: goals, feedback, results, cancels and refusals of actions")
    first.terminate()


if __name__ == "__main__":
    main()
