"""Whether the torques that an estimator hears are those of its robot, while it begins to learn.

Amperes, torques before a gear, a wrong sign, or torques without gravity would be learned like any
others. They show before: the filtered torque T that is measured is compared with the one that the
initial estimate predicts, P, joint by joint, once what friction of the joint could explain is
removed from both,

    factor = <T, P> / <P, P>,        correlation = <T, P> / (|T| |P|).

``pinadapt.information.check_torques`` does the same with a whole log, and names the cause. Here,
what a load or wrong inertias could do is left alone: only factors far from one count.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..exceptions import ImplausibleError

_FIRST, _LAST = 1.0, 8.0  # [s] of motion after which the torques are judged, doubling in between
_SLIDING = 0.02  # [rad/s or m/s] from where Coulomb friction has its full size
_FACTORS = (0.3, 4.0)  # of all joints together
_CLEAR = 0.9  # correlation of a joint that is told to have the wrong sign
_AGAINST = -0.35  # its factor
_HEAVY = 0.2  # of the largest predicted torque, from where on a joint is judged by itself
_RELATED = 0.3  # correlation of all joints together, below which torques are not the robot's
_PREDICTED = 0.5  # of the measured torques, from where on predicted ones must be seen in them
_ZERO = 1e-9


class HeardTorques(NamedTuple):
    """What the torques of a motion have told so far.

    Attributes:
        time: of the motion [s].
        due: when they are judged next [s].
        filtered: (3, n) torque, velocity and its sign through the low pass of the prediction.
        products: (n, 4, 4) sums over time of products of P, T, and both kinds of friction.
    """

    time: float
    due: float
    filtered: np.ndarray
    products: np.ndarray

    @classmethod
    def none(cls, n: int) -> HeardTorques:
        """Return that of n joints before any sample."""
        return cls(0.0, _FIRST, np.zeros((3, n)), np.zeros((n, 4, 4)))

    def after(
        self, tau: np.ndarray, v: np.ndarray, error: np.ndarray, decay: float, elapsed: float
    ) -> HeardTorques:
        """Return what they have told with one more sample.

        Args:
            tau: (n) measured torque [N m or N].
            v: (n) joint velocity [rad/s or m/s].
            error: (n) P - T [N m or N].
            decay: of the low pass over the sample.
            elapsed: since the sample before [s].
        """
        now = np.stack([tau, v, np.tanh(v / _SLIDING)])
        filtered = decay * self.filtered + (1.0 - decay) * now
        T = filtered[0]
        row = np.stack([T + error, T, filtered[1], filtered[2]], axis=1)
        products = self.products + elapsed * row[:, :, None] * row[:, None, :]
        return HeardTorques(self.time + elapsed, self.due, filtered, products)

    def judged(self, names: Sequence[str]) -> HeardTorques | tuple[()]:
        """Return what is to be remembered from now on, nothing once all is told.

        Args:
            names: of the joints.

        Raises:
            ImplausibleError: the torques cannot be those of the robot.
        """
        if self.time < self.due:
            return self
        PP, PT, TT = self._without_friction()
        heavy = np.sqrt(PP) > _HEAVY * max(math.sqrt(PP.max(initial=0.0)), _ZERO)
        clear = -PT / np.sqrt(np.maximum(PP * TT, _ZERO)) > _CLEAR
        against = heavy & (PT < _AGAINST * PP) & clear
        if against.any() and not against[heavy].all():
            j = int(np.argmax(against))
            raise self._mismatch(PT[j] / PP[j], "the wrong sign?", f" for joint '{names[j]}'")
        both, predicted, measured = float(PT.sum()), float(PP.sum()), float(TT.sum())
        correlation = both / math.sqrt(max(predicted * measured, _ZERO))
        if predicted > max(_PREDICTED**2 * measured, _ZERO):
            factor = both / predicted
            if not _FACTORS[0] < factor < _FACTORS[1] or correlation < _RELATED:
                raise self._mismatch(factor, _guess(factor, correlation))
        elif predicted > _ZERO and both > _FACTORS[1] * predicted and correlation > _CLEAR:
            raise self._mismatch(both / predicted, "in another unit?")
        return () if self.due >= _LAST else self._replace(due=2.0 * self.due)

    def _mismatch(self, factor: float, guess: str, whose: str = "") -> ImplausibleError:
        """Return the error of torques that are a multiple of the predicted ones."""
        return ImplausibleError(
            "tau",
            f"{factor:.2g} times",
            f"is not what the model predicts{whose} in the first {self.time:.2g} s of motion",
            guess,
            "Give the torques of the joints in N m or N, after the gears and with gravity. "
            "limits=pa.Limits(guards={'gravity': False}) switches this check off.",
        )

    def _without_friction(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return <P, P>, <P, T> and <T, T> (n) without what friction could explain."""
        outer, mixed, inner = (
            self.products[:, :2, :2],
            self.products[:, :2, 2:],
            self.products[:, 2:, 2:],
        )
        explained = mixed @ np.linalg.pinv(inner, rcond=1e-9, hermitian=True) @ mixed.swapaxes(1, 2)
        rest = outer - explained
        return np.maximum(rest[:, 0, 0], 0.0), rest[:, 0, 1], np.maximum(rest[:, 1, 1], 0.0)


def _guess(factor: float, correlation: float) -> str:
    """Return what may cause a factor of all joints together."""
    if factor < _AGAINST:
        return "the wrong sign?"
    if correlation > _CLEAR:
        return "in amperes? before the gear?"
    return "without gravity, which the arm adds? another mounting, or order of the joints?"
