"""The open chain between the base of a Pinocchio model and one frame: joints, limits, checks."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from .._checks import LARGEST
from ..exceptions import RobotError, did_you_mean

_WORLD = "universe"
_SUPPORTED = ("JointModelR", "JointModelP")
_LINK_MARK = "(link) "
_ROUNDING = 1e-9  # [rad or m] by which a home pose may exceed a limit without a warning
_NO_LIMIT = 1e300  # effort and velocity limits from here on mean that there is none
_TRAVEL = 2.0  # [m], stroke of an unlimited slide where a chain has no other extent
_PHYSICAL = 1e-9  # smallest eigenvalue of a scaled pseudo-inertia
_REGULAR = 1e-10  # smallest eigenvalue of a scaled mass matrix


# Frames, links and joints


def frame_id(model: pin.Model, name: str) -> int:
    """Return the index of the frame ``name``; where a link and a joint share it, of the link.

    Raises:
        RobotError: no frame has that name; the nearest one is suggested.
    """
    found = [i for i, frame in enumerate(model.frames) if frame.name == name]
    if not found:
        names = [frame.name for frame in model.frames]
        raise RobotError(
            f"no frame of '{model.name}' is called '{name}'.{did_you_mean(name, names)}",
            where="frame",
        )
    links = [i for i in found if model.frames[i].type == pin.FrameType.BODY]
    return (links or found)[0]


def links_of(model: pin.Model, joint: int) -> list[str]:
    """Return the names of the links that move with a joint, or its own where it has none."""
    links = [
        str(frame.name)
        for frame in model.frames
        if frame.type == pin.FrameType.BODY and frame.parentJoint == joint
    ]
    return links or [str(model.names[joint])]


def massless_joints(model: pin.Model) -> list[int]:
    """Return the indices of the joints whose bodies have no mass."""
    return [i for i in range(1, model.njoints) if model.inertias[i].mass <= 0.0]


def is_physical(pi: np.ndarray) -> bool:
    """Return whether ten inertial parameters pi (10) belong to a body with a mass distribution.

    This holds if the pseudo-inertia is positive definite (Wensing, Kim, Slotine 2018). The bound on
    its eigenvalues is relative: rows and columns are scaled to a unit diagonal.
    """
    if pi[0] <= 0.0:
        return False
    P = pin.PseudoInertia.FromDynamicParameters(pi).toMatrix()
    if (np.diag(P) <= 0.0).any():
        return False
    scale = np.sqrt(np.diag(P))
    return bool(np.linalg.eigvalsh(P / np.outer(scale, scale))[0] > _PHYSICAL)


def chain_joints(model: pin.Model, frame: int) -> list[int]:
    """Return the indices of the joints between the base and a frame, in order from the base."""
    return [int(joint) for joint in model.supports[model.frames[frame].parentJoint] if joint > 0]


def is_slide(joint: pin.JointModel) -> bool:
    """Tell whether a joint is prismatic."""
    return bool(joint.shortname().startswith("JointModelP"))


def joint_unit(joint: pin.JointModel) -> str:
    """Return the unit of a joint's coordinate."""
    return "m" if is_slide(joint) else "rad"


def is_free_flyer(joint: pin.JointModel) -> bool:
    """Tell whether a joint is the six-dof one of a floating base."""
    return bool(joint.shortname() == "JointModelFreeFlyer")


# Reducing a model to the chain


def reduce_to_chain(model: pin.Model, keep: Sequence[int], q_reference: np.ndarray) -> pin.Model:
    """Lock every joint but ``keep`` at ``q_reference`` (nq of the whole), on a copy."""
    return _reduced(model, [], keep, q_reference)[0]


def reduce_visual(
    model: pin.Model, visual: pin.GeometryModel, keep: Sequence[int], q_reference: np.ndarray
) -> pin.GeometryModel:
    """Return the visual geometry of a chain from that of the whole model."""
    return _reduced(model, [visual], keep, q_reference)[1][0]


def _reduced(
    model: pin.Model,
    visuals: list[pin.GeometryModel],
    keep: Sequence[int],
    q_reference: np.ndarray,
) -> tuple[pin.Model, Sequence[pin.GeometryModel]]:
    lock = [joint for joint in range(1, model.njoints) if joint not in set(keep)]
    model = model.copy()
    _rename_links(model, mark=True)
    reduced, geometries = pin.buildReducedModel(model, visuals, lock, q_reference)
    _rename_links(reduced, mark=False)
    return reduced, geometries


def _rename_links(model: pin.Model, *, mark: bool) -> None:
    """Mark links that share a frame's name, which buildReducedModel refuses; or unmark them."""
    names = [frame.name for frame in model.frames]
    times = Counter(names)
    for frame, name in zip(model.frames, names, strict=True):
        if not mark:
            frame.name = name.removeprefix(_LINK_MARK)
        elif frame.type == pin.FrameType.BODY and times[name] > 1:
            frame.name = _LINK_MARK + name


# Configurations and joint angles


def configuration_from_angles(model: pin.Model, angles: np.ndarray) -> np.ndarray:
    """Turn one number a joint [rad or m] (nv) into a configuration (nq)."""
    return np.asarray(pin.integrate(model, pin.neutral(model), np.asarray(angles, dtype=float)))


def angles_from_configuration(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Turn a configuration (nq) into one number a joint [rad or m] (nv)."""
    return np.asarray(pin.difference(model, pin.neutral(model), q))


# Limits and size


def position_limits(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper joint limits (nv) [rad or m], infinite where there are none.

    URDFs say "no limit" with 0, 1.8e308 or infinity: any empty or wider-than-two-turns range counts
    as absent.
    """
    lower, upper = np.full(model.nv, -np.inf), np.full(model.nv, np.inf)
    for joint in model.joints[1:]:
        if joint.nq == 1:
            low, high = (
                float(model.lowerPositionLimit[joint.idx_q]),
                float(model.upperPositionLimit[joint.idx_q]),
            )
            if low < high and high - low <= 4 * np.pi:
                lower[joint.idx_v], upper[joint.idx_v] = low, high
    return lower, upper


def position_bounds(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return joint bounds (nv) [rad or m]; an absent limit becomes half a turn or one metre."""
    lower, upper = position_limits(model)
    half = np.array([1.0 if is_slide(joint) else np.pi for joint in model.joints[1:]])
    return np.where(np.isfinite(lower), lower, -half), np.where(np.isfinite(upper), upper, half)


def effort_limits(model: pin.Model) -> np.ndarray:
    """Return the effort limits (nv) [N m or N]; 0, 1.8e308 and inf in a URDF mean none: inf."""
    limits = np.array(model.effortLimit, dtype=float)
    return np.where((limits > 0.0) & (limits < _NO_LIMIT), limits, np.inf)


def velocity_limits(model: pin.Model) -> np.ndarray:
    """Return speed limits (nv) [rad/s or m/s]; 0, 1.8e308 and inf in a URDF mean none: inf."""
    limits = np.array(model.velocityLimit, dtype=float)
    return np.where((limits > 0.0) & (limits < _NO_LIMIT), limits, np.inf)


def warn_beyond_limits(model: pin.Model, angles: np.ndarray) -> None:
    """Warn of joints of a home pose (nv) [rad or m] that are outside their limits."""
    lower, upper = position_limits(model)
    outside = [
        f"joint '{model.names[joint.id]}' at {angles[i]:.6g} {joint_unit(joint)}, limits "
        f"{lower[i]:.6g} to {upper[i]:.6g}"
        for joint in model.joints[1:]
        if not lower[(i := joint.idx_v)] - _ROUNDING <= angles[i] <= upper[i] + _ROUNDING
    ]
    if outside:
        warnings.warn(f"q0 is outside the joint limits: {'; '.join(outside)}.", stacklevel=3)


def reach(model: pin.Model, frame: int) -> float:
    """Return the length [m] of the stretched chain from first joint to frame, slides extended.

    A slide without limits, such as a mobile base, adds nothing, unless there is nothing else.
    """
    lower, upper = position_limits(model)
    slides = [joint.idx_v for joint in model.joints[1:] if is_slide(joint)]
    travel = (upper - lower)[np.array(slides, dtype=int)]
    lengths = [np.linalg.norm(placement.translation) for placement in model.jointPlacements[2:]]
    lengths.append(np.linalg.norm(model.frames[frame].placement.translation))
    length = float(sum(lengths) + travel[np.isfinite(travel)].sum())
    return length or _TRAVEL * len(travel)


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
    q, data = pin.neutral(model), model.createData()
    axes = pin.computeJointJacobians(model, data, q).reshape(6, model.nv)[3:]
    low, high = position_limits(model)
    slides = np.array([is_slide(joint) for joint in model.joints[1:]])
    stroke = np.where(slides, np.maximum(np.abs(low), np.abs(high)), 0.0)
    tip = model.frames[frame].placement.translation
    steps = [model.jointPlacements[i].translation for i in range(2, model.njoints)] + [tip]
    lengths = np.array([np.linalg.norm(step) for step in steps])
    linear = np.ones(model.nv)
    for i in np.flatnonzero(~slides):
        first = np.linalg.norm(np.cross(axes[:, i], data.oMi[int(i) + 1].rotation @ steps[i]))
        linear[i] = first + lengths[i + 1 :].sum() + stroke[i + 1 :].sum()
    return linear, np.where(slides, 0.0, 1.0)


# Checks


def check_names(model: pin.Model) -> None:
    """Refuse a joint that is called as Pinocchio calls the world.

    Raises:
        RobotError: there is one.
    """
    if _WORLD in list(model.names)[1:]:
        raise RobotError(
            f"a joint is called '{_WORLD}', which is the name of the fixed world.",
            where=model.name,
            hint="Give it another name in the description.",
        )


def check_numbers(model: pin.Model) -> None:
    """Refuse models with numbers that no robot has.

    Raises:
        RobotError: non-finite placements, inertias or gravity, or a negative mass; the joint is
            named.
    """
    for name, placement, body in zip(
        model.names, model.jointPlacements, model.inertias, strict=True
    ):
        for part in (placement.homogeneous, body.toDynamicParameters()):
            if not (np.abs(part) <= LARGEST).all():  # also true for NaN
                raise RobotError(
                    f"the placement of joint '{name}' or the inertia it moves is not finite, or "
                    f"has numbers over {LARGEST:g}.",
                    where=model.name,
                )
        if body.mass < 0.0:
            raise RobotError(
                f"the body moved by joint '{name}' has a negative mass, {body.mass} kg.",
                where=model.name,
            )
    if not (np.abs(model.gravity.linear) <= LARGEST).all():
        raise RobotError(f"gravity is not finite: {model.gravity.linear}.", where=model.name)


def check_joints(model: pin.Model, joints: Sequence[int]) -> None:
    """Refuse joints for which the regressor identities do not hold.

    Raises:
        RobotError: a free-flyer, a mimic joint, or any joint that is not revolute or prismatic.
    """
    for joint in joints:
        kind, name = model.joints[joint].shortname(), model.names[joint]
        if is_free_flyer(model.joints[joint]):
            raise RobotError(
                f"joint '{name}' makes the base floating; the laws hold for fixed-base chains.",
                where=model.name,
                hint="Weld it (weld_root=True, in a scenario robot.weld_root = true) to use one "
                "limb as a fixed-base arm.",
            )
        if "Mimic" in kind:
            raise RobotError(
                f"joint '{name}' mimics another joint, which laws for independent joints do not "
                "cover.",
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


def check_position_limits(model: pin.Model) -> None:
    """Refuse joints whose lower limit is above the upper one.

    Taking them as no limits would let an arm run into the stops that somebody meant to state.

    Raises:
        RobotError: there is one; the joint and both numbers are named.
    """
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        if joint.nq == 1:
            low = float(model.lowerPositionLimit[joint.idx_q])
            high = float(model.upperPositionLimit[joint.idx_q])
            if low > high:
                raise RobotError(
                    f"the lower limit of joint '{name}', {low:g}, is above its upper one, "
                    f"{high:g}.",
                    where=model.name,
                    hint="Exchange them in the description, or make both 0 for no limit.",
                )


def check_mass_matrix(model: pin.Model, configurations: Sequence[np.ndarray]) -> None:
    """Refuse models whose mass matrix is singular or not positive definite.

    Raises:
        RobotError: M(q) has a relative eigenvalue below 1e-10 at one of the configurations; the
            joints that move without effort are named, and the moving links without mass.
    """
    data = model.createData()
    for q in configurations:
        M = pin.crba(model, data, q)
        scale = np.sqrt(np.maximum(np.diag(M), np.finfo(float).tiny))
        eigenvalues, vectors = np.linalg.eigh(M / np.outer(scale, scale))
        if eigenvalues[0] >= _REGULAR:
            continue
        massless = massless_joints(model)
        links = ", ".join(f"'{links_of(model, i)[0]}' after '{model.names[i]}'" for i in massless)
        free = int(np.argmax(np.abs(vectors[:, 0] / scale)))
        blame = (
            f"these links have no mass: {links}"
            if massless
            else f"nothing resists joint '{model.names[free + 1]}', which moves "
            f"'{links_of(model, free + 1)[0]}'"
        )
        raise RobotError(
            f"the mass matrix is singular or indefinite; {blame}.",
            where=model.name,
            hint="Say what the whole robot weighs, and they get a share by their shapes: "
            "`init --mass KG`, robot.mass in a scenario, load(..., mass=KG). Or give each an "
            "<inertial>, or lock the joint."
            if massless
            else "Give every moving link a positive mass and inertia, or lock the joint.",
        )
