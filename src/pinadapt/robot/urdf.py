"""Reading a URDF file."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pinocchio as pin

from ..exceptions import RobotError


def is_path(source: str | Path) -> bool:
    """Tell whether a source is the path of a file; other text is a name in the catalogue."""
    return isinstance(source, Path) or "/" in source or source.endswith((".urdf", ".xml"))


def read_urdf(path: Path) -> pin.Model:
    """Build the model of a URDF file.

    Raises:
        RobotError: no such file, not XML, or not a URDF.
    """
    _check_xml(path)
    try:
        return pin.buildModelFromUrdf(str(path))
    except Exception as error:
        raise RobotError(
            "this XML is not a valid URDF; the messages of the parser stand above.",
            where=str(path),
            hint="Every joint needs a parent and child that exist, revolute and prismatic ones "
            "also <limit>.",
        ) from error


def read_visual(path: Path) -> pin.GeometryModel | None:
    """Read the visual geometry of a URDF file, or warn and return None where a mesh is missing.

    Meshes named ``package://`` are searched in the folders above the file.
    """
    model, folders = read_urdf(path), [str(folder) for folder in path.resolve().parents]
    try:
        return pin.buildGeomFromUrdf(
            model, str(path), pin.GeometryType.VISUAL, package_dirs=folders
        )
    except Exception as error:  # a robot can be controlled without its meshes
        warnings.warn(
            f"{path}: {str(error).strip().rstrip('.')}. The robot is drawn as a stick figure. "
            "Meshes are looked for in the folders above the file and in the folders of "
            "ROS_PACKAGE_PATH.",
            stacklevel=2,
        )
        return None


def mimic_joints(path: Path) -> frozenset[str]:
    """Return the names of the joints that mimic another; Pinocchio makes them independent."""
    robot = ElementTree.parse(path).getroot()
    return frozenset(
        joint.get("name", "") for joint in robot.iter("joint") if joint.find("mimic") is not None
    )


def _check_xml(path: Path) -> None:
    if not path.is_file():
        near = (
            sorted(str(other) for other in path.parent.glob("*.urdf"))
            if path.parent.is_dir()
            else []
        )
        raise RobotError(
            "no such file.", where=str(path), hint=f"URDF files there: {near}." if near else None
        )
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise RobotError(f"not well-formed XML ({error}).", where=str(path)) from error
    if root.tag != "robot":
        raise RobotError(f"the root element is <{root.tag}>, a URDF has <robot>.", where=str(path))
