"""Everything the controller remembers from one sample to the next."""

from __future__ import annotations

from collections.abc import Callable
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
        places = (kernels.BRIDGED, kernels.FRAMES, kernels.TORQUES, kernels.REPEATED)
        return cls(*(int(trail[place]) for place in places))


class ControllerState(NamedTuple):
    """The state of a controller after a sample: estimates, filters, sensors; immutable.

    The sizes of the estimates are checked in every step. Of what filters, adaptations and sensors
    remember the shapes are checked, not the numbers, so leave it to the controller.

    Attributes:
        t: time of the last sample [s].
        dynamic: estimate of the dynamic parameters, with what its adaptation remembers.
        kinematic: the same of the kinematic parameters [m].
        a_0: (p_d) the dynamic estimate at the start, moved by what was announced since.
        filters: state of the law's filters, see ``Law.filters``; of an ``Estimator``, what its
            torques have shown, see ``TorqueHistory``.
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
        return trail[kernels.TRAIL + kernels.BELIEVED :: kernels.TRAIL_ROWS] < 0.0

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
        leaves: list[np.ndarray] = []
        for part in (*self[1:5], self.torque_filter, self.path):
            _collect(part, leaves)
        return np.concatenate(leaves)

    def with_flat(self, values: np.ndarray) -> ControllerState:
        """Return the state whose ``flat`` is ``values``.

        Raises:
            InputError: another number of values.
        """
        size = self.flat().size
        if not isinstance(values, np.ndarray) or values.dtype != float or values.shape != (size,):
            raise InputError(f"expected an array of {size} floats.", where="values")
        return self.filler()(values)

    def filler(self) -> Callable[[np.ndarray], ControllerState]:
        """Return ``with_flat`` as a function, faster where many states of one shape are made."""
        moving, size = _filler((*self[1:5], self.torque_filter, self.path), 0)
        t, adapting, load, sensed = self.t, self.adapting, self.load, self.sensed
        start = self.start

        def filled(values: np.ndarray) -> ControllerState:
            """Return this state with its moving numbers replaced, at the same time."""
            assert size == values.size
            dynamic, kinematic, a_0, filters, torque_filter, path = moving(values)
            return ControllerState(
                t, dynamic, kinematic, a_0, filters, adapting, load, sensed, torque_filter, path,
                start,
            )  # fmt: skip

        return filled


def _collect(part: Any, leaves: list[np.ndarray]) -> None:
    """Append the arrays in estimates and nested tuples, flat and in order, without constants."""
    if isinstance(part, np.ndarray):
        leaves.append(part if part.ndim == 1 else part.ravel())
    elif isinstance(part, Estimate):
        leaves.append(part.value)
        _collect(part.memory, leaves)
    elif isinstance(part, PathTime):
        leaves.append(np.array(part[:3]))
    elif isinstance(part, tuple):
        for inner in part:
            _collect(inner, leaves)


def _filler(part: Any, start: int) -> tuple[Callable[[np.ndarray], Any], int]:
    """Return what makes a part anew with its arrays taken from flat values, and where they end.

    The part is an estimate, an array, a constant, or nested tuples of them; its values begin at
    ``start``.
    """
    if isinstance(part, np.ndarray):
        stop, shape = start + part.size, part.shape
        if part.ndim == 1:
            return lambda values: values[start:stop], stop
        return lambda values: values[start:stop].reshape(shape), stop
    if isinstance(part, Estimate):
        value, middle = _filler(part.value, start)
        memory, stop = _filler(part.memory, middle)
        if stop == middle:
            kept = part.memory
            return lambda values: Estimate(value(values), kept), stop
        return lambda values: Estimate(value(values), memory(values)), stop
    if isinstance(part, PathTime):
        stop, cause = start + 3, part.cause
        return lambda values: PathTime._make([*values[start:stop].tolist(), cause]), stop
    if not isinstance(part, tuple) or not part:
        return lambda values: part, start
    pieces, stop = [], start
    for piece in part:
        filled, stop = _filler(piece, stop)
        pieces.append(filled)
    if hasattr(part, "_fields"):
        make = type(part)
        return lambda values: make(*[piece(values) for piece in pieces]), stop
    return lambda values: tuple([piece(values) for piece in pieces]), stop


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
