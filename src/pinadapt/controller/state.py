"""Everything the controller remembers from one sample to the next."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from .._checks import flag
from .._kernels import samples as kernels
from ..adaptation.adaptation import Estimate
from ..exceptions import InputError
from ..models.delay_compensation import SensedState
from ..records import Desired, Measurement
from ..robot.changes import Payload
from .governor import PathTime
from .sensing import LASTS, row

_NOTHING = SensedState(np.zeros(0), np.zeros(0))


class Bridged(NamedTuple):
    """How many samples were replaced by a prediction, because they did not follow from the others.

    Attributes:
        joints: samples of q or v.
        frames: frames of the camera, taken for missing ones.
        torques: measured torques, taken for those that were sent.
        times: samples with the time of the one before, in which no time was taken to pass.
    """

    joints: int = 0
    frames: int = 0
    torques: int = 0
    times: int = 0

    @classmethod
    def of(cls, trail: np.ndarray) -> Bridged:
        """Return the numbers in the trail of a state."""
        if not trail.size:
            return cls()
        return cls(*trail[: kernels.BRIDGED].astype(int).tolist())


class ControllerState(NamedTuple):
    """The state of a controller after a sample: estimates, filters, sensors; immutable.

    The sizes of the estimates are checked in every step. Of what filters, adaptations and sensors
    remember the shapes are checked, not the numbers, so leave it to the controller.

    Attributes:
        t: time of the last sample [s].
        dynamic: estimate of the dynamic parameters, with what its adaptation remembers.
        kinematic: the same of the kinematic parameters [m].
        a_0: (p_d) the dynamic estimate at the start, moved by what was announced since.
        filters: state of the law's filters, see ``Law.filters``.
        adapting: whether the estimates move; see ``adapt``.
        load: what the robot carries in addition to its description, as last announced.
        sensed: what the sensors said at the last sample, see ``SensedState``.
        torque_filter: state of the low pass of torque and regressor, where the adaptation uses
            their prediction error.
        path: time of the path, where a governor may slow it, or where it had to wait for a
            ``SlowStart``; else None.
        start: of a ``SlowStart``, what it remembers until the path begins; None from then on.
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
    path: PathTime | None = None
    start: Any = None

    @property
    def a_d(self) -> np.ndarray:
        """The dynamic estimate (p_d)."""
        return self.dynamic.value

    @property
    def a_k(self) -> np.ndarray:
        """The kinematic estimate (p_k) [m]."""
        return self.kinematic.value

    @property
    def bridged(self) -> Bridged:
        """How many samples were replaced by a prediction since the start."""
        return Bridged.of(self.sensed.trail)

    @property
    def unseen(self) -> np.ndarray:
        """Of which joints (n) ``Controller.safe`` has known nothing for 15 ms.

        No torque rests such a joint: it is a matter for the arm's brakes.
        """
        trail = self.sensed.trail
        if not trail.size:
            return np.zeros(self.sensed.v.size, bool)
        return row(trail, kernels.UNSEEN) > LASTS

    def adapt(self, adapting: bool = True) -> ControllerState:
        """Return this state with estimates that move from now on, or rest.

        Raises:
            InputError: neither True nor False.
        """
        return self._replace(adapting=flag(adapting, "adapting"))

    def gave(self, torque: np.ndarray | None) -> ControllerState:
        """Return the state before a sample whose motors applied another torque than commanded.

        The torque (n) is that of the last period [N m or N]; None: the commanded one. Where motors
        are declared late, nothing is changed.
        """
        memory = self.torque_filter
        if torque is None or not memory or memory.underway or np.array_equal(torque, memory.tau):
            return self
        y = memory.y + memory.shares[1] * (torque - memory.tau)
        return self._replace(torque_filter=memory._replace(y=y, tau=torque))

    def flat(self) -> np.ndarray:
        """Return the continuous states as one array: estimates, filters, memories, path time."""
        return np.concatenate(list(_leaves((*self[1:5], self.torque_filter, self.path))))

    def with_flat(self, values: np.ndarray) -> ControllerState:
        """Return the state whose ``flat`` is ``values``."""
        moving, used = _filled((*self[1:5], self.torque_filter, self.path), values, 0)
        if used != values.size:
            raise InputError(f"expected {used} floats, got {values.size}.", where="values")
        dynamic, kinematic, a_0, filters, torque_filter, path = moving
        return self._replace(
            dynamic=dynamic,
            kinematic=kinematic,
            a_0=a_0,
            filters=filters,
            torque_filter=torque_filter,
            path=path,
        )


def _leaves(part: Any) -> Iterator[np.ndarray]:
    """Yield the arrays in estimates and nested tuples, flat and in order, without constants."""
    if isinstance(part, np.ndarray):
        yield part.ravel()
    elif isinstance(part, Estimate):
        yield from _leaves((part.value, part.memory))
    elif isinstance(part, PathTime):
        yield np.array(part[:3])
    elif isinstance(part, tuple):
        for inner in part:
            yield from _leaves(inner)


def _filled(part: Any, values: np.ndarray, start: int) -> tuple[Any, int]:
    """Return a part with the arrays of ``_leaves`` taken from values, and where they end there."""
    if isinstance(part, np.ndarray):
        stop = start + part.size
        return values[start:stop].reshape(part.shape), stop
    if isinstance(part, Estimate):
        both, stop = _filled((part.value, part.memory), values, start)
        return Estimate(*both), stop
    if isinstance(part, PathTime):
        return PathTime._make([*values[start : start + 3].tolist(), part.cause]), start + 3
    if not isinstance(part, tuple):
        return part, start
    pieces = []
    for piece in part:
        found, start = _filled(piece, values, start)
        pieces.append(found)
    return type(part)(*pieces) if hasattr(part, "_fields") else tuple(pieces), start


class Sample(NamedTuple):
    """One sample of a run: signals, state and torque; views, logs and rollouts read these.

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
