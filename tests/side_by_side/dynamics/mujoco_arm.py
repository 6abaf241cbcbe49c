"""The arm, and what stands around it, in MuJoCo.

Reads one JSON object from standard input, writes one to standard output. The arm is built from the URDF by this program
alone; nothing of ProACT's code takes part. README.md in this folder has the keys.
"""

import json
import sys
import time
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np

TICK = 1e-3
# Who collides with whom: links with the room and with blocks, not with each other.
LINK, ROOM, BLOCK = 'contype="1" conaffinity="0"', 'contype="2" conaffinity="1"', 'contype="4" conaffinity="7"'


def numbers(values):
    return " ".join(repr(float(value)) for value in values)


def vector(text):
    return np.array([float(word) for word in text.split()])


def rotation(rpy):
    """Matrix of URDF's roll, pitch, yaw about fixed axes."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])


def quaternion(matrix):
    """Scalar first."""
    out = np.zeros(4)
    mujoco.mju_mat2Quat(out, matrix.flatten())
    return out


def origin(element):
    tag = element.find("origin")
    if tag is None:
        return np.zeros(3), np.eye(3)
    return vector(tag.get("xyz", "0 0 0")), rotation(vector(tag.get("rpy", "0 0 0")))


def about(axis, angle):
    out = np.zeros(4)
    mujoco.mju_axisAngle2Quat(out, axis, angle)
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, out)
    return matrix.reshape(3, 3)


def shape(kind, size, more):
    """MuJoCo takes half sizes."""
    half = {
        "box": lambda: [0.5 * value for value in size],
        "sphere": lambda: size[:1],
        "cylinder": lambda: [size[0], 0.5 * size[1]],
        "capsule": lambda: [size[0], 0.5 * size[1]],
    }[kind]()
    return f'<geom type="{kind}" size="{numbers(half)}" {more}/>'


def urdf_shape(geometry):
    tag = next(iter(geometry))
    if tag.tag == "box":
        return "box", vector(tag.get("size"))
    if tag.tag == "sphere":
        return "sphere", [float(tag.get("radius"))]
    return tag.tag, [float(tag.get("radius")), float(tag.get("length"))]


class Arm:
    def __init__(self, problem):
        robot = ElementTree.fromstring(problem["urdf"])
        self.links = {link.get("name"): link for link in robot.iter("link")}
        self.children = {}
        for joint in robot.findall("joint"):
            self.children.setdefault(joint.find("parent").get("link"), []).append(joint)
        children = {joint.find("child").get("link") for joint in robot.findall("joint")}
        self.root = next(name for name in self.links if name not in children)
        self.angles = dict(zip(problem["joints"], problem["positions"]))
        limits = {joint.get("name"): joint.find("limit") for joint in robot.findall("joint")}
        # A joint without a range is none.
        fixed = [name for name, limit in limits.items() if limit is not None and limit.get("lower") == limit.get("upper")]
        problem["free"] = [name for name in problem["free"] if name not in fixed]
        self.free = problem["free"]
        self.limp = problem["limp"]
        self.gain = problem.get("motor_gain", 0.0)
        self.motors = []

    def body(self, name, place):
        text = [f'<body name="{name}" {place}>']
        link = self.links[name]
        inertial = link.find("inertial")
        if inertial is not None:
            at, turn = origin(inertial)
            tag = inertial.find("inertia")
            ixx, ixy, ixz, iyy, iyz, izz = (float(tag.get(key)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
            own = turn @ np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]) @ turn.T
            six = [own[0, 0], own[1, 1], own[2, 2], own[0, 1], own[0, 2], own[1, 2]]
            mass = float(inertial.find("mass").get("value"))
            text.append(f'<inertial pos="{numbers(at)}" mass="{mass!r}" fullinertia="{numbers(six)}"/>')
        for joint in self.joint_of(name):
            text.append(joint)
        for collision in link.findall("collision") if not self.limp else []:
            at, turn = origin(collision)
            kind, size = urdf_shape(collision.find("geometry"))
            more = f'pos="{numbers(at)}" quat="{numbers(quaternion(turn))}" friction="0.8 0.005 0.0001" {LINK}'
            text.append(shape(kind, size, more))
        for joint in self.children.get(name, []):
            at, turn = origin(joint)
            if joint.get("name") in self.angles and joint.get("name") not in self.free:
                turn = turn @ about(vector(joint.find("axis").get("xyz")), self.angles[joint.get("name")])
            place = f'pos="{numbers(at)}" quat="{numbers(quaternion(turn))}"'
            text.append(self.body(joint.find("child").get("link"), place))
        text.append("</body>")
        return "\n".join(text)

    def joint_of(self, child):
        for joints in self.children.values():
            for joint in joints:
                name = joint.get("name")
                if joint.find("child").get("link") != child or name not in self.free:
                    continue
                limit, dynamics = joint.find("limit"), joint.find("dynamics")
                more = 'limited="false"'
                if not self.limp:
                    more = f'limited="true" range="{limit.get("lower")} {limit.get("upper")}"'
                    if dynamics is not None:
                        more += f' damping="{dynamics.get("damping", "0")}" frictionloss="{dynamics.get("friction", "0")}"'
                    self.motors.append((name, float(limit.get("effort"))))
                yield f'<joint name="{name}" type="hinge" axis="{joint.find("axis").get("xyz")}" {more}/>'


def pose(seven):
    """MJCF's attributes of x y z qx qy qz qw."""
    x, y, z, qx, qy, qz, qw = seven
    return f'pos="{numbers([x, y, z])}" quat="{numbers([qw, qx, qy, qz])}"'


def build(problem):
    arm = Arm(problem)
    body = arm.body(arm.root, 'mocap="true" ' + pose(problem["base"]))
    text = ['<mujoco><compiler angle="radian" autolimits="false" inertiafromgeom="auto"/>']
    text.append(f'<option timestep="{problem["step"]!r}" integrator="{problem["integrator"]}" gravity="0 0 -9.80665"/>')
    text.append('<size memory="200M"/><worldbody>' + body)
    for thing in problem.get("fixed", []):
        text.append(shape(thing["kind"], thing["size"], f'{pose(thing["pose"])} friction="0.4 0.005 0.0001" {ROOM}'))
    for index, thing in enumerate(problem.get("blocks", [])):
        text.append(f'<body name="block{index}" {pose(thing["pose"])}><freejoint/>')
        text.append(shape(thing["kind"], thing["size"], f'mass="{thing["mass"]!r}" friction="0.4 0.005 0.0001" {BLOCK}'))
        text.append("</body>")
    text.append("</worldbody>")
    if problem["drive"] == "speed":
        text.append("<actuator>")
        for name, effort in arm.motors:
            if name not in arm.free:
                continue
            # A motor of bounded torque that is at its limit 0.01 rad/s beside its speed.
            text.append(f'<velocity joint="{name}" kv="{100.0 * effort!r}" forcelimited="true" forcerange="{-effort!r} {effort!r}"/>')
        text.append("</actuator>")
    tip = problem.get("tip")
    if tip and problem.get("blocks"):
        text.append("<equality>")
        for index in range(len(problem["blocks"])):
            text.append(f'<weld body1="{tip}" body2="block{index}" active="false"/>')
        text.append("</equality>")
    text.append("</mujoco>")
    return mujoco.MjModel.from_xml_string("\n".join(text)), arm


def weld(model, data, tip, block):
    """Joins a block to the tip where both are."""
    a, b = model.body(tip).id, model.body(f"block{block}").id
    turn, back = np.zeros(4), np.zeros(4)
    mujoco.mju_negQuat(back, data.xquat[a])
    mujoco.mju_mulQuat(turn, back, data.xquat[b])
    model.eq_data[block, 3:6] = data.xmat[a].reshape(3, 3).T @ (data.xpos[b] - data.xpos[a])
    model.eq_data[block, 6:10] = turn
    data.eq_active[block] = 1


def run(problem):
    model, arm = build(problem)
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in problem["free"]]
    places = np.array([joint.qposadr[0] for joint in joints])
    dofs = np.array([joint.dofadr[0] for joint in joints])
    rows = np.array([problem["joints"].index(name) for name in problem["free"]])
    data.qpos[places] = np.array(problem["positions"])[rows]
    mujoco.mj_forward(model, data)
    count = len(problem["joints"])
    commands = np.fromfile(problem["commands"]).reshape(-1, 2 * count + 7)
    events = {tick: rest for tick, *rest in problem.get("events", [])}
    substeps = round(TICK / problem["step"])
    order = [name for name, _ in arm.motors]
    actuators = np.array([problem["free"].index(name) for name in order], dtype=int)
    fastest = np.array(problem.get("fastest", np.full(count, np.inf)))[rows]
    angles, times = [], []
    for tick, command in enumerate(commands):
        position, velocity, base = command[:count][rows], command[count:2 * count][rows], command[2 * count:]
        data.mocap_pos[0] = base[:3]
        data.mocap_quat[0] = [base[6], *base[3:6]]
        for kind, *what in [events[tick]] if tick in events else []:
            if kind == "attach":
                weld(model, data, problem["tip"], what[0])
            else:
                data.eq_active[:] = 0
        if problem["drive"] == "speed":
            error = position - data.qpos[places] - velocity * TICK
            data.ctrl[:] = np.clip(velocity + 200.0 * error, -1.25 * fastest, 1.25 * fastest)[actuators]
        else:
            data.qfrc_applied[dofs] = position
        before = time.thread_time_ns()
        for _ in range(substeps):
            mujoco.mj_step(model, data)
        times.append(1e-9 * (time.thread_time_ns() - before))
        if tick % problem["every"] == problem["every"] - 1:
            angles.append(data.qpos[places].tolist())
    if not np.all(np.isfinite(data.qpos)):
        raise SystemExit("MuJoCo's state left the finite numbers")
    return {
        "version": mujoco.__version__,
        "angles": angles,
        "core_secs": float(np.sum(times)),
        "median_secs": float(np.median(times)),
        "warnings": int(sum(warning.number for warning in data.warning)),
    }


if __name__ == "__main__":
    json.dump([run(problem) for problem in json.load(sys.stdin)], sys.stdout)
