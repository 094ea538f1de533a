"""Kinematics of the task frame in the axes of a tracker whose placement is unknown.

x = R_c (p(q) + sum_i a_i r_i(q)) + t_c with the tracker's rotation R_c and position t_c, the
position p of the frame by the description, and r_i = dp/da_i for the errors a of unknown
translations. The products are lumped: x = Theta phi(q), phi = (p, r_1, ..., r_k, 1), each but the
last relative to its value at home, and Theta = (R_c, a_1 R_c, ..., a_k R_c, x_home). That is linear
in Theta, so no rotation is parametrised and none of the blocks needs to remain one. For a pose the
angular velocity is R_c w, w of the frame in the axes of the base; a constant rotation between frame
and marker has no effect on it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from .._checks import instance
from ..exceptions import RobotError
from ..robot.robot import Robot
from ..tasks.frame import TASKS, FrameTask, matrix, quaternion
from .basis import base_parameters
from .frame_kinematics import FrameKinematics
from .task_kinematics import TaskKinematics
from .translations import PlacedTranslations, Translation

TRACKER = "tracker"
_OFF = 0.1  # of the reach: translations and the position at home, relative to the rotation
_WIDE = 0.5  # of the reach
_TURNED = 1.5  # bound of an entry of the rotation
_ROUNDS = 20  # of the turns that find rotation and translations
_FARTHEST = 1e3  # [m] of the frame at home from the tracker
_CONVERGED = 1e-10  # [rad] or [m]
_INEXACT = 0.01  # of the sizes, by which a described arm differs from a real one
_PRIOR = 0.1  # of the reach: standard deviation of a described translation


class Tracker(NamedTuple):
    """The pose of a tracker, and the translations that it identifies.

    Attributes:
        placement: of the robot's base in the axes of the tracker (R_c, t_c).
        a: (k) the unknown translations [m].
        misfit: how far the lumped estimate is from that of a rotation and translations, the
            largest entry of the difference of R_c and of a R_c over the reach.
    """

    placement: pin.SE3
    a: np.ndarray
    misfit: float = 0.0


class LumpedKinematics(TaskKinematics):
    """Kinematics with products of unknowns as parameters, which are linear in phi(q) (4 + 3 k).

    phi = (p, r_1, ..., r_k, 1), each but the last relative to its value at home; with the Jacobian
    Phi, dphi/dt = Phi v.

    Attributes:
        nominal: (k) the described translations [m].
        translation_names: (k) names of the translations.
    """

    task: FrameTask
    calibrated = False

    def _take(self, robot: Robot, unknown: str | Sequence[str | Translation]) -> None:
        """Take a nominal robot and its unknown translations."""
        task = instance(robot, Robot, "robot", RobotError).frame_task
        inside = FrameKinematics(replace(robot, task=TASKS["pose"]), unknown)
        self._inside, self.translations = inside, inside.translations
        self.robot, self.task, self.frame = robot.undrawn(), task, robot.frame
        self.joint_names, self.nq, self.nv = robot.joint_names, inside.nq, inside.nv
        self.positions, self.nominal = task.positions, inside.initial
        inside.update(self.nominal, robot.q0, np.zeros(self.nv))
        self._home = _stacked(inside.p_hat, inside.X_k)
        self.translation_names = inside.names
        of = [f"{name}_{axis}" for name in ("base", *inside.names) for axis in "xyz"]
        self._columns = (*of, "home")
        self._still, self._none_moves = np.zeros(self.nv), np.zeros(inside.size)

    def _look(self, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate phi, dphi/dt, Phi, and dPhi/dt v at q (nq) and v (nv)."""
        inside = self._inside
        inside.update_unchecked(self.nominal, q, v)
        J, r = inside.J, inside.X_k
        blocks = [-pin.skew(r[:, i]).dot(J_w) for i, J_w in enumerate(self._turning_of(J))]
        self._Phi = np.concatenate([J[:3], *blocks, np.zeros((1, self.nv))])
        turning = inside.acceleration_regressor_unchecked(self._still)
        self._drift = np.append(_stacked(inside.Jdot_v, turning[:3]), 0.0)
        self._phid = np.append(_stacked(inside.xd_hat, inside.Y_k[:3]), 0.0)
        self._phi = self.lumped_unchecked(inside.p_hat, r)

    def _Phi_rate(self) -> np.ndarray:
        """Return dPhi/dt (4 + 3 k, nv) by the motion."""
        inside = self._inside
        Jd, r, rd = inside.jacobian_rate_unchecked(self._none_moves), inside.X_k, inside.Y_k
        pairs = zip(self._turning_of(inside.J), self._turning_of(Jd, rate=True), strict=True)
        blocks = [
            -pin.skew(rd[:3, i]).dot(own) - pin.skew(r[:, i]).dot(rate)
            for i, (own, rate) in enumerate(pairs)
        ]
        return np.concatenate([Jd[:3], *blocks, np.zeros((1, self.nv))])

    def lumped(self, p: np.ndarray, r: np.ndarray) -> np.ndarray:
        """Return phi (4 + 3 k) at a position p (3) and r (3, k)."""
        return np.append(_stacked(p, r) - self._home, 1.0)

    lumped_unchecked = lumped

    def in_base(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p (3), r (3, k) and dp/dt (3) in the axes of the base, as described."""
        self._inside.update(self.nominal, q, v)
        return self._inside.p_hat, self._inside.X_k, self._inside.xd_hat[:3]

    def _turning_of(self, J: np.ndarray, rate: bool = False) -> Iterator[np.ndarray]:
        """Yield the angular Jacobian (3, n), or its rate, of the parent joint of each parameter.

        Args:
            J: (6, n) that of the frame, or its rate.
            rate: whether it is the rate.
        """
        of = pin.getJointJacobianTimeVariation if rate else pin.getJointJacobian
        model, data = self._inside.chain
        for part, parent in zip(self.translations, self._inside.parents, strict=True):
            own = J if part.joint is None else of(model, data, parent, pin.LOCAL_WORLD_ALIGNED)
            yield from [own[3:]] * part.size

    def between(self, q_0: np.ndarray, q_1: np.ndarray, share: float) -> np.ndarray:
        """Return the configuration (nq) at a share, from 0 to 1, of the way from q_0 to q_1."""
        return self._inside.between(q_0, q_1, share)

    def base(self, samples: int = 50) -> int:
        """Return the number of identifiable combinations of the parameters."""
        return base_parameters(self, self.robot, samples=samples).size


class TrackerKinematics(LumpedKinematics):
    """The estimated kinematics of the task frame in the axes of a tracker, x = Theta phi(q).

    The parameters are the rows of Theta (m_p, 4 + 3 k), one after the other. The estimated Jacobian
    must have full rank; the rotation block needs not be orthogonal.

    H. Wang, *Adaptive control of robot manipulators with uncertain kinematics and dynamics*, IEEE
    Trans. Automatic Control 62 (2017) 948-954, for the law; the lumped parameters are those of
    uncalibrated visual servoing.
    """

    shapes = LumpedKinematics.shapes + ", H: size size, score: size, told: c c"

    def __init__(self, robot: Robot, unknown: str | Sequence[str | Translation] = ()) -> None:
        """Choose the unknown translations of a nominal robot, as ``unknown_translations``.

        Raises:
            ParameterError, RobotError: as ``unknown_translations``.
        """
        self._take(robot, unknown)
        task, k = self.task, self.nominal.size
        self._rows, self._turns = task.place, task.size > task.positions
        labels = task.labels[: self.positions]
        self.names = tuple(f"{row}({name})" for row in labels for name in self._columns)
        self.size = len(self.names)
        self._shape, self._eye = (self.positions, 4 + 3 * k), np.eye(self.positions)
        self._none = np.zeros(3 * k + 1)
        self.initial = self.parameters(Tracker(pin.SE3.Identity(), self.nominal))
        off = np.repeat([1.0, _OFF * robot.reach], [3, 3 * k + 1])
        wide = np.repeat([_TURNED, _TURNED * _WIDE * robot.reach, _FARTHEST], [3, 3 * k, 1])
        self.sizes = np.tile(off, self.positions)
        self._vague = np.diag(np.repeat([1.0, 1.0 / robot.reach**2, 0.0], [3, 3, k]))
        self.bounds = np.tile(wide, self.positions) * np.array([[-1.0], [1.0]])

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return TrackerKinematics, (self.robot, self.translations)

    def parameters(self, tracker: Tracker) -> np.ndarray:
        """Return the parameters (p) of a tracker and translations."""
        R, t = tracker.placement.rotation, tracker.placement.translation
        Theta = np.concatenate([R, *(a * R for a in tracker.a - self.nominal)], axis=1)
        home = t + Theta.dot(self._home)
        return np.concatenate([Theta, home[:, None]], axis=1)[self._rows].ravel()

    def tracker(self, a_k: np.ndarray) -> Tracker:
        """Return the tracker and the translations that an estimate a_k (p) is nearest to.

        It minimises the sum of squares |B_0 - R_c|^2 + sum_i |B_i - a_i R_c|^2 / reach^2 of the
        blocks B of Theta over rotations and translations by turns; each turn is linear or an
        orthogonal Procrustes problem (P. H. Schönemann, Psychometrika 31, 1966, 1-10). Of a task
        with two coordinates the third row is the cross product of theirs.
        """
        m, weight = self.positions, 1.0 / self.robot.reach**2
        Theta = a_k.reshape(self._shape)
        blocks = Theta[:, :-1].reshape(m, -1, 3).swapaxes(0, 1)
        first, others = blocks[0], blocks[1:]
        a = np.zeros(len(others))
        for _ in range(_ROUNDS):
            R = _orthonormal(first + weight * np.tensordot(a, others, 1))
            a = np.einsum("kij,ij->k", others, R) / m
        off = np.sqrt(weight) * np.abs(others - np.multiply.outer(a, R)).max(initial=0.0)
        misfit = max(float(np.abs(first - R).max()), float(off))
        home = np.concatenate([R, *(each * R for each in a)], axis=1).dot(self._home)
        t = np.zeros(3)
        t[self._rows] = Theta[:, -1] - home
        return Tracker(pin.SE3(self._completed(R), t), a + self.nominal, misfit)

    def slopes(self, tracker: Tracker) -> np.ndarray:
        """Return the derivatives (p, 6 + k) of the parameters of a tracker.

        With respect to small turns of the base about the axes of the tracker, its position, and the
        translations.
        """
        R, a = tracker.placement.rotation, tracker.a - self.nominal
        none = np.zeros((3, 3))
        turned = [pin.skew(axis) @ R for axis in np.eye(3)]
        blocks = [np.concatenate([dR, *(each * dR for each in a)], axis=1) for dR in turned]
        blocks += [np.tile(none, 1 + len(a))] * 3
        for i in range(len(a)):
            of = [R if i == j else none for j in range(len(a))]
            blocks.append(np.concatenate([none, *of], axis=1))
        found = []
        for i, block in enumerate(blocks):
            home = block.dot(self._home)
            if 3 <= i < 6:
                home[i - 3] = 1.0
            found.append(np.concatenate([block, home[:, None]], axis=1)[self._rows].ravel())
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
        k, tracker = len(self.nominal), start
        known = np.repeat([0.0, 1.0 / (_PRIOR * self.robot.reach) ** 2], [6, k])
        for _ in range(_ROUNDS):
            G, off = self.slopes(tracker), np.append(np.zeros(6), tracker.a - self.nominal)
            told = G.T @ H @ G + np.diag(known)
            slope = G.T @ (score - H @ self.parameters(tracker)) - known * off
            step = np.linalg.solve(told + self._vague, slope)
            R, t = tracker.placement.rotation, tracker.placement.translation
            placement = pin.SE3(pin.exp3(step[:3]) @ R, t + step[3:6])
            tracker = Tracker(placement, tracker.a + step[6:])
            if np.abs(step).max() < _CONVERGED:
                break
        return tracker, told

    def covariance(self, tracker: Tracker, told: np.ndarray) -> np.ndarray:
        """Return the covariance (p, p) of the parameters, of a tracker with (6 + k, 6 + k) told.

        What is not told is known to a radian and to the reach.
        """
        G = self.slopes(tracker)
        return np.asarray(G @ np.linalg.inv(told + self._vague) @ G.T)

    def information(self, tracker: Tracker, told: np.ndarray) -> np.ndarray:
        """Return what a tracker with the information (6 + k, 6 + k) says of the parameters (p, p).

        All but the position at home are known no better than to a hundredth of their sizes: so much
        an arm may differ from its description.
        """
        inexact = (_INEXACT * self.sizes.reshape(self._shape)) ** 2
        inexact[:, -1] = 0.0
        found = np.linalg.inv(self.covariance(tracker, told) + np.diag(inexact.ravel()))
        return np.asarray(0.5 * (found + found.T))

    def _completed(self, R: np.ndarray) -> np.ndarray:
        """Return the rotation (3, 3) with rows R (m_p, 3) of the task's coordinates."""
        if len(R) == 3:
            return R
        found = np.zeros((3, 3))
        found[self._rows] = R
        (row,) = set(range(3)) - set(np.arange(3)[self._rows].tolist())
        found[row] = np.cross(found[row - 2], found[row - 1])
        return found

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate at an estimate a_k (p), configuration q (nq) and velocity v (nv)."""
        self._look(q, v)
        self.a_k, self._Theta, inside = a_k, a_k.reshape(self._shape), self._inside
        self.J = self._mapped(self._Phi, inside.J[3:])
        self.Jdot_v = self._mapped(self._drift, inside.Jdot_v[3:])
        self.xd_hat = self._mapped(self._phid, inside.xd_hat[3:])
        self.Y_k = self._regressor(self._phid, inside.xd_hat[3:])
        self.p_hat, self.X_k = self._Theta.dot(self._phi), np.kron(self._eye, self._phi)
        self.last_joint = self.p_hat

    def _mapped(self, lumped: np.ndarray, turning: np.ndarray) -> np.ndarray:
        """Return Theta times a rate of phi (4 + 3 k, .), and R_c times an angular one (3, .)."""
        linear = self._Theta.dot(lumped)
        if not self._turns:
            return linear
        return np.concatenate([linear, self._Theta[:, :3].dot(turning)])

    def _regressor(self, lumped: np.ndarray, turning: np.ndarray) -> np.ndarray:
        """Return the matrix (m, p) that gives ``_mapped`` of vectors from the parameters."""
        linear = np.kron(self._eye, lumped)
        if not self._turns:
            return linear
        return np.concatenate([linear, np.kron(self._eye, np.append(turning, self._none))])

    @property
    def x_hat(self) -> np.ndarray:
        """The estimated positions (m) [m], or position and quaternion xyzw (7) of a pose."""
        return self._coordinates(self.p_hat, self._inside.x_hat)

    def _coordinates(self, p_hat: np.ndarray, inside: np.ndarray) -> np.ndarray:
        """Return the task coordinates at a position (m_p), and the pose (7) in the base's axes."""
        if not self._turns:
            return p_hat
        R = _orthonormal(self._Theta[:, :3]).dot(matrix(inside[3:]))
        return np.concatenate([p_hat, quaternion(R)])

    def at(self, q: np.ndarray, seen: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the estimated task coordinates at another q (nq), and X_k (m_p, p) there."""
        x, r = self._inside.at_unchecked(q)
        phi = self.lumped_unchecked(x[:3], r)
        return self._coordinates(self._Theta.dot(phi), x), np.kron(self._eye, phi)

    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return dJ/dt (m, nv) by the motion and by the rate a_k_rate (p) of the estimate."""
        Jd = self._inside.jacobian_rate_unchecked(self._none_moves)[3:]
        Theta_rate = a_k_rate.reshape(self._shape)
        by_estimate = Theta_rate.dot(self._Phi)
        if self._turns:
            turned = Theta_rate[:, :3].dot(self._inside.J[3:])
            by_estimate = np.concatenate([by_estimate, turned])
        return np.asarray(self._mapped(self._Phi_rate(), Jd) + by_estimate)

    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return Ybar_k (m, p) of Wang and Xie (27) at joint acceleration a (nv)."""
        inside = self._inside
        return self._regressor(
            self._Phi.dot(a) + self._drift, inside.J[3:].dot(a) + inside.Jdot_v[3:]
        )

    def initial_at(self, q: np.ndarray, x: np.ndarray | None) -> np.ndarray:
        """Return the estimate (p) to start from: as described, with the position measured.

        Args:
            q: (nq) measured.
            x: measured coordinates, or None.
        """
        found = self.initial.copy()
        if x is not None:
            self.update(self.initial, q, self._still)
            found.reshape(self._shape)[:, -1] += x[: self.positions] - self.p_hat
        return found

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of a robot with the same chain, as ``Robot.seen_from`` gives.

        None if no parameters give that robot's position, because other placements differ.
        """
        model, base = robot.model, self.robot.model.jointPlacements[1]
        a = PlacedTranslations(model, self.robot.frame_id, self.translations).read()
        a_k = self.parameters(Tracker(model.jointPlacements[1] * base.inverse(), a))
        q = pin.integrate(model, pin.neutral(model), np.linspace(0.3, 1.1, self.nv))
        self.update(a_k, q, self._still)
        place = robot.placement(q).translation[self._rows]
        return a_k if np.abs(self.p_hat - place).max() < 1e-9 else None

    def seen(self, a_k: np.ndarray) -> Robot:
        """Return the nominal robot with x in the axes in which an estimate a_k (p) has it."""
        placement = self.tracker(a_k).placement
        return self.robot.seen_from(placement.rotation, placement.translation)

    def write(self, model: pin.Model, a_k: np.ndarray) -> None:
        """Write the translations of an estimate a_k (p) [m] into a model of the chain."""
        self._inside.write(model, self.tracker(a_k).a)

    def read(self, model: pin.Model, a_k: np.ndarray) -> np.ndarray:
        """Return an estimate a_k (p) with the translations of a model of the chain [m]."""
        return self.parameters(self.tracker(a_k)._replace(a=self._inside.read(model, a_k)))


def _stacked(p: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return p (3) and the columns of r (3, k) as one (3 + 3 k)."""
    return np.concatenate([p[:3], r.T.ravel()])


def _orthonormal(B: np.ndarray) -> np.ndarray:
    """Return the nearest orthonormal rows to B (m, 3); of three rows a rotation."""
    U, _, V = np.linalg.svd(B, full_matrices=False)
    if len(B) == 3 and np.linalg.det(U @ V) < 0.0:
        U[:, -1] *= -1.0
    return np.asarray(U @ V)
