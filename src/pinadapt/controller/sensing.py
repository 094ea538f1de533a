"""What a controller makes of a sample: plausibility, filtered velocity, position of now."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy import empty

from .._checks import shown
from .._kernels import samples as kernels
from ..description.chain import is_slide, velocity_limits
from ..exceptions import ImplausibleError, InputError, did_you_mean
from ..filters import LowPass
from ..models.delay_compensation import DelayCompensator, SensedState
from ..models.task_kinematics import TaskKinematics
from ..models.translations import FIRST
from ..records import Desired, Measurement, SensorQuality, Sensors
from ..robot.motors import Compensation
from ..robot.robot import Robot
from .first_samples import FirstSamples, make_first_samples

GUARDS = ("position", "velocity", "time", "rest", "limits", "differences", "gravity")
_FAR, _FAR_BASE = 2.0, 20.0  # of the reach: x from x_hat, with the base in its place and unknown
_FAST = 10.0  # of the description's velocity limits
_SLOW, _NEAR = 1e-3, 1e-4  # [1/s] and share, of a radian or the reach, of an arm that rests
_NOISE = 4.0  # standard deviations
_NOTHING, _NO_COLUMNS = np.zeros(0), np.zeros((0, 0))
_PERFECT = SensorQuality()
_MISSED = 1.5  # periods after which a sample was dropped
_LATEST = 10.0  # periods that one step may bridge


@dataclass(frozen=True, eq=False)
class Guards:
    """Bounds of plausible measurements; the defaults accept every position and time.

    Attributes:
        fast: (n) largest joint velocities [rad/s or m/s].
        far: largest distance of the measured position from the estimated last joint [m].
        clock: whether times must go forward, and the period is the time since the last sample
            where one was dropped.
        slow: joint velocities below which an arm may be resting [rad/s or m/s]; zero: it never is.
        near: of the errors as well [m or rad].
        first: what the first samples are held against; None: nothing.
    """

    fast: np.ndarray
    far: float = math.inf
    clock: bool = False
    slow: float = 0.0
    near: float = 0.0
    first: FirstSamples | None = None

    def without_torque(self) -> Guards:
        """Return the guards where no torque is sent: gravity is not judged."""
        first = None if self.first is None else replace(self.first, gravity=None)
        return replace(self, first=first)

    def implausible(
        self,
        found: int,
        v: np.ndarray,
        x: np.ndarray,
        kinematics: TaskKinematics,
        first: np.ndarray | None = None,
    ) -> ImplausibleError:
        """Return the error for what the kernel ``check_sample`` found.

        Args:
            found: the kernel's answer.
            v: (n) joint velocity [rad/s or m/s].
            x: measured coordinates.
            kinematics: updated to the sample.
            first: what the first samples have told, if they have not told all.
        """
        if found == kernels.FAR:
            distance = np.linalg.norm(x[: kinematics.positions] - kinematics.last_joint)
            return ImplausibleError(
                "x",
                x,
                f"is implausible: {distance:.3g} m from the estimated position of the last joint, "
                f"more than {self.far:.3g} m",
                "in millimetres? in another frame?",
                "Give x in metres, in the axes and from the origin of the robot's base.",
            )
        joint = found - kernels.FAST
        known = self.first
        ratio = known.ratio(first, joint) if known is not None and first is not None else ""
        return ImplausibleError(
            "v",
            v,
            f"is implausible: {kinematics.joint_names[joint]} at {v[joint]:.3g} rad/s or m/s, over "
            f"{_FAST:g} times the limit of its description",
            f"in degrees?{ratio}",
        )

    def elapsed(self, before: float, now: float, dt: float, period: float) -> float:
        """Return the time [s] that a sample at time ``now`` stands for.

        dt, or the time since the sample before where others were dropped in between.

        Raises:
            ImplausibleError: the time goes back.
            InputError: the period is not positive, or over ten times the one that the controller
                was made for.
        """
        try:
            fits = 0.0 < dt <= _LATEST * period
        except (TypeError, ValueError):
            fits = False
        if not fits:
            raise _unfit(dt, period)
        if not self.clock:
            return dt
        elapsed = now - before
        if elapsed < 0.0:
            raise ImplausibleError("t", now, f"is before the last sample's, {before:g} s")
        if elapsed <= _MISSED * dt:
            return dt
        if elapsed > _LATEST * period:
            raise _unfit(elapsed, period)
        return elapsed


def _unfit(dt: Any, period: float) -> InputError:
    """Return the error of a dt [s] that does not fit the period that the controller is made for."""
    made = f" and at most {_LATEST * period:g} s, ten periods of the controller"
    return InputError(
        f"must be positive{made if math.isfinite(period) else ''}, got {dt!r}.",
        where="dt",
        hint="After a longer pause start anew with `init`, from the last estimates.",
    )


@dataclass(frozen=True, eq=False)
class Senses:
    """From a measurement to joint velocity and task position of now.

    Attributes:
        guards: what is refused as implausible, and when the arm rests.
        compensator: predicts the present position from late frames of a camera.
        low_pass: on the measured joint velocity, or None.
        quality: of the sensors for which all this is made.
        sensors: for which all this is made.
    """

    guards: Guards
    compensator: DelayCompensator = field(default_factory=DelayCompensator)
    low_pass: LowPass | None = None
    quality: SensorQuality = _PERFECT
    sensors: Sensors = field(default_factory=Sensors)

    def init(
        self, measurement: Measurement, kinematics: TaskKinematics, a_k: np.ndarray
    ) -> SensedState:
        """Return what is kept of the first sample, with the kinematic estimate a_k (p) [m].

        Raises:
            ImplausibleError: this robot cannot be there; see ``FirstSamples``.
        """
        _, q, v, x, *_ = measurement
        first = None
        if self.guards.first is not None:
            kinematics.update(a_k, q, v)
            first = self.guards.first.init(q, v, x, kinematics)
        if not kinematics.positions:  # a joint task
            x = kinematics.task.measured(None, q)
        return SensedState(q.copy(), v.copy(), None if x is None else x.copy(), first=first)

    def read(
        self,
        before: SensedState,
        t_before: float,
        measurement: Measurement,
        desired: Desired,
        kinematics: TaskKinematics,
        a_k: np.ndarray,
        position_error: bool = True,
        stepping: bool = False,
    ) -> tuple[SensedState, bool]:
        """Return what is known at a sample, and whether joints and reference are at rest.

        The kinematics are updated to the sample. Nothing returned shares memory with it.

        Args:
            before: what was known at the sample before.
            t_before: time of that sample [s].
            measurement: the sample.
            desired: the desired motion.
            kinematics: the estimated kinematics.
            a_k: (p_k) their estimate [m].
            position_error: whether the prediction error of the position is used.
            stepping: whether the sample follows that one; otherwise it is only looked at.

        Raises:
            ImplausibleError: a joint is faster or the position farther than the guards allow, the
                last frame of the camera is too old, or what the first samples tell is impossible.
            MeasurementError: a frame was taken later than the sample.
        """
        t, q, v, x, x_time, _, _, _, _ = measurement
        q, v = q.copy(), v.copy()
        if self.low_pass is not None:
            v = self.low_pass.advance(before.v, v, t - t_before)
        first = before.first
        if first is not None and stepping:
            first = self._first(before.q, first, measurement, t - t_before)
        kinematics.update(a_k, q, v)
        guards, seen = self.guards, _NOTHING if x is None else x
        found = kernels.check_sample(
            v, guards.fast, guards.slow, seen, kinematics.last_joint, guards.far
        )
        if found >= kernels.FAR:
            raise guards.implausible(found, v, seen, kinematics, first)
        still = found == kernels.STILL and not (desired.xd_d.any() or desired.xdd_d.any())
        if not kinematics.positions:  # a joint task
            return SensedState(
                q, v, kinematics.x_hat, kinematics.p_hat, kinematics.X_k, None, (), first
            ), still
        late = x_time is not None and x_time != t
        if x is None or late or self.compensator.smoothing < math.inf:
            sensed = self.compensator.update(before, t_before, t, q, v, x, x_time, kinematics)
            return sensed if first is None else sensed._replace(first=first), still
        if not position_error:
            return SensedState(q, v, x.copy(), _NOTHING, _NO_COLUMNS, None, (), first), still
        epsilon = kinematics.p_hat - x[: kinematics.positions]
        return SensedState(q, v, x.copy(), epsilon, kinematics.X_k, None, (), first), still

    def _first(
        self, q_before: np.ndarray, first: np.ndarray, measurement: Measurement, elapsed: float
    ) -> np.ndarray | None:
        """Return what the first samples have told with one more, None once that is all.

        Args:
            q_before: (nq) at the sample before.
            first: what they have told by then.
            measurement: the sample.
            elapsed: time between the two [s].

        Raises:
            ImplausibleError: it is impossible.
        """
        known, after = self.guards.first, empty(first.size)
        assert known is not None  # else nothing would be remembered
        found = kernels.first_samples(
            measurement.q, q_before, measurement.v, elapsed,
            known.bounds, known.places, known.longest, known.half, first, after,
        )  # fmt: skip
        if measurement.tau is not None:
            known.hear(after, measurement.tau, elapsed)
        if found == kernels.NOTHING:
            return after
        return known.judge(found, after, measurement.q, measurement.v)


def make_guards(
    robot: Robot,
    kinematics: TaskKinematics,
    guards: Mapping[str, bool] | bool,
    quality: SensorQuality,
    *,
    unloaded: Robot,
    box: np.ndarray | None,
    sensors: Sensors,
    compensation: Compensation | None,
    dt: float,
) -> Guards:
    """Return the guards of a controller for a robot.

    Args:
        robot: the nominal robot.
        kinematics: its kinematics.
        guards: False for none, or some of ``GUARDS`` with False.
        quality: of the sensors, whose noise an arm that rests still shows.
        unloaded: the robot without the load announced at first.
        box: (2, p) in which the kinematic estimates stay [m], or None where there are none.
        sensors: of the robot.
        compensation: what the arm is said to add to the torques sent, or None.
        dt: sampling period [s].

    Raises:
        InputError: an unknown guard.
    """
    if not isinstance(guards, bool | Mapping):
        raise InputError(f"expected True, False or a mapping, got {shown(guards)}.", where="guards")
    on = dict.fromkeys(GUARDS, guards is not False)
    for name, wanted in (guards if isinstance(guards, Mapping) else {}).items():
        if name not in GUARDS or not isinstance(wanted, bool):
            raise InputError(
                f"expected some of {list(GUARDS)} with true or false, got {name!r} = {wanted!r}."
                f"{did_you_mean(str(name), GUARDS)}",
                where="guards",
            )
        on[name] = wanted
    size = robot.reach
    based = not kinematics.anchored or any(p.joint == FIRST for p in kinematics.translations)
    scale = size if kinematics.positions else 1.0
    slides = any(is_slide(joint) for joint in robot.model.joints[1:])
    return Guards(
        far=(_FAR_BASE if based else _FAR) * size
        if on["position"] and kinematics.positions
        else math.inf,
        fast=_FAST * velocity_limits(robot.model)
        if on["velocity"]
        else np.full(robot.model.nv, np.inf),
        clock=on["time"],
        slow=_SLOW * (min(1.0, size) if slides else 1.0) + _NOISE * quality.v
        if on["rest"]
        else 0.0,
        near=_NEAR * scale + _NOISE * quality.x,
        first=make_first_samples(
            robot,
            unloaded=unloaded,
            on=on,
            box=np.zeros((2, 0)) if box is None else box,
            sensors=sensors,
            compensation=compensation,
            dt=dt,
        )
        if any(on[name] for name in ("position", "limits", "differences", "gravity"))
        else None,
    )
