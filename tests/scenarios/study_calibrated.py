#!/usr/bin/python3
"""A study on a calibrated shoulder: `proact localize shoulder`, then `proact study run --mocap` with a trial on that shoulder.

    tests/scenarios/study_calibrated.py PATH_OF_PROACT

The person of the trial must sit where the calibration has the shoulder, the record must keep the calibration, the trunk that was
tracked, and replay bit for bit; a calibration of the other brace is not used. Exit code 0 only if all of it holds.
"""

import json
import math
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

from page_client import PageClient

TIMEOUT_SECS = 60
# Another distance from shoulder to midline than the set-up's, so that a calibration that is not used shows.
HALF_WIDTH = 0.21
PLAN = """
name = "calibrated"
participants = 1
[trial]
setup = "seated"
limit_secs = 3
[[conditions]]
name = "A"
trial = { method = "A" }
[order]
by = "listed"
[[sessions]]
name = "1"
trials = 1
begin = [{ do = "say", text = "welcome", minutes = 1 }]
[texts]
welcome = "Hello."
"""

proact = pathlib.Path(sys.argv[1]).resolve()
work = pathlib.Path(tempfile.mkdtemp(prefix="proact-calibrated-"))


def demand(holds, what):
    if not holds:
        print(f"study_calibrated: {what}", file=sys.stderr)
        sys.exit(1)


def run_program(*words):
    run = subprocess.run([proact, *words], capture_output=True, text=True, cwd=work)
    demand(run.returncode == 0, f"{words} ended with {run.returncode}: {run.stderr}")
    return run.stdout


def poses(name, seconds, sway):
    """A brace and a breastbone at 100 Hz; the person leans ahead by 6 degrees in the course of it if it sways."""
    with open(work / name, "w") as file:
        file.write("body,id,stamp_ns,x,y,z,qx,qy,qz,qw,tracked\n")
        for k in range(100 * seconds):
            breath = 0.001 * math.sin(k / 40)
            lean = 0.05 * math.sin(k / 60) if sway else 0.0
            for body, x, y in (("Shoulderpad", 2.0 + lean / 5, 1.0), ("Sternum", 2.1 + lean / 5, 1.2)):
                turn = f"0,{math.sin(lean):.6f},0,{math.cos(lean):.6f}"
                file.write(f"{body},1,{k}0000000,{x:.6f},{y},{1.4 + breath:.6f},{turn},1\n")


class Listener:
    """A page whose newest message of a study is kept."""

    def __init__(self, port, role):
        self.page, self.newest, self.role = PageClient(port, role), None, role
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        try:
            while True:
                message = self.page.receive()
                if message and message["type"] == ("study" if self.role == "experimenter" else "participant"):
                    self.newest = message
        except (OSError, ConnectionError, ValueError):
            self.newest = None

    def until(self, holds, what):
        end = time.monotonic() + TIMEOUT_SECS
        while time.monotonic() < end:
            newest = self.newest
            if newest and holds(newest):
                return newest
            time.sleep(0.02)
        demand(False, f"{what}; the newest message is {json.dumps(self.newest)[:1000]}")


def conduct(folder, body):
    """One session with one trial; the folder of its record."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    log = open(work / f"{folder}.log", "wb")
    process = subprocess.Popen(
        [proact, "study", "run", folder, "--no-browser", "--exact-port", "--port", str(port),
         "--mocap", f"file:{work}/moving.csv/{body}", "--mocap-trunk", "Sternum"],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log, cwd=work,
    )
    end = time.monotonic() + TIMEOUT_SECS
    while True:
        try:
            desk = Listener(port, "experimenter")
            break
        except OSError:
            demand(process.poll() is None and time.monotonic() < end, f"study run: {(work / f'{folder}.log').read_text()}")
            time.sleep(0.05)
    person = Listener(port, "participant")
    person.page.send(type="join", name="participant")
    ask = lambda ask, **more: desk.page.send(type="conduct", ask=ask, **more)

    def now(kind, running):
        def holds(screen):
            step = screen["session"] and screen["session"]["now"]
            return step and step["what"]["is"] == kind and step["running"] == running

        desk.until(holds, f"a step that is {kind}, running {running}")

    desk.until(lambda screen: screen["next"], "who is next")
    ask("begin", id="X1", new=True)
    desk.until(lambda screen: screen["session"] and screen["session"]["now"]["what"]["is"] == "say", "the text to say")
    ask("next")
    now("trial", False)
    ask("start_anyway", reason="a test")
    now("trial", True)
    desk.until(lambda screen: not (screen["session"] and screen["session"]["now"]["what"]["is"] == "trial"
                                   and screen["session"]["now"]["running"]), "the trial's end")
    process.send_signal(signal.SIGINT)
    demand(process.wait(timeout=TIMEOUT_SECS) == 0, f"study run: {(work / f'{folder}.log').read_text()}")
    records = [path.parent for path in (work / folder).rglob("result.json")]
    demand(len(records) == 1, f"one record: {records}")
    return records[0]


def shoulder_of(record):
    import tomllib

    return tomllib.loads((record / "config.toml").read_text())["setup"]["body"]["shoulder_m"]


poses("rest.csv", 5, sway=False)
poses("moving.csv", 90, sway=True)
fit = json.loads(run_program("localize", "--json", "shoulder", "rest.csv", "--body", "Shoulderpad", "--half-shoulder-width", str(HALF_WIDTH)))
place = fit["details"]["world_from_shoulder"]
demand(abs(place[1] + HALF_WIDTH) < 1e-3, f"the shoulder is calibrated: {fit}")
reach = run_program("localize", "reach")
demand("calibrated of 20" in reach and "% of the box is reached" in reach, f"what is in reach: {reach}")

for folder in ("one", "two"):
    run_program("study", "new", folder)
    (work / folder / "plan.toml").write_text(PLAN)
record = conduct("one", "Shoulderpad")
is_at = shoulder_of(record)
demand(all(abs(a - b) < 1e-9 for a, b in zip(is_at, place)), f"the trial's shoulder is {is_at}, calibrated {place}")
kept = record / "calibrations" / "shoulder.toml"
demand(kept.read_bytes() == (work / "calibrations" / "shoulder.toml").read_bytes(), "the record keeps the calibration")
run_program("replay", str(record))
run_program("study", "export", "one")
table = (work / "one" / "tables" / "compensation.csv").read_text().splitlines()
row = dict(zip(table[0].split(","), table[1].split(",")))
demand(2.0 < float(row["trunk_turn_deg"]) < 12.0 and float(row["shoulder_path_m"]) > 0, f"compensation: {row}")

# The large brace has no calibration: the set-up's shoulder, and the calibration of the other brace is not kept.
text = (work / "moving.csv").read_text().replace("Shoulderpad", "ShoulderpadL")
(work / "moving.csv").write_text(text)
other = conduct("two", "ShoulderpadL")
demand(abs(shoulder_of(other)[1] + HALF_WIDTH) > 0.02, f"the other brace: {shoulder_of(other)}")
demand(not (other / "calibrations" / "shoulder.toml").exists(), "a calibration of the other brace is not kept")
shutil.rmtree(work)
print("study_calibrated: the study ran on the calibrated shoulder")
