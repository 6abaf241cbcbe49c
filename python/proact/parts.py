"""Control methods, intent models, participants and classifiers written in Python: what a trial shows them, and what they may
answer."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Optional

import numpy as np

#: The five commands, in the order of their numbers.
GESTURES = ("hand_close", "hand_open", "no_motion", "wrist_extension", "wrist_flexion")


def pose_matrix(pose: dict) -> np.ndarray:
    """The (4, 4) matrix of a pose given as ``{"rotation": [x, y, z, w], "translation": [x, y, z]}``."""
    x, y, z, w = pose["rotation"]
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = pose["translation"]
    return matrix


def check_array(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    """``values`` as float64 of this shape, all finite.

    Raises ValueError that says what was got and what was expected.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} is {values!r}, expected numbers of shape {shape}") from error
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} is {array.tolist()}, expected finite numbers")
    return array


class Seen:
    """What a method sees at one control step, 100 times a second. ``n`` joints of the arm, ``m`` objects.

    ``time_ms``: int. ``gesture``: one of ``GESTURES``, in force. ``message``: the gesture that was decided in this tick, or None.
    ``effort``: 0 to 1. ``drives``: shape (d,), of a regressor; empty without one.
    ``measured``, ``commanded``: shape (n,), rad. ``highlight``: index of the object that is most likely meant, or None.
    ``objects``: shape (m, 3), centres in ``world``, m. ``posterior``: shape (m,), or (0,) without inference.
    ``place``: shape (3,), where the gaze would put something down, ``world``, m. ``hand``: ``open``, ``closing``, ``closed`` or
    ``opening``; ``holds``: index of the object in it, or None.
    ``world_from_base``, ``base_from_tip``: shape (4, 4). ``jacobian``: shape (6, n), linear rows first, axes of the base.
    ``plan``: the plan that takes effect now, a dict with ``status`` and ``trajectory``, or None. ``motion``: ``holding``,
    ``finished`` or ``{"following": share}``. ``joint_position``, ``joint_velocity``, ``joint_effort``: arm then hand joints, rad,
    rad/s, N m. ``digit_forces``: N. ``limb``: shape (n,), rad, or None. ``targets``: dicts with ``object``, ``centre``, ``radius``.
    ``raw``: all of it as it came.
    """

    def __init__(self, raw: dict[str, Any]):
        def array(value: Any) -> np.ndarray:
            return np.array(value, dtype=np.float64)

        self.raw = raw
        self.time_ms: int = raw["time"]
        self.gesture: str = raw["gesture"]
        self.message: Optional[str] = raw["message"]
        self.effort: float = raw["effort"]
        self.drives = array(raw.get("drives", []))
        self.measured = array(raw["measured"])
        self.commanded = array(raw["commanded"])
        self.highlight: Optional[int] = raw["highlight"]
        self.objects = array(raw["objects"]).reshape(-1, 3)
        self.posterior = array(raw["posterior"])
        self.place = array(raw["place"])
        self.hand: str = raw["hand"]["state"]
        self.holds: Optional[int] = raw["hand"]["holds"]
        self.world_from_base = pose_matrix(raw["world_from_base"])
        tip = raw["base_from_tip"]
        self.base_from_tip = np.full((4, 4), np.nan) if tip is None else pose_matrix(tip)
        jacobian = raw["jacobian"]
        self.jacobian = np.full((6, self.measured.size), np.nan) if jacobian is None else array(jacobian)
        self.plan: Optional[dict] = raw["plan"]
        self.motion = raw["motion"]
        felt = raw["felt"]
        self.joint_position = array(felt["position"])
        self.joint_velocity = array(felt["velocity"])
        self.joint_effort = array(felt["effort"])
        self.digit_forces = array(felt["digit_forces"])
        self.limb = None if raw["limb"] is None else array(raw["limb"])
        self.targets: list[dict] = raw["targets"]


@dataclass
class Command:
    """What a method asks for in one step. Nothing set leaves all as it is; a method that moves says so at every step.

    velocity, goto: shape (n,), rad/s or rad, for the arm's joints; ``hold`` stops them. At most one of the three.
    hand: ``open`` or ``close``. fingers: shape (k,), rad, one number a joint of the hand.
    plan: ``{"goal": "pick", "object": i, "centre": [x, y, z]}``, ``{"goal": "place", "point": [x, y, z]}`` or
    ``{"goal": "joints", "q": [...]}``; ``cancel_plan`` gives up the plan in the making. ``follow``: a trajectory, as plans bring it.
    note: what happened, for the record, at most 400 bytes. target: what is shown of a selection, a dict with ``object``, ``place``,
    ``locked``, ``posterior``.
    """

    velocity: Optional[Sequence[float]] = None
    goto: Optional[Sequence[float]] = None
    hold: bool = False
    follow: Optional[dict] = None
    hand: Optional[str] = None
    fingers: Optional[Sequence[float]] = None
    plan: Optional[dict] = None
    cancel_plan: bool = False
    note: Optional[str] = None
    target: Optional[dict] = None

    def line(self, seen: Seen) -> str:
        """The JSON line of it, checked against what the method saw."""
        joints = (seen.measured.size,)
        motions: list[Any] = []
        if self.velocity is not None:
            motions.append({"velocity": check_array("velocity", self.velocity, joints).tolist()})
        if self.goto is not None:
            motions.append({"goto": check_array("goto", self.goto, joints).tolist()})
        if self.follow is not None:
            motions.append({"follow": self.follow})
        if self.hold:
            motions.append("hold")
        if len(motions) > 1:
            raise ValueError("more than one of velocity, goto, follow and hold is set, expected at most one")
        line: dict[str, Any] = {"time": seen.time_ms}
        if motions:
            line["motion"] = motions[0]
        if self.hand is not None:
            if self.hand not in ("open", "close"):
                raise ValueError(f"hand is {self.hand!r}, expected 'open' or 'close'")
            line["hand"] = self.hand
        if self.fingers is not None:
            fingers = (seen.joint_position.size - seen.measured.size,)
            line["fingers"] = {"goto": check_array("fingers", self.fingers, fingers).tolist()}
        if self.plan is not None:
            line["plan"] = {"request": self.plan}
        elif self.cancel_plan:
            line["plan"] = "cancel"
        if self.note is not None:
            line["events"] = [{"event": "note", "text": str(self.note)}]
        if self.target is not None:
            line["target"] = {"object": None, "place": None, "locked": False, "posterior": [], **self.target}
        return json.dumps(line, default=_to_builtin, allow_nan=False)


def _to_builtin(value: Any) -> Any:
    """NumPy's numbers and arrays as JSON has them."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is no JSON")


class ControlMethod:
    """A control method. Override ``step``; ``begin`` is called before the first step of each trial.

    name: what it is called in results, letters, digits, ``_`` and ``-``; the class's name unless set. title: as shown.
    style: ``jogging`` (a simulated participant moves one joint or axis after the other: HO cycles, WE and WF move, HC works the
    hand) or ``selecting`` (it looks at what is meant: WE goes there, WF locks, HC closes, HO opens).
    needs_gaze, needs_plans, uses_prior: what the trial must give it.
    """

    name: str = ""
    title: str = ""
    style: str = "jogging"
    needs_gaze: bool = False
    needs_plans: bool = False
    uses_prior: bool = False

    def begin(self) -> None:
        """Forgets the trial before."""

    def step(self, seen: Seen) -> Optional[Command]:
        """What to do now. None leaves all as it is: an arm that moved stops after two such steps."""
        raise NotImplementedError("a control method has a step(seen) of its own")

    def _info(self) -> str:
        name = self.name or type(self).__name__
        needs = {"gaze": self.needs_gaze, "plans": self.needs_plans, "prior": self.uses_prior}
        return json.dumps({"name": name, "title": self.title or name, "style": self.style, "needs": needs})

    def _ask(self, line: str) -> str:
        seen = Seen(json.loads(line))
        command = self.step(seen)
        if command is None:
            command = Command()
        if not isinstance(command, Command):
            raise TypeError(f"step gave {type(command).__name__}, expected proact.Command or None")
        return command.line(seen)


@dataclass
class Intention:
    """What a participant does from one display frame to the next.

    gesture: one of ``GESTURES``. look_at: shape (3,), a point in ``world``, m; None looks ahead. eyes_open: False during blinks.
    lean: forward, lateral (to the right) and axial (to the left) angle of the trunk, rad.
    """

    gesture: str = "no_motion"
    look_at: Optional[Sequence[float]] = None
    eyes_open: bool = True
    lean: Sequence[float] = field(default_factory=lambda: (0.0, 0.0, 0.0))


class Participant:
    """Somebody who sees what is displayed, 60 times a second, and acts. Override ``step``."""

    def begin(self) -> None:
        """Forgets the trial before."""

    def step(self, frame: dict[str, Any]) -> Intention:
        """What to do until the next frame. ``frame`` is the displayed instant: ``joints`` (rad), ``objects`` (poses, ``world``),
        ``hand``, ``target``, ``planner``, ``mode``, ``next``, ``asked``, ``score``, ``time_left_secs`` and more."""
        raise NotImplementedError("a participant has a step(frame) of its own")

    def _ask(self, line: str) -> str:
        frame = json.loads(line)
        intention = self.step(frame)
        if not isinstance(intention, Intention):
            raise TypeError(f"step gave {type(intention).__name__}, expected proact.Intention")
        if intention.gesture not in GESTURES:
            raise ValueError(f"gesture is {intention.gesture!r}, expected one of {', '.join(GESTURES)}")
        head = pose_matrix(frame["world_from_head"])
        direction = head[:3, 0]
        if intention.look_at is not None:
            direction = check_array("look_at", intention.look_at, (3,)) - head[:3, 3]
            length = np.linalg.norm(direction)
            direction = direction / length if length > 1e-9 else head[:3, 0]
        forward, lateral, axial = check_array("lean", intention.lean, (3,)).tolist()
        return json.dumps(
            {
                "gesture": intention.gesture,
                "gaze_direction": direction.tolist(),
                "eyes_open": bool(intention.eyes_open),
                "trunk": {"forward": forward, "lateral": lateral, "axial": axial},
                "limb": None,
            }
        )


class Look:
    """What an intent model sees of one gaze. ``m`` objects, in the order of the scene.

    ``time_ms``: int. ``valid``: False during a blink, when origin and direction mean nothing. ``origin``: shape (3,), the eye,
    ``world``, m. ``direction``: shape (3,), of any length. ``objects``: shape (m, 3), centres, ``world``, m. ``pickable``: shape
    (m,), bool, which may be meant. ``due``: shape (m,), bool, which the task asks for; all of them for a method without task
    context. ``prior``: shape (m,), what the task says of each; sums to one, zeros where nothing may be meant. ``selection``: counts
    up when a new selection begins. ``tip``: shape (3,), where the hand would meet an object, ``world``, m, or None. ``raw``: all of
    it as it came.
    """

    def __init__(self, raw: dict[str, Any]):
        def points(value: Any) -> np.ndarray:
            # What is not finite came as null, which becomes NaN.
            return np.array(value, dtype=np.float64)

        self.raw = raw
        self.time_ms: int = raw["time"]
        gaze = raw["gaze"]
        self.valid: bool = gaze["valid"]
        self.origin = points(gaze["origin"])
        self.direction = points(gaze["direction"])
        self.objects = points(raw["objects"]).reshape(-1, 3)
        self.pickable = np.array(raw["pickable"], dtype=bool)
        self.due = np.array(raw["due"], dtype=bool)
        self.prior = points(raw["prior"])
        self.selection: int = raw["selection"]
        self.tip = None if raw["tip"] is None else points(raw["tip"])

    def angles(self) -> np.ndarray:
        """The angle between the gaze and the line to each object, shape (m,), rad."""
        lines = self.objects - self.origin
        cosines = lines @ self.direction / (np.linalg.norm(lines, axis=1) * np.linalg.norm(self.direction))
        return np.arccos(np.clip(cosines, -1.0, 1.0))


class IntentModel:
    """A model of which object a person means. Override ``infer``; ``begin`` is called before each trial."""

    def begin(self) -> None:
        """Forgets the trial before."""

    def infer(self, look: Look) -> Optional[Sequence[float]]:
        """How likely each object is meant: shape (m,), numbers from zero up in any scale; those of objects that are not
        ``pickable`` do not count. None, or all zero: the gaze told nothing, and nothing is highlighted; during a blink what was
        known before stands."""
        raise NotImplementedError("an intent model has an infer(look) of its own")

    def _ask(self, line: str) -> str:
        look = Look(json.loads(line))
        answer = self.infer(look)
        if answer is None:
            return json.dumps({"time": look.time_ms, "posterior": None})
        posterior = check_array("infer", answer, (len(look.objects),))
        if posterior.min(initial=0.0) < 0:
            raise ValueError(f"infer gave {posterior.tolist()}, expected numbers from 0 up")
        return json.dumps({"time": look.time_ms, "posterior": posterior.tolist()})


class Classifier:
    """A classifier of EMG windows. Anything with scikit-learn's ``fit`` and ``predict_proba`` will do as well.

    ``fit(features, labels)``: (windows, f) and (windows,) names of gestures; features are MAV, ZC, SSC, WL of each channel.
    ``predict_proba(features)``: (1, f) gives (1, gestures), probabilities in the order of ``classes_`` (ascending names).
    """

    def fit(self, features: np.ndarray, labels: np.ndarray) -> Classifier:
        raise NotImplementedError("a classifier has a fit(features, labels) of its own")

    def predict_proba(self, features: np.ndarray) -> np.ndarray:
        raise NotImplementedError("a classifier has a predict_proba(features) of its own")


def classifier_function(classifier: Any, gestures: Sequence[str]):
    """From a window's line to its answer, by ``classifier``; ``gestures`` in the order of the model."""
    order = [list(getattr(classifier, "classes_", gestures)).index(gesture) for gesture in gestures]

    def ask(line: str) -> str:
        window = json.loads(line)
        probabilities = classifier.predict_proba(np.array([window["features"]], dtype=np.float64))
        row = check_array("predict_proba", probabilities, (1, len(gestures)))[0]
        if row.min() < 0 or abs(row.sum() - 1) > 1e-6:
            raise ValueError(f"predict_proba gave {row.tolist()}, expected probabilities that sum to one")
        return json.dumps({"window": window["window"], "posterior": row[order].tolist()})

    return ask
