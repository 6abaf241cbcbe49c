#!/usr/bin/python3
"""Conducts a study with people: this script is experimenter and participant at the pages' sockets.

    tests/scenarios/study_live.py PATH_OF_PROACT

A session of every kind of step from begin to thanks: answers that are refused and taken back, consent that is missing, a test of
gestures by keys, a calibration of the gaze, practice, a demonstration, trials that are paused, ended, done again and left out, a
session that is left and goes on, and a program that is killed in the middle of a trial. Then what a lab may do to it: a second
program, an edited plan, a participant who exists, a journal that cannot be written to, a clock that is set back. Every event that
was told as on the disk has to be in the tables, and every departure from the plan with its reason. Exit code 0 only if all of it
holds.
"""

import argparse
import csv
import json
import math
import os
import pathlib
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

from page_client import PageClient

TIMEOUT_SECS = 30
# Two rounds of five gestures, and a sequence without a mistake.
TRAINING_SECS = 150
PLAN = """
name = "live"
title = "Every kind of step"
participants = 2

[trial]
task = "modified_bbt"
setup = "still"
limit_secs = 3

[[conditions]]
name = "D"
trial = { method = "D" }
begin = [{ do = "demonstrate", minutes = 1 }, { do = "practise", transfers = 1, minutes = 1 }]

[order]
by = "listed"

[[sessions]]
name = "1"
trials = 2
begin = [
  { do = "form", form = "participant", minutes = 1 },
  { do = "say", text = "welcome", minutes = 1 },
  { do = "train", repetitions = 2, hold_secs = 1, consecutive_correct_runs = 1, minutes = 1 },
  { do = "calibrate_gaze", minutes = 1 },
  { do = "rest", minutes = 0.05 },
]
after_condition = [{ do = "form", form = "nasa_tlx", minutes = 1 }]
end = [{ do = "form", form = "comments", minutes = 1 }]

[texts]
welcome = "Hello."
"""

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("proact", type=pathlib.Path)
options = parser.parse_args()
proact = options.proact.resolve()
work = pathlib.Path(tempfile.mkdtemp(prefix="proact-study-"))
folder = work / "live"


class CheckFailed(Exception):
    """Something that was promised does not hold."""


def demand(holds, what):
    if not holds:
        raise CheckFailed(what)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Listener:
    """A page whose newest messages of each type are kept, read beside what the script does."""

    def __init__(self, port, role):
        self.page = PageClient(port, role)
        self.newest = {}
        self.ended = False
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        try:
            while True:
                message = self.page.receive()
                if message:
                    self.newest[message["type"]] = message
        except (OSError, ConnectionError, ValueError):
            self.ended = True

    def until(self, kind, holds, what, timeout=TIMEOUT_SECS):
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            message = self.newest.get(kind)
            if message and holds(message):
                return message
            if self.ended:
                break
            time.sleep(0.01)
        ended = "; the connection is gone" if self.ended else ""
        raise CheckFailed(f"{what}{ended}: the newest message is {json.dumps(self.newest.get(kind))[:1500]}")


class StudyRun:
    """`proact study run`, with an experimenter's and a participant's page."""

    def __init__(self, *words, prefix=(), study=None):
        self.port = free_port()
        command = [*prefix, proact, "study", "run", study or folder, "--no-browser", "--exact-port", "--port", str(self.port)]
        self.log = open(work / "run.log", "ab")
        self.process = subprocess.Popen(
            [*command, "--print-events", *words], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=self.log, text=True
        )
        self.acknowledged = 0
        threading.Thread(target=self._acknowledge, daemon=True).start()
        end = time.monotonic() + TIMEOUT_SECS
        while True:
            try:
                self.experimenter = Listener(self.port, "experimenter")
                break
            except OSError:
                demand(self.process.poll() is None, f"study run ended: {(work / 'run.log').read_text()[-2000:]}")
                demand(time.monotonic() < end, "the page is served")
                time.sleep(0.05)
        self.participant = Listener(self.port, "participant")
        self.participant.page.send(type="join", name="participant")

    def _acknowledge(self):
        for line in self.process.stdout:
            word, _, number = line.strip().partition(" ")
            if word == "event":
                self.acknowledged = int(number)

    def ask(self, ask, **more):
        self.experimenter.page.send(type="conduct", ask=ask, **more)

    def screen(self, holds, what):
        return self.experimenter.until("study", holds, what)

    def wait_for_step(self, kind, what=None, running=None):
        """Waits for a step of this kind."""

        def holds(screen):
            now = screen["session"] and screen["session"]["now"]
            return now and now["what"]["is"] == kind and (running is None or now["running"] == running)

        return self.screen(holds, what or f"a step that is {kind}")["session"]["now"]

    def wait_for_notice(self, words):
        return self.screen(lambda screen: words in screen["notice"], f"shows {words!r}")

    def wait_for_participant_screen(self, show):
        return self.participant.until("participant", lambda screen: screen["show"] == show, f"the participant sees {show}")

    def answer(self, form, key, value, page=None):
        (page or self.participant).page.send(type="answer", step=form["step"], key=key, answer=value)

    def fill(self, form):
        """Answers whatever has to be answered, and waits until it is kept."""
        for item in form["form"]["items"]:
            kind = item["kind"]
            value = {
                "scale": lambda: item["least"] + item["step"],
                "choice": lambda: [item["options"][0]["value"]] if item["several"] else item["options"][0]["value"],
                "ranking": lambda: [form["conditions"]],
                "condition": lambda: form["conditions"][0],
                "consent": lambda: item["version"],
                "text": lambda: "free, \"quoted\", words\nin two lines",
            }[kind]()
            self.answer(form, item["key"], value)
        for pair in form["pairs"]:
            self.answer(form, pair["key"], pair["second"])
        wanted = {item["key"] for item in form["form"]["items"]} | {pair["key"] for pair in form["pairs"]}
        kept = self.participant.until(
            "participant",
            lambda screen: screen["show"] == "form" and wanted <= set(screen["answers"]),
            "all answers are kept",
        )
        demand(kept["missing"] == [] and kept["refused"] is None, "nothing is missing")
        self.participant.page.send(type="submit", step=form["step"])

    def drive(self, seconds):
        """Looks about and makes a gesture, so that the trial's clock starts."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            angle = 0.3 + 0.1 * math.sin(7 * time.monotonic())
            self.participant.page.send(
                type="gaze", origin=[-0.5, 0.3, 1.7], direction=[math.cos(angle), 0.1 * math.cos(3 * angle), -math.sin(angle)]
            )
            time.sleep(0.02)

    def trial(self):
        """Starts the trial that waits, although nobody minds that the gaze is not calibrated by a mouse."""
        now = self.wait_for_step("trial", running=False)
        if all(check["ready"] for check in now["what"]["checks"]):
            self.ask("next")
        else:
            self.ask("start_anyway", reason="a test")
        self.wait_for_step("trial", running=True)
        self.wait_for_participant_screen("scene")

    def end(self, how=signal.SIGINT):
        # What wraps the program, such as faketime, does not hand signals on.
        inner = subprocess.run(["pgrep", "-f", f"^{proact} study run"], capture_output=True, text=True).stdout.split()
        for process in map(int, inner):
            os.kill(process, how)
        code = self.process.wait(timeout=TIMEOUT_SECS)
        demand(how != signal.SIGINT or code == 0, f"study run ended with {code}: {(work / 'run.log').read_text()[-2000:]}")
        return code


def run_program(*words):
    run = subprocess.run([proact, *words], capture_output=True, text=True)
    demand(run.returncode == 0, f"{words} ended with {run.returncode}: {run.stderr}")
    return run.stdout


def run_refused(*words, prefix=(), study=None):
    run = subprocess.run([*prefix, proact, "study", "run", study or folder, "--no-browser", *words], capture_output=True, text=True)
    demand(run.returncode != 0, f"{words} is refused")
    lines = [line for line in run.stderr.splitlines() if line.startswith("proact:")]
    demand(len(lines) == 1, f"one sentence: {run.stderr}")
    return lines[0]


def table(name, out):
    with open(out / f"{name}.csv", newline="") as file:
        return list(csv.DictReader(file))


def run_until_kill():
    run = StudyRun("--usage-log", work / "use.jsonl")
    screen = run.screen(lambda screen: screen["next"], "says who is next")
    demand(screen["next"]["participant"] == 1 and screen["can"] == ["begin"], f"participant 1 is next: {screen['next']}")
    run.ask("begin", id="nobody")
    run.wait_for_notice("there is no participant nobody")
    run.ask("begin", id="X1", new=True)

    form = run.wait_for_participant_screen("form")
    run.ask("skip", reason="in a hurry")
    run.wait_for_notice("without consent")
    run.participant.page.send(type="submit", step=form["step"])
    run.wait_for_notice("without consent")
    run.answer(form, "no_such_item", "x")
    run.participant.until("participant", lambda s: s.get("refused") and s["refused"]["key"] == "no_such_item", "an unknown item is refused")
    choice = next(item for item in form["form"]["items"] if item["kind"] == "choice")
    run.answer(form, choice["key"], "no such answer")
    run.participant.until("participant", lambda s: s.get("refused") and s["refused"]["key"] == choice["key"], "an unknown answer is refused")
    run.answer(form, choice["key"], choice["options"][1]["value"])
    run.participant.until("participant", lambda s: choice["key"] in s.get("answers", {}), "an answer is kept")
    run.answer(form, choice["key"], None)
    run.participant.until("participant", lambda s: choice["key"] not in s.get("answers", {choice["key"]: 1}), "and taken back")
    run.fill(form)

    demand(run.wait_for_step("say")["what"]["text"] == "Hello.", "the text to say is there")
    run.wait_for_participant_screen("listen")
    run.ask("note", text="arrived\x07 late")
    screen = run.screen(lambda screen: screen["notes"], "a note is kept")
    demand(screen["notes"] == ["arrived  late"], f"without control characters: {screen['notes']}")
    run.ask("next")

    run.wait_for_participant_screen("train")
    end = time.monotonic() + TIMEOUT_SECS
    while not (prompt := run.participant.newest["participant"])["passed"]:
        demand(time.monotonic() < end, f"the gestures are passed: {prompt}")
        run.participant.page.send(type="gesture", gesture=prompt["gesture"])
        time.sleep(0.05)
        run.participant.page.send(type="alive")
        prompt = run.participant.newest["participant"]
        if prompt["show"] != "train":
            break
    run.participant.page.send(type="gesture", gesture="no_motion")
    run.ask("next")

    run.wait_for_step("calibrate_gaze", running=True)
    run.wait_for_participant_screen("scene")
    point = {"accuracy_deg": 3.0, "precision_deg": 0.1, "offset_deg": [2.9, 0.1], "lost_share": 0, "blinks": 0, "samples": 60}
    run.drive(0.3)
    run.participant.until("status", lambda status: status["gaze_calibrations"] > 0, "the participant's page is asked to calibrate")
    run.participant.page.send(type="gaze_check", source="mouse", points=[point] * 5, correction_deg=[2.9, 0.1])
    run.screen(
        lambda s: s["session"]["now"]["what"].get("error_deg") == 3.0, "the error of the gaze is shown to the experimenter"
    )
    run.ask("next")
    demand(run.wait_for_participant_screen("rest")["left_secs"] <= 3.0, "the break's length is the plan's")
    run.screen(lambda s: s["session"]["now"]["what"].get("left_secs") == 0, "the break runs out")
    run.ask("next")

    run.wait_for_step("demonstrate", running=False)
    run.ask("next")
    run.wait_for_step("demonstrate", running=True)
    demand("watch" in run.wait_for_participant_screen("scene")["title"], "the demonstration says so")
    time.sleep(0.5)
    run.ask("next")
    run.wait_for_step("practise", running=False)
    run.ask("next")
    run.wait_for_step("practise", running=True)
    run.drive(0.5)
    # What may not be asked for now is told, and changes nothing.
    run.ask("redo", reason="x")
    run.wait_for_notice("end it first")
    run.ask("next")

    now = run.wait_for_step("trial", running=False)
    checks = {check["name"]: check for check in now["what"]["checks"]}
    demand({"pages", "gestures", "gaze", "disk", "clock"} <= set(checks), f"what is looked at: {sorted(checks)}")
    demand(checks["gaze"]["ready"] and checks["gestures"]["ready"], f"trained and calibrated: {checks}")
    demand(checks["gaze"]["age_secs"] is not None, "each has its age")
    run.ask("redo", reason="too early")
    run.wait_for_notice("there is no trial")
    run.trial()
    frame = run.participant.newest.get("frame")
    run.drive(0.5)
    run.experimenter.page.send(type="study", action="pause")
    run.participant.until("status", lambda status: status["paused"], "the trial stands still")
    # What would choose another trial is not a participant's to ask.
    run.participant.page.send(type="restart")
    run.ask("note", text="the phone rang")
    run.screen(lambda screen: "the phone rang" in screen["notes"], "a note is kept in a pause")
    run.experimenter.page.send(type="study", action="resume")
    run.drive(4.0)
    now = run.wait_for_step("trial", running=False)
    demand(now["what"]["number"] == [2, 2] and "blocks on target in 3 s" in now["what"]["before"], f"after the first trial: {now['what']}")

    # Trained and calibrated again in the middle: kept with the reasons.
    run.ask("retrain", reason="")
    run.wait_for_notice("a reason is needed")
    run.ask("recalibrate", reason="the headset slipped")
    run.wait_for_step("calibrate_gaze", running=True)
    run.drive(0.3)
    run.ask("next")
    run.wait_for_step("trial", running=False)
    run.ask("redo", reason="looked away")
    now = run.wait_for_step("trial", running=False)
    run.screen(lambda s: s["session"]["now"]["what"]["number"] == [1, 2], "the first trial is done again")
    run.trial()
    run.drive(0.5)
    # In the middle of the trial.
    demand(run.participant.newest["frame"]["time"] > 100, "the trial goes on")
    acknowledged = run.acknowledged
    run.end(signal.SIGKILL)
    return acknowledged


def resume_and_finish(acknowledged):
    run = StudyRun("--usage-log", work / "use.jsonl")
    run.wait_for_notice("was interrupted")
    # Beside it nobody else runs this study, and looking is allowed.
    demand("another program runs this study" in run_refused("--port", "0"), "a second program is refused")
    run_program("study", "status", folder)
    demand(run.acknowledged > acknowledged, "events go on where they were")
    screen = run.screen(lambda screen: screen["next"], "says who is next")
    demand(screen["next"]["begun"] and screen["next"]["id"] == "X1", f"the session goes on: {screen['next']}")
    run.ask("begin", id="X1", new=True)
    run.wait_for_notice("X1 exists already")
    run.ask("begin")
    run.screen(lambda s: s["session"] and s["session"]["now"]["what"].get("number") == [1, 2], "the interrupted trial is done again")
    run.trial()
    run.drive(4.0)
    run.screen(lambda s: s["session"]["now"]["what"].get("number") == [2, 2], "then the second one")
    run.trial()
    run.drive(0.3)
    run.experimenter.page.send(type="study", action="abort")
    form = run.wait_for_participant_screen("form")
    demand(form["about"] == "D" and len(form["pairs"]) == 15, "the questionnaire is about the condition, with its pairs")
    run.answer(form, form["form"]["items"][0]["key"], 50)
    run.participant.until("participant", lambda s: len(s.get("answers", {})) == 1, "one answer is kept")
    run.ask("leave")
    run.screen(lambda screen: screen["next"], "the session is left")
    run.ask("begin")
    form = run.wait_for_participant_screen("form")
    demand(len(form["answers"]) == 1, "answers stay")
    run.participant.page.send(type="submit", step=form["step"])
    run.wait_for_notice("questions have no answer")
    run.fill(form)
    form = run.wait_for_participant_screen("form")
    run.participant.until("participant", lambda s: s.get("form", {}).get("name") == "comments", "the last questionnaire")
    run.ask("skip", reason="no time left")
    run.screen(lambda screen: screen["session"] is None, "the session is over")
    run.wait_for_participant_screen("thanks")
    acknowledged = run.acknowledged
    run.end()
    return acknowledged


def check_use_log():
    """The first program was killed within its minute; the second one had the trials that ended and whoever was connected."""
    lines = [json.loads(line) for line in (work / "use.jsonl").read_text().splitlines()]
    demand(lines, "the log of use has lines")
    used = [line["used"] for line in lines]
    trials = sum(line["trials"] for line in used)
    demand(2 <= trials <= 4, f"trials that ended, and no practice or demonstration: {lines}")
    demand(all(line["connected_secs"] > 0 for line in used), f"a page was connected: {lines}")
    days = json.loads(run_program("emg", "usage", work / "use.jsonl", "--json"))["days"]
    demand(sum(day["trials"] for day in days) == trials, f"and emg usage adds them up: {days}")


def check_exported_tables(acknowledged):
    out = work / "tables"
    check_use_log()
    rows = json.loads(run_program("study", "export", folder, "--out", out, "--keep-pseudonyms", "--raw", "--json"))["rows"]
    demand(rows["trials"] == 2 and rows["attempts"] == 4, f"two trials count, of four attempts: {rows}")
    demand(rows["events"] >= acknowledged, f"{acknowledged} events were acknowledged, {rows['events']} are there")
    numbers = [int(row["event"]) for row in table("events", out)]
    demand(numbers == list(range(1, len(numbers) + 1)), "events are numbered without gaps")
    kinds = {row["deviation"]: row["reason"] for row in table("deviations", out)}
    demand(kinds.get("repeated") == "looked away" and kinds.get("left_out") == "no time left", f"reasons: {kinds}")
    demand(kinds.get("recalibrated") == "the headset slipped", f"reasons: {kinds}")
    trials = table("trials", out)
    demand([row["end_reason"] for row in trials] == ["task", "abort"], f"how they ended: {trials}")
    demand(trials[0]["mark"] == "*" and "repeated" in trials[0]["deviations"], "the asterisk of what was done again")
    demand(all(row["simulated"] == "0" for row in trials), "people are no simulation")
    attempts = [(row["trial"], row["attempt"], row["outcome"]) for row in table("attempts", out)]
    demand(attempts == [("1", "1", "done"), ("1", "2", "interrupted"), ("1", "3", "done"), ("2", "1", "aborted")], f"{attempts}")
    participants = table("participants", out)
    demand(participants[0]["id"] == "X1" and participants[0]["consent_version"], f"consent is there: {participants[0]}")
    scores = {row["score_name"]: row["value"] for row in table("scores", out) if row["form"] == "nasa_tlx"}
    demand(float(scores["nasa_tlx_raw"]) > 0 and float(scores["nasa_tlx_weighted"]) > 0, f"scores: {scores}")
    demand(rows["raw_gaze"] > 50, "the gaze sample by sample")
    for row in table("attempts", out):
        record = folder / row["record"]
        replayed = json.loads(run_program("replay", record, "--json"))
        demand(replayed["agrees"], f"{record} replays")
        demand((record / f"participant1-modeD-trial{row['trial']}.bag").exists() or row["outcome"] == "interrupted", f"the bag of {record}")
    # Without --keep-pseudonyms nobody finds the pseudonym.
    plain = work / "shared"
    run_program("study", "export", folder, "--out", plain)
    for file in plain.glob("*.csv"):
        demand("X1" not in file.read_text(), f"{file.name} has no pseudonym")
    subprocess.run(["sha256sum", "--quiet", "-c", "SHA256SUMS"], cwd=plain, check=True)
    archive = work / "live.zip"
    run_program("study", "archive", folder, "--out", archive)
    shutil.unpack_archive(archive, work / "unpacked")
    subprocess.run(["sha256sum", "--quiet", "-c", "SHA256SUMS"], cwd=work / "unpacked" / "live", check=True)
    demand(run_program("study", "status", work / "unpacked" / "live") == run_program("study", "status", folder), "an archive is a study")


def check_allowed_plan_edits():
    plan = folder / "plan.toml"
    text = plan.read_text()
    # What is to come may be changed, and that is kept; what was done may not.
    plan.write_text(text.replace("trials = 2", "trials = 1"))
    demand("was done and is another one now" in run_refused("--port", "0"), "an edited past is refused")
    plan.write_text(text.replace('welcome = "Hello."', 'welcome = "Welcome."'))
    run = StudyRun("--participant", "X2", "--enroll")
    run.screen(lambda s: s["session"] and "plan_changed" in s["session"]["steps"][0]["deviations"], "that the plan was changed is kept")
    run.wait_for_participant_screen("form")
    run.end()
    demand("real participants" in run_refused("--simulated"), "simulated and real people do not mix")
    demand("exists" in subprocess.run([proact, "study", "new", folder], capture_output=True, text=True).stderr, "no study is overwritten")

    # A clock that is set back: kept, and the order of events is that of their numbers.
    if shutil.which("faketime"):
        run = StudyRun(prefix=("faketime", "-f", "-2h"))
        screen = run.screen(lambda screen: screen["next"], "says who is next")
        run.ask("begin", id="X2")
        run.wait_for_participant_screen("form")
        run.end()
        out = work / "clock"
        run_program("study", "export", folder, "--out", out)
        kinds = [row["deviation"] for row in table("deviations", out)]
        demand("clock_set" in kinds, f"a clock that is set back is kept: {kinds}")
    else:
        print("skipped: a clock that is set back; it needs faketime")

    # A disk that takes no more: one sentence, and all that was told is there. The limit of a file's size is such a disk.
    other = work / "full"
    shutil.copytree(folder, other)
    for left in other.glob("study.sqlite.lock"):
        left.unlink()
    size = (other / "study.sqlite").stat().st_size

    def limit_file_size():
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + 8192, size + 8192))

    port = free_port()
    process = subprocess.Popen(
        [proact, "study", "run", other, "--no-browser", "--exact-port", "--port", str(port), "--print-events", "--participant", "X2"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=limit_file_size,
    )
    end = time.monotonic() + TIMEOUT_SECS
    while process.poll() is None and time.monotonic() < end:
        try:
            page = PageClient(port, "experimenter")
            for k in range(200):
                page.send(type="conduct", ask="note", text=f"note {k} " + 200 * "x")
                time.sleep(0.005)
        except (OSError, ConnectionError):
            time.sleep(0.1)
    out, error = process.communicate(timeout=TIMEOUT_SECS)
    numbers = [int(line.split()[1]) for line in out.splitlines() if line.startswith("event ")]
    sentence = [line for line in error.splitlines() if line.startswith("proact:")]
    demand(process.returncode != 0 and len(sentence) == 1, f"a full disk is told in one sentence: {error[-1500:]}")
    demand("study.sqlite" in sentence[0], f"and says where: {sentence}")
    rows = json.loads(run_program("study", "export", other, "--out", work / "full-tables", "--json"))["rows"]
    demand(rows["events"] >= max(numbers), f"{max(numbers)} events were acknowledged, {rows['events']} are there")


def armband():
    """Training with an armband, a simulated one that makes what is asked for, and what becomes of its model."""
    other = work / "armband"
    run_program("study", "new", other)
    steps = '{ do = "train", repetitions = 2, hold_secs = 2, consecutive_correct_runs = 1, minutes = 1 }'
    (other / "plan.toml").write_text(
        'name = "armband"\nparticipants = 2\n[trial]\nsetup = "still"\nlimit_secs = 2\nmethod = "D"\n'
        '[[conditions]]\nname = "D"\n[order]\nby = "listed"\n'
        f'[[sessions]]\nname = "1"\ntrials = 2\nbegin = [{steps}]\n'
    )
    run = StudyRun("--emg-source", "synthetic", "--participant", "Y1", "--enroll", study=other)
    run.participant.until("participant", lambda s: s["show"] == "train" and s["recording"], "gestures are recorded")
    run.participant.until("participant", lambda s: s["show"] == "train" and s["passed"], "the gestures are passed", TRAINING_SECS)
    run.ask("next")
    now = run.wait_for_step("trial", running=False)
    checks = {check["name"]: check for check in now["what"]["checks"]}
    demand(checks["gestures"]["ready"] and "recognised" in checks["gestures"]["found"], f"trained: {checks}")
    run.screen(lambda s: all(c["ready"] for c in s["session"]["now"]["what"]["checks"]), "the armband sends")
    run.ask("next")
    run.screen(lambda s: s["session"]["now"]["what"].get("number") == [2, 2], "the trial goes by itself")
    run.end(signal.SIGKILL)
    demand((other / "models" / "participant1-session1.json").exists(), "the model is in the study")
    demand(any((other / "models" / "participant1-session1.recordings").iterdir()), "and what it was trained on")
    run = StudyRun("--emg-source", "synthetic", "--participant", "Y1", study=other)
    now = run.wait_for_step("trial", running=False)
    checks = {check["name"]: check for check in now["what"]["checks"]}
    demand(checks["gestures"]["ready"] and checks["gestures"]["age_secs"] is not None, f"the training is remembered: {checks}")
    run.ask("retrain", reason="the band was moved")
    run.participant.until("participant", lambda s: s["show"] == "train" and s["recording"], "gestures are recorded again")
    run.participant.until("participant", lambda s: s["show"] == "train" and s["passed"], "and passed", TRAINING_SECS)
    run.ask("next")
    run.wait_for_step("trial", running=False)
    demand((other / "models" / "participant1-session1-2.json").exists(), "the second model is another file")
    run.screen(lambda s: all(c["ready"] for c in s["session"]["now"]["what"]["checks"]), "the armband sends")
    run.ask("next")
    run.screen(lambda s: s["session"] is None, "the session is over")
    run.ask("begin", id="Y2", new=True)
    run.wait_for_participant_screen("train")
    run.ask("skip", reason="a test")
    run.wait_for_step("trial", running=False)
    run.ask("start_anyway", reason="a test")
    run.wait_for_notice("a trial needs a model")
    run.end()
    shared = work / "armband-shared"
    run_program("study", "export", other, "--out", shared)
    for file in shared.glob("*.csv"):
        demand("Y1" not in file.read_text() and "Y2" not in file.read_text(), f"{file.name} has no pseudonym")


run_program("study", "new", folder)
(folder / "plan.toml").write_text(PLAN)
try:
    acknowledged = run_until_kill()
    print("ok  a session until the program was killed in a trial")
    acknowledged = resume_and_finish(acknowledged)
    print("ok  the session goes on and ends")
    check_exported_tables(acknowledged)
    print("ok  tables, records, archive")
    check_allowed_plan_edits()
    print("ok  second program, edited plan, set clock, full disk")
    armband()
    print("ok  an armband that is trained, remembered, trained again, and taken off")
    print("1 passed, 0 failed")
except CheckFailed as broken:
    print(f"broken: {broken}; what is left is in {work}", file=sys.stderr)
    print("0 passed, 1 failed")
    sys.exit(1)
finally:
    subprocess.run(["pkill", "-KILL", "-f", f"study run {work}"], check=False)
shutil.rmtree(work)
