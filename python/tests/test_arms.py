"""Kinematics, dynamics and plans: the laws that tie them together, and what is refused."""

import numpy as np
import pytest

import proact


@pytest.fixture(scope="module", params=["mpl_right", "mpl_left"])
def arm(request):
    return proact.Arm(request.param)


def postures(arm, count, seed=1):
    share = np.random.default_rng(seed).uniform(0.1, 0.9, (count, len(arm.joint_names)))
    return arm.lower + share * (arm.upper - arm.lower)


def test_the_jacobian_is_the_derivative_of_the_pose(arm):
    step = 1e-6
    for q in postures(arm, 5):
        jacobian = arm.jacobian(q)
        for joint in range(len(q)):
            shift = np.eye(len(q))[joint] * step
            one, other = arm.forward(q - shift), arm.forward(q + shift)
            linear = (other[:3, 3] - one[:3, 3]) / (2 * step)
            spin = (other[:3, :3] - one[:3, :3]) / (2 * step) @ arm.forward(q)[:3, :3].T
            angular = [spin[2, 1], spin[0, 2], spin[1, 0]]
            assert np.allclose(jacobian[:, joint], [*linear, *angular], atol=1e-7)


def test_inverse_kinematics_comes_back_to_the_pose(arm):
    solved = 0
    for q in postures(arm, 10):
        target = arm.forward(q)
        found = arm.inverse(target, seed=q + 0.05)
        if found is not None:
            solved += 1
            assert (found >= arm.lower - 1e-9).all() and (found <= arm.upper + 1e-9).all()
            assert np.allclose(arm.forward(found), target, atol=1e-4)
    assert solved >= 8
    out_of_reach = np.eye(4)
    out_of_reach[0, 3] = 10.0
    assert arm.inverse(out_of_reach) is None


def test_many_postures_at_once_are_as_one_by_one(arm):
    q = postures(arm, 4)
    assert arm.forward(q).shape == (4, 4, 4)
    assert np.array_equal(arm.forward(q)[2], arm.forward(q[2]))


def test_torques_at_rest_are_those_of_gravity_and_inertia_adds_to_them(arm):
    q = postures(arm, 1)[0]
    zero = np.zeros_like(q)
    rest = arm.inverse_dynamics(q, zero, zero)
    assert rest.shape == q.shape and np.abs(rest).max() > 0.1
    # The equation of motion is linear in the acceleration, with a symmetric, positive mass matrix.
    mass = np.array([arm.inverse_dynamics(q, zero, row) - rest for row in np.eye(len(q))])
    assert np.allclose(mass, mass.T, atol=1e-9) and np.linalg.eigvalsh(mass).min() > 0


def test_a_plan_leads_from_start_to_goal_and_keeps_clear():
    arm = proact.Arm()
    start = np.array([0.0, -0.3, 0.0, 1.0, 0.0, 0.0, 0.0])
    start = np.clip(start, arm.lower, arm.upper)
    goal = np.clip(start + [0.3, 0.1, 0.2, 0.3, 0.0, 0.1, 0.0], arm.lower, arm.upper)
    plan = arm.plan(start, goal, "empty", seed=3)
    assert plan.status == "ok" and plan.path.shape == (len(plan.times), 7)
    assert np.allclose(plan.path[0], start) and np.allclose(plan.path[-1], goal)
    assert (np.diff(plan.times) > 0).all()
    again = arm.plan(start, goal, "empty", seed=3)
    assert np.array_equal(plan.path, again.path)
    assert all(not arm.collisions(q, "empty") for q in plan.path[::10])


def test_what_is_in_the_way_is_named():
    arm = proact.Arm()
    q = np.clip(np.zeros(7), arm.lower, arm.upper)
    tip = arm.forward(q)[:3, 3]
    block = {
        "name": "block",
        "shape": {"type": "box", "size": [0.1, 0.1, 0.1]},
        "position": tip.tolist(),
        "quaternion": [0, 0, 0, 1],
    }
    pairs = arm.collisions(q, [block])
    assert any("block" in pair for pair in pairs)
    plan = arm.plan(q, q + 0.01, [block])
    assert plan.status == "start_in_collision" and plan.path.shape == (0, 7)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda arm: arm.forward(np.zeros(6)), r"q has shape \(6,\), expected \(7,\)"),
        (lambda arm: arm.jacobian([np.nan] * 7), "q is .*nan.*, expected finite numbers"),
        (lambda arm: arm.forward("up"), "could not convert|expected numbers"),
        (lambda arm: arm.inverse(np.eye(3)), r"base_from_tip has shape \(3, 3\), expected \(4, 4\)"),
        (lambda arm: arm.inverse(2 * np.eye(4)), "is no rotation"),
        (lambda arm: arm.inverse_dynamics(np.zeros(7), np.zeros(7), np.zeros(6)), "qdd has shape"),
        (lambda arm: arm.plan(np.zeros(7), np.zeros(7), "forest"), "forest"),
        (lambda arm: arm.plan(np.zeros(7), np.zeros(7), "empty", planner="none"), "none"),
    ],
)
def test_what_cannot_be_is_refused_with_what_can(ask, words):
    with pytest.raises(ValueError, match=words):
        ask(proact.Arm())


def test_an_arm_that_does_not_exist_is_refused_with_those_that_do():
    with pytest.raises(ValueError, match="mpl_right"):
        proact.Arm("third")


def test_quaternions_and_matrices_are_the_same_rotation():
    for seed in range(20):
        q = np.random.default_rng(seed).normal(size=4)
        q *= np.sign(q[3]) / np.linalg.norm(q)
        matrix = proact.parts.pose_matrix({"rotation": q, "translation": [0, 0, 0]})
        assert np.allclose(proact.arms.quaternion(matrix), q, atol=1e-12)
