"""Which parameters a motion identifies, and how well; how well estimates predict its torques.

Measured signals are linear in the unknown parameters a, y = W a + noise, with the covariance S of
the noise. Then H = W^T S^-1 W is the information matrix, its inverse the covariance of the
least-squares estimate, and its null space what the motion does not excite.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
import pinocchio as pin

from .._output import Sheet, Table
from ..controller.controller import Controller
from ..controller.learned import AlongExcited
from ..controller.state import ControllerState, Sample
from ..models.dynamics import Dynamics
from ..models.excited import Excited, TorqueSums, names_together, scales
from ..models.task_kinematics import TaskKinematics
from ..records import Measurement
from .measured_motion import instants_of_samples, motion_of_samples

BLOCK = 0.05  # [s] over which rows of the torque are averaged, so that their noise is independent
CUTOFF = 30.0  # [Hz] for noisy positions; averages over a block are at half (-6 dB) at 12 Hz
_UNEXCITED = 1e-10  # share of the largest eigenvalue up to which a direction was not excited
_OUTSIDE = 1e-3  # share of a gradient that may lie along directions that were not excited
_INVISIBLE = 1e-8  # share of the largest scale up to which a parameter has no effect
_LEAST_NOISE = 1e-9  # share of the size of a signal
_INSTANTS = 400  # at most, of which the torques are taken
_ROUNDS, _CONVERGED = 60, 1e-6  # of Gauss-Newton; of a deviation: a thousand times changes nothing

State = TypeVar("State")


@dataclass(frozen=True, eq=False)
class Information:
    """Information of N rows of data on p parameters, linearised at an estimate of them.

    Attributes:
        names: of the parameters (p).
        estimate: (p) at which the residuals were taken.
        H: (p, p) information matrix W^T S^-1 W, in units of 1 / (parameter unit)^2.
        score: (p) W^T S^-1 r of the residuals r = y - W a: zero at the least-squares estimate.
        noise: (n) standard deviation of the residual of each measured signal, in its unit.
        rows: N.
        spread: (B, p) differences of estimates from parts of the data, or with another model,
            whose squares sum to the variances of the estimate as far as errors last: those of a
            jackknife over blocks of time, and with other friction. None where rows are independent.
    """

    names: tuple[str, ...]
    estimate: np.ndarray
    H: np.ndarray
    score: np.ndarray
    noise: np.ndarray
    rows: int
    spread: np.ndarray | None = None

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
        sizes = np.broadcast_to(noise, r.shape[1:]).astype(float)
        rows = (W / sizes[:, None]).reshape(r.size, len(names))
        H = rows.T @ rows + np.diag(np.broadcast_to(prior, len(names)))
        score = rows.T @ (r / sizes).ravel() + prior * off
        return cls(tuple(names), estimate, H, score, sizes, r.size)

    def beside(self, W: np.ndarray, r: np.ndarray, column: np.ndarray) -> tuple[float, float]:
        """Return the value of one more parameter at the best fit, and its deviation.

        Args:
            W: (N, n, p) slopes of the fit, in units of the noise.
            r: (N, n) its residuals.
            column: (N, n) the effect of the other parameter.
        """
        rows, column = W.reshape(column.size, -1), column.ravel()
        own = column - rows @ (self.covariance @ (rows.T @ column))
        size = float(column @ own)
        if not size > _UNEXCITED * float(column @ column):
            return 0.0, np.inf
        return float(own @ r.ravel()) / size, 1.0 / np.sqrt(size)

    @cached_property
    def scale(self) -> np.ndarray:
        """Scale (p) of each parameter's effect, sqrt(H_ii); the largest one if it has no effect."""
        sizes = np.sqrt(np.diag(self.H))
        largest = sizes.max(initial=0.0) or 1.0
        return np.where(sizes > _INVISIBLE * largest, sizes, largest)

    @cached_property
    def _eigen(self) -> tuple[np.ndarray, np.ndarray]:
        values, vectors = np.linalg.eigh(self.H / np.outer(self.scale, self.scale))
        return values[::-1], vectors[:, ::-1]

    @property
    def spectrum(self) -> np.ndarray:
        """Eigenvalues (p) of H scaled to a unit diagonal, descending; all ones are the best."""
        return self._eigen[0]

    @property
    def rank(self) -> int:
        """Number of identifiable combinations of the parameters."""
        values = self.spectrum
        return int(np.count_nonzero(values > _UNEXCITED * values.max(initial=0.0)))

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance (p, p) of the least-squares estimate within the excited directions."""
        values, vectors = self._eigen
        excited = vectors[:, : self.rank]
        scaled = (excited / values[: self.rank]) @ excited.T
        return np.asarray(scaled / np.outer(self.scale, self.scale))

    @cached_property
    def correction(self) -> np.ndarray:
        """Step (p) from the estimate to the least-squares one, within the excited directions."""
        return self.covariance @ self.score

    @property
    def solution(self) -> np.ndarray:
        """The step (p) from the estimate where a prior makes all of it certain."""
        return np.linalg.solve(self.H, self.score)

    @cached_property
    def equations(self) -> tuple[np.ndarray, np.ndarray]:
        """R (p, p) and c (p), the p equations R d = c for a step d that stand for all rows.

        H = R^T R and, within the excited directions, score = R^T c.
        """
        values, vectors = self._eigen
        roots = np.sqrt(np.maximum(values, 0.0))
        c = np.zeros(len(values))
        excited = slice(self.rank)
        c[excited] = vectors[:, excited].T @ (self.score / self.scale) / roots[excited]
        return roots[:, None] * vectors.T * self.scale, c

    def refined(self) -> Information:
        """Return the information at the least-squares estimate from all rows."""
        best = self.estimate + self.correction
        return replace(self, estimate=best, score=np.zeros_like(self.score))

    def deviation(self, gradient: np.ndarray) -> np.ndarray:
        """Return the uncertainty (k) of quantities whose gradients are the rows of (k, p).

        The root of variance plus squared correction; infinite for a quantity that changes along a
        direction that was not excited. The variance is the larger one of that of the rows and of
        ``spread``.
        """
        excited, scaled = self._eigen[1][:, : self.rank], gradient / self.scale
        outside = np.linalg.norm(scaled - scaled @ excited @ excited.T, axis=1)
        variance = np.einsum("ki,ij,kj->k", gradient, self.covariance, gradient)
        if self.spread is not None:
            variance = np.maximum(variance, np.sum((gradient @ self.spread.T) ** 2, axis=1))
        total = np.sqrt(np.maximum(variance, 0.0) + (gradient @ self.correction) ** 2)
        return np.where(outside <= _OUTSIDE * np.linalg.norm(scaled, axis=1), total, np.inf)

    @cached_property
    def deviations(self) -> np.ndarray:
        """Uncertainty (p) of each parameter's estimate; infinite where it is not identifiable."""
        return self.deviation(np.eye(len(self.names)))


def torque_information(
    controller: Controller, samples: Sequence[Sample], state: ControllerState
) -> Information:
    """Return the information of measured motion and torque on the dynamic parameters at a state."""
    return dynamic_information(
        controller.dynamics, controller.kinematics.robot.model, samples, state.a_d
    )


def dynamic_information(
    dynamics: Dynamics,
    model: pin.Model,
    samples: Sequence[Sample],
    a_d: np.ndarray,
    least_noise: float = _LEAST_NOISE,
) -> Information:
    """Return the information of measured motion and torque of a chain on dynamic parameters.

    With noisy sensors, torques of a joint whose dry friction is unknown are left out while its
    velocity may change sign within the noise: the sign of the friction is then random, which would
    bias all parameters.

    Args:
        dynamics: of p parameters.
        model: of the chain.
        samples: of a run, at a constant rate.
        a_d: (p) at which the residuals are taken.
        least_noise: of a torque, as a share of its mean size.
    """
    dynamics.load(a_d)
    nv = model.nv
    motion = motion_of_samples(model, samples, cutoff=CUTOFF)
    _, q, v, a, tau, smooth = motion
    reverses = dynamics.joints if smooth else None
    size = max(1, round(BLOCK / motion.period)) if motion.period else 1
    blocks = len(q) // size if dynamics.size else 0
    W, r = np.zeros((blocks, nv, dynamics.size)), np.zeros((blocks, nv))
    kept = np.ones((blocks, nv), dtype=bool)
    for k in range(blocks * size):
        W[k // size] += dynamics.regressor(q[k], v[k], a[k]) / size
        r[k // size] += (tau[k] - dynamics.torque(q[k], v[k], a[k])) / size
        if reverses is not None:
            kept[k // size] &= reverses.sliding(v[k])
    level = np.abs(tau).mean(axis=0) if blocks else np.zeros(nv)
    W, r = W * kept[:, :, None], r * kept
    return _information(dynamics.names, a_d, W, r, level, kept, least_noise)


def position_information(
    controller: Controller, samples: Sequence[Sample], state: ControllerState
) -> Information:
    """Return the information of measured frame positions on the kinematic parameters at a state.

    A late frame is compared with the configuration at the time when it was taken.
    """
    kinematics, m = controller.kinematics, controller.kinematics.positions
    W, r = [], []
    measurements = [sample.measurement for sample in samples if kinematics.size]
    for q, v, x in frames(kinematics, measurements):
        kinematics.update(state.a_k, q, v)
        W.append(kinematics.explaining(x))
        r.append(x - kinematics.p_hat)
    shape = len(W), m
    return _information(
        kinematics.names,
        state.a_k,
        np.array(W).reshape(*shape, kinematics.size),
        np.array(r).reshape(shape),
        np.full(m, controller.kinematics.robot.reach),
    )


def frames(
    kinematics: TaskKinematics, measurements: Sequence[Measurement]
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield q (nq), v (nv) and the measured positions x (m_p) of each frame of a motion.

    Of a late frame q is that at ``x_time``, between two measurements.
    """
    times, last = np.array([each.t for each in measurements]), None
    for t, q, v, x, taken, *_ in measurements:
        if x is None or (taken is not None and taken == last):
            continue
        last = taken
        if taken is not None and taken < t and len(times) > 1:
            k = int(np.clip(np.searchsorted(times, taken, side="right") - 1, 0, len(times) - 2))
            share = float(np.clip((taken - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0))
            before, after = measurements[k], measurements[k + 1]
            q, v = kinematics.between(before.q, after.q, share), before.v
        yield q, v, np.asarray(x, dtype=float)[: kinematics.positions]


def _information(
    names: tuple[str, ...],
    a: np.ndarray,
    W: np.ndarray,
    r: np.ndarray,
    level: np.ndarray,
    kept: np.ndarray | None = None,
    least_noise: float = _LEAST_NOISE,
) -> Information:
    """Return the information of rows W (N, n, p) with residuals r (N, n), zero where not ``kept``.

    The noise of each signal is its residual at the least-squares estimate. It is found in two
    rounds: signals are weighted by their ``level`` (n) in the first, by their noise in the second.
    """
    counts = np.full(r.shape[1], len(r)) if kept is None else kept.sum(axis=0)
    count, least = int(counts.sum()), least_noise * np.maximum(level, np.finfo(float).tiny)
    noise = np.maximum(level, np.finfo(float).tiny)
    found = Information.of_rows(names, a, W, r, noise)
    for _ in range(2 if count else 0):
        residual = r - W @ found.correction
        degrees = max(1.0 - found.rank / count, 1.0 / count)
        variance = np.sum(residual**2, axis=0) / np.maximum(counts, 1)
        noise = np.where(counts > 0, np.maximum(np.sqrt(variance / degrees), least), noise)
        found = Information.of_rows(names, a, W, r, noise)
    return replace(found, rows=count)


def gauss_newton(
    rows: Callable[[State], tuple[np.ndarray, np.ndarray, np.ndarray]],
    moved: Callable[[State, np.ndarray], State],
    state: State,
    prior: np.ndarray,
) -> State:
    """Return the state whose residuals are least, in units of their noise, from one close by.

    Steps are solved by QR, not by normal equations, as what rows do not show may be 1e8 times less
    certain than what they show.

    Args:
        rows: slopes (N, n, p) and residuals (N, n) at a state, both in units of the noise, and what
            was known before (p), less the state.
        moved: a state after a step (p).
        state: to begin with.
        prior: (p) inverse variances of what was known before.
    """
    root = np.sqrt(prior)
    for _ in range(_ROUNDS):
        W, r, off = rows(state)
        A = np.vstack([W.reshape(-1, root.size), np.diag(root)])
        step = np.linalg.lstsq(A, np.concatenate([r.ravel(), root * off]), rcond=None)[0]
        state = moved(state, step)
        if np.linalg.norm(A @ step) <= _CONVERGED * np.sqrt(root.size):
            break
    return state


@dataclass(frozen=True, eq=False, repr=False)
class Excitation:
    """Information of a run on all parameters; ``print`` shows a table.

    Attributes:
        dynamic: of motion and torque about the dynamic parameters.
        kinematic: of measured positions about the kinematic parameters.
        units: name of a parameter -> its unit.
    """

    dynamic: Information
    kinematic: Information
    units: Mapping[str, str]

    def __repr__(self) -> str:
        """Return rank and conditioning of both, and each estimate with its uncertainty."""
        return str(self._sheet())

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def _sheet(self) -> Sheet:
        return Sheet("Excitation", self.tables())

    def tables(self) -> list[Table]:
        """Return an overview, then a table of the kinematic and one of the dynamic parameters."""
        parts = {"kinematic": self.kinematic, "dynamic": self.dynamic}
        overview = [
            row
            for name, part in parts.items()
            if part.names
            for row in (
                (f"{name} parameters", identifiable(part)),
                (f"{name} conditioning", _conditioning(part)),
            )
        ]
        tables = [Table(overview or [("nothing", "was adapted")])]
        for part in parts.values():
            if part.names:
                tables.append(
                    Table(self._rows(part), ("parameter", "estimate", "known to", "unit"))
                )
        return tables

    def _rows(self, part: Information) -> list[tuple[str, ...]]:
        return [
            (name, f"{value:.4g}", known_to(deviation), self.units.get(name, ""))
            for name, value, deviation in zip(
                part.names, part.estimate, part.deviations, strict=True
            )
        ]


def known_to(deviation: float) -> str:
    """Return an uncertainty in words: its number, or that there is none."""
    return f"+- {deviation:.2g}" if np.isfinite(deviation) else "not identifiable"


def identifiable(part: Information) -> str:
    """Return in words how many combinations of parameters are identifiable."""
    return f"{part.rank} identifiable combinations of {len(part.names)}"


def _conditioning(part: Information) -> str:
    """Return the ratio of the largest to the smallest excited eigenvalue of the scaled H."""
    if not part.rank:
        return "nothing was excited"
    return f"{part.spectrum[0] / part.spectrum[part.rank - 1]:.2g}, from {part.rows} rows"


@dataclass(frozen=True, eq=False)
class MotionTorques:
    """The torques of a motion, as estimates of p dynamic parameters predict them.

    Attributes:
        excited: which combinations of the parameters the motion excites.
        sums: of the torques, from which follow their errors at any estimate.
        first, last: (p) the estimates at the first and at the last sample.
    """

    excited: Excited
    sums: TorqueSums
    first: np.ndarray
    last: np.ndarray

    def share(self, a: np.ndarray) -> float:
        """Return the rms error of the torques of the whole motion at a (p), relative to them."""
        return self.sums.error(a) / (self.sums.size or np.finfo(float).tiny)

    def left(self, a: np.ndarray, truth: np.ndarray) -> float | None:
        """Return the error of the identifiable combinations at a (p) relative to the first one's.

        None where that is zero.
        """
        start = self.excited.distance(self.first, truth)
        return self.excited.distance(a, truth) / start if start > 0.0 else None


@dataclass(frozen=True)
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
    """

    rms: float
    error_first: float
    error_last: float
    identifiable: int
    identifiable_error: float | None
    not_excited: tuple[str, ...]

    @property
    def share_first(self) -> float:
        """The first error relative to the torques."""
        return self.error_first / (self.rms or np.finfo(float).tiny)

    @property
    def share_last(self) -> float:
        """The last error relative to the torques."""
        return self.error_last / (self.rms or np.finfo(float).tiny)

    def not_excited_words(self) -> str:
        """Return the names of what is not excited, whole bodies and kinds together."""
        return names_together(self.not_excited)

    @classmethod
    def of(cls, torques: MotionTorques, truth: np.ndarray | None) -> TorquePrediction:
        """Take the numbers of a motion, with the true parameters (p) or None."""
        excited, left = torques.excited, None
        if truth is not None:
            left = torques.left(torques.last, truth)
        still = [name for name, no in zip(excited.names, excited.still, strict=True) if no]
        errors = torques.sums.error(torques.first), torques.sums.error(torques.last)
        return cls(torques.sums.size, *errors, excited.rank, left, tuple(still))


def motion_torques(controller: Controller, samples: Sequence[Sample]) -> MotionTorques | None:
    """Return the torques that were measured along a motion, at up to 400 instants.

    Takes about 20 ms for seven joints. None without dynamic parameters, with fewer than three
    samples, or where estimates or torques are not finite.
    """
    dynamics = controller.dynamics
    if not dynamics.size or len(samples) < 3:
        return None
    first, last = samples[0].state.a_d, samples[-1].state.a_d
    model = controller.kinematics.robot.model
    motion = instants_of_samples(model, samples, cutoff=CUTOFF, window=BLOCK, most=_INSTANTS)
    finite = all(np.isfinite(part).all() for part in (first, last, *motion[1:5]))
    if not (finite and len(motion.t)):
        return None
    states = list(zip(motion.q, motion.v, motion.a, strict=True))
    dynamics.load(last)
    Y = np.array([dynamics.regressor(*state) for state in states])
    predicted = np.array([dynamics.torque(*state) for state in states])
    sums = TorqueSums(model.nv, last)
    sums.add(Y, motion.tau - predicted, motion.tau)
    return MotionTorques(sums.excited(dynamics.names, scales(dynamics, first)), sums, first, last)


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
    return AlongExcited(whole.excited, last.sums.relative_error(last.last))
