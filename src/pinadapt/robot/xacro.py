"""Expanding a xacro file with arguments, without ROS."""

from __future__ import annotations

import contextlib
import io
import re
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeAlias
from xml.dom import minidom
from xml.parsers.expat import ExpatError

from ..exceptions import RobotError, did_you_mean
from .packages import WHERE_PACKAGES_ARE, Packages

XacroArguments: TypeAlias = "Mapping[str, str | float | bool]"

_ARGUMENT = re.compile(r"""\$\(arg\s+([^)\s]+)\s*\)|<xacro:arg\s[^>]*?\bname\s*=\s*["']([^"']+)""")


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


_UNDEFINED = (
    "Give it: load(..., xacro={name: value}), in a scenario robot.xacro = { name = value }, "
    "`init --xacro name=value`."
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
