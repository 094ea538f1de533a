"""Kinematics of what sensors with unknown placements see: one output map on top of the columns.

With phi(q) the position of the frame by the description and r_i = dp/da_i for the errors a of
unknown translations, each relative to its value at home, and a one at the end, all of them see

    y = N phi(q) / (D phi(q)),

with the division row by row. For a camera N and D are its projection (3, 4) times (1, a); its scale
is free, so the last entry of D is one and depths are relative to that at home. For a tracker with
the rotation R_c, N = (R_c, a_1 R_c, ..., a_k R_c, x_home), and D phi is one. The products are the
parameters: y is linear in N, so no rotation is parametrised, and N phi - y D phi = 0 is linear in
both, so that with the *measured* y the prediction error is linear in the errors of N and D,
exactly, however wrong they are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._checks import instance
from ..exceptions import RobotError
from ..robot.robot import Robot
from ..tasks.frame import FrameTask, quaternion
from .linear_kinematics import ColumnMotion, LinearKinematics, columns_of_translations
from .translations import Translation, unknown_translations

OFF = 0.1  # of the reach: how far translations and the position at home may be off
_LEAST = 0.1  # depth relative to that at home


class ProjectedKinematics(LinearKinematics):
    """The estimated coordinates y = N phi(q) / (D phi(q)) of the task frame.

    The parameters are the rows of N (m_p, 4 + 3 k), then of each camera that of D without its last
    entry. J = (N - y_hat D) Phi / z_hat is the exact Jacobian of the estimated coordinates, where
    dphi/dt = Phi v. The depth z_hat is at least a tenth of that at home. ``Y_k`` is for y_hat and
    z_hat as they are. For a pose the angular velocity is R_c w, w of the frame in the axes of the
    base; a constant rotation between frame and marker has no effect on it.

    Attributes:
        nominal: (k) the described translations [m].
        translation_names: (k) names of the translations.
    """

    task: FrameTask
    calibrated = False

    def _project(
        self, robot: Robot, unknown: str | Sequence[str | Translation], camera: Sequence[int]
    ) -> None:
        """Take a nominal robot, its unknown translations, and the camera of each row, if any."""
        task = instance(robot, Robot, "robot", RobotError).frame_task
        self.translations = unknown_translations(robot, unknown)
        columns = columns_of_translations(robot, self.translations)
        self._take(robot, columns)
        self.task, self.positions = task, task.positions
        self._turns = task.size > task.positions
        self.nominal, self.translation_names = columns.initial, columns.names
        self._camera = np.array(camera, dtype=int)
        cameras = len(set(camera))
        of = [f"{name}_{axis}" for name in ("base", *columns.names) for axis in "xyz"]
        depths = ["depth", "depth_2"][:cameras]
        self.names = (
            *(f"{row}({name})" for row in task.labels[: task.positions] for name in (*of, "home")),
            *(f"{row}({name})" for row in depths for name in of),
        )
        width = len(of) + 1
        self.size, self._split = len(self.names), task.positions * width
        self._shape, self._below = (task.positions, width), (cameras, width - 1)
        self._one = np.zeros(self._shape)
        self._one[:, -1] = 1.0
        self.motion.update(robot.q0, self.still)
        self._home = self.motion.phi.flatten()

    def lumped(self, p: np.ndarray, r: np.ndarray) -> np.ndarray:
        """Return phi (4 + 3 k) at a position p (3) and r (3, k)."""
        return np.append(np.concatenate([p, r.T.ravel()]) - self._home, 1.0)

    def in_base(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p (3), r (3, k) and dp/dt (3) in the axes of the base, as described."""
        self.motion.update(q, v)
        phi, phid = self.motion.phi.copy(), self.motion.phid.copy()
        return phi[0], phi[1:].T, phid[0]

    def _matrices(self, a_k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return N and D (m_p, 4 + 3 k), row by row, of an estimate a_k (p)."""
        D = self._one.copy()
        if len(self._camera):
            D[:, :-1] = a_k[self._split :].reshape(self._below)[self._camera]
        return a_k[: self._split].reshape(self._shape), D

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate at an estimate a_k (p), configuration q (nq) and velocity v (nv)."""
        motion, (N, D) = self.motion, self._matrices(a_k)
        motion.update(q, v)
        Phi, Phid = self._jacobians()
        self.a_k, self._N, self._D, self._v = a_k, N, D, v
        self._phi = np.append(motion.phi.ravel() - self._home, 1.0)
        self._phid = np.append(motion.phid, 0.0)
        self._z, self._zd = np.maximum(D.dot(self._phi), _LEAST), D.dot(self._phid)
        self.p_hat = N.dot(self._phi) / self._z
        self._G = (N - self.p_hat[:, None] * D)[:, :-1] / self._z[:, None]
        J, xd = self._G.dot(Phi), self._G.dot(self._phid[:-1])
        Jdot_v = self._G.dot(Phid.dot(v)) - 2.0 * xd * self._zd / self._z
        self.X_k = self._regressor(self._phi, self.p_hat, self._z)
        Y_k = self._regressor(self._phid, self.p_hat, self._z)
        if self._turns:
            R, turning, rate = N[:, :3], motion.axes[3:], motion.axis_rates[3:]
            J, xd = np.concatenate([J, R @ turning]), np.append(xd, R @ (turning @ v))
            Jdot_v = np.append(Jdot_v, R @ (rate @ v))
            Y_k = np.concatenate([Y_k, self._turning(turning @ v)])
        self.J, self.xd_hat, self.Jdot_v, self.Y_k = J, xd, Jdot_v, Y_k

    def _jacobians(self) -> tuple[np.ndarray, np.ndarray]:
        """Return Phi (3 + 3 k, nv), without the row of zeros of the one, and its rate."""
        return self.motion.Phi.reshape(-1, self.nv), self.motion.Phid.reshape(-1, self.nv)

    def _regressor(self, phi: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the matrix (m_p, p) of (dN phi - y dD phi) / z for changes dN and dD."""
        found, width = np.zeros((self.positions, self.size)), phi.size
        for i in range(self.positions):
            found[i, i * width : (i + 1) * width] = phi / z[i]
        for i, camera in enumerate(self._camera):
            deep = self._split + camera * (width - 1)
            found[i, deep : deep + width - 1] = phi[:-1] * (-y[i] / z[i])
        return found

    def _turning(self, angular: np.ndarray) -> np.ndarray:
        """Return the matrix (3, p) that gives R_c times a vector (3) from the parameters."""
        rest = np.zeros(self._shape[1] - 3)
        return np.kron(np.eye(3), np.append(angular, rest))

    @property
    def x_hat(self) -> np.ndarray:
        """The estimated coordinates (m), or position and quaternion xyzw (7) of a pose."""
        return self._coordinates(self.p_hat, self.motion)

    def _coordinates(self, p_hat: np.ndarray, motion: ColumnMotion) -> np.ndarray:
        """Return the task coordinates at estimated positions (m_p) and a motion of the arm."""
        if not self._turns:
            return p_hat
        R = orthonormal(self._N[:, :3]) @ motion.rotation()
        return np.concatenate([p_hat, quaternion(R)])

    def explaining(self, x: np.ndarray) -> np.ndarray:
        """Return X (m_p, p) with p_hat - x = X da_k, exactly, for measured coordinates x."""
        return self._regressor(self._phi, x, self._z)

    def at(self, q: np.ndarray, seen: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the estimated task coordinates at another q (nq), and X (m_p, p) there."""
        self.past.update(q, self.still)
        phi = np.append(self.past.phi.ravel() - self._home, 1.0)
        z = np.maximum(self._D.dot(phi), _LEAST)
        y = self._N.dot(phi) / z
        X = self._regressor(phi, y if seen is None else seen, z)
        return self._coordinates(y, self.past), X

    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return dJ/dt (m, nv) by the motion and by the rate a_k_rate (p) of the estimate."""
        (N_rate, D_rate), (Phi, Phid) = self._matrices(a_k_rate), self._jacobians()
        D_rate[:, -1] = 0.0
        yd = self.xd_hat[: self.positions] + self.X_k.dot(a_k_rate)
        zd = self._zd + D_rate.dot(self._phi)
        change = N_rate - yd[:, None] * self._D - self.p_hat[:, None] * D_rate
        G_rate = (change[:, :-1] - zd[:, None] * self._G) / self._z[:, None]
        found = self._G.dot(Phid) + G_rate.dot(Phi)
        if not self._turns:
            return np.asarray(found)
        turned = N_rate[:, :3] @ self.motion.axes[3:]
        turned += self._N[:, :3] @ self.motion.axis_rates[3:]
        return np.concatenate([found, turned])

    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return Ybar_k (m, p), d(xd_hat)/dt = Ybar_k a_k, for y_hat and its rate as they are."""
        (Phi, Phid), motion = self._jacobians(), self.motion
        phidd = np.append(Phi.dot(a) + Phid.dot(self._v), 0.0)
        found = self._regressor(phidd, self.p_hat, self._z)
        slow = self._regressor(self._phid, 2.0 * self.xd_hat, self._z)
        found[:, self._split :] += slow[:, self._split :]
        if not self._turns:
            return found
        turning = motion.axes[3:].dot(a) + motion.axis_rates[3:].dot(self._v)
        return np.concatenate([found, self._turning(turning)])

    def standing_at(self, y: np.ndarray) -> np.ndarray:
        """Return the parameters (p) of coordinates that stay at y (m_p), however the arm moves."""
        found = np.zeros(self.size)
        found[: self._split].reshape(self._shape)[:, -1] = y
        return found

    def initial_at(self, q: np.ndarray, x: np.ndarray | None) -> np.ndarray:
        """Return the estimate (p) to start from: as described, with the position measured.

        Args:
            q: (nq) measured.
            x: measured coordinates, or None.
        """
        if x is None:
            return self.initial.copy()
        self.update(self.initial, q, self.still)
        return self.initial + self.standing_at((x[: self.positions] - self.p_hat) * self._z)


def orthonormal(B: np.ndarray) -> np.ndarray:
    """Return the nearest orthonormal rows to B (m, 3); of three rows a rotation."""
    U, _, V = np.linalg.svd(B, full_matrices=False)
    if len(B) == 3 and np.linalg.det(U @ V) < 0.0:
        U[:, -1] *= -1.0
    return np.asarray(U @ V)
