"""Recorded trials as arrays and tables: what they hold is what the trial did."""

import json

import numpy as np
import pytest

import proact


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    """Three seconds of a simulated participant with method B, and its result."""
    place = tmp_path_factory.mktemp("record") / "trial"
    return place, proact.run_trial("B", seed=4, limit_secs=3.0, record=place)


def test_arrays_have_the_shapes_that_they_are_said_to_have(trial):
    place, result = trial
    record = proact.load(place)
    samples, joints, objects = len(record.times), len(record.joint_names), len(record.object_names)
    assert (samples, joints, objects) == (301, 27, 4)
    assert record.times[0] == 0.0 and record.times[-1] == 3.0
    for name in ("position", "velocity", "effort", "target"):
        assert getattr(record, name).shape == (samples, joints), name
    assert record.tip.shape == record.base.shape == (samples, 7)
    assert record.object_poses.shape == (samples, objects, 7)
    assert record.object_velocities.shape == (samples, objects, 6)
    assert record.gaze_direction.shape[1] == 3 and record.emg_samples.shape[1] == 8
    # 1 kHz, with a sample at both ends.
    assert np.array_equal(record.emg_counter, np.arange(3001))
    assert record.agrees and record.digest == result["digest"] == record.result["digest"]
    assert np.allclose(np.linalg.norm(record.tip[:, 3:], axis=1), 1.0)


def test_speeds_are_those_of_the_angles_and_the_tip_is_where_kinematics_say(trial):
    record = proact.load(trial[0], rate_hz=1000)
    turned = np.gradient(record.position, record.times, axis=0)
    # A central difference over two ticks: the rest is what the speed changes within them.
    assert np.abs(turned - record.velocity)[5:-5].max() < 0.05
    assert np.abs(record.velocity[:, :7]).max() > 0.05, "the arm moved"
    arm = proact.Arm("mpl_right")
    for sample in (0, 1500, 3000):
        base = proact.parts.pose_matrix({"translation": record.base[sample, :3], "rotation": record.base[sample, 3:]})
        tip = base @ arm.forward(record.position[sample, :7])
        assert np.allclose(tip[:3, 3], record.tip[sample, :3], atol=1e-9)


def test_tables_say_the_same_as_arrays(trial):
    record = proact.load(trial[0])
    assert record.joints["position"].shape == (301, 27) and record.joints.index.name == "time_secs"
    elbow = [name for name in record.joint_names if name.endswith("elbow")][0]
    column = record.joint_names.index(elbow)
    assert np.array_equal(record.joints["velocity", elbow], record.velocity[:, column])
    assert list(record.objects["red1"].columns) == ["x", "y", "z", "qx", "qy", "qz", "qw"]
    assert set(record.course["gesture"]) <= set(proact.GESTURES)
    assert list(record.emg.columns) == ["counter", *(f"channel_{k}" for k in range(8))]
    assert len(record.gaze) == len(record.gaze_times) > 150
    changes = record.events[record.events["event"] == "gesture_changed"]
    assert len(changes) > 0 and set(changes["gesture"]) <= set(proact.GESTURES)
    # What an event says of the gesture is what the course has from then on.
    time, gesture = changes.index[0], changes["gesture"].iloc[0]
    assert record.course["gesture"].loc[np.ceil(time * 100) / 100] == gesture


def test_a_record_that_was_changed_is_refused(trial, tmp_path):
    import shutil

    place = shutil.copytree(trial[0], tmp_path / "trial")
    result = json.loads((place / "result.json").read_text())
    result["digest"] = "0" * 64
    (place / "result.json").write_text(json.dumps(result))
    with pytest.raises(ValueError, match="result"):
        proact.load(place)


@pytest.mark.parametrize("rate", [0, -1, 3, 2000, 0.5])
def test_rates_that_ticks_do_not_have_are_refused(trial, rate):
    with pytest.raises(ValueError, match="expected 1000 divided by a whole number"):
        proact.load(trial[0], rate_hz=rate)


def test_a_folder_that_is_no_record_is_refused(tmp_path):
    with pytest.raises(ValueError, match=str(tmp_path)):
        proact.load(tmp_path)
    with pytest.raises(ValueError, match="has no table 'scores'; it has none"):
        proact.load_table(tmp_path, "scores")
