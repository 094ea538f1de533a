"""Rest at a point."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._checks import vector
from ..records import Desired
from .trajectory import Trajectory


class Hold(Trajectory):
    """Rest at a fixed point, for set-point control."""

    def __init__(self, point: ArrayLike) -> None:
        """Take the point (m) [m].

        Raises:
            InputError: non-finite coordinates.
        """
        self.point = vector(point, None, "reference.center")
        self._rest = np.zeros(self.point.size)

    @property
    def extent(self) -> float:
        """Zero: it is a point."""
        return 0.0

    @property
    def settles(self) -> float:
        """Zero: it rests."""
        return 0.0

    def shifted(self, by: np.ndarray) -> Hold:
        """Return the point moved by (m) [m]."""
        return Hold(self.point + by)

    def at(self, t: float) -> Desired:
        """Return the point, at rest."""
        return Desired(self.point, self._rest, self._rest)
