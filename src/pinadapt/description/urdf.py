"""Reading XML, a URDF file, or a xacro file that expands to one."""

from __future__ import annotations

import math
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.parsers.expat import ExpatError, ParserCreate, errors

import coal
import numpy as np
import pinocchio as pin

from ..exceptions import RobotError
from .xacro import WHERE_PACKAGES_ARE, Packages, XacroArguments, expand

_BOUNDED = ("revolute", "prismatic")
_LIMITS = ("effort", "velocity")  # attributes of <limit> that URDF requires
_SHOWN = 3  # unreadable meshes that a warning lists
_HINT = "Write numbers with a decimal point, and separate several numbers by spaces."
_UNBOUND = errors.codes[errors.XML_ERROR_UNBOUND_PREFIX]
# element -> attribute -> count of its numbers
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
    """Return whether a source is the path of a file, and not a name."""
    return isinstance(source, Path) or "/" in source or source.endswith((".urdf", ".xml", ".xacro"))


@dataclass(frozen=True)
class Urdf:
    """A URDF with checked numbers.

    Attributes:
        path: the file it was read from.
        text: the URDF without comments; of a xacro file, its expansion.
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
        """Read a file. A URDF is data, which runs nothing; a ``.xacro`` file is a program.

        Args:
            path: of a URDF or xacro file.
            xacro: arguments of the xacro file.
            named: package name -> folder.

        Raises:
            RobotError: no such file, not XML, not a URDF, a xacro file that cannot be expanded,
                arguments for a URDF, or a number that cannot be read.
        """
        root, packages = read_xml(path), Packages(path.parent, named or {})
        if path.suffix == ".xacro":
            root = parse_xml(expand(path, xacro or {}, packages), str(path))
        elif xacro:
            raise RobotError("a URDF takes no xacro arguments.", where=str(path))
        elif any("xacro}" in str(each.tag) for each in root.iter()):
            raise RobotError(
                "it has xacro elements, which are expanded only in a file whose name ends in "
                ".xacro, as such a file is a program.",
                where=str(path),
            )
        if root.tag != "robot":
            raise RobotError(
                f"the root element is <{root.tag}>; that of a URDF is <robot>.", where=str(path)
            )
        check_urdf_numbers(root, str(path))
        fill_urdf_gaps(root, str(path))
        return cls(path, xml_text(root), packages)

    def model(self) -> pin.Model:
        """Build the model.

        Raises:
            RobotError: it is not a valid URDF.
        """
        try:
            return pin.buildModelFromXML(self.text)
        except Exception as error:
            raise RobotError(
                "not a valid URDF; the parser of Pinocchio has printed the reason above.",
                where=str(self.path),
                hint="Check that every joint has a parent and a child link that exist, and that "
                "revolute and prismatic joints have a <limit>.",
            ) from error

    def geometry(self, kind: pin.GeometryType) -> pin.GeometryModel:
        """Return the visual or collision geometry, without shapes whose mesh cannot be read."""
        root, loader = parse_xml(self.text, str(self.path)), coal.CachedMeshLoader()
        other = "collision" if kind == pin.GeometryType.VISUAL else "visual"
        for link in root.iter("link"):
            for shape in link.findall(other):
                link.remove(shape)
        keep_readable_meshes(root, self.packages, loader, str(self.path))
        text = xml_text(root)
        return pin.buildGeomFromUrdfString(self.model(), text, kind, mesh_loader=loader)

    def mimics(self) -> frozenset[str]:
        """Return the names of the mimic joints, which Pinocchio treats as independent."""
        return frozenset(
            joint.get("name", "")
            for joint in parse_xml(self.text, str(self.path)).iter("joint")
            if joint.find("mimic") is not None
        )

    def armatures(self) -> dict[str, float]:
        """Return joint name -> rotor inertia [kg m^2 or kg], for joints that state it.

        It is the attribute ``armature`` of <dynamics>, which ``Robot.urdf`` writes.
        """
        return self.joint_effects("armature")

    def joint_effects(self, attribute: str) -> dict[str, float]:
        """Return joint name -> the number of an attribute of <dynamics>, for joints that state it.

        ``Robot.urdf`` writes those that URDF does not define.
        """
        return {
            joint.get("name", ""): float(dynamics.get(attribute, "nan"))
            for joint in parse_xml(self.text, str(self.path)).findall("joint")
            for dynamics in joint.findall("dynamics")
            if attribute in dynamics.attrib
        }


@dataclass(frozen=True, eq=False)
class Origin:
    """The URDF that a robot was read from.

    Attributes:
        source: the URDF, or the path of one that is read on demand.
        model: Pinocchio model of the chain as loaded, before any change; read only.
    """

    source: Urdf | Path
    model: pin.Model

    @property
    def urdf(self) -> Urdf:
        """The URDF.

        Raises:
            RobotError: the file is missing or not a URDF any more.
        """
        return self.source if isinstance(self.source, Urdf) else Urdf.read(self.source)


# Numbers


def check_urdf_numbers(root: ElementTree.Element, where: str) -> None:
    """Refuse numbers of links and joints that cannot be read, are not finite, or are missing.

    Raises:
        RobotError: there is one; the message names the link or joint, the element and its text.
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
    """Return what is wrong with a text of numbers, ``count`` of them if given, or None."""
    numbers = [_number(word) for word in text.split()]
    readable = [number for number in numbers if number is not None]
    if len(readable) < len(numbers) or len(numbers) != (count or len(numbers)) or not numbers:
        return f"is not {'a number' if count == 1 else f'{count} numbers' if count else 'numbers'}"
    if any(math.isnan(number) for number in readable):
        return "is not a number"
    return "is not finite" if any(map(math.isinf, readable)) else None


def _number(word: str) -> float | None:
    """Return the number that a C parser reads from a word, or None."""
    try:
        return None if "_" in word or not word.isascii() else float(word)
    except ValueError:
        return None


# Gaps


def fill_urdf_gaps(root: ElementTree.Element, where: str) -> None:
    """Add what URDF requires but many files omit, and warn about it.

    These are effort and velocity limits of revolute and prismatic joints, added as 0, which means
    no limit; and links that a joint names as its parent but that are not defined, such as "world".
    """
    added = [*_fill_limits(root), *_fill_parents(root)]
    if added:
        warnings.warn(f"{where}: {'; '.join(added)}.", stacklevel=4)


def _fill_limits(root: ElementTree.Element) -> list[str]:
    open_joints = []
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        if joint.get("type") not in _BOUNDED and limit is None:
            continue
        if limit is None:
            limit = ElementTree.SubElement(joint, "limit")
        missing = [name for name in _LIMITS if name not in limit.attrib]
        if missing:
            limit.attrib.update(dict.fromkeys(missing, "0"))
            open_joints.append(f"{joint.get('name', '')} ({', '.join(missing)})")
    return (
        [f"no limit is stated, taken as unlimited: {', '.join(open_joints)}"] if open_joints else []
    )


def _fill_parents(root: ElementTree.Element) -> list[str]:
    known = {link.get("name") for link in root.findall("link")}
    ends = (joint.find("parent") for joint in root.findall("joint"))
    named = {end.get("link", "") for end in ends if end is not None} - known - {""}
    for name in sorted(named):
        ElementTree.SubElement(root, "link", name=name)
    return (
        [f"missing parent link added without a body: {', '.join(sorted(named))}"] if named else []
    )


# Meshes


def keep_readable_meshes(
    root: ElementTree.Element, packages: Packages, loader: coal.MeshLoader, where: str
) -> None:
    """Make the mesh paths in a URDF absolute, and remove shapes whose mesh cannot be read.

    ``loader`` reads the meshes and keeps them in memory. A warning lists the unreadable ones.
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
        listed = "; ".join(f"{name}: {flaw}" for name, flaw in list(missing.items())[:_SHOWN])
        more = f"; and {len(missing) - _SHOWN} more" if len(missing) > _SHOWN else ""
        warnings.warn(
            f"{where}: shapes not drawn, as their meshes cannot be read: {listed}{more}. "
            f"{WHERE_PACKAGES_ARE}",
            stacklevel=2,
        )


def _flaw(mesh: ElementTree.Element, packages: Packages, loader: coal.MeshLoader) -> str | None:
    """Make the path of a mesh absolute, or return why the mesh cannot be read."""
    file = packages.file(mesh.get("filename", ""))
    if file is None:
        return "no such file"
    mesh.set("filename", str(file))
    try:
        scale = np.array([float(word) for word in mesh.get("scale", "1 1 1").split()])
        loader.load(str(file), scale)
    except Exception as error:  # the parser of many formats raises errors of any kind
        return str(error).strip().splitlines()[-1]
    return None


def read_xml(path: Path) -> ElementTree.Element:
    """Return the root element of an XML file, without its comments.

    Raises:
        RobotError: no such file, or not well-formed XML.
    """
    if not path.is_file():
        raise RobotError("no such file.", where=str(path), hint=_neighbours(path))
    try:
        return parse_xml(path.read_bytes(), str(path))
    except OSError as error:
        raise RobotError(f"cannot be read ({error.strerror}).", where=str(path)) from error


def parse_xml(text: bytes | str, where: str) -> ElementTree.Element:
    """Return the root element of an XML document, without its comments.

    Raises:
        RobotError: not well-formed XML.
    """
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        if error.code != _UNBOUND:
            raise _malformed(error, where) from error
    except (ValueError, LookupError) as error:
        raise _malformed(error, where) from error
    try:
        return _without_namespaces(text)
    except ExpatError as error:
        raise _malformed(error, where) from error


def _malformed(error: Exception, where: str) -> RobotError:
    return RobotError(f"not well-formed XML ({error}).", where=where)


def _without_namespaces(text: bytes | str) -> ElementTree.Element:
    """Return the root element of a document that uses undeclared namespace prefixes.

    As in other URDF parsers, a prefix is part of the name.
    """
    builder, parser = ElementTree.TreeBuilder(), ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.data
    parser.Parse(text, True)
    return builder.close()


def xml_text(root: ElementTree.Element) -> str:
    """Return an XML document as text."""
    return ElementTree.tostring(root, encoding="unicode")


def _neighbours(path: Path) -> str | None:
    """Return which URDF and xacro files are in the folder of a missing one, or None."""
    if not path.parent.is_dir():
        return None
    near = sorted(str(other) for end in ("urdf", "xacro") for other in path.parent.glob(f"*.{end}"))
    return f"Robot files in that folder: {near}." if near else None
