"""Expanding a xacro file without ROS, and finding the packages that a description refers to."""

from __future__ import annotations

import contextlib
import io
import os
import re
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import unquote
from xml.dom import minidom
from xml.parsers.expat import ExpatError

from ..exceptions import RobotError, did_you_mean
from .expressions import CONSTANTS, evaluate

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
_ELEMENTS = 15_000  # of an expanded file; an arm with a hand has some 300
_BOOLEANS = {"true": True, "false": False}
_CHARACTERS = 20_000_000  # of all texts in which expressions were replaced


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
        return path

    def parse_whole(given: Any, filename: str | None = None) -> Any:
        """Parse a document as xacro does, but a file in one piece, which is faster."""
        if given is None and filename is not None and allowed(filename).is_file():
            given = minidom.parseString(Path(filename).read_bytes())
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
    """

    elements: int = _ELEMENTS
    characters: int = _CHARACTERS

    def element(self, function: Any) -> Any:
        """Return a function that visits an element, which counts."""

        def counted(*given: Any) -> Any:
            self.elements -= 1
            if self.elements < 0:
                raise RobotError(f"the expanded file has more than {_ELEMENTS} elements.")
            return function(*given)

        return counted

    def text(self, function: Any) -> Any:
        """Return a function that replaces expressions in a text, which counts."""

        def counted(*given: Any) -> Any:
            found = function(*given)
            self.characters -= len(found) if isinstance(found, str) else 1
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
        """Return the folder of a package, or None."""
        if name in self.named:
            return Path(self.named[name])
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
        """Tell whether xacro files may be read from a folder that was found.

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
    try:
        return ElementTree.fromstring((folder / "package.xml").read_bytes()).findtext("name")
    except (OSError, ElementTree.ParseError):
        return None


def _stem(name: str) -> str:
    """Return a package name without an ending such as ``_description``."""
    for word in ("_support", "_description", "_descriptions"):
        name = name.removesuffix(word)
    return name
