"""Which parameters a motion identifies, and how well; how well estimates predict its torques.

Measured signals are linear in the unknown parameters a, y = W a + noise, with the covariance S of
the noise. Then H = W^T S^-1 W is the information matrix, its inverse the covariance of the
least-squares estimate, and its null space what the motion does not excite.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress
from typing import Any

import numpy as np

from .._checks import ROUNDING
from .._output import Printed, Report, Table
from ..controller.controller import Controller
from ..controller.first_samples import CERTAIN as CERTAIN
from ..controller.learned import AlongExcited
from ..controller.state import ControllerState, Sample
from ..models.dynamics import Dynamics
from ..models.excited import Excited, TorqueErrors, rms, scales
from ..models.physical_fit import square
from ..models.task_kinematics import TaskKinematics
from ..records import Measurement
from ..robot.constraints import repeated
from .measured_motion import at_times, evenly, motion_of_samples

# [s] over which rows of the torque are averaged, so that their noise is independent; half, twice: a
# load's mass 0.7 and 2 % other, its deviation 8 % smaller and 3 % larger; logs do not use it
BLOCK = 0.05
# share of the largest singular value up to which a direction was not excited, and share of a
# gradient that may lie along such directions; a hundredth, a hundred times: the same loads, logs
# and calibrations
_UNEXCITED = 1e-5
_OUTSIDE = 1e-3


@dataclass(frozen=True, eq=False)
class Information:
    """Information of rows of data on p parameters, linearised at an estimate of them.

    Attributes:
        names: of the parameters (p); perhaps not of the last ones, or of none.
        estimate: (p) at which the residuals were taken.
        R: (k, p) of the information matrix R^T R = W^T S^-1 W, in 1 / (parameter unit).
        c: (k) R d = c are the equations for the step d to the least-squares estimate.
    """

    names: tuple[str, ...]
    estimate: np.ndarray
    R: np.ndarray
    c: np.ndarray

    @classmethod
    def of_rows(
        cls,
        names: Sequence[str],
        estimate: np.ndarray,
        W: np.ndarray,
        r: np.ndarray,
        noise: np.ndarray | float = 1.0,
        prior: np.ndarray | float = 0.0,
        off: np.ndarray | float = 0.0,
    ) -> Information:
        """Return the information of rows W (N, n, p) with residuals r (N, n), and of a prior.

        Args:
            names: of the parameters.
            estimate: (p) of them.
            W: slopes of the signals.
            r: residuals at the estimate.
            noise: (n) of the signals.
            prior: (p) inverse variances of what was known before.
            off: (p) what was known before, less the estimate.
        """
        p = len(estimate)
        sizes = np.broadcast_to(noise, r.shape[1:])
        known = np.broadcast_to(np.sqrt(prior), p)
        rows = np.concatenate([(W / sizes[:, None]).reshape(r.size, p), np.diag(known)])
        return cls(tuple(names), estimate, *square(rows, np.append(r / sizes, known * off)))

    @cached_property
    def scale(self) -> np.ndarray:
        """Scale (p) of each parameter's effect; the largest one if it has no effect."""
        sizes = np.linalg.norm(self.R, axis=0)
        largest = sizes.max(initial=0.0) or 1.0
        return np.where(sizes > ROUNDING * largest, sizes, largest)

    @cached_property
    def _singular(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """U (k, r), singular values (r) and V (p, r) of R / scale in the excited directions."""
        U, s, V = np.linalg.svd(self.R / self.scale, full_matrices=False)
        r = np.count_nonzero(s > _UNEXCITED * s.max(initial=0.0))
        return U[:, :r], s[:r], V[:r].T

    @property
    def rank(self) -> int:
        """Number of identifiable combinations of the parameters."""
        return self._singular[1].size

    @cached_property
    def _root(self) -> np.ndarray:
        """L (p, r) of the covariance L L^T."""
        _, s, V = self._singular
        return V / s / self.scale[:, None]

    @property
    def correction(self) -> np.ndarray:
        """Step (p) from the estimate to the least-squares one, within the excited directions."""
        return self._root @ (self._singular[0].T @ self.c)

    def refined(self) -> Information:
        """Return the information at the least-squares estimate from all rows."""
        return replace(self, estimate=self.estimate + self.correction, c=0.0 * self.c)

    def marginalised(self, root: np.ndarray) -> Information:
        """Return the information if the parameters may also be off by L z, |z| normal of size one.

        It is R^T (1 + A A^T)^-1 R with A = R L, computed as a square of its own so that nothing
        cancels when the data are much better than what is known of L z.

        Args:
            root: L (p, k).
        """
        U, s, _ = np.linalg.svd(self.R @ root, full_matrices=False)
        less = (U * (1.0 - 1.0 / np.sqrt(1.0 + s**2))) @ U.T
        return replace(self, R=self.R - less @ self.R, c=self.c - less @ self.c)

    def marginal(self, count: int) -> Information:
        """Return the marginal information on the first parameters, whatever the others are."""
        U, _, _ = replace(self, R=self.R[:, count:])._singular
        R, c = (part - U @ (U.T @ part) for part in (self.R[:, :count], self.c))
        return Information(self.names[:count], self.estimate[:count], R, c)

    def deviation(self, gradient: np.ndarray) -> np.ndarray:
        """Return the uncertainty (k) of quantities whose gradients are the rows of (k, p).

        The root of variance plus squared correction; infinite for a quantity that changes along a
        direction that was not excited.
        """
        excited = self._singular[2]
        scaled = gradient / self.scale
        outside = np.linalg.norm(scaled - scaled @ excited @ excited.T, axis=1)
        variance = np.sum((gradient @ self._root) ** 2, axis=1)
        total = np.sqrt(variance + (gradient @ self.correction) ** 2)
        return np.where(outside <= _OUTSIDE * np.linalg.norm(scaled, axis=1), total, np.inf)

    @cached_property
    def deviations(self) -> np.ndarray:
        """Uncertainty (p) of each parameter's estimate; infinite where it is not identifiable."""
        return self.deviation(np.eye(len(self.estimate)))


def dynamic_information(
    dynamics: Dynamics,
    kinematics: TaskKinematics,
    samples: Sequence[Sample],
    a_d: np.ndarray,
    least_noise: float = ROUNDING,
) -> Information:
    """Return the information of measured motion and torque of a robot on dynamic parameters.

    Args:
        dynamics: of p parameters.
        kinematics: of the robot, with its constraints.
        samples: of a run, at a constant rate.
        a_d: (p) at which the residuals are taken.
        least_noise: of a torque, as a share of its mean size.
    """
    motion = motion_of_samples(kinematics.robot.model, samples)
    W, r, tau = _torque_rows(dynamics, kinematics, a_d, *motion[1:5])
    robot = kinematics.robot
    free, _ = robot.constrained.free(robot.q0, np.zeros(robot.model.nv))
    size = max(1, round(BLOCK / motion.period)) if motion.period else 1
    W, r = (
        part[: len(part) // size * size].reshape(-1, size, *part.shape[1:]).mean(axis=1)
        for part in (W, r)
    )
    level = np.abs(tau).sum(axis=0) / max(len(motion.t), 1)
    return fitted(dynamics.names, a_d, W, r, level, least_noise, repeated(free))


def _torque_rows(
    dynamics: Dynamics,
    kinematics: TaskKinematics,
    a_d: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    tau: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return slopes (N, n, p), residuals (N, n) at a_d (p) and the torques (N, n) of a motion.

    Under constraints they are what no constraint force changes, as nobody measures these.
    """
    dynamics.load(a_d)
    W = np.zeros((*tau.shape, dynamics.size))
    r = tau.copy()
    for k, state in enumerate(zip(q, v, a, strict=True)):
        W[k] = dynamics.regressor(*state)
        r[k] -= dynamics.torque(*state)
    if (constraints := kinematics.constraints) is None:
        return W, r, tau
    free = np.array([constraints.free(*state)[0] for state in zip(q, v, strict=True)])
    return free @ W, *(np.einsum("kij,kj->ki", free, part) for part in (r, tau))


def position_information(
    controller: Controller, samples: Sequence[Sample], state: ControllerState
) -> Information:
    """Return the information of measured frame positions on the kinematic parameters at a state.

    A late frame is compared with the configuration at the time when it was taken.
    """
    kinematics = controller.kinematics
    measurements = [sample.measurement for sample in samples]
    W, r = position_rows(kinematics, state.a_k, *frames(kinematics, measurements))
    return fitted(kinematics.names, state.a_k, W, r, kinematics.robot.reach)


def position_rows(
    kinematics: TaskKinematics, a_k: np.ndarray, q: np.ndarray, v: np.ndarray, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return slopes (M, m_p, p) and residuals (M, m_p) of measured frames at an estimate (p)."""
    m = kinematics.positions
    W = np.zeros((len(q), m, kinematics.size))
    r = np.zeros((len(q), m))
    for k, each in enumerate(x):
        kinematics.update(a_k, q[k], v[k])
        W[k], r[k] = kinematics.explaining(each[:m]), each[:m] - kinematics.p_hat
    return W, r


def measured_frames(measurements: Sequence[Measurement]) -> tuple[np.ndarray, np.ndarray]:
    """Return times (M) [s] and coordinates (M, m) of the frames in measurements that are finite."""
    seen = [one for one in measurements if one.x is not None and np.isfinite(one.x).all()]
    taken = [one.t if one.x_time is None else one.x_time for one in seen]
    return np.array(taken, dtype=float), np.array([one.x for one in seen], dtype=float)


def frames(
    kinematics: TaskKinematics, measurements: Sequence[Measurement]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return q (M, nq), v (M, nv) and the measured positions x (M, m_p) of the frames of a motion.

    Of a late frame q is that at ``x_time``, between two measurements.
    """
    taken, x = measured_frames(measurements)
    times, first = np.unique(taken, return_index=True)
    t, q = (np.array([getattr(one, part) for one in measurements]) for part in "tq")
    model = kinematics.robot.model
    kept, q, v = at_times(model, t, q.reshape(-1, model.nq), times)
    m = kinematics.positions
    return q, v, x[first][kept][:, :m] if len(x) else np.zeros((0, m))


def fitted(
    names: Sequence[str],
    a: np.ndarray,
    W: np.ndarray,
    r: np.ndarray,
    level: np.ndarray | float,
    least_noise: float = ROUNDING,
    repeats: float = 1.0,
) -> Information:
    """Return the information of rows W (N, n, p) with residuals r (N, n).

    The noise of each signal is its residual at the least-squares estimate, times ``repeats`` where
    signals are a projection, see ``repeated``. It is found in two rounds: signals are weighted by
    their ``level`` (n) in the first, by their noise in the second.
    """
    rounding = max(ROUNDING * np.max(level, initial=0.0), np.finfo(float).tiny)
    level = np.maximum(level, rounding)
    least = np.maximum(least_noise * level, rounding)
    found = Information.of_rows(names, a, W, r, level)
    for _ in range(2 if r.size else 0):
        free = max(r.size / repeats**2 - found.rank, 1.0) / r.size
        noise = np.maximum(rms(r - W @ found.correction, 0) / np.sqrt(free), least)
        found = Information.of_rows(names, a, W, r, noise)
    return found


def lateness(
    W: np.ndarray,
    r: np.ndarray,
    rate: np.ndarray,
    noise: np.ndarray | float,
    prior: np.ndarray | float = 0.0,
    off: np.ndarray | float = 0.0,
) -> tuple[float, float]:
    """Return how much later signals of N rows were than their times, and its deviation [s].

    The lateness is one more parameter, beside which the others are fitted again.

    Args:
        W: (N, n, p) slopes of the signals.
        r: (N, n) residuals at an estimate of the parameters.
        rate: (N, n) of the signals.
        noise: (n) of the signals.
        prior: (p) inverse variances of what was known before.
        off: (p) what was known before, less the estimate.
    """
    prior, off = (np.append(np.broadcast_to(part, W.shape[2]), 0.0) for part in (prior, off))
    W = np.concatenate([W, -rate[..., None]], axis=2)
    found = Information.of_rows((), 0.0 * prior, W, r, noise, prior, off)
    return float(found.correction[-1]), float(found.refined().deviations[-1])


def spread(points: np.ndarray) -> float:
    """Return the rms distance of points (N, m) from their mean along one coordinate."""
    return rms(points - points.mean(axis=0))


def gauss_newton(
    rows: Callable[[], tuple[np.ndarray, np.ndarray, np.ndarray]],
    move: Callable[[np.ndarray], Any],
    prior: np.ndarray,
) -> None:
    """Move a state to where its residuals are least, in units of their noise, from close by.

    Steps are solved by QR, not by normal equations, as what rows do not show may be 1e8 times less
    certain than what they show.

    Args:
        rows: slopes (N, n, p) and residuals (N, n) at the state, both in units of the noise, and
            what was known before (p), less the state.
        move: the state by a step (p), in place.
        prior: (p) inverse variances of what was known before.
    """
    root = np.sqrt(prior)
    for _ in range(60):
        W, r, off = rows()
        A = np.vstack([W.reshape(-1, root.size), np.diag(root)])
        step = np.linalg.lstsq(A, np.concatenate([r.ravel(), root * off]), rcond=None)[0]
        move(step)
        if np.linalg.norm(A @ step) <= ROUNDING * np.sqrt(root.size):
            break


@dataclass(frozen=True, eq=False, repr=False)
class Excitation(Printed):
    """Information of a run on all parameters; ``print`` shows a table.

    Attributes:
        dynamic: of motion and torque about the dynamic parameters.
        kinematic: of measured positions about the kinematic parameters.
        units: name of a parameter -> its unit.
    """

    dynamic: Information
    kinematic: Information
    units: Mapping[str, str]

    def report(self) -> Report:
        """Return an overview, then a table of the kinematic and one of the dynamic parameters."""
        overview = []
        tables = []
        for name, part in (("kinematic", self.kinematic), ("dynamic", self.dynamic)):
            if part.names:
                overview.append((f"{name} parameters", identifiable(part)))
                tables.append(parameter_table(part, self.units))
        return Report("Excitation", [Table(overview), *tables])


def parameter_table(part: Information, units: Mapping[str, str]) -> Table:
    """Return a row for each parameter: its estimate, its uncertainty, its unit."""
    return estimate_table(
        part.names, part.estimate, part.deviations, [units.get(name, "") for name in part.names]
    )


def estimate_table(
    names: Sequence[str],
    values: np.ndarray,
    deviations: np.ndarray,
    units: Sequence[str],
    what: str = "parameter",
) -> Table:
    """Return a row for each number (k): its name, its value, its uncertainty, its unit."""
    known = [f"+- {d:.2g}" if np.isfinite(d) else "not identifiable" for d in deviations]
    return Table(
        list(zip(names, values, known, units, strict=True)), (what, "estimate", "known to", "unit")
    )


def identifiable(part: Information) -> str:
    """Return in words how many combinations of parameters stand out from rounding."""
    return f"{part.rank} combinations of {len(part.names)} have an effect"


@dataclass(frozen=True, eq=False)
class MotionTorques:
    """The torques of a motion, as estimates of p dynamic parameters predict them.

    Attributes:
        excited: which combinations of the parameters the motion excites.
        sums: of the torques, from which follow their errors at any estimate.
        first: (p) the estimate at the first sample.
    """

    excited: Excited
    sums: TorqueErrors
    first: np.ndarray


class TorquePrediction:
    """Errors of the torques that estimates of dynamic parameters predict along a motion.

    Attributes:
        rms: of the torques, all joints together [N m or N].
        error_first, error_last: rms error of the torques that the first and the last estimate
            predict [N m or N].
        identifiable: number of combinations of the parameters that the motion excites.
        identifiable_error: their error at the last estimate relative to the first, in the metric of
            ``Excited``. None where the truth is unknown, or was known at first.
        not_excited: names of the parameters that hardly change the torques.
        share_first, share_last: the first and the last error relative to the torques.
    """

    def __init__(self, torques: MotionTorques, truth: np.ndarray | None) -> None:
        """Take the numbers of a motion, with the true parameters (p) or None."""
        excited = torques.excited
        ends = (torques.first, torques.sums.at)
        self.rms = torques.sums.size
        self.error_first, self.error_last = map(torques.sums.error, ends)
        self.identifiable = excited.rank
        self.identifiable_error = None
        if truth is not None:
            before, after = (excited.distance(a, truth) for a in ends)
            self.identifiable_error = after / before if before > 0.0 else None
        self.not_excited = tuple(compress(excited.names, excited.still))
        size = max(self.rms, np.finfo(float).tiny)
        self.share_first = self.error_first / size
        self.share_last = self.error_last / size


def motion_torques(controller: Controller, samples: Sequence[Sample]) -> MotionTorques | None:
    """Return the torques that were measured along a motion, at up to 400 instants.

    Takes about 20 ms for seven joints. None without dynamic parameters, with fewer than 16
    samples, or where estimates or torques are not finite.
    """
    dynamics = controller.dynamics
    motion = motion_of_samples(controller.kinematics.robot.model, samples)
    if not (dynamics.size and len(motion.t)):
        return None
    first = samples[0].state.a_d
    last = samples[-1].state.a_d
    tau = motion.tau
    if motion.smoothed:  # by noise, which averages out over a block
        from scipy.ndimage import uniform_filter1d  # here, because scipy is slow to import

        tau = uniform_filter1d(tau, max(round(BLOCK / motion.period), 1), axis=0)
    some = evenly(len(motion.t), 400)
    q, v, a, tau = (part[some] for part in (*motion[1:4], tau))
    if not all(np.isfinite(part).all() for part in (first, last, q, v, a, tau)):
        return None
    sums = TorqueErrors(*_torque_rows(dynamics, controller.kinematics, last, q, v, a, tau), last)
    return MotionTorques(sums.excited(dynamics.names, scales(dynamics, first)), sums, first)


def along_excited(
    controller: Controller, samples: Sequence[Sample], *, since: float = -np.inf
) -> AlongExcited | None:
    """Return what a motion excites, for ``Controller.learned``; None as of ``motion_torques``.

    Args:
        controller: that adapted.
        samples: of the whole motion.
        since: time of the last change of the robot [s]; the error of the torques is that of the
            later samples.
    """
    whole = motion_torques(controller, samples)
    later = [sample for sample in samples if sample.t >= since]
    last = whole if len(later) == len(samples) else motion_torques(controller, later)
    if whole is None or last is None:
        return None
    return AlongExcited(whole.excited, last.sums.relative_error(last.sums.at))
