#!/usr/bin/python3
"""An example classifier in another process: the nearest mean of standardised features. It needs nothing but Python.

    proact emg train --source ble --classifier process --decoder-process docs/decoders/nearest_centroid.toml --out p07.json

Each line of standard input is a JSON object, each line of standard output answers one. Keep standard output for answers;
what you print for yourself goes to standard error.
"""
import json
import math
import sys


def fit(windows, labels, gestures):
    """Mean and spread of each feature, and the mean of each gesture in standardised features."""
    columns = list(zip(*windows))
    mean = [sum(c) / len(c) for c in columns]
    spread = [math.sqrt(sum((x - m) ** 2 for x in c) / len(c)) or 1.0 for c, m in zip(columns, mean)]
    centroids = []
    for gesture in gestures:
        own = [standardized(w, mean, spread) for w, label in zip(windows, labels) if label == gesture]
        centroids.append([sum(c) / len(c) for c in zip(*own)])
    return {"mean": mean, "spread": spread, "centroids": centroids}


def standardized(window, mean, spread):
    return [(x - m) / s for x, m, s in zip(window, mean, spread)]


def posterior(state, window):
    """One probability for each gesture, in the order of the line `begin`: the nearer the mean, the larger."""
    here = standardized(window, state["mean"], state["spread"])
    away = [sum((x - c) ** 2 for x, c in zip(here, centroid)) for centroid in state["centroids"]]
    weights = [math.exp(0.5 * (min(away) - a)) for a in away]
    return [w / sum(weights) for w in weights]


gestures, state = [], None
for line in sys.stdin:
    asked = json.loads(line)
    answer = {"window": asked["window"]}
    if "begin" in asked:
        gestures, state = asked["begin"]["gestures"], asked["state"]
    elif "fit" in asked:
        state = fit(asked["fit"]["windows"], asked["fit"]["labels"], gestures)
        answer["state"] = state
    else:
        answer["posterior"] = posterior(state, asked["features"])
    print(json.dumps(answer), flush=True)
