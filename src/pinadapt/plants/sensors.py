"""Simulated sensors: a camera of the task frame, joint encoders, noise."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pinocchio as pin

from .._checks import instance, positive, vector, whole
from ..description.chain import angles_from_configuration, configuration_from_angles
from ..exceptions import InputError
from ..records import Camera, Measurement, Sensors
from ..robot.base_from_legs import BaseFromLegs
from ..robot.robot import Robot
from ..tasks.task import Moving


class SimulatedSensors:
    """Encoders, velocity and torque sensors at the joints, and a camera of the task frame.

    An encoder measures q in whole counts, and v as their difference over one period; it is zero at
    the first sample, as the arm is at rest. For continuous joints the angle in (-pi, pi] is
    rounded, and the difference is the shorter rotation. Joints with a count of zero have no
    encoder.

    A camera has a frame rate, a delay and lost frames; the times of frames and the delay are
    rounded to whole periods. The arm is assumed at rest before the first sample: frames from before
    have the content and the time of the first one, and the first sample always has a frame. Noise
    is added per frame, not per sample. A camera with a rate does not measure the velocity. Without
    a rate it is a tracker, which measures position and velocity at every sample, the velocity
    without noise.

    For a joint task there is no camera: measurements have neither x nor xd. The velocity w of the
    motors of elastic joints has the noise and the resolution of v.

    Attributes:
        sensors: what is simulated.
        task: of the coordinates that they measure.
    """

    def __init__(self, robot: Robot, dt: float, sensors: Sensors, *, seed: int = 0) -> None:
        """Simulate sensors.

        Args:
            robot: the robot whose configuration and task coordinates are measured.
            dt: sampling period [s].
            sensors: what is simulated.
            seed: of the noise and of the lost frames.

        Raises:
            InputError: an encoder or a torque noise of a wrong size, or angle noise for a task
                without orientation.
        """
        instance(robot, Robot, "robot")
        self.sensors = instance(sensors, Sensors, "sensors")
        dt = positive(dt, "dt")
        n = robot.model.nv
        self._tau = vector(sensors.noise.get("tau", 0.0), n, "noise.tau")
        self._offset = vector(sensors.torque_offset or 0.0, n, "torque_offset")
        self.task = robot.task
        self._model = robot.model
        self._seed = whole(seed, "seed", 0)
        angle = sensors.deviation("angle")
        if angle and not 0 < self.task.positions < self.task.size:
            raise InputError(
                f"the task '{self.task.name}' has no orientation; it takes no angle noise.",
                where="noise.angle",
            )
        self._deviations = self.task.per_row(sensors.deviation("x"), angle)
        counts = vector(sensors.encoder, n, "encoder", names=robot.joint_names)
        self._counted = counts > 0.0
        self._count = np.where(self._counted, counts, 1.0)
        self._dt = dt
        self._camera = sensors.camera or Camera()
        self._spacing = max(1.0, 1.0 / ((self._camera.rate or math.inf) * dt))
        self._late = round(self._camera.delay / dt)
        self._robot = robot
        self.reset()

    def reset(self) -> None:
        """Discard all measurements; restart the random numbers."""
        rngs = [np.random.default_rng([self._seed, k]) for k in range(5)]
        self._rng, self._of_frames, self._of_torque, of_offset, self._of_imu = rngs
        self._off = self._offset * of_offset.uniform(-1.0, 1.0)
        self._sample = 0
        self._truths = deque[Measurement](maxlen=self._late + 1)
        self._last: np.ndarray | None = None
        if self.sensors.imu is not None:
            way = self._of_imu.standard_normal(2)
            self._tilt = self.sensors.imu.tilt * way / np.linalg.norm(way)
            self._base = BaseFromLegs(self._robot)

    def measure(self, truth: Measurement, torque: np.ndarray | None = None) -> Measurement:
        """Return the next measurement.

        Args:
            truth: what ideal sensors measure.
            torque: (nv) torque that the motors applied in the last period [N m or N]; None before
                the first period.
        """
        if torque is not None and "tau" in self.sensors.noise:
            noise = self._tau * self._of_torque.standard_normal(self._tau.size)
            truth = truth._replace(tau=torque + self._off + noise)
        q = truth.q
        v = truth.v
        w = truth.w
        if self.sensors.deviation("q") or self.sensors.deviation("v"):
            q = pin.integrate(self._model, q, self._white("q"))
            v = v + self._white("v")
            w = None if w is None else w + self._white("v")
        if self._counted.any():
            q, v = self._read(q, v)
            step = self._count / self._dt
            w = None if w is None else np.where(self._counted, np.rint(w / step) * step, w)
        seen = self._seen(truth)._replace(q=q, v=v, w=w)
        return seen if self.sensors.imu is None else self._from_legs(seen, truth)

    def _from_legs(self, seen: Measurement, truth: Measurement) -> Measurement:
        """Return a measurement with the base, and x, by the IMU and the legs."""
        imu = self.sensors.imu
        noise = self._of_imu.standard_normal((2, 2))
        assert imu is not None
        tilt = truth.q[4:6] + self._tilt + imu.noise * noise[0]
        q, v = self._base(seen.q, seen.v, tilt, truth.v[4:6] + imu.rate_noise * noise[1])
        return seen._replace(q=q, v=v, x=self._robot.position(q), x_time=None, xd=None)

    def _read(self, q: np.ndarray, v: np.ndarray) -> Moving:
        """Return q (nq) and v (nv) of the next sample as measured by the encoders."""
        angles = angles_from_configuration(self._model, q)
        counted = np.where(self._counted, np.rint(angles / self._count) * self._count, angles)
        read = configuration_from_angles(self._model, counted)
        last = read if self._last is None else self._last
        self._last = read
        step = pin.difference(self._model, last, read)
        return read, np.where(self._counted, step / self._dt, v)

    def _white(self, name: str) -> np.ndarray:
        return self.sensors.deviation(name) * self._rng.standard_normal(self._model.nv)

    def _seen(self, truth: Measurement) -> Measurement:
        """Return the next sample with x, x_time, xd of the frame that arrives, or None for them."""
        k = self._sample
        self._sample += 1
        if k == 0:
            self._truths.extend([truth] * self._late)
        self._truths.append(truth)
        frame = self._truths[0]
        exposed = k - self._late  # a negative sample is before the first
        nearest = math.floor(exposed / self._spacing + 0.5) * self._spacing
        taken = math.floor(nearest + 0.5) == exposed  # at multiples of the frame interval, rounded
        comes = k == 0 or (taken and self._of_frames.random() >= self._camera.dropout)
        if not comes or frame.x is None or not self.task.positions:
            return truth._replace(x=None, x_time=None, xd=None)
        x = frame.x
        xd = frame.xd if self._camera.rate is None else None
        if self._deviations.any():
            noise = self._deviations * self._of_frames.standard_normal(self.task.size)
            x = self.task.moved(x, noise)
        return truth._replace(x=x, x_time=frame.t, xd=xd)
