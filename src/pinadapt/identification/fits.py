"""Least-squares fits of torques and positions in a log.

Torques. The equations of motion are averaged over overlapping windows phi(t), with the momentum
p = Y_M a + p_0 integrated by parts, so that no acceleration is needed:

    int phi tau dt = int (phi (Y_0 a + tau_0) - phi' (Y_M a + p_0)) dt.

Each window is one row W a = y for each joint. ``torque_fit`` solves them in the physical cone.

Positions. The position of the task frame is linear in the unknown translations. ``position_fit``
solves for all of them with the description as a weak prior.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..exceptions import LogError
from ..information.information import Information
from ..information.measured_motion import MeasuredMotion
from ..logs.log import Log
from ..models.dynamics import Dynamics
from ..models.physical_fit import PhysicalSet, physical_fit
from ..models.regressor import PER_BODY
from ..models.task_kinematics import TaskKinematics
from ..robot.robot import Robot

LENGTH = 0.2  # [s] of a window, which is at half (-6 dB) at 6.5 Hz
CUTOFF = 15.0  # [Hz] for noisy positions, above the band of a window
_FEWEST = 16  # samples in a window, which is longer for a log of a lower rate
_OVERLAP = 3  # windows at any time
_GAP = 8  # the longest gap between two samples in a window, as so many parts of its length
_ROUNDS = 3  # in which the noise is found
_TORQUE_NOISE, _LEAST_TORQUE_NOISE = 0.05, 1e-4  # first and least, share of a joint's torque
_POSITION_NOISE, _LEAST_POSITION_NOISE = 1e-2, 1e-9  # first and least, share of the reach
_PRIOR = 0.5  # of the reach: standard deviation of a described translation
_LEAST_WEIGHT = 1e-6
_TINY = 1e-300
_POSITION, _POSE = 3, 7  # coordinates
_FARTHEST = 4.0  # of the reach, farther than any frame of the robot moves


class Windows(NamedTuple):
    """Averages over N windows of a motion.

    Attributes:
        t: (N) times of their middles [s].
        W: (N, n, p) regressor.
        y: (N, n) torque without its known part [N m or N].
        tau: (N, n) torque [N m or N].
        length: of a window [s].
    """

    t: np.ndarray
    W: np.ndarray
    y: np.ndarray
    tau: np.ndarray
    length: float

    def between(self, first: float, last: float) -> Windows:
        """Return the windows that lie wholly between two times [s]."""
        half = 0.5 * self.length
        kept = (self.t - half >= first) & (self.t + half <= last)
        return Windows(self.t[kept], self.W[kept], self.y[kept], self.tau[kept], self.length)

    def residual(self, a: np.ndarray) -> np.ndarray:
        """Return y - W a (N, n) [N m or N] at parameters a (p)."""
        return np.asarray(self.y - self.W @ a)


def windows_of(motion: MeasuredMotion, dynamics: Dynamics, period: float, *, held: bool) -> Windows:
    """Return the windows of a motion that have no gap.

    Args:
        motion: the samples.
        dynamics: of the unknown parameters.
        period: typical time between samples [s].
        held: whether torques were held from each sample to the next; else each is of its instant.
    """
    t, p, n = motion.t, dynamics.size, motion.v.shape[1]
    length = max(LENGTH, _FEWEST * period)
    count = max(int(np.floor((t[-1] - t[0]) / length * _OVERLAP)) - _OVERLAP + 1, 0)
    middles = t[0] + 0.5 * length + np.arange(count) * length / _OVERLAP
    weights = _trapezoids(t)
    W, y, tau = np.zeros((count, n, p)), np.zeros((count, n)), np.zeros((count, n))
    for k in range(t.size):
        near = np.flatnonzero(np.abs(t[k] - middles) < 0.5 * length)
        if not near.size:
            continue
        Y_M, Y_0, p_0, tau_0 = dynamics.momentum(motion.q[k], motion.v[k])
        for window in near:
            phi, rate = _window(t[k] - middles[window], length)
            phi, rate = phi * weights[k], rate * weights[k]
            W[window] += phi * Y_0
            W[window] -= rate * Y_M
            y[window] += rate * p_0 - phi * tau_0
            tau[window] += phi * motion.tau[k]
    if held:
        tau = _held_torques(motion, middles, length)
    whole = _without_gap(t, middles, length)
    return Windows(middles[whole], W[whole], (y + tau)[whole], tau[whole], length)


def _window(s: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return phi = 8 / (3 L) cos^4(pi s / L) of integral one, and phi', at times s from its middle.

    Its first three derivatives vanish at the ends, so that sums are integrals to the fourth power
    of the period.
    """
    angle = np.pi * s / length
    height = 8.0 / (3.0 * length)
    cos = np.cos(angle)
    return height * cos**4, -4.0 * height * np.pi / length * cos**3 * np.sin(angle)


def _integral(s: np.ndarray, length: float) -> np.ndarray:
    """Return int phi from the left end of a window to times s from its middle, zero to one."""
    angle = np.pi * np.clip(s, -0.5 * length, 0.5 * length) / length
    whole = 3.0 * angle + 2.0 * np.sin(2.0 * angle) + 0.25 * np.sin(4.0 * angle)
    return np.asarray(0.5 + whole / (3.0 * np.pi))


def _trapezoids(t: np.ndarray) -> np.ndarray:
    """Return the weight (N) [s] of each sample in an integral by trapezoids."""
    steps = np.diff(t)
    return 0.5 * (np.append(steps, 0.0) + np.insert(steps, 0, 0.0))


def _held_torques(motion: MeasuredMotion, middles: np.ndarray, length: float) -> np.ndarray:
    """Return int phi tau dt (N, n) of torques that are held from each sample to the next."""
    found = np.zeros((len(middles), motion.tau.shape[1]))
    for k, middle in enumerate(middles):
        first, last = np.searchsorted(motion.t, (middle - 0.5 * length, middle + 0.5 * length))
        part = slice(max(first - 1, 0), last + 1)
        weights = np.diff(_integral(motion.t[part] - middle, length))
        found[k] = weights @ motion.tau[part][: len(weights)]
    return found


def _without_gap(t: np.ndarray, middles: np.ndarray, length: float) -> np.ndarray:
    """Tell of each window whether no two successive samples in it are too far apart."""
    gaps = np.flatnonzero(np.diff(t) > length / _GAP)
    starts, ends = t[gaps], t[gaps + 1]
    hit = (starts < middles[:, None] + 0.5 * length) & (ends > middles[:, None] - 0.5 * length)
    return np.asarray(~hit.any(axis=1))


def torque_fit(dynamics: Dynamics, physical: PhysicalSet, windows: Windows) -> Information:
    """Return the physical least-squares estimate of all dynamic parameters with its information.

    The noise of a joint is the residual of its torque, found in rounds. Windows overlap, and errors
    of the model last longer than one of them: in the end the variance of a joint is multiplied by
    the sum of the residual's autocorrelation, as its rows are not independent.
    """
    level = np.sqrt(np.mean(windows.tau**2, axis=0)) if len(windows.t) else np.zeros(0)
    level = np.maximum(level, 1e-12 * max(level.max(initial=0.0), _TINY))
    noise, a, rows = _TORQUE_NOISE * level, physical.center, windows.y.size
    fitted: np.ndarray | None = None  # the noise at which a is the fit
    if not dynamics.size:
        return Information((), a, np.zeros((0, 0)), a, level, rows)
    physical = replace(physical, weights=_weights(physical, windows))
    for last in (*(False,) * _ROUNDS, True):
        if fitted is None or not np.array_equal(noise, fitted):
            A, b = _whitened(windows.W, windows.y, noise)
            a, fitted = physical_fit(A, b, physical), noise
            residual = windows.residual(a)
            rank = min(np.linalg.matrix_rank(A, tol=1e-8 * np.linalg.norm(A)), rows - 1)
        deviation = np.sqrt(np.mean(residual**2, axis=0) / (1.0 - rank / rows))
        if last:
            deviation *= np.sqrt(_repetition(residual))
        noise = np.maximum(deviation, _LEAST_TORQUE_NOISE * level)
    A, b = _whitened(windows.W, windows.y, noise)
    score = A.T @ (b - A @ a)
    return Information(tuple(dynamics.names), a, A.T @ A, score, noise, rows)


def _weights(physical: PhysicalSet, windows: Windows) -> np.ndarray:
    """Return w: coefficients over those that would explain all of a joint's torque, at most one."""
    columns = windows.W[:, :, PER_BODY * physical.bodies :]
    joints = np.argmax(np.abs(columns).sum(axis=0), axis=0)  # each acts on one
    effects = np.array([np.linalg.norm(columns[:, j, k]) for k, j in enumerate(joints)])
    whole = np.linalg.norm(windows.tau, axis=0)[joints]
    shares = physical.coefficients(physical.center) * effects / np.maximum(whole, _TINY)
    return np.asarray(np.clip(shares, _LEAST_WEIGHT, 1.0))


def _repetition(residual: np.ndarray) -> np.ndarray:
    """Return how many rows (n) of a residual (N, n) are worth one independent row.

    One plus twice the autocorrelation up to where it first is negative (Geyer's initial sequence).
    """
    found = np.ones(residual.shape[1])
    for j, column in enumerate((residual - residual.mean(axis=0)).T):
        size = float(column @ column)
        for lag in range(1, len(column) // 2):
            correlation = float(column[lag:] @ column[:-lag]) / size if size else 0.0
            if correlation <= 0.0:
                break
            found[j] += 2.0 * correlation
    return found


class Frames(NamedTuple):
    """M positions or poses of the task frame, from a camera or tracker.

    Attributes:
        t: (M) when they were taken [s], ascending.
        x: (M, m) coordinates of the task.
    """

    t: np.ndarray
    x: np.ndarray


def frames_of(log: Log, robot: Robot) -> Frames:
    """Return the frames of a log in the coordinates of a robot's task; none where it has none.

    Raises:
        LogError: coordinates that the task does not have, or further apart than it can move.
    """
    t, x = log.frames()
    if not len(t):
        return Frames(np.zeros(0), np.zeros((0, robot.task.coordinates)))
    wanted, got = robot.task.coordinates, x.shape[1]
    if got != wanted and wanted <= _POSITION and got in (_POSITION, _POSE):
        x = x[:, :_POSITION][:, robot.frame_task.place]
    elif got != wanted:
        raise LogError(
            f"{got} coordinates, and the task '{robot.task.name}' has {wanted}.",
            where=f"{log.source}: x",
            hint="Positions are x, y, z in world axes, poses x, y, z, qx, qy, qz, qw; a robot is "
            'loaded with task = "xyz" or "pose".',
        )
    span = float(np.ptp(x[:, : robot.task.positions], axis=0).max(initial=0.0))
    if span > _FARTHEST * robot.reach:
        raise LogError(
            f"the frame moves by {span:.4g} m, and the robot reaches {robot.reach:.3g} m.",
            where=f"{log.source}: x",
            hint="Positions are in metres. In millimetres? A tracker's lost frames are NaN, not 0.",
        )
    order = np.argsort(t, kind="stable")
    return Frames(t[order], x[order])


class PositionRows(NamedTuple):
    """The equations of M frames, r = W (a - a_0), with a_0 the described translations.

    Attributes:
        t: (M) times [s].
        W: (M, m, p) dx/da.
        r: (M, m) measured less described positions [m].
    """

    t: np.ndarray
    W: np.ndarray
    r: np.ndarray

    def split(self, t: float) -> tuple[PositionRows, PositionRows]:
        """Return the rows before a time [s], and those from it on."""
        first = self.t < t
        return tuple(  # type: ignore[return-value]
            PositionRows(self.t[part], self.W[part], self.r[part]) for part in (first, ~first)
        )


def position_rows(
    kinematics: TaskKinematics, motion: MeasuredMotion, frames: Frames
) -> PositionRows:
    """Return the rows of all frames within a motion, at the configuration of each one's time."""
    still, t, W, r = np.zeros(kinematics.nv), [], [], []
    m, p = kinematics.positions, kinematics.size
    for time, x in zip(frames.t, frames.x, strict=True):
        if not (p and motion.t[0] <= time <= motion.t[-1]):
            continue
        k = min(max(int(np.searchsorted(motion.t, time)) - 1, 0), len(motion.t) - 2)
        share = (time - motion.t[k]) / (motion.t[k + 1] - motion.t[k])
        q = kinematics.between(motion.q[k], motion.q[k + 1], float(share))
        kinematics.update(kinematics.initial, q, still)
        position, X_k = kinematics.p_hat, kinematics.X_k
        t.append(time)
        W.append(X_k)
        r.append(x[:m] - position)
    count = len(t)
    rows = np.array(W).reshape(count, m, p), np.array(r).reshape(count, m)
    return PositionRows(np.array(t), *rows)


def position_fit(kinematics: TaskKinematics, rows: PositionRows) -> Information:
    """Return the least-squares estimate of all translations with its information.

    The prior is the description, with a standard deviation of half the reach in every direction, so
    that no choice of axes matters. It decides only what the motion does not identify.
    """
    m, p, reach = kinematics.positions, kinematics.size, kinematics.robot.reach
    noise, step = np.full(m, _POSITION_NOISE * reach), np.zeros(p)
    prior = np.eye(p) / (_PRIOR * reach) ** 2
    for _ in range(_ROUNDS if len(rows.t) else 0):
        A, b = _whitened(rows.W, rows.r, noise)
        step = np.linalg.solve(A.T @ A + prior, A.T @ b)
        deviation = np.sqrt(np.mean((rows.r - rows.W @ step) ** 2, axis=0))
        noise = np.maximum(deviation, _LEAST_POSITION_NOISE * reach)
    A, b = _whitened(rows.W, rows.r, noise)
    score = A.T @ (b - A @ step)
    estimate = kinematics.initial + step
    return Information(tuple(kinematics.names), estimate, A.T @ A, score, noise, b.size)


def _whitened(W: np.ndarray, y: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (N n, p) and right-hand side (N n) in units of the noise (n)."""
    return (W / noise[:, None]).reshape(y.size, W.shape[-1]), (y / noise).ravel()
