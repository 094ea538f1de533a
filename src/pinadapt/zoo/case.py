"""A robot of the catalogue, a wrong model of it, and a motion to follow."""

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

PERIOD = 1e-3  # [s], sampling period of the controller
INERTIA_ERROR = 0.3  # relative, of the mass and inertia of each body of the model
TOOL_ERROR = 0.05  # relative to the reach
LOAD = 0.1  # relative to the chain's mass, but at most the last body's mass
FRICTION = 0.5  # relative to typical friction of a robot of this size, times 0.5 to 1.5
SWING = 0.2  # [rad], amplitude of the tool's rotation in a pose task
_AROUND, _SAMPLES = 0.3, 30  # [rad or m] largest distance from home, number of poses
_TURNS = 4.0  # least number of turns of a run
_SETTLED = 9.0  # [s] after which a run without adaptation repeats itself
_LEAST_DURATION = 30.0  # [s]; its last 10 % is a whole turn of the fastest circle, 3 s


@dataclass(frozen=True, eq=False)
class ZooCase:
    """One robot of the zoo.

    Attributes:
        true: the true robot.
        estimated: the initial model.
        motion: the desired motion: a circle from the true initial position; in a pose task the tool
            swings.
        radius: radius of the circle [m].
        period: period of the circle [s].
        duration: duration of the run [s].
    """

    true: Robot
    estimated: Robot
    motion: Trajectory
    radius: float
    period: float
    duration: float

    @property
    def efforts_suffice(self) -> bool:
        """Whether the effort limits of the description suffice to hold the true robot near home.

        They do not for PR2's arms, which have counterbalance springs, and for the underwater arm
        Bravo 7.
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
        """Duration [s] of a run without adaptation that ends like one of ``duration``.

        With constant estimates the loop becomes periodic within seconds, so whole turns are
        omitted.
        """
        least = max(_SETTLED, 2.0 * self.period)
        return self.duration - self.period * max(0, (self.duration - least) // self.period)


def zoo_case(name: str, seed: int = 0, task: str | None = None) -> ZooCase:
    """Return the case of a robot of the catalogue; it depends on name, seed and task only.

    The true robot has friction, a tool displaced by 5 % of the reach in a random direction of the
    task, and a load at the tool. In the model each body is 30 % too light or too heavy.

    Args:
        name: name in the catalogue.
        seed: seed of tool, friction and model errors.
        task: as in ``load``; None: the catalogue's.

    Raises:
        RobotError: the robot cannot be loaded with that task, or it cannot reach any circle.
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
    estimated = robot.changed(
        inertial_scale=dict(zip(robot.joint_names, factors.tolist(), strict=True))
    )
    return ZooCase(
        true,
        estimated,
        _motion(true, found, rng),
        found.radius,
        found.period,
        max(_LEAST_DURATION, _TURNS * found.period),
    )


def _motion(robot: Robot, found: WorkspaceCircle, rng: np.random.Generator) -> Trajectory:
    """Return the circle through the robot's home position, in task coordinates.

    In a pose task the tool swings once per turn about a random axis.
    """
    motion: Trajectory = found.motion(robot.task.positions)
    if robot.task.size > robot.task.positions:
        motion = PoseTrajectory(motion, Swing(rng.standard_normal(3), SWING, found.period))
    return motion.starting_at(robot.position(robot.q0))


def _tool(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Return a random tool translation (3) [m], in the frame's axes.

    At home it lies in the task's directions. Its length is 5 % of the reach.
    """
    m = robot.task.positions
    direction = np.zeros(3)
    direction[["xyz".index(label) for label in robot.task.labels[:m]]] = rng.standard_normal(m)
    direction *= TOOL_ERROR * robot.reach / np.linalg.norm(direction)
    return np.asarray(robot.placement(robot.q0).rotation.T @ direction)
