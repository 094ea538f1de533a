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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy import empty

from .._checks import ROUNDING
from .._kernels import models as kernels
from ..description.chain import axis_of, is_slide
from ..exceptions import ParameterError
from ..robot.robot import Robot
from ..tasks.frame import FrameTask, PositionTask, quaternion
from .regressor import SAMPLES, live_array, random_states
from .task_kinematics import TaskKinematics
from .translations import (
    FIRST,
    TOOL,
    Translation,
    Words,
    placed_values,
    placement_of,
    unknown_translations,
)

GEOMETRY = "geometry"
TURN, SHIFT = 0.02, 0.005  # [rad] and share of the reach: standard deviations of a description
_TOOL, _BASE = 10.0, 3.0  # times those, of the tool and of the base
OFF = 0.1  # of the reach: how far off what has the size of one may be
BOUND = 10.0  # bounds: of the sizes of displacements and of cameras, of the reach for the base, and
# of a nominal length, whose shortest is the inverse
_WIDE = 0.5  # of the reach: bounds of a translation, but of the base


def axes_of(model: pin.Model, joint: int) -> tuple[np.ndarray, int]:
    """Return orthonormal directions (6, 6) of a joint's displacement, and which one is its own.

    Three translations and three rotations along the axes of the joint frame. A frame whose axes
    do not contain the joint's axis is turned so that its z axis is that of the joint.
    """
    axis = axis_of(model, joint)
    k = int(np.argmax(np.abs(axis)))
    basis = np.eye(3)
    if abs(abs(axis[k]) - 1.0) > 1e-9:
        k = 2
        basis = np.linalg.svd(axis[None, :])[2].T[:, [1, 2, 0]]
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

    By default a length lies between a tenth and ten times the nominal one, other coordinates
    within half the reach, those of the base within ten times.
    """
    sizes = [part.size for part in translations]
    joints = [part.joint or robot.model.njoints for part in translations]
    margins = [BOUND if part.joint == FIRST else _WIDE for part in translations]
    initial = np.concatenate(
        [np.zeros(0), *placed_values(robot.model, robot.frame_id, translations)]
    )
    shifts = np.concatenate([np.zeros((3, 0)), *(part.directions for part in translations)], axis=1)
    return Columns(
        tuple(label for part in translations for label in part.labels),
        np.repeat(joints, sizes).astype(np.int64),
        np.concatenate([shifts, np.zeros(shifts.shape)]),
        initial,
        np.ones(initial.size),
        np.where(
            np.repeat(np.equal(sizes, 1), sizes),
            np.outer([1.0 / BOUND, BOUND], initial),
            initial + np.outer([-robot.reach, robot.reach], np.repeat(margins, sizes)),
        ),
    )


def columns_of_geometry(robot: Robot) -> Columns:
    """Return the columns of every placement, with displacements as values.

    They are the shift of the tool (3), the displacements of the base (6) and of every other joint
    (4), in metres and radians: one along or about the axis of a joint is left out, as one of the
    next placement has the same effect.
    """
    model = robot.model
    labels = np.array([f"{kind}_{axis}" for kind in ("shift", "turn") for axis in "xyz"])
    off = np.repeat([SHIFT * robot.reach, TURN], 3)
    tip = placement_of(model, robot.frame_id, None).rotation
    motions = np.concatenate([tip, np.zeros((3, 3))])
    parts = [(unknown_translations(robot, [TOOL])[0].labels, motions, _TOOL * off[:3])]
    for joint, name in enumerate(robot.joint_names, 1):
        axes, own = axes_of(model, joint)
        kept = (np.arange(6) % 3 != own % 3) | (joint == FIRST)
        motions = np.kron(np.eye(2), model.jointPlacements[joint].rotation) @ axes[:, kept]
        size = off[kept] * (_BASE if joint == FIRST else 1.0)
        parts.append((tuple(f"{name}.{label}" for label in labels[kept]), motions, size))
    names, moves, sizes = zip(*parts, strict=True)
    deviations = np.concatenate(sizes)
    return Columns(
        sum(names, ()),
        np.repeat([model.njoints, *range(1, model.njoints)], list(map(len, names))),
        np.concatenate(moves, axis=1),
        np.zeros(deviations.size),
        deviations / (OFF * robot.reach),
        BOUND * deviations * np.array([[-1.0], [1.0]]),
    )


class _ObservedChain:
    """A chain whose frame a sensor observes, with what the kernel ``observed_motion`` fills.

    Attributes:
        columns: (9, 1 + p) for the kernel; the last three rows are the phi at home.
        motion: (2, k, n + 1) dphi/dq and phi, and their rates.
        maps: (2, rows, k) N and D.
        G, z: (rows, k) (N - y D) / z but for the column of the one, which is z (rows).
        Jdot: (rows, n) dJ/dt at a constant estimate.
    """

    def __init__(
        self, robot: Robot, columns: Columns, constants: np.ndarray, entries: np.ndarray
    ) -> None:
        """Use a nominal robot, its columns, and a map as the kernel takes it."""
        self._model = robot.model.copy()
        self._frame = robot.frame_id
        self._data = data = self._model.createData()
        places = [*self._model.jointPlacements[1:], placement_of(self._model, self._frame, None)]
        origins = np.array([place.translation for place in places])
        moves = columns.motions.copy()
        moves[:3] += np.cross(origins[columns.joints - 1], moves[3:].T).T
        self.columns = np.zeros((9, 1 + len(columns.names)))
        self.columns[:3, 0], self.columns[:6, 1:] = origins[-1], moves
        n, (_, rows, width) = self._model.nv, constants.shape
        carrier = self._model.frames[self._frame].parentJoint
        parents = np.append(self._model.parents, carrier)  # of the tool, which counts as a joint
        self._axes = data.J.reshape(6, n), data.dJ.reshape(6, n)
        self._others = np.setdiff1d(np.arange(n), np.array(self._model.supports[carrier]) - 1)
        self._of_chain = (
            live_array([placement.rotation for placement in data.oMi]),
            live_array([placement.translation for placement in data.oMi]),
            *self._axes,
            np.append(carrier, parents[columns.joints]).astype(np.int64),
            self.columns,
        )
        self._of_sensor = constants, entries, empty((4, 3))
        self.motion = np.zeros((2, width, n + 1))
        self.maps = constants.copy()
        self.G, self.Jdot, one = empty((rows, width)), empty((rows, n)), 3 * self.columns.shape[1]
        self.motion[0, one, n], self.z = 1.0, self.G[:, one]
        self._filled = self.motion, self.maps, self.G, self.Jdot

    def update(self, a: np.ndarray, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return y, J, the rate of y, dJ/dt v, X and Y of ``observed_motion`` as new arrays."""
        pin.computeJointJacobiansTimeVariation(self._model, self._data, q, v)
        if self._others.size:  # the axes of other branches count as zero
            for axes in self._axes:
                axes[:, self._others] = 0.0
        rows, p = len(self.G), a.size
        found = empty(rows), empty(self.Jdot.shape), empty(rows), empty(rows)
        X, Y = empty((rows, p)), empty((rows, p))
        kernels.observed_motion(
            *self._of_chain, v, a, *self._of_sensor, *self._filled, *found, X, Y
        )
        return *found, X, Y

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

    def _observe(self, columns: Columns, constants: np.ndarray, places: np.ndarray) -> None:
        """Take the columns, and a map whose entries are parameters, beside constants.

        Args:
            columns: of the nominal robot.
            constants: (2, m_p, 4 + 3 k) of N and D.
            places: (2, m_p, 4 + 3 k) the parameter that each entry has in addition; -1: none.
        """
        _, m, width = constants.shape
        self.columns = columns
        self._of_pose = self.task.size > m
        if self._of_pose:  # the rotation in N once more, for the angular velocity
            wider = (0, 0), (0, m), (0, 3)
            constants, places = np.pad(constants, wider), np.pad(places + 1, wider) - 1
            constants[0, m:, width:], constants[1, m:, width - 1] = constants[0, :m, :3], 1.0
            places[0, m:, width:] = places[0, :m, :3]
        at = np.nonzero(places >= 0)
        self._entries = np.column_stack([places[at], *at])
        self._now, self._past = (
            _ObservedChain(self.robot, self.columns, constants, self._entries) for _ in range(2)
        )

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate at an estimate a_k (p), configuration q (nq) and velocity v (nv)."""
        if a_k.size != self.size:
            raise ParameterError(f"expected {self.size} numbers, got {a_k.size}.", where="a_k")
        y, self.J, self.xd_hat, self.Jdot_v, X, self.Y_k = self._now.update(a_k, q, v)
        self.a_k, self._v, self._y = a_k, v, y
        self.p_hat, self.X_k = (y[:3], X[:3]) if self._of_pose else (y, X)

    def _regressor(self, phi: np.ndarray, y: np.ndarray, chain: _ObservedChain) -> np.ndarray:
        """Return (dN phi - y dD phi) / z (rows, p) by the parameters, z that of the chain."""
        j, of, i, c = self._entries.T
        X = np.zeros((len(chain.G), self.size))
        X[i, j] = np.where(of == 0, 1.0, -y[i]) * phi[c] / chain.z[i]
        return X

    @property
    def y_k0(self) -> np.ndarray:
        """The known part (m) of the velocity, J v = Y_k a_k + y_k0 [m/s, rad/s]."""
        return self.xd_hat - self.Y_k.dot(self.a_k)

    @property
    def x_hat(self) -> np.ndarray:
        """The estimated positions (m) [m], or position and quaternion xyzw (7) of a pose."""
        return self._coordinates(self.p_hat, self._now)

    def _coordinates(self, p_hat: np.ndarray, chain: _ObservedChain) -> np.ndarray:
        """Return the task coordinates at estimated positions (m_p)."""
        if not self._of_pose:
            return p_hat
        return np.concatenate([p_hat, quaternion(self._axes() @ chain.rotation())])

    def _axes(self) -> np.ndarray:
        """Return R_c (3, 3), a rotation."""
        return np.eye(3)

    def explaining(self, x: np.ndarray) -> np.ndarray:
        """Return X (m_p, p) with p_hat - x = X da_k, exactly, for measured coordinates x."""
        if self.affine:
            return self.X_k
        return self._regressor(self._now.motion[0, :, -1], x, self._now)

    def at(self, q: np.ndarray, seen: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the estimated task coordinates at another q (nq), and X_k (m_p, p) there.

        The estimate is that of the last update. The attributes do not change.
        """
        y, _, _, _, X, _ = self._past.update(self.a_k, q, self._still)
        if not self.affine and seen is not None:
            X = self._regressor(self._past.motion[0, :, -1], seen, self._past)
        m = self.positions
        return self._coordinates(y[:m], self._past), X[:m]

    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return dJ/dt (m, nv) by the motion and by the rate a_k_rate (p) of the estimate.

        Without the second part (17) of Wang and Xie does not hold.
        """
        chain = self._now
        found = self._now.Jdot.copy()
        kernels.add_map_rates(
            a_k_rate, self._entries, chain.motion, chain.maps, chain.G, chain.z,
            self._y, self.xd_hat, found,
        )  # fmt: skip
        return found

    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return Ybar_k (m, p) of Wang and Xie (27), xddot = Ybar_k(q, v, a) a_k + known part.

        No law for pictures, whose acceleration is not affine in a_k, asks for it.
        """
        Phi, Phid = self._now.motion[:, :, :-1]
        return self._regressor(Phi.dot(a) + Phid.dot(self._v), self._y, self._now)

    def _described(self, robot: Robot) -> np.ndarray:
        """Return the parameters (p) of a robot, exact where other placements are the same."""
        return self.read(robot.model, self.initial)

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of a robot with the same chain.

        None if no parameters give that robot's coordinates, because other placements differ. A
        constant rotation between the frame and the marker that a tracker sees has no effect.
        """
        m = self.positions
        found = self._described(robot)
        rows, off = [], []
        for q, _, _ in random_states(self.robot.model, SAMPLES):
            self.update(found, q, self._still)
            x = robot.position(q)
            rows.append(self.explaining(x)[:m] * self.sizes)
            off.append(self.task.error(x, self.x_hat))
        W, left = np.concatenate(rows), np.array(off)
        if not self.calibrated:
            left = left[:, :m]
        if np.abs(left).max() >= ROUNDING:
            step = np.linalg.lstsq(W, left[:, :m].ravel(), rcond=1e-10)[0]
            left[:, :m] -= (W @ step).reshape(-1, m)
            found = found + step * self.sizes
        return found if np.abs(left).max() < ROUNDING else None

    def displace(self, model: pin.Model, off: np.ndarray) -> None:
        """Write the described placements, displaced by off (p), into a model of the chain."""
        for own, nominal, place in self._placements(model):
            moved = self.columns.motions[:, own] @ off[own]
            place.translation = nominal.translation + moved[:3]
            place.rotation = pin.exp3(moved[3:]) @ nominal.rotation

    def displacement(self, model: pin.Model) -> np.ndarray:
        """Return how far (p) the placements of a model of the chain are along the columns."""
        found = empty(len(self.columns.names))
        for own, nominal, place in self._placements(model):
            turn = pin.log3(place.rotation @ nominal.rotation.T)
            moved = np.concatenate([place.translation - nominal.translation, turn])
            found[own] = self.columns.motions[:, own].T @ moved
        return found

    def _placements(self, model: pin.Model) -> Iterator[tuple[np.ndarray, pin.SE3, pin.SE3]]:
        """Yield the columns (p) of each placement, the described one, and that of a model."""
        for joint in np.unique(self.columns.joints).tolist():
            at = self.robot.frame_id, None if joint == model.njoints else joint
            nominal = placement_of(self.robot.model, *at)
            yield self.columns.joints == joint, nominal, placement_of(model, *at)


class FrameKinematics(LinearKinematics):
    """The estimated kinematics of the task frame in world axes, with columns as parameters.

    For a pose the rotation rows of Y_k are zero, as orientation does not depend on translations.
    """

    def __init__(self, robot: Robot, unknown: Words = ()) -> None:
        """Choose the unknown translations of a nominal robot, as ``unknown_translations``.

        ``unknown="geometry"`` chooses every placement, as ``columns_of_geometry``.

        Raises:
            ParameterError, RobotError: as ``unknown_translations``, or the geometry with a task
                that is not one of positions alone.
        """
        task = robot.frame_task
        whole = isinstance(unknown, str) and unknown == GEOMETRY
        if whole and not isinstance(task, PositionTask):
            raise ParameterError(
                f"the geometry is learned from positions only, and the task is '{task.name}'.",
                where="unknown.geometry",
                hint='Take a task of the position, such as "xyz", or `pinadapt calibrate` before.',
            )
        self.translations = unknown_translations(robot, [TOOL] if whole else unknown)
        columns = (
            columns_of_geometry(robot)
            if whole
            else columns_of_translations(robot, self.translations)
        )
        self._take(robot, task, unknown)
        self.names = columns.names
        self.size = len(columns.names)
        self.initial, self.sizes, self.bounds = columns.initial, columns.sizes, columns.bounds
        constants = np.zeros((2, self.positions, 4 + 3 * self.size))
        constants[1, :, -1], places = 1.0, np.full(constants.shape, -1)
        for i, row in enumerate(range(3)[task.place]):
            own = slice(3 + row, -1, 3)
            constants[0, i, row], constants[0, i, own] = 1.0, -self.initial
            places[0, i, own] = np.arange(self.size)
        self._observe(columns, constants, places)
        self.update(self.initial, robot.q0, self._still)

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each parameter (p)."""
        return tuple("rad" if turn.any() else "m" for turn in self.columns.motions[3:].T)

    def write(self, model: pin.Model, a_k: np.ndarray) -> None:
        """Write the placements of an estimate a_k (p) into a model of the chain."""
        self.displace(model, a_k - self.initial)

    def read(self, model: pin.Model, a_k: np.ndarray) -> np.ndarray:
        """Return the parameters (p) of a model of the chain."""
        return self.initial + self.displacement(model)
