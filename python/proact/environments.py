"""Gymnasium environments: a trial step by step, for each task, arm and level of action."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from . import _proact

_MISSING: ImportError | None = None
try:
    from gymnasium import spaces
    from gymnasium.core import Env
    from gymnasium.envs.registration import register as _register
    from gymnasium.envs.registration import registry
except ImportError as error:  # The rest of the package does without.
    Env = object  # type: ignore[assignment,misc]
    _MISSING = error

#: Environments and the tasks that they begin with.
TASKS = {
    "BoxAndBlocks-v0": "bbt",
    "BoxAndBlocksHeap-v0": "bbt_heap",
    "ModifiedBoxAndBlocks-v0": "modified_bbt",
    "TargetedBoxAndBlocks-v0": "targeted_bbt",
    "Clothespins-v0": "clothespins",
    "CupTransfer-v0": "cup_transfer",
    "FrameTransfer-v0": "frame_transfer",
    "PastaBox-v0": "pasta_box",
    "Reaching-v0": "reaching",
    "TargetAchievement-v0": "target_achievement",
}

#: Method that a level of action drives unless another is named.
_METHODS = {"gesture": "A", "selection": "D"}

#: Largest seed: what TOML holds.
_MAX_SEED = 2**63 - 1


def register() -> None:
    """Makes the environments known to Gymnasium, where there is one; done when ``proact`` is imported."""
    if _MISSING is not None:
        return
    for name, task in TASKS.items():
        identifier = f"proact/{name}"
        if identifier not in registry:
            _register(identifier, entry_point="proact.environments:ProactEnv", kwargs={"task": task})


class ProactEnv(Env):
    """A trial that an agent drives.

    One step holds one action for ``period_ms`` of simulated time. The observation is a vector of float64 whose numbers
    ``observation_names`` names. Parameters:

    task, arm, setup, profile
        Names, or a file or folder of a lab's own, as for ``proact demo``. ``setup`` is ``still`` unless named: a shoulder that
        stays in place.
    action
        ``gesture``: Discrete(5), the gestures of ``GESTURES`` for a method without gaze (A unless named).
        ``selection``: MultiDiscrete([looks, 5]), where the eye looks and the gesture, for a method with gaze (D unless named).
        ``joint_speed``: Box(-1, 1), one number an arm joint as a share of its highest speed, then the hand.
        ``end_effector_speed``: Box(-1, 1), linear (shares of 0.2 m/s) then angular (0.5 rad/s) speed of the grasp's centre along
        the axes of ``world``, then the hand. Above 1/3 the hand closes, below -1/3 it opens.
    observation
        ``display``: what a person sees, at 60 Hz. ``privileged``: the state of the physics besides.
    reward
        ``sparse``: what the task counted in this step. ``shaped``: besides, how much nearer hand and object, or joints, came (m, rad).
    method
        Control method of the levels ``gesture`` and ``selection``; the others take its place.
    emg
        None: gestures are given directly, as by keys. ``synthetic``, or a folder of recordings: they pass through an armband and a
        classifier, and can be misread.
    accept_faults
        Use recordings whose faults make an accuracy wrong all the same; the episode's configuration says which (``emg_accepted_faults``).
    gaze_error_deg
        Root mean square error of the eye tracker, degrees (``selection``).
    limit_secs
        When time is up; the task's own limit unless given.
    settings
        Other values of the configuration, such as ``["physics.engine=ode"]``.
    record
        A folder: each episode is recorded in ``episode-0``, ``episode-1``, ... of it, and can be replayed.

    ``terminated``: the task is done. ``truncated``: time is up. ``info`` has ``time_secs``, ``score`` and ``digest``; after the last step
    ``result`` too. ``events()``, ``frame()``, ``result()`` and ``config()`` tell more.

    ``reset(seed=...)`` decides every bit of what follows, with the actions. Without a seed the next one is drawn.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}
    GESTURES = ("hand_close", "hand_open", "no_motion", "wrist_extension", "wrist_flexion")

    def __init__(
        self,
        task: str = "modified_bbt",
        arm: str = "mpl_right",
        action: str = "joint_speed",
        observation: str = "display",
        reward: str = "shaped",
        method: str | None = None,
        setup: str = "still",
        profile: str | None = None,
        period_ms: int = 50,
        emg: str | None = None,
        gaze_error_deg: float = 1.5,
        limit_secs: float | None = None,
        settings: list[str] | tuple[str, ...] = (),
        record: str | Path | None = None,
        render_mode: str | None = None,
        render_size: tuple[int, int] = (320, 240),
        render_view: str = "head",
        accept_faults: bool = False,
    ):
        if _MISSING is not None:
            raise ImportError("the environments need gymnasium: pip install gymnasium") from _MISSING
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode is {render_mode!r}, expected None or 'rgb_array'")
        if render_view not in ("head", "overhead"):
            raise ValueError(f"render_view is {render_view!r}, expected 'head' or 'overhead'")
        self.render_mode = render_mode
        self._picture = (*render_size, render_view == "overhead")
        self.metadata = {**self.metadata, "render_fps": 1000 / max(period_ms, 1)}
        self._choice: dict[str, Any] = {
            "task": task,
            "arm": arm,
            "method": method or _METHODS.get(action),
            "setup": setup,
            "profile": profile,
            "limit_secs": limit_secs,
            "settings": list(settings),
        }
        self._how: dict[str, Any] = {
            "action": action,
            "observation": observation,
            "reward": reward,
            "period_ms": period_ms,
            "emg": emg,
            "gaze_error_deg": gaze_error_deg,
            "accept_faults": accept_faults,
        }
        self._record = None if record is None else Path(record)
        self._episodes = 0
        self._finished = False
        # The spaces are those of any seed.
        self._trial = trial = self._open(0, record=False)
        self.observation_names: list[str] = trial.observation_names
        self.action_choices: list[list[str]] | None = trial.action_choices
        self.action_names: list[str] | None = trial.action_names
        size = len(self.observation_names)
        self.observation_space = spaces.Box(-np.inf, np.inf, (size,), dtype=np.float64)  # type: ignore[arg-type]
        if self.action_choices is None:
            self.action_space = spaces.Box(-1.0, 1.0, (len(self.action_names or ()),), dtype=np.float64)  # type: ignore[arg-type]
        elif len(self.action_choices) == 1:
            self.action_space = spaces.Discrete(len(self.action_choices[0]))
        else:
            self.action_space = spaces.MultiDiscrete([len(names) for names in self.action_choices])

    def _open(self, seed: int, record: bool = True) -> _proact.AgentTrial:
        place = None
        if record and self._record is not None:
            self._record.mkdir(parents=True, exist_ok=True)
            place = self._record / f"episode-{self._episodes}"
            self._episodes += 1
        return _proact.AgentTrial({**self._choice, "seed": seed}, record=place, **self._how)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Begins another trial: (observation, info). ``options`` may hold ``settings``, further values for this trial."""
        super().reset(seed=seed)
        if seed is None:
            seed = int(self.np_random.integers(_MAX_SEED))
        unknown = set(options or {}) - {"settings"}
        if unknown:
            raise ValueError(f"options has {sorted(unknown)}, expected only 'settings'")
        if self._record is not None:
            self._trial.close()
        kept = self._choice["settings"]
        try:
            self._choice["settings"] = kept + list((options or {}).get("settings", ()))
            self._trial = self._open(seed)
        finally:
            self._choice["settings"] = kept
        observation = np.empty(len(self.observation_names))
        self._trial.observe(observation)
        return observation, self._info()

    def step(self, action):
        """Holds ``action`` for one period: (observation, reward, terminated, truncated, info)."""
        numbers = np.ascontiguousarray(action, dtype=np.float64).reshape(-1)
        observation = np.empty(len(self.observation_names))
        reward, terminated, truncated = self._trial.step(numbers, observation)
        info = self._info()
        if terminated or truncated:
            info["result"] = json.loads(self._trial.result())
        return observation, reward, terminated, truncated, info

    def _info(self) -> dict[str, Any]:
        trial = self._trial
        return {"time_secs": trial.time_secs, "score": trial.score, "digest": trial.digest}

    def render(self):
        """What a camera sees: uint8, shape (height, width, 3)."""
        if self.render_mode is None:
            return None
        width, height, overhead = self._picture
        return self._trial.picture(width, height, overhead).reshape(height, width, 3)

    def events(self) -> list[dict[str, Any]]:
        """What happened in the last step: dicts with ``time`` (ms), ``event`` and its own keys."""
        return json.loads(self._trial.events())

    def frame(self) -> dict[str, Any]:
        """The newest displayed instant, with all that a person sees."""
        return json.loads(self._trial.frame())

    def config(self) -> str:
        """The configuration of the trial, as ``config.toml`` of its record has it."""
        return self._trial.config()

    def result(self) -> dict[str, Any]:
        """The result as of now."""
        return json.loads(self._trial.result())

    def close(self):
        """Ends the trial and closes its record."""
        if self._record is not None:
            self._trial.close()
