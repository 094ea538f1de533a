"""Estimates kept in a box."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from .._checks import vector
from .._kernels import adaptation as kernels
from ..exceptions import DivergedError, GainError, InputError, ParameterError
from ..models.bodies import InertialModel
from ..models.dynamics import Dynamics
from ..robot.robot import Robot
from .adaptation import Adaptation, Drive, Estimate, Wrapper
from .gradient import Gradient

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

    sources = ("IoannouSun1996",)

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

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return what the inner adaptation adds to dV/dt, less what the walls take off."""
        own = self.inner.dissipation(estimate, drive, truth)
        if kernels.inside(estimate.value, self.low, self.high):
            return own
        change = self.rate(estimate, drive).value - self.inner.rate(estimate, drive).value
        return own + self.inner.power(estimate, change, truth)

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


_LEAST = 0.10  # of the believed mass matrix: where the projection acts ...
_RESTORED = 0.12  # ... and how far it goes
_MASS_MATRIX_ROUNDS = 50
_LOST = "the estimated mass matrix could not be kept positive definite."


class MassMatrixProjection(Wrapper):
    """Any adaptation, projected onto {a : M_hat(q; a) >= 0.1 M_0(q)} at the measured q.

    M_0 is the believed robot's mass matrix. M_hat is affine in a, so the set is convex, and it
    contains the truth for every q as long as the true robot has in every direction at least 12 % of
    the believed inertia. It is cut out of half-spaces u^T M_hat(q; a) u >= 0.12 u^T M_0(q) u: each
    eigenvalue of M_hat below 0.1 relative to M_0 gives one by its eigenvector u, and the estimate
    becomes the point nearest to it, in the inner adaptation's metric Gamma^-1 at the estimate with
    its memory, that satisfies all of them, until no such eigenvalue is left. The nearest point of a
    convex set is nearer to all points of that set, the truth among them, so the projection can only
    lower V; and M_hat stays invertible with a margin that knows no units.

    No cone of physical bodies is needed, only that the torque is affine in a: for bodies, a basis
    or lumped parameters.
    """

    def __init__(self, inner: Adaptation, dynamics: Dynamics, robot: Robot) -> None:
        """Take the adaptation, the dynamics whose parameters it moves, and the believed robot."""
        super().__init__(inner)
        self.name = "projected" if inner.name == Gradient.name else inner.name
        self._dynamics, self._believed = dynamics, InertialModel(robot.model)
        self._zero = np.zeros(robot.model.nv)

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) itself, or projected where M_hat(q; a) is not positive enough.

        Raises:
            DivergedError: no parameters give a positive mass matrix, or the value is not finite.
        """
        from scipy.linalg import eigh  # here, because scipy is slow to import
        from scipy.linalg.lapack import dpotrf

        value, M_0, root = estimate.value, self._believed.mass_matrix(q), None
        kept = value
        cuts: list[np.ndarray] = []
        bounds: list[float] = []
        for _ in range(_MASS_MATRIX_ROUNDS):
            self._dynamics.load(kept)
            M = self._dynamics.mass_matrix(q)
            if dpotrf(M - _LEAST * M_0)[1] == 0:
                return self.inner.project(estimate._replace(value=kept), q)
            if not np.isfinite(M).all():
                break
            root = np.linalg.cholesky(self.inner.metric(estimate)) if root is None else root
            ratios, vectors = eigh(M, M_0)
            rest = self._dynamics.regressor(q, self._zero, self._zero)
            for ratio, u in zip(ratios, vectors.T, strict=True):
                if ratio < _LEAST:  # u^T M_0 u = 1, and u^T M_hat u = c a + known
                    c = u.dot(self._dynamics.regressor(q, self._zero, u) - rest)
                    cuts.append(c.dot(root))
                    bounds.append(_RESTORED - ratio + c.dot(kept - value))
            kept = value + root.dot(_least_move(np.array(cuts), np.array(bounds)))
        raise DivergedError(_LOST)


def _least_move(G: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return the shortest x (p) with G x >= h, G (k, p).

    Least distance programming by nonnegative least squares: C. Lawson and R. Hanson, *Solving Least
    Squares Problems*, 1974, chapter 23. The rows are scaled to one.

    Raises:
        DivergedError: there is none.
    """
    from scipy.optimize import nnls  # slow to import, and seldom needed

    scale = np.linalg.norm(G, axis=1)
    if not (scale > 0.0).all():
        raise DivergedError(_LOST)
    G, size = G / scale[:, None], np.abs(h / scale).max()
    E = np.vstack([G.T, h / (scale * size)])
    target = np.append(np.zeros(G.shape[1]), 1.0)
    try:
        residual = E @ nnls(E, target)[0] - target
    except RuntimeError as error:  # its iterations did not end
        raise DivergedError(_LOST) from error
    if residual[-1] > -1e-12:
        raise DivergedError(_LOST)
    return np.asarray(-size * residual[:-1] / residual[-1])


_GRAVITY_ROUNDS = 200
_TOLERANCE = 1e-9  # of the bound


class GravityProjection(Wrapper):
    """Any adaptation, kept where |g_i(q; a)| <= G_i for each joint i at the measured q.

    A slab {a : -G_i <= Z_i(q) a + g_0,i(q) <= G_i} is convex and holds the truth wherever the true
    gravity torque is within G. An estimate beyond one of its faces moves back to it along the
    adaptation's own flow under the drive Z_i^T e, e the sign of the excess: da/dt = -Gamma(a) Z_i^T
    e lowers the adaptation's part of V, dD/dt = -e (Z_i a - Z_i a_true) <= 0, as long as the truth
    is on the other side of the face. With a constant Gamma that is the projection in the metric
    Gamma^-1; natural adaptation stays in its cone. The length of the flow is found by Newton's
    iteration, the faces are taken in turn.

    For an adaptation whose metric is memory, as that of least squares, dD/dt is another: it is
    refused.

    Attributes:
        inner: the adaptation that it wraps.
        bound: (n) G [N m or N].
    """

    sources = ("Dixon2007",)

    def __init__(self, inner: Adaptation, dynamics: Dynamics, bound: np.ndarray) -> None:
        """Take the adaptation, the dynamics whose parameters it moves, and G (n) [N m or N].

        Raises:
            GainError: bounds that are not positive.
            InputError: least squares.
        """
        super().__init__(inner)
        if inner.updates_gain:
            raise InputError(
                f"'{inner.name}' updates its gain, in whose metric gravity is not projected.",
                where="adaptation",
                hint='Take "natural-composite" or "composite".',
            )
        self.bound = vector(bound, None, "gravity", error=GainError)
        if not (self.bound > 0.0).all():
            raise GainError(f"must be positive, got {self.bound.tolist()}.", where="gravity")
        self._dynamics, self._rest = dynamics, np.zeros(self.bound.size)

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) itself, or moved to where the gravity torque at q is bounded."""
        kept = self.inner.project(estimate, q)
        self._dynamics.load(kept)
        gravity = self._dynamics.torque(q, self._rest, self._rest)
        if (np.abs(gravity) <= self.bound).all():
            return kept
        Z = self._dynamics.regressor(q, self._rest, self._rest)
        known, within = gravity - Z.dot(kept), self.bound * (1.0 - _TOLERANCE)
        for _ in range(_GRAVITY_ROUNDS):
            gravity = Z.dot(kept) + known
            i = int(np.argmax(np.abs(gravity) / self.bound))
            excess = abs(gravity[i]) - within[i]
            if not excess > 0.0:
                break
            e = np.sign(gravity[i : i + 1])
            effect = float(Z[i].dot(self.inner.gain_times(kept, Z[i][:, None])[:, 0]))
            if not effect > 0.0:
                break
            drive = Drive(Z[i : i + 1], e)
            kept = self.inner.step(estimate._replace(value=kept), drive, excess / effect).value
        return kept
