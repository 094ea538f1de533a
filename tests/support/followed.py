"""A circle followed by a robot's frame, without its dynamics."""

import numpy as np
import pinocchio as pin


def followed(robot, circle, start, turns=1.2):
    """Return configurations (N, nq) and speeds (N, nv) on the circle, by fine steps of J^+."""
    model = robot.model
    data = robot.model.createData()
    q = robot.q0
    rows = robot.task.rows
    steps = 300  # a turn
    dt = circle.period / steps
    path = circle.starting_at(start[rows])
    configurations = []
    speeds = []
    for k in range(int(turns * steps)):
        desired = path.at(k * dt)
        place = (robot.frame_id, pin.LOCAL_WORLD_ALIGNED)
        J = pin.computeFrameJacobian(model, data, q, *place)[rows]
        off = desired.x_d - robot.position(q)
        pinv = np.linalg.pinv(J)
        free = (np.eye(model.nv) - pinv @ J) @ (4.0 * pin.difference(model, q, robot.q0))
        configurations.append(q)
        speeds.append(pinv @ (desired.xd_d + 20.0 * off) + free)
        q = pin.integrate(model, q, dt * speeds[-1])
    assert np.linalg.norm(off) < 0.03 * circle.radius
    return configurations, np.array(speeds)
