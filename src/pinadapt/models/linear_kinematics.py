"""Kinematics of the task frame, linear in small displacements of the placements of the chain.

A column is a displacement, a shift s and a turn w, of one placement: of a joint, of the base (the
placement of the first joint) or of the tool (that of the task frame). To first order it moves the
frame, at the position p, by s + w x (p - o), with o the origin of what is placed:

    x = phi_0(q) + sum_j (a_j - a_0j) phi_j(q),   phi_0 = p,   phi_j = s_j + w_j x (p - o_j),

everything in world axes, a_0 as described. For shifts that is exact, for turns the remainder is of
second order. Unknown translations, lengths, and the whole geometry are choices of columns. What a
sensor sees is an output map on top of them, with phi the phi_j one after the other and a one,

    y = N phi(q) / (D phi(q)),

row by row, where N and D are affine in the parameters. In world axes, D phi = 1 and the rows of N
are 1 and a_j - a_0j; trackers and cameras have other maps. The task velocity is xdot = Y_k(q, v)
a_k + y_k0(q, v): Wang and Xie (2009), equation (2), for any chain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy import empty

from .._checks import instance
from .._kernels import models as kernels
from ..description.chain import is_slide
from ..description.urdf_writer import axis_of
from ..exceptions import ParameterError, RobotError
from ..robot.robot import Robot
from ..tasks.frame import FrameTask, PositionTask, quaternion
from .basis import base_parameters
from .regressor import live_array
from .task_kinematics import TaskKinematics
from .translations import FIRST, TOOL, Translation, placement_of, unknown_translations

GEOMETRY = "geometry"
TURN, SHIFT = 0.02, 0.005  # [rad] and share of the reach: standard deviations of a description
_TOOL, _BASE = 10.0, 3.0  # times those, of the tool and of the base
_UNIT = 0.1  # of the reach: what the size of one stands for
_DEVIATIONS = 10.0  # standard deviations of a displacement: its bounds
_WIDE, _WIDE_BASE = 0.5, 10.0  # of the reach: bounds of a translation
_SHORTEST, _LONGEST = 0.2, 5.0  # of the nominal length
_SAMPLES = 60  # configurations at which two geometries are compared
_SAME = 1e-9  # [m] or [rad]


def axes_of(model: pin.Model, joint: int) -> tuple[np.ndarray, int]:
    """Return orthonormal directions (6, 6) of a joint's displacement, and which one is its own.

    They are the axes of the joint frame, shifts before turns, but for the own one; where the
    joint's axis is none of these, they are turned such that the last one is.
    """
    axis = axis_of(model, joint)
    k = int(np.argmax(np.abs(axis)))
    basis = np.eye(3)
    if abs(abs(axis[k]) - 1.0) > 1e-9:
        k, basis = 2, np.linalg.svd(axis[None, :])[2].T[:, [1, 2, 0]]
    basis[:, k] = axis
    return np.kron(np.eye(2), basis), k if is_slide(model.joints[joint]) else 3 + k


@dataclass(frozen=True, eq=False)
class Columns:
    """Unknown displacements of placements, the parameters of the kinematics.

    Attributes:
        names: one name a parameter (p).
        joints: (p) the joint whose placement each displaces; of the tool the number of the joints.
        motions: (6, p) shift and turn about the origin of what is placed, in the axes of the joint
            before it.
        initial: (p) the values as described.
        sizes: (p) how far each parameter may be off, relative to each other.
        bounds: (2, p) where the parameters stay by default.
    """

    names: tuple[str, ...]
    joints: np.ndarray
    motions: np.ndarray
    initial: np.ndarray
    sizes: np.ndarray
    bounds: np.ndarray


def columns_of_translations(robot: Robot, translations: Sequence[Translation]) -> Columns:
    """Return the columns of unknown translations, whose values are the translations themselves.

    By default a length lies between a fifth and five times the nominal one, other coordinates
    within half the reach, those of the base within ten times.

    Raises:
        ParameterError: offset and directions do not contain the nominal translation.
    """
    model, empty_part = robot.model, np.zeros(0)
    joints, initial, low, high = [empty_part], [empty_part], [empty_part], [empty_part]
    for part in translations:
        nominal = placement_of(model, robot.frame_id, part.joint).translation
        a = part.parameters(nominal)
        if np.abs(part.at(a) - nominal).max() > _SAME:
            raise ParameterError(
                "the directions and offsets do not contain the placements of the nominal robot.",
                where="unknown.translations",
                hint="Use an offset on the line or plane of the nominal translation.",
            )
        margin = (_WIDE_BASE if part.joint == FIRST else _WIDE) * robot.reach
        length = part.size == 1 and not part.offset.any() and a[0] > 0.0
        joints.append(np.full(part.size, part.joint or model.njoints))
        initial.append(a)
        low.append(_SHORTEST * a if length else a - margin)
        high.append(_LONGEST * a if length else a + margin)
    directions = [np.zeros((3, 0)), *(part.directions for part in translations)]
    shifts = np.concatenate(directions, axis=1)
    return Columns(
        tuple(label for part in translations for label in part.labels),
        np.concatenate(joints).astype(np.int64),
        np.concatenate([shifts, np.zeros_like(shifts)]),
        np.concatenate(initial),
        np.ones(shifts.shape[1]),
        np.array([np.concatenate(low), np.concatenate(high)]),
    )


def columns_of_geometry(robot: Robot) -> Columns:
    """Return the columns of every placement, with displacements as values.

    They are the shift of the tool (3), the displacements of the base (6) and of every other joint
    (4), in metres and radians: one along or about the axis of a joint is left out, as one of the
    next placement has the same effect.
    """
    model, reach = robot.model, robot.reach
    labels = np.array([f"{kind}_{axis}" for kind in ("shift", "turn") for axis in "xyz"])
    names, motions = list(unknown_translations(robot, [TOOL])[0].labels), [np.eye(6)[:, :3]]
    joints, sizes = [model.njoints] * 3, [np.full(3, _TOOL * SHIFT * reach)]
    tip = placement_of(model, robot.frame_id, None)
    motions[0] = np.kron(np.eye(2), tip.rotation) @ motions[0]
    for joint, name in enumerate(robot.joint_names, 1):
        axes, own = axes_of(model, joint)
        kept = (np.arange(6) % 3 != own % 3) | (joint == FIRST)
        names += [f"{name}.{label}" for label in labels[kept]]
        motions.append(np.kron(np.eye(2), model.jointPlacements[joint].rotation) @ axes[:, kept])
        joints += [joint] * int(kept.sum())
        size = np.repeat([SHIFT * reach, TURN], 3)[kept]
        sizes.append(size * (_BASE if joint == FIRST else 1.0))
    deviations = np.concatenate(sizes)
    return Columns(
        tuple(names),
        np.array(joints, dtype=np.int64),
        np.concatenate(motions, axis=1),
        np.zeros(len(names)),
        deviations / (_UNIT * reach),
        _DEVIATIONS * deviations * np.array([[-1.0], [1.0]]),
    )


class ColumnMotion:
    """What the columns of a chain move the frame by, with derivatives: see ``column_motion``.

    Attributes:
        home: (3 (1 + p)) values of phi from which it is counted, by default zeros.
        phi, phid: (3 (1 + p) + 1) phi_0, ..., phi_p of the last update, then a one; its rate.
        Phi, Phid: (3 (1 + p), n) dphi/dq without that last row, and its rate.
        axes, axis_rates: (6, n) of the joints, as motions at the world's origin; views.
    """

    def __init__(self, robot: Robot, columns: Columns) -> None:
        """Use a nominal robot and its columns."""
        self._model, self._frame = robot.model.copy(), robot.frame_id
        self._data = data = self._model.createData()
        n, parts = self._model.nv, 1 + len(columns.names)
        lever = placement_of(self._model, self._frame, None).translation
        origins = [place.translation for place in [*self._model.jointPlacements[1:]]]
        of = np.array([*origins, lever])[columns.joints - 1]
        at_parent = columns.motions.copy()
        at_parent[:3] += np.cross(of, columns.motions[3:].T).T
        self.axes, self.axis_rates = data.J.reshape(6, n), data.dJ.reshape(6, n)
        joints = *_live_placements(data), self.axes, self.axis_rates
        self.home = np.zeros(3 * parts)
        self._given = *joints, lever, columns.joints - 1, at_parent, self.home
        self.phi, self.phid = np.ones(3 * parts + 1), np.zeros(3 * parts + 1)
        self.Phi, self.Phid = empty((2, 3 * parts, n))
        matrices = (each.reshape(parts, 3, n) for each in (self.Phi, self.Phid))
        self._filled = self.phi[:-1], self.phid[:-1], *matrices, empty((4, 3))

    def update(self, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate at a configuration q (nq) and velocity v (nv)."""
        pin.computeJointJacobiansTimeVariation(self._model, self._data, q, v)
        kernels.column_motion(*self._given, v, *self._filled)

    def rotation(self) -> np.ndarray:
        """Return the rotation (3, 3) of the frame."""
        return pin.updateFramePlacement(self._model, self._data, self._frame).rotation


class LinearKinematics(TaskKinematics):
    """The estimated coordinates y = N phi(q) / (D phi(q)) of the task frame.

    J = (N - y_hat D) Phi / z_hat is the exact Jacobian of the estimated coordinates, where dphi/dt
    = Phi v and z_hat = D phi; ``Y_k`` is for y_hat and z_hat as they are. The rotation rows of a
    pose are R_c times the angular velocity in the axes of the base, with R_c the first three
    columns of N.
    """

    task: FrameTask

    def _take(self, robot: Robot, columns: Columns) -> None:
        """Take a nominal robot with the task of its frame, and its columns."""
        self.robot, self.frame, self.joint_names = robot.undrawn(), robot.frame, robot.joint_names
        self.nq, self.nv = int(robot.model.nq), int(robot.model.nv)
        self.task, self.columns = robot.frame_task, columns
        self.positions, self._turns = self.task.positions, self.task.size > self.task.positions
        self.motion, self.past = ColumnMotion(robot, columns), ColumnMotion(robot, columns)
        self.still = np.zeros(self.nv)

    def _map(self, N_0: np.ndarray, entries: np.ndarray, depths: np.ndarray) -> None:
        """Take a map N, D (m_p, 4 + 3 k) whose entries are parameters, beside constants.

        Args:
            N_0: (m_p, 4 + 3 k) constants of N; those of D are (0, ..., 0, 1).
            entries: (., 3) parameter, row and column of each entry of N that a parameter adds to.
            depths: (., 3) the same of D; none where D phi = 1.
        """
        self._entries, self._depths, self._map_of = entries, depths, (N_0, entries, depths)
        self._N, self._D, G = np.empty((3, *N_0.shape))
        self._G, self._z, self._Jdot = G, empty(self.positions), empty((self.positions, self.nv))
        self._known = self.motion.phi, self.motion.phid, self.motion.Phi, self.motion.Phid
        self._kept = self._N, self._D, self._G, self._z, self._Jdot

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate at an estimate a_k (p), configuration q (nq) and velocity v (nv)."""
        motion, m = self.motion, self.positions
        if a_k.shape != (self.size,):
            raise ParameterError(f"expected {self.size} numbers, got {a_k.shape}.", where="a_k")
        motion.update(q, v)
        J, p_hat, xd, Jdot_v = empty((m, self.nv)), empty(m), empty(m), empty(m)
        kernels.output_map(a_k, *self._map_of, *self._known, v, *self._kept, p_hat, J, xd, Jdot_v)
        X_k = self._regressor(motion.phi, p_hat, self._z)
        Y_k = self._regressor(motion.phid, p_hat, self._z)
        if self._turns:
            R, axes, rates = self._N[:, :3], motion.axes[3:], motion.axis_rates[3:]
            J = np.concatenate([J, R @ axes])
            xd = np.concatenate([xd, R @ axes.dot(v)])
            Jdot_v = np.concatenate([Jdot_v, R @ rates.dot(v)])
            Y_k = np.concatenate([Y_k, self._turning(axes.dot(v))])
        self.a_k, self._v, self.p_hat, self.X_k, self.Y_k = a_k, v, p_hat, X_k, Y_k
        self.J, self.xd_hat, self.Jdot_v = J, xd, Jdot_v

    def _regressor(self, phi: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return the matrix (m_p, p) of (dN phi - y dD phi) / z for changes of the parameters."""
        X = empty((self.positions, self.size))
        kernels.map_regressor(self._entries, self._depths, phi, y, z, X)
        return X

    def _matrix(self, places: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the matrix (m_p, 4 + 3 k) with parameters a (p) at their places alone."""
        found = np.zeros(self._N.shape)
        found[places[:, 1], places[:, 2]] = a[places[:, 0]]
        return found

    def _turning(self, angular: np.ndarray) -> np.ndarray:
        """Return the matrix (3, p) that gives dR_c times a vector (3) from changes of a_k."""
        phi = np.zeros(self.motion.phi.size)
        phi[:3] = angular
        return self._regressor(phi, np.zeros(3), np.ones(3))

    @property
    def y_k0(self) -> np.ndarray:
        """The known part (m) of the velocity, J v = Y_k a_k + y_k0 [m/s, rad/s]."""
        return self.xd_hat - self.Y_k.dot(self.a_k)

    @property
    def x_hat(self) -> np.ndarray:
        """The estimated positions (m) [m], or position and quaternion xyzw (7) of a pose."""
        return self._coordinates(self.p_hat, self.motion)

    def _coordinates(self, p_hat: np.ndarray, motion: ColumnMotion) -> np.ndarray:
        """Return the task coordinates at estimated positions (m_p) and a motion of the arm."""
        if not self._turns:
            return p_hat
        return np.concatenate([p_hat, quaternion(self._axes() @ motion.rotation())])

    def _axes(self) -> np.ndarray:
        """Return R_c (3, 3), a rotation."""
        return np.eye(3)

    def explaining(self, x: np.ndarray) -> np.ndarray:
        """Return X (m_p, p) with p_hat - x = X da_k, exactly, for measured coordinates x."""
        return self._regressor(self.motion.phi, x, self._z)

    def at(self, q: np.ndarray, seen: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the estimated task coordinates at another q (nq), and X_k (m_p, p) there.

        The estimate is that of the last update. The attributes do not change.
        """
        self.past.update(q, self.still)
        phi = self.past.phi
        z = np.maximum(self._D.dot(phi), kernels.LEAST_DEPTH)
        y = self._N.dot(phi) / z
        X = self._regressor(phi, y if seen is None else seen, z)
        return self._coordinates(y, self.past), X

    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return dJ/dt (m, nv) by the motion and by the rate a_k_rate (p) of the estimate.

        Without the second part (17) of Wang and Xie does not hold.
        """
        motion, found = self.motion, self._Jdot.copy()
        kernels.add_map_rates(a_k_rate, self._entries, motion.Phi, self._z, found)
        if len(self._depths):
            D_rate = self._matrix(self._depths, a_k_rate)
            yd = self.xd_hat[: self.positions] + self.X_k.dot(a_k_rate)
            zd = self._D.dot(motion.phid) + D_rate.dot(motion.phi)
            less = yd[:, None] * self._D + self.p_hat[:, None] * D_rate + zd[:, None] * self._G
            found -= (less[:, :-1] / self._z[:, None]).dot(motion.Phi)
        if not self._turns:
            return found
        R_rate = self._matrix(self._entries, a_k_rate)[:, :3]
        turned = R_rate @ motion.axes[3:] + self._N[:, :3] @ motion.axis_rates[3:]
        return np.concatenate([found, turned])

    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return Ybar_k (m, p) of Wang and Xie (27), xddot = Ybar_k(q, v, a) a_k + known part."""
        motion, phidd = self.motion, np.zeros(self.motion.phi.size)
        kernels.add_products(motion.Phi, a, motion.Phid, self._v, phidd)
        found = self._regressor(phidd, self.p_hat, self._z)
        if len(self._depths):  # what the rate of y adds
            yd = 2.0 * self.xd_hat
            found += self._regressor(motion.phid, yd, self._z)
            found -= self._regressor(motion.phid, 0.0 * yd, self._z)
        if not self._turns:
            return found
        turning = motion.axes[3:].dot(a) + motion.axis_rates[3:].dot(self._v)
        return np.concatenate([found, self._turning(turning)])

    def base(self, samples: int = 50) -> int:
        """Return the number of identifiable combinations of the parameters: the rank of Y_p."""
        return base_parameters(self, self.robot, samples=samples).size

    def displace(self, model: pin.Model, off: np.ndarray) -> None:
        """Write the described placements, displaced by off (p), into a model of the chain."""
        columns = self.columns
        for joint in set(columns.joints.tolist()):
            own, nominal = columns.joints == joint, self._place(self.robot.model, joint)
            moved, place = columns.motions[:, own] @ off[own], self._place(model, joint)
            place.translation = nominal.translation + moved[:3]
            place.rotation = pin.exp3(moved[3:]) @ nominal.rotation

    def displacement(self, model: pin.Model) -> np.ndarray:
        """Return how far (p) the placements of a model of the chain are along the columns."""
        columns, found = self.columns, empty(len(self.columns.names))
        for joint in set(columns.joints.tolist()):
            own, place = columns.joints == joint, self._place(model, joint)
            nominal = self._place(self.robot.model, joint)
            turn = pin.log3(place.rotation @ nominal.rotation.T)
            moved = np.concatenate([place.translation - nominal.translation, turn])
            found[own] = columns.motions[:, own].T @ moved
        return found

    def _place(self, model: pin.Model, joint: int) -> pin.SE3:
        """Return a placement of a model as a view: of a joint, or of the tool after the last."""
        return placement_of(model, self.robot.frame_id, None if joint == model.njoints else joint)


class FrameKinematics(LinearKinematics):
    """The estimated kinematics of the task frame in world axes, with columns as parameters.

    For a pose the rotation rows of Y_k are zero, as orientation does not depend on translations.
    """

    def __init__(self, robot: Robot, unknown: str | Sequence[str | Translation] = ()) -> None:
        """Choose the unknown translations of a nominal robot, as ``unknown_translations``.

        ``unknown="geometry"`` chooses every placement, as ``columns_of_geometry``.

        Raises:
            ParameterError, RobotError: as ``unknown_translations``, or the geometry with a task
                that is not one of positions alone.
        """
        task = instance(robot, Robot, "robot", RobotError).frame_task
        self._whole = isinstance(unknown, str) and unknown == GEOMETRY
        if self._whole and not isinstance(task, PositionTask):
            raise ParameterError(
                f"the geometry is learned from positions only, and the task is '{task.name}'.",
                where="unknown.geometry",
                hint='Take a task of the position, such as "xyz", or `pinadapt calibrate` before.',
            )
        self.translations = unknown_translations(robot, [TOOL] if self._whole else unknown)
        columns = (
            columns_of_geometry(robot)
            if self._whole
            else columns_of_translations(robot, self.translations)
        )
        self._take(robot, columns)
        self.names, self.size = columns.names, len(columns.names)
        self.initial, self.sizes, self.bounds = columns.initial, columns.sizes, columns.bounds
        N_0, entries = np.zeros((self.positions, self.motion.phi.size)), []
        for i, row in enumerate(range(3)[task.place]):
            N_0[i, row], N_0[i, 3 + row : -1 : 3] = 1.0, -self.initial
            entries += [(j, i, 3 * (1 + j) + row) for j in range(self.size)]
        self._map(N_0, places_of(entries), places_of([]))
        self.update(self.initial, robot.q0, self.still)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return FrameKinematics, (self.robot, GEOMETRY if self._whole else self.translations)

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each parameter (p)."""
        return tuple("rad" if turn.any() else "m" for turn in self.columns.motions[3:].T)

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of a robot with the same chain.

        None if no parameters give that robot's coordinates, because other placements differ.
        """
        rng, start = np.random.default_rng(0), self.displacement(robot.model)
        rows, off = [], []
        for _ in range(_SAMPLES):
            q = pin.integrate(self.robot.model, self.robot.q0, rng.uniform(-2.0, 2.0, self.nv))
            self.update(self.initial + start, q, self.still)
            rows.append(np.zeros(self.Y_k.shape))
            rows[-1][: self.positions] = self.X_k * self.sizes
            off.append(self.task.error(robot.position(q), self.x_hat))
        W, y = np.concatenate(rows), np.concatenate(off)
        if np.abs(y).max() < _SAME:
            return self.initial + start
        found = np.linalg.lstsq(W, y, rcond=1e-10)[0]
        if np.abs(y - W @ found).max() > _SAME:
            return None
        return self.initial + start + found * self.sizes

    def write(self, model: pin.Model, a_k: np.ndarray) -> None:
        """Write the placements of an estimate a_k (p) into a model of the chain."""
        self.displace(model, a_k - self.initial)

    def read(self, model: pin.Model, a_k: np.ndarray) -> np.ndarray:
        """Return the parameters (p) of a model of the chain."""
        return self.initial + self.displacement(model)


def places_of(entries: Sequence[tuple[int, int, int]]) -> np.ndarray:
    """Return entries of a map (., 3): parameter, row and column of each."""
    return np.array(entries, dtype=np.int64).reshape(-1, 3)


def _live_placements(data: pin.Data) -> tuple[np.ndarray, np.ndarray]:
    """Return the rotations (N, 3, 3) and origins (N, 3) of all joints as views."""
    rotations = live_array([placement.rotation for placement in data.oMi])
    return rotations, live_array([placement.translation for placement in data.oMi])
