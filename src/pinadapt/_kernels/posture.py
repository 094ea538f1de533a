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


@compiled("void(f8[:], f8[:], f8[:], f8, f8[:], f8[:], f8[:], f8[:], f8[:])", fills=2)
def posture_velocity(
    q: np.ndarray,
    rest: np.ndarray,
    v: np.ndarray,
    w: float,
    low: np.ndarray,
    high: np.ndarray,
    margin: np.ndarray,
    psi: np.ndarray,
    rate: np.ndarray,
) -> None:
    """Write psi = -w ``posture_offset`` and its rate -w (1 + 4 |e| / margin) v, both (n)."""
    for i in range(len(v)):
        d = q[i] - rest[i]
        e = max(d - high[i], 0.0) + min(d - low[i], 0.0)
        psi[i] = -w * (d + 2.0 * e * abs(e) / margin[i])
        rate[i] = -w * (1.0 + 4.0 * abs(e) / margin[i]) * v[i]
