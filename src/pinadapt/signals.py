"""What a control law may see at one instant."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, dataclass, fields
from typing import Any, NoReturn, cast

import numpy as np

from .adaptation.adaptation import Estimate
from .models.late_frames import Sensed
from .models.right_inverse import RightInverse


@dataclass(slots=True, eq=False)
class OpenSignals:
    """Signals that are being put together; see ``Signals``.

    A frozen dataclass pays for every attribute in its ``__init__``. These are written plainly and
    then closed as a whole, by ``signals.__class__ = Signals``.
    """

    t: float
    q: np.ndarray
    v: np.ndarray
    xd: np.ndarray
    xd_d: np.ndarray
    xdd_d: np.ndarray
    dx: np.ndarray
    xd_hat: np.ndarray
    delta: np.ndarray | None
    kinematic: Estimate
    a_k: np.ndarray
    a_d: np.ndarray
    a_0: np.ndarray
    J: np.ndarray
    Jdot_v: np.ndarray
    Y_k: np.ndarray
    inverse: RightInverse
    filtered: Any
    adapting: bool
    sensed: Sensed
    epsilon: np.ndarray
    X_k: np.ndarray
    predicted: Any


class Signals(OpenSignals):
    """Everything a law may see at one instant; m task coordinates, n joints, m_p positions.

    Its arrays belong to this instant for good: no later one changes them. It is frozen, and nothing
    here is to be written to.

    Attributes:
        t: time [s].
        q, v: measured configuration (nq) and joint velocity (n).
        xd: (m) measured task velocity; J_hat v without such a sensor, and in the rows that need
            none, such as the angular ones.
        xd_d, xdd_d: (m) desired task velocity and acceleration.
        dx: (m) x - x_d; for a pose the rotation vector of the orientation error in its last three
            rows, for joints the difference on the manifold.
        xd_hat: (m) J_hat v, the estimated task velocity.
        delta: (m) d(dx)/dt - (xd - xd_d) of a pose, known without xd, or None where it is zero; see
            ``PoseTask``.
        kinematic: the kinematic estimate, with what its adaptation remembers.
        a_k, a_d: (p_k), (p_d) the estimates.
        adapting: whether the estimates move.
        epsilon: (m_p) prediction error of the last seen position [m], of which X_k (m_p, p_k) is
            the regressor: X_k da_k at the configuration where it was seen. Empty for laws that
            do not ask; see ``Law.needs_prediction``.
        sensed: what the controller keeps of the sensors for the next sample.
        a_0: (p_d) the initial dynamic estimate.
        J: (m, n) J_hat, the believed Jacobian.
        Jdot_v: (m) dJ_hat/dt v with the estimate held constant.
        Y_k: (m, p_k) kinematic regressor.
        inverse: right inverse of J_hat, damped near its singularities.
        filtered: what the law's own filters tell; see ``Law.filters``.
        predicted: filtered regressor and torque of the joints, a ``FilteredTorque``, where the
            adaptation of the dynamics asks for them, else None.
    """

    __slots__ = ()

    def __new__(cls, *args: Any, **kwargs: Any) -> Signals:
        """Take all attributes, in their order or by name."""
        signals = OpenSignals(*args, **kwargs)
        signals.__class__ = cls
        return cast(Signals, signals)

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Leave what ``__new__`` has taken."""

    def __setattr__(self, name: str, value: object) -> NoReturn:
        """Refuse."""
        raise FrozenInstanceError(f"cannot assign to field {name!r}")

    def __delattr__(self, name: str) -> NoReturn:
        """Refuse."""
        raise FrozenInstanceError(f"cannot delete field {name!r}")

    def __reduce__(self) -> tuple[type[Signals], tuple[Any, ...]]:
        """Copy by the attributes."""
        return Signals, tuple(getattr(self, part.name) for part in fields(self))

    @property
    def dxd_hat(self) -> np.ndarray:
        """The estimated task-velocity error J_hat v - xd_d (m)."""
        return np.subtract(self.xd_hat, self.xd_d)
