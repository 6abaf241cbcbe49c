"""Computes tests/filter_vectors.json with SciPy: the reference of the tests of src/filter.rs.

Run in an environment with scipy 1.17.1 and numpy:
    python make_filter_vectors.py > filter_vectors.json
Noise with a level, from a fixed seed; the filters begin settled on its first sample.
"""

import json

import numpy as np
from scipy import signal

rng = np.random.default_rng(20261126)
CASES = [
    ("lowpass:150", 1000, ("lowpass", 150, 4)),
    ("lowpass:30:3", 200, ("lowpass", 30, 3)),
    ("highpass:20:2", 200, ("highpass", 20, 2)),
    ("highpass:20:5", 2000, ("highpass", 20, 5)),
    ("bandpass:20-450", 1000, ("bandpass", [20, 450], 4)),
    ("bandpass:20-450:1", 2148, ("bandpass", [20, 450], 1)),
    ("bandpass:5-400:3", 1000, ("bandpass", [5, 400], 3)),
    ("bandstop:45-55:2", 1000, ("bandstop", [45, 55], 2)),
    ("bandstop:90-130:3", 1000, ("bandstop", [90, 130], 3)),
    ("notch:50", 1000, ("notch", 50, 3)),
    ("notch:60:5", 200, ("notch", 60, 5)),
]
out = []
for text, rate, (kind, hz, number) in CASES:
    values = np.round(rng.normal(3, 20, 120), 6)
    if kind == "notch":
        sections = signal.tf2sos(*signal.iirnotch(hz, hz / number, fs=rate))
    else:
        sections = signal.butter(number, hz, kind, fs=rate, output="sos")
    filtered, _ = signal.sosfilt(sections, values, zi=signal.sosfilt_zi(sections) * values[0])
    out.append({"filter": text, "rate_hz": rate, "input": values.tolist(), "output": filtered.tolist()})
print(json.dumps(out))
