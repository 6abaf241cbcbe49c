"""The native part: numbers and JSON text. What it has is public in `proact` under friendlier names."""

from os import PathLike
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import NDArray

__version__: str

class AgentTrial:
    """A trial that a program drives. It stays in the thread that made it."""

    def __init__(
        self,
        choice: dict[str, Any],
        *,
        action: str,
        observation: str,
        reward: str,
        period_ms: int,
        emg: Optional[str] = None,
        gaze_error_deg: float = 1.5,
        record: Union[str, PathLike[str], None] = None,
        accept_faults: bool = False,
    ) -> None: ...
    def step(self, action: NDArray[np.float64], out: NDArray[np.float64]) -> tuple[float, bool, bool]:
        """Holds ``action`` for one period and writes the observation, shape (len(observation_names),), into ``out``: reward,
        terminated, truncated."""
    def observe(self, out: NDArray[np.float64]) -> None:
        """Writes the observation, shape (len(observation_names),), into ``out``."""
    @property
    def observation_names(self) -> list[str]: ...
    @property
    def action_choices(self) -> Optional[list[list[str]]]: ...
    @property
    def action_names(self) -> Optional[list[str]]: ...
    @property
    def digest(self) -> str: ...
    @property
    def time_secs(self) -> float: ...
    @property
    def step_secs(self) -> float:
        """Processor time of the last step and its observation within the testbed, s."""
    @property
    def score(self) -> int: ...
    def events(self) -> str: ...
    def frame(self) -> str: ...
    def result(self) -> str: ...
    def config(self) -> str: ...
    def close(self) -> str: ...
    def picture(self, width: int, height: int, overhead: bool) -> NDArray[np.uint8]:
        """Shape (3 * width * height,), rows from the top."""

class ArmQuery:
    """An arm that answers the questions of ``proact query``. It stays in the thread that made it."""

    def __init__(self, name: str) -> None: ...
    def ask(self, question: str) -> str: ...
    @property
    def joints(self) -> list[str]: ...
    @property
    def hand_joints(self) -> list[str]: ...
    @property
    def limits(self) -> list[tuple[float, float, float, float]]:
        """Of each joint: lower and upper angle (rad), velocity (rad/s), effort (N m)."""
    @property
    def ends(self) -> tuple[str, str]: ...

def run_trial(
    choice: dict[str, Any],
    python: dict[str, Any],
    *,
    emg: Optional[str] = None,
    gaze_error_deg: float = 1.5,
    record: Union[str, PathLike[str], None] = None,
    accept_faults: bool = False,
) -> str: ...
def replay(dir: Union[str, PathLike[str]]) -> str: ...
def load(dir: Union[str, PathLike[str]], every_ms: int, other_versions: bool) -> dict[str, Any]: ...
def training_windows(emg: str, seed: int, *, accept_faults: bool = False) -> tuple[NDArray[np.float64], list[str]]:
    """Features, shape (windows, f), and the gesture of each window."""

def external_model(emg: str, seed: int, *, accept_faults: bool = False) -> str: ...
