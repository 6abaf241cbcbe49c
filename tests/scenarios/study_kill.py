#!/usr/bin/python3
"""Kills a study at random moments, again and again, until it is finished.

    tests/scenarios/study_kill.py PATH_OF_PROACT [--points N] [--seed S]

`study run --simulated --print-events` is killed by SIGKILL (every fifth time one of its workers is instead), then run again. A line
"event K" says that event K is on the disk. After each kill the journal has every event that was told; in the end the plan is
finished, no trial counts twice, each answer that was told is in the tables, and every record that counts replays. When a study is
finished before the kills are spent, another one begins. Prints the counts; exit code 0 only if all of it holds.
"""

import argparse
import contextlib
import csv
import json
import os
import pathlib
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time

PLAN = """
name = "{name}"
participants = 2
seed = {seed}

[trial]
setup = "seated"
limit_secs = {limit}

[[conditions]]
name = "A"
trial = {{ method = "A" }}
[[conditions]]
name = "D"
trial = {{ method = "D" }}

[order]
by = "williams"
[arrangements]
by = "balanced"

[[sessions]]
name = "1"
condition_positions = [1]
trials = 2
begin = [{{ do = "form", form = "participant", minutes = 1 }}, {{ do = "say", text = "welcome", minutes = 1 }}]
after_condition = [{{ do = "form", form = "nasa_tlx", minutes = 1 }}]
end = [{{ do = "form", form = "ranking", minutes = 1 }}]

[[sessions]]
name = "2"
days_after = [1, 2]
condition_positions = [2]
trials = 4
breaks = [{{ after_trial = 1, minutes = 1 }}]

[texts]
welcome = "Hello."
"""

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("proact", type=pathlib.Path)
parser.add_argument("--points", type=int, default=10, help="kills (default: %(default)s)")
parser.add_argument("--seed", type=int, default=1, help="of the moments (default: %(default)s)")
options = parser.parse_args()
proact = options.proact.resolve()
work = pathlib.Path(tempfile.mkdtemp(prefix="proact-study-kill-"))
rng = random.Random(options.seed)
counts = {"kills": 0, "of workers": 0, "studies": 0, "events": 0, "answers": 0, "trials": 0, "interrupted trials": 0}


class CheckFailed(Exception):
    """Something that was promised does not hold."""


def demand(holds, what):
    if not holds:
        raise CheckFailed(what)


def run_program(*words):
    run = subprocess.run([proact, *words], capture_output=True, text=True)
    demand(run.returncode == 0, f"{words} ended with {run.returncode}: {run.stderr.strip()}")
    return run.stdout


class StudyRun:
    """`study run` in a process group of its own."""

    def __init__(self, folder):
        self.process = subprocess.Popen(
            [proact, "study", "run", folder, "--simulated", "--print-events", "--jobs", "2"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.acknowledged = 0
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()
        self.error = ""
        threading.Thread(target=self._read_error, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            word, _, number = line.strip().partition(" ")
            if word == "event":
                self.acknowledged = int(number)

    def _read_error(self):
        self.error = self.process.stderr.read()

    def workers(self):
        listed = subprocess.run(["pgrep", "-P", str(self.process.pid)], capture_output=True, text=True).stdout
        return [int(line) for line in listed.split()]


def journal(folder):
    """All events, as the file has them."""
    if not (folder / "study.sqlite").exists():
        return []
    with sqlite3.connect(folder / "study.sqlite", timeout=10) as file:
        tables = file.execute("SELECT name FROM sqlite_master WHERE name = 'journal'").fetchall()
        return [(row[0], json.loads(row[1])) for row in file.execute("SELECT id, event FROM journal ORDER BY id")] if tables else []


def check_finished(folder, events):
    status = json.loads(run_program("study", "status", folder, "--json"))
    demand(status["finished"] and status["trials"][0] == status["trials"][1] == 12, f"the plan is finished: {status}")
    out = folder / "tables"
    rows = {name: list(csv.DictReader(open(out / f"{name}.csv", newline=""))) for name in ("trials", "attempts", "answers", "events")}
    demand(len(rows["trials"]) == 12, f"{len(rows['trials'])} trials count, 12 are planned")
    keys = [(row["participant"], row["session"], row["condition"], row["trial"]) for row in rows["trials"]]
    demand(len(set(keys)) == 12, "no trial twice")
    demand(len(rows["events"]) == len(events), "every event is in the table")
    given = {}
    for _, event in events:
        if event["kind"] == "answered":
            step_id = event["spot"]
            given[(str(step_id["participant"]), step_id["session"], step_id["step"], event["item"])] = event["answer"]
    demand(sum(1 for row in rows["answers"] if row["answer"]) == len(given), f"{len(given)} answers were told")
    demand(all(row["simulated"] == "1" for row in rows["trials"] + rows["answers"]), "all of it is marked as simulated")
    for row in rows["trials"]:
        replayed = json.loads(run_program("replay", folder / row["record"], "--json"))
        demand(replayed["agrees"] and replayed["finished"], f"{row['record']} does not replay: {replayed}")
        demand(replayed["digest"] == row["digest"], f"{row['record']} has the digest that the table says")
    counts["answers"] += len(given)
    counts["trials"] += len(rows["trials"])
    counts["interrupted trials"] += len(rows["attempts"]) - len(rows["trials"])
    counts["events"] += len(events)
    counts["studies"] += 1


def study(number):
    """One study, killed until it is finished or all kills are spent, then finished."""
    folder = work / f"study{number}"
    run_program("study", "new", folder)
    (folder / "plan.toml").write_text(PLAN.format(name=folder.name, seed=number, limit=rng.choice([4, 6, 10])))
    acknowledged = 0
    while True:
        run = StudyRun(folder)
        killed = counts["kills"] < options.points
        if killed:
            time.sleep(rng.uniform(0.02, 1.5))
            workers = run.workers()
            if counts["kills"] % 5 == 4 and workers:
                # The run may have ended it in between.
                with contextlib.suppress(ProcessLookupError):
                    os.kill(rng.choice(workers), signal.SIGKILL)
                    counts["of workers"] += 1
                time.sleep(rng.uniform(0.0, 0.3))
            if run.process.poll() is None:
                run.process.kill()
                counts["kills"] += 1
            else:
                killed = False
        code = run.process.wait(timeout=600)
        run.reader.join()
        acknowledged = max(acknowledged, run.acknowledged)
        events = journal(folder)
        demand([number for number, _ in events] == list(range(1, len(events) + 1)), "events are numbered without gaps")
        demand(len(events) >= acknowledged, f"event {acknowledged} was acknowledged, the journal has {len(events)}")
        if not killed:
            demand(code == 0, f"study run ended with {code}: {run.error}")
            check_finished(folder, events)
            shutil.rmtree(folder)
            return


try:
    number = 1
    while counts["kills"] < options.points:
        study(number)
        number += 1
    print(", ".join(f"{value} {name}" for name, value in counts.items()))
    print("1 passed, 0 failed")
except CheckFailed as broken:
    print(f"broken: {broken}; what is left is in {work}", file=sys.stderr)
    print(counts)
    print("0 passed, 1 failed")
    sys.exit(1)
shutil.rmtree(work)
