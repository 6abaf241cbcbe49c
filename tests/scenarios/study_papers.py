#!/usr/bin/python3
"""Runs both studies of the ProACT paper with simulated participants, from plan to tables.

    tests/scenarios/study_papers.py PATH_OF_PROACT [--jobs N] [study1] [study2]

The tables have exactly the rows that the plans ask for. Prints what each took. Exit code 0 only if all of it holds.
"""

import argparse
import csv
import json
import pathlib
import resource
import shutil
import subprocess
import sys
import tempfile
import time

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("proact", type=pathlib.Path)
parser.add_argument("studies", nargs="*", default=["study1", "study2"])
parser.add_argument("--jobs", default="2", help="participants at once (default: %(default)s)")
options = parser.parse_args()
proact = options.proact.resolve()
work = pathlib.Path(tempfile.mkdtemp(prefix="proact-papers-"))


def demand(holds, what):
    if not holds:
        print(f"broken: {what}; what is left is in {work}", file=sys.stderr)
        print("0 passed, 1 failed")
        sys.exit(1)


def run_program(*words):
    run = subprocess.run([proact, *words], capture_output=True, text=True)
    demand(run.returncode == 0, f"{words} ended with {run.returncode}: {run.stderr.strip()}")
    return run.stdout


for name in options.studies:
    folder = work / name
    run_program("study", "new", folder, "--template", name)
    schedule = json.loads(run_program("study", "check", folder, "--schedule", "--json"))["sessions"]
    steps = [step for session in schedule for step in session["happenings"]]
    trials = [step for step in steps if "arrangement" in step]
    forms = [step for step in steps if step.get("do") == "form"]
    start = time.monotonic()
    run_program("study", "run", folder, "--simulated", "--jobs", options.jobs, "--json")
    seconds = time.monotonic() - start
    start = time.monotonic()
    rows = json.loads(run_program("study", "export", folder, "--json"))["rows"]
    exporting = time.monotonic() - start
    tables = {table: list(csv.DictReader(open(folder / "tables" / f"{table}.csv", newline=""))) for table in rows}
    demand(rows["trials"] == rows["attempts"] == len(trials), f"{len(trials)} trials are planned, {rows['trials']} are there")
    planned = sorted((t["participant"], t["session"], t["condition"], t["trial"], t["arrangement"]) for t in trials)
    there = sorted(
        (int(r["participant"]), r["session"], r["condition"], int(r["trial"]), r["arrangement"]) for r in tables["trials"]
    )
    demand(planned == there, "each trial of the plan is there once, with its arrangement")
    demand(rows["blocks"] == 4 * len(trials) and rows["gaze"] == 2 * len(trials), f"four blocks and two phases a trial: {rows}")
    demand(rows["sessions"] == len(schedule), f"{len(schedule)} sessions")
    answered = {(r["participant"], r["session"], r["condition"], r["form"]) for r in tables["answers"]}
    demand(len(answered) == len(forms), f"{len(forms)} questionnaires are planned, {len(answered)} were answered")
    demand(all(r["answer"] and r["simulated"] == "1" for r in tables["answers"]), "all answers, marked as simulated")
    demand(rows["deviations"] == 0, "nothing departs from the plan")
    size = sum(file.stat().st_size for file in folder.glob("trials/**/*") if file.is_file())
    simulated = sum(float(r["seconds"]) for r in tables["trials"])
    print(
        f"{name}: {len(trials)} trials in {seconds:.0f} s with {options.jobs} at once; {simulated / 3600:.2f} h of trials are "
        f"{size / 1e6:.0f} MB, {size / 1e6 * 3600 / simulated:.0f} MB an hour; tables in {exporting:.1f} s"
    )
    shutil.rmtree(folder)
peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
print(f"largest process: {peak:.0f} MB")
print("1 passed, 0 failed")
shutil.rmtree(work)
