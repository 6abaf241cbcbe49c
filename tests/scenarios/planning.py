#!/usr/bin/python3
"""Reads the report of `proact bench planning --json` and demands what must hold on any machine, however busy.

    proact bench planning --json | tests/scenarios/planning.py

1,000 problems; no path with a contact; 99.5 % of the reachable goals solved in the box and among 20 blocks; at least
five times quicker than a plain program with the original's settings. Exit code: 0 good, 1 not.
"""

import json
import sys

report = json.load(sys.stdin)
figures = {figure["name"]: figure for figure in report["figures"]}
for name, figure in figures.items():
    print(f"{name}: {figure['value']:.3f} {figure['unit']}  {figure['note']}")


def value(name):
    if name not in figures:
        sys.exit(f"FAILED: the report has no figure {name!r}")
    return figures[name]["value"]


failures = []
scenes = ["box", "20 blocks"]
if sum(value(f"{scene}: problems") for scene in scenes) < 1000:
    failures.append("fewer than 1,000 problems")
for scene in scenes:
    if value(f"{scene}: paths with a contact") > 0:
        failures.append(f"{scene}: a path touches something")
    solved = value(f"{scene}: reachable goals solved")
    if solved < 0.995:
        failures.append(f"{scene}: {solved:.4f} of the reachable goals solved, expected 0.995")
faster = value("beside plain LBKPIECE1 in steps of 0.005: times faster at the median")
if faster < 5:
    failures.append(f"{faster:.1f} times faster than the original's settings, expected 5")
if failures:
    sys.exit("FAILED: " + "; ".join(failures))
