"""Robots whose joints have effects of all kinds, and their torques, joint by joint."""

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.description.chain import configuration_from_angles


def with_everything(robot, rng):
    """Return a robot with friction of all kinds, and a shaft that its last two joints turn."""
    n = robot.model.nv
    last = (n - 2, n - 1)
    friction = pa.Friction(
        rng.uniform(0.1, 2.0, n),
        rng.uniform(0.1, 2.0, n),
        threshold=rng.uniform(0.01, 0.1, n),
        gear_friction=rng.uniform(0.01, 0.3, n),
        asymmetry=rng.uniform(-0.1, 0.1, n),
        offset=rng.uniform(-1.0, 1.0, n),
        breakaway=rng.uniform(0.5, 1.5, n),
        fading=rng.uniform(0.05, 0.3, n),
        shafts=(pa.robot.Shaft(last, -1, 0.02, 0.3, 0.4),) if n > 1 else (),
    )
    return robot.changed(armature=rng.uniform(0.01, 0.3, n), friction=friction)


def torques_of_everything(robot, q, v, a):
    """Return the torques (N, n) along angles, velocities and accelerations of the joints."""
    at = [configuration_from_angles(robot.model, angles) for angles in q]
    return np.array([torque_of_everything(robot, *one) for one in zip(at, v, a, strict=True)])


def torque_of_everything(robot, q, v, a):
    """Return the torque joint by joint, as the equation in the docstring of ``Friction`` has it."""
    tau = pin.rnea(robot.model, robot.model.createData(), q, v, a)
    g = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), q)
    f = robot.friction
    for j, speed in enumerate(v):
        sign = np.tanh(speed / f.threshold[j])
        sign *= 1.0 + (f.breakaway[j] - 1.0) * np.exp(-abs(speed) / f.fading[j])
        dry = f.coulomb[j] + f.gear_friction[j] * abs(g[j]) + f.asymmetry[j] * np.sign(speed)
        tau[j] += f.viscous[j] * speed + dry * sign + f.offset[j]
    for shaft in f.shafts:
        (i, j), s = shaft.joints, shaft.sign
        u = v[i] + s * v[j]
        part = shaft.armature * (a[i] + s * a[j]) + shaft.viscous * u
        part += shaft.coulomb * np.tanh(u / shaft.threshold)
        tau[i] += part
        tau[j] += s * part
    return tau
