"""Natural adaptation: the gradient in the metric of a cone, which the estimate never leaves.

``Natural`` has the log-det metric of positive definite matrices, ``ExponentiatedGradient`` that of
the relative entropy of positive numbers.

T. Lee, J. Kwon, F. C. Park, *A natural adaptive control law for robot manipulators*, IROS 2018;
P. M. Wensing, J.-J. Slotine, *Beyond convexity - contraction and global convergence of gradient
descent*, PLoS ONE 2020.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy import empty
from numpy.typing import ArrayLike

from .._checks import MOST_PARAMETERS, instance, name_list, numbers, positive, whole
from .._kernels import estimates as kernels
from ..exceptions import ParameterError
from ..models.basis import read_matrix
from ..models.bodies import COEFFICIENTS, nearest_physical, unphysical_bodies
from ..models.regressor import PER_BODY
from .adaptation import Adaptation, Drive, Estimate, positive_numbers

# Of a sampled step in the metric, that is relative to the estimate. A load on a light wrist is many
# lengths away from the wrist, so that it falls for 0.1 s at the start: 0.01: 23 mm on a UR10 at
# 1 kHz; 0.02: 22; 0.04: 19; 0.06: 16, but then a flange of 80 g that carries 1 kg is spun, and 9 in
# place of 5 of 24 arms are lost with encoders of 14 bits that were not declared
_LONGEST = 0.02


class MatrixInequality:
    """Linear matrix inequality: the set of a with P_b(a) = sum_i a_{b,i} F_i > 0 for k b.

    The blocks b share the matrices F. A user's own inequality has one block; the pseudo-inertias of
    a robot's bodies are k blocks.

    Attributes:
        F: (p, n, n) coefficient matrices of one block, symmetric and linearly independent.
        blocks: k.
        size: number of parameters of all blocks.
        complete: whether the F_i span all symmetric matrices, p = n (n + 1) / 2.
    """

    def __init__(self, F: ArrayLike, *, blocks: int = 1) -> None:
        """Make the inequality of ``blocks`` blocks.

        Args:
            F: (p, n, n) coefficient matrices of a block.
            blocks: k; of several blocks the matrices must span all symmetric ones.

        Raises:
            ParameterError: wrong shape, or matrices that are not symmetric or linearly dependent.
        """
        self.F = F = numbers(F, "LMI", error=ParameterError)
        valid = F.ndim == 3 and F.size > 0 and F.shape[1] == F.shape[2]
        valid = valid and np.allclose(F, F.transpose(0, 2, 1))
        if not valid or np.linalg.matrix_rank(F.reshape(len(F), -1)) < len(F):
            raise ParameterError(
                "expected p symmetric and linearly independent matrices, shape (p, n, n), got "
                f"shape {F.shape}.",
                where="LMI",
            )
        self.blocks = whole(blocks, "blocks", 0, most=MOST_PARAMETERS)
        self._p, self._n, _ = F.shape
        self.size = self.blocks * self._p
        self.complete = self._p == self._n * (self._n + 1) // 2
        self._flat = flat = F.reshape(self._p, -1)  # rows F_i
        self._dual = np.linalg.solve(flat @ flat.T, flat)  # rows D_i
        dual = _entries(self._dual.reshape(F.shape))
        self._constants = (self._p, self._n, *_entries(F), *dual)

    @classmethod
    def from_file(cls, path: Path) -> MatrixInequality:
        """Read F from a CSV file: a row per parameter, with the n x n entries of its matrix.

        Raises:
            ParameterError: no such file, or rows that are not square matrices.
        """
        rows = read_matrix(path)
        n = round(rows.shape[1] ** 0.5)
        if n * n != rows.shape[1]:
            raise ParameterError(
                f"each row must hold n x n numbers, got {rows.shape[1]}.", where=path
            )
        return cls(rows.reshape(-1, n, n))

    def matrices(self, a: np.ndarray) -> np.ndarray:
        """Return P (k, n, n) at parameters a (k p)."""
        return a.reshape(self.blocks, self._p).dot(self._flat).reshape(-1, self._n, self._n)

    def metric(self, a: np.ndarray) -> np.ndarray:
        """Return the Hessian of -log det (p, p) at a (p): tr(P^-1 F_i P^-1 F_j), of one block."""
        G = np.linalg.solve(self.matrices(a)[0], self.F)
        return np.einsum("iab,jba->ij", G, G)

    def metric_inverse_times(self, a: np.ndarray, X: np.ndarray, gamma: np.ndarray) -> np.ndarray:
        """Return the inverse metric of -log det at a (k p), of block b times gamma_b, times X.

        In a complete set, column i of a block has the coordinates of P L P with tr(L P(da)) = da_i.

        Args:
            a: (k p) parameters.
            X: (k p, l).
            gamma: (k) factors of the blocks.
        """
        if not self.complete:
            return gamma * np.linalg.solve(self.metric(a), X)
        P = gamma[:, None, None] ** 0.5 * self.matrices(a)
        size = self._n**2
        both = P[:, :, None, :, None] * P[:, None, :, None, :]  # P L P is this times L
        blocks = self._dual @ both.reshape(-1, size, size) @ self._dual.T
        return (blocks @ X.reshape(len(blocks), self._p, X.shape[1])).reshape(X.shape)

    def contains(self, a: np.ndarray) -> bool:
        """Return whether every block is positive definite at a (k p)."""
        P = self.matrices(a)
        return bool(np.isfinite(P).all() and (np.linalg.eigvalsh(P) > 0.0).all())

    def step(self, a: np.ndarray, g: np.ndarray, h: float, most: float = math.inf) -> np.ndarray:
        """Return the parameters (k p) after a step h of dP/dt = -P L P, tr(L P(da)) = g . da.

        In a complete set it follows the geodesic P+ = exp(-h P L) P, by the series of exp(-x) up to
        the fourth order, which is positive for all x: P+ is positive definite for any h. In others
        it is a straight step, which has to stay below a length of one to remain inside. A step
        longer than ``most`` in the log-det metric is shortened to that length.
        """
        if self.complete:
            after = empty(a.size)
            kernels.follow_geodesic(a, g, *self._constants, h, most, after)
            return after
        metric = self.metric(a)
        step = -h * np.linalg.solve(metric, g)
        length = math.sqrt(step @ metric @ step)
        return a + step * (most / length if length > most else 1.0)

    def validate(self, a: np.ndarray) -> np.ndarray:
        """Return the initial estimate a (k p) if it satisfies the inequality.

        Raises:
            ParameterError: it does not.
        """
        if not self.contains(a):
            raise ParameterError(
                f"the initial estimate {np.round(a, 6).tolist()} is outside the matrix inequality "
                "of natural adaptation.",
                where="start.a_d",
                hint="Start from an estimate inside, or use gradient adaptation.",
            )
        return a


def _entries(F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places (k, 3) and values (k) of what is more than rounding in F (p, n, n)."""
    some = np.abs(F) > np.finfo(float).eps * np.abs(F).max()
    return np.ascontiguousarray(np.argwhere(some)), F[some]


class BodyInequality(MatrixInequality):
    """Physical inertial parameters: the pseudo-inertia of each body is positive definite."""

    def __init__(
        self, names: Sequence[str], *, least_mass: float = 1e-6, least_radius: float = 1e-3
    ) -> None:
        """Make the inequality of as many bodies as there are names.

        Args:
            names: of the bodies, for messages.
            least_mass: of bodies that ``validate`` makes physical [kg].
            least_radius: of these [m]: their second moment about the centre of mass becomes at
                least mass times radius squared.
        """
        self._names = tuple(name_list(names, "names"))
        super().__init__(COEFFICIENTS, blocks=len(self._names))
        self._least = {
            "least_mass": positive(least_mass, "least_mass"),
            "least_radius": positive(least_radius, "least_radius"),
        }

    def validate(self, a: np.ndarray) -> np.ndarray:
        """Return a (10 k) with unphysical bodies made physical; a warning names them."""
        names = unphysical_bodies(a, self._names)
        if not names:
            return a
        warnings.warn(
            f"the inertias of the bodies moved by {names} are not physical (pseudo-inertia not "
            "positive definite); the initial estimate was moved to physical values close by.",
            stacklevel=2,
        )
        repaired = [
            nearest_physical(pi, **self._least) if name in names else pi
            for name, pi in zip(self._names, a.reshape(-1, PER_BODY), strict=True)
        ]
        return np.concatenate(repaired)


class Natural(Adaptation):
    """dP/dt = -gamma P L P for each P = P_b(a), with L such that tr(L P(da)) = g . da.

    The adaptation's part of V is the sum over the matrices of
    (log|P| - log|P_true| + tr(P^-1 P_true) - n) / gamma. Matrices may have relative rates c:
    dP/dt = -gamma c P L P, and their terms of V are divided by c.

    The estimate stays inside the cone for every step length. In a complete cone it moves along the
    geodesic P+ = S exp(-h gamma S^T L S) S^T, P = S S^T, in others by a step inside the Dikin
    ellipsoid of log det. A sampled step is at most 0.02 long in the log-det metric, two per cent in
    any direction: at a start far from the path a sampled gradient is a poor approximation of the
    continuous-time law, and without the limit the estimate could diverge between two measurements.
    ``rate`` is not limited.

    Attributes:
        cone: the set of the parameters.
        gamma: the gain.
        shares: (k) relative rates c, one a matrix of the cone, or None where all are one.
    """

    name = "natural"
    sources = ("LeeKwonPark2018", "WensingSlotine2020")

    def __init__(
        self,
        gamma: float,
        cone: MatrixInequality,
        *,
        shares: ArrayLike | None = None,
    ) -> None:
        """Choose gain, cone, and relative rates of its matrices.

        Args:
            gamma: the gain.
            cone: the set of the parameters.
            shares: (k) relative rates of the cone's matrices; None: all one.

        Raises:
            GainError: gamma is not positive, or shares are not k positive numbers.
            InputError: not a cone.
        """
        self.gamma = positive(gamma, "gamma_d")
        self.cone = instance(cone, MatrixInequality, "cone")
        c = positive_numbers(1.0 if shares is None else shares, "shares", cone.blocks)
        self.shares = None if shares is None else c
        self._gammas = self.gamma * c
        self._scale = np.repeat(c, cone.size // max(cone.blocks, 1))

    def init(self, value: np.ndarray, information: np.ndarray | None = None) -> Estimate:
        """Return the estimate to start from, inside the cone; see ``MatrixInequality.validate``."""
        return Estimate(self.cone.validate(value))

    def contains(self, value: np.ndarray) -> bool:
        """Return whether a value (p) is inside the cone."""
        return self.cone.contains(value)

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return da/dt (p)."""
        return Estimate(-self.gain_times(estimate, drive.gradient[:, None])[:, 0])

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held; inside the cone for any dt."""
        g = drive.gradient if self.shares is None else self._scale * drive.gradient
        return Estimate(self.cone.step(estimate.value, g, self.gamma * dt, _LONGEST))

    def gain_times(self, estimate: Estimate, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l); Gamma is block-diagonal, one block a matrix of the cone."""
        return self.cone.metric_inverse_times(estimate.value, X, self._gammas)

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the log-det divergence from the truth over gamma; None outside the cone."""
        both = np.stack([self.cone.matrices(estimate.value), self.cone.matrices(truth)])
        if not np.isfinite(both).all():
            return None
        try:
            L, L_true = np.linalg.cholesky(both)  # more accurate than P for thin bodies
        except np.linalg.LinAlgError:
            return None
        roots = np.diagonal(L, axis1=1, axis2=2) / np.diagonal(L_true, axis1=1, axis2=2)
        traces = np.square(np.linalg.solve(L, L_true)).sum(axis=(1, 2))
        terms = 2.0 * np.log(roots).sum(axis=1) + traces - L.shape[1]
        return np.sum(terms / self._gammas)


class ExponentiatedGradient(Adaptation):
    """da/dt = -gamma c a g with scales c, entry by entry: estimates stay positive.

    The adaptation's part of V is the sum of (a_true log(a_true / a) + a - a_true) / (c gamma). It
    is the natural gradient of the relative entropy. A step is a+ = a exp(-gamma dt c g), positive
    for every dt, and limited to a change of two per cent.

    The log-det metric of bodies would give da/dt = -gamma a^2 g. That is positive too, but from a
    hundredth of the truth it learns a hundred times more slowly, and its V is undefined where the
    truth is zero, as friction may be.

    N. Boffi, J.-J. Slotine, *Implicit regularization and momentum algorithms in nonlinearly
    parameterized adaptive control and prediction*, Neural Computation 33 (2021), for any Bregman
    divergence.

    Attributes:
        gamma: the gain.
        scale: (p) c, typical sizes of the parameters; where a = c the rate is that of the log-det
            metric.
    """

    name = "natural"
    sources = ("BoffiSlotine2021",)

    def __init__(self, gamma: float, scale: ArrayLike) -> None:
        """Choose the gain and the scales (p).

        Raises:
            GainError: one of them is not positive.
        """
        self.gamma = positive(gamma, "gamma_joint")
        self.scale = np.atleast_1d(positive_numbers(scale, "gamma_joint: scale"))
        self._rates = self.gamma * self.scale

    def init(self, value: np.ndarray, information: np.ndarray | None = None) -> Estimate:
        """Return the estimate to start from, if all its entries are positive.

        Raises:
            ParameterError: they are not.
        """
        if not self.contains(value):
            raise ParameterError(
                f"the initial joint coefficients must be positive, got {value.tolist()}.",
                where="start.a_d",
            )
        return Estimate(value)

    def contains(self, value: np.ndarray) -> bool:
        """Return whether all entries of a value (p) are positive."""
        return bool((value > 0.0).all())

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return da/dt (p)."""
        return Estimate(-self._rates * estimate.value * drive.gradient)

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held."""
        a = estimate.value
        after = empty(a.size)
        kernels.exponentiate(a, drive.gradient, self._rates, dt, _LONGEST, after)
        return Estimate(after)

    def gain_times(self, estimate: Estimate, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l), Gamma = gamma diag(c a)."""
        return (self._rates * estimate.value)[:, None] * X

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the sum of (a_true log(a_true / a) + a - a_true) / (c gamma).

        None where a value is not positive or a true one negative.
        """
        value = estimate.value
        if not (self.contains(value) and (truth >= 0.0).all()):
            return None
        from scipy.special import kl_div  # here, because scipy is slow to import

        return np.sum(kl_div(truth, value) / self._rates)
