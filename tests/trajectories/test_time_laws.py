"""Time laws: smooth starts, slowed motions, and motions taken as they are."""

import math

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.trajectories import SlowedTime
from tests.support.differences import derivative

CIRCLE = pa.trajectories.Circle([0.5, 0.1, 0.4], 0.1, 3.0, plane="yz", phase=0.4)
SWINGING = pa.trajectories.PoseTrajectory(
    CIRCLE, pa.trajectories.Swing([0.0, 1.0, 0.5], 0.3, 2.0, quaternion=[0.5, 0.5, 0.5, 0.5])
)
MOTIONS = {
    "circle": CIRCLE,
    "fourier": pa.trajectories.FourierSeries(
        [0.3, -0.2], [[0.2, 0.1, -0.05], [0.0, 0.3, 0.1]], [[0.1, 0.0, 0.2], [-0.3, 0.1, 0.0]], 3.7
    ),
    "sinusoid, at rest but accelerated": pa.trajectories.Sinusoid([0.3, -0.2], [0.4, 0.1], 2.1),
    "pose that swings": SWINGING,
    "users' function": pa.trajectories.as_trajectory(
        lambda t: (
            [0.1 * math.sin(2 * t), t * t],
            [0.2 * math.cos(2 * t), 2 * t],
            [-0.4 * math.sin(2 * t), 2.0],
        )
    ),
}
motions = pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS.keys())


def close(motion, t, velocity=1e-8, acceleration=1e-6):
    """Return whether velocity and acceleration at t are the derivatives of x_d."""
    now = motion.at(t)
    pose = pa.tasks.TASKS["pose"]
    error = pose.error if now.x_d.size == 7 else np.subtract

    def moved(h):
        return error(motion.at(t + h).x_d, now.x_d)

    found = derivative(moved), derivative(lambda h: motion.at(t + h).xd_d)
    return np.allclose(now.xd_d, found[0], atol=velocity) and np.allclose(
        now.xdd_d, found[1], atol=acceleration
    )


@motions
@pytest.mark.parametrize("t", [0.05, 0.31, 0.62, 0.8, 1.3])
def test_derivatives_of_a_motion_from_rest(motion, t):
    assert close(motion.from_rest(0.8), t)
    assert close(pa.trajectories.Retimed(motion, SlowedTime(1.5)), t)


@motions
def test_a_start_is_smooth_and_the_motion_exact_afterwards(motion):
    T = 0.8
    begun = motion.from_rest(T)
    first = begun.at(0.0)
    assert np.array_equal(first.x_d, motion.at(0.0).x_d)
    assert not first.xd_d.any() and not first.xdd_d.any()
    assert all(np.array_equal(*pair) for pair in zip(begun.at(-1.0), first, strict=True))
    for t in (0.0, T):  # no jump of any of the three
        before = begun.at(t - 1e-9)
        after = begun.at(t + 1e-9)
        assert all(np.allclose(*pair, atol=1e-6) for pair in zip(before, after, strict=True))
    for t in np.linspace(0.0, T, 7):  # on the same path
        s, rate, _ = begun.law.at(t)
        assert 0.0 <= rate <= 1.0 and 0.0 <= s <= t
        assert np.array_equal(begun.at(t).x_d, motion.at(s).x_d)
    for t in (T, 1.3, 7.7):
        now = begun.at(t)
        later = motion.at(t - 0.5 * T)
        assert all(np.array_equal(*pair) for pair in zip(now, later, strict=True))


@motions
def test_a_start_asks_for_hardly_more_acceleration_than_the_motion(motion):
    times = np.linspace(0.0, 5.0, 501)
    begun = motion.from_rest()
    most = [
        max(np.linalg.norm(each.at(t).xdd_d) for t in times if t >= 0.02)
        for each in (begun, motion)
    ]
    assert most[0] < 1.5 * most[1]
    if motion is CIRCLE:  # where the two parts are orthogonal
        assert most[0] < 1.05 * most[1]
        assert math.isclose(begun.law.ramp, 1.875 * 3.0 / (2.0 * math.pi), rel_tol=1e-9)
