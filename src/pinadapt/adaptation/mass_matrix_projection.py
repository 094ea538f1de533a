"""Estimates kept where the estimated mass matrix is positive definite."""

from __future__ import annotations

import numpy as np

from ..exceptions import DivergedError
from ..models.dynamics import Dynamics
from ..models.inertial_model import InertialModel
from ..robot.robot import Robot
from .adaptation import Adaptation, Wrapper
from .drive import Estimate
from .gradient import Gradient

_LEAST = 0.10  # of the believed mass matrix: where the projection acts ...
_RESTORED = 0.12  # ... and how far it goes
_ROUNDS = 50
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
        for _ in range(_ROUNDS):
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
