"""Kinematics of the task frame with small errors of every placement of the chain.

Each placement, of a joint or of the task frame, is the described one times a small displacement
exp(d), six numbers (shift s, turn w) in the axes of what it places. To first order the position is
linear in all of them,

    x = p(q) + sum over placements of s + w x (p - o),

with o the origin of what is placed, s and w in world axes. The remainder is of second order in the
turns, and zero for shifts. A displacement along or about the axis of a joint is left out: one of
the next placement has the same effect.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from .._checks import instance
from ..description.chain import is_slide
from ..description.urdf_writer import axis_of
from ..exceptions import ParameterError, RobotError
from ..robot.robot import Robot
from ..tasks.frame import PositionTask
from .basis import base_parameters
from .task_kinematics import TaskKinematics
from .translations import FIRST, TOOL, unknown_translations

GEOMETRY = "geometry"
TURN, SHIFT = 0.02, 0.005  # [rad] and share of the reach: standard deviations of a description
_TOOL, _BASE = 10.0, 3.0  # times those, of the tool and of the base
_UNIT = 0.1  # of the reach: what the size of one stands for
_WIDE = 10.0  # standard deviations
_SAMPLES = 60  # configurations at which two geometries are compared
_SAME = 1e-9  # [m]


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


class PlacementKinematics(TaskKinematics):
    """The estimated kinematics of the task frame, linear in displacements of all placements.

    The parameters are the shift of the tool (3), the displacements of the base (the placement of
    the first joint, 6) and of every other joint (4), in metres and radians, zero as described.
    """

    task: PositionTask

    def __init__(self, robot: Robot) -> None:
        """Use a nominal robot with a task of its frame's position.

        Raises:
            ParameterError: the task is not one of positions alone.
        """
        task = instance(robot, Robot, "robot", RobotError).frame_task
        if not isinstance(task, PositionTask):
            raise ParameterError(
                f"the geometry is learned from positions only, and the task is '{task.name}'.",
                where="unknown.geometry",
                hint='Take a task of the position, such as "xyz", or `pinadapt calibrate` before.',
            )
        self.robot, self.task, self.frame = robot.undrawn(), task, robot.frame
        self.joint_names, model = robot.joint_names, robot.model.copy()
        self.nq, self.nv, self.positions = int(model.nq), int(model.nv), task.positions
        self._rows = task.place
        plain = np.array([f"{kind}_{axis}" for kind in ("shift", "turn") for axis in "xyz"])
        self.translations = unknown_translations(robot, [TOOL])
        names, columns = list(self.translations[0].labels), [np.eye(6)[:, :3]]
        places, sizes = [self.nv] * 3, [np.full(3, _TOOL * SHIFT * robot.reach)]
        self._ids = []
        for joint, name in enumerate(self.joint_names, 1):
            axes, own = axes_of(model, joint)
            kept = np.arange(6) % 3 != own % 3
            if joint == FIRST:
                kept[:] = True
            names += [f"{name}.{label}" for label in plain[kept]]
            columns.append(axes[:, kept])
            places += [joint - 1] * int(kept.sum())
            size = np.repeat([SHIFT * robot.reach, TURN], 3)[kept]
            sizes.append(size * (_BASE if joint == FIRST else 1.0))
            placed = pin.Frame(
                f"{name}, placed", model.parents[joint], 0, model.jointPlacements[joint],
                pin.FrameType.OP_FRAME,
            )  # fmt: skip
            self._ids.append(model.addFrame(placed, False))
        self._ids.append(robot.frame_id)
        self.names, self.size = tuple(names), len(names)
        self._columns, self._places = np.concatenate(columns, axis=1), np.array(places)
        deviations = np.concatenate(sizes)
        self.sizes = deviations / (_UNIT * robot.reach)
        self.bounds = _WIDE * deviations * np.array([[-1.0], [1.0]])
        self.initial = np.zeros(self.size)
        self._model, self._data, self._past = model, model.createData(), model.createData()
        self.update(self.initial, robot.q0, np.zeros(self.nv))

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the argument: Pinocchio's data is scratch."""
        return PlacementKinematics, (self.robot,)

    def update(self, a_k: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Evaluate at an estimate a_k (p), configuration q (nq) and velocity v (nv)."""
        model, data, kind = self._model, self._data, pin.LOCAL_WORLD_ALIGNED
        pin.computeJointJacobiansTimeVariation(model, data, q, v)
        pin.updateFramePlacements(model, data)
        self.a_k, self._v = a_k, v
        self._J = np.array([pin.getFrameJacobian(model, data, k, kind) for k in self._ids])
        self._dJ = np.array(
            [pin.getFrameJacobianTimeVariation(model, data, k, kind) for k in self._ids]
        )
        r, shifts, turns = self._levers(data)
        self._r, self._rd = r, self._relative(self._J) @ v
        self._shifts, self._turns = shifts, turns
        self._W = _skew(self._J[:, 3:] @ v)  # angular velocities of the bodies that carry places
        W = self._W[self._places]
        self._shift_rates, self._turn_rates = _times(W, shifts), _times(W, turns)
        X, Y = self._first_order(r), self._rates()
        self.X_k, self.Y_k = X[:, self._rows].T, Y[:, self._rows].T
        self.p_hat = data.oMf[self._ids[-1]].translation[self._rows] + self.X_k.dot(a_k)
        self.last_joint = self.p_hat
        self.J = self._jacobian()[self._rows]
        self.xd_hat = self.J.dot(v)
        drift = (self._dJ[-1, :3] @ v)[self._rows]
        self.Jdot_v = drift + self._accelerations(np.zeros(self.nv)).dot(a_k)

    def _levers(self, data: pin.Data) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return p - o (F, 3) of each placement, and shifts and turns (p, 3) in world axes."""
        origins = np.array([data.oMf[k].translation for k in self._ids])
        R = np.array([data.oMf[k].rotation for k in self._ids])[self._places]
        shifts, turns = (_times(R, part.T) for part in (self._columns[:3], self._columns[3:]))
        return origins[-1] - origins, shifts, turns

    def _first_order(self, r: np.ndarray) -> np.ndarray:
        """Return dx/da (p, 3) at levers r (F, 3)."""
        return self._shifts + _cross(self._turns, r[self._places])

    def _rates(self) -> np.ndarray:
        """Return the rate (p, 3) of dx/da."""
        r, rd = self._r[self._places], self._rd[self._places]
        return self._shift_rates + _cross(self._turn_rates, r) + _cross(self._turns, rd)

    def _relative(self, J: np.ndarray) -> np.ndarray:
        """Return the rows (F, 3, n) of the lever p - o in a Jacobian of all placements."""
        return np.asarray(J[-1, :3] - J[:, :3])

    def _displacements(self, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return shift and turn (F, 3) of each placement, as matrices (F, 3, 3) of products."""
        s, w = np.zeros((2, len(self._ids), 3))
        np.add.at(s, self._places, self._shifts * a[:, None])
        np.add.at(w, self._places, self._turns * a[:, None])
        return _skew(s), _skew(w)

    def _jacobian(self) -> np.ndarray:
        """Return dx/dq (3, n) at the estimate.

        A joint that turns by j carries s along as j x s, and w x r as (j x w) x r + w x dr.
        """
        S, W = self._displacements(self.a_k)
        turning = _skew(self._r) @ W - S
        parts = turning @ self._J[:, 3:] + W @ self._relative(self._J)
        return np.asarray(self._J[-1, :3] + parts.sum(axis=0))

    def jacobian_rate(self, a_k_rate: np.ndarray) -> np.ndarray:
        """Return dJ/dt (m, nv) by the motion and by the rate a_k_rate (p) of the estimate."""
        S, W = self._displacements(self.a_k)
        S_rate, W_rate = self._displacements(a_k_rate)
        turned, r, rd = self._W, _skew(self._r), _skew(self._rd)
        S_rate += turned @ S - S @ turned  # of w x s, as a matrix
        W_rate += turned @ W - W @ turned
        J, dJ = self._J, self._dJ
        parts = (rd @ W + r @ W_rate - S_rate) @ J[:, 3:] + (r @ W - S) @ dJ[:, 3:]
        parts += W_rate @ self._relative(J) + W @ self._relative(dJ)
        return np.asarray(dJ[-1, :3] + parts.sum(axis=0))[self._rows]

    def acceleration_regressor(self, a: np.ndarray) -> np.ndarray:
        """Return Ybar_k (m, p) of Wang and Xie (27) at joint acceleration a (nv)."""
        return self._accelerations(a)

    def _accelerations(self, a: np.ndarray) -> np.ndarray:
        """Return the second derivative (m, p) of dx/da at joint acceleration a (nv)."""
        motion = self._dJ @ self._v + self._J @ a
        turned = _skew(motion[:, 3:])[self._places]
        W, r, rd = self._W[self._places], self._r[self._places], self._rd[self._places]
        rdd = (motion[-1, :3] - motion[:, :3])[self._places]
        shifts = _times(turned, self._shifts) + _times(W, self._shift_rates)
        turns = _times(turned, self._turns) + _times(W, self._turn_rates)
        found = shifts + _cross(turns, r) + 2.0 * _cross(self._turn_rates, rd)
        return np.asarray((found + _cross(self._turns, rdd))[:, self._rows].T)

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of each parameter (p)."""
        return tuple("rad" if self._columns[3:, k].any() else "m" for k in range(self.size))

    @property
    def x_hat(self) -> np.ndarray:
        """The estimated positions (m) [m]."""
        return self.p_hat

    def at(self, q: np.ndarray, seen: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the estimated positions at another q (nq), and X_k (m_p, p) there."""
        pin.framesForwardKinematics(self._model, self._past, q)
        r, shifts, turns = self._levers(self._past)
        X_k = (shifts + _cross(turns, r[self._places]))[:, self._rows].T
        place = self._past.oMf[self._ids[-1]].translation[self._rows]
        return place + X_k.dot(self.a_k), X_k

    def between(self, q_0: np.ndarray, q_1: np.ndarray, share: float) -> np.ndarray:
        """Return the configuration (nq) at a share, from 0 to 1, of the way from q_0 to q_1."""
        return np.asarray(pin.interpolate(self._model, q_0, q_1, share))

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of a robot with the same chain.

        None if no parameters give that robot's position to a nanometre, because it is turned.
        """
        rng, still = np.random.default_rng(0), np.zeros(self.nv)
        rows, off = [], []
        for _ in range(_SAMPLES):
            q = pin.integrate(self._model, self.robot.q0, rng.uniform(-2.0, 2.0, self.nv))
            self.update(self.initial, q, still)
            rows.append(self.X_k * self.sizes)
            off.append(robot.placement(q).translation[self._rows] - self.p_hat)
        W, y = np.concatenate(rows), np.concatenate(off)
        found = np.linalg.lstsq(W, y, rcond=1e-10)[0]
        return found * self.sizes if np.abs(y - W @ found).max() < _SAME else None

    def write(self, model: pin.Model, a_k: np.ndarray) -> None:
        """Write the placements of an estimate a_k (p) into a model of the chain."""
        nominal = self.robot.model
        for place in range(self.nv + 1):
            moved = pin.exp6(self._columns[:, self._places == place] @ a_k[self._places == place])
            if place == self.nv:
                tip = nominal.frames[self.robot.frame_id].placement
                model.frames[self.robot.frame_id].placement = tip * moved
            else:
                model.jointPlacements[place + 1] = nominal.jointPlacements[place + 1] * moved

    def read(self, model: pin.Model, a_k: np.ndarray) -> np.ndarray:
        """Return the displacements (p) of a model of the chain."""
        nominal, tip = self.robot.model, self.robot.frame_id
        found = np.zeros(self.size)
        for place in range(self.nv + 1):
            before, now = (
                one.frames[tip].placement if place == self.nv else one.jointPlacements[place + 1]
                for one in (nominal, model)
            )
            own = self._places == place
            found[own] = self._columns[:, own].T @ pin.log6(before.actInv(now)).vector
        return found

    def base(self, samples: int = 50) -> int:
        """Return the number of identifiable combinations of the parameters."""
        return base_parameters(self, self.robot, samples=samples).size


def _skew(vectors: np.ndarray) -> np.ndarray:
    """Return the matrices (F, 3, 3) of the cross products with vectors (F, 3)."""
    found = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    found[:, 0, 1], found[:, 0, 2], found[:, 1, 2] = -z, y, -x
    found[:, 1, 0], found[:, 2, 0], found[:, 2, 1] = z, -y, x
    return found


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return matrices (p, 3, 3) times vectors (p, 3), one by one."""
    return np.asarray(np.einsum("pij,pj->pi", matrices, vectors))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross products (p, 3) of vectors, which numpy's own takes longer for."""
    after, before = [1, 2, 0], [2, 0, 1]
    return np.asarray(a[:, after] * b[:, before] - a[:, before] * b[:, after])
