"""What noise of the sensors asks of filters and rates; nothing where there is none.

The size that counts is the noise of the joint velocity against the bandwidth, an angle sigma = (its
standard deviation) / w. Where it is ``_COARSE``, about that of a differenced encoder of 14 bits a
turn at 1 kHz, the loop needs all of what is below; finer sensors need less, with the cube root of
sigma: velocity noise through a low pass, K_D and back goes with its bandwidth, and from there into
the estimates with the square.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from numpy.typing import ArrayLike

from .._checks import positive, vector
from ..exceptions import InputError, did_you_mean
from ..robot.robot import Robot
from ..robot.workspace import reach
from ..sensing import Camera

CHANNELS = ("q", "v", "x", "angle")

_COARSE = 5e-3  # [rad]
_FILTER, _DECORRELATION, _MODE = 7.0, 2.0, 0.3  # bandwidths; share of the adaptation's mode
_LEAK = 0.03  # [1/s]
_FINEST = 1e-4  # of the reach: what noise of the camera may leave in the position


class Remedies(NamedTuple):
    """What a controller does against noise.

    Attributes:
        velocity: bandwidth of the low pass on the joint velocity [1/s], infinite for none.
        decorrelation: of the law's regressor [1/s], infinite for none.
        mode: share of the adaptation's fastest mode.
        leak: of the dynamic estimate [1/s], zero for none.
        smoothing: bandwidth of the low pass on a camera's frames [1/s], infinite for none.
    """

    velocity: float = math.inf
    decorrelation: float = math.inf
    mode: float = 1.0
    leak: float = 0.0
    smoothing: float = math.inf


@dataclass(frozen=True)
class Sensors:
    """What the user declares of the sensors, as the sizes that count.

    Attributes:
        dt: sampling period [s].
        reach: of the robot [m].
        v: standard deviation of the joint velocity [rad/s or m/s].
        x: of a frame's position [m].
        rate: frames of the camera [1/s].
    """

    dt: float
    reach: float
    v: float = 0.0
    x: float = 0.0
    rate: float = 0.0

    @classmethod
    def of(
        cls,
        robot: Robot,
        dt: float,
        camera: Camera | Mapping[str, float | None] | None,
        noise: Mapping[str, float] | None,
        encoder: ArrayLike,
    ) -> Sensors:
        """Return the sizes, from the words of ``make_controller``.

        A count c of a differenced encoder is noise of c / (dt sqrt(6)): two roundings.

        Raises:
            InputError: unknown words, or numbers that cannot be.
        """
        given = noise or {}
        for name in given:
            if name not in CHANNELS:
                raise InputError(
                    f"no channel is called '{name}'; there are {list(CHANNELS)}."
                    f"{did_you_mean(str(name), CHANNELS)}",
                    where="noise",
                )
        sizes = {name: positive(given.get(name, 0.0), f"noise.{name}", zero=True) for name in given}
        counts = vector(encoder, robot.model.nv, "encoder")
        if (counts < 0.0).any():
            raise InputError(f"must not be negative, got {encoder!r}.", where="encoder")
        differenced = float(counts.max(initial=0.0)) / (dt * math.sqrt(6.0))
        seen = None if camera is None else Camera.of(camera)
        rate = 1.0 / dt if seen is None or seen.rate is None else min(seen.rate, 1.0 / dt)
        v = math.hypot(sizes.get("v", 0.0), differenced)
        return cls(dt, reach(robot), v, sizes.get("x", 0.0), rate)


def remedies(sensors: Sensors, bandwidth: float) -> Remedies:
    """Return what noise asks for at a bandwidth w [rad/s] of the feedback."""
    found = Remedies()
    if sensors.v > 0.0:
        size = sensors.v / bandwidth / _COARSE
        root = size ** (1.0 / 3.0)
        found = Remedies(
            velocity=_FILTER * bandwidth / root,
            decorrelation=_DECORRELATION * bandwidth / root,
            mode=min(1.0, _MODE / root),
            leak=_LEAK * size,
        )
    if sensors.x > 0.0:
        smoothing = 2.0 * sensors.rate * (_FINEST * sensors.reach / sensors.x) ** 2
        found = found._replace(smoothing=smoothing)
    return found
