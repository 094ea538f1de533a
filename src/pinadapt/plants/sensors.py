"""What the controller gets to see of a plant."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import instance, mapping, positive, vector, whole
from ..exceptions import InputError, did_you_mean
from ..records import Measurement
from ..robot.robot import Robot
from ..sensing import Camera
from ..tasks.task import FrameTask
from .camera import SimulatedCamera
from .encoder import Encoder

CHANNELS = ("q", "v", "x", "angle", "tau")


class Sensors:
    """Encoders, tachometers and torque sensors at the joints, and a camera of the task frame.

    A joint task has no frame to see: its measurements have neither x nor xd.

    Attributes:
        perfect: whether they show all there is as it is.
    """

    def __init__(
        self,
        robot: Robot,
        dt: float,
        *,
        noise: Mapping[str, ArrayLike] | None = None,
        delay: float = 0.0,
        camera: Camera | Mapping[str, float | None] | None = None,
        encoder: ArrayLike = 0.0,
        seed: int = 0,
    ) -> None:
        """Take what is wrong with the sensors; without any of it they are perfect.

        Args:
            robot: whose configurations and task are measured.
            dt: sampling period [s].
            noise: standard deviation of each channel, white: q [rad or m], before it is counted; v
                [rad/s or m/s] of joints without encoder; of every frame x [m], and angle [rad], by
                which a measured pose is turned about each world axis; tau, one or one a joint (nv)
                [N m or N]: then the torque of the last period is measured too, else it is not.
            delay: s, of a camera with a frame at every sample; short for ``camera={"delay": ...}``.
            camera: see ``Camera``.
            encoder: a count, one or one a joint (nv) [rad or m], zero for none; see ``Encoder``.
            seed: of the noise and of lost frames.

        Raises:
            InputError: unknown names, negative numbers, angles of a task that has none, two delays,
                or a camera or encoder that cannot be.
        """
        instance(robot, Robot, "robot")
        dt = positive(dt, "dt")
        self._noise = _deviations(noise)
        self._tau = vector((noise or {}).get("tau", 0.0), robot.model.nv, "noise.tau")
        if (self._tau < 0.0).any():
            raise InputError(f"must not be negative, got {self._tau.tolist()}.", where="noise.tau")
        if self._noise["angle"] and not _turns(robot):
            raise InputError(
                f"the task '{robot.task.name}' has no orientation to disturb.", where="noise.angle"
            )
        self._model, self._seed = robot.model, whole(seed, "seed", 0)
        self._noisy = bool(self._noise["q"] or self._noise["v"])
        place, angle, camera = self._noise["x"], self._noise["angle"], _camera(camera, delay)
        self._camera = SimulatedCamera(robot.task, camera, dt, place=place, angle=angle, seed=seed)
        self._encoder = Encoder(robot, encoder, dt)
        noisy = any(self._noise.values()) or self._tau.any() or self._encoder.present
        self.perfect = camera == Camera() and not noisy
        self.reset()

    def reset(self) -> None:
        """Forget what was measured, and begin the noise anew."""
        self._rng = np.random.default_rng(self._seed)
        self._of_torque = np.random.default_rng([self._seed, 2])
        self._camera.reset()
        self._encoder.reset()

    def measure(self, truth: Measurement, torque: np.ndarray | None = None) -> Measurement:
        """Return what the sensors make of the next sample, given what perfect ones would say.

        Args:
            truth: what they would say.
            torque: (nv) that the motors gave until now; None before the first period.
        """
        if torque is not None and self._tau.any():
            noise = self._tau * self._of_torque.standard_normal(self._tau.size)
            truth = truth._replace(tau=torque + noise)
        q, v = truth.q, truth.v
        if self._noisy:
            q = pin.integrate(self._model, q, self._white("q"))
            v = v + self._white("v")
        if self._encoder.present:
            q, v = self._encoder.read(q, v)
        return self._camera.see(truth)._replace(q=q, v=v)

    def _white(self, name: str) -> np.ndarray:
        return self._noise[name] * self._rng.standard_normal(self._model.nv)


def _deviations(noise: Mapping[str, ArrayLike] | None) -> dict[str, float]:
    """Return the standard deviation of every channel that has one number."""
    for name in mapping(noise, "noise"):
        if name not in CHANNELS:
            raise InputError(
                f"no channel is called '{name}'; there are {CHANNELS}."
                f"{did_you_mean(name, CHANNELS)}",
                where="noise",
            )
    return {
        name: positive((noise or {}).get(name, 0.0), f"noise.{name}", zero=True)
        for name in CHANNELS
        if name != "tau"
    }


def _turns(robot: Robot) -> bool:
    """Tell whether the task has an orientation."""
    return isinstance(robot.task, FrameTask) and robot.task.size > robot.task.positions


def _camera(camera: Camera | Mapping[str, float | None] | None, delay: float) -> Camera:
    """Return the camera, given as such or by its delay [s] alone."""
    late = Camera(delay=positive(delay, "delay", zero=True))
    if camera is None:
        return late
    if late.delay:
        raise InputError(
            "a camera has its delay in itself.",
            where="delay",
            hint="Take camera = { delay = ... } alone.",
        )
    return Camera.of(camera)
