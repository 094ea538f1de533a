"""Where a tracker stands: its axes against the robot's base, from measured motion and positions.

Hand-eye calibration with an unknown tool: R_c, t_c and the unknown translations a minimise

    sum over frames of |x - R_c (p(q) + sum_i (a_i - a_0i) r_i(q)) - t_c|^2,

by Gauss-Newton on the information about the lumped parameters, in which x is linear, from the
nearest rotation to their least-squares estimate (``TrackerKinematics.explaining_tracker``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np
import pinocchio as pin

from .._checks import instance
from .._output import Printed, Report, Table
from ..exceptions import LogError
from ..models.camera_kinematics import CameraKinematics
from ..models.projected_kinematics import OFF
from ..models.task_kinematics import TaskKinematics
from ..models.tracker_kinematics import Tracker, TrackerKinematics
from ..records import Measurement
from .information import (
    CERTAIN,
    Information,
    estimate_table,
    frames,
    gauss_newton,
    lateness,
    spread,
)

# Half and twice of each of these: the same trackers, and the same mistakes of frames named.
LEAST_WAY = 2e-3  # of the reach: rms motion of the frame that shows anything
LEAST_NOISE = 1e-6  # of the reach, and [rad]
_SCALE = 0.7  # logarithm by which the size of a motion may differ
_WORST = 0.05  # rms residual over rms motion, from which no tracker explains the frames
_LATE = 0.02  # [s]: axes that are off by 2 degrees look like frames that are late by up to 0.01 s


@dataclass(frozen=True, eq=False, repr=False)
class FoundTracker(Printed):
    """A tracker found from frames; ``print`` shows a table.

    Attributes:
        tracker: placement of the base in the tracker's axes, and the translations.
        a_k: (p) the same as parameters of ``TrackerKinematics``, to start a controller from.
        information: (p, p) rows of the information of the frames on these, as ``information_k`` of
            ``Controller.init``.
        deviations: (6 + k) standard deviations: of the rotation vector [rad] and position [m] of
            the base in the tracker's axes, and of the translations [m].
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

    @property
    def start(self) -> dict[str, np.ndarray]:
        """``a_k`` and ``information_k`` for ``simulate(..., start=...)`` or ``Controller.init``."""
        return {"a_k": self.a_k, "information_k": self.information}

    def report(self) -> Report:
        """Return the table."""
        placement = self.tracker.placement
        values = np.concatenate(
            [pin.log3(placement.rotation), placement.translation, self.tracker.a]
        )
        units = [*["rad"] * 3, *["m"] * (len(values) - 3)]
        summary = [
            ("frames", self.frames),
            ("rms residual", f"{self.noise:.3g} m"),
            ("not identified by this motion", ", ".join(self.unseen) or "-"),
        ]
        return Report(
            "tracker",
            [Table(summary), estimate_table(self.names, values, self.deviations, units)],
        )


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
            "no tracker is unknown.",
            where="kinematics",
            hint="Make the controller with unknown=pa.Unknown(tracker=True).",
        )
    own = kinematics
    reach = own.robot.reach
    a = own.initial
    seen = _Seen(own, samples)
    x = seen.x
    motion = spread(seen.p)
    X, left, _ = seen.rows(a)
    y = left + X @ a  # x is linear in the parameters, so X and y do not depend on these
    shape = (x.shape[1], -1)
    lumped = a.copy()
    lumped.reshape(shape)[:, :-1] = 0.0  # of which only the sizes are known beforehand
    prior = (LEAST_NOISE * reach / own.sizes) ** 2 * len(x)
    found = Information.of_rows(own.names, lumped, X, y - X @ lumped, prior=prior)
    lumped = found.refined().estimate
    B = lumped.reshape(shape)[:, :3]
    check_size(x, motion)
    tracker = own.tracker(lumped)
    W = X.reshape(-1, a.size)
    placed = [f"{word} {axis}" for word in ("rotation", "base") for axis in "xyz"]
    names = (*placed, *own.columns.names)
    for _ in range(4):  # in which the noise is found
        sigma = seen.noise(y - X @ own.parameters(tracker), len(names))
        both = W.T @ W / sigma**2, W.T @ y.ravel() / sigma**2
        tracker, told = own.explaining_tracker(*both, tracker)
    a = own.parameters(tracker)
    seen.check(y - X @ a, sigma, motion, len(B) == 3 and np.linalg.det(B) < 0.0)
    known = np.repeat([1.0, reach, OFF * reach], [3, 3, len(tracker.a)])
    prior = np.append(np.zeros(6), known[6:] ** -2)
    slopes = own.slopes(tracker)
    slopes[:, :3] @= pin.Jexp3(-pin.log3(tracker.placement.rotation))  # by the rotation vector
    deviations = Information.of_rows(names, known, X @ slopes, 0.0 * x, sigma, prior).deviations
    return FoundTracker(
        tracker,
        a,
        np.linalg.cholesky(own.information(tracker, told)).T,
        deviations,
        names,
        sigma,
        len(x),
        tuple(compress(names, deviations / known > 0.9)),
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
    own: CameraKinematics = instance(kinematics, CameraKinematics, "kinematics", LogError)
    seen = _Seen(own, samples)
    motion = spread(seen.x)
    size = motion / spread(seen.p)
    if size > 10.0:
        raise LogError(
            f"the picture moves {size:.3g} times as far as the arm. In pixels?",
            hint=f"Multiply x by about {1.0 / size:.2g}, the length that one covers at the arm.",
        )
    a_0 = own.standing_at(seen.x[0])
    known = 1.0 / own.sizes**2
    a = a_0.copy()

    def rows() -> tuple[float, list[np.ndarray]]:
        """Return the noise at a, and slopes, residuals and rates in units of it."""
        parts = seen.rows(a)
        sigma = seen.noise(parts[1], len(a))
        return sigma, [part / sigma for part in parts]

    gauss_newton(lambda: (*rows()[1][:2], a_0 - a), lambda step: np.add(a, step, out=a), known)
    sigma, (W, left, rate) = rows()
    seen.check(left, sigma, motion)
    late, deviation = lateness(W, left, rate, 1.0, known, a_0 - a)
    if abs(late) > max(_LATE, CERTAIN * deviation):
        raise LogError(
            "the frames have another clock than q: frames taken about "
            f"{1e3 * late:.2g} ms before their time stamps would explain them.",
            hint="x_time is when a picture was taken, on the clock of q.",
        )
    return Information.of_rows(own.names, a, W, 0.0 * left, prior=known)


class _Seen:
    """N frames of a motion.

    Attributes:
        kinematics: of the task.
        q, v: (N, nq), (N, nv) configurations and velocities when they were taken.
        x: (N, m_p) measured positions.
        p: (N, 3) described positions in the axes of the base [m].
    """

    def __init__(
        self, kinematics: TrackerKinematics | CameraKinematics, samples: Sequence[Measurement]
    ) -> None:
        """Take the frames of measurements.

        Raises:
            LogError: fewer than four, or they hardly move.
        """
        robot = kinematics.robot
        self.kinematics = kinematics
        self.q, self.v, self.x = frames(kinematics, samples)
        self.p = np.array([robot.placement(q).translation for q in self.q]).reshape(-1, 3)
        moved = min(spread(part) if len(part) else 0.0 for part in (self.p, self.x))
        if len(self.p) < 4 or moved < LEAST_WAY * robot.reach:
            raise LogError(
                f"{len(self.p)} frames of a motion of {moved:.2g} (rms) do not show the camera or "
                "tracker.",
                hint="Move every joint, such that the frame moves by some hundredths of the reach, "
                "and x with it: does the tracker or camera run, or repeat its last frame?",
            )

    def rows(self, a: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return slopes (N, m_p, p), residuals and rates (N, m_p) at parameters a (p)."""
        kept = []
        for q, v, y in zip(self.q, self.v, self.x, strict=True):
            self.kinematics.update(a, q, v)
            rate = self.kinematics.xd_hat[: len(y)]
            kept.append((self.kinematics.X_k, y - self.kinematics.p_hat, rate))
        return tuple(map(np.array, zip(*kept, strict=True)))

    def noise(self, residual: np.ndarray, parameters: int) -> float:
        """Return the standard deviation of the noise that leaves a residual (N, m_p) [m]."""
        variance = np.sum(residual**2) / max(1, residual.size - parameters)
        return max(math.sqrt(variance), LEAST_NOISE * self.kinematics.robot.reach)

    def check(self, left: np.ndarray, sigma: float, motion: float, mirrored: bool = False) -> None:
        """Refuse frames of which something else than noise is left (N, m_p), in any unit.

        What a tracker cannot explain changes with the motion; noise changes from frame to frame.
        Frames that are nearer to a mirror's may then be mirrored.

        Raises:
            LogError: too much is left.
        """
        size = np.vdot(left, left)
        alike = np.vdot(left[1:], left[:-1])
        if sigma * math.sqrt(max(alike, 0.0) / size if size else 0.0) <= _WORST * motion:
            return
        if mirrored:
            raise left_handed()
        raise LogError(
            f"no camera or tracker explains these frames: they are off by {sigma:.3g} (rms) in a "
            f"motion of {motion:.3g}.",
            hint="Is x of this frame, of this robot, and timed on the clock of q?",
        )


def check_size(x: np.ndarray, motion: float) -> None:
    """Refuse frames x (N, m_p) of a motion of this size in another unit.

    Raises:
        LogError: they are.
    """
    size = spread(x) / motion * math.sqrt(x.shape[1] / 3.0)
    if abs(math.log(max(size, LEAST_NOISE))) > _SCALE:
        raise LogError(
            f"the frames move {size:.3g} times as far as the arm. In millimetres, or frozen?",
            hint="Give x in metres, of a point that is fixed to the last body.",
        )


def left_handed() -> LogError:
    """Return the error of frames that only a mirror explains."""
    return LogError(
        "the axes of the tracker are left-handed: only a mirror explains the frames.",
        hint="Change the sign of one coordinate of x.",
    )
