"""The dynamic parameters that a motion's windows tell, weighed by what they leave of each joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..models.dynamics import Dynamics
from ..models.regressor import PER_BODY
from ..rollout.information import Information
from .physical_fit import PhysicalSet, physical_fit
from .windows import Windows

_START, _FLOOR = 0.05, 1e-4  # noise at first and at least, as a share of a joint's torque
_ROUNDS = 3
_LIGHTEST, _TINY = 1e-6, 1e-300


def torque_fit(dynamics: Dynamics, physical: PhysicalSet, windows: Windows) -> Information:
    """Return the physical least-squares estimate of all parameters, and what is known of it.

    The noise of a joint is what the parameters leave of its torque, found in rounds. Windows
    overlap, and what no parameter explains goes on from one to the next: at the end a joint's rows
    count as fewer independent ones by the sum of the residual's autocorrelation.
    """
    level = np.sqrt(np.mean(windows.tau**2, axis=0)) if len(windows.t) else np.zeros(0)
    level = np.maximum(level, 1e-12 * max(level.max(initial=0.0), 1e-300))
    noise, a, rows = _START * level, physical.center, windows.y.size
    if not dynamics.size:
        return Information((), a, np.zeros((0, 0)), a, level, rows)
    physical = replace(physical, weights=_weights(physical, windows))
    for last in (*(False,) * _ROUNDS, True):
        A, b = _whitened(windows, noise)
        a = physical_fit(A, b, physical)
        left = windows.residual(a)
        told = min(np.linalg.matrix_rank(A, tol=1e-8 * np.linalg.norm(A)), rows - 1)
        spread = np.sqrt(np.mean(left**2, axis=0) / (1.0 - told / rows))
        noise = np.maximum(spread * (np.sqrt(_repeated(left)) if last else 1.0), _FLOOR * level)
    A, b = _whitened(windows, noise)
    pull = A.T @ (b - A @ a)
    return Information(tuple(dynamics.names), a, A.T @ A, pull, noise, rows)


def _weights(physical: PhysicalSet, windows: Windows) -> np.ndarray:
    """Return w: coefficients over those that would explain all of a joint's torque, at most one."""
    columns = windows.W[:, :, PER_BODY * physical.bodies :]
    joints = np.argmax(np.abs(columns).sum(axis=0), axis=0)  # each shows in one
    seen = np.array([np.linalg.norm(columns[:, j, k]) for k, j in enumerate(joints)])
    whole = np.linalg.norm(windows.tau, axis=0)[joints]
    shares = physical.coefficients(physical.center) * seen / np.maximum(whole, _TINY)
    return np.asarray(np.clip(shares, _LIGHTEST, 1.0))


def _whitened(windows: Windows, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (N n, p) and right-hand side (N n) in units of the noise (n)."""
    A = windows.W / noise[:, None]
    return A.reshape(windows.y.size, A.shape[-1]), (windows.y / noise).ravel()


def _repeated(left: np.ndarray) -> np.ndarray:
    """Return how many rows (n) of a residual (N, n) tell as much as one that is independent.

    One and twice the autocorrelation up to where it first is negative (Geyer's initial sequence).
    """
    found = np.ones(left.shape[1])
    for j, column in enumerate((left - left.mean(axis=0)).T):
        size = float(column @ column)
        for lag in range(1, len(column) // 2):
            correlation = float(column[lag:] @ column[:-lag]) / size if size else 0.0
            if correlation <= 0.0:
                break
            found[j] += 2.0 * correlation
    return found
