#!/usr/bin/python3
"""Makes the twelve records again that `./proact test records` replays.

    tests/records/make.py PATH_OF_PROACT [FOLDER]

FOLDER is the one of this script unless another is given. Run it on a platform of tests/digests, when the format of records has
gone up; README.md beside it says what each record is. Bags and logs of plans are left out: neither is replayed.
"""

import hashlib
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/scenarios"))

from page_client import PageClient, ServeProcess  # noqa: E402

MOST_FILE_BYTES = 200 << 10
PLAN = """
name = "corpus"
participants = 1
[trial]
limit_secs = 0.3
[[conditions]]
name = "D"
trial = { method = "D" }
[order]
by = "williams"
[[sessions]]
name = "1"
trials = 1
"""

# Simulated participants, whose EMG is 64 kB a second: long enough for a plan where one is made, short elsewhere.
DEMOS = {
    "a_emg": ["--method", "A", "--task", "modified_bbt", "--time-limit", "0.3"],
    "b_emg_left": ["--method", "B", "--arm", "mpl_left", "--time-limit", "0.3"],
    "c_emg_targeted_bbt": ["--method", "C", "--task", "targeted_bbt", "--time-limit", "0.3"],
    "d_emg_plan": ["--method", "D", "--setup", "still", "--seed", "10", "--time-limit", "1.35"],
    "d_original": ["--method", "D", "--profile", "original", "--time-limit", "0.3"],
    "external_method": ["--method-command", "python3 follow_gaze.py", "--time-limit", "0.3"],
    "external_intent": ["--intent-command", "python3 leaky_dwell.py", "--time-limit", "0.3"],
}
# Programs that these trials start.
PROGRAMS = ["docs/methods/follow_gaze.py", "docs/intent_models/leaky_dwell.py"]


def demo(proact, out, words):
    command = [proact, "demo", "--headless", "--out", out, *words]
    done = subprocess.run(command, stdout=subprocess.DEVNULL)
    # A method that has not acted by the end is an error to the command; its record is complete.
    assert done.returncode in (0, 1) and pathlib.Path(out, "SHA256SUMS").exists(), f"{out}: demo ended with {done.returncode}"


def live(proact, out, port, how, act, *words):
    """A trial that `act` drives at the page and the signal `how` ends; the folder of its record."""
    server = ServeProcess(proact, port, out, "--seed", "7", *words)
    page = PageClient(server.port)
    act(page)
    code = server.stop(how)
    assert how == signal.SIGKILL or code == 0, f"{out}: serve ended with {code}: {server.output_text()}"
    return pathlib.Path(out, "seed7")


def look_at(page, frame, index):
    """Looks at an object of the frame, from where the head is."""
    origin, place = frame["world_from_head"]["translation"], frame["objects"][index]["translation"]
    direction = [to - at for to, at in zip(place, origin)]
    page.send(type="gaze", origin=origin, direction=direction)


def press(page, gesture, frames):
    """Holds a key for some frames, while the eyes stay on the first object."""
    page.send(type="gesture", gesture=gesture)
    for _ in range(frames):
        look_at(page, page.frame(), 0)


def keys(page):
    for gesture in ["hand_close", "no_motion", "wrist_flexion", "no_motion", "wrist_extension", "no_motion", "hand_open"]:
        press(page, gesture, 8)


def select(page):
    """Looks, locks the object, starts the way to it."""
    press(page, "no_motion", 30)
    press(page, "wrist_flexion", 40)
    press(page, "no_motion", 20)
    press(page, "wrist_extension", 60)


def study(proact):
    folder = pathlib.Path("study")
    subprocess.run([proact, "study", "new", folder], check=True, stdout=subprocess.DEVNULL)
    (folder / "plan.toml").write_text(PLAN)
    subprocess.run([proact, "study", "run", folder, "--simulated"], check=True, stdout=subprocess.DEVNULL)
    return folder / "trials/participant1-modeD-trial1"


def keep(record, to):
    """Copies a record without its bag, with hashes of what is left."""
    shutil.rmtree(to, ignore_errors=True)
    shutil.copytree(record, to, ignore=shutil.ignore_patterns("*.bag", "*.bag.active", "plans.jsonl", "SHA256SUMS"))
    if (record / "SHA256SUMS").exists():
        files = sorted(to.iterdir())
        sums = [f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in files]
        (to / "SHA256SUMS").write_text("".join(sums))
    for file in to.iterdir():
        size = file.stat().st_size
        assert size <= MOST_FILE_BYTES, f"{file} has {size} bytes, expected at most {MOST_FILE_BYTES}"


def main():
    proact = pathlib.Path(sys.argv[1]).resolve()
    into = pathlib.Path(sys.argv[2] if len(sys.argv) > 2 else pathlib.Path(__file__).parent).resolve()
    with tempfile.TemporaryDirectory(prefix="proact-records-") as place:
        # Names of files go into records: none of this machine's.
        os.chdir(place)
        for program in PROGRAMS:
            shutil.copy(ROOT / program, ".")
        for name, words in DEMOS.items():
            demo(proact, name, words)
            keep(pathlib.Path(name), into / name)
        end = signal.SIGINT
        keep(live(proact, "keys_a", 18610, end, keys, "--method", "A", "--task", "bbt"), into / "keys_a_bbt")
        keep(live(proact, "keys_b", 18611, end, keys, "--method", "B", "--arm", "mpl_left"), into / "keys_b_left")
        keep(live(proact, "page_d", 18612, end, select, "--method", "D"), into / "page_d_plan")
        keep(live(proact, "page_c", 18613, signal.SIGKILL, select, "--method", "C"), into / "page_c_interrupted")
        keep(study(proact), into / "study_d")
        os.chdir(ROOT)
    for record in sorted(path for path in into.iterdir() if path.is_dir()):
        run = subprocess.run([proact, "replay", record], capture_output=True, text=True)
        print(f"{record.name:<20} {run.stdout.strip() or run.stderr.strip()}")
        assert run.returncode == 0, record
    assert '"plan_finished"' in (into / "page_d_plan/events.jsonl").read_text(), "page_d_plan has no plan"


if __name__ == "__main__":
    main()
