"""The gains that the task-space laws share, checked against their hypotheses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .._checks import definite_matrix, positive
from ..exceptions import GainError


@dataclass(frozen=True, eq=False)
class Gains:
    """Gains of Wang and Xie (2009) for m task coordinates.

    Attributes: K_v: (m, m) velocity gain [1/s]. K_P: (m, m) position gain [1/s^2]. alpha: weight of
        the position error in e = dxd_hat + alpha dx [1/s]. R_k: (m_p, m_p) weight of the kinematic
        prediction error; m_p = m, or the 3 positions of a pose. Q: (2 m, 2 m) right-hand side of
        the Lyapunov equation of the law with task velocity.
    """

    K_v: np.ndarray
    K_P: np.ndarray
    alpha: float
    R_k: np.ndarray
    Q: np.ndarray

    @classmethod
    def checked(
        cls,
        size: int,
        K_v: ArrayLike,
        K_P: ArrayLike,
        alpha: float,
        R_k: ArrayLike = 1.0,
        Q: ArrayLike | None = None,
        *,
        margin: bool = True,
        positions: int | None = None,
    ) -> Gains:
        """Take numbers, lists or matrices for m = ``size`` task coordinates.

        Q defaults to diag(2 alpha K_P, 2 (K_v - alpha I)), for which B^T P xi = dxd + alpha dx, the
        error e of the other laws.

        ``margin`` asks for K_v - alpha I > 0, which the laws on the estimated velocity error need.
        Rows after the first ``positions`` (all of them by default) are rotations; see ``PoseTask``
        for what their gains have to be.

        Raises: GainError: not positive (definite), wrong size, K_v - alpha I not positive definite,
            or gains on rotations that are no multiple of the identity.
        """
        places = size if positions is None else positions
        velocity, position = definite_matrix(K_v, size, "Kv"), definite_matrix(K_P, size, "Kp")
        weight = positive(alpha, "alpha")
        beta = np.linalg.eigvalsh(velocity)[0] - weight
        if margin and beta <= 0.0:
            raise GainError(
                f"K_v - alpha I must be positive definite; its smallest eigenvalue is {beta:.4g}.",
                where="alpha",
                hint=f"Take alpha below {beta + weight:.4g}, or a larger Kv.",
            )
        if Q is None:
            from scipy.linalg import block_diag  # here, because scipy is slow to import

            Q = (
                block_diag(2.0 * weight * position, 2.0 * (velocity - weight * np.eye(size)))
                if beta > 0.0
                else 1.0
            )
        weights = definite_matrix(Q, 2 * size, "Q")
        for name, K in (("Kv", velocity), ("Kp", position), ("Q", weights)):
            for block in (
                K[i : i + size, j : j + size]
                for i in range(0, len(K), size)
                for j in range(0, len(K), size)
            ):
                _check_rotations(block, places, name)
        return cls(velocity, position, weight, definite_matrix(R_k, places, "R_k"), weights)


def _check_rotations(block: np.ndarray, places: int, name: str) -> None:
    """Refuse a block (m, m) whose rows after the first ``places`` are not one number times the identity."""
    expected = np.zeros_like(block)
    expected[:places, :places] = block[:places, :places]
    turning = np.arange(places, len(block))
    expected[turning, turning] = block[places, places] if turning.size else 0.0
    if not np.allclose(block, expected, rtol=1e-9, atol=1e-9 * np.abs(block).max()):
        raise GainError(
            "the rotation rows must be one number times the identity, not coupled to the position: phi^T K delta = 0, on "
            "which the proof for a pose rests, holds for such gains only.",
            where=name,
            hint=f"Give one number, or {len(block)} numbers whose last {turning.size} are equal.",
        )
