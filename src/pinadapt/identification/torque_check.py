"""Whether recorded torques can be those of a described robot, and if not, what is the likely cause.

For each joint the torque tau of a log is compared with what the description predicts, d, from its
inverse dynamics without friction. Both are averaged over windows, and what viscous and Coulomb
friction of the joint could explain is removed from both. Then

    factor = <tau, d> / <d, d>,        correlation = <tau, d> / (|tau| |d|).

Friction, noise, inertias that are wrong by a third and wear leave the factor between 0.5 and 2.2:
logs of four real arms gave 0.65 to 2.0, correlations of at least 0.79. Currents, torques before the
gear, a wrong sign or another mounting do not.

Usual mistakes are undone one by one, each without and with a load that is not described. What is
then left of a joint's torque, with a factor between 0.65 and 2 and friction that takes energy,
judges them: the sum over the joints of log(residual^2), and a price for each number that is chosen.
A log fits if no mistake is surely likelier than none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from .._output import Sheet, Table
from ..description.chain import angles_from_configuration, configuration_from_angles
from ..exceptions import LogError
from ..information.measured_motion import Averages
from ..logs.log import Log
from ..models.regressor import PER_BODY
from ..robot.robot import Robot
from .logged_motion import motion_of_log

_MOST = 250  # windows; half as many give the same verdicts on the real logs
_SLIDING = 0.02  # [rad/s or m/s] from where Coulomb friction has its full size; half: the same
# Factors between which a joint is as described, and between which residuals are compared. Half as
# wide refuses worn or wrongly described arms, twice as wide accepts a robot of another size.
_FACTORS, _USUAL = (0.5, 2.2), (0.65, 2.0)
_CLEAR = 0.75  # correlation of a clear relation
_LEAST = 0.4  # correlation, and share of a joint's torque, from where on a relation may be there
# Of the largest described torque, from where on a joint is judged: half as much judges wrists whose
# friction hides everything else, twice as much overlooks light joints.
_VISIBLE = 0.05
_CLOSE = 0.2  # of the torques of judged joints, that a good explanation leaves; it changes words
# In log(residual^2): the price of a chosen number, and by how much a mistake must be likelier than
# none. Quarters of real logs gain up to 0.8 by mistakes nobody made; the least visible one that
# somebody made gains 1.2, so half refuses good logs and twice as much accepts a wrong sign.
_PRICE, _SURELY = 0.15, 1.0
_LOAD_NUMBERS = 4  # of a load
# Of the robot's mass: a load. Half as much refuses rated loads, twice as much takes a UR10 for a
# loaded UR5. A usual one has this share of mass and reach, a weak prior.
_HEAVIEST = 1.0 / 3.0
_LEAST_RESIDUAL = 0.02  # of a joint's torque, that no description explains; for exact logs
_EPS = np.finfo(float).eps
_UNITS = "Are they motor currents (A) or torques before the gear, or is the robot of another size?"


class JointFactor(NamedTuple):
    """How the torque of a joint compares with the description.

    Attributes:
        joint: its name.
        torque: root mean square [N m or N].
        described: that of what the description predicts, friction removed [N m or N].
        factor, correlation: of the torque and the described torque, friction removed.
        judged: whether the description predicts enough to judge the joint.
        fits: whether the joint is as described, perhaps with a load; true where it is not judged.
    """

    joint: str
    torque: float
    described: float
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
        causes: likely ones of torques that do not fit, the likeliest first; none: they fit.
        notes: other findings, which do no harm.
    """

    source: str
    joints: tuple[JointFactor, ...]
    causes: tuple[Cause, ...]
    notes: tuple[str, ...] = ()

    @property
    def fits(self) -> bool:
        """Whether the log can be one of the described robot."""
        return not self.causes

    @property
    def verdict(self) -> str:
        """The result in one line."""
        if self.causes:
            words = ". Or ".join(map(str, self.causes))
            return f"the torques do not fit the description: {words}."
        factors = ", ".join(f"{one.factor:.2f}" for one in self.joints if one.judged)
        if not factors:
            return "the description predicts too little torque to judge the log by it."
        return f"the torques fit the description ({factors} times it at the judged joints)."

    def table(self) -> Table:
        """Return one row for each joint."""
        header = ("joint", "torque, rms", "described", "factor", "correlation", "")
        rows = [
            (
                one.joint,
                *(f"{value:.3g}" for value in (one.torque, one.described)),
                *(f"{value:.2f}" for value in (one.factor, one.correlation)),
                ("fits" if one.fits else "DOES NOT FIT") if one.judged else "too little to judge",
            )
            for one in self.joints
        ]
        return Table(rows, header)

    def summary(self) -> dict[str, Any]:
        """Return all numbers and words for a file."""
        return {"fits": self.fits, "verdict": self.verdict, **vars(self)}

    def sheet(self) -> Sheet:
        """Return table and verdict."""
        lines = "\n".join([*self.notes, self.verdict])
        return Sheet(f"torques of {self.source}", [self.table()], lines)

    def __repr__(self) -> str:
        """Return table and verdict."""
        return str(self.sheet())


def check_torques(log: Log, robot: Robot) -> TorqueCheck:
    """Compare the torques of a log with those that a description predicts.

    Args:
        log: checked, its columns in the order of the joints; see ``read_log``.
        robot: as described.

    Raises:
        LogError: fewer than two samples are finite.
    """
    motion = _averages(log, robot)
    if not len(motion.q):
        return TorqueCheck(log.source, (), ())
    return _Comparison(motion, robot, named=bool(log.joints)).result(log.source)


def on_wall(log: Log, robot: Robot) -> Robot:
    """Return a robot that hangs on a wall, with down along that axis which its torques show.

    Args:
        log: checked, its columns in the order of the joints.
        robot: as described, the third axis of its base normal to the wall.

    Raises:
        LogError: the torques fit no direction of gravity, or one along the third axis best.
    """
    likeliest = min(
        _Comparison(_averages(log, robot), robot).mountings(), key=lambda one: one.score
    )
    if not likeliest.fits or likeliest.gravity[2]:
        raise LogError(
            "the torques are not those of an arm on a wall.",
            where="mount",
            hint="--gravity x,y,z states the gravity in the axes of the base.",
        )
    model = robot.model.copy()
    model.gravity.linear = likeliest.gravity
    return replace(robot, model=model)


class _Motion(NamedTuple):
    """Averages over K windows: angles, velocities, accelerations, torques, signs of v: (K, n)."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    signs: np.ndarray

    def turned(self, scale: np.ndarray) -> _Motion:
        """Return it scaled by factors (n), the torques as they are."""
        q, v, a = (part * scale for part in self[:3])
        return _Motion(q, v, a, self.tau, self.signs * np.sign(scale))

    @property
    def friction(self) -> np.ndarray:
        """Columns (n, K, 2) of what the friction of each joint can explain."""
        return np.stack([self.v.T, self.signs.T], axis=2)

    def without_friction(self, values: np.ndarray) -> np.ndarray:
        """Return values (K, n, ...) of the joints without what their friction can explain."""
        columns, (K, n, *_) = self.friction, values.shape
        parts = values.swapaxes(0, 1).reshape(n, K, -1)
        parts = parts - columns @ (np.linalg.pinv(columns) @ parts)
        return parts.swapaxes(0, 1).reshape(values.shape)


def _averages(log: Log, robot: Robot) -> _Motion:
    """Return averages over some windows of a log."""
    motion, model = motion_of_log(robot, log), robot.model
    angles = motion.q
    if model.nq != model.nv:
        angles = np.unwrap([angles_from_configuration(model, q) for q in motion.q], axis=0)
    averages = Averages(motion.t, log.period)
    some = np.unique(np.linspace(0, averages.whole.sum() - 1, _MOST).astype(int))
    parts = angles, motion.v, motion.a, motion.tau, np.tanh(motion.v / _SLIDING)
    return _Motion(*(averages.mean(part)[averages.whole][some] for part in parts))


class _Fit(NamedTuple):
    """A comparison of torques with described ones, arrays (n).

    Attributes:
        factor, correlation: see the module.
        described, torque: root mean squares without friction [N m or N].
        left: what neither the description nor friction explains, a share of the torque.
    """

    factor: np.ndarray
    correlation: np.ndarray
    described: np.ndarray
    torque: np.ndarray
    left: np.ndarray

    @property
    def judged(self) -> np.ndarray:
        """Whether the description predicts enough of each joint (n)."""
        clear = np.abs(self.correlation) >= _CLEAR
        enough = self.described > _VISIBLE * self.described.max()
        return np.asarray(enough & (clear | (self.described >= _LEAST * self.torque)))

    @property
    def fits(self) -> np.ndarray:
        """Whether each joint (n) is as described, as far as it is judged."""
        inside = (self.factor >= _FACTORS[0]) & (self.factor <= _FACTORS[1])
        return np.asarray(~self.judged | (inside & (self.correlation >= _LEAST)))

    @property
    def score(self) -> float:
        """The sum of log(residual^2) over the joints."""
        return float(np.log(self.left**2 + _LEAST_RESIDUAL**2).sum())


def _fit(motion: _Motion, tau: np.ndarray, described: np.ndarray, sizes: np.ndarray) -> _Fit:
    """Return the comparison of torques (K, n) with described ones, friction removed.

    Residuals are relative to ``sizes`` (n).
    """
    from scipy.optimize import nnls  # here, because scipy is slow to import

    t, d = motion.without_friction(tau), motion.without_friction(described)
    size, level = (np.maximum(np.linalg.norm(part, axis=0), _EPS) for part in (d, t))
    factor = (t * d).sum(axis=0) / size**2
    rest = tau - np.clip(factor, *_USUAL) * described
    left = [nnls(columns, part)[1] for columns, part in zip(motion.friction, rest.T, strict=True)]
    root = math.sqrt(len(tau))
    shares = np.minimum(np.array(left) / np.maximum(sizes, _EPS), 1.0)
    return _Fit(factor, factor * size / level, size / root, level / root, shares)


class _Explanation(NamedTuple):
    """A mistake, or none, undone.

    Attributes:
        cause: None without a mistake.
        bare, loaded: the fits without and with a load that is not described.
        mass: of that load [kg].
        gravity: (3) of the base [m/s^2].
        fits: whether all joints are as described, without or with a load that an arm can carry.
        score: the smaller one of both.
    """

    cause: Cause | None
    bare: _Fit
    loaded: _Fit
    mass: float
    gravity: np.ndarray
    fits: bool
    score: float


class _Comparison:
    """A motion beside a description, and what mistakes would make of them."""

    def __init__(self, motion: _Motion, robot: Robot, *, named: bool = True) -> None:
        self._motion, self._robot, self._model = motion, robot, robot.model.copy()
        self._named, self._data = named, self._model.createData()
        self._down = np.array(robot.model.gravity.linear)
        self._names, self._n = robot.joint_names, robot.model.nv

    def result(self, source: str) -> TorqueCheck:
        """Return factors, likely causes and other findings."""
        plain = self._explained(None, 0)
        causes, bare = tuple(self._causes(plain)), plain.bare
        with_load = not causes and not bare.fits.all()
        fit = plain.loaded if with_load else bare
        levels = np.sqrt(np.mean(self._motion.tau**2, axis=0))
        numbers = np.column_stack([levels, bare.described, bare.factor, bare.correlation])
        joints = tuple(
            JointFactor._make([name, *row, bool(judged), bool(fits)])
            for name, row, judged, fits in zip(
                self._names, numbers.tolist(), fit.judged, fit.fits, strict=True
            )
        )
        notes = []
        if not causes and plain.loaded.score + _PRICE * _LOAD_NUMBERS < bare.score - _SURELY:
            only = "only" if with_load else "better"
            notes.append(
                f"the torques fit {only} with a load of {plain.mass:.2f} kg behind the last joint, "
                "in addition to what is described there."
            )
        return TorqueCheck(source, joints, causes, tuple(notes))

    def _states(self, motion: _Motion) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Yield configuration, velocity and acceleration of each window."""
        angles, model = motion.q, self._model
        q = [configuration_from_angles(model, row) for row in angles]
        return zip(q if model.nq != self._n else angles, motion.v, motion.a, strict=True)

    def _torques(self, motion: _Motion, gravity: np.ndarray) -> np.ndarray:
        """Return the described torques (K, n) of a motion under a gravity (3)."""
        self._model.gravity.linear = gravity
        return np.array([pin.rnea(self._model, self._data, *each) for each in self._states(motion)])

    def _load(
        self, motion: _Motion, rest: np.ndarray, gravity: np.ndarray, noise: np.ndarray
    ) -> tuple[float, np.ndarray, bool]:
        """Return the load on the last body that best explains a rest (K, n), near a usual one.

        One that is heavier than an arm can carry, or lack, or farther away than it reaches is taken
        in part: with no mistake and with each of them a load is from the same set.

        Returns:
            Its mass [kg], its torque (K, n), and whether it is the whole of it.
        """
        model, robot = self._model, self._robot
        model.gravity.linear = gravity
        usual = robot.mass * np.repeat([1.0, robot.reach, robot.reach**2], [1, 3, 6])
        usual *= _HEAVIEST ** np.repeat([1, 2, 3], [1, 3, 6])
        whole = [
            pin.computeJointTorqueRegressor(model, self._data, *each)[:, -PER_BODY:]
            for each in self._states(motion)
        ]
        Y = np.array(whole) * usual
        rows = motion.without_friction(np.concatenate([Y, rest[..., None]], axis=2))
        rows = (rows / noise[:, None]).reshape(-1, PER_BODY + 1)
        H = rows.T @ rows
        x = np.linalg.solve(H[:-1, :-1] + np.eye(PER_BODY), H[:-1, -1])
        body = float(model.inertias[model.njoints - 1].mass)
        mass, moment = x[0] * usual[0], np.linalg.norm(x[1:4]) * usual[1]
        parts = mass / (_HEAVIEST * robot.mass), -mass / max(body, _EPS)
        share = max(1.0, *parts, moment / (robot.reach * max(mass, body, _EPS)))
        return float(mass / share), Y @ x / share, bool(share == 1.0)

    def _causes(self, plain: _Explanation) -> Iterator[Cause]:
        """Yield the likeliest mistakes; none if the log is as likely without one, loaded or not."""
        tried = [one for one in self._mistakes(plain.bare) if one.fits and one.bare.judged.any()]
        tried.sort(key=lambda one: one.score)
        if tried and (not plain.fits or tried[0].score < plain.score - _SURELY):
            good = [one.cause for one in tried if one.score < tried[0].score + 0.5 * _SURELY]
            yield from dict.fromkeys(cause for cause in good if cause)
            left = np.minimum(tried[0].bare.left, tried[0].loaded.left)
            if (left[tried[0].bare.judged] > _CLOSE).any():
                yield Cause("it is the log of another robot, as this does not fit well either")
        elif not plain.fits:
            yield self._unexplained(plain.bare)

    def _mistakes(self, plain: _Fit) -> Iterator[_Explanation]:
        """Yield all mistakes that are considered, undone."""
        motion, n, names, explained = self._motion, self._n, self._names, self._explained
        yield from self._gains(plain)
        yield from self.mountings()
        rest = np.zeros_like(motion.v)
        added = self._torques(motion._replace(v=rest, a=rest), self._down)
        words = "they are without gravity, which the arm adds by itself"
        yield explained(Cause(words, "--compensated nominal"), 0, added=added)
        slides = np.array(list(self._robot.slides.values()))
        degrees = motion.turned(np.where(slides, 1.0, math.radians(1.0)))
        yield explained(Cause("the angles are degrees", "--degrees"), 0, degrees)
        orders = [list(range(n))[::-1]] if n > 2 else []
        for i, j in combinations(range(n), 2):
            orders.append([j if k == i else i if k == j else k for k in range(n)])
        for order in orders:
            moved = [names[j] for j in range(n) if order[j] != j]
            who = " and ".join(moved) + " are swapped"
            who = who if len(moved) == 2 else "the joints are in another order"
            listed = ",".join(names[j] for j in (order if self._named else np.argsort(order)))
            cause = Cause(f"the columns of {who}", f"--joints {listed}")
            yield explained(cause, 1, _Motion(*(part[:, order] for part in motion)))
            cause = Cause(f"the torques of {who}", f"--joints tau:{listed}")
            yield explained(cause, 1, motion._replace(tau=motion.tau[:, order]))
        for j, name in enumerate(names):
            sign = np.where(np.arange(n) == j, -1.0, 1.0)
            words = f"the position of {name} has the wrong sign"
            yield explained(Cause(words, f"--flip q:{name}"), 1, motion.turned(sign))

    def _explained(
        self,
        cause: Cause | None,
        numbers: float,
        motion: _Motion | None = None,
        gravity: np.ndarray | None = None,
        added: np.ndarray | float = 0.0,
        gains: np.ndarray | float = 1.0,
    ) -> _Explanation:
        """Return the fits without and with a load after a mistake is undone.

        Residuals are relative to the torques of the corrected motion, less what is ``added``.
        """
        motion = self._motion if motion is None else motion
        motion = motion._replace(tau=motion.tau * gains)
        gravity = self._down if gravity is None else gravity
        d, tau = self._torques(motion, gravity), motion.tau + added
        sizes = np.linalg.norm(motion.tau, axis=0)
        bare = _fit(motion, tau, d, sizes)
        noise = np.hypot(bare.left, _LEAST_RESIDUAL) * sizes / math.sqrt(len(tau))
        mass, torque, whole = self._load(motion, tau - d, gravity, np.maximum(noise, _EPS))
        loaded = _fit(motion, tau - torque, d, sizes)
        fits = bare.fits.all() or (whole and loaded.fits.all())
        score = min(bare.score, loaded.score + _PRICE * _LOAD_NUMBERS) + _PRICE * numbers
        return _Explanation(cause, bare, loaded, mass, gravity, bool(fits), score)

    def _gains(self, plain: _Fit) -> Iterator[_Explanation]:
        """Yield explanations by signs of the torques, and by a common factor."""
        names, n = self._names, self._n
        against = plain.judged & (plain.factor < 0.0)
        for one in {*((j,) for j in range(n)), tuple(np.flatnonzero(against).tolist())} - {()}:
            who = ",".join(names[j] for j in one)
            cause = Cause(f"the torque of {who} has the wrong sign", f"--flip {who}")
            yield self._explained(
                cause, len(one), gains=np.where(np.isin(range(n), one), -1.0, 1.0)
            )
        cause = Cause("the torque of all joints has the wrong sign", "--torque-gain=-1")
        yield self._explained(cause, 1, gains=-np.ones(n))
        clear = plain.judged & (np.abs(plain.correlation) >= _CLEAR)
        if not clear.any():
            return
        sign, factors = -1.0 if against[clear].all() else 1.0, plain.factor
        common = sign * float(np.exp(np.mean(np.log(np.abs(factors[clear])))))
        spread, sizes = factors[clear] / common, np.abs(factors)
        off = np.flatnonzero(clear & ((sizes < _FACTORS[0]) | (sizes > _FACTORS[1])))
        if not off.size:
            return
        words, gains = f"all torques are about {common:.2g} times the described ones", np.ones(n)
        option = f"--torque-gain={1.0 / common:.3g}"
        if ((spread > _USUAL[0]) & (spread < 1.0 / _USUAL[0])).all():
            off, gains = off[:1], gains / common
        else:
            gains[off] = 1.0 / factors[off]
            shown = ", ".join(f"{names[j]} {factors[j]:.2g}" for j in off)
            words = f"torques are these multiples of the described ones: {shown}"
            option = "--torque-gain " + ",".join(f"{names[j]}={gains[j]:.3g}" for j in off)
        cause = Cause(f"{words}. {_UNITS}", f"{option}, or rather the data sheet's gains,")
        yield self._explained(cause, off.size, gains=gains)

    def mountings(self) -> Iterator[_Explanation]:
        """Yield the explanations by gravity along another axis of the base."""
        size = float(np.linalg.norm(self._down))
        for gravity in size * np.vstack([np.eye(3), -np.eye(3)]):
            if not size or np.allclose(gravity, self._down, atol=0.1 * size):
                continue
            side = "upright" if gravity[2] < 0.0 else "upside down" if gravity[2] else "on a wall"
            mount = {"upside down": " or --mount ceiling", "on a wall": " or --mount wall"}
            option = f"--gravity={','.join(f'{x + 0.0:.3g}' for x in gravity)}{mount.get(side, '')}"
            cause = Cause(f"the base is mounted {side}", option)
            yield self._explained(cause, 1, gravity=gravity)

    def _unexplained(self, plain: _Fit) -> Cause:
        """Return the cause of a log that no single mistake explains."""
        wrong = np.flatnonzero(~plain.fits)
        shown = [
            f"{self._names[j]} is {plain.factor[j]:.2f} times the description (correlation "
            f"{plain.correlation[j]:.2f})"
            for j in wrong
        ]
        return Cause(
            f"{'; '.join(shown)}. Neither a sign, a unit, a gear, two swapped columns nor a "
            "mounting explains it. Is it the log of another robot, or do several of these come "
            "together?"
        )
