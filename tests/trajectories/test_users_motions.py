"""Motions given by users: objects with at(t), functions of time, and samples."""

import math
import re

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.tasks.frame import TASKS
from pinadapt.tasks.task import JointTask
from pinadapt.trajectories import Function, as_trajectory
from tests.support.chains import catalogue_robot
from tests.support.differences import derivative

XYZ, POSE = TASKS["xyz"], TASKS["pose"]
CIRCLE = pa.trajectories.Circle([0.5, 0.1, 0.4], 0.1, 3.0, plane="yz")
SWING = pa.trajectories.Swing([1.0, 2.0, -0.5], 0.7, 1.3, 0.4, quaternion=[0.6, 0.0, 0.8, 0.0])
MOVING_POSE = pa.trajectories.PoseTrajectory(CIRCLE, SWING)


class Path:
    """A class of a user that does not depend on the library."""

    def __init__(self, motion):
        self._motion = motion

    def at(self, t):
        return tuple(self._motion.at(t))


# --- functions ---


def test_errors_of_finite_differences_agree_with_the_docstring():
    """Of sines of several frequencies, after the start and at it; in units of w and w^2."""
    rows = re.findall(r"(\d+) Hz +(\S+), (\S+) +(\S+), (\S+)", Function.__doc__)
    assert len(rows) == 3
    phases = np.linspace(0.0, math.pi, 50)
    for row in rows:
        frequency, *stated = (float(number) for number in row)
        w = 2.0 * math.pi * frequency
        found = []
        motion = Function(lambda t, w=w: np.sin(w * t + phases))
        for times in (np.linspace(0.004, 3.0, 301), np.linspace(0.0, 0.00399, 40)):
            at = [(motion.at(float(t)), w * t + phases) for t in times]
            found.append(max(np.abs(now.xd_d / w - np.cos(x)).max() for now, x in at))
            found.append(max(np.abs(now.xdd_d / w**2 + np.sin(x)).max() for now, x in at))
        for error, bound in zip(found, stated, strict=True):
            assert 0.5 * bound < error <= bound


@pytest.mark.parametrize("returns", [tuple, list, pa.Desired._make, np.array])
def test_a_function_may_return_its_derivatives(returns):
    motion = as_trajectory(lambda t: returns(CIRCLE.at(t)), XYZ)
    for t in (0.0, 0.003, 0.4, 2.7):
        assert all(np.array_equal(*pair) for pair in zip(motion.at(t), CIRCLE.at(t), strict=True))


def flipped(x, t):
    """Return a pose whose quaternion often changes its sign."""
    return np.append(x[:3], x[3:] if int(100 * t) % 2 else -x[3:])


def as_se3(x, _):
    return pin.XYZQUATToSE3(x)


@pytest.mark.parametrize("returns", [lambda x, t: x, flipped, as_se3])
@pytest.mark.parametrize("t", [0.0, 0.399, 0.4, 2.7])
def test_poses_are_differentiated_as_rotations(returns, t):
    now = as_trajectory(lambda t: returns(MOVING_POSE.at(t).x_d, t), POSE).at(t)
    exact = MOVING_POSE.at(t)
    assert np.allclose(POSE.error(now.x_d, exact.x_d), 0.0, atol=1e-12)
    assert np.allclose(now.xd_d, exact.xd_d, atol=1e-7 if t else 1e-6)
    assert np.allclose(now.xdd_d, exact.xdd_d, atol=1e-6 if t else 1e-3)


def test_angles_of_continuous_joints_may_jump_by_whole_turns():
    task = JointTask("joint", ("a", "b"), (True, False), (0, 2), (0, 1), (False, False))
    turning = pa.trajectories.Sinusoid([3.0, 0.0], [1.0, 1.0], 2.0)

    def wrapped(t):
        x = turning.at(t).x_d
        return np.array([math.remainder(x[0], 2.0 * math.pi), x[1]])

    times = np.linspace(0.0, 2.0, 201)
    jumps = np.abs(np.diff([wrapped(t)[0] for t in times])).max()
    assert jumps > 6.0
    far = [[0.0, 0.0], [7.0, 0.0]]  # more than a turn
    assert as_trajectory(([0.0, 6.0], far), task).at(6.0).x_d[0] == 7.0
    samples = as_trajectory((times, [wrapped(t) for t in times]), task)
    for t in np.linspace(0.1, 1.9, 50):
        now = as_trajectory(wrapped, task).at(t)
        assert np.allclose(now.xd_d, turning.at(t).xd_d, atol=1e-8)
        assert np.allclose(samples.at(t).xd_d, turning.at(t).xd_d, atol=1e-5)


# --- samples ---


UNEVEN = np.array([0.0, 0.3, 0.4, 1.1, 1.5, 2.5, 2.6])
POINTS = np.random.default_rng(1).uniform(-0.3, 0.3, (7, 3))


@pytest.mark.parametrize("given", [(UNEVEN, POINTS), np.column_stack([UNEVEN, POINTS])])
def test_splines_pass_through_the_samples_smoothly_and_are_at_rest_at_the_ends(given):
    motion = as_trajectory(given, XYZ)
    for t, x in zip(UNEVEN, POINTS, strict=True):
        assert np.allclose(motion.at(t).x_d, x, atol=1e-12)
    for t in (*np.linspace(0.01, 2.59, 40), *UNEVEN[1:-1]):
        now = motion.at(t)
        assert np.allclose(now.xd_d, derivative(lambda h, t=t: motion.at(t + h).x_d), atol=1e-8)
        assert np.allclose(now.xdd_d, derivative(lambda h, t=t: motion.at(t + h).xd_d), atol=1e-6)
    for t, x in ((-1.0, POINTS[0]), (0.0, POINTS[0]), (2.6, POINTS[-1]), (9.0, POINTS[-1])):
        now = motion.at(t)
        assert np.allclose(now.x_d, x, rtol=0.0, atol=1e-12)
        assert np.abs(now.xd_d).max() < 1e-10 and np.abs(now.xdd_d).max() < 1e-9
    assert motion.settles == 2.6
    assert motion.extent == pytest.approx(0.5 * np.linalg.norm(np.ptp(POINTS, axis=0)))


@pytest.mark.parametrize("signs", [1.0, np.resize([1.0, -1.0, -1.0], (301, 1))])
def test_sampled_poses_have_the_derivatives_of_the_sampled_motion(signs):
    t = np.linspace(0.0, 2.6, 301)
    x = MOVING_POSE.positions(t)
    x[:, 3:] *= signs
    motion = as_trajectory((t, x), POSE)
    for at in np.linspace(0.5, 2.0, 40):
        now = motion.at(at)
        exact = MOVING_POSE.at(at)
        assert np.allclose(POSE.error(now.x_d, exact.x_d), 0.0, atol=1e-9)
        assert np.allclose(now.xd_d, exact.xd_d, atol=1e-6)
        assert np.allclose(now.xdd_d, exact.xdd_d, atol=1e-3)
        assert np.linalg.norm(now.x_d[3:]) == pytest.approx(1.0, abs=1e-14)


class Own(pa.trajectories.Trajectory):
    """A user's subclass, which has ``at`` alone."""

    def __init__(self, motion):
        self._motion = motion

    def at(self, t):
        return self._motion.at(t)


@pytest.fixture(scope="module")
def loop():
    """Return robot, controller and a circle."""
    robot = catalogue_robot("planar_2r")
    circle = pa.trajectories.Circle(np.zeros(2), 0.1, 2.0).starting_at(robot.position(robot.q0))
    return (
        robot,
        pa.make_controller(robot.changed(inertial_scale=0.8), adaptation="natural"),
        circle,
    )


GIVEN = {
    "function": lambda circle: lambda t: circle.at(t).x_d,
    "object": Path,
    "subclass": Own,
}


def run_of(loop, path, mode):
    """Return a run of a path."""
    robot, controller, _ = loop
    continuous = mode == "continuous"
    duration = 0.3 if mode == "sampled" else 0.1
    engine = pa.Engine(dt=2e-3, continuous=continuous)
    return pa.simulate(robot, controller, path, duration=duration, engine=engine)


@pytest.fixture(scope="module", params=["sampled", "continuous"])
def as_circle(request, loop):
    """Return a mode, and the run of the circle as such."""
    return request.param, run_of(loop, loop[2], request.param)


@pytest.mark.parametrize("given", GIVEN.values(), ids=GIVEN.keys())
def test_a_run_is_the_same_however_its_motion_is_given(given, as_circle, loop):
    (mode, one), circle = as_circle, loop[2]
    other = run_of(loop, given(circle), mode)
    assert np.allclose(one.q, other.q, atol=1e-6) and np.ptp(one.q) > 1e-2
    assert np.allclose(one.a_d, other.a_d, atol=1e-4)
    moved = 0.5 * np.linalg.norm(np.ptp(one.x_d, axis=0))
    assert (one.extent, other.extent) == pytest.approx((moved, moved))


# --- what is refused, before anything moves ---

TWO = [[0.0, 0.0]] * 2
REFUSED = {
    "nothing": None,
    "a class": pa.trajectories.Circle,
    "one point": np.array([0.1, 0.2]),
    "three arrays": ([0.0, 1.0], TWO, TWO),
    "a function of two": lambda t, u: [0.0, 0.0],
    "a function that fails": lambda t: 1.0 / t,
    "no coordinates": lambda t: "here",
    "complex numbers": lambda t: np.array([1j, 0.0]),
    "too many": lambda t: [0.0] * 3,
    "too few": Own(pa.trajectories.Hold([0.1])),
    "ragged": lambda t: ([0.0, 0.0], [0.0], [0.0, 0.0]),
    "infinite speed": lambda t: ([0.0, 0.0], [np.inf, 0.0], [0.0, 0.0]),
    "sizes that vary": lambda t: [0.0] * (2 if t == 0.0 else 3),
    "unequal lengths": ([0.0, 1.0], [[0.0, 0.0]] * 3),
    "times back": ([0.0, 2.0, 1.0], [[0.0, 0.0]] * 3),
    "one time": ([0.0], [[0.0, 0.0]]),
    "positions nan": ([0.0, 1.0], [[0.0, 0.0], [np.nan, 0.0]]),
}


@pytest.mark.parametrize("given", REFUSED.values(), ids=REFUSED.keys())
def test_invalid_motions_raise_input_errors_before_the_run(given, loop):
    robot, controller, _ = loop
    plant = pa.plants.PinocchioPlant(robot)
    for start in (
        lambda: pa.simulate(robot, controller, given, duration=0.01),
        lambda: next(pa.run(plant, controller, given)),
        lambda: next(pa.simulation.run_continuous(plant, controller, given, dt=1e-3)),
    ):
        with pytest.raises(pa.InputError, match="trajectory"):
            start()


def test_a_point_of_a_pose_is_held_with_six_velocities():
    robot = catalogue_robot("panda", task="pose")
    point = robot.position(robot.q0)
    for given in (pa.trajectories.Hold(point), pa.trajectories.Hold()):
        x_d, xd_d, _ = pa.reference.starting_from(
            given, robot, pa.Measurement(0.0, robot.q0, np.zeros(7), point)
        ).at(0.3)
        assert np.allclose(x_d, point) and not xd_d.any() and xd_d.size == 6
    several = pa.trajectories.Waypoints([point, point], 1.0)
    with pytest.raises(pa.InputError, match=r"the task 'pose' have 6.*PoseTrajectory"):
        pa.trajectories.as_trajectory(several, robot.task)


@pytest.mark.parametrize("mode", ["sampled", "continuous"])
def test_a_function_that_fails_during_a_run_ends_it_with_the_rollout_so_far(mode, loop):
    robot, controller, circle = loop

    def f(t):
        return circle.at(t).x_d if t < 0.03 else {}["lost"]

    motion = pa.trajectories.as_trajectory(f, robot.task).as_given()
    engine = pa.Engine(continuous=mode == "continuous")
    rollout = pa.simulate(robot, controller, motion, duration=0.1, engine=engine)
    assert 0.02 < rollout.diverged <= 0.03 and "KeyError: 'lost'" in rollout.reason
