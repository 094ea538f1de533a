"""Everything the controller remembers from one sample to the next."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..adaptation.adaptation import Estimate
from ..models.delay_compensation import SensedState
from ..records import Desired, Measurement
from ..robot.changes import Payload

_NOTHING = SensedState(np.zeros(0), np.zeros(0))


class ControllerState(NamedTuple):
    """An immutable snapshot; keep an old one and you can go back to it.

    Attributes:
        t: time of the last sample [s].
        dynamic: estimate of the dynamic parameters, with what its adaptation remembers.
        kinematic: the same of the kinematic parameters [m].
        a_0: (p_d) the dynamic estimate at the start, moved by what was announced since.
        filters: state of the law's filters; see ``Law.filters``.
        adapting: whether the estimates move; see ``adapt``.
        load: what the robot carries in addition to its description, as last announced.
        sensed: what the sensors said at the last sample, see ``SensedState``.
        torque_filter: state of the low pass of torque and regressor, where the adaptation uses
            their prediction error.
    """

    t: float
    dynamic: Estimate
    kinematic: Estimate
    a_0: np.ndarray
    filters: Any
    adapting: bool = True
    load: Payload | None = None
    sensed: SensedState = _NOTHING
    torque_filter: Any = ()

    @property
    def a_d(self) -> np.ndarray:
        """The dynamic estimate (p_d)."""
        return self.dynamic.value

    @property
    def a_k(self) -> np.ndarray:
        """The kinematic estimate (p_k) [m]."""
        return self.kinematic.value

    def adapt(self, adapting: bool = True) -> ControllerState:
        """Return this state with estimates that move from now on, or rest."""
        return self._replace(adapting=adapting)

    def flat(self) -> np.ndarray:
        """Return what moves, estimates and filters with their memories, as one array."""
        moving = (*self[1:5], self.torque_filter)
        return np.concatenate([part.ravel() for part in _leaves(moving)])

    def with_flat(self, values: np.ndarray) -> ControllerState:
        """Return the state whose ``flat`` is ``values``."""
        parts, used = _filled((*self[1:5], self.torque_filter), values, 0)
        assert used == values.size
        names = ("dynamic", "kinematic", "a_0", "filters", "torque_filter")
        return self._replace(**dict(zip(names, parts, strict=True)))


def _leaves(part: Any) -> list[np.ndarray]:
    """Return the arrays in estimates and nested tuples, in order; constants are left out."""
    if isinstance(part, Estimate):
        return [part.value, *_leaves(part.memory)]
    if isinstance(part, tuple):
        return [leaf for inner in part for leaf in _leaves(inner)]
    return [part] if isinstance(part, np.ndarray) else []


def _filled(part: Any, values: np.ndarray, start: int) -> tuple[Any, int]:
    """Return estimates and nested tuples with their arrays taken from values, and how many were.

    They are taken from ``start`` on; the number is that of all used by then.
    """
    if isinstance(part, Estimate):
        (value, memory), start = _filled((part.value, part.memory), values, start)
        return Estimate(value, memory), start
    if not isinstance(part, tuple | np.ndarray):
        return part, start
    if not isinstance(part, tuple):
        return values[start : start + part.size].reshape(part.shape), start + part.size
    inner = []
    for piece in part:
        filled, start = _filled(piece, values, start)
        inner.append(filled)
    return (type(part)(*inner) if hasattr(part, "_fields") else tuple(inner)), start


class Sample(NamedTuple):
    """What there was at one sample of a run; views, logs and rollouts all read these.

    Attributes:
        t: time [s].
        measurement: what the sensors said.
        desired: the desired motion.
        state: the controller's state before this sample's step.
        torque: (nv) what the motors give from now on [N m or N].
        truth: what perfect sensors would have said: the true q, v, x and xd.
        step_time: how long the controller took [s]; zero in continuous mode, which has no steps.
    """

    t: float
    measurement: Measurement
    desired: Desired
    state: ControllerState
    torque: np.ndarray
    truth: Measurement
    step_time: float = 0.0
