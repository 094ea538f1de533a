"""Everything the controller remembers from one sample to the next."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from .._checks import flag
from .._kernels import samples as kernels
from ..adaptation.adaptation import Estimate, mapped
from ..models.delay_compensation import SensedState
from ..records import Desired, Measurement
from ..robot.changes import Load
from .constraint_forces import FEASIBLE, Missed
from .governor import PathTime
from .residuals import LASTS

_NOTHING = SensedState(np.array([]), np.array([]))


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
        missed: what constraint forces could not give of the torque at the last sample.
        footing: (c, 3) where contacts stand [m], NaN in the air; see ``Constraints.footing``.
    """

    t: float
    dynamic: Estimate
    kinematic: Estimate
    a_0: np.ndarray
    filters: Any
    adapting: bool = True
    load: Load = None
    sensed: SensedState = _NOTHING
    torque_filter: Any = ()
    path: PathTime | None = None
    start: Any = None
    missed: Missed = FEASIBLE
    footing: np.ndarray = np.zeros((0, 3))

    @property
    def a_d(self) -> np.ndarray:
        """The dynamic estimate (p_d)."""
        return self.dynamic.value

    @property
    def a_k(self) -> np.ndarray:
        """The kinematic estimate (p_k) [m]."""
        return self.kinematic.value

    @property
    def stands(self) -> np.ndarray | None:
        """Which point contacts (c) stand, as last desired; None: all contacts."""
        air = np.isnan(self.footing[:, 0])
        return ~air if air.any() else None

    @property
    def bridged(self) -> Bridged:
        """How many samples were replaced by a prediction since the start."""
        return Bridged(*self.sensed.monitor.bridged)

    @property
    def unseen(self) -> np.ndarray:
        """Of which joints (n) ``Controller.safe`` has known nothing for 15 ms.

        No torque rests such a joint: it is a matter for the arm's brakes.
        """
        return self.sensed.monitor.joints[kernels.UNSEEN] > LASTS

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
        y = memory.y + memory.shares[1] * memory.projected(torque - memory.tau)
        return self._replace(torque_filter=memory._replace(y=y, tau=torque))

    def flat(self) -> np.ndarray:
        """Return the continuous states as one array: estimates, filters, memories, path time."""
        found: list[np.ndarray] = []

        def keep(array: np.ndarray) -> np.ndarray:
            found.append(array.ravel())
            return array

        self._mapped(keep)
        return np.concatenate(found)

    def with_flat(self, values: np.ndarray) -> ControllerState:
        """Return the state whose ``flat`` is ``values``."""
        used = 0

        def take(array: np.ndarray) -> np.ndarray:
            nonlocal used
            used += array.size
            return values[used - array.size : used].reshape(array.shape)

        return self._mapped(take)

    def _mapped(self, change: Callable[[np.ndarray], np.ndarray]) -> ControllerState:
        """Return the state with its continuous states changed."""
        names = ("dynamic", "kinematic", "a_0", "filters", "torque_filter", "path")
        return self._replace(**{name: mapped(change, getattr(self, name)) for name in names})


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
        mean_torque: (nv) mean torque until the next sample, where those in between are not kept.
    """

    t: float
    measurement: Measurement
    desired: Desired
    state: ControllerState
    torque: np.ndarray
    truth: Measurement
    step_time: float = 0.0
    mean_torque: np.ndarray | None = None
