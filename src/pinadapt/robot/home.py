"""The search for a home pose: away from singularities, joint limits and the mounting plane."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..description.chain import (
    angles_from_configuration,
    configuration_from_angles,
    position_bounds,
    position_limits,
    reach,
)
from ..exceptions import RobotError

_SAMPLES, _REFINEMENTS = 500, (0.2, 0.1, 0.05)
_DIGITS = 4  # decimals of a searched home pose [rad or m]
_NEARLY = 0.6  # least conditioning of a given pose, relative to the best one
_DEGENERATE = 1e-6  # smallest over largest singular value of the task Jacobian
_OFF_LIMITS, _FAR_OFF = 0.05, 0.2  # distances from a joint limit, relative to the joint's range
_ROOM = 0.05  # distance of the chain from the mounting plane, relative to the reach
_HEIGHT_SAMPLES = 10  # random poses that show which heights vary
_STILL = 1e-6  # [m], largest variation of a constant height


def conditioning(
    model: pin.Model, data: pin.Data, frame: int, rows: slice, q: np.ndarray
) -> tuple[float, float]:
    """Return the smallest singular value of the task Jacobian, and its ratio to the largest."""
    J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[rows]
    singular = np.linalg.svd(J, compute_uv=False)
    return float(singular[-1]), float(singular[-1] / max(singular[0], np.finfo(float).tiny))


def find_home(
    model: pin.Model,
    frame: int,
    rows: slice,
    candidates: Iterable[np.ndarray],
    plane: MountingPlane | None = None,
) -> np.ndarray:
    """Return the first acceptable candidate (nq), else the best pose of a random search.

    The search takes seeded samples inside the joint limits, then samples around the best of them.
    It maximises the smallest singular value of the task Jacobian. Within a fifth of a joint's range
    from a limit, this value is reduced in proportion to the distance from the limit. A candidate is
    acceptable if it has 60 % of the singular value of the best pose and a distance of 5 % of each
    joint's range from the limits. All poses stay on their side of the mounting plane if the chain
    can.

    Args:
        model: of the chain.
        frame: index of the task frame.
        rows: rows of the frame's Jacobian that belong to the task.
        candidates: (nq) poses that are preferred, in this order.
        plane: the mounting plane, or None.

    Raises:
        RobotError: the task Jacobian is singular in all poses.
    """
    limits, rng = position_limits(model), np.random.default_rng(0)
    samples = _samples(model, rng)
    room = -np.inf if plane is None else plane.room(model, frame, _configurations(model, samples))

    def qualities(poses: np.ndarray) -> np.ndarray:
        """Return the smallest singular values (N) at joint positions (N, nv), less near limits."""
        configurations = _configurations(model, poses)
        found = _singular_values(model, frame, rows, configurations)[:, -1]
        if plane is not None:
            found[plane.distances(model, frame, configurations) < room] = 0.0
        return np.asarray(found * np.minimum(1.0, _margins(limits, poses) / _FAR_OFF))

    best = _refined(model, rng, samples[np.argmax(qualities(samples))], qualities)
    home = configuration_from_angles(model, np.round(best, _DIGITS))
    data = model.createData()
    singular, ratio = conditioning(model, data, frame, rows, home)
    if ratio < _DEGENERATE:
        raise RobotError(
            f"the chain to frame '{model.frames[frame].name}' cannot move all coordinates of the "
            "task: the task Jacobian is singular in every pose.",
            where="task",
            hint="Choose another task or a frame further from the base; if there is none, add a "
            "link to the description.",
        )
    for q in candidates:
        off_limits = _margins(limits, angles_from_configuration(model, q)) >= _OFF_LIMITS
        if (
            off_limits
            and (plane is None or plane.distance(model, data, frame, q) >= room)
            and conditioning(model, data, frame, rows, q)[0] >= _NEARLY * singular
        ):
            return np.asarray(q)
    return home


def home_inside_limits(model: pin.Model, candidates: Iterable[np.ndarray]) -> np.ndarray:
    """Return the first candidate (nq) inside the joint limits, else the middle of the limits."""
    limits = position_limits(model)
    for q in candidates:
        if _margins(limits, angles_from_configuration(model, q)) >= 0.0:
            return np.asarray(q)
    return configuration_from_angles(model, np.mean(position_bounds(model), axis=0))


def _samples(model: pin.Model, rng: np.random.Generator) -> np.ndarray:
    """Return random joint positions (., nv) in the middle 80 % of the joint bounds."""
    middle, half = _inner(model)
    return np.asarray(middle + half * rng.uniform(-1.0, 1.0, (_SAMPLES, model.nv)))


def _configurations(model: pin.Model, poses: np.ndarray) -> list[np.ndarray]:
    """Return the configurations (nq) of joint positions (N, nv)."""
    if model.nq == model.nv:  # positions and configurations are the same numbers
        return list(poses)
    return [configuration_from_angles(model, angles) for angles in poses]


def _singular_values(
    model: pin.Model, frame: int, rows: slice, configurations: Iterable[np.ndarray]
) -> np.ndarray:
    """Return the singular values (N, .) of the task Jacobian, falling, at configurations (nq)."""
    data, axes = model.createData(), pin.LOCAL_WORLD_ALIGNED
    J = [pin.computeFrameJacobian(model, data, q, frame, axes)[rows] for q in configurations]
    return np.asarray(np.linalg.svd(np.array(J), compute_uv=False))


def _refined(
    model: pin.Model,
    rng: np.random.Generator,
    best: np.ndarray,
    qualities: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Return the joint positions (nv) of highest quality around the best so far."""
    middle, half = _inner(model)
    for size in _REFINEMENTS:
        around = best + size * half * rng.standard_normal((_SAMPLES // 10, model.nv))
        poses = np.vstack([best, np.clip(around, middle - half, middle + half)])
        best = poses[np.argmax(qualities(poses))]
    return np.asarray(best)


def _inner(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return middle and half width (nv) of the middle 80 % of the joint bounds."""
    lower, upper = position_bounds(model)
    return (lower + upper) / 2, 0.8 * (upper - lower) / 2


def _margins(limits: tuple[np.ndarray, np.ndarray], angles: np.ndarray) -> np.ndarray:
    """Return the least distances (...) from a joint limit, relative to the joint's range.

    They are infinite if no joint has limits. The joint positions are ``angles`` (..., nv).
    """
    lower, upper = limits
    limited = np.isfinite(lower)
    low, high, at = lower[limited], upper[limited], angles[..., limited]
    nearest = np.minimum(at - low, high - at) / (high - low)
    return np.asarray(np.min(nearest, axis=-1, initial=np.inf))


@dataclass(frozen=True)
class MountingPlane:
    """The horizontal plane through the link that carries the first joint of a chain.

    Arms usually stand on it; legs, and arms on a ceiling, hang from it. The chain should stay on
    the side on which the reference pose of the description has it. Horizontal is the xy plane of
    the root.

    Attributes:
        level: height of the plane above the root [m].
        side: 1 for a chain above the plane, -1 for one below.
        movable: indices of the points whose height varies, in the list of the second joint, all
            joints after it and the task frame.
    """

    level: float
    side: float
    movable: tuple[int, ...]

    @classmethod
    def of(cls, model: pin.Model, frame: int, shown: np.ndarray) -> MountingPlane | None:
        """Return the plane of a chain, with the side that the reference pose ``shown`` (nq) is on.

        None if the whole chain moves horizontally.
        """
        rng, data = np.random.default_rng(0), model.createData()
        samples = rng.uniform(-1.0, 1.0, (_HEIGHT_SAMPLES, model.nv))
        heights = _heights(model, data, frame, _configurations(model, samples))
        movable = np.flatnonzero(np.ptp(heights, axis=0) > _STILL)
        if not movable.size:
            return None
        level = _level(model)
        above = np.mean(_heights(model, data, frame, [shown])[0, movable]) > level - _STILL
        return cls(level, 1.0 if above else -1.0, tuple(movable.tolist()))

    def distance(self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray) -> float:
        """Return the distance [m] of the chain from the plane; negative on the wrong side."""
        heights = _heights(model, data, frame, [q])[0, self.movable]
        return float(np.min(self.side * (heights - self.level)))

    def distances(
        self, model: pin.Model, frame: int, configurations: Iterable[np.ndarray]
    ) -> np.ndarray:
        """Return the distance [m] of the chain from the plane in each of N configurations (nq)."""
        heights = _heights(model, model.createData(), frame, configurations)
        return np.asarray(np.min(self.side * (heights[:, self.movable] - self.level), axis=1))

    def room(self, model: pin.Model, frame: int, configurations: Iterable[np.ndarray]) -> float:
        """Return the distance [m] to keep: 5 % of the reach, at most half of what is possible.

        It is minus infinity if none of the configurations (nq) is on the right side.
        """
        most = float(np.max(self.distances(model, frame, configurations)))
        return min(_ROOM * reach(model, frame), most / 2) if most > 0.0 else -np.inf


def _heights(
    model: pin.Model, data: pin.Data, frame: int, configurations: Iterable[np.ndarray]
) -> np.ndarray:
    """Return heights (N, .) [m] above the root of the second joint, those after it and the frame.

    At N configurations (nq). The places are read where Pinocchio writes them: copies cost more than
    the kinematics.
    """
    places = [data.oMi[joint].translation for joint in range(2, model.njoints)]
    places.append(data.oMf[frame].translation)
    rows = []
    for q in configurations:
        pin.forwardKinematics(model, data, q)
        pin.updateFramePlacement(model, data, frame)
        rows.append([place.item(2) for place in places])
    return np.array(rows)


def _level(model: pin.Model) -> float:
    """Return the height [m] of the origin of the link that carries the first joint."""
    for frame in model.frames:
        if frame.type == pin.FrameType.JOINT and frame.parentJoint == 1:
            return float(model.frames[frame.parentFrame].placement.translation[2])
    return 0.0
