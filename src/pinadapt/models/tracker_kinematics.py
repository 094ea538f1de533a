"""Kinematics of the task frame in the axes of a tracker whose placement is unknown.

x = R_c (p(q) + sum_i a_i r_i(q)) + t_c with the tracker's rotation R_c and position t_c: linear in
the products R_c, a_i R_c and the position at home, see ``projected_kinematics``. None of the blocks
needs to remain a rotation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..robot.robot import Robot
from .linear_kinematics import BOUND, OFF
from .projected_kinematics import ProjectedKinematics, nearest_rotation
from .translations import Words

TRACKER = "tracker"
_FARTHEST = 1e3  # [m] of the frame at home from the tracker; half, twice: the same
# of the sizes, by which a described arm differs from a real one; half: last error of a Z1 13 %
# larger, twice: 8 % smaller
_INEXACT = 0.01


class Tracker(NamedTuple):
    """The pose of a tracker, and the translations that it identifies.

    Attributes:
        placement: of the robot's base in the axes of the tracker (R_c, t_c).
        a: (k) the unknown translations [m].
    """

    placement: pin.SE3
    a: np.ndarray


class TrackerKinematics(ProjectedKinematics):
    """The estimated kinematics of the task frame in the axes of a tracker, x = Theta phi(q).

    The parameters are the rows of Theta (m_p, 4 + 3 k), one after the other. The estimated Jacobian
    must have full rank; the rotation block needs not be orthogonal.

    H. Wang, *Adaptive control of robot manipulators with uncertain kinematics and dynamics*, IEEE
    Trans. Automatic Control 62 (2017) 948-954, for the law; the lumped parameters are those of
    uncalibrated visual servoing.
    """

    def __init__(self, robot: Robot, unknown: Words = ()) -> None:
        """Choose the unknown translations of a nominal robot, as ``unknown_translations``.

        Raises:
            ParameterError, RobotError: as ``unknown_translations``.
        """
        self._project(robot, unknown, ())
        k = self.nominal.size
        self._rows = self.task.place
        self.initial = self.parameters(Tracker(pin.SE3.Identity(), self.nominal))
        wide = np.repeat([BOUND, BOUND * 0.5 * robot.reach, _FARTHEST], [3, 3 * k, 1])
        self._vague = np.diag(np.repeat([1.0, 1.0 / robot.reach**2, 0.0], [3, 3, k]))
        self.bounds = np.tile([-wide, wide], self.positions)

    def _axes(self) -> np.ndarray:
        """Return the rotation (3, 3) nearest to R_c of the estimate."""
        return nearest_rotation(self._now.maps[0, :3, :3])

    def parameters(self, tracker: Tracker) -> np.ndarray:
        """Return the parameters (p) of a tracker and translations."""
        return self._theta(tracker.placement.homogeneous[:3], self._factors(tracker.a))

    def _theta(self, H: np.ndarray, factors: np.ndarray) -> np.ndarray:
        """Return the parameters (p) of a map H (3, 4) of positions; see ``_rows_of``."""
        return self._rows_of(H[self._rows], factors).ravel()

    def tracker(self, a_k: np.ndarray) -> Tracker:
        """Return the tracker and the translations that an estimate a_k (p) is near to.

        The rotation is the nearest one to R_c of Theta, an orthogonal Procrustes problem (P. H.
        Schönemann, Psychometrika 31, 1966, 1-10); the translations are the nearest to a_i R_c then.
        """
        Theta = a_k.reshape(self._shape)
        m = self.positions
        blocks = np.zeros((len(self.nominal) + 1, 3, 3))
        blocks[:, self._rows] = Theta[:, :-1].reshape(m, -1, 3).swapaxes(0, 1)
        R = nearest_rotation(blocks[0])
        t = np.zeros(3)
        a = np.tensordot(blocks[1:], R) / m
        t[self._rows] = Theta[:, -1] - np.kron(np.append(1.0, a), R[self._rows]).dot(self._home)
        return Tracker(pin.SE3(R, t), a + self.nominal)

    def slopes(self, tracker: Tracker) -> np.ndarray:
        """Return the derivatives (p, 6 + k) of the parameters of a tracker.

        With respect to small turns of the base about the axes of the tracker, its position, and the
        translations.
        """
        R = tracker.placement.rotation
        factors = self._factors(tracker.a)
        ways = [np.column_stack([pin.skew(way[:3]) @ R, way[3:]]) for way in np.eye(6)]
        found = [self._theta(way, factors) for way in ways]
        fixed = np.column_stack([R, np.zeros(3)])
        found += [self._theta(fixed, one) for one in np.eye(len(factors))[1:]]
        return np.array(found).T

    def explaining_tracker(
        self, H: np.ndarray, score: np.ndarray, start: Tracker
    ) -> tuple[Tracker, np.ndarray]:
        """Return the tracker that explains frames best, and the information of it (6 + k, 6 + k).

        It minimises theta^T H theta / 2 - score^T theta over its parameters theta, the translations
        known before to a tenth of the reach, by Gauss-Newton. The information, an inverse
        covariance, is of what ``slopes`` are taken with respect to.

        Args:
            H: (p, p) sum of X_k^T X_k of the frames over the variance of their noise.
            score: (p) sum of X_k^T x, x relative to X_k theta, over the same.
            start: tracker to begin with.
        """
        k = len(self.nominal)
        tracker = start
        known = np.repeat([0.0, 1.0 / (OFF * self.robot.reach) ** 2], [6, k])
        for _ in range(20):
            G = self.slopes(tracker)
            off = np.append(np.zeros(6), tracker.a - self.nominal)
            information = G.T @ H @ G + np.diag(known)
            slope = G.T @ (score - H @ self.parameters(tracker)) - known * off
            step = np.linalg.solve(information + self._vague, slope)
            place = tracker.placement
            moved = pin.SE3(pin.exp3(step[:3]) @ place.rotation, place.translation + step[3:6])
            tracker = Tracker(moved, tracker.a + step[6:])
            if np.abs(step).max() < 1e-10:
                break
        return tracker, information

    def covariance(self, tracker: Tracker, information: np.ndarray) -> np.ndarray:
        """Return the covariance (p, p) of the parameters.

        The information (6 + k, 6 + k) is that of frames on the tracker; what they do not show is
        known to a radian and to the reach.
        """
        G = self.slopes(tracker)
        return G @ np.linalg.inv(information + self._vague) @ G.T

    def information(self, tracker: Tracker, information: np.ndarray) -> np.ndarray:
        """Return what a tracker with the information (6 + k, 6 + k) says of the parameters (p, p).

        All but the position at home are known no better than to a hundredth of their sizes: so much
        an arm may differ from its description.
        """
        inexact = (_INEXACT * self.sizes.reshape(self._shape)) ** 2
        inexact[:, -1] = 0.0
        found = np.linalg.inv(self.covariance(tracker, information) + np.diag(inexact.ravel()))
        return 0.5 * (found + found.T)

    def _described(self, robot: Robot) -> np.ndarray:
        """Return the parameters (p) of the tracker of a robot, as ``Robot.seen_from`` gives."""
        base = self.robot.model.jointPlacements[1]
        placement = robot.model.jointPlacements[1] * base.inverse()
        return self.parameters(Tracker(placement, self.nominal + self.displacement(robot.model)))

    def seen(self, a_k: np.ndarray) -> Robot:
        """Return the nominal robot with x in the axes in which an estimate a_k (p) has it."""
        placement = self.tracker(a_k).placement
        return self.robot.seen_from(placement.rotation, placement.translation)

    def write(self, model: pin.Model, a_k: np.ndarray) -> None:
        """Write the translations of an estimate a_k (p) [m] into a model of the chain."""
        self.displace(model, self.tracker(a_k).a - self.nominal)

    def read(self, model: pin.Model, a_k: np.ndarray) -> np.ndarray:
        """Return an estimate a_k (p) with the translations of a model of the chain [m]."""
        a = self.nominal + self.displacement(model)
        return self.parameters(self.tracker(a_k)._replace(a=a))
