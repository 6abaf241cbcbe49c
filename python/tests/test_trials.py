"""Trials with methods, intent models, participants and classifiers in Python: those that work, and those that fail in every way."""

import json
import threading

import numpy as np
import pytest

import proact


class Elbow(proact.ControlMethod):
    """WE bends the elbow, WF stretches it, HC and HO work the hand."""

    name = "elbow"

    def begin(self):
        self.gesture = None

    def step(self, seen):
        changed, self.gesture = seen.gesture != self.gesture, seen.gesture
        hand = {"hand_close": "close", "hand_open": "open"}.get(seen.gesture) if changed else None
        sign = {"wrist_extension": 1.0, "wrist_flexion": -1.0}.get(seen.gesture, 0.0)
        velocity = np.zeros(seen.measured.size)
        velocity[2] = 0.3 * sign
        return proact.Command(velocity=velocity, hand=hand)


class Holds(proact.Participant):
    """Holds a gesture after a moment of rest, and keeps what was seen. Relaxes for 100 ms at ``relaxes``, s."""

    def __init__(self, gesture="wrist_extension", after=0.3, relaxes=None):
        self.gesture, self.after, self.relaxes = gesture, after, relaxes

    def begin(self):
        self.frames = []

    def step(self, frame):
        self.frames.append(frame)
        secs = frame["time"] / 1000
        rests = secs <= self.after or self.relaxes is not None and self.relaxes <= secs < self.relaxes + 0.1
        return proact.Intention(gesture="no_motion" if rests else self.gesture)


def run(method, participant=None, **how):
    how = {"setup": "still", "limit_secs": 3.0, "emg": None, **how}
    return proact.run_trial(method, participant=participant or Holds(), **how)


def moved(participant, start, end):
    """How far the elbow turned between two times, rad."""
    angles = {frame["time"]: frame["joints"][2] for frame in participant.frames}
    first, last = (min(angles, key=lambda at: abs(at - 1000 * secs)) for secs in (start, end))
    return angles[last] - angles[first]


def test_a_shipped_method_runs_as_by_the_command():
    result = proact.run_trial("D", seed=1, limit_secs=5.0)
    assert result["method"] == "D" and result["faults"] == [] and result["sim_seconds"] == 5.0
    assert result["digest"] == proact.run_trial("D", seed=1, limit_secs=5.0)["digest"]
    assert result["digest"] != proact.run_trial("D", seed=2, limit_secs=5.0)["digest"]


def test_a_method_in_python_moves_the_arm_and_its_record_is_replayed_without_it(tmp_path):
    person = Holds()
    result = run(Elbow(), person, record=tmp_path / "trial")
    assert result["method"] == "elbow" and result["faults"] == []
    assert moved(person, 1.0, 2.0) == pytest.approx(0.3, abs=0.02)
    found = proact.replay(tmp_path / "trial")
    assert found["agrees"] and found["digest"] == result["digest"]


def test_a_method_in_python_is_driven_by_the_simulated_participant_and_compared():
    table = proact.compare([Elbow(), "A"], seeds=[1, 2], limit_secs=4.0)
    assert list(table) == ["elbow", "A"]
    assert [summary["trials"] for summary in table.values()] == [2, 2]
    assert all(not result["faults"] for result in table["elbow"]["results"])
    with pytest.raises(ValueError, match="two methods are called 'elbow'"):
        proact.compare([Elbow(), Elbow()], seeds=[1], limit_secs=0.5)


class Fails(Elbow):
    """As Elbow until two seconds, then in a way of its own for half a second."""

    def __init__(self, how):
        self.how = how

    def step(self, seen):
        if 2000 <= seen.time_ms < 2500:
            return self.how(seen)
        return super().step(seen)


def raises(seen):
    return {}["what is not there"]


def gives_nan(seen):
    return proact.Command(velocity=np.full(seen.measured.size, np.nan))


def gives_another_shape(seen):
    return proact.Command(velocity=np.zeros(3))


def gives_something_else(seen):
    return [0.0] * 7


def gives_two_motions(seen):
    return proact.Command(velocity=np.zeros(seen.measured.size), hold=True)


def plans_for_no_object(seen):
    return proact.Command(plan={"goal": "pick", "object": 99, "centre": [0, 0, 0]})


def gives_up_the_interpreter(seen):
    raise SystemExit(3)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        (raises, "raised KeyError: 'what is not there' (line "),
        (gives_nan, "velocity is [nan"),
        (gives_another_shape, "velocity has shape (3,), expected (7,)"),
        (gives_something_else, "step gave list, expected proact.Command or None"),
        (gives_two_motions, "expected at most one"),
        (gives_up_the_interpreter, "raised SystemExit: 3"),
        (plans_for_no_object, "plan: got object 99, there are 4"),
    ],
)
def test_a_method_that_fails_stops_the_arm_says_why_and_goes_on_after_a_relaxed_hand(how, words, tmp_path):
    person = Holds(relaxes=2.7)
    result = run(Fails(how), person, record=tmp_path / "trial", limit_secs=4.0)
    # The arm needs a tenth of a second to stand still.
    assert abs(moved(person, 2.2, 2.7)) < 0.002, "it stands still, and does not start again by itself"
    assert moved(person, 1.0, 1.9) > 0.2 and moved(person, 2.9, 3.9) > 0.2, "it moves before and after"
    assert result["ended"] == "task", "it was back at the end"
    assert any(words in reason for reason in result["reasons"]), result["reasons"]
    shown = [frame["planner"].get("reason", "") for frame in person.frames if 2100 < frame["time"] < 2450]
    assert shown and all(words in reason for reason in shown)
    found = proact.replay(tmp_path / "trial")
    assert found["agrees"] and found["digest"] == result["digest"]


def test_a_method_that_takes_too_long_ends_the_trial_at_the_third_answer_and_the_trial_does_not_wait(tmp_path):
    over = threading.Event()

    def waits(seen):
        over.wait(60)
        return proact.Command(velocity=np.ones(seen.measured.size))

    person = Holds()
    result = run(Fails(waits), person, answer_timeout_secs=0.05, record=tmp_path / "trial", limit_secs=2.6)
    assert not over.is_set(), "it is still at it"
    over.set()
    assert result["sim_seconds"] == pytest.approx(2.02), "steps of 10 ms"
    assert result["ended"] == "failed" and "has missed 3 answers in a row" in result["trial_faults"][0]["reason"]
    assert result["faults"] == ["the Python method has not answered within 50 ms"]
    assert any("has not answered within 50 ms" in reason for reason in result["reasons"])
    assert json.loads((tmp_path / "trial" / "python_faults.json").read_text()) == result["faults"]
    assert proact.replay(tmp_path / "trial")["digest"] == result["digest"]


def test_a_method_that_never_returns_does_not_hold_the_trial_up():
    stop = []

    def loops(seen):
        while not stop:
            pass

    result = run(Fails(loops), answer_timeout_secs=0.02, limit_secs=2.2)
    stop.append(True)
    assert result["sim_seconds"] == pytest.approx(2.02) and result["ended"] == "failed"
    assert result["faults"] == ["the Python method has not answered within 20 ms"]


def test_a_participant_that_looks_and_acts_is_the_input_of_the_trial(tmp_path):
    class Looks(Holds):
        def step(self, frame):
            self.frames.append(frame)
            return proact.Intention(look_at=frame["objects"][2]["translation"])

    person = Looks()
    result = run("D", person, record=tmp_path / "trial")
    assert result["faults"] == []
    highlighted = [frame["target"]["object"] for frame in person.frames[60:]]
    # A straight look at a block wins over its neighbours, the task's order notwithstanding, nearly always.
    assert highlighted.count(2) > 0.9 * len(highlighted)
    assert proact.replay(tmp_path / "trial")["digest"] == result["digest"]


@pytest.mark.parametrize(
    ("how", "words"),
    [
        (lambda frame: 1 / 0, "raised ZeroDivisionError: division by zero"),
        (lambda frame: proact.Intention(gesture="fist"), "gesture is 'fist', expected one of hand_close"),
        (lambda frame: proact.Intention(look_at=[0, 0]), "look_at has shape (2,), expected (3,)"),
        (lambda frame: proact.Intention(lean=(np.nan, 0, 0)), "lean is [nan"),
        (lambda frame: "fist", "step gave str, expected proact.Intention"),
    ],
)
def test_a_participant_that_fails_lets_go_and_the_trial_goes_on(how, words, tmp_path):
    class Breaks(Holds):
        def step(self, frame):
            intention = super().step(frame)
            return how(frame) if frame["time"] > 1500 else intention

    person = Breaks()
    result = run(Elbow(), person, record=tmp_path / "trial")
    assert abs(moved(person, 0.8, 1.5)) > 0.1
    assert abs(moved(person, 2.0, 2.9)) < 0.002
    assert all(frame["stop"] is None for frame in person.frames if frame["time"] <= 1500)
    last = person.frames[-1]
    assert last["gesture"] == "no_motion"
    # The reason is what the page shows, and the arm goes on when the hand is relaxed after it is back.
    assert (last["stop"]["source"], last["stop"]["cause"]) == ("participant", "undecided")
    assert words in last["stop"]["reason"] and any(words in reason for reason in result["reasons"])
    assert any(words in fault for fault in result["faults"]), result["faults"]
    assert words in json.loads((tmp_path / "trial" / "python_faults.json").read_text())[0]
    assert proact.replay(tmp_path / "trial")["digest"] == result["digest"]


def test_a_participant_that_acts_again_moves_the_arm_again_once_the_hand_was_relaxed(tmp_path):
    class Stumbles(Holds):
        def step(self, frame):
            intention = super().step(frame)
            if 1500 < frame["time"] < 1700:
                raise OSError("its camera is gone")
            # It holds on for a while after it is back, and then does what it is told.
            relaxes = frame["time"] > 2100 and frame["stop"] is not None
            return proact.Intention() if relaxes else intention

    person = Stumbles()
    result = run(Elbow(), person, record=tmp_path / "trial")
    stopped = [frame["time"] for frame in person.frames if frame["stop"] is not None]
    assert stopped and 1500 < stopped[0] and 2100 < stopped[-1] < 2200, stopped
    assert abs(moved(person, 0.8, 1.5)) > 0.1
    assert abs(moved(person, 1.8, 2.1)) < 0.002
    assert person.frames[-1]["stop"] is None
    assert abs(moved(person, 2.5, 2.9)) > 0.1
    assert any("its camera is gone" in reason for reason in result["reasons"])
    assert proact.replay(tmp_path / "trial")["digest"] == result["digest"]


class NearestToGaze(proact.IntentModel):
    """The narrower the angle, the likelier; the task has its say."""

    def begin(self):
        self.looks = 0

    def infer(self, look):
        self.looks += 1
        return look.prior * np.exp(-0.5 * (look.angles() / 0.03) ** 2) if look.valid else None


def test_an_intent_model_in_python_is_driven_by_the_simulated_participant_and_replayed_without_it(tmp_path):
    model = NearestToGaze()
    result = proact.run_trial("D", seed=1, intent=model, record=tmp_path / "trial")
    assert result["faults"] == [] and result["score"] == 4 and model.looks > 1000
    assert "proact:python" in (tmp_path / "trial" / "config.toml").read_text()
    found = proact.replay(tmp_path / "trial")
    assert found["agrees"] and found["digest"] == result["digest"]
    table = proact.compare(["C", "D"], seeds=[1], limit_secs=5.0, intent=NearestToGaze())
    assert all(not result["faults"] for row in table.values() for result in row["results"])


class LooksAtThird(Holds):
    def step(self, frame):
        intention = super().step(frame)
        intention.look_at = frame["objects"][2]["translation"]
        return intention


def test_what_an_intent_model_says_is_what_is_highlighted_and_what_cannot_be_meant_does_not_count(tmp_path):
    class Stubborn(proact.IntentModel):
        def infer(self, look):
            likely = np.array([0.0, 5.0, 0.0, 0.0])
            return likely if look.time_ms < 1500 else np.zeros(4)

    person = LooksAtThird("no_motion")
    result = run("D", person, intent=Stubborn(), record=tmp_path / "trial")
    shown = {frame["time"]: frame["target"]["object"] for frame in person.frames}
    assert all(shown[at] == 1 for at in shown if 500 < at < 1500), "it says the second one"
    assert all(shown[at] is None for at in shown if at > 1600), "it says nothing any more"
    assert result["faults"] == [] and proact.replay(tmp_path / "trial")["digest"] == result["digest"]


@pytest.mark.parametrize(
    ("how", "words"),
    [
        (lambda look: 1 / 0, "raised ZeroDivisionError: division by zero"),
        (lambda look: np.full(4, np.nan), "infer is [nan"),
        (lambda look: [1.0, 2.0], "infer has shape (2,), expected (4,)"),
        (lambda look: [1.0, -2.0, 0.0, 0.0], "infer gave [1.0, -2.0, 0.0, 0.0], expected numbers from 0 up"),
        (lambda look: "the red one", "infer is 'the red one', expected numbers"),
        (lambda look: threading.Event().wait(0.4), "has not answered within 150 ms"),
    ],
)
def test_an_intent_model_that_fails_stops_the_arm_and_says_why(how, words, tmp_path):
    class Breaks(NearestToGaze):
        def infer(self, look):
            return how(look) if 1500 <= look.time_ms < 2500 else super().infer(look)

    class Drives(Elbow):
        needs_gaze = True

    person = LooksAtThird()
    timeout = {"answer_timeout_secs": 0.15} if "answered" in words else {}
    result = run(Drives(), person, intent=Breaks(), record=tmp_path / "trial", **timeout)
    assert moved(person, 0.8, 1.4) > 0.1, "it moves while all is well"
    assert abs(moved(person, 1.8, 2.9)) < 0.002, "and waits for a relaxed hand after that"
    during = [frame for frame in person.frames if 1700 < frame["time"] < 2400]
    assert all(words in frame["stop"]["reason"] and frame["stop"]["cause"] == "undecided" for frame in during)
    assert all(frame["target"]["object"] is None for frame in during)
    assert any(words in fault for fault in result["faults"]), result["faults"]
    found = proact.replay(tmp_path / "trial")
    assert found["agrees"] and found["digest"] == result["digest"]


class NearestMean(proact.Classifier):
    def fit(self, features, labels):
        self.scale = features.std(axis=0) + 1e-9
        self.classes_ = np.unique(labels)
        self.means = np.array([features[labels == name].mean(axis=0) for name in self.classes_])
        return self

    def predict_proba(self, features):
        away = (((features[:, None] - self.means) / self.scale) ** 2).sum(axis=-1)
        weights = np.exp(-0.5 * (away - away.min(axis=1, keepdims=True)))
        return weights / weights.sum(axis=1, keepdims=True)


def test_a_classifier_in_python_reads_the_muscles_of_a_trial(tmp_path):
    features, labels = proact.training_windows(seed=3)
    assert features.shape == (len(labels), 32) and set(labels) == set(proact.GESTURES)
    person = Holds("wrist_extension")
    result = run("A", person, emg="synthetic", classifier=NearestMean(), record=tmp_path / "trial")
    assert result["faults"] == []
    recognised = [frame["recognised"] for frame in person.frames if frame["time"] > 1000]
    assert recognised.count("wrist_extension") > 0.9 * len(recognised)
    found = proact.replay(tmp_path / "trial")
    assert found["agrees"] and found["digest"] == result["digest"]


@pytest.mark.parametrize(
    ("how", "words"),
    [
        (lambda shape: 1 / 0, "raised ZeroDivisionError"),
        (lambda shape: np.full(shape, np.nan), "predict_proba is [[nan"),
        (lambda shape: np.ones((1, 2)), "predict_proba has shape (1, 2), expected (1, 5)"),
        (lambda shape: np.ones(shape), "expected probabilities that sum to one"),
    ],
)
def test_a_classifier_that_fails_stops_the_arm_and_says_why(how, words, tmp_path):
    class Breaks(NearestMean):
        windows = 0

        def predict_proba(self, features):
            self.windows += 1
            right = super().predict_proba(features)
            return how(right.shape) if self.windows > 30 else right

    person = Holds("wrist_extension")
    result = run("A", person, emg="synthetic", classifier=Breaks(), record=tmp_path / "trial")
    assert abs(moved(person, 2.3, 2.9)) < 0.002
    assert any(words in reason for reason in result["reasons"]), result["reasons"]
    assert person.frames[-1]["stop"] is not None and words in person.frames[-1]["stop"]["reason"]
    assert proact.replay(tmp_path / "trial")["digest"] == result["digest"]


def test_a_classifier_that_takes_too_long_stops_the_arm(tmp_path):
    over = threading.Event()

    class Waits(NearestMean):
        windows = 0

        def predict_proba(self, features):
            self.windows += 1
            if self.windows > 30:
                over.wait(60)
            return super().predict_proba(features)

    person = Holds("wrist_extension")
    result = run("A", person, emg="synthetic", classifier=Waits(), answer_timeout_secs=0.2, record=tmp_path / "trial")
    over.set()
    assert abs(moved(person, 2.3, 2.9)) < 0.002
    assert result["faults"] == ["the Python classifier has not answered within 200 ms"]
    assert proact.replay(tmp_path / "trial")["digest"] == result["digest"]


def stamped(folder):
    """Recordings of noise with time stamps as the first column: five gestures, three repetitions of 3 s at 200 Hz."""
    random = np.random.default_rng(1)
    folder.mkdir()
    (folder / "metadata.json").write_text('{"rate_hz": 200}')
    for repetition in range(3):
        for gesture in range(5):
            stamps = 100.0 * (5 * repetition + gesture) + 0.005 * np.arange(600)
            rows = np.column_stack([stamps, np.round(random.normal(0, 5 + 10 * gesture, (600, 7)))])
            np.savetxt(folder / f"R_{repetition}_C_{gesture}.csv", rows, delimiter=",")
    return str(folder)


def test_recordings_with_faults_are_refused_unless_they_are_accepted_which_is_recorded(tmp_path):
    emg = stamped(tmp_path / "recordings")
    with pytest.raises(ValueError, match="channel 0 only rises"):
        proact.training_windows(emg)
    with pytest.raises(ValueError, match="channel 0 only rises"):
        proact.run_trial("A", emg=emg, limit_secs=1.0)
    features, labels = proact.training_windows(emg, accept_faults=True)
    assert len(features) == len(labels) > 0
    for how in ({}, {"classifier": NearestMean()}):
        record = tmp_path / f"trial-{len(how)}"
        result = proact.run_trial("A", emg=emg, limit_secs=1.0, accept_faults=True, record=record, **how)
        assert result["findings"][0]["fault"] == "time_stamps" and result["findings"][0]["makes_accuracy_wrong"]
        assert "channel 0 only rises" in result["accepted_faults"][0]
        assert "emg_accepted_faults" in (record / "config.toml").read_text()
    good = proact.run_trial("A", limit_secs=1.0)
    assert good["findings"] == [] and good["accepted_faults"] == []


def test_what_cannot_be_is_refused():
    with pytest.raises(TypeError, match="method is a int, expected a name or a proact.ControlMethod"):
        proact.run_trial(3)
    with pytest.raises(TypeError, match="intent is a str, expected a proact.IntentModel"):
        proact.run_trial("D", intent="filtered")
    with pytest.raises(ValueError, match="nobody gives gestures without it"):
        proact.run_trial("A", emg=None)
    with pytest.raises(ValueError, match="a classifier needs EMG"):
        proact.run_trial("A", emg=None, participant=Holds(), classifier=NearestMean())
    with pytest.raises(ValueError, match="answer_timeout_secs is 0"):
        run(Elbow(), answer_timeout_secs=0)
    with pytest.raises(ValueError, match="answer_timeout_secs is 0"), pytest.warns(DeprecationWarning, match="answer_timeout_secs"):
        run(Elbow(), **{"patience_secs": 0})
    with pytest.raises(TypeError, match="unexpected keyword argument 'wait_secs'"):
        run(Elbow(), wait_secs=1)
    with pytest.raises(ValueError, match="not a trial|no trial|cannot"):
        proact.replay("nowhere")


def test_a_name_that_a_method_cannot_have_is_refused():
    class Odd(Elbow):
        name = "two words"

    with pytest.raises(ValueError, match="two words"):
        run(Odd())
