"""Steps a second of an environment beside arms of MuJoCo in the same run, and what the border between Python and Rust costs.

    pip install "./python[gym]" mujoco==3.17.0 && python python/bench.py [--json]

Times are processor time of this thread, so that others on the machine count little. Environments of Gymnasium that are not installed
are left out, and said so.
"""

import argparse
import json
import time

import gymnasium
import numpy as np

import proact  # noqa: F401 - it registers its environments

STEPS = 400
ROUNDS = 5
WARM_UP = 20

#: Beside ours: an arm of seven joints that pushes a cylinder, and, of like size as ours, an arm with a hand that carries a ball
#: (28 joints; pip install gymnasium-robotics).
PEERS = ["Pusher-v5", "AdroitHandRelocate-v1"]


def time_steps(env, steps):
    """Processor time of each step, seconds, and simulated time of a step."""
    env.reset(seed=1)
    env.action_space.seed(1)
    actions = [env.action_space.sample() for _ in range(steps)]
    for action in actions[:WARM_UP]:
        env.step(action)
    took = np.empty(steps)
    for index, action in enumerate(actions):
        began = time.thread_time_ns()
        _, _, terminated, truncated, _ = env.step(action)
        took[index] = (time.thread_time_ns() - began) * 1e-9
        if terminated or truncated:
            env.reset(seed=1)
    return took


def binding_overhead(env, steps):
    """What a step takes outside of the testbed, seconds: its own processor time less that of the testbed."""
    env.reset(seed=1)
    env.action_space.seed(1)
    actions = [env.action_space.sample() for _ in range(steps)]
    took = np.empty(steps)
    for index, action in enumerate(actions):
        began = time.thread_time_ns()
        env.step(action)
        took[index] = (time.thread_time_ns() - began) * 1e-9 - env._trial.step_secs
    return took


def figure(name, values, unit, scale, **more):
    quantile = {"median": np.median(values), "p99": np.quantile(values, 0.99), "worst": values.max()}
    return {"name": name, "unit": unit, **{key: float(value * scale) for key, value in quantile.items()}, **more}


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--json", action="store_true", help="one JSON object on standard output")
    json_asked = options.parse_args().json

    candidates = {
        "proact box and blocks, joint speeds (27 joints, 1 ms ticks)": (
            gymnasium.make("proact/ModifiedBoxAndBlocks-v0", action="joint_speed"),
            0.05,
            50,
        ),
        "proact reaching, end-effector speed (27 joints, 1 ms ticks)": (
            gymnasium.make("proact/Reaching-v0", action="end_effector_speed"),
            0.05,
            50,
        ),
    }
    left_out = []
    for name in PEERS:
        try:
            try:
                import gymnasium_robotics

                gymnasium.register_envs(gymnasium_robotics)
            except ImportError:
                pass
            env = gymnasium.make(name)
            model = env.unwrapped.model
            simulated = env.unwrapped.dt
            size = f"{model.nv} degrees of freedom, {model.opt.timestep * 1e3:g} ms ticks"
            candidates[f"MuJoCo {name} ({size})"] = (env, simulated, env.unwrapped.frame_skip)
        except (gymnasium.error.Error, ImportError, AttributeError) as error:
            left_out.append({"name": name, "why": str(error).splitlines()[0]})

    took = {name: [] for name in candidates}
    for _ in range(ROUNDS):  # In turns: what the machine does beside this falls on all.
        for name, (env, _, _) in candidates.items():
            took[name].append(time_steps(env, STEPS))
    figures = []
    for name, (_, simulated, ticks) in candidates.items():
        values = np.concatenate(took[name])
        more = {
            "simulated_secs_per_step": simulated,
            "us_per_tick": float(np.median(values) * 1e6 / ticks),
            "steps_per_second": float(1 / values.mean()),
            "simulated_secs_per_second": float(simulated / values.mean()),
        }
        figures.append(figure(name, values, "us a step", 1e6, **more))
    env = candidates["proact box and blocks, joint speeds (27 joints, 1 ms ticks)"][0].unwrapped
    crossing = np.concatenate([binding_overhead(env, STEPS) for _ in range(ROUNDS)])
    figures.append(figure("border between Python and Rust", crossing, "us a step", 1e6))

    if json_asked:
        print(json.dumps({"stage": "python", "figures": figures, "left_out": left_out}))
        return
    print(f"{'':62} median   99 %  worst  us a step | us a tick  steps/s  simulated s/s")
    for row in figures:
        rates = ""
        if "steps_per_second" in row:
            rates = f"{row['us_per_tick']:9.1f} {row['steps_per_second']:8.0f} {row['simulated_secs_per_second']:14.0f}"
        print(f"{row['name']:62} {row['median']:6.1f} {row['p99']:6.1f} {row['worst']:6.1f}            {rates}")
    for row in left_out:
        print(f"left out: {row['name']}: {row['why']}")


if __name__ == "__main__":
    main()
