"""Checks of what a user gives, shared by every part that takes some.

A number is a real one: no truth value, no text, not NaN. Sizes beyond ``LARGEST`` are refused where
they come in, as products of a few of them would overflow somewhere inside.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from numbers import Integral, Real
from reprlib import Repr
from types import UnionType
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from .exceptions import (
    GainError,
    InputError,
    did_you_mean,
)

ROUNDING = float(np.sqrt(np.finfo(float).eps))  # share of a size, or [m, rad, s], that is no more
_SINGLE = np.finfo(np.float32)  # whose range is that of a user's numbers, computed with in double
LARGEST, SMALLEST = float(_SINGLE.max), float(_SINGLE.tiny)  # the latter of positive ones
MOST_PARAMETERS = 10_000  # that are adapted; half or twice: where a mistyped number is refused

_FLOAT, _ARRAY = np.dtype(float), np.ndarray

_SHORT = Repr()
# characters of a value in a message; half, twice: shorter and longer messages
_SHORT.maxstring = _SHORT.maxother = 60


def shown(value: object) -> str:
    """Return a value as a message shows it, cut where it is long or deep."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    try:
        return _SHORT.repr(value)
    except (ValueError, RecursionError):  # an integer of more digits than Python writes
        return f"a value of type {type(value).__name__}"


def instance(
    value: Any, kind: type | UnionType, name: str, error: type[InputError] = InputError
) -> Any:
    """Return an object, checked to be of a kind.

    Raises:
        error: it is of another kind.
    """
    if not isinstance(value, kind):
        kinds = get_args(kind) or (kind,)
        wanted = " or ".join(each.__name__ for each in kinds).replace("NoneType", "None")
        article = "an" if wanted[0] in "AEIOU" else "a"
        raise error(f"expected {article} {wanted}, got {shown(value)}.", where=name)
    return value


def flag(value: Any, name: str) -> bool:
    """Return a truth value.

    Raises:
        InputError: anything but True and False.
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"expected True or False, got {shown(value)}.", where=name)
    return bool(value)


def word(value: Any, allowed: Iterable[str], name: str) -> str:
    """Return a word if it is one of those allowed.

    Raises:
        InputError: it is not; the nearest is suggested.
    """
    allowed = list(allowed)
    if not isinstance(value, str) or value not in allowed:
        raise InputError(
            f"must be one of {allowed}, got {shown(value)}.{did_you_mean(value, allowed)}",
            where=name,
        )
    return value


def name_list(value: Any, name: str, error: type[InputError] = InputError) -> list[str]:
    """Return one name, or a list of names, as a list.

    Raises:
        error: anything else.
    """
    lists = isinstance(value, Iterable) and not isinstance(value, str | bytes | Mapping)
    found = list(value) if lists else [value]
    if not all(isinstance(each, str) for each in found):
        raise error(f"expected a name or a list of names, got {shown(value)}.", where=name)
    return found


def mapping(value: Any, name: str, error: type[InputError] = InputError) -> Mapping[Any, Any]:
    """Return a mapping, an empty one for None.

    Raises:
        error: anything else.
    """
    if value is not None and not isinstance(value, Mapping):
        raise error(f"expected a mapping, got {shown(value)}.", where=name)
    return value or {}


def numbers(
    value: Any, name: str, *, error: type[InputError] = InputError, infinite: bool = False
) -> np.ndarray:
    """Return a number, list, or list of lists as a new array of floats, of any shape.

    Sizes beyond ``LARGEST`` are for limits, of which they say that there is none: ``infinite``.

    Raises:
        error: not numbers, ragged, NaN, or larger than ``LARGEST`` where these are no limits.
    """
    try:
        array = np.asarray(value)
    except ValueError:
        array = np.empty(0, dtype=object)
    entries = () if array is value else np.array(value, dtype=object).ravel()
    truths = any(isinstance(each, bool | np.bool_) for each in entries)
    if truths or array.dtype.kind not in "iuf":
        raise error(f"expected numbers, lists of one length, got {shown(value)}.", where=name)
    array = np.array(array, dtype=float)
    if not (np.abs(array) <= (np.inf if infinite else LARGEST)).all():
        finite = f"all entries must be finite, got {shown(array)}."
        raise error(_too_large(value) if np.isfinite(array).all() else finite, where=name)
    return array


def _too_large(value: Any) -> str:
    return f"is too large to compute with, over {LARGEST:.3g}: {shown(value)}."


def whole(
    value: Any,
    name: str,
    least: int,
    most: int = 2**63 - 1,
) -> int:
    """Return a whole number within the stated limits.

    Raises:
        InputError: another kind of value, too small, or too large for a counter of 64 bits.
    """
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise InputError(f"expected a whole number, got {shown(value)}.", where=name)
    number = int(value)
    if not least <= number <= most:
        edge = f"at least {least}" if number < least else f"at most {most}"
        raise InputError(f"must be {edge}, got {shown(value)}.", where=name)
    return number


def optional(module: str, extra: str, where: str, error: type[InputError] = InputError) -> Any:
    """Return a module that only an extra of this package brings.

    Raises:
        error: it cannot be imported; the message says how it is installed.
    """
    try:
        return import_module(module)
    except ImportError as reason:
        raise error(
            f"{module.partition('.')[0]} is not installed ({reason}).",
            where=where,
            hint=f'Install it: pip install "pinadapt[{extra}]".',
        ) from reason


@contextmanager
def arithmetic(where: str, error: type[InputError] = InputError) -> Iterator[None]:
    """Turn what breaks down in computing with a user's numbers into an error about them.

    Each of them may be in range, and a product of them or a decomposition fail nevertheless.

    Raises:
        error: an overflow, a division by zero, NaN, or a singular matrix inside.
    """
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"), warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            yield
    except (ArithmeticError, np.linalg.LinAlgError, RuntimeWarning) as reason:
        raise error(
            f"these numbers cannot be computed with ({reason}).",
            where=where,
            hint="Some are far too large or too small together: check their units.",
        ) from reason


def is_array(value: Any, shape: tuple[int, ...]) -> bool:
    """Return whether this is an array of native floats of a shape."""
    return value.__class__ is _ARRAY and value.dtype == _FLOAT and value.shape == shape


def vector(
    value: ArrayLike,
    size: int | None,
    name: str,
    *,
    names: Sequence[str] | None = None,
    error: type[InputError] = InputError,
    fills: bool = True,
    infinite: bool = False,
) -> np.ndarray:
    """Return ``value`` as a new vector (size), None: of any size; a number ``fills`` it.

    Raises:
        error: wrong size, or as ``numbers``.
    """
    array = numbers(value, name, error=error, infinite=infinite)
    if array.ndim == 0 and fills:
        array = np.full(1 if size is None else size, float(array))
    if array.ndim != 1 or size not in (None, array.size):
        count = "a list of" if size is None else size
        which = f" {list(names)}" if names else ""
        raise error(f"expected {count} numbers{which}, got shape {array.shape}.", where=name)
    return array


def joint_numbers(
    value: ArrayLike,
    name: str,
    size: int | None = None,
    *,
    zero: bool = True,
    infinite: bool = False,
    error: type[InputError] = InputError,
) -> np.ndarray:
    """Return one number for all joints, or one per joint, as an array of no or one dimension.

    With a size it is the vector (size) of all joints.

    Raises:
        error: not numbers, another size, negative ones, or zero where that is not allowed.
    """
    if size is None:
        array = numbers(value, name, error=error, infinite=infinite)
    else:
        array = vector(value, size, name, error=error, infinite=infinite)
    if array.ndim > 1 or (array < 0.0).any() or not (zero or array.all()):
        raise error(
            f"must {'not be negative' if zero else 'be positive'}, one number or one per joint, "
            f"got {shown(value)}.",
            where=name,
        )
    return array


def kept_numbers(
    value: ArrayLike, name: str, *, zero: bool = True, infinite: bool = False
) -> float | tuple[float, ...]:
    """Return ``joint_numbers`` as a number or a tuple, which records that do not change keep."""
    array = joint_numbers(value, name, zero=zero, infinite=infinite)
    return tuple(array.tolist()) if array.ndim else float(array)


def definite_matrix(value: ArrayLike, size: int, name: str) -> np.ndarray:
    """Return a scalar, list or matrix as a symmetric positive definite matrix (size, size).

    Asymmetry of the size of rounding errors is averaged out.

    Raises:
        GainError: wrong shape, no numbers, too large, asymmetric or not positive definite.
    """
    array = numbers(value, name, error=GainError)
    if array.shape in ((), (size,)):
        array = np.diag(np.broadcast_to(array, size))
    if array.shape != (size, size):
        raise GainError(
            f"expected a number, {size} numbers or a {size} x {size} matrix, got {array.shape}.",
            where=name,
        )
    # Relative to sqrt(a_ii a_jj), which bounds |a_ij| of a definite matrix, whatever units i and j
    # have; as a congruence this keeps definiteness.
    scale = np.sqrt(np.abs(np.diag(array)))
    sizes = np.outer(scale, scale)
    if (np.abs(array - array.T) > 1e-9 * np.maximum(sizes, np.abs(array))).any():
        raise GainError("the matrix must be symmetric.", where=name)
    array = 0.5 * (array + array.T)
    if not (scale.all() and (np.linalg.eigvalsh(array / sizes) > 0.0).all()):
        raise GainError(f"must be positive definite, got {shown(value)}.", where=name)
    return array


def positive(
    value: Any,
    name: str,
    *,
    zero: bool = False,
    most: float = np.inf,
    error: type[InputError] = GainError,
) -> float:
    """Return ``value`` as a finite positive float (or zero, where allowed), ``most`` at most.

    Raises:
        error: anything else, or a number beyond ``LARGEST`` or between zero and ``SMALLEST``.
    """
    if not isinstance(value, Real) or isinstance(value, bool):
        raise error(f"expected a number, got {shown(value)}.", where=name)
    size: Any = value  # an integer may be too large for a float
    if not size >= 0.0 or (size == 0.0 and not zero):
        raise error(
            f"must be {'zero or ' if zero else ''}positive, got {shown(value)}.", where=name
        )
    if size > LARGEST:
        raise error(_too_large(value), where=name)
    if size > most:
        raise error(f"must be at most {most:.4g}, got {shown(value)}.", where=name)
    if 0.0 < size < SMALLEST:
        raise error(f"is too small to compute with, under {SMALLEST:.3g}: {size}.", where=name)
    return float(value)


def take_checked(
    record: Any, check: Callable[..., Any], where: str, *names: str, **options: Any
) -> None:
    """Turn attributes of a frozen record that is being made into what a check here returns.

    Raises:
        InputError: as the check; ``where`` stands in front of the name.
    """
    for name in names:
        value = check(getattr(record, name), f"{where}{name}", **options)
        object.__setattr__(record, name, value)


@contextmanager
def located(path: str, names: Iterable[str] = (), others: Iterable[str] = ()) -> Iterator[None]:
    """Let errors raised inside name their place by a dotted path.

    Args:
        path: of the table or argument that is read inside.
        names: of what it holds.
        others: first words of places that stand for themselves, beside the path's own.

    Raises:
        InputError: the error raised inside, with its own type.
    """
    try:
        yield
    except InputError as error:
        place = error.where or ""
        head, _, rest = place.partition(".")
        if head == path.rpartition(".")[2]:
            place = f"{path}.{rest}" if rest else path
        elif place and head not in others:
            place = f"{path}{'.' if head in names else ': '}{place}"
        raise type(error)(error.what, where=place or path, hint=error.hint) from error
