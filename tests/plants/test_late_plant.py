"""Motors that are late: the motion is that of the same torques, applied later."""

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot


def ending(plant, torques, dt):
    """Return q and v of a plant after torques (N, n), each commanded for dt [s]."""
    for torque in torques:
        plant.step(torque, dt)
    last = plant.measure()
    return np.concatenate([last.q, last.v, [last.t]])


@pytest.mark.parametrize(("delay", "whole"), [(0.0, 0), (3e-3, 3), (7e-3, 7)])
def test_torques_arrive_after_the_delay(delay, whole):
    robot, dt = catalogue_robot("ur5"), 1e-3
    torques = 5.0 * np.random.default_rng(0).standard_normal((30, 6))
    late = pa.plants.MotorDelay(delay)(robot)
    arrived = np.vstack([*[torques[:1]] * whole, torques])[: len(torques)]
    assert np.allclose(
        ending(late, torques, dt),
        ending(pa.plants.PinocchioPlant(robot), arrived, dt),
        rtol=1e-12,
        atol=1e-12,
    )


def test_a_delay_of_half_a_period_splits_it():
    robot, dt = catalogue_robot("ur5"), 2e-3
    torques = 5.0 * np.random.default_rng(0).standard_normal((10, 6))
    late = pa.plants.MotorDelay(1e-3)(robot)
    halves = np.repeat(torques, 2, axis=0)
    arrived = np.vstack([halves[:1], halves])[:20]
    assert np.allclose(
        ending(late, torques, dt), ending(pa.plants.PinocchioPlant(robot), arrived, 1e-3)
    )


def test_reset_forgets_torques_on_their_way_and_limits_hold():
    robot, dt = catalogue_robot("ur5"), 1e-3
    limited = {"torque_limits": np.full(6, 2.0)}
    plant = pa.plants.MotorDelay(2e-3)(robot, **limited)
    torques = 5.0 * np.random.default_rng(0).standard_normal((10, 6))
    first = ending(plant, torques, dt)
    plant.reset()
    assert np.array_equal(ending(plant, torques, dt), first)
    clipped = pa.plants.MotorDelay(2e-3)(robot)
    assert np.allclose(ending(clipped, np.clip(torques, -2.0, 2.0), dt), first)


def test_no_negative_delay():
    with pytest.raises(pa.InputError, match="delay"):
        pa.plants.MotorDelay(-1e-3)


@pytest.mark.parametrize("name", ["ur5", "z1"])
def test_a_memory_with_a_lag_bears_motors_that_are_ten_milliseconds_late(name):
    """Nobody declares it; without adaptation the error is more than ten times as large."""
    robot = catalogue_robot(name)
    path, last = pa.reachable_circle(robot), {}
    for adaptation in ("none", "natural-memory"):
        controller = pa.make_controller(
            robot.changed(inertial_scale=0.7), adaptation=adaptation, lag=0.01, dt=2e-3
        )
        rollout = pa.simulate(
            robot,
            controller,
            path.starting_at(robot.position(robot.q0)),
            duration=6.0,
            engine=pa.Engine(plant=pa.plants.MotorDelay(10e-3)),
        )
        assert rollout.diverged is None
        last[adaptation] = rollout.distance[-500:].max()
    assert last["natural-memory"] < 0.1 * last["none"], last
