"""The rest posture of redundant joints: where it pulls, how fast, and what may be given."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot, random_state
from tests.support.differences import derivative

ROBOTS = ["panda", "kinova", "ur5"]  # kinova's continuous joints have no limits


def limited(robot):
    """Return which joints have limits, and the limits (2, n) of the angles."""
    low, high = np.full((2, robot.model.nv), [[-np.inf], [np.inf]])
    for i, joint in enumerate(robot.model.joints[1:]):
        if joint.nq == 1:
            low[i] = robot.model.lowerPositionLimit[joint.idx_q]
            high[i] = robot.model.upperPositionLimit[joint.idx_q]
    return high - low < 12.5, low, high  # two turns are no limit


@pytest.mark.parametrize("name", ROBOTS)
def test_far_from_limits_the_offset_is_the_way_from_rest(name):
    robot = catalogue_robot(name)
    posture, rng = pa.laws.Posture(robot), np.random.default_rng(0)
    assert not posture.offset(robot.q0).any()
    way = 1e-2 * rng.standard_normal(robot.model.nv)
    q = pin.integrate(robot.model, robot.q0, way)
    assert np.allclose(posture.offset(q), way, atol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_offset_pushes_away_from_limits(name):
    """At a limit it is the way and twice the margin more, which grows from nothing inside of it."""
    robot = catalogue_robot(name)
    posture, rest = pa.laws.Posture(robot), robot.home_angles
    there, low, high = limited(robot)
    assert there.any() and (name != "kinova" or not there.all())
    for i in np.flatnonzero(there):
        for limit in (low[i], high[i]):
            margin = min(0.1 * (high[i] - low[i]), 0.5 * min(rest[i] - low[i], high[i] - rest[i]))
            for share, more in ((1.0, 2.0 * margin), (0.5, 0.5 * margin), (0.0, 0.0), (-1.0, 0.0)):
                angles, outwards = rest.copy(), np.sign(limit - rest[i])
                angles[i] = limit - (1.0 - share) * margin * outwards
                expected = np.zeros(rest.size)
                expected[i] = angles[i] - rest[i] + outwards * more
                assert np.allclose(posture.offset(robot.at(angles).q0), expected, atol=1e-9)


@pytest.mark.parametrize("name", ["panda", "kinova"])
def test_the_rate_of_the_null_motion_is_its_derivative(name):
    robot = catalogue_robot(name)
    controller, rng = pa.make_controller(robot), np.random.default_rng(1)
    posture, pushed = controller.law.posture, 0

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

        Seen.q, Seen.v = q, v
        motion, rate = posture.null_motion_unchecked(Seen)
        assert np.allclose(motion, psi(0.0), atol=1e-12)
        assert np.allclose(rate, derivative(psi), atol=1e-6)
        plain = pin.difference(robot.model, robot.q0, q)
        pushed += not np.allclose(posture.offset(q), plain)
    assert pushed > 3


def test_a_continuous_joint_goes_the_short_way():
    robot = catalogue_robot("kinova")
    there, _, _ = limited(robot)
    i = np.flatnonzero(~there)[0]
    way = np.zeros(robot.model.nv)
    way[i] = 2 * np.pi - 0.3
    q = pin.integrate(robot.model, robot.q0, way)
    assert pa.laws.Posture(robot).offset(q)[i] == pytest.approx(-0.3, abs=1e-9)


@pytest.mark.parametrize("law", ["separation", "adaptive-inverse-dynamics", "adaptive-jacobian"])
def test_the_frequency_is_half_of_the_bandwidth_and_home_is_rest(law):
    robot = catalogue_robot("panda")
    controller = pa.make_controller(robot, law=law, dt=1e-4)
    posture = controller.law.posture
    rate = 0.25 if law == "adaptive-jacobian" else 1.0  # of the task error, in bandwidths
    assert posture.frequency == pytest.approx(0.5 * rate * controller.motion.bandwidth)
    assert np.array_equal(posture.offset(robot.q0), np.zeros(7))
    M = pin.crba(robot.model, robot.model.createData(), robot.q0)
    assert np.allclose(posture.damping, posture.frequency * np.diag(M))


def test_a_slowed_feedback_has_a_slowed_posture():
    """A long period reduces the bandwidth of both by the same share."""
    robot = catalogue_robot("xarm7", task="pose")
    laws = [pa.make_controller(robot, law="adaptive-jacobian", dt=dt).law for dt in (1e-3, 1e-4)]
    ratios = [laws[0].alpha / laws[1].alpha, laws[0].posture.frequency / laws[1].posture.frequency]
    assert ratios[0] < 0.8 and np.isclose(*ratios)


REST = [0.3, -0.5, 0.2, -2.0, 0.1, 1.8, 0.9]


@pytest.mark.parametrize(
    ("given", "rest", "frequency"),
    [
        (REST, REST, None),
        (np.array(REST), REST, None),
        (6.0, None, 6.0),
        ({"rest": REST}, REST, None),
        ({"frequency": 6.0}, None, 6.0),
        ({"rest": REST, "frequency": 6.0}, REST, 6.0),
    ],
    ids=str,
)
def test_a_user_may_give_rest_pose_and_rate(given, rest, frequency):
    robot = catalogue_robot("panda")
    default, posture = (
        pa.make_controller(robot, law="adaptive-inverse-dynamics", posture=each).law.posture
        for each in (None, given)
    )
    assert posture.frequency == (default.frequency if frequency is None else frequency)
    at = robot.q0 if rest is None else np.array(rest)
    assert not posture.offset(at).any()
    assert rest is None or posture.offset(robot.q0).all()


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


@pytest.mark.parametrize(
    ("given", "kind", "words"),
    [
        ({"rets": REST}, pa.GainError, r"no 'rets'.*Did you mean 'rest'"),
        ({"frequency": -1.0}, pa.GainError, "posture frequency"),
        (0.0, pa.GainError, "posture frequency"),
        ([0.0, 1.0], pa.InputError, "rest: expected 7 numbers"),
        ({"rest": [np.nan] * 7}, pa.InputError, "rest"),
    ],
    ids=str,
)
def test_an_invalid_posture_is_refused_by_name(given, kind, words):
    with pytest.raises(kind, match=words):
        pa.make_controller(catalogue_robot("panda"), posture=given)
