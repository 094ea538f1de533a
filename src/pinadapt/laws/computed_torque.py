"""Computed torque, the joint-space law for a known robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .resolved_acceleration import ResolvedAcceleration


@dataclass(frozen=True, eq=False)
class ComputedTorque(ResolvedAcceleration):
    """Computed torque: B. Markiewicz, JPL Technical Memorandum 33-601 (1973); J. Luh et al. (1980).

    Resolved acceleration on a joint task, x = q and J = I.

    Law:          tau = M (qdd_d - K_v ed - K_P e) + C qd + g, true parameters, e = q - q_d on the
                  manifold.
    Adaptation:   none.
    Closed loop:  edd + K_v ed + K_P e = 0.
    V:            |ed + alpha e|^2 / 2 + e^T (K_P + alpha K_v - alpha^2 I) e / 2,
                  dV/dt = -ed^T (K_v - alpha I) ed - alpha e^T K_P e.
    Assumptions:  M, C and g known exactly. With wrong estimates it is the unadapted baseline.
    """

    posture: Any = None

    name = "computed-torque"
    sources = ("Markiewicz1973", "LuhWalkerPaul1980")
    joint_space = True
    units = ("1/s", "1/s^2")
