"""Kinematics of the task frame, affine in unknown translations of the chain.

x = sum_j R_parent(j)(q) p_j + R_n(q) p_e, with p_j the translations of the joint placements and p_e
that of the frame. With p = p_0 + B a_k the task velocity is xdot = Y_k(q, v) a_k + y_k0(q, v): Wang
and Xie (2009), equation (2), for any chain.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from numpy import empty

from .._checks import instance
from .._kernels import models as kernels
from ..exceptions import REFUSED, ArrayError, ParameterError, RobotError
from ..robot.robot import Robot
from .basis import base_parameters
from .regressor import live_array
from .task_kinematics import TaskKinematics
from .translations import FIRST, PlacedTranslations, Translation, placement_of, unknown_translations

_WIDE, _WIDE_BASE = 0.5, 10.0  # of the reach
_SHORTEST, _LONGEST = 0.2, 5.0  # of the nominal length


class FrameKinematics(TaskKinematics):
    """The estimated kinematics of the task frame, with unknown translations as parameters.

    Everything is in world axes (LOCAL_WORLD_ALIGNED), with the rows of the task only. Orientation
    does not depend on translations: for a pose the rotation rows of Y_k are zero.
    """

    def __init__(self, robot: Robot, unknown: str | Sequence[str | Translation] = ()) -> None:
        """Choose the unknown translations of a nominal robot, as ``unknown_translations``.

        Raises:
            ParameterError, RobotError: as ``unknown_translations``.
        """
        instance(robot, Robot, "robot", RobotError)
        self.translations = unknown_translations(robot, unknown)
        self.robot = robot.undrawn()
        self.task, self.joint_names, self.frame = robot.task, robot.joint_names, robot.frame
        self.nq, self.nv = int(robot.model.nq), int(robot.model.nv)
        self.names = tuple(label for part in self.translations for label in part.labels)
        self.size = len(self.names)
        self._task = robot.frame_task
        self._rows, self._place = self._task.rows, self._task.place
        self.positions = robot.task.positions
        self._size = robot.task.size
        self._turns = self._size > self.positions
        self._J_shape = (self._size, self.nv)
        self._Y_shape, self._X_shape = (self._size, self.size), (self.positions, self.size)
        self._Jdot = empty(self._J_shape)  # dJ/dt at a constant estimate, scratch
        self._model = robot.model.copy()
        self._data, self._past = self._model.createData(), self._model.createData()
        self._frame = robot.frame_id
        self._placed = PlacedTranslations(self._model, self._frame, self.translations)
        self.parents = [self._parent(self._model, part) for part in self.translations]
        self._B = [None if part.whole else part.directions for part in self.translations]
        # Views into Data of each parent joint: position rows of its rotation, its angular velocity
        # and acceleration in its own axes.
        self._R = [self._data.oMi[i].rotation[self._place] for i in self.parents]
        self._w = [self._data.v[i].angular for i in self.parents]
        self._dw = [self._data.a[i].angular for i in self.parents]
        # Views into Data of all joints: placements, motions in their own axes, Jacobian, its rate.
        self._rotations, self._origins = _placements(self._data)
        self._past_placements = _placements(self._past)
        self._velocities = _motions(self._data.v)
        self._axes = self._data.J.reshape(6, self.nv)
        self._axis_rates = self._data.dJ.reshape(6, self.nv)
        self._lever = placement_of(self._model, self._frame, None).translation
        self.last_joint = self._data.oMi[self._model.njoints - 1].translation[self._place]
        self._row_numbers, self._place_numbers = np.arange(6)[self._rows], np.arange(3)[self._place]
        sizes = [part.size for part in self.translations]
        self._parent_of = np.repeat(np.array(self.parents, dtype=np.int64), sizes)
        self._last_column = np.array([joint.idx_v for joint in self._model.joints], dtype=np.int64)
        self._zero, self._no_columns = np.zeros(self._model.nv), np.zeros((self.positions, 0))
        self._no_turning = np.zeros((robot.task.size - self.positions, self.size))
        initial = self.value(robot)
        if initial is None:
            raise ParameterError(
                "the directions and offsets do not contain the placements of the nominal robot.",
                where="unknown.kinematic",
                hint="Use an offset on the line or plane of the nominal translation.",
            )
        self.initial, self.sizes = initial, np.ones(self.size)
        self.bounds = self._bounds(robot.reach)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return FrameKinematics, (self.robot, self.translations)

    @property
    def chain(self) -> tuple[pin.Model, pin.Data]:
        """Model and data of the last update."""
        return self._model, self._data

    def _bounds(self, reach: float) -> np.ndarray:
        """Return bounds (2, p) [m] around the nominal translations.

        A length lies between a fifth and five times the nominal one, other coordinates within half
        the reach, those of the base within ten times.
        """
        parts, centre = self.translations, self.initial
        plain = [part.size == 1 and not part.offset.any() for part in parts]
        sizes = np.array([part.size for part in parts], dtype=int)
        length = np.repeat(np.array(plain, dtype=bool), sizes) & (centre > 0.0)
        wide = [_WIDE_BASE if part.joint == FIRST else _WIDE for part in parts]
        margin = np.repeat(np.array(wide), sizes) * reach
        low = np.where(length, _SHORTEST * centre, centre - margin)
        return np.stack([low, np.where(length, _LONGEST * centre, centre + margin)])

    def _parent(self, model: pin.Model, part: Translation) -> int:
        """Return the joint in whose axes a translation is given."""
        if part.joint is None:
            return int(model.frames[self._frame].parentJoint)
        return int(model.parents[part.joint])

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) [m] of a robot with the same chain.

        None if no parameters give that robot's position, because other placements differ.
        """
        a_k = PlacedTranslations(robot.model, self._frame, self.translations).read()
        q = pin.integrate(
            self._model, pin.neutral(self._model), np.linspace(0.3, 1.1, self._model.nv)
        )
        self.update(a_k, q, self._zero)
        return a_k if np.abs(self.task.error(self.x_hat, robot.position(q))).max() < 1e-9 else None

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate at an estimate a_k (p) [m], configuration q (nq) and velocity v (nv)."""
        for first, directions, offset, translation in self._placed.places:
            kernels.place(a_k, first, directions, offset, translation)
        try:
            pin.computeJointJacobiansTimeVariation(self._model, self._data, q, v)
        except REFUSED as error:
            raise ArrayError from error
        m, m_p = self._size, self.positions
        J, Jdot_v, xd_hat = empty(self._J_shape), empty(m), empty(m)
        Y_k, p_hat, X_k = empty(self._Y_shape), empty(m_p), empty(self._X_shape)
        kernels.frame_motion(
            self._rotations, self._origins, self._velocities, self._axes, self._axis_rates, v,
            self._lever, self._row_numbers, self._parent_of, self._placed.directions,
            J, self._Jdot, Jdot_v, xd_hat, Y_k, p_hat, X_k,
        )  # fmt: skip
        self.J, self.Jdot_v, self.xd_hat = J, Jdot_v, xd_hat
        self.Y_k, self.p_hat, self.X_k = Y_k, p_hat, X_k
        self.a_k, self._q, self._v = a_k, q, v

    @property
    def Y_p(self) -> np.ndarray:
        """The position rows (m_p, p) of Y_k."""
        return self.Y_k[: self.positions]

    @property
    def y_k0(self) -> np.ndarray:
        """The known part (m) of the velocity, J v = Y_k a_k + y_k0 [m/s, rad/s]."""
        return self.xd_hat - self.Y_k.dot(self.a_k)

    @property
    def y_p0(self) -> np.ndarray:
        """The position rows (m_p) of ``y_k0`` [m/s]."""
        return self.y_k0[: self.positions]

    @property
    def x_hat(self) -> np.ndarray:
        """The estimated positions (m) [m], or position and quaternion xyzw (7) of a pose."""
        placement = pin.updateFramePlacement(self._model, self._data, self._frame)
        return self._task.of(placement)

    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return Ybar_k (m, p) of Wang and Xie (27), xddot = Ybar_k(q, v, a) a_k + known part."""
        try:
            pin.forwardKinematics(self._model, self._data, self._q, self._v, a)
        except REFUSED as error:
            raise ArrayError from error
        blocks = []
        for w, dw in zip(self._w, self._dw, strict=True):
            W = pin.skew(w)
            blocks.append(pin.skew(dw) + W.dot(W))
        return self._padded(self._stack(blocks))

    def at(self, q: np.ndarray, seen: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the estimated task coordinates at another q (nq), and X_k (m_p, p) there.

        The estimate is that of the last update. The attributes do not change.
        """
        try:
            pin.forwardKinematics(self._model, self._past, q)
        except REFUSED as error:
            raise ArrayError from error
        placement = pin.updateFramePlacement(self._model, self._past, self._frame)
        p_hat, X_k = empty(self.positions), empty((self.positions, self.size))
        kernels.positions_at(
            *self._past_placements, self._lever, self._place_numbers, self._parent_of,
            self._placed.directions, p_hat, X_k,
        )  # fmt: skip
        return self._task.of(placement), X_k

    def between(self, q_0: np.ndarray, q_1: np.ndarray, share: float) -> np.ndarray:
        """Return the configuration (nq) at a share, from 0 to 1, of the way from q_0 to q_1."""
        if self.nq == self.nv:
            return q_0 + share * (q_1 - q_0)
        return np.asarray(pin.interpolate(self._model, q_0, q_1, share))

    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return dJ/dt (m, nv) by the motion and by the rate a_k_rate (p) [m/s] of the estimate.

        J is affine in a_k, so the second part is linear in a_k_rate. Without it (17) of Wang and
        Xie does not hold.
        """
        Jdot = self._Jdot.copy()
        kernels.add_translation_rates(
            a_k_rate, self._parent_of, self._placed.directions, self._rotations,
            self._axes, self._last_column, self._place_numbers, Jdot,
        )  # fmt: skip
        return Jdot

    def write(self, model: pin.Model, a_k: np.ndarray) -> None:
        """Write the translations of an estimate a_k (p) [m] into a model of the chain."""
        PlacedTranslations(model, self._frame, self.translations).write(a_k)

    def read(self, model: pin.Model, a_k: np.ndarray) -> np.ndarray:
        """Return the translations (p) [m] of a model of the chain."""
        return PlacedTranslations(model, self._frame, self.translations).read()

    def _stack(self, blocks: Sequence[np.ndarray]) -> np.ndarray:
        """Return the position rows (m_p, p) of R (block) B for blocks (3, 3) in parent axes."""
        parts = [
            R.dot(block if B is None else block.dot(B))
            for R, B, block in zip(self._R, self._B, blocks, strict=True)
        ]
        return parts[0] if len(parts) == 1 else np.concatenate([self._no_columns, *parts], axis=1)

    def _padded(self, Y: np.ndarray) -> np.ndarray:
        """Return position rows (m_p, p) with zero rotation rows below, (m, p)."""
        return np.concatenate([Y, self._no_turning]) if self._turns else Y

    def base(self, samples: int = 50) -> int:
        """Return the number of identifiable combinations of the parameters: the rank of Y_p."""
        return base_parameters(self, self.robot, samples=samples).size


def _placements(data: pin.Data) -> tuple[np.ndarray, np.ndarray]:
    """Return the rotations (N, 3, 3) and origins (N, 3) of all joints as views."""
    rotations = live_array([placement.rotation for placement in data.oMi])
    return rotations, live_array([placement.translation for placement in data.oMi])


def _motions(motions: Iterable[pin.Motion]) -> np.ndarray:
    """Return the motions (N, 6) of all joints as a view, linear before angular, own axes."""
    linear = live_array([motion.linear for motion in motions])
    return np.lib.stride_tricks.as_strided(
        linear, (len(linear), 6), linear.strides, writeable=False
    )
