"""Constraints A(q) v = 0: contacts with the ground, loops, joints that follow others."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from .._checks import instance, numbers, positive, vector
from ..description.chain import angles_from_configuration, frame_id
from ..exceptions import RobotError
from ..records import Feet
from .changes import joint_id

_ITERATIONS = 30  # of Newton's method; half or twice: it converges in 10 or not at all
_CLOSED = 1e-12  # [m, rad], rounding: half or twice change nothing

Rows = tuple[np.ndarray, np.ndarray]
"""A (k, n) and its rate (k, n)."""


class Constraint(ABC):
    """Some rows of A."""

    @abstractmethod
    def check(self, model: pin.Model) -> None:
        """Refuse names that a model does not have.

        Raises:
            RobotError: there is no such frame or joint.
        """

    @abstractmethod
    def at(self, model: pin.Model, data: pin.Data) -> Rows:
        """Return the rows, with Jacobians, their variation and frames in ``data``."""

    @abstractmethod
    def error(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        """Return by how much each row is off at q (nq), NaN where any value will do."""


@dataclass(frozen=True)
class Contact(Constraint):
    """A point foot or a sole that stands on the ground.

    Attributes:
        frame: its frame; that of a sole has its normal as z axis and lies in its middle.
        sole: half of its length and of its width [m], along the axes x and y of the frame; None
            for a point.
        friction: coefficient.

    Raises:
        RobotError: numbers that are not positive.
    """

    frame: str
    sole: tuple[float, float] | None = None
    friction: float = 0.6

    def __post_init__(self) -> None:
        """Refuse what is no contact."""
        instance(self.frame, str, "contacts.frame", RobotError)
        positive(self.friction, "contacts.friction", error=RobotError)
        if self.sole is not None:
            for half in vector(self.sole, 2, "contacts.sole", error=RobotError, fills=False):
                positive(half, "contacts.sole", error=RobotError)

    @property
    def size(self) -> int:
        """Three rows of a point, six of a sole."""
        return 3 if self.sole is None else 6

    def check(self, model: pin.Model) -> None:
        """Refuse a frame that the model does not have."""
        frame_id(model, self.frame)

    def at(self, model: pin.Model, data: pin.Data) -> Rows:
        """Return the rows: the velocity of the frame, of a sole also its angular velocity."""
        A, A_rate = _frame_rows(model, data, self.frame)
        return A[: self.size], A_rate[: self.size]

    def error(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        """Return the height, and NaN."""
        off = np.full(self.size, np.nan)
        off[2] = data.oMf[frame_id(model, self.frame)].translation[2]
        return off


@dataclass(frozen=True)
class Loop(Constraint):
    """Two frames that move alike: a linkage that is closed, or two arms that hold one object.

    Attributes:
        frame_a, frame_b: the frames.
        rows: which of their relative velocities are zero, 0 to 2 linear and 3 to 5 angular, in
            world axes. Rows that depend on others must be left out: a planar loop has two.
    """

    frame_a: str
    frame_b: str
    rows: tuple[int, ...] = (0, 1, 2)

    def check(self, model: pin.Model) -> None:
        """Refuse frames that the model does not have, and rows that do not exist."""
        frame_id(model, self.frame_a)
        frame_id(model, self.frame_b)
        if not self.rows or not set(self.rows) <= set(range(6)):
            raise RobotError("expected some of 0 to 5.", where="loops.rows")

    def at(self, model: pin.Model, data: pin.Data) -> Rows:
        """Return the rows of the velocity of b less that of a."""
        (A_a, rate_a), (A_b, rate_b) = (
            _frame_rows(model, data, frame) for frame in (self.frame_a, self.frame_b)
        )
        rows = list(self.rows)
        return (A_b - A_a)[rows], (rate_b - rate_a)[rows]

    def error(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        """Return the way and the turn from a to b."""
        a, b = (data.oMf[frame_id(model, frame)] for frame in (self.frame_a, self.frame_b))
        turn = pin.log3(b.rotation @ a.rotation.T)
        return np.concatenate([b.translation - a.translation, turn])[list(self.rows)]


@dataclass(frozen=True)
class Coupling(Constraint):
    """A joint that follows another one, q_j = ratio q_i + offset; it has no motor.

    Attributes:
        joint: that follows.
        leader: the other one.
        ratio: of their velocities.
        offset: [rad or m].
    """

    joint: str
    leader: str
    ratio: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no number."""
        numbers([self.ratio, self.offset], "mimic", error=RobotError)

    def check(self, model: pin.Model) -> None:
        """Refuse joints that the model does not have."""
        for name in (self.joint, self.leader):
            joint_id(model, name, "mimic")

    def _dofs(self, model: pin.Model) -> list[int]:
        """Return the places in v of the joint and of the one that it follows."""
        joints = model.joints
        return [joints[model.getJointId(name)].idx_v for name in (self.joint, self.leader)]

    def at(self, model: pin.Model, data: pin.Data) -> Rows:
        """Return one constant row."""
        A = np.zeros((1, model.nv))
        own, leader = self._dofs(model)
        A[0, own], A[0, leader] = 1.0, -self.ratio
        return A, np.zeros(A.shape)

    def error(self, model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
        """Return q_j - ratio q_i - offset."""
        own, other = angles_from_configuration(model, q)[self._dofs(model)]
        return np.array([own - self.ratio * other - self.offset])


Part = TypeVar("Part", Contact, Loop)


def parts_of(
    kind: type[Part], given: Iterable[Part | Mapping[str, Any] | str], where: str
) -> tuple[Part, ...]:
    """Return contacts or loops, given as such, by their fields or, contacts, by their frames.

    Raises:
        RobotError: something else.
    """
    found = []
    for each in given:
        own: Any = {"frame": each} if isinstance(each, str) else each
        if isinstance(own, Mapping):
            try:
                own = kind(**{name: _tuple(value) for name, value in own.items()})
            except TypeError as error:
                raise RobotError(f"{error}.", where=where) from error
        found.append(instance(own, kind, where, RobotError))
    return tuple(found)


def _tuple(value: Any) -> Any:
    """Return a list of a file as a tuple."""
    return tuple(value) if isinstance(value, list) else value


def _frame_rows(model: pin.Model, data: pin.Data, frame: str) -> Rows:
    """Return the Jacobian (6, n) of a frame in world axes, and its rate."""
    given = model, data, frame_id(model, frame), pin.LOCAL_WORLD_ALIGNED
    return pin.getFrameJacobian(*given), pin.getFrameJacobianTimeVariation(*given)


def consistent(model: pin.Model, q: np.ndarray, parts: Sequence[Constraint]) -> np.ndarray:
    """Return the configuration (nq) next to q (nq) at which all constraints hold.

    Contacts stand on the ground, at a height of zero, wherever else they are.

    Raises:
        RobotError: loops that do not close near q.
    """
    constraints, still = Constraints(model, parts), np.zeros(model.nv)
    for _ in range(_ITERATIONS if parts else 0):
        A, _ = constraints.at(q, still)
        errors = [part.error(model, constraints.data, q) for part in parts]
        rows = np.concatenate([np.isfinite(error) for error in errors])
        off = np.concatenate(errors)[rows]
        if np.abs(off).max(initial=0.0) < _CLOSED:
            return q
        q = pin.integrate(model, q, -np.linalg.pinv(A[rows]) @ off)
    if parts:
        raise RobotError(
            "the loops do not close near the home pose.", where="loops", hint="Give a q0 nearer."
        )
    return q


class Constraints:
    """All constraints of a robot: A (k, n) and its rate."""

    def __init__(self, model: pin.Model, parts: Sequence[Constraint]) -> None:
        """Take the model of a robot, and its constraints."""
        self._model, self.data, self.parts = model.copy(), model.createData(), tuple(parts)
        self._none = self._A = np.zeros((0, model.nv))
        feet = [part.frame for part in self.parts if isinstance(part, Contact)]
        self._feet = [frame_id(model, foot) for foot in feet]

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return type(self), (self._model, self.parts)

    def at(self, q: np.ndarray, v: np.ndarray) -> Rows:
        """Return A (k, n) and dA/dt (k, n) at q (nq) and v (n)."""
        model, data = self._model, self.data
        pin.computeJointJacobiansTimeVariation(model, data, q, v)
        pin.updateFramePlacements(model, data)
        found = [part.at(model, data) for part in self.parts]
        A, A_rate = zip((self._none, self._none), *found, strict=True)
        self._A = np.concatenate(A)
        return self._A, np.concatenate(A_rate)

    def free(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the projection (n, n) of torques onto what no constraint force changes."""
        A, _ = self.at(q, v)
        return np.asarray(np.eye(v.size) - np.linalg.pinv(A) @ A)

    def references(self, feet: Feet, v: np.ndarray, alpha: float) -> Rows:
        """Return what A v_r (k) shall be, and its rate (k): zero where the robot stands.

        That of a foot in the air is xd_d - alpha (x - x_d). All contacts are points, and they are
        the last of the constraints. State and frames are those of the last ``at``.

        Args:
            feet: their motion.
            v: (n) velocity.
            alpha: [1/s].
        """
        rows, rate = np.zeros((2, len(self._A)))
        x = np.array([self.data.oMf[foot].translation for foot in self._feet])
        first, velocity = len(rows) - x.size, (self._A @ v)[len(rows) - x.size :].reshape(x.shape)
        air = ~feet.stands
        u, ud = (
            feet.xd_d - alpha * (x - feet.x_d),
            feet.xdd_d - alpha * (velocity - feet.xd_d),
        )
        rows[first:].reshape(x.shape)[air], rate[first:].reshape(x.shape)[air] = u[air], ud[air]
        return rows, rate

    def axes(self, frame: str) -> np.ndarray:
        """Return the axes (3, 3) of a frame in the world, of the last ``at``."""
        return np.asarray(self.data.oMf[frame_id(self._model, frame)].rotation)
