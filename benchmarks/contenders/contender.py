"""The contenders: how each is made, and which of its gains are selected from a grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import pinadapt as pa

from .joint_tracking import JointTracking
from .observed_torque import ObservedTorque
from .setting import Setting

Gains = dict[str, float]

_OUTER = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)  # in bandwidths
_JOINT_INTEGRAL = 0.5  # in bandwidths; with poles at w and 3 w a faster one gains nothing


@dataclass(frozen=True)
class Contender:
    """One way to control a robot whose model is wrong.

    Attributes:
        make: returns the controller for a setting and gains.
        grid: values to try of each selected gain, relative to the bandwidth.
        sensors: the sets of sensors for which it is run.
    """

    make: Callable[..., pa.Controller]
    grid: Mapping[str, Sequence[float]] = field(default_factory=dict)
    sensors: Sequence[str] = ("perfect", "camera")

    def choices(self) -> list[Gains]:
        """Return all combinations of the grid."""
        return [dict(zip(self.grid, c, strict=True)) for c in product(*self.grid.values())]


def joint_tracking(at: Setting, *, k_j: float = 0.0, k_x: float = 0.0) -> pa.Controller:
    """Return PD or PID with gravity: the default's K_D, and w K_D on positions."""
    gains: dict[str, Any] = {
        "K_P": at.w * at.damping,
        "K_D": at.damping,
        "k_j": k_j * at.w,
        "k_x": k_x * at.w,
    }
    return _frozen(at, JointTracking(at.model, at.w, **gains))


def joint_pid(at: Setting, *, k_x: float = 0.0) -> pa.Controller:
    """Return PID with gravity."""
    return joint_tracking(at, k_j=_JOINT_INTEGRAL, k_x=k_x)


def computed_torque(at: Setting, *, share: float = 1.0) -> pa.Controller:
    """Return resolved acceleration with both poles scaled by a share."""
    law = pa.laws.ResolvedAcceleration(at.nominal.task, _posture(at), **_poles(share * at.w))
    return _frozen(at, law)


def observed_torque(
    at: Setting, *, k_o: float, k_x: float, seen: bool | None = None, compensate: bool = False
) -> pa.Controller:
    """Return computed torque with observer and integral; on x_hat(q) if the camera is late."""
    task = at.nominal.task
    posture = _posture(at)
    seen = at.sensors.perfect if seen is None else seen
    rates = {"k_o": k_o * at.w, "k_x": k_x * at.w}
    law = ObservedTorque(task, posture, **_poles(at.w), nominal=at.model, seen=seen, **rates)
    return _frozen(at, law, compensate)


def compensated(at: Setting, **gains: float) -> pa.Controller:
    """Return the same on measured frames with the library's delay compensation."""
    return observed_torque(at, seen=True, compensate=True, **gains)


def unadapted(at: Setting) -> pa.Controller:
    """Return the default law with frozen estimates."""
    return at.controller(adaptation="none")


def adapted(at: Setting) -> pa.Controller:
    """Return the library's default."""
    return at.controller()


def _frozen(at: Setting, law: pa.laws.Law, compensate: bool = False) -> pa.Controller:
    return at.controller(law=law, adaptation="none", compensate_delay=compensate)


def _posture(at: Setting) -> pa.laws.Posture:
    return pa.laws.Posture(at.nominal, frequency=0.5 * at.w)


def _poles(w: float) -> dict[str, Any]:
    """Return the gains of resolved acceleration with the default's poles, -w and -3 w."""
    return {"K_v": 4.0 * w, "K_P": 3.0 * w * w, "alpha": w / 4.0}


DEFAULT = "pinadapt"
CONTENDERS = {
    "PD + gravity": Contender(joint_tracking),
    "PD + gravity, task integral": Contender(joint_tracking, {"k_x": _OUTER}),
    "PID + gravity": Contender(joint_pid),
    "PID + gravity, task integral": Contender(joint_pid, {"k_x": _OUTER}),
    "computed torque": Contender(computed_torque, {"share": (1.0, 0.7, 0.5, 0.35)}),
    "computed torque, observer, task integral": Contender(
        observed_torque, {"k_o": (1.0, 3.0), "k_x": _OUTER}
    ),
    "the same, frames compensated": Contender(
        compensated, {"k_o": (1.0, 3.0), "k_x": _OUTER}, ("camera",)
    ),
    "pinadapt, not adapted": Contender(unadapted),
    DEFAULT: Contender(adapted),
}
