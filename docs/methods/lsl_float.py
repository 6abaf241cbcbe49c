#!/usr/bin/python3
"""A method that one number drives: the newest value of a stream of the lab streaming layer, -1 to 1, is the share of its
highest speed at which one joint moves, as ArmSym's mode for laboratories of decoders.

    proact serve --method docs/methods/lsl_float.toml

The words behind the file in the .toml are the stream's name, the place of the joint among the arm's joints from 0, and its speed
in rad/s. HC and HO of whatever makes gestures work the hand. Needs pylsl. A value that is not finite, and a stream that says
nothing for 0.2 s, stop the arm.
"""
import json
import math
import sys
import time

import pylsl

NAME, JOINT, SPEED = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
STALE_SECS = 0.2

inlet, value, received_at = None, 0.0, -math.inf
finder = pylsl.ContinuousResolver(prop="name", value=NAME)


def latest_value():
    """The newest value of the stream, 0 where there is none in time."""
    global inlet, value, received_at
    if inlet is None:
        found = finder.results()
        if not found:
            return 0.0
        inlet = pylsl.StreamInlet(found[0], max_buflen=1, recover=True)
        inlet.open_stream(timeout=1.0)
        print(f"lsl_float: {found[0].name()} on {found[0].hostname()}", file=sys.stderr)
    samples, _ = inlet.pull_chunk(timeout=0.0)
    if samples:
        received_at = time.monotonic()
        value = float(samples[-1][0])
    alive = time.monotonic() - received_at < STALE_SECS and math.isfinite(value)
    return max(-1.0, min(1.0, value)) if alive else 0.0


last = None
for line in sys.stdin:
    step = json.loads(line)
    share = latest_value()
    answer = {"time": step["time"]}
    if share:
        speeds = [0.0] * len(step["commanded"])
        speeds[JOINT] = share * SPEED
        answer["motion"] = {"velocity": speeds}
    else:
        answer["motion"] = "hold"
    gesture, changed, last = step["gesture"], step["gesture"] != last, step["gesture"]
    if changed and gesture in ("hand_close", "hand_open"):
        answer["hand"] = "close" if gesture == "hand_close" else "open"
    print(json.dumps(answer), flush=True)
