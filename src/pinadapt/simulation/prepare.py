"""Before a run: do robot, controller, motion and options match?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import arithmetic, mapping, word
from ..controller.controller import Controller
from ..controller.learned import LearnedParameters
from ..controller.state import ControllerState
from ..exceptions import InputError
from ..laws import DEFAULT
from ..plants.plant import SimulatedPlant
from ..records import Sensors
from ..robot.motors import overloaded
from ..robot.robot import Robot
from ..trajectories.given import TrajectoryLike, as_trajectory
from ..trajectories.trajectory import Trajectory
from ..tuning.preflight import preflight, sensor_findings
from .engine import Engine

_START = ("a_k", "a_d", "information", "information_k")


@arithmetic("simulation")
def prepare(
    plant: SimulatedPlant,
    controller: Controller,
    start: LearnedParameters | Mapping[str, ArrayLike | None] | None,
) -> ControllerState:
    """Return the controller's initial state; check that it fits the plant.

    Args:
        plant: to be driven.
        controller: that drives it.
        start: initial estimates, as in ``simulate``.

    Raises:
        InputError: it does not, or the initial estimates cannot be used.
    """
    true, own = plant.robot, controller.kinematics
    ours = true.joint_names, true.frames, true.task.name
    theirs = own.joint_names, own.robot.frames, own.task.name
    if ours != theirs:
        raise InputError(
            f"the true robot (joints, frame, task: {ours}) and the controller's ({theirs}) differ.",
            hint="Make both from the same load(), the true one by .changed().",
        )
    if isinstance(start, LearnedParameters):
        start = start.start(controller)
    given: Any = mapping(start, "start")
    for name in given:
        word(name, _START, "start")
    return controller.init(plant.measure(), **given)


def findings(
    true: Robot,
    controller: Controller,
    engine: Engine,
    sensors: Sensors,
) -> list[str]:
    """Return the findings on period, camera, encoders and motors before a sampled run.

    Args:
        true: the true robot.
        controller: to drive it.
        engine: what moves the true robot.
        sensors: of the true robot.
    """
    if engine.continuous:
        return []
    dt, motors = engine.period(controller), engine.motors(true)
    quality = sensors.quality(true.model.nv, dt)
    found = [*preflight(controller, dt, engine.actuators), *sensor_findings(controller, quality)]
    words = [str(each) for each in found]
    if motors is not None and controller.compensation is None:
        words += filter(None, [overloaded(true, motors)])
    return words


def usable_trajectory(
    controller: Any, given: TrajectoryLike, duration: float | None = None
) -> Trajectory:
    """Return a motion as a ``Trajectory`` that suits the controller's task and law.

    Args:
        controller: a ``Controller``, or any object with ``init`` and ``step``, of whose task and
            law nothing is known.
        given: as ``as_trajectory`` takes it.
        duration: of the run [s]; None for a run without end.

    Raises:
        InputError: it is no motion, has not the coordinates of the task, is not finite at its
            start, or does not come to rest where the law is for a set point.
    """
    kinematics, law = getattr(controller, "kinematics", None), getattr(controller, "law", None)
    trajectory = as_trajectory(given, None if kinematics is None else kinematics.task)
    if law is None or not law.set_point or trajectory.settles is not None:
        return trajectory
    last = trajectory.at(60.0 if duration is None else duration)  # [s]
    if max(np.abs(last.xd_d).max(), np.abs(last.xdd_d).max()) < 1e-6:
        return trajectory
    raise InputError(
        f"the law '{law.name}' is for a set point, and the desired motion does not come to rest.",
        where="trajectory",
        hint='Take "hold" or "waypoints" (Hold, Waypoints, or a motion of your own that ends at '
        f"rest), or the law '{DEFAULT}', which follows motions.",
    )
