"""Whole trials, with methods, intent models, participants and classifiers in Python, and their replay."""

from __future__ import annotations

import json
import statistics
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Callable, Optional, Union

import numpy as np

from . import _proact
from ._worker import Worker
from .parts import ControlMethod, IntentModel, Participant, classifier_function


def run_trial(
    method: Union[str, ControlMethod, None] = None,
    *,
    task: Optional[str] = None,
    arm: Optional[str] = None,
    setup: str = "seated",
    profile: Optional[str] = None,
    seed: int = 1,
    limit_secs: Optional[float] = None,
    settings: Iterable[str] = (),
    participant: Optional[Participant] = None,
    classifier: Any = None,
    intent: Optional[IntentModel] = None,
    emg: Optional[str] = "synthetic",
    gaze_error_deg: float = 1.5,
    answer_timeout_secs: float = 10.0,
    record: Union[str, Path, None] = None,
    accept_faults: bool = False,
    **renamed: Any,
) -> dict[str, Any]:
    """Runs a trial to its end, as fast as the machine allows: the result, as ``proact demo --headless --json`` has it.

    method: a name (``A`` to ``D``), the file of an outside one, or a ``ControlMethod``. ``D`` unless given.
    participant: a ``Participant``; the simulated one unless given. classifier: a ``Classifier``, or anything with ``fit`` and
    ``predict_proba``: it is trained on the trial's EMG first. intent: an ``IntentModel`` in the place of the configuration's; those
    that ship are chosen by ``settings``, such as ``intent_model=filtered``. emg: ``synthetic``, a folder of recordings, or None:
    gestures of a ``participant`` are then taken directly. gaze_error_deg: error of the eye tracker of a ``participant``, degrees.
    answer_timeout_secs: a Python part that takes longer on the clock has not answered: the arm holds. Its old name ``patience_secs``
    is still taken, with a DeprecationWarning.
    record: a folder for the record; none is made unless given. ``replay`` needs no Python. accept_faults: use recordings whose faults
    make an accuracy wrong all the same, as ``--accept-faults`` of the commands; they are refused unless given.

    Beside the keys of a result: ``faults``, what went wrong in Python, each once; ``reasons``, why the arm held, as displayed;
    ``findings``, what is wrong with the recordings, each with its ``text``; ``accepted_faults``, those that make an accuracy wrong and
    were accepted, which are in the record's configuration too (``emg_accepted_faults``).

    Deterministic for ``seed`` as far as the Python parts are. Raises ValueError for what cannot be, in the testbed's words.
    """
    answer_timeout_secs = _renamed_timeout(renamed, answer_timeout_secs)
    workers: list[Worker] = []

    def worker(function: Callable[[str], str]) -> Worker:
        workers.append(Worker(function))
        return workers[-1]

    choice = _trial_keywords(method if isinstance(method, str) else None, task, arm, setup, profile, seed, limit_secs, settings)
    python: dict[str, Any] = {
        "method_info": None,
        "method": None,
        "participant": None,
        "classifier": None,
        "model": None,
        "intent": None,
        "timeout_secs": float(answer_timeout_secs),
    }
    if isinstance(method, ControlMethod):
        method.begin()
        python["method_info"] = method._info()
        python["method"] = worker(method._ask)
    elif not (method is None or isinstance(method, str)):
        raise TypeError(f"method is a {type(method).__name__}, expected a name or a proact.ControlMethod")
    if participant is not None:
        participant.begin()
        python["participant"] = worker(participant._ask)
    if intent is not None:
        if not isinstance(intent, IntentModel):
            raise TypeError(f"intent is a {type(intent).__name__}, expected a proact.IntentModel")
        intent.begin()
        python["intent"] = worker(intent._ask)
    if classifier is not None:
        if emg is None:
            raise ValueError("a classifier needs EMG: give emg='synthetic' or a folder of recordings")
        features, labels = training_windows(emg, seed=seed, accept_faults=accept_faults)
        classifier.fit(features, labels)
        gestures = sorted(set(labels.tolist()))
        python["classifier"] = worker(classifier_function(classifier, gestures))
        python["model"] = _proact.external_model(emg, seed, accept_faults=accept_faults)
    place = None if record is None else Path(record)
    try:
        result = _proact.run_trial(choice, python, emg=emg, gaze_error_deg=gaze_error_deg, record=place, accept_faults=accept_faults)
        return json.loads(result)
    finally:
        for one in workers:
            one.close()


def _renamed_timeout(renamed: dict[str, Any], answer_timeout_secs: float) -> float:
    """The timeout by its present or its old keyword."""
    if unknown := renamed.keys() - {"patience_secs"}:
        raise TypeError(f"run_trial() got an unexpected keyword argument {sorted(unknown)[0]!r}")
    if not renamed:
        return answer_timeout_secs
    warnings.warn("patience_secs is now called answer_timeout_secs", DeprecationWarning, stacklevel=3)
    return renamed["patience_secs"]


def _trial_keywords(method, task, arm, setup, profile, seed, limit_secs, settings) -> dict[str, Any]:
    return {
        "task": task,
        "arm": arm,
        "method": method,
        "setup": setup,
        "profile": profile,
        "seed": int(seed),
        "limit_secs": limit_secs,
        "settings": list(settings),
    }


def compare(
    methods: Iterable[Union[str, ControlMethod]],
    seeds: Iterable[int] = range(1, 6),
    **how: Any,
) -> dict[str, dict[str, Any]]:
    """Each method in one trial a seed, with the same seeds for all: a summary a method, in their order.

    how: as ``run_trial``. Each summary has ``mean``, ``sd`` (None for one trial), ``min``, ``max``, ``median``, ``trials`` of the score,
    ``score_name``, and ``results``, the results of its trials. Trials that failed (``ended`` is ``"failed"``) have no score: they are
    counted in ``failed``, with the first reason in ``failure``; without a score left, ``mean`` to ``median`` are None. Trials of
    simulated participants are no evidence about people.
    """
    seeds = list(seeds)
    summaries = {}
    for method in methods:
        results = [run_trial(method, seed=seed, **how) for seed in seeds]
        scores = [result["score"] for result in results if result["ended"] != "failed"]
        failures = [
            fault["reason"]
            for result in results
            for fault in result.get("trial_faults", [])
            if result["ended"] == "failed" and fault["kind"] == "external_part"
        ]
        name = results[0]["method"]
        if name in summaries:
            raise ValueError(f"two methods are called {name!r}: give one of them another name")
        summaries[name] = {
            "mean": statistics.mean(scores) if scores else None,
            "sd": statistics.stdev(scores) if len(scores) > 1 else None,
            "min": min(scores, default=None),
            "max": max(scores, default=None),
            "median": statistics.median(scores) if scores else None,
            "trials": len(scores),
            "failed": len(results) - len(scores),
            "failure": failures[0] if failures else None,
            "score_name": results[0]["score_name"],
            "results": results,
        }
    return summaries


def replay(record: Union[str, Path]) -> dict[str, Any]:
    """Recomputes a recorded trial: ``agrees``, ``digest``, ``recorded`` (the record's digest), ``finished``, ``seconds``, and
    ``divergence`` where the two part. Python parts are not needed: what they answered is in the record."""
    return json.loads(_proact.replay(Path(record)))


def training_windows(emg: str = "synthetic", *, seed: int = 1, accept_faults: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """What a classifier of a trial with this EMG and seed is trained on: features, shape (windows, f), and the names of the
    gestures, shape (windows,). Raises ValueError for recordings whose faults make an accuracy wrong, unless accept_faults is given."""
    features, labels = _proact.training_windows(emg, int(seed), accept_faults=accept_faults)
    return features, np.array(labels)
