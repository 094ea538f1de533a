"""The plane that a chain is mounted on, and on which side of it the chain stays."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from .chain import configuration_from_angles
from .reach import reach

_ROOM = 0.05  # of the reach, between the plane and every joint
_SAMPLES, _STILL = 10, 1e-6  # poses that tell what moves up and down, and by how much [m] at least


@dataclass(frozen=True)
class MountingPlane:
    """The horizontal plane (xy of the root) through the link that carries a chain's first joint.

    Arms stand on it, legs and arms on a ceiling hang from it: the chain belongs on the side on
    which its description shows it.

    Attributes:
        level: its height above the root [m].
        side: 1 for a chain above it, -1 for one below.
        movable: which of the second joint, those after it and the frame change their height.
    """

    level: float
    side: float
    movable: tuple[int, ...]

    @classmethod
    def of(cls, model: pin.Model, frame: int, shown: np.ndarray) -> MountingPlane | None:
        """Return that of a chain to a frame, as the configuration ``shown`` (nq) has it.

        None where all of the chain moves horizontally.
        """
        data, rng = model.createData(), np.random.default_rng(0)
        samples = rng.uniform(-1.0, 1.0, (_SAMPLES, model.nv))
        heights = [
            _heights(model, data, frame, configuration_from_angles(model, s)) for s in samples
        ]
        movable = np.flatnonzero(np.ptp(heights, axis=0) > _STILL)
        if not movable.size:
            return None
        level = _level(model)
        above = np.mean(_heights(model, data, frame, shown)[movable]) > level - _STILL
        return cls(level, 1.0 if above else -1.0, tuple(movable.tolist()))

    def distance(self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray) -> float:
        """Return how far [m] the chain stays from the plane at q (nq); negative beyond it."""
        heights = _heights(model, data, frame, q)[list(self.movable)]
        return float(np.min(self.side * (heights - self.level)))

    def room(self, model: pin.Model, frame: int, configurations: Iterable[np.ndarray]) -> float:
        """Return the distance [m] to be kept: a twentieth of the reach, less where there is less.

        Where none of the configurations (nq) is on the right side it is minus infinity.
        """
        data = model.createData()
        most = max(self.distance(model, data, frame, q) for q in configurations)
        return min(_ROOM * reach(model, frame), most / 2) if most > 0.0 else -np.inf


def _heights(model: pin.Model, data: pin.Data, frame: int, q: np.ndarray) -> np.ndarray:
    """Return the heights above the root [m] of the second joint, those after it and the frame."""
    pin.forwardKinematics(model, data, q)
    placements = [*data.oMi[2:], pin.updateFramePlacement(model, data, frame)]
    return np.array([placement.translation[2] for placement in placements])


def _level(model: pin.Model) -> float:
    """Return the height of the origin of the link that carries the first joint [m]."""
    for frame in model.frames:
        if frame.type == pin.FrameType.JOINT and frame.parentJoint == 1:
            return float(model.frames[frame.parentFrame].placement.translation[2])
    return 0.0
