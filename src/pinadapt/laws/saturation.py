"""A saturating function of the task error that has a potential."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._checks import numbers, positive
from ..exceptions import GainError
from ..tasks.task import Task


@dataclass(frozen=True, eq=False)
class Saturation:
    """s(dx) = w tanh(dx / w) by rows; w tanh(|phi| / w) phi / |phi| of a rotation vector.

    Near zero s(dx) = dx, far away |s_i| <= w_i. With diagonal K_P, one number on the rotations,
    K_P s is the gradient of S(dx) = sum K_P,i w_i^2 log cosh(dx_i / w_i), so that dS/dt =
    (K_P s)^T d(dx)/dt: radially also where d(phi)/dt is not the angular velocity, as phi^T
    d(phi)/dt = phi^T omega. S. Arimoto's saturating functions, with tanh in place of the sine.

    Attributes:
        task: whose errors are taken.
        width: (m) w [m or rad], equal on the rows of a rotation.
    """

    task: Task
    width: Any
    _turning: Any = field(init=False, default=None, repr=False)

    def __post_init__(self) -> None:
        """Turn the width into one a row.

        Raises:
            GainError: not positive, of another size, or different on the axes of a rotation.
        """
        given = numbers(self.width, "width", error=GainError)
        if given.shape not in ((), (self.task.size,)):
            raise GainError(
                f"expected one number or {self.task.size}, got shape {given.shape}.", where="width"
            )
        width = np.broadcast_to(given, self.task.size).astype(float)
        for w in width:
            positive(float(w), "width")
        for group in self.task.groups:
            if group.name == "rotation":
                if np.ptp(width[group.rows]) > 0.0:
                    raise GainError("must be one number on the rotation rows.", where="width")
                object.__setattr__(self, "_turning", group.rows)
        object.__setattr__(self, "width", width)

    def of(self, dx: np.ndarray) -> np.ndarray:
        """Return s (m) of an error dx (m) [m or rad]."""
        s = np.asarray(self.width * np.tanh(dx / self.width))
        if self._turning is not None:
            phi, w = dx[self._turning], self.width[self._turning][0]
            s[self._turning] = _gain(float(np.linalg.norm(phi)), w) * phi
        return s

    def rate(self, dx: np.ndarray, dxd: np.ndarray) -> np.ndarray:
        """Return ds/dt (m) of an error dx (m) that moves at dxd (m)."""
        sd = np.asarray(dxd / np.cosh(np.minimum(np.abs(dx / self.width), 300.0)) ** 2)
        if self._turning is not None:
            phi, phid = dx[self._turning], dxd[self._turning]
            w, size = self.width[self._turning][0], float(np.linalg.norm(phi))
            gain = _gain(size, w)
            along = phi @ phid / size**2 if size > 0.0 else 0.0
            slope = 1.0 / np.cosh(min(size / w, 300.0)) ** 2
            sd[self._turning] = gain * phid + (slope - gain) * along * phi
        return sd

    def potential(self, dx: np.ndarray) -> np.ndarray:
        """Return S_i (m) with S = sum K_P,i S_i [m^2 or rad^2]; a rotation's in its first row."""
        x = np.abs(dx)
        if self._turning is not None:
            x[self._turning] = 0.0
            x[self._turning.start] = np.linalg.norm(dx[self._turning])
        u = x / self.width
        return np.asarray(self.width**2 * (u + np.log1p(np.exp(-2.0 * u)) - np.log(2.0)))


def _gain(size: float, w: float) -> float:
    """Return w tanh(size / w) / size."""
    return float(w * np.tanh(size / w) / size) if size > 0.0 else 1.0
