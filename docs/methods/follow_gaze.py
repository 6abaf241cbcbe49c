#!/usr/bin/python3
"""An example method in another process: WE carries the hand towards the block that you look at, WF back up, HC and HO
work the hand.

    proact serve --method docs/methods/follow_gaze.toml

Each line of standard input is one control step as a JSON object, each line of standard output answers one. Keep
standard output for answers; what you print for yourself goes to standard error.
"""
import json
import sys

SPEED_M_PER_S = 0.1  # of the hand, m/s
STOP_HEIGHT_M = 0.15  # the hand stops this far above the block's centre, metres
LIFT_VELOCITY_M_PER_S = [0.0, 0.0, SPEED_M_PER_S]


def rotate_back(q, v):
    """Turns `v` by the inverse of the unit quaternion `q` (x, y, z, w)."""
    u, w = [-x for x in q[:3]], q[3]

    def cross(a, b):
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    t = [2 * x for x in cross(u, v)]
    return [x + w * y + z for x, y, z in zip(v, t, cross(u, t))]


def approach_velocity(step):
    """Velocity of the hand toward the point over the block in view, base axes, m/s; none when it is there."""
    if step["highlight"] is None:
        return None
    block = step["objects"][step["highlight"]]
    base = step["world_from_base"]
    goal = [block[0], block[1], block[2] + STOP_HEIGHT_M]
    goal = rotate_back(base["rotation"], [g - t for g, t in zip(goal, base["translation"])])
    away = [g - t for g, t in zip(goal, step["base_from_tip"]["translation"])]
    distance = sum(x * x for x in away) ** 0.5
    return [x / distance * min(SPEED_M_PER_S, distance) for x in away] if distance > 1e-3 else None


def joint_speeds(linear, jacobian):
    """Along the transpose of the Jacobian's linear rows, as fast as brings the hand to the speed asked for."""
    rows = jacobian[:3]
    speeds = [sum(rows[i][k] * linear[i] for i in range(3)) for k in range(len(rows[0]))]
    moved = [sum(row[k] * speeds[k] for k in range(len(speeds))) for row in rows]
    gained = sum(m * v for m, v in zip(moved, linear))
    asked = sum(v * v for v in linear)
    return [speed * asked / max(gained, 1e-4) for speed in speeds]


last = None
for line in sys.stdin:
    step = json.loads(line)
    gesture, changed, last = step["gesture"], step["gesture"] != last, step["gesture"]
    linear = {"wrist_extension": approach_velocity(step), "wrist_flexion": LIFT_VELOCITY_M_PER_S}.get(gesture)
    answer = {"time": step["time"], "target": {"object": step["highlight"], "locked": False, "posterior": []}}
    # A method that moves says so at every step; whatever is no motion is a stop.
    answer["motion"] = {"velocity": joint_speeds(linear, step["jacobian"])} if linear else "hold"
    if changed and gesture in ("hand_close", "hand_open"):
        answer["hand"] = "close" if gesture == "hand_close" else "open"
    print(json.dumps(answer), flush=True)
