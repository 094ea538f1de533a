"""Finding the files that a description names, without ROS: meshes, and what a xacro includes."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from urllib.parse import unquote

WHERE_PACKAGES_ARE = (
    "Packages are looked for in the folders above the file, beside these, and in the folders of "
    "ROS_PACKAGE_PATH."
)

_DEPTH = 4  # folders above a description whose neighbours are searched


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
