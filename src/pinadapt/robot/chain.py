"""From any Pinocchio model to the open chain between its base and one frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from ..exceptions import RobotError, did_you_mean

_CONTINUOUS = ("JointModelRUB", "JointModelRevoluteUnbounded")
_SUPPORTED = (*_CONTINUOUS, "JointModelR", "JointModelP")


def frame_id(model: pin.Model, name: str) -> int:
    """Return the index of the frame ``name``.

    Raises:
        RobotError: no frame has that name; the nearest one is suggested.
    """
    if not model.existFrame(name):
        names = [frame.name for frame in model.frames]
        raise RobotError(f"no frame is called '{name}'.{did_you_mean(name, names)}", where=model.name)
    return int(model.getFrameId(name))


def chain_joints(model: pin.Model, frame: int) -> list[int]:
    """Return the indices of the joints between the base and a frame, in order from the base."""
    return [int(joint) for joint in model.supports[model.frames[frame].parentJoint] if joint > 0]


def is_continuous(joint: pin.JointModel) -> bool:
    """Tell whether a joint is an unbounded revolute one, held in q as (cos, sin)."""
    return joint.shortname().startswith(_CONTINUOUS)


def check_joints(model: pin.Model, joints: Sequence[int]) -> None:
    """Refuse joints for which the regressor identities do not hold.

    Raises:
        RobotError: a free-flyer, a mimic joint, or any joint that is not revolute or prismatic.
    """
    for joint in joints:
        kind, name = model.joints[joint].shortname(), model.names[joint]
        if kind == "JointModelFreeFlyer":
            raise RobotError(
                f"joint '{name}' makes the base floating; the laws hold for fixed-base chains.",
                where=model.name,
                hint="Weld it (weld_root=True) to use one limb as a fixed-base arm.",
            )
        if "Mimic" in kind:
            raise RobotError(
                f"joint '{name}' mimics another joint, which adaptive laws for independent joints do not cover.",
                where=model.name,
                hint="Lock it, or choose a frame before it.",
            )
        if not kind.startswith(_SUPPORTED) or model.joints[joint].nv != 1:
            raise RobotError(
                f"joint '{name}' is of type {kind.removeprefix('JointModel')}; "
                "only revolute, continuous and prismatic joints are supported.",
                where=model.name,
                hint="Lock it, or choose a frame before it.",
            )


def check_mass_matrix(model: pin.Model, configurations: Sequence[np.ndarray]) -> None:
    """Refuse models whose mass matrix is singular or not positive definite.

    Raises:
        RobotError: M(q) has a relative eigenvalue below 1e-10 at one of the configurations; the
            massless moving bodies are named. Or its entries are not finite.
    """
    data = model.createData()
    for q in configurations:
        M = pin.crba(model, data, q)
        if not np.isfinite(M).all():
            raise RobotError("masses, inertias or placements are not finite numbers.", where=model.name)
        scale = np.sqrt(np.maximum(np.diag(M), np.finfo(float).tiny))
        if np.linalg.eigvalsh(M / np.outer(scale, scale))[0] < 1e-10:
            massless = [str(model.names[i]) for i in range(1, model.njoints) if model.inertias[i].mass <= 0.0]
            blame = f"; bodies without mass after joints {massless}" if massless else ""
            raise RobotError(
                f"the mass matrix is singular or indefinite{blame}.",
                where=model.name,
                hint="Give every moving body a positive mass and inertia, or lock the joint that moves none.",
            )


def configuration_from_angles(model: pin.Model, angles: np.ndarray) -> np.ndarray:
    """Turn one number a joint [rad or m] (nv) into a configuration (nq); continuous joints become (cos, sin)."""
    return np.asarray(pin.integrate(model, pin.neutral(model), np.asarray(angles, dtype=float)))


def angles_from_configuration(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Turn a configuration (nq) into one number a joint [rad or m] (nv)."""
    return np.asarray(pin.difference(model, pin.neutral(model), q))


def reduce_to_chain(
    model: pin.Model, visual: pin.GeometryModel | None, keep: Sequence[int], q_reference: np.ndarray
) -> tuple[pin.Model, pin.GeometryModel | None]:
    """Lock every joint but ``keep`` at ``q_reference`` (nq of the whole model); the input is not changed."""
    lock = [joint for joint in range(1, model.njoints) if joint not in set(keep)]
    if visual is None:
        return pin.buildReducedModel(model, lock, q_reference), None
    reduced, geometries = pin.buildReducedModel(model, [visual], lock, q_reference)
    return reduced, geometries[0]
