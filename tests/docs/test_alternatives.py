"""The contenders of the comparison do what their names say, and its page has their results."""

import numpy as np
import pytest

import pinadapt as pa
from benchmarks.contenders import CONTENDERS, SENSORS, Setting
from tests.support.chains import catalogue_robot

OFFSET = np.array([0.0, 0.02, 0.03])  # [m] of the tool, in the frame's axes


def setting(true, nominal):
    return Setting(true, nominal, "yz", 0.0, 0.05, SENSORS["perfect"])


def hold(at, name, duration, **gains):
    """Return the rollout of a contender that holds the initial position of the true robot."""
    controller = CONTENDERS[name].make(at, **gains)
    path = pa.trajectories.Hold(at.true.position(at.true.q0))
    return pa.simulate(at.true, controller, path, duration=duration)


@pytest.fixture(scope="module")
def arm():
    return catalogue_robot("ur5")


@pytest.fixture(scope="module")
def loaded(arm):
    return arm.changed(payload=pa.Payload(2.0, [0.0, 0.0, 0.1]))


def test_pd_sags_by_the_unknown_load_over_its_stiffness(arm, loaded):
    at = setting(loaded, arm)
    rollout = hold(at, "PD + gravity", 1.0)
    missing = pa.robot.Gravity(loaded)(rollout.q[-1]) - pa.robot.Gravity(arm)(rollout.q[-1])
    assert rollout.q[-1] - arm.q0 == pytest.approx(-missing / (at.w * at.damping), abs=1e-6)
    assert np.abs(rollout.error[-1]).max() > 5e-4


def test_the_task_integral_removes_the_error_of_tool_and_load(arm, loaded):
    at = setting(loaded.changed(tool_translation=OFFSET), arm)
    integrated = hold(at, "PD + gravity, task integral", 0.9, k_x=0.5).error
    assert np.linalg.norm(integrated, axis=1).max() > 2e-3  # it sags at first
    assert np.linalg.norm(integrated[-1]) < 1e-4


def observed(at, duration):
    """Return the last signals of the law and the observed r (n) [N m], without integral."""
    controller = CONTENDERS["computed torque, observer, task integral"].make(at, k_o=1.0, k_x=0.0)
    plant = pa.plants.PinocchioPlant(at.true)
    path = pa.trajectories.Hold(at.true.position(at.true.q0))
    for sample in pa.run(plant, controller, path, duration=duration):
        last = sample
    s, _ = controller.command(last.state, last.measurement, last.desired)
    return s, controller.law.disturbance(s)


def test_the_observer_converges_to_the_torque_of_an_unknown_load(arm, loaded):
    s, r = observed(setting(loaded, arm), 1.0)
    assert np.abs(s.v).max() < 1e-4
    missing = pa.robot.Gravity(arm)(s.q) - pa.robot.Gravity(loaded)(s.q)
    assert np.abs(missing).max() > 5.0
    assert r == pytest.approx(missing, abs=1e-2)
