"""Default gains of least squares on the prediction error of position or velocity."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from .._checks import positive
from ..adaptation.least_squares import LeastSquares
from ..laws.law import Law
from ..models.typical_motion import TypicalMotion
from ..sensing import SensorQuality
from .remedies import Remedies

# of the bandwidth
_RATE = 1.0
_FORGETTING = 0.125

_PRIOR = 0.1  # of the reach: how far translations may be off
_FINEST = 1e-3  # of what that makes of the predicted: what is taken for noise where there is none


def kinematic_least_squares(
    P_0: np.ndarray,
    law: Law,
    motion: TypicalMotion,
    bandwidth: float,
    rates: Mapping[str, Any],
    needed: Remedies,
    quality: SensorQuality,
) -> LeastSquares:
    """Return least squares on what a law predicts of the frame, from a gain P(0) (p, p) on.

    Error and gain fall at the bandwidth w, so that the reference, which holds da_k/dt, can be
    followed, until the gain is that of the camera's noise against translations off by a tenth of
    the reach: from then on frames are averaged. Each direction forgets by itself, at w / 8 or an
    eighth of the low pass that the noise asks for. A weight R_k of the user's own takes the place
    of all but the forgetting.

    Args:
        P_0: the gain at the start.
        law: that predicts positions, or velocities.
        motion: the believed robot.
        bandwidth: w [rad/s].
        rates: given ``kinematic_rate``, ``kinematic_forgetting`` and ``R_k``.
        needed: what the noise asks for.
        quality: of the camera.

    Raises:
        GainError: a rate that is not positive.
    """
    rate, forgetting = rates.get("kinematic_rate"), rates.get("kinematic_forgetting")
    if forgetting is None:
        forgetting = _FORGETTING * min(bandwidth, needed.smoothing)
    size = motion.kinematics.size
    options: dict[str, Any] = {"weight": None, "forgetting": forgetting, "directional": True}
    if rates.get("R_k") is not None and rate is None:
        return LeastSquares(P_0, size, **options)
    rate = _RATE * bandwidth if rate is None else positive(rate, "kinematic_rate")
    seen = motion.position_regressors if law.needs_prediction else motion.kinematic_regressors
    squares = [np.einsum("ij,jk,ik->i", X, P_0, X) for X in seen]
    typical = float(np.mean(squares)) if squares else 0.0
    # noise of the predicted against what the prior makes of it, white over a second
    spread = quality.x if law.needs_prediction else quality.x * _velocity_filter(law, bandwidth)
    off = _PRIOR * motion.robot.reach * math.sqrt(typical / np.mean(np.diag(P_0)))
    noise = rate * (spread / off) ** 2 / quality.rate if spread and off else 0.0
    floor = typical * max(noise, _FINEST**2)
    return LeastSquares(P_0, size, rate=rate, floor=floor or 1.0, **options)


def _velocity_filter(law: Law, bandwidth: float) -> float:
    """Return the bandwidth [1/s] through which a law without prediction sees the velocity."""
    return float(getattr(law, "lambda_", bandwidth))
