"""What laws with a feedback of the task error share: gains, and the adaptation of kinematics."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy import empty

from .._kernels import laws as kernels
from ..adaptation.adaptation import Drive
from ..models.typical_motion import TypicalMotion
from ..signals import Signals
from ..tasks.task import Task
from .law import KinematicLoop, Law, Truth
from .posture import Posture


@dataclass(frozen=True, eq=False)
class TaskFeedback(Law):
    """A law with gains K_v and K_P on the error of the task; numbers, lists or matrices.

    Attributes:
        task: the controlled coordinates, m of them, m_p positions.
        posture: what redundant joints do.
        K_v: (m, m) velocity gain.
        K_P: (m, m) position gain.
        alpha: [1/s].
        R_k: (m_p, m_p) weight of the kinematic prediction error.
        lambda_: velocity filter [1/s].
    """

    task: Task
    posture: Posture
    _: KW_ONLY
    K_v: Any
    K_P: Any
    alpha: float
    R_k: Any = 1.0
    lambda_: float = 10.0

    @classmethod
    def felt(cls, motion: TypicalMotion, dt: float) -> Any:
        """Return the inertia that a force of the feedback accelerates, one for accelerations."""
        return 1.0

    @classmethod
    def default_gains(cls, motion: TypicalMotion, dt: float, w: float) -> dict[str, Any]:
        """Return the default gains, as the class states them."""
        m = cls.felt(motion, dt)
        return {
            "Kv": 2.0 * w * m,
            "Kp": w * w * m,
            "alpha": w / 4.0,
            "R_k": 1.0,
            "lambda_": w / 2.0,
        }

    @cached_property
    def K_PV(self) -> np.ndarray:
        """K_P + alpha K_v (m, m)."""
        return self.K_P + self.alpha * self.K_v

    def _errors(self, s: Signals, alpha: float) -> tuple[np.ndarray, Drive]:
        """Return e = dxd_hat + alpha dx (m), and the drive of the kinematic estimate.

        g_k = -Y_k^T ((K_P + alpha K_v) dx + alpha dxd_hat) + W_k^T R_k (W_k a_k - y), (19) of Wang
        and Xie (2009), with zero for its last alpha where ``alpha`` is zero.
        """
        W_k = s.filtered.W_k
        y = s.filtered.y
        m = s.dx.size
        e, error, residual, g_k = empty(m), empty(m), empty(y.size), empty(s.a_k.size)
        kernels.kinematic_drive(
            self.K_PV, s.dx, alpha, s.xd_hat, s.xd_d, s.Y_k, W_k, self.R_k, s.a_k, y,
            e, error, residual, g_k,
        )  # fmt: skip
        return e, Drive(s.Y_k, error, W_k, residual, self.R_k, g_k)

    def _dissipated(self, s: Signals, truth: Truth) -> float:
        """Return dxd_hat^T K_v dxd_hat + alpha dx^T K_P dx + da_k^T W_k^T R_k W_k da_k."""
        prediction = s.filtered.W_k @ (s.a_k - truth.a_k)
        task = s.dxd_hat @ (self.K_v @ s.dxd_hat) + self.alpha * s.dx @ (self.K_P @ s.dx)
        return task + prediction @ (self.R_k @ prediction)

    def kinematic_loop(self) -> KinematicLoop:
        """Return the coupling by K_P + alpha K_v on the positions."""
        m = self.task.positions
        stiffness = np.linalg.eigvalsh(self.K_PV[:m, :m])[-1] if m else 0.0
        return KinematicLoop(stiffness, self.alpha, self.R_k)
