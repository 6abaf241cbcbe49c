"""Computes tests/selection_vectors.json with LibEMG: the reference of the tests of src/selection.rs.

Run in an environment with libemg 2.0.3, its warnings and notices on standard error:
    python make_selection_vectors.py 3> selection_vectors.json
The windows are made here, from a fixed seed: three classes and four repetitions of five features of two channels. LibEMG's
active error compares a sum of two flags with the number of the relaxed class, which is right for class 2 alone, so that
it is class 2 here.
"""

import json
import os

import numpy as np
from libemg.feature_selector import FeatureSelector

rng = np.random.default_rng(20261127)
NAMES = ["MAV", "ZC", "SSC", "WL", "RMS"]
CHANNELS, CLASSES, REPETITIONS, WINDOWS = 2, 3, 4, 12
labels = np.repeat(np.tile(np.arange(CLASSES), REPETITIONS), WINDOWS)
repetitions = np.repeat(np.arange(REPETITIONS), CLASSES * WINDOWS)
data = {}
for f, name in enumerate(NAMES):
    centres = rng.normal(0, 1.2 - 0.15 * f, (CLASSES, CHANNELS))
    drift = rng.normal(0, 0.3, (REPETITIONS, CLASSES, CHANNELS))
    noise = rng.normal(0, 1, (len(labels), CHANNELS)) @ np.array([[1.0, 0.4], [0.0, 0.8]])
    data[name] = np.round(10 + 2 * f + centres[labels] + drift[repetitions, labels] + noise, 6)
order = {}
for ours, theirs in [
    ("accuracy", "accuracy"),
    ("active_error", "activeerror"),
    ("mean_semi_principal_axis", "meansemiprincipalaxis"),
    ("feature_efficiency", "featureefficiency"),
    ("repeatability", "repeatability"),
    ("separability", "separability"),
]:
    results, names = FeatureSelector().run_selection(data, theirs, labels, {"var": repetitions}, nm_class=2)
    values = results if results.ndim == 1 else np.diagonal(results)
    order[ours] = (names, [float(v) for v in values])
windows = np.hstack([data[name] for name in NAMES])
with os.fdopen(3, "w") as out:
    json.dump(
        {
            "features": ",".join(NAMES),
            "channels": CHANNELS,
            "windows": windows.tolist(),
            "labels": labels.tolist(),
            "repetitions": repetitions.tolist(),
            "order": order,
        },
        out,
    )
