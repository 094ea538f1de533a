"""A motion through positions at given times."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import ArrayLike

from .._checks import arithmetic, numbers, word
from ..exceptions import InputError
from ..records import Desired
from .trajectory import Trajectory, half_diagonal

ENDS = ("rest", "free")

_DEGREE = 5
_MANY, _SUDDEN = 8, 10.0  # a warning needs so many samples, and such a ratio of accelerations


class Spline(Trajectory):
    """The spline of degree five through positions at given times; four continuous derivatives.

    Before the first time and after the last one the motion rests at the first and last position.
    With ``ends="rest"`` velocity and acceleration are zero at both ends, so they are continuous
    there; through two positions this is the minimum-jerk motion. With ``ends="free"`` velocity and
    acceleration at the ends follow from the samples (not-a-knot conditions) and jump to zero
    beyond them. This suits samples of a motion that is already under way.

    Quaternions are interpolated as four numbers, after their signs are made consistent, and divided
    by their length. The orientation passes through every sample and is as smooth as the position.

    Attributes:
        t: (N) times [s].
        x: (N, m) positions [m or rad]; of a pose with a quaternion xyzw (7), of an orientation (4).
    """

    def __init__(
        self, t: ArrayLike, x: ArrayLike, *, ends: str = "rest", quaternion: bool = False
    ) -> None:
        """Take times and positions.

        Args:
            t: (N) increasing times [s], N >= 2 at rest at the ends, N >= 6 for free ends.
            x: (N, m) or, of one coordinate, (N) positions [m or rad].
            ends: "rest" or "free".
            quaternion: whether the last four columns are a unit quaternion xyzw.

        Raises:
            InputError: sizes that do not match, numbers that are not finite, times that do not
                increase, too few samples, or quaternions of another length than 1.
        """
        self.t, self.x = numbers(t, "trajectory.t"), numbers(x, "trajectory.x")
        if self.x.ndim == 1:
            self.x = self.x[:, None]
        least = _DEGREE + 1 if word(ends, ENDS, "ends") == "free" else 2
        _check(self.t, self.x, least)
        self._rotates = quaternion
        if quaternion:
            self.x[:, -4:] = _continuous(self.x[:, -4:])
        from scipy.interpolate import make_interp_spline  # not needed to load a robot

        still = [(order, np.zeros(self.x.shape[1])) for order in (1, 2)]
        conditions = (still, still) if ends == "rest" else None
        with arithmetic("trajectory.t"):
            spline = make_interp_spline(self.t, self.x, _DEGREE, bc_type=conditions)
            self._parts = spline, spline.derivative(1), spline.derivative(2)
        if ends == "rest":
            _warn_of_speed(self.t, self.x)

    @property
    def extent(self) -> float:
        """Half the diagonal of the box around the positions [m or rad]."""
        return half_diagonal(self.x[:, :-4] if self._rotates else self.x)

    @property
    def settles(self) -> float:
        """The last time [s]."""
        return float(self.t[-1])

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s]; outside the times at rest."""
        inside = min(max(t, self.t[0]), self.t[-1])
        u, ud, udd = (part(inside) for part in self._parts)
        if inside != t:
            ud, udd = np.zeros_like(u), np.zeros_like(u)
        if not self._rotates:
            return Desired(u, ud, udd)
        q, omega, alpha = _rotation(u[-4:], ud[-4:], udd[-4:])
        return Desired(np.append(u[:-4], q), np.append(ud[:-4], omega), np.append(udd[:-4], alpha))


def _check(t: np.ndarray, x: np.ndarray, least: int) -> None:
    """Check times and positions.

    Raises:
        InputError: sizes that do not match, too few samples, or times that do not increase.
    """
    if t.ndim != 1 or x.ndim != 2 or len(t) != len(x) or not x.size:
        raise InputError(
            f"expected N times and N rows of positions, got shapes {t.shape} and {x.shape}.",
            where="trajectory",
            hint="Give (t, x) with t (N) [s] and x (N, m).",
        )
    if len(t) < least:
        raise InputError(f"expected at least {least} samples, got {len(t)}.", where="trajectory.t")
    if (late := np.diff(t) <= 0.0).any():
        k = int(np.argmax(late)) + 1
        raise InputError(
            f"times must increase, but t[{k}] = {t[k]:g} s follows {t[k - 1]:g} s.",
            where="trajectory.t",
            hint="Sort the samples by time, and keep one sample of each time.",
        )


def _continuous(q: np.ndarray) -> np.ndarray:
    """Return quaternions (N, 4) of length 1, each with the sign nearer to the previous one.

    Raises:
        InputError: one of another length, by more than 1 %.
    """
    if q.shape[1] != 4:
        raise InputError(
            f"expected positions that end in a quaternion xyzw, got {q.shape[1]} columns.",
            where="trajectory.x",
        )
    lengths = np.linalg.norm(q, axis=1)
    if (off := np.abs(lengths - 1.0) > 0.01).any():
        k = int(np.argmax(off))
        raise InputError(
            f"row {k} has a quaternion xyzw of length {lengths[k]:.4g} instead of 1.",
            where="trajectory.x",
        )
    q = q / lengths[:, None]
    opposite = np.einsum("ij,ij->i", q[1:], q[:-1]) < 0.0
    q[1:] *= np.where(np.cumsum(opposite) % 2, -1.0, 1.0)[:, None]
    return q


def _rotation(u: np.ndarray, ud: np.ndarray, udd: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return q = u / |u| xyzw (4), angular velocity (3) and acceleration (3), world axes.

    omega = 2 vec(qd q*) and alpha = 2 vec(qdd q*), as qd = omega q / 2.
    """
    n = np.sqrt(u @ u)
    nd = u @ ud / n
    ndd = (ud @ ud + u @ udd - nd * nd) / n
    q = u / n
    qd = (ud - nd * q) / n
    qdd = (udd - 2.0 * nd * qd - ndd * q) / n
    return q, *(2.0 * (q[3] * d[:3] - d[3] * q[:3] - np.cross(d[:3], q[:3])) for d in (qd, qdd))


def _warn_of_speed(t: np.ndarray, x: np.ndarray) -> None:
    """Warn if the samples move at an end, where the spline is at rest.

    The test: reaching the end speed within one interval takes ten times the largest acceleration of
    the samples (second differences).
    """
    if len(t) < _MANY:
        return
    steps = np.diff(t)
    speeds = np.diff(x, axis=0) / steps[:, None]
    middles = 0.5 * (steps[1:] + steps[:-1])
    most = np.linalg.norm(np.diff(speeds, axis=0) / middles[:, None], axis=1).max()
    for k, end in ((0, "first"), (-1, "last")):
        speed = float(np.linalg.norm(speeds[k]))
        if speed / steps[k] > _SUDDEN * most:
            warnings.warn(
                f"the positions move at {speed:.3g} /s at their {end} sample, where the spline is "
                f'at rest. Spline(t, x, ends="free") starts and ends at the speed of the samples.',
                stacklevel=4,
            )
