"""Filter settings for noisy sensors, and modifications of the adaptation.

The settings follow from the noise of the joint velocity over the bandwidth, an angle sigma = (its
standard deviation) / w. At sigma = ``_COARSE``, about that of a differenced encoder of 14 bits a
turn at 1 kHz, the settings are the numbers below. The low pass of the velocity costs an error that
falls with its bandwidth b, 1 / b, and one of the noise that it passes, sigma b^1/2: the sum is
least at b proportional to sigma^-2/3. The others scale with the cube root of sigma, as the effect
of noise on the estimates grows with the square of what passes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from .._checks import name_list, positive, word
from ..adaptation.adaptation import Adaptation
from ..adaptation.modifications import DeadZone, ErrorLeak, Leak, Normalised
from ..adaptation.projections import MassMatrixProjection
from ..exceptions import GainError
from ..laws.law import Law
from ..models.typical_motion import TypicalMotion
from ..records import SensorQuality
from .defaults import typical_torques

# [rad], at which the others are as stated; half, twice: a velocity filter 1.6 times slower, faster
_COARSE = 5e-3
# bandwidths, and share of the adaptation's mode; half: more lag, slower; twice: more noise passes
_FILTER, _DECORRELATION, _MODE = 7.0, 2.0, 0.2
_LEAK = 0.03  # [1/s]; half: estimates drift twice as far; twice: they stay nearer to the start
# of the reach: accepted noise of the filtered position; half: a quarter of the low pass's bandwidth
_FINEST = 1.5e-4


class NoiseSettings(NamedTuple):
    """Filters and rates of a controller with noisy sensors; the defaults are for perfect ones.

    Attributes:
        velocity: bandwidth of the low pass on the joint velocity [1/s], infinite for none.
        decorrelation: of the law's regressor [1/s], infinite for none.
        mode: share of the adaptation's fastest mode.
        leak: of the dynamic estimate [1/s], zero for none.
        smoothing: bandwidth of the low pass on a camera's frames [1/s], infinite for none.
        kinematic: fastest mode of the kinematic adaptation [rad/s]: its loop closes through frames.
    """

    velocity: float = math.inf
    decorrelation: float = math.inf
    mode: float = 1.0
    leak: float = 0.0
    smoothing: float = math.inf
    kinematic: float = math.inf


def noise_settings(quality: SensorQuality, bandwidth: float, reach: float) -> NoiseSettings:
    """Return filters and rates for the noise and delay of sensors at a bandwidth w [rad/s].

    Args:
        quality: of the sensors.
        bandwidth: w [rad/s].
        reach: of the robot [m].
    """
    found = NoiseSettings(kinematic=1.0 / quality.age if quality.age else math.inf)
    if quality.v > 0.0:
        root = (quality.v / bandwidth / _COARSE) ** (1.0 / 3.0)
        found = found._replace(
            velocity=_FILTER * bandwidth / root**2,
            decorrelation=_DECORRELATION * bandwidth / root,
            mode=min(1.0, _MODE / root),
            leak=_LEAK * root,
        )
    if quality.x > 0.0:
        found = found._replace(smoothing=2.0 * quality.rate * (_FINEST * reach / quality.x) ** 2)
    return found


SIGMA = "sigma"
MODIFICATIONS = ("projection", SIGMA, "e1", "dead-zone", "normalised")
Given: TypeAlias = str | Sequence[str] | Mapping[str, Any] | None


class Tuning(NamedTuple):
    """A tuned loop, from which the sizes of modifications follow.

    Attributes:
        law: whose errors drive the adaptation.
        motion: of the model.
        bandwidth: w [rad/s].
        period: dt [s].
        quality: of the sensors.
        settings: of the filters for their noise.
        rates: given by name; None: the default.
        lmi: matrix inequality for a basis of the user's own, or None.
    """

    law: Law
    motion: TypicalMotion
    bandwidth: float
    period: float
    quality: SensorQuality
    settings: NoiseSettings
    rates: Mapping[str, Any]
    lmi: Any = None

    @property
    def jitter(self) -> float:
        """Standard deviation of the joint velocity behind its low pass [rad/s or m/s]."""
        return self.quality.v * min(1.0, math.sqrt(0.5 * self.settings.velocity * self.period))

    def rate(self, name: str, default: float) -> float:
        """Return the rate with a name that is given, else the default.

        Raises:
            GainError: it is not positive; forgetting may be zero.
        """
        given = self.rates.get(name)
        return default if given is None else positive(given, name, zero="forgetting" in name)


def chosen_modifications(given: Given) -> dict[str, Any]:
    """Return the names of modifications, innermost first, with a gain, None or False.

    None is for the default.

    Args:
        given: names, or a mapping from names to a gain, True for the default, False for none, not
            even where noise asks for it.

    Raises:
        InputError: an unknown name; the nearest is suggested.
    """
    if isinstance(given, Mapping):
        chosen = {name: None if gain is True else gain for name, gain in given.items()}
    else:
        chosen = dict.fromkeys(name_list(given or (), "modifications"))
    for name in chosen:
        word(name, MODIFICATIONS, "modifications")
    return chosen


def modified(adaptation: Adaptation, chosen: Mapping[str, Any], tuning: Tuning) -> Adaptation:
    """Return an adaptation of the dynamic estimate inside its modifications, the first innermost.

    Raises:
        GainError: an invalid gain, or one without a default here.
    """
    motion = tuning.motion
    for name, gain in chosen.items():
        if gain is False:
            continue
        if name == "projection":
            adaptation = MassMatrixProjection(adaptation, motion.dynamics, motion.robot)
        elif name == SIGMA:
            if gain is None:
                gain = tuning.settings.leak or 0.05  # [1/s]
            adaptation = Leak(adaptation, gain)
        elif name == "e1":
            size = _of_velocity(tuning, 1e-3 * tuning.bandwidth, "modifications.e1")
            adaptation = ErrorLeak(adaptation, 0.2 if gain is None else gain, size)  # [1/s]
        elif name == "dead-zone":
            where = "modifications.dead-zone"
            if gain is None:  # three standard deviations of the velocity behind its low pass
                if not tuning.jitter:
                    raise GainError(
                        "no noise of the joint velocity is known, from which the size follows.",
                        where=where,
                        hint="Give the size, or the sensors: pa.Sensors(encoder=...) or noise=.",
                    )
                gain = _of_velocity(tuning, 3.0 * tuning.jitter, where)
            adaptation = DeadZone(adaptation, gain)
        else:
            share = 1.0 if gain is None else positive(gain, "modifications.normalised")
            typical = typical_torques(adaptation, motion)
            adaptation = Normalised(adaptation, typical.sum() / share)
    return adaptation


def _of_velocity(tuning: Tuning, size: float, where: str) -> float:
    """Return a size in units of the joint velocity, if that is what drives the adaptation.

    Raises:
        GainError: it is something else.
    """
    if tuning.law.velocity_error:
        return size
    raise GainError(
        f"the law '{tuning.law.name}' drives the adaptation by another error than that of the "
        "joint velocity, whose size is not known.",
        where=where,
        hint="Wrap an adaptation yourself: pinadapt.adaptation.DeadZone, ErrorLeak.",
    )
