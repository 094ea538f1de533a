"""Recorded motions of robots that are not as described: sums of sinusoids, exact or with noise."""

from functools import cache

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.description.chain import configuration_from_angles, effort_limits
from pinadapt.reference import SmallExcitation
from tests.support.chains import catalogue_robot

LOAD = pa.Payload(1.5, (0.02, -0.01, 0.05), (0.01, 0.0, 0.012, 0.0, 0.0, 0.004))
TOOL = (0.03, -0.02, 0.12)


def true_robot(name, **changes):
    """Return a robot of the catalogue with a load, a tool and friction."""
    known = {"payload": LOAD, "tool_translation": TOOL, "viscous": 0.5, "coulomb": 0.8}
    return catalogue_robot(name).changed(**{**known, **changes})


@cache
def motion(name, duration=8.0, dt=8e-3, seed=1):
    """Return times, joint angles, velocities and accelerations."""
    robot = catalogue_robot(name)
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, dt)
    shape = (robot.model.nv, 3)
    w = 2.0 * np.pi * rng.uniform(0.1, 0.7, shape)
    phase = rng.uniform(0.0, 6.0, shape)
    height = rng.uniform(0.1, 0.25, shape)
    angles = t[:, None, None] * w + phase
    q = robot.home_angles + (height * np.sin(angles)).sum(-1)
    v = (height * w * np.cos(angles)).sum(-1)
    return t, q, v, -(height * w**2 * np.sin(angles)).sum(-1)


def torques(robot, q, v, a):
    """Return the torques (N, n) of a robot with friction along a motion."""
    data = robot.model.createData()
    model = robot.model
    return np.array(
        [
            pin.rnea(model, data, configuration_from_angles(model, q_k), v_k, a_k)
            + robot.friction.torque(v_k)
            for q_k, v_k, a_k in zip(q, v, a, strict=True)
        ]
    )


@cache
def recorded(name, noisy=False, seen=True, rate=30.0, **options):
    """Return a log of the true robot, positions of the frame at the rate of a camera [Hz].

    Noise: encoders of 17 bits, velocities differenced from them, 1 % of the effort limits on the
    torques, 0.1 mm on the positions.
    """
    robot, (t, q, v, a) = true_robot(name), motion(name, **options)
    tau = torques(robot, q, v, a)
    every = max(1, round(1.0 / rate / (t[1] - t[0])))
    configurations = [configuration_from_angles(robot.model, part) for part in q[::every]]
    x = np.array([robot.position(part) for part in configurations])
    if noisy:
        rng = np.random.default_rng(7)
        count = 2.0 * np.pi / 2**17
        limits = effort_limits(robot.model)
        q = np.round(q / count) * count
        v = np.vstack([0.0 * v[:1], np.diff(q, axis=0) / (t[1] - t[0])])
        tau = tau + 0.01 * np.where(np.isfinite(limits), limits, 0.0) * rng.standard_normal(q.shape)
        x = x + 1e-4 * rng.standard_normal(x.shape)
    names = tuple(robot.joint_names)
    return pa.Log(t, q, tau, v, names, x if seen else None, t[::every] if seen else None)


@cache
def identified(name):
    """Return the identification of a robot's noisy log, with nothing told."""
    return pa.identify(recorded(name, noisy=True, dt=4e-3), catalogue_robot(name))


def frames_of_small_motions(robot, true, period):
    """Return measurements of a robot for two seconds, with the position of the true one."""
    motion = SmallExcitation(robot)
    samples = []
    for t in np.arange(0.0, 2.0, period):
        q = configuration_from_angles(robot.model, motion.at(t).x_d)
        samples.append(pa.Measurement(t, q, motion.at(t).xd_d, true.position(q)))
    return samples
