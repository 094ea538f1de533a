"""Unknown translations of a chain: of the tool, of joint placements, or lengths along them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from .._checks import instance
from ..exceptions import ParameterError
from ..robot.changes import joint_id
from ..robot.robot import Robot

TOOL = "tool"
LENGTHS = "lengths"
BASE = "base"
FIRST = 1  # the joint whose placement is the position of the base


@dataclass(frozen=True, eq=False)
class Translation:
    """One unknown translation, directions @ theta, of a joint or of the task frame.

    Attributes:
        name: "tool", or the joint's name.
        joint: index of the joint whose placement it is; None: the placement of the task frame.
        directions: (3, k) orthonormal, in the axes of the parent joint; the identity if all of it
            is unknown, one column for a length.
        labels: one name a parameter (k).
    """

    name: str
    joint: int | None
    directions: np.ndarray
    labels: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number k of parameters."""
        return len(self.labels)


Words: TypeAlias = "str | Sequence[str | Translation]"
"""One unknown translation or several, see ``unknown_translations``."""


def placed_values(
    model: pin.Model, frame: int, translations: Sequence[Translation]
) -> list[np.ndarray]:
    """Return the parameters (k) of each translation, from the placements of a model.

    Args:
        model: of the chain.
        frame: index of its task frame.
        translations: the unknown ones.
    """
    return [
        part.directions.T.dot(placement_of(model, frame, part.joint).translation)
        for part in translations
    ]


def place(
    model: pin.Model, frame: int, translations: Sequence[Translation], theta: np.ndarray
) -> None:
    """Write the placements of the parameters theta (p) of translations into a model."""
    first = 0
    for part in translations:
        own = theta[first : first + part.size]
        placement_of(model, frame, part.joint).translation = part.directions.dot(own)
        first += part.size


def unknown_translations(robot: Robot, unknown: Words) -> list[Translation]:
    """Return the translations that a user's words name; Translation objects pass unchanged.

    Args:
        robot: the nominal robot, whose placements define the directions of lengths.
        unknown: "tool" or joint names (whole translations); "tool:length" or "joint:length" (a
            length along the nominal direction); "lengths" (one length a link, tool included);
            "base" (the translation of the first joint: the base in the camera's frame).

    Raises:
        ParameterError: one that occurs twice or has no effect on the frame, or a length of zero,
            which has no direction.
        RobotError: unknown joint.
    """
    words: list[str | Translation] = []
    for word in [unknown] if isinstance(unknown, str) else unknown:
        words += _all_lengths(robot) if word == LENGTHS else [word]
    parts = [
        _translation(robot, word)
        if isinstance(word, str)
        else instance(word, Translation, "unknown.translations", ParameterError)
        for word in words
    ]
    names = [part.name for part in parts]
    if len(set(names)) != len(names):
        raise ParameterError(f"one occurs twice in {names}.", where="unknown.translations")
    return parts


def placement_of(model: pin.Model, frame: int, joint: int | None) -> pin.SE3:
    """Return the placement of a joint, or of the frame where ``joint`` is None, as a view."""
    return model.frames[frame].placement if joint is None else model.jointPlacements[joint]


def _all_lengths(robot: Robot) -> list[str]:
    """Return "name:length" for every nonzero translation after the first joint."""
    names = [*robot.joint_names[1:], TOOL]
    joints = [*range(2, robot.model.njoints), None]
    return [
        f"{name}:length"
        for name, joint in zip(names, joints, strict=True)
        if np.linalg.norm(placement_of(robot.model, robot.frame_id, joint).translation) > 1e-9
    ]


def _translation(robot: Robot, word: str) -> Translation:
    """Return the translation that one word names; see ``unknown_translations``."""
    if word == BASE:
        return _whole(BASE, FIRST)
    name = word.removesuffix(":length")
    joint = (
        None
        if name == TOOL
        else joint_id(robot.model, name, "unknown.translations", (TOOL, LENGTHS, BASE))
    )
    if joint == FIRST:
        raise ParameterError(
            f"the placement of the first joint, '{name}', has no effect on the frame's velocity.",
            where="unknown.translations",
            hint=f"Use '{BASE}' to adapt it from the measured position, with the law 'separation'.",
        )
    if name == word:
        return _whole(name, joint)
    nominal = placement_of(robot.model, robot.frame_id, joint).translation.copy()
    length = np.linalg.norm(nominal)
    if length < 1e-9:
        raise ParameterError(
            f"the translation of '{name}' is zero, so its length has no direction.",
            where="unknown.translations",
            hint=f"Use '{name}' for the whole translation.",
        )
    return Translation(name, joint, (nominal / length)[:, None], (f"{name}_length",))


def _whole(name: str, joint: int | None) -> Translation:
    return Translation(name, joint, np.eye(3), tuple(f"{name}_{axis}" for axis in "xyz"))
