"""Each stage a node, in lock-step: field by field the hashes of the same trial in one process."""

import json
import os
import shlex
import subprocess
import sys
import tempfile
import unittest

import graph

GRAPH = None
NODES = ["sim", "emg", "intent", "method", "participant"]
SPAN = 100
FIELDS = ["input.emg", "input.gesture", "input.gaze", "input.shoulder", "input.limb", "input.plan", "input.method",
          "emg.decision", "intent.posterior", "control.commands", "motion.targets", "dynamics.joints",
          "dynamics.objects", "task.state"]
# A lock-step of five processes takes about as long as the time that it simulates; a busy machine, several times that.
TIMEOUT_SECS = 20.0
EXTERNAL_METHOD = os.path.join(graph.ROOT, "docs", "methods", "follow_gaze.py")
EXTERNAL_INTENT_MODEL = os.path.join(graph.ROOT, "docs", "intent_models", "leaky_dwell.py")
# Means the second block for two seconds, and then says what cannot be used.
BROKEN_MODEL = """import json, sys
for line in sys.stdin:
    time = json.loads(line)["time"]
    print(json.dumps({"time": time, "posterior": [0, 1, 0, 0] if time < 2000 else [0, -1, 0, 0]}), flush=True)
"""


def setUpModule():
    global GRAPH
    GRAPH = graph.Graph()


def tearDownModule():
    GRAPH.close()


def run_in_one_process(folder, words):
    """Field hashes by tick and field, of the trial in one process."""
    out = os.path.join(folder, "trial")
    done = subprocess.run([graph.BINARY, "demo", "--headless", "--out", out, *words], stdout=subprocess.DEVNULL,
                          stderr=subprocess.DEVNULL)
    # A trial whose intent model broke has failed, which is an exit code of 1; its record is complete.
    assert done.returncode in (0, 1) and os.path.exists(os.path.join(out, "SHA256SUMS")), done
    hashes = {}
    with open(os.path.join(out, "digests.log")) as log:
        for line in log:
            span = json.loads(line.split(" ", 1)[1])
            assert len(span["fields"]) == len(FIELDS)
            hashes[span["tick"]] = dict(zip(FIELDS, span["fields"]))
    return hashes


def read_spans(path):
    """What a node has written; a line in the making is left out."""
    try:
        with open(path) as lines:
            return [json.loads(line) for line in lines if line.endswith("\n")]
    except FileNotFoundError:
        return []


class Lockstep(unittest.TestCase):
    def compare(self, words, odd=None):
        """The first span at which a field differs, by field; none where all agree. `odd`: more words for one node."""
        with tempfile.TemporaryDirectory() as folder:
            expected = run_in_one_process(folder, words)
            # Without the last span: only the simulator knows when it was cut short.
            whole = [tick for tick in expected if tick % SPAN == 0]
            paths = {name: os.path.join(folder, name) for name in NODES if name != "participant"}
            nodes = [GRAPH.node(name, *words, *(odd or {}).get(name, []), "_lockstep:=true",
                                *([f"_digest_file:={paths[name]}"] if name in paths else [])) for name in NODES]
            try:
                graph.wait_until(lambda: all(len(read_spans(path)) >= len(whole) for path in paths.values()),
                                 "the last span of every node", timeout=60.0 + TIMEOUT_SECS * max(expected) / 1000)
                self.assertEqual([node.poll() for node in nodes], [None] * len(nodes))
            finally:
                for node in nodes:
                    GRAPH.stop(node)
                graph.wait_until(lambda: not any(n.startswith("/proact_") for n in GRAPH.nodes()), "all nodes gone")
            first, seen = {}, set()
            for path in paths.values():
                for span in read_spans(path):
                    for field, found in span["fields"].items():
                        seen.add(field)
                        if span["tick"] in whole and expected[span["tick"]][field] != found:
                            first.setdefault(field, span["tick"])
            self.assertEqual(seen, set(FIELDS))
            return first

    def check(self, words):
        with self.subTest(" ".join(words)):
            self.assertEqual(self.compare(words), {})


class Short(Lockstep):
    def test_half_a_minute_of_each_method_is_that_of_one_process(self):
        for method in METHODS:
            self.check(["--method", method, "--seed", "1", "--set", "limit_secs=30"])

    def test_an_intent_model_in_a_program_is_asked_by_its_node_and_one_that_breaks_stops_the_method_of_another(self):
        if "D" not in METHODS:
            self.skipTest("method D is in the other half")
        with tempfile.TemporaryDirectory() as folder:
            breaks = os.path.join(folder, "breaks.py")
            with open(breaks, "w") as script:
                script.write(BROKEN_MODEL)
            for program, seconds in ((EXTERNAL_INTENT_MODEL, 12), (breaks, 4)):
                self.check(["--method", "D", "--seed", "1", "--set", f"limit_secs={seconds}",
                            "--intent-command", shlex.join(["/usr/bin/python3", program])])

    def test_a_node_with_another_configuration_is_told_by_its_field(self):
        words = ["--method", "D", "--seed", "1", "--set", "limit_secs=1"]
        first = self.compare(words, odd={"intent": ["--set", "intent.gaze_sigma=0.3"]})
        self.assertEqual(first, {"intent.posterior": SPAN}, "control and arm do not move yet")


class Long(Lockstep):
    def test_a_whole_trial_is_that_of_one_process(self):
        self.check(["--method", "D", "--seed", "2", "--setup", "still"])

    def test_profiles_a_tracked_limb_other_intents_and_an_outside_method_are_those_of_one_process(self):
        for words in (["--method", "D", "--setup", "still", "--profile", "original"],
                      ["--method", "B", "--profile", "original"],
                      ["--method", "A", "--set", "profile.level=below_elbow"],
                      ["--method", "C", "--set", "intent_model=filtered"],
                      ["--method", "C", "--method-command", shlex.join(["/usr/bin/python3", EXTERNAL_METHOD])]):
            self.check([*words, "--seed", "3", "--set", "limit_secs=15"])


def load_tests(loader, _tests, _pattern):
    """The long ones where they are asked for."""
    names = [Long] if "--long" in LONG else [Short]
    return unittest.TestSuite(loader.loadTestsFromTestCase(each) for each in names)


LONG = [word for word in sys.argv if word == "--long"]
# --methods=AB: those alone, so that two halves can run side by side.
CHOSEN = [word for word in sys.argv if word.startswith("--methods=")]
METHODS = CHOSEN[0].split("=")[1] if CHOSEN else "ABCD"

if __name__ == "__main__":
    unittest.main(verbosity=2, argv=[word for word in sys.argv if word not in LONG + CHOSEN])
