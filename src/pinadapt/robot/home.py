"""The home configuration: away from singularities, joint limits and the mounting plane."""

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
_DIGITS = 4  # of a searched home [rad or m], so that it can be read and written
_NEARLY = 0.6  # of the best smallest singular value
_DEGENERATE = 1e-6  # smallest over largest singular value of the task Jacobian
_OFF_LIMITS, _FAR_OFF = 0.05, 0.2  # parts of a joint's range
_ROOM = 0.05  # of the reach, between the mounting plane and every joint
_HEIGHT_SAMPLES = 10  # poses that show which heights change
_STILL = 1e-6  # [m] by which a height that changes varies at least


def conditioning(
    model: pin.Model, data: pin.Data, frame: int, rows: slice, q: np.ndarray
) -> tuple[float, float]:
    """Return the task Jacobian's smallest singular value at q, and its ratio to the largest."""
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
    """Return the first well-conditioned candidate (nq) off the limits, or the best pose.

    The best pose found among seeded samples inside the limits, and samples around the best of them,
    has the largest smallest singular value of the task Jacobian times how far it is from the
    limits, up to a fifth of each joint's range. A candidate needs three fifths of its singular
    value and a twentieth of each range. All keep off the plane where the chain can.

    Args:
        model: of the chain.
        frame: the task frame.
        rows: of its Jacobian that the task takes.
        candidates: (nq) taken if they will do, in this order.
        plane: that the chain is mounted on, or None.

    Raises:
        RobotError: the task Jacobian is degenerate in all of them.
    """
    data, limits = model.createData(), position_limits(model)
    rng = np.random.default_rng(0)
    samples = _samples(model, rng)
    configurations = [configuration_from_angles(model, sample) for sample in samples]
    room = -np.inf if plane is None else plane.room(model, frame, configurations)

    def off_plane(q: np.ndarray) -> bool:
        return plane is None or plane.distance(model, data, frame, q) >= room

    def quality(angles: np.ndarray) -> float:
        """Return the smallest singular value of the Jacobian at angles (nv), less near a limit."""
        q = configuration_from_angles(model, angles)
        if not off_plane(q):
            return 0.0
        return conditioning(model, data, frame, rows, q)[0] * min(
            1.0, _margin(limits, angles) / _FAR_OFF
        )

    best = _refined(model, rng, max(samples, key=quality), quality)
    home = configuration_from_angles(model, np.round(best, _DIGITS))
    singular, ratio = conditioning(model, data, frame, rows, home)
    if ratio < _DEGENERATE:
        raise RobotError(
            f"the chain to frame '{model.frames[frame].name}' cannot move all coordinates of the "
            "task in any posture.",
            where="task",
            hint="Take another task, or a frame further out; where there is none, give the "
            "description a link there.",
        )
    for q in candidates:
        off_limits = _margin(limits, angles_from_configuration(model, q)) >= _OFF_LIMITS
        if (
            off_limits
            and off_plane(q)
            and conditioning(model, data, frame, rows, q)[0] >= _NEARLY * singular
        ):
            return np.asarray(q)
    return home


def home_inside_limits(model: pin.Model, candidates: Iterable[np.ndarray]) -> np.ndarray:
    """Return the first candidate (nq) inside the joint limits, or the middle between them."""
    limits = position_limits(model)
    for q in candidates:
        if _margin(limits, angles_from_configuration(model, q)) >= 0.0:
            return np.asarray(q)
    return configuration_from_angles(model, np.mean(position_bounds(model), axis=0))


def _samples(model: pin.Model, rng: np.random.Generator) -> np.ndarray:
    """Return seeded samples of the angles (., nv) inside four fifths of the bounds."""
    middle, half = _inner(model)
    return np.asarray(middle + half * rng.uniform(-1.0, 1.0, (_SAMPLES, model.nv)))


def _refined(
    model: pin.Model,
    rng: np.random.Generator,
    best: np.ndarray,
    quality: Callable[[np.ndarray], float],
) -> np.ndarray:
    """Return the angles (nv) of highest quality among the best until now and samples around it."""
    middle, half = _inner(model)
    for size in _REFINEMENTS:
        around = best + size * half * rng.standard_normal((_SAMPLES // 10, model.nv))
        best = max([best, *np.clip(around, middle - half, middle + half)], key=quality)
    return np.asarray(best)


def _inner(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return middle and half width (nv) of four fifths of the bounds."""
    lower, upper = position_bounds(model)
    return (lower + upper) / 2, 0.8 * (upper - lower) / 2


def _margin(limits: tuple[np.ndarray, np.ndarray], angles: np.ndarray) -> float:
    """Return the distance to the nearest limit, in parts of that joint's range; inf for none."""
    lower, upper = limits
    limited = np.isfinite(lower)
    low, high, at = lower[limited], upper[limited], angles[limited]
    return float(np.min(np.minimum(at - low, high - at) / (high - low), initial=np.inf))


@dataclass(frozen=True)
class MountingPlane:
    """The horizontal plane (xy of the root) through the link that carries a chain's first joint.

    Arms stand on it, legs and arms on a ceiling hang from it: the chain belongs on the side on
    which its description shows it.

    Attributes:
        level: its height above the root [m].
        side: 1 for a chain above it, -1 for one below.
        movable: which of the second joint, those after it and the frame change their height.
    """

    level: float
    side: float
    movable: tuple[int, ...]

    @classmethod
    def of(cls, model: pin.Model, frame: int, shown: np.ndarray) -> MountingPlane | None:
        """Return that of a chain to a frame, as the configuration ``shown`` (nq) has it.

        None where all of the chain moves horizontally.
        """
        data, rng = model.createData(), np.random.default_rng(0)
        samples = rng.uniform(-1.0, 1.0, (_HEIGHT_SAMPLES, model.nv))
        heights = [
            _heights(model, data, frame, configuration_from_angles(model, s)) for s in samples
        ]
        movable = np.flatnonzero(np.ptp(heights, axis=0) > _STILL)
        if not movable.size:
            return None
        level = _level(model)
        above = np.mean(_heights(model, data, frame, shown)[movable]) > level - _STILL
        return cls(level, 1.0 if above else -1.0, tuple(movable.tolist()))

    def distance(self, model: pin.Model, data: pin.Data, frame: int, q: np.ndarray) -> float:
        """Return how far [m] the chain stays from the plane at q (nq); negative beyond it."""
        heights = _heights(model, data, frame, q)[list(self.movable)]
        return float(np.min(self.side * (heights - self.level)))

    def room(self, model: pin.Model, frame: int, configurations: Iterable[np.ndarray]) -> float:
        """Return the distance [m] to be kept: a twentieth of the reach, less where there is less.

        Where none of the configurations (nq) is on the right side it is minus infinity.
        """
        data = model.createData()
        most = max(self.distance(model, data, frame, q) for q in configurations)
        return min(_ROOM * reach(model, frame), most / 2) if most > 0.0 else -np.inf


def _heights(model: pin.Model, data: pin.Data, frame: int, q: np.ndarray) -> np.ndarray:
    """Return the heights above the root [m] of the second joint, those after it and the frame."""
    pin.forwardKinematics(model, data, q)
    placements = [*data.oMi[2:], pin.updateFramePlacement(model, data, frame)]
    return np.array([placement.translation[2] for placement in placements])


def _level(model: pin.Model) -> float:
    """Return the height of the origin of the link that carries the first joint [m]."""
    for frame in model.frames:
        if frame.type == pin.FrameType.JOINT and frame.parentJoint == 1:
            return float(model.frames[frame.parentFrame].placement.translation[2])
    return 0.0
