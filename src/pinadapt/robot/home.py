"""The search for a home pose: away from singularities, joint limits and the mounting plane."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..description.chain import (
    Bounds,
    angles_from_configuration,
    configuration_from_angles,
    position_bounds,
    position_limits,
    reach,
)
from ..exceptions import RobotError

# distance kept from joint limits and the mounting plane, of the range and the reach; half: runs
# with an unknown tool come closer to limits; twice: fewer poses of descriptions are kept
MARGIN = 0.05
# of a joint's range, distance from a limit up to which a pose counts less; half: homes nearer to
# limits; twice: homes in the middle of the limits
_FAR_OFF = 0.2
# least conditioning of a given pose, relative to the best one; half: more poses of descriptions are
# kept, some close to singularities; 1: none is kept
_NEARLY = 0.6


@dataclass(frozen=True)
class MountingPlane:
    """The horizontal plane through the link that carries the first joint of a chain.

    Arms usually stand on it; legs, and arms on a ceiling, hang from it. The third joint, all after
    it and the task frame should stay on the side on which the reference pose of the description has
    them. Horizontal is the xy plane of the root.

    Attributes:
        level: height of the plane above the root [m]; by default there is none.
        side: 1 for a chain above the plane, -1 for one below.
    """

    level: float = -np.inf
    side: float = 1.0

    @classmethod
    def of(cls, model: pin.Model, frame: int, shown: np.ndarray) -> MountingPlane:
        """Return the plane of a chain, with the side of the reference pose ``shown`` (nq)."""
        levels = (
            float(model.frames[joint.parentFrame].placement.translation[2])
            for joint in model.frames
            if joint.type == pin.FrameType.JOINT and joint.parentJoint == 1
        )
        level = next(levels, 0.0)
        above = np.mean(_heights(model, frame, [shown])) > level - 1e-6
        return cls(level, 1.0 if above else -1.0)

    def distances(
        self, model: pin.Model, frame: int, configurations: Iterable[np.ndarray]
    ) -> np.ndarray:
        """Return the distances (N) [m] of the chain at configurations (nq), negative beyond."""
        return np.min(self.side * (_heights(model, frame, configurations) - self.level), axis=1)


def _heights(model: pin.Model, frame: int, configurations: Iterable[np.ndarray]) -> np.ndarray:
    """Return heights (N, .) [m] above the root of the third joint, those after it and the frame."""
    data = model.createData()
    rows = []
    # places where Pinocchio writes: copies cost more than the kinematics
    places = [each.translation for each in [*list(data.oMi)[3:], data.oMf[frame]]]
    for q in configurations:
        pin.forwardKinematics(model, data, q)
        pin.updateFramePlacement(model, data, frame)
        rows.append([place.item(2) for place in places])
    return np.array(rows)


def singular_values(
    model: pin.Model, frames: Sequence[int], rows: slice, configurations: Iterable[np.ndarray]
) -> np.ndarray:
    """Return the singular values (N, .) of the task Jacobian at configurations (nq).

    It has the ``rows`` of the Jacobians of all frames; the largest comes first.
    """
    data = model.createData()
    axes = pin.LOCAL_WORLD_ALIGNED
    J = [
        [pin.computeFrameJacobian(model, data, q, frame, axes)[rows] for frame in frames]
        for q in configurations
    ]
    return np.linalg.svd(np.reshape(J, (len(J), -1, model.nv)), compute_uv=False)


def find_home(
    model: pin.Model,
    frames: Sequence[int],
    rows: slice,
    candidates: Iterable[np.ndarray],
    plane: MountingPlane = MountingPlane(),
) -> np.ndarray:
    """Return the first acceptable candidate (nq), else the best pose of a random search.

    The search takes seeded samples inside the joint limits, then samples around the best of them.
    It maximises the smallest singular value of the task Jacobian. Within a fifth of a joint's range
    from a limit, this value is reduced in proportion to the distance from the limit. A candidate is
    acceptable if it has 60 % of the singular value of the best pose and a distance of 5 % of each
    joint's range from the limits. All poses stay on their side of the mounting plane if the chain
    can, at a distance of 5 % of the reach, or half of what is possible.

    Args:
        model: of the chain.
        frames: indices of the task frames.
        rows: rows of each frame's Jacobian that belong to the task.
        candidates: (nq) poses that are preferred, in this order.
        plane: the mounting plane; of several frames it is that of the first.

    Raises:
        RobotError: the task Jacobian is singular in all poses.
    """
    limits = position_limits(model)
    rng = np.random.default_rng(0)
    lower, upper = position_bounds(model)
    middle = (lower + upper) / 2
    half = 0.8 * (upper - lower) / 2

    def best_of(poses: np.ndarray) -> np.ndarray:
        """Return the joint positions (N, nv) of the largest singular value, less near limits."""
        at = [configuration_from_angles(model, angles) for angles in poses]
        found = singular_values(model, frames, rows, at)[:, -1]
        found *= (plane.distances(model, frames[0], at) >= room) * np.minimum(
            1.0, _off_limits(limits, poses) / _FAR_OFF
        )
        return poses[np.argmax(found)]

    samples = middle + half * rng.uniform(-1.0, 1.0, (500, model.nv))
    sampled = [configuration_from_angles(model, angles) for angles in samples]
    most = plane.distances(model, frames[0], sampled).max()
    room = min(MARGIN * reach(model, frames[0]), most / 2) if most > 0.0 else -np.inf
    best = best_of(samples)
    for size in (0.2, 0.1, 0.05):
        around = best + size * half * rng.standard_normal((50, model.nv))
        best = best_of(np.vstack([best, np.clip(around, middle - half, middle + half)]))
    home = configuration_from_angles(model, np.round(best, 4))
    ((largest, *_, smallest),) = singular_values(model, frames, rows, [home])
    if smallest < 1e-6 * max(largest, np.finfo(float).tiny):
        names = "', '".join(model.frames[frame].name for frame in frames)
        raise RobotError(
            f"the joints to '{names}' cannot move all coordinates of the task: the task Jacobian "
            "is singular in every pose.",
            where="task",
            hint="Choose another task or a frame further from the base; if there is none, add a "
            "link to the description.",
        )
    for q in candidates:
        if (
            _off_limits(limits, angles_from_configuration(model, q)) >= MARGIN
            and plane.distances(model, frames[0], [q])[0] >= room
            and singular_values(model, frames, rows, [q])[0, -1] >= _NEARLY * smallest
        ):
            return q
    return home


def home_inside_limits(model: pin.Model, candidates: Iterable[np.ndarray]) -> np.ndarray:
    """Return the first candidate (nq) inside the joint limits, else the middle of the limits."""
    for q in candidates:
        if _off_limits(position_limits(model), angles_from_configuration(model, q)) >= 0.0:
            return q
    return configuration_from_angles(model, np.mean(position_bounds(model), axis=0))


def _off_limits(limits: Bounds, angles: np.ndarray) -> np.ndarray:
    """Return the least distance of joint positions (..., nv) from a limit, relative to the range.

    It is infinite if no joint has limits.
    """
    limited = np.isfinite(limits[0])
    low, high = limits[:, limited]
    at = angles[..., limited]
    nearest = np.minimum(at - low, high - at) / (high - low)
    return np.min(nearest, axis=-1, initial=np.inf)
