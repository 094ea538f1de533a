"""Robust modifications of any adaptation: sigma (leak), e1, dead zone and normalisation.

Each wraps another adaptation and bounds its estimate under noise and disturbances. The inner
adaptation's part of V stays; ``dissipation`` states what the modification adds to dV/dt.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from .._checks import positive
from ..exceptions import GainError
from .adaptation import Adaptation, Drive, Estimate, Wrapper, positive_numbers


class Leak(Wrapper):
    """da/dt = (inner rate) - lambda (a - a_0), a_0 the initial value: the sigma modification.

    Noise of the joint velocities makes the mean of Y^T s nonzero. Parameters that the motion does
    not excite then drift without bound; the leak bounds them. It is much slower than the adaptation
    of excited parameters. A step mixes the inner adaptation's result with a_0, so it stays in every
    convex domain that contains both.

    dV/dt changes by -lambda da^T Gamma^-1 (a - a_0), da = a - a_true, an equality in every metric.
    For a constant Gamma this is at most -lambda (D(a) - D(a_0)), D the inner adaptation's part of
    V. With a disturbance d of the closed loop, V decreases wherever the parameter error exceeds a
    bound given by its initial value and by d. The errors therefore remain bounded and converge to a
    neighbourhood of zero that shrinks with lambda.

    P. Ioannou, P. Kokotovic, *Instability analysis and improvement of robustness of adaptive
    control*, Automatica 20 (1984) 583-594. Their leak, -Gamma sigma a, is towards zero; this one is
    towards a_0, at the same rate in all directions.

    Attributes:
        inner: the adaptation that it wraps.
        bandwidth: lambda [1/s].
    """

    sources = ("IoannouKokotovic1984",)
    _parts = 1

    def __init__(self, inner: Adaptation, bandwidth: float) -> None:
        """Wrap an adaptation with a leak of rate lambda [1/s].

        Raises:
            GainError: lambda is not positive.
        """
        super().__init__(inner)
        self.bandwidth = positive(bandwidth, "leak")

    def leak_rate(self, drive: Drive) -> float:
        """Return the rate of the leak [1/s] under a drive, lambda."""
        return self.bandwidth

    def _own(self, start: np.ndarray) -> tuple:
        """Return a_0."""
        return (start.copy(),)

    def _added(self, estimate: Estimate, drive: Drive) -> np.ndarray:
        """Return -lambda (a - a_0) (p)."""
        return self.leak_rate(drive) * (estimate.memory[0] - estimate.value)

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the inner adaptation's estimate after dt [s], mixed with a_0."""
        after = super().step(estimate, drive, dt)
        share = -math.expm1(-self.leak_rate(drive) * dt)
        return after.with_value(after.value + share * (estimate.memory[0] - after.value))


class ErrorLeak(Leak):
    """da/dt = (inner rate) - lambda |e| (a - a_0), |e| the scaled error: the e1 modification.

    A ``Leak`` biases the estimate even when the tracking error has vanished; this leak vanishes
    with the error. With a vanishing disturbance the true parameters are therefore an equilibrium,
    and a sufficiently exciting motion makes the estimate converge to them. Its weakness is a small
    error that noise sustains: the estimate then drifts as far as the ratio of noise to lambda,
    whatever the size of that error.

    dV/dt changes by -lambda |e| da^T Gamma^-1 (a - a_0), an equality; for a constant Gamma this is
    at most -lambda |e| (D(a) - D(a_0)). Under a bounded disturbance both the error's and the
    parameters' part of dV/dt are negative outside a bounded set.

    K. Narendra, A. Annaswamy, *A new adaptive law for robust adaptation without persistent
    excitation*, IEEE TAC 32 (1987) 134-145. Their leak, -Gamma nu |e| a, is towards zero.

    Attributes:
        bandwidth: lambda [1/s], the rate of the leak where |e| = 1.
        size: (k) or a number, in units of the drive's e; |e| is the root mean square of e / size.
    """

    sources = ("NarendraAnnaswamy1987",)

    def __init__(self, inner: Adaptation, bandwidth: float, size: ArrayLike) -> None:
        """Wrap an adaptation with a leak of rate lambda [1/s] at an error of the given size.

        Raises:
            GainError: one of them is not positive.
        """
        super().__init__(inner, bandwidth)
        self.size = positive_numbers(size, "e1")

    def leak_rate(self, drive: Drive) -> float:
        """Return lambda |e| [1/s] under a drive; zero for a drive without tracking error."""
        return 0.0 if drive.e is None else self.bandwidth * _scaled_error(drive.e, self.size)


class DeadZone(Wrapper):
    """Any adaptation with a dead zone: its error is e (1 - 1 / |e|) where |e| > 1, else zero.

    |e| is the root mean square of e / size, and |r| that of the prediction error. The zone is
    continuous in the errors and has no hysteresis.

    Purpose:    inside the zone the estimates stay constant. Small persistent errors from noise,
                late frames, friction or elastic joints do not make them drift.
    Cost:       nothing is learned from errors inside the zone, so that they end at about its size.
    V:          dV/dt changes by da^T (g - g_zone), g_zone the gradient of the remaining errors, an
                equality. With a measured r = W da + n the prediction's part of dV/dt becomes
                -phi (r - n)^T R r <= -phi |r|_R (|r|_R - |n|_R), phi = max(0, 1 - 1 / |r|). For
                R = diag(1 / size^2) up to a factor and |n| <= 1 it never increases V, which it can
                without the zone. The tracking part of dV/dt changes by da^T Y^T e min(1, 1 / |e|),
                of any sign and bounded by |Y da| times the zone: V decreases to a level of that
                size.

    B. Peterson, K. Narendra, *Bounded error adaptive control*, IEEE TAC 27 (1982) 1161-1168.

    Attributes:
        inner: the adaptation that it wraps.
        size: (k) or a number, in units of the drive's e; None: no zone for the tracking error.
        residual: (l) or a number, in units of the prediction error; None: no zone for that error.
    """

    sources = ("PetersonNarendra1982",)

    def __init__(
        self, inner: Adaptation, size: ArrayLike | None, residual: ArrayLike | None = None
    ) -> None:
        """Wrap an adaptation with dead zones of the given sizes.

        Raises:
            GainError: sizes that are not positive, or neither of them given.
        """
        super().__init__(inner)
        if size is None and residual is None:
            raise GainError(
                "expected the size of the tracking error, of the prediction error, or both.",
                where="dead-zone",
            )
        self.size = None if size is None else positive_numbers(size, "dead-zone")
        self.residual = None if residual is None else positive_numbers(residual, "dead-zone")

    def _driven(self, estimate: Estimate, drive: Drive) -> Drive:
        """Return the drive with the errors that remain outside the zone."""
        return drive.scaled(
            _share_outside(drive.e, self.size), _share_outside(drive.residual, self.residual)
        )


def _share_outside(error: np.ndarray | None, size: np.ndarray | None) -> float:
    """Return 1 - 1 / |e|, zero inside the zone; one without an error or a zone."""
    if error is None or size is None:
        return 1.0
    length = _scaled_error(error, size)
    return 1.0 - 1.0 / length if length > 1.0 else 0.0


class Normalised(Wrapper):
    """Any adaptation with the gradient Y^T e / m_Y^2 + W^T R r / m_W^2.

    m_Y^2 = 1 + tr(Y Gamma Y^T) / c, and m_W^2 likewise; Gamma is that of the inner adaptation.
    However large the regressor, the effect of the estimate's rate on the torque is
    bounded, |Y da/dt| <= c |e|. This limits the effect of error bursts, fast motion and outliers.

    V:          dV/dt changes by da^T (g - g / m^2), an equality. The prediction part -r^T R r
                becomes -r^T R r / m_W^2 <= 0. The tracking part changes by
                da^T Y^T e (1 - 1 / m_Y^2), of any sign. With V_e / m_Y^2 in place of the law's part
                V_e of V that term vanishes, and dV/dt changes by -2 (dm_Y/dt) V_e / m_Y^3 instead;
                the law's own decay of V_e dominates it while m_Y decreases more slowly than that.
                Use it with regressors that change more slowly than the loop settles.

    P. Ioannou, J. Sun, *Robust Adaptive Control*, 1996, section 4.3.

    Attributes:
        inner: the adaptation that it wraps.
        size: c, the tr(Y Gamma Y^T) at which the adaptation is half as fast.
    """

    sources = ("IoannouSun1996",)

    def __init__(self, inner: Adaptation, size: float) -> None:
        """Wrap an adaptation with the normalisation of size c.

        Raises:
            GainError: the size is not positive.
        """
        super().__init__(inner)
        self.size = positive(size, "normalised")

    def _driven(self, estimate: Estimate, drive: Drive) -> Drive:
        """Return the drive with each part divided by its m^2."""
        of_W = 1.0 if drive.W is None else self._factor(estimate, drive.W)
        return drive.scaled(self._factor(estimate, drive.Y), of_W)

    def _factor(self, estimate: Estimate, Y: np.ndarray) -> float:
        """Return 1 / m^2 at an estimate for a regressor (k, p)."""
        trace = np.sum(Y.T * self.inner.gain_times(estimate, Y.T))
        return 1.0 / (1.0 + trace / self.size)


def _scaled_error(e: np.ndarray, size: np.ndarray) -> float:
    """Return the root mean square of e / size, e (k), size a number or (k); zero for k = 0."""
    ratio = e / size
    return math.sqrt(ratio.dot(ratio) / ratio.size) if ratio.size else 0.0
