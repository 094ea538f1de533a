"""Gradient adaptation that keeps the estimated mass matrix positive definite."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh
from scipy.linalg.lapack import dpotrf

from ..exceptions import DivergedError
from ..parameters import DynamicParameters
from ..parameters.inertial_model import InertialModel
from ..robot import Robot
from .gradient import Gradient

_LEAST, _RESTORED = 0.10, 0.12  # of the believed mass matrix: where the projection acts, and how far it goes
_ROUNDS = 200


class Projected(Gradient):
    """da/dt = -Gamma g, projected onto {a : M_hat(q; a) >= 0.1 M_0(q)} at the measured q, M_0 the believed robot's mass matrix.

    M_hat is affine in a, so the set is convex, and it contains the truth for every q as long as the true robot has in every
    direction at least 12 % of the believed inertia. It is cut out of half-spaces u^T M_hat(q; a) u >= 0.1 u^T M_0(q) u: while
    the mass matrix violates one, for the eigenvector u of its smallest eigenvalue relative to M_0, the estimate is moved to the
    nearest point of it in the metric Gamma^-1. Each of these moves brings it closer to all points of the half-space, the truth
    among them, so the projection can only lower V; and M_hat stays invertible with a margin that knows no units.

    No cone of physical bodies is needed, only that the torque is affine in a: for bodies, a basis or lumped parameters.
    """

    name = "projected"

    def __init__(self, Gamma: ArrayLike, dynamics: DynamicParameters, robot: Robot, name: str = "gamma_d") -> None:
        """Take the gain, the parameters that it moves, and the believed robot that they were made for.

        Raises:
            GainError: a gain that is not positive definite, or of another size.
        """
        super().__init__(Gamma, dynamics.size, name)
        self._dynamics = dynamics
        self._believed = InertialModel(robot.model)
        self._zero = np.zeros(robot.model.nv)

    def keep(self, a: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return the estimate (p) itself, or projected where M_hat(q; a) is not positive enough.

        Raises:
            DivergedError: the half-spaces were not met in 200 moves, which a finite estimate should not need.
        """
        dynamics, M_0 = self._dynamics, self._believed.mass_matrix(q)
        for _ in range(_ROUNDS):
            dynamics.load(a)
            M = dynamics.mass_matrix(q)
            if dpotrf(M - _LEAST * M_0)[1] == 0:
                return a
            if not np.isfinite(M).all():
                break
            ratios, vectors = eigh(M, M_0, subset_by_index=(0, 0))
            u = vectors[:, 0]
            c = u.dot(dynamics.regressor(q, self._zero, u) - dynamics.regressor(q, self._zero, self._zero))
            step = self.Gamma.dot(c)
            a = a + step * ((_RESTORED - ratios[0]) / c.dot(step))  # u^T M_0 u = 1
        raise DivergedError("the estimated mass matrix could not be kept positive definite.")
