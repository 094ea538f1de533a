"""By how much actual and desired motion exceed the limits of the robot's description."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ..description.chain import (
    configuration_from_angles,
    effort_limits,
    is_slide,
    position_limits,
    velocity_limits,
)
from ..records import Desired
from ..robot.robot import Robot
from ..tasks.task import DISPLAYS, JointTask

KINDS = ("position", "velocity", "effort")


Motion = Sequence[np.ndarray]
"""Position [rad or m], velocity [rad/s or m/s], torque [N m or N] of the joints, each (N, nv)."""


@dataclass(frozen=True, eq=False)
class LimitExcess:
    """By how much joints exceed the limits of the description; ``print`` says it in a line.

    Attributes:
        joints: names of the joints.
        slides: of each joint, whether it is prismatic.
        stated: whether the description states any limit.
        plant: (nv, 3) largest excess of each joint of the true robot: position [rad or m], velocity
            [rad/s or m/s], effort [N m or N]; zero within the limit or without one.
        reference: (nv, 3) of the desired motion, with the torques that the true robot needs to
            follow it; None for tasks of the frame, whose reference is not a joint motion.
    """

    joints: tuple[str, ...]
    slides: tuple[bool, ...]
    stated: bool
    plant: np.ndarray
    reference: np.ndarray | None

    @classmethod
    def of(cls, robot: Robot, moved: Motion, desired: Motion | None) -> LimitExcess:
        """Compare motions with the limits of a robot's description."""
        model = robot.model
        lower, upper = position_limits(model)
        bounds = np.array([upper, -lower, velocity_limits(model), effort_limits(model)])

        def excess(motion: Motion) -> np.ndarray:
            """Return the excess (nv, 3) of a motion."""
            q, v, tau = motion
            parts = q, -q, np.abs(v), np.abs(tau)
            with np.errstate(invalid="ignore"):  # inf - inf is no excess
                beyond = np.array(parts) - bounds[:, None]
            largest = np.where(np.isfinite(beyond), beyond, 0.0).max(axis=1, initial=0.0)
            return np.array([largest[:2].max(axis=0), *largest[2:]]).T

        return cls(
            tuple(robot.joint_names),
            tuple(is_slide(joint) for joint in model.joints[1:]),
            bool(np.isfinite(bounds).any()),
            excess(moved),
            None if desired is None else excess(desired),
        )

    @property
    def exceeded(self) -> bool:
        """Whether the motion or the desired motion of any joint exceeds a limit."""
        return bool(self.plant.any() or (self.reference is not None and self.reference.any()))

    def summary(self) -> dict[str, Any]:
        """Return the largest excess of plant and reference, by joint and kind of limit."""
        return {
            motion: None
            if excess is None
            else {
                joint: dict(zip(KINDS, row, strict=True))
                for joint, row in zip(self.joints, excess.tolist(), strict=True)
            }
            for motion, excess in (("reference", self.reference), ("plant", self.plant))
        }

    def __str__(self) -> str:
        """Return in one line which joints exceed which limit by how much, the first three."""
        if not self.exceeded:
            return "joint limits kept" if self.stated else ""
        found = []
        for words, excess in (("", self.plant), (" (desired)", self.reference)):
            if excess is None:
                continue
            for i, k in np.argwhere(excess).tolist():
                unit, scale = DISPLAYS["m" if self.slides[i] else "rad"]
                if KINDS[k] == "effort":
                    unit, scale = "N" if self.slides[i] else "N m", 1.0
                unit += "/s" if KINDS[k] == "velocity" else ""
                value = f"{scale * excess[i, k]:.4g} {unit}"
                found.append(f"{self.joints[i]} {KINDS[k]} by {value}{words}")
        more = f" and {len(found) - 3} more" if len(found) > 3 else ""
        return f"beyond limits: {', '.join(found[:3])}{more}"


def reference_motion(true: Robot, desired: Sequence[Desired]) -> Motion | None:
    """Return the desired joint motion, and the torques that the true robot needs to follow it.

    None for tasks of the frame, because several joint motions follow the same path: the arm may be
    redundant, and its inverse kinematics have several branches.
    """
    if not isinstance(true.task, JointTask):
        return None
    model, data, rows = true.model, true.model.createData(), []
    for x_d, xd_d, xdd_d in desired:
        q = configuration_from_angles(model, x_d)
        tau = pin.rnea(model, data, q, xd_d, xdd_d) + true.friction_at(q).torque(xd_d)
        rows.append((x_d, xd_d, tau))
    return np.array(rows).reshape(len(rows), 3, model.nv).swapaxes(0, 1)
