"""Kinematics of several frames of one robot: those of each, with its own unknown tool, stacked."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ..exceptions import ParameterError
from ..robot.robot import Robot
from ..tasks.several_frames import FramesTask
from .linear_kinematics import FrameKinematics
from .task_kinematics import TaskKinematics
from .translations import TOOL


class FramesKinematics(TaskKinematics):
    """The estimated kinematics of several frames, block by block those of each.

    The parameters are the tools, in the order of the frames: the position of a frame depends on its
    own tool alone, so X_k and Y_k are block diagonal. J and dJ/dt are those of the frames, rows of
    positions first; they are exact, and so is everything that follows from them.
    """

    task: FramesTask

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
        self._take(robot, robot.task, words)
        self._parts = [FrameKinematics(robot.of_frame(name), words) for name in robot.frames]
        self.size = sum(part.size for part in self._parts)
        self.names = tuple(f"{part.frame}.{name}" for part in self._parts for name in part.names)
        self.translations = [each for part in self._parts for each in part.translations]
        self.initial, self.sizes, self.bounds = (
            np.concatenate([getattr(part, name) for part in self._parts], axis=-1)
            for name in ("initial", "sizes", "bounds")
        )
        self.update(self.initial, robot.q0, self._still)

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate at an estimate a_k (p), configuration q (nq) and velocity v (nv)."""
        self.a_k = a_k
        for part, own in self._each(a_k):
            part.update(own, q, v)
        self.J, self.xd_hat, self.Jdot_v, self.p_hat = (
            self.task.joined([getattr(part, name) for part in self._parts])
            for name in ("J", "xd_hat", "Jdot_v", "p_hat")
        )
        self.X_k = self._blocks([part.X_k for part in self._parts])
        self.Y_k = self._blocks([part.Y_k for part in self._parts])

    def _each(self, a_k: np.ndarray) -> Iterable[tuple[FrameKinematics, np.ndarray]]:
        """Return the kinematics of each frame with its parameters among a_k (p)."""
        return zip(self._parts, a_k.reshape(len(self._parts), -1), strict=True)

    def _blocks(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """Return rows of all frames, given the columns that the parameters of each have."""
        k, rows, p = np.shape(parts)
        wide = np.zeros((k, rows, k, p))
        wide[range(k), :, range(k)] = parts  # of each frame the columns of its own parameters
        return self.task.joined(list(wide.reshape(k, rows, -1)))

    @property
    def x_hat(self) -> np.ndarray:
        """The estimated positions, or poses, of all frames."""
        return self.task.joined([part.x_hat for part in self._parts])

    def at(self, q: np.ndarray, seen: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the estimated task coordinates at another q (nq), and X_k (m_p, p) there."""
        x, X = zip(*(part.at(q) for part in self._parts), strict=True)
        return self.task.joined(list(x)), self._blocks(X)

    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return dJ/dt (m, nv) by the motion and by the rate a_k_rate (p) of the estimate."""
        return self.task.joined([part.jacobian_rate(own) for part, own in self._each(a_k_rate)])

    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return Ybar_k (m, p) of Wang and Xie (27), xddot = Ybar_k(q, v, a) a_k + known part."""
        return self._blocks([part.acceleration_regressor(a) for part in self._parts])

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the tools (p) of a robot with the same joints; None if none reproduce it."""
        found = [part.value(robot.of_frame(part.frame)) for part in self._parts]
        return None if any(own is None for own in found) else np.concatenate(found)  # type: ignore[arg-type]

    def write(self, model: pin.Model, a_k: np.ndarray) -> None:
        """Write the tools of an estimate a_k (p) into a model of the robot."""
        for part, own in self._each(a_k):
            part.write(model, own)

    def read(self, model: pin.Model, a_k: np.ndarray) -> np.ndarray:
        """Return the tools (p) of a model of the robot."""
        return np.concatenate([part.read(model, own) for part, own in self._each(a_k)])
