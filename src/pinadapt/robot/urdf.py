"""Reading a URDF file, or the xacro file of one."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import coal
import pinocchio as pin

from ..exceptions import RobotError
from .meshes import keep_readable_meshes
from .packages import Packages
from .urdf_gaps import fill_urdf_gaps
from .urdf_numbers import check_urdf_numbers
from .xacro import XacroArguments, expand, is_xacro
from .xml_file import parse_xml, read_xml, xml_text


def is_path(source: str | Path) -> bool:
    """Tell whether a source is the path of a file; other text is a name."""
    return isinstance(source, Path) or "/" in source or source.endswith((".urdf", ".xml", ".xacro"))


_DEEPEST = 3200  # links in one row, of those that a stack of 8 MB bears


@dataclass(frozen=True)
class Urdf:
    """A URDF, with its numbers checked.

    Attributes:
        path: the file it was read from.
        text: the URDF without comments; of a xacro file, what became of it.
        packages: where its meshes are searched.
    """

    path: Path
    text: str
    packages: Packages

    @classmethod
    def read(
        cls,
        path: Path,
        xacro: XacroArguments | None = None,
        named: Mapping[str, str] | None = None,
    ) -> Urdf:
        """Read a file; ``xacro`` are its arguments, ``named`` folders of packages.

        Raises:
            RobotError: no such file, not XML, no URDF, a xacro that cannot be expanded, arguments
                for a file that takes none, a number that cannot be read, or too many links.
        """
        root, packages = read_xml(path), Packages(path.parent, named or {})
        if is_xacro(path, root):
            root = parse_xml(expand(path, xacro or {}, packages), str(path))
        elif xacro:
            raise RobotError("takes no arguments: it is a URDF, not a xacro file.", where=str(path))
        if root.tag != "robot":
            raise RobotError(
                f"the root element is <{root.tag}>, a URDF has <robot>.", where=str(path)
            )
        check_urdf_numbers(root, str(path))
        fill_urdf_gaps(root, str(path))
        _check_depth(root, str(path))
        return cls(path, xml_text(root, str(path)), packages)

    def model(self) -> pin.Model:
        """Build the model.

        Raises:
            RobotError: it is no valid URDF.
        """
        try:
            return pin.buildModelFromXML(self.text)
        except Exception as error:
            raise RobotError(
                "this XML is not a valid URDF; the messages of the parser stand above.",
                where=str(self.path),
                hint="Every joint needs a parent and child that exist, revolute and prismatic ones "
                "also <limit>.",
            ) from error

    def geometry(self, kind: pin.GeometryType) -> pin.GeometryModel:
        """Read the visual or collision geometry; shapes whose mesh is missing are left out."""
        root, loader = parse_xml(self.text, str(self.path)), coal.CachedMeshLoader()
        other = "collision" if kind == pin.GeometryType.VISUAL else "visual"
        for link in root.iter("link"):
            for shape in link.findall(other):
                link.remove(shape)
        keep_readable_meshes(root, self.packages, loader, str(self.path))
        text = xml_text(root, str(self.path))
        return pin.buildGeomFromUrdfString(self.model(), text, kind, mesh_loader=loader)

    def mimics(self) -> frozenset[str]:
        """Return the names of the joints that mimic another; Pinocchio makes them independent."""
        return frozenset(
            joint.get("name", "")
            for joint in parse_xml(self.text, str(self.path)).iter("joint")
            if joint.find("mimic") is not None
        )


def _check_depth(root: ElementTree.Element, where: str) -> None:
    """Refuse links on links on links, for which Pinocchio's recursion has no stack.

    Raises:
        RobotError: more of them than _DEEPEST in one row.
    """
    below: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        ends = [joint.find(end) for end in ("parent", "child")]
        parent, child = ("" if end is None else end.get("link", "") for end in ends)
        below.setdefault(parent, []).append(child)
    children = {child for links in below.values() for child in links}
    row = [parent for parent in below if parent not in children]
    for _ in range(_DEEPEST):
        row = [child for link in row for child in below.pop(link, ())]
        if not row:
            return
    raise RobotError(f"more than {_DEEPEST} links in one row.", where=where)


def read_urdf(path: Path) -> pin.Model:
    """Build the model of a URDF file.

    Raises:
        RobotError: as ``Urdf``.
    """
    return Urdf.read(path).model()


def mimic_joints(path: Path) -> frozenset[str]:
    """Return the names of the joints of a URDF file that mimic another."""
    return Urdf.read(path).mimics()
