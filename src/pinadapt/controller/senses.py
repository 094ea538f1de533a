"""How a controller takes what its sensors say: what it believes, filters, and carries on to now."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..filters.low_pass import LowPass
from ..models.late_frames import Carrier, Sensed
from ..models.task_kinematics import TaskKinematics
from ..records import Measurement
from ..sensing import SensorQuality
from .guards import Guards

_PERFECT = SensorQuality()


@dataclass(frozen=True, eq=False)
class Senses:
    """From measurements to the position and the joint velocity of now.

    Attributes:
        guards: what is not believed, and when there is nothing to learn.
        carrier: how frames of a camera become the coordinates of now.
        low_pass: on the measured joint velocity, or None.
        quality: of the sensors that all this is made for.
    """

    guards: Guards
    carrier: Carrier = field(default_factory=Carrier)
    low_pass: LowPass | None = None
    quality: SensorQuality = _PERFECT

    def init(self, measurement: Measurement, kinematics: TaskKinematics) -> Sensed:
        """Return what is kept of the first sample."""
        sensed = self.carrier.init(measurement, kinematics)
        return sensed if self.low_pass is None else sensed._replace(v=measurement.v.copy())

    def velocity(self, before: Sensed, v: np.ndarray, elapsed: float) -> np.ndarray:
        """Return the joint velocity (n), filtered over the time since the last sample [s]."""
        assert self.low_pass is not None and before.v is not None  # one that filters begins with v
        return self.low_pass.advance(before.v, v, elapsed)
