"""From a sample to what the law uses: plausibility, filtered velocity, present position."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import EllipsisType
from typing import Any

import numpy as np

from .._kernels import samples as kernels
from ..filters import LowPass
from ..models.delay_compensation import DelayCompensator, SensedState
from ..models.task_kinematics import TaskKinematics
from ..records import Measurement, SensorQuality, Sensors
from . import clock
from .first_samples import FirstSamples
from .residuals import TIME, Guards, new_monitor


@dataclass(frozen=True, eq=False)
class Senses:
    """From a measurement to joint velocity and present task position.

    Attributes:
        guards: what is refused as implausible, and when the arm rests.
        compensator: predicts the present position from late frames of a camera.
        low_pass: on the measured joint velocity, or None.
        quality: of the sensors for which all this is made.
        sensors: for which all this is made.
        timed: whether times must go forward, and the period is the time since the last sample where
            one was dropped.
        first: the torque against the momentum, in the first samples; None: it is not compared.
    """

    guards: Guards
    compensator: DelayCompensator = field(default_factory=DelayCompensator)
    low_pass: LowPass | None = None
    quality: SensorQuality = field(default_factory=SensorQuality)
    sensors: Sensors = field(default_factory=Sensors)
    timed: bool = False
    first: FirstSamples | None = None

    def init(
        self, measurement: Measurement, kinematics: TaskKinematics, a_k: np.ndarray
    ) -> SensedState:
        """Return what is kept of the first sample, with the kinematic estimate a_k (p) [m].

        Raises:
            ImplausibleError: this robot cannot be there.
        """
        measurement = measurement._replace(x_time=None)
        monitor = new_monitor(measurement.v)
        before = SensedState(measurement.q, measurement.v, monitor=monitor)
        sensed = self.read(before, measurement.t, measurement, kinematics, a_k)[0]
        self.guards.check_turn(measurement, kinematics, monitor)
        first = None if self.first is None else self.first.init()
        return sensed._replace(first=first, monitor=monitor)

    def read(
        self,
        before: SensedState,
        t_before: float,
        measurement: Measurement,
        kinematics: TaskKinematics,
        a_k: np.ndarray,
        dt: float | EllipsisType = ...,
        period: float = math.inf,
        sent: np.ndarray | None = None,
    ) -> tuple[SensedState, bool, Measurement, float]:
        """Return what is known at a sample, whether its joints rest, the sample, elapsed time [s].

        The estimated kinematics are updated to the sample, which is returned without the frame and
        the torque that were bridged. What is known shares no memory with it.

        Args:
            before: what was known at the sample before.
            t_before: time of that [s].
            measurement: the sample.
            kinematics: the estimated ones.
            a_k: (p_k) the estimate.
            dt: the controller's own time since then [s]; left out: the sample does not follow it.
            period: of the controller [s].
            sent: (n) the torque of the last period [N m or N].

        Raises:
            InputError: what dt cannot be.
            ImplausibleError: what clock and guards refuse, the last frame of the camera is too old,
                or what the first samples show is impossible.
            MeasurementError: a frame was taken later than the sample, or q or v is not finite.
        """
        guards, first, elapsed, since = self.guards, before.first, 0.0, math.inf
        t, q, v, x, x_time, _, _, tau, _ = measurement
        if dt is not ...:
            elapsed, since = clock.elapsed(t_before, t, dt, period, self.timed)
        answer, q, v, monitor = guards.check_joints(before, q, v, since)
        if answer == 2:
            guards.bridge_joints(measurement, monitor)
        if dt is not ...:
            if elapsed or not before.monitor.begun:
                monitor.since[TIME], elapsed = math.inf, elapsed or dt
            else:
                clock.stood(monitor, t, min(dt, period))
            if tau is not None:
                measurement = guards.bridge_torque(measurement, monitor, sent)
            if first is not None and self.first is not None:
                mean = 0.5 * (v + before.monitor.joints[kernels.RATE])
                first = self.first.after(first, q, mean, since)
        if self.low_pass is not None:
            v = self.low_pass.advance(before.v, v, t - t_before)
        kinematics.update(a_k, q, v)
        late = x_time is not None and x_time != t
        if not kinematics.positions:  # x follows from q
            x = kinematics.x_hat
            late = False
        follow = (before, t_before, t, q)
        seen = x is not None
        found = self.compensator.update(*follow, x, x_time if late else None, kinematics)
        x, epsilon, X_k, frame, _ = found
        if kinematics.positions and seen:
            if not late or frame is not before.frame:
                measurement, monitor = guards.bridge_frame(measurement, epsilon, X_k, a_k, monitor)
            if measurement.x is None:
                found = self.compensator.update(*follow, None, None, kinematics)
        sensed = SensedState(q, v, *found, first, monitor)
        return sensed, answer == 1, measurement, elapsed

    def fallback(
        self, before: SensedState, sample: Measurement | None, dt: float, decay: float
    ) -> SensedState:
        """Return the plausible q and v of a sample in which anything may be wrong; None: none came.

        The monitor has the way of each joint since the first such sample, and for how long nothing
        of it was used. Without q and v, the velocity decays at a rate [1/s].
        """
        q = _numbers(getattr(sample, "q", None), before.q.size)
        v = _numbers(getattr(sample, "v", None), before.v.size)
        _, q, v, monitor = self.guards.check_joints(before, q, v, dt, decay)
        return before._replace(q=q, v=v, monitor=monitor)


def _numbers(given: Any, size: int) -> np.ndarray:
    """Return an array of a size, NaN if it is none."""
    try:
        return np.asarray(given, dtype=float).reshape(size)
    except (TypeError, ValueError):
        return np.full(size, np.nan)
