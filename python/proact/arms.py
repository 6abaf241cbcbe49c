"""Kinematics, dynamics, plans and collisions of an arm, with arrays in and out."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Optional, Union

import numpy as np

from . import _proact
from .parts import check_array, pose_matrix

#: A scene by name, or shapes: ``{"name", "shape": {"type": "box", "size": [x, y, z]}, "position", "quaternion"}``, m, ``world``.
Scene = Union[str, Sequence[dict]]


@dataclass(frozen=True)
class Plan:
    """``status``: ``ok``, ``intermediate`` (it ends on the way), or why there is none: ``no_plan``, ``unreachable``,
    ``start_in_collision``, ``goal_in_collision``, ``invalid``. ``path``: shape (p, n), rad. ``times``: shape (p,), s. ``reason``: why,
    where there is no full plan."""

    status: str
    path: np.ndarray
    times: np.ndarray
    reason: str


class Arm:
    """An arm that ships with the program (``mpl_right``, ``mpl_left``, ``wam``, ...), or a lab's own in a folder.

    Its chain has ``n`` joints from ``base`` to ``tip``, its hand ``h``. Poses are of the tip in the base, as (4, 4) matrices; twists and
    Jacobians have linear rows first, axes of the base. Computed by KDL, OMPL and FCL. Not for use from several threads.

    ``joint_names``, ``hand_joint_names``: in the order of all arrays. ``lower``, ``upper`` (rad), ``max_velocity`` (rad/s), ``max_effort``
    (N m): shape (n,).
    """

    def __init__(self, name: str = "mpl_right"):
        self._query = _proact.ArmQuery(str(name))
        self.name = str(name)
        self.joint_names: list[str] = self._query.joints
        self.hand_joint_names: list[str] = self._query.hand_joints
        self.base, self.tip = self._query.ends
        self.lower, self.upper, self.max_velocity, self.max_effort = np.array(self._query.limits).T

    def _ask(self, op: str, **question: Any) -> dict[str, Any]:
        given = {key: value for key, value in question.items() if value is not None}
        return json.loads(self._query.ask(json.dumps({"op": op, **given})))

    def _joints(self, name: str, values: Any) -> list[float]:
        return check_array(name, values, (len(self.joint_names),)).tolist()

    def _hand(self, hand: Any) -> Optional[list[float]]:
        return None if hand is None else check_array("hand", hand, (len(self.hand_joint_names),)).tolist()

    def forward(self, q: Any) -> np.ndarray:
        """``base_from_tip`` at the angles ``q``, shape (n,), rad: shape (4, 4). For q of shape (k, n): (k, 4, 4)."""
        array = np.asarray(q, dtype=np.float64)
        if array.ndim == 2:
            return np.array([self.forward(row) for row in array]).reshape(-1, 4, 4)
        answer = self._ask("fk", q=self._joints("q", q))
        return pose_matrix({"rotation": answer["quaternion"], "translation": answer["position"]})

    def jacobian(self, q: Any) -> np.ndarray:
        """Geometric Jacobian of the tip at ``q``, shape (n,): shape (6, n), linear rows first, m and rad per rad."""
        return np.array(self._ask("jacobian", q=self._joints("q", q))["jacobian"])

    def singular_values(self, q: Any) -> np.ndarray:
        """Of the Jacobian at ``q``: shape (6,), falling."""
        return np.array(self._ask("condition", q=self._joints("q", q))["sigma"])

    def inverse(self, base_from_tip: Any, seed: Any = None) -> Optional[np.ndarray]:
        """Angles within the limits at which the tip is there, shape (n,), searched from ``seed``, shape (n,) (the middle of the limits
        unless given); None if none were found."""
        matrix = check_array("base_from_tip", base_from_tip, (4, 4))
        start = None if seed is None else self._joints("seed", seed)
        answer = self._ask("ik", position=matrix[:3, 3].tolist(), quaternion=quaternion(matrix), seed=start)
        return np.array(answer["q"]) if answer["status"] == "ok" else None

    def inverse_dynamics(self, q: Any, qd: Any, qdd: Any, hand: Any = None) -> np.ndarray:
        """Torques of the arm's joints, shape (n,), N m, for angles, speeds and accelerations of shape (n,), the hand's mass included.
        ``hand``: its angles, shape (h,), zero unless given. Gravity is 9.80665 m/s^2 along -z of the base."""
        joints = {key: self._joints(key, value) for key, value in (("q", q), ("qd", qd), ("qdd", qdd))}
        return np.array(self._ask("inverse_dynamics", **joints, hand=self._hand(hand))["tau"])

    def plan(
        self,
        start: Any,
        goal: Any,
        scene: Scene = "box",
        *,
        seed: int = 0,
        hand: Any = None,
        planner: Optional[str] = None,
        world_from_base: Any = None,
    ) -> Plan:
        """A path from the angles ``start``, shape (n,), to ``goal``: angles, shape (n,), or ``base_from_tip``, shape (4, 4).

        scene: ``box`` (table, walls, partition), ``clutter`` (with blocks), ``empty``, or a list of shapes. planner: OMPL's name.
        Deterministic for ``seed``. No plan is an answer, not an error.
        """
        target = np.asarray(goal, dtype=np.float64)
        where: dict[str, Any]
        if target.shape == (4, 4):
            where = {"goal_pose": _pose("goal", target)}
        else:
            where = {"goal_q": self._joints("goal", goal)}
        base = None if world_from_base is None else _pose("world_from_base", world_from_base)
        answer = self._ask(
            "plan",
            start=self._joints("start", start),
            scene=scene if isinstance(scene, str) else list(scene),
            seed=int(seed),
            hand=self._hand(hand),
            planner=planner,
            base_pose=base,
            **where,
        )
        path = np.array(answer["path"], dtype=np.float64).reshape(-1, len(self.joint_names))
        times = np.array(answer["times"], dtype=np.float64)
        return Plan(answer["status"], path, times, answer.get("reason") or "")

    def collisions(self, q: Any, scene: Scene = "box", *, hand: Any = None, world_from_base: Any = None) -> list[tuple[str, str]]:
        """Pairs that touch at ``q``, shape (n,); none if there are none."""
        base = None if world_from_base is None else _pose("world_from_base", world_from_base)
        answer = self._ask(
            "collision",
            q=self._joints("q", q),
            scene=scene if isinstance(scene, str) else list(scene),
            hand=self._hand(hand),
            base_pose=base,
        )
        return [tuple(pair) for pair in answer["pairs"]]


def _pose(name: str, matrix: Any) -> dict[str, list[float]]:
    matrix = check_array(name, matrix, (4, 4))
    return {"position": matrix[:3, 3].tolist(), "quaternion": quaternion(matrix)}


def quaternion(matrix: Any) -> list[float]:
    """The rotation of a (4, 4) or (3, 3) matrix as x, y, z, w (Bar-Itzhack 2000: the eigenvector of the largest eigenvalue).

    Raises ValueError for a matrix that is no rotation.
    """
    m = np.asarray(matrix, dtype=np.float64)[:3, :3]
    if np.abs(m @ m.T - np.eye(3)).max() > 1e-6 or np.linalg.det(m) < 0:
        raise ValueError(f"the upper left 3 x 3 of {np.asarray(matrix).tolist()} is no rotation, expected orthonormal, right-handed axes")
    k = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[2, 0] + m[0, 2], m[2, 1] - m[1, 2]],
            [m[1, 0] + m[0, 1], m[1, 1] - m[0, 0] - m[2, 2], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
            [m[2, 0] + m[0, 2], m[2, 1] + m[1, 2], m[2, 2] - m[0, 0] - m[1, 1], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], m[0, 0] + m[1, 1] + m[2, 2]],
        ]
    )
    values, vectors = np.linalg.eigh(k / 3)
    x, y, z, w = vectors[:, -1]
    sign = -1.0 if w < 0 else 1.0
    return [sign * x, sign * y, sign * z, sign * w]
