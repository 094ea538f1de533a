"""Gains of laws, checked against the hypotheses of their proofs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import definite_matrix, positive
from ..exceptions import GainError, did_you_mean
from ..tasks.task import Task

NAMES = (
    "Kv",
    "Kp",
    "alpha",
    "beta",
    "R_k",
    "Q",
    "lambda_",
    "lambda_a",
    "lambda_s",
    "lag",
    "posture",
    "width",
    "weight",
    "bound",
    "gravity",
)  # as users write them
SYMBOLS = {"Kv": "K_v", "Kp": "K_P"}  # what the laws call those that they call otherwise
_TASK_GAINS = {symbol: name for name, symbol in SYMBOLS.items()}


def task_gain(value: ArrayLike, task: Task, name: str, *, copies: int = 1) -> np.ndarray:
    """Return a gain matrix (m k, m k) of a task of size m, k = ``copies``.

    A number is a multiple of the identity, a list a diagonal.

    Raises:
        GainError: not positive definite, of another size, or on the rotations of a pose no multiple
            of the identity.
    """
    gain, m = definite_matrix(value, copies * task.size, name), task.size
    turning = [group.rows for group in task.groups if group.name == "rotation"]
    for rows in turning:
        for i in range(copies):
            for j in range(copies):
                _check_rotations(gain[i * m : (i + 1) * m, j * m : (j + 1) * m], rows.start, name)
    return gain


def check_in_place(law: Any, *names: str) -> None:
    """Turn gains of a frozen law that is being made into what they are checked to be.

    K_v and K_P are gains of the task, R_k is a weight of its positions (m_p, m_p), all others are
    positive numbers.

    Raises:
        GainError: one of them is not, or of another size.
    """
    task: Task = law.task
    for name in names:
        value, shown = getattr(law, name), name.rstrip("_")
        if name in _TASK_GAINS:
            value = task_gain(value, task, _TASK_GAINS[name])
        elif name == "R_k":
            value = definite_matrix(value, task.positions, shown)
        else:
            value = positive(value, shown)
        object.__setattr__(law, name, value)


def check_margin(K_v: np.ndarray, alpha: float) -> None:
    """Refuse gains without K_v - alpha I > 0.

    Raises:
        GainError: K_v - alpha I is not positive definite.
    """
    beta = np.linalg.eigvalsh(K_v)[0] - alpha
    if beta <= 0.0:
        raise GainError(
            f"K_v - alpha I must be positive definite; its smallest eigenvalue is {beta:.4g}.",
            where="alpha",
            hint=f"Take alpha below {beta + alpha:.4g}, or a larger Kv.",
        )


def merged(defaults: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the defaults of a law's gains with the given ones in their place, by its own symbols.

    None gives nothing; gains that only other laws have are left out, so that one set of gains
    serves for a comparison of laws; ``make_controller`` names them.

    Raises:
        GainError: a gain that no law has; the nearest is suggested.
    """
    for name in given:
        if name not in NAMES:
            raise GainError(
                f"no gain is called '{name}'; there are {list(NAMES)}.{did_you_mean(name, NAMES)}",
                where=name,
            )
    own = {
        name: default if given.get(name) is None else given[name]
        for name, default in defaults.items()
    }
    return {SYMBOLS.get(name, name): gain for name, gain in own.items()}


def _check_rotations(block: np.ndarray, first: int, name: str) -> None:
    """Refuse a block (m, m) whose rows from ``first`` on are not one number times the identity."""
    expected = np.zeros_like(block)
    expected[:first, :first] = block[:first, :first]
    turning = np.arange(first, len(block))
    expected[turning, turning] = block[first, first]
    if not np.allclose(block, expected, rtol=1e-9, atol=1e-9 * np.abs(block).max()):
        raise GainError(
            "the rotation rows must be one number times the identity, not coupled to the position: "
            "phi^T K delta = 0, on which the proof for a pose rests, holds for such gains only.",
            where=name,
            hint=f"Give one number, or {len(block)} numbers whose last {turning.size} are equal.",
        )
