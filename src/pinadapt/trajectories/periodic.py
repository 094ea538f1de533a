"""Motions that repeat themselves: circles, one sine for each coordinate, and Fourier series."""

from __future__ import annotations

import math
from copy import copy
from typing import Any, TypeVar

import numpy as np
from numpy import empty
from numpy.typing import ArrayLike

from .._checks import numbers, positive, vector, word
from .._kernels import trajectories as kernels
from ..exceptions import InputError
from ..records import Desired
from .trajectory import Trajectory

PLANES = ("xy", "yz", "xz")

_Motion = TypeVar("_Motion", bound="_Harmonic")


class _Harmonic(Trajectory):
    """x_d,i = center_i + Re sum_k c_ik exp(i w_k t).

    Attributes:
        center: (m) [m or rad]. None: such that the motion begins where the robot is; until a run
            places it, the centre is zero.
    """

    def _take(
        self,
        center: ArrayLike | None,
        w: np.ndarray,
        c: np.ndarray,
        given: dict[str, Any],
    ) -> None:
        """Take centre, w [rad/s] (K) and complex c (m, K); without a centre what they are of.

        Raises:
            InputError: a centre of another size.
        """
        if center is None:
            self._unplaced = given
            center = 0.0
        self.center = vector(center, len(c), "trajectory.center")
        self._w = w
        # real and imaginary parts in turn (3, m, 2 K), with those of the derivatives
        self._parts = np.array([c, 1j * w * c, -(w**2) * c]).view(float)

    def placed(self: _Motion, start: np.ndarray) -> _Motion:
        """Return the motion that begins at ``start`` (m), if it has no centre of its own."""
        if self._unplaced is None:
            return self
        return type(self)(np.zeros(start.size), **self._unplaced).starting_at(start)  # type: ignore[call-arg, return-value]

    def shifted(self: _Motion, by: ArrayLike) -> _Motion:
        """Return the same motion displaced by (m) [m or rad]."""
        moved = copy(self)
        moved._unplaced = None
        moved.center = self.center + vector(by, self.center.size, "by")
        return moved

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        x = empty(self._parts.shape[:2])
        kernels.harmonics(self._parts, self._w, float(t), x)
        x[0] += self.center
        return Desired(x[0], x[1], x[2])


class Circle(_Harmonic):
    """x_d = center + radius (cos(w t + phase) u_1 + sin(w t + phase) u_2), w = 2 pi / period.

    Attributes:
        center: (m) [m].
        radius: [m].
        period: of a turn [s].
        plane: the two axes u_1, u_2; "xy" for two coordinates, whatever these are.
        phase: angle at time 0 [rad].
    """

    def __init__(
        self,
        center: ArrayLike | None = None,
        radius: float = 0.1,
        period: float = 3.0,
        plane: str = "xy",
        phase: float = 0.0,
    ) -> None:
        """Take centre (m) [m], radius [m], period [s], plane ("xy", "yz", "xz") and phase [rad].

        Without a centre the circle begins where the robot is.

        Raises:
            InputError: a centre that has not 2 or 3 coordinates, an unknown plane, numbers that are
                not finite, or a radius or period that is not positive.
        """
        self.radius = positive(radius, "trajectory.radius")
        self.period = positive(period, "trajectory.period")
        self.phase = float(vector(phase, 1, "trajectory.phase")[0])
        self.plane = plane
        size = 3 if center is None else vector(center, None, "trajectory.center").size
        if size not in (2, 3):
            raise InputError(
                f"a circle needs 2 or 3 coordinates, got {size}.", where="trajectory.center"
            )
        word(plane, PLANES if size == 3 else ("xy",), "trajectory.plane")
        axes = np.eye(3, size)[["xyz".index(axis) for axis in plane]]  # u_1, u_2
        c = self.radius * np.exp(1j * self.phase) * (axes[0] - 1j * axes[1])
        given = {"radius": radius, "period": period, "plane": plane, "phase": phase}
        self._take(center, np.array([2.0 * math.pi / self.period]), c[:, None], given)
        self.extent = self.radius


class Sinusoid(_Harmonic):
    """x_d,i = center_i + amplitude_i sin(2 pi n_i t / period_i + phase_i).

    With the default phase it starts at rest at center - amplitude. Made for joint references, and
    usable for any coordinates.

    Attributes:
        center, amplitude: (m) [m or rad].
        period: (m) [s].
    """

    def __init__(
        self,
        center: ArrayLike | None = None,
        amplitude: ArrayLike = 0.1,
        period: ArrayLike = 3.0,
        phase: ArrayLike = -math.pi / 2.0,
        cycles: ArrayLike = 1.0,
    ) -> None:
        """Take centres, amplitudes, periods, phases and cycles, each (m) or one number for all.

        Args:
            center: [rad or m]; None: the motion begins where the robot is.
            amplitude: [rad or m], of either sign.
            period: [s].
            phase: [rad].
            cycles: n in a period.

        Raises:
            InputError: different sizes, numbers that are not finite, or periods not positive.
        """
        given = {"amplitude": amplitude, "period": period, "phase": phase, "cycles": cycles}
        named = given if center is None else {"center": center, **given}
        size = max(vector(part, None, f"trajectory.{name}").size for name, part in named.items())
        parts = {name: vector(part, size, f"trajectory.{name}") for name, part in named.items()}
        for each in parts["period"]:
            positive(each, "trajectory.period", error=InputError)
        self.amplitude = A = parts["amplitude"]
        self.period = parts["period"]
        self.extent = float(np.linalg.norm(A))
        w = 2.0 * math.pi * parts["cycles"] / self.period
        c = np.diag(-1j * A * np.exp(1j * parts["phase"]))
        self._take(parts.get("center"), w, c, given)


class Lissajous(Sinusoid):
    """x_d,i = center_i + amplitude_i sin(2 pi n_i t / period + phase_i): n_i cycles a period."""

    def __init__(
        self,
        center: ArrayLike | None = None,
        amplitude: ArrayLike = 0.1,
        cycles: ArrayLike = 1.0,
        period: ArrayLike = 6.0,
        phase: ArrayLike = 0.0,
    ) -> None:
        """Take centre, amplitudes [m or rad], cycles n, phases [rad], each (m), and period [s].

        A number applies to all coordinates; without a centre the motion begins where the robot is.

        Raises:
            InputError: as ``Sinusoid``.
        """
        super().__init__(center, amplitude, period, phase, cycles)


class FourierSeries(_Harmonic):
    """x_d,i = center_i + sum_k (cosine_ik cos(k w t) + sine_ik sin(k w t)), w = 2 pi / period.

    The motion repeats itself and contains no frequency above K / period. It begins at rest where
    sum k sine_ik = 0, and without acceleration where sum k^2 cosine_ik = 0. After J. Swevers,
    C. Ganseman, D. Tukel, J. De Schutter, H. Van Brussel, *Optimal robot excitation and
    identification*, IEEE Trans. Robotics and Automation 13 (1997). See ``excite``.

    Attributes:
        center: (m) mean [rad or m].
        cosine, sine: (m, K) coefficients [rad or m], the slowest first.
        period: [s].
        harmonics: their number K.
    """

    def __init__(
        self,
        center: ArrayLike | None = None,
        cosine: ArrayLike = (),
        sine: ArrayLike = (),
        period: float = 10.0,
    ) -> None:
        """Take means (m), coefficients (m, K) [rad or m], and the period [s].

        Without means the motion begins where the robot is.

        Raises:
            InputError: sizes that differ, numbers that are not finite, or a period not positive.
        """
        self.cosine = numbers(cosine, "trajectory.cosine")
        self.sine = numbers(sine, "trajectory.sine")
        if self.cosine.ndim != 2 or not self.cosine.size or self.cosine.shape != self.sine.shape:
            raise InputError(
                "expected a list of coefficients for each coordinate, as many of sines as of "
                f"cosines, got shapes {self.cosine.shape} and {self.sine.shape}.",
                where="trajectory.cosine",
            )
        self.period = positive(period, "trajectory.period")
        self.harmonics = self.cosine.shape[1]
        w = 2.0 * math.pi / self.period * np.arange(1.0, self.harmonics + 1.0)
        given = {"cosine": cosine, "sine": sine, "period": period}
        self._take(center, w, self.cosine - 1j * self.sine, given)
