#!/usr/bin/python3
"""Kills the program at random moments, and looks at what is left.

    tests/scenarios/kill.py PATH_OF_PROACT [--points N] [--seed S]

N points for each of `demo`, `serve`, `emg train` and `emg features`: most by SIGKILL, every fourth by SIGTERM, SIGHUP or SIGINT, which
must end a record as it should. After each: `replay` agrees and `analyze` ends with exit code 0, up to the last digest;
every event that a page was shown and a digest counts is in the record, and nothing that was shown is older than 0.2 s
behind it; the bag's last message is at most 0.2 s older than the last digest; of a training every repetition that was
told to be kept is whole in its folder, and a model is whole or not there; of a file that is replaced the old or the new one is
there, whole. Exit code 0 only if all of it holds.
"""

import argparse
import concurrent.futures
import json
import pathlib
import random
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time

from page_client import PageClient, ServeProcess

# Promised: a process that is killed loses at most this, milliseconds; a frame shows what is one flush old.
LOST_MS = 200
ROS_EPOCH_MS = 1_000_000
GRACEFUL_SIGNALS = [signal.SIGTERM, signal.SIGHUP, signal.SIGINT]
# Run by nohup this ignores SIGHUP, and programs that inherit that outlive it, as they should.
signal.signal(signal.SIGHUP, signal.SIG_DFL)

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("proact", type=pathlib.Path)
parser.add_argument("--points", type=int, default=10, help="for each of the four programs (default: %(default)s)")
parser.add_argument("--seed", type=int, default=1, help="of the moments (default: %(default)s)")
options = parser.parse_args()
work = pathlib.Path(tempfile.mkdtemp(prefix="proact-kill-"))


class CheckFailed(Exception):
    """Something that was promised does not hold."""


def demand(holds, what):
    if not holds:
        raise CheckFailed(what)


def run_program(*words):
    run = subprocess.run([options.proact, *words, "--json"], capture_output=True, text=True)
    demand(run.returncode == 0, f"{' '.join(map(str, words))} ended with {run.returncode}: {run.stderr.strip()}")
    return json.loads(run.stdout)


def last_message_ms(bag):
    """Time of the last message in the whole chunks of a bag, on the trial's clock."""
    data = bag.read_bytes()
    at, last = len(b"#ROSBAG V2.0\n"), 0

    def record(data, at):
        header = struct.unpack_from("<I", data, at)[0]
        size = struct.unpack_from("<I", data, at + 4 + header)[0]
        fields, field = {}, at + 4
        while field < at + 4 + header:
            length = struct.unpack_from("<I", data, field)[0]
            name, value = data[field + 4 : field + 4 + length].split(b"=", 1)
            fields[name], field = value, field + 4 + length
        start = at + 8 + header
        return fields, start, start + size

    while at + 8 < len(data):
        try:
            fields, start, end = record(data, at)
        except (struct.error, ValueError):
            break
        if end > len(data):
            break
        if fields.get(b"op") == b"\x05":
            inner = start
            while inner < end:
                message, _, inner = record(data, inner)
                if message[b"op"] == b"\x02":
                    secs, nsecs = struct.unpack("<II", message[b"time"])
                    last = max(last, secs * 1000 + nsecs // 1_000_000)
        at = end
    return last - ROS_EPOCH_MS


def check_record(folder, ended_well, shown=()):
    """Replays and analyzes a record; its last digest, ms. `shown` are the frames that a page got."""
    if not folder.exists():
        demand(not shown, f"{folder} is not there, although frames of it were shown")
        return 0
    replayed = run_program("replay", folder)
    demand(replayed["agrees"], f"{folder} does not agree with itself: {replayed}")
    demand(replayed["finished"] or not ended_well, f"{folder} was ended by a signal and is not finished")
    # Of a record without a pick that is finished there is nothing to analyze, which is an error of its own.
    if not replayed["finished"]:
        run_program("analyze", folder, "--intent")
    end = round(replayed["seconds"] * 1000)
    if shown:
        demand(end >= shown[-1]["time"] - LOST_MS, f"{folder} ends at {end} ms, {shown[-1]['time']} ms were shown")
        recorded = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines() if line.endswith("}")]
        for frame in shown:
            for event in frame["events"]:
                demand(event["time"] > end or event in recorded, f"{folder} lacks {event}, which was shown")
    for bag in folder.glob("trial.bag*"):
        # Before the first digest a bag has nothing but its head.
        last = last_message_ms(bag) if end else 0
        demand(last >= end - LOST_MS, f"{bag} ends at {last} ms, the digests at {end} ms")
    return end


def demo(number, rng):
    folder = work / f"demo{number}"
    command = [options.proact, "demo", "--headless", "--seed", str(number), "--out", folder]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    time.sleep(rng.uniform(0.02, 1.2))
    how = rng.choice(GRACEFUL_SIGNALS) if number % 4 == 3 else signal.SIGKILL
    process.send_signal(how)
    process.wait(timeout=60)
    # Before its handlers are there a signal of any kind ends a program, and after the trial none does.
    return check_record(folder, False)


def serve(number, rng):
    folder = work / f"serve{number}"
    method = rng.choice("ABCD")
    server = ServeProcess(options.proact, 18400 + number % 50, folder, "--seed", "7", "--method", method)
    page = PageClient(server.port)
    how = rng.choice(GRACEFUL_SIGNALS) if number % 4 == 3 else signal.SIGKILL
    shown, end = [], time.monotonic() + rng.uniform(0.1, 4.0)
    gestures = ["wrist_flexion", "wrist_extension", "hand_close", "hand_open", "no_motion"]
    while time.monotonic() < end:
        page.send(type="gaze", origin=[-0.5, 0, 1.7], direction=[0.6, rng.uniform(-0.3, 0.3), -0.7])
        page.send(type="gesture", gesture=rng.choice(gestures))
        shown.append(page.frame())
    code = server.stop(how)
    demand(how == signal.SIGKILL or code == 0, f"{how.name} ended serve with {code}")
    return check_record(folder / "seed7", how != signal.SIGKILL, shown)


def train(number, rng):
    folder, model = work / f"train{number}", work / f"model{number}.json"
    secs, rate, gestures = 0.5, 1000, 5
    command = [options.proact, "emg", "train", "--source", "synthetic", "--repetition-seconds", str(secs), "--prepare-seconds", "0.2"]
    command += ["--max-rounds", "2", "--save", folder, "--out", model]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    time.sleep(rng.uniform(0.5, 8.0))
    # A model that is not good enough is written, and said to be so by the exit code.
    demand(process.poll() is None or model.exists(), f"{' '.join(map(str, command))} ended with {process.poll()}")
    process.send_signal(signal.SIGKILL if number % 4 != 3 else rng.choice(GRACEFUL_SIGNALS))
    process.wait(timeout=60)
    rows = [len(path.read_text().splitlines()) for path in folder.glob("R_*.csv")]
    demand(all(count == rows[0] for count in rows), f"{folder} has repetitions of {rows} rows")
    demand(min(rows, default=rate) >= secs * rate * 0.9, f"{folder} has repetitions of {rows} rows")
    if model.exists():
        demand(json.loads(model.read_text()), f"{model} is not whole")
        demand(len(rows) == 2 * gestures, f"{model} is there and {len(rows)} repetitions")
    if len(rows) >= 2 * gestures and not model.exists():
        # Whether it is a good one is not the question here.
        again = work / f"again{number}.json"
        train = ["emg", "train", "--source", f"file:{folder}", "--out", again]
        subprocess.run([options.proact, *train, "--json"], capture_output=True)
        demand(again.exists(), f"no model can be trained on {folder}")
    return len(rows)


def features(number, rng):
    samples, out = work / f"samples{number}.csv", work / f"features{number}.csv"
    rows, window = 40_000, 20
    samples.write_text("\n".join(",".join(str(row * (k + 3) % 17) for k in range(8)) for row in range(rows)) + "\n")
    old = "old\n" * 1000
    out.write_text(old)
    command = [options.proact, "emg", "features", "--csv", samples, "--out", out]
    command += ["--window", str(window), "--increment", "1", "--unit", "samples"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    time.sleep(rng.uniform(0.0, 1.0))
    process.send_signal(rng.choice([signal.SIGKILL, *GRACEFUL_SIGNALS]))
    process.wait(timeout=60)
    text = out.read_text()
    count = len(text.splitlines())
    demand(text == old or (count == rows - window + 1 and text.endswith("\n")), f"{out} is neither old nor new: {count} lines")
    samples.unlink()
    return count


def kill_points(program):
    rng = random.Random(f"{options.seed} {program.__name__}")
    found = []
    for number in range(options.points):
        try:
            found.append(program(number, rng))
        except (CheckFailed, ConnectionError, RuntimeError, subprocess.SubprocessError, OSError) as error:
            return program.__name__, found, f"point {number}: {error}; it is in {work}"
    return program.__name__, found, None


with concurrent.futures.ThreadPoolExecutor(max_workers=4) as pool:
    done = list(pool.map(kill_points, [demo, serve, train, features]))
failed = False
for name, found, error in done:
    unit = {"train": "repetitions kept", "features": "lines"}.get(name, "ms in the record")
    print(f"{name:6} {len(found)} points, {min(found, default=0)} to {max(found, default=0)} {unit}")
    if error:
        failed = True
        print(f"FAILED: {name}, {error}")
if not failed:
    shutil.rmtree(work)
sys.exit(failed)
