"""A chain of the catalogue with a wrong model of all of it, and a motion to follow."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..description.chain import effort_limits
from ..models.joint_effects import typical_coefficients
from ..robot.changes import Payload
from ..robot.loading import load
from ..robot.robot import Robot
from ..robot.workspace import WorkspaceCircle, find_circle
from ..trajectories.pose import PoseTrajectory, Swing
from ..trajectories.trajectory import Trajectory

PERIOD = 1e-3  # [s] of the controller
INERTIA_ERROR = 0.3  # each body is believed this much too light or too heavy
TOOL_ERROR = 0.05  # of the reach
LOAD = 0.1  # of the chain's mass, or the last body's own if that is less
FRICTION = 0.5  # of what is typical for the robot's size, times 0.5 to 1.5
SWING = 0.2  # [rad] to either side, of the tool of a pose task
_AROUND, _SAMPLES = 0.3, 30  # [rad or m] from home, poses
_TURNS = 4.0
_SETTLED = 9.0  # [s]
_LEAST_DURATION = 30.0  # [s]; of the shortest circles, 3 s, the last tenth is a whole turn


@dataclass(frozen=True, eq=False)
class ZooCase:
    """One robot of the zoo.

    Attributes:
        true, believed: the real robot and what is believed of it.
        motion: the desired one, a circle from the true initial position, in a pose task with the
            tool swinging.
        radius, period: of the circle [m], [s].
        duration: of the run [s].
    """

    true: Robot
    believed: Robot
    motion: Trajectory
    radius: float
    period: float
    duration: float

    @property
    def bears_itself(self) -> bool:
        """Whether the efforts of the description hold the real robot up around home.

        Those of PR2's arms, which springs hold up, and of Bravo 7 under water do not.
        """
        model, rng = self.true.model, np.random.default_rng(0)
        data, efforts = model.createData(), effort_limits(self.true.model)
        around = rng.uniform(-_AROUND, _AROUND, (_SAMPLES, model.nv))
        return all(
            (np.abs(pin.computeGeneralizedGravity(model, data, q)) < efforts).all()
            for q in (pin.integrate(model, self.true.q0, step) for step in around)
        )

    @property
    def repeating(self) -> float:
        """Duration [s] of a run without adaptation that ends as one of ``duration`` would.

        With constant estimates the loop forgets its start within seconds and repeats itself turn by
        turn: whole turns are left out.
        """
        least = max(_SETTLED, 2.0 * self.period)
        return self.duration - self.period * max(0, (self.duration - least) // self.period)


def zoo_case(name: str, seed: int = 0, task: str | None = None) -> ZooCase:
    """Return the case of a chain of the catalogue, reproducible by name, seed and task.

    The real robot has friction, a tool moved by 5 % of the reach in a random direction of the task,
    and a load there; each body is believed 30 % too light or too heavy.

    Args:
        name: in the catalogue.
        seed: of tool, friction and errors.
        task: as in ``load``, by default the catalogue's.

    Raises:
        RobotError: the chain cannot be loaded with that task, or no circle is in its reach.
    """
    robot = load(name, task=task)
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    found = find_circle(robot, tool_error=TOOL_ERROR)
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
        _motion(true, found, rng),
        found.radius,
        found.period,
        max(_LEAST_DURATION, _TURNS * found.period),
    )


def _motion(robot: Robot, found: WorkspaceCircle, rng: np.random.Generator) -> Trajectory:
    """Return the circle through the robot's home, in the task's own coordinates.

    In a pose task the tool swings once a turn about a random axis.
    """
    motion: Trajectory = found.motion(robot.task.positions)
    if robot.task.size > robot.task.positions:
        motion = PoseTrajectory(motion, Swing(rng.standard_normal(3), SWING, found.period))
    return motion.starting_at(robot.position(robot.q0))


def _tool(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Return a translation (3) [m] in the frame's axes that the task sees at home.

    It is 5 % of the reach long.
    """
    m = robot.task.positions
    direction = np.zeros(3)
    direction[["xyz".index(label) for label in robot.task.labels[:m]]] = rng.standard_normal(m)
    direction *= TOOL_ERROR * robot.reach / np.linalg.norm(direction)
    return np.asarray(robot.placement(robot.q0).rotation.T @ direction)
