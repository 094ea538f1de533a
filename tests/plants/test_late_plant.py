"""Motors that are late: the motion is that of the same torques, applied later."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.robot.motors import LateTorque
from tests.support.chains import catalogue_robot


def ending(plant, torques, dt):
    """Return q and v of a plant after torques (N, n), each commanded for dt [s]."""
    for torque in torques:
        plant.step(torque, dt)
    last = plant.measure()
    return np.concatenate([last.q, last.v, [last.t]])


def test_every_joint_has_its_own_delay():
    """Joints with one delay move as their own torques arrive: checked against torques shifted."""
    robot = catalogue_robot("ur5")
    dt = 1e-3
    torques = 5.0 * np.random.default_rng(0).standard_normal((20, 6))
    delays = np.array([0.0, 2e-3, 0.0, 5e-3, 5e-3, 0.0])
    arrived = np.empty_like(torques)
    for joint, delay in enumerate(delays):
        whole = round(delay / dt)
        own = torques[:, joint]
        arrived[:, joint] = np.concatenate([np.full(whole, own[0]), own])[: len(torques)]
    late = pa.plants.PinocchioPlant(robot, actuators=pa.robot.Actuators(delay=delays))
    assert np.allclose(
        ending(late, torques, dt), ending(pa.plants.PinocchioPlant(robot), arrived, dt), rtol=1e-12
    )


@pytest.mark.parametrize("dt", [1e-3, 4e-3])
def test_a_bandwidth_is_a_first_order_low_pass(dt):
    """The pieces' means are the exact means of the low pass's output, at any period."""
    own = pa.robot.Actuators(bandwidth=[50.0, 200.0, *[np.inf] * 4])
    late = LateTorque(own.of(catalogue_robot("ur5")))
    rest = np.zeros(6)
    step = np.ones(6)
    at_rest, underway = late.after(None, rest, dt, 1e-3)
    assert all(np.array_equal(tau, rest) for tau, _ in at_rest)
    t = 0.0
    pieces = []
    again = underway
    for _ in range(5):
        more, underway = late.after(underway, step, dt, 1e-3)
        pieces += more
        mean, again = late.mean(again, step, dt)
        assert np.allclose(mean, sum(tau * h for tau, h in more) / dt, rtol=1e-12)
    for tau, h in pieces:
        assert h <= 1e-3 * (1.0 + 1e-6)
        for joint, a in enumerate((50.0, 200.0)):
            mean = 1.0 - (np.exp(-a * t) - np.exp(-a * (t + h))) / (a * h)
            assert tau[joint] == pytest.approx(mean, rel=1e-12)
        assert tau[2] == 1.0
        t += h
    assert t == pytest.approx(5.0 * dt)
