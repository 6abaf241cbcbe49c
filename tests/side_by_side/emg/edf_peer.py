"""What pyedflib and MNE read in an EDF+ file, as one JSON object.

edf_peer.py FILE: of each program the rate, the channels with their unit or type, the samples of the first channel in
microvolts and the annotations, onset and duration in seconds.
"""

import json
import sys

import mne
import pyedflib


def by_pyedflib(path):
    with pyedflib.EdfReader(path) as file:
        signals = range(file.signals_in_file)
        onsets, durations, texts = file.readAnnotations()
        return {
            "rate_hz": file.getSampleFrequency(0),
            "channels": [file.getLabel(k) for k in signals],
            "units": [file.getPhysicalDimension(k) for k in signals],
            "microvolts": file.readSignal(0).tolist(),
            "annotations": [[float(o), float(d), t] for o, d, t in zip(onsets, durations, texts)],
        }


def by_mne(path):
    raw = mne.io.read_raw_edf(path, infer_types=True, preload=True, verbose="error")
    kept = raw.get_data(picks=[0], reject_by_annotation="omit", verbose="error")
    return {
        "rate_hz": raw.info["sfreq"],
        "channels": raw.ch_names,
        "types": raw.get_channel_types(),
        "microvolts": (1e6 * raw.get_data(picks=[0])[0]).tolist(),
        "kept": int(kept.shape[1]),
        "annotations": [[float(a["onset"]), float(a["duration"]), str(a["description"])] for a in raw.annotations],
    }


print(json.dumps({"pyedflib": by_pyedflib(sys.argv[1]), "mne": by_mne(sys.argv[1])}))
