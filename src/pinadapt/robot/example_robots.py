"""The descriptions of example-robot-data; their meshes, slow to read, only where they are drawn."""

from __future__ import annotations

from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from pinocchio.robot_wrapper import RobotWrapper

from .urdf import mimic_joints


def _loaders() -> Any:
    from example_robot_data import robots_loader  # here, because a user's own URDF needs none

    return robots_loader


@cache
def example_path(origin: str) -> Path:
    """Return the URDF file of a loader."""
    return _folder(origin) / _file(origin)


def _file(origin: str) -> Path:
    kind = _loaders().ROBOTS[origin]
    return Path(kind.path, kind.urdf_subpath, kind.urdf_filename)


def _folder(origin: str) -> Path:
    """Return the folder of all robots."""
    loaders = _loaders()
    return Path(loaders.ROBOTS[origin].model_path or loaders.getModelPath(str(_file(origin))))


@cache
def example_mimics(origin: str) -> frozenset[str]:
    """Return the names of the joints that mimic another."""
    return mimic_joints(example_path(origin))


@cache
def example_robot(origin: str) -> tuple[pin.Model, np.ndarray]:
    """Return a robot's model as its loader makes it and its pose (nq); neither is to be written."""
    loaders, kind = _loaders(), _loaders().ROBOTS[origin]
    if _is_special(origin):
        whole = _whole(origin)
        return whole.model, whole.q0
    base = [pin.JointModelFreeFlyer()] if kind.free_flyer else []
    model = pin.buildModelFromUrdf(str(example_path(origin)), *base)
    if not kind.srdf_filename:
        return model, pin.neutral(model)
    srdf = _folder(origin) / kind.path / kind.srdf_subpath / kind.srdf_filename
    q0 = loaders.readParamsFromSrdf(
        model, str(srdf), False, kind.has_rotor_parameters, kind.ref_posture
    )
    return model, q0


@lru_cache(maxsize=8)  # meshes take up to 200 MB a robot
def example_visual(origin: str) -> pin.GeometryModel:
    """Read the visual geometry of a robot; not to be written."""
    if _is_special(origin):
        return _whole(origin).visual_model
    model, file = example_robot(origin)[0], str(example_path(origin))
    packages = [str(_folder(origin) / ".." / "..")]
    return pin.buildGeomFromUrdf(model, file, pin.GeometryType.VISUAL, package_dirs=packages)


def _is_special(origin: str) -> bool:
    """Tell whether a loader changes the model after reading it."""
    loaders = _loaders()
    return loaders.ROBOTS[origin].__init__ is not loaders.RobotLoader.__init__


@lru_cache(maxsize=8)
def _whole(origin: str) -> RobotWrapper:
    return _loaders().load(origin)
