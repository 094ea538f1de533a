"""Reading XML, a URDF file, or a xacro file that expands to one."""

from __future__ import annotations

import math
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.parsers.expat import ExpatError, ParserCreate

import pinocchio as pin

from ..exceptions import RobotError
from .chain import Mimics
from .xacro import WHERE_PACKAGES_ARE, Packages, XacroArguments, expand

ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_REQUIRED = {"mass": ("value",), "inertia": ENTRIES}
_TAGS = (
    *("origin", "axis", "mass", "inertia", "limit", "dynamics", "mimic"),
    *("box", "sphere", "cylinder", "capsule", "mesh"),
)
_VECTORS = ("xyz", "rpy", "size", "scale")  # of three numbers
_NUMBERS = (
    *(*ENTRIES, "value", "lower", "upper", "effort", "velocity", "multiplier", "offset"),
    *("radius", "length"),
)


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
        root = read_xml(path)
        packages = Packages(path.parent, named or {})
        if path.suffix == ".xacro":
            root = parse_xml(expand(path, xacro or {}, packages), str(path))
        elif xacro:
            raise RobotError("a URDF takes no xacro arguments.", where=path)
        elif any(element.tag.startswith("xacro:") for element in root.iter()):
            raise RobotError(
                "it has xacro elements, which are expanded only in a file whose name ends in "
                ".xacro, as such a file is a program.",
                where=path,
            )
        if root.tag != "robot":
            raise RobotError(
                f"the root element is <{root.tag}>; that of a URDF is <robot>.", where=path
            )
        for part in [*root.findall("link"), *root.findall("joint")]:
            for element in part.iter():
                if element.tag in _TAGS:
                    owner = f"{part.tag} '{part.get('name', '')}', "
                    for name in _REQUIRED.get(element.tag, ()):
                        element.attrib.setdefault(name, "")
                    own = element.attrib if element.tag == "dynamics" else _NUMBERS
                    check_numbers(element, own, 1, path, owner)
                    check_numbers(element, _VECTORS, 3, path, owner)
        _fill_gaps(root, str(path))
        return cls(path, xml_text(root), packages)

    def model(self, *base: pin.JointModel) -> pin.Model:
        """Build the model, on a joint of its base if one is given.

        Raises:
            RobotError: it is not a valid URDF.
        """
        try:
            return pin.buildModelFromXML(self.text, *base)
        except Exception as error:
            raise RobotError(
                "not a valid URDF; the parser of Pinocchio has printed the reason above.",
                where=self.path,
                hint="Check that every joint has a parent and a child link that exist, and that "
                "revolute and prismatic joints have a <limit>.",
            ) from error

    def geometry(self, model: pin.Model, kind: pin.GeometryType) -> pin.GeometryModel:
        """Return the visual or collision geometry, without shapes whose mesh is not found.

        A warning lists these meshes. If one cannot be read, there are no shapes at all.
        """
        root = self.root
        missing = self.packages.find_files(root)
        lost = set[str]()
        for link in root.iter("link"):
            for shape in link.findall(kind.name.lower()):
                files = {mesh.get("filename", "") for mesh in shape.iter("mesh")} & missing
                if files:
                    link.remove(shape)
                lost |= files
        if lost:
            warnings.warn(
                f"{self.path}: shapes not drawn, as their meshes are not found: "
                f"{', '.join(sorted(lost))}. {WHERE_PACKAGES_ARE}",
                stacklevel=2,
            )
        return built_shapes(self.path, pin.buildGeomFromUrdfString, model, xml_text(root), kind)

    @property
    def root(self) -> ElementTree.Element:
        """A new root element of the text."""
        return parse_xml(self.text, str(self.path))

    @cached_property
    def mimics(self) -> Mimics:
        """The mimic joints, which Pinocchio treats as independent."""
        found = {}
        for joint in self.root.findall("joint[mimic]"):
            stated = child(joint, "mimic")
            found[joint.get("name", "")] = (
                stated.get("joint", ""),
                float(stated.get("multiplier", "1")),
                float(stated.get("offset", "0")),
            )
        return found

    def joint_effect(self, attribute: str, joints: Collection[str]) -> dict[str, float]:
        """Return joint name -> an attribute of its <dynamics>, where that is stated.

        ``Robot.urdf`` writes those that URDF does not define, such as ``armature``.
        """
        return {
            name: float(child(joint, "dynamics").get(attribute, ""))
            for joint in self.root.findall(f"joint/dynamics[@{attribute}]/..")
            if (name := joint.get("name", "")) in joints
        }


def built_shapes(
    path: Path, build: Callable[..., pin.GeometryModel], *given: Any
) -> pin.GeometryModel:
    """Return the shapes that Pinocchio builds of a file; none, and a warning, if it cannot."""
    try:
        return build(*given)
    except Exception as error:  # the parser of many formats raises errors of any kind
        reason = str(error).strip().rpartition("\n")[2]
        warnings.warn(f"{path}: no shapes are drawn: {reason}.", stacklevel=3)
        return pin.GeometryModel()


@dataclass(frozen=True, eq=False)
class Origin:
    """The URDF that a robot was read from.

    Attributes:
        urdf: the URDF.
        model: Pinocchio model of the chain as loaded, before any change; read only.
    """

    urdf: Urdf
    model: pin.Model


def check_numbers(
    element: ElementTree.Element,
    names: Iterable[str],
    count: int | None,
    path: Path,
    owner: str = "",
) -> None:
    """Refuse attributes that are not numbers, which the parsers of Pinocchio would ignore.

    Args:
        element: of an XML document.
        names: of its attributes that are numbers, if they are stated.
        count: of the numbers in each; None: any.
        path: of the file.
        owner: which element it belongs to, for the message.

    Raises:
        RobotError: an attribute that is not this many finite numbers.
    """
    for name in names:
        text = element.get(name)
        if text is None:
            continue
        words = text.split()
        try:
            finite = all(math.isfinite(float(word)) for word in words)
        except ValueError:
            finite = False
        plain = text.isascii() and "_" not in text  # as a C parser reads them
        if not (finite and plain and len(words) == (count or len(words) or 1)):
            raise RobotError(
                f'{owner}<{element.tag}>: {name}="{text}" is not {count or "some"} finite '
                f"number{'' if count == 1 else 's'}.",
                where=path,
                hint="Write finite numbers with a decimal point, and separate several by spaces.",
            )


def _fill_gaps(root: ElementTree.Element, where: str) -> None:
    """Add what URDF requires but many files omit, and warn about it.

    These are effort and velocity limits of revolute and prismatic joints, added as 0, which means
    no limit; and links that a joint names as its parent but that are not defined, such as "world".
    """
    unlimited = []
    for joint in root.findall("joint"):
        if joint.get("type") in ("revolute", "prismatic") or joint.find("limit") is not None:
            stated = child(joint, "limit").attrib
            if not {"effort", "velocity"} <= stated.keys():
                unlimited.append(joint.get("name", ""))
            stated |= {"effort": "0", "velocity": "0"} | stated
    known = {link.get("name") for link in root.findall("link")}
    parents = (parent.get("link", "") for parent in root.findall("joint/parent[@link]"))
    undefined = [name for name in dict.fromkeys(parents) if name not in known]
    for name in undefined:
        ElementTree.SubElement(root, "link", name=name)
    for gap, names in (
        ("no limit is stated, taken as unlimited", unlimited),
        ("missing parent link added without a body", undefined),
    ):
        if names:
            warnings.warn(f"{where}: {gap}: {', '.join(names)}.", stacklevel=3)


# XML


def read_xml(path: Path) -> ElementTree.Element:
    """Return the root element of an XML file, without its comments.

    Raises:
        RobotError: no such file, or not well-formed XML.
    """
    try:
        return parse_xml(path.read_bytes(), str(path))
    except OSError as error:
        raise RobotError(f"cannot be read: {error.strerror}.", where=path) from error


def parse_xml(text: bytes | str, where: str) -> ElementTree.Element:
    """Return the root element of an XML document, without its comments.

    A prefix is part of a name and need not be declared, as in other URDF parsers.

    Raises:
        RobotError: not well-formed XML.
    """
    builder = ElementTree.TreeBuilder()
    parser = ParserCreate()
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text, True)
    except (ExpatError, ValueError, LookupError) as error:
        raise RobotError(f"not well-formed XML ({error}).", where=where) from error
    return builder.close()


def xml_text(root: ElementTree.Element) -> str:
    """Return an XML document as text."""
    return ElementTree.tostring(root, encoding="unicode")


def child(element: ElementTree.Element, tag: str) -> ElementTree.Element:
    """Return the child element with a tag; it is added if missing."""
    found = element.find(tag)
    return ElementTree.SubElement(element, tag) if found is None else found
