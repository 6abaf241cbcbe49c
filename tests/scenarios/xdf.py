"""An exported trial as pyxdf reads it, the reader that MNE and others use.

    xdf.py PROACT

Needs pyxdf, which `./proact peers` installs; without it the test says so and counts as skipped (77).
"""

import json
import os
import subprocess
import sys
import tempfile

try:
    import pyxdf
except ImportError:
    print("skipped: pyxdf is not installed; ./proact peers installs it")
    sys.exit(77)

import numpy as np

SECONDS = 12


def main(proact):
    with tempfile.TemporaryDirectory() as place:
        trial, file = os.path.join(place, "trial"), os.path.join(place, "trial.xdf")
        subprocess.run([proact, "demo", "--headless", "--seed", "1", "--time-limit", str(SECONDS), "--out", trial], check=True,
                       capture_output=True)
        summary = json.loads(subprocess.run([proact, "export", trial, "--xdf", file, "--json"], check=True, capture_output=True).stdout)
        streams, header = pyxdf.load_xdf(file)
        with open(os.path.join(trial, "events.jsonl"), encoding="utf-8") as lines:
            events = [json.loads(line) for line in lines]
    assert header["info"]["version"] == ["1.0"], header
    found = {stream["info"]["name"][0]: stream for stream in streams}
    for said in summary["streams"]:
        stream = found.pop(said["name"])
        shape = (len(stream["time_stamps"]), int(stream["info"]["channel_count"][0]))
        assert shape == (said["samples"], said["channels"]), (said, shape)
        labels = [channel["label"][0] for channel in stream["info"]["desc"][0]["channels"][0]["channel"]]
        assert len(set(labels)) == said["channels"], labels
        times = stream["time_stamps"]
        assert np.all(np.diff(times) >= 0) and -0.1 < times[0] and times[-1] < SECONDS + 0.1, said
        rate = float(stream["info"]["nominal_srate"][0])
        if rate:
            assert abs(stream["info"]["effective_srate"] - rate) < 0.02 * rate, (said, stream["info"]["effective_srate"])
        if said["name"] == "Events":
            assert [json.loads(json_text) for _, json_text in stream["time_series"]] == events
            assert np.allclose(times, [event["time"] / 1000 for event in events])
        else:
            assert np.isfinite(stream["time_series"]).all(), said
        print(f"{said['name']:<10} {shape[0]:>6} samples of {shape[1]:>2} channels")
    assert not found, found.keys()
    print("ok  pyxdf reads what was exported")


main(sys.argv[1])
