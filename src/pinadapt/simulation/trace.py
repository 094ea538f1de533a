"""What a run records while it goes on."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..controller.state import ControllerState
from ..records import Desired, Measurement


@dataclass(eq=False)
class Trace:
    """The raw record of a closed loop, one entry a sample.

    Attributes:
        t: times [s].
        measurements: what the sensors said.
        desired: the desired motion.
        true_q, true_v, true_x: true configuration (nq), velocity (nv) and task coordinates, without
            noise or delay.
        states: the controller's states before each step.
        torques: the torques (n) [N m or N] that the motors gave.
        diverged: time [s] at which the loop left every bound, or None.
        reason: why, or None.
        steps: controller steps done, recorded or not.
        step_time: seconds spent in them.
    """

    t: list[float] = field(default_factory=list)
    measurements: list[Measurement] = field(default_factory=list)
    desired: list[Desired] = field(default_factory=list)
    true_q: list[np.ndarray] = field(default_factory=list)
    true_v: list[np.ndarray] = field(default_factory=list)
    true_x: list[np.ndarray] = field(default_factory=list)
    states: list[ControllerState] = field(default_factory=list)
    torques: list[np.ndarray] = field(default_factory=list)
    diverged: float | None = None
    reason: str | None = None
    steps: int = 0
    step_time: float = 0.0

    def add(
        self,
        t: float,
        measurement: Measurement,
        desired: Desired,
        truth: Measurement,
        state: ControllerState,
        tau: np.ndarray,
    ) -> None:
        """Append one sample; ``truth`` is what perfect sensors would have said."""
        self.t.append(t)
        self.measurements.append(measurement)
        self.desired.append(desired)
        self.true_q.append(truth.q)
        self.true_v.append(truth.v)
        self.true_x.append(truth.x)
        self.states.append(state)
        self.torques.append(tau)

    def end(self, t: float, reason: str) -> None:
        """Note that the loop diverged at time t [s]."""
        self.diverged, self.reason = t, reason
