"""Time laws s(t): when a motion is at which instant of its own time s."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_right

import numpy as np
from numpy.typing import ArrayLike

from .._checks import numbers, positive, whole
from ..exceptions import InputError

_NEWTON, _EXACT = 20, 1e-15  # most iterations, and the step at which they end [cells]


class TimeLaw(ABC):
    """A path's own time s as a function of time t, twice continuously differentiable for t > 0.

    Along x_d(s(t)) velocity and acceleration are x_d' ds/dt and x_d'' (ds/dt)^2 + x_d' d^2s/dt^2.
    """

    @abstractmethod
    def at(self, t: float) -> tuple[float, float, float]:
        """Return s [s], ds/dt and d^2s/dt^2 [1/s] at time t [s]."""

    @abstractmethod
    def when(self, s: float) -> float:
        """Return the time t [s] at which the path's time is s [s], the latest one if it rests."""

    @abstractmethod
    def repeats(self, since: float, period: float) -> tuple[float, float] | None:
        """Return from when and with which period a motion repeats itself under this law [s].

        Args:
            since: when it begins to repeat itself by its own time [s].
            period: of the motion by its own time [s].
        """


class SmoothStart(TimeLaw):
    """The rate ds/dt rises from 0 to 1 within a ramp, and s = t - ramp / 2 afterwards.

    ds/dt = 10 u^3 - 15 u^4 + 6 u^5 with u = t / ramp, so ds/dt and its first two derivatives are
    continuous, at both ends of the ramp too; its slope is at most 1.875 / ramp. Before time 0 the
    motion rests at its first point.

    Attributes:
        ramp: [s].
    """

    def __init__(self, ramp: float) -> None:
        """Take the ramp [s].

        Raises:
            InputError: it is not positive.
        """
        self.ramp = positive(ramp, "ramp", error=InputError)

    def __repr__(self) -> str:
        """Return the ramp in words."""
        return f"from rest within {self.ramp:.3g} s"

    def at(self, t: float) -> tuple[float, float, float]:
        """Return s [s], ds/dt and d^2s/dt^2 [1/s] at time t [s]."""
        T = self.ramp
        if t >= T:
            return t - 0.5 * T, 1.0, 0.0
        if t <= 0.0:
            return 0.0, 0.0, 0.0
        u = t / T
        square = u * u
        cube, rest = square * u, 1.0 - u
        s = T * cube * u * (2.5 - 3.0 * u + square)
        return s, cube * (10.0 - 15.0 * u + 6.0 * square), 30.0 * square * rest * rest / T

    def when(self, s: float) -> float:
        """Return the time t [s] at which the path's time is s [s]."""
        T = self.ramp
        if s >= 0.5 * T:
            return s + 0.5 * T
        early, late = 0.0, T
        while late - early > 1e-12 * T:
            middle = 0.5 * (early + late)
            early, late = (middle, late) if self.at(middle)[0] <= s else (early, middle)
        return early

    def repeats(self, since: float, period: float) -> tuple[float, float]:
        """Return the later one of the ramp's end and of ``since``, and the same period [s]."""
        return max(self.ramp, self.when(since)), period


class SlowedTime(TimeLaw):
    """ds/dt = 1 / p(s), where p >= 1 is a cubic spline: never faster than the motion itself.

    p is a uniform cubic B-spline, twice continuously differentiable, and at each s between the
    least and the largest of the four control values around it. t(s) is its integral, a polynomial
    of degree four on each interval, inverted by Newton's method to rounding, so that s, ds/dt = 1/p
    and d^2s/dt^2 = -p' / p^3 belong together exactly.

    Attributes:
        slowness: (N + 3) control values of p; the four from the k-th on are those of interval k.
        step: length of an interval [s].
        turn: how many of the last of the N intervals are repeated without end; 0: p stays as it is
            at the end.
    """

    def __init__(self, slowness: ArrayLike, step: float, turn: int = 0) -> None:
        """Take the control values (N + 3), N >= 1, the step [s], and how many intervals recur.

        Raises:
            InputError: fewer than four values, one below 1, a step that is not positive, or values
                that do not recur where they should.
        """
        c = self.slowness = numbers(slowness, "slowness")
        self.step = positive(step, "step", error=InputError)
        self.turn = whole(turn, "turn", 0)
        N = c.size - 3
        if c.ndim != 1 or N < 1 or (c < 1.0).any() or self.turn > N:
            raise InputError(
                f"expected at least four numbers of at least 1, and no more intervals that recur "
                f"than there are, got {c} and {turn}.",
                where="slowness",
            )
        if not np.array_equal(c[N:], c[N - turn : N - turn + 3] if turn else c[[-1, -1, -1]]):
            raise InputError(
                "the last three values must be those before the turn, without turn equal.",
                where="slowness",
            )
        first, second, third, fourth = c[:-3], c[1:-2], c[2:-1], c[3:]
        parts = (
            (first + 4.0 * second + third) / 6.0,
            (third - first) / 2.0,
            (first - 2.0 * second + third) / 2.0,
            (fourth - 3.0 * third + 3.0 * second - first) / 6.0,
        )
        ends = (self.step * np.cumsum(sum(a / k for k, a in enumerate(parts, 1)))).tolist()
        self._cells: list[tuple[float, ...]] = np.column_stack(parts).tolist()
        self._times = [0.0, *ends]

    def at(self, t: float) -> tuple[float, float, float]:
        """Return s [s], ds/dt and d^2s/dt^2 [1/s] at time t [s]."""
        times, last, turns = self._times, len(self._cells), 0
        if t >= times[-1]:
            if not self.turn:
                p = _value(self._cells[-1], 1.0)
                return last * self.step + (t - times[-1]) / p, 1.0 / p, 0.0
            since = times[last - self.turn]
            turns = int((t - since) // (times[-1] - since))
            t = min(max(t - turns * (times[-1] - since), since), times[-1])
        elif t <= 0.0:
            p = _value(self._cells[0], 0.0)
            return t / p, 1.0 / p, 0.0
        k = min(bisect_right(times, t) - 1, last - 1)
        a, b, c, d = self._cells[k]
        far = (t - times[k]) / self.step
        u = far / ((times[k + 1] - times[k]) / self.step)
        for _ in range(_NEWTON):
            p = a + u * (b + u * (c + u * d))
            move = (far - u * (a + u * (b / 2.0 + u * (c / 3.0 + u * d / 4.0)))) / p
            u += move
            if abs(move) < _EXACT:
                break
        p = a + u * (b + u * (c + u * d))
        slope = (b + u * (2.0 * c + u * 3.0 * d)) / self.step
        return (k + turns * self.turn + u) * self.step, 1.0 / p, -slope / p**3

    def when(self, s: float) -> float:
        """Return the time t [s] at which the path's time is s [s]."""
        times, last = self._times, len(self._cells)
        k = math.floor(s / self.step)
        if k < 0:
            return s * _value(self._cells[0], 0.0)
        later = 0.0
        if k >= last:
            if not self.turn:
                return times[-1] + (s - last * self.step) * _value(self._cells[-1], 1.0)
            turns = (k - (last - self.turn)) // self.turn
            later = turns * (times[-1] - times[last - self.turn])
            s -= turns * self.turn * self.step
            k -= turns * self.turn
        a, b, c, d = self._cells[k]
        u = s / self.step - k
        rest = u * (a + u * (b / 2.0 + u * (c / 3.0 + u * d / 4.0)))
        return times[k] + later + self.step * rest

    def repeats(self, since: float, period: float) -> tuple[float, float] | None:
        """Return since when and with which period [s]; None where the law does not repeat so."""
        cells = len(self._cells)
        if self.turn:
            ratio = period / (self.turn * self.step)
            if abs(ratio - round(ratio)) > 1e-9 * ratio:
                return None
        start = max(since, (cells - self.turn) * self.step)
        begin = self.when(start)
        return begin, self.when(start + period) - begin


def _value(cell: tuple[float, ...], u: float) -> float:
    """Return p at the share u of an interval with these coefficients."""
    a, b, c, d = cell
    return a + u * (b + u * (c + u * d))
