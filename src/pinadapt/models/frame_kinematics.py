"""Unknown translations of a chain, in which position, velocity and acceleration of the frame are affine.

Theory: x = sum_j R_parent(j)(q) p_j + R_n(q) p_e over the joint placements p_j and the frame's own
p_e, so that with p = p_0 + B a_k the task velocity is xdot = Y_k(q, v) a_k + y_k0(q, v): Wang and
Xie (2009), equation (2), for any chain.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from .._compiled import compiled
from ..exceptions import ParameterError
from ..robot.robot import Robot
from .translations import PlacedTranslations, Translation, unknown_translations


class FrameKinematics:
    """The believed kinematics of a chain at the current estimate of its unknown translations.

    ``update`` evaluates everything at one state; the attributes then hold for that state until the
    next update. All are in world axes (LOCAL_WORLD_ALIGNED), rows of the task only. m: task size,
    m_p: its positions (m, but 3 for a pose), p: number of parameters. No translation turns the
    frame: the rotation rows of a pose have no unknowns.

    Attributes:
        names: one name a parameter.
        size: p.
        initial: (p) values in the believed robot's own description [m].
        task: the controlled coordinates.
        joint_names: names of the chain's joints.
        frame: name of the task frame.
        nq, nv: sizes of configuration and velocity.
        x_hat: believed task coordinates: (m) [m], or the 7 numbers of a pose.
        xd_hat: (m) believed velocity J v [m/s, rad/s].
        J: (m, nv) Jacobian at the estimate.
        Jdot_v: (m) dJ/dt v with the estimate held constant [m/s^2, rad/s^2].
        Y_k: (m, p) kinematic regressor, (2); zero in rotation rows.
        Y_p: (m_p, p) its position rows.
    """

    def __init__(self, robot: Robot, unknown: str | Sequence[str | Translation] = ()) -> None:
        """Choose the unknown translations of a believed robot; see ``unknown_translations`` for the words.

        Raises:
            ParameterError, RobotError: as ``unknown_translations``.
        """
        self.translations = unknown_translations(robot, unknown)
        self.task, self.joint_names, self.frame = robot.task, robot.joint_names, robot.frame
        self.nq, self.nv = int(robot.model.nq), int(robot.model.nv)
        self.names = tuple(label for part in self.translations for label in part.labels)
        self.size = len(self.names)
        self._rows, self._place = robot.task.rows, robot.task.place
        self._positions = robot.task.positions
        self._turns = robot.task.size > self._positions
        self._model = robot.model.copy()
        self._data = self._model.createData()
        self._frame = robot.frame_id
        self._placed = PlacedTranslations(self._model, self._frame, self.translations)
        self._parents = [self._parent(self._model, part) for part in self.translations]
        self._B = [None if part.whole else part.directions for part in self.translations]
        # Live views into Data: position rows of each parent joint's rotation, its angular velocity
        # and acceleration (own axes).
        self._R = [self._data.oMi[i].rotation[self._place] for i in self._parents]
        self._w = [self._data.v[i].angular for i in self._parents]
        self._dw = [self._data.a[i].angular for i in self._parents]
        self._shape = (robot.task.size, self.size)
        self._columns = [
            (window, (R, w, np.array(part.directions, dtype=float)))
            for part, window, R, w in zip(
                self.translations, self._placed.windows, self._R, self._w, strict=True
            )
        ]
        self._zero, self._no_columns = np.zeros(self._model.nv), np.zeros((self._positions, 0))
        self._no_turning = np.zeros((robot.task.size - self._positions, self.size))
        initial = self.value(robot)
        if initial is None:
            raise ParameterError(
                "the directions and offsets do not contain the believed robot's own placements."
            )
        self.initial = initial

    def _parent(self, model: pin.Model, part: Translation) -> int:
        return int(
            model.frames[self._frame].parentJoint
            if part.joint is None
            else model.parents[part.joint]
        )

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) [m] of any robot with this chain, the truth when given the true one.

        None when no value of the parameters gives that robot's position: something else differs
        too.
        """
        a_k = PlacedTranslations(robot.model, self._frame, self.translations).read()
        q = pin.integrate(
            self._model, pin.neutral(self._model), np.linspace(0.3, 1.1, self._model.nv)
        )
        self.update(a_k, q, self._zero)
        return a_k if np.abs(self.task.error(self.x_hat, robot.position(q))).max() < 1e-9 else None

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate the kinematics at estimate a_k (p) [m], configuration q (nq) and velocity v (nv)."""
        model, data = self._model, self._data
        self._placed.write(a_k)
        pin.forwardKinematics(model, data, q, v, self._zero)
        pin.computeJointJacobians(model, data)
        aligned = (
            pin.LOCAL_WORLD_ALIGNED
        )  # of a single joint Pinocchio returns the column as a vector
        J = pin.getFrameJacobian(model, data, self._frame, aligned)
        self.J = J[self._rows] if self.nv > 1 else J[self._rows, None]
        acceleration = pin.getFrameClassicalAcceleration(model, data, self._frame, aligned)
        self.Y_k = np.zeros(self._shape)
        for window, (R, w, B) in self._columns:
            _velocity_regressor(R, w, B, self.Y_k[:, window])
        self.Y_p = self.Y_k[: self._positions] if self._turns else self.Y_k
        self.xd_hat = self.J.dot(v)
        self.Jdot_v = acceleration.vector[self._rows]
        self._a_k, self._q, self._v = a_k, q, v

    @property
    def y_k0(self) -> np.ndarray:
        """Velocity (m) that no parameter changes at the last update, so that J v = Y_k a_k + y_k0 [m/s, rad/s]."""
        return self.xd_hat - self.Y_k.dot(self._a_k)

    @property
    def y_p0(self) -> np.ndarray:
        """Position rows (m_p) of ``y_k0`` [m/s]."""
        return self.y_k0[: self._positions]

    @property
    def x_hat(self) -> np.ndarray:
        """Believed task coordinates at the last update: positions (m) [m], or position and quaternion xyzw (7)."""
        return self.task.of(pin.updateFramePlacement(self._model, self._data, self._frame))

    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return the task-acceleration regressor (m, p) of Wang and Xie (27): xddot = Ybar_k(q, v, a) a_k + known part."""
        pin.forwardKinematics(self._model, self._data, self._q, self._v, a)
        blocks = []
        for w, dw in zip(self._w, self._dw, strict=True):
            W = pin.skew(w)
            blocks.append(pin.skew(dw) + W.dot(W))
        return self._padded(self._stack(blocks))

    def position_regressor(self) -> np.ndarray:
        """Return dx/da_k (m, p) at the last update: x = (this) a_k + known part, and the orientation does not move."""
        return self._padded(self._stack([np.eye(3)] * len(self._R)))

    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return dJ/dt (m, nv) while the estimate moves at a_k_rate (p) [m/s]: the motion's part plus the estimate's.

        The second part is linear in a_k_rate because J is affine in a_k; without it (17) of Wang
        and Xie does not hold.
        """
        model, data = self._model, self._data
        pin.computeJointJacobiansTimeVariation(model, data, self._q, self._v)
        Jdot = pin.getFrameJacobianTimeVariation(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)
        Jdot = Jdot.reshape(6, self.nv)[self._rows]
        axes = data.J.reshape(6, self.nv)[
            3:
        ]  # (3, nv) world directions of the revolute axes, zero for prismatic joints
        for part, window, parent in zip(
            self.translations, self._placed.windows, self._parents, strict=True
        ):
            velocity = data.oMi[parent].rotation @ (part.directions @ a_k_rate[window])
            columns = slice(
                0, model.joints[parent].idx_v + 1
            )  # the joints before the translation turn it
            Jdot[: self._positions, columns] -= (pin.skew(velocity) @ axes[:, columns])[self._place]
        return Jdot

    def _stack(self, blocks: Sequence[np.ndarray]) -> np.ndarray:
        """Return the position rows (m_p, p) of R B for each block (3, 3) in its parent joint's axes and directions B."""
        parts = [
            R.dot(block if B is None else block.dot(B))
            for R, B, block in zip(self._R, self._B, blocks)
        ]
        return parts[0] if len(parts) == 1 else np.concatenate([self._no_columns, *parts], axis=1)

    def _padded(self, Y: np.ndarray) -> np.ndarray:
        """Return position rows (m_p, p) with the zeros of the rotation rows below, (m, p)."""
        return np.concatenate([Y, self._no_turning]) if self._turns else Y

    def base(self, samples: int = 50) -> int:
        """Return how many combinations of the parameters motion can identify: the rank of Y_p over random states."""
        rng = np.random.default_rng(0)
        rows = []
        for _ in range(samples):
            self.update(
                self.initial,
                pin.integrate(
                    self._model, pin.neutral(self._model), rng.uniform(-3, 3, self._model.nv)
                ),
                rng.standard_normal(self._model.nv),
            )
            rows.append(self.Y_p)
        return int(np.linalg.matrix_rank(np.vstack(rows), tol=1e-8 * samples)) if self.size else 0


@compiled("void(f8[:,:], f8[:], f8[:,:], f8[:,:])")
def _velocity_regressor(R: np.ndarray, w: np.ndarray, B: np.ndarray, Y: np.ndarray) -> None:
    """Write R [w]x B into the position rows of Y (m, k), R (m_p, 3) those of a rotation, w (3) in its own axes, B (3, k)."""
    for j in range(B.shape[1]):
        x = w[1] * B[2, j] - w[2] * B[1, j]
        y = w[2] * B[0, j] - w[0] * B[2, j]
        z = w[0] * B[1, j] - w[1] * B[0, j]
        for i in range(len(R)):
            Y[i, j] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z
