"""Announcements to a running controller: the load that the robot carries, and its tool."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import EllipsisType
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..adaptation.adaptation import Adaptation
from ..description.chain import frame_named
from ..exceptions import ParameterError
from ..models.dynamics import Dynamics
from ..models.task_kinematics import TaskKinematics
from ..robot.changes import Load, by_frame
from ..robot.robot import Robot
from .state import ControllerState


@dataclass(frozen=True, eq=False)
class NominalRobot:
    """The robot that a controller was made for.

    Attributes:
        unloaded: as described, without the load.
        load: the load announced at first, or None.
    """

    unloaded: Robot
    load: Load = None

    def robot(self, load: Load) -> Robot:
        """Return the robot as described with a load, or none."""
        return self.unloaded if load is None else self.unloaded.changed(payload=load)


class ControllerParts(Protocol):
    """The parts of a controller that are announced or learned; see there."""

    kinematics: TaskKinematics
    dynamics: Dynamics
    adaptation_k: Adaptation
    adaptation_d: Adaptation
    nominal: NominalRobot


def announced_state(
    controller: ControllerParts,
    state: ControllerState,
    payload: Load | EllipsisType,
    tool_translation: ArrayLike | Mapping[str, ArrayLike] | None,
) -> ControllerState:
    """Return the state after announcing a new load and a new tool; see ``Controller.announce``.

    Raises:
        InputError: the parameters cannot express it, or the load or tool is impossible.
    """
    if not isinstance(payload, EllipsisType):
        state = _loaded(controller, state, payload)
    if tool_translation is None:
        return state
    described = controller.nominal.unloaded
    a_k = _with_tool(controller.kinematics, described, state.a_k, tool_translation)
    monitor = state.sensed.monitor._replace(fit=None)  # the next frame is that of another tool
    return state._replace(
        kinematic=controller.adaptation_k.init(a_k), sensed=state.sensed._replace(monitor=monitor)
    )


def _loaded(controller: ControllerParts, state: ControllerState, load: Load) -> ControllerState:
    """Return the state with a load in place of the one announced before.

    What a load adds may depend on unknown lengths: they are taken as estimated where the parameters
    cover them, else as described.
    """
    described = [controller.nominal.robot(each) for each in (state.load, load)]
    estimated = [at_lengths(robot, controller.kinematics, state.a_k) for robot in described]
    init = controller.adaptation_d.init
    for before, after in (estimated, described):
        a_d, a_0 = (controller.dynamics.with_load(a, before, after) for a in (state.a_d, state.a_0))
        if a_d is not None and a_0 is not None:
            start = init(a_0)  # with a memory that knows nothing of the new load
            dynamic = start.with_value(init(a_d).value)
            return state._replace(dynamic=dynamic, a_0=start.value, load=load)
    raise ParameterError(
        f"the {controller.dynamics.size} dynamic parameters cannot express a load on the last "
        "body, or this one.",
        where="payload",
        hint='Adapt the last body: bodies = "all" or "payload".',
    )


def at_lengths(robot: Robot, kinematics: TaskKinematics, a_k: np.ndarray) -> Robot:
    """Return a robot with its unknown translations at an estimate (p) [m]."""
    model = robot.model.copy()
    kinematics.write(model, a_k)
    return replace(robot, model=model)


def _with_tool(
    kinematics: TaskKinematics, described: Robot, a_k: np.ndarray, translation: Any
) -> np.ndarray:
    """Return the estimate (p) with the parameters of announced tools (3) [m] among the other ones.

    Raises:
        InputError: the tool is not among the parameters, or not a value of them.
    """
    model = described.changed(tool_translation=translation).model
    named = by_frame(translation, described.frames, "tool_translation")
    places = [frame_named(model, name).placement for name in named]
    tools = [place.translation.copy() for place in places]
    kinematics.write(model, a_k)
    for place, tool in zip(places, tools, strict=True):
        place.translation[:] = tool
    if any(part.joint is None for part in kinematics.translations):
        announced = kinematics.read(model, a_k)
        kinematics.write(model, announced)
        moved = announced is not a_k  # a picture's parameters do not have the tool by itself
        if moved and np.allclose([place.translation for place in places], tools, atol=1e-9):
            return announced
    raise ParameterError(
        f"the kinematic parameters {list(kinematics.names)} cannot express this tool.",
        where="tool_translation",
        hint="Adapt the whole translation of the tool, unknown=pa.Unknown(tool=True), and not in a "
        "picture, which does not show it by itself.",
    )
