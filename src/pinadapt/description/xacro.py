"""Expanding a xacro file without ROS, and finding its packages."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias
from urllib.parse import unquote

from ..exceptions import RobotError, did_you_mean

XacroArguments: TypeAlias = "Mapping[str, str | float | bool]"

WHERE_PACKAGES_ARE = (
    "Packages are searched in the folders above the file, in the folders next to these, and in "
    "ROS_PACKAGE_PATH."
)

_ARGUMENT = re.compile(r"""(?:\$\(arg\s+|<xacro:arg\s[^>]*?\bname\s*=\s*["'])([^)\s"']+)""")
_HINT = (
    "An undefined argument is given as load(..., xacro={name: value}), in a scenario as "
    "robot.xacro = { name = value }, to `init` as --xacro name=value."
)


def expand(path: Path, arguments: XacroArguments, packages: Packages) -> str:
    """Return the URDF that a xacro file and its arguments give.

    A xacro file is a program: its expressions are evaluated by Python, as in ROS.
    ``$(find package)`` searches the same packages as meshes.

    Raises:
        RobotError: the file or one that it includes cannot be expanded, or an argument is unknown.
    """
    import xacro  # slow to import; a plain URDF does not need it
    from xacro import substitution_args

    def find(name: str) -> str:
        """Return the folder of a package."""
        folder = packages.find(name)
        if folder is None:
            raise LookupError(f"package '{name}' is not found. {WHERE_PACKAGES_ARE}")
        return str(folder)

    words = {k: str(v).lower() if isinstance(v, bool) else str(v) for k, v in arguments.items()}
    of_ros = substitution_args._eval_find
    xacro.all_includes.clear()
    substitution_args._eval_find = substitution_args._eval_dict["find"] = find
    try:
        text: str = xacro.process_file(str(path), mappings=dict(words)).toxml()
    except Exception as error:  # an expression raises errors of any kind
        file = [str(path), *(xacro.filestack or [])][-1]
        reason = str(error).strip() or type(error).__name__
        raise RobotError(
            f"xacro cannot expand {file}: {reason.rstrip('.')}.", where=path, hint=_HINT
        ) from error
    finally:
        substitution_args._eval_find = substitution_args._eval_dict["find"] = of_ros
    known = {
        name
        for file in (path, *map(Path, xacro.all_includes))
        for name in _ARGUMENT.findall(file.read_text(encoding="utf-8", errors="replace"))
    }
    for name in words.keys() - known:
        raise RobotError(
            f"the file has no xacro argument '{name}'.{did_you_mean(name, known)}",
            where=path,
            hint=f"Its arguments: {', '.join(sorted(known)) or 'none'}.",
        )
    return text


# Packages


@dataclass(frozen=True)
class Packages:
    """The packages that a description can refer to.

    They are searched in this order: packages given by name; the folders above the description and
    the folders in these; ROS_PACKAGE_PATH and the share folders of AMENT_PREFIX_PATH. A package is
    found by the name of its folder.

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
        ros = [
            Path(text, inside)
            for variable, inside in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share"))
            for text in os.environ.get(variable, "").split(os.pathsep)
            if text
        ]
        folders = (each for place in (*self._above, *ros) for each in (place, place / name))
        return next((each for each in folders if each.name == name and each.is_dir()), None)

    def file(self, name: str) -> Path | None:
        """Return the file of a ``package://``, ``model://`` or ``file://`` URI or path, or None.

        A relative path starts at the folder of the description, or at one above it.
        """
        scheme, mark, rest = name.partition("://")
        places: list[Path | None] = [*self._above]
        if mark and scheme in ("package", "model"):
            package, _, name = rest.partition("/")
            places = [self.find(package)]
        elif mark and scheme == "file":
            name = unquote(rest)
        files = (place / name for place in places if place is not None)
        return next((file for file in files if file.is_file()), None)

    def find_files(self, root: ElementTree.Element) -> set[str]:
        """Make the paths of meshes and textures absolute; return the names that are not found."""
        missing = set()
        for element in [*root.iter("mesh"), *root.iter("texture")]:
            name = element.get("filename", "")
            if (file := self.file(name)) is None:
                missing.add(name)
            else:
                element.set("filename", str(file))
        return missing

    @property
    def _above(self) -> list[Path]:
        folder = self.folder.resolve()
        return [folder, *folder.parents]
