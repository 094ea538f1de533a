"""Desired trajectories against finite differences, and the low pass against its own equation."""

import math

import numpy as np
import pytest

import pinadapt as pa
from tests.support.differences import derivative

MOTIONS = {
    "circle, planar": pa.trajectories.Circle([0.8, 0.0], 0.3, 2.0, phase=0.7),
    "circle, yz": pa.trajectories.Circle([0.5, 0.1, 0.4], 0.1, 3.0, plane="yz"),
    "circle, xz": pa.trajectories.Circle([0.5, 0.1, 0.4], 0.2, 1.3, plane="xz", phase=-1.0),
    "lissajous": pa.trajectories.Lissajous(
        [0.5, 0.1, 0.4], [0.1, 0.2, 0.05], [1.0, 2.0, 3.0], 4.0, [0.0, 0.3, 1.0]
    ),
    "waypoints": pa.trajectories.Waypoints(
        [[0.0, 0.0, 0.0], [0.1, 0.0, 0.2], [0.1, -0.3, 0.1]], 0.8
    ),
    "sinusoid from rest": pa.trajectories.Sinusoid([0.3, -0.2], [2.0, 1.0], [2.1, 1.3]),
    "sinusoid at speed": pa.trajectories.Sinusoid(0.1, [0.2, 0.5, -0.3], 3.0, phase=0.0),
    "fourier": pa.trajectories.FourierSeries(
        [0.3, -0.2], [[0.2, 0.1, -0.05], [0.0, 0.3, 0.1]], [[0.1, 0.0, 0.2], [-0.3, 0.1, 0.0]], 3.7
    ),
    "hold": pa.trajectories.Hold([0.1, 0.2, 0.3]),
}
motions = pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS.keys())


def test_a_centre_may_be_set_to_any_numbers():
    circle = pa.trajectories.Circle([0.4, 0.0, 0.5])
    circle.center = [1, 0, 1]
    assert np.allclose(circle.at(0).x_d, [1.1, 0.0, 1.0])


@motions
@pytest.mark.parametrize("t", [0.11, 0.55, 1.0, 1.45, 3.2])
def test_velocity_and_acceleration_are_the_derivatives(motion, t):
    now = motion.at(t)
    assert np.allclose(now.xd_d, derivative(lambda h: motion.at(t + h).x_d), atol=1e-9)
    assert np.allclose(now.xdd_d, derivative(lambda h: motion.at(t + h).xd_d), atol=1e-8)


@motions
def test_starting_at_displaces_the_motion_without_changing_it(motion):
    start = np.linspace(-0.2, 0.6, motion.at(0.0).x_d.size)
    before = motion.at(0.37)
    moved = motion.starting_at(start)
    assert np.allclose(moved.at(0.0).x_d, start, atol=1e-15)
    shift = start - motion.at(0.0).x_d
    assert np.allclose(moved.at(0.37).x_d, before.x_d + shift, atol=1e-15)
    assert np.allclose(moved.at(0.37).xd_d, before.xd_d, atol=1e-15)
    assert np.allclose(moved.at(0.37).xdd_d, before.xdd_d, atol=1e-15)
    assert np.array_equal(motion.at(0.37).x_d, before.x_d)  # the original stays


def test_a_circle_starts_on_the_first_axis_of_its_plane_and_turns_to_the_second():
    circle = pa.trajectories.Circle([0.5, 0.1, 0.4], 0.1, 2.0, plane="yz")
    assert np.allclose(circle.at(0.0).x_d, [0.5, 0.2, 0.4])
    assert np.allclose(circle.at(0.5).x_d, [0.5, 0.1, 0.5])
    assert np.allclose(circle.at(2.0).x_d, circle.at(0.0).x_d)
    later = pa.trajectories.Circle([0.5, 0.1, 0.4], 0.1, 2.0, plane="yz", phase=math.pi / 2)
    assert np.allclose(later.at(0.0).x_d, circle.at(0.5).x_d)


def test_a_fourier_series_is_the_sum_of_its_harmonics():
    series = pa.trajectories.FourierSeries([1.0], [[0.1, 0.2]], [[0.3, -0.4]], 4.0)
    w = np.pi / 2
    t = 0.7
    expected = 1.0 + 0.1 * np.cos(w * t) + 0.2 * np.cos(2 * w * t)
    expected += 0.3 * np.sin(w * t) - 0.4 * np.sin(2 * w * t)
    assert np.isclose(series.at(t).x_d[0], expected) and series.harmonics == 2
    assert np.allclose(series.at(t + 4.0).x_d, series.at(t).x_d)


STATE, INPUT = np.array([1.0, -0.5, 2.0]), np.array([0.2, 0.3, -1.0])


def test_low_pass_rate_is_the_derivative_of_its_state():
    low_pass = pa.filters.LowPass(10.0)
    slope = derivative(lambda h: low_pass.advance(STATE, INPUT, h))
    assert np.allclose(low_pass.rate(STATE, INPUT), slope, atol=1e-8)
