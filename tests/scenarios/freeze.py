#!/usr/bin/python3
"""Freezes results before a redesign and compares them after each of its steps.

    tests/scenarios/freeze.py make PATH_OF_PROACT FOLDER
    tests/scenarios/freeze.py compare PATH_OF_PROACT FOLDER

Frozen are the JSON of twelve trials, all tables and numbers of a study of simulated participants and of each stored record, and
`proact reference`. Wall time, times of day, folder names and the chain value of a digest (it contains the text of the configuration) are left
out. The digests of the sixteen committed trials are compared by `cargo test -p proact-cli --test digests`, control's golden traces
by `cargo test -p proact-control --test golden`.
"""

import argparse
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

TRIALS = [(method, seed, more) for method in "ABCD" for seed, more in (
    (1, ["--setup", "still"]),
    (2, ["--setup", "seated", "--arm", "mpl_left"]),
    (3, ["--task", "bbt", "--setup", "still"]),
)]
# They differ from run to run, or contain the text of the configuration.
LEFT_OUT = {"wall_seconds", "real_time_factor", "digest", "trial_dir", "config_hash", "program", "commit"}

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("action", choices=["make", "compare"])
parser.add_argument("proact", type=pathlib.Path)
parser.add_argument("folder", type=pathlib.Path)
options = parser.parse_args()
proact = options.proact.resolve()
root = pathlib.Path(__file__).resolve().parents[2]
work = pathlib.Path(tempfile.mkdtemp(prefix="proact-freeze-"))


def answer(*words):
    run = subprocess.run([proact, *map(str, words)], capture_output=True, text=True)
    if run.returncode:
        sys.exit(f"{' '.join(map(str, words))} ended with {run.returncode}: {run.stderr.strip()}")
    return run.stdout


def stable(value):
    """A JSON value without what differs from run to run."""
    if isinstance(value, dict):
        return {key: stable(inner) for key, inner in value.items() if key not in LEFT_OUT}
    if isinstance(value, list):
        return [stable(inner) for inner in value]
    return value.replace(str(work), "WORK").replace(str(root), "ROOT") if isinstance(value, str) else value


def keep(results, name, text):
    # Times of day are not compared.
    text = re.sub(r"\d{4}-\d\d-\d\d(T[\d:.]+Z)?", "TIME", text)
    results[name] = text.replace(str(work), "WORK").replace(str(root), "ROOT")


def tables(results, name, folder):
    """Every table that an analysis or export left in a folder."""
    for path in sorted(folder.rglob("*.csv")):
        keep(results, f"{name}/{path.relative_to(folder)}", path.read_text())


def run():
    results = {}
    for number, (method, seed, more) in enumerate(TRIALS):
        out = work / f"trial{number}"
        trial = json.loads(answer("demo", "--headless", "--json", "--method", method, "--seed", seed, "--out", out, *more))
        keep(results, f"trials/{number}.json", json.dumps(stable(trial), indent=1, sort_keys=True))
        analysis = work / f"analysis{number}"
        answer("analyze", out, "--out", analysis, "--json")
        tables(results, f"trials/{number}", analysis)
    study = work / "study"
    answer("study", "new", study)
    answer("study", "run", study, "--simulated", "--json")
    answer("study", "export", study, "--json")
    tables(results, "study", study / "tables")
    answer("analyze", study, "--out", work / "study_analysis", "--json")
    tables(results, "study_analysis", work / "study_analysis")
    for record in sorted((root / "tests/records").iterdir()):
        # The one that was interrupted has no scores.
        if record.is_dir() and not record.name.endswith("_interrupted"):
            copy = work / "records" / record.name
            shutil.copytree(record, copy)
            analysis = work / "records" / f"{record.name}_analysis"
            answer("analyze", copy, "--out", analysis, "--json")
            tables(results, f"records/{record.name}", analysis)
    answer("reference", work / "reference")
    for path in sorted((work / "reference").rglob("*.md")):
        keep(results, f"reference/{path.name}", path.read_text())
    return results


results = run()
shutil.rmtree(work)
if options.action == "make":
    for name, text in results.items():
        path = options.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    print(f"{len(results)} files are frozen in {options.folder}")
    sys.exit(0)
frozen = {str(path.relative_to(options.folder)): path.read_text() for path in options.folder.rglob("*") if path.is_file()}
different = sorted(name for name in frozen.keys() | results.keys() if frozen.get(name) != results.get(name))
for name in different:
    old, new = frozen.get(name, "").splitlines(), results.get(name, "").splitlines()
    first = next((pair for pair in zip(old, new) if pair[0] != pair[1]), (f"{len(old)} lines", f"{len(new)} lines"))
    print(f"FAILED {name}:\n  frozen {first[0][:300]}\n  now    {first[1][:300]}")
print(f"{len(frozen.keys() | results.keys()) - len(different)} equal, {len(different)} different")
sys.exit(bool(different))
