"""Checks of a user's numbers, shared by every part that takes some."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .exceptions import GainError, InputError

_ASYMMETRY = 1e-9  # relative difference of two entries that counts as rounding


def vector(
    value: ArrayLike,
    size: int,
    name: str,
    *,
    names: Sequence[str] | None = None,
    error: type[InputError] = InputError,
) -> np.ndarray:
    """Return ``value`` as a new finite vector (size); a scalar fills it.

    Raises:
        error: wrong size, not numbers, or non-finite entries.
    """
    expected = f" {list(names)}" if names is not None else ""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as reason:
        raise error(f"expected {size} numbers{expected}, got {value!r}.", where=name) from reason
    if array.ndim == 0:
        array = np.full(size, float(array))
    if array.shape != (size,):
        raise error(f"expected {size} numbers{expected}, got shape {array.shape}.", where=name)
    if not np.isfinite(array).all():
        raise error(f"all entries must be finite, got {array.tolist()}.", where=name)
    return array


def definite_matrix(value: ArrayLike, size: int, name: str) -> np.ndarray:
    """Return a scalar, list or matrix as a symmetric positive definite matrix (size, size).

    Asymmetry of the size of rounding errors is averaged out.

    Raises:
        GainError: wrong shape, non-finite, asymmetric or not positive definite.
    """
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as reason:
        raise GainError(
            f"expected a number, a list or a matrix, got {value!r}.", where=name
        ) from reason
    if not np.isfinite(array).all():
        raise GainError("all entries must be finite.", where=name)
    if array.ndim == 0:
        array = np.eye(size) * array
    elif array.shape == (size,):
        array = np.diag(array)
    if array.shape != (size, size):
        raise GainError(
            f"expected a number, {size} numbers or a {size} x {size} matrix, got {array.shape}.",
            where=name,
        )
    # Relative to sqrt(a_ii a_jj), which bounds |a_ij| of a definite matrix, whatever units i and j
    # have; as a congruence this keeps definiteness.
    scale = np.sqrt(np.abs(np.diag(array)))
    sizes = np.outer(scale, scale)
    if (np.abs(array - array.T) > _ASYMMETRY * np.maximum(sizes, np.abs(array))).any():
        raise GainError("the matrix must be symmetric.", where=name)
    array = 0.5 * (array + array.T)
    if size and not (scale.all() and np.linalg.eigvalsh(array / sizes)[0] > 0.0):
        lowest = np.linalg.eigvalsh(array)[0]
        raise GainError(
            f"must be positive definite; its smallest eigenvalue is {lowest:.4g}.", where=name
        )
    return array


def positive(value: Any, name: str, *, zero: bool = False) -> float:
    """Return ``value`` as a finite positive float (or zero, where allowed).

    Raises:
        GainError: anything else.
    """
    try:
        number = float(value)
    except (TypeError, ValueError) as reason:
        raise GainError(f"expected a number, got {value!r}.", where=name) from reason
    if not np.isfinite(number) or number < 0.0 or (number == 0.0 and not zero):
        raise GainError(
            f"must be {'zero or ' if zero else ''}positive, got {number:g}.", where=name
        )
    return number
