"""Reading a URDF file, or the xacro file of one."""

from __future__ import annotations

import math
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from ..exceptions import RobotError
from .xacro import WHERE_PACKAGES_ARE, Packages, XacroArguments, expand, is_xacro
from .xml_file import parse_xml, read_xml, xml_text

_DEEPEST = 3200  # links in one row, of those that a stack of 8 MB bears
_BOUNDED = ("revolute", "prismatic")
_NEEDED = ("effort", "velocity")
_SHOWN = 3  # missing meshes in a warning
_HINT = "Numbers are written with a point, lists with spaces between their numbers."
# element -> attribute -> how many numbers it holds
_NUMBERS: dict[str, dict[str, int]] = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": {"ixx": 1, "ixy": 1, "ixz": 1, "iyy": 1, "iyz": 1, "izz": 1},
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "dynamics": {"damping": 1, "friction": 1, "armature": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "mesh": {"scale": 3},
}
_REQUIRED = {"mass", "inertia"}


def is_path(source: str | Path) -> bool:
    """Tell whether a source is the path of a file; other text is a name."""
    return isinstance(source, Path) or "/" in source or source.endswith((".urdf", ".xml", ".xacro"))


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

    def armatures(self) -> dict[str, float]:
        """Return joint name -> rotor inertia [kg m^2 or kg], of joints that state one.

        It is the attribute ``armature`` of <dynamics>, which ``Robot.urdf`` writes.
        """
        return {
            joint.get("name", ""): float(dynamics.get("armature", "nan"))
            for joint in parse_xml(self.text, str(self.path)).findall("joint")
            for dynamics in joint.findall("dynamics")
            if "armature" in dynamics.attrib
        }


@dataclass(frozen=True, eq=False)
class Origin:
    """The URDF behind a robot.

    Attributes:
        source: the URDF, or the path of one that is read when it is asked for.
        model: the chain as loaded, before anything of it was changed; never written to.
    """

    source: Urdf | Path
    model: pin.Model

    @property
    def urdf(self) -> Urdf:
        """The URDF.

        Raises:
            RobotError: its file is gone, or no longer one.
        """
        return self.source if isinstance(self.source, Urdf) else Urdf.read(self.source)


def read_urdf(path: Path) -> pin.Model:
    """Build the model of a URDF file.

    Raises:
        RobotError: as ``Urdf``.
    """
    return Urdf.read(path).model()


def mimic_joints(path: Path) -> frozenset[str]:
    """Return the names of the joints of a URDF file that mimic another."""
    return Urdf.read(path).mimics()


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


# Numbers


def check_urdf_numbers(root: ElementTree.Element, where: str) -> None:
    """Refuse numbers of links and joints that cannot be read, are not finite, or are missing.

    Raises:
        RobotError: the first of them; the link or joint, the element and its text are named.
    """
    for part in root:
        if part.tag in ("link", "joint"):
            owner = f"{part.tag} '{part.get('name', '')}'"
            for element in part.iter():
                for flaw in _flaws(element):
                    raise RobotError(f"{owner}, <{element.tag}>: {flaw}.", where=where, hint=_HINT)


def _flaws(element: ElementTree.Element) -> Iterator[str]:
    for name, count in _NUMBERS.get(element.tag, {}).items():
        text = element.get(name)
        if text is not None:
            flaw = flaw_of_numbers(text, count)
            if flaw:
                yield f'{name}="{text}" {flaw}'
        elif element.tag in _REQUIRED:
            yield f"{name} is missing"


def flaw_of_numbers(text: str, count: int | None = None) -> str | None:
    """Return what is wrong with a text of ``count`` numbers, or of any, or None."""
    numbers = [_number(word) for word in text.split()]
    readable = [number for number in numbers if number is not None]
    if len(readable) < len(numbers) or len(numbers) != (count or len(numbers)) or not numbers:
        return f"is not {'a number' if count == 1 else f'{count} numbers' if count else 'numbers'}"
    if any(math.isnan(number) for number in readable):
        return "is not a number"
    return "is not finite" if any(map(math.isinf, readable)) else None


def _number(word: str) -> float | None:
    """Return a number as a C program reads it, or None."""
    try:
        return None if "_" in word or not word.isascii() else float(word)
    except ValueError:
        return None


# Gaps


def fill_urdf_gaps(root: ElementTree.Element, where: str) -> None:
    """Add limits of zero, which mean none, and links that only carry others; warn of them.

    Written are ``effort`` and ``velocity`` of revolute and prismatic joints, their whole ``limit``,
    and links that joints name as parents but nothing defines, such as "world".
    """
    told = [*_fill_limits(root), *_fill_parents(root)]
    if told:
        warnings.warn(f"{where}: {'; '.join(told)}.", stacklevel=4)


def _fill_limits(root: ElementTree.Element) -> list[str]:
    open_joints = []
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        if joint.get("type") not in _BOUNDED and limit is None:
            continue
        if limit is None:
            limit = ElementTree.SubElement(joint, "limit")
        missing = [name for name in _NEEDED if name not in limit.attrib]
        if missing:
            limit.attrib.update(dict.fromkeys(missing, "0"))
            open_joints.append(f"{joint.get('name', '')} ({', '.join(missing)})")
    return [f"no limit is stated for {', '.join(open_joints)}"] if open_joints else []


def _fill_parents(root: ElementTree.Element) -> list[str]:
    known = {link.get("name") for link in root.findall("link")}
    ends = (joint.find("parent") for joint in root.findall("joint"))
    named = {end.get("link", "") for end in ends if end is not None} - known - {""}
    for name in sorted(named):
        ElementTree.SubElement(root, "link", name=name)
    return [f"no link is called {', '.join(sorted(named))}: added, without a body"] if named else []


# Meshes


def keep_readable_meshes(
    root: ElementTree.Element, packages: Packages, loader: coal.MeshLoader, where: str
) -> None:
    """Write into a URDF the path of each mesh, and take out the shapes whose mesh is unreadable.

    Meshes are read by ``loader``, which keeps them. One warning tells which are missing.
    """
    missing: dict[str, str] = {}
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            flaw = missing.get(name) or _flaw(mesh, packages, loader)
            if flaw:
                missing[name] = flaw
                link.remove(shape)
    if missing:
        told = "; ".join(f"{name}: {flaw}" for name, flaw in list(missing.items())[:_SHOWN])
        more = f"; and {len(missing) - _SHOWN} more" if len(missing) > _SHOWN else ""
        warnings.warn(
            f"{where}: not drawn, for their meshes cannot be read: {told}{more}. "
            f"{WHERE_PACKAGES_ARE}",
            stacklevel=2,
        )


def _flaw(mesh: ElementTree.Element, packages: Packages, loader: coal.MeshLoader) -> str | None:
    """Write the path of a mesh into its element, or return why it cannot be read."""
    file = packages.file(mesh.get("filename", ""))
    if file is None:
        return "no such file"
    mesh.set("filename", str(file))
    try:
        scale = np.array([float(word) for word in mesh.get("scale", "1 1 1").split()])
        loader.load(str(file), scale)
    except Exception as error:  # of any kind: they come from a parser of many formats
        return str(error).strip().splitlines()[-1]
    return None
