"""Controllers stepped over the same recorded samples, here or in another process."""

from itertools import islice
from typing import Any

import numpy as np

import pinadapt as pa

Samples = list[tuple[pa.Measurement, pa.Desired]]


def record(
    true: pa.Robot, controller: pa.Controller, path: pa.trajectories.Trajectory, count: int = 20
) -> Samples:
    """Return what came into a controller in its first steps at 1 kHz."""
    stream = pa.run(pa.plants.PinocchioPlant(true), controller, path, duration=1e-3 * count)
    return [(sample.measurement, sample.desired) for sample in islice(stream, count)]


def replay(
    controller: pa.Controller, samples: Samples, **start: Any
) -> tuple[np.ndarray, pa.ControllerState]:
    """Return the torques (N, n) over the samples, and the last state; ``start`` is for ``init``."""
    state = controller.init(samples[0][0], **start)
    torques = []
    for measurement, desired in samples:
        torque, state = controller.step(state, measurement, desired, 1e-3)
        torques.append(torque)
    return np.array(torques), state
