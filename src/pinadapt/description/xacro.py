"""Expanding a xacro file without ROS and without running code, and finding its packages."""

from __future__ import annotations

import ast
import contextlib
import io
import math
import operator
import os
import re
import time
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import unquote
from xml.dom import minidom
from xml.parsers.expat import ExpatError

import simpleeval

from ..exceptions import RobotError, did_you_mean

XacroArguments: TypeAlias = "Mapping[str, str | float | bool]"

WHERE_PACKAGES_ARE = (
    "Packages are searched in the folders above the file, in the folders next to these, and in "
    "ROS_PACKAGE_PATH."
)

_ARGUMENT = re.compile(r"""\$\(arg\s+([^)\s]+)\s*\)|<xacro:arg\s[^>]*?\bname\s*=\s*["']([^"']+)""")
_UNDEFINED = (
    "Give a value: load(..., xacro={name: value}), in a scenario robot.xacro = { name = value }, "
    "`init --xacro name=value`."
)
_DEPTH = 4  # folders above a description in which packages are searched
_NEAR = 2  # of these, how many up a folder without package.xml counts as a package of xacro files
_BYTES = 1_000_000  # of a file that is expanded, included or of YAML; those of arms have 50,000
_ELEMENTS = 15_000  # of an expanded file; an arm with a hand has some 300
_BOOLEANS = {"true": True, "false": False}
_CHARACTERS = 20_000_000  # of all texts in which expressions were replaced
_SECONDS = 30.0  # of processor time that an expansion may take; an arm with a hand takes two


def is_xacro(path: Path, root: ElementTree.Element) -> bool:
    """Return whether a file has to be expanded.

    Raises:
        RobotError: it has xacro elements, and its name says that it has none.
    """
    if path.suffix == ".xacro":
        return True
    found = next((each for each in root.iter() if "xacro}" in str(each.tag)), None)
    if found is not None and path.suffix == ".urdf":
        raise RobotError(
            f"a .urdf file with the element <xacro:{str(found.tag).split('}')[1]}>, which is not "
            "expanded.",
            where=str(path),
            hint="If it is a xacro file, give it a name that ends in .xacro.",
        )
    return found is not None


def expand(path: Path, arguments: XacroArguments, packages: Packages) -> str:
    """Return the URDF that a xacro file and its arguments give.

    ``$(find package)`` searches the same packages as meshes. Messages of xacro become warnings.

    Raises:
        RobotError: the file or one that it includes cannot be expanded, or an argument is unknown.
    """
    import xacro  # slow to import; a plain URDF does not need it

    given = {name: _word(value) for name, value in arguments.items()}
    messages = io.StringIO()
    xacro.all_includes.clear()
    try:
        with _without_ros(packages), contextlib.redirect_stderr(messages):
            text: str = xacro.process_file(str(path), mappings=dict(given)).toxml()
    except Exception as error:
        raise _refusal(error, path, [path, *(xacro.filestack or [])][-1]) from error
    if messages.getvalue().strip():
        text_of_all = " ".join(messages.getvalue().split())
        warnings.warn(f"{path}: message of xacro: {text_of_all}", stacklevel=2)
    _check_known(given, path, [path, *map(Path, xacro.all_includes)])
    return text


def _word(value: str | float | bool) -> str:
    """Return an argument as text for xacro."""
    return str(value).lower() if isinstance(value, bool) else str(value)


@contextlib.contextmanager
def _without_ros(packages: Packages) -> Iterator[None]:
    """Make xacro search the given packages, run no code of the file, and end in bounded time."""
    from unittest.mock import patch  # here, as it is slow to import

    import xacro
    from xacro import substitution_args

    folders, limits = packages.own(), _Budget()
    parse, load_yaml = xacro.parse, xacro.load_yaml
    of_xacro: Any = xacro._global_symbols["xacro"]

    def find(name: str) -> str:
        """Return the folder of a package, from which files may be read from now on."""
        folder = packages.find(name)
        if folder is None:
            raise RobotError(f"package '{name}' is not found.", hint=WHERE_PACKAGES_ARE)
        if packages.is_package(folder):
            folders.append(folder)
        return str(folder)

    def allowed(name: str) -> Path:
        """Return the path of a file that is inside one of the packages."""
        path = Path(xacro.abs_filename_spec(name)).resolve()
        if not any(path.is_relative_to(folder.resolve()) for folder in folders):
            raise RobotError(
                f"the file {path} is outside of the description's packages.",
                hint="Files may be read from the package of the description (the folder with "
                "package.xml, else its own folder) and from packages that it finds.",
            )
        if path.exists() and not path.is_file():  # a pipe would be waited for without end
            raise RobotError(f"{path} is no file.")
        if path.exists() and path.stat().st_size > _BYTES:
            raise RobotError(f"{path} has more than {_BYTES} bytes.")
        return path

    def parse_whole(given: Any, filename: str | None = None) -> Any:
        """Parse a document as xacro does, but a file in one piece, which is faster."""
        if given is None and filename is not None and allowed(filename).is_file():
            given = minidom.parseString(Path(filename).read_bytes())
            if given.doctype is not None and len(given.doctype.entities):
                raise RobotError(
                    f"{filename} defines XML entities, which could expand without limit."
                )
        return parse(given, filename)

    def yaml_file(name: str) -> Any:
        """Return the content of a YAML file."""
        return load_yaml(str(allowed(str(name))))

    names = "abs_filename", "arg", "dotify", "tokenize", "message", "warning", "error", "fatal"
    functions = {name: dict.__getitem__(of_xacro, name) for name in names} | {
        "load_yaml": yaml_file
    }

    def braces(text: str, symbols: Mapping[str, Any], _: object = None) -> Any:
        """Return the value of ${text}."""
        return evaluate(str(text), symbols.__getitem__, functions)

    def dollar_eval(text: str, context: Mapping[str, Any]) -> str:
        """Return the value of $(eval text)."""
        given = context.get("arg", {})

        def argument(name: str) -> Any:
            """Return a number, boolean or text."""
            return substitution_args.convert_value(given[name], "auto")

        def value(name: str) -> Any:
            """Return an argument or a constant."""
            return argument(name) if name in given else {**CONSTANTS, **_BOOLEANS}[name]

        called = {
            "arg": argument,
            "find": find,
            "dirname": lambda: substitution_args._eval_dirname(context.get("filename")),
            "env": substitution_args._eval_env,
            "optenv": substitution_args._eval_optenv,
        }
        return str(evaluate(text, value, called))

    with (
        patch.object(substitution_args, "_eval_find", find),
        patch.object(substitution_args, "_eval", dollar_eval),
        patch.object(xacro, "safe_eval", braces),
        patch.object(xacro, "parse", parse_whole),
        patch.object(xacro, "eval_text", limits.text(xacro.eval_text)),
        patch.object(xacro, "handle_macro_call", limits.element(xacro.handle_macro_call)),
    ):
        yield


@dataclass
class _Budget:
    """What is left for the expansion of one file.

    Attributes:
        elements: that may still be visited.
        characters: that replaced texts may still have.
        until: processor time of this thread at which it must be complete [s].
    """

    elements: int = _ELEMENTS
    characters: int = _CHARACTERS
    until: float = field(default_factory=lambda: time.thread_time() + _SECONDS)

    def element(self, function: Any) -> Any:
        """Return a function that visits an element, which counts."""

        def counted(*given: Any) -> Any:
            """Visit an element if there are not too many."""
            self.elements -= 1
            if self.elements < 0:
                raise RobotError(f"the expanded file has more than {_ELEMENTS} elements.")
            return function(*given)

        return counted

    def text(self, function: Any) -> Any:
        """Return a function that replaces expressions in a text, which counts."""

        def counted(*given: Any) -> Any:
            """Replace expressions if the texts are not too long."""
            found = function(*given)
            self.characters -= len(found) if isinstance(found, str) else 1
            if time.thread_time() > self.until:
                raise RobotError(f"its expansion takes more than {_SECONDS:g} s.")
            if self.characters < 0:
                raise RobotError(f"expressions give more than {_CHARACTERS} characters.")
            return found

        return counted


def _refusal(error: Exception, path: Path, file: str | Path) -> RobotError:
    """Return the error of a xacro file, with the innermost file that it occurred in."""
    inner: BaseException | None = error
    while inner is not None and not isinstance(inner, RobotError):
        inner = getattr(inner, "exc", None) or inner.__cause__
    if isinstance(inner, RobotError):
        return RobotError(inner.what, where=str(path), hint=inner.hint)
    reason = str(error).strip() or type(error).__name__
    if isinstance(error, ExpatError):
        reason = f"not well-formed XML ({reason})"
    if isinstance(error, RecursionError):
        reason = "macros or elements are nested too deeply"
    inside = f" in {file}" if str(file) != str(path) else ""
    return RobotError(
        f"xacro cannot expand this file; error{inside}: {reason.rstrip('.')}.",
        where=str(path),
        hint=_UNDEFINED if "Undefined substitution argument" in reason else None,
    )


def _check_known(given: Mapping[str, str], path: Path, files: list[Path]) -> None:
    """Refuse arguments that no file declares or uses."""
    known = {
        first or second
        for file in files
        for first, second in _ARGUMENT.findall(file.read_text(encoding="utf-8", errors="replace"))
    }
    for name in given:
        if name not in known:
            raise RobotError(
                f"the file has no xacro argument '{name}'.{did_you_mean(name, known)}",
                where=str(path),
                hint=f"Its arguments: {', '.join(sorted(known)) or 'none'}.",
            )


# Packages


@dataclass(frozen=True)
class Packages:
    """The packages that a description can refer to.

    They are searched in this order: packages given by name; the folders above the description and
    the folders in these; ROS_PACKAGE_PATH and the share folders of AMENT_PREFIX_PATH. A package is
    found by the name of its folder, then by the name in its package.xml. Last, near the
    description, folders match whose names differ by an ending such as ``_support`` or
    ``_description`` only.

    Attributes:
        folder: of the description.
        named: package name -> folder.
    """

    folder: Path
    named: Mapping[str, str] = field(default_factory=dict)

    def find(self, name: str) -> Path | None:
        """Return the folder of a package, or None; a path such as ".." names no package."""
        if name in self.named:
            return Path(self.named[name])
        if name in ("", ".", "..") or "/" in name or os.sep in name:
            return None
        for place in self._above:
            if place.name == name:
                return place
            if (place / name).is_dir():
                return place / name
        for place in _ros_folders():
            if (place / name).is_dir():
                return place / name
        return self._by_manifest.get(name) or self._by_stem.get(_stem(name))

    def own(self) -> list[Path]:
        """Return the folders of the package that the description is in.

        That is the nearest folder above with package.xml, and where that file really is, if it is
        a link; else the nearest whose name is that of a description; else the folder of the
        description, or the one above if it is called urdf, xacro or robots.
        """
        near = self._above[: _DEPTH + 1]
        for place in near:
            if (place / "package.xml").is_file():
                return [place, (place / "package.xml").resolve().parent]
        for place in near:
            if _stem(place.name) != place.name:
                return [place]
        return [near[min(near[0].name in ("urdf", "xacro", "robots"), len(near) - 1)]]

    def is_package(self, folder: Path) -> bool:
        """Return whether xacro files may be read from a folder that was found.

        It was named, has a package.xml, or is near the description.
        """
        return (
            str(folder) in map(str, self.named.values())
            or (folder / "package.xml").is_file()
            or (folder.resolve().parent in self._above[: _NEAR + 1] and folder.parent != folder)
        )

    def file(self, name: str) -> Path | None:
        """Return the file of a ``package://``, ``model://`` or ``file://`` URI or path, or None.

        A relative path starts at the folder of the description, or at one above it.
        """
        scheme, mark, rest = name.partition("://")
        if mark and scheme in ("package", "model"):
            package, _, inner = rest.partition("/")
            folder = self.find(package)
            return None if folder is None else _existing(folder / inner)
        place = Path(unquote(rest) if scheme == "file" and mark else name)
        places = self._above if not place.is_absolute() else [Path()]
        return next((found for start in places if (found := _existing(start / place))), None)

    @cached_property
    def _above(self) -> list[Path]:
        folder = self.folder.resolve()
        return [folder, *folder.parents]

    @cached_property
    def _near(self) -> list[Path]:
        """The folders above the description, and all folders in the four nearest of them."""
        return [*self._above, *(folder for up in self._above[:_DEPTH] for folder in _inside(up))]

    @cached_property
    def _by_manifest(self) -> dict[str, Path]:
        places = [*self._near, *(inner for outer in _ros_folders() for inner in _inside(outer))]
        found = ((_manifest_name(place), place) for place in reversed(places))
        return {name: place for name, place in found if name}

    @cached_property
    def _by_stem(self) -> dict[str, Path]:
        return {_stem(place.name): place for place in reversed(self._near)}


def _existing(path: Path) -> Path | None:
    return path if path.is_file() else None


def _inside(folder: Path) -> Iterator[Path]:
    """Yield the folders in a folder; none if it cannot be read."""
    try:
        yield from sorted(Path(entry.path) for entry in os.scandir(folder) if entry.is_dir())
    except OSError:
        return


def _ros_folders() -> list[Path]:
    """Return the folders of packages that the environment variables of ROS 1 and ROS 2 list."""
    first = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    second = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return [Path(text) for text in first if text] + [Path(t, "share") for t in second if t]


def _manifest_name(folder: Path) -> str | None:
    """Return the name in a folder's package.xml, or None."""
    file = folder / "package.xml"
    try:
        return (
            ElementTree.fromstring(file.read_bytes()).findtext("name") if file.is_file() else None
        )
    except (OSError, ElementTree.ParseError):
        return None


def _stem(name: str) -> str:
    """Return a package name without an ending such as ``_description``."""
    for word in ("_support", "_description", "_descriptions"):
        name = name.removesuffix(word)
    return name


# Expressions: numbers, texts, lists and functions of mathematics, nothing else. xacro hands them to
# Python's eval, by which a description could run any code. Here they go through simpleeval with a
# list of what is allowed, and the sizes of numbers, texts and lists are bounded.

LONGEST = 100_000  # characters and elements of a value, together
_DIGITS = 400  # of a number, before or after the point
_BITS = 1024  # of a whole number; beyond it no float holds it
_TEXT = 10_000  # characters of an expression
_HINT = (
    "Expressions may use numbers, texts, lists, dictionaries, + - * / // % **, comparisons, and, "
    "or, not, if else, items as in a[0], a['key'] or a.key of YAML, pi, functions of math, and "
    "abs, all, any, bool, dict, divmod, enumerate, float, int, len, list, max, min, range, "
    "reversed, round, sorted, str, sum, tuple, zip; of xacro: arg, dotify, load_yaml, tokenize."
)


def _bounded(value: Any) -> Any:
    """Return a value; refuse what is not data, and what is too large."""
    left: list[Any] = [value]
    size = 0
    while left:
        each = left.pop()
        if isinstance(each, str):
            size += len(each)
        elif isinstance(each, (list, tuple)):
            size += len(each)
            left += each[: LONGEST - size + 1]
        elif isinstance(each, dict):
            size += len(each)
            left += [*each.keys(), *dict.values(each)]
        elif isinstance(each, int):
            if each.bit_length() > _BITS:
                raise RobotError("a whole number has more than 300 digits.", hint=_HINT)
        elif not isinstance(each, (float, type(None))):
            raise RobotError(f"a value is of the kind '{type(each).__name__}'.", hint=_HINT)
        if size > LONGEST:
            raise RobotError(f"a value has more than {LONGEST} characters or elements.")
    return value


def _product(a: Any, b: Any) -> Any:
    """Return a b, where a text or a list times a number does not become too long."""
    for several, times in ((a, b), (b, a)):
        if not isinstance(several, str | list | tuple):
            continue
        if not isinstance(times, int):
            raise RobotError("a text or a list is multiplied by no whole number.", hint=_HINT)
        if len(several) * times > LONGEST:
            raise RobotError(f"a value has more than {LONGEST} characters or elements.")
    return a * b


def _power(a: float, b: float) -> float:
    """Return a^b, exact for whole numbers that are not too large."""
    if not isinstance(a, int) or not isinstance(b, int) or b < 0:
        return math.pow(a, b)
    if b * max(a.bit_length(), 1) > 2 * _BITS:
        raise RobotError(f"{a}**{b} is too large.", hint=_HINT)
    return int(a**b)


def _remainder(a: Any, b: Any) -> Any:
    """Return a modulo b of numbers; texts are not formatted."""
    if isinstance(a, str):
        raise RobotError("a text cannot be formatted by %.", hint="Join texts by + and str().")
    return a % b


def _round(number: float, digits: int | None = None) -> float:
    """Return a number rounded to digits after the point, as many as a number can have."""
    if digits is not None and abs(digits) > _DIGITS:
        raise RobotError(f"a number has at most {_DIGITS} digits.", hint=_HINT)
    return round(number, digits)


def _sum(numbers: Iterable[float], start: float = 0) -> float:
    """Return the sum of numbers; lists are copied once more for each that is added."""
    if not all(isinstance(each, int | float) for each in (start, *numbers)):
        raise RobotError("sum() adds numbers only.", hint="Join lists by +.")
    return sum(numbers, start)


def _range(*limits: int) -> list[int]:
    """Return whole numbers."""
    if len(range(*limits)) > LONGEST:
        raise RobotError(f"a range has more than {LONGEST} numbers.")
    return list(range(*limits))


def _as_list(function: Callable[..., Iterable[Any]]) -> Callable[..., list[Any]]:
    """Return a function that returns a list where another one returns an iterator."""
    return lambda *given: list(function(*given))


_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: _product,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: _remainder,
    ast.Pow: _power,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
    ast.Not: operator.not_,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda item, several: item in several,
    ast.NotIn: lambda item, several: item not in several,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
}
_SLOW = {"factorial", "comb", "perm", "prod"}  # of whole numbers, which they make large
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: f for name, f in vars(math).items() if callable(f) and name[0] != "_"},
    **{f.__name__: f for f in (abs, all, any, bool, dict, divmod, float, int, len, list, max)},
    **{f.__name__: f for f in (min, sorted, str, tuple)},
    "round": _round,
    "sum": _sum,
    "range": _range,
    **{f.__name__: _as_list(f) for f in (enumerate, reversed, zip)},
    "pow": _power,
}
_NAMESPACES = "math", "python", "xacro"  # in front of a function or a constant
CONSTANTS = {"pi": math.pi, "e": math.e, "tau": math.tau, "inf": math.inf, "nan": math.nan}


class _Evaluator(simpleeval.SimpleEval):
    """simpleeval without attributes, statements and formatted texts.

    Args:
        lookup: name -> value; raises KeyError.
        functions: that the expression may call, besides those of mathematics.
    """

    def __init__(
        self, lookup: Callable[[str], Any], functions: Mapping[str, Callable[..., Any]]
    ) -> None:
        super().__init__(operators=_OPERATORS, functions={}, names={})
        self._lookup = lookup
        self._known = {k: f for k, f in _FUNCTIONS.items() if k not in _SLOW} | {**functions}
        kept = ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Subscript, ast.Slice
        handlers: dict[type[ast.AST], Callable[[Any], Any]] = vars(self)["nodes"]
        self.nodes = {kind: handlers[kind] for kind in kept} | {
            ast.Constant: lambda node: _bounded(node.value),
            ast.Name: self._name,
            ast.BinOp: lambda node: _bounded(self._eval_binop(node)),
            ast.Attribute: self._key_by_dot,
            ast.Call: self._call,
            ast.List: lambda node: _bounded([self._eval(each) for each in node.elts]),
            ast.Tuple: lambda node: _bounded(tuple(self._eval(each) for each in node.elts)),
            ast.Dict: self._dictionary,
        }

    def _name(self, node: ast.Name) -> Any:
        try:
            return _bounded(self._lookup(node.id))
        except KeyError:
            raise RobotError(f"'{node.id}' is not defined.", hint=_HINT) from None

    def _key_by_dot(self, node: ast.Attribute) -> Any:
        """Return a constant of a namespace, or an item of a dictionary, never an attribute."""
        if isinstance(node.value, ast.Name) and node.value.id in _NAMESPACES:
            if node.attr in CONSTANTS:
                return CONSTANTS[node.attr]
        else:
            owner = self._owner(node.value)
            if isinstance(owner, dict) and node.attr in owner:
                return _bounded(owner[node.attr])
        raise RobotError(f"'{ast.unparse(node)}' is not defined.", hint=_HINT)

    def _owner(self, node: ast.expr) -> Any:
        """Return what stands before a dot: a namespace of included files is no value by itself."""
        if not isinstance(node, ast.Name):
            return self._eval(node)
        try:
            return self._lookup(node.id)
        except KeyError:
            return None

    def _call(self, node: ast.Call) -> Any:
        name = ""
        if isinstance(node.func, ast.Name):
            name = node.func.id
        elif isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name):
            name = node.func.attr if node.func.value.id in _NAMESPACES else ""
        if name not in self._known:
            raise RobotError(f"'{ast.unparse(node.func)}' cannot be called.", hint=_HINT)
        values = [self._eval(each) for each in node.args]
        named = {str(each.arg): self._eval(each.value) for each in node.keywords}
        return _bounded(self._known[name](*values, **named))

    def _dictionary(self, node: ast.Dict) -> dict[Any, Any]:
        if None in node.keys:
            raise RobotError("a dictionary with ** in it.", hint=_HINT)
        keys = [self._eval(each) for each in node.keys if each is not None]
        return dict(_bounded(dict(zip(keys, map(self._eval, node.values), strict=True))))


def evaluate(
    text: str,
    lookup: Callable[[str], Any],
    functions: Mapping[str, Callable[..., Any]],
) -> Any:
    """Return the value of an expression: a number, a text, a list, a tuple or a dictionary.

    Args:
        text: of the expression, in Python's syntax.
        lookup: name -> value of a property or constant; raises KeyError.
        functions: name -> function, besides those of mathematics.

    Raises:
        RobotError: what the expression uses is not allowed, not defined or too large.
        SyntaxError, TypeError, ValueError, ZeroDivisionError, OverflowError: as Python has them.
    """
    if len(text) > _TEXT:
        raise RobotError(f"an expression has more than {_TEXT} characters.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python would look for the text in a file to show it
            tree = ast.parse(text.strip(), mode="eval").body
    except (MemoryError, RecursionError) as error:
        raise RobotError("an expression is nested too deeply.") from error
    try:
        return _Evaluator(lookup, functions).eval(text, previously_parsed=tree)
    except simpleeval.InvalidExpression as error:
        raise RobotError(f"{str(error).rstrip('.')}.", hint=_HINT) from error
