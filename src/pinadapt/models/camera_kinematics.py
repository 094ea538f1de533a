"""Kinematics of the picture of the task frame in fixed cameras, whose projections are unknown.

A camera sees the frame at y = (N phi(q)) / z with the depth z = D phi(q), in the notation of
``tracker_kinematics``: the unknown projection (3, 4) times the unknown translations. Its scale is
free, so the last entry of D is one: depths are relative to that at home. Then z y - N phi = 0 is
linear, and with the *measured* y the prediction error y_hat - y = (N_hat phi - z_hat y) / z_hat is
linear in the errors of N and D, exactly, however wrong they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from ..robot.robot import Robot
from ..tasks.frame import ImageTask
from .tracker_kinematics import LumpedKinematics
from .translations import PlacedTranslations, Translation

CAMERA = "camera"
_OFF = 0.1  # of the reach: translations, and the picture at home
_NEAR = 0.5  # of 1 / reach: change of the relative depth by a motion [1/m]
_WIDE = 10.0  # times these: the bounds
_FAR = 100.0  # reaches: bounds of the picture at home, from a corner of the image or elsewhere
_LEAST = 0.1  # depth relative to that at home
_SAME = 1e-9


class CameraKinematics(LumpedKinematics):
    """The estimated kinematics of a picture, y = N phi(q) / (D phi(q)).

    The parameters are the rows of N (m, 4 + 3 k), then those of D without their last entry, one
    row a camera. J = (N - y_hat D) Phi / z_hat is the exact Jacobian of the estimated picture. The
    depth z_hat is at least a tenth of that at home. ``Y_k`` is for y_hat and z_hat as they are.

    C. C. Cheah, C. Liu, J.-J. E. Slotine, *Adaptive Jacobian vision based control for robots with
    uncertain depth information*, Automatica 46 (2010) 1228-1233; H. Wang, *Adaptive visual tracking
    for robotic systems without image-space velocity measurement*, Automatica 55 (2015) 294-301.
    """

    task: ImageTask
    affine = False

    def __init__(self, robot: Robot, unknown: str | Sequence[str | Translation] = ()) -> None:
        """Choose the unknown translations of a nominal robot, as ``unknown_translations``.

        Raises:
            ParameterError, RobotError: as ``unknown_translations``.
        """
        self._take(robot, unknown)
        task, width = self.task, len(self._columns)
        self._camera = np.array([camera for camera, _ in task.picks])
        count = int(self._camera.max()) + 1
        depths = ["depth", "depth_2"][:count]
        self.names = (
            *(f"{row}({name})" for row in task.labels for name in self._columns),
            *(f"{row}({name})" for row in depths for name in self._columns[:-1]),
        )
        self.size, self._split = len(self.names), task.size * width
        self._shape, self._below = (task.size, width), (count, width - 1)
        self._one = np.ones((count, 1))
        self.initial = self.parameters(task, self.nominal)
        small = np.append(np.repeat([1.0, _OFF * robot.reach], [3, width - 4]), _OFF * robot.reach)
        deep = small[:-1] * _NEAR / robot.reach
        self.sizes = np.concatenate([np.tile(small, task.size), np.tile(deep, count)])
        wide = _WIDE * self.sizes
        wide[: self._split].reshape(self._shape)[:, -1] = _FAR * robot.reach
        self.bounds = self.initial + wide * np.array([[-1.0], [1.0]])

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return CameraKinematics, (self.robot, self.translations)

    def parameters(self, task: ImageTask, translations: np.ndarray) -> np.ndarray:
        """Return the parameters (p) of the cameras of a task and of translations (k) [m]."""
        above, below = (
            np.array([self._lumped_row(row, translations) for row in rows])
            for rows in task.projections
        )
        depth = below[:, -1:]
        first = [int(np.argmax(self._camera == camera)) for camera in range(self._below[0])]
        return np.concatenate([(above / depth).ravel(), (below / depth)[first, :-1].ravel()])

    def _lumped_row(self, H: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the row (4 + 3 k) of N or D of a row H (4) of a projection."""
        blocks = np.concatenate([H[:3], *(each * H[:3] for each in a - self.nominal)])
        return np.append(blocks, H[3] + blocks.dot(self._home))

    def _rows(self, a_k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return N (m, 4 + 3 k) and D (c, 4 + 3 k) of an estimate a_k (p)."""
        below = a_k[self._split :].reshape(self._below)
        return a_k[: self._split].reshape(self._shape), np.concatenate([below, self._one], axis=1)

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate at an estimate a_k (p), configuration q (nq) and velocity v (nv)."""
        self._look(q, v)
        self.a_k, (N, D) = a_k, self._rows(a_k)
        D = D[self._camera]
        self._z = np.maximum(D.dot(self._phi), _LEAST)
        self.p_hat = N.dot(self._phi) / self._z
        self._D, self._G = D, (N - self.p_hat[:, None] * D) / self._z[:, None]
        self.J, self.xd_hat = self._G.dot(self._Phi), self._G.dot(self._phid)
        self._zd = D.dot(self._phid)
        self.Jdot_v = self._G.dot(self._drift) - 2.0 * self.xd_hat * self._zd / self._z
        self.X_k = self._regressor(self._phi, self.p_hat, self._z)
        self.Y_k = self._regressor(self._phid, self.p_hat, self._z)
        self.last_joint = self.p_hat

    def _regressor(self, phi: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the matrix (m, p) of (dN phi - y dD phi) / z for changes dN and dD."""
        found = np.zeros((len(y), self.size))
        for i, camera in enumerate(self._camera):
            width, deep = phi.size, self._split + camera * (phi.size - 1)
            found[i, i * width : (i + 1) * width] = phi / z[i]
            found[i, deep : deep + width - 1] = phi[:-1] * (-y[i] / z[i])
        return found

    @property
    def x_hat(self) -> np.ndarray:
        """The estimated coordinates (m) of the picture."""
        return self.p_hat

    def explaining(self, x: np.ndarray) -> np.ndarray:
        """Return X (m, p) with p_hat - x = X da_k, exactly, for a measured picture x (m)."""
        return self._regressor(self._phi, x, self._z)

    def at(self, q: np.ndarray, seen: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the estimated picture (m) at another q (nq), and X (m, p) there."""
        x, r = self._inside.at_unchecked(q)
        phi, (N, D) = self.lumped_unchecked(x[:3], r), self._rows(self.a_k)
        z = np.maximum(D[self._camera].dot(phi), _LEAST)
        y = N.dot(phi) / z
        return y, self._regressor(phi, y if seen is None else seen, z)

    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return dJ/dt (m, nv) by the motion and by the rate a_k_rate (p) of the estimate."""
        N_rate, _ = self._rows(a_k_rate)
        D_rate = np.zeros_like(self._D)
        D_rate[:, :-1] = a_k_rate[self._split :].reshape(self._below)[self._camera]
        yd = self.xd_hat + self.X_k.dot(a_k_rate)
        zd = self._zd + D_rate.dot(self._phi)
        change = N_rate - yd[:, None] * self._D - self.p_hat[:, None] * D_rate
        G_rate = (change - zd[:, None] * self._G) / self._z[:, None]
        return np.asarray(self._G.dot(self._Phi_rate()) + G_rate.dot(self._Phi))

    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return Ybar_k (m, p), d(xd_hat)/dt = Ybar_k a_k, for y_hat and its rate as they are."""
        y, phidd = self.p_hat, self._Phi.dot(a) + self._drift
        found = self._regressor(phidd, y, self._z)
        turning = self._regressor(self._phid, 2.0 * self.xd_hat, self._z)
        found[:, self._split :] += turning[:, self._split :]
        return found

    def standing_at(self, y: np.ndarray) -> np.ndarray:
        """Return the parameters (p) of a picture that stays at y (m), however the arm moves."""
        found = np.zeros(self.size)
        found[: self._split].reshape(self._shape)[:, -1] = y
        return found

    def initial_at(self, q: np.ndarray, x: np.ndarray | None) -> np.ndarray:
        """Return the estimate (p) to start from: as described, with the picture measured.

        Args:
            q: (nq) measured.
            x: (m) measured picture, or None.
        """
        found = self.initial.copy()
        if x is not None:
            self.update(self.initial, q, self._still)
            found[: self._split].reshape(self._shape)[:, -1] += (x - self.p_hat) * self._z
        return found

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of a robot with the same chain, as ``Robot.filmed_by`` gives.

        None if no parameters give that robot's picture, because other placements differ.
        """
        if not isinstance(robot.task, ImageTask):
            return None
        model = robot.model
        a = PlacedTranslations(model, self.robot.frame_id, self.translations).read()
        a_k = self.parameters(robot.task, a)
        q = pin.integrate(model, self.robot.q0, np.linspace(0.1, 0.3, self.nv))
        self.update(a_k, q, self._still)
        return a_k if np.abs(self.p_hat - robot.position(q)).max() < _SAME else None

    def seen(self, a_k: np.ndarray) -> Robot:
        """Return the nominal robot with the cameras of an estimate a_k (p)."""
        N, D = self._rows(a_k)
        cameras = np.zeros((len(D), 3, 4))
        rows = [(camera, row, N[i]) for i, (camera, row) in enumerate(self.task.picks)]
        for camera, row, found in (*rows, *((i, 2, each) for i, each in enumerate(D))):
            cameras[camera, row] = *found[:3], found[-1] - found[:3].dot(self._home[:3])
        given = tuple(tuple(map(tuple, H.tolist())) for H in cameras)
        return replace(self.robot, task=replace(self.task, cameras=given))

    def write(self, model: pin.Model, a_k: np.ndarray) -> None:
        """Write nothing: a picture does not separate a translation from the camera's scale."""

    def read(self, model: pin.Model, a_k: np.ndarray) -> np.ndarray:
        """Return the estimate a_k (p) itself."""
        return a_k
