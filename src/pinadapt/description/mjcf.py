"""Reading an MJCF file, the format of MuJoCo, with Pinocchio."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin

from ..exceptions import RobotError
from .urdf import flaw_of_numbers, read_xml, xml_text

_COMPILED = (
    "Let MuJoCo write the compiled model as one plain file: mujoco.mj_saveLastXML(path, model)."
)
# Pinocchio ignores these elements without an error; the model would be wrong.
_SKIPPED = ("include", "attach", "replicate", "composite", "flexcomp", "frame", "plugin")
# Pinocchio does not compute the inertia of these shapes.
_NO_INERTIA = ("mesh", "ellipsoid", "hfield", "sdf")
_NUMBERS = (
    *("pos", "quat", "euler", "axisangle", "xyaxes", "zaxis", "axis", "range", "ref", "fromto"),
    *("size", "mass", "density", "diaginertia", "fullinertia", "armature", "gravity", "qpos"),
    *("damping", "frictionloss", "scale", "actuatorfrcrange"),
)


@dataclass(frozen=True)
class Mjcf:
    """An MJCF file of which Pinocchio ignores nothing that changes the model.

    Attributes:
        path: the file.
        coupled: names of joints that an <equality> couples to others.
        gravity: (3) [m/s^2] in world axes.
    """

    path: Path
    coupled: frozenset[str]
    gravity: tuple[float, ...]

    @classmethod
    def read(cls, path: Path, root: ElementTree.Element) -> Mjcf:
        """Check the root element of a file.

        Raises:
            RobotError: an element that Pinocchio would ignore, or text in place of a number.
        """
        for flaw in _flaws(root):
            raise RobotError(flaw, where=str(path), hint=_COMPILED)
        loops = [element.tag for kind in ("connect", "weld") for element in root.iter(kind)]
        if loops:
            warnings.warn(
                f"{path}: {len(loops)} kinematic loops closed by <equality> are opened.",
                stacklevel=3,
            )
        coupled = (joint.get("joint1", "") for joint in root.findall("equality/joint"))
        texts = [option.get("gravity", "") for option in root.findall("option")]
        gravity = next((text for text in texts if text), "0 0 -9.81")
        return cls(path, frozenset(coupled), tuple(map(float, gravity.split())))

    def model(self) -> pin.Model:
        """Build the model.

        Raises:
            RobotError: Pinocchio cannot read it.
        """
        try:
            model = pin.buildModelFromMJCF(str(self.path))
        except Exception as error:
            raise _unreadable(error, self.path) from error
        model.gravity.linear = np.array(self.gravity)
        return model

    def geometry(self, kind: pin.GeometryType) -> pin.GeometryModel:
        """Return the visual or collision geometry, without shapes whose mesh file is missing.

        Raises:
            RobotError: Pinocchio cannot read it.
        """
        with TemporaryDirectory() as folder:
            complete = Path(folder) / self.path.name
            root = read_xml(self.path)
            _leave_out_missing_meshes(root, self.path)
            complete.write_text(xml_text(root, str(self.path)), encoding="utf-8")
            try:
                return pin.buildGeomFromMJCF(self.model(), str(complete), kind)
            except Exception as error:
                raise _unreadable(error, self.path) from error

    def mimics(self) -> frozenset[str]:
        """Return the names of the joints that are coupled to another joint."""
        return self.coupled


def _unreadable(error: Exception, path: Path) -> RobotError:
    lines = [line for line in str(error).splitlines() if line.strip()] or [type(error).__name__]
    reason = lines[-1].removeprefix("message: ").rstrip(".")
    return RobotError(
        f"Pinocchio cannot read this MJCF file: {reason}.", where=str(path), hint=_COMPILED
    )


def _leave_out_missing_meshes(root: ElementTree.Element, path: Path) -> None:
    """Make all file paths in an MJCF absolute, and remove shapes whose mesh file is missing.

    A warning lists the missing files.
    """
    compiler = root.find("compiler")
    options = {} if compiler is None else compiler.attrib
    start = path.resolve().parent
    missing = {}
    for asset in root.iter("asset"):
        for kind in ("mesh", "texture"):
            above = start / options.get(f"{kind}dir", options.get("assetdir", ""))
            for thing in asset.findall(kind):
                file = above / thing.get("file", "")
                if kind == "mesh" and thing.get("file") and not file.is_file():
                    missing[thing.get("name", file.stem)] = str(file)
                    asset.remove(thing)
                elif thing.get("file"):
                    thing.set("file", str(file))
    for body in root.iter():
        for geom in [geom for geom in body.findall("geom") if geom.get("mesh") in missing]:
            body.remove(geom)
    if missing:
        files = ", ".join(missing.values())
        warnings.warn(f"{path}: not drawn, as these mesh files are missing: {files}.", stacklevel=3)


def keyframe(model: pin.Model) -> np.ndarray:
    """Return the configuration (nq) of the keyframe "home", else of the first, else the neutral."""
    poses = {pose.key(): pose.data() for pose in model.referenceConfigurations}
    first = next(iter(poses.values()), pin.neutral(model))
    return np.array(poses.get("home", first))


def _flaws(root: ElementTree.Element) -> Iterator[str]:
    """Yield what Pinocchio would ignore or misread."""
    for element in root.iter():
        if element.tag in _SKIPPED:
            yield f"Pinocchio does not read <{element.tag}>."
        for name in _NUMBERS:
            text = element.get(name)
            flaw = text is not None and flaw_of_numbers(text)
            if flaw:
                yield f"<{element.tag}> '{element.get('name', '')}': {name}=\"{text}\" {flaw}."
    for body in root.iter("body"):
        if not body.get("name"):
            yield "a <body> has no name; Pinocchio ignores such bodies and all that they carry."
        shapes = [geom for geom in body.findall("geom") if _has_no_inertia(geom)]
        if body.find("inertial") is None and shapes:
            yield (
                f"body '{body.get('name')}' has no <inertial>, and Pinocchio does not compute the "
                "inertia of its shapes."
            )


def _has_no_inertia(geom: ElementTree.Element) -> bool:
    massless = "0" in (geom.get("mass"), geom.get("density"))
    return not massless and (geom.get("mesh") is not None or geom.get("type") in _NO_INERTIA)
