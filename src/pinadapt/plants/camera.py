"""A camera in simulation: frames that are rare, late, noisy, or lost."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ..records import Measurement
from ..sensing import Camera
from ..tasks.task import Task


class SimulatedCamera:
    """Shows the task coordinates as a camera does, sample by sample.

    The arm stood still before the first sample: frames of that time show what the first one does
    and carry its time, and one of them is there at the first sample, whatever gets lost later. The
    noise is of frames, not of samples.

    A camera with a rate gives no velocity. Without one it is a tracker, which tells the task
    velocity with every position, without noise.
    """

    def __init__(
        self, task: Task, camera: Camera, dt: float, *, place: float, angle: float, seed: int
    ) -> None:
        """Take the standard deviations of place [m] and angle [rad], dt [s] and the noise's seed.

        The times at which frames are taken, and their delay, are rounded to whole periods.
        """
        self._task, self._camera, self._seed = task, camera, seed
        self._spacing = 1.0 if camera.rate is None else max(1.0, 1.0 / (camera.rate * dt))
        self._late = round(camera.delay / dt)
        angles = [angle] * (task.size - task.positions)
        self._deviations = np.array([place] * task.positions + angles)
        self._noisy = bool(self._deviations.any())
        self.reset()

    def reset(self) -> None:
        """Forget the frames, and begin noise and losses anew."""
        self._rng = np.random.default_rng([self._seed, 1])
        self._sample = 0
        self._under_way: deque[Measurement] = deque()

    def see(self, truth: Measurement) -> Measurement:
        """Return the next sample with x, x_time and xd of a frame that arrives now, or None."""
        k, self._sample = self._sample, self._sample + 1
        frames, late = self._under_way, self._late
        if k == 0:
            frames.extend(truth for i in range(-late, 0) if self._takes(i))
        if self._takes(k):
            frames.append(truth)
        frame = frames.popleft() if self._takes(k - late) else None
        if k == 0:
            frame = truth
        elif frame is not None and self._rng.random() < self._camera.dropout:
            frame = None
        if frame is None or frame.x is None or not self._task.positions:
            return truth._replace(x=None, x_time=None, xd=None)
        xd = frame.xd if self._camera.rate is None else None
        seen_at = frame.t if frame.x_time is None else frame.x_time
        return truth._replace(x=self._disturbed(frame.x), x_time=seen_at, xd=xd)

    def _takes(self, sample: int) -> bool:
        """Tell whether a frame is taken at a sample, before the first of which they are negative.

        That is, whether it is a multiple of the spacing, rounded.
        """
        nearest = math.floor(sample / self._spacing + 0.5) * self._spacing
        return math.floor(nearest + 0.5) == sample

    def _disturbed(self, x: np.ndarray) -> np.ndarray:
        if not self._noisy:
            return x
        return self._task.moved(x, self._deviations * self._rng.standard_normal(self._task.size))
