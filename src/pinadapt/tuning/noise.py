"""What noise of the sensors asks of filters and rates; nothing where there is none.

The size that counts is the noise of the joint velocity against the bandwidth, an angle sigma = (its
standard deviation) / w. Where it is ``_COARSE``, about that of a differenced encoder of 14 bits a
turn at 1 kHz, the loop needs all of what is below; finer sensors need less, with the cube root of
sigma: velocity noise through a low pass, K_D and back goes with its bandwidth, and from there into
the estimates with the square.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .._checks import mapping, name_list, positive, vector
from ..adaptation.adaptation import Adaptation
from ..adaptation.modifications import DeadZone, ErrorLeak, Leak, Normalised
from ..adaptation.projections import MassMatrixProjection
from ..exceptions import GainError, InputError, did_you_mean
from ..laws.law import Law
from ..models.typical_motion import TypicalMotion
from ..records import Measurement
from ..robot.robot import Robot
from ..sensing import Camera, SensorQuality
from .prediction_rates import typical_torques

_FEWEST = 10  # samples that show the noise
_RESTING = 1.0  # mean against deviation of the velocity of an arm that rests
CHANNELS = ("q", "v", "x", "angle", "tau")

_COARSE = 5e-3  # [rad]
_FILTER, _DECORRELATION, _MODE = 7.0, 2.0, 0.2  # bandwidths; share of the adaptation's mode
_LEAK = 0.03  # [1/s]
_FINEST = 1.5e-4  # of the reach: what noise of the camera may leave in the position


class Remedies(NamedTuple):
    """What a controller does against noise.

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


def sensor_quality(
    robot: Robot,
    dt: float,
    camera: Camera | Mapping[str, float | None] | None,
    noise: Mapping[str, ArrayLike] | Sequence[Measurement] | None,
    encoder: ArrayLike,
) -> SensorQuality:
    """Return how good declared sensors are.

    A count c of a differenced encoder is noise of c / (dt sqrt(6)): two roundings.

    Args:
        robot: whose joints are measured.
        dt: sampling period [s].
        camera: that gives x, or None.
        noise: standard deviations by channel, q, v, x [rad, rad/s, m, m/s], or samples at rest;
            that of the torque, tau, asks for nothing.
        encoder: rad or m a count, one or one a joint.

    Raises:
        InputError: unknown words, or numbers that cannot be.
    """
    given = seen_noise(noise) if isinstance(noise, list | tuple) else mapping(noise, "noise")
    for name in given:
        if name not in CHANNELS:
            raise InputError(
                f"no channel is called '{name}'; there are {list(CHANNELS)}."
                f"{did_you_mean(str(name), CHANNELS)}",
                where="noise",
            )
    sizes = {
        name: positive(given.get(name, 0.0), f"noise.{name}", zero=True)
        for name in given
        if name != "tau"
    }
    counts = vector(encoder, robot.model.nv, "encoder")
    if (counts < 0.0).any():
        raise InputError(f"must not be negative, got {encoder!r}.", where="encoder")
    differenced = float(counts.max(initial=0.0)) / (dt * math.sqrt(6.0))
    seen = None if camera is None else Camera.of(camera)
    rate = 1.0 / dt if seen is None or seen.rate is None else min(seen.rate, 1.0 / dt)
    age = 0.0 if seen is None else seen.delay + 1.0 / rate
    v = math.hypot(sizes.get("v", 0.0), differenced)
    return SensorQuality(v, sizes.get("x", 0.0), rate, age)


def seen_noise(samples: Sequence[Measurement]) -> dict[str, float]:
    """Return the standard deviations of v [rad/s or m/s] and x [m] that samples at rest show.

    The largest of the joints, and of the first three coordinates; frames that a camera repeats
    count once.

    Raises:
        InputError: fewer than ten samples, or an arm that moves.
    """
    if len(samples) < _FEWEST or not all(isinstance(part, Measurement) for part in samples):
        raise InputError(
            f"expected at least {_FEWEST} measurements of an arm at rest.", where="noise"
        )
    v = np.array([sample.v for sample in samples], dtype=float)
    deviation = v.std(axis=0)
    if (np.abs(v.mean(axis=0)) > _RESTING * deviation + 1e-9).any():
        raise InputError(
            f"the arm moves, at {np.abs(v.mean(axis=0)).max():.2g} rad/s or m/s.",
            where="noise",
            hint="Take the samples while it rests.",
        )
    frames = {sample.t if sample.x_time is None else sample.x_time: sample.x for sample in samples}
    x = np.array([frame[:3] for frame in frames.values() if frame is not None], dtype=float)
    return {
        "v": float(deviation.max(initial=0.0)),
        "x": float(x.std(axis=0).max()) if len(x) > 1 else 0.0,
    }


def remedies(quality: SensorQuality, bandwidth: float, reach: float) -> Remedies:
    """Return what noise and age ask for at a bandwidth w [rad/s] of the feedback.

    Args:
        quality: of the sensors.
        bandwidth: w [rad/s].
        reach: of the robot [m].
    """
    found = Remedies(kinematic=1.0 / quality.age if quality.age else math.inf)
    if quality.v > 0.0:
        size = coarseness(quality, bandwidth)
        root = size ** (1.0 / 3.0)
        found = found._replace(
            velocity=_FILTER * bandwidth / root,
            decorrelation=_DECORRELATION * bandwidth / root,
            mode=min(1.0, _MODE / root),
            leak=_LEAK * root,
        )
    if quality.x > 0.0:
        smoothing = 2.0 * quality.rate * (_FINEST * reach / quality.x) ** 2
        found = found._replace(smoothing=smoothing)
    return found


def coarseness(quality: SensorQuality, bandwidth: float) -> float:
    """Return the noise of the joint velocity against that of 14 bits a turn at w [rad/s]."""
    return quality.v / bandwidth / _COARSE


SIGMA = "sigma"
MODIFICATIONS = ("projection", SIGMA, "e1", "dead-zone", "normalised")
Given: TypeAlias = str | Sequence[str] | Mapping[str, Any] | None

_LEAK_RATE = 0.05  # [1/s]
_E1, _OFF = 0.2, 1e-3  # [1/s] in a loop that is 1 mrad or 1 mm off at the bandwidth
_DEVIATIONS = 3.0  # of the noise, for a dead zone


class Setting(NamedTuple):
    """What the sizes of modifications follow from.

    Attributes:
        law: whose errors drive the adaptation.
        motion: the believed robot.
        bandwidth: w [rad/s].
        period: dt [s].
        quality: of the sensors.
        needed: what their noise asks for.
    """

    law: Law
    motion: TypicalMotion
    bandwidth: float
    period: float
    quality: SensorQuality
    needed: Remedies


def chosen_modifications(given: Given) -> dict[str, Any]:
    """Return the names of modifications, innermost first, with a gain, None or False.

    None is for the default.

    Args:
        given: names, or a mapping from names to a gain, True for the default, False for none, not
            even where noise asks for it.

    Raises:
        InputError: an unknown name; the nearest is suggested.
    """
    if given is None:
        return {}
    if isinstance(given, Mapping):
        chosen = {name: None if gain is True else gain for name, gain in given.items()}
    else:
        chosen = dict.fromkeys(name_list(given, "modifications", InputError))
    for name in chosen:
        if name not in MODIFICATIONS:
            raise InputError(
                f"no modification is called '{name}'; there are {list(MODIFICATIONS)}."
                f"{did_you_mean(str(name), MODIFICATIONS)}",
                where="modifications",
            )
    return chosen


def modified(adaptation: Adaptation, chosen: Mapping[str, Any], setting: Setting) -> Adaptation:
    """Return an adaptation of the dynamic estimate inside its modifications, the first innermost.

    Raises:
        GainError: a gain that cannot be, or that has no default here.
    """
    for name, gain in chosen.items():
        if gain is False:
            continue
        adaptation = _modified(adaptation, name, gain, setting)
    return adaptation


def _modified(adaptation: Adaptation, name: str, gain: Any, setting: Setting) -> Adaptation:
    motion = setting.motion
    if name == "projection":
        if gain is not None:
            raise GainError("it has no gain: write true.", where="modifications.projection")
        return MassMatrixProjection(adaptation, motion.dynamics, motion.robot)
    if name == SIGMA:
        default = setting.needed.leak or _LEAK_RATE
        return Leak(adaptation, default if gain is None else gain)
    if name == "e1":
        size = _of_velocity(setting, _OFF * setting.bandwidth, "modifications.e1")
        return ErrorLeak(adaptation, _E1 if gain is None else gain, size)
    if name == "dead-zone":
        return DeadZone(adaptation, _noise(setting) if gain is None else gain)
    share = 1.0 if gain is None else gain
    if not (isinstance(share, int | float) and share > 0.0):
        raise GainError(f"expected a positive number, got {gain!r}.", where="normalised")
    return Normalised(adaptation, float(typical_torques(adaptation, motion).sum()) / share)


def _noise(setting: Setting) -> ArrayLike:
    """Return three standard deviations of the joint velocity as it is behind its low pass.

    Raises:
        GainError: no noise is known.
    """
    where, v = "modifications.dead-zone", setting.quality.v
    if not v:
        raise GainError(
            "no noise of the joint velocity is known, from which the size follows.",
            where=where,
            hint="Give the size, or say encoder= or noise=.",
        )
    passed = min(1.0, math.sqrt(0.5 * setting.needed.velocity * setting.period))
    return _of_velocity(setting, _DEVIATIONS * v * passed, where)


def _of_velocity(setting: Setting, size: float, where: str) -> float:
    """Return a size in units of the joint velocity, if that is what drives the adaptation.

    Raises:
        GainError: it is something else.
    """
    if setting.law.velocity_error:
        return size
    raise GainError(
        f"the law '{setting.law.name}' drives the adaptation by another error than that of the "
        "joint velocity, whose size is not known.",
        where=where,
        hint="Wrap an adaptation yourself: pinadapt.DeadZone, pinadapt.ErrorLeak.",
    )
