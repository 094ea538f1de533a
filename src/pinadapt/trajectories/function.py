"""A motion given as a function of time, with numerical derivatives if it returns none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from .._checks import positive, shown
from ..exceptions import InputError
from ..records import Desired
from .trajectory import Trajectory

Difference: TypeAlias = Callable[[np.ndarray, np.ndarray], Any]
"""How far (m) coordinates x are from others x_0: ``Task.error``, x - x_0 for vectors."""

# Five-point formulas at nodes t + (k - j) h, k = 0..4, for j nodes before t: h df/dt, h^2 d2f/dt2
_WEIGHTS = {
    2: (np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12, np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12),
    1: (
        np.array([-3.0, -10.0, 18.0, -6.0, 1.0]) / 12,
        np.array([11.0, -20.0, 6.0, 4.0, -1.0]) / 12,
    ),
    0: (
        np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / 12,
        np.array([35.0, -104.0, 114.0, -56.0, 11.0]) / 12,
    ),
}
STEP = 2e-3  # [s]


class Function(Trajectory):
    """x_d = f(t) for a function f that returns x_d, or x_d and its two derivatives.

    If f returns x_d alone, velocity and acceleration are five-point differences with a step of h =
    2 ms. f is called at t and at four more times within 2 h of it; near time 0 within 4 h after it,
    as f is never called before time 0. f must have two continuous derivatives. Relative errors for
    a sine, with respect to the amplitudes of velocity and acceleration:

    | frequency | velocity, acceleration | in the first 4 ms |
    |---|---|---|
    | 1 Hz | 9e-10, 3e-10 | 5e-9, 2e-6 |
    | 5 Hz | 6e-7, 2e-7 | 4e-6, 3e-4 |
    | 20 Hz | 2e-4, 5e-5 | 1e-3, 2e-2 |

    They grow with h^4, for the acceleration in the first 4 ms with h^3. Noise of f is multiplied by
    up to 1.5/h in the velocity and 5.4/h^2 in the acceleration, 27/h^2 in the first 4 ms. Rounding
    of numbers near 1 gives less than 2e-9 m/s^2, but noise of 1e-9 m gives 1.3e-3 m/s^2. For a
    noisy f take a longer step, or samples of it in a ``Spline``. A function that returns the
    derivatives too is not differentiated, and called once.
    """

    def __init__(
        self,
        f: Callable[[float], Any],
        *,
        difference: Difference = np.subtract,
        step: float = STEP,
        extent: float | None = None,
        settles: float | None = None,
    ) -> None:
        """Take the function and what is known of the motion.

        Args:
            f: t [s] -> x_d, or (x_d, xd_d, xdd_d), or ``Desired``; a pose may be a ``pin.SE3``.
            difference: (x, x_0) -> (m), how far x is from x_0; ``Task.error`` of a task.
            step: h [s].
            extent: see ``Trajectory.extent``.
            settles: see ``Trajectory.settles``.

        Raises:
            InputError: a step that is not positive.
        """
        self._f, self._difference = f, difference
        self._h = positive(step, "step", error=InputError)
        self._extent, self._settles = extent, settles

    @property
    def extent(self) -> float | None:
        """As given."""
        return self._extent

    @property
    def settles(self) -> float | None:
        """As given."""
        return self._settles

    def at(self, t: float) -> Desired:
        """Return position, velocity and acceleration at time t [s].

        Raises:
            InputError: the function returned no coordinates, or a varying number of them.
        """
        x_d, *derivatives = _coordinates(self._f(t), t)
        return Desired(x_d, *(derivatives or self._differences(t, x_d)))

    def _differences(self, t: float, x_d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        h = self._h
        before = 2 if t >= 2 * h or t < 0.0 else 1 if t >= h else 0
        first, second = _WEIGHTS[before]
        steps = [self._from(x_d, t + (k - before) * h) for k in range(5) if k != before]
        steps.insert(before, np.zeros_like(steps[0]))
        away = np.array(steps)
        return first @ away / h, second @ away / h**2

    def _from(self, x_d: np.ndarray, t: float) -> np.ndarray:
        """Return how far (m) the motion at time t [s] is from x_d."""
        x = _coordinates(self._f(t), t)[0]
        if x.shape != x_d.shape:
            raise InputError(
                f"the function returned {x_d.size} coordinates before and {x.size} at t = {t:g} s.",
                where="trajectory",
            )
        return np.asarray(self._difference(x, x_d))


def _coordinates(value: Any, t: float) -> list[np.ndarray]:
    """Return [x_d] or [x_d, xd_d, xdd_d] of what a function returned, as new arrays of floats."""
    if isinstance(value, np.ndarray):
        several = value.ndim == 2 and len(value) == 3
    else:
        several = isinstance(value, tuple | list) and len(value) == 3
        several = several and all(isinstance(x, pin.SE3) or np.ndim(x) == 1 for x in value)
    return [_vector(part, value, t) for part in (value if several else [value])]


def _vector(part: Any, value: Any, t: float) -> np.ndarray:
    if isinstance(part, pin.SE3):
        return np.asarray(pin.SE3ToXYZQUAT(part))
    try:
        array = np.asarray(part)
    except ValueError:  # ragged
        array = np.zeros((0, 0))
    if array.dtype.kind not in "fiu" or array.ndim > 1:
        raise InputError(
            f"expected coordinates x_d or (x_d, xd_d, xdd_d) at t = {t:g} s, got {shown(value)}.",
            where="trajectory",
        )
    return array.astype(float).reshape(-1)
