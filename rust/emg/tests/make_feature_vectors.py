"""Computes tests/feature_vectors.json with LibEMG: the reference of tests/feature_parity.rs.

Run in an environment with libemg 2.0.3 (or its feature_extractor.py on the path as libemg) and numpy 1.26:
    python make_feature_vectors.py > feature_vectors.json
The signals are made here, from a fixed seed, so the file depends on nothing else. COMP is computed for one window at
a time, since LibEMG's value depends on how many windows are passed. JSON has no NaN: they are written as null.
"""

import json
import math
import warnings

import numpy as np
from libemg.feature_extractor import FeatureExtractor

OF_RATE = ("MDF", "MNF", "SM", "DFTR", "WENG", "WV", "WWL", "WENT")
NAMES = (
    "MAV ZC SSC WL LS MFL MSR WAMP RMS IAV DASDV VAR M0 M2 M4 SPARSI IRF WLF AR MDF MNF SKEW KURT ACT MOB COMP "
    "CC LD MAVFD MAVSLP MNP MPK RMSPHASOR PAP WLPHASOR MZP TM SM SAMPEN FUZZYEN DFTR ISD COR MDIFF MLK WENG WV WWL "
    "WENT MEAN"
).split()

rng = np.random.default_rng(20260701)


def coloured(length, volts):
    """Three channels of noise of different colour and strength."""
    noise = rng.standard_normal((3, length + 20))
    noise[1] = np.convolve(noise[1], np.ones(5) / 5, "same")
    noise[2] = np.diff(noise[2], prepend=0.0) * 3
    return np.round(noise[:, 20:] * volts * np.array([[1.0], [2.5], [0.4]]), 9)


t = np.arange(100)
CASES = {
    "noise in volts, 100 samples": coloured(100, 1e-4 * 30),
    "noise in counts, 100 samples": np.round(coloured(100, 20.0)),
    "noise with an offset, 64 samples": coloured(64, 8.0) + 100.0,
    "noise, 37 samples": coloured(37, 5.0),
    "sine, chirp and square": np.round(
        np.stack([np.sin(0.3 * t), np.sin(0.002 * t * t), np.sign(np.sin(0.1 * t + 0.05))]), 9
    ),
    "zero, constant and ramp": np.stack([np.zeros(100), np.full(100, 3.0), 0.25 * t]),
    "noise at 200 Hz, 20 samples": coloured(20, 30.0),
    "noise at 2048 Hz, 41 samples": coloured(41, 30.0),
}


def rate_of(name):
    return next((int(word) for word, unit in zip(name.split(), name.split()[1:]) if unit.startswith("Hz")), 1000)


def finite(value):
    value = float(value)
    return value if math.isfinite(value) else None


extractor = FeatureExtractor()
out = []
warnings.simplefilter("ignore")
for name, signal in CASES.items():
    rate_hz = rate_of(name)
    window = signal[np.newaxis]
    features = {}
    for feature in NAMES:
        # Only those of this feature: LibEMG hands WWL_fs to WL too, whose name it contains.
        parameters = {f"{feature}_fs": rate_hz} if feature in OF_RATE else {}
        try:
            values = extractor.extract_features([feature], window, parameters)[feature][0]
        except IndexError:
            # The median frequency of a zero channel.
            values = np.concatenate(
                [
                    extractor.extract_features([feature], window[:, [c]], parameters)[feature][0]
                    if signal[c].any()
                    else [math.nan]
                    for c in range(len(signal))
                ]
            )
        features["AR4" if feature == "AR" else feature] = [finite(v) for v in values]
    out.append({"name": name, "rate_hz": rate_hz, "channels": signal.tolist(), "features": features})
print(json.dumps(out))
