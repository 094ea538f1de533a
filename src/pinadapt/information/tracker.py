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
from ..models.camera_kinematics import CameraKinematics
from ..models.task_kinematics import TaskKinematics
from ..models.tracker_kinematics import Tracker, TrackerKinematics
from ..records import Measurement
from .information import Information, frames, gauss_newton

_LEAST_WAY = 2e-3  # of the reach: rms motion of the frame that shows anything
_PRIOR = 0.1  # of the reach: standard deviation of a described translation
_LEAST_NOISE = 1e-6  # of the reach
_FEWEST = 4
_LUMPED = 1e-5  # of the reach: deviation of a frame when lumped parameters are fitted
_STILL = 0.1  # times the motion of the arm, below which x does not move with it
_SCALE = 0.7  # logarithm by which the size of a motion may differ
_LEAST_SHARE = 0.2
_LARGEST = 10.0  # motion of a picture over that of the arm
_MIRRORED = -0.5  # determinant; near zero where the motion does not show all axes
_WORST = 0.05  # rms residual over rms motion, from which no tracker explains the frames
_LATE = 0.02  # [s]: axes that are off by 2 degrees look like frames that are late by up to 0.01 s
_CERTAIN = 5.0  # deviations
_UNSEEN = 0.9  # of the prior deviation


@dataclass(frozen=True, eq=False, repr=False)
class FoundTracker:
    """A tracker found from frames; ``print`` shows a table.

    Attributes:
        tracker: placement of the base in the tracker's axes, and the translations.
        a_k: (p) the same as parameters of ``TrackerKinematics``, to start a controller from.
        information: (p, p) rows of the information of the frames on these, as ``information_k`` of
            ``Controller.init``.
        deviations: (6 + k) standard deviations: of the rotation [rad] and position [m] of the base
            in the tracker's axes, and of the translations [m].
        names: (6 + k) of these.
        noise: rms residual of a coordinate [m].
        frames: how many there were.
        unseen: names of the parameters that the motion does not identify.
    """

    tracker: Tracker
    a_k: np.ndarray
    information: np.ndarray
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

    @property
    def start(self) -> dict[str, np.ndarray]:
        """``a_k`` and ``information_k`` for ``simulate(..., start=...)`` or ``Controller.init``."""
        return {"a_k": self.a_k, "information_k": self.information}

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
            summary.append(("not identified by this motion", ", ".join(self.unseen)))
        return Sheet("tracker", [Table(summary), Table(rows, ("", "value", "deviation"))])


def find_tracker(kinematics: TaskKinematics, samples: Sequence[Measurement]) -> FoundTracker:
    """Return the pose of the tracker that measured the frames of a motion.

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
    p, r, x, rate = _seen(kinematics, samples)
    motion, reach = _rms(p - p.mean(axis=0)), kinematics.robot.reach
    if len(p) < _FEWEST or motion < _LEAST_WAY * reach:
        raise LogError(
            f"{len(p)} frames of a motion of {1e3 * motion:.2g} mm (rms) do not show where the "
            "tracker stands.",
            hint="Move every joint, such that the frame moves by centimetres.",
        )
    found = _lumped(kinematics, p, r, x)
    check_axes(found.reshape(x.shape[1], -1)[:, :3], p, x, motion)
    tracker, residual, information, late = _fitted(
        kinematics, kinematics.tracker(found), (p, r, x, rate)
    )
    names = information.names
    sigma = _noise(residual, len(names), reach)
    if sigma * _correlated(residual) > _WORST * motion:
        cause = ""
        if abs(late[0]) > _CERTAIN * late[1]:
            early = f"{1e3 * late[0]:.2g} ms"
            cause = f"; frames taken {early} before their time stamps would explain more"
        raise LogError(
            f"no tracker explains these frames: they are off by {1e3 * sigma:.3g} mm (rms) in a "
            f"motion of {1e3 * motion:.3g} mm{cause}.",
            hint="Is x of this frame, of this robot, and timed on the clock of q?",
        )
    deviations = information.deviations
    prior = np.repeat([1.0, reach, _PRIOR * reach], [3, 3, len(tracker.a)])
    unseen = [name for name, off in zip(names, deviations / prior, strict=True) if off > _UNSEEN]
    told = kinematics.information(tracker, information.H)
    return FoundTracker(
        tracker,
        kinematics.parameters(tracker),
        np.linalg.cholesky(told).T,
        deviations,
        names,
        sigma,
        len(p),
        tuple(unseen),
    )


def find_camera(kinematics: TaskKinematics, samples: Sequence[Measurement]) -> Information:
    """Return the information of frames on uncalibrated cameras, at the estimate that fits them.

    Args:
        kinematics: of a controller with the task "image", see ``Robot.filmed_by``.
        samples: measurements of a motion, with x at some of them, as ``find_tracker``.

    Raises:
        LogError: no camera explains the frames: fewer than four, a picture that hardly moves, in
            pixels, of another point, or of another clock.
    """
    if not isinstance(kinematics, CameraKinematics):
        raise LogError("these kinematics have no camera.", hint='Take the task "image".')
    found = list(frames(kinematics, samples))
    x, reach = np.array([each for *_, each in found]), kinematics.robot.reach
    motion = _rms(x - x.mean(axis=0)) if len(x) else 0.0
    if len(x) < _FEWEST or motion < _LEAST_WAY * reach:
        raise LogError(
            f"{len(x)} frames whose picture moves by {motion:.2g} (rms) do not show the camera.",
            hint="Move every joint, such that the picture moves by some hundredths of the reach "
            f"({reach:.2g} m), a pixel counted as about the length that it covers at the arm.",
        )
    p = np.array([kinematics.in_base(q, v)[0] for q, v, _ in found])
    size = motion / _rms(p - p.mean(axis=0))
    if size > _LARGEST:
        raise LogError(
            f"the picture moves {size:.3g} times as far as the arm. In pixels?",
            hint=f"Multiply x by about {1.0 / size:.2g}, the length that one covers at the arm.",
        )
    a_0 = kinematics.standing_at(x[0])
    told, residual, (late, uncertain) = _filmed(kinematics, found, a_0)
    sigma = _noise(residual, len(a_0), reach)
    cause = ""
    if abs(late) > max(_LATE, _CERTAIN * uncertain):
        cause = f"frames taken about {1e3 * late:.2g} ms before their time stamps would explain it"
    if sigma * _correlated(residual) > _WORST * motion:
        raise LogError(
            f"no camera explains these frames: they are off by {sigma:.3g} (rms) in a motion of "
            f"{motion:.3g}{cause and '; ' + cause}.",
            hint="Is the picture that of this frame, of this robot, and timed on the clock of q?",
        )
    if cause:
        raise LogError(
            f"the frames have another clock than q: {cause}.",
            hint="x_time is when a picture was taken, on the clock of q.",
        )
    return told


def _filmed(
    kinematics: CameraKinematics,
    found: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
    a_0: np.ndarray,
) -> tuple[Information, np.ndarray, tuple[float, float]]:
    """Return what frames say of a camera at the best fit, and the residual (N, m_p).

    The last is how late the frames seem to be, and the deviation of that [s].

    Args:
        kinematics: of the camera, p parameters.
        found: q (nq), v (nv) and x (m_p) of each of N frames.
        a_0: (p) known before, to begin with.
    """
    known, reach = 1.0 / kinematics.sizes**2, kinematics.robot.reach

    def seen(a: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return slopes (N, m_p, p), residuals (N, m_p) and the rate of the picture (N, m_p)."""
        kept = []
        for q, v, y in found:
            kinematics.update(a, q, v)
            kept.append((kinematics.X_k, y - kinematics.p_hat, kinematics.xd_hat[: len(y)]))
        X_k, left, rate = (np.array(column) for column in zip(*kept, strict=True))
        return X_k, left, rate

    def rows(a: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        W, left, _ = seen(a)
        sigma = _noise(left, len(a), reach)
        return W / sigma, left / sigma, a_0 - a

    a = gauss_newton(rows, lambda a, step: a + step, a_0, known)
    W, left, rate = seen(a)
    sigma = _noise(left, len(a), reach)
    told = Information.of_rows(
        kinematics.names, a, W / sigma, left / sigma, prior=known, off=a_0 - a
    )
    return told, left, told.beside(W / sigma, left / sigma, -rate / sigma)


def _seen(
    kinematics: TrackerKinematics, samples: Sequence[Measurement]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return of N frames p (N, 3), r (N, 3, k), x (N, m_p), and dp/dt (N, 3)."""
    rows = [(*kinematics.in_base(q, v), x) for q, v, x in frames(kinematics, samples)]
    if not rows:
        raise LogError("there is no frame: no measurement has an x.")
    p, r, pd, x = (np.array(column) for column in zip(*rows, strict=True))
    return p, r, x, pd


def _lumped(
    kinematics: TrackerKinematics, p: np.ndarray, r: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Return the least-squares estimate (p) of the lumped parameters.

    Only the size of the blocks is known beforehand.
    """
    m = x.shape[1]
    start = kinematics.initial.reshape(m, -1).copy()
    start[:, :-1] = 0.0
    phi = [kinematics.lumped(*each) for each in zip(p, r, strict=True)]
    W = np.kron(np.array(phi), np.eye(m)).reshape(len(p), m, -1, m)
    W = W.swapaxes(2, 3).reshape(len(p), m, -1)
    prior = (_LUMPED * kinematics.robot.reach / kinematics.sizes) ** 2 * len(p)
    found = Information.of_rows(kinematics.names, start.ravel(), W, x - start[:, -1], prior=prior)
    return found.estimate + found.correction


def _fitted(
    kinematics: TrackerKinematics,
    start: Tracker,
    seen: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> tuple[Tracker, np.ndarray, Information, tuple[float, float]]:
    """Return tracker, residual (N, m_p) [m] and what the frames say at the best fit.

    The last is how late the frames seem to be, and the deviation of that [s].

    Args:
        kinematics: with the described translations, which are known to a tenth of the reach.
        start: tracker to begin with.
        seen: p (N, 3), r (N, 3, k), x (N, m_p) and dp/dt (N, 3), see ``_seen``.
    """
    p, r, x, rate = seen
    a_0, place, reach = kinematics.nominal, kinematics.task.place, kinematics.robot.reach
    turned = [f"{word} {axis}" for word in ("turn about", "base") for axis in "xyz"]
    names = (*turned, *kinematics.translation_names)
    known = np.repeat([0.0, 1.0 / (_PRIOR * reach) ** 2], [6, len(a_0)])

    def residual(tracker: Tracker) -> np.ndarray:
        seen_from = (p + r @ (tracker.a - a_0)) @ tracker.placement.rotation.T
        return np.asarray(x - (seen_from + tracker.placement.translation)[:, place])

    def rows(tracker: Tracker) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        R, left = tracker.placement.rotation, residual(tracker)
        turns = np.array([-pin.skew(each) for each in (p + r @ (tracker.a - a_0)) @ R.T])
        shifts = np.tile(np.eye(3), (len(p), 1, 1))
        W = np.concatenate([turns, shifts, R @ r], axis=2)[:, place]
        sigma = _noise(left, len(names), reach)
        return W / sigma, left / sigma, np.append(np.zeros(6), a_0 - tracker.a)

    def moved(tracker: Tracker, step: np.ndarray) -> Tracker:
        placement = tracker.placement
        R, t = pin.exp3(step[:3]) @ placement.rotation, placement.translation + step[3:6]
        return Tracker(pin.SE3(R, t), tracker.a + step[6:])

    best = gauss_newton(rows, moved, start, known)
    W, r_n, off = rows(best)
    estimate = np.concatenate(
        [pin.log3(best.placement.rotation), best.placement.translation, best.a]
    )
    found = Information.of_rows(names, estimate, W, r_n, prior=known, off=off)
    left = residual(best)
    column = -(rate @ best.placement.rotation.T)[:, place] / _noise(left, len(names), reach)
    return best, left, found, found.beside(W, r_n, column)


def check_axes(B: np.ndarray, p: np.ndarray, x: np.ndarray, motion: float) -> None:
    """Refuse frames whose rotation block B (m_p, 3) shows another unit or another handedness."""
    size = _rms(x - x.mean(axis=0)) / motion * math.sqrt(x.shape[1] / 3.0)
    if size < _STILL:
        raise LogError(
            f"x does not move with the arm: by {1e3 * size * motion:.2g} mm (rms), where the arm "
            f"moves its frame by {1e3 * motion:.2g} mm.",
            hint="Does the tracker run, or repeat its last frame? Is the marker on the last body?",
        )
    if abs(math.log(size)) > _SCALE:
        raise LogError(
            f"the frames move {size:.3g} times as far as the arm."
            f"{' In millimetres?' if 300.0 < size < 3000.0 else ''}",
            hint="Give x in metres, of a point that is fixed to the last body.",
        )
    if len(B) == 3 and np.linalg.det(B) < _MIRRORED:
        raise LogError(
            "the axes of the tracker are left-handed: only a mirror explains the frames.",
            hint="Change the sign of one coordinate of x.",
        )


def _noise(residual: np.ndarray, parameters: int, reach: float) -> float:
    """Return the standard deviation of the noise that leaves a residual (N, m_p) [m]."""
    variance = float(np.sum(residual**2)) / max(1, residual.size - parameters)
    return max(math.sqrt(variance), _LEAST_NOISE * reach)


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
