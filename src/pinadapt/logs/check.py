"""Whether a log can be one of a robot: times, units and lengths."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pinocchio as pin

from ..description.chain import effort_limits, is_slide
from ..exceptions import LogError
from ..robot.robot import Robot
from .log import Log

SHORTEST, FEWEST = 1.0, 100  # [s] and samples
_MEASURED = 0.5  # share of the samples that must be finite
_TURNS = 4.0 * math.pi  # [rad] beyond which a joint without limits hardly turns
_BEYOND = 0.5  # [rad] beyond a limit that no calibration explains
_OUTSIDE = 0.5  # share of the samples there
_TOO_STRONG = 5.0  # times the effort limit, root mean square
_MOVING = 0.02  # [rad/s or m/s] root mean square of a velocity that can be compared
_FACTORS = (0.5, 2.0)  # between which a velocity is that of its positions


def check(log: Log, robot: Robot) -> None:
    """Refuse a log from which nothing sound can be learned.

    Raises:
        LogError: times that do not ascend, too few or too short, hardly anything measured, torques
            that are all zero, or numbers that look like degrees, counts or other units.
    """
    for flaw in (_times, _measured, _degrees, _velocities, _torques):
        flaw(log, robot)


def _times(log: Log, robot: Robot) -> None:
    where = f"{log.source}: t"
    if not np.isfinite(log.t).all():
        row = int(np.flatnonzero(~np.isfinite(log.t))[0])
        raise LogError(f"sample {row} has no time.", where=where)
    steps = np.diff(log.t)
    if (steps <= 0.0).any():
        row = int(np.flatnonzero(steps <= 0.0)[0]) + 1
        raise LogError(
            f"times must ascend; sample {row} is at {log.t[row]:.6g} s, the one before at "
            f"{log.t[row - 1]:.6g} s. There are {np.count_nonzero(steps <= 0.0)} such samples.",
            where=where,
            hint="Sort the rows, remove repeated ones, or name another column: --columns t=NAME.",
        )
    if len(log.t) < FEWEST or log.duration < SHORTEST:
        raise LogError(
            f"{len(log.t)} samples over {log.duration:.3g} s are too short; at least {FEWEST} and "
            f"{SHORTEST:g} s are needed.",
            where=where,
            hint="Times are in seconds." if log.duration < 0.1 else None,
        )
    if log.period > 0.2:
        raise LogError(
            f"samples are {log.period:.4g} s apart, and inertia does not show.",
            where=where,
            hint="Are the times in milliseconds? They must be in seconds. Else record at 20 Hz or "
            "more.",
        )


def _measured(log: Log, robot: Robot) -> None:
    for name, part in (("q", log.q), ("tau", log.tau)):
        share = np.isfinite(part).mean(axis=0)
        if (share < _MEASURED).any():
            joint = int(np.argmin(share)) if part.shape[1] == robot.model.nv else 0
            raise LogError(
                f"only {share.min():.0%} of the samples of {robot.joint_names[joint]} are numbers.",
                where=f"{log.source}: {name}",
            )


def _degrees(log: Log, robot: Robot) -> None:
    """Refuse positions that are far outside of the limits, and inside them as degrees."""
    if log.q.shape[1] != robot.model.nv:
        return
    for j, low, high in _turning(robot):
        q = log.q[np.isfinite(log.q[:, j]), j]
        margin = max(_BEYOND, 0.25 * (high - low))
        outside = np.mean((q < low - margin) | (q > high + margin))
        if outside > _OUTSIDE:
            raise LogError(
                f"{robot.joint_names[j]} is at {q.min():.4g} to {q.max():.4g}, and its limits are "
                f"{low:.4g} and {high:.4g} rad. In degrees?",
                where=f"{log.source}: q",
                hint="--degrees reads angles in degrees; joints are matched by their names where "
                "columns have some.",
            )


def _turning(robot: Robot) -> Iterator[tuple[int, float, float]]:
    """Yield index and limits [rad] of the joints that turn."""
    model: pin.Model = robot.model
    for j, joint in enumerate(model.joints[1:]):
        if is_slide(joint):
            continue
        bounds = (-_TURNS, _TURNS)
        if joint.nq == 1:
            low = float(model.lowerPositionLimit[joint.idx_q])
            high = float(model.upperPositionLimit[joint.idx_q])
            if -1e3 < low < high < 1e3:
                bounds = (low, high)
        yield j, *bounds


def _velocities(log: Log, robot: Robot) -> None:
    """Refuse velocities that are not those of the positions: other units, signs or columns."""
    if log.v is None:
        return
    q, travelled = log.configurations(robot), []
    for before, after in pairwise(q):
        travelled.append(pin.difference(robot.model, before, after))
    rates = np.array(travelled) / np.diff(log.t)[:, None]
    for j, name in enumerate(robot.joint_names):
        mean = 0.5 * (log.v[1:, j] + log.v[:-1, j])
        both = np.isfinite(mean) & np.isfinite(rates[:, j])
        seen, own = mean[both], rates[both, j]
        if not len(own) or _rms(own) < _MOVING or _rms(_smooth(own)) < _MOVING:
            continue
        factor = float(_smooth(own) @ _smooth(seen) / max(_smooth(own) @ _smooth(own), 1e-300))
        if not _FACTORS[0] < factor < _FACTORS[1]:
            raise LogError(
                f"the velocity of {name} is {factor:.3g} times that of its positions"
                f"{_guess(factor)}.",
                where=f"{log.source}: v",
                hint="Bring both to rad and rad/s (m and m/s), or leave velocities out: they are "
                "then taken from the positions.",
            )


def _guess(factor: float) -> str:
    if abs(factor - math.degrees(1.0)) < 6.0:
        return ", in degrees a second"
    if abs(factor - math.radians(1.0)) < 2e-3:
        return ", and the positions are in degrees"
    return ", with the other sign" if abs(factor + 1.0) < 0.2 else ""


def _torques(log: Log, robot: Robot) -> None:
    finite = np.isfinite(log.tau)
    squares = np.where(finite, log.tau, 0.0) ** 2
    sizes = np.sqrt(squares.sum(axis=0) / finite.sum(axis=0))
    if not sizes.any():
        raise LogError(
            "all torques are zero, and without them no dynamics can be learned.",
            where=f"{log.source}: tau",
            hint="Record the efforts that the motors gave.",
        )
    limits = effort_limits(robot.model)
    if (sizes > _TOO_STRONG * limits).any():
        joint = int(np.argmax(sizes / limits))
        raise LogError(
            f"{robot.joint_names[joint]} gives {sizes[joint]:.4g} on average, and its limit is "
            f"{limits[joint]:g} N m or N. In other units?",
            where=f"{log.source}: tau",
            hint="Torques are those of the joints, behind the gears, in N m or N.",
        )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _smooth(values: np.ndarray, size: int = 25) -> np.ndarray:
    """Return running means, without the noise of differenced encoders."""
    return np.convolve(values, np.full(size, 1.0 / size), mode="same")
