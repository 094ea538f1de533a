"""One entry of a closed loop."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..controller.state import ControllerState
from ..records import Desired, Measurement


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
