"""Changes of a robot: payload, friction, and functions that change a Pinocchio model in place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import (
    instance,
    joint_numbers,
    numbers,
    positive,
    shown,
    take_checked,
    vector,
    whole,
    word,
)
from ..description.floating_base import BASE_JOINTS
from ..exceptions import InputError, RobotError


@dataclass(frozen=True)
class Payload:
    """A load fixed to the last body; none if mass and inertia are zero.

    Attributes:
        mass: kg.
        com: (3) centre of mass relative to the task frame as described, in its axes [m].
        inertia: (6) Ixx Ixy Iyy Ixz Iyz Izz about the centre of mass, in the frame's axes [kg m^2].

    Raises:
        RobotError: a negative mass, an unphysical inertia, or wrong sizes.
    """

    mass: float
    com: ArrayLike = (0.0, 0.0, 0.0)
    inertia: ArrayLike = (0.0,) * 6

    def __post_init__(self) -> None:
        """Refuse what is no load."""
        self.spatial_inertia()

    @property
    def present(self) -> bool:
        """Whether there is a load at all."""
        return bool(self.mass or np.any(self.inertia))

    def spatial_inertia(self) -> pin.Inertia:
        """Return the load as a Pinocchio inertia in the task frame."""
        mass = positive(self.mass, "payload.mass", zero=True, error=RobotError)
        com = vector(self.com, 3, "payload.com", error=RobotError, fills=False)
        given = vector(self.inertia, 6, "payload.inertia", error=RobotError, fills=False)
        matrix = pin.Symmetric3(given).matrix()
        second_moment = 0.5 * np.trace(matrix) * np.eye(3) - matrix
        if np.linalg.eigvalsh(second_moment)[0] < -1e-12:
            raise RobotError(
                "not physical: a principal moment of inertia exceeds the sum of the other two.",
                where="payload.inertia",
            )
        return pin.Inertia(mass, com, matrix)


Load = Payload | Mapping[str, Payload] | None
"""A load, or those of several task frames by the frames' names, or none."""


def by_frame(given: Any, frames: Sequence[str], where: str) -> dict[str, Any]:
    """Return what is given for each task frame; with one frame also given without its name.

    Raises:
        InputError: unknown frames, or several and no mapping from their names.
    """
    if given is None:
        return {}
    if isinstance(given, Mapping):
        return {word(name, frames, where): own for name, own in given.items()}
    if len(frames) == 1:
        return {frames[0]: given}
    raise RobotError(
        f"there are {len(frames)} task frames; say of which one it is.",
        where=where,
        hint=f"Give a mapping from frames, such as {{{frames[0]!r}: ...}}.",
    )


def joint_id(model: pin.Model, name: str, where: str, words: Sequence[str] = ()) -> int:
    """Return the index of a joint, given its name.

    Args:
        model: Pinocchio model.
        name: of the joint.
        where: the argument that is checked, for the message.
        words: other values that this argument may have, for the message.

    Raises:
        InputError: unknown name; the closest one is suggested.
    """
    names = list(model.names[1:])
    allowed = names if name in words else [*names, *words]
    return names.index(word(name, allowed, where)) + 1


def per_joint(
    given: Any,
    names: Sequence[str],
    where: str,
    default: float,
    error: type[InputError] = InputError,
) -> np.ndarray:
    """Return one number for each joint (n), given so, one for all, or by some of their names.

    Args:
        given: numbers; None: the default. One for all is not of the six joints of a free base.
        names: of the joints.
        where: the argument that is checked, for the message.
        default: of the joints that are not meant.
        error: of a number that cannot be used.

    Raises:
        InputError: unknown joint.
        error: as ``vector``.
    """
    if isinstance(given, Mapping):
        for name in given:
            word(name, names, where)
        given = [given.get(name, default) for name in names]
    given = default if given is None else given
    every = vector(given, len(names), where, names=names, error=error)
    if np.ndim(given) == 0:
        every[np.isin(names, BASE_JOINTS)] = default
    return every


def scale_inertias(model: pin.Model, scale: float | Mapping[str, float]) -> None:
    """Multiply mass and inertia of all bodies, or of those that the named joints move.

    Raises:
        RobotError: unknown joint or a factor that is not positive.
    """
    if not isinstance(scale, Mapping):
        positive(scale, "inertial_scale", error=RobotError)
        scale = dict.fromkeys(model.names[1:], scale)
    for name, given in scale.items():
        body = model.inertias[joint_id(model, name, "inertial_scale")]
        factor = positive(given, f"inertial_scale.{name}", error=RobotError)
        body.mass *= factor
        body.inertia = factor * body.inertia


def placement(rotation: ArrayLike, translation: ArrayLike, where: str) -> pin.SE3:
    """Return a placement from a rotation, as matrix (3, 3) or vector (3) [rad], and a position (3).

    Raises:
        RobotError: wrong sizes, or a matrix that is no rotation.
    """
    R = numbers(rotation, f"{where}.rotation", error=RobotError)
    R = pin.exp3(R) if R.shape == (3,) else R
    same = R.shape == (3, 3) and np.allclose(R @ R.T, np.eye(3), rtol=0.0, atol=1e-6)
    if not same or np.linalg.det(R) < 0.0:
        raise RobotError(
            "expected a rotation vector (3) [rad], or a matrix (3, 3) with R R^T = 1, det R = 1; "
            f"got {shown(rotation)}.",
            where=f"{where}.rotation",
        )
    return pin.SE3(R, vector(translation, 3, f"{where}.translation", error=RobotError, fills=False))


def move_base(model: pin.Model, base: pin.SE3) -> None:
    """Place all that is fixed to the world, and gravity, by the placement of the base."""
    for joint in range(1, model.njoints):
        if model.parents[joint] == 0:
            model.jointPlacements[joint] = base * model.jointPlacements[joint]
    for frame in model.frames[1:]:
        if frame.parentJoint == 0:
            frame.placement = base * frame.placement
    model.gravity = pin.Motion(base.rotation @ model.gravity.linear, np.zeros(3))


@dataclass(frozen=True)
class Shaft:
    """A motor that turns with two joints, u = v_first + sign v_second, as of a coupled wrist.

    Its rotor inertia and friction act on both joints: with f its torque, the first gets f, the
    second sign f.

    Attributes:
        joints: names of the two joints, or their indices, from 0.
        sign: 1 or -1.
        armature: rotor inertia, as seen by the joints [kg m^2 or kg].
        viscous: [N m s/rad or N s/m].
        coulomb: [N m or N].
        threshold: speed [rad/s or m/s] at which the smoothed sign reaches tanh(1).
    """

    joints: tuple[Any, Any]
    sign: int = 1
    armature: float = 0.0
    viscous: float = 0.0
    coulomb: float = 0.0
    threshold: float = 0.01

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            RobotError: negative coefficients, or a sign other than 1 and -1.
        """
        parts = "armature", "viscous", "coulomb"
        take_checked(self, positive, "shafts.", *parts, zero=True, error=RobotError)
        take_checked(self, positive, "shafts.", "threshold", error=RobotError)
        where = "shafts.joints"
        pair = instance(self.joints, list | tuple, where, RobotError)
        if len(pair) != 2 or pair[0] == pair[1]:
            raise RobotError(f"expected two joints, got {shown(pair)}.", where=where)
        for each in pair:
            if not isinstance(each, str):
                whole(each, where, 0)
        if self.sign not in (1, -1):
            raise RobotError(f"must be 1 or -1, got {shown(self.sign)}.", where="shafts.sign")

    def of(self, model: pin.Model) -> Shaft:
        """Return the shaft with the indices of its joints.

        Raises:
            RobotError: the model has no such joints.
        """
        where = "friction.shafts.joints"
        first, second = (
            joint_id(model, each, where) - 1 if isinstance(each, str) else each
            for each in self.joints
        )
        if not 0 <= max(first, second) < model.nv:
            raise RobotError(f"there are {model.nv} joints, got {self.joints}.", where=where)
        return replace(self, joints=(first, second))

    def name(self, joints: Sequence[str]) -> str:
        """Return the name, given those of all joints: "joint_5+joint_6"."""
        first, second = (joints[j] for j in self.joints)
        return f"{first}{'+' if self.sign > 0 else '-'}{second}"


_SIGNED = ("asymmetry", "offset")
FRICTION_ATTRIBUTES = ("threshold", "gear_friction", *_SIGNED, "breakaway", "fading")  # (nv) each
COEFFICIENTS = ("viscous", "coulomb", *FRICTION_ATTRIBUTES)


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction of joints and whatever else their motors add, at velocity v and gravity g(q).

        tau_f = viscous v + (coulomb + gear_friction |g| + asymmetry sign(v)) sigma(v) + offset,
        sigma(v) = tanh(v / threshold) (1 + (breakaway - 1) exp(-|v| / fading)).

    sigma is a smoothed sign: it rises within ``threshold``, and near rest it may be larger
    (Stribeck) or smaller than at speed. The torques of ``shafts`` are added.

    Each is one number for all joints but those of a free base, one per joint (nv), or joint name ->
    number, the others as by default; ``Robot.changed`` turns them into (nv).

    Attributes:
        viscous: (nv) N m s/rad or N s/m.
        coulomb: (nv) N m or N.
        threshold: (nv) speed [rad/s or m/s] at which the smoothed sign reaches tanh(1).
        gear_friction: (nv) Coulomb friction that the gears add, as a share of the gravity torque
            that they carry.
        asymmetry: (nv) half the difference of the Coulomb friction forwards and backwards [N m, N].
        offset: (nv) constant torque, as of a sensor that is off or a spring [N m or N].
        breakaway: (nv) dry friction near rest as a share of that at speed.
        fading: (nv) speed at which a share 1/e of that difference is left [rad/s or m/s].
        shafts: motors that turn with two joints.
    """

    viscous: np.ndarray = 0.0  # type: ignore[assignment]
    coulomb: np.ndarray = 0.0  # type: ignore[assignment]
    threshold: np.ndarray = 0.01  # type: ignore[assignment]
    gear_friction: np.ndarray = 0.0  # type: ignore[assignment]
    asymmetry: np.ndarray = 0.0  # type: ignore[assignment]
    offset: np.ndarray = 0.0  # type: ignore[assignment]
    breakaway: np.ndarray = 1.0  # type: ignore[assignment]
    fading: np.ndarray = 0.1  # type: ignore[assignment]
    shafts: tuple[Shaft, ...] = ()

    def __post_init__(self) -> None:
        """Check the coefficients.

        Raises:
            RobotError: negative coefficients, or a speed that is not positive.
        """
        for name in COEFFICIENTS:
            value = getattr(self, name)
            where = f"friction.{name}"
            array = list(value.values()) if isinstance(value, Mapping) else value
            if name in _SIGNED:
                array = numbers(array, where, error=RobotError)
            else:
                speed = name in ("threshold", "fading")
                array = joint_numbers(array, where, zero=not speed, error=RobotError)
            if array.ndim > 1:
                raise RobotError("expected one number for each joint.", where=where)
            if not isinstance(value, Mapping):
                object.__setattr__(self, name, array)
        for shaft in instance(self.shafts, list | tuple, "friction.shafts", RobotError):
            instance(shaft, Shaft, "friction.shafts", RobotError)

    def of(self, model: pin.Model) -> Friction:
        """Return the friction of the joints of a model, with one number for each.

        Raises:
            RobotError: another number of joints, or unknown names.
        """
        names = list(model.names[1:])
        given = {
            name: per_joint(
                getattr(self, name), names, f"friction.{name}", getattr(Friction, name), RobotError
            )
            for name in COEFFICIENTS
        }
        return replace(self, **given, shafts=tuple(each.of(model) for each in self.shafts))

    @cached_property
    def present(self) -> bool:
        """Whether any joint has friction or an offset."""
        parts = self.viscous, self.coulomb, self.gear_friction, self.asymmetry, self.offset
        return bool(self.shafts or np.any(parts))

    @property
    def special(self) -> dict[str, np.ndarray]:
        """The attributes (nv) beside viscous and coulomb that differ from their defaults."""
        every = {name: getattr(self, name) for name in FRICTION_ATTRIBUTES}
        return {
            name: part for name, part in every.items() if np.any(part != getattr(Friction, name))
        }

    @cached_property
    def loaded(self) -> bool:
        """Whether friction depends on the gravity torque."""
        return bool(self.gear_friction.any())

    @cached_property
    def plain(self) -> bool:
        """Whether it is viscous and Coulomb friction alone, which simulators know."""
        return not self.shafts and not self.special.keys() - {"threshold", "fading"}

    @cached_property
    def shape(self) -> np.ndarray:
        """The rows threshold, breakaway - 1 and 1 / fading (3, nv) of sigma."""
        return np.array([self.threshold, self.breakaway - 1.0, 1.0 / self.fading])

    @cached_property
    def directions(self) -> np.ndarray:
        """The directions (k, nv) of the shafts: their speeds are ``directions`` v."""
        rows = np.zeros((len(self.shafts), self.viscous.size))
        for row, shaft in zip(rows, self.shafts, strict=True):
            row[list(shaft.joints)] = 1.0, shaft.sign
        return rows

    def under(self, gravity: np.ndarray) -> Friction:
        """Return the friction under a gravity torque (nv), which is then part of ``coulomb``."""
        coulomb = self.coulomb + self.gear_friction * np.abs(gravity)
        return replace(self, coulomb=coulomb, gear_friction=np.zeros(coulomb.size))

    def torque(self, v: np.ndarray) -> np.ndarray:
        """Return tau_f (nv) [N m or N] at joint velocity v (nv), of a load only as of ``under``.

        Raises:
            RobotError: the friction depends on the gravity torque.
        """
        if self.loaded:
            raise RobotError(
                "this friction depends on the gravity torque.",
                where="friction.gear_friction",
                hint="friction.under(g).torque(v) takes the gravity torque g.",
            )
        threshold, excess, rate = self.shape
        sigma = np.tanh(v / threshold) * (1.0 + excess * np.exp(-np.abs(v) * rate))
        tau = self.viscous * v + self.coulomb * sigma + self.asymmetry * np.abs(sigma) + self.offset
        for d, part in zip(self.directions, self.shafts, strict=True):
            u = float(d @ v)
            tau = tau + d * (part.viscous * u + part.coulomb * np.tanh(u / part.threshold))
        return tau
