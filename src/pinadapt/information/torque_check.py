"""Whether recorded torques can be those of a described robot, and if not, what is the likely cause.

For each joint the torque tau of a log is compared with what the description predicts, d, from its
inverse dynamics without friction. Both are averaged over windows, and what viscous and Coulomb
friction of the joint could explain is removed from both. Then

    factor = <tau, d> / <d, d>,        correlation = <tau, d> / (|tau| |d|).

Friction, noise, inertias that are wrong by a third and wear leave the factor between 0.5 and 2.2:
logs of four real arms gave 0.65 to 2.0, correlations of at least 0.79. Currents, torques before the
gear, a wrong sign or another mounting do not. A joint is judged where the described torque is at
least a twentieth of the largest one.

Gravity enters linearly, g(q) = G(q) gamma, so its direction follows from the log by least squares.
A load that is not described is allowed for.

A log that does not fit is compared with what usual mistakes would make of it: the likeliest of
those after which it fits is named, by the sum over the joints of log(residual^2).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, islice, permutations
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from .._output import Sheet, Table
from ..description.chain import (
    angles_from_configuration,
    configuration_from_angles,
    effort_limits,
)
from ..exceptions import LogError
from ..logs.log import Log
from ..models.regressor import PER_BODY
from ..robot.robot import Robot
from .measured_motion import MeasuredMotion, motion_of_log

CUTOFF = 15.0  # [Hz] for noisy positions
_WINDOW, _FEWEST = 0.2, 16  # [s] and samples of a window
_WHOLE = 0.25  # of a window's length: the weight of its samples, 0.375 without a gap
_MOST, _FEWEST_WINDOWS = 250, 5
_ROWS_A_WINDOW = 1.5  # by which overlapping windows make deviations too small
_SLIDING = 0.02  # [rad/s or m/s] from where Coulomb friction has its full size
_FACTORS = (0.5, 2.2)  # between which a joint is as described
_USUAL = (0.65, 2.0)  # between which residuals are compared
_CLEAR, _LEAST = 0.75, 0.4  # correlations: of a clear relation, and of one that may be there
_VISIBLE = 0.05  # of the largest described torque, from where on a joint is judged
_AGAINST = 0.01  # of it, from where on a wrong sign is seen; of the torques likewise
_CLOSE = 0.2  # of the torques of judged joints, that a good explanation leaves
_CLAIMED = 0.3  # of the torque, from where on a description must be seen in it
_DRIVING = 0.6  # of a joint's torque that follows its velocity, which then has the wrong sign
# of what is left of a joint's torque: that follows another joint's velocity rather than its own;
# then of its torque: that is left
_FOREIGN, _LEFT = 0.4, 0.25
_TURNED = math.radians(25.0)  # from the described gravity
_STRENGTH = (0.6, 1.6)  # of gravity, between which its direction is believed
_SCATTER = 1.5  # by which the factors of joints differ that have one gain in common
_HEAVY, _SAME, _SIZE = 0.3, 0.95, (0.8, 1.25)  # share of the largest torque; correlation; factor
_PRICE = 0.15  # of each number that an explanation chooses, in log(residual^2)
_LOAD_NUMBERS = 4  # mass and first moments
# log(residual^2) by which a mistake must be likelier than none, and a finding than another one
_SURELY, _LIKELIER = 3.5, 1.0
_AS_GOOD, _NAMED = 0.5, 3  # log(residual^2) within which mistakes are named together; at most
_HEAVIEST, _LIGHTEST = 0.8, 0.3  # of the robot's mass: a load; what any arm can carry
_HELD = 0.6  # of the largest effort limit: the weight of a load at full reach
_USUAL_LOAD = (0.2, 0.2)  # of the mass of the robot, and of its reach
_FARTHEST = 0.6  # of the reach: its centre
_CALIBRATION = 0.2  # [kg] by which the mass of a body may be off
_LEAST_NOISE = 0.02  # of a joint's torque
_ORDERED, _SOME_WINDOWS = 7, 40  # joints of which all orders are tried, and by how many windows
_BEST_ORDERS = 40  # of them that are compared in full
_ROUNDS = 3  # in which the noise is found
_SMALLEST, _MATCH = 0.1, 0.15  # [kg] of a body that may be missing; relative difference of its mass
_SURE = 4.0  # standard deviations
_ZERO, _PARALLEL, _FLAT = 1e-9, 1e-6, 0.02
_DEGREE = math.pi / 180.0
GRAVITY = 9.81  # [m/s^2]


class JointFactor(NamedTuple):
    """How the torque of a joint compares with the description.

    Attributes:
        joint: its name.
        torque: root mean square [N m or N].
        described: that of what the description predicts, friction removed [N m or N].
        gravity_factor, gravity_correlation: of the torque and the described gravity torque.
        factor, correlation: of the torque and the whole described torque, friction removed.
        judged: whether the description predicts enough to judge the joint.
        fits: whether the joint is as described; true where it is not judged.
    """

    joint: str
    torque: float
    described: float
    gravity_factor: float
    gravity_correlation: float
    factor: float
    correlation: float
    judged: bool
    fits: bool


class Cause(NamedTuple):
    """A likely cause of torques that do not fit.

    Attributes:
        words: what it is.
        option: of ``pinadapt identify`` that corrects it, or nothing.
    """

    words: str
    option: str = ""

    def turns(self, joint: str) -> bool:
        """Whether the position or the torque of a joint has the wrong sign, or all torques."""
        flipped = "--flip" in self.option and joint in re.split(r"[\s,:]+", self.option)
        return flipped or "--torque-gain=-" in self.option

    def __str__(self) -> str:
        """Return both in a sentence."""
        mark = "" if self.words.endswith("?") else ";"
        return f"{self.words}{mark} {self.option} corrects that" if self.option else self.words


@dataclass(frozen=True, eq=False, repr=False)
class TorqueCheck:
    """The comparison of a log with a description; ``print`` shows a table.

    Attributes:
        source: of the log.
        joints: (n) factors and correlations.
        gravity: (3) gravity as the log shows it [m/s^2], in the axes of the base; NaN if it cannot.
        load: mass [kg] of a load, added to the description, that the log shows, and its standard
            deviation.
        causes: likely ones of torques that do not fit, the likeliest first; none: they fit.
        notes: other findings, which do no harm.
    """

    source: str
    joints: tuple[JointFactor, ...]
    gravity: np.ndarray
    load: tuple[float, float]
    causes: tuple[Cause, ...]
    notes: tuple[str, ...] = ()

    @property
    def fits(self) -> bool:
        """Whether the log can be one of the described robot."""
        return not self.causes

    @property
    def verdict(self) -> str:
        """The result in one line."""
        if self.fits:
            factors = ", ".join(f"{one.factor:.2f}" for one in self.joints if one.judged)
            if not factors:
                return "the description predicts too little torque to judge the log by it."
            return f"the torques fit the description ({factors} times it at the judged joints)."
        first, *others = self.causes
        also = "".join(f" Or {other}." for other in others)
        return f"the torques do not fit the description: {first}.{also}"

    def table(self) -> Table:
        """Return one row for each joint."""
        header = ("joint", "torque", "described", "of gravity", "corr.", "of all", "corr.", "")
        rows = [
            (
                one.joint,
                *(f"{value:.3g}" for value in (one.torque, one.described)),
                *(f"{value:.2f}" if np.isfinite(value) else "-" for value in one[3:7]),
                ("fits" if one.fits else "DOES NOT FIT") if one.judged else "too little to judge",
            )
            for one in self.joints
        ]
        return Table(rows, header)

    @property
    def legend(self) -> str:
        """What the columns of the table are."""
        return (
            "torque, described: rms of both. of gravity, of all: slope of the torque over the "
            "described torque of gravity, and over all of it. corr.: correlation with all of it."
        )

    def summary(self) -> dict[str, Any]:
        """Return all numbers and words for a file; None stands for what is not finite."""
        rows = [
            {
                key: value if isinstance(value, str) or np.isfinite(value) else None
                for key, value in one._asdict().items()
            }
            for one in self.joints
        ]
        return {
            "fits": self.fits,
            "verdict": self.verdict,
            "joints": rows,
            "gravity": self.gravity.tolist() if np.isfinite(self.gravity).all() else None,
            "causes": [one._asdict() for one in self.causes],
            "notes": list(self.notes),
        }

    def sheet(self) -> Sheet:
        """Return table and verdict."""
        lines = [self.legend, *self.notes, self.verdict]
        return Sheet(f"torques of {self.source}", [self.table()], "\n".join(lines))

    def __repr__(self) -> str:
        """Return table and verdict."""
        return str(self.sheet())


@dataclass(frozen=True, eq=False)
class _Motion:
    """Averages over K windows: angles, velocities, accelerations, torques, signs of v: (K, n)."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    signs: np.ndarray

    def moved(self, order: Sequence[int]) -> _Motion:
        """Return it with the columns of the motion in another order, the torques as they are."""
        q, v, a, signs = (part[:, order] for part in (self.q, self.v, self.a, self.signs))
        return _Motion(q, v, a, self.tau, signs)._with(self.friction[list(order)])

    def turned(self, scale: np.ndarray, offset: np.ndarray | float = 0.0) -> _Motion:
        """Return it scaled by factors (n), positions then shifted."""
        q, v, a = (part * scale for part in (self.q, self.v, self.a))
        turned = _Motion(q + offset, v, a, self.tau, self.signs * np.sign(scale))
        return turned._with(self.friction)

    def _with(self, friction: np.ndarray) -> _Motion:
        """Return it with known bases: what friction explains has neither scale nor sign."""
        vars(self)["friction"] = friction  # of the cached property
        return self

    @cached_property
    def friction(self) -> np.ndarray:
        """Orthonormal bases (n, K, 2) of what the friction of each joint can explain."""
        columns = np.stack([self.v.T, self.signs.T], axis=2)
        columns /= np.maximum(np.linalg.norm(columns, axis=1, keepdims=True), _ZERO)
        left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        return np.asarray(left * (sizes > _PARALLEL)[:, None])

    def without_friction(self, values: np.ndarray) -> np.ndarray:
        """Return values (K, n, ...) of the joints without what their friction can explain."""
        basis, (K, n, *_) = self.friction, values.shape
        parts = values.swapaxes(0, 1).reshape(n, K, -1)
        parts = parts - basis @ (basis.swapaxes(1, 2) @ parts)
        return parts.swapaxes(0, 1).reshape(values.shape)


class _Described(NamedTuple):
    """Described torques: D (K, n) without gravity, G (K, n, 3) for a unit of gravity."""

    D: np.ndarray
    G: np.ndarray

    def torque(self, gravity: np.ndarray) -> np.ndarray:
        """Return the torque (K, n) under a gravity (3)."""
        return np.asarray(self.D + self.G @ gravity)


class _TorqueFit(NamedTuple):
    """A comparison of torques with described ones, arrays (n).

    Attributes:
        factor, correlation: see the module.
        described, torque: root mean squares without friction [N m or N].
        whole: that of the torque with friction [N m or N].
        left: what neither the description nor friction explains, a share of the torque, at most
            one: then the description is worse than none.
        driving: share of the torque that follows the velocity with the sign of a motor.
        foreign: share of what the description leaves that follows another joint's velocity,
            less the share that follows its own.
        rest: what the description leaves, a share of the torque with friction.
    """

    factor: np.ndarray
    correlation: np.ndarray
    described: np.ndarray
    torque: np.ndarray
    whole: np.ndarray
    left: np.ndarray
    driving: np.ndarray
    foreign: np.ndarray
    rest: np.ndarray

    @property
    def against(self) -> np.ndarray:
        """Whether a joint (n) shows clearly that its torque has the wrong sign."""
        seen = self.described > max(_AGAINST * self.described.max(initial=0.0), _ZERO)
        driven = self._strong & (self.driving >= _DRIVING)
        return np.asarray(seen & (self.correlation <= -_CLEAR) | driven)

    @property
    def wrong(self) -> np.ndarray:
        """Whether a joint (n) is wrong by its sign or by its friction, even a weak one."""
        turned = (self.foreign >= _FOREIGN) & (self.rest >= _LEFT)
        return np.asarray(self.against | (self._strong & turned))

    @property
    def _strong(self) -> np.ndarray:
        """Whether the torque of a joint (n) is more than the noise of the others may be."""
        return np.asarray(self.whole > _AGAINST * self.whole.max(initial=0.0))

    @property
    def judged(self) -> np.ndarray:
        """Whether the description predicts enough of each joint (n)."""
        enough = self.described > max(_VISIBLE * self.described.max(initial=0.0), _ZERO)
        claimed = self.described >= _CLAIMED * self.torque
        return np.asarray(enough & ((np.abs(self.correlation) >= _CLEAR) | claimed) | self.wrong)

    @property
    def fits(self) -> np.ndarray:
        """Whether each joint (n) is as described, as far as it is judged."""
        inside = (self.factor >= _FACTORS[0]) & (self.factor <= _FACTORS[1])
        good = inside & (self.correlation >= _LEAST)
        return np.asarray((~self.judged | good) & ~self.wrong)

    @property
    def close(self) -> bool:
        """Whether all judged joints are as described to within what is usual."""
        part = self.judged
        left, factor, correlation = self.left[part], self.factor[part], self.correlation[part]
        usual = (factor > _USUAL[0]) & (factor < _USUAL[1]) & (correlation > _CLEAR)
        return bool(usual.all() and math.sqrt(np.mean(left**2)) < _CLOSE)

    @property
    def score(self) -> float:
        """The sum of log(residual^2) over the joints: the less, the likelier."""
        return float(2.0 * np.log(np.maximum(self.left, 1e-6)).sum())


class _Explanation(NamedTuple):
    """A mistake, or none, with the fit after its correction and how many numbers were chosen.

    ``size``: whether all torques have one factor, as those of a robot of another size.
    """

    cause: Cause | None
    fit: _TorqueFit
    numbers: float
    size: bool = False

    @property
    def score(self) -> float:
        """That of the fit, and a price for each number that was chosen."""
        return self.fit.score + _PRICE * self.numbers


class _Load(NamedTuple):
    """A load that is not described: mass and deviation [kg], whether an arm can carry it, torque.

    Attributes:
        mass, deviation: kg.
        possible: whether an arm can carry it, or lack it.
        torque: (K, n) of the load [N m or N].
    """

    mass: float
    deviation: float
    possible: bool
    torque: np.ndarray


def check_torques(log: Log, robot: Robot) -> TorqueCheck:
    """Compare the torques of a log with those that a description predicts.

    Args:
        log: checked, its columns in the order of the joints; see ``read_log``.
        robot: as described.

    Raises:
        LogError: fewer than two samples are finite.
    """
    motion = motion_of_log(robot, log, cutoff=CUTOFF)
    named = bool(log.joints)
    return check_motion(motion, robot, period=log.period, source=log.source, named=named)


def on_wall(log: Log, robot: Robot) -> Robot:
    """Return a robot that hangs on a wall, with down where the torques of a log show it.

    Args:
        log: checked, its columns in the order of the joints.
        robot: as described, the third axis of its base normal to the wall.

    Raises:
        LogError: the torques show no gravity of the right size, or none across the wall.
    """
    motion = motion_of_log(robot, log, cutoff=CUTOFF)
    seen = _Comparison(_averages(motion, robot, log.period), robot).seen_gravity()
    size = float(np.linalg.norm(robot.model.gravity.linear)) or GRAVITY
    across = np.append(seen[:2], 0.0)
    strength = float(np.linalg.norm(across)) / size
    if not (_STRENGTH[0] < strength < _STRENGTH[1] and abs(seen[2]) < _STRENGTH[0] * size):
        raise LogError(
            f"the torques show a gravity of ({', '.join(f'{x:.2f}' for x in seen)}) m/s^2 in the "
            "axes of the base, which is not that of an arm on a wall.",
            where="mount",
            hint="--gravity x,y,z states it.",
        )
    model = robot.model.copy()
    model.gravity.linear = size * _snapped(across / (strength * size))
    return replace(robot, model=model)


def _snapped(direction: np.ndarray) -> np.ndarray:
    """Return a direction (3), or the axis that it is close to."""
    axes = np.vstack([np.eye(3), -np.eye(3)])
    nearest = axes[np.argmax(axes @ direction)]
    return np.asarray(nearest if nearest @ direction > math.cos(_TURNED) else direction)


def check_motion(
    motion: MeasuredMotion,
    robot: Robot,
    *,
    period: float,
    source: str = "log",
    named: bool = True,
) -> TorqueCheck:
    """Compare the torques of a measured motion with those that a description predicts.

    Args:
        motion: of the joints, with their torques.
        robot: as described.
        period: typical time between samples [s].
        source: for messages.
        named: whether the log has names for its joints, see ``Intake.joints``.
    """
    averages = _averages(motion, robot, period)
    if len(averages.q) < _FEWEST_WINDOWS:
        return TorqueCheck(source, (), np.full(3, np.nan), (0.0, np.inf), ())
    return _Comparison(averages, robot, named=named).result(source)


def _averages(motion: MeasuredMotion, robot: Robot, period: float) -> _Motion:
    """Return averages over windows, weighted as those of ``identify``."""
    model, t = robot.model, motion.t
    length = min(max(_WINDOW, _FEWEST * period), float(t[-1] - t[0]))
    count = int(np.clip(2.0 * (t[-1] - t[0]) / length, 1, _MOST))
    angles = motion.q
    if model.nq != model.nv:
        angles = np.unwrap([angles_from_configuration(model, q) for q in motion.q], axis=0)
    signs = np.tanh(motion.v / _SLIDING)
    columns = np.hstack([angles, motion.v, motion.a, motion.tau, signs])
    weights, rows = np.gradient(t), []
    for middle in np.linspace(t[0] + 0.5 * length, t[-1] - 0.5 * length, count):
        first, last = np.searchsorted(t, (middle - 0.5 * length, middle + 0.5 * length))
        phi = np.cos(np.pi * (t[first:last] - middle) / length) ** 4 * weights[first:last]
        if phi.sum() > _WHOLE * length:
            rows.append(phi @ columns[first:last] / phi.sum())
    found = np.array(rows).reshape(-1, columns.shape[1])
    return _Motion(*np.split(found, 5, axis=1))


def _fit(
    motion: _Motion, tau: np.ndarray, described: np.ndarray, sizes: np.ndarray | None = None
) -> _TorqueFit:
    """Return the comparison of torques (K, n) with described ones, friction removed.

    Residuals are relative to ``sizes`` (n), by default those of the torques.
    """
    t, d = motion.without_friction(tau), motion.without_friction(described)
    whole = np.maximum(np.linalg.norm(tau, axis=0) if sizes is None else sizes, _ZERO)
    size, level, both = np.linalg.norm(d, axis=0), np.linalg.norm(t, axis=0), (t * d).sum(axis=0)
    factor = np.where(size > _ZERO, both / np.maximum(size, _ZERO) ** 2, 0.0)
    usual, seen = np.clip(factor, *_USUAL), (size > _ZERO) & (level > _ZERO)
    rest = tau - factor * described
    shares = ((motion.friction.swapaxes(1, 2) @ rest) ** 2).sum(axis=1)
    shares /= np.maximum((rest**2).sum(axis=0), _ZERO**2)  # (i, j): of joint j, by friction of i
    own = np.diag(shares).copy()
    np.fill_diagonal(shares, 0.0)
    power, speed = (rest * motion.v).sum(axis=0), np.linalg.norm(motion.v, axis=0)
    moving = speed > _ZERO
    return _TorqueFit(
        factor,
        np.where(seen, both / np.maximum(size * level, _ZERO**2), 0.0),
        size / math.sqrt(len(tau)),
        level / math.sqrt(len(tau)),
        whole / math.sqrt(len(tau)),
        np.minimum(np.linalg.norm(t - usual * d, axis=0) / whole, 1.0),
        np.where(moving, -power / np.maximum(whole * speed, _ZERO**2), 0.0),
        shares.max(axis=0) - own,
        np.linalg.norm(rest, axis=0) / whole,
    )


class _Comparison:
    """A motion beside a description, and what mistakes would make of them."""

    def __init__(self, motion: _Motion, robot: Robot, *, named: bool = True) -> None:
        self._motion, self._robot, self._model = motion, robot, robot.model.copy()
        self._named = named
        self._data = self._model.createData()
        self._gravity = np.array(robot.model.gravity.linear)
        self._names, self._n = robot.joint_names, robot.model.nv
        self._found = self._described(motion)
        self._last: tuple[_Motion, tuple[np.ndarray, np.ndarray]] | None = None

    def result(self, source: str) -> TorqueCheck:
        """Return factors, likely causes and other findings."""
        motion, gravity = self._motion, self._gravity
        described = self._found.torque(gravity)
        plain = _fit(motion, motion.tau, described)
        load = self._load(motion, motion.tau, described, gravity, plain)
        causes = tuple(self._causes(plain))
        fit = plain
        if not causes and not plain.fits.all():
            fit = _fit(motion, motion.tau - load.torque, described)
        joints = tuple(self._factors(plain, fit))
        notes = () if causes else tuple(self._notes(load, plain, described))
        seen = self.seen_gravity()
        return TorqueCheck(source, joints, seen, (load.mass, load.deviation), causes, notes)

    def _factors(self, plain: _TorqueFit, fit: _TorqueFit) -> Iterator[JointFactor]:
        """Yield the rows of the table, judged by a fit that may allow for a load."""
        tau, weight = self._motion.tau, self._found.G @ self._gravity
        for j, name in enumerate(self._names):
            both = float(tau[:, j] @ weight[:, j])
            size, level = (float(np.linalg.norm(part[:, j])) for part in (weight, tau))
            heavy = size > _ZERO
            yield JointFactor(
                name,
                level / math.sqrt(len(tau)),
                float(plain.described[j]),
                both / size**2 if heavy else np.nan,
                both / (level * size) if heavy and level else np.nan,
                float(plain.factor[j]),
                float(plain.correlation[j]),
                bool(fit.judged[j]),
                bool(fit.fits[j]),
            )

    def _configurations(self, angles: np.ndarray) -> np.ndarray:
        """Return configurations (K, nq) with angles (K, n)."""
        if self._model.nq == self._n:
            return angles
        return np.array([configuration_from_angles(self._model, row) for row in angles])

    def _described(self, motion: _Motion) -> _Described:
        """Return the described torques of a motion."""
        model, data, q = self._model, self._data, self._configurations(motion.q)
        D = self._torques(motion, np.zeros(3))
        G = np.zeros((*D.shape, 3))
        for i, axis in enumerate(np.eye(3)):
            model.gravity.linear = axis
            G[..., i] = [pin.computeGeneralizedGravity(model, data, x) for x in q]
        return _Described(D, G)

    def _torques(self, motion: _Motion, gravity: np.ndarray) -> np.ndarray:
        """Return the described torques (K, n) of a motion under a gravity (3)."""
        model, data, q = self._model, self._data, self._configurations(motion.q)
        model.gravity.linear = gravity
        rows = zip(q, motion.v, motion.a, strict=True)
        return np.array([pin.rnea(model, data, *row) for row in rows])

    def seen_gravity(self) -> np.ndarray:
        """Return gravity (3) as all joints show it together, with one factor of the inertia."""
        motion, (D, G) = self._motion, self._found
        weight = np.linalg.norm(G, axis=(0, 2))
        heavy = np.flatnonzero(weight > _VISIBLE * max(weight.max(initial=0.0), _ZERO))
        if not heavy.size:
            return np.full(3, np.nan)
        columns = motion.without_friction(np.dstack([G, D, motion.tau]))[:, heavy]
        columns = columns / np.maximum(np.linalg.norm(columns[..., 4], axis=0), _ZERO)[:, None]
        rows = columns.reshape(-1, 5)
        spread = np.linalg.svd(rows[:, :3], compute_uv=False)
        if spread[-1] < _FLAT * spread[0]:
            return np.full(3, np.nan)
        return np.asarray(np.linalg.lstsq(rows[:, :4], rows[:, 4], rcond=None)[0][:3])

    def _load(
        self,
        motion: _Motion,
        tau: np.ndarray,
        described: np.ndarray,
        gravity: np.ndarray,
        plain: _TorqueFit,
    ) -> _Load:
        """Return the load, a point mass on the last body, that best explains the rest."""
        if gravity is not self._gravity:
            Y, seen = self._load_rows(motion, gravity)
        elif motion is self._motion:
            Y, seen = self._load_as_it_is
        else:
            if self._last is None or self._last[0] is not motion:  # that two mistakes may share
                self._last = (motion, self._load_rows(motion, gravity))
            Y, seen = self._last[1]
        level = np.maximum(np.linalg.norm(tau, axis=0) / math.sqrt(len(tau)), _ZERO)
        noise = np.maximum(plain.left, _LEAST_NOISE) * level
        rest = motion.without_friction(tau - described)
        rows = np.concatenate([seen, rest[..., None]], axis=2).swapaxes(0, 1)
        squares = rows.swapaxes(1, 2) @ rows  # (n, 11, 11) of each joint
        for _ in range(_ROUNDS):
            total = (squares / noise[:, None, None] ** 2).sum(axis=0)
            inverse = np.linalg.inv(total[:-1, :-1] + np.eye(PER_BODY))
            x = inverse @ total[:-1, -1]
            both = np.append(x, -1.0)
            left = np.maximum(both @ squares @ both, 0.0) / len(tau)
            noise = np.maximum(np.sqrt(left), _LEAST_NOISE * level)
        pi, body = x * self._usual, float(self._model.inertias[self._model.njoints - 1].mass)
        mass, deviation = float(pi[0]), float(self._usual[0] * math.sqrt(inverse[0, 0]))
        far = float(np.linalg.norm(pi[1:4]))
        liftable = -body - _CALIBRATION < mass < self._heaviest
        near = far <= _FARTHEST * self._robot.reach * max(abs(mass), body, _CALIBRATION)
        return _Load(mass, _ROWS_A_WINDOW * deviation, liftable and near, Y @ x)

    def _load_rows(self, motion: _Motion, gravity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Y (K, n, 10) of a load, in units of a usual one, and Y without friction."""
        model, q = self._model, self._configurations(motion.q)
        model.gravity.linear = gravity
        rows = zip(q, motion.v, motion.a, strict=True)
        whole = [pin.computeJointTorqueRegressor(model, self._data, *row) for row in rows]
        Y = np.array([row[:, -PER_BODY:] for row in whole]) * self._usual
        return Y, motion.without_friction(Y)

    @cached_property
    def _load_as_it_is(self) -> tuple[np.ndarray, np.ndarray]:
        """The same for motion and gravity without a correction."""
        return self._load_rows(self._motion, self._gravity)

    @cached_property
    def _usual(self) -> np.ndarray:
        """Parameters (10) of the size that a load has, the scale of a weak prior."""
        mass, length = _USUAL_LOAD[0] * self._robot.mass, _USUAL_LOAD[1] * self._robot.reach
        return mass * np.array([1.0, *[length] * 3, *[length**2] * 6])

    @cached_property
    def _heaviest(self) -> float:
        """The largest mass [kg] of a load, by what the strongest joint holds at full reach."""
        limits = effort_limits(self._robot.model)[~np.array(list(self._robot.slides.values()))]
        holds = _HELD * limits.max(initial=0.0) / (9.81 * self._robot.reach)
        most = _HEAVIEST * self._robot.mass
        return max(min(holds, most), _LIGHTEST * self._robot.mass)

    def _causes(self, plain: _TorqueFit) -> Iterator[Cause]:
        """Yield the likeliest mistakes, none if the log is as likely without one.

        Where the strong joints alone look like those of another robot, that is one of them.
        """
        found = list(self._mistakes(plain))
        yield from found
        heavy = plain.described > _HEAVY * plain.described.max(initial=0.0)
        sizes, told = plain.factor[heavy], any("robot" in cause.words for cause in found)
        if not found or told or len(sizes) < 2 or (plain.correlation[heavy] < _SAME).any():
            return
        common = float(np.exp(np.mean(np.log(sizes))))
        alike = (np.abs(np.log(sizes / common)) < math.log(_SCATTER)).all()
        if alike and not _SIZE[0] < common < _SIZE[1]:
            named = " and ".join(self._names[j] for j in np.flatnonzero(heavy))
            yield Cause(
                f"it is the log of a robot of another size, as the torques of {named} are all "
                f"about {common:.2g} times the described ones"
            )

    def _mistakes(self, plain: _TorqueFit) -> Iterator[Cause]:
        """Yield the likeliest mistakes; none if the log is as likely without one, loaded or not."""
        least = 1 if plain.judged.any() else 0
        fitting = [
            one
            for one in self._explanations(plain)
            if one.fit.fits.all() and np.count_nonzero(one.fit.judged) >= least
        ]
        healthy = min((one.score for one in fitting if one.cause is None), default=np.inf)
        tried = sorted((one for one in fitting if one.cause), key=lambda one: one.score)
        wrong = [name for name, no in zip(self._names, plain.wrong, strict=True) if no]
        turning = [one for one in tried if one.cause and any(map(one.cause.turns, wrong))]
        if turning and turning[0].score < healthy + _SURELY:
            healthy = np.inf  # a load hardly turns a torque: it would have to be surely likelier
        if tried and tried[0].score < healthy - _SURELY:
            close = tried[0].fit.close
            order = None if close else self._fitting_order()
            best = [one.cause for one in tried if one.score < tried[0].score + _AS_GOOD]
            best = best if order is None else [order]
            yield from list(dict.fromkeys(cause for cause in best if cause))[:_NAMED]
            if not close and order is None:
                yield Cause("it is the log of another robot, as this does not fit well either")
        elif healthy == np.inf:
            yield self._fitting_order() or self._unexplained(plain)
        elif not plain.fits.all():
            size = next((one for one in tried if one.size), None)
            if size is not None and size.cause and size.score < healthy + _AS_GOOD:
                yield size.cause
                yield Cause(
                    "it carries a heavy load that is not described, which explains them as well; "
                    "describe it, or --accept-doubts"
                )

    def _explanations(self, plain: _TorqueFit) -> Iterator[_Explanation]:
        """Yield all mistakes that are considered, and none, each without and with a load."""
        motion, n = self._motion, self._n
        yield from self._corrected(None, 0)
        yield from self._gains(plain)
        yield from self._gravities()
        yield from self._compensated()
        slides = np.array(list(self._robot.slides.values()))
        if not slides.all():
            degrees = motion.turned(np.where(slides, 1.0, _DEGREE))
            yield from self._corrected(Cause("the angles are degrees", "--degrees"), 0, degrees)
        yield from self._orders()
        for j, name in enumerate(self._names):
            here = np.arange(n) == j
            sign = np.where(here, -1.0, 1.0)
            turned = motion.turned(sign)
            words = f"the position of {name} has the wrong sign"
            yield from self._corrected(Cause(words, f"--flip q:{name}"), 1, turned)
            words, option = f"{name} turns the other way", f"--flip q:{name},tau:{name}"
            yield from self._corrected(Cause(words, option), 1, turned, motion.tau * sign)
            for quarter in (1, -1, 2) if not slides[j] else ():
                shift = 0.5 * math.pi * quarter
                words = f"the zero of {name} is {-90 * quarter} degrees from the described one, if "
                words += "this is not the log of another robot"
                moved = motion.turned(np.ones(n), shift * here)
                yield from self._corrected(Cause(words, f"--offset {name}={shift:.6g}"), 1, moved)

    def _corrected(
        self,
        cause: Cause | None,
        numbers: float,
        motion: _Motion | None = None,
        tau: np.ndarray | None = None,
        gravity: np.ndarray | None = None,
    ) -> Iterator[_Explanation]:
        """Yield the fits, without and with a load, after a mistake is corrected."""
        gravity = self._gravity if gravity is None else gravity
        if motion is None:
            motion, described = self._motion, self._found.torque(gravity)
        else:
            described = self._torques(motion, gravity)
        tau = motion.tau if tau is None else tau
        sizes = np.linalg.norm(tau, axis=0)
        fit = _fit(motion, tau, described)
        yield _Explanation(cause, fit, numbers)
        load = self._load(motion, tau, described, gravity, fit)
        if load.possible:
            loaded = _fit(motion, tau - load.torque, described, sizes)
            yield _Explanation(cause, loaded, numbers + _LOAD_NUMBERS)

    def _compensated(self) -> Iterator[_Explanation]:
        """Yield the explanation by an arm that adds its gravity torque and logs only the rest.

        Then nothing in the torque follows gravity: what is left is that of the rest alone.
        """
        motion, tau, (D, G) = self._motion, self._motion.tau, self._found
        weight = G @ self._gravity
        cause = Cause(
            "they are without gravity, which the arm adds by itself", "--compensated nominal"
        )
        rest = _fit(motion, tau, D)
        load = self._load(motion, tau, D, self._gravity, rest)
        loaded = tau - load.torque
        both = _fit(motion, loaded, D, np.linalg.norm(tau, axis=0))
        for part, left, numbers in ((tau, rest.left, 0), (loaded, both.left, _LOAD_NUMBERS)):
            if numbers == 0 or load.possible:
                fit = _fit(motion, part + weight, D + weight)
                yield _Explanation(cause, fit._replace(left=left), numbers)

    def _gains(self, plain: _TorqueFit) -> Iterator[_Explanation]:
        """Yield explanations by signs and factors of the torques."""
        tau, n = self._motion.tau, self._n
        against = (plain.judged & (plain.factor < 0.0)) | plain.against
        if (against | ~plain.judged).all():
            against = np.full(n, True)
        signs, turned = np.where(against, -1.0, 1.0), np.flatnonzero(against)
        every = turned.size == n
        names = ",".join(self._names[j] for j in turned)
        flip = f"--flip {names}"
        if turned.size:
            words = f"the torque of {'all joints' if every else names} has the wrong sign"
            cause = Cause(words, "--torque-gain=-1" if every else flip)
            yield from self._corrected(cause, 1 if every else turned.size, tau=tau * signs)
        clear, sizes = plain.judged & (np.abs(plain.correlation) >= _CLEAR), np.abs(plain.factor)
        off = clear & ((sizes < _FACTORS[0]) | (sizes > _FACTORS[1]))
        if not off.any():
            return
        common = float(np.exp(np.mean(np.log(sizes[clear]))))
        alike = bool((np.abs(np.log(sizes[clear] / common)) < math.log(_SCATTER)).all())
        ask = "Are they motor currents (A) or torques before the gear"
        if alike:
            gains = np.full(n, 1.0 / common)
            gain = f"--torque-gain={-1.0 / common if every else 1.0 / common:.3g}"
            words = f"all torques are about {common:.2g} times the described ones. {ask}, or is it "
            words += "the log of a robot of another size?"
        else:
            gains = np.where(off, 1.0 / np.where(off, sizes, 1.0), 1.0)
            each = ",".join(f"{self._names[j]}={gains[j]:.3g}" for j in np.flatnonzero(off))
            gain, factors = f"--torque-gain {each}", plain.factor
            shown = ", ".join(f"{self._names[j]} {factors[j]:.2g}" for j in np.flatnonzero(off))
            words = f"torques are these multiples of the described ones: {shown}. {ask}?"
        option = f"{gain} {flip}" if turned.size and not (alike and every) else gain
        numbers = (1 if alike else int(off.sum())) + (0 if every else turned.size)
        cause = Cause(words, f"{option}, or rather the gains of the data sheet,")
        for one in self._corrected(cause, numbers, tau=tau * gains * signs):
            yield one._replace(size=alike)

    def _gravities(self) -> Iterator[_Explanation]:
        """Yield the explanation by another mounting, if the log shows one."""
        seen, size = self.seen_gravity(), float(np.linalg.norm(self._gravity))
        strength = float(np.linalg.norm(seen)) / size if size else np.nan
        if not _STRENGTH[0] < strength < _STRENGTH[1]:  # also for NaN
            return
        direction, near = seen / (strength * size), math.cos(_TURNED)
        if direction @ self._gravity / size > near:
            return
        direction = _snapped(direction)
        places = {"upright": -direction[2] > near, "upside down": direction[2] > near}
        places["on a wall"] = abs(direction[2]) < math.sin(_TURNED)
        place = next((name for name, fits in places.items() if fits), "tilted")
        mount = {"upside down": " or --mount ceiling", "on a wall": " or --mount wall"}
        arrow = ", ".join(f"{x + 0.0:.2f}" for x in direction)
        vector = ",".join(f"{size * x + 0.0:.3g}" for x in direction)
        words = f"the base is mounted {place}: the torques show a gravity along ({arrow}) of it"
        cause = Cause(words, f"--gravity={vector}{mount.get(place, '')}")
        yield from self._corrected(cause, 1, gravity=size * direction)

    def _orders(self) -> Iterator[_Explanation]:
        """Yield explanations by columns in another order."""
        motion, n, names = self._motion, self._n, self._names
        alphabetical = sorted(range(n), key=lambda j: names[j])
        orders = [_swapped(n, *pair) for pair in combinations(range(n), 2)]
        orders += [list(range(n))[::-1], np.argsort(alphabetical).tolist(), alphabetical]
        for order in {tuple(order): None for order in orders if order != list(range(n))}:
            moved = [names[j] for j in range(n) if order[j] != j]
            who = " and ".join(moved) if len(moved) == 2 else "the joints"
            how = "are swapped" if len(moved) == 2 else "are in another order"
            listed, tau = self._listed(order), motion.tau[:, order]
            cause = Cause(f"the columns of {who} {how}", f"--joints {listed}")
            yield from self._corrected(cause, 1, motion.moved(order), tau)
            cause = Cause(f"the torques of {who} {how}", f"--joints tau:{listed}")
            yield from self._corrected(cause, 1, tau=tau)

    def _listed(self, order: Sequence[int]) -> str:
        """Return what ``--joints`` says of columns (n) in the robot's order."""
        listed = order if self._named else np.argsort(order)
        return ",".join(self._names[j] for j in listed)

    def _fitting_order(self) -> Cause | None:
        """Return the order of the joints with which the log is close, None where none is found.

        All orders of at most seven joints are compared by the torques of some windows, friction
        included, and the best of them as any other explanation.
        """
        motion, n = self._motion, self._n
        if not 2 < n <= _ORDERED:  # two can only be swapped
            return None
        some = np.linspace(0, len(motion.tau) - 1, _SOME_WINDOWS).astype(int)
        q, v, a, tau = (part[some] for part in (motion.q, motion.v, motion.a, motion.tau))
        model, data = self._model, self._data
        model.gravity.linear = self._gravity
        scores = []
        for columns in map(list, islice(permutations(range(n)), 1, None)):  # the first is as it is
            angles = self._configurations(q[:, columns])
            states = zip(angles, v[:, columns], a[:, columns], strict=True)
            d = np.array([pin.rnea(model, data, *state) for state in states])
            rest = (tau[:, columns] - d) ** 2
            share = rest.sum(axis=0) / np.maximum((tau[:, columns] ** 2).sum(axis=0), _ZERO)
            scores.append((float(np.log(np.maximum(share, _ZERO)).clip(max=0.0).sum()), columns))
        fits = []
        for _, order in sorted(scores)[:_BEST_ORDERS]:
            words = "the columns of the joints are in another order"
            cause = Cause(words, f"--joints {self._listed(order)}")
            corrected = self._corrected(cause, 1, motion.moved(order), motion.tau[:, order])
            fits.append(min(corrected, key=lambda one: one.score))
        first, second, *_ = sorted(fits, key=lambda one: one.score)
        good = first.fit.fits.all() and first.fit.close
        return first.cause if good and first.score < second.score - _LIKELIER else None

    def _unexplained(self, plain: _TorqueFit) -> Cause:
        """Return the cause of a log that no single mistake explains."""
        wrong = [
            f"{self._names[j]} is {plain.factor[j]:.2f} times the description (correlation "
            f"{plain.correlation[j]:.2f})"
            for j in np.flatnonzero(~plain.fits)
        ]
        return Cause(
            f"{'; '.join(wrong)}. Neither a sign, a unit, a gear, an order of the joints nor a "
            "mounting explains it. Is it the log of another robot, or do several of these come "
            "together"
        )

    def _notes(self, load: _Load, plain: _TorqueFit, described: np.ndarray) -> Iterator[str]:
        """Yield other findings: a load, or an end of the arm that is described and not mounted."""
        if not plain.fits.all():
            yield (
                f"the torques fit only with a load of {load.mass:.2f} kg behind the last joint, "
                "which is not described. Without such a load it may be the log of a larger robot."
            )
        if not load.mass < -_SURE * load.deviation:
            return
        links = self._end_links()
        for k in range(len(links)):
            mass = sum(one for _, one in links[k:])
            if mass < _SMALLEST or abs(-load.mass / mass - 1.0) > _MATCH:
                continue
            motion = self._motion
            sizes = np.linalg.norm(motion.tau, axis=0)
            fit = _fit(motion, motion.tau - load.torque, described, sizes)
            if fit.score < plain.score - _LIKELIER - _PRICE * _LOAD_NUMBERS:
                names = ", ".join(name for name, _ in links[k:])
                some = "are described and seem" if links[k + 1 :] else "is described and seems"
                yield (
                    f"{names} ({mass:.2f} kg) {some} not to be mounted: the log shows "
                    f"{-load.mass:.2f} kg less behind the last joint."
                )
                return

    def _end_links(self) -> list[tuple[str, float]]:
        """Return name and mass [kg] of the links that are fixed to the last moving one."""
        model = self._model
        names = {
            frame.parentFrame: str(frame.name)
            for frame in model.frames
            if frame.type == pin.FrameType.BODY
        }
        return [
            (names.get(index, str(frame.name)), float(frame.inertia.mass))
            for index, frame in enumerate(model.frames)
            if frame.parentJoint == model.njoints - 1
            and frame.type == pin.FrameType.FIXED_JOINT
            and frame.inertia.mass > 0.0
        ]


def _swapped(n: int, i: int, j: int) -> list[int]:
    order = list(range(n))
    order[i], order[j] = j, i
    return order
