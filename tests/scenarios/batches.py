#!/usr/bin/python3
"""Batches whose results are the same bytes whatever the jobs, the shards and the kills.

    tests/scenarios/batches.py PATH_OF_PROACT [--kills N]

Short trials, in which nobody gets anywhere: what is tested is what is kept of them. Exit code 0 only if all of it holds.
"""

import argparse
import json
import pathlib
import random
import signal
import subprocess
import tempfile
import time

WORDS = ["simulate", "--methods", "A,D", "--participants", "4", "--time-limit", "2"]
FILES = ["trials.jsonl", "trials.csv", "blocks.csv", "measures.csv", "objects.csv", "phases.csv", "faults.csv"]


def run(binary, *words, fails=False):
    done = subprocess.run([binary, *map(str, words)], capture_output=True, text=True, check=False)
    assert (done.returncode != 0) == fails, f"{words}: {done.stdout}{done.stderr}"
    return done.stderr if fails else done.stdout


def file_contents(folder):
    return {name: (folder / name).read_bytes() for name in FILES}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("binary", type=pathlib.Path)
    parser.add_argument("--kills", type=int, default=3)
    args = parser.parse_args()
    binary = args.binary.resolve()
    with tempfile.TemporaryDirectory() as place:
        place = pathlib.Path(place)
        whole = place / "whole"
        summary = json.loads(run(binary, *WORDS, "--jobs", 1, "--out", whole, "--json"))
        assert summary["merged"] and "no evidence about people" in summary["note"], summary
        expected = file_contents(whole)
        assert len(expected["trials.jsonl"].splitlines()) == 8

        run(binary, *WORDS, "--jobs", 2, "--out", place / "two")
        assert file_contents(place / "two") == expected, "two jobs"

        for number in (3, 1):
            summary = json.loads(run(binary, *WORDS, "--out", place / "shards", "--shard", f"{number}/3", "--json"))
            assert not summary["merged"], summary
        missing = run(binary, "simulate", "--merge", place / "shards", fails=True)
        assert "of shards 2/3" in missing, missing
        run(binary, *WORDS, "--out", place / "shards", "--shard", "2/3")
        assert file_contents(place / "shards") == expected, "three shards, the last of which merges"
        run(binary, "simulate", "--merge", place / "shards")
        assert file_contents(place / "shards") == expected, "merged once more"

        for words, reason in [
            (["--seed", 2], "other seed: 1, and this one has 2"),
            (["--set", "intent.gaze_sigma=0.1"], "other configuration"),
            (["--shard", "1/2"], "other number of shards: 1"),
        ]:
            refused = run(binary, *WORDS, "--out", whole, *words, fails=True)
            assert reason in refused, refused

        killed = place / "killed"
        log = killed / "shard-1-of-1.log"
        chance = random.Random(1)
        kills = 0
        while kills < args.kills:
            with (place / "killed.txt").open("ab") as error_log:
                words = [binary, *WORDS, "--jobs", "2", "--out", killed]
                program = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=error_log)
            time.sleep(chance.uniform(0.05, 0.3))
            if program.poll() is not None:
                break
            program.send_signal(signal.SIGKILL)
            program.wait()
            kills += 1
        # Its workers find nobody to answer, and end without a word.
        time.sleep(2)
        errors = (place / "killed.txt").read_text()
        assert "Broken pipe" not in errors, errors
        # Torn in the middle of its last line, if the kills did not do that.
        if log.exists() and log.stat().st_size > 100:
            log.write_bytes(log.read_bytes()[:-50])
        run(binary, *WORDS, "--jobs", 2, "--out", killed)
        assert file_contents(killed) == expected, f"{kills} kills"
        print(f"batches: 8 trials are the same bytes with 1 and 2 jobs, in 3 shards, and after {kills} kills and a torn line")


if __name__ == "__main__":
    main()
