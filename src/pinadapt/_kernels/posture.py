"""The return to a rest posture, away from limits."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled


@compiled("void(f8[:], f8[:], f8[:], f8[:], f8[:], f8[:])")
def posture_offset(
    q: np.ndarray,
    rest: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    margin: np.ndarray,
    offset: np.ndarray,
) -> None:
    """Write d + 2 e |e| / margin (n), d = q - rest, e how far d is outside of [low, high]."""
    for i in range(len(offset)):
        d = q[i] - rest[i]
        e = max(d - high[i], 0.0) + min(d - low[i], 0.0)
        offset[i] = d + 2.0 * e * abs(e) / margin[i]


@compiled("void(f8[:], f8[:], f8[:], f8, f8[:], f8[:], f8[:], f8[:])")
def posture_rate(
    q: np.ndarray,
    rest: np.ndarray,
    v: np.ndarray,
    frequency: float,
    low: np.ndarray,
    high: np.ndarray,
    margin: np.ndarray,
    rate: np.ndarray,
) -> None:
    """Write -w (1 + 4 |e| / margin) v (n), the rate of -w times ``posture_offset``."""
    for i in range(len(rate)):
        d = q[i] - rest[i]
        e = max(d - high[i], 0.0) + min(d - low[i], 0.0)
        rate[i] = -frequency * (1.0 + 4.0 * abs(e) / margin[i]) * v[i]
