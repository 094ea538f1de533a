"""The exciting motion of largest information gain within all limits, and its search.

With a prior covariance P of the parameters and the information matrix H of a motion, the expected
information gain is log det(1 + P H) / 2 nats (Lindley, *On a measure of the information provided by
an experiment*, 1956). Without a prior, maximising it is the D-optimal design of Swevers (1997).
P and H are taken in base parameters, the combinations of parameters that motion can identify.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import MOST_PARAMETERS, instance, numbers, positive, whole
from .._output import Printed, Report, Table
from ..description.chain import effort_limits, position_limits, velocity_limits
from ..exceptions import InputError, ParameterError, RobotError
from ..information.information import BLOCK, Information, identifiable, parameter_table
from ..information.measured_motion import integrated
from ..models.basis import base_parameters
from ..models.dynamics import Dynamics
from ..models.excited import scales
from ..models.joint_effects import ALL
from ..robot.robot import Robot
from ..simulation.simulate import watched
from ..trajectories.periodic import FourierSeries
from ..tuning.unknowns import Unknown, nominal_dynamics
from .allowance import Allowance, Shapes, States

_NOISE = 0.01  # of the effort limit; half or twice as much changes the stated uncertainty by that
# Instants per harmonic, in the search and in the last check: half and twice of the first: 88 and 93
# nat of a UR5; of the second: the same motions.
_PER_HARMONIC, _FINE = 16, 120
# Half and twice of the first: 91 and 90 nat; of the second: 86 and 97.
_STARTS, _ITERATIONS = 24, 60
# [nat] for exceeding an allowance by its own size at all instants; half, twice: 77 and 90 nat
_PENALTY = 200.0
# of numerical derivatives [rad or m, and per s or s^2]; distances of shapes are known to 1e-9 m
_STEP = float(np.cbrt(np.finfo(float).eps))


def excite(
    robot: Robot,
    *,
    unknown: Unknown | str | Sequence[str] | None = None,
    duration: float = 10.0,
    harmonics: int = 5,
    excursion: ArrayLike | None = None,
    load: float | None = None,
    srdf: Path | str | None = None,
    floor: float | None = None,
    seed: int = 0,
    progress: bool | None = None,
) -> ExcitingMotion:
    """Find a motion of the joints that identifies unknown dynamic parameters, within all limits.

    The motion is a Fourier series for each joint, from rest at home and back (Swevers and others,
    1997), with the largest expected information gain about the base parameters. It is found by
    quasi-Newton steps from the best of some random series.

    It stays away from the ends of each joint's range by a twentieth of it, uses at most four fifths
    of the velocity and effort limits, the latter with and without a load, and keeps joints and
    frame above the horizontal plane that the robot is mounted on. Bodies with collision geometry
    stay apart from each other, and all stay above a floor, see ``Shapes``.

    Args:
        robot: the nominal model, of any task, at its home.
        unknown: what the motion is to excite, an ``Unknown`` or words for it; by default all
            bodies, friction and rotor inertias.
        duration: of the motion, and period of the series [s].
        harmonics: of the series, at least 2; ten seconds with the default reach half a hertz.
        excursion: how far joints may move from home, one or one per joint [rad or m]; by default a
            quarter of a turn and half a metre.
        load: mass of the heaviest load at the frame [kg]; by default a tenth of the robot's mass,
            and at most half of what the motors hold at home.
        srdf: a file whose ``disable_collisions`` name links that may touch.
        floor: height of a floor [m], in the axes of the robot's base; None for none.
        seed: of the random series.
        progress: as in ``simulate``.

    Raises:
        InputError: nothing is unknown, no motion identifies it, or impossible numbers.
        RobotError: home is outside the limits, or the motors cannot hold arm and load there.
    """
    dynamics = nominal_dynamics(instance(robot, Robot, "robot"), Unknown.of(unknown), ALL)
    robot.check_single_frame()
    duration = positive(duration, "duration", error=InputError)
    harmonics = whole(harmonics, "harmonics", 2, most=MOST_PARAMETERS)
    level = None if floor is None else float(numbers(floor, "floor"))
    allowed = Allowance(robot, excursion, load, Shapes.of(robot, srdf, level), level)
    coarse, fine = (
        _Search(dynamics, allowed, RestToRest(harmonics, duration, count * harmonics))
        for count in (_PER_HARMONIC, _FINE)
    )
    steps = watched(range(_ITERATIONS), progress, "excite")
    theta = fine.inside(coarse.best(whole(seed, "seed", 0), steps))
    states = fine.states(theta)
    return ExcitingMotion(
        fine.basis.series(robot.home_angles, theta),
        duration,
        fine.information(states),
        dict(zip(dynamics.names, dynamics.units, strict=True)),
        LimitUse.of(allowed, states),
        len(fine.chosen),
        fine.gain(states)[0],
    )


class _Search:
    """Motions of coefficients theta (n, size), evaluated at the instants of a period.

    Attributes:
        basis: the family of motions.
        chosen: (b) indices of the base parameters.
    """

    def __init__(self, dynamics: Dynamics, allowed: Allowance, basis: RestToRest) -> None:
        """Take the unknown parameters, the allowance, and the family of motions.

        Raises:
            ParameterError: no motion identifies any of the parameters.
        """
        self._dynamics = dynamics
        self._allowed = allowed
        self.basis = basis
        robot = allowed.robot
        self._home = robot.home_angles
        efforts = effort_limits(robot.model)
        self._noise = _NOISE * np.where(
            np.isfinite(efforts), efforts, 9.81 * robot.mass * robot.reach
        )
        dynamics.load(dynamics.initial)
        base = base_parameters(dynamics, robot) if dynamics.size else None
        if base is None or not base.size:
            raise ParameterError(
                f"no motion of '{robot.name}' from its base to '{robot.frame}' identifies any "
                f"unknown dynamic parameter ({', '.join(dynamics.names[:10])}).",
                where="unknown",
                hint='Name bodies ("all", "payload", joints further out).',
            )
        self.chosen = base.chosen
        prior = base.regrouping @ scales(dynamics, dynamics.initial)
        values, vectors = np.linalg.eigh(prior @ prior.T)
        self._root = vectors * np.sqrt(np.maximum(values, 0.0))

    def _states(self, angles: np.ndarray, v: np.ndarray, a: np.ndarray) -> States:
        """Return states with these angles, velocities and accelerations (N, n)."""
        model = self._allowed.robot.model
        return States(angles, integrated(model, pin.neutral(model), angles), v, a)

    def states(self, theta: np.ndarray) -> States:
        """Return the states of a motion."""
        displacement, v, a = self.basis.rows @ theta.T
        return self._states(self._home + displacement, v, a)

    def gain(self, states: States, first: int | None = None) -> tuple[float, np.ndarray]:
        """Return the expected information gain [nat] of N states (N, .) over the period.

        The second is its change when one of the ``first`` states, which count alone, is replaced.
        The other states are k blocks, each with a replacement for every one of the first. The
        changes (k, first) are to first order, of one replacement at a time.
        """
        count = first or len(states.q)
        b = len(self.chosen)
        rows = self._regressors(states)[:, :, self.chosen] / self._noise[:, None] @ self._root
        W = rows[:count]
        others = rows[count:].reshape(-1, count, *rows.shape[1:])
        share = self.basis.period / BLOCK / count
        flat = W.reshape(-1, b)
        information = np.eye(b) + share * (flat.T @ flat)
        slope = share * np.linalg.solve(information, flat.T).T.reshape(W.shape)
        changes = np.einsum("tij,ktij->kt", slope, others - W)
        return 0.5 * float(np.linalg.slogdet(information)[1]), changes

    def information(self, states: States) -> Information:
        """Return the information of a motion's states, one measurement in each block of time."""
        W = self._regressors(states)
        noise = self._noise * np.sqrt(len(W) / (self.basis.period / BLOCK))
        return Information.of_rows(
            self._dynamics.names, self._dynamics.initial, W, 0.0 * W[:, :, 0], noise
        )

    def _regressors(self, states: States) -> np.ndarray:
        """Return the regressors Y (N, n, p) of the torques."""
        return np.array(
            [self._dynamics.regressor(*state) for state in zip(*states[1:], strict=True)]
        )

    def best(self, seed: int, iterations: Iterable[int]) -> np.ndarray:
        """Return the coefficients of largest gain, nearly within the allowance."""
        from scipy.optimize import minimize  # here, because scipy is slow to import

        rng = np.random.default_rng(seed)
        shape = (len(self._home), self.basis.size)
        starts = (self.inside(rng.standard_normal(shape)) for _ in range(_STARTS))
        first = max(starts, key=lambda theta: self.gain(self.states(theta))[0])
        size = np.abs(first).max()
        steps = iter(iterations)

        def cost(z: np.ndarray) -> tuple[float, np.ndarray]:
            """Return the cost and its slope in coordinates of order one."""
            value, slope = self.cost(size * z.reshape(shape))
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
        return size * found.x.reshape(shape)

    def inside(self, theta: np.ndarray) -> np.ndarray:
        """Return theta times the largest factor up to one whose motion keeps all limits.

        Raises:
            RobotError: no factor does.
        """

        def kept(factor: float) -> bool:
            return self._allowed.kept(self.states(factor * theta))

        if kept(1.0):
            return theta
        low = 0.0
        for k in range(1, 21):
            if kept(low + 0.5**k):
                low += 0.5**k
        if not low:
            raise RobotError(
                "no motion from home keeps the limits.",
                where=self._allowed.robot.name,
                hint="Take another home pose, or a lighter load.",
            )
        return low * theta

    def cost(self, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the penalty for exceeded allowances minus the gain [nat], and its derivative.

        The derivative (n, size) is by differences in the 3 n states of each instant, fewer than the
        coefficients.
        """
        now = self.basis.rows @ theta.T  # (3, N, n)
        now[0] += self._home
        _, count, n = now.shape
        shifts = _STEP * np.eye(3 * n).reshape(3 * n, 3, 1, n)
        moved = np.concatenate([now[None], now + shifts]).transpose(1, 0, 2, 3)
        states = self._states(*moved.reshape(3, -1, n))
        gain, changes = self.gain(states, count)
        beyond = _PENALTY / count * np.sum(self._allowed.excess(states) ** 2, axis=1)
        beyond = beyond.reshape(1 + 3 * n, count)
        slopes = ((beyond[1:] - beyond[0] - changes) / _STEP).reshape(3, n, count)
        return beyond[0].sum() - gain, (slopes @ self.basis.rows).sum(axis=0)


@dataclass(frozen=True, eq=False, repr=False)
class ExcitingMotion(Printed):
    """A motion of the joints from home and back, and the information expected of it.

    ``print`` shows the use of each limit, the identifiable combinations, and the uncertainty that
    each parameter would have with the assumed noise: 1 % of the effort limits in the torque,
    averaged over 50 ms.

    Attributes:
        trajectory: of the joints, for a robot loaded with ``task="joint"``; it repeats itself.
        duration: of the motion [s].
        information: about the dynamic parameters, at their nominal values.
        units: name of a parameter -> its unit.
        limits: the share of each limit that it uses.
        identifiable: number of combinations of the parameters that any motion can identify.
        information_gain: expected from the data, given the prior [nat].
    """

    trajectory: FourierSeries
    duration: float
    information: Information
    units: dict[str, str]
    limits: LimitUse
    identifiable: int
    information_gain: float

    def reference(self) -> dict[str, Any]:
        """Return the motion as the table ``[trajectory]`` of a scenario with ``task = "joint"``."""
        return {
            "kind": "fourier",
            **{  # to eight decimals, 10 nm
                name: getattr(self.trajectory, name).round(8).tolist()
                for name in ("center", "cosine", "sine")
            },
            "period": self.trajectory.period,
        }

    def report(self) -> Report:
        """Return tables of limits and of parameters."""
        limits = self.limits
        rows = [
            ("duration", f"{self.duration:g} s, {self.trajectory.harmonics} harmonics"),
            ("parameters", f"{identifiable(self.information)}, {self.identifiable} by any motion"),
            ("efforts", f"with and without a load of {limits.load:.3g} kg"),
            ("distance", f"{limits.apart:.3g} m between two bodies"),
        ]
        note = "Collisions of the robot with its surroundings are not checked."
        if not np.isfinite(limits.apart):
            note += " Nor are those with itself: the description has no collision geometry."
        return Report(
            "Exciting motion",
            [Table(rows), limits.table(), parameter_table(self.information, self.units)],
            note,
        )


@dataclass(frozen=True, eq=False)
class LimitUse:
    """The share of each limit that a motion uses; 1 is at the limit, 0 also stands for no limit.

    Attributes:
        joints: names (n).
        position: (n) of half the range of a joint, from its middle.
        velocity: (n).
        effort: (n) the larger one with and without the heaviest load.
        load: mass of the heaviest load [kg], in the origin of the frame.
        apart: smallest distance of two bodies, or of a body from the floor [m]; infinite where
            none was checked.
    """

    joints: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    load: float
    apart: float

    @classmethod
    def of(cls, allowed: Allowance, states: States) -> LimitUse:
        """Return the shares that the states of a motion use."""
        robot = allowed.robot
        lower, upper = position_limits(robot.model)
        with np.errstate(invalid="ignore"):  # of joints without limits
            position = np.abs(2.0 * states.angles - lower - upper).max(axis=0) / (upper - lower)
        return cls(
            tuple(robot.joint_names),
            np.nan_to_num(position),
            np.abs(states.v).max(axis=0) / velocity_limits(robot.model),
            np.abs(allowed.torques(states)).max(axis=(0, 1)) / effort_limits(robot.model),
            allowed.load,
            np.inf if allowed.shapes is None else float(allowed.shapes.distances(states.q).min()),
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
        rows: (3, N, size) those of x - x_0, of velocity and of acceleration at N instants.
    """

    def __init__(self, harmonics: int, period: float, samples: int) -> None:
        """Take K of at least 2, the period [s], and the number N of instants to evaluate."""
        k = np.arange(1.0, harmonics + 1.0)
        conditions = np.zeros((2, 2 * harmonics))
        conditions[0, :harmonics], conditions[1, harmonics:] = k, np.ones(harmonics)
        scale = np.tile(1.0 / k, 2)  # coefficients of equal speed
        self._free = scale[:, None] * np.linalg.svd(conditions)[2][2:].T
        self.period = period
        self.size = self._free.shape[1]
        times = np.linspace(0.0, period, samples, endpoint=False)
        w = 2.0 * np.pi / period * k
        c = np.cos(np.outer(times, w))
        s = np.sin(np.outer(times, w))
        cosines = [c - 1.0, -w * s, -w * w * c]
        sines = [s, w * c, -w * w * s]
        self.rows = np.concatenate([cosines, sines], axis=2) @ self._free

    def series(self, start: np.ndarray, theta: np.ndarray) -> FourierSeries:
        """Return the motion for theta (n, size) from a start (n)."""
        cosine, sine = np.split(theta @ self._free.T, 2, axis=1)
        return FourierSeries(start - cosine.sum(axis=1), cosine, sine, self.period)
