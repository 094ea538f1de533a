"""The way to a motion's first point: smooth, straight, and the short way round."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.reference import Approach
from tests.support.differences import derivative

XYZ, POSE = pa.tasks.TASKS["xyz"], pa.tasks.TASKS["pose"]
TURNING = pa.tasks.JointTask("joint", ("a", "b"), (True, False), (0, 2), (0, 1), (False, False))
CIRCLE = pa.trajectories.Circle([0.5, 0.1, 0.4], 0.1, 3.0, plane="yz")
SWING = pa.trajectories.Swing([0.0, 1.0, 0.5], 0.3, 2.0, quaternion=[0.5, 0.5, 0.5, 0.5])
CASES = {
    "xyz": (XYZ, CIRCLE, [0.3, 0.2, 0.1]),
    "pose": (
        POSE,
        pa.trajectories.PoseTrajectory(CIRCLE, SWING),
        [0.3, 0.2, 0.1, 0.0, 0.0, -1.0, 0.0],
    ),
    "joints": (TURNING, pa.trajectories.Sinusoid([7.0, 0.4], 0.2, 2.0), [-0.4, -0.3]),
}
cases = pytest.mark.parametrize(("task", "motion", "start"), CASES.values(), ids=CASES.keys())


@cases
def test_an_approach_is_smooth_and_ends_in_the_motion(task, motion, start):
    begun = motion.from_rest(0.7)
    approach = Approach(begun, start, 0.6, task)
    first = approach.at(0.0)
    assert np.allclose(task.error(first.x_d, np.array(start)), 0.0, atol=1e-12)
    assert not first.xd_d.any() and not first.xdd_d.any()
    for t in (0.1, 0.3, 0.47, 0.9, 2.0):
        now = approach.at(t)
        assert np.allclose(
            now.xd_d,
            derivative(lambda h, t=t, now=now: task.error(approach.at(t + h).x_d, now.x_d)),
            atol=1e-8,
        )
        assert np.allclose(now.xdd_d, derivative(lambda h, t=t: approach.at(t + h).xd_d), atol=1e-6)
    before = approach.at(0.6 - 1e-9)
    after = approach.at(0.6 + 1e-9)
    assert np.allclose(task.error(after.x_d, before.x_d), 0.0, atol=1e-8)
    assert np.allclose(before.x_d[-1:], after.x_d[-1:], atol=1e-8)  # no whole turn in between
    assert np.allclose(before.xdd_d, after.xdd_d, atol=1e-6)
    for t in (0.6, 1.0, 5.0):
        pairs = zip(approach.at(t), begun.at(t - 0.6), strict=True)
        assert all(np.array_equal(*pair) for pair in pairs)
