"""What the pictures need to know of a run."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..tasks.task import Task


class Drawable(Protocol):
    """A run of N samples, as ``Rollout`` has it; see there for shapes and units."""

    @property
    def title(self) -> str:
        """Of the figures."""

    @property
    def law(self) -> str:
        """Name of the law."""

    @property
    def adaptation(self) -> str:
        """Name of the adaptation."""

    @property
    def task(self) -> Task:
        """The controlled coordinates."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """One name a joint."""

    @property
    def effort_limits(self) -> np.ndarray:
        """The description's effort limits (nv), infinite where it has none."""

    @property
    def kinematic_names(self) -> tuple[str, ...]:
        """One name a kinematic parameter."""

    @property
    def dynamic_names(self) -> tuple[str, ...]:
        """One name a dynamic parameter."""

    @property
    def t(self) -> np.ndarray:
        """Time (N) [s]."""

    @property
    def error(self) -> np.ndarray:
        """Task error (N, m)."""

    @property
    def tau(self) -> np.ndarray:
        """Torques of the motors (N, nv)."""

    @property
    def a_k(self) -> np.ndarray:
        """Kinematic estimates (N, p_k)."""

    @property
    def a_d(self) -> np.ndarray:
        """Dynamic estimates (N, p_d)."""

    @property
    def a_k_true(self) -> np.ndarray | None:
        """Their truth (p_k), or that of each time (N, p_k)."""

    @property
    def a_d_true(self) -> np.ndarray | None:
        """Their truth (p_d), or that of each time (N, p_d)."""

    @property
    def lyapunov(self) -> np.ndarray | None:
        """V (N)."""

    @property
    def min_eig_M_hat(self) -> np.ndarray:
        """Smallest eigenvalue of the estimated mass matrix (N)."""

    @property
    def damping(self) -> np.ndarray:
        """The mu^2 of the estimated Jacobian's right inverse (N)."""

    @property
    def saturated(self) -> np.ndarray:
        """Whether a torque was at its limit (N)."""

    @property
    def marks(self) -> tuple[tuple[float, str], ...]:
        """Time [s] and words of what happened during the run."""

    @property
    def interrupted(self) -> float | None:
        """Time at which somebody stopped the run [s]."""

    @property
    def diverged(self) -> float | None:
        """Time of divergence [s]."""
