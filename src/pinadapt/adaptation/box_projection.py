"""Estimates kept in a box."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from .._checks import vector
from .._kernels import adaptation as kernels
from ..bibliography import IOANNOU_SUN
from ..exceptions import ParameterError
from .adaptation import Adaptation, Wrapper
from .drive import Drive, Estimate

_HALVINGS = 60


class BoxProjection(Wrapper):
    """Any adaptation whose estimate stays in low <= a <= high, by projection in its own metric.

    A rate that points out of the box is replaced by the nearest one that does not, an estimate
    outside by the nearest one inside, both in the metric Gamma^-1 of the inner adaptation at its
    estimate, with its memory: of least squares in that of P^-1 as it is by then (P. Ioannou and J.
    Sun, *Robust Adaptive Control*, 1996, section 4.4). That adds
    (a - a_true)^T Gamma^-1 (change) <= 0 to dV/dt for every a_true in the box: V falls at least as
    fast as without it. For a truth outside the box nothing is proved. A diagonal Gamma projects
    each entry by itself. Where the nearest point of the box is outside of the inner adaptation's
    domain, the estimate goes towards it as far as both allow.

    Attributes:
        inner: the adaptation inside the box.
        low, high: (p) the box.
    """

    sources = (IOANNOU_SUN,)

    def __init__(
        self,
        inner: Adaptation,
        low: ArrayLike,
        high: ArrayLike,
        *,
        names: Sequence[str] = (),
        where: str = "box",
    ) -> None:
        """Take the adaptation, the box (p) and (p), and for messages the names of its entries.

        Raises:
            ParameterError: bounds of the wrong size, not finite, or crossed.
        """
        super().__init__(inner)
        size = vector(low, None, where, error=ParameterError).size
        self._names = tuple(names) or tuple(f"parameter {i + 1}" for i in range(size))
        self._where, size = where, len(self._names)
        self.low = vector(low, size, where, names=self._names, error=ParameterError)
        self.high = vector(high, size, where, names=self._names, error=ParameterError)
        bounds = zip(self._names, self.low, self.high, strict=True)
        if empty := [name for name, a, b in bounds if not a < b]:
            what = f"the lower bounds of {empty} are not below the upper ones."
            raise ParameterError(what, where=where)

    def validate(self, value: np.ndarray) -> np.ndarray:
        """Return the initial value (p) if it lies in the box.

        Raises:
            ParameterError: it does not.
        """
        value = self.inner.validate(value)
        for name, a, low, high in zip(self._names, value, self.low, self.high, strict=True):
            if not low <= a <= high:
                raise ParameterError(
                    f"the initial estimate {name} = {a:.4g} is outside its box "
                    f"[{low:.4g}, {high:.4g}].",
                    where=self._where,
                    hint="Start inside, or give a wider box.",
                )
        return value

    def contains(self, value: np.ndarray) -> bool:
        """Tell whether a value (p) is in the box and in the inner adaptation's domain."""
        inside = (self.low <= value).all() and (value <= self.high).all()
        return bool(inside) and self.inner.contains(value)

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the rates, of which the value's does not point out of the box at its boundary."""
        rate, a = self.inner.rate(estimate, drive), estimate.value
        if kernels.inside(a, self.low, self.high):
            return rate
        low, high = np.where(a <= self.low, 0.0, -np.inf), np.where(a >= self.high, 0.0, np.inf)
        return rate._replace(value=self._nearest(rate.value, low, high, estimate))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s]; its value is inside the box for any dt."""
        after = self.inner.step(estimate, drive, dt)
        if kernels.inside(after.value, self.low, self.high):
            return after
        now = after._replace(value=estimate.value)  # the gain that V has by then
        nearest = self._nearest(after.value, self.low, self.high, now)
        return after._replace(value=self._within_domain(estimate.value, nearest))

    def _nearest(
        self, x: np.ndarray, low: np.ndarray, high: np.ndarray, at: Estimate
    ) -> np.ndarray:
        """Return the point (p) of low <= . <= high nearest to x in the metric Gamma^-1 there."""
        clipped = np.minimum(np.maximum(x, low), high)
        Gamma = self.inner.metric(at)
        if not np.isfinite(x).all() or (Gamma == np.diag(np.diag(Gamma))).all():
            return clipped
        from scipy.optimize import lsq_linear  # slow to import, and seldom needed

        root = np.linalg.cholesky(np.linalg.inv(Gamma)).T  # Gamma^-1 = root^T root
        # bounded variable least squares, exact up to rounding; its result is clipped against that
        y = lsq_linear(root, root.dot(x), bounds=(low, high), method="bvls", tol=1e-14).x
        return np.minimum(np.maximum(y, low), high)

    def _within_domain(self, a: np.ndarray, to: np.ndarray) -> np.ndarray:
        """Return the furthest point (p) from a towards ``to`` in the inner adaptation's domain."""
        share = 1.0
        for _ in range(_HALVINGS):
            point = a + share * (to - a) if share < 1.0 else to
            if self.inner.contains(point) or not np.isfinite(to).all():
                return point
            share *= 0.5
        return a
