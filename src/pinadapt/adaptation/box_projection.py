"""Estimates kept in a box."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from .._checks import vector
from .._compiled import compiled
from ..exceptions import ParameterError
from .adaptation import Adaptation
from .gradient import Gradient


class BoxProjection(Adaptation):
    """Gradient adaptation whose estimate stays in low <= a <= high, by projection in the metric of Gamma^-1.

    A rate that points out of the box is replaced by the nearest one that does not, an estimate
    outside by the nearest one inside (P. Ioannou and J. Sun, *Robust Adaptive Control*, 1996,
    section 4.4). In the metric of Gamma^-1 the projection adds (a - a_true)^T Gamma^-1 (change) <=
    0 to dV/dt for every a_true in the box: V falls at least as fast as without it. For a truth
    outside the box nothing is proved. A diagonal Gamma projects each entry by itself.

    Attributes:
        inner: the adaptation inside the box.
        low, high: (p) the box.
    """

    def __init__(
        self,
        inner: Gradient,
        low: ArrayLike,
        high: ArrayLike,
        *,
        names: Sequence[str] = (),
        where: str = "box",
    ) -> None:
        """Take the adaptation, the box (p) and (p), and for messages the parameters' names and the box's own.

        Raises:
            ParameterError: bounds of the wrong size, not finite, or crossed.
        """
        size = inner.Gamma.shape[0]
        self.inner, self.name = inner, inner.name
        self._names, self._where = (
            tuple(names) or tuple(f"parameter {i + 1}" for i in range(size)),
            where,
        )
        self.low = vector(low, size, where, names=self._names, error=ParameterError)
        self.high = vector(high, size, where, names=self._names, error=ParameterError)
        empty = [
            name for name, a, b in zip(self._names, self.low, self.high, strict=True) if not a < b
        ]
        if empty:
            raise ParameterError(
                f"the lower bounds of {empty} are not below the upper ones.", where=where
            )
        self._lows, self._highs = self.low.tolist(), self.high.tolist()
        diagonal = (inner.Gamma == np.diag(np.diag(inner.Gamma))).all()
        self._root = (
            None if diagonal else np.linalg.cholesky(np.linalg.inv(inner.Gamma)).T
        )  # Gamma^-1 = root^T root

    def admit(self, a: np.ndarray) -> np.ndarray:
        """Return ``a`` if it lies in the box.

        Raises:
            ParameterError: it does not.
        """
        a = self.inner.admit(a)
        for name, value, low, high in zip(self._names, a, self._lows, self._highs, strict=True):
            if not low <= value <= high:
                raise ParameterError(
                    f"the initial estimate {name} = {value:.4g} is outside its box [{low:.4g}, {high:.4g}].",
                    where=self._where,
                    hint="Start inside, or give a wider box.",
                )
        return a

    def rate(self, a: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Return da/dt (p), which at the boundary does not point out of the box."""
        rate = self.inner.rate(a, g)
        for value, low, high in zip(a.tolist(), self._lows, self._highs):  # noqa: B905
            if not low < value < high:
                break
        else:
            return rate
        return self._nearest(
            rate, np.where(a <= self.low, 0.0, -np.inf), np.where(a >= self.high, 0.0, np.inf)
        )

    def advance(self, a: np.ndarray, g: np.ndarray, dt: float) -> np.ndarray:
        """Return the estimate (p) after dt [s] with g held; inside the box for any dt."""
        after = np.empty(a.size)
        inside = _descend(a, g, self.inner.Gamma, dt, self.low, self.high, after)
        return after if inside else self._nearest(after, self.low, self.high)

    def distance(self, a: np.ndarray, a_true: np.ndarray) -> float:
        """Return the inner adaptation's part of V."""
        return self.inner.distance(a, a_true)

    def _nearest(self, x: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return the point (p) of low <= . <= high nearest to x in the metric of Gamma^-1."""
        clipped = np.minimum(np.maximum(x, low), high)
        if self._root is None or not np.isfinite(x).all():
            return clipped
        from scipy.optimize import lsq_linear  # here, because scipy is slow to import

        # bounded variable least squares, exact up to rounding; its result is clipped against that
        y = lsq_linear(
            self._root, self._root.dot(x), bounds=(low, high), method="bvls", tol=1e-14
        ).x
        return np.minimum(np.maximum(y, low), high)


@compiled("b1(f8[:], f8[:], f8[:,:], f8, f8[:], f8[:], f8[:])")
def _descend(
    a: np.ndarray,
    g: np.ndarray,
    Gamma: np.ndarray,
    dt: float,
    low: np.ndarray,
    high: np.ndarray,
    after: np.ndarray,
) -> bool:
    """Write a - dt Gamma g (p); tell whether it lies in the box."""
    inside = True
    for i in range(len(a)):
        rate = 0.0
        for j in range(len(g)):
            rate -= Gamma[i, j] * g[j]
        after[i] = a[i] + dt * rate
        inside &= low[i] <= after[i] <= high[i]
    return inside
