"""The exciting motion of largest information gain within all limits, and its search.

With a prior covariance P of the parameters and the information matrix H of a motion, the expected
information gain is log det(1 + P H) / 2 nats (Lindley, *On a measure of the information provided by
an experiment*, 1956). Without a prior, maximising it is the D-optimal design of Swevers (1997).
P and H are taken in base parameters, the combinations of parameters that motion can identify.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import MOST_SAMPLES, instance, numbers, positive, whole
from .._output import Sheet, Table
from ..controller.controller import Controller
from ..description.chain import effort_limits, position_limits, velocity_limits
from ..exceptions import InputError, ParameterError, RobotError
from ..information.information import BLOCK, Excitation, Information
from ..information.payload import described_robot
from ..models.basis import base_parameters, independent_columns
from ..models.dynamics import Dynamics
from ..models.joint_effects import ALL
from ..models.linear_kinematics import FrameKinematics
from ..models.task_kinematics import JointKinematics, TaskKinematics
from ..robot.robot import Robot
from ..simulation.simulate import Progress, watched
from ..tasks.frame import TASKS
from ..tasks.task import JointTask
from ..trajectories.periodic import FourierSeries
from ..tuning.defaults import prior_covariance
from ..tuning.unknowns import Unknown, nominal_dynamics
from .allowance import Allowance, Shapes, configurations

_TORQUE_NOISE = 0.01  # of the effort limit, or of the typical torque of a joint without one
_POSITION_NOISE = 1e-3  # of the reach
_TRANSLATION_PRIOR = 0.1  # of the reach: standard deviation of a translation
_SAMPLES, _SPREAD, _SPEED = 50, 0.5, 1.0  # random states [rad, rad/s, rad/s^2 or m]


@dataclass(frozen=True, eq=False)
class _Part:
    """Parameters (p) of one model: prior in base parameters, and noise of the measured signals."""

    names: tuple[str, ...]
    initial: np.ndarray
    chosen: np.ndarray  # (b) indices of the base parameters
    root: np.ndarray  # (b, b) L of the prior covariance L L^T of the base parameters
    noise: np.ndarray  # (n) of the signals of a row

    def gain(self, W: np.ndarray, rows: float) -> tuple[float, np.ndarray]:
        """Return the information gain [nat] and its derivative (N, n, p) by W.

        Args:
            W: (N, n, p) regressors.
            rows: number of measurements for which the N stand.
        """
        slope = np.zeros(W.shape)
        if not len(self.chosen):
            return 0.0, slope
        share = rows / len(W)
        scaled = W[:, :, self.chosen] / self.noise[:, None] @ self.root
        flat = scaled.reshape(-1, len(self.chosen))
        information = np.eye(len(self.chosen)) + share * (flat.T @ flat)
        by_scaled = share * np.linalg.solve(information, flat.T).T.reshape(scaled.shape)
        slope[:, :, self.chosen] = by_scaled @ self.root.T / self.noise[:, None]
        return 0.5 * float(np.linalg.slogdet(information)[1]), slope

    def information(self, W: np.ndarray, rows: float) -> Information:
        """Return the information of ``rows`` measurements, for which W (N, n, p) stand."""
        noise = self.noise * np.sqrt(max(len(W), 1) / rows)
        none = np.zeros(W.shape[:2])
        found = Information.of_rows(self.names, self.initial, W, none, noise)
        return replace(found, noise=self.noise, rows=round(rows * len(self.noise)))


class Aim:
    """The unknown parameters of a robot, to be identified from torques and frame positions.

    Attributes:
        dynamic, kinematic: numbers of combinations of parameters that any motion can identify.
    """

    def __init__(self, robot: Robot, dynamics: Dynamics, kinematics: TaskKinematics) -> None:
        """Take the nominal robot and its models.

        Raises:
            ParameterError: nothing is unknown, or no motion identifies any of it.
        """
        self._robot, self._dynamics, self._kinematics = robot, dynamics, kinematics
        if not dynamics.size + kinematics.size:
            raise ParameterError(
                "nothing is unknown, so there is nothing to excite.",
                where="unknown",
                hint='Name bodies ("all", "payload", joints) or translations ("tool", joints).',
            )
        dynamics.load(dynamics.initial)
        self._torque = _torque_part(robot, dynamics)
        self._position = _position_part(robot, kinematics)
        self.dynamic, self.kinematic = len(self._torque.chosen), len(self._position.chosen)
        if not self.dynamic + self.kinematic:
            names = ", ".join((*dynamics.names, *kinematics.names)[:10])
            raise ParameterError(
                f"no motion of '{robot.name}' from its base to '{robot.frame}' identifies any of "
                f"the unknown parameters ({names}).",
                where="unknown",
                hint="Name bodies further out; pinadapt.base_parameters returns the identifiable "
                "combinations.",
            )

    def gain(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        duration: float,
        first: int | None = None,
    ) -> tuple[float, np.ndarray]:
        """Return the expected information gain [nat] of N states (N, .) over a duration [s].

        The second is its change when one of the ``first`` states, which count alone, is replaced.
        The other states are k blocks, each with a replacement for every one of the first. The
        changes (k first) are to first order, of one replacement at a time.
        """
        count = len(q) if first is None else first
        total, changes = 0.0, np.zeros(len(q) - count)
        for part, W in (
            (self._torque, self._regressors(q, v, a)),
            (self._position, self._position_regressors(q)),
        ):
            if not W.size:
                continue
            gain, slope = part.gain(W[:count], duration / BLOCK)
            others = W[count:].reshape(-1, *W[:count].shape)
            changes += np.einsum("tij,ktij->kt", slope, others - W[:count]).ravel()
            total += gain
        return total, changes

    def excitation(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, duration: float
    ) -> Excitation:
        """Return the information of N states (N, .), spread over a duration [s]."""
        rows, dynamics = duration / BLOCK, self._dynamics
        units: Mapping[str, str] = {name: "m" for name in self._kinematics.names} | dict(
            zip(dynamics.names, dynamics.units, strict=True)
        )
        return Excitation(
            self._torque.information(self._regressors(q, v, a), rows),
            self._position.information(self._position_regressors(q), rows),
            units,
        )

    def _regressors(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the regressors Y (N, n, p) of the torques."""
        shape = len(q), self._robot.model.nv, self._dynamics.size
        if not self._dynamics.size:
            return np.zeros(shape)
        regressor = self._dynamics.regressor
        return np.array([regressor(*each) for each in zip(q, v, a, strict=True)])

    def _position_regressors(self, q: np.ndarray) -> np.ndarray:
        """Return dx/da_k (N, m, p) of the positions."""
        kinematics = self._kinematics
        if not kinematics.size:
            return np.zeros((len(q), kinematics.positions, 0))
        kinematics.update(kinematics.initial, q[0], np.zeros(kinematics.nv))
        return np.array([kinematics.at(each)[1] for each in q])


def _torque_part(robot: Robot, dynamics: Dynamics) -> _Part:
    """Return the dynamic parameters; prior: inertias within 30 %, coefficients typical ones."""
    model, data, rng = robot.model, robot.model.createData(), np.random.default_rng(0)
    torques, regressors = [], []
    for _ in range(_SAMPLES):
        q = pin.integrate(model, robot.q0, rng.uniform(-_SPREAD, _SPREAD, model.nv))
        v, a = _SPEED * rng.standard_normal((2, model.nv))
        torques.append(pin.rnea(model, data, q, v, a))
        regressors.append(dynamics.regressor(q, v, a))
    typical, Y = np.sqrt(np.mean(np.square(torques), axis=0)), np.array(regressors)
    efforts, size = effort_limits(model), dynamics.inertial.size
    noise = _TORQUE_NOISE * np.where(
        np.isfinite(efforts), efforts, np.maximum(typical, typical.max())
    )
    base = base_parameters(dynamics, robot)
    prior = np.diag(dynamics.typical**2)
    inertial = prior_covariance(robot, dynamics) if size else np.zeros((0, 0))
    if inertial is None:  # of which nothing is known but the torques
        effects = np.sqrt(np.mean(Y**2, axis=(0, 1)))[:size]
        level = np.sqrt(np.mean(typical**2))
        inertial = np.diag((level / np.where(effects > 0.0, effects, np.inf)) ** 2)
    prior[:size, :size] = inertial
    root = _root(base.regrouping @ prior @ base.regrouping.T)
    return _Part(tuple(dynamics.names), dynamics.initial, base.chosen, root, noise)


def _position_part(robot: Robot, kinematics: TaskKinematics) -> _Part:
    """Return the kinematic parameters; prior: each within a tenth of the reach."""
    rng, m, size = np.random.default_rng(0), kinematics.positions, kinematics.size
    rows = [np.zeros((0, size))]
    for _ in range(_SAMPLES if size else 0):
        q = pin.integrate(robot.model, robot.q0, rng.uniform(-np.pi, np.pi, robot.model.nv))
        kinematics.update(kinematics.initial, q, np.zeros(robot.model.nv))
        rows.append(kinematics.X_k)
    chosen, R = independent_columns(np.vstack(rows))
    root = _TRANSLATION_PRIOR * robot.reach * _root(R @ R.T)
    noise = np.full(m, _POSITION_NOISE * robot.reach)
    return _Part(tuple(kinematics.names), kinematics.initial, chosen, root, noise)


def _root(covariance: np.ndarray) -> np.ndarray:
    """Return an L with covariance = L L^T."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


_FASTEST = 0.5  # [Hz] of the harmonics, unless the duration is too short
_FEWEST, _MOST = 3, 8  # harmonics, by default
_PER_HARMONIC, _FINE = 16, 120  # instants per harmonic, in the search and in the last check
_STARTS, _ITERATIONS = 24, 60
_PENALTY = 200.0  # [nat] for exceeding an allowance by its own size at all instants
_STEP = 1e-6  # of numerical derivatives [rad or m, and per s or s^2]
_BISECTIONS = 20  # in the last check


def excite(
    robot: Robot | Controller,
    *,
    unknown: Unknown | str | Sequence[str] | None = None,
    duration: float = 10.0,
    harmonics: int | None = None,
    excursion: ArrayLike | None = None,
    load: float | None = None,
    srdf: Path | str | None = None,
    floor: float | None = None,
    seed: int = 0,
    progress: Progress | bool | None = None,
) -> ExcitingMotion:
    """Find a motion of the joints that identifies unknown parameters, within all limits.

    The motion is a Fourier series for each joint, from rest at home and back (Swevers and others,
    1997), with the largest expected information gain about the base parameters (see ``Aim``). It is
    found by quasi-Newton steps from the best of some random series.

    It stays away from the ends of each joint's range by a twentieth of it, uses at most four fifths
    of the velocity and effort limits, the latter with and without a load, and keeps joints and
    frame above the horizontal plane that the robot is mounted on. Bodies with collision geometry
    stay apart from each other, and all stay above a floor, see ``Shapes``.

    Args:
        robot: the nominal model, of any task, at its home; or a controller, whose unknown
            parameters are taken.
        unknown: what the motion is to excite, an ``Unknown`` or words for it; by default all
            bodies, friction and rotor inertias. Translations, ``tool`` among them, are those that a
            camera would show.
        duration: of the motion, and period of the series [s].
        harmonics: of the series, at least 2; by default as many as stay within half a hertz, from 3
            to 8.
        excursion: how far joints may move from home, one or one per joint [rad or m]; by default a
            quarter of a turn and half a metre.
        load: mass of the heaviest load at the frame [kg]; by default a tenth of the robot's mass,
            halved until the motors hold it at home.
        srdf: a file whose ``disable_collisions`` name links that may touch.
        floor: height of a floor [m], in the axes of the robot's base; None for none.
        seed: of the random series.
        progress: as in ``simulate``.

    Raises:
        InputError: nothing is unknown, no motion identifies it, or impossible numbers.
        RobotError: home is outside the limits, or the motors cannot hold arm and load there.
    """
    nominal, aim = _nominal_and_aim(robot, unknown)
    duration = positive(duration, "duration", error=InputError)
    if harmonics is None:
        harmonics = min(max(round(_FASTEST * duration), _FEWEST), _MOST)
    harmonics = whole(harmonics, "harmonics", 2, most=MOST_SAMPLES)
    level = None if floor is None else float(numbers(floor, "floor", error=InputError))
    shapes = Shapes.of(nominal, srdf, level)
    allowed = Allowance.of(nominal, excursion, load, shapes, level)
    search = _Search(aim, allowed, RestToRest(harmonics, duration, _PER_HARMONIC * harmonics))
    theta = search.best(whole(seed, "seed", 0), watched(range(_ITERATIONS), progress, "excite"))
    fine = RestToRest(harmonics, duration, _FINE * harmonics)
    check = _Search(aim, allowed, fine)
    theta = check.inside(theta)
    angles, q, v, a = check.states(theta)
    return ExcitingMotion(
        fine.series(nominal.home_angles, theta),
        duration,
        aim.excitation(q, v, a, duration),
        LimitUse.of(allowed, angles, q, v, a),
        (aim.dynamic, aim.kinematic),
        aim.gain(q, v, a, duration)[0],
    )


def _nominal_and_aim(
    given: Robot | Controller, unknown: Unknown | str | Sequence[str] | None
) -> tuple[Robot, Aim]:
    """Return the nominal robot and its unknown parameters.

    Raises:
        InputError: unknown words, or no parameter that a motion identifies.
    """
    instance(given, Robot | Controller, "robot")
    if isinstance(given, Controller):
        if unknown is not None:
            raise InputError("a controller has its own unknown parameters.", where="unknown")
        nominal = described_robot(given)
        return nominal, Aim(nominal, given.dynamics, given.kinematics)
    nominal, unknown = given, Unknown.of(unknown)
    dynamics = nominal_dynamics(nominal, unknown, ALL)
    translations = unknown.translation_words(tool=False)
    kinematics: TaskKinematics
    if not translations:
        kinematics = JointKinematics(replace(nominal, task=JointTask.of_chain(nominal.model)), ())
    else:
        in_joints = isinstance(nominal.task, JointTask)
        framed = replace(nominal, task=TASKS["xyz"]) if in_joints else nominal
        kinematics = FrameKinematics(framed, translations)
    return nominal, Aim(nominal, dynamics, kinematics)


class _Search:
    """Motions of coefficients theta (n, size), evaluated at the instants of a period."""

    def __init__(self, aim: Aim, allowed: Allowance, basis: RestToRest) -> None:
        """Take the unknown parameters, the allowance, and the family of motions."""
        self._aim, self._allowed, self._basis = aim, allowed, basis
        self._home = allowed.robot.home_angles

    def states(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return angles (N, n), configurations (N, nq), velocities and accelerations (N, n)."""
        displacement, v, a = self._basis.motion(theta)
        angles = self._home + displacement
        return angles, configurations(self._allowed.robot, angles), v, a

    def best(self, seed: int, iterations: Iterable[int]) -> np.ndarray:
        """Return the coefficients of largest gain, nearly within the allowance."""
        from scipy.optimize import minimize  # here, because scipy is slow to import

        rng, shape = np.random.default_rng(seed), (len(self._home), self._basis.size)
        starts = [self.inside(rng.standard_normal(shape)) for _ in range(_STARTS)]
        first = min(starts, key=self._negative_gain)
        size, steps = np.abs(first).max(), iter(iterations)

        def cost(z: np.ndarray) -> tuple[float, np.ndarray]:
            """Return the cost and its slope in coordinates of order one."""
            value, slope = self._cost(size * z.reshape(shape))
            return value, size * slope.ravel()

        next(steps, None)
        found = minimize(
            cost,
            (first / size).ravel(),
            jac=True,
            method="L-BFGS-B",
            callback=lambda _: next(steps, None),
            options={"maxiter": _ITERATIONS},
        )
        for _ in steps:  # complete the progress bar
            pass
        return np.asarray(size * found.x.reshape(shape))

    def inside(self, theta: np.ndarray) -> np.ndarray:
        """Return theta times the largest factor up to one whose motion keeps all limits.

        Raises:
            RobotError: no factor does.
        """
        if self._kept(theta):
            return theta
        low, high = 0.0, 1.0
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._kept(middle * theta) else (low, middle)
        if not low:
            raise RobotError(
                "no motion from home keeps the limits.",
                where=self._allowed.robot.name,
                hint="Take another home pose, or a lighter load.",
            )
        return low * theta

    def _kept(self, theta: np.ndarray) -> bool:
        return self._allowed.kept(*self.states(theta))

    def _negative_gain(self, theta: np.ndarray) -> float:
        return -self._aim.gain(*self.states(theta)[1:], self._basis.period)[0]

    def _cost(self, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the penalty for exceeded allowances minus the gain [nat], and its derivative.

        The derivative (n, size) is by differences in the 3 n states of each instant, fewer than the
        coefficients.
        """
        displacement, v, a = self._basis.motion(theta)
        now = np.stack([self._home + displacement, v, a])  # (3, N, n)
        count, n = v.shape
        shifts = _STEP * np.eye(3 * n).reshape(3 * n, 3, 1, n)
        states = np.concatenate([now[None], now + shifts]).transpose(1, 0, 2, 3)
        angles, v, a = states.reshape(3, -1, n)
        q = configurations(self._allowed.robot, angles)
        gain, changes = self._aim.gain(q, v, a, self._basis.period, count)
        beyond = _PENALTY / count * np.sum(self._allowed.excess(angles, q, v, a) ** 2, axis=1)
        beyond = beyond.reshape(1 + 3 * n, count)
        slopes = (beyond[1:] - beyond[0] - changes.reshape(3 * n, count)) / _STEP
        return float(beyond[0].sum()) - gain, self._basis.derivative(slopes.reshape(3, n, count))


_DIGITS = 7  # of a coefficient in a file


@dataclass(frozen=True, eq=False, repr=False)
class ExcitingMotion:
    """A motion of the joints from home and back, and the information expected of it.

    ``print`` shows the use of each limit, the identifiable combinations, and the uncertainty that
    each parameter would have with the assumed noise: 1 % of the effort limits in the torque,
    averaged over 50 ms, and a thousandth of the reach in a position.

    Attributes:
        trajectory: of the joints, for a robot loaded with ``task="joint"``; it repeats itself.
        duration: of the motion [s].
        excitation: information about the parameters, at their nominal values.
        limits: the share of each limit that it uses.
        identifiable: numbers of combinations of dynamic and of kinematic parameters that any motion
            can identify.
        information_gain: expected from the data, given the prior [nat].
    """

    trajectory: FourierSeries
    duration: float
    excitation: Excitation
    limits: LimitUse
    identifiable: tuple[int, int]
    information_gain: float

    def reference(self) -> dict[str, Any]:
        """Return the motion as the table ``[trajectory]`` of a scenario with ``task = "joint"``."""
        series = self.trajectory
        return {
            "kind": "fourier",
            "center": _written(series.center),
            "cosine": [_written(row) for row in series.cosine],
            "sine": [_written(row) for row in series.sine],
            "period": series.period,
        }

    def __repr__(self) -> str:
        """Return tables of limits and of parameters."""
        return str(self._sheet())

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def _sheet(self) -> Sheet:
        limits, found = self.limits, self.excitation
        rows = [("duration", f"{self.duration:g} s, {self.trajectory.harmonics} harmonics")]
        for part, name, most in (
            (found.dynamic, "dynamic", self.identifiable[0]),
            (found.kinematic, "kinematic", self.identifiable[1]),
        ):
            if part.names:
                share = f"all {most}" if part.rank == most else f"{part.rank} of {most}"
                rows.append((name, f"{share} identifiable combinations are excited"))
        rows.append(("efforts", f"with and without a load of {limits.load:.3g} kg"))
        if np.isfinite(limits.clearance):
            rows.append(("clearance", f"{limits.clearance:.3g} m above the mounting plane"))
        if np.isfinite(limits.apart):
            rows.append(("distance", f"{limits.apart:.3g} m between {limits.closest}"))
        note = "Collisions of the robot with its surroundings are not checked."
        if not limits.shapes:
            note += " Nor are those with itself: the description has no collision geometry."
        return Sheet("Exciting motion", [Table(rows), limits.table(), *found.tables()], note)


def _written(values: np.ndarray) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") + 0.0 for value in values]


@dataclass(frozen=True, eq=False)
class LimitUse:
    """The share of each limit that a motion uses; 1 is at the limit, 0 also stands for no limit.

    Attributes:
        joints: names (n).
        position: (n) of half the range of a joint, from its middle.
        velocity: (n).
        effort: (n) the larger one with and without the heaviest load.
        load: mass of the heaviest load [kg], in the origin of the frame.
        clearance: smallest distance of a joint or the frame from the mounting plane [m]; infinite
            for a robot that moves along that plane.
        apart: smallest distance of two bodies, or of a body from the floor [m]; infinite where
            none was checked.
        closest: the names of these two.
        shapes: whether the bodies have shapes; otherwise only joints and frame stay off the floor.
    """

    joints: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    load: float
    clearance: float
    apart: float = np.inf
    closest: str = ""
    shapes: bool = False

    @classmethod
    def of(
        cls, allowed: Allowance, angles: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> LimitUse:
        """Return the shares that N states of a motion use."""
        robot = allowed.robot
        lower, upper = position_limits(robot.model)
        with np.errstate(invalid="ignore"):  # of joints without limits
            position = np.abs(2.0 * angles - lower - upper).max(axis=0) / (upper - lower)
        efforts = np.abs(allowed.torques(q, v, a)).max(axis=(0, 1))
        return cls(
            tuple(robot.joint_names),
            np.nan_to_num(position),
            np.abs(v).max(axis=0) / velocity_limits(robot.model),
            efforts / effort_limits(robot.model),
            allowed.load,
            allowed.clearance(q),
            *allowed.apart(q),
            allowed.shapes is not None,
        )

    def table(self) -> Table:
        """Return a row for each joint, in per cent of each limit."""
        parts = zip(self.joints, self.position, self.velocity, self.effort, strict=True)
        rows = [
            (name, *(f"{share:.0%}" if share else "no limit" for share in use))
            for name, *use in parts
        ]
        return Table(rows, ("joint", "of position", "of velocity", "of effort limit"))


class RestToRest:
    """Motions x(t) = x_0 + Phi(t) theta, whose velocity and acceleration vanish at t = 0.

    Phi stacks cosines and sines of K harmonics. The two conditions leave 2 K - 2 of the 2 K
    coefficients of each coordinate free: theta, scaled so that equal ones cause equal speeds.

    Attributes:
        size: 2 K - 2.
        period: [s].
        times: (N) instants of a period [s] at which motions are evaluated.
    """

    def __init__(self, harmonics: int, period: float, samples: int) -> None:
        """Take K of at least 2, the period [s], and the number N of instants."""
        k = np.arange(1.0, harmonics + 1.0)
        conditions = np.zeros((2, 2 * harmonics))
        conditions[0, :harmonics], conditions[1, harmonics:] = k, np.ones(harmonics)
        scale = np.tile(1.0 / k, 2)  # coefficients of equal speed
        self._free = scale[:, None] * np.linalg.svd(conditions)[2][2:].T
        self._harmonics, self.period = harmonics, period
        self.size = self._free.shape[1]
        self.times = np.linspace(0.0, period, samples, endpoint=False)
        w = 2.0 * np.pi / period * k
        c, s = np.cos(np.outer(self.times, w)), np.sin(np.outer(self.times, w))
        rows = [[c - 1.0, s], [-w * s, w * c], [-w * w * c, -w * w * s]]
        self._rows = np.array([np.hstack(row) for row in rows]) @ self._free  # (3, N, size)

    def motion(self, theta: np.ndarray) -> np.ndarray:
        """Return displacement, velocity and acceleration (3, N, n) for theta (n, size)."""
        return np.asarray(self._rows @ theta.T)

    def derivative(self, by_states: np.ndarray) -> np.ndarray:
        """Return a derivative (n, size) by theta from that (3, n, N) by the states."""
        return np.asarray((by_states @ self._rows).sum(axis=0))

    def series(self, start: np.ndarray, theta: np.ndarray) -> FourierSeries:
        """Return the motion for theta (n, size) from a start (n)."""
        cosine, sine = np.split(theta @ self._free.T, [self._harmonics], axis=1)
        return FourierSeries(start - cosine.sum(axis=1), cosine, sine, self.period)
