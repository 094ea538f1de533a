"""What a control law sees, what it returns, and what it must state about itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from ..models.dynamics import Dynamics
from ..models.frame_kinematics import FrameKinematics
from ..models.right_inverse import RightInverse
from ..robot.friction import Friction
from .gains import Gains
from .posture import Posture


@dataclass(slots=True, eq=False)
class Signals:
    """Everything a law may see at one instant; m task coordinates, n joints.

    Attributes: q, v: measured configuration (nq) and joint velocity (n). xd: (m) measured task
        velocity, or None without such a sensor; angular rows are J_omega v, which needs none. xd_d,
        xdd_d: (m) desired task velocity and acceleration. dx: (m) x - x_d; for a pose the rotation
        vector of the orientation error in its last three rows. dxd_hat: (m) J_hat v - xd_d, the
        estimated task-velocity error. W_k, y: (m_p, p_k) and (m_p) the filtered regressor and
        velocity, (3)-(4), known part taken off y; positions only. a_k, a_d: (p_k), (p_d) the
        estimates. a_0: (p_d) the initial dynamic estimate. kinematics: the believed kinematics,
        evaluated at q, v, a_k. dynamics: the believed dynamics, a_d loaded. inverse: right inverse
        of the believed Jacobian, damped near its singularities. rate_k: from a gradient signal g_k
        (p_k) to the rate of a_k (p_k), by the chosen adaptation. watch: whether an M_hat that is
        not positive definite ends the run of a law that inverts it. delta: (m) d(dx)/dt - (xd -
        xd_d) of a pose, known without xd, or None where it is zero; see ``PoseTask``.
    """

    q: np.ndarray
    v: np.ndarray
    xd: np.ndarray | None
    xd_d: np.ndarray
    xdd_d: np.ndarray
    dx: np.ndarray
    dxd_hat: np.ndarray
    W_k: np.ndarray
    y: np.ndarray
    a_k: np.ndarray
    a_d: np.ndarray
    a_0: np.ndarray
    kinematics: FrameKinematics
    dynamics: Dynamics
    inverse: RightInverse
    rate_k: Callable[[np.ndarray], np.ndarray]
    watch: bool
    delta: np.ndarray | None = None


@dataclass(slots=True, eq=False)
class Command:
    """A torque, affine in the joint acceleration where the law measures it: tau = torque + feedthrough @ a.

    Attributes:
        torque: (n) N m or N.
        feedthrough: (n, n) or None for zero.
        memo: what the law wants back when it adapts, so that nothing is computed twice.
    """

    torque: np.ndarray
    feedthrough: np.ndarray | None = None
    memo: tuple[np.ndarray, ...] = ()

    def at(self, a: np.ndarray) -> np.ndarray:
        """Return the torque (n) at joint acceleration a (n)."""
        return self.torque if self.feedthrough is None else self.torque + self.feedthrough @ a


class Gradients(NamedTuple):
    """The signals that estimates descend: da/dt = -Gamma g.

    Attributes:
        g_d: (p_d) dynamic.
        g_k: (p_k) kinematic.
    """

    g_d: np.ndarray
    g_k: np.ndarray


class Truth(NamedTuple):
    """The true values at one instant, known in simulation only.

    Attributes:
        a_k, a_d: (p_k), (p_d) true parameters.
        M: (n, n) true mass matrix at q.
        friction: true friction of the joints.
    """

    a_k: np.ndarray
    a_d: np.ndarray
    M: np.ndarray
    friction: Friction


class Law(ABC):
    """A control law: torque, gradient signals, and the Lyapunov function that proves it.

    A new law is one file with one subclass; listing it in ``laws/__init__.py`` names it for
    scenarios.

    Attributes: name: as written in scenarios. adapts: whether it uses estimates that move.
        needs_task_velocity: whether ``Signals.xd`` must be measured. needs_margin: whether the
        proof needs K_v - alpha I > 0. inverts_estimate: whether it needs M_hat^-1 at the moving
        estimate. energy_based: whether V is in joules, so that gains are forces; otherwise gains
        are accelerations.
    """

    name: ClassVar[str]
    adapts: ClassVar[bool] = True
    needs_task_velocity: ClassVar[bool] = False
    needs_margin: ClassVar[bool] = False
    inverts_estimate: ClassVar[bool] = False
    energy_based: ClassVar[bool] = False

    def __init__(self, gains: Gains, posture: Posture) -> None:
        """Take checked gains and the null-space posture."""
        self.gains, self.posture = gains, posture

    @abstractmethod
    def command(self, s: Signals) -> Command:
        """Return the torque for the signals of one instant."""

    @abstractmethod
    def gradients(self, s: Signals, command: Command, a: np.ndarray) -> Gradients:
        """Return the adaptation signals, given the command just computed and the joint acceleration a (n)."""

    def prediction_gradient(self, s: Signals) -> np.ndarray:
        """Return the part W_k^T R_k (W_k a_k - y) (p_k) of g_k that compares measurements alone, whatever the torque did."""
        return self.gains.R_k.dot(s.W_k.dot(s.a_k) - s.y).dot(s.W_k)

    @abstractmethod
    def storage(self, s: Signals, truth: Truth) -> float:
        """Return V without the parts of the parameters, which the adaptations' ``distance`` adds."""

    @abstractmethod
    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt as the proof has it, an equality in continuous time with the ideal acceleration."""
