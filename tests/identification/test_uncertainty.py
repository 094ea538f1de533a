"""Uncertainties of identified parameters, loads by difference, and logs to test on."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.effects import torques_of_everything
from tests.support.recorded import motion

pytestmark = [
    pytest.mark.slow,
    pytest.mark.usefixtures("shortened"),
]

LOAD = pa.Payload(2.805, (0.01, -0.02, 0.09), (0.006, 0.0, 0.006, 0.0, 0.0, 0.004))


@cache
def arm(loaded=False):
    """Return an arm that differs from its description in bodies and friction."""
    described = catalogue_robot("ur5")
    rng = np.random.default_rng(100)
    friction = pa.Friction(
        rng.uniform(0.3, 2.0, 6),
        rng.uniform(0.3, 2.0, 6),
        breakaway=rng.uniform(0.6, 1.4, 6),
        offset=rng.normal(0.0, 0.5, 6),
        gear_friction=[0.0, 0.1, 0.1, 0.0, 0.0, 0.0],
    )
    scale = dict(zip(described.joint_names, rng.uniform(0.8, 1.3, 6).tolist(), strict=True))
    return described.changed(
        inertial_scale=scale, friction=friction, payload=LOAD if loaded else None
    )


@cache
def log_of_arm(seed, loaded=False):
    """Return a log with errors that last: ripple of the gears, and torques that wander for 1 s."""
    true = arm(loaded)
    rng = np.random.default_rng(seed)
    t, q, v, a = motion("ur5", duration=9.0, dt=12e-3, seed=seed)
    tau = torques_of_everything(true, q, v, a)
    tau += 0.3 * np.sin(7.0 * q + rng.uniform(0.0, 6.0, 6))
    wander = np.zeros(6)
    for k in range(len(t)):
        wander += -12e-3 * wander + 0.3 * np.sqrt(2.0 * 12e-3) * rng.standard_normal(6)
        tau[k] += wander
    tau += 0.3 * rng.standard_normal(tau.shape)
    return pa.Log(t, q, tau, v, tuple(true.joint_names), source=f"log {seed}")


@cache
def identified(seed):
    """Return what is identified from a log, the first one tested on the third."""
    test = () if seed else log_of_arm(2)
    return pa.identify(log_of_arm(seed), catalogue_robot("ur5"), test=test)


def test_two_logs_of_an_arm_agree_within_their_uncertainties():
    """They match the true errors too: errors last for seconds, so rows are far from independent."""
    near = []
    right = []
    for one, other in ((0, 1), (1, 0)):
        parts = [identified(seed).dynamic for seed in (one, other)]
        names = [name for name in parts[0].names if name in parts[1].names]
        picked = [[part.names.index(name) for name in names] for part in parts]
        estimates, deviations = (
            np.array([getattr(p, what)[i] for p, i in zip(parts, picked, strict=True)])
            for what in ("estimate", "deviations")
        )
        known = np.isfinite(deviations).all(axis=0)
        assert np.count_nonzero(known) > 15
        away = np.abs(estimates[0] - estimates[1])[known]
        near += (away < 2.0 * deviations[:, known].min(axis=0)).tolist()
        dynamics = identified(one).controller.dynamics.inertial
        truth = dynamics.value(arm().changed(armature=0.0, friction=pa.Friction()))
        own = parts[0].deviations[: truth.size]
        off = np.abs(parts[0].estimate[: truth.size] - truth)
        right += (off < 2.0 * own)[np.isfinite(own)].tolist()
    assert np.mean(near) > 0.85 and np.mean(right) > 0.9


def test_the_load_is_the_difference_to_a_log_of_the_empty_arm():
    found = pa.identify(log_of_arm(5, loaded=True), catalogue_robot("ur5"), empty=log_of_arm(0))
    load = found.payload()
    assert load.mass == pytest.approx(LOAD.mass, abs=0.15)
    assert abs(load.mass - LOAD.mass) < 2.5 * load.mass_known_to
    assert load.mass_known_to < 0.3
    assert np.abs(load.com - LOAD.com).max() < 0.02
    known = np.isfinite(load.com_known_to)
    assert (np.abs(load.com - LOAD.com) < 3.0 * load.com_known_to)[known].all()
    assert found.summary()["payload"]["mass"] == load.mass


def test_the_uncertainty_of_a_load_covers_wrong_torque_gains():
    gains = np.random.default_rng(100).normal(1.0, 0.08, 6)
    loaded, empty = (
        replace(log, tau=log.tau * gains) for log in (log_of_arm(5, loaded=True), log_of_arm(20))
    )
    unknown = pa.Unknown(friction=True, armature=False)
    robot = catalogue_robot("ur5")
    found = pa.identify(loaded, robot, empty=empty, unknown=unknown)
    load = found.payload()
    assert abs(load.mass - LOAD.mass) < 2.0 * load.mass_known_to
    assert load.mass_known_to > 0.03 * LOAD.mass  # without gains: 2 %
