"""Records that flow between robot, motion and controller, and the sensors that fill them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ._checks import (
    flag,
    instance,
    kept_numbers,
    mapping,
    positive,
    take_checked,
    vector,
    word,
)
from .exceptions import InputError

CHANNELS = ("q", "v", "x", "angle", "tau")


class Measurement(NamedTuple):
    """The measured signals of one sample.

    q, v, a and tau belong to the instant t; x, and xd with it, to ``x_time``, which is earlier
    where a camera is late.

    Attributes:
        t: time [s], on the clock that all measurements share.
        q: (nq) configuration, as ``pin.integrate`` has it.
        v: (nv) joint velocity [rad/s or m/s].
        x: task coordinates in world axes, from a camera or tracker, not from the model: (m) [m], or
            for a pose position [m] and unit quaternion xyzw (7), of either sign. None where there
            is none at this sample. A joint task ignores it, of whatever size: there x is q.
        x_time: time of x [s]; None: t.
        xd: (m) task velocity [m/s], a pose's first three rows alone being read; needed only by
            laws that state it.
        a: (nv) joint acceleration [rad/s^2 or m/s^2]; filtered from v when absent.
        tau: (nv) torque that the motors gave until now [N m or N], with what the arm adds by
            itself; read by the adaptations that predict the torque, which else take it to be what
            was commanded.
        w: (nv) velocity of the motors after their gears [rad/s or m/s], where v is that of the
            links; read by ``FastFeedback`` alone.
    """

    t: float
    q: np.ndarray
    v: np.ndarray
    x: np.ndarray | None = None
    x_time: float | None = None
    xd: np.ndarray | None = None
    a: np.ndarray | None = None
    tau: np.ndarray | None = None
    w: np.ndarray | None = None


class Feet(NamedTuple):
    """Which of a robot's c point contacts stand, and how the others move, at one instant.

    Attributes:
        stands: (c) bools.
        x_d: (c, 3) desired positions of the contacts' frames in world axes [m]; read of those that
            do not stand, as are the derivatives.
        xd_d: (c, 3) velocities [m/s].
        xdd_d: (c, 3) accelerations [m/s^2].
    """

    stands: np.ndarray
    x_d: np.ndarray
    xd_d: np.ndarray
    xdd_d: np.ndarray

    @property
    def table(self) -> np.ndarray:
        """Everything as numbers (10 c), contact by contact."""
        return np.column_stack(self).ravel()

    @classmethod
    def of_table(cls, table: np.ndarray) -> Feet:
        """Return the feet of a ``table``."""
        rows = table.reshape(-1, 10)
        return cls(rows[:, 0] > 0.0, *np.hsplit(rows[:, 1:], 3))


class Desired(NamedTuple):
    """The desired task motion at one instant, in world axes.

    Attributes:
        x_d: (m) position [m], or for a pose position [m] and unit quaternion xyzw (7).
        xd_d: (m) velocity [m/s], linear before angular [rad/s].
        xdd_d: (m) acceleration [m/s^2], linear before angular [rad/s^2].
    """

    x_d: np.ndarray
    xd_d: np.ndarray
    xdd_d: np.ndarray

    @property
    def feet(self) -> Feet | None:
        """How the contacts move, see ``DesiredSteps``; None: all stand."""
        return None

    def at_rate(self, rate: float, acceleration: float) -> Desired:
        """Return the motion at another time law s(t), by the chain rule.

        Args:
            rate: ds/dt.
            acceleration: d^2s/dt^2 [1/s].
        """
        if rate == 1.0 and acceleration == 0.0:
            return self
        x_d, xd_d, xdd_d = self
        return Desired(x_d, rate * xd_d, rate * rate * xdd_d + acceleration * xd_d)


class DesiredSteps(Desired):
    """The desired motion of a robot whose contacts change."""

    _feet: Feet

    @classmethod
    def of(cls, desired: Desired, feet: Feet) -> DesiredSteps:
        """Return a desired motion of the task with that of the feet."""
        made = cls(*desired)
        made._feet = feet
        return made

    @property
    def feet(self) -> Feet:
        """How the contacts move."""
        return self._feet

    def at_rate(self, rate: float, acceleration: float) -> Desired:
        """Return both motions at another time law, see ``Desired``."""
        stands, *moved = self.feet
        feet = Feet(stands, *Desired(*moved).at_rate(rate, acceleration))
        return DesiredSteps.of(super().at_rate(rate, acceleration), feet)


@dataclass(frozen=True)
class Camera:
    """A camera or tracker that sees the task frame.

    Frames are taken at the multiples of 1 / rate and arrive ``delay`` later, or never.

    Attributes:
        rate: frames a second; None, or more than samples a second: one at every sample.
        delay: from the exposure of a frame to its arrival [s].
        dropout: share of the frames that never arrive, in [0, 1).

    Raises:
        InputError: a rate that is not positive, a delay that is negative or over 100 s, or a
            dropout outside [0, 1).
    """

    rate: float | None = None
    delay: float = 0.0
    dropout: float = 0.0

    def __post_init__(self) -> None:
        """Refuse numbers that no camera has."""
        if self.rate is not None:
            take_checked(self, positive, "camera.", "rate")
        take_checked(self, positive, "camera.", "delay", "dropout", zero=True)
        if self.delay > 100.0:
            raise InputError(
                f"must be at most 100 s, got {self.delay:g}.",
                where="camera.delay",
                hint="It is in seconds: 30 ms are 0.03.",
            )
        if self.dropout >= 1.0:
            raise InputError(
                f"must be a share of the frames, below 1, got {self.dropout:g}.",
                where="camera.dropout",
            )


@dataclass(frozen=True)
class Imu:
    """An inertial measurement unit on the base of a robot that stands: pitch and roll, with rates.

    Position and yaw of the base are then those of the legs, see ``robot.BaseFromLegs``.

    Attributes:
        tilt: by which pitch and roll are off, for good [rad].
        noise: standard deviation of white noise on both [rad].
        rate_noise: of their rates [rad/s].

    Raises:
        InputError: a negative number.
    """

    tilt: float = 0.0
    noise: float = 0.0
    rate_noise: float = 0.0

    def __post_init__(self) -> None:
        """Refuse numbers that no sensor has."""
        take_checked(self, positive, "imu.", "tilt", "noise", "rate_noise", zero=True)


@dataclass(frozen=True)
class Sensors:
    """The sensors of a robot; perfect by default.

    One object serves ``make_controller``, which chooses filters and rates for these sensors, and
    ``simulate``, which simulates them.

    Attributes:
        camera: that gives x; None: x is measured at every sample, at once.
        encoder: resolution of the joint encoders [rad or m a count], one number or one per joint
            (n); q is rounded to it and v is the difference of q over a period. Zero: q and v are
            measured directly.
        noise: standard deviations of white noise by channel: ``q`` [rad or m], before it is
            counted; ``v`` [rad/s or m/s] of joints without encoder; ``x`` [m] of each frame;
            ``angle`` [rad], by which a measured pose is turned about each world axis; ``tau``
            [N m or N], one number or one per joint (n): with it the torque of the last period is
            measured too.
        compensate_delay: whether the controller predicts late frames to the present with its model;
            otherwise it takes each frame for the present one.
        torque_offset: largest constant error of the torque sensors [N m or N], one number or one
            per joint (n). A controller predicts the torque that they measure only where both this
            and ``noise.tau`` are given; else the torque that was commanded, as an unknown offset
            would be learned as a mass, and tracked.

        imu: of a robot with a free base, which together with its legs takes the place of whatever
            else measures the base and x; None: there is something else.

    Raises:
        InputError: an unknown name, a negative number, or an impossible camera.
    """

    camera: Camera | None = None
    encoder: ArrayLike = 0.0
    noise: Mapping[str, ArrayLike] = field(default_factory=dict, hash=False)
    compensate_delay: bool = True
    torque_offset: ArrayLike | None = None
    imu: Imu | None = None

    def __post_init__(self) -> None:
        """Check and keep the sensors.

        Raises:
            InputError: as the class.
        """
        instance(self.camera, Camera | None, "sensors.camera")
        instance(self.imu, Imu | None, "sensors.imu")
        flag(self.compensate_delay, "sensors.compensate_delay")
        noise = {}
        for name, deviation in mapping(self.noise, "sensors.noise").items():
            where = f"sensors.noise.{word(name, CHANNELS, 'sensors.noise')}"
            checked = kept_numbers(deviation, where)
            noise[name] = checked if name == "tau" else positive(checked, where, zero=True)
        object.__setattr__(self, "noise", noise)
        take_checked(self, kept_numbers, "sensors.", "encoder")
        if self.torque_offset is None:
            return
        take_checked(self, kept_numbers, "sensors.", "torque_offset")
        if "tau" not in noise:
            raise InputError(
                "a torque sensor has noise too.",
                where="sensors.noise.tau",
                hint="Give its standard deviation beside the offset.",
            )

    @property
    def perfect(self) -> bool:
        """Whether q, v and x alone are measured, at every sample, at once and without error."""
        noisy = any(np.any(each) for each in (self.encoder, *self.noise.values()))
        beside = self.imu, self.torque_offset
        return self.camera in (None, Camera()) and not noisy and beside == (None, None)

    def quality(self, nv: int, dt: float) -> SensorQuality:
        """Return the sizes on which filters and rates depend.

        An encoder of resolution c whose counts are differenced over dt has velocity noise of
        standard deviation c / (sqrt(6) dt): the rounding errors of two counts.

        Args:
            nv: number of joints.
            dt: sampling period [s].

        Raises:
            InputError: an encoder resolution for another number of joints.
        """
        count = vector(self.encoder, nv, "sensors.encoder").max(initial=0.0)
        differenced = float(count) / (dt * math.sqrt(6.0))
        camera = self.camera or Camera()
        rate = min(camera.rate or math.inf, 1.0 / dt)
        age = 0.0 if self.camera is None else camera.delay + 1.0 / rate
        tau = 0.0
        if self.torque_offset is not None:
            offset = vector(self.torque_offset, nv, "sensors.torque_offset")
            noise = vector(self.noise["tau"], nv, "sensors.noise.tau")
            tau = float(np.hypot(offset, noise).max())
        v = math.hypot(self.deviation("v"), differenced)
        return SensorQuality(v, self.deviation("x"), rate, age, tau)

    def deviation(self, channel: str) -> float:
        """Return the standard deviation of a channel that has one number: all but ``tau``."""
        return self.noise.get(channel, 0.0)  # type: ignore[return-value]


@dataclass(frozen=True)
class SensorQuality:
    """The sizes of noise and delay on which filters and rates depend; perfect by default.

    Attributes:
        v: standard deviation of the joint velocity [rad/s or m/s].
        x: of a measured position [m].
        rate: frames of the camera [1/s].
        age: largest age of the latest frame [s]; zero if every sample has a frame of its own.
        tau: by which a declared torque sensor is off, offset and noise together [N m or N].
    """

    v: float = 0.0
    x: float = 0.0
    rate: float = 0.0
    age: float = 0.0
    tau: float = 0.0
