#!/usr/bin/python3
"""Reads a bag as a laboratory would: with ROS's own Python rosbag, from Debian's python3-rosbag.

    /usr/bin/python3 tests/bag/check_bag.py trials/one/trial.bag

Every message of every topic is decoded by the class that genpy makes of the definition in the bag. The sum that
the bag gives for a type must be the one that genpy computes from that definition, and the one of the installed
message package where there is one. `rosbag info` must agree on the number of messages.

Prints one JSON object: {"messages": N, "packages_compared": [types], "topics": {topic: {type, md5, count,
first_secs, last_secs, last_message}}}. Exit status: 0 the bag is good, 1 it is not, 77 rosbag is not installed.
"""

import importlib
import json
import subprocess
import sys

NOT_INSTALLED = 77

try:
    import rosbag
    from genpy.dynamic import generate_dynamic
except ImportError as error:
    print(f"{error}; install python3-rosbag", file=sys.stderr)
    sys.exit(NOT_INSTALLED)


def installed_class(type_name):
    """The class of the installed message package, or None."""
    package, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(package + ".msg"), name)
    except ImportError:
        return None


def check_sum(connection, compared):
    """Complains if the bag's sum of this connection's type is not ROS's."""
    made = generate_dynamic(connection.datatype, connection.msg_def)[connection.datatype]
    if made._md5sum != connection.md5sum:
        raise ValueError(f"{connection.datatype}: the bag says {connection.md5sum}, genpy {made._md5sum}")
    installed = installed_class(connection.datatype)
    if installed is not None:
        if installed._md5sum != connection.md5sum:
            raise ValueError(
                f"{connection.datatype}: the bag says {connection.md5sum}, the package {installed._md5sum}"
            )
        compared.add(connection.datatype)


def read_topics(path):
    """Decodes every message, checking order, and gathers what there is by topic."""
    topics, compared, before = {}, set(), 0.0
    with rosbag.Bag(path) as bag:
        for connection in bag._get_connections():
            check_sum(connection, compared)
            topics[connection.topic] = {"type": connection.datatype, "md5": connection.md5sum, "count": 0}
        for topic, message, time in bag.read_messages():
            entry = topics[topic]
            if message._md5sum != entry["md5"]:
                raise ValueError(f"{topic} holds a message of sum {message._md5sum}")
            if time.to_sec() < before:
                raise ValueError(f"{topic} at {time.to_sec()} s comes after {before} s")
            before = time.to_sec()
            entry["count"] += 1
            entry.setdefault("first_secs", before)
            entry["last_secs"] = before
            entry["last_message"] = str(message)
        for topic, entry in topics.items():
            # By the index, without reading the messages.
            indexed = bag.get_message_count(topic)
            if indexed != entry["count"]:
                raise ValueError(f"{topic}: {entry['count']} messages, the index has {indexed}")
    return topics, sorted(compared)


def main():
    if len(sys.argv) != 2:
        sys.exit("usage: check_bag.py BAG")
    path = sys.argv[1]
    topics, compared = read_topics(path)
    messages = sum(entry["count"] for entry in topics.values())
    command = [sys.executable, "/usr/bin/rosbag", "info", "--key=messages", "--yaml", path]
    info = subprocess.run(command, capture_output=True, text=True, check=False)
    if info.returncode != 0 or info.stdout.strip() != str(messages):
        raise ValueError(f"rosbag info: {info.stdout}{info.stderr}; expected {messages} messages")
    print(json.dumps({"messages": messages, "packages_compared": compared, "topics": topics}))


if __name__ == "__main__":
    try:
        main()
    except (ValueError, rosbag.ROSBagException) as error:
        sys.exit(f"{type(error).__name__}: {error}")
