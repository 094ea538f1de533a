"""A starting configuration away from singularities, when nobody gives one."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from ..exceptions import RobotError
from .chain import angles_from_configuration, configuration_from_angles, is_slide

_WELL_CONDITIONED = 0.1  # smallest over largest singular value of the task Jacobian
_DEGENERATE = 1e-6
_OFF_LIMITS, _FAR_OFF = 0.05, 0.2  # parts of a joint's range
_SAMPLES, _REFINEMENTS = 500, (0.2, 0.1, 0.05)


def position_limits(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper joint limits (nv) [rad or m], infinite where there are none.

    URDFs say "no limit" with 0, 1.8e308 or infinity: any empty or wider-than-two-turns range counts as absent.
    """
    lower, upper = np.full(model.nv, -np.inf), np.full(model.nv, np.inf)
    for joint in model.joints[1:]:
        if joint.nq == 1:
            low, high = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
            if low < high and high - low <= 4 * np.pi:
                lower[joint.idx_v], upper[joint.idx_v] = low, high
    return lower, upper


def position_bounds(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper joint bounds (nv) [rad or m]; an absent limit becomes half a turn or one metre."""
    lower, upper = position_limits(model)
    half = np.array([1.0 if is_slide(joint) else np.pi for joint in model.joints[1:]])
    return np.where(np.isfinite(lower), lower, -half), np.where(np.isfinite(upper), upper, half)


def conditioning(model: pin.Model, data: pin.Data, frame: int, rows: slice, q: np.ndarray) -> tuple[float, float]:
    """Return smallest singular value of the task Jacobian, and its ratio to the largest, at q (nq)."""
    J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[rows]
    singular = np.linalg.svd(J, compute_uv=False)
    return float(singular[-1]), float(singular[-1] / max(singular[0], np.finfo(float).tiny))


def find_home(model: pin.Model, frame: int, rows: slice, candidates: Iterable[np.ndarray]) -> np.ndarray:
    """Return the first candidate (nq) that is well conditioned and off the limits, else the best of many seeded samples.

    The best one has the largest smallest singular value of the task Jacobian, times how far it is from the limits up to a
    fifth of each joint's range; it is refined by samples around it.

    Raises:
        RobotError: the task Jacobian is degenerate in all of them.
    """
    data, limits = model.createData(), position_limits(model)
    for q in candidates:
        margin = _margin(limits, angles_from_configuration(model, q))
        if margin >= _OFF_LIMITS and conditioning(model, data, frame, rows, q)[1] >= _WELL_CONDITIONED:
            return np.asarray(q)

    def quality(angles: np.ndarray) -> float:
        q = configuration_from_angles(model, angles)
        return conditioning(model, data, frame, rows, q)[0] * min(1.0, _margin(limits, angles) / _FAR_OFF)

    lower, upper = position_bounds(model)
    middle, half, rng = (lower + upper) / 2, 0.8 * (upper - lower) / 2, np.random.default_rng(0)
    best = max(middle + half * rng.uniform(-1.0, 1.0, (_SAMPLES, model.nv)), key=quality)
    for size in _REFINEMENTS:
        around = best + size * half * rng.standard_normal((_SAMPLES // 10, model.nv))
        best = max([best, *np.clip(around, middle - half, middle + half)], key=quality)
    home = configuration_from_angles(model, best)
    if conditioning(model, data, frame, rows, home)[1] < _DEGENERATE:
        raise RobotError(
            f"the chain to frame '{model.frames[frame].name}' cannot move all coordinates of the task in any posture.",
            where="task",
            hint="Take another task, or a frame further out.",
        )
    return home


def _margin(limits: tuple[np.ndarray, np.ndarray], angles: np.ndarray) -> float:
    """Return the distance to the nearest limit in parts of that joint's range, negative outside, infinite without limits."""
    lower, upper = limits
    limited = np.isfinite(lower)
    low, high, at = lower[limited], upper[limited], angles[limited]
    return float(np.min(np.minimum(at - low, high - at) / (high - low), initial=np.inf))
