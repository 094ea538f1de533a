"""A circle followed by a robot's frame, without its dynamics."""

import math

import numpy as np
import pinocchio as pin

AXES = {"x": 0, "y": 1, "z": 2}


def followed(robot, circle, start, turns=1.2, steps=300):
    """Return configurations (N, nq) and speeds (N, nv) on the circle, by fine steps of J^+."""
    model, data, q = robot.model, robot.model.createData(), robot.q0
    rows, dt = np.arange(3)[robot.task.rows], circle.period / steps
    axes = [rows[AXES[axis]] for axis in circle.plane]
    configurations, speeds = [], []
    for k in range(int(turns * steps)):
        J = pin.computeFrameJacobian(model, data, q, robot.frame_id, pin.LOCAL_WORLD_ALIGNED)[
            robot.task.rows
        ]
        pin.updateFramePlacement(model, data, robot.frame_id)
        angle = 2 * math.pi * k / steps + circle.phase
        x_d, v_d = start.copy(), np.zeros(3)
        x_d[axes] += circle.radius * np.array(
            [math.cos(angle) - math.cos(circle.phase), math.sin(angle) - math.sin(circle.phase)]
        )
        v_d[axes] = (
            2
            * math.pi
            / circle.period
            * circle.radius
            * np.array([-math.sin(angle), math.cos(angle)])
        )
        u = (v_d + 20.0 * (x_d - data.oMf[robot.frame_id].translation))[robot.task.rows]
        pinv = np.linalg.pinv(J)
        v = pinv @ u + (np.eye(model.nv) - pinv @ J) @ (4.0 * pin.difference(model, q, robot.q0))
        configurations.append(q)
        speeds.append(v)
        q = pin.integrate(model, q, dt * v)
    assert (
        np.linalg.norm((x_d - data.oMf[robot.frame_id].translation)[robot.task.rows])
        < 0.03 * circle.radius
    )
    return configurations, np.array(speeds)
