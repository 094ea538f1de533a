"""What a controller does not believe of its sensors, and when there is nothing to learn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .._kernels import guards as kernels
from ..exceptions import ImplausibleError, InputError, did_you_mean
from ..models.task_kinematics import TaskKinematics
from ..models.translations import FIRST
from ..robot.chain import is_slide
from ..robot.robot import Robot
from ..robot.velocity_limits import velocity_limits
from ..robot.workspace import reach

GUARDS = ("position", "velocity", "time", "rest")
_FAR, _FAR_BASE = 2.0, 20.0  # of the reach: x from x_hat, with the base in its place and unknown
_FAST = 10.0  # of the description's velocity limits
_SLOW, _NEAR = 1e-3, 1e-4  # [1/s] and share, of a radian or the reach, of an arm that rests
_NOISE = 4.0  # standard deviations
_MISSED = 1.5  # periods after which a sample was dropped


@dataclass(frozen=True, eq=False)
class Guards:
    """Bounds of what is plausible; the defaults believe everything.

    Attributes:
        far: how far the measured position may be from the believed one [m].
        fast: (n) largest joint velocities [rad/s or m/s], or None.
        clock: whether times must go forward, and the period is the time since the last sample
            where one was dropped.
        slow: joint velocities below which an arm may be resting [rad/s or m/s]; zero: it never is.
        near: of the errors as well [m or rad].
    """

    far: float = math.inf
    fast: np.ndarray | None = None
    clock: bool = False
    slow: float = 0.0
    near: float = 0.0

    def check_velocity(self, v: np.ndarray) -> None:
        """Refuse a joint velocity (n) [rad/s or m/s] far beyond what the joints can.

        Raises:
            ImplausibleError: it is.
        """
        if self.fast is not None and (i := kernels.first_beyond(v, self.fast)) >= 0:
            raise ImplausibleError(
                "v",
                v,
                f"is implausible: joint {i + 1} moves at {v[i]:.3g} rad/s or m/s, over "
                f"{_FAST:g} times the limit of its description (in degrees?)",
            )

    def check_position(self, x: np.ndarray, kinematics: TaskKinematics) -> None:
        """Refuse a position x that is far from where the frame is believed to be.

        Raises:
            ImplausibleError: it is.
        """
        if self.far == math.inf:
            return
        distance = kernels.distance(x, kinematics.x_hat, kinematics.positions)
        if distance > self.far:
            raise ImplausibleError(
                "x",
                x,
                f"is implausible: {distance:.3g} m from where the frame is believed to be, "
                f"more than {self.far:.3g} m (in millimetres? in another frame?)",
            )

    def elapsed(self, before: float, now: float, dt: float) -> float:
        """Return the period [s] that a sample at time ``now`` stands for.

        dt, or the time since the sample before where others were dropped in between.

        Raises:
            ImplausibleError: the time goes back.
        """
        if not self.clock:
            return dt
        elapsed = now - before
        if elapsed < 0.0:
            raise ImplausibleError("t", now, f"is before the last sample's, {before:g} s")
        return elapsed if elapsed > _MISSED * dt else dt

    def rests(self, xd_d: np.ndarray, xdd_d: np.ndarray, v: np.ndarray, dx: np.ndarray) -> bool:
        """Tell whether the arm stands where it should, so that an estimate could only drift."""
        return self.slow > 0.0 and kernels.rests(xd_d, xdd_d, v, dx, self.slow, self.near)


def make_guards(
    believed: Robot,
    kinematics: TaskKinematics,
    guards: Mapping[str, bool] | bool,
    *,
    noise_v: float = 0.0,
    noise_x: float = 0.0,
) -> Guards:
    """Return the guards of a controller for a believed robot.

    Args:
        believed: the believed robot.
        kinematics: its kinematics.
        guards: False for none, or some of "position", "velocity", "time" and "rest" with False.
        noise_v: standard deviation of the joint velocity [rad/s or m/s].
        noise_x: of the position [m].

    Raises:
        InputError: an unknown guard.
    """
    on = dict.fromkeys(GUARDS, guards is not False)
    for name, wanted in (guards if isinstance(guards, Mapping) else {}).items():
        if name not in GUARDS or not isinstance(wanted, bool):
            raise InputError(
                f"expected some of {list(GUARDS)} with true or false, got {name!r} = {wanted!r}."
                f"{did_you_mean(str(name), GUARDS)}",
                where="guards",
            )
        on[name] = wanted
    size = reach(believed)
    based = any(part.joint == FIRST for part in kinematics.translations)
    scale = size if kinematics.positions else 1.0
    slides = any(is_slide(joint) for joint in believed.model.joints[1:])
    return Guards(
        far=(_FAR_BASE if based else _FAR) * size
        if on["position"] and kinematics.positions
        else math.inf,
        fast=_FAST * velocity_limits(believed.model) if on["velocity"] else None,
        clock=on["time"],
        slow=_SLOW * (min(1.0, size) if slides else 1.0) + _NOISE * noise_v if on["rest"] else 0.0,
        near=_NEAR * scale + _NOISE * noise_x,
    )
