"""Recursive least squares of base parameters, with exponential forgetting."""

from __future__ import annotations

from time import process_time

import numpy as np

from .estimation import Estimates, LearningProblem

# Variance of every base parameter at the start, in SI units; with 100 and 1e6 errors are the same.
_VARIANCE = 1e4
_STORED = 0.02  # [s] between stored estimates


def recursive_least_squares(problem: LearningProblem, memory: float = np.inf) -> Estimates:
    """Estimate base parameters sample by sample.

        K = P Y^T (l R + Y P Y^T)^-1,  b <- b + K (tau - Y b),  P <- (P - K Y P) / l

    with l = exp(-dt / memory): L. Ljung, *System Identification* (1999), section 11.2. The other
    parameters stay as described.

    Args:
        problem: the motion and the model.
        memory: time in which old samples lose all but 1 / e of their weight [s].
    """
    dynamics = problem.dynamics
    base = problem.base
    motion = problem.learned
    R = np.diag(problem.noise**2)
    P = _VARIANCE * np.eye(len(base))
    a = dynamics.initial.copy()
    stored = list[tuple[float, np.ndarray]]()
    last = -np.inf
    dynamics.load(a)
    started = process_time()
    left = np.exp(-motion.period / memory)
    change = np.zeros(len(base))
    for t, q, v, acceleration, tau in zip(*motion[:-1], strict=True):
        Y = dynamics.regressor(q, v, acceleration)[:, base]
        YP = Y @ P
        error = tau - dynamics.torque(q, v, acceleration) - Y @ change
        K = np.linalg.solve(left * R + YP @ Y.T, YP).T
        change += K @ error
        P = (P - K @ YP) / left
        P = 0.5 * (P + P.T)
        if t - last >= _STORED:
            last = t
            stored.append((t, change.copy()))
    seconds = process_time() - started
    stored.append((float(motion.t[-1]), change))
    t, changes = (np.array(part) for part in zip(*stored, strict=True))
    found = np.tile(a, (len(t), 1))
    found[:, base] += changes
    return Estimates(t, found, seconds)
