"""Motions that repeat themselves: circles, one sine for each coordinate, and Fourier series."""

from __future__ import annotations

import math
from copy import copy
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from .._checks import numbers, positive, vector, word
from ..exceptions import InputError
from ..records import Desired
from .trajectory import Trajectory

PLANES = ("xy", "yz", "xz")
FROM_REST = -math.pi / 2.0  # [rad] phase of a sine that starts at rest, at its lowest

_Motion = TypeVar("_Motion", bound="_Centered")


class _Centered(Trajectory):
    """A motion about a centre.

    Attributes:
        center: (m) [m or rad]. None: such that the motion begins where the robot is; until a run
            places it, the centre is zero.
    """

    center: np.ndarray
    _unplaced: dict[str, Any] | None = None

    def _placed(self, center: ArrayLike | None, size: int, **others: Any) -> np.ndarray:
        """Return the centre; without one zeros (m), and the other arguments are kept for later."""
        if center is None:
            self._unplaced = others
            return np.zeros(size)
        return vector(center, None, "trajectory.center")

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


class _Sines(_Centered):
    """x_d,i = center_i + amplitude_i sin(w_i t + phase_i).

    Attributes:
        center, amplitude: (m) [m or rad].
    """

    amplitude: np.ndarray

    def _take(
        self,
        center: ArrayLike | None,
        amplitude: np.ndarray,
        w: np.ndarray,
        phase: np.ndarray,
        given: dict[str, Any],
    ) -> None:
        """Take centre, amplitudes, w [rad/s] and phases (m); without a centre, what they are of."""
        self.amplitude, self._w, self._phase = amplitude, w, phase
        self._speed, self._acceleration = w * amplitude, -w * w * amplitude
        self.center = self._placed(center, w.size, **given)

    @property
    def extent(self) -> float:
        """Half the diagonal of the box that the amplitudes span [m or rad]."""
        return float(np.linalg.norm(self.amplitude))

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        angle = self._w * t + self._phase
        s = np.sin(angle)
        x_d = self.center + self.amplitude * s
        return Desired(x_d, self._speed * np.cos(angle), self._acceleration * s)


class Circle(_Sines):
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
        self.phase, self.plane = float(vector(phase, 1, "trajectory.phase")[0]), plane
        size = 3 if center is None else vector(center, None, "trajectory.center").size
        if size not in (2, 3):
            raise InputError(
                f"a circle needs 2 or 3 coordinates, got {size}.", where="trajectory.center"
            )
        word(plane, PLANES if size == 3 else ("xy",), "trajectory.plane")
        axes = ["xyz".index(axis) for axis in plane]
        amplitude, phases = np.zeros(size), np.zeros(size)
        amplitude[axes], phases[axes] = self.radius, (self.phase + 0.5 * math.pi, self.phase)
        given = {"radius": radius, "period": period, "plane": plane, "phase": phase}
        self._take(center, amplitude, np.full(size, 2.0 * math.pi / self.period), phases, given)

    @property
    def extent(self) -> float:
        """The radius [m]."""
        return self.radius


class Lissajous(_Sines):
    """x_d,i = center_i + amplitude_i sin(2 pi n_i t / period + phase_i): n_i cycles a period."""

    def __init__(
        self,
        center: ArrayLike | None = None,
        amplitude: ArrayLike = 0.1,
        cycles: ArrayLike = 1.0,
        period: float = 6.0,
        phase: ArrayLike = 0.0,
    ) -> None:
        """Take centre, amplitudes [m or rad], cycles n, phases [rad], each (m), and period [s].

        A number applies to all coordinates; without a centre the motion begins where the robot is.

        Raises:
            InputError: different sizes, numbers that are not finite, or a period not positive.
        """
        given: dict[str, Any] = {"amplitude": amplitude, "cycles": cycles, "phase": phase}
        parts = _alike(center=center, **given)
        w = 2.0 * math.pi * parts["cycles"] / positive(period, "trajectory.period")
        given = {**given, "period": period}
        self._take(parts.get("center"), parts["amplitude"], w, parts["phase"], given)


def _alike(**given: ArrayLike | None) -> dict[str, np.ndarray]:
    """Return numbers and lists of numbers as vectors of one size (m); None is left out.

    Raises:
        InputError: lists of different sizes, or numbers that are not finite.
    """
    named = {f"trajectory.{name}": part for name, part in given.items() if part is not None}
    size = max(vector(part, None, name).size for name, part in named.items())
    return {name.partition(".")[2]: vector(part, size, name) for name, part in named.items()}


class Sinusoid(_Sines):
    """x_d,i = center_i + amplitude_i sin(2 pi t / period_i + phase_i).

    With the default phase it starts at rest at center - amplitude. Made for joint references, and
    usable for any coordinates.
    """

    def __init__(
        self,
        center: ArrayLike | None = None,
        amplitude: ArrayLike = 0.1,
        period: ArrayLike = 3.0,
        phase: ArrayLike = FROM_REST,
    ) -> None:
        """Take centres, amplitudes, periods and phases, each (m) or one number for all.

        Args:
            center: [rad or m]; None: the motion begins where the robot is.
            amplitude: [rad or m], of either sign.
            period: [s].
            phase: [rad].

        Raises:
            InputError: different sizes, numbers that are not finite, or periods not positive.
        """
        given = {"amplitude": amplitude, "period": period, "phase": phase}
        parts = _alike(center=center, **given)
        for each in parts["period"]:
            positive(each, "trajectory.period", error=InputError)
        self.period = parts["period"]
        w = 2.0 * math.pi / self.period
        self._take(parts.get("center"), parts["amplitude"], w, parts["phase"], given)


class FourierSeries(_Centered):
    """x_d,i = center_i + sum_k (cosine_ik cos(k w t) + sine_ik sin(k w t)), w = 2 pi / period.

    The motion repeats itself and contains no frequency above K / period. It begins at rest where
    sum k sine_ik = 0, and without acceleration where sum k^2 cosine_ik = 0. After J. Swevers,
    C. Ganseman, D. Tukel, J. De Schutter, H. Van Brussel, *Optimal robot excitation and
    identification*, IEEE Trans. Robotics and Automation 13 (1997). See ``excite``.

    Attributes:
        center: (m) mean [rad or m].
        cosine, sine: (m, K) coefficients [rad or m], the slowest first.
        period: [s].
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
        given = {"cosine": cosine, "sine": sine, "period": period}
        size = len(self.cosine)
        self.center = self._placed(center, size, **given)
        vector(self.center, size, "trajectory.center")
        self.period = positive(period, "trajectory.period")
        self._w = 2.0 * math.pi / self.period * np.arange(1.0, self.cosine.shape[1] + 1.0)
        # (2 K, 3 m): what cosines and sines of all angles add to position, velocity, acceleration
        w = self._w[:, None]
        A, B = self.cosine.T, self.sine.T
        self._parts = np.block([[A, w * B, -w * w * A], [B, -w * A, -w * w * B]])

    @property
    def harmonics(self) -> int:
        """Number K of harmonics."""
        return len(self._w)

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]."""
        angles = self._w * t
        x, xd, xdd = (
            np.concatenate([np.cos(angles), np.sin(angles)]).dot(self._parts).reshape(3, -1)
        )
        return Desired(self.center + x, xd, xdd)
