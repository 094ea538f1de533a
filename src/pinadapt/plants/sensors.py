"""What the controller gets to see of the plant: noise, and a late camera."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np

from .._checks import positive
from ..exceptions import InputError, did_you_mean
from ..records import Measurement
from .pinocchio_plant import PinocchioPlant

CHANNELS = ("q", "v", "x", "angle")


class Sensors:
    """Encoders, tachometers and a task-space tracker with white noise, the tracker with a pure delay.

    The tracker also reports the task velocity, delayed alike and without noise.
    """

    def __init__(
        self,
        plant: PinocchioPlant,
        dt: float,
        *,
        noise: Mapping[str, float] | None = None,
        delay: float = 0.0,
        seed: int = 0,
    ) -> None:
        """Take standard deviations q [rad or m], v [rad/s or m/s], x [m], angle [rad], and the tracker's delay.

        The tracker's ``angle`` turns a measured pose about each world axis.

        Args:
            plant: what is measured.
            dt: sampling period [s].
            noise: standard deviation of each channel.
            delay: s, rounded to whole periods.
            seed: of the noise.

        Raises:
            InputError: unknown channels, negative numbers, or angles of a task that has none.
        """
        for name in noise or {}:
            if name not in CHANNELS:
                raise InputError(
                    f"no channel is called '{name}'; there are {CHANNELS}.{did_you_mean(name, CHANNELS)}",
                    where="noise",
                )
        self._plant, self._rng = plant, np.random.default_rng(seed)
        self._noise = {
            name: positive((noise or {}).get(name, 0.0), f"noise.{name}", zero=True)
            for name in CHANNELS
        }
        self._task = plant.robot.task
        self._angles = self._task.size - self._task.positions
        if self._noise["angle"] and not self._angles:
            raise InputError(
                f"the task '{self._task.name}' has no orientation to disturb.", where="noise.angle"
            )
        late = round(positive(delay, "delay", zero=True) / dt)
        self._tracked: deque[tuple[np.ndarray, np.ndarray | None]] = deque(maxlen=late + 1)

    def measure(self, q: np.ndarray, v: np.ndarray) -> tuple[Measurement, Measurement]:
        """Return the next sample as the sensors see it, and as it truly is."""
        truth = self._plant.measurement(q, v)
        self._tracked.append((truth.x, truth.xd))
        x, xd = self._tracked[0]  # before the delay has passed, the first sample
        if any(self._noise.values()):
            q = self._plant.integrate(q, self._white("q", self._plant.nv))
            v = v + self._white("v", self._plant.nv)
            x = self._task.moved(x, self._tracking_error())
        return Measurement(truth.t, q, v, x, xd=xd), truth

    def _tracking_error(self) -> np.ndarray:
        places = self._white("x", self._task.positions)
        return (
            np.concatenate([places, self._white("angle", self._angles)]) if self._angles else places
        )

    def _white(self, name: str, size: int) -> np.ndarray:
        return self._noise[name] * self._rng.standard_normal(size)
