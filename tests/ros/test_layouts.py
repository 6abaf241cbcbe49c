"""The layouts for PlotJuggler and Foxglove name what there is: in the bag of a trial, or published by a node."""

import json
import os
import re
import subprocess
import tempfile
import unittest
import xml.etree.ElementTree as xml

import graph

graph.message_packages()

import rosbag  # noqa: E402

LAYOUTS = os.path.join(graph.ROOT, "ros1_ws", "src", "proact_bringup", "layouts")


def setUpModule():
    global MESSAGES
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "trial")
        subprocess.run([os.environ["PROACT_BINARY"], "demo", "--headless", "--method", "D", "--seed", "1",
                        "--time-limit", "8", "--out", out], check=True, capture_output=True)
        with rosbag.Bag(os.path.join(out, "trial.bag")) as bag:
            MESSAGES = {topic: message for topic, message, _ in bag.read_messages()}


def value(message, path):
    """The field at a path such as `pose.position.x` or `effort[3]`."""
    for name, index in re.findall(r"(\w+)(?:\[(\d+)\])?", path):
        message = getattr(message, name)
        message = message[int(index)] if index else message
    return message


class Layouts(unittest.TestCase):
    def test_plotjugglers_curves_are_numbers_in_the_bag(self):
        root = xml.parse(os.path.join(LAYOUTS, "plotjuggler.xml")).getroot()
        curves = [curve.get("name") for curve in root.iter("curve")]
        self.assertGreater(len(curves), 40)
        for name in curves:
            topic = max((t for t in MESSAGES if name.startswith(t + "/")), key=len, default=None)
            self.assertIsNotNone(topic, name)
            message, path = MESSAGES[topic], name[len(topic) + 1:].split("/")
            if hasattr(message, "name"):
                # PlotJuggler names the joints, each with its fields.
                joint, field = path
                number = getattr(message, field)[message.name.index(joint)]
            else:
                number = value(message, ".".join(path))
            self.assertIsInstance(number, float, name)
        for splitter in root.iter("DockSplitter"):
            count = int(splitter.get("count"))
            self.assertEqual((len(splitter), len(splitter.get("sizes").split(";"))), (count, count))

    def test_foxgloves_panels_are_laid_out_and_show_what_there_is(self):
        with open(os.path.join(LAYOUTS, "foxglove.json"), encoding="utf-8") as file:
            layout = json.load(file)

        def panels(node):
            return [node] if isinstance(node, str) else panels(node["first"]) + panels(node["second"])
        self.assertEqual(sorted(panels(layout["layout"])), sorted(layout["configById"]))
        live = set()
        for name, config in layout["configById"].items():
            for path in config.get("paths", []):
                topic, _, field = path["value"].partition(".")
                shown = value(MESSAGES[topic], field)
                self.assertIsInstance(shown, float if name.startswith("Plot!") else str, path)
                index = re.search(r"\[(\d+)\]", field)
                if index:
                    joint = MESSAGES[topic].name[int(index.group(1))]
                    self.assertTrue(joint.endswith(path["label"]), f"{path}: {joint}")
            live.update(config.get("topics", {}))
            live.update(config[key] for key in ("topicToRender", "topicPath") if key in config)
        everything = graph.Graph()
        try:
            everything.node("testbed", "--method", "D", "--seed", "1")

            def published():
                return {topic for topic, _ in everything.system_state()[0]}
            graph.wait_until(lambda: live <= published(), f"publishers of {sorted(live)}")
        finally:
            everything.close()


if __name__ == "__main__":
    unittest.main(verbosity=2)
