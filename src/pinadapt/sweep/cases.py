"""What a sweep varies: lists, ranges, distributions and designs, as numbered cases.

The same words are used on the command line, in sweep files and in Python. A value is a list, whose
entries are tried in turn, or a text:

* ``0.5, 1.0`` or ``separation, slotine-li``, numbers or words;
* ``lin(0.5, 2.0, 16)`` and ``log(1.0, 100.0, 9)``: so many numbers, both ends among them, evenly
  spaced in the numbers or in their logarithms;
* ``uniform(low, high)``, ``loguniform(low, high)``, ``normal(mean, deviation)``, ``choice([...])``:
  drawn anew for each sample; bounds may be lists, one number for each joint.

Lists and ranges are axes of a grid. What is drawn is one point of a design: random numbers, a Latin
hypercube, or Sobol's sequence (``scipy.stats.qmc``). The cases are the product of the listed cases,
the grid, the samples and the repetitions, in this order, the last changing fastest. A case follows
from its number alone.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from .._checks import instance, mapping, positive, shown, whole, word
from .._output import Record, read_toml, toml, write_text
from .._version import __version__
from ..exceptions import InputError
from ..scenario.scenario import described_robot
from ..scenario.tables import (
    at_folder,
    flat,
    made,
    names_file,
    parts,
    plain,
    setting,
    toml_value,
    with_values,
)
from .table import Row

Function: TypeAlias = Callable[..., Any] | str  # or its name, "module:name"
METHODS = ("random", "lhs", "sobol")
DISTRIBUTIONS = ("uniform", "loguniform", "normal")
COPY = "sweep.toml"
SUCCESS = "follows"
_HINT = (
    "Write values such as 1.0, 2.0 or a, b, or one of lin(a, b, n), log(a, b, n), uniform(a, b), "
    "loguniform(a, b), normal(mean, deviation), choice([...]), finite numbers and a below b."
)
_LIST_TEXT = re.compile(r"\s*(\[|(lin|log)\s*\()")  # a text that is a list or a range
_CONDITION = re.compile(r"\s*([^\s<>=]+)\s*(?:(<|>)\s*(-?[\d.]+(?:e-?\d+)?)\s*)?", re.I)


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
    values: Row

    def row(self, found: Record) -> Row:
        """Return the row of the case, with what was found."""
        return {"case": self.number, "seed": self.seed, **self.values, **found}


@dataclass(frozen=True)
class Values:
    """The values of one key: an axis of the grid, or a distribution.

    Attributes:
        key: a dotted key of a scenario, or the name of an argument of a function.
        kind: "list", "uniform", "loguniform", "normal" or "choice".
        arguments: the values of the axis; low and high, or mean and deviation, each () or (n); or
            the choices.
        names: of the joints that have one number each in a table; empty: no table.
    """

    key: str
    kind: str
    arguments: tuple[Any, ...]
    names: Sequence[str] = ()

    @classmethod
    def of(cls, key: str, given: Any) -> Values:
        """Return the values that a list, a number or a text stands for.

        Raises:
            InputError: the text is none of the known ones, or a range or a bound is impossible.
        """
        kind = "list"
        if isinstance(given, str):
            try:
                kind, given = _parsed(given.strip())
                if not given:
                    raise ValueError
            except (ArithmeticError, AttributeError, SyntaxError, TypeError, ValueError) as error:
                raise InputError(
                    f"cannot be read: {shown(given)}.", where=key, hint=_HINT
                ) from error
        if kind == "list":
            given = plain(given)
        return cls(key, kind, tuple(given) if isinstance(given, list) else (given,))

    @property
    def drawn(self) -> bool:
        """Whether values are drawn, not listed."""
        return self.kind != "list"

    @property
    def shape(self) -> tuple[int, ...]:
        """(n) where n numbers are drawn, () for a single value."""
        return np.shape(self.arguments[0]) if self.kind in DISTRIBUTIONS else ()

    def at(self, u: np.ndarray) -> Any:
        """Return the value at the quantiles u (n), or (1) for a single one."""
        if self.kind == "choice":
            return self.arguments[int(u[0] * len(self.arguments))]  # u < 1
        low, high = self.arguments
        if self.kind == "normal":
            from scipy.special import ndtri

            edge = np.finfo(float).epsneg  # at 0 and 1 it is infinite
            found = low + high * ndtri(np.clip(u, edge, 1.0 - edge))
        elif self.kind == "loguniform":
            found = low * (high / low) ** u
        else:
            found = low + u * (high - low)
        return found.reshape(self.shape).tolist()

    def by_joint(self, names: Sequence[str]) -> Values:
        """Return "KEY.*" as KEY with a number of its own for each of n joints; others as they are.

        Raises:
            InputError: the bounds are lists of another length.
        """
        key = self.key.removesuffix(".*")
        if key == self.key:
            return self
        arguments = self.arguments
        if self.kind in DISTRIBUTIONS:
            if self.shape not in ((), (len(names),)):
                raise InputError(f"expected {len(names)} numbers, one a joint.", where=self.key)
            arguments = tuple(np.broadcast_to(bound, len(names)) for bound in arguments)
        if not key.endswith(("inertial_scale", "link_translation")):  # a list, no table of joints
            names = ()
        return replace(self, key=key, arguments=arguments, names=names)

    def used(self, value: Any) -> Any:
        """Return what the scenario gets for a value of the axis or of the distribution."""
        if self.names:
            numbers = np.broadcast_to(value, len(self.names))
            return dict(zip(self.names, numbers.tolist(), strict=True))
        return value


def _parsed(text: str) -> tuple[str, list[Any]]:
    """Return kind and arguments that a text stands for.

    Raises:
        ArithmeticError, AttributeError, SyntaxError, TypeError, ValueError: it cannot be read.
    """
    if text.startswith("["):
        return "list", list(instance(toml_value(text), list, "values"))
    if "(" not in text:
        return "list", [toml_value(part.strip()) for part in text.split(",")]
    tree: Any = ast.parse(text, mode="eval").body
    kind = tree.func.id
    given = [ast.literal_eval(each) for each in tree.args]
    if kind in ("lin", "log"):
        with np.errstate(all="raise"):  # numbers that are not finite
            return "list", (np.linspace if kind == "lin" else np.geomspace)(*given).tolist()
    if kind == "choice":
        return kind, list(*given)
    low, high = np.broadcast_arrays(*given)
    least = 0.0 if kind == "normal" else low
    possible = np.isfinite([low, high]).all() and (least < high).all()
    if kind not in DISTRIBUTIONS or not possible or (kind == "loguniform" and low.min() <= 0.0):
        raise ValueError
    return kind, [low.astype(float), high.astype(float)]


def _design(method: str, seed: int, count: int, d: int) -> np.ndarray:
    """Return quantiles (count, d): random numbers, a Latin hypercube, or Sobol's sequence."""
    # cases have the spawn keys (0, number)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    if method == "random" or not d:
        return rng.random((count, d))
    from scipy.stats import qmc

    if method == "lhs":
        return qmc.LatinHypercube(d, seed=rng).random(count)
    return qmc.Sobol(d, seed=rng).random_base2((count - 1).bit_length())[:count]


@dataclass(frozen=True, eq=False)
class Plan:
    """A whole sweep: what is run, what is varied, and how; the keys of a sweep file.

    Attributes:
        title: of the report.
        scenario: tables of the scenario, the fixed settings among them; None for a function.
        folder: to which the scenario's paths are relative.
        function: "module:name", or a function; None for a scenario.
        path: folder from which a module is imported; empty: as installed.
        vary: values by key.
        case: explicit cases, with which the others are combined.
        samples: number of samples of the distributions.
        method: of the samples: "random", "lhs" (Latin hypercube) or "sobol".
        repeat: runs of each case, each with another seed.
        seed: of the sweep.
        timeout: [s] of a case.
        success: a column of truth values, or a condition such as "error_share < 0.01".

    Raises:
        InputError: they cannot be used.
    """

    title: str = ""
    scenario: Record | None = None
    folder: str = ""
    function: Function | None = None
    path: str = ""
    vary: Record = field(default_factory=dict)
    case: Sequence[Record] = ()
    samples: int | None = None
    method: str = "random"
    repeat: int = 1
    seed: int = 0
    timeout: float | None = None
    success: str = ""

    def __post_init__(self) -> None:
        """Refuse what makes no sweep."""
        if (self.scenario is None) == (self.function is None):
            raise InputError(
                "a sweep runs either a scenario or a function.",
                where="sweep file",
                hint='Write scenario = "file.toml", or function = "module:name".',
            )
        if self.timeout is not None:
            positive(self.timeout, "timeout", error=InputError)
        if self.samples is not None:
            whole(self.samples, "samples", least=1)
        whole(self.repeat, "repeat", least=1)
        whole(self.seed, "seed", least=0)
        word(self.method, METHODS, "method")
        condition(self.success)
        drawn = [each.key for each in self.values if each.drawn]
        if bool(drawn) != (self.samples is not None):
            raise InputError(
                f"{', '.join(drawn) or 'nothing'}: values are drawn from distributions if and only "
                "if the number of samples is given.",
                where="samples",
                hint="State it: --samples 100, or samples=100; a distribution is uniform(0.5, 2).",
            )
        if not self.cases:
            raise InputError("there is no case.", where="case")
        self.check(self.cases[0].values)

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
        folder = path.resolve().parent
        above = folder  # from which modules beside the file are imported
        while (above / "__init__.py").is_file():
            above = above.parent
        if isinstance(tables.get("scenario"), str):
            named = path.parent / tables["scenario"]
            tables["scenario"] = read_toml(named)
            folder = named.resolve().parent
        elif {"vary", "case", "function"}.isdisjoint(tables):
            tables = {"scenario": tables}
        tables = {"path": str(above), "folder": str(folder)} | tables
        tables["vary"] = {
            **mapping(tables.get("vary"), "vary"),
            **dict(setting(key, "--vary") for key in vary),
        }
        tables["set"] = flat(tables.get("set", {})) | dict(map(setting, settings))
        return cls.of(tables | plain(options))

    @classmethod
    def of(cls, tables: Record) -> Plan:
        """Return a sweep from the keys of a sweep file, whose scenario is a table.

        Its table [set] becomes part of the scenario, or of each case of a function.

        Raises:
            InputError: they cannot be used.
        """
        tables = dict(tables)
        fixed = tables.pop("set", {})
        listed = tables.get("case", [])
        if "scenario" in tables:
            tables["scenario"] = with_values(tables["scenario"], fixed)
            listed = [flat(case) for case in listed]
        elif fixed:
            listed = [fixed | case for case in listed or [{}]]
        tables["case"] = [each for case in listed for each in _expanded(case)]
        tables["vary"] = flat(mapping(tables.get("vary"), "vary"))
        return made(cls, tables, "sweep file")

    def _tables(self, values: Record) -> Row:
        """Return the tables of the scenario with other values."""
        return at_folder(with_values(self.scenario or {}, values), Path(self.folder))

    def check(self, values: Record) -> None:
        """Check keys and values against the scenario, if the sweep is of one.

        Raises:
            InputError: an unknown key, or a value that it cannot have.
        """
        if self.scenario is not None:
            parts(self._tables(values))

    @cached_property
    def values(self) -> list[Values]:
        """What is varied beside the listed cases; "KEY.*" has a number for each joint."""
        values = [Values.of(str(key), each) for key, each in self.vary.items()]
        if self.scenario is not None and any(each.key.endswith(".*") for each in values):
            names = described_robot(parts(self._tables(dict(*self.case[:1])))).joint_names
            values = [each.by_joint(names) for each in values]
        return values

    @cached_property
    def cases(self) -> list[Case]:
        """The product of listed cases, grid, samples and repetitions, the last changing fastest."""
        drawn = [each for each in self.values if each.drawn]
        sizes = [math.prod(each.shape) for each in drawn]
        samples = [
            {
                each.key: each.used(each.at(u))
                for each, u in zip(drawn, np.split(row, np.cumsum(sizes)[:-1]), strict=False)
            }
            for row in _design(self.method, self.seed, self.samples or 1, sum(sizes))
        ]
        axes = [
            [{each.key: each.used(value)} for value in each.arguments]
            for each in self.values
            if not each.drawn
        ]
        points: Any = product(self.case or [{}], *axes, samples, range(self.repeat))
        found = []
        for number, (*chosen, _) in enumerate(points):
            own = np.random.SeedSequence(self.seed, spawn_key=(0, number))
            (seed,) = own.generate_state(1, np.uint64)
            values = {key: value for part in chosen for key, value in part.items()}
            found.append(Case(number, int(seed) >> 1, values))  # below 2**63
        return found

    def text(self) -> str:
        """Return the sweep file that says the same, with the version of the library.

        And with a hash of the files that are named in it, such as descriptions of robots.
        """
        import tomlkit

        tables = flat(self.scenario or {}), *(case.values for case in self.cases)
        named = {
            (key, name) for table in tables for key, name in table.items() if names_file(key, name)
        }
        paths = [Path(self.folder, name) for _, name in sorted(named)]
        files = b"".join(path.read_bytes() for path in paths if path.is_file())

        given = {each.name: getattr(self, each.name) for each in fields(self)}
        if callable(self.function):
            given["function"] = f"{self.function.__module__}:{self.function.__qualname__}"
        about = {"version": __version__, "files": sha256(files).hexdigest()}
        return tomlkit.dumps({**about, **plain(given)})

    def save(self, folder: Path) -> None:
        """Write ``sweep.toml`` into a folder."""
        write_text(folder / COPY, self.text())

    def is_in(self, folder: Path) -> bool:
        """Return whether a folder holds this sweep, of the same files, run by this version.

        It may have another condition of success, which only the report applies.
        """
        there = read_toml(folder / COPY) if (folder / COPY).is_file() else {}
        return toml.loads(self.text()) == {**there, "success": self.success}

    @classmethod
    def load(cls, folder: Path) -> Plan:
        """Return the sweep of a folder.

        Raises:
            InputError: there is none, or it was run by another version of the library.
        """
        tables = read_toml(folder / COPY)
        version = tables.pop("version", None)
        tables.pop("files", None)
        if version != __version__:
            raise InputError(
                f"was run by pinadapt {version}; this is {__version__}.",
                where=folder,
                hint="Take that version, or run the sweep again in another folder.",
            )
        return cls.of(tables)


def _expanded(case: Record) -> list[Row]:
    """Return the cases of a table [[case]]: one for each value of a text that is a list or range.

    The text is written as on the command line, "[1, 2]" or "lin(0, 1, 5)"; a list itself is one
    value.

    Raises:
        InputError: such a text cannot be read.
    """
    axes = [
        Values.of(key, value).arguments
        if isinstance(value, str) and _LIST_TEXT.match(value)
        else [value]
        for key, value in case.items()
    ]
    return [dict(zip(case, values, strict=True)) for values in product(*axes)]


def condition(text: str) -> tuple[str, str, float]:
    """Return column, sign and number of "column < number"; a column alone is "> 0".

    Raises:
        InputError: the text is neither.
    """
    found = _CONDITION.fullmatch(text or SUCCESS)
    if found is None:
        raise InputError(
            f"cannot be read: {shown(text)}.",
            where="success",
            hint='Write a column and a bound, "error_share < 0.01".',
        )
    column, sign, bound = found.groups()
    return column, sign or ">", float(bound or 0.0)
