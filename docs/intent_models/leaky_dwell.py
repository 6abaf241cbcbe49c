#!/usr/bin/python3
"""An example intent model in another process: looks add up while the eye rests on something, and fade within half a second.

    proact demo --intent-command "python3 docs/intent_models/leaky_dwell.py"

Each line of standard input is one gaze as a JSON object, each line of standard output answers one. Keep standard output
for answers; what you print for yourself goes to standard error.
"""
import json
import math
import sys

GAZE_SIGMA_RAD = 0.05  # of the gaze about what is meant, rad
FADE_MS = 500.0  # after this time a look counts for a third


def angle(origin, direction, point):
    """Between the gaze and the line to `point`, rad."""
    line = [p - o for p, o in zip(point, origin)]
    lengths = math.dist(point, origin) * math.hypot(*direction)
    cosine = sum(a * b for a, b in zip(line, direction)) / lengths
    return math.acos(max(-1.0, min(1.0, cosine)))


evidence, before, selection = [], 0, None
for line in sys.stdin:
    look = json.loads(line)
    gaze, time = look["gaze"], look["time"]
    if look["selection"] != selection:
        # Something was put down: what is meant next has nothing to do with what was meant before.
        evidence, selection = [0.0] * len(look["objects"]), look["selection"]
    kept = math.exp((before - time) / FADE_MS)
    before = time
    if not gaze["valid"]:
        # A blink tells nothing: what was known before stands.
        print(json.dumps({"time": time}), flush=True)
        continue
    for k, point in enumerate(look["objects"]):
        near = math.exp(-0.5 * (angle(gaze["origin"], gaze["direction"], point) / GAZE_SIGMA_RAD) ** 2)
        evidence[k] = kept * evidence[k] + (1.0 - kept) * near
    # Any scale will do, and what cannot be picked does not count.
    posterior = [prior * seen for prior, seen in zip(look["prior"], evidence)]
    print(json.dumps({"time": time, "posterior": posterior}), flush=True)
