"""Where a tracker stands: its axes against the robot's base, from measured motion and positions.

Hand-eye calibration with an unknown tool: R_c, t_c and the unknown translations a minimise

    sum over frames of |x - R_c (p(q) + sum_i (a_i - a_0i) r_i(q)) - t_c|^2,

by Gauss-Newton from the nearest rotation to the lumped least-squares estimate, which is linear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from .._output import Sheet, Table
from ..exceptions import LogError
from ..models.task_kinematics import TaskKinematics
from ..models.tracker_kinematics import Tracker, TrackerKinematics
from ..records import Measurement

_LEAST_WAY = 2e-3  # of the reach: rms motion of the frame that shows anything
_ROUNDS = 20
_CONVERGED = 1e-12
_PRIOR = 0.1  # of the reach: standard deviation of a described translation
_LEAST_NOISE = 1e-6  # of the reach
_FEWEST = 4
_RIDGE = 1e-4  # of the largest singular value
_RANK = 1e-13
_PART = 1e-6  # of a direction
_SCALE = 0.7  # logarithm by which the size of a motion may differ
_LEAST_SHARE = 0.2
_EXPLAINED = 0.5  # share of the residual's size that a mistake must take away
_WORST = 0.05  # rms residual over rms motion, from which no tracker explains the frames
_UNSEEN = 0.9  # of the prior deviation


@dataclass(frozen=True, eq=False, repr=False)
class FoundTracker:
    """A tracker found from frames; ``print`` shows a table.

    Attributes:
        tracker: placement of the base in the tracker's axes, and the translations.
        a_k: (p) the same as parameters of ``TrackerKinematics``, to start a controller from.
        deviations: (6 + k) standard deviations: of the rotation [rad] and position [m] of the base
            in the tracker's axes, and of the translations [m].
        names: (6 + k) of these.
        noise: rms residual of a coordinate [m].
        frames: how many there were.
        unseen: names of what the motion does not show.
    """

    tracker: Tracker
    a_k: np.ndarray
    deviations: np.ndarray
    names: tuple[str, ...]
    noise: float
    frames: int
    unseen: tuple[str, ...]

    def __repr__(self) -> str:
        """Return a table."""
        return str(self.sheet)

    def _repr_html_(self) -> str:
        return self.sheet.html()

    @cached_property
    def sheet(self) -> Sheet:
        """The table."""
        placement, a = self.tracker.placement, self.tracker.a
        turn = pin.log3(placement.rotation)
        values = [*np.degrees(turn), *1e3 * placement.translation, *1e3 * a]
        scales = np.repeat([math.degrees(1.0), 1e3], [3, 3 + len(a)])
        units = np.repeat(["deg", "mm"], [3, 3 + len(a)])
        rows = [
            (name, f"{value:.4g} {unit}", f"{scale * deviation:.2g} {unit}")
            for name, value, unit, scale, deviation in zip(
                self.names, values, units, scales, self.deviations, strict=True
            )
        ]
        summary = [
            ("turned", f"{math.degrees(float(np.linalg.norm(turn))):.4g} deg"),
            ("frames", f"{self.frames}"),
            ("rms residual", f"{1e3 * self.noise:.3g} mm"),
        ]
        if self.unseen:
            summary.append(("not shown by this motion", ", ".join(self.unseen)))
        return Sheet("tracker", [Table(summary), Table(rows, ("", "value", "deviation"))])


def find_tracker(kinematics: TaskKinematics, samples: Sequence[Measurement]) -> FoundTracker:
    """Return where the tracker stands that saw the frames of a motion.

    Args:
        kinematics: of a controller with ``unknown=pa.Unknown(tracker=True)``.
        samples: measurements of a motion, with x at some of them; a late frame is compared with
            the configuration at ``x_time``.

    Raises:
        LogError: no tracker explains the frames, with the likely cause: fewer than four frames, a
            frame that hardly moves or not with the arm, millimetres, left-handed axes, another
            clock.
    """
    if not isinstance(kinematics, TrackerKinematics):
        raise LogError(
            "these kinematics have no tracker.", hint="Take unknown=pa.Unknown(tracker=True)."
        )
    p, r, x, rate = _frames(kinematics, samples)
    motion, reach = _rms(p - p.mean(axis=0)), kinematics.robot.reach
    if len(p) < _FEWEST or motion < _LEAST_WAY * reach:
        raise LogError(
            f"{len(p)} frames of a motion of {1e3 * motion:.2g} mm (rms) do not show where the "
            "tracker stands.",
            hint="Move every joint, such that the frame moves by centimetres.",
        )
    found = _lumped(kinematics, p, r, x)
    _check_axes(found.reshape(x.shape[1], -1)[:, :3], p, x, motion)
    tracker, residual, H, _ = _fitted(kinematics, kinematics.tracker(found), p, r, x)
    sigma = max(_deviation(residual, len(H)), _LEAST_NOISE * reach)
    if sigma * _correlated(residual) > _WORST * motion:
        _, other, _, late = _fitted(kinematics, tracker, p, r, x, rate)
        left = _deviation(other, len(H))
        cause = ""
        if left < _EXPLAINED * sigma:
            cause = f"; frames taken {1e3 * late:.3g} ms before their time would explain it"
        raise LogError(
            f"no tracker explains these frames: they are off by {1e3 * sigma:.3g} mm (rms) in a "
            f"motion of {1e3 * motion:.3g} mm{cause}.",
            hint="Is x of this frame, of this robot, and timed on the clock of q?",
        )
    deviations = sigma * _spread(H)
    turned = [f"{word} {axis}" for word in ("turn about", "base") for axis in "xyz"]
    names = (*turned, *kinematics.translation_names)
    prior = np.repeat([1.0, reach, _PRIOR * reach], [3, 3, len(tracker.a)])
    unseen = tuple(
        name for name, off in zip(names, deviations / prior, strict=True) if off > _UNSEEN
    )
    return FoundTracker(
        tracker,
        kinematics.parameters(tracker),
        deviations,
        names,
        sigma,
        len(p),
        unseen,
    )


def _fitted(
    kinematics: TrackerKinematics,
    start: Tracker,
    p: np.ndarray,
    r: np.ndarray,
    x: np.ndarray,
    rate: np.ndarray | None = None,
) -> tuple[Tracker, np.ndarray, np.ndarray, float]:
    """Return tracker, residual (N, m_p) [m], information and lateness [s] of the best fit.

    Args:
        kinematics: with the described translations, which are known to a tenth of the reach.
        start: tracker to begin with.
        p: (N, 3) positions in the axes of the base by the description [m].
        r: (N, 3, k) their derivatives by the translations.
        x: (N, m_p) frames [m].
        rate: (N, 3) dp/dt, if the frames may all be late; None: they are in time.
    """
    R, t, a = start.placement.rotation, start.placement.translation, start.a
    a_0, rows, reach = kinematics.nominal, kinematics.task.place, kinematics.robot.reach
    late, k = 0.0, len(a)
    prior = np.repeat([0.0, 1.0 / (_PRIOR * reach) ** 2, 0.0], [6, k, 1])
    for _ in range(_ROUNDS):
        moved = p if rate is None else p - late * rate
        y = (moved + r @ (a - a_0)) @ R.T
        residual = x - (y + t)[:, rows]
        slopes = [
            np.concatenate([-pin.skew(y_i), np.eye(3), R @ r_i, np.zeros((3, 1))], axis=1)
            for y_i, r_i in zip(y, r, strict=True)
        ]
        W = np.stack(slopes)
        if rate is not None:
            W[:, :, -1] = -rate @ R.T
        W = W[:, rows]
        sigma = max(_deviation(residual, 6 + k), _LEAST_NOISE * reach)
        off = np.concatenate([np.zeros(6), a_0 - a, [0.0]])
        gradient = np.einsum("nmp,nm->p", W, residual) + sigma**2 * prior * off
        H = np.einsum("nmp,nmq->pq", W, W) + np.diag(sigma**2 * prior)
        scale = np.sqrt(np.maximum(np.diag(H), np.finfo(float).tiny))
        step = np.linalg.pinv(H / np.outer(scale, scale), rcond=_RANK, hermitian=True)
        step = step @ (gradient / scale) / scale
        R, t, a = pin.exp3(step[:3]) @ R, t + step[3:6], a + step[6:-1]
        late += float(step[-1])
        if np.abs(step).max() < _CONVERGED:
            break
    return Tracker(pin.SE3(R, t), a), residual, H[:-1, :-1], late


def _spread(H: np.ndarray) -> np.ndarray:
    """Return the roots of the diagonal of H^-1 (p, p); infinite where H says nothing."""
    scale = np.sqrt(np.maximum(np.diag(H), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(H / np.outer(scale, scale))
    told = values > _RANK
    variance = np.sum(vectors[:, told] ** 2 / values[told], axis=1) / scale**2
    free = np.sum(vectors[:, ~told] ** 2, axis=1) > _PART
    return np.where(free, np.inf, np.sqrt(variance))


def _frames(
    kinematics: TrackerKinematics, samples: Sequence[Measurement]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return of N frames p (N, 3), r (N, 3, k), x (N, m_p), and dx/dt but for a turn (N, 3)."""
    times = np.array([sample.t for sample in samples])
    rows, last = [], None
    for k, sample in enumerate(samples):
        t, q, v, x, taken, *_ = sample
        if x is None or (taken is not None and taken == last):
            continue
        last = taken
        if taken is not None and taken < t:
            k = min(max(int(np.searchsorted(times, taken, side="right")) - 1, 0), len(times) - 2)
            share = float(np.clip((taken - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0))
            q, v = kinematics.between(samples[k].q, samples[k + 1].q, share), samples[k].v
        p, r, pd = kinematics.in_base(q, v)
        rows.append((p, r, np.asarray(x, dtype=float)[: kinematics.positions], pd))
    if not rows:
        raise LogError("there is no frame: no measurement has an x.")
    p, r, x, pd = (np.array(column) for column in zip(*rows, strict=True))
    return p, r, x, pd


def _lumped(
    kinematics: TrackerKinematics, p: np.ndarray, r: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Return the least-squares estimate (p) of the lumped parameters, near the described ones."""
    phi = np.array([kinematics.lumped(*each) for each in zip(p, r, strict=True)])
    m = x.shape[1]
    start, sizes = kinematics.initial.reshape(m, -1), kinematics.sizes.reshape(m, -1)[0]
    start = start * np.append(np.zeros(start.shape[1] - 1), 1.0)  # of the blocks nothing is known
    U, s, V = np.linalg.svd(phi * sizes, full_matrices=False)
    weight = s / (s**2 + (_RIDGE * s[0]) ** 2)
    return np.asarray((start + (V.T * weight @ U.T @ (x - phi @ start.T)).T * sizes).ravel())


def _check_axes(B: np.ndarray, p: np.ndarray, x: np.ndarray, motion: float) -> None:
    """Refuse frames whose rotation block B (m_p, 3) shows another unit or another handedness."""
    size = _rms(x - x.mean(axis=0)) / motion * math.sqrt(x.shape[1] / 3.0)
    if abs(math.log(size)) > _SCALE:
        unit = "in millimetres? " if 300.0 < size < 3000.0 else ""
        still = "x does not move with the arm. " if size < 0.01 else ""
        raise LogError(
            f"the frames move {size:.3g} times as far as the arm. {still}{unit}".strip(),
            hint="Give x in metres, of a point that is fixed to the last body.",
        )
    if len(B) == 3 and np.linalg.det(B) < 0.0:
        raise LogError(
            "the axes of the tracker are left-handed: only a mirror explains the frames.",
            hint="Change the sign of one coordinate of x.",
        )


def _deviation(residual: np.ndarray, parameters: int) -> float:
    """Return the standard deviation of the noise that leaves a residual (N, m_p)."""
    return math.sqrt(float(np.sum(residual**2)) / max(1, residual.size - parameters))


def _correlated(residual: np.ndarray) -> float:
    """Return the share of a residual (N, m_p) that is no noise, from its neighbours; at least 0.2.

    What a tracker cannot explain changes with the motion; noise changes from frame to frame.
    """
    if len(residual) < 3:
        return 1.0
    alike = float(np.vdot(residual[1:], residual[:-1]))
    size = float(np.vdot(residual, residual))
    return max(math.sqrt(max(alike, 0.0) / size) if size else 0.0, _LEAST_SHARE)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
