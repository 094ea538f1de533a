"""Kinematics of several frames of one robot: those of each, with its own unknown tool."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..exceptions import ParameterError
from ..robot.robot import Robot
from .linear_kinematics import FrameKinematics, stacked, translated
from .translations import TOOL, unknown_translations


class FramesKinematics(FrameKinematics):
    """The estimated kinematics of several frames, positions first, with the tools as parameters.

    The position of a frame depends on its own tool alone, so X_k and Y_k are block diagonal.
    """

    def __init__(self, robot: Robot, unknown: str | Sequence[Any] = ()) -> None:
        """Use a nominal robot with several task frames; ``unknown`` is empty or ["tool"].

        Raises:
            ParameterError: other unknown translations: those of joints move several frames.
        """
        words = [unknown] if isinstance(unknown, str) else list(unknown)
        if words not in ([], [TOOL]):
            raise ParameterError(
                f"with several frames their tools may be unknown, and {words} was given.",
                where="unknown.translations",
                hint='Take unknown "tool", or one frame at a time.',
            )
        own = unknown_translations(robot, words)
        self.translations, parts = own * len(robot.frames), []
        for k, name in enumerate(robot.frames):
            for part in translated(robot.of_frame(name), own):
                names = tuple(f"{name}.{label}" for label in part.names)
                parts.append(part._replace(names=names, joints=part.joints + k))
        self._displace(robot, words, stacked(parts))
