"""Random open chains: revolute, continuous and prismatic joints about arbitrary axes, arbitrary physical bodies."""

from functools import cache

import numpy as np
import pinocchio as pin
from hypothesis import strategies as st

from pinadapt import Robot, load


def random_model(seed: int, joints: int) -> pin.Model:
    """Return a chain of 1 to 10 joints with a frame 'tip', reproducible by its seed."""
    rng = np.random.default_rng(seed)
    model = pin.Model()
    model.name = f"chain{seed}"
    parent = 0
    for i in range(joints):
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        revolute, prismatic = pin.JointModelRevoluteUnaligned(axis), pin.JointModelPrismaticUnaligned(axis)
        joint = (revolute, pin.JointModelRUBY(), prismatic)[rng.choice(3, p=(0.5, 0.2, 0.3))]
        placement = pin.SE3.Random()
        placement.translation = rng.uniform(-0.5, 0.5, 3)
        placement.rotation = pin.exp3(rng.uniform(-2.0, 2.0, 3))
        parent = model.addJoint(parent, joint, placement, f"joint{i + 1}")
        model.appendBodyToJoint(parent, random_inertia(rng), pin.SE3.Identity())
    tip = pin.SE3(pin.exp3(rng.uniform(-2.0, 2.0, 3)), rng.uniform(-0.3, 0.3, 3))
    model.addFrame(pin.Frame("tip", parent, 0, tip, pin.FrameType.BODY))
    model.gravity.linear = rng.uniform(-10.0, 10.0, 3)
    return model


def random_inertia(rng: np.random.Generator) -> pin.Inertia:
    """Return a physical inertia: a cloud of point masses."""
    points, masses = rng.uniform(-0.2, 0.2, (6, 3)), rng.uniform(0.1, 1.0, 6)
    mass = masses.sum()
    com = masses @ points / mass
    arms = points - com
    inertia = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, arms, strict=True))
    return pin.Inertia(mass, com, inertia)


def random_robot(seed: int, joints: int) -> Robot:
    """Return a robot on a random chain; chains too short for three coordinates serve kinematic tests through the model."""
    return load(random_model(seed, joints), frame="tip", q0=np.zeros(joints))


chains = st.builds(random_robot, st.integers(0, 2**31), st.integers(3, 10))


catalogue_robot = cache(load)  # loading takes most of a second, and robots are not written to


def random_state(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return q (nq), v and a (nv)."""
    nv = robot.model.nv
    q = pin.integrate(robot.model, pin.neutral(robot.model), rng.uniform(-2.0, 2.0, nv))
    v, a = rng.standard_normal((2, nv))
    return q, v, a
