"""What a sweep varies: lists, ranges, distributions and designs, as numbered cases.

The same words are used on the command line, in sweep files and in Python. A value is a list, whose
entries are tried in turn, or a text:

* ``lin(0.5, 2.0, 16)`` and ``log(1.0, 100.0, 9)``: so many numbers, both ends among them, evenly
  spaced in the numbers or in their logarithms;
* ``uniform(low, high)``, ``loguniform(low, high)``, ``normal(mean, deviation)``, ``choice([...])``:
  drawn anew for each sample; bounds may be lists, one number for each joint;
* one of these after ``*``: factors on the value that the scenario has.

Lists and ranges are axes of a grid. What is drawn is one point of a design: random numbers, a Latin
hypercube, or Sobol's sequence (``scipy.stats.qmc``). The cases are the product of the listed cases,
the grid, the samples and the repetitions, in this order, the last changing fastest. A case follows
from its number alone.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from .._checks import numbers, positive, shown, word
from .._output import read_toml, write_text
from .._version import __version__
from ..exceptions import InputError, did_you_mean
from ..scenario.scenario import described_robot
from ..scenario.schema import put, tables_with, toml_value

METHODS = ("random", "lhs", "sobol")
MANY = 1_000_000  # cases, above which a user is asked
_AXES = {"lin": 3, "log": 3}  # kinds of values -> number of arguments
_DRAWN = {"uniform": 2, "loguniform": 2, "normal": 2, "choice": 1}
_CHECKED = 1000  # values of an axis that are all checked before the first case
_OWN = {"case", "status", "reason", "seconds"}  # columns that no argument of a function may have
_EDGE = 2.0**-53  # least distance of a quantile from 0 and 1, where normal ones are infinite
_DESIGN = 1  # spawn key of the design's random numbers; cases have (0, number)


@dataclass(frozen=True)
class Case:
    """One case of a sweep.

    Attributes:
        number: counted from 0.
        seed: of its random numbers; it follows from the sweep's seed and the number.
        values: what is varied, by key.
    """

    number: int
    seed: int
    values: dict[str, Any]


@dataclass(frozen=True)
class Drawn:
    """Values that are drawn: a distribution, one for each of n numbers where bounds are lists.

    Attributes:
        kind: "uniform", "loguniform", "normal" or "choice".
        arguments: low and high, or mean and deviation, each a number or n of them; or the choices.
    """

    kind: str
    arguments: tuple[Any, ...]

    @property
    def size(self) -> int | None:
        """Number n of numbers, None for a single one."""
        sizes = [len(each) for each in self.arguments if isinstance(each, list)]
        return sizes[0] if sizes and self.kind != "choice" else None

    def at(self, u: np.ndarray) -> Any:
        """Return the value at the quantiles u (n), or (1) for a single number."""
        if self.kind == "choice":
            choices = self.arguments[0]
            return choices[min(int(u[0] * len(choices)), len(choices) - 1)]
        a, b = (np.broadcast_to(np.asarray(each, float), u.shape) for each in self.arguments)
        if self.kind == "uniform":
            found = a + u * (b - a)
        elif self.kind == "loguniform":
            found = np.exp(np.log(a) + u * (np.log(b) - np.log(a)))
        else:
            from scipy.special import ndtri

            found = a + b * ndtri(np.clip(u, _EDGE, 1.0 - _EDGE))
        return [float(each) for each in found]


@dataclass(frozen=True)
class Values:
    """The values of one key, as they were given and as they are used.

    Attributes:
        key: a dotted key of a scenario, or the name of an argument of a function.
        axis: the values of the grid; None for what is drawn.
        drawn: the distribution; None for a grid.
        relative: whether these are factors on the scenario's value.
        base: the value that factors multiply: a number or n of them.
        names: of the joints that have one number each in a table; empty: no table.
    """

    key: str
    axis: list[Any] | None = None
    drawn: Drawn | None = None
    relative: bool = False
    base: Any = None
    names: tuple[str, ...] = ()

    @classmethod
    def of(cls, key: str, given: Any) -> Values:
        """Return the values that a list, a number or a text stands for.

        Raises:
            InputError: the text is none of the known ones, or a range or a bound is impossible.
        """
        if isinstance(given, np.ndarray):
            given = given.tolist()
        if isinstance(given, range | tuple):
            given = list(given)
        relative = isinstance(given, str) and given.lstrip().startswith("*")
        if isinstance(given, str):
            axis, drawn = _parsed(key, given.strip().lstrip("*").strip())
            return cls(key, axis, drawn, relative)
        axis = given if isinstance(given, list) else [given]
        if not axis:
            raise InputError("the list is empty.", where=key)
        for value in axis:
            _finite(key, value)
        return cls(key, list(axis))

    def each(self, size: int) -> Values:
        """Return the same with a number of its own for each of n joints."""
        if self.drawn is None or self.drawn.kind == "choice" or self.drawn.size == size:
            return self
        if self.drawn.size is not None:
            raise InputError(
                f"there are {size} numbers, the bounds are lists of {self.drawn.size}.",
                where=self.key,
            )
        lists = tuple([bound] * size for bound in self.drawn.arguments)
        return replace(self, drawn=Drawn(self.drawn.kind, lists))

    def used(self, value: Any) -> Any:
        """Return what the scenario gets for a value of the axis or of the distribution."""
        if self.relative:
            found = np.asarray(self.base, float) * np.asarray(value, float)
            value = found.tolist()
        if self.names:
            value = np.broadcast_to(value, len(self.names)).tolist()
            return dict(zip(self.names, value, strict=True))
        return value


def _finite(key: str, value: Any) -> None:
    """Refuse NaN and infinite numbers in a value of any depth."""
    for each in value if isinstance(value, list | tuple) else [value]:
        if isinstance(each, list | tuple):
            _finite(key, each)
        elif isinstance(each, float) and not math.isfinite(each):
            raise InputError(f"the numbers must be finite, got {shown(value)}.", where=key)


def _parsed(key: str, text: str) -> tuple[list[Any] | None, Drawn | None]:
    """Return the axis, or what is drawn, that a text stands for."""
    if re.search(r"\b(nan|inf)\b", text, re.IGNORECASE):
        raise InputError(f"the numbers must be finite, got {shown(text)}.", where=key)
    known = [*_AXES, *_DRAWN]
    hint = (
        "Write a list such as [1.0, 2.0], or one of lin(a, b, n), log(a, b, n), uniform(a, b), "
        "loguniform(a, b), normal(mean, deviation), choice([...])."
    )
    listed = toml_value(text) if text.startswith("[") else None
    if isinstance(listed, list):
        return Values.of(key, listed).axis, None
    try:
        tree = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        tree = None
    if isinstance(tree, ast.List | ast.Tuple):
        try:
            values = Values.of(key, list(ast.literal_eval(tree)))
        except (ValueError, TypeError, SyntaxError) as error:
            raise InputError(f"cannot be read: {shown(text)}.", where=key, hint=hint) from error
        return values.axis, None
    if not isinstance(tree, ast.Call) or not isinstance(tree.func, ast.Name) or tree.keywords:
        raise InputError(f"cannot be read: {shown(text)}.", where=key, hint=hint)
    kind = tree.func.id
    if kind not in known:
        guess = did_you_mean(kind, known)
        raise InputError(f"unknown kind of values '{kind}'.{guess}", where=key, hint=hint)
    try:
        given = [ast.literal_eval(argument) for argument in tree.args]
    except (ValueError, TypeError, SyntaxError) as error:
        raise InputError(f"cannot be read: {shown(text)}.", where=key, hint=hint) from error
    wanted = (_AXES | _DRAWN)[kind]
    if len(given) != wanted:
        raise InputError(
            f"{kind} takes {wanted} argument{'s' * (wanted > 1)}, got {len(given)}.", where=key
        )
    return (_range(key, kind, *given), None) if kind in _AXES else (None, _drawn(key, kind, given))


def _range(key: str, kind: str, first: Any, last: Any, count: Any) -> list[float]:
    """Return the numbers of a range."""
    a, b = (float(numbers(each, key)) for each in (first, last))
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise InputError(
            f"{kind} ends with the number of values, at least 1, got {shown(count)}.", where=key
        )
    if kind == "log" and min(a, b) <= 0.0:
        raise InputError(f"log needs positive numbers, got {a:g} and {b:g}.", where=key)
    if count > 1 and a == b:
        raise InputError(f"the range is empty: both ends are {a:g}.", where=key)
    spaced = np.linspace(a, b, count) if kind == "lin" else np.geomspace(a, b, count)
    return [float(each) for each in spaced]


def _drawn(key: str, kind: str, given: list[Any]) -> Drawn:
    """Return a distribution after checks of its arguments."""
    if kind == "choice":
        if not isinstance(given[0], list | tuple) or not given[0]:
            raise InputError("choice takes a list of at least one value.", where=key)
        _finite(key, list(given[0]))
        return Drawn(kind, (list(given[0]),))
    arguments = []
    for each in given:
        many = isinstance(each, list | tuple)
        parts = [float(numbers(part, key)) for part in (each if many else [each])]
        arguments.append(parts if many else parts[0])
    if len({len(each) for each in arguments if isinstance(each, list)}) > 1:
        raise InputError(f"the lists of {kind} have different lengths.", where=key)
    drawn = Drawn(kind, tuple(arguments))
    first, second = np.broadcast_arrays(*(np.atleast_1d(each) for each in arguments))
    if first.size == 0:
        raise InputError(f"{kind} got an empty list.", where=key)
    if kind == "normal" and (second < 0.0).any():
        raise InputError("the deviation of normal(mean, deviation) is negative.", where=key)
    if kind != "normal" and (first >= second).any():
        raise InputError(
            f"the range of {kind}(low, high) is empty: low is not below high.", where=key
        )
    if kind == "loguniform" and (first <= 0.0).any():
        raise InputError("loguniform needs positive bounds.", where=key)
    return drawn


@dataclass(frozen=True)
class Cases:
    """The cases of a sweep: ``len``, iteration and indexing; none is kept.

    Attributes:
        values: what is varied.
        listed: explicit cases, with which the others are combined; empty: none.
        samples: number of samples of the distributions.
        method: of the design: "random", "lhs" or "sobol".
        repeat: how often each case is repeated, with another seed.
        seed: of the sweep.
    """

    values: tuple[Values, ...] = ()
    listed: tuple[Mapping[str, Any], ...] = ()
    samples: int | None = None
    method: str = "random"
    repeat: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        """Check that the parts fit together."""
        word(self.method, METHODS, "method")
        for name, least in (("samples", 1), ("repeat", 1), ("seed", 0)):
            value = getattr(self, name)
            if value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise InputError(
                    f"a whole number of at least {least} is expected, got {shown(value)}.",
                    where=name,
                )
        drawn = [each.key for each in self.values if each.drawn]
        if drawn and self.samples is None:
            raise InputError(
                f"{', '.join(drawn)} {'is' if len(drawn) == 1 else 'are'} random, but the "
                "number of samples is missing.",
                where="samples",
                hint="State it: --samples 100, or samples=100.",
            )
        if not drawn and self.samples is not None:
            raise InputError(
                "nothing is drawn.",
                where="samples",
                hint="Give a distribution such as uniform(0.5, 2.0), or use repeat.",
            )
        keys = [each.key for each in self.values] + [key for case in self.listed for key in case]
        both = {each.key for each in self.values} & {key for case in self.listed for key in case}
        if both or len(set(keys[: len(self.values)])) < len(self.values):
            twice = sorted(both) or keys
            raise InputError(f"is varied twice: {', '.join(twice)}.", where="vary")
        for key in _OWN & set(keys):
            raise InputError(
                "is a column of every table.", where=key, hint="Give the argument another name."
            )

    @classmethod
    def of(
        cls,
        given: Mapping[str, Any] | Sequence[Mapping[str, Any]] | Cases | None,
        **options: Any,
    ) -> Cases:
        """Return cases from values by key, or from a list of explicit cases.

        Raises:
            InputError: they cannot be used.
        """
        if isinstance(given, Cases):
            return given
        if given is None:
            return cls(**options)
        if isinstance(given, Mapping):
            return cls(tuple(Values.of(str(key), each) for key, each in given.items()), **options)
        if isinstance(given, str) or not all(isinstance(each, Mapping) for each in given):
            raise InputError(
                f"expected values by key, or a list of them, got {shown(given)}.", where="cases"
            )
        if not given:
            raise InputError("the list is empty.", where="cases")
        for case in given:
            for key, value in case.items():
                _finite(str(key), value)
        return cls(listed=tuple(dict(each) for each in given), **options)

    def __len__(self) -> int:
        """Number of cases."""
        return math.prod(self._shape)

    @property
    def _shape(self) -> tuple[int, ...]:
        """Sizes: listed cases, axes, samples, repetitions."""
        axes = [len(each.axis) for each in self.values if each.axis is not None]
        return (max(1, len(self.listed)), *axes, self.samples or 1, self.repeat)

    @property
    def keys(self) -> list[str]:
        """The keys that are varied, in order."""
        listed = dict.fromkeys(key for case in self.listed for key in case)
        return [*listed, *(each.key for each in self.values)]

    def __getitem__(self, index: int) -> Case:
        """Return a case by its number.

        Raises:
            IndexError: there is no such case.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"there are {len(self)} cases, from 0 to {len(self) - 1}.")
        first, *axes, sample, _ = (int(each) for each in np.unravel_index(index, self._shape))
        values: dict[str, Any] = dict(self.listed[first]) if self.listed else {}
        column, grid = 0, iter(axes)
        for each in self.values:
            if each.axis is not None:
                values[each.key] = each.used(each.axis[next(grid)])
            else:
                assert each.drawn is not None
                size = each.drawn.size
                found = each.drawn.at(self._design[sample, column : column + (size or 1)])
                single = size is None and each.drawn.kind != "choice"
                values[each.key] = each.used(found[0] if single else found)
                column += size or 1
        return Case(index, self._seed_of(index), values)

    def __iter__(self) -> Iterator[Case]:
        """Yield the cases in order."""
        return (self[index] for index in range(len(self)))

    def _seed_of(self, index: int) -> int:
        """Return the seed of a case, below 2**63."""
        child = np.random.SeedSequence(self.seed, spawn_key=(0, index))
        return int(child.generate_state(1, np.uint64)[0] >> np.uint64(1))

    @cached_property
    def _design(self) -> np.ndarray:
        """Quantiles (samples, d) of all numbers that are drawn, in the order of their keys."""
        d = sum(each.drawn.size or 1 for each in self.values if each.drawn)
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(_DESIGN,)))
        count = self.samples or 1
        if self.method == "random":
            return rng.random((count, d))
        from scipy.stats import qmc

        if self.method == "lhs":
            return np.asarray(qmc.LatinHypercube(d, seed=rng).random(count))
        sequence = qmc.Sobol(d, seed=rng)
        whole = sequence.random_base2(math.ceil(math.log2(count))) if count > 1 else None
        return np.asarray(sequence.random(1) if whole is None else whole[:count])


def flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the entries of nested tables by dotted keys."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        inside = isinstance(value, Mapping)
        found |= flat(value, f"{prefix}{key}.") if inside else {f"{prefix}{key}": value}
    return found


# --- the sweep file ---

_KEYS = {
    "title": str,
    "scenario": str | dict,
    "folder": str,
    "function": str,
    "path": str,
    "reduce": str,
    "set": dict,
    "vary": dict,
    "case": list,
    "samples": int,
    "method": str,
    "repeat": int,
    "seed": int,
    "timeout": float | int,
    "success": str,
    "csv": bool,
    "version": str,
}
_MAY_DIFFER = ("title", "timeout", "success", "csv")  # between a sweep and its resumption
COPY = "sweep.toml"
SUCCESS = "follows"
_SPREAD = re.compile(r"\s*(\[|(lin|log)\s*\()")  # a text that is a list or a range
_CONDITION = re.compile(r"^\s*(\S+)\s*(<=|>=|<|>|==)\s*(\S+)\s*$")


@dataclass(frozen=True)
class Plan:
    """A whole sweep: what is run, what is varied, and how; what a sweep file holds.

    Attributes:
        cases: what is varied.
        raw: tables of the scenario, the fixed settings among them; None for a function.
        folder: to which the scenario's paths are relative.
        function: "module:name", or a function; None for a scenario.
        path: folder from which a module is imported; empty: as installed.
        reduce: "module:name", or a function, that returns the numbers of a rollout.
        title: of the report.
        timeout: [s] of a case.
        success: a column of truth values, or a condition such as "error_share < 0.01".
        csv: whether tables are written as CSV even where pyarrow is installed.
        given: what is varied, as it was given.
    """

    cases: Cases
    raw: dict[str, Any] | None = None
    folder: str = ""
    function: Callable[..., Any] | str | None = None
    path: str = ""
    reduce: Callable[..., Any] | str | None = None
    title: str = ""
    timeout: float | None = None
    success: str = ""
    csv: bool = False
    given: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def read(
        cls, path: Path, vary: Sequence[str] = (), settings: Sequence[str] = (), **options: Any
    ) -> Plan:
        """Return the sweep of a sweep file, or of a scenario.

        Args:
            path: of a TOML file; one with a table [vary] or [[case]], or with a function, is a
                sweep file.
            vary: further values, "key=value".
            settings: fixed settings of the scenario, "key=value".
            options: further keys of a sweep file; None: as the file says.

        Raises:
            InputError: the file cannot be used.
        """
        tables = read_toml(path)
        if not (
            {"vary", "case", "function"} & set(tables) or isinstance(tables.get("scenario"), str)
        ):
            tables = {"scenario": tables, "folder": str(path.resolve().parent)}
        _check_keys(tables, str(path))
        tables.setdefault("path", str(_root(path)))
        if isinstance(tables.get("scenario"), str):
            named = path.parent / tables["scenario"]
            tables["scenario"] = read_toml(named)
            tables["folder"] = str(named.resolve().parent)
        tables.setdefault("folder", str(path.resolve().parent))
        varied = flat(tables.get("vary", {}))
        for text in vary:
            key, value = parsed_setting(text, "--vary")
            varied[key] = value
        fixed = flat(tables.get("set", {})) | dict(
            parsed_setting(text, "--set") for text in settings
        )
        own = {key: value for key, value in options.items() if value is not None}
        return cls.of(tables | {"vary": varied, "set": fixed} | own)

    @classmethod
    def of(cls, tables: Mapping[str, Any]) -> Plan:
        """Return a sweep from the keys of a sweep file, whose scenario is a table.

        Raises:
            InputError: they cannot be used.
        """
        scenario = tables.get("scenario") is not None  # whose tables are flattened to dotted keys
        listed = [
            each
            for case in tables.get("case", [])
            for each in _expanded(flat(case) if scenario else dict(case))
        ]
        options = {
            key: tables[key] for key in ("samples", "method", "repeat", "seed") if key in tables
        }
        varied = flat(tables.get("vary", {}))
        cases = Cases.of(varied, listed=tuple(listed), **options)
        for case in listed:
            for key, value in case.items():
                _finite(key, value)
        raw, settings = tables.get("scenario"), dict(tables.get("set", {}))
        function = tables.get("function")
        if (raw is None) == (function is None):
            raise InputError(
                "a sweep runs either a scenario or a function.",
                where="sweep file",
                hint='Write scenario = "file.toml", or function = "module:name".',
            )
        if raw is None:
            if settings:
                listed = [settings | case for case in listed or [{}]]
                cases = replace(cases, listed=tuple(listed))
        else:
            raw = deepcopy(dict(raw))
            for key, value in settings.items():
                put(raw, key, value)
            cases = _bound(cases, raw, tables.get("folder", ""))
        timeout = tables.get("timeout")
        if timeout is not None:
            timeout = positive(timeout, "timeout", error=InputError)
        success = tables.get("success", "")
        condition(success)
        kept = {"samples", "method", "repeat", "seed"}
        given = {"vary": varied, "case": listed} | {k: v for k, v in options.items() if k in kept}
        return cls(
            cases,
            raw,
            tables.get("folder", ""),
            function,
            tables.get("path", ""),
            tables.get("reduce"),
            tables.get("title", ""),
            timeout,
            success,
            tables.get("csv", False),
            given,
        )

    def tables(self, *, bare: bool = False) -> dict[str, Any]:
        """Return the keys of a sweep file that says the same; ``bare``: without the version."""
        named = {"function": self.function, "reduce": self.reduce}
        found: dict[str, Any] = {
            "title": self.title,
            "version": "" if bare else __version__,
            **{key: _name_of(each) for key, each in named.items() if each is not None},
            "folder": self.folder,
            "path": self.path,
            "timeout": self.timeout,
            "success": self.success,
            "csv": self.csv,
            **{key: value for key, value in self.given.items() if key not in ("vary", "case")},
            "vary": self.given.get("vary", {}),
            "case": self.given.get("case", []),
        }
        if self.raw is not None:
            found["scenario"] = self.raw
        return {key: each for key, each in found.items() if each not in (None, "", [], {}, False)}

    def differs(self, other: Plan) -> list[str]:
        """Return the keys in which two sweeps differ so that their rows do not fit together."""
        a, b = (as_plain(each.tables()) for each in (self, other))
        keys = [key for key in (a | b) if key not in (*_MAY_DIFFER, "version")]
        return [key for key in keys if a.get(key) != b.get(key)]

    def save(self, folder: Path) -> None:
        """Write ``sweep.toml`` into a folder."""
        import tomlkit

        write_text(folder / COPY, tomlkit.dumps(as_plain(self.tables())))

    @classmethod
    def load(cls, folder: Path) -> Plan:
        """Return the sweep of a folder.

        Raises:
            InputError: there is none, or it was run by another version of the library.
        """
        path = folder / COPY
        if not path.is_file():
            raise InputError(f"holds no sweep: there is no {COPY}.", where=str(folder))
        tables = read_toml(path)
        _check_keys(tables, str(path))
        version = tables.pop("version", None)
        if version != __version__:
            raise InputError(
                f"was run by pinadapt {version}; this is {__version__}.",
                where=str(folder),
                hint="Take that version, or run the sweep again in another folder.",
            )
        return cls.of(tables)


def _expanded(case: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the cases of a table [[case]]: one for each value of a text that is a list or range.

    The text is written as on the command line, "[1, 2]" or "lin(0, 1, 5)"; a list itself is one
    value.

    Raises:
        InputError: such a text cannot be read.
    """
    axes = [
        _parsed(key, value.strip())[0] or [value]
        if isinstance(value, str) and _SPREAD.match(value)
        else [value]
        for key, value in case.items()
    ]
    return [dict(zip(case, values, strict=True)) for values in product(*axes)]


def as_plain(value: Any) -> Any:
    """Return nested tables and lists as TOML has them."""
    if isinstance(value, Mapping):
        return {str(key): as_plain(each) for key, each in value.items() if each is not None}
    if isinstance(value, list | tuple | range):
        return [as_plain(each) for each in value]
    if isinstance(value, np.ndarray | np.generic):
        return as_plain(value.tolist())
    return value


def _name_of(function: Callable[..., Any] | str) -> str:
    if isinstance(function, str):
        return function
    return f"{function.__module__}:{getattr(function, '__qualname__', repr(function))}"


def condition(text: str) -> tuple[str, str, float]:
    """Return column, sign and number of "column < number"; a column alone is "== 1".

    Raises:
        InputError: the text is neither.
    """
    if not text or re.fullmatch(r"[\w.\[\]]+", text):
        return text or SUCCESS, "==", 1.0
    found = _CONDITION.match(text)
    try:
        if found is None:
            raise ValueError
        return found[1], found[2], float(found[3])
    except ValueError as error:
        raise InputError(
            f"cannot be read: {shown(text)}.",
            where="success",
            hint='Write a column and a bound, "error_share < 0.01".',
        ) from error


def parsed_setting(text: str, where: str) -> tuple[str, Any]:
    """Return key and value of "key=value", the value in TOML or as text.

    Raises:
        InputError: there is no equals sign or no key.
    """
    key, equals, value = text.partition("=")
    if not (equals and key.strip()):
        raise InputError(f"expected key=value, got '{text}'.", where=where)
    return key.strip(), toml_value(value.strip())


def _check_keys(tables: Mapping[str, Any], where: str) -> None:
    """Check the keys of a sweep file and the types of their values."""
    for key, value in tables.items():
        if key not in _KEYS:
            raise InputError(
                f"unknown key '{key}'; allowed: {', '.join(_KEYS)}.{did_you_mean(key, _KEYS)}",
                where=where,
            )
        kind = _KEYS[key]
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise InputError(f"{key} cannot be {shown(value)}.", where=where)
    if any(not isinstance(each, Mapping) for each in tables.get("case", [])):
        raise InputError("write each case as a table, [[case]].", where=where)


def _root(path: Path) -> Path:
    """Return the folder from which modules beside a file are imported: the first no package."""
    folder = path.resolve().parent
    while (folder / "__init__.py").is_file():
        folder = folder.parent
    return folder


def _bound(cases: Cases, raw: dict[str, Any], folder: str) -> Cases:
    """Return cases with what follows from the scenario, after checks of every key and list.

    Raises:
        InputError: a key or value is not allowed in the scenario.
    """
    first = {key: value for case in cases.listed[:1] for key, value in case.items()}
    names: list[str] = []
    base = tables_with(deepcopy(raw), first, "scenario").model_dump(by_alias=True)
    values = []
    for each in cases.values:
        key, star = each.key.removesuffix(".*"), each.key.endswith(".*")
        if star and not names:
            names = _joints(deepcopy(raw), first, folder)
        here = _entry(base, key)
        if star:
            each = each.each(len(names))
            each = replace(each, key=key, names=tuple(names) if _by_name(key) else ())
        elif isinstance(here, list) and here and all(isinstance(x, int | float) for x in here):
            each = each.each(len(here))
        if each.relative:
            each = replace(each, base=_factor_base(key, here, names))
        values.append(each)
    found = replace(cases, values=tuple(values))
    ordinary = found[0].values
    for each in values:
        axis = each.axis if each.axis is not None else [None]
        for value in axis if len(axis) <= _CHECKED else (axis[0], axis[-1]):
            used = {} if value is None else {each.key: each.used(value)}
            tables_with(deepcopy(raw), ordinary | used, f"--vary {each.key}")
    return found


def _entry(base: Mapping[str, Any], key: str) -> Any:
    """Return the value at a dotted key, None where there is none."""
    found: Any = base
    for part in key.split("."):
        if isinstance(found, list):
            found = found[int(part)] if part.isdigit() and int(part) < len(found) else None
        else:
            found = found.get(part) if isinstance(found, Mapping) else None
    return found


def _by_name(key: str) -> bool:
    """Return whether a key holds a table of joints, where others hold a list."""
    return key.rpartition(".")[2] in ("inertial_scale", "link_translation")


def _factor_base(key: str, here: Any, names: Sequence[str]) -> Any:
    """Return the number or numbers that factors multiply."""
    if isinstance(here, Mapping) and names and set(here) <= set(names):
        here = [here.get(name, 1.0) for name in names]
    try:
        if here is None:
            raise InputError("there is none")
        return numbers(here, key).tolist()
    except InputError as error:
        raise InputError(
            "the scenario has no number here that could be multiplied.",
            where=key,
            hint="Set one, or give values without the asterisk.",
        ) from error


def _joints(raw: dict[str, Any], values: Mapping[str, Any], folder: str) -> list[str]:
    """Return the joint names of the scenario's robot."""
    tables = tables_with(raw, values, "scenario")
    return list(described_robot(tables, Path(folder)).joint_names)
