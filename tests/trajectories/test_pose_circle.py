"""The circle that a pose task can follow at constant orientation, and its scenario of `init`."""

import math

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.description.chain import position_limits

AXES = {"x": 0, "y": 1, "z": 2}


def followed(robot, circle, turns=1.2, steps=240):
    """Return angles (N, nv), speeds (N, nv) and Jacobians on the circle, by fine steps of J^+."""
    model, data, q = robot.model, robot.model.createData(), robot.q0
    start, dt, w = robot.placement(q), circle.period / steps, 2 * math.pi / circle.period
    first, second = (np.eye(3)[AXES[axis]] for axis in circle.plane)
    angles, speeds, Jacobians = [], [], []
    for k in range(int(turns * steps)):
        angle = w * k * dt + circle.phase
        there = circle.radius * (math.cos(angle) * first + math.sin(angle) * second)
        here = circle.radius * (math.cos(circle.phase) * first + math.sin(circle.phase) * second)
        speed = w * circle.radius * (math.cos(angle) * second - math.sin(angle) * first)
        J = pin.computeFrameJacobian(model, data, q, robot.frame_id, pin.LOCAL_WORLD_ALIGNED)
        now = pin.updateFramePlacement(model, data, robot.frame_id)
        off = start.translation + there - here - now.translation
        turn = pin.log3(start.rotation @ now.rotation.T)
        inverse = np.linalg.pinv(J)
        psi = 4.0 * pin.difference(model, q, robot.q0)
        v = inverse @ np.concatenate([speed + 20.0 * off, 20.0 * turn]) + psi - inverse @ (J @ psi)
        angles.append(pin.difference(model, pin.neutral(model), q))
        speeds.append(v)
        Jacobians.append(J.copy())
        q = pin.integrate(model, q, dt * v)
    assert np.linalg.norm(off) < 0.03 * circle.radius and np.linalg.norm(turn) < 0.01
    return np.array(angles), np.array(speeds), Jacobians


@pytest.mark.parametrize("name", ["panda", "kinova", "talos_left_leg"])
def test_the_circle_can_be_followed_at_constant_orientation_also_with_a_longer_tool(name):
    robot = pa.load(name, task="pose")
    circle = pa.reachable_circle(robot)
    length = robot.reach
    assert 0.05 * length < circle.radius <= 0.1 * length
    lower, upper = position_limits(robot.model)
    limited = np.isfinite(lower)
    for axis in np.eye(3):
        angles, speeds, Jacobians = followed(
            robot.changed(tool_translation=0.05 * length * axis), circle
        )
        room = np.minimum(angles - lower, upper - angles)[:, limited] / (upper - lower)[limited]
        assert room.min(initial=1.0) > 0.04
        arms = np.repeat([1.0, length], 3)[:, None]
        least = [np.linalg.svd(arms * J, compute_uv=False)[-1] for J in Jacobians[::9]]
        assert min(least) > 0.48 * least[0]
        assert np.abs(speeds).max() < 1.65
