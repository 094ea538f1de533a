"""Adaptation of coefficients that are never negative, such as friction and rotor inertia."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .._checks import positive, vector
from .._kernels import adaptation as kernels
from ..bibliography import BOFFI_SLOTINE
from ..exceptions import GainError, ParameterError
from ..records import named
from .adaptation import Adaptation
from .drive import Drive, Estimate

_LARGEST_STEP = 0.02


class ExponentiatedGradient(Adaptation):
    """da/dt = -gamma c a g, with scales c.

    Its part of V is the sum of (a_true log(a_true / a) + a - a_true) / c over gamma.

    The natural gradient of the relative entropy; N. Boffi and J.-J. Slotine, *Implicit
    regularization and momentum algorithms in nonlinearly parameterized adaptive control and
    prediction*, Neural Computation 33 (2021), allow any Bregman divergence. An estimate stays
    positive for every step length, a+ = a exp(-gamma dt c g). The log-det metric of bodies would
    give da/dt = -gamma a^2 g, positive too, but learns a hundred times slower from a hundredth of
    the truth, and its V is undefined where the truth is zero, as friction may be. One sample
    changes an estimate by at most two per cent, as for bodies.

    Attributes:
        gamma: the one gain.
        scale: (p) c, typical sizes of the coefficients: where a = c the rate is that of the log-det
            metric.
    """

    name = "natural"
    sources = (BOFFI_SLOTINE,)

    def __init__(self, gamma: float, scale: ArrayLike, name: str = "gamma_joint") -> None:
        """Take the gain and the scales (p).

        Raises:
            GainError: one of them is not positive.
        """
        self.gamma = positive(gamma, name)
        self.scale = vector(scale, None, f"{name}: scale", error=GainError)
        if not (self.scale > 0.0).all():
            raise GainError(f"scales must be positive, got {self.scale.tolist()}.", where=name)

    def validate(self, value: np.ndarray) -> np.ndarray:
        """Return the initial value (p) if all of it is positive.

        Raises:
            ParameterError: it is not.
        """
        if not self.contains(value):
            raise ParameterError(
                "the initial estimates of the joints' coefficients must be positive, got "
                f"{value.tolist()}.",
                where="belief.dynamic",
            )
        return value

    def contains(self, value: np.ndarray) -> bool:
        """Tell whether all of a value (p) is positive."""
        return bool((value > 0.0).all())

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return da/dt (p)."""
        return Estimate(-self.gamma * self.scale * estimate.value * drive.gradient)

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held."""
        a = estimate.value
        after = np.empty(a.size)
        kernels.exponentiate(a, drive.gradient, self.scale, self.gamma * dt, _LARGEST_STEP, after)
        return named(Estimate, (after, ()))

    def gain_times(self, value: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l), Gamma = gamma diag(c a)."""
        return np.asarray((self.gamma * self.scale * value)[:, None] * X)

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float | None:
        """Return the relative entropy from the truth, in scales, over gamma.

        None where an estimate is not positive or a truth negative.
        """
        if not (self.contains(value) and (truth >= 0.0).all()):
            return None
        least = np.finfo(float).tiny
        entropy = np.where(truth > 0.0, truth * np.log(np.maximum(truth, least) / value), 0.0)
        return float(np.sum((entropy + value - truth) / self.scale) / self.gamma)
