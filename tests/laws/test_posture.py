"""The rest posture of redundant joints: where it pulls, how fast, and what may be given."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot, random_state
from tests.support.differences import derivative

ROBOTS = ["panda", "kinova"]  # kinova's continuous joints have no limits


def limited(robot):
    """Return which joints have limits, and the limits (2, n) of the angles."""
    low, high = np.full((2, robot.model.nv), [[-np.inf], [np.inf]])
    for i, joint in enumerate(robot.model.joints[1:]):
        if joint.nq == 1:
            low[i] = robot.model.lowerPositionLimit[joint.idx_q]
            high[i] = robot.model.upperPositionLimit[joint.idx_q]
    return high - low < 12.5, low, high  # two turns are no limit


@pytest.mark.parametrize("name", ROBOTS)
def test_the_offset_pushes_away_from_limits(name):
    """At a limit it is the way and twice the margin more, which grows from nothing inside of it."""
    robot = catalogue_robot(name)
    posture = pa.laws.Posture(robot)
    rest = robot.home_angles
    there, low, high = limited(robot)
    assert there.any() and (name != "kinova" or not there.all())
    for i in np.flatnonzero(there):
        for limit in (low[i], high[i]):
            margin = min(0.1 * (high[i] - low[i]), 0.5 * min(rest[i] - low[i], high[i] - rest[i]))
            for share, more in ((1.0, 2.0 * margin), (0.5, 0.5 * margin), (0.0, 0.0), (-1.0, 0.0)):
                angles = rest.copy()
                outwards = np.sign(limit - rest[i])
                angles[i] = limit - (1.0 - share) * margin * outwards
                expected = np.zeros(rest.size)
                expected[i] = angles[i] - rest[i] + outwards * more
                assert np.allclose(posture.offset(robot.at(angles).q0), expected, atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_rate_of_the_null_motion_is_its_derivative(name):
    robot = catalogue_robot(name)
    controller = pa.make_controller(robot)
    rng = np.random.default_rng(1)
    posture = controller.law.posture
    pushed = 0

    for _ in range(10):
        q, v, _ = random_state(robot, rng)
        q = pin.integrate(robot.model, robot.q0, rng.uniform(-2.5, 2.5, robot.model.nv))

        def psi(t, q=q, v=v):
            at = pin.integrate(robot.model, q, t * v)
            return -posture.frequency * posture.offset(at)

        class Seen:
            """The signals that the posture reads."""

            class inverse:
                unique = False

        Seen.q = q
        Seen.v = v
        motion, rate = posture.null_motion(Seen)
        assert np.allclose(motion, psi(0.0), atol=1e-12)
        assert np.allclose(rate, derivative(psi), atol=1e-6)
        plain = pin.difference(robot.model, robot.q0, q)
        pushed += not np.allclose(posture.offset(q), plain)
    assert pushed > 3


def test_the_arm_goes_to_the_rest_that_it_was_given():
    """The hand stays where it is, the elbow goes where the rest pose has it."""
    robot = catalogue_robot("panda")
    start = pa.trajectories.Hold(robot.position(robot.q0))
    rest = robot.home_angles + np.array([0.3, 0.0, -0.3, 0.0, 0.0, 0.0, 0.5])
    ends = []
    for posture in (None, rest):
        controller = pa.make_controller(robot, posture=posture, dt=4e-3)
        rollout = pa.simulate(robot, controller, start, duration=1.5)
        assert rollout.diverged is None and rollout.distance[-1] < 1e-3
        ends.append(rollout.q[-1])
    assert np.abs(ends[0] - robot.q0).max() < 1e-3
    assert np.linalg.norm(ends[1] - rest) < 0.6 * np.linalg.norm(ends[0] - rest)
    assert abs(ends[1][6] - rest[6]) < 0.05  # turning the hand does not move it
