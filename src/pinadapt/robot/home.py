"""A starting configuration away from singularities, when nobody gives one."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from ..exceptions import RobotError
from .chain import configuration_from_angles

_WELL_CONDITIONED = 0.1  # smallest over largest singular value of the task Jacobian
_DEGENERATE = 1e-6
_SAMPLES = 500


def position_bounds(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper joint bounds (nv) [rad or m]; an absent limit becomes half a turn or one metre.

    URDFs say "no limit" with 0, 1.8e308 or infinity: any empty or wider-than-a-turn range counts as absent.
    """
    lower, upper = np.full(model.nv, -np.pi), np.full(model.nv, np.pi)
    for joint in model.joints[1:]:
        i = joint.idx_v
        if joint.shortname().startswith("JointModelP"):
            lower[i], upper[i] = -1.0, 1.0
        if joint.nq == 1:
            low, high = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
            if low < high and high - low <= 4 * np.pi:
                lower[i], upper[i] = low, high
    return lower, upper


def conditioning(model: pin.Model, data: pin.Data, frame: int, rows: slice, q: np.ndarray) -> tuple[float, float]:
    """Return smallest singular value of the task Jacobian, and its ratio to the largest, at q (nq)."""
    J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[rows]
    singular = np.linalg.svd(J, compute_uv=False)
    return float(singular[-1]), float(singular[-1] / max(singular[0], np.finfo(float).tiny))


def find_home(model: pin.Model, frame: int, rows: slice, candidates: Iterable[np.ndarray]) -> np.ndarray:
    """Return the first well-conditioned candidate (nq), else the best of many seeded samples inside the limits.

    Raises:
        RobotError: the task Jacobian is degenerate in all of them.
    """
    data = model.createData()
    for q in candidates:
        if conditioning(model, data, frame, rows, q)[1] >= _WELL_CONDITIONED:
            return np.asarray(q)
    lower, upper = position_bounds(model)
    middle, half = (lower + upper) / 2, 0.8 * (upper - lower) / 2
    angles = middle + half * np.random.default_rng(0).uniform(-1.0, 1.0, (_SAMPLES, model.nv))
    samples = [configuration_from_angles(model, sample) for sample in angles]
    best = max(samples, key=lambda q: conditioning(model, data, frame, rows, q)[0])
    if conditioning(model, data, frame, rows, best)[1] < _DEGENERATE:
        raise RobotError(
            f"the chain to frame '{model.frames[frame].name}' cannot move all coordinates of the task in any posture.",
            where="task",
            hint="Take another task, or a frame further out.",
        )
    return best
