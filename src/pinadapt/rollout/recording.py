"""What was recorded of a run, and the quantities that are computed from the record."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import compress, groupby, pairwise
from typing import Any, NamedTuple

import numpy as np

from .._checks import ROUNDING
from ..controller.controller import Controller
from ..controller.state import Bridged, ControllerState, Sample
from ..description.chain import effort_limits
from ..exceptions import ImplausibleError, InputError, ParameterError
from ..information.information import MotionTorques, TorquePrediction, motion_torques
from ..information.measured_motion import evenly
from ..laws.law import Truth
from ..models.basis import base_parameters
from ..plants.pinocchio_plant import PinocchioPlant
from ..robot.robot import EARLY, Robot, Succession
from ..tasks.frame import ImageTask
from ..tasks.task import Task
from .limit_excess import LimitExcess


class Evaluation(NamedTuple):
    """What the quantities of N recorded samples are computed from.

    Attributes:
        controller: that ran; its private models are overwritten by the computations.
        true: the robot that was driven, and the ones that it became during the run.
        samples: what was recorded (N).
    """

    controller: Controller
    true: Succession
    samples: Sequence[Sample]

    @property
    def last_state(self) -> ControllerState:
        """The controller's state at the last sample.

        Raises:
            ParameterError: there is no sample, or its estimates are not finite.
        """
        if not self.samples:
            raise ParameterError("the run has no sample, so there is no estimate.", where="rollout")
        state = self.samples[-1].state
        if not (np.isfinite(state.a_d).all() and np.isfinite(state.a_k).all()):
            raise ParameterError("the last estimates are not finite.", where="rollout")
        return state

    def true_values(self, value: Callable[[Robot], np.ndarray | None]) -> np.ndarray | None:
        """Return a value (p) of each of the r true robots (r, p), None where one has none."""
        return _rows([value(robot) for robot in self.true.robots]) if self.true.known else None

    @np.errstate(all="ignore")  # a loop that diverges overflows
    def storage(self, samples: Sequence[Sample]) -> np.ndarray | None:
        """Return V at some of the samples (k), or None where it is undefined for all of them.

        NaN at a sample that the controller had to bridge.
        """
        controller = self.controller
        V = []
        true_k = self.true_values(controller.kinematics.value)
        true_d = self.true_values(controller.dynamics.value)
        if true_k is None or true_d is None or not samples:
            return None
        plants = [PinocchioPlant(robot) for robot in self.true.robots]
        for sample in samples:
            k = self.true.index(sample.t)
            parts = controller.parameter_storage(sample.state, true_k[k], true_d[k])
            if parts is None:
                return None
            try:
                signals = controller.observe(sample.state, sample.measurement, sample.desired)
            except ImplausibleError:
                V.append(np.nan)
                continue
            truth = truth_at(plants[k], sample, true_k[k], true_d[k])
            V.append(parts + controller.law.storage(signals, truth))
        return np.array(V)


def truth_at(
    plant: PinocchioPlant, sample: Sample, a_k_true: np.ndarray, a_d_true: np.ndarray
) -> Truth:
    """Return the quantities of the true robot at one sample on which a law's V depends."""
    q = sample.measurement.q
    return Truth(
        a_k_true,
        a_d_true,
        plant.mass_matrix(q),
        plant.coriolis_matrix(q, sample.measurement.v),
        plant.robot.friction_at(q),
    )


class Slowdown(NamedTuple):
    """An interval in which a governor slowed the path.

    Attributes:
        start, end: time of its first and last sample [s].
        cause: as ``PathTime.cause``, the one that acted longest.
        least_rate: smallest ds/dt.
    """

    start: float
    end: float
    cause: str
    least_rate: float


class Shortfall(NamedTuple):
    """An interval in which contacts and motors could not give the torque that the law asked for.

    Attributes:
        start, end: time of its first and last sample [s].
        cause: as ``Missed.cause``, the one that acted longest.
        largest: norm of what was missed [N, N m].
    """

    start: float
    end: float
    cause: str
    largest: float


def _episodes(
    kind: Any, extreme: Callable[[Any], float], listed: Sequence[tuple[float, bool, str, float]]
) -> tuple[Any, ...]:
    """Return records of a kind: start, end, most frequent cause, and extreme number of each run.

    Args:
        kind: of record.
        extreme: of some numbers.
        listed: time [s], whether something acts, its cause and a number, of each sample.
    """
    found = []
    for acts, own in groupby(listed, key=lambda each: each[1]):
        t, _, causes, numbers = zip(*own, strict=True)
        if acts:
            ((cause, _),) = Counter(causes).most_common(1)
            found.append(kind(t[0], t[-1], cause, extreme(numbers)))
    return tuple(found)


_FEWEST = 64  # samples of a spectrum; half or twice: of shorter or only of longer records
# Share of the joint's torque that rings, and of this share that has one frequency: half or twice,
# weaker or only stronger oscillations ring; less pure ones are the noise of sensors.
_RINGS, _PURE = 0.05, 0.85


class Ringing(NamedTuple):
    """A torque that oscillates faster than the motion: a motor is late, or a joint is elastic.

    Attributes:
        joint: whose torque oscillates most.
        frequency: of the oscillation [Hz].
        share: its rms over that of all of the joint's torque.
    """

    joint: str
    frequency: float
    share: float


def ringing(
    t: np.ndarray, tau: np.ndarray, joints: Sequence[str], slowest: float = 3.0
) -> Ringing | None:
    """Return the ringing of recorded torques in the second half of a run, or None.

    A loop at its limit of stability oscillates at one frequency, sensor noise at all. A joint rings
    where the part of its torque above ``slowest`` has 5 % of the rms and 85 % of its power within
    15 % of one frequency. Spectra are means of windows of a second. Frequencies above half of the
    rate of the record appear below it.

    Args:
        t: (N) time [s], in equal steps.
        tau: (N, nv) torque of the motors [N m or N].
        joints: their names.
        slowest: frequency above which torques are faster than motions of this robot [Hz]; half or
            twice, slower or only faster tones ring.
    """
    from scipy.signal import welch  # here, because scipy is slow to import

    finite = np.isfinite(tau).all(axis=1)
    t = t[finite]
    tau = tau[finite]
    if len(t) < _FEWEST:
        return None
    rate = 1.0 / np.median(np.diff(t))
    length = max(_FEWEST, round(rate))
    tau = tau[-max(len(t) // 2, length) :]
    f, power = welch(tau, rate, nperseg=min(len(tau), length), detrend="linear", axis=0)
    step = f[1]
    fast = f >= slowest
    f = f[fast]
    found = []
    sizes = np.mean(tau**2, axis=0)
    sizes = np.maximum(sizes, ROUNDING**2 * sizes.max())  # of a joint that needs no torque
    for name, own, size in zip(joints, power[fast].T, sizes, strict=True):
        peak = np.argmax(own) if own.size else 0
        if peak < 2:  # no edge of the motion's own spectrum
            continue
        near = np.abs(f - f[peak]) <= max(0.15 * f[peak], 2.0 * step)
        share = float(np.sqrt(step * own.sum() / size))  # the sum over f is the mean square
        if own[near].sum() > _PURE * own.sum() and share > _RINGS:
            found.append(Ringing(name, float(f[peak]), share))
    return max(found, key=lambda each: each.share, default=None)


def ringing_of(t: np.ndarray, tau: np.ndarray, controller: Controller) -> Ringing | None:
    """Return the ringing of torques tau (N, nv) [N m or N] of a controller's run, or None.

    Only frequencies above those of its feedback count.
    """
    motion = controller.motion
    slowest = () if motion is None else (motion.bandwidth / (2.0 * np.pi),)
    return ringing(t, tau, controller.kinematics.robot.joint_names, *slowest)


# [m or rad] error below which a run without extent has recovered from an event; half, twice: a held
# joint that is given 2 kg has after 0.17 and 0.13 s, in place of 0.15
CLOSE = 1e-3

# Errors in the last 10 %, relative to the path's extent, and the change of an orientation [rad]
# that is taken as its extent: half or twice of them, and half or twice as large errors follow.
ACCURATE, ROUGH, TURN = 0.02, 0.2, 0.2
FOLLOWS, ROUGHLY, LOST = "follows", "follows roughly", "does not follow"


class Transient(NamedTuple):
    """The error norm, ``Recording.distance``, from one mark of a run to the next.

    Attributes:
        at: time of the mark [s].
        what: its words.
        max_error: largest finite one until the next mark or the end [m or rad]; None: there is
            none.
        time_back: from the mark until the error stays below ``CLOSE`` [s]; zero where it never
            exceeds that, None where it does not come back before the next mark or the end.
    """

    at: float
    what: str
    max_error: float | None
    time_back: float | None


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """A closed loop over N samples, in SI units and world axes.

    The fields were recorded. The properties are computed from them when they are first read.

    Attributes:
        title, robot, law, adaptation: names of what ran.
        task: the controlled coordinates.
        joint_names: one name a joint.
        kinematic_names, dynamic_names: one name a parameter.
        t: (N) time [s].
        q, v, tau: (N, nq), (N, nv), (N, nv) true configuration and velocity, torque given by the
            motors.
        x, x_d: (N, .) true and desired task coordinates.
        a_k, a_d: (N, p_k), (N, p_d) estimates.
        saturated: (N) whether a torque was at its limit.
        diverged: time [s] at which the loop diverged, or None; the arrays end there.
        reason: why it diverged, or None.
        wall_time: seconds for the whole run.
        step_time: mean seconds of one controller step; zero in continuous mode, which has no steps.
        evaluation: what the properties are computed by; None once the rollout was loaded.
        bridged: how many samples the controller replaced by a prediction, by kind.
        marks: time [s] and a few words for each change of the true robot and each announcement to
            the controller.
        interrupted: time [s] at which the user stopped the run, or None; the arrays end there.
        path_extent: radius of the desired circle, half the diagonal of another path [m or rad],
            zero for a point; None where the motion does not say.
        unadapted: largest error in the last 10 % of the same loop without adaptation [m or rad],
            or None where it is not known.
    """

    title: str
    robot: str
    law: str
    adaptation: str
    task: Task
    joint_names: tuple[str, ...]
    kinematic_names: tuple[str, ...]
    dynamic_names: tuple[str, ...]
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    x: np.ndarray
    x_d: np.ndarray
    a_k: np.ndarray
    a_d: np.ndarray
    saturated: np.ndarray
    diverged: float | None
    reason: str | None
    wall_time: float
    step_time: float
    evaluation: Evaluation | None
    bridged: Bridged
    marks: tuple[tuple[float, str], ...] = ()
    interrupted: float | None = None
    path_extent: float | None = None
    unadapted: float | None = None

    @cached_property
    def error(self) -> np.ndarray:
        """Task error (N, m), x relative to x_d: [m], for orientations and joints [rad]."""
        rows = [self.task.error(*both) for both in zip(self.x, self.x_d, strict=True)]
        return np.array(rows).reshape(-1, self.task.size)

    @property
    def duration(self) -> float:
        """Time [s] from the first sample to one period after the last."""
        return float(np.diff(self.t).sum() + np.diff(self.t[-2:]).sum())

    @property
    def distance(self) -> np.ndarray:
        """Norm of the error in the task's first group of rows (N) [m or rad]."""
        return np.linalg.norm(self.error[:, self.task.groups[0].rows], axis=1)

    @property
    def angle(self) -> np.ndarray | None:
        """Angle between true and desired orientation, or of joints beside slides (N) [rad]."""
        if len(self.task.groups) == 1:
            return None
        return np.linalg.norm(self.error[:, self.task.groups[1].rows], axis=1)

    @property
    def extent(self) -> float:
        """Half the diagonal of the path that ran, at most what its motion says [m or rad]."""
        groups = self.task.groups
        stated = self.path_extent
        if stated is None or (len(groups) > 1 and not self.task.lengths):
            stated = np.inf  # or it is of slides and turns together
        x_d = self.x_d[:, groups[0].rows]
        extent = 0.5 * float(np.linalg.norm(np.ptp(x_d, axis=0))) if len(x_d) else 0.0
        return min(extent, stated) if extent > ROUNDING * np.abs(x_d).max(initial=0.0) else 0.0

    def window(self, first: bool) -> np.ndarray:
        """Return the error norms ``distance`` (>= 1) in the first or last 10 % of the samples."""
        return window(self.distance, first)

    @property
    def error_share(self) -> float | None:
        """Largest error of the last 10 % relative to the path's extent; None for a point."""
        error = extreme(np.max, self.window(False))
        return error / self.extent if error is not None and self.extent else None

    @property
    def grade(self) -> str:
        """The verdict in a few words: of the position, or the orientation if that is worse."""
        if self.diverged is not None:
            return f"diverged at {self.diverged:.3f} s"
        if self.interrupted is not None:
            return f"interrupted at {self.interrupted:.3f} s"
        errors = self.distance / (self.extent or CLOSE / ACCURATE)
        if self.angle is not None:
            errors = np.maximum(errors, self.angle / TURN)
        worst = extreme(np.max, window(errors, False))
        if worst is None:
            return "no finite error"
        if len(errors) < 2:
            return "no sample after the first"
        return FOLLOWS if worst <= ACCURATE else ROUGHLY if worst <= ROUGH else LOST

    @property
    def transients(self) -> list[Transient]:
        """The error after each of the marks that has samples after it."""
        found = []
        for (at, what), (end, _) in pairwise([*self.marks, (np.inf, "")]):
            part = (self.t >= at - EARLY) & (self.t < end - EARLY)
            if not part.any():
                continue
            error = self.distance[part]
            # the times at which it may be back: the mark, and each sample after one; NaN is far
            backs = [0.0, *(self.t[part][1:] - at).round(6).tolist(), None]
            back = backs[np.flatnonzero([True, *~(error < CLOSE)])[-1]]
            found.append(Transient(at, what, extreme(np.max, error), back))
        return found

    @cached_property
    def a_k_true(self) -> np.ndarray | None:
        """The true kinematic parameters (p_k) [m], or None where no value of them is the truth.

        Of each sample (N, p_k) where the true robot changes during the run.
        """
        return self._true("kinematics")

    @cached_property
    def a_d_true(self) -> np.ndarray | None:
        """The true dynamic parameters (p_d), or None where no value of them is the truth.

        Of each sample (N, p_d) where the true robot changes during the run.
        """
        return self._true("dynamics")

    def _true(self, model: str) -> np.ndarray | None:
        """Return the true parameters of the kinematics or the dynamics of the controller."""
        run = self.evaluated()
        rows = run.true_values(getattr(run.controller, model).value)
        if rows is None:
            return None
        return rows[0] if len(rows) == 1 else rows[run.true.index(self.t)]

    @cached_property
    def prediction(self) -> TorquePrediction | None:
        """How well the estimates predict the torques since the last mark, and which it excites.

        None where nothing of the dynamics is estimated, or a number is not finite.
        """
        torques = self.motion_torques
        truth = self.a_d_true
        if torques is None:
            return None
        return TorquePrediction(torques, truth if truth is None else np.atleast_2d(truth)[-1])

    @cached_property
    def not_identified(self) -> tuple[str, ...]:
        """Names of the dynamic parameters that the motion does not identify by themselves."""
        torques = self.motion_torques
        if torques is None:
            return ()
        return tuple(compress(torques.excited.names, ~torques.excited.alone))

    @cached_property
    def motion_torques(self) -> MotionTorques | None:
        """The torques since the last mark, and what of the parameters they depend on."""
        return motion_torques(self.evaluated().controller, self.samples_since_last_mark())

    def samples_since_last_mark(self) -> Sequence[Sample]:
        """Return the samples since the last change of the robot or announcement.

        Raises:
            InputError: the rollout was loaded.
        """
        return [sample for sample in self.evaluated().samples if sample.t >= self.last_mark]

    @property
    def last_mark(self) -> float:
        """Time of the last change of the robot or announcement [s], -inf without any."""
        return max((at for at, _ in self.marks), default=-np.inf)

    @cached_property
    def kinematic_base(self) -> int:
        """Number of combinations of the kinematic parameters that motion can identify."""
        kinematics = self.evaluated().controller.kinematics
        return base_parameters(kinematics, kinematics.robot).size

    @cached_property
    def lyapunov(self) -> np.ndarray | None:
        """V(t) (N), or None where undefined; it jumps where the true robot changes.

        Of more than a thousand samples it is computed at so many, and linear between them.
        """
        run = self.evaluated()
        chosen = evenly(len(self.t), 1000)
        V = run.storage([run.samples[k] for k in chosen])
        return None if V is None else np.interp(self.t, self.t[chosen], V)

    @cached_property
    def min_eig_M_hat(self) -> np.ndarray:
        """Smallest eigenvalue (N) of the estimated mass matrix; NaN where that is not finite."""
        controller = self.evaluated().controller

        def M_hat(sample: Sample) -> np.ndarray:
            q = sample.measurement.q
            controller.dynamics.load(controller.adaptation_d.project(sample.state.dynamic, q))
            return controller.dynamics.mass_matrix(q)

        return self._smallest(np.linalg.eigvalsh, M_hat)

    @cached_property
    def min_singular_J_hat(self) -> np.ndarray:
        """Smallest singular value (N) of the estimated Jacobian; NaN where that is not finite."""
        kinematics = self.evaluated().controller.kinematics

        def J_hat(sample: Sample) -> np.ndarray:
            kinematics.update(sample.state.a_k, sample.measurement.q, sample.measurement.v)
            return kinematics.J

        return self._smallest(np.linalg.svdvals, J_hat)

    @np.errstate(all="ignore")
    def _smallest(self, values: Callable[[Any], Any], matrix: Callable[[Any], Any]) -> np.ndarray:
        """Return the smallest value (N) of a matrix of each sample; NaN where it is not finite."""
        return np.array(
            [
                values(M).min() if np.isfinite(M).all() else np.nan
                for M in map(matrix, self.evaluated().samples)
            ]
        )

    @cached_property
    @np.errstate(all="ignore")
    def beside_picture(self) -> float | None:
        """Largest distance of the tool from where its picture is the desired one [m].

        In the last 10 %, to the nearest such point; None for tasks other than a picture.
        """
        true = self.evaluated().true
        last = window(np.arange(len(self.t)), False)
        if not (isinstance(self.task, ImageTask) and true.known):
            return None
        found = []
        for k in last[:: max(1, len(last) // 100)]:
            robot = true.robots[true.index(self.t[k])]
            tool: Any = robot.task
            found.append(tool.distance(robot.placement(self.q[k]).translation, self.x_d[k]))
        return extreme(np.max, np.array(found))

    @cached_property
    def path_time(self) -> np.ndarray | None:
        """Time s of the path (N) [s]; None for a run without a governor."""
        paths = [sample.state.path for sample in self.evaluated().samples]
        lags = _rows([None if path is None else path.lag for path in paths])
        return None if lags is None else self.t - lags

    @cached_property
    def slowed(self) -> tuple[Slowdown, ...]:
        """When a governor slowed the path by more than 1 %, and why; see ``Limits.governor``."""
        rates = [
            (sample.t, path.rate < 0.99, path.cause, path.rate)
            for sample in self.evaluated().samples
            if (path := sample.state.path) is not None
        ]
        return _episodes(Slowdown, min, rates)

    @cached_property
    def infeasible(self) -> tuple[Shortfall, ...]:
        """When contacts and motors could not give what the law asked for, and why."""
        missed = [(sample.state.t, sample.state.missed) for sample in self.evaluated().samples]
        return _episodes(Shortfall, max, [(t, m.size > 0.0, m.cause, m.size) for t, m in missed])

    @cached_property
    def ringing(self) -> Ringing | None:
        """Which torque oscillates faster than the motion, or None; see ``rollout.ringing``."""
        return ringing_of(self.t, self.tau, self.evaluated().controller)

    @cached_property
    def disturbance(self) -> np.ndarray | None:
        """The torque (N, nv) [N m or N] that acts on the joints and is not in the model.

        Of each sample, as ``Controller.disturbance``; None where that is.
        """
        run = self.evaluated()
        return _rows([run.controller.disturbance(sample.state) for sample in run.samples])

    @cached_property
    def limits(self) -> LimitExcess:
        """How far the motion of each joint exceeded the description's limits."""
        robot = self.evaluated().true.robots[0]
        return LimitExcess.of(robot, self.q[:, robot.model.idx_qs[1:]], self.v, self.tau)

    @cached_property
    def effort_limits(self) -> np.ndarray:
        """Effort limits (nv) of the description [N m or N], infinite where it has none."""
        return effort_limits(self.evaluated().true.robots[0].model)

    def evaluated(self) -> Evaluation:
        """Return what the properties are computed by: robots, controller and samples.

        Raises:
            InputError: the rollout was loaded from files, which have only the numbers.
        """
        if self.evaluation is None:
            raise InputError(
                "a rollout that was loaded has its numbers, but no robots.",
                where="rollout",
                hint="Ask for this where it ran.",
            )
        return self.evaluation


def _rows(values: Sequence[Any]) -> np.ndarray | None:
    """Return the values as rows (N, .), or None where they are, or there is none."""
    return np.array(values) if values and all(v is not None for v in values) else None


def window(values: np.ndarray, first: bool) -> np.ndarray:
    """Return the first or last 10 % of the values, at least one where there is one."""
    count = max(1, len(values) // 10)
    return values[:count] if first else values[-count:]


def extreme(of: Callable[[np.ndarray], float], values: np.ndarray) -> float | None:
    """Return a number computed from the finite values, or None where there is none."""
    finite = values[np.isfinite(values)]
    return float(of(finite)) if finite.size else None
