"""What a run shows of its estimates: predicted torques, and what the motion identifies."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.information.information import GrowingTorques
from tests.support.chains import catalogue_robot
from tests.support.loops import run

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("blank_pictures")]


@pytest.fixture(scope="module")
def rollout():
    """Return a run of a UR5 that learns: 30 % of the inertias are missing at first."""
    return run(
        "ur5",
        truth={"inertial_scale": 1.4},
        control={"adaptation": "natural-memory", "dt": 4e-3},
        duration=2.5,
    )


def test_errors_of_the_torques_are_those_of_the_estimates(rollout):
    """At every sample with the truth's accelerations, and not only at some of them."""
    found, evaluation = rollout.prediction, rollout.evaluated()
    dynamics = evaluation.controller.dynamics
    t, v = rollout.t, rollout.v
    a = np.gradient(v, t, axis=0)
    Y = [dynamics.regressor(*state) for state in zip(rollout.q, v, a, strict=True)]
    missed = np.array(Y)[2:-2] @ (np.array([rollout.a_d[0], rollout.a_d[-1]]) - rollout.a_d_true).T
    exact = np.sqrt(np.mean(missed**2, axis=(0, 1)))
    assert found.error_first == pytest.approx(exact[0], rel=0.02)
    assert found.error_last == pytest.approx(exact[1], rel=0.1, abs=1e-3 * found.rms)
    assert found.share_last < 0.05 * found.share_first
    assert found.identifiable_error < 0.3


def test_table_verdict_and_summary_say_what_the_motion_identifies(rollout, tmp_path):
    rollout.save(tmp_path)
    assert pa.Rollout.load(tmp_path).prediction == rollout.prediction
    numbers = json.loads((tmp_path / "summary.json").read_text())["torque_prediction"]
    assert numbers["share_last"] == pytest.approx(numbers["error_last"] / numbers["rms"])
    assert 3 < numbers["identifiable"] < len(rollout.dynamic_names) / 2
    assert "shoulder_pan_joint.m" in numbers["not_excited"]
    assert "wrist_2_joint.mcx" not in numbers["not_excited"]
    assert "torques predicted to" in rollout.verdict and "at first 4" in rollout.verdict
    text = str(rollout)
    assert "not excited by this motion" in text and "bodies of shoulder_pan_joint" in text
    assert f"{numbers['identifiable']} combinations of 78 parameters" in text


def test_only_the_motion_since_the_last_change_is_predicted():
    """The estimates are right for the heavy arm, and wrong for the light one at the end."""
    light = catalogue_robot("planar_2r").changed(inertial_scale=0.8)
    events = pa.Events(changes={0.5: light})
    fixed = {"adaptation": "none", "unknown": pa.Unknown(friction=False, armature=False)}
    changed = run("planar_2r", control=fixed, duration=1.0, events=events)
    assert changed.prediction.share_first < 1e-3
    assert run("planar_2r", control=fixed).prediction.share_first > 0.05


def test_without_estimates_or_samples_there_is_no_prediction(rollout):
    known = pa.Unknown(bodies="none", friction=False, armature=False)
    perfect = run("ur5", control={"unknown": known}, duration=0.05)
    assert perfect.prediction is None and "predicted torque" not in str(perfect)
    assert perfect.summary()["torque_prediction"] is None
    assert replace(rollout, evaluation=None).prediction is None
    copied = pickle.loads(pickle.dumps(rollout))
    assert copied.prediction == rollout.prediction


def test_noisy_sensors_predict_averages():
    """Differences of a count of the encoder are 60 rad/s^2; unsmoothed they would be all."""
    sensors = pa.Sensors(encoder=2.0 * np.pi / 2**14)
    options = {"name": "ur5", "truth": {"inertial_scale": 1.4}, "duration": 2.0}
    rollout = run(**options, control={"dt": 4e-3, "sensors": sensors}, sensors=sensors)
    first, last = rollout.prediction.share_first, rollout.prediction.share_last
    assert first == pytest.approx(
        run(**options, control={"dt": 4e-3}).prediction.share_first, rel=0.1
    )
    assert last < 0.3 * first


def test_a_motion_that_goes_on_has_the_same_torques_in_the_end(rollout):
    """From every eighth sample, 32 ms apart, with the mean torque in between."""
    evaluation, found = rollout.evaluated(), rollout.motion_torques()
    samples, start = evaluation.samples, rollout.a_d[0]
    growing = GrowingTorques(evaluation.controller, start)
    assert growing.share(start) is None and growing.left(start, rollout.a_d_true) is None
    for k in range(0, len(samples) - 8, 8):
        torque = np.mean([sample.torque for sample in samples[k : k + 8]], axis=0)
        growing.add(samples[k], samples[k + 8], torque)
    assert growing.share(start) == pytest.approx(found.share(start), rel=0.05)
    last = rollout.a_d[-1]
    assert growing.share(last) == pytest.approx(found.share(last), rel=0.3, abs=0.01)
    truth = rollout.a_d_true
    assert growing.left(last, truth) == pytest.approx(found.left(last, truth), rel=0.3)
