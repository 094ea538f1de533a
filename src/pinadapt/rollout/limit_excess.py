"""By how much actual and desired motion exceed the limits of the robot's description."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from .._output import Table
from ..controller.state import Sample
from ..description.chain import (
    configuration_from_angles,
    effort_limits,
    is_slide,
    position_limits,
    velocity_limits,
)
from ..robot.robot import Robot
from ..tasks.task import DISPLAYS, JointTask

_NONE = "-"
_SHOWN = 3  # excesses in the one-line text; half or twice: a shorter or longer line
_HEADER = ("beyond limits", "position", "velocity", "effort", "of")


class Excess(NamedTuple):
    """The largest excess of each joint; zero within the limit or without one.

    Attributes:
        position: (nv) [rad or m].
        velocity: (nv) [rad/s or m/s].
        effort: (nv) [N m or N].
    """

    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray


@dataclass(frozen=True, eq=False)
class LimitExcess:
    """By how much joints exceed the limits of the description.

    Attributes:
        joints: names of the joints.
        slides: of each joint, whether it is prismatic.
        stated: whether the description states any limit.
        plant: of the true robot at the recorded samples, with the torques of its motors.
        reference: of the desired motion, with the torques that the true robot needs to follow it;
            None for tasks of the frame, whose reference is not a joint motion.
    """

    joints: tuple[str, ...]
    slides: tuple[bool, ...]
    stated: bool
    plant: Excess
    reference: Excess | None

    @classmethod
    def of(cls, robot: Robot, moved: DrivenMotion, desired: DrivenMotion | None) -> LimitExcess:
        """Compare motions with the limits of a robot's description."""
        limits = _Limits.of(robot)
        return cls(
            tuple(robot.joint_names),
            tuple(is_slide(joint) for joint in robot.model.joints[1:]),
            limits.stated,
            limits.excess(moved),
            None if desired is None else limits.excess(desired),
        )

    @classmethod
    def of_summary(
        cls, given: Mapping[str, Any], slides: tuple[bool, ...], *, stated: bool
    ) -> LimitExcess:
        """Return what ``summary`` was made of, given slides and ``stated`` as well."""
        plant, reference = (
            None
            if given[motion] is None
            else Excess(*np.array([[*row.values()] for row in given[motion].values()]).T)
            for motion in ("plant", "reference")
        )
        assert plant is not None  # every run has one
        return cls(tuple(given["plant"]), slides, stated, plant, reference)

    @property
    def exceeded(self) -> bool:
        """Whether the motion or the desired motion of any joint exceeds a limit."""
        return any(np.any(excess) for _, excess in self._motions())

    def summary(self) -> dict[str, dict[str, dict[str, float]] | None]:
        """Return the largest excess of plant and reference, by joint and kind of limit."""
        named = {
            motion: {
                joint: dict(zip(Excess._fields, map(float, row), strict=True))
                for joint, *row in zip(self.joints, *excess, strict=True)
            }
            for motion, excess in self._motions()
        }
        return {"reference": None, **named}

    def verdict(self) -> str:
        """Return in a few words how many joints exceed a limit."""
        if not self.stated:
            return "none in the description"
        counts = [
            f"{np.any(excess, axis=0).sum()} ({motion})" for motion, excess in self._motions()
        ]
        words = f"exceeded at {', '.join(counts)} of {len(self.joints)} joints"
        return words if self.exceeded else "kept"

    def words(self) -> str:
        """Return in one line which joints exceed which limit by how much."""
        found = [
            f"{joint} {kind} by {value}{'' if motion == 'plant' else ' (desired)'}"
            for joint, *values, motion in self.table.rows
            for kind, value in zip(Excess._fields, values, strict=True)
            if value != _NONE
        ]
        more = f" and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
        return f"beyond limits: {', '.join(found[:_SHOWN])}{more}"

    @property
    def table(self) -> Table:
        """The joints beyond a limit, one in each row."""
        rows = []
        for motion, excess in self._motions():
            for i in np.flatnonzero(np.any(excess, axis=0)):
                shown = [_shown(each[i], kind, self.slides[i]) for kind, each in _named(excess)]
                rows.append((self.joints[i], *shown, motion))
        return Table(rows, _HEADER)

    def _motions(self) -> list[tuple[str, Excess]]:
        """Return the excess of plant and, if there is one, of the reference."""
        reference = [] if self.reference is None else [("reference", self.reference)]
        return [("plant", self.plant), *reference]


def _named(excess: Excess) -> Iterator[tuple[str, np.ndarray]]:
    """Yield kind and numbers (nv) of an excess."""
    return zip(Excess._fields, excess, strict=True)


def _shown(value: float, kind: str, slide: bool) -> str:
    """Return one number with its unit, a dash for zero."""
    if not value:
        return _NONE
    if kind == "effort":
        return f"{value:.4g} {'N' if slide else 'N m'}"
    shown = DISPLAYS["m" if slide else "rad"]
    return f"{value * shown.scale:.4g} {shown.unit}{'/s' if kind == 'velocity' else ''}"


class DrivenMotion(NamedTuple):
    """Motion and torques of the joints of a chain at N samples.

    Attributes:
        q: (N, nv) one number per joint [rad or m]; meaningless for continuous joints.
        v: (N, nv) velocities [rad/s or m/s].
        tau: (N, nv) torques at the joints [N m or N].
    """

    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray


def motion_of_plant(true: Robot, samples: Sequence[Sample]) -> DrivenMotion:
    """Return the motion of the true robot and the torques of its motors."""
    numbers = [joint.idx_q for joint in true.model.joints[1:]]
    return _stacked(true, [(s.truth.q[numbers], s.truth.v, s.torque) for s in samples])


def motion_of_reference(true: Robot, samples: Sequence[Sample]) -> DrivenMotion | None:
    """Return the desired joint motion, and the torques that the true robot needs to follow it.

    None for tasks of the frame, because several joint motions follow the same path: the arm may be
    redundant, and its inverse kinematics have several branches.
    """
    if not isinstance(true.task, JointTask):
        return None
    model, data, rows = true.model, true.model.createData(), []
    for x_d, xd_d, xdd_d in (sample.desired for sample in samples):
        q = configuration_from_angles(model, x_d)
        tau = pin.rnea(model, data, q, xd_d, xdd_d)
        rows.append((x_d, xd_d, tau + true.friction_at(q).torque(xd_d)))
    return _stacked(true, rows)


def _stacked(robot: Robot, rows: Sequence[tuple[np.ndarray, ...]]) -> DrivenMotion:
    stack = np.array(rows, dtype=float).reshape(len(rows), 3, robot.model.nv)
    return DrivenMotion(*stack.swapaxes(0, 1))


class _Limits(NamedTuple):
    """The limits of a description for each joint, infinite where it states none."""

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray

    @classmethod
    def of(cls, robot: Robot) -> _Limits:
        """Return the limits of a description."""
        lower, upper = position_limits(robot.model)
        return cls(lower, upper, velocity_limits(robot.model), effort_limits(robot.model))

    @property
    def stated(self) -> bool:
        """Whether the description states any limit."""
        return bool(np.isfinite(np.concatenate(self)).any())

    @np.errstate(invalid="ignore")  # inf - inf is no excess
    def excess(self, motion: DrivenMotion) -> Excess:
        """Return by how much a motion exceeds the limits, zero where it does not."""
        return Excess(
            _largest(np.maximum(motion.q - self.upper, self.lower - motion.q)),
            _largest(np.abs(motion.v) - self.velocity),
            _largest(np.abs(motion.tau) - self.effort),
        )


def _largest(beyond: np.ndarray) -> np.ndarray:
    """Return the largest positive finite number of each column (N, nv), or zero."""
    return np.where(np.isfinite(beyond), beyond, 0.0).max(axis=0, initial=0.0)
