"""The nominal robot at seeded states of a typical motion, for default gains and checks."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..robot.motors import torque_bounds
from ..robot.robot import Robot
from .dynamics import Dynamics
from .regressor import SAMPLES
from .task_kinematics import TaskKinematics

# of the configurations around home [rad or m]; half, twice: errors after a push 5 % smaller to 20 %
# larger
_SPREAD = 0.3
# singular values left out of inverses, relative to the largest; half, twice: the same runs
_SINGULAR = 1e-2


class States(NamedTuple):
    """N states of motion.

    Attributes:
        q: (N, nq).
        v: (N, n) [rad/s or m/s].
        a: (N, n) [rad/s^2 or m/s^2].
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


class TypicalMotion:
    """Typical motion around home, with the models evaluated at the initial estimates.

    Task coordinates have a typical speed of a sixth of the reach per second (rotations and joints
    of a sixth of a radian per second), and the acceleration with which the feedback reacts to an
    error of one per cent of the reach. Under constraints all of it is what they allow. What the
    dynamics give is computed on first use.

    Attributes:
        robot: the nominal robot.
        kinematics, dynamics: its models.
        states: N states.
        jacobians: (N, m, n) J at each state.
        kinematic_regressors: (N, m_p, p_k) Y_p, the position rows of Y_k, at each state.
        position_regressors: (N, m_p, p_k) X_k = dx/da_k at each state.
        right_inverses: (N, n, m) J^+ at each state, without directions that J hardly moves.
        free: (N, n, n) projection of torques onto what no constraint force changes, the identity
            without constraints.
        bandwidth: of the feedback [rad/s].
        efforts: (n) limits of the motors [N m or N], infinite where there is none.
    """

    def __init__(
        self,
        robot: Robot,
        kinematics: TaskKinematics,
        dynamics: Dynamics,
        bandwidth: float,
        efforts: np.ndarray | None = None,
    ) -> None:
        """Use the nominal robot, its models, the bandwidth [rad/s] and the limits of the motors."""
        self.efforts = torque_bounds(efforts, robot.model.nv)
        self.robot = robot.undrawn()
        self.bandwidth = bandwidth
        self.kinematics = kinematics
        self.dynamics = dynamics

        model = robot.model
        rng = np.random.default_rng(0)
        task = kinematics.task
        size = task.per_row(robot.reach if task.lengths else 1.0, 1.0)  # joints: by rad and m
        scale = np.outer([1.0 / 6.0, 0.01 * bandwidth**2], size)
        constraints = robot.constrained
        found = []
        still = np.zeros(model.nv)
        home = constraints.free(robot.q0, still)[0]
        for _ in range(SAMPLES):
            q = pin.integrate(model, robot.q0, rng.uniform(-_SPREAD, _SPREAD, model.nv).dot(home))
            kinematics.update(kinematics.initial, q, still)
            J = kinematics.J
            rows = np.concatenate([J, constraints.at(q, still)[0]])
            inverse = np.linalg.pinv(rows, rcond=_SINGULAR)[:, : len(J)]
            free = constraints.free(q, still)[0]
            v, a = scale * rng.standard_normal(scale.shape) @ inverse.T
            kinematics.update(kinematics.initial, q, v)
            found.append((q, v, a, J, inverse, free, kinematics.Y_p, kinematics.X_k))
        columns = [np.array(column) for column in zip(*found, strict=True)]
        self.states = States(*columns[:3])
        self.jacobians, self.right_inverses, self.free = columns[3:6]
        self.kinematic_regressors, self.position_regressors = columns[6:]

    @cached_property
    def regressors(self) -> np.ndarray:
        """P Y (N, n, p_d) at each state, Y without constraints."""
        return self.free @ np.array(list(map(self.dynamics.regressor, *self.states)))

    @cached_property
    def mass_matrices(self) -> np.ndarray:
        """M_hat (N, n, n) at each state."""
        self.dynamics.load(self.dynamics.initial)
        return np.array([self.dynamics.mass_matrix(q) for q in self.states.q])

    @cached_property
    def unit_masses(self) -> np.ndarray:
        """W (N, n, n) with W M_hat W^T = 1, M_hat^-1/2 up to a rotation, at each state.

        Under constraints it is that of the motions which they allow: W M_hat W^T is a projection,
        and A W^T = 0.
        """
        P = self.free
        eigenvalues, vectors = np.linalg.eigh(P @ self.mass_matrices @ P + (np.eye(P.shape[1]) - P))
        scaled = vectors / np.sqrt(np.abs(eigenvalues))[:, None, :]
        return scaled.swapaxes(1, 2) @ P


def felt_mass(robot: Robot) -> float:
    """Return the effective mass [kg] at the frame at home, 1 / mean eigenvalue of J M^-1 J^T."""
    m = robot.task.positions
    return 1.0 / np.mean(np.linalg.eigvalsh(_mobility(robot)[:m, :m]))


def felt_inertia(robot: Robot, largest: float) -> float:
    """Return the mean effective inertia [kg m^2] of a pose task's frame in rotation at home.

    At most ``largest`` times the effective inertia of the axis that rotates most easily. That
    bounds the rate at which a damping proportional to the result acts on that axis.
    """
    mobility = _mobility(robot)
    in_place = np.linalg.inv(mobility)[3:, 3:]
    return min(np.trace(in_place) / 3.0, largest / np.linalg.eigvalsh(mobility[3:, 3:])[-1])


def joint_inertia(robot: Robot) -> np.ndarray:
    """Return the inertia that each joint moves at home (n) [kg m^2 or kg], the diagonal of M."""
    return np.diag(pin.crba(robot.model, robot.model.createData(), robot.q0)).copy()


def _mobility(robot: Robot) -> np.ndarray:
    """Return J M^-1 J^T (m, m) of a frame task at home."""
    model = robot.model
    data = model.createData()
    M = pin.crba(model, data, robot.q0)
    J = pin.computeFrameJacobian(model, data, robot.q0, robot.frame_id, pin.LOCAL_WORLD_ALIGNED)
    J = J[robot.frame_task.rows]
    return J @ np.linalg.solve(M, J.T)
