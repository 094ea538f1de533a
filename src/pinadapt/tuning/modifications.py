"""Modifications of the dynamic adaptation by name, with their default sizes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from numpy.typing import ArrayLike

from .._checks import name_list
from ..adaptation.adaptation import Adaptation
from ..adaptation.dead_zone import DeadZone
from ..adaptation.error_leak import ErrorLeak
from ..adaptation.leak import Leak
from ..adaptation.mass_matrix_projection import MassMatrixProjection
from ..adaptation.normalised import Normalised
from ..exceptions import GainError, InputError, did_you_mean
from ..laws.law import Law
from ..models.typical_motion import TypicalMotion
from ..sensing import SensorQuality
from .prediction_rates import typical_torques
from .remedies import Remedies

SIGMA = "sigma"
MODIFICATIONS = ("projection", SIGMA, "e1", "dead-zone", "normalised")
Given: TypeAlias = str | Sequence[str] | Mapping[str, Any] | None

_LEAK = 0.05  # [1/s]
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
        default = setting.needed.leak or _LEAK
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
