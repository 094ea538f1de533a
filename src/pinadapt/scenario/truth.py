"""From the [truth] and [belief] tables to robots, at the start and as they change."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from ..exceptions import ScenarioError
from ..robot.changes import Payload
from ..robot.robot import Robot
from .error_prefix import prefix_errors
from .schema import BeliefSection, PayloadSection, TruthKeys, TruthSection


def true_robot(described: Robot, truth: TruthKeys) -> Robot:
    """Return the described robot as the keys of [truth] change it.

    Raises:
        InputError: keys that do not fit the robot.
    """
    return described.changed(
        inertial_scale=truth.inertial_scale,
        payload=payload_of(truth.payload),
        tool_translation=truth.tool_translation,
        link_translation=truth.link_translation,
        armature=truth.armature,
        viscous=truth.friction.viscous,
        coulomb=truth.friction.coulomb,
    )


def believed_robot(described: Robot, belief: BeliefSection) -> Robot:
    """Return the described robot as [belief] changes it, without the guess of its load.

    Raises:
        InputError: keys that do not fit the robot.
    """
    return described.changed(
        inertial_scale=belief.inertial_scale,
        armature=belief.armature,
        viscous=belief.friction.viscous,
        coulomb=belief.friction.coulomb,
    )


def payload_of(section: PayloadSection | None) -> Payload | None:
    """Return the load of a table, or None for none."""
    if section is None or not (section.mass or any(section.inertia)):
        return None
    return Payload(**section.model_dump())


def true_changes(described: Robot, truth: TruthSection) -> dict[float, Robot]:
    """Return the true robot from the time [s] of each [[truth.change]] on.

    A change replaces the keys that it names; the others are those of the change before it in time,
    and of [truth] before the first.

    Raises:
        InputError: two changes at one time, or keys that do not fit the robot.
    """
    keys: TruthKeys = truth
    robots = {}
    for number, change in _in_time(truth.change, "truth.change"):
        named = {name: getattr(change, name) for name in change.model_fields_set - {"at"}}
        keys = keys.model_copy(update=named)
        with prefix_errors(f"truth.change.{number}"):
            robots[change.at] = true_robot(described, keys)
    return robots


def told(belief: BeliefSection) -> dict[float, dict[str, Any]]:
    """Return what ``Controller.believe`` is given at the time [s] of each [[belief.change]].

    Raises:
        ScenarioError: two changes at one time, or one that tells nothing.
    """
    beliefs = {}
    for number, change in _in_time(belief.change, "belief.change"):
        named = {name: getattr(change, name) for name in change.model_fields_set - {"at"}}
        if not named:
            raise ScenarioError(
                "must name payload or tool_translation.", where=f"belief.change.{number}"
            )
        if "payload" in named:
            named["payload"] = payload_of(change.payload)
        beliefs[change.at] = named
    return beliefs


def _in_time(changes: Sequence[Any], where: str) -> list[tuple[int, Any]]:
    """Return changes with their numbers in the file, from 0, sorted by time."""
    ordered = sorted(enumerate(changes), key=lambda pair: pair[1].at)
    for (_, one), (number, other) in pairwise(ordered):
        if one.at == other.at:
            raise ScenarioError(
                f"there is another change at {other.at:g} s.",
                where=f"{where}.{number}.at",
                hint="Put both into one.",
            )
    return ordered
