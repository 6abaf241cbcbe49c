"""Environments: Gymnasium's own check, seeds, digests that a replay finds again, processes, errors."""

import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import proact

LEVELS = ["gesture", "selection", "joint_speed", "end_effector_speed"]


def make(name="ModifiedBoxAndBlocks-v0", **how):
    return gymnasium.make(f"proact/{name}", **{"limit_secs": 2.0, **how}).unwrapped


def episode(env, seed, steps=1000):
    """Random actions of this seed; the observations, the rewards, the last info, and how it ended."""
    env.action_space.seed(seed)
    observation, info = env.reset(seed=seed)
    seen, rewards, ended = [observation], [], (False, False)
    for _ in range(steps):
        observation, reward, *ended, info = env.step(env.action_space.sample())
        seen.append(observation)
        rewards.append(reward)
        if any(ended):
            break
    return np.array(seen), np.array(rewards), info, tuple(ended)


@pytest.mark.parametrize("observation", ["display", "privileged"])
@pytest.mark.parametrize("action", LEVELS)
def test_gymnasium_finds_no_fault(action, observation):
    with warnings.catch_warnings():
        warnings.filterwarnings("error")
        # Angles, speeds and places have no bounds that an observation would never exceed.
        warnings.filterwarnings("ignore", message=".*A Box observation space m(in|ax)imum value is.*")
        check_env(make(action=action, observation=observation, limit_secs=0.5, render_mode="rgb_array"))


@pytest.mark.parametrize("name", sorted(proact.TASKS))
def test_every_task_runs_until_time_is_up(name):
    env = make(name, limit_secs=65.0 if name.startswith("BoxAndBlocks") else 1.0, period_ms=1000)
    _, _, info, ended = episode(env, 1, 100)
    assert ended == (False, True)
    assert info["result"]["task"] == proact.TASKS[name]


@pytest.mark.parametrize("arm", ["mpl_right", "mpl_left"])
@pytest.mark.parametrize("action", LEVELS)
def test_seed_and_actions_decide_every_bit(action, arm):
    first, again, other = (episode(make(action=action, arm=arm), seed) for seed in (5, 5, 6))
    assert np.array_equal(first[0], again[0]) and np.array_equal(first[1], again[1])
    assert first[2]["digest"] == again[2]["digest"] != other[2]["digest"]


@pytest.mark.parametrize("action", LEVELS)
def test_a_replay_of_the_record_gives_the_digest_of_the_episode(action, tmp_path):
    env = make(action=action, record=tmp_path)
    _, _, info, _ = episode(env, 7)
    found = proact.replay(tmp_path / "episode-0")
    assert found["agrees"] and found["finished"]
    assert found["digest"] == info["digest"] == info["result"]["digest"]


def test_an_episode_that_is_left_is_recorded_up_to_there(tmp_path):
    env = make(record=tmp_path)
    episode(env, 1, steps=10)
    env.close()
    found = proact.replay(tmp_path / "episode-0")
    assert found["agrees"] and found["seconds"] == pytest.approx(0.518)


def test_gestures_through_an_armband_are_misread_at_times():
    direct, read = (episode(make(action="gesture", emg=emg), 3)[2]["digest"] for emg in (None, "synthetic"))
    assert direct != read


def test_joint_speeds_turn_the_joint_that_they_name_as_fast_as_they_say():
    env = make(observation="privileged", limit_secs=5.0)
    env.reset(seed=1)
    elbow = [name.endswith("elbow") for name in env.action_names].index(True)
    action = np.zeros(len(env.action_names))
    action[elbow] = 0.5
    place = {name: index for index, name in enumerate(env.observation_names)}
    speeds = {name: place[f"state.velocity.{name}"] for name in env.action_names[:-1]}
    for _ in range(30):
        observation, *_ = env.step(action)
    turned = {name: observation[index] for name, index in speeds.items()}
    assert turned.pop(env.action_names[elbow]) == pytest.approx(0.25, abs=0.02)  # Half of its 0.5 rad/s.
    assert max(abs(speed) for speed in turned.values()) < 0.05


def test_end_effector_speed_moves_the_grasp_along_world_axes():
    env = make(action="end_effector_speed", observation="privileged", limit_secs=5.0)
    before, _ = env.reset(seed=1)
    for _ in range(20):
        after, *_ = env.step(np.array([0, 0, 0.5, 0, 0, 0, 0]))
    at = [env.observation_names.index(f"state.grasp_centre.{axis}") for axis in "xyz"]
    moved = after[at] - before[at]
    assert moved[2] > 0.05 and abs(moved[2]) > 3 * np.abs(moved[:2]).max()


def test_shaped_reward_sums_to_how_much_nearer_the_hand_came():
    env = make("Reaching-v0", action="end_effector_speed", observation="privileged", limit_secs=60.0)
    names = env.observation_names
    hand = [names.index(f"state.grasp_centre.{axis}") for axis in "xyz"]
    ball = [names.index(f"asked.{axis}") for axis in "xyz"]
    observation, _ = env.reset(seed=2)
    start, total = np.linalg.norm(observation[hand] - observation[ball]), 0.0
    for _ in range(10):
        toward = observation[ball] - observation[hand]
        action = np.concatenate([0.5 * toward / np.linalg.norm(toward), np.zeros(4)])
        observation, reward, *_ = env.step(action)
        total += reward
    end = np.linalg.norm(observation[hand] - observation[ball])
    assert end < start - 0.02
    assert total == pytest.approx(start - end, abs=1e-9)


def test_a_task_that_is_done_terminates_and_a_step_after_it_is_refused(tmp_path):
    # A lab's own: the reaches that ship, with a tenth of a second for each ball.
    shipped = Path(__file__).parents[2] / "rust/tasks/data/reaching.toml"
    own = tmp_path / "hasty.toml"
    text = shipped.read_text()
    assert text.count("limit_secs = 15.0") == 1
    text = text.replace('name = "reaching"', 'name = "hasty"').replace("dwell_secs = 1.0", "dwell_secs = 0.05")
    own.write_text(text.replace("limit_secs = 15.0", "limit_secs = 0.1"))
    env = make(task=str(own), action="end_effector_speed", limit_secs=30.0)
    _, rewards, info, ended = episode(env, 1)
    assert ended == (True, False) and info["time_secs"] < 3.0
    with pytest.raises(ValueError, match="the trial ended at .* s; reset before the next step"):
        env.step(env.action_space.sample())


def test_processes_side_by_side_give_the_digests_of_single_ones():
    how = {"limit_secs": 1.0, "action": "joint_speed"}
    envs = gymnasium.make_vec("proact/ModifiedBoxAndBlocks-v0", num_envs=2, vectorization_mode="async", **how)
    try:
        envs.reset(seed=[11, 12])
        action = np.zeros((2, 8))
        action[:, 2] = 0.4
        for _ in range(10):
            _, _, _, _, info = envs.step(action)
        digests = list(info["digest"])
    finally:
        envs.close()
    for seed, digest in zip((11, 12), digests):
        env = make(**how)
        env.reset(seed=seed)
        for _ in range(10):
            *_, alone = env.step(action[0])
        assert alone["digest"] == digest


def test_a_picture_shows_what_moved():
    env = make(render_mode="rgb_array", limit_secs=5.0)
    env.reset(seed=1)
    before = env.render()
    assert before.shape == (240, 320, 3) and before.dtype == np.uint8
    for _ in range(40):
        env.step(np.array([0, 0, 1, 0, 0, 0, 0, 0]))
    assert (env.render() != before).any()


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"action": "thought"}, 'action = "thought", expected gesture, selection'),
        ({"observation": "all"}, "expected display or privileged"),
        ({"reward": "dense"}, "expected sparse or shaped"),
        ({"action": "gesture", "method": "D"}, 'it needs gaze; use action = "selection"'),
        ({"action": "selection", "method": "A"}, 'use action = "gesture"'),
        ({"task": "bowling"}, "bowling"),
        ({"arm": "third"}, "third"),
        ({"period_ms": 0}, "period_ms"),
        ({"gaze_error_deg": -1.0}, "0 to 45 degrees"),
        ({"settings": ["physics.engine=paper"]}, "paper"),
    ],
)
def test_what_cannot_be_is_refused_with_what_can(how, words):
    with pytest.raises(ValueError, match=words):
        make(**how)


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (np.zeros(7), "the action has 7 numbers, expected 8"),
        (np.full(8, np.nan), "is NaN, expected a number from -1 to 1"),
        (np.full(8, 1.5), "is 1.5, expected a number from -1 to 1"),
    ],
)
def test_an_action_that_is_none_is_refused_and_the_trial_goes_on(action, words):
    env = make()
    env.reset(seed=1)
    with pytest.raises(ValueError, match=words):
        env.step(action)
    env.step(np.zeros(8))


def test_there_is_an_environment_for_each_task_that_ships():
    data = Path(__file__).parents[2] / "rust/tasks/data"
    shipped = {path.stem for path in data.glob("*.toml") if "\nrules = " in path.read_text()}
    assert len(shipped) >= 10 and shipped == set(proact.TASKS.values())
