"""What a control law may use at one instant."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from .models.right_inverse import RightInverse


@dataclass(slots=True, eq=False, init=False)
class Signals:
    """Everything a law may use at one instant; m task coordinates, n joints, m_p positions.

    The controller fills it once. Its arrays belong to this instant for good: no later one changes
    them, and a law must not write to them.

    Attributes:
        t: time [s].
        q: (nq) measured configuration.
        v: (n) measured joint velocity [rad/s or m/s].
        a: (n) joint acceleration, measured or filtered from v [rad/s^2 or m/s^2]; None for a law
            whose filters give none, without a measurement.
        x: task coordinates now, measured or predicted from the last frame; of a joint task those
            of q.
        xd: (m) measured task velocity; J_hat v without such a sensor, and in the rows that need
            none, such as the angular ones.
        xd_d, xdd_d: (m) desired task velocity and acceleration.
        dx: (m) x - x_d; for a pose the rotation vector of the orientation error in its last three
            rows, for joints the difference on the manifold.
        xd_hat: (m) J_hat v, the estimated task velocity.
        delta: (m) d(dx)/dt - (xd - xd_d) of a pose, known without xd, or None where it is zero; see
            ``PoseTask``.
        a_k: (p_k) kinematic estimate [m].
        a_d: (p_d) dynamic estimate.
        a_0: (p_d) initial dynamic estimate.
        adapting: whether the estimates move.
        J: (m, n) J_hat, the estimated Jacobian.
        Jdot_v: (m) dJ_hat/dt v with the estimate held constant.
        Y_k: (m, p_k) kinematic regressor.
        inverse: right inverse of J_hat, damped near its singularities.
        epsilon: (m_p) prediction error of the last seen position, x_hat(q; a_k) - x [m]; empty for
            joint tasks.
        X_k: (m_p, p_k) regressor of epsilon: it is X_k da_k at the configuration where the position
            was seen.
        filtered: output of the law's own filters; see ``Law.filters``.
        filtered_torque: filtered regressor and torque of the joints, a ``FilteredTorque``, where
            the adaptation of the dynamics uses their prediction error, else None.
        residual: (n) prediction error of the torque, W a_d - y [N m or N], or None as well.
        w: (n) measured velocity of the motors [rad/s or m/s], or None.
        stands: (c) which contacts stand; None: all.
        missed: what constraint forces cannot give of the torque to send, once that is known.
    """

    t: float
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    x: np.ndarray
    xd: np.ndarray
    xd_d: np.ndarray
    xdd_d: np.ndarray
    dx: np.ndarray
    xd_hat: np.ndarray
    delta: np.ndarray | None
    a_k: np.ndarray
    a_d: np.ndarray
    a_0: np.ndarray
    adapting: bool
    J: np.ndarray
    Jdot_v: np.ndarray
    Y_k: np.ndarray
    inverse: RightInverse
    epsilon: np.ndarray
    X_k: np.ndarray
    filtered: Any
    filtered_torque: Any
    residual: np.ndarray | None
    w: np.ndarray | None
    stands: np.ndarray | None
    missed: Any

    @property
    def dxd_hat(self) -> np.ndarray:
        """The estimated task-velocity error J_hat v - xd_d (m)."""
        return np.subtract(self.xd_hat, self.xd_d)

    def replaced(self, **changes: Any) -> Signals:
        """Return signals with other values of some attributes, by name."""
        other = copy.copy(self)
        for name, value in changes.items():
            setattr(other, name, value)
        return other
