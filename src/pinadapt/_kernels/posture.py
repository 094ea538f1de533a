"""The return to a rest posture, away from limits."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled


@compiled("void(f8[:], f8[:,:], f8[:])")
def posture_offset(q: np.ndarray, posture: np.ndarray, offset: np.ndarray) -> None:
    """Write d + 2 e |e| / margin (n), d = q - rest, e how far d is outside of [low, high].

    Rows of the posture (4, n): rest, low, high, margin.
    """
    for i in range(len(offset)):
        d = q[i] - posture[0, i]
        e = max(d - posture[2, i], 0.0) + min(d - posture[1, i], 0.0)
        offset[i] = d + 2.0 * e * abs(e) / posture[3, i]


@compiled("void(f8[:], f8[:,:], f8[:], f8, f8[:], f8[:])", fills=2)
def posture_velocity(
    q: np.ndarray, posture: np.ndarray, v: np.ndarray, w: float, psi: np.ndarray, rate: np.ndarray
) -> None:
    """Write psi = -w ``posture_offset`` and its rate -w (1 + 4 |e| / margin) v, both (n)."""
    for i in range(len(v)):
        d = q[i] - posture[0, i]
        e = max(d - posture[2, i], 0.0) + min(d - posture[1, i], 0.0)
        psi[i] = -w * (d + 2.0 * e * abs(e) / posture[3, i])
        rate[i] = -w * (1.0 + 4.0 * abs(e) / posture[3, i]) * v[i]
