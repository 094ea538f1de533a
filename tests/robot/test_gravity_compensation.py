"""Arms that compensate gravity by themselves."""

from functools import partial

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot as load
from tests.support.loops import motion_at_home, with_tool_and_load


def loops(
    robot,
    true,
    compensated,
    *,
    limits=False,
    law="adaptive-inverse-dynamics",
):
    """Return a plain run, and one whose arm adds a torque that the controller subtracts."""
    make = partial(pa.make_controller, robot, law=law)
    engine = pa.Engine(torque_limits=limits)
    simulate = partial(pa.simulate, engine=engine, duration=0.1)
    path = motion_at_home(robot)
    plain = simulate(true, make(), path)
    return plain, simulate(true, make(compensated=compensated), path)


def check_alike(plain, own):
    """Check that joints saw the same torques and moved alike."""
    assert np.allclose(own.tau, plain.tau, rtol=0.0, atol=1e-9 * np.abs(plain.tau).max())
    assert np.allclose(own.q, plain.q, atol=1e-9) and np.allclose(own.a_d, plain.a_d, atol=1e-6)
    assert np.array_equal(own.saturated, plain.saturated)


@pytest.mark.parametrize(
    ("task", "law"), [("xyz", "adaptive-inverse-dynamics"), ("joint", "separation")]
)
def test_the_joint_torque_is_the_same_with_and_without_compensation(task, law):
    robot = pa.load("panda", task=task)
    true = robot.changed(payload=pa.Payload(1.5), viscous=0.2)
    check_alike(*loops(robot, true, "nominal", law=law))


def test_motors_limit_the_sum_of_command_and_compensation():
    """The limits are those of the joints: with compensation and without, they bind alike."""
    robot = load("ur5")
    free, _ = loops(robot, with_tool_and_load(robot), "nominal")
    weak = with_tool_and_load(robot)
    weak.model.effortLimit = np.quantile(np.abs(free.tau), 0.9, axis=0)
    plain, own = loops(robot, weak, "nominal", limits=True)
    assert plain.saturated.any() and not plain.saturated.all()
    check_alike(plain, own)
    assert (np.abs(own.tau) <= weak.model.effortLimit).all()
