"""Random open chains: joints about arbitrary axes, arbitrary physical bodies."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
from hypothesis import example, settings
from hypothesis import strategies as st

import pinadapt as pa
from pinadapt.tasks.frame import TASKS

SIZES = range(1, 11)  # numbers of joints
seeds = st.integers(0, 2**31)
seeded = settings(max_examples=15, deadline=None, derandomize=True)


def random_model(seed: int, joints: int) -> pin.Model:
    """Return a chain of 1 to 10 joints with a frame 'tip', reproducible by its seed."""
    rng = np.random.default_rng(seed)
    model = pin.Model()
    model.name = f"chain of {joints}, seed {seed}"
    parent = 0
    for i in range(joints):
        parent = model.addJoint(
            parent, random_joint(rng), random_placement(rng, 0.5), f"joint{i + 1}"
        )
        model.appendBodyToJoint(parent, random_inertia(rng), pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", parent, 0, random_placement(rng, 0.3), pin.FrameType.BODY))
    model.gravity.linear = rng.uniform(-10.0, 10.0, 3)
    return model


def random_joint(rng: np.random.Generator) -> pin.JointModel:
    """Return a joint; continuous ones turn about a coordinate axis, arbitrary once placed."""
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    continuous = (pin.JointModelRUBX, pin.JointModelRUBY, pin.JointModelRUBZ)[rng.integers(3)]
    kinds = (
        pin.JointModelRevoluteUnaligned(axis),
        continuous(),
        pin.JointModelPrismaticUnaligned(axis),
    )
    return kinds[rng.choice(3, p=(0.5, 0.2, 0.3))]


def random_placement(rng: np.random.Generator, distance: float) -> pin.SE3:
    """Return a placement whose translation is at most ``distance`` along each axis [m]."""
    return pin.SE3(pin.exp3(rng.uniform(-2.0, 2.0, 3)), rng.uniform(-distance, distance, 3))


def random_inertia(rng: np.random.Generator) -> pin.Inertia:
    """Return a physical inertia: a cloud of point masses."""
    points = rng.uniform(-0.2, 0.2, (6, 3))
    masses = rng.uniform(0.1, 1.0, 6)
    mass = masses.sum()
    com = masses @ points / mass
    arms = points - com
    inertia = sum(
        m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, arms, strict=True)
    )
    return pin.Inertia(mass, com, inertia)


def random_robot(seed: int, joints: int) -> pa.Robot:
    """Return a robot on a random chain, at home where it is neutral, even if too short for xyz."""
    model = random_model(seed, joints)
    return pa.Robot(
        str(model.name),
        model,
        "tip",
        TASKS["xyz"],
        pin.neutral(model),
        pa.Friction().of(model),
    )


def chains_of(sizes: Sequence[int]) -> st.SearchStrategy[pa.Robot]:
    """Return the strategy of robots on random chains with one of these numbers of joints."""
    return st.builds(random_robot, seeds, st.sampled_from(sizes))


chains = chains_of(SIZES)


def each_size(sizes: Sequence[int] = SIZES, **others: Any) -> Callable[[Callable], Callable]:
    """Return a decorator: a test given a random ``robot`` also runs on one of each size.

    Args:
        sizes: numbers of joints.
        others: values of the test's other arguments for these chains.
    """

    def decorate(test: Callable) -> Callable:
        for joints in sizes:
            test = example(robot=random_robot(joints, joints), **others)(test)
        return test

    return decorate


catalogue_robot = cache(pa.load)  # loading takes most of a second, and robots are not written to


def robot_of(law: str, name: str) -> pa.Robot:
    """Return a robot with a task that a law controls: its own, or its joints.

    Args:
        law: a name of ``pa.laws.LAWS``.
        name: in the catalogue, or "mixed".
    """
    task = {"task": "joint"} if pa.laws.LAWS[law].joint_space else {}
    return mixed_robot(**task) if name == "mixed" else catalogue_robot(name, **task)


@cache
def mixed_robot(task: str = "xyz") -> pa.Robot:
    """Return a slide, a continuous joint and two revolute ones."""
    rng = np.random.default_rng(3)
    model = pin.Model()
    parent = 0
    axis = np.array([0.6, 0.0, 0.8])
    kinds = [
        pin.JointModelPrismaticUnaligned(axis),
        pin.JointModelRUBZ(),
        pin.JointModelRY(),
        pin.JointModelRevoluteUnaligned(axis),
    ]
    for i, kind in enumerate(kinds):
        parent = model.addJoint(parent, kind, random_placement(rng, 0.4), f"joint{i + 1}")
        model.appendBodyToJoint(parent, random_inertia(rng), pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", parent, 0, random_placement(rng, 0.2), pin.FrameType.BODY))
    model.name = "mixed"
    return pa.load(model, frame="tip", task=task, q0=[0.1, 3.0, -0.4, 0.3])


def random_state(
    robot: pa.Robot, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return q (nq), v and a (nv)."""
    nv = robot.model.nv
    q = pin.integrate(robot.model, pin.neutral(robot.model), rng.uniform(-2.0, 2.0, nv))
    v, a = rng.standard_normal((2, nv))
    return q, v, a
