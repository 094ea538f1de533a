"""The open chain from the base of a Pinocchio model to one frame: joints, limits, checks."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from .._checks import LARGEST
from ..exceptions import RobotError, did_you_mean

Mimics: TypeAlias = Mapping[str, tuple[str, float, float]]
"""A joint -> the one that it follows, ratio and offset, q_j = ratio q_i + offset."""
Closures: TypeAlias = Sequence[tuple[str, str, int]]
"""Two frames that move alike, and in how many coordinates: 3 of position, or these and 3 angles."""
Bounds: TypeAlias = np.ndarray
"""Lower and upper limits (2, nv) [rad or m]."""
ENDS = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)  # frames at which a chain may end
_LINK_MARK = "(link) "  # of links, where none may share its name with a joint


# Frames, links and joints


def frame_id(model: pin.Model, name: str) -> int:
    """Return the index of a frame; if a link and a joint share the name, that of the link.

    Raises:
        RobotError: no frame has that name; the closest one is suggested.
    """
    for kind in (pin.FrameType.BODY, *pin.FrameType.values.values()):
        if model.existFrame(name, kind):
            return model.getFrameId(name, kind)
    names = [frame.name for frame in model.frames if frame.type in ENDS]
    raise RobotError(
        f"'{model.name}' has no frame '{name}'.{did_you_mean(name, names)}", where="frame"
    )


def frame_named(model: pin.Model, name: str) -> pin.Frame:
    """Return a frame by its name, see ``frame_id``."""
    return model.frames[frame_id(model, name)]


def links_of(model: pin.Model, joint: int) -> list[str]:
    """Return the names of the links that a joint moves, or the joint's own name if none."""
    links = [
        frame.name
        for frame in model.frames
        if frame.type == pin.FrameType.BODY and frame.parentJoint == joint
    ]
    return links or [model.names[joint]]


def massless_joints(model: pin.Model) -> list[int]:
    """Return the indices of the joints that move a body without mass."""
    return [i for i in range(1, model.njoints) if model.inertias[i].mass <= 0.0]


def is_physical(pi: np.ndarray) -> bool:
    """Return whether ten inertial parameters pi (10) belong to a body with a mass distribution.

    This holds if the pseudo-inertia is positive definite (Wensing, Kim, Slotine 2018). The bound on
    its eigenvalues is relative: rows and columns are scaled to a unit diagonal.
    """
    P = pin.PseudoInertia.FromDynamicParameters(pi).toMatrix()
    scale = np.sqrt(np.maximum(np.diag(P), 0.0))
    return bool(scale.all() and np.linalg.eigvalsh(P / np.outer(scale, scale))[0] > 1e-9)


def check_physical(body: pin.Inertia, link: str, where: str) -> None:
    """Refuse the inertia of a link that no distribution of mass has.

    Raises:
        RobotError: it is not physical.
    """
    if not is_physical(body.toDynamicParameters()):
        raise RobotError(
            f"the inertia of the body of link '{link}' is not physical: no distribution of mass "
            "has it.",
            where=where,
            hint='The adaptation "natural" keeps all bodies physical.',
        )


def chain_joints(model: pin.Model, frame: int) -> list[int]:
    """Return the indices of the joints from the base to a frame, in this order; no free-flyer."""
    _, *joints = model.supports[model.frames[frame].parentJoint]
    return [joint for joint in joints if not is_free_flyer(model.joints[joint])]


def is_slide(joint: pin.JointModel) -> bool:
    """Return whether a joint is prismatic."""
    return joint.shortname().startswith("JointModelP")


def sliding_joints(model: pin.Model) -> np.ndarray:
    """Return whether each joint (nv) is prismatic."""
    return np.array([is_slide(joint) for joint in model.joints[1:]])


def is_free_flyer(joint: pin.JointModel) -> bool:
    """Return whether a joint is the free-flyer of a floating base."""
    return joint.shortname() == "JointModelFreeFlyer"


def axis_of(model: pin.Model, joint: int) -> np.ndarray:
    """Return the axis (3) of a joint in the joint frame."""
    part = model.joints[joint]
    scratch = part.createData()
    part.calc(scratch, pin.neutral(model))
    return np.reshape(scratch.S, (2, 3)).sum(axis=0)  # the linear or the angular part is zero


# Reducing a model to the chain


def with_unique_names(model: pin.Model) -> pin.Model:
    """Return a copy whose links share no name with a joint, which Pinocchio asks for sometimes."""
    model = model.copy()
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            frame.name = _LINK_MARK + frame.name
    return model


def restore_names(model: pin.Model) -> None:
    """Undo ``with_unique_names`` in a model that was made from its copy."""
    for frame in model.frames:
        frame.name = frame.name.removeprefix(_LINK_MARK)


def reduced(
    model: pin.Model, keep: Sequence[int], q_reference: np.ndarray, *shapes: pin.GeometryModel
) -> tuple[pin.Model, Sequence[pin.GeometryModel]]:
    """Return a copy with all joints but ``keep`` locked at ``q_reference`` (nq), and its shapes."""
    lock = [joint for joint in range(1, model.njoints) if joint not in keep]
    chain, geometries = pin.buildReducedModel(
        with_unique_names(model), list(shapes), lock, q_reference
    )
    restore_names(chain)
    return chain, geometries


# Configurations and joint angles


def configuration_from_angles(model: pin.Model, angles: np.ndarray) -> np.ndarray:
    """Return the configuration (nq) of joint positions (nv) [rad or m]."""
    return pin.integrate(model, pin.neutral(model), angles)


def angles_from_configuration(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Return the joint positions (nv) [rad or m] of a configuration (nq)."""
    return pin.difference(model, pin.neutral(model), q)


# Limits and size


def _widest(model: pin.Model, rounding: float = 0.0) -> np.ndarray:
    """Return the range (nv) beyond which joints are free: two turns, but a kilometre of slides."""
    return np.where(sliding_joints(model), 1e3, 4.0 * np.pi + rounding)


def position_limits(model: pin.Model) -> Bounds:
    """Return lower and upper joint limits (2, nv) [rad or m]; +-inf for joints without limits.

    URDF files write 0, 1.8e308 or infinity for "no limit". A range that is empty, or wider than two
    turns (as files round them) or a kilometre, therefore counts as no limit.
    """
    low, high = stated = _stated_limits(model)
    # 6.2832 for 2 pi, in each limit; half, twice: the same files
    limited = (low < high) & (high <= low + _widest(model, rounding=1e-3))
    return np.where(limited, stated, [[-np.inf], [np.inf]])


def _stated_limits(model: pin.Model) -> Bounds:
    """Return lower and upper limits of the description; NaN for joints of two coordinates."""
    turns = np.array(model.nqs[1:]) > 1
    stated = np.array([model.lowerPositionLimit, model.upperPositionLimit])
    return np.where(turns, np.nan, stated[:, model.idx_qs[1:]])


def position_bounds(model: pin.Model) -> Bounds:
    """Return bounds (2, nv) [rad or m] of all placements that joints have.

    The limits, but half a turn to each side where they leave two turns or more; 1 m without limits.
    """
    low, high = limits = position_limits(model)
    half = np.where(sliding_joints(model), 1.0, np.pi)
    return np.where(high <= low + _widest(model), limits, [-half, half])


def effort_limits(model: pin.Model) -> np.ndarray:
    """Return the effort limits (nv) [N m or N]; inf if the description has 0, 1.8e308 or inf."""
    return _limits(model.effortLimit)


def velocity_limits(model: pin.Model) -> np.ndarray:
    """Return the velocity limits (nv) [rad/s or m/s]; inf if it has 0, 1.8e308 or inf."""
    return _limits(model.velocityLimit)


def _limits(stated: np.ndarray) -> np.ndarray:
    return np.where((stated > 0.0) & (stated < LARGEST), stated, np.inf)


def reach(model: pin.Model, frame: int, joints: Sequence[int] | None = None) -> float:
    """Return the length [m] of the stretched chain from its first joint to a frame.

    Prismatic joints count with their stroke. One without limits, such as a mobile base, counts
    only if the chain has no other extent: then with 2 m.

    Args:
        model: of the chain.
        frame: index of the frame.
        joints: of the chain, from the base; None: all of the model.
    """
    own = range(1, model.njoints) if joints is None else joints
    slides = [joint - 1 for joint in own if is_slide(model.joints[joint])]
    strokes = np.ptp(position_bounds(model)[:, slides], axis=0)
    limited = np.isfinite(position_limits(model)[0, slides])
    steps = [*(model.jointPlacements[joint] for joint in own[1:]), model.frames[frame].placement]
    length = sum(np.linalg.norm(step.translation) for step in steps)
    length += strokes[limited].sum()
    return float(length or strokes.sum())


def jacobian_bounds(model: pin.Model, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Return bounds of |J_i|, column by column of the frame's Jacobian, over all configurations.

    For a revolute joint, |J_i| is the distance of the frame from the joint axis. It is at most the
    distance of the next joint from that axis, which is constant, plus the lengths of all links
    after it, plus the strokes of the slides among them. A prismatic joint translates the frame at
    its own velocity and does not rotate it.

    Returns:
        Linear part (nv) [m/rad, or 1 for slides], infinite for joints before a slide without
        limits; angular part (nv), 1 or 0.
    """
    slides = sliding_joints(model)
    stroke = np.where(slides, np.abs(position_limits(model)).max(axis=0), 0.0)
    placements = [*model.jointPlacements[2:], model.frames[frame].placement]
    steps = [place.translation for place in placements]
    linear = np.ones(model.nv)
    for i in np.flatnonzero(~slides).tolist():
        first = np.linalg.norm(np.cross(axis_of(model, i + 1), steps[i]))
        rest = sum(map(np.linalg.norm, steps[i + 1 :]))
        linear[i] = first + rest + stroke[i + 1 :].sum()
    return linear, 1.0 - slides


# Checks


def check_numbers(model: pin.Model) -> None:
    """Refuse impossible numbers.

    Raises:
        RobotError: a placement, inertia or gravity that is not finite or too large, or a negative
            mass; the joint is named.
    """
    for name, placement, body in zip(
        model.names, model.jointPlacements, model.inertias, strict=True
    ):
        numbers = [*placement.homogeneous.flat, *body.toDynamicParameters(), *model.gravity.linear]
        if not (np.abs(numbers) <= LARGEST).all() or body.mass < 0.0:  # the first also for NaN
            raise RobotError(
                f"the placement of joint '{name}', its body or gravity has a number that is not "
                f"finite or exceeds {LARGEST:.3g}, or a negative mass.",
                where=model.name,
            )


def check_joints(model: pin.Model, joints: Sequence[int], mimics: Collection[str] = ()) -> None:
    """Refuse joints that the control laws do not cover.

    Args:
        model: Pinocchio model.
        joints: indices of the joints.
        mimics: names of joints that depend on others.

    Raises:
        RobotError: a mimic joint, or a joint that is neither revolute nor prismatic.
    """
    for joint in joints:
        if not is_independent(model, joint, mimics):
            kind = model.joints[joint].shortname().removeprefix("JointModel")
            raise RobotError(
                f"joint '{model.names[joint]}' mimics another one, or is of type {kind}; joints "
                "of a chain are independent, and revolute, continuous or prismatic.",
                where=model.name,
                hint="Lock it, choose a frame before it, or, if it mimics one, "
                'task="joint" without a frame.',
            )


def is_independent(model: pin.Model, joint: int, mimics: Collection[str]) -> bool:
    """Return whether a joint is revolute, continuous or prismatic, and follows no other one."""
    part = model.joints[joint]
    kind = part.shortname().removeprefix("JointModel")
    follows = model.names[joint] in mimics or "Mimic" in kind
    return not follows and part.nv == 1 and kind[0] in "RP"


def check_position_limits(model: pin.Model) -> None:
    """Refuse a lower joint limit above the upper one.

    Ignoring such limits would let an arm run into its stops.

    Raises:
        RobotError: there is one; the message names the joint and both numbers.
    """
    for name, low, high in zip(model.names[1:], *_stated_limits(model), strict=True):
        if low > high:
            raise RobotError(
                f"the lower limit of joint '{name}', {low:g}, is above its upper limit, {high:g}.",
                where=model.name,
                hint="Swap them in the description, or set both to 0 for no limit.",
            )


def check_mass_matrix(model: pin.Model, configurations: Sequence[np.ndarray]) -> None:
    """Refuse a mass matrix that is singular or not positive definite.

    Raises:
        RobotError: M(q), scaled to a unit diagonal, has an eigenvalue below 1e-10 at one of the
            configurations (nq). The message names the moving links without mass, or else a joint
            that moves without inertia.
    """
    data = model.createData()
    for q in configurations:
        M = pin.crba(model, data, q)
        scale = np.sqrt(np.maximum(np.diag(M), np.finfo(float).tiny))
        eigenvalues, vectors = np.linalg.eigh(M / np.outer(scale, scale))
        if eigenvalues[0] >= 1e-10:
            continue
        weakest = int(np.argmax(np.abs(vectors[:, 0] / scale))) + 1
        links = [links_of(model, joint)[0] for joint in massless_joints(model) or [weakest]]
        raise RobotError(
            f"the mass matrix is singular or indefinite: {links} have no mass or inertia.",
            where=model.name,
            hint="Give each of them an <inertial>, or lock the joint; or state the mass of the "
            "whole robot, and links without mass get a share by their shapes: load(..., mass=KG), "
            "`init --mass KG`, in a scenario robot.mass.",
        )
