"""Estimates kept where the gravity torque that they stand for is bounded."""

from __future__ import annotations

import numpy as np

from .._checks import vector
from ..bibliography import DIXON
from ..exceptions import GainError, InputError
from ..models.dynamics import Dynamics
from .adaptation import Adaptation, Wrapper
from .drive import Drive, Estimate
from .least_squares import LeastSquares

_ROUNDS = 200
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

    sources = (DIXON,)

    def __init__(self, inner: Adaptation, dynamics: Dynamics, bound: np.ndarray) -> None:
        """Take the adaptation, the dynamics whose parameters it moves, and G (n) [N m or N].

        Raises:
            GainError: bounds that are not positive.
            InputError: least squares.
        """
        super().__init__(inner)
        if _remembers(inner):
            raise InputError(
                f"the metric of '{inner.name}' is memory, in which nothing is projected.",
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
        for _ in range(_ROUNDS):
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


def _remembers(adaptation: Adaptation) -> bool:
    """Tell whether the metric of an adaptation changes with what it remembers."""
    while isinstance(adaptation, Wrapper):
        adaptation = adaptation.inner
    return isinstance(adaptation, LeastSquares)
