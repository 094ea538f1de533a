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
from typing import NamedTuple

_COARSE = 5e-3  # [rad]
_FILTER, _DECORRELATION, _MODE = 7.0, 2.0, 0.1875  # bandwidths; share of the adaptation's mode
_LEAK = 0.1  # [1/s]
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


def remedies(
    *,
    bandwidth: float,
    reach: float,
    dt: float,
    noise: Mapping[str, float] | None,
    encoder: float,
    rate: float,
) -> Remedies:
    """Return what the declared noise asks for.

    Args:
        bandwidth: w [rad/s].
        reach: of the robot [m].
        dt: sampling period [s].
        noise: standard deviations of v [rad/s or m/s] and x [m].
        encoder: rad or m a count, from which v is differenced over a period; zero for none.
        rate: of the camera's frames [1/s].
    """
    noise = noise or {}
    v = math.hypot(noise.get("v", 0.0), encoder / (dt * math.sqrt(6.0)))
    x, found = noise.get("x", 0.0), Remedies()
    if v > 0.0:
        size = v / bandwidth / _COARSE
        root = size ** (1.0 / 3.0)
        found = Remedies(
            velocity=_FILTER * bandwidth / root,
            decorrelation=_DECORRELATION * bandwidth / root,
            mode=min(1.0, _MODE / root),
            leak=_LEAK * size,
        )
    if x > 0.0:
        found = found._replace(smoothing=2.0 * rate * (_FINEST * reach / x) ** 2)
    return found
