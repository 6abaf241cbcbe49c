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
# Of the body that carries the base, kg and kg m^2: what the arm does to it is 1e-6 of what it does to the arm.
CARRIER_INERTIA = 1e6
# Of a wheel that drives a joint by friction, kg m^2.
WHEEL_INERTIA_KG_M2 = 10.0
# Contacts that give way as little as the step lets them, and whose friction is the norm of both tangents.
HARD_CONTACT = 'solref="0.002 1" solimp="0.95 0.99 0.0001" condim="3"'
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
        self.hard = HARD_CONTACT if problem.get("hard") else ""
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
            more = f'pos="{numbers(at)}" quat="{numbers(quaternion(turn))}" friction="0.8 0.005 0.0001" {self.hard} {LINK}'
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
    if problem.get("sways"):
        # A mocap body has a place and no speed; this one has both.
        body = arm.body(arm.root, 'pos="0 0 0"')
        six = [CARRIER_INERTIA, CARRIER_INERTIA, CARRIER_INERTIA, 0.0, 0.0, 0.0]
        own = f'<freejoint name="base"/><inertial pos="0 0 0" mass="{CARRIER_INERTIA!r}" fullinertia="{numbers(six)}"/>'
        body = f'<body name="carrier" gravcomp="1" {pose(problem["base"])}>{own}{body}</body>'
    else:
        body = arm.body(arm.root, 'mocap="true" ' + pose(problem["base"]))
    text = ['<mujoco><compiler angle="radian" autolimits="false" inertiafromgeom="auto"/>']
    # Newton's method fails where friction couples bodies as heavy as a carrier and as light as a finger.
    cone = 'cone="elliptic" impratio="10" solver="CG" iterations="500" tolerance="1e-12"' if arm.hard else ""
    text.append(f'<option timestep="{problem["step"]!r}" integrator="{problem["integrator"]}" gravity="0 0 -9.80665" {cone}/>')
    text.append('<size memory="200M"/><worldbody>' + body)
    for thing in problem.get("fixed", []):
        text.append(shape(thing["kind"], thing["size"], f'{pose(thing["pose"])} friction="0.4 0.005 0.0001" {arm.hard} {ROOM}'))
    for index, thing in enumerate(problem.get("blocks", [])):
        text.append(f'<body name="block{index}" {pose(thing["pose"])}><freejoint/>')
        text.append(shape(thing["kind"], thing["size"], f'mass="{thing["mass"]!r}" friction="0.4 0.005 0.0001" {arm.hard} {BLOCK}'))
        text.append("</body>")
    wheels = arm.motors if problem["drive"] == "speed" and arm.hard else []
    for name, _ in wheels:
        text.append(f'<body name="wheel_{name}"><joint name="wheel_{name}" type="hinge" axis="0 0 1"/>')
        text.append(f'<inertial pos="0 0 0" mass="1" diaginertia="{WHEEL_INERTIA_KG_M2!r} {WHEEL_INERTIA_KG_M2!r} {WHEEL_INERTIA_KG_M2!r}"/></body>')
    text.append("</worldbody>")
    if wheels:
        # A motor of bounded torque is a wheel of the asked speed that drags its joint by friction. A velocity actuator at
        # its bound is explicit, and shakes fingers of some grams.
        text.append("<tendon>")
        for name, effort in wheels:
            text.append(f'<fixed frictionloss="{effort!r}" solreffriction="0.0002 1" solimpfriction="0.99 0.999 0.001">')
            text.append(f'<joint joint="{name}" coef="1"/><joint joint="wheel_{name}" coef="-1"/></fixed>')
        text.append("</tendon>")
    elif problem["drive"] == "speed":
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


def pose7_from(row):
    """Position and scalar-first quaternion of x y z qx qy qz qw."""
    return row[:3], np.array([row[6], *row[3:6]])


class Carrier:
    """Moves the base as it is commanded: from one tick's pose to the next at a steady speed, as the testbed's does."""

    def __init__(self, model, data):
        joint = model.joint("base")
        self.place, self.dof = joint.qposadr[0], joint.dofadr[0]
        self.before = np.zeros(6)
        self.data = data

    def begin_step(self, target):
        data, at = self.data, self.place
        position, rotation = pose7_from(target)
        turn = np.zeros(3)
        mujoco.mju_subQuat(turn, rotation, data.qpos[at + 3:at + 7])
        # A free joint's turning speed is in the body's own frame.
        speed = np.concatenate([(position - data.qpos[at:at + 3]) / TICK, turn / TICK])
        force = CARRIER_INERTIA * (speed - self.before) / TICK
        # The speed changes within the tick, by a force, so that the arm feels it; the place is put right at its end.
        data.qvel[self.dof:self.dof + 6] = self.before
        data.qfrc_applied[self.dof:self.dof + 6] = force
        self.before = speed

    def end_step(self, target):
        data, at = self.data, self.place
        data.qpos[at:at + 3], data.qpos[at + 3:at + 7] = pose7_from(target)
        data.qvel[self.dof:self.dof + 6] = self.before


def block_forces(model, data, links):
    """Normal forces of links on blocks, N, by link."""
    found, six = {}, np.zeros(6)
    for index, contact in enumerate(data.contact):
        bodies = [model.geom_bodyid[geom] for geom in contact.geom]
        names = [model.body(body).name for body in bodies]
        if not any(name.startswith("block") for name in names):
            continue
        for name in names:
            if name in links:
                mujoco.mj_contactForce(model, data, index, six)
                found[name] = found.get(name, 0.0) + float(six[0])
    return found


def run(problem):
    model, arm = build(problem)
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in problem["free"]]
    places = np.array([joint.qposadr[0] for joint in joints], dtype=int)
    dofs = np.array([joint.dofadr[0] for joint in joints], dtype=int)
    rows = np.array([problem["joints"].index(name) for name in problem["free"]], dtype=int)
    data.qpos[places] = np.array(problem["positions"])[rows]
    if "block_speeds" in problem:
        for index, speed in enumerate(problem["block_speeds"]):
            start = model.body(f"block{index}").dofadr[0]
            data.qvel[start:start + 3] = speed
    mujoco.mj_forward(model, data)
    count = len(problem["joints"])
    commands = np.fromfile(problem["commands"]).reshape(-1, 2 * count + 7)
    events = {tick: rest for tick, *rest in problem.get("events", [])}
    substeps = round(TICK / problem["step"])
    order = [name for name, _ in arm.motors]
    driven = problem["drive"] == "speed"
    wheels = np.array([model.joint(f"wheel_{name}").dofadr[0] for name in order if driven and arm.hard], dtype=int)
    actuators = np.array([problem["free"].index(name) for name in order if driven], dtype=int)
    limits = np.array([effort for _, effort in arm.motors if driven])
    fastest = np.array(problem.get("fastest", np.full(count, np.inf)))[rows]
    carrier = Carrier(model, data) if problem.get("sways") else None
    blocks = [model.body(f"block{index}").id for index in range(len(problem.get("blocks", [])))]
    end_of = lambda body: [*data.xpos[body], *data.xquat[body][1:], data.xquat[body][0]]
    answer = {key: [] for key in ("angles", "efforts", "blocks", "forces")}
    times = []
    for tick, command in enumerate(commands):
        position, velocity, base = command[:count][rows], command[count:2 * count][rows], command[2 * count:]
        if carrier:
            carrier.begin_step(base)
        else:
            data.mocap_pos[0], data.mocap_quat[0] = pose7_from(base)
        for kind, *what in [events[tick]] if tick in events else []:
            if kind == "attach":
                weld(model, data, problem["tip"], what[0])
            else:
                data.eq_active[:] = 0
        if driven:
            error = position - data.qpos[places] - velocity * TICK
            speeds = np.clip(velocity + 200.0 * error, -1.25 * fastest, 1.25 * fastest)[actuators]
            if len(wheels):
                data.qvel[wheels] = speeds
            else:
                data.ctrl[:] = speeds
        else:
            data.qfrc_applied[dofs] = position
        tells = tick % problem["every"] == problem["every"] - 1
        torque, forces = np.zeros(len(dofs)), {}
        before = time.thread_time_ns()
        for _ in range(substeps):
            mujoco.mj_step(model, data)
            if tells and problem.get("tell"):
                if model.nu:
                    # What an implicit motor gives is of the speed at the step's end; actuator_force is of its start's.
                    lag = data.ctrl - data.qvel[dofs][actuators]
                    torque[actuators] += np.clip(100.0 * limits * lag, -limits, limits) / substeps
                for name, force in block_forces(model, data, arm.links).items():
                    forces[name] = forces.get(name, 0.0) + force / substeps
        times.append(1e-9 * (time.thread_time_ns() - before))
        if carrier:
            carrier.end_step(base)
        if tells:
            answer["angles"].append(data.qpos[places].tolist())
            if problem.get("tell"):
                answer["efforts"].append(torque.tolist())
                answer["blocks"].append([end_of(body) for body in blocks])
                answer["forces"].append(forces)
    if not np.all(np.isfinite(data.qpos)):
        raise SystemExit("MuJoCo's state left the finite numbers")
    warnings = int(sum(warning.number for warning in data.warning))
    if warnings and problem.get("tell"):
        raise SystemExit(f"MuJoCo warned {warnings} times")
    return answer | {
        "version": mujoco.__version__,
        "core_secs": float(np.sum(times)),
        "median_secs": float(np.median(times)),
        "warnings": warnings,
        "end": [end_of(body) for body in blocks],
    }


if __name__ == "__main__":
    json.dump([run(problem) for problem in json.load(sys.stdin)], sys.stdout)
