"""Position and orientation of the frame together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from .rotation import quaternion, rotation_between, rotation_drift, turned
from .task import FrameTask, RowGroup

_LOOSEST = 0.02  # of the square of a quaternion's length


@dataclass(frozen=True)
class PoseTask(FrameTask):
    """Position and orientation: 3 position rows, then 3 rotation rows, all in world axes.

    x and x_d are 7 numbers: position [m] and unit quaternion xyzw of the frame (R_d: of the desired
    frame). Velocities and accelerations are 6: linear [m/s], then angular [rad/s]. The error is dx
    = (p - p_d, phi), phi = log(R R_d^T) [rad].

    What of the proofs carries over. phi is not a vector whose derivative is omega - omega_d, but
    delta = dphi/dt - (omega - omega_d) is known: it needs phi, omega_d and omega = J_omega qd only,
    and J_omega holds no translation, so that no estimate enters. The laws subtract what delta would
    add to their closed loops. The rest is phi^T delta = 0, which takes delta out of dV/dt wherever
    K multiplies phi by one number; hence gains on the rotation rows are multiples of the identity,
    without coupling to the position, and others are refused. Each law's V and dV/dt then hold as
    they stand, and unknown translations are learned from the position rows, those of the
    orientation being zero in Y_k.

    What is asked of the belief. The inertia of a wrist may be a small part of its load's, and laws
    that command M_hat v then command too little on the rotation rows until the load is learned.
    Believe in a load, rather too heavy.

    What is local. phi jumps where the orientation is half a turn off, |phi| = pi, and the proofs
    hold in |phi| < pi. Where V(0) < k pi^2 / 2, k such that V >= k phi^T phi / 2, the loop stays
    inside because V does not grow.
    """

    @property
    def coordinates(self) -> int:
        """Seven: position and quaternion."""
        return 7

    @property
    def positions(self) -> int:
        """Three: the rotation rows follow."""
        return 3

    @property
    def groups(self) -> tuple[RowGroup, ...]:
        """Position, then rotation."""
        return RowGroup("position", "m", slice(0, 3)), RowGroup("rotation", "rad", slice(3, 6))

    def of(self, placement: pin.SE3) -> np.ndarray:
        """Return position [m] and quaternion xyzw, of either sign, (7) of a frame's placement."""
        return np.concatenate([placement.translation, quaternion(placement.rotation)])

    def velocity_of(self, motion: pin.Motion) -> np.ndarray:
        """Return linear and angular velocity (6) of a frame's LOCAL_WORLD_ALIGNED motion."""
        return np.array(motion.vector)

    def position(self, x: np.ndarray) -> np.ndarray:
        """Return the positions (3) among coordinates x (7) or a velocity (6)."""
        return x[:3]

    def error(self, x: np.ndarray, x_d: np.ndarray) -> np.ndarray:
        """Return dx (6) = (p - p_d, phi); phi is NaN for quaternions off unit length by 1 %."""
        dx = np.empty(6)
        dx[:3] = x[:3] - x_d[:3]
        q, q_d = x[3:].tolist(), x_d[3:].tolist()
        dx[3:] = rotation_between(q, q_d) if _unit(q) and _unit(q_d) else np.nan
        return dx

    def drift(self, dx: np.ndarray, xd: np.ndarray, xd_d: np.ndarray) -> np.ndarray:
        """Return delta (6): zeros, then dphi/dt - (omega - omega_d) [rad/s] of the orientation."""
        delta = np.zeros(6)
        delta[3:] = rotation_drift(dx[3:].tolist(), xd[3:].tolist(), xd_d[3:].tolist())
        return delta

    def known_velocity(self, xd: np.ndarray | None, xd_hat: np.ndarray) -> np.ndarray:
        """Return the linear velocity, measured or believed, and the believed angular one (6)."""
        return xd_hat if xd is None else np.concatenate([xd[:3], xd_hat[3:]])

    def turn(self, x_hat: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return R_hat^T R of a believed and a seen pose, as a quaternion xyzw."""
        return (_turning(x_hat[3:]).conjugate() * _turning(x[3:])).coeffs()

    def turn_between(self, turn: np.ndarray, before: np.ndarray, share: float) -> np.ndarray:
        """Return the turn on the way to an earlier one, this share of it."""
        return _turning(turn).slerp(share, _turning(before)).coeffs()

    def carried(self, x_hat: np.ndarray, epsilon: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """Return the pose (7) that is epsilon (3) [m] and a turn of its own axes from another."""
        orientation = (_turning(x_hat[3:]) * _turning(turn)).normalized()
        return np.concatenate([x_hat[:3] - epsilon, orientation.coeffs()])

    def moved(self, x: np.ndarray, by: np.ndarray) -> np.ndarray:
        """Return the pose (7) moved by by[:3] [m] and turned by by[3:] [rad] about world axes."""
        return np.concatenate([x[:3] + by[:3], turned(x[3:], by[3:])])

    def flaw(self, x: np.ndarray) -> str | None:
        """Return what is wrong with a quaternion that is not of unit length within 1 %, or None."""
        if _unit(x[3:].tolist()):
            return None
        return f"has a quaternion xyzw of length {np.linalg.norm(x[3:]):.4g} instead of 1"


def _turning(q: np.ndarray) -> pin.Quaternion:
    x, y, z, w = q.tolist()
    return pin.Quaternion(w, x, y, z)


def _unit(q: list[float]) -> bool:
    x, y, z, w = q
    return abs(x * x + y * y + z * z + w * w - 1.0) < _LOOSEST
