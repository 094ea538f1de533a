"""What happens during a run: the true robot changes, and the controller is told."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

from .._checks import mapping
from ..controller.controller import Controller
from ..controller.state import ControllerState
from ..exceptions import InputError, did_you_mean
from ..plants.plant import Plant
from ..robot.robot import Robot
from ..robot.succession import EARLY, in_time

NEWS = ("payload", "tool_translation")


class Events:
    """Changes of the true robot and beliefs that the controller is told, each at its time.

    Both take effect at the first sample at or after their time, a change before its belief.

    Attributes:
        changes: time [s] -> the true robot from then on.
        beliefs: time [s] -> what ``Controller.believe`` is given then, by name.
    """

    def __init__(
        self,
        changes: Mapping[float, Robot] | None = None,
        beliefs: Mapping[float, Mapping[str, Any]] | None = None,
    ) -> None:
        """Take what happens, in any order.

        Raises:
            InputError: times that are not positive and finite, or beliefs that ``believe`` does not
                know.
        """
        self.changes: dict[float, Robot] = in_time(changes, "changes")
        self.beliefs: dict[float, Mapping[str, Any]] = {
            time: mapping(belief, f"beliefs[{time:g}]")
            for time, belief in in_time(beliefs, "beliefs").items()
        }
        for time, belief in self.beliefs.items():
            for name in belief:
                if name not in NEWS:
                    raise InputError(
                        f"must be one of {list(NEWS)}, got {name!r}."
                        f"{did_you_mean(str(name), NEWS)}",
                        where=f"beliefs[{time:g}]",
                    )

    @property
    def any(self) -> bool:
        """Whether anything happens."""
        return bool(self.changes or self.beliefs)

    def check(self, controller: Controller, state: ControllerState) -> None:
        """Tell the controller everything in advance, to refuse what it cannot express.

        Raises:
            InputError: as ``Controller.believe``.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they are shown when it is told
            for belief in self.beliefs.values():
                state = controller.believe(state, **belief)

    def after(self, duration: float) -> list[float]:
        """Return the times [s] of what does not happen in a run of a duration [s]."""
        return sorted({at for at in (*self.changes, *self.beliefs) if at > duration - EARLY})

    def change(self, plant: Plant, before: float, now: float) -> None:
        """Let a plant become what it is ``now``, if that is another robot than at ``before`` [s].

        Raises:
            InputError: as ``Plant.become``.
        """
        for robot in _due(self.changes, before, now):
            plant.become(robot)

    def tell(
        self, controller: Controller, state: ControllerState, before: float, now: float
    ) -> ControllerState:
        """Return the state of a controller told what it is from ``before`` to ``now`` [s]."""
        for belief in _due(self.beliefs, before, now):
            state = controller.believe(state, **belief)
        return state


def _due(events: Mapping[float, Any], before: float, now: float) -> list[Any]:
    return [event for at, event in events.items() if before < at - EARLY <= now]
