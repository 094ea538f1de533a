"""How a controller takes what its sensors say: what it believes, filters, and carries on to now."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..filters.low_pass import LowPass
from ..models.sight import Carrier, Sensed
from ..models.task_kinematics import TaskKinematics
from ..records import Measurement
from .guards import Guards


@dataclass(frozen=True, eq=False)
class Senses:
    """From measurements to the position and the joint velocity of now; the defaults take all as is.

    Attributes:
        carrier: how frames of a camera become the coordinates of now.
        low_pass: on the measured joint velocity, or None.
        guards: what is not believed, and when there is nothing to learn.
    """

    carrier: Carrier = field(default_factory=Carrier)
    low_pass: LowPass | None = None
    guards: Guards = field(default_factory=Guards)

    def init(self, measurement: Measurement, kinematics: TaskKinematics) -> Sensed:
        """Return what is kept of the first sample."""
        v = None if self.low_pass is None else measurement.v.copy()
        return Sensed(self.carrier.init(measurement, kinematics), v)

    def velocity(self, before: Sensed, measurement: Measurement, t: float) -> np.ndarray:
        """Return the joint velocity (n), filtered since the sample before at time t [s].

        Raises:
            MeasurementError: it is implausible.
        """
        v = measurement.v
        self.guards.check_velocity(v)
        if self.low_pass is None:
            return v
        assert before.v is not None  # the controller that filters has begun with one
        return self.low_pass.advance(before.v, v, measurement.t - t)

    def see(
        self,
        before: Sensed,
        measurement: Measurement,
        v: np.ndarray,
        kinematics: TaskKinematics,
        a_k: np.ndarray,
    ) -> Sensed:
        """Return what is kept for the next sample, kinematics updated to this one.

        Args:
            before: of the sample before.
            measurement: the sample.
            v: (n) its filtered velocity [rad/s or m/s].
            kinematics: the believed kinematics.
            a_k: (p) their estimate [m].

        Raises:
            MeasurementError: the position is implausible, of a later time, or too old.
        """
        if measurement.x is not None:
            self.guards.check_position(measurement.x, kinematics)
        sight = self.carrier.see(before.sight, measurement, kinematics, a_k)
        return Sensed(sight, None if self.low_pass is None else v)
