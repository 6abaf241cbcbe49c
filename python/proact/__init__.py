"""ProACT from Python: environments, trials, recordings, kinematics.

Units are SI and radians, quaternions are (x, y, z, w), twists and Jacobians have their linear rows first, and time is simulated
time unless a name says otherwise. The frame ``world`` has x away from the person, y left, z up.
"""

from ._proact import __version__
from .arms import Arm, Plan
from .environments import TASKS, ProactEnv, register
from .parts import GESTURES, Classifier, Command, ControlMethod, Intention, IntentModel, Look, Participant, Seen
from .recordings import Recording, load, load_table
from .trials import compare, replay, run_trial, training_windows

register()

__all__ = [
    "Arm",
    "Classifier",
    "Command",
    "ControlMethod",
    "GESTURES",
    "IntentModel",
    "Intention",
    "Look",
    "Participant",
    "Plan",
    "ProactEnv",
    "Recording",
    "Seen",
    "TASKS",
    "__version__",
    "compare",
    "load",
    "load_table",
    "register",
    "replay",
    "run_trial",
    "training_windows",
]
