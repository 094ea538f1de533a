"""Encoders: joint positions in whole counts, and velocities differenced from them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import vector
from ..exceptions import InputError
from ..robot.chain import angles_from_configuration, configuration_from_angles
from ..robot.robot import Robot


class Encoder:
    """What a drive tells of its joint: q in whole counts, v as their difference over one period.

    Joints of continuous rotation have their angle in (-pi, pi] rounded and differenced the shorter
    way round. At the first sample v is zero: the arm stood still. Joints whose count is zero keep q
    and v as they come.

    Attributes:
        present: whether any joint has one.
    """

    def __init__(self, robot: Robot, counts: ArrayLike, dt: float) -> None:
        """Take the size of a count, one or one a joint (nv) [rad or m], and the period dt [s].

        Raises:
            InputError: wrong size, or negative or non-finite counts.
        """
        model = self._model = robot.model
        size = vector(counts, model.nv, "encoder", names=robot.joint_names)
        if (size < 0.0).any():
            raise InputError(f"a count must not be negative, got {size.tolist()}.", where="encoder")
        self._dt, self._there = dt, size > 0.0
        self._count = np.where(self._there, size, 1.0)
        self.present = bool(self._there.any())
        self.reset()

    def reset(self) -> None:
        """Forget the last sample."""
        self._last: np.ndarray | None = None

    def read(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the next sample's q (nq) and v (nv) as the encoders tell them."""
        model, plain = self._model, self._model.nq == self._model.nv
        angles = q if plain else angles_from_configuration(model, q)
        counted = np.where(self._there, np.rint(angles / self._count) * self._count, angles)
        read = counted if plain else configuration_from_angles(model, counted)
        last, self._last = read if self._last is None else self._last, read
        way = read - last if plain else pin.difference(model, last, read)
        return read, np.where(self._there, way / self._dt, v)
