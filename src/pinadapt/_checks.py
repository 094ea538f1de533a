"""Checks of what a user gives, shared by every part that takes some.

A number is a real one: no truth value, no text, not NaN. Sizes beyond ``LARGEST`` are refused where
they come in, as products of a few of them would overflow somewhere inside.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial, wraps
from inspect import Parameter, isfunction, signature
from numbers import Integral, Real
from reprlib import Repr
from types import UnionType
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from .exceptions import (
    ArrayError,
    GainError,
    InputError,
    PinadaptError,
    RobotError,
    did_you_mean,
)

LARGEST, SMALLEST = 1e30, 1e-30  # of a user's number, and of one that is to be positive
MOST_SAMPLES, MOST_PARAMETERS = 100_000, 10_000  # that are drawn, or adapted

_ASYMMETRY = 1e-9  # relative difference of two entries that counts as rounding
C = TypeVar("C", bound=Callable[..., Any])
R = TypeVar("R")

_SHORT = Repr()
_SHORT.maxlong, _SHORT.maxstring, _SHORT.maxother = 24, 60, 60


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
    """Return an object if it is of a kind.

    Raises:
        error: it is not.
    """
    if not isinstance(value, kind):
        kinds = kind.__args__ if isinstance(kind, UnionType) else (kind,)
        wanted = " or ".join(each.__name__ for each in kinds)
        article = "an" if wanted[0] in "AEIOU" else "a"
        wanted = wanted.replace("NoneType", "None")
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
    if isinstance(value, str):
        return [value]
    if isinstance(value, Mapping | bytes) or not isinstance(value, Iterable):
        raise error(f"expected a name or a list of names, got {shown(value)}.", where=name)
    found = list(value)
    if not all(isinstance(each, str) for each in found):
        raise error(f"expected a name or a list of names, got {shown(found)}.", where=name)
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
        given = np.asarray(value)
        if given.dtype == object:  # integers too long for numpy; a mixture stays one
            given = np.array([float(_real(each)) for each in given.flat]).reshape(given.shape)
        elif given.dtype.kind not in "iuf" or (
            given is not value and any(isinstance(each, bool | np.bool_) for each in _leaves(value))
        ):
            raise TypeError
        array = np.array(given, dtype=float)
    except OverflowError as reason:
        raise error(_too_large(value), where=name) from reason
    except (TypeError, ValueError) as reason:
        rows = isinstance(value, list | tuple) and any(isinstance(x, list | tuple) for x in value)
        alike = ", each row with the same number of entries" if rows else ""
        raise error(f"expected numbers{alike}, got {shown(value)}.", where=name) from reason
    if infinite and not np.isnan(array).any():
        return array
    if not np.isfinite(array).all():
        raise error(f"all entries must be finite, got {shown(array)}.", where=name)
    if (np.abs(array) > LARGEST).any():
        raise error(_too_large(value), where=name)
    return array


def _leaves(value: Any) -> Iterator[Any]:
    """Return the entries of nested lists."""
    if isinstance(value, list | tuple):
        for each in value:
            yield from _leaves(each)
    else:
        yield value


def _real(value: Any) -> Any:
    if not isinstance(value, Real) or isinstance(value, bool | np.bool_):
        raise TypeError
    return value


def _too_large(value: Any) -> str:
    return f"is too large to compute with, over {LARGEST:g}: {shown(value)}."


def whole(
    value: Any,
    name: str,
    least: int,
    error: type[InputError] = InputError,
    most: int = 2**63 - 1,
) -> int:
    """Return a whole number within the stated limits.

    Raises:
        error: another kind of value, too small, or too large for a counter of 64 bits.
    """
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise error(f"expected a whole number, got {shown(value)}.", where=name)
    number = int(value)
    if not least <= number <= most:
        edge = f"at least {least}" if number < least else f"at most {most}"
        raise error(f"must be {edge}, got {shown(value)}.", where=name)
    return number


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


def vector(
    value: ArrayLike,
    size: int | None,
    name: str,
    *,
    names: Sequence[str] | None = None,
    error: type[InputError] = InputError,
    fills: bool = True,
) -> np.ndarray:
    """Return ``value`` as a new finite vector (size), None: of any size; a number ``fills`` it.

    Raises:
        error: wrong size, not numbers, non-finite entries, or too large ones.
    """
    try:
        array = numbers(value, name, error=error)
    except InputError as reason:
        if not reason.what.startswith("expected numbers"):
            raise
        array = np.empty((0, 0))
    if array.ndim == 0 and fills:
        array = np.full(1 if size is None else size, float(array))
    if array.ndim != 1 or size not in (None, array.size):
        expected = f" {list(names)}" if names is not None else ""
        got = f"shape {array.shape}" if array.shape != (0, 0) else shown(value)
        count = "a list of" if size is None else size
        raise error(f"expected {count} numbers{expected}, got {got}.", where=name)
    return array


def definite_matrix(value: ArrayLike, size: int, name: str) -> np.ndarray:
    """Return a scalar, list or matrix as a symmetric positive definite matrix (size, size).

    Asymmetry of the size of rounding errors is averaged out.

    Raises:
        GainError: wrong shape, no numbers, too large, asymmetric or not positive definite.
    """
    array = numbers(value, name, error=GainError)
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
    if (scale**2 < SMALLEST).any() and scale.all():
        raise GainError(f"is too small to compute with, under {SMALLEST:g}.", where=name)
    if size and not (scale.all() and np.linalg.eigvalsh(array / sizes)[0] > 0.0):
        lowest = np.linalg.eigvalsh(array)[0]
        raise GainError(
            f"must be positive definite; its smallest eigenvalue is {lowest:.4g}.", where=name
        )
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
    if not isinstance(value, Real) or isinstance(value, bool | np.bool_):
        raise error(f"expected a number, got {shown(value)}.", where=name)
    try:
        number = float(value)
    except OverflowError as reason:
        raise error(_too_large(value), where=name) from reason
    if not np.isfinite(number) or number < 0.0 or (number == 0.0 and not zero):
        raise error(f"must be {'zero or ' if zero else ''}positive, got {number:g}.", where=name)
    if number > most:
        raise error(f"must be at most {most:.4g}, got {number:g}.", where=name)
    if number > LARGEST:
        raise error(_too_large(number), where=name)
    if 0.0 < number < SMALLEST:
        raise error(f"is too small to compute with, under {SMALLEST:g}: {number:g}.", where=name)
    return number


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


_FLOAT = np.dtype(float)
_OBJECTS = {
    *("Robot", "Estimate", "Drive", "Drives", "Signals", "Truth", "EstimatedModel"),
    *("Measurement", "Desired", "ControllerState", "FilteredTorque", "TorqueFilterState"),
    *("Model", "Data"),  # of Pinocchio
}
_UNCHECKED = "_unchecked"
_RULES: dict[str, tuple[str, Callable[[float], bool]]] = {
    "finite": ("a finite number", lambda number: True),
    ">=0": ("a finite number, zero or positive", lambda number: number >= 0.0),
    ">0": ("a positive finite number", lambda number: number > 0.0),
}
_Check = Callable[[Any, Any, dict[str, int]], Any]


class Doors:
    """Public methods that check what they are given, in all subclasses, and cost nothing in a step.

    Every public method of a subclass is wrapped. A method that runs in each control step has a twin
    without a door, which the library calls there: ``torque_unchecked`` of ``torque``. The class
    that introduces the method says so by ``torque_unchecked = torque``; a subclass that overrides
    ``torque`` gets the twin of its own.

    Arrays and numbers are checked by the names of the arguments, objects by their annotations.
    Numbers of another kind and lists become arrays of floats; they may be infinite or NaN, as those
    of a run that diverged.

    Attributes:
        shapes: as "q: nq, X: size l, estimate.value: size, dt: >=0": an argument or a part of one,
            and its lengths, each a number, an attribute of the object, or any other word. Lengths
            of the same word must be equal in one call. A number may have to be "finite", or ">=0"
            or ">0" and finite. "... n" are arrays of any number of axes, of which the last has the
            length n. Arrays that are not named may have any shape.
        own_checks: methods that check their arguments themselves.
    """

    __slots__ = ()
    shapes: ClassVar[str] = ""
    own_checks: ClassVar[frozenset[str]] = frozenset()

    def __init_subclass__(cls, **options: Any) -> None:
        """Wrap the methods that the subclass defines."""
        super().__init_subclass__(**options)
        for name, method in list(vars(cls).items()):
            private = name.startswith("_") and name != "__call__"
            if private or name.endswith(_UNCHECKED) or name in cls.own_checks:
                continue
            inside = getattr(method, _UNCHECKED, method)  # of a door that another class has made
            if hasattr(cls, name + _UNCHECKED):
                abstract = getattr(inside, "__isabstractmethod__", False)
                setattr(cls, name + _UNCHECKED, _not_implemented if abstract else inside)
            if isfunction(method) and inside is method:
                above = getattr(super(cls, cls), name, None)
                setattr(cls, name, _with_door(method, cls.shapes, above))

    def _flaw(self, value: Any) -> str | None:
        """Return what else is wrong with an object of the right class and sizes, or None."""
        return None


def _not_implemented(self: Any, *args: Any, **given: Any) -> Any:
    """Stand for the twin of an abstract method, so that Python asks for the method alone."""
    raise NotImplementedError


def _with_door(method: Callable[..., R], of_class: str, above: Any) -> Callable[..., R]:
    """Return a method that checks its arguments first, or itself if there is nothing to check.

    Args:
        method: of a class.
        of_class: its attribute ``shapes``.
        above: the method that it overrides, whose annotations hold where it has none; or None.
    """
    shapes = dict(each.split(": ") for each in of_class.split(", ") if each)
    inherited = signature(above).parameters if isfunction(above) else {}
    checks = {}
    for each in list(signature(method).parameters.values())[1:]:
        bare = each.annotation is Parameter.empty and each.name in inherited
        typed = inherited[each.name] if bare else each
        checks[each.name] = _check_of(typed, shapes, method.__name__)
    if not any(checks.values()):
        return method
    in_order = list(checks.values())

    @wraps(method)
    def checked(self: Any, *args: Any, **given: Any) -> R:
        """Call the method with arguments of the right kind and size."""
        found: dict[str, int] = {}
        positional = [
            value if check is None else check(self, value, found)
            for check, value in zip(in_order, args, strict=False)
        ]
        for name, value in given.items():
            check = checks.get(name)
            given[name] = value if check is None else check(self, value, found)
        try:
            return method(self, *positional, *args[len(in_order) :], **given)
        except PinadaptError:
            raise
        except (TypeError, ValueError, IndexError, ArithmeticError) as reason:
            of_python = isinstance(reason, TypeError) and type(reason) is TypeError
            if of_python or not of_computing(reason):
                raise
            raise ArrayError(
                f"these arrays or numbers cannot be computed with ({one_line(reason)}).",
                where=f"{type(self).__name__}.{method.__name__}",
                hint="Are their sizes those of one robot, and their values of a usual size?",
            ) from reason

    setattr(checked, _UNCHECKED, method)
    return checked


_COMPUTING = ("pinadapt", "numpy", "scipy", "pinocchio", "numba")


def of_computing(reason: BaseException) -> bool:
    """Tell whether an error comes from computations of the library, not from a user's own code."""
    trace = reason.__traceback__
    while trace is not None:
        if str(trace.tb_frame.f_globals.get("__name__")).partition(".")[0] not in _COMPUTING:
            return False
        trace = trace.tb_next
    return True


def one_line(reason: BaseException) -> str:
    """Return the last line of an error's message, cut where it is long."""
    return shown((str(reason).strip().splitlines() or [type(reason).__name__])[-1])


def _check_of(parameter: Parameter, shapes: Mapping[str, str], method: str) -> _Check | None:
    """Return what checks and converts an argument (object, value, known lengths), or None."""
    given = parameter.annotation
    words = given.__name__ if isinstance(given, type) else str(given)
    kinds = [kind.strip().rpartition(".")[2] for kind in words.split("|")]
    name, kind = parameter.name, kinds[0]
    optional, asked = "None" in kinds or parameter.default is None, shapes.get(name)
    lengths = None if asked is None else _parsed(asked)
    where = partial(_place, f"{method}: {name}")
    parts = [
        (part.split(".")[1], partial(_place, f"{method}: {part}"), _parsed(its))
        for part, its in shapes.items()
        if part.startswith(f"{name}.")
    ]

    def array(owner: Any, value: Any, found: dict[str, int]) -> Any:
        """Return an array of floats of the stated lengths."""
        if value is None and optional:
            return None
        return _sized(value, lengths, owner, found, where)

    def number(owner: Any, value: Any, found: dict[str, int]) -> Any:
        """Return a number."""
        if value is None and optional:
            return None
        return _one_number(value, asked, where(owner))

    def count(owner: Any, value: Any, found: dict[str, int]) -> int:
        """Return a whole number."""
        return whole(value, where(owner), 0, most=MOST_SAMPLES)

    def thing(owner: Any, value: Any, found: dict[str, int]) -> Any:
        """Return an object of the right class whose parts have the stated lengths."""
        if value is None and optional:
            return None
        if kind not in _names_of(value.__class__):
            refuse = RobotError if kind == "Robot" else InputError
            raise refuse(f"expected a {kind}, got {shown(value)}.", where=where(owner))
        may_lack = getattr(value, "_optional", getattr(value, "_field_defaults", ()))
        for part, place, its in parts:
            inner = getattr(value, part)
            if inner is None and part in may_lack:
                continue
            if not isinstance(inner, np.ndarray) or inner.dtype != _FLOAT:
                words = f"expected an array of floats, got {shown(inner)}."
                raise InputError(words, where=place(owner))
            _sized(inner, its, owner, found, place)
        if flaw := owner._flaw(value):
            raise InputError(flaw, where=where(owner))
        return value

    if "ndarray" in kinds:
        return array
    if kind in _OBJECTS:
        return thing
    return {"float": number, "int": count}.get(kind)


def _place(words: str, owner: Any) -> str:
    """Return the place of an argument of an object's method, for messages."""
    return f"{type(owner).__name__}.{words}"


@lru_cache(maxsize=256)
def _names_of(kind: type) -> frozenset[str]:
    """Return the names of a class and of those that it inherits from."""
    return frozenset(each.__name__ for each in kind.__mro__)


_Length = tuple[str, int | None, tuple[str, ...]]  # a word, and the number or the path it may be


def _parsed(lengths: str) -> tuple[_Length, ...]:
    """Return the words of lengths, each with its number or with the names of its attribute."""
    return tuple(
        (word_, int(word_) if word_.isdigit() else None, tuple(word_.split(".")))
        for word_ in lengths.split()
    )


_ANY_AXES = "..."


def _sized(
    value: Any,
    lengths: tuple[_Length, ...] | None,
    owner: Any,
    found: dict[str, int],
    where: Callable[[Any], str],
) -> np.ndarray:
    """Return an array of floats of the stated lengths; remember those that are met first."""
    array = value
    if value.__class__ is not np.ndarray or value.dtype is not _FLOAT:
        array = _floats(value)
        if array is None:
            raise InputError(f"expected numbers, got {shown(value)}.", where=where(owner))
    checked: np.ndarray = array
    if lengths is None:
        return checked
    shape = checked.shape
    if lengths and lengths[0][0] == _ANY_AXES:
        lengths = lengths[1:]
        shape = shape[max(len(shape) - len(lengths), 0) :]
    if len(lengths) == len(shape):
        for (word_, number, path), length in zip(lengths, shape, strict=True):
            if word_ not in found:
                own = _attribute(owner, path) if number is None else number
                found[word_] = length if own is None else own
            if found[word_] != length:
                break
        else:
            return checked
    known = [f"{found[each]}" if each in found else each.strip("_") for each, _, _ in lengths]
    raise InputError(
        f"expected an array of shape ({', '.join(known)}{',' * (len(known) == 1)}), got "
        f"{checked.shape}.",
        where=where(owner),
    )


def _floats(value: Any) -> np.ndarray | None:
    """Return integers or floats of any kind, or lists of them, as an array of floats, or None."""
    try:
        array = np.asarray(value)
        return array.astype(float) if array.dtype.kind in "iuf" else None
    except (TypeError, ValueError, OverflowError):
        return None


def _attribute(owner: Any, path: tuple[str, ...]) -> int | None:
    """Return a whole number among the attributes of an object, or None."""
    for name in path:
        owner = getattr(owner, name, None)
    if owner.__class__ is int:  # soonest told
        number: int = owner
        return number
    return int(owner) if isinstance(owner, Integral) else None


def _one_number(value: Any, asked: str | None, where: str) -> float:
    """Return a real number; it may be infinite or NaN unless it is asked to be finite."""
    real = value.__class__ is float or isinstance(value, Real)  # the first is soonest told
    if not real or isinstance(value, bool | np.bool_):
        raise InputError(f"expected a number, got {shown(value)}.", where=where)
    try:
        number = float(value)
    except OverflowError as reason:
        raise InputError(_too_large(value), where=where) from reason
    if asked and not (abs(number) <= LARGEST and _RULES[asked][1](number)):
        raise InputError(f"expected {_RULES[asked][0]}, got {number:g}.", where=where)
    return number
