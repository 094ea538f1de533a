"""One sample of the controller's filters together."""

from __future__ import annotations

import numpy as np

from .._compiled import compiled
from ..filters.low_pass import LowPass
from ..laws.law import Signals
from .state import ControllerState

Filtered = tuple[np.ndarray, np.ndarray, np.ndarray]


def advance_filters(
    state: ControllerState, signals: Signals, velocity: LowPass, acceleration: LowPass, dt: float
) -> Filtered:
    """Return W_k, xi and z after dt [s] with their inputs Y_p, lambda x + J v - Y_p a_k and the joint velocity held."""
    W_k, xi, z = np.empty(state.W_k.shape), np.empty(state.xi.shape), np.empty(state.z.shape)
    model, f_k, f_a = signals.kinematics, velocity.fraction(dt), acceleration.fraction(dt)
    _advance(
        state.W_k,
        model.Y_p,
        state.a_k,
        state.xi,
        signals.y,
        model.xd_hat,
        f_k,
        state.z,
        signals.v,
        f_a,
        W_k,
        xi,
        z,
    )
    return W_k, xi, z


@compiled(
    "void(f8[:,:], f8[:,:], f8[:], f8[:], f8[:], f8[:], f8, f8[:], f8[:], f8, f8[:,:], f8[:], f8[:])",
    fills=3,
)
def _advance(
    W_k: np.ndarray,
    Y_p: np.ndarray,
    a_k: np.ndarray,
    xi: np.ndarray,
    y: np.ndarray,
    xd_hat: np.ndarray,
    f_k: float,
    z: np.ndarray,
    v: np.ndarray,
    f_a: float,
    W_k_after: np.ndarray,
    xi_after: np.ndarray,
    z_after: np.ndarray,
) -> None:
    """Move each state the fraction f of its way to its input; the way of xi is y + y_p0, y_p0 = J v - Y_p a_k."""
    for i in range(len(xi)):
        way = y[i] + xd_hat[i]
        for j in range(len(a_k)):
            W_k_after[i, j] = W_k[i, j] + f_k * (Y_p[i, j] - W_k[i, j])
            way -= Y_p[i, j] * a_k[j]
        xi_after[i] = xi[i] + f_k * way
    for i in range(len(z)):
        z_after[i] = z[i] + f_a * (v[i] - z[i])
