"""Contacts with the ground: frames that do not move while a robot stands on them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from .._checks import instance, positive, vector
from ..description.chain import frame_id
from ..exceptions import RobotError

_AXES = pin.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True)
class Contact:
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
    def rows(self) -> int:
        """Three rows of a point, six of a sole."""
        return 3 if self.sole is None else 6

    @classmethod
    def all_of(cls, given: Iterable[Contact | str], model: pin.Model) -> tuple[Contact, ...]:
        """Return contacts, given as such or as names of frames of point feet.

        Raises:
            RobotError: no such frame, or one that is given twice.
        """
        found = [cls(each) if isinstance(each, str) else each for each in given]
        for contact in found:
            instance(contact, cls, "contacts", RobotError)
            frame_id(model, contact.frame)
        if len({contact.frame for contact in found}) < len(found):
            raise RobotError("a frame is given twice.", where="contacts")
        return tuple(found)


class ContactConstraints:
    """A(q) v = 0 of contacts that do not move: A (k, n) and its rate, in world axes."""

    def __init__(self, model: pin.Model, contacts: Sequence[Contact]) -> None:
        """Take the model of a robot, and its contacts."""
        self._model, self._data, self.contacts = model.copy(), model.createData(), tuple(contacts)
        self._frames = [frame_id(model, contact.frame) for contact in contacts]

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return type(self), (self._model, self.contacts)

    def at(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return A (k, n) and dA/dt (k, n) at q (nq) and v (n)."""
        model, data = self._model, self._data
        pin.computeJointJacobiansTimeVariation(model, data, q, v)
        pin.updateFramePlacements(model, data)
        A, A_rate = [np.zeros((0, model.nv))], [np.zeros((0, model.nv))]
        for frame, contact in zip(self._frames, self.contacts, strict=True):
            A.append(pin.getFrameJacobian(model, data, frame, _AXES)[: contact.rows])
            rate = pin.getFrameJacobianTimeVariation(model, data, frame, _AXES)
            A_rate.append(rate[: contact.rows])
        return np.concatenate(A), np.concatenate(A_rate)

    def free(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the projection (n, n) of torques onto what no contact force changes."""
        A, _ = self.at(q, v)
        return np.asarray(np.eye(v.size) - np.linalg.pinv(A) @ A)

    def rotations(self) -> list[np.ndarray]:
        """Return the axes of each contact's frame (3, 3) in the world, of the last ``at``."""
        return [self._data.oMf[frame].rotation for frame in self._frames]
