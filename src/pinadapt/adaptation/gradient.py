"""Gradient adaptation with a constant gain, and its multiplicative form for positive parameters."""

from __future__ import annotations

import numpy as np
from numpy import empty
from numpy.typing import ArrayLike

from .._checks import definite_matrix, positive, vector, whole
from .._kernels import estimates as kernels
from ..exceptions import GainError, ParameterError
from .adaptation import Adaptation, Drive, Estimate


class Gradient(Adaptation):
    """da/dt = -Gamma g, as in Wang and Xie (2009), equations (18) and (19).

    The adaptation's part of V is (a - a_true)^T Gamma^-1 (a - a_true) / 2.

    Attributes:
        Gamma: (p, p) constant, symmetric, positive definite.
    """

    name = "gradient"

    def __init__(self, Gamma: ArrayLike, size: int, name: str = "Gamma") -> None:
        """Choose Gamma: a number, p numbers or a matrix (p, p), for p = ``size`` parameters.

        Raises:
            GainError: Gamma is not positive definite, or of another size.
        """
        self.Gamma = np.ascontiguousarray(definite_matrix(Gamma, whole(size, "size", 0), name))
        self._information = np.linalg.inv(self.Gamma)

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return -Gamma g (p)."""
        rate = empty(estimate.value.size)
        kernels.descent(drive.gradient, self.Gamma, rate)
        return Estimate(rate)

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held."""
        a = estimate.value
        after = empty(a.size)
        kernels.descend(a, drive.gradient, self.Gamma, dt, after)
        return Estimate(after)

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float:
        """Return half the squared Gamma^-1 norm of the parameter error."""
        error = value - truth
        return float(0.5 * error @ self._information @ error)

    def gain(self, value: np.ndarray) -> np.ndarray:
        """Return Gamma (p, p)."""
        return self.Gamma

    def gain_times(self, value: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l)."""
        return self.Gamma.dot(X)


_LARGEST_STEP = 0.02  # relative change of an estimate in one step


class ExponentiatedGradient(Adaptation):
    """da/dt = -gamma c a g with scales c, entry by entry: estimates stay positive.

    The adaptation's part of V is the sum of (a_true log(a_true / a) + a - a_true) / (c gamma). It
    is the natural gradient of the relative entropy. A step is a+ = a exp(-gamma dt c g), positive
    for every dt, and limited to a change of two per cent, as for bodies.

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

    def __init__(self, gamma: float, scale: ArrayLike, name: str = "gamma_joint") -> None:
        """Choose the gain and the scales (p); ``name`` is the gain's, for messages.

        Raises:
            GainError: one of them is not positive.
        """
        self.gamma = positive(gamma, name)
        self.scale = vector(scale, None, f"{name}: scale", error=GainError)
        if not (self.scale > 0.0).all():
            raise GainError(f"scales must be positive, got {self.scale.tolist()}.", where=name)

    def validate(self, value: np.ndarray) -> np.ndarray:
        """Return the initial value (p) if all its entries are positive.

        Raises:
            ParameterError: they are not.
        """
        if not self.contains(value):
            raise ParameterError(
                f"the initial joint coefficients must be positive, got {value.tolist()}.",
                where="belief.dynamic",
            )
        return value

    def contains(self, value: np.ndarray) -> bool:
        """Tell whether all entries of a value (p) are positive."""
        return bool((value > 0.0).all())

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return da/dt (p)."""
        return Estimate(-self.gamma * self.scale * estimate.value * drive.gradient)

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held."""
        a = estimate.value
        after = np.empty(a.size)
        kernels.exponentiate(a, drive.gradient, self.scale, self.gamma * dt, _LARGEST_STEP, after)
        return Estimate(after)

    def gain_times(self, value: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l), Gamma = gamma diag(c a)."""
        return np.asarray((self.gamma * self.scale * value)[:, None] * X)

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float | None:
        """Return the sum of (a_true log(a_true / a) + a - a_true) / (c gamma).

        None where a value is not positive or a true one negative.
        """
        if not (self.contains(value) and (truth >= 0.0).all()):
            return None
        least = np.finfo(float).tiny
        entropy = np.where(truth > 0.0, truth * np.log(np.maximum(truth, least) / value), 0.0)
        return float(np.sum((entropy + value - truth) / self.scale) / self.gamma)
