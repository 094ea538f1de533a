"""Joint references for a path of the frame."""

from __future__ import annotations

import numpy as np

import pinadapt as pa

from .believed_robot import BelievedRobot

_DAMPING = 0.02  # of the root mean square of J's singular values
_RETURN = 0.5  # of the null space to home, in bandwidths, as under the library's laws


class InverseKinematics:
    """qd_r = J^+ (xd - w (x_hat(q_r) - x)) + (I - J^+ J) psi, damped least squares.

    It follows the path with the believed tool, whatever the real one does.
    """

    def __init__(self, believed: BelievedRobot, w: float) -> None:
        """Take the robot, and the rate w [1/s] at which errors of q_r decay."""
        self._believed, self._w = believed, w
        self._posture = pa.laws.Posture(believed.robot, frequency=_RETURN * w)

    def rate(self, q_r: np.ndarray, x: np.ndarray, xd: np.ndarray) -> np.ndarray:
        """Return qd_r (n) at q_r (n) for a path that is at x (m) and moves at xd (m)."""
        J = self._believed.jacobian(q_r)
        psi = -self._posture.frequency * self._posture.offset(q_r)
        gram = J @ J.T
        gram += _DAMPING**2 * np.trace(gram) / len(J) * np.eye(len(J))
        wanted = xd - self._w * (self._believed.position(q_r) - x)
        return np.asarray(psi + J.T @ np.linalg.solve(gram, wanted - J @ psi))
