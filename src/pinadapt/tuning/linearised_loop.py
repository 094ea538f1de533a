"""How fast the adaptation answers the error: the modes of the linearised closed loop over a typical motion.

With e the error that drives the adaptation and Phi the matrix by which parameter errors act on it,
de/dt = ... + Phi da and d(da)/dt = -Gamma Phi^T e: without damping an oscillator of frequencies
sqrt(eig(Phi Gamma Phi^T)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..adaptation.adaptation import Adaptation
from ..laws.law import Law
from ..models.dynamics import Dynamics
from ..models.frame_kinematics import FrameKinematics
from ..robot.robot import Robot
from ..robot.workspace import reach

_SAMPLES = 30
_SPREAD = 0.3  # [rad or m] around home
_SPEED, _ERROR = (
    1.0 / 6.0,
    0.01,
)  # of the reach: task speed [1/s], and task error to which the feedback reacts
_TURN = 1.0  # [rad] what takes the place of the reach for the rotations of a pose


class Motion(NamedTuple):
    """Seeded states of a typical motion around home.

    Each task coordinate moves at a sixth of the reach a second and is accelerated by the feedback
    of one per cent of the reach.

    Attributes:
        q: (N, nq).
        v: (N, n) [rad/s or m/s].
        a: (N, n) [rad/s^2 or m/s^2].
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def typical_motion(robot: Robot, kinematics: FrameKinematics, bandwidth: float) -> Motion:
    """Return the typical motion of a believed robot under feedback of a bandwidth [rad/s]."""
    model, rng = robot.model, np.random.default_rng(0)
    m = robot.task.positions
    size = np.repeat([reach(robot), _TURN], [m, robot.task.size - m])
    scale = np.array([[_SPEED], [_ERROR * bandwidth**2]]) * size
    states = []
    for _ in range(_SAMPLES):
        q = pin.integrate(model, robot.q0, rng.uniform(-_SPREAD, _SPREAD, model.nv))
        kinematics.update(kinematics.initial, q, np.zeros(model.nv))
        inverse = np.linalg.pinv(kinematics.J, rcond=1e-2)
        v, a = scale * rng.standard_normal((2, inverse.shape[1]))
        states.append((q, inverse @ v, inverse @ a))
    return Motion(*(np.array(column) for column in zip(*states, strict=True)))


@dataclass(frozen=True, eq=False)
class LinearisedLoop:
    """A law with its believed robot, over a typical motion.

    Attributes:
        law: the law.
        kinematics, dynamics: the believed robot, at its initial estimates.
        motion: the states.
    """

    law: type[Law]
    kinematics: FrameKinematics
    dynamics: Dynamics
    motion: Motion

    @cached_property
    def dynamic(self) -> list[np.ndarray]:
        """Phi of the dynamic parameters at each state: J M^-1 Y (m, p), or for energy-based laws M^-1/2 Y (n, p)."""
        self.dynamics.load(self.dynamics.initial)
        effects = []
        for q, v, a in zip(*self.motion, strict=True):
            Y, M = self.dynamics.regressor(q, v, a), self.dynamics.mass_matrix(q)
            if self.law.energy_based:
                effects.append(unit_mass(M) @ Y)
            else:
                self.kinematics.update(self.kinematics.initial, q, v)
                effects.append(self.kinematics.J @ np.linalg.solve(M, Y))
        return effects

    @cached_property
    def kinematic(self) -> list[np.ndarray]:
        """Y_p (m_p, p), the position rows of Y_k, at each state."""
        effects = []
        for q, v, _ in zip(*self.motion, strict=True):
            self.kinematics.update(self.kinematics.initial, q, v)
            effects.append(self.kinematics.Y_p)
        return effects


def unit_mass(M: np.ndarray) -> np.ndarray:
    """Return M^-1/2 (n, n) up to a rotation: W with W M W^T = 1, M a believed mass matrix."""
    eigenvalues, vectors = np.linalg.eigh(M)
    return np.asarray((vectors / np.sqrt(np.abs(eigenvalues))).T)


def gain_matrix(adaptation: Adaptation, a: np.ndarray) -> np.ndarray:
    """Return Gamma(a) (p, p), with da/dt = -Gamma g."""
    return (
        -np.column_stack([adaptation.rate(a, column) for column in np.eye(a.size)])
        if a.size
        else np.zeros((0, 0))
    )


def frequency(effects: Sequence[np.ndarray], Gamma: np.ndarray) -> float:
    """Return the median over the states of sqrt of the largest eigenvalue of Phi Gamma Phi^T [rad/s]."""
    largest = [np.linalg.eigvalsh(Phi @ Gamma @ Phi.T)[-1] for Phi in effects]
    return float(np.sqrt(max(np.median(largest), 0.0)))


def rate_for(mode: float, effects: Sequence[np.ndarray], unit: Adaptation, a: np.ndarray) -> float:
    """Return the rate gamma at which the ``frequency`` is ``mode`` [rad/s]; ``unit``: the adaptation at rate one."""
    natural = frequency(effects, gain_matrix(unit, a))
    return (mode / natural) ** 2 if natural > 0.0 else 1.0
