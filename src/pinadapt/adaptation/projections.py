"""Projections: estimates kept in a convex set that contains the truth.

``BoxProjection`` keeps every parameter between bounds, ``MassMatrixProjection`` keeps the estimated
mass matrix positive definite, ``GravityProjection`` bounds the estimated gravity torque. Each wraps
any adaptation and projects in its metric Gamma^-1. A projection onto a convex set that contains the
true parameters never increases V.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from .._checks import vector
from .._kernels import estimates as kernels
from ..exceptions import DivergedError, ParameterError
from ..models.dynamics import Dynamics
from ..models.regressor import Regressor
from ..robot.robot import Robot
from .adaptation import Adaptation, Drive, Estimate, Wrapper, positive_numbers
from .gradient import Gradient

_BOX = "limits.box"
# Of M_hat to M_0: where the projection acts, and the ratio that it restores. No run of the zoo's
# arms comes here, also with half or twice of both.
_LEAST_RATIO = 0.10
_RESTORED_RATIO = 0.12
_LOST = "the estimated mass matrix could not be kept positive definite."


class BoxProjection(Wrapper):
    """Any adaptation whose estimate stays in low <= a <= high, by projection in its own metric.

    A rate that points out of the box is replaced by the nearest one that does not, and an estimate
    outside by the nearest one inside. Both are nearest in the metric Gamma^-1 of the inner
    adaptation at its estimate and memory; for least squares that is the current P^-1. This adds
    (a - a_true)^T Gamma^-1 (change) <= 0 to dV/dt for every a_true in the box, so that V decreases
    at least as fast as without the projection. For a truth outside the box nothing is proved.

    With a diagonal Gamma each entry is projected on its own. Where the nearest point of the box is
    outside the inner adaptation's domain, the estimate moves towards it as far as the domain
    allows.

    P. Ioannou, J. Sun, *Robust Adaptive Control*, 1996, section 4.4.

    Attributes:
        inner: the adaptation inside the box.
        low, high: (p) the box.
    """

    sources = ("IoannouSun1996",)

    def __init__(
        self,
        inner: Adaptation,
        low: ArrayLike,
        high: ArrayLike,
        *,
        names: Sequence[str] = (),
    ) -> None:
        """Wrap an adaptation with a box.

        Args:
            inner: the adaptation inside the box.
            low: (p) lower bounds.
            high: (p) upper bounds.
            names: of the parameters, for messages.

        Raises:
            ParameterError: bounds of the wrong size, not finite, or crossed.
        """
        super().__init__(inner)
        size = vector(low, None, _BOX, error=ParameterError).size
        self._names = tuple(names) or tuple(f"parameter {i + 1}" for i in range(size))
        self.low, self.high = (
            vector(bounds, len(self._names), _BOX, names=self._names, error=ParameterError)
            for bounds in (low, high)
        )
        if empty := [self._names[i] for i in np.flatnonzero(self.low >= self.high)]:
            raise ParameterError(
                f"the lower bounds of {empty} are not below the upper bounds.", where=_BOX
            )

    def init(self, value: np.ndarray, information: np.ndarray | None = None) -> Estimate:
        """Return the inner adaptation's start, if that lies in the box.

        Raises:
            ParameterError: it does not.
        """
        estimate = super().init(value, information)
        value = estimate.value
        if outside := np.flatnonzero((value < self.low) | (value > self.high)).tolist():
            i = outside[0]
            raise ParameterError(
                f"the initial estimate {self._names[i]} = {value[i]:.4g} is outside its box "
                f"[{self.low[i]:.4g}, {self.high[i]:.4g}].",
                where=_BOX,
                hint="Start inside the box, or give a wider one.",
            )
        return estimate

    def contains(self, value: np.ndarray) -> bool:
        """Return whether a value (p) is in the box and in the inner adaptation's domain."""
        inside = (self.low <= value).all() and (value <= self.high).all()
        return bool(inside) and self.inner.contains(value)

    def _added(self, estimate: Estimate, drive: Drive) -> np.ndarray | None:
        """Return what keeps the rate of a value on the boundary from pointing out of the box."""
        if kernels.inside(estimate.value, self.low, self.high):
            return None
        low = np.where(estimate.value <= self.low, 0.0, -np.inf)
        high = np.where(estimate.value >= self.high, 0.0, np.inf)
        free = self.inner.value_rate(estimate, drive)
        return self._nearest(free, low, high, estimate) - free

    def value_rate(self, estimate: Estimate, drive: Drive) -> np.ndarray:
        """Return the value (p) of ``rate``."""
        rate = self.inner.value_rate(estimate, drive)
        added = self._added(estimate, drive)
        return rate if added is None else rate + added

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s]; its value is in the box for any dt."""
        after = self.inner.step(estimate, drive, dt)
        if kernels.inside(after.value, self.low, self.high):
            return after
        updated = after.with_value(estimate.value)  # with the gain that V has after the step
        nearest = self._nearest(after.value, self.low, self.high, updated)
        return after.with_value(self._within_domain(estimate.value, nearest))

    def _nearest(
        self, x: np.ndarray, low: np.ndarray, high: np.ndarray, at: Estimate
    ) -> np.ndarray:
        """Return the point (p) of low <= . <= high nearest to x in the metric at an estimate."""
        clipped = np.clip(x, low, high)
        Gamma = self.inner.gain(at)
        if not np.isfinite(x).all() or (Gamma == np.diag(np.diag(Gamma))).all():
            return clipped
        from scipy.optimize import lsq_linear  # here, because scipy is slow to import

        root = np.linalg.cholesky(np.linalg.inv(Gamma)).T  # Gamma^-1 = root^T root
        # bounded-variable least squares, exact up to rounding, which the clip below removes
        y = lsq_linear(root, root.dot(x), bounds=(low, high), method="bvls", tol=1e-14).x
        return np.clip(y, low, high)

    def _within_domain(self, a: np.ndarray, to: np.ndarray) -> np.ndarray:
        """Return a point (p) between a and ``to``, in the inner adaptation's domain as a is."""
        if not np.isfinite(to).all():
            return to
        for halvings in range(60):  # then the way is rounding
            point = a + 0.5**halvings * (to - a) if halvings else to
            if self.inner.contains(point):
                return point
        return a


class MassMatrixProjection(Wrapper):
    """Any adaptation, projected onto {a : M_hat(q; a) >= 0.1 M_0(q)} at the measured q.

    M_0 is the mass matrix of the nominal robot. M_hat is affine in a, so the set is convex. It
    contains the truth for every q if the true robot has in every direction at least 12 % of the
    nominal inertia. M_hat stays invertible with a margin that does not depend on units.

    The set is approached by cutting planes. Each eigenvalue of M_hat below 0.1 relative to M_0
    gives, with its eigenvector u, the half-space u^T M_hat(q; a) u >= 0.12 u^T M_0(q) u. The
    estimate becomes the nearest point that satisfies all of them, in the inner adaptation's metric
    Gamma^-1 at the estimate and its memory, and this repeats until no such eigenvalue remains. The
    projection onto a convex set reduces the distance to all points of that set, the truth among
    them, so it can only decrease V.

    It needs no physical bodies, only a torque that is affine in a: the parameters may be those of
    bodies, a user's basis, or lumped ones.
    """

    def __init__(self, inner: Adaptation, dynamics: Dynamics, robot: Robot) -> None:
        """Wrap the adaptation of the parameters of ``dynamics``; ``robot`` is the nominal one."""
        super().__init__(inner)
        self.name = "projected" if inner.name == Gradient.name else inner.name
        self._dynamics = dynamics
        self._nominal = Regressor(robot.model)
        self._zero = np.zeros(robot.model.nv)

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p), projected where M_hat(q; a) has eigenvalues below the bound.

        Raises:
            DivergedError: no parameters satisfy the bound, or the value is not finite.
        """
        from scipy.linalg import eigh  # here, because scipy is slow to import
        from scipy.linalg.lapack import dpotrf

        value = estimate.value
        M_0 = self._nominal.mass_matrix(q)
        kept = value
        cuts: list[np.ndarray] = []
        bounds: list[float] = []
        for _ in range(50):
            self._dynamics.load(kept)
            M = self._dynamics.mass_matrix(q)
            if dpotrf(M - _LEAST_RATIO * M_0)[1] == 0:
                return self.inner.project(estimate.with_value(kept), q)
            if not np.isfinite(M).all():
                break
            root = np.linalg.cholesky(self.inner.gain(estimate))
            ratios, vectors = eigh(M, M_0)
            rest = self._dynamics.regressor(q, self._zero, self._zero)
            for ratio, u in zip(ratios, vectors.T, strict=True):
                if ratio < _LEAST_RATIO:  # u^T M_0 u = 1 and u^T M_hat u = c a + known part
                    c = u.dot(self._dynamics.regressor(q, self._zero, u) - rest)
                    cuts.append(c.dot(root))
                    bounds.append(_RESTORED_RATIO - ratio + c.dot(kept - value))
            kept = value + root.dot(_least_move(np.array(cuts), np.array(bounds)))
        raise DivergedError(_LOST)


def _least_move(G: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return the shortest x (p) with G x >= h, G (k, p).

    Least distance programming by nonnegative least squares: C. Lawson, R. Hanson, *Solving Least
    Squares Problems*, 1974, chapter 23. The rows are scaled to unit length.

    Raises:
        DivergedError: no x satisfies the inequalities.
    """
    from scipy.optimize import nnls  # here, because scipy is slow to import

    scale = np.linalg.norm(G, axis=1)
    if not (scale > 0.0).all():
        raise DivergedError(_LOST)
    G = G / scale[:, None]
    size = np.abs(h / scale).max()
    E = np.vstack([G.T, h / (scale * size)])
    target = np.append(np.zeros(G.shape[1]), 1.0)
    try:
        residual = E @ nnls(E, target)[0] - target
    except RuntimeError as error:  # too many iterations
        raise DivergedError(_LOST) from error
    if residual[-1] > -1e-12:
        raise DivergedError(_LOST)
    return -size * residual[:-1] / residual[-1]


class GravityProjection(Wrapper):
    """Any adaptation, projected onto {a : |g_i(q; a)| <= G_i for each joint i} at the measured q.

    The slab {a : -G_i <= Z_i(q) a + g_0,i(q) <= G_i} is convex, and contains the truth if the true
    gravity torque is within G. An estimate outside one of its faces moves back to the face along
    the adaptation's own flow under the drive Z_i^T e, e the sign of the excess:
    da/dt = -Gamma(a) Z_i^T e decreases the adaptation's part of V,
    dD/dt = -e (Z_i a - Z_i a_true) <= 0, since the truth is on the other side of the face. With a
    constant Gamma this is the projection in the metric Gamma^-1; natural adaptation stays in its
    cone, and least squares keeps its gain. Newton's iteration gives the length of the flow; the
    most violated face comes first.

    After W. Dixon, *Adaptive regulation of amplitude limited robot manipulators with uncertain
    kinematics and dynamics*, IEEE TAC 52 (2007) 488-493.

    Attributes:
        inner: the adaptation that it wraps.
        bound: (n) G [N m or N].
    """

    sources = ("Dixon2007",)

    def __init__(self, inner: Adaptation, dynamics: Dynamics, bound: np.ndarray) -> None:
        """Wrap the adaptation of the parameters of ``dynamics`` with the bound G (n) [N m or N].

        Raises:
            GainError: bounds that are not positive.
        """
        super().__init__(inner)
        self.bound = np.atleast_1d(positive_numbers(bound, "gravity"))
        self._dynamics = dynamics
        self._rest = np.zeros(self.bound.size)

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p), moved where its gravity torque at q exceeds the bound."""
        kept = self.inner.project(estimate, q)
        self._dynamics.load(kept)
        gravity = self._dynamics.torque(q, self._rest, self._rest)
        if (np.abs(gravity) <= self.bound).all():
            return kept
        Z = self._dynamics.regressor(q, self._rest, self._rest)
        known = gravity - Z.dot(kept)
        within = self.bound * (1.0 - 1e-9)
        for _ in range(200):
            gravity = Z.dot(kept) + known
            i = int(np.argmax(np.abs(gravity) / self.bound))
            excess = abs(gravity[i]) - within[i]
            if not excess > 0.0:
                break
            e = np.sign(gravity[i : i + 1])
            at = estimate.with_value(kept)
            effect = Z[i].dot(self.inner.gain_times(at, Z[i][:, None])[:, 0])
            if not effect > 0.0:
                break
            kept = self.inner.step(at, Drive(Z[i : i + 1], e), excess / effect).value
        return kept
