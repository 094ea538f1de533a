"""Least-squares fits of torques and positions in a log.

Torques. The equations of motion are averaged over windows phi(t), with the momentum p = Y_M a + p_0
integrated by parts (Shinbrot 1957), so that they need no accelerations:

    int phi tau dt = int (phi (Y_0 a + tau_0) - phi' (Y_M a + p_0)) dt.

Each window is one row W a = y for each joint. ``torque_fit`` solves the equations of all windows in
the physical cone.

Positions. The position of the task frame is linear in the unknown translations. ``position_fit``
solves for all of them with the description as a weak prior.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..exceptions import LogError, ParameterError
from ..information.information import Information
from ..information.measured_motion import Averages, MeasuredMotion
from ..information.payload import PayloadEstimate, payload_of
from ..logs.log import Log
from ..models.dynamics import Dynamics
from ..models.physical_fit import GAMMA, PhysicalSet, physical_fit
from ..models.regressor import LABELS, PER_BODY, Momentum
from ..models.task_kinematics import TaskKinematics
from ..robot.robot import Robot

# Of the description, relative to one row of noise: a third and three times of it change no held-out
# error of the real logs by 3 %. Without rows to outweigh it the description is kept.
WEIGHT = 1.0
_ROUNDS = 3  # in which the noise is found
_TORQUE_NOISE, _LEAST_TORQUE_NOISE = 0.05, 1e-4  # first and least, share of a joint's torque
_POSITION_NOISE, _LEAST_POSITION_NOISE = 1e-2, 1e-9  # first and least, share of the reach
_PRIOR = 0.5  # of the reach: standard deviation of a described translation
_LEAST_WEIGHT = 1e-6
_TINY = 1e-300
_POSITION, _POSE = 3, 7  # coordinates
_BALL = 0.05  # of the robot's mass and reach: mass and radius of gyration of a likely load
_FREE = 1e-2  # weight of that, relative to the description of a body
_FARTHEST = 4.0  # of the reach, farther than any frame of the robot moves


def torque_fit(
    dynamics: Dynamics,
    physical: PhysicalSet,
    windows: Windows,
    gamma: float = GAMMA,
    blocks: Sequence[np.ndarray] = (),
) -> Information:
    """Return the physical least-squares estimate of all dynamic parameters with its information.

    The noise of a joint is the residual of its torque, found in rounds. Windows overlap, and errors
    of the model last longer than one of them: in the end the variance of a joint is multiplied by
    the sum of the residual's autocorrelation, as its rows are not independent.

    Args:
        dynamics: of the parameters.
        physical: the set of physical ones.
        windows: the rows.
        gamma: weight of the description.
        blocks: of windows that are left out in turn, for the ``spread`` of the estimate; an error
            of the model that some of them show and others do not shows in it. By default none.
    """
    return _fitted(tuple(dynamics.names), physical, windows, gamma, blocks)


def _fitted(
    names: tuple[str, ...],
    physical: PhysicalSet,
    windows: Windows,
    gamma: float,
    blocks: Sequence[np.ndarray],
) -> Information:
    """Return the physical least-squares estimate of parameters with these names."""
    noise, least = noise_levels(windows.tau)
    a, rows = physical.center, windows.y.size
    fitted: np.ndarray | None = None  # the noise at which a is the fit
    if not names:
        return Information((), a, np.zeros((0, 0)), a, noise, rows)
    physical = weighted(physical, windows)
    for last in (*(False,) * _ROUNDS, True):
        if fitted is None or not np.array_equal(noise, fitted):
            A, b = _whitened(windows.W, windows.y, noise)
            near = None if fitted is None else a
            a, fitted = physical_fit(A, b, physical, gamma=gamma, near=near), noise
            residual = windows.residual(a)
            rank = min(np.linalg.matrix_rank(A, tol=1e-8 * np.linalg.norm(A)), rows - 1)
        deviation = np.sqrt(np.mean(residual**2, axis=0) / (1.0 - rank / rows))
        if last:
            deviation *= np.sqrt(_repetition(residual))
        noise = np.maximum(deviation, least)
    assert fitted is not None  # set in the first round
    spread = jackknife(physical, windows, fitted, gamma, blocks, a) if blocks else None
    found = Information.of_rows(names, a, windows.W, windows.residual(a), noise)
    return replace(found, spread=spread)


def jackknife(
    physical: PhysicalSet,
    windows: Windows,
    noise: np.ndarray,
    gamma: float,
    blocks: Sequence[np.ndarray],
    a: np.ndarray,
) -> np.ndarray:
    """Return the spread (B, p) of estimates without one of B blocks of windows each.

    Its squares sum to the jackknife's variance, (B - 1) / B sum_b (a_b - mean)^2, times the squared
    ratio of the two-sided 95 % points of Student's distribution with B - 1 degrees of freedom and
    of the normal one, as the variance is itself estimated from B numbers. ``a`` (p) is the estimate
    with all windows.
    """
    from scipy.special import stdtrit  # here, because scipy is slow to import

    p = windows.W.shape[2]
    A = np.concatenate([windows.W, windows.y[:, :, None]], axis=2) / noise[:, None]
    roots = [root_of(A[block].reshape(-1, p + 1)) for block in blocks]
    found = np.empty((len(blocks), p))
    for b in range(len(blocks)):
        rows = np.vstack([root for k, root in enumerate(roots) if k != b])
        found[b] = physical_fit(rows[:, :-1], rows[:, -1], physical, gamma=gamma, near=a)
    few = float(stdtrit(len(blocks) - 1, 0.975)) / 1.96
    share = np.sqrt((len(blocks) - 1) / len(blocks))
    return np.asarray(few * share * (found - found.mean(axis=0)))


def root_of(rows: np.ndarray) -> np.ndarray:
    """Return at most p + 1 rows with the same sums of squares as rows (N, p + 1)."""
    return np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > rows.shape[1] else rows


def load_fit(
    dynamics: Dynamics,
    physical: PhysicalSet,
    both: tuple[Windows, Windows],
    robot: Robot,
    gamma: float,
    blocks: tuple[Sequence[np.ndarray], Sequence[np.ndarray]],
) -> PayloadEstimate:
    """Return the load that an arm carries in one log and not in another.

    Bodies of the arm and effects of its joints are common to both logs, so that what is wrong with
    their model, and their friction, cancels as far as both motions show it.

    Args:
        dynamics: of the arm, its last body among them.
        physical: the set of its physical parameters.
        both: windows of the log with the load, and of that without.
        robot: as described, with its task frame.
        gamma: weight of the description.
        blocks: of windows of both logs, left out in turn for the uncertainty.

    Raises:
        ParameterError: the last body is not among the parameters.
    """
    size, n = dynamics.inertial.size, robot.model.nv
    if not dynamics.per_body or n - 1 not in dynamics.bodies:
        raise ParameterError(
            "the last body is not among the parameters, so there is no estimate of a load.",
            where="empty",
        )
    last, loaded = slice(size - PER_BODY, size), [1.0, 0.0]
    W = [
        np.concatenate([w.W[:, :, :size], share * w.W[:, :, last], w.W[:, :, size:]], axis=2)
        for w, share in zip(both, loaded, strict=True)
    ]
    y, tau = (np.concatenate([getattr(w, part) for w in both]) for part in ("y", "tau"))
    windows = Windows(np.arange(float(len(y))), np.concatenate(W), y, tau, both[0].length)
    shift = len(both[0].t)
    turns = [np.concatenate([one, other + shift]) for one, other in zip(*blocks, strict=False)]
    ball = pin.Inertia(
        _BALL * robot.mass,
        robot.model.frames[robot.frame_id].placement.translation,
        _BALL * robot.mass * (_BALL * robot.reach) ** 2 * np.eye(3),
    )
    start = np.insert(physical.center, size, ball.toDynamicParameters())
    weights = np.append(np.ones(physical.bodies), _FREE)
    whole = replace(physical, bodies=physical.bodies + 1, center=start, body_weights=weights)
    names = list(dynamics.names)
    names[size:size] = [f"load.{label}" for label in LABELS]
    found = _fitted(tuple(names), whole, windows, gamma, turns)
    return payload_of(found, slice(size, size + PER_BODY), robot)


def noise_levels(tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what noise (n) torques (N, n) are first assumed to have, and the least that counts."""
    level = np.sqrt(np.mean(tau**2, axis=0)) if len(tau) else np.zeros(tau.shape[1])
    level = np.maximum(level, 1e-12 * max(level.max(initial=0.0), _TINY))
    return _TORQUE_NOISE * level, _LEAST_TORQUE_NOISE * level


def weighted(physical: PhysicalSet, windows: Windows) -> PhysicalSet:
    """Return the set with weights w: coefficients over those that explain all of a joint's torque.

    They are at most one.
    """
    last = windows.W.shape[2] - physical.scales.size
    columns = windows.W[:, :, PER_BODY * physical.bodies : last]
    joints = np.argmax(np.abs(columns).sum(axis=0), axis=0)  # each acts on one
    effects = np.array([np.linalg.norm(columns[:, j, k]) for k, j in enumerate(joints)])
    whole = np.linalg.norm(windows.tau, axis=0)[joints]
    shares = physical.coefficients(physical.center) * effects / np.maximum(whole, _TINY)
    return replace(physical, weights=np.clip(shares, _LEAST_WEIGHT, 1.0))


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
    reach, names = kinematics.robot.reach, kinematics.names
    noise, step = np.full(kinematics.positions, _POSITION_NOISE * reach), np.zeros(len(names))
    for _ in range(_ROUNDS if len(rows.t) else 0):
        prior = 1.0 / (_PRIOR * reach) ** 2
        step = Information.of_rows(names, step, rows.W, rows.r, noise, prior).solution
        deviation = np.sqrt(np.mean((rows.r - rows.W @ step) ** 2, axis=0))
        noise = np.maximum(deviation, _LEAST_POSITION_NOISE * reach)
    left = rows.r - rows.W @ step
    return Information.of_rows(names, kinematics.initial + step, rows.W, left, noise)


def _whitened(W: np.ndarray, y: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (N n, p) and right-hand side (N n) in units of the noise (n)."""
    return (W / noise[:, None]).reshape(y.size, W.shape[-1]), (y / noise).ravel()


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


def windows_of(
    motion: MeasuredMotion,
    dynamics: Dynamics,
    period: float,
    *,
    held: bool,
    inertial: Windows | None = None,
) -> Windows:
    """Return the windows of a motion that have no gap.

    Args:
        motion: the samples.
        dynamics: of the unknown parameters.
        period: typical time between samples [s].
        held: whether torques were held from each sample to the next; else each is of its instant.
        inertial: the windows of its inertial block alone, if they are known already.
    """
    averages = Averages(motion.t, period)
    whole, t = averages.whole, averages.t[averages.whole]
    if inertial is None:
        W, y = _equations(motion, averages, dynamics.momentum, dynamics.size)
        if held:
            tau = _held_torques(motion, averages.t, averages.length)
        else:
            tau = averages.mean(motion.tau)
        return Windows(t, W[whole], (tau - y)[whole], tau[whole], averages.length)
    joints = dynamics.joints
    if joints is None:
        return inertial
    W, y = _equations(motion, averages, joints.momentum, joints.size)
    both = np.concatenate([inertial.W, W[whole]], axis=2)
    return inertial._replace(W=both, y=inertial.y - y[whole])


def _equations(
    motion: MeasuredMotion,
    averages: Averages,
    momentum: Callable[[np.ndarray, np.ndarray], Momentum],
    size: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return W (K, n, p), p = ``size``, and the averages (K, n) of the known part of the torque."""
    K, n = len(averages.t), motion.v.shape[1]
    W, known = np.zeros((K, n, size)), np.zeros((K, n))
    for part, near, phi, rate in averages.chunks:
        count = part.stop - part.start
        moving, rest = np.empty((2, count, n, size + 1))
        for k in range(count):
            Y_M, Y_0, p_0, tau_0 = momentum(motion.q[part.start + k], motion.v[part.start + k])
            moving[k, :, :size], moving[k, :, size] = Y_M, p_0
            rest[k, :, :size], rest[k, :, size] = Y_0, tau_0
        both = np.tensordot(phi, rest, axes=1) - np.tensordot(rate, moving, axes=1)
        W[near] += both[:, :, :size]
        known[near] += both[:, :, size]
    return W, known


def _integral(s: np.ndarray, length: float) -> np.ndarray:
    """Return int phi from the left end of a window to times s from its middle, zero to one."""
    angle = np.pi * np.clip(s, -0.5 * length, 0.5 * length) / length
    whole = 3.0 * angle + 2.0 * np.sin(2.0 * angle) + 0.25 * np.sin(4.0 * angle)
    return np.asarray(0.5 + whole / (3.0 * np.pi))


def _held_torques(motion: MeasuredMotion, middles: np.ndarray, length: float) -> np.ndarray:
    """Return int phi tau dt (N, n) of torques that are held from each sample to the next."""
    found = np.zeros((len(middles), motion.tau.shape[1]))
    for k, middle in enumerate(middles):
        first, last = np.searchsorted(motion.t, (middle - 0.5 * length, middle + 0.5 * length))
        part = slice(max(first - 1, 0), last + 1)
        weights = np.diff(_integral(motion.t[part] - middle, length))
        found[k] = weights @ motion.tau[part][: len(weights)]
    return found
