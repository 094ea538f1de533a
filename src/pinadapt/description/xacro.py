"""Expanding a xacro file with arguments, without ROS."""

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

XacroArguments: TypeAlias = "Mapping[str, str | float | bool]"

WHERE_PACKAGES_ARE = (
    "Packages are looked for in the folders above the file, beside these, and in the folders of "
    "ROS_PACKAGE_PATH."
)

_ARGUMENT = re.compile(r"""\$\(arg\s+([^)\s]+)\s*\)|<xacro:arg\s[^>]*?\bname\s*=\s*["']([^"']+)""")
_UNDEFINED = (
    "Give it: load(..., xacro={name: value}), in a scenario robot.xacro = { name = value }, "
    "`init --xacro name=value`."
)
_DEPTH = 4  # folders above a description whose neighbours are searched


def is_xacro(path: Path, root: ElementTree.Element) -> bool:
    """Tell whether a file needs expanding: by its name, or by an element of xacro in it."""
    return path.suffix == ".xacro" or any("xacro}" in str(element.tag) for element in root.iter())


def expand(path: Path, arguments: XacroArguments, packages: Packages) -> str:
    """Return the URDF that a xacro file makes of its arguments.

    ``$(find package)`` is searched as the packages of meshes are. What xacro says is a warning.

    Raises:
        RobotError: the file or one it includes cannot be expanded, or has no such argument.
    """
    import xacro  # here, because a plain URDF needs none

    given = {name: _word(value) for name, value in arguments.items()}
    said = io.StringIO()
    xacro.all_includes.clear()
    try:
        with _without_ros(packages), contextlib.redirect_stderr(said):
            text: str = xacro.process_file(str(path), mappings=dict(given)).toxml()
    except Exception as error:
        raise _refusal(error, path, [path, *(xacro.filestack or [])][-1]) from error
    if said.getvalue().strip():
        warnings.warn(f"{path}: xacro says: {' '.join(said.getvalue().split())}", stacklevel=2)
    _check_known(given, path, [path, *map(Path, xacro.all_includes)])
    return text


def _word(value: str | float | bool) -> str:
    """Return an argument as xacro expects it."""
    return str(value).lower() if isinstance(value, bool) else str(value)


@contextlib.contextmanager
def _without_ros(packages: Packages) -> Iterator[None]:
    """Let xacro search packages where meshes are searched, and read each file at once."""
    from unittest.mock import patch  # here, as it is slow to import

    import xacro
    from xacro import substitution_args

    parse: Any = xacro.parse

    def find(name: str) -> str:
        folder = packages.find(name)
        if folder is None:
            raise RobotError(f"package '{name}' was not found.", hint=WHERE_PACKAGES_ARE)
        return str(folder)

    def parse_at_once(given: Any, filename: str | None = None) -> Any:
        if given is None and filename is not None and Path(filename).is_file():
            given = minidom.parseString(Path(filename).read_bytes())
        return parse(given, filename)

    with (
        patch.object(substitution_args, "_eval_find", find),
        patch.dict(substitution_args._eval_dict, {"find": find}),
        patch.object(xacro, "parse", parse_at_once),
    ):
        yield


def _refusal(error: Exception, path: Path, file: str | Path) -> RobotError:
    """Return what is wrong with a xacro file, in the innermost file that it was found in."""
    inner: BaseException | None = error
    while inner is not None and not isinstance(inner, RobotError):
        inner = getattr(inner, "exc", None) or inner.__cause__
    if isinstance(inner, RobotError):
        return RobotError(inner.what, where=str(path), hint=inner.hint)
    reason = str(error).strip() or type(error).__name__
    if isinstance(error, ExpatError):
        reason = f"not well-formed XML ({reason})"
    if isinstance(error, RecursionError):
        reason = "its macros or elements are nested too deeply"
    inside = f" in {file}" if str(file) != str(path) else ""
    return RobotError(
        f"xacro cannot expand it{inside}: {reason.rstrip('.')}.",
        where=str(path),
        hint=_UNDEFINED if "Undefined substitution argument" in reason else None,
    )


def _check_known(given: Mapping[str, str], path: Path, files: list[Path]) -> None:
    """Refuse arguments that no file asks for."""
    known = {
        first or second
        for file in files
        for first, second in _ARGUMENT.findall(file.read_text(encoding="utf-8", errors="replace"))
    }
    for name in given:
        if name not in known:
            raise RobotError(
                f"there is no xacro argument '{name}'.{did_you_mean(name, known)}",
                where=str(path),
                hint=f"Its arguments: {', '.join(sorted(known)) or 'none'}.",
            )


# Packages


@dataclass(frozen=True)
class Packages:
    """The packages that a description can see.

    In this order: those given by name; folders above the description, and folders in these; folders
    of ROS_PACKAGE_PATH and share folders of AMENT_PREFIX_PATH. A folder is a package by its name,
    or by the name in its package.xml. Last, near the description, a folder of the same name but for
    a last word such as ``_support`` or ``_description``.

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

    def file(self, name: str) -> Path | None:
        """Return the file behind ``package://``, ``model://``, ``file://`` or a path, or None.

        A relative path starts at the description's folder, or at one above it.
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
        """The folders above the description, and all folders in the nearest of them."""
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
    """Yield the folders in a folder; none where it cannot be read."""
    try:
        yield from sorted(Path(entry.path) for entry in os.scandir(folder) if entry.is_dir())
    except OSError:
        return


def _ros_folders() -> list[Path]:
    """Return the folders that ROS 1 and ROS 2 say they keep packages in."""
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
    """Return a name without its last word."""
    for word in ("_support", "_description", "_descriptions"):
        name = name.removesuffix(word)
    return name
