"""What was recorded of a run, and the quantities that are computed from the record."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..controller.controller import Controller
from ..controller.state import Bridged, ControllerState, Sample
from ..description.chain import effort_limits
from ..exceptions import ImplausibleError, InputError, ParameterError
from ..information.information import MotionTorques, TorquePrediction, motion_torques
from ..laws.law import Truth
from ..plants.pinocchio_plant import PinocchioPlant
from ..robot.robot import EARLY, Robot, Succession
from ..tasks.frame import ImageTask
from ..tasks.task import Task
from .limit_excess import LimitExcess, motion_of_plant, motion_of_reference

_NONE_BRIDGED = Bridged()


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

    def robots_at(self, samples: Sequence[Sample]) -> np.ndarray:
        """Return the index of the true robot at each of the samples (k)."""
        return self.true.index(np.array([sample.t for sample in samples]))

    def of_robots(self, value: Callable[[Robot], np.ndarray | None]) -> list[np.ndarray] | None:
        """Return a value of each true robot, None where one has none."""
        if not self.true.known:
            return None
        values = [value(robot) for robot in self.true.robots]
        known = [part for part in values if part is not None]
        return known if len(known) == len(values) else None

    def in_time(self, value: Callable[[Robot], np.ndarray | None]) -> np.ndarray | None:
        """Return the one value (p), or those of all samples (N, p) where there are several."""
        values = self.of_robots(value)
        if values is None or len(values) == 1:
            return None if values is None else values[0]
        return np.array(values)[self.robots_at(self.samples)]

    @np.errstate(all="ignore")  # a loop that diverges overflows
    def storage(self, samples: Sequence[Sample]) -> np.ndarray | None:
        """Return V at some of the samples (k), or None where it is undefined for all of them.

        NaN at a sample that the controller had to bridge.
        """
        controller, V = self.controller, []
        true_k = self.of_robots(controller.kinematics.value)
        true_d = self.of_robots(controller.dynamics.value)
        if true_k is None or true_d is None or not samples:
            return None
        plants = [PinocchioPlant(robot) for robot in self.true.robots]
        for sample, k in zip(samples, self.robots_at(samples), strict=True):
            plant, a_k, a_d = plants[k], true_k[k], true_d[k]
            parts = controller.parameter_storage(sample.state, a_k, a_d)
            if parts is None:
                return None
            try:
                signals = controller.observe(sample.state, sample.measurement, sample.desired)
            except ImplausibleError:
                V.append(np.nan)
                continue
            truth = truth_at(plant, sample, a_k, a_d)
            V.append(parts + controller.law.storage(signals, truth))
        return np.array(V)


def truth_at(
    plant: PinocchioPlant, sample: Sample, a_k_true: np.ndarray, a_d_true: np.ndarray
) -> Truth:
    """Return the quantities of the true robot at one sample on which a law's V depends."""
    q, v = sample.measurement.q, sample.measurement.v
    M, C = plant.mass_matrix(q), plant.coriolis_matrix(q, v)
    return Truth(a_k_true, a_d_true, M, C, plant.friction_at(q))


def _of_finite(
    values: Callable[[np.ndarray], np.ndarray], matrices: Sequence[np.ndarray]
) -> np.ndarray:
    """Return min(m, n) values of each matrix (N, m, n), NaN for matrices that are not finite."""
    if not len(matrices):
        return np.zeros((0, 0))
    stack = np.array(matrices)
    finite = np.isfinite(stack).all(axis=(1, 2))
    result = np.full((len(stack), min(stack.shape[1:])), np.nan)
    result[finite] = values(stack[finite])
    return result


SLOWED = 0.99  # rate of the path's time below which it counts as slowed
_PART = 0.1  # of an interval, from which a cause is named


class Slowdown(NamedTuple):
    """An interval in which a governor slowed the path.

    Attributes:
        start, end: time [s].
        cause: as ``PathTime.cause``; several by the time that they acted, the longest first.
        least_rate: smallest ds/dt.
    """

    start: float
    end: float
    cause: str
    least_rate: float


def path_times(samples: Sequence[Sample]) -> np.ndarray | None:
    """Return the time of the path at each of the samples (N) [s], None without a governor."""
    if not samples or samples[0].state.path is None:
        return None
    paths = [(sample.t, sample.state.path) for sample in samples]
    return np.array([path.at(t) for t, path in paths if path is not None])


def slowdowns(samples: Sequence[Sample]) -> tuple[Slowdown, ...]:
    """Return the intervals in which the path was slowed, in order."""
    if not samples or samples[0].state.path is None:
        return ()
    found, acting = [], list[Sample]()
    for sample in (*samples, None):
        path = None if sample is None else sample.state.path
        if sample is not None and path is not None and path.rate < SLOWED:
            acting.append(sample)
        elif acting:
            paths = [each.state.path for each in acting if each.state.path is not None]
            causes = Counter(each.cause for each in paths).most_common()
            named = [cause for cause, count in causes if count >= _PART * len(paths)]
            end = acting[-1].t if sample is None else sample.t
            least = min(each.rate for each in paths)
            found.append(Slowdown(acting[0].t, end, ", ".join(named), least))
            acting = []
    return tuple(found)


_WINDOW, _FEWEST = 1.0, 64  # [s] and samples, of which a spectrum is made
_SLOWEST = 3.0  # [Hz] of ringing, where no bandwidth is known
_RINGS, _PURE = 0.05, 0.85  # share of the joint's torque, and of what is fast in it
# of the limits; half or twice: the same runs of late motors, springs and coarse encoders ring
_VIOLENT = 0.33
_NEAR_PEAK, _FEWEST_FREQUENCIES = 0.15, 8  # of its frequency; in a spectrum
_CALM = 1.5  # [Hz] of ringing, at least
_HARMONICS, _MOST = 4.0, 0.9  # of a motion that its torques have; of the power of its acceleration


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
    t: np.ndarray,
    tau: np.ndarray,
    joints: Sequence[str],
    slowest: float = _SLOWEST,
    limits: np.ndarray | float = np.inf,
) -> Ringing | None:
    """Return the ringing of recorded torques in the second half of a run, or None.

    A loop at its limit of stability oscillates at one frequency, sensor noise at all. A joint rings
    where the part of its torque above ``slowest`` has 5 % of the rms and 85 % of its power within
    15 % of one frequency, or where this part is a third of the joint's limit (a torque that jumps
    between its limits has no single frequency). Spectra are means of windows
    of a second. Frequencies above half of the rate of the record appear below it.

    Args:
        t: (N) time [s], in equal steps.
        tau: (N, nv) torque of the motors [N m or N].
        joints: their names.
        slowest: frequency above which torques are faster than motions of this robot [Hz].
        limits: of the torques (nv) [N m or N].
    """
    finite = np.isfinite(tau).all(axis=1)
    count = len(t) if finite.all() else int(np.argmin(finite))
    t, tau = t[:count], tau[:count]
    if count < _FEWEST:
        return None
    dt = float(np.median(np.diff(t)))
    length = min(count, max(_FEWEST, round(_WINDOW / dt))) if dt > 0.0 else 0
    if not length:
        return None
    frequencies = np.fft.rfftfreq(length, dt)
    fast = frequencies >= slowest
    if fast.sum() < _FEWEST_FREQUENCIES:
        return None
    f, window, ramp = frequencies[fast], np.hanning(length)[:, None], np.linspace(0.0, 1.0, length)
    first, spectra = max(0, min(count // 2, count - length)), []
    for k in range(first, count - length + 1, length // 2):
        part = tau[k : k + length]
        part = part - part[0] - np.outer(ramp, part[-1] - part[0])
        spectra.append(np.fft.rfft((part - part.mean(axis=0)) * window, axis=0)[fast])
    # its sum over f is the mean square of what is fast
    power = np.mean(np.abs(spectra) ** 2, axis=0) / (0.5 * length * np.sum(window**2))
    total, size = power.sum(axis=0), np.sqrt(np.mean(tau[first:] ** 2, axis=0))
    violent = np.sqrt(total) > _VIOLENT * limits
    found = None
    for joint, name in enumerate(joints):
        own, peak = power[:, joint], int(np.argmax(power[:, joint]))
        near = np.abs(f - f[peak]) <= max(_NEAR_PEAK * f[peak], 2.0 * frequencies[1])
        pure = peak >= 2 and own[near].sum() > _PURE * total[joint]  # no edge of the motion's own
        if not (violent[joint] or (pure and np.sqrt(total[joint]) > _RINGS * size[joint])):
            continue
        share = float(np.sqrt(total[joint]) / size[joint])
        if found is None or share > found.share:
            found = Ringing(name, float(f[peak]), share)
    return found


def ringing_of(
    t: np.ndarray, x_d: np.ndarray, tau: np.ndarray, controller: Controller
) -> Ringing | None:
    """Return the ringing of torques tau (N, nv) [N m or N] of a controller's run, or None.

    Only frequencies above those of the desired motion x_d (N, .) or of the feedback count.
    """
    robot, slowest = controller.kinematics.robot, _SLOWEST
    if controller.motion is not None:
        slowest = min(controller.motion.bandwidth / (2.0 * np.pi), beyond_motion(t, x_d))
    return ringing(t, tau, robot.joint_names, slowest, effort_limits(robot.model))


def beyond_motion(t: np.ndarray, x_d: np.ndarray) -> float:
    """Return the frequency [Hz] above which torques do not follow from a desired motion.

    Four times the one up to which the second half of the motion has 90 % of the power of its
    acceleration, and at least 1.5 Hz; infinite for a record that is too short.

    Args:
        t: (N) time [s], in equal steps.
        x_d: (N, .) desired task coordinates.
    """
    half = len(t) // 2
    if len(t) - half < _FEWEST:
        return np.inf
    a = np.diff(x_d[half:], 2, axis=0)
    power = np.sum(np.abs(np.fft.rfft(a * np.hanning(len(a))[:, None], axis=0)) ** 2, axis=1)
    most = int(np.argmax(np.cumsum(power) >= _MOST * power.sum()))  # the window widens it by one
    fastest = max(most - 1, 0) / (len(a) * float(np.median(np.diff(t))))
    return float(max(_CALM, _HARMONICS * fastest))


CLOSE = 1e-3  # [m or rad] error below which a run has recovered from an event
_TENTH = 10  # parts of a run, of which errors are stated for the first and the last
_LOOKS = 100  # samples at which a tool is compared with its picture
_DRAWN = 1000  # samples of V in a figure


class Transient(NamedTuple):
    """The error norm, ``Recording.distance``, from one mark of a run to the next.

    Attributes:
        at: time of the mark [s].
        what: its words.
        worst: largest error until the next mark or the end [m or rad].
        back: time from the mark after which the error stays below ``CLOSE`` [s]; zero where it
            never exceeds that, None where it does not come back before the next mark or the end.
    """

    at: float
    what: str
    worst: float
    back: float | None


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
        evaluation: what the properties are computed by; None once the rollout was copied to another
            process, with all of them computed.
        marks: time [s] and a few words for each change of the true robot and each announcement to
            the controller.
        interrupted: time [s] at which the user stopped the run, or None; the arrays end there.
        path_extent: radius of the desired circle, half the diagonal of another path [m or rad],
            zero for a point; None where the motion does not say.
        unadapted: largest error in the last 10 % of the same loop without adaptation [m or rad],
            or None where it is not known.
        path_time: (N) time s of the path [s]; None for a run without a governor.
        slowed: when a governor slowed the path, and why, in order; see ``Limits.governor``.
        ringing: which torque oscillates faster than the motion, how fast and how much, or None; see
            ``pinadapt.rollout.ringing``.
        bridged: how many samples the controller replaced by a prediction, by kind.
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
    marks: tuple[tuple[float, str], ...] = ()
    interrupted: float | None = None
    path_extent: float | None = None
    unadapted: float | None = None
    path_time: np.ndarray | None = None
    slowed: tuple[Slowdown, ...] = ()
    ringing: Ringing | None = None
    bridged: Bridged = _NONE_BRIDGED

    @cached_property
    def error(self) -> np.ndarray:
        """Task error (N, m), x relative to x_d: [m], for orientations and joints [rad]."""
        rows = [self.task.error(*both) for both in zip(self.x, self.x_d, strict=True)]
        return np.array(rows).reshape(len(rows), self.task.size)

    @property
    def duration(self) -> float:
        """Time [s] from the first sample to one period after the last."""
        return float(self.t[-1] - self.t[0] + np.diff(self.t[-2:]).sum()) if len(self.t) else 0.0

    @property
    def distance(self) -> np.ndarray:
        """Norm of the error in the task's first group of rows (N): position [m] or joints [rad]."""
        return np.linalg.norm(self.error[:, self.task.groups[0].rows], axis=1)

    @property
    def angle(self) -> np.ndarray | None:
        """Angle between true and desired orientation (N) [rad], or None for tasks without one."""
        if len(self.task.groups) == 1:
            return None
        return np.linalg.norm(self.error[:, self.task.groups[1].rows], axis=1)

    @property
    def extent(self) -> float:
        """The path's extent [m or rad]: as its motion says, or half the diagonal of what ran."""
        if self.path_extent is not None or not len(self.t):
            return self.path_extent or 0.0
        return 0.5 * float(np.linalg.norm(np.ptp(self.x_d[:, self.task.groups[0].rows], axis=0)))

    def window(self, first: bool) -> np.ndarray:
        """Return the error norms ``distance`` (>= 1) in the first or last 10 % of the samples."""
        return window(self.distance, first)

    @property
    def transients(self) -> list[Transient]:
        """The error after each of the marks that has samples after it."""
        ends = np.searchsorted(self.t, [at - EARLY for at, _ in self.marks] + [np.inf])
        distance, found = self.distance, []
        for (at, what), first, last in zip(self.marks, ends, ends[1:], strict=False):
            if first == last:
                continue
            far = np.flatnonzero(~(distance[first:last] < CLOSE))  # NaN is far
            back: float | None = 0.0
            if far.size:
                after = first + far[-1] + 1
                back = round(float(self.t[after] - at), 6) if after < last else None
            found.append(Transient(at, what, float(distance[first:last].max()), back))
        return found

    @cached_property
    def a_k_true(self) -> np.ndarray | None:
        """The true kinematic parameters (p_k) [m], or None where no value of them is the truth.

        Of each sample (N, p_k) where the true robot changes during the run.
        """
        run = self.evaluated()
        return run.in_time(run.controller.kinematics.value)

    @cached_property
    def a_d_true(self) -> np.ndarray | None:
        """The true dynamic parameters (p_d), or None where no value of them is the truth.

        Of each sample (N, p_d) where the true robot changes during the run.
        """
        run = self.evaluated()
        return run.in_time(run.controller.dynamics.value)

    @cached_property
    def prediction(self) -> TorquePrediction | None:
        """How well the estimates predict the torques since the last mark, and which it excites.

        None where nothing of the dynamics is estimated, or a number is not finite.
        """
        if self.evaluation is None:
            return None
        torques, truth = self.motion_torques(), self.a_d_true
        if torques is None:
            return None
        return TorquePrediction.of(
            torques, truth if truth is None or truth.ndim == 1 else truth[-1]
        )

    @property
    def not_excited(self) -> tuple[str, ...]:
        """Names of the dynamic parameters that the motion since the last mark does not excite."""
        return () if self.prediction is None else self.prediction.not_excited

    def motion_torques(self) -> MotionTorques | None:
        """Return the torques since the last mark, and what of the parameters they depend on.

        Raises:
            InputError: the rollout has only the numbers left.
        """
        return motion_torques(self.evaluated().controller, self.samples_since_last_mark())

    def samples_since_last_mark(self) -> Sequence[Sample]:
        """Return the samples since the last change of the robot or announcement.

        Raises:
            InputError: the rollout was copied to another process.
        """
        since = max((at for at, _ in self.marks), default=-np.inf)
        return [sample for sample in self.evaluated().samples if sample.t >= since]

    @cached_property
    def kinematic_base(self) -> int:
        """Number of combinations of the kinematic parameters that motion can identify."""
        return self.evaluated().controller.kinematics.base()

    @cached_property
    def lyapunov(self) -> np.ndarray | None:
        """V(t) (N), or None where undefined; it jumps where the true robot changes."""
        run = self.evaluated()
        return run.storage(run.samples)

    @cached_property
    def lyapunov_curve(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Times [s] and V of at most 1000 samples, or None where undefined."""
        chosen = np.unique(np.linspace(0, len(self.t) - 1, min(len(self.t), _DRAWN)).astype(int))
        run = self.evaluated()
        V = run.storage([run.samples[k] for k in chosen])
        return None if V is None else (self.t[chosen], V)

    @cached_property
    @np.errstate(all="ignore")
    def min_eig_M_hat(self) -> np.ndarray:
        """Smallest eigenvalue (N) of the estimated mass matrix; NaN where that is not finite."""
        run, M = self.evaluated(), []
        dynamics, project = run.controller.dynamics, run.controller.adaptation_d.project
        for sample in run.samples:
            q = sample.measurement.q
            dynamics.load(project(sample.state.dynamic, q))
            M.append(dynamics.mass_matrix(q))
        return _of_finite(np.linalg.eigvalsh, M).min(axis=1, initial=np.inf)

    @cached_property
    @np.errstate(all="ignore")
    def singular_J_hat(self) -> np.ndarray:
        """Singular values (N, m) of the estimated Jacobian, descending; NaN where not finite."""
        run, J = self.evaluated(), []
        kinematics = run.controller.kinematics
        for sample in run.samples:
            kinematics.update(sample.state.a_k, sample.measurement.q, sample.measurement.v)
            J.append(kinematics.J)
        return _of_finite(lambda stack: np.linalg.svd(stack, compute_uv=False), J)

    @property
    def min_singular_J_hat(self) -> np.ndarray:
        """Smallest singular value (N) of the estimated Jacobian."""
        return self.singular_J_hat.min(axis=1, initial=np.inf)

    @cached_property
    @np.errstate(all="ignore")
    def damping(self) -> np.ndarray:
        """The mu^2 (N) of the estimated Jacobian's ``RightInverse``, zero where that is exact."""
        threshold = self.evaluated().controller.limits.singular
        s_squared = 1.0 / np.sum(self.singular_J_hat**-2.0, axis=1)
        return np.maximum(0.5 * (threshold**2 - s_squared), 0.0)

    @property
    def damping_share(self) -> np.ndarray:
        """The largest share (N) of a task motion that damping takes, mu^2 / (s_min^2 + mu^2)."""
        whole = self.min_singular_J_hat**2 + self.damping
        return self.damping / np.maximum(whole, np.finfo(float).tiny)

    @cached_property
    @np.errstate(all="ignore")
    def beside_picture(self) -> float | None:
        """Largest distance of the tool from where its picture is the desired one [m].

        In the last 10 %, to the nearest such point; None for tasks other than a picture.
        """
        if not isinstance(self.task, ImageTask) or not len(self.t):
            return None
        run = self.evaluated()
        if not run.true.known:
            return None
        last = window(np.arange(len(self.t)), False)
        seen = [run.samples[k] for k in last[:: max(1, len(last) // _LOOKS)]]
        found = []
        for sample, k in zip(seen, run.robots_at(seen), strict=True):
            robot = run.true.robots[k]
            assert isinstance(robot.task, ImageTask)
            p = robot.placement(sample.truth.q).translation
            found.append(robot.task.distance(p, sample.desired.x_d))
        return extreme(np.max, np.array(found))

    @cached_property
    def disturbance(self) -> np.ndarray | None:
        """The torque (N, nv) [N m or N] that acts on the joints and is not in the model.

        Of each sample, as ``Controller.disturbance``; None where that is.
        """
        run = self.evaluated()
        return _rows([run.controller.disturbance(sample.state) for sample in run.samples])

    @cached_property
    def disturbance_noise(self) -> np.ndarray | None:
        """The deviation (N, nv) [N m or N] of ``disturbance`` by the declared noise of sensors.

        None where there is no disturbance, or no period.
        """
        controller = self.evaluated().controller
        return _rows([controller.disturbance_noise(q, controller.period) for q in self.q])

    @cached_property
    def limits(self) -> LimitExcess:
        """How far motion and desired motion of each joint exceeded the description's limits."""
        run = self.evaluated()
        robot = run.true.robots[0]
        moved, desired = (of(robot, run.samples) for of in (motion_of_plant, motion_of_reference))
        assert moved is not None
        return LimitExcess.of(robot, moved, desired)

    @cached_property
    def effort_limits(self) -> np.ndarray:
        """Effort limits (nv) of the description [N m or N], infinite where it has none."""
        return effort_limits(self.evaluated().true.robots[0].model)

    def evaluated(self) -> Evaluation:
        """Return what the properties are computed by: robots, controller and samples.

        Raises:
            InputError: the rollout was loaded or copied to another process and has only the
                numbers left.
        """
        if self.evaluation is None:
            raise InputError(
                "a rollout that was loaded, or copied to another process, has its numbers, but "
                "no robots.",
                where="rollout",
                hint="Ask for this where it ran.",
            )
        return self.evaluation

    def __getstate__(self) -> dict[str, Any]:
        """Compute every property and leave out what they are computed from."""
        for kind in type(self).__mro__:
            for name, attribute in vars(kind).items():
                if isinstance(attribute, cached_property):
                    getattr(self, name)
        return {**self.__dict__, "evaluation": None}


def _rows(values: Sequence[np.ndarray | None]) -> np.ndarray | None:
    """Return the values as rows (N, .), or None where they are, or there is none."""
    return np.array(values) if values and all(v is not None for v in values) else None


def window(values: np.ndarray, first: bool) -> np.ndarray:
    """Return the first or last 10 % of the values, at least one where there is one."""
    count = max(1, len(values) // _TENTH)
    return values[:count] if first else values[-count:]


def extreme(of: Callable[[np.ndarray], float], values: np.ndarray) -> float | None:
    """Return a number computed from the finite values, or None where there is none."""
    finite = values[np.isfinite(values)]
    return float(of(finite)) if finite.size else None
