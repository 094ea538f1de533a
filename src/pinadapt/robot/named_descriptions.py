"""Descriptions by the names of the package robot_descriptions, which fetches them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from ..exceptions import RobotError, did_you_mean

_INSTALL = 'Install it: pip install "pinadapt[descriptions]".'


@dataclass(frozen=True)
class NamedDescription:
    """Where a description lies.

    Attributes:
        path: its URDF, xacro or MJCF file.
        xacro: arguments that its xacro file needs.
        packages: folders of packages by name.
    """

    path: Path
    xacro: Mapping[str, str]
    packages: Mapping[str, str]


def is_description_name(source: str) -> bool:
    """Tell whether a name is one of the package, such as ``iiwa14_description``."""
    return source.endswith("_description")


def named_description(name: str) -> NamedDescription:
    """Return a description of the package robot_descriptions, fetched where it is not yet.

    Raises:
        RobotError: the package is missing, has no such description, or could not fetch it.
    """
    try:
        package = import_module("robot_descriptions")
    except ImportError as error:
        raise RobotError(
            f"'{name}' is a name of the package robot_descriptions, which is not installed.",
            where="source",
            hint=_INSTALL,
        ) from error
    if name not in package.DESCRIPTIONS:
        raise RobotError(
            f"the package robot_descriptions has no '{name}'."
            f"{did_you_mean(name, package.DESCRIPTIONS)}",
            where="source",
        )
    try:
        module = import_module(f"robot_descriptions.{name}")
    except Exception as error:  # of git, the network, the disk
        reason = (str(error).strip() or type(error).__name__).splitlines()[-1].strip()
        raise RobotError(
            f"robot_descriptions could not fetch '{name}': {reason}.",
            where="source",
            hint="It clones from GitHub at the first use, with git: try again online, or set "
            "ROBOT_DESCRIPTIONS_CACHE to a folder that holds it already.",
        ) from error
    for kind in ("URDF_PATH", "XACRO_PATH", "MJCF_PATH"):
        if hasattr(module, kind):
            return NamedDescription(
                Path(getattr(module, kind)),
                getattr(module, "XACRO_ARGS", {}) if kind == "XACRO_PATH" else {},
                getattr(module, "XACRO_PACKAGE_PATHS", {}),
            )
    raise RobotError(f"'{name}' has neither a URDF, nor a xacro, nor an MJCF.", where="source")
