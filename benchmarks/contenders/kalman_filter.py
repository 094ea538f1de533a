"""An extended Kalman filter of the inertias, in coordinates in which all of them are physical."""

from __future__ import annotations

from time import process_time

import numpy as np

from pinadapt.models.bodies import COLUMNS
from pinadapt.models.regressor import PER_BODY

from .estimation import Estimates, LearningProblem

# Deviation of a joint's coefficient at the start, in typical ones. Half and twice: the same to 1 %.
_TYPICAL = 10.0
_STORED = 0.02  # [s] between stored estimates
_ROWS, _COLUMNS = np.tril_indices(4)


def kalman_filter(
    problem: LearningProblem, noise: float = 20.0, deviation: float = 0.1, walk: float = 0.0
) -> Estimates:
    """Estimate bodies and joints sample by sample, from the error of the predicted torque.

    The pseudo-inertia of a body is P = L_0 X X^T L_0^T, P_0 = L_0 L_0^T the described one and X
    lower triangular with the diagonal exp(x_i): C. Rucker, P. M. Wensing, *Smooth parameterization
    of rigid-body inertia*, IEEE RA-L 7 (2022) 2771-2778. The state is x, a random walk, and the
    coefficients of the joints, which are constant. It starts from the description.

    Args:
        problem: the motion and the model.
        noise: of the torque of a sample in that of the problem, as errors last.
        deviation: of the coordinates of a body at the start; 0.1: its mass to 20 %.
        walk: deviation that a coordinate of a body gains in one second.
    """
    dynamics = problem.dynamics
    motion = problem.learned
    physical = problem.physical
    bodies = physical.bodies
    size = PER_BODY * physical.bodies
    roots = np.linalg.cholesky(physical.matrices(physical.center))
    tens = np.linalg.pinv(COLUMNS)
    x = np.concatenate([np.zeros(size), dynamics.initial[size:]])
    P = np.diag(np.concatenate([np.full(size, deviation), _TYPICAL * dynamics.typical[size:]]) ** 2)
    Q = np.diag(np.where(np.arange(len(x)) < size, walk**2 * motion.period, 0.0))
    R = np.diag((noise * problem.noise) ** 2)
    stored = list[tuple[float, np.ndarray]]()
    last = -np.inf
    started = process_time()
    for t, q, v, acceleration, tau in zip(*motion[:-1], strict=True):
        a, slope = parameters(x, roots, tens)
        Y = dynamics.regressor(q, v, acceleration)
        dynamics.load(a)
        H = Y.copy()
        H[:, :size] = np.einsum(
            "nbk,bkj->nbj", Y[:, :size].reshape(-1, bodies, PER_BODY), slope
        ).reshape(len(Y), size)
        P += Q
        HP = H @ P
        K = np.linalg.solve(R + HP @ H.T, HP).T
        x = x + K @ (tau - dynamics.torque(q, v, acceleration))
        P -= K @ HP
        P = 0.5 * (P + P.T)
        if t - last >= _STORED:
            last = t
            stored.append((t, a))
    seconds = process_time() - started
    stored.append((float(motion.t[-1]), parameters(x, roots, tens)[0]))
    t, found = (np.array(part) for part in zip(*stored, strict=True))
    return Estimates(t, found, seconds)


def parameters(x: np.ndarray, roots: np.ndarray, tens: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the parameters (p) and the derivative (k, 10, 10) of each body's by its coordinates.

    Args:
        x: (p) coordinates of k bodies, then coefficients of joints.
        roots: (k, 4, 4) L_0 of the bodies.
        tens: (16, 10) the ten parameters of a pseudo-inertia.
    """
    size = PER_BODY * len(roots)
    X = np.zeros((len(roots), 4, 4))
    X[:, _ROWS, _COLUMNS] = x[:size].reshape(-1, PER_BODY)
    diagonal = np.arange(4)
    X[:, diagonal, diagonal] = np.exp(X[:, diagonal, diagonal])
    L = roots @ X
    # column _COLUMNS of L changes by the column _ROWS of L_0, times exp(x) on the diagonal
    rates = roots[:, :, _ROWS].swapaxes(1, 2)
    rates = rates * np.where(_ROWS == _COLUMNS, X[:, _ROWS, _COLUMNS], 1.0)[:, :, None]
    half = rates[:, :, :, None] * L[:, :, _COLUMNS].swapaxes(1, 2)[:, :, None, :]
    slope = (half + half.swapaxes(2, 3)).reshape(len(roots), PER_BODY, 16) @ tens
    found = (L @ L.swapaxes(1, 2)).reshape(len(roots), 16) @ tens
    return np.concatenate([found.ravel(), x[size:]]), slope.swapaxes(1, 2)
