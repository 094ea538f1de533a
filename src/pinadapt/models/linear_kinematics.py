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

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy import empty

from .._checks import ROUNDING
from .._kernels import models as kernels
from ..description.chain import axis_of, is_slide
from ..exceptions import ParameterError
from ..robot.robot import Robot
from ..tasks.frame import FrameTask, PositionTask, quaternion
from .regressor import SAMPLES, live_array, moves, random_states, wrong_sizes
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
DISPLACEMENTS = tuple(f"{kind}_{axis}" for kind in ("shift", "turn") for axis in "xyz")
# [rad] and share of the reach: standard deviations of a description; half, twice: calibrated errors
# the same to 3 %, those of a geometry learned in motion 13 to 21 % larger
TURN, SHIFT = 0.02, 0.005
# times those, of the tool and of the base; half, twice: 0.6 and 5 times that error with the second
_TOOL, _BASE = 10.0, 3.0
# of the reach: how far off what has the size of one may be; half: largest error in pictures of a
# UR5 2.3 times as large, twice: 0.9 to 1.2 times
OFF = 0.1
# half, twice of these bounds: the same runs
BOUND = 10.0  # bounds: of the sizes of displacements and of cameras, of the reach for the base, and
# of a nominal length, whose shortest is the inverse
_WIDE = 0.5  # of the reach: bounds of a translation, but of the base; half, twice: the same runs


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


class Columns(NamedTuple):
    """Unknown displacements of placements, the parameters of the kinematics.

    Attributes:
        names: one name a parameter (p).
        joints: (p) the joint whose placement each displaces; of the tool of frame k the number of
            the joints plus k.
        motions: (6, p) shift and turn about the origin of what is placed, in the axes of the joint
            before it.
        initial: (p) the values as described.
        sizes: (p) how far each parameter may be off, relative to each other.
        bounds: (2, p) where the parameters stay by default.
    """

    names: tuple[str, ...] = ()
    joints: np.ndarray = np.zeros(0, dtype=np.int64)
    motions: np.ndarray = np.zeros((6, 0))
    initial: np.ndarray = np.zeros(0)
    sizes: np.ndarray = np.zeros(0)
    bounds: np.ndarray = np.zeros((2, 0))


def stacked(parts: Iterable[Columns]) -> Columns:
    """Return the columns of some placements, one placement after the other."""
    names, *arrays = zip(Columns(), *parts, strict=True)
    return Columns(sum(names, ()), *(np.concatenate(each, axis=-1) for each in arrays))


def translated(robot: Robot, translations: Sequence[Translation]) -> Iterator[Columns]:
    """Yield the columns of unknown translations, whose values are the translations themselves.

    By default a length lies between a tenth and ten times the nominal one, other coordinates
    within half the reach, those of the base within ten times. Each of several frames has a tool.
    """
    for k, frame in enumerate(robot.frames):
        own = robot.of_frame(frame)
        prefix = f"{frame}." if robot.task.frames else ""
        values = placed_values(own.model, own.frame_id, translations)
        for part, value in zip(translations, values, strict=True):
            names = tuple(prefix + label for label in part.labels)
            motions = np.concatenate([part.directions, np.zeros((3, part.size))])
            wide = own.reach * (BOUND if part.joint == FIRST else _WIDE)
            bounds = np.array([value - wide, value + wide])
            if part.size == 1:
                bounds = np.array([value / BOUND, value * BOUND])
            joints = np.full(part.size, part.joint or own.model.njoints + k)
            yield Columns(names, joints, motions, value, np.ones(part.size), bounds)


def columns_of_geometry(robot: Robot) -> Columns:
    """Return the columns of every placement, with displacements as values.

    They are the shift of the tool (3), the displacements of the base (6) and of every other joint
    (4), in metres and radians: one along or about the axis of a joint is left out, as one of the
    next placement has the same effect.
    """
    model = robot.model
    labels = np.array(DISPLACEMENTS)
    off = np.repeat([SHIFT * robot.reach, TURN], 3)

    (tool,) = unknown_translations(robot, TOOL)
    tip = placement_of(model, robot.frame_id, None)
    parts = [(tool.labels, model.njoints, tip, np.eye(6)[:, :3], _TOOL * off[:3])]
    for joint, name in enumerate(robot.joint_names, 1):
        axes, own = axes_of(model, joint)
        kept = (np.arange(6) % 3 != own % 3) | (joint == FIRST)
        names = tuple(f"{name}.{label}" for label in labels[kept])
        size = off[kept] * (_BASE if joint == FIRST else 1.0)
        parts.append((names, joint, model.jointPlacements[joint], axes[:, kept], size))
    return stacked(
        Columns(
            names,
            np.full(size.size, joint),
            np.kron(np.eye(2), place.rotation) @ axes,
            np.zeros(size.size),
            size / (OFF * robot.reach),
            np.array([-BOUND * size, BOUND * size]),
        )
        for names, joint, place, axes, size in parts
    )


class _ObservedChain:
    """A chain whose frames a sensor observes, with what the kernel ``observed_motion`` fills.

    Attributes:
        frames: their f indices in the model.
        columns: (9, f + p) for the kernel; the last three rows are the phi at home.
        motion: (2, k, n + 1) dphi/dq and phi, and their rates.
        maps: (2, rows, k) N and D.
        G, z: (rows, k) (N - y D) / z but for the column of the one, which is z (rows).
        Jdot: (rows, n) dJ/dt at a constant estimate.
    """

    def __init__(
        self, robot: Robot, columns: Columns, constants: np.ndarray, entries: np.ndarray
    ) -> None:
        """Use a nominal robot, its columns, and a map as the kernel takes it."""
        model = robot.model
        self._model = model.copy()
        self._data = data = self._model.createData()
        self.frames = robot.frame_ids
        ends = [model.frames[frame] for frame in self.frames]
        f = len(ends)
        places = [*model.jointPlacements[1:], *(end.placement for end in ends)]
        origins = np.array([place.translation for place in places])
        joints = np.append(model.njoints + np.arange(f), columns.joints)  # tools count as joints
        self.columns = np.zeros((9, len(joints)))
        self.columns[:3, :f] = origins[-f:].T
        self.columns[:6, f:] = columns.motions
        self.columns[:3] += np.cross(origins[joints - 1], self.columns[3:6].T).T
        n = model.nv
        _, rows, width = constants.shape
        parents = np.append(model.parents, [end.parentJoint for end in ends])[joints]
        self._of_chain = (
            live_array([placement.rotation for placement in data.oMi]),
            live_array([placement.translation for placement in data.oMi]),
            data.J.reshape(6, n),
            data.dJ.reshape(6, n),
            np.column_stack(
                [parents, np.maximum(joints - model.njoints, 0), moves(model)[parents]]
            ),
            self.columns,
        )
        self.motion = np.zeros((2, width, n + 1))
        self.maps = constants.copy()
        self.G = empty((rows, width))
        self.Jdot = empty((rows, n))
        one = 3 * self.columns.shape[1]
        self.motion[0, one, n] = 1.0
        self.z = self.G[:, one]
        filled = self.motion, self.maps, self.G, self.Jdot
        self._of_sensor = constants, entries, empty((4, 3)), *filled

    def update(self, a: np.ndarray, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return y, J, the rate of y, dJ/dt v, X and Y of ``observed_motion`` as new arrays."""
        try:
            pin.computeJointJacobiansTimeVariation(self._model, self._data, q, v)
        except ValueError as error:
            raise wrong_sizes(self._model, q, v) from error
        m = len(self.G)
        shape = m, a.size
        found = empty(m), empty(self.Jdot.shape), empty(m), empty(m), empty(shape), empty(shape)
        kernels.observed_motion(*self._of_chain, v, a, *self._of_sensor, *found)
        return found

    def rotations(self) -> list[np.ndarray]:
        """Return the rotation (3, 3) of each frame."""
        return [
            pin.updateFramePlacement(self._model, self._data, frame).rotation
            for frame in self.frames
        ]


class LinearKinematics(TaskKinematics):
    """The estimated coordinates y = N phi(q) / (D phi(q)) of the task frame, or frames.

    J = (N - y_hat D) Phi / z_hat is the exact Jacobian of the estimated coordinates, where dphi/dt
    = Phi v and z_hat = D phi; ``Y_k`` is for y_hat and z_hat as they are. The rotation rows of a
    pose are R_c times the angular velocity in the axes of the base, with R_c the first three
    columns of N.
    """

    task: FrameTask

    def _observe(self, columns: Columns, N: np.ndarray, entries: np.ndarray) -> None:
        """Take the columns, and a map whose entries are parameters, beside constants.

        Args:
            columns: of the nominal robot.
            N: (m_p, 1 + 3 f + 3 k) its constants, of f frames and k columns; those of D are a one.
            entries: (K, 4) a parameter, 0 for N or 1 for D, and the row and column that it adds to.
        """
        m, width = N.shape
        self.columns = columns
        turning = self.task.size - m  # rows of rotations, that in N once more
        self._of_pose = turning > 0
        constants = np.zeros((2, m + turning, width + turning))
        constants[0, :m, :width] = N
        constants[1, :, width - 1] = 1.0
        constants[0, m:, width:] = N[:turning, :turning]
        again = entries[entries[:, 3] < turning] + [0, 0, m, width]
        self._entries = np.concatenate([entries, again])
        self._now, self._past = (
            _ObservedChain(self.robot, columns, constants, self._entries) for _ in range(2)
        )

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate at an estimate a_k (p), configuration q (nq) and velocity v (nv)."""
        if a_k.size != self.size:
            raise ParameterError(f"expected {self.size} numbers, got {a_k.size}.", where="a_k")
        y, self.J, self.xd_hat, self.Jdot_v, X, self.Y_k = self._now.update(a_k, q, v)
        self.a_k = a_k
        self._v = v
        self._y = y
        m = self.positions
        self.p_hat, self.X_k = (y[:m], X[:m]) if self._of_pose else (y, X)

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
        """The estimated positions (m) [m], and for poses the quaternions xyzw behind them."""
        return self._coordinates(self.p_hat, self._now)

    def _coordinates(self, p_hat: np.ndarray, chain: _ObservedChain) -> np.ndarray:
        """Return the task coordinates at estimated positions (m_p)."""
        if not self._of_pose:
            return p_hat
        turned = (self._axes() @ R for R in chain.rotations())
        return np.concatenate([p_hat, *map(quaternion, turned)])

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
        if a_k_rate.size != self.size:
            raise ParameterError(f"expected {self.size} numbers.", where="a_k_rate")
        chain = self._now
        found = chain.Jdot.copy()
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
        rows = []
        off = []
        for q, _, _ in random_states(self.robot.model, SAMPLES):
            self.update(found, q, self._still)
            x = robot.position(q)
            rows.append(self.explaining(x) * self.sizes)
            off.append(self.task.error(x, self.x_hat))
        W = np.concatenate(rows)
        left = np.array(off)
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
            tool = joint - model.njoints
            at = self._now.frames[max(tool, 0)], None if tool >= 0 else joint
            nominal = placement_of(self.robot.model, *at)
            yield self.columns.joints == joint, nominal, placement_of(model, *at)


class FrameKinematics(LinearKinematics):
    """The estimated kinematics of the task frame in world axes, with columns as parameters.

    For a pose the rotation rows of Y_k are zero, as orientation does not depend on translations. Of
    several frames each depends on its own tool alone, so X_k and Y_k are block diagonal.
    """

    def __init__(self, robot: Robot, unknown: Words = ()) -> None:
        """Choose the unknown translations of a nominal robot, as ``unknown_translations``.

        ``unknown="geometry"`` chooses every placement, as ``columns_of_geometry``.

        Raises:
            ParameterError, RobotError: as ``unknown_translations``, the geometry with a task that
                is not one of positions alone, or of several frames other unknown translations than
                their tools: those of joints move several frames.
        """
        whole = isinstance(unknown, str) and unknown == GEOMETRY
        words = [unknown] if isinstance(unknown, str) else list(unknown)
        task = robot.task if robot.task.frames else robot.frame_task
        if task.frames and words not in ([], [TOOL]):
            raise ParameterError(
                f"with several frames their tools may be unknown, and {words} was given.",
                where="unknown.translations",
                hint='Take unknown "tool", or one frame at a time.',
            )
        if whole and not isinstance(task, PositionTask):
            raise ParameterError(
                f"the geometry is learned from positions only, and the task is '{task.name}'.",
                where="unknown.geometry",
                hint='Take a task of the position, such as "xyz", or `pinadapt calibrate` before.',
            )
        self._take(robot, task, unknown)
        own = unknown_translations(robot, [TOOL] if whole else unknown)
        f = len(robot.frames)
        m = self.positions
        self.translations = own * f
        columns = columns_of_geometry(robot) if whole else stacked(translated(robot, own))
        self.names, _, _, self.initial, self.sizes, self.bounds = columns
        self.size = len(self.names)
        frames = np.repeat(range(f), m // f)
        rows = np.tile(np.arange(3)[self.task.place], f)
        moved = np.maximum(columns.joints - robot.model.njoints, 0)  # the frame of each column
        i, j = np.nonzero(frames[:, None] == moved)
        at = 3 * (f + j) + rows[i]
        N = np.zeros((m, 1 + 3 * f + 3 * self.size))
        N[range(m), 3 * frames + rows] = 1.0
        N[i, at] = -self.initial[j]
        self._observe(columns, N, np.column_stack([j, 0 * j, i, at]))
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
