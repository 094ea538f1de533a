"""Changes of a robot: payload, friction, and functions that change a Pinocchio model in place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import instance, mapping, numbers, positive, vector, whole
from ..exceptions import RobotError, did_you_mean


@dataclass(frozen=True)
class Payload:
    """A load fixed to the last body.

    Attributes:
        mass: kg.
        com: (3) centre of mass relative to the task frame as described, in its axes [m].
        inertia: (6) Ixx Ixy Iyy Ixz Iyz Izz about the centre of mass, in the frame's axes [kg m^2].
    """

    mass: float
    com: ArrayLike = (0.0, 0.0, 0.0)
    inertia: ArrayLike = (0.0,) * 6

    def spatial_inertia(self) -> pin.Inertia:
        """Return the load as a Pinocchio inertia in the task frame.

        Raises:
            RobotError: a mass that is not positive, an unphysical inertia, or wrong sizes.
        """
        mass = positive(self.mass, "payload.mass", error=RobotError)
        com = vector(self.com, 3, "payload.com", error=RobotError)
        xx, xy, yy, xz, yz, zz = vector(self.inertia, 6, "payload.inertia", error=RobotError)
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        second_moment = 0.5 * np.trace(matrix) * np.eye(3) - matrix
        if np.linalg.eigvalsh(second_moment)[0] < -1e-12:
            raise RobotError(
                "not physical: a principal moment of inertia exceeds the sum of the other two.",
                where="payload.inertia",
            )
        return pin.Inertia(mass, com, matrix)


def joint_id(model: pin.Model, name: str, where: str, words: Sequence[str] = ()) -> int:
    """Return the index of a joint, given its name.

    Args:
        model: Pinocchio model.
        name: of the joint.
        where: the argument that is checked, for the message.
        words: other values that this argument may have, for the message.

    Raises:
        RobotError: unknown name; the closest one is suggested.
    """
    names = [str(other) for other in model.names[1:]]
    if name not in names:
        also = f", or {list(words)}" if words else ""
        guess = did_you_mean(name, [*words, *names])
        raise RobotError(
            f"there is no joint '{name}'; expected one of {names}{also}.{guess}", where=where
        )
    return names.index(name) + 1


def scale_inertias(model: pin.Model, scale: float | Mapping[str, float]) -> None:
    """Multiply mass and inertia of all bodies, or of those that the named joints move.

    Raises:
        RobotError: unknown joint or a factor that is not positive.
    """
    if not isinstance(scale, Mapping):
        factor = positive(scale, "inertial_scale", error=RobotError)
        scale = {str(name): factor for name in model.names[1:]}
    for name, given in scale.items():
        joint = joint_id(model, name, "inertial_scale")
        factor = positive(given, f"inertial_scale.{name}", error=RobotError)
        body = model.inertias[joint]
        if factor == 1.0:
            continue
        if body.mass:  # FromDynamicParameters divides by the mass
            model.inertias[joint] = pin.Inertia.FromDynamicParameters(
                factor * body.toDynamicParameters()
            )
        else:
            model.inertias[joint] = pin.Inertia(0.0, body.lever, factor * body.inertia)


def attach_payload(model: pin.Model, frame: int, payload: Payload) -> pin.Inertia:
    """Add a load to the body that carries a frame; return it in the axes of the body's joint."""
    instance(payload, Payload, "payload", RobotError)
    carrier = model.frames[frame]
    load = carrier.placement.act(payload.spatial_inertia())
    model.inertias[carrier.parentJoint] += load
    return load


def shift_tool(model: pin.Model, frame: int, translation: ArrayLike) -> None:
    """Move the origin of a frame by a translation (3) [m] in the axes of the frame."""
    placement = model.frames[frame].placement
    shift = vector(translation, 3, "tool_translation", error=RobotError)
    placement.translation = placement.translation + placement.rotation @ shift


def shift_joints(model: pin.Model, translations: Mapping[str, ArrayLike] | None) -> None:
    """Add translations (3) [m], in parent axes, to the placements of the named joints.

    Raises:
        RobotError: unknown joint or wrong sizes.
    """
    for name, translation in mapping(translations, "link_translation", RobotError).items():
        placement = model.jointPlacements[joint_id(model, name, "link_translation")]
        placement.translation = placement.translation + vector(
            translation, 3, f"link_translation.{name}", error=RobotError
        )


@dataclass(frozen=True, eq=False)
class Friction:
    """Viscous and Coulomb friction, tau_f = diag(viscous) v + diag(coulomb) tanh(v / threshold).

    Attributes:
        viscous: (nv) N m s/rad or N s/m.
        coulomb: (nv) N m or N.
        threshold: speed [rad/s or m/s] at which the smoothed sign reaches tanh(1).
    """

    viscous: np.ndarray
    coulomb: np.ndarray
    threshold: float = 0.01

    def __post_init__(self) -> None:
        """Check the coefficients.

        Raises:
            RobotError: negative coefficients, different sizes, or a threshold that is not positive.
        """
        for name in ("viscous", "coulomb"):
            given = numbers(getattr(self, name), f"friction.{name}", error=RobotError)
            if given.ndim != 1 or (given < 0.0).any():
                raise RobotError(
                    f"expected one non-negative number per joint, got {given.tolist()}.",
                    where=f"friction.{name}",
                )
            object.__setattr__(self, name, given)
        if self.viscous.size != self.coulomb.size:
            raise RobotError("viscous and coulomb have different sizes.", where="friction")
        threshold = positive(self.threshold, "friction.threshold", error=RobotError)
        object.__setattr__(self, "threshold", threshold)

    @cached_property
    def present(self) -> bool:
        """Whether any joint has friction."""
        return bool(self.viscous.any() or self.coulomb.any())

    @classmethod
    def none(cls, nv: int) -> Friction:
        """Return zero friction at nv joints."""
        joints = whole(nv, "friction", 0, RobotError)
        return cls(np.zeros(joints), np.zeros(joints))

    def torque(self, v: np.ndarray) -> np.ndarray:
        """Return the friction torque tau_f (nv) [N m or N] at joint velocity v (nv)."""
        return self.viscous * v + self.coulomb * np.tanh(v / self.threshold)
