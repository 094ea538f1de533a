"""The catalogue of example robots: the folder ``robots/`` and the package example-robot-data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from .._output import read_toml
from ..exceptions import RobotError, did_you_mean
from .chain import chain_joints, frame_id
from .urdf import Urdf


@dataclass(frozen=True)
class CatalogueEntry:
    """A robot of the catalogue: an arm, or one limb of a larger robot whose base is fixed.

    Attributes:
        name: name in the catalogue.
        link: the link that carries the default task frame.
        joints: number of joints of the chain.
        task: default task.
        urdf: file in ``robots/``; None for robots of example-robot-data.
        loader: of example-robot-data, where it is not called as the robot.
        first: first joint of the limb; the joints before it are locked. None: the first of all.
        tip: (3) [m] origin of the frame in the axes of ``link``, where the description has no frame
            at the end of that link; else None.
        q0: home pose, one value per joint [rad or m], or None if it is searched.
        about: a remark.
    """

    name: str
    link: str
    joints: int
    task: str = "xyz"
    urdf: str | None = None
    loader: str | None = None
    first: str | None = None
    tip: Sequence[float] | None = None
    q0: Sequence[float] | None = None
    about: str = ""

    @property
    def frame(self) -> str:
        """The default task frame."""
        return self.link if self.tip is None else f"{self.link}_tip"

    @property
    def origin(self) -> str:
        """The name of the loader in example-robot-data, or "pinadapt"."""
        return (self.loader or self.name) if self.urdf is None else "pinadapt"

    def limb(self, model: pin.Model) -> tuple[list[int], list[int]]:
        """Return the joints of the whole model before the limb, and those of the limb."""
        chain = chain_joints(model, frame_id(model, self.frame))
        start = chain.index(model.getJointId(self.first)) if self.first else 0
        return chain[:start], chain[start:]


@cache
def catalogue() -> Mapping[str, CatalogueEntry]:
    """Return the catalogue: name -> entry."""
    return {
        name: CatalogueEntry(name, row.pop("frame"), **row)
        for name, row in read_toml(robots_folder() / "catalogue.toml").items()
    }


def catalogue_entry(name: str) -> CatalogueEntry:
    """Return one robot of the catalogue.

    Raises:
        RobotError: unknown name; the closest one is suggested.
    """
    if name not in catalogue():
        raise RobotError(
            f"'{name}' is neither a robot of the catalogue nor the path of a robot file."
            f"{did_you_mean(name, catalogue())}",
            where="source",
            hint="`pinadapt robots` lists the catalogue. Files end in .urdf, .xacro or .xml; names "
            "of the package robot_descriptions end in _description.",
        )
    return catalogue()[name]


def robots_folder() -> Path:
    """Return the folder ``robots``: inside the package, or beside ``src`` in a checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "robots"
    return inside if inside.is_dir() else package.parents[1] / "robots"


def whole_names() -> list[str]:
    """Return the names of the whole robots of example-robot-data."""
    return list(_loaders().ROBOTS)


@cache
def whole_robot(name: str) -> tuple[Urdf, pin.Model, np.ndarray]:
    """Return URDF, model and reference pose (nq) of a whole robot; callers must not change them."""
    kind = _loaders().ROBOTS[name]
    urdf = Urdf.read(example_path(name))
    model = urdf.model(*[pin.JointModelFreeFlyer()] if kind.free_flyer else ())
    if hasattr(kind, "freeflyer_ori"):
        model.jointPlacements[1].rotation = kind.freeflyer_ori
    pose = pin.neutral(model)
    if kind.srdf_filename:
        pose = _loaders().readParamsFromSrdf(
            model,
            str(_folder(kind) / kind.srdf_subpath / kind.srdf_filename),
            False,
            kind.has_rotor_parameters,
            kind.ref_posture,
        )
    return urdf, model, pose


@lru_cache(maxsize=8)  # the meshes of a robot take up to 200 MB
def whole_geometry(name: str, kind: pin.GeometryType) -> pin.GeometryModel:
    """Return visual or collision geometry of a whole robot; callers must not change it."""
    urdf, model, _ = whole_robot(name)
    return urdf.geometry(model, kind)


def example_path(origin: str) -> Path:
    """Return the URDF file that a loader of example-robot-data reads."""
    kind = _loaders().ROBOTS[origin]
    return _folder(kind) / kind.urdf_subpath / kind.urdf_filename


def _folder(kind: Any) -> Path:
    """Return the folder that holds the robot of a loader."""
    return Path(kind.model_path or _loaders().getModelPath(kind.path), kind.path)


def _loaders() -> Any:
    from example_robot_data import robots_loader  # slow to import; a user's URDF does not need it

    return robots_loader
