"""Recorded trials as arrays and tables."""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Optional, Union

import numpy as np

from . import _proact
from .parts import GESTURES

if TYPE_CHECKING:
    import pandas

_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")


def load(record: Union[str, Path], *, rate_hz: float = 100.0, other_versions: bool = False) -> Recording:
    """The trial recorded in the folder ``record``, sampled ``rate_hz`` times a simulated second (1 to 1000).

    Its states are recomputed from its inputs, a hundred times as fast as they were, and checked against the recorded digests:
    ``agrees`` says whether all of them were the same. A record of another version of a library is refused, unless
    ``other_versions``; what is recomputed may then differ.

    Raises ValueError for a folder that is no record, or whose files have changed.
    """
    every_ms = 1000.0 / rate_hz if rate_hz > 0 else 0.0
    if not every_ms.is_integer() or not 1 <= every_ms <= 1000:
        raise ValueError(f"rate_hz is {rate_hz}, expected 1000 divided by a whole number from 1 to 1000")
    return Recording(Path(record), _proact.load(Path(record), int(every_ms), other_versions))


class Recording:
    """What a trial held. ``k`` samples in time, ``j`` moving joints (arm, then hand), ``m`` objects.

    Arrays: ``times`` (k,), s. ``position``, ``velocity``, ``effort``, ``target`` (k, j): rad, rad/s, N m, asked rad.
    ``base``, ``tip`` (k, 7): x, y, z (m), quaternion x, y, z, w, in ``world``. ``object_poses`` (k, m, 7), ``object_velocities``
    (k, m, 6): linear m/s, angular rad/s. ``gesture`` (k,): numbers of ``GESTURES``. ``score`` (k,). ``stopped`` (k,): bool.
    ``gaze_times``, ``gaze_origin``, ``gaze_direction``, ``gaze_valid``: of each measurement. ``emg_times``, ``emg_samples`` (s, channels),
    ``emg_counter`` (s,).
    Tables (pandas, index ``time_secs``): ``joints``, ``objects``, ``hand``, ``course``, ``gaze``, ``emg``, ``events``.
    ``result``: dict, None if the trial was interrupted. ``config``: TOML text. ``digest``: of the record. ``agrees``: the recomputed
    states have that digest; else ``divergence`` says where they part.
    """

    def __init__(self, record: Path, raw: dict[str, Any]):
        self.record = record
        self.joint_names: list[str] = raw["joints"]
        self.object_names: list[str] = raw["objects"]
        joints, objects = len(self.joint_names), len(self.object_names)
        states = raw["states"]
        self.times = states[:, 0] / 1000.0
        samples = len(self.times)
        self.position, self.velocity, self.effort, self.target = (
            states[:, 1 + part * joints : 1 + (part + 1) * joints] for part in range(4)
        )
        self.base, self.tip = raw["poses"][:, 1:8], raw["poses"][:, 8:15]
        bodies = raw["bodies"][:, 1:].reshape(samples, objects, 13)
        self.object_poses, self.object_velocities = bodies[:, :, :7], bodies[:, :, 7:]
        course = raw["course"]
        self.gesture, self.score = course[:, 1].astype(int), course[:, 2].astype(int)
        self.stopped = course[:, 3].astype(bool)
        gaze = raw["gaze"] if raw["gaze"].size else np.empty((0, 8))
        self.gaze_times, self.gaze_origin, self.gaze_direction = gaze[:, 0] / 1000.0, gaze[:, 1:4], gaze[:, 4:7]
        self.gaze_valid = gaze[:, 7].astype(bool)
        emg = raw["emg"] if raw["emg"].size else np.empty((0, 2))
        self.emg_times, self.emg_counter, self.emg_samples = emg[:, 0] / 1000.0, emg[:, 1].astype(int), emg[:, 2:]
        self.event_list: list[dict[str, Any]] = json.loads(raw["events"])
        self.result: Optional[dict[str, Any]] = json.loads(raw["result"])
        self.config: str = raw["config"]
        self.digest: str = raw["digest"]
        self.divergence: Optional[dict[str, Any]] = json.loads(raw["divergence"])
        self.agrees = self.divergence is None

    def __repr__(self) -> str:
        how = "agrees" if self.agrees else "differs"
        return f"<proact.Recording {self.record}: {len(self.times)} samples to {self.times[-1]:.3f} s, {how}>"

    @cached_property
    def joints(self) -> pandas.DataFrame:
        """Columns ``position``, ``velocity``, ``effort``, ``target``, each with one column a joint."""
        parts = {"position": self.position, "velocity": self.velocity, "effort": self.effort, "target": self.target}
        return _table(
            self.times, {(part, name): values[:, index] for part, values in parts.items() for index, name in enumerate(self.joint_names)}
        )

    @cached_property
    def objects(self) -> pandas.DataFrame:
        """For each object the columns x, y, z (m) and qx, qy, qz, qw."""
        return _table(
            self.times,
            {
                (name, part): self.object_poses[:, index, place]
                for index, name in enumerate(self.object_names)
                for place, part in enumerate(_POSE)
            },
        )

    @cached_property
    def hand(self) -> pandas.DataFrame:
        """Pose of the tip in ``world``: x, y, z (m) and qx, qy, qz, qw."""
        return _table(self.times, {part: self.tip[:, place] for place, part in enumerate(_POSE)})

    @cached_property
    def course(self) -> pandas.DataFrame:
        """``gesture`` by name, ``score``, ``stopped``."""
        names = np.array(GESTURES, dtype=object)[self.gesture]
        return _table(self.times, {"gesture": names, "score": self.score, "stopped": self.stopped})

    @cached_property
    def gaze(self) -> pandas.DataFrame:
        """Each measurement: origin (m) and direction in ``world``, and whether the eye was seen."""
        columns = {f"origin_{axis}": self.gaze_origin[:, place] for place, axis in enumerate("xyz")}
        columns.update({f"direction_{axis}": self.gaze_direction[:, place] for place, axis in enumerate("xyz")})
        return _table(self.gaze_times, {**columns, "valid": self.gaze_valid})

    @cached_property
    def emg(self) -> pandas.DataFrame:
        """Each sample: the device's ``counter`` and one column a channel."""
        channels = {f"channel_{index}": self.emg_samples[:, index] for index in range(self.emg_samples.shape[1])}
        return _table(self.emg_times, {"counter": self.emg_counter, **channels})

    @cached_property
    def events(self) -> pandas.DataFrame:
        """What happened: ``event`` and the keys of all events, None where one has no such key."""
        pandas = _pandas()
        table = pandas.DataFrame(self.event_list, columns=_keys(self.event_list)).astype(object)
        table.insert(0, "time_secs", [event["time"] / 1000.0 for event in self.event_list])
        return table.drop(columns="time").set_index("time_secs")


def _keys(events: list[dict[str, Any]]) -> list[str]:
    """``time``, ``event``, then all others as they come."""
    return list(dict.fromkeys(["time", "event", *(key for event in events for key in event)]))


def _pandas():
    try:
        import pandas
    except ImportError as error:
        raise ImportError("tables need pandas: pip install pandas") from error
    return pandas


def _table(times: np.ndarray, columns: dict[Any, np.ndarray]) -> pandas.DataFrame:
    pandas = _pandas()
    return pandas.DataFrame(columns, index=pandas.Index(times, name="time_secs"))


def load_table(folder: Union[str, Path], name: str) -> pandas.DataFrame:
    """The table ``name`` that ``proact simulate --out``, ``proact study export`` or ``proact analyze`` wrote into ``folder``."""
    path = Path(folder) / f"{name}.csv"
    if not path.is_file():
        there = sorted(table.stem for table in Path(folder).glob("*.csv"))
        raise ValueError(f"{folder} has no table {name!r}; it has {', '.join(there) or 'none'}")
    return _pandas().read_csv(path)
