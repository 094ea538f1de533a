"""A whole robot as described by a name, a file or an object, before one chain is selected."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from pinocchio.robot_wrapper import RobotWrapper

from .._checks import mapping, shown
from ..exceptions import RobotError, did_you_mean
from .catalogue import (
    catalogue,
    catalogue_entry,
    robots_folder,
    whole_geometry,
    whole_names,
    whole_robot,
)
from .chain import Closures, Mimics, check_numbers, frame_id
from .missing_inertia import with_inertias
from .mjcf import Mjcf, keyframe
from .urdf import Urdf, is_path, read_xml
from .xacro import XacroArguments

Source: TypeAlias = "str | Path | pin.Model | RobotWrapper"
Geometry: TypeAlias = Callable[[pin.GeometryType], "pin.GeometryModel | None"]


@dataclass(frozen=True)
class Description:
    """A whole robot with all its joints.

    Attributes:
        name: of the robot.
        model: Pinocchio model of all its joints.
        geometry: function that reads the visual or collision geometry.
        q_reference: (nq) reference configuration.
        mimics: joints that follow others, see ``Mimics``.
        frame: default task frame, of a chain of the catalogue, or None.
        task: default task, or None.
        locked: joints to lock.
        urdf: the URDF it was read from, or None.
        closures: loops, see ``Closures``.
        passive: joints without a motor.
    """

    name: str
    model: pin.Model
    geometry: Geometry
    q_reference: np.ndarray
    mimics: Mimics = field(default_factory=dict)
    frame: str | None = None
    task: str | None = None
    locked: tuple[str, ...] = ()
    urdf: Urdf | None = None
    closures: Closures = ()
    passive: tuple[str, ...] = ()


def describe(source: Source, xacro: XacroArguments | None, mass: float | None) -> Description:
    """Return the whole robot that a name, a path or an object describes.

    Args:
        source: see ``load``.
        xacro: arguments of a xacro file.
        mass: mass of the whole robot [kg]; bodies without inertia get a share of it.

    Raises:
        RobotError: the source is not found, cannot be read or has impossible numbers, or xacro
            arguments are given for another kind of source.
    """
    arguments = mapping(xacro, "xacro", RobotError)
    if isinstance(source, RobotWrapper | pin.Model):
        found = _from_object(source)
    elif not isinstance(source, str | Path):
        raise RobotError(
            "expected a name, the path of a file, a pin.Model or a RobotWrapper, got "
            f"{shown(source)}.",
            where="source",
            hint="`pinadapt robots` lists the names.",
        )
    elif is_path(source):
        found = _from_file(Path(source).expanduser(), arguments)
    else:
        found = _from_name(str(source), arguments)
    check_numbers(found.model)
    if mass is None:
        return found
    return replace(found, model=with_inertias(found.model, found.geometry, mass, found.name))


def _from_name(name: str, arguments: XacroArguments) -> Description:
    """Return a robot of robot_descriptions, of example-robot-data or of the catalogue."""
    if is_description_name(name):
        path, own, packages = named_description(name)
        return replace(_from_file(path, {**own, **arguments}, packages), name=name)
    if arguments:
        raise RobotError(f"'{name}' is not a xacro file; it takes no arguments.", where="xacro")
    if name not in catalogue() and name in whole_names():
        return _whole_robot(name)
    return _from_catalogue(name)


def _from_object(source: pin.Model | RobotWrapper) -> Description:
    model = getattr(source, "model", source)
    for joint in range(2, model.njoints):
        if model.parents[joint] not in model.supports[joint - 1]:
            raise RobotError(
                f"joint '{model.names[joint]}' comes after those of another branch, for which "
                "Pinocchio's mass matrix is wrong.",
                where="source",
                hint="Add all joints of a branch before those of the next.",
            )
    shapes = {
        pin.GeometryType.VISUAL: getattr(source, "visual_model", None),
        pin.GeometryType.COLLISION: getattr(source, "collision_model", None),
    }
    return Description(model.name, model, shapes.get, getattr(source, "q0", pin.neutral(model)))


def _from_file(
    path: Path, xacro: XacroArguments | None = None, packages: Mapping[str, str] | None = None
) -> Description:
    """Read a URDF, xacro or MJCF file."""
    root = read_xml(path)
    own = dict[str, Any]()
    file: Urdf | Mjcf
    if root.tag == "mujoco" and not xacro:
        file = Mjcf.read(path, root)
        model = file.model()
        own = {"closures": file.closures, "passive": file.passive(model)}
    else:
        file = own["urdf"] = Urdf.read(path, xacro, packages)
        model = file.model()
    return Description(
        model.name, model, partial(file.geometry, model), keyframe(model), file.mimics, **own
    )


def _whole_robot(name: str) -> Description:
    """Return a whole robot of example-robot-data, by the name of its loader."""
    urdf, model, q_reference = whole_robot(name)
    return Description(
        name,
        model.copy(),
        partial(whole_geometry, name),
        q_reference.copy(),
        urdf.mimics,
        urdf=urdf,
    )


def _from_catalogue(name: str) -> Description:
    entry = catalogue_entry(name)
    if entry.urdf is None:
        whole = _whole_robot(entry.origin)
    else:
        whole = _from_file(robots_folder() / entry.urdf)
    model = whole.model
    if entry.tip is not None:
        index = frame_id(model, entry.link)
        link = model.frames[index]
        model.addFrame(
            pin.Frame(
                entry.frame,
                link.parentJoint,
                index,
                link.placement * pin.SE3(np.eye(3), np.array(entry.tip)),
                pin.FrameType.OP_FRAME,
            )
        )
    before, limb = entry.limb(model)
    for joint, angle in zip(limb, entry.q0 or (), strict=entry.q0 is not None):
        part = model.joints[joint]
        whole.q_reference[part.idx_q : part.idx_q + part.nq] = (
            angle if part.nq == 1 else [np.cos(angle), np.sin(angle)]
        )
    return replace(
        whole,
        name=entry.name,
        frame=entry.frame,
        task=entry.task,
        locked=tuple(model.names[joint] for joint in before),
    )


# The package robot_descriptions


def is_robot_name(source: str) -> bool:
    """Return whether a name is one of those that ``pinadapt.load`` takes."""
    return source in catalogue() or is_description_name(source) or source in whole_names()


def is_description_name(source: str) -> bool:
    """Return whether a name is one of robot_descriptions, such as ``iiwa14_description``."""
    return source.endswith("_description")


def named_description(name: str) -> tuple[Path, Mapping[str, str], Mapping[str, str]]:
    """Return a description of the package robot_descriptions, downloaded at its first use.

    Returns:
        URDF, xacro or MJCF file; arguments of the xacro file; package name -> folder.

    Raises:
        RobotError: the package is not installed, has no such description, or cannot download it.
    """
    try:
        known = import_module("robot_descriptions").DESCRIPTIONS
        module = import_module(f"robot_descriptions.{name}") if name in known else None
    except Exception as error:  # of the import, git, the network, the disk
        raise RobotError(
            f"the package robot_descriptions does not give '{name}' ({error}).",
            where="source",
            hint='Install it: pip install "pinadapt[descriptions]". At its first use a description '
            "is cloned from GitHub with git: try again online, or set ROBOT_DESCRIPTIONS_CACHE to "
            "a folder that already contains it.",
        ) from error
    kinds = ("URDF_PATH", "XACRO_PATH", "MJCF_PATH")
    path = next((getattr(module, kind) for kind in kinds if hasattr(module, kind)), None)
    if path is None:
        raise RobotError(
            f"the package robot_descriptions has no '{name}'.{did_you_mean(name, known)}",
            where="source",
        )
    return (
        Path(path),
        {} if hasattr(module, "URDF_PATH") else getattr(module, "XACRO_ARGS", {}),
        getattr(module, "XACRO_PACKAGE_PATHS", {}),
    )
