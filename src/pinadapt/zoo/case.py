"""A chain of the catalogue with a wrong model of all of it, and a circle to follow."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from ..models.joint_effects import typical_coefficients
from ..robot.changes import Payload
from ..robot.robot import Robot, load
from ..robot.workspace import WorkspaceCircle, reach, reachable_circle
from ..trajectories.circle import Circle
from ..trajectories.trajectory import Trajectory

PERIOD = 1e-3  # [s] of the controller
INERTIA_ERROR = 0.3  # each body is believed this much too light or too heavy
TOOL_ERROR = 0.05  # of the reach
LOAD = 0.1  # of the chain's mass, or the last body's own if that is less
FRICTION = 0.5  # of what is typical for the robot's size, times 0.5 to 1.5
_TURNS = 4.0
_SETTLED = 9.0  # [s]
_LEAST_DURATION = 30.0  # [s]; of the shortest circles, 3 s, the last tenth is a whole turn


@dataclass(frozen=True, eq=False)
class ZooCase:
    """One robot of the zoo.

    Attributes:
        true, believed: the real robot and what is believed of it.
        circle: the desired motion, through the true initial position.
        radius, period: of the circle [m], [s].
        duration: of the run [s].
    """

    true: Robot
    believed: Robot
    circle: Trajectory
    radius: float
    period: float
    duration: float

    @property
    def repeating(self) -> float:
        """Duration [s] of a run without adaptation that ends as one of ``duration`` would.

        With constant estimates the loop forgets its start within seconds and repeats itself turn by
        turn: whole turns are left out.
        """
        least = max(_SETTLED, 2.0 * self.period)
        return self.duration - self.period * max(0, (self.duration - least) // self.period)


def zoo_case(name: str, seed: int = 0) -> ZooCase:
    """Return the case of a chain of the catalogue, reproducible by name and seed.

    The real robot has friction, a tool moved by 5 % of the reach in a random direction of the task,
    and a load there; each body is believed 30 % too light or too heavy.

    Raises:
        RobotError: the chain cannot be loaded, or no circle is in its reach.
    """
    robot = load(name)
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    found = reachable_circle(robot, tool_error=TOOL_ERROR)
    tool = _tool(robot, rng)
    bodies = [inertia.mass for inertia in robot.model.inertias[1:]]
    _, viscous, coulomb = (
        FRICTION * typical_coefficients(robot) * rng.uniform(0.5, 1.5, (3, robot.model.nv))
    )
    true = robot.changed(
        tool_translation=tool,
        payload=Payload(mass=min(LOAD * sum(bodies), bodies[-1]), com=tool),
        viscous=viscous,
        coulomb=coulomb,
    )
    factors = 1.0 + INERTIA_ERROR * rng.choice([-1.0, 1.0], robot.model.nv)
    believed = robot.changed(
        inertial_scale=dict(zip(robot.joint_names, factors.tolist(), strict=True))
    )
    return ZooCase(
        true,
        believed,
        _circle(true, found),
        found.radius,
        found.period,
        max(_LEAST_DURATION, _TURNS * found.period),
    )


def _circle(robot: Robot, found: WorkspaceCircle) -> Trajectory:
    """Return the circle through the robot's home, in the task's own coordinates."""
    size = robot.task.size
    circle = Circle(
        np.zeros(size), found.radius, found.period, found.plane if size == 3 else "xy", found.phase
    )
    return circle.starting_at(robot.position(robot.q0))


def _tool(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Return a translation (3) [m] in the frame's axes that the task sees at home.

    It is 5 % of the reach long.
    """
    m = robot.task.positions
    direction = np.zeros(3)
    direction[["xyz".index(label) for label in robot.task.labels[:m]]] = rng.standard_normal(m)
    direction *= TOOL_ERROR * reach(robot) / np.linalg.norm(direction)
    return np.asarray(robot.placement(robot.q0).rotation.T @ direction)
