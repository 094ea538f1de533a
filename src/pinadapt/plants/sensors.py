"""What the controller gets to see of a plant: noise, and a late tracker."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from .._checks import positive
from ..exceptions import InputError, did_you_mean
from ..records import Measurement
from ..robot.robot import Robot

CHANNELS = ("q", "v", "x", "angle")


class Sensors:
    """Encoders, tachometers and a task-space tracker, all with white noise, the tracker late.

    The tracker also reports the task velocity, equally late and without noise.
    """

    def __init__(
        self,
        robot: Robot,
        dt: float,
        *,
        noise: Mapping[str, float] | None = None,
        delay: float = 0.0,
        seed: int = 0,
    ) -> None:
        """Take the standard deviations and the tracker's delay.

        Args:
            robot: whose configurations and task are measured.
            dt: sampling period [s].
            noise: standard deviation of each channel: q [rad or m], v [rad/s or m/s], x [m], and
                angle [rad], by which the tracker turns a measured pose about each world axis.
            delay: s, rounded to whole periods.
            seed: of the noise.

        Raises:
            InputError: unknown channels, negative numbers, or angles of a task that has none.
        """
        for name in noise or {}:
            if name not in CHANNELS:
                raise InputError(
                    f"no channel is called '{name}'; there are {CHANNELS}."
                    f"{did_you_mean(name, CHANNELS)}",
                    where="noise",
                )
        self._model, self._task, self._seed = robot.model, robot.task, seed
        self._noise = {
            name: positive((noise or {}).get(name, 0.0), f"noise.{name}", zero=True)
            for name in CHANNELS
        }
        self._noisy = any(self._noise.values())
        self._angles = self._task.size - self._task.positions
        if self._noise["angle"] and not self._angles:
            raise InputError(
                f"the task '{self._task.name}' has no orientation to disturb.", where="noise.angle"
            )
        late = round(positive(delay, "delay", zero=True) / dt)
        self._tracked: deque[Measurement] = deque(maxlen=late + 1)
        self.reset()

    def reset(self) -> None:
        """Forget what was measured, and begin the noise anew."""
        self._rng = np.random.default_rng(self._seed)
        self._tracked.clear()

    def measure(self, truth: Measurement) -> Measurement:
        """Return what the sensors make of the next sample, given what perfect ones would say.

        Before the delay has passed, the tracker repeats its first sample.
        """
        self._tracked.append(truth)
        tracked = self._tracked[0]
        q, v, x = truth.q, truth.v, tracked.x
        if self._noisy:
            q = pin.integrate(self._model, q, self._white("q", len(v)))
            v = v + self._white("v", len(v))
            x = None if x is None else self._task.moved(x, self._tracking_error())
        return truth._replace(q=q, v=v, x=x, x_time=tracked.t, xd=tracked.xd)

    def _tracking_error(self) -> np.ndarray:
        places = self._white("x", self._task.positions)
        return (
            np.concatenate([places, self._white("angle", self._angles)]) if self._angles else places
        )

    def _white(self, name: str, size: int) -> np.ndarray:
        return self._noise[name] * self._rng.standard_normal(size)
