"""The lab streaming layer as pylsl speaks it, with the newest liblsl in its wheel, for tests of our own streams.

lsl_peer.py send NAME: 8 channels at 1 kHz, channel c of sample k is (k + c) modulo 1000. Sample 3000 and the four after
it are missing. Stamps are those of an even sample clock.

lsl_peer.py receive NAME COUNT: reads samples of NAME and decisions of NAME-decisions and prints one JSON object.
"""

import json
import sys
import time

import pylsl


def send(name):
    about = pylsl.StreamInfo(name, "EMG", 8, 1000.0, pylsl.cf_int16, name)
    outlet = pylsl.StreamOutlet(about)
    if not outlet.wait_for_consumers(30):
        sys.exit("nobody reads " + name)
    begin = pylsl.local_clock()
    for k in range(6000):
        time.sleep(max(0.0, begin + k / 1000 - pylsl.local_clock()))
        if not 3000 <= k < 3005:
            outlet.push_sample([(k + c) % 1000 for c in range(8)], begin + k / 1000)
    # What was pushed last still has to leave.
    time.sleep(1.0)


def open_stream(name):
    found = pylsl.resolve_byprop("name", name, timeout=10)
    if not found:
        sys.exit("there is no stream " + name)
    inlet = pylsl.StreamInlet(found[0])
    inlet.open_stream(10)
    return inlet


def receive(name, count):
    samples, decisions = open_stream(name), open_stream(name + "-decisions")
    about = samples.info()
    stamps, widths, gestures = [], set(), []
    while len(stamps) < count:
        sample, stamp = samples.pull_sample(timeout=10)
        if sample is None:
            sys.exit("the samples of " + name + " have ended")
        stamps.append(stamp)
        widths.add(len(sample))
        gesture, at = decisions.pull_sample(timeout=0.0)
        if gesture is not None:
            gestures.append((gesture[0], at))
    steps = [b - a for a, b in zip(stamps, stamps[1:])]
    print(json.dumps({
        "type": about.type(), "rate_hz": about.nominal_srate(), "channels": about.channel_count(),
        "labels": about.get_channel_labels(), "widths": sorted(widths), "first": stamps[0], "last": stamps[-1],
        "least_step": min(steps), "most_step": max(steps), "gestures": gestures,
    }))


if sys.argv[1] == "send":
    send(sys.argv[2])
else:
    receive(sys.argv[2], int(sys.argv[3]))
