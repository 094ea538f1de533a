"""Joint references for a path of the frame."""

from __future__ import annotations

import numpy as np

import pinadapt as pa

from .nominal_robot import NominalRobot

_DAMPING = 0.02  # relative to the root mean square of J's singular values
_RETURN = 0.5  # rate of the return to home in the null space, in bandwidths, as in the library


class InverseKinematics:
    """qd_r = J^+ (xd - w (x_hat(q_r) - x)) + (I - J^+ J) psi, damped least squares.

    The tool of the nominal robot follows the path; the true tool is not used.
    """

    def __init__(self, nominal: NominalRobot, w: float) -> None:
        """Take the robot, and the rate w [1/s] at which errors of q_r decay."""
        self._nominal = nominal
        self._w = w
        self._posture = pa.laws.Posture(nominal.robot, frequency=_RETURN * w)

    def rate(self, q_r: np.ndarray, x: np.ndarray, xd: np.ndarray) -> np.ndarray:
        """Return qd_r (n) at q_r (n) for a path at x (m) with velocity xd (m)."""
        J = self._nominal.jacobian(q_r)
        psi = -self._posture.frequency * self._posture.offset(q_r)
        gram = J @ J.T
        gram += _DAMPING**2 * np.trace(gram) / len(J) * np.eye(len(J))
        wanted = xd - self._w * (self._nominal.position(q_r) - x)
        return np.asarray(psi + J.T @ np.linalg.solve(gram, wanted - J @ psi))
