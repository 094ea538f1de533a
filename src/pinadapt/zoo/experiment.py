"""The zoo: robots of the catalogue with a wrong model, with and without adaptation.

Each case is a robot, a wrong model of it, and a motion to follow; many of them are a sweep.
"""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..controller.controller import PERIOD
from ..controller.limits import Limits
from ..description.catalogue import catalogue_entry
from ..description.chain import effort_limits
from ..exceptions import PinadaptError
from ..laws import DEFAULT
from ..models.bodies import UNCERTAINTY
from ..models.joint_effects import typical_coefficients
from ..robot.changes import Friction, Payload
from ..robot.loading import load
from ..robot.motors import overloaded
from ..robot.robot import LOAD, Robot
from ..robot.workspace import TOOL_ERROR as TOOL_ERROR
from ..robot.workspace import find_circle
from ..rollout.recording import FOLLOWS, extreme
from ..rollout.recording import TURN as SWING
from ..rollout.rollout import Rollout
from ..rollout.summary import BETTER
from ..scenario.template import FRICTION
from ..simulation.engine import Engine
from ..simulation.simulate import simulate
from ..sweep.cases import Plan
from ..sweep.execution import rows
from ..sweep.table import DONE, Row
from ..trajectories.pose import PoseTrajectory, Swing
from ..trajectories.trajectory import Trajectory
from ..tuning.make_controller import make_controller
from ..tuning.unknowns import Unknown

# [s]; its last 10 % is a whole turn of the fastest circle, 3 s; half: less time to converge
LEAST_DURATION = 30.0


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
        """Whether the effort limits of the description suffice to hold the true robot at home.

        They do not for PR2's arms, which have counterbalance springs, and for the underwater arm
        Bravo 7.
        """
        return overloaded(self.true, effort_limits(self.true.model)) is None

    @property
    def repeating(self) -> float:
        """Duration [s] of a run without adaptation that ends like one of ``duration``.

        With constant estimates the loop becomes periodic within a third of the run, so whole turns
        are omitted.
        """
        least = max(0.3 * LEAST_DURATION, 2.0 * self.period)
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
    found = find_circle(robot)
    tool = _tool(robot, rng)
    bodies = [inertia.mass for inertia in robot.model.inertias[1:]]
    _, viscous, coulomb = (
        FRICTION * typical_coefficients(robot) * rng.uniform(0.5, 1.5, (3, robot.model.nv))
    )
    true = robot.changed(
        tool_translation=tool,
        payload=Payload(mass=min(LOAD * sum(bodies), bodies[-1]), com=tool),
        friction=Friction(viscous, coulomb),
    )
    factors = 1.0 + UNCERTAINTY * rng.choice([-1.0, 1.0], robot.model.nv)
    motion: Trajectory = found
    if robot.task.size > robot.task.positions:  # of a pose: the tool swings once per turn
        motion = PoseTrajectory(found, Swing(rng.standard_normal(3), SWING, found.period))
    return ZooCase(
        true,
        robot.changed(inertial_scale=dict(zip(robot.joint_names, factors, strict=True))),
        motion.starting_at(true.position(true.q0)),
        found.radius,
        found.period,
        max(LEAST_DURATION, 4.0 * found.period),
    )


def _tool(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Return a random tool translation (3) [m], in the frame's axes.

    At home it lies in the task's directions. Its length is 5 % of the reach.
    """
    task = robot.frame_task
    direction = np.zeros(3)
    direction[task.place] = rng.standard_normal(task.positions)
    direction *= TOOL_ERROR * robot.reach / np.linalg.norm(direction)
    return robot.placement(robot.q0).rotation.T @ direction


POSITION, POSE, CONVERGED = "position", "pose", "converged"


def zoo_numbers(
    robot: str,
    law: str = DEFAULT,
    task: str = POSITION,
    adaptation: str = "",
    case_seed: int = 0,
) -> Row:
    """Run one robot of the catalogue, with and without adaptation, as a case of a sweep.

    ``unadapted`` and ``adapted`` are the largest errors in the last 10 % of the duration [m],
    ``unadapted_angle`` and ``adapted_angle`` those of the orientation of a pose [rad];
    ``min_eig_M_hat`` and ``min_singular_J_hat`` are the smallest eigenvalue of the estimated mass
    matrix and singular value of the estimated Jacobian over the adapted run. None where there is
    none. A robot that is refused has a verdict alone.

    Args:
        robot: name in the catalogue.
        law: name of a law.
        task: "position" or "pose".
        adaptation: name of an adaptation; "" is the default.
        case_seed: seed of tool, friction and model errors.
    """
    row: Row = {"robot": robot, "law": law, "task": task}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the verdict reports bodies that are not physical
        try:
            case = zoo_case(robot, case_seed, POSE if task == POSE else None)
            adapted = _run(case, law, adaptation or None, case.duration)
            unadapted = _run(case, law, "none", case.repeating)
            row |= {
                "joints": case.true.model.nv,
                "radius": case.radius,
                "unadapted": _last(case, unadapted, unadapted.distance),
                "adapted": _last(case, adapted, adapted.distance),
                "min_eig_M_hat": extreme(np.min, adapted.min_eig_M_hat),
                "min_singular_J_hat": extreme(np.min, adapted.min_singular_J_hat),
                "unadapted_angle": _last(case, unadapted, unadapted.angle),
                "adapted_angle": _last(case, adapted, adapted.angle),
            }
            error = row["adapted"]
            without = row["unadapted"]
            better = adapted.grade == FOLLOWS and without is not None and error <= BETTER * without
            row["verdict"] = CONVERGED if better else adapted.verdict
        except (PinadaptError, ArithmeticError, ValueError) as error:
            row["verdict"] = f"refused: {error}"
    return {**row, "converged": row["verdict"] == CONVERGED}


def run_zoo(
    names: Sequence[str], processes: int | None = None, task: str = POSITION
) -> Iterator[Row]:
    """Run robots as a sweep and yield their numbers as they finish, see ``zoo_numbers``.

    Robots with most joints start first, so that the processes finish at about the same time.

    Args:
        names: names in the catalogue.
        processes: number of processes, 0 for none besides this one; None: one per core.
        task: position, a circle (default), or pose, a circle with a swinging tool, for chains of
            six and more joints.

    Raises:
        RobotError: a name is not in the catalogue.
    """
    longest_first = sorted(names, key=lambda name: -catalogue_entry(name).joints)
    plan = Plan(
        function=zoo_numbers, case=[{"robot": name, "task": task} for name in longest_first]
    )
    for row in rows(plan, plan.cases, processes):
        if row["status"] != DONE:
            row["verdict"] = f"{row['status']}: {row['reason']}"
        yield row


def _run(case: ZooCase, law: str, adaptation: str | None, duration: float) -> Rollout:
    """Run a case with default gains; its sensors are right: implausible speed is divergence."""
    controller = make_controller(
        case.estimated,
        law=law,
        adaptation=adaptation,
        # the true robot has friction, the model has none
        unknown=Unknown(friction=True, armature=True),
        limits=Limits(torque=case.efforts_suffice, guards={"velocity": False}),
        dt=PERIOD,
    )
    return simulate(
        case.true,
        controller,
        case.motion,
        duration=duration,
        engine=Engine(torque_limits=case.efforts_suffice),
        record_every=10,
        progress=False,
    )


def _last(case: ZooCase, rollout: Rollout, errors: np.ndarray | None) -> float | None:
    """Return the largest error at the end of a run, or None if there is none that is finite.

    The end is 10 % of the case's duration, however long the run itself was.
    """
    if errors is None:
        return None
    return extreme(np.max, errors[rollout.t > rollout.t[-1:] - 0.1 * case.duration])
