"""Whether recorded torques can be those of a described robot, and if not, what is the likely cause.

For each joint the torque tau of a log is compared with what the description predicts, d, from its
inverse dynamics without friction. Both are averaged over windows, and what viscous and Coulomb
friction of the joint could explain is removed from both. Then

    factor = <tau, d> / <d, d>,        correlation = <tau, d> / (|tau| |d|).

Friction, noise, inertias that are wrong by a third and wear leave the factor between 0.5 and 2.2:
logs of four real arms gave 0.87 to 1.86, correlations of at least 0.86. Currents, torques before
the gear, a wrong sign or another mounting do not.

Usual mistakes are undone one by one. Each is judged by the likeliest errors of the described bodies
and loads at the task frames, normal with given deviations, beside a rotor and friction: by the sum
over the joints of log(residual^2) and the squared size of these errors. A log fits if no mistake is
surely likelier than none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from threadpoolctl import threadpool_limits

from .._output import Printed, Report, Table
from ..description.chain import angles_from_configuration
from ..information.measured_motion import Averages, evenly, integrated
from ..logs.import_options import ImportOptions
from ..logs.log import Log
from ..models.bodies import ALL, BodyDynamics
from ..models.excited import rms
from ..models.physical_fit import physical_set
from ..models.regressor import PER_BODY
from ..robot.robot import Robot
from .logged_motion import motion_of_log

# Factors between which a joint is as described. Half as wide refuses worn or wrongly described
# arms, twice as wide accepts a robot of another size.
_FACTORS = (0.5, 2.2)
# correlation of a clear relation; half: the same verdicts, with more joints named; 0.9: three of 27
# mistakes are accepted
_CLEAR = 0.75
# correlation, and share of a joint's torque, from where on a relation may be there; half: the same
# verdicts on four real logs and mistakes in them; twice: another joint is named in one
_LEAST = 0.4
# Of the largest described torque, from where on a joint is judged: half as much judges wrists whose
# friction hides everything else, twice as much overlooks light joints.
_VISIBLE = 0.05
# In log(residual^2): by how much a mistake must be likelier than none. Half refuses quarters of
# real logs, twice as much accepts a wrong sign.
_EVIDENCE = 1.15
# Deviation of a described body in the divergence of ``physical_fit``: 0.3 of its mass. Half takes a
# UR10 for a UR5, twice refuses a quarter of the log of a Panda.
_OFF = 0.6
# Independent rows that the torques of a joint are worth, as errors of a model last. Half and twice
# name other causes for amperes of a Panda and a TX40.
_WORTH = 5.0
# Of the robot's mass: a load. Half as much refuses rated loads, twice as much takes a UR10 for a
# loaded UR5. A usual one has this share of mass and reach, a weak prior.
HEAVIEST = 1.0 / 3.0
# [rad or m] of a position that is off. 20 degrees of a Panda show as 0.17 to 0.5: twice misses its
# third joint.
_LEAST_ANGLE = 0.1
_EPS = np.finfo(float).eps
# of a joint's torque, that no description explains; for exact logs; half, twice: the same verdicts
_LEAST_RESIDUAL = 0.02


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


@dataclass(frozen=True, eq=False, repr=False)
class TorqueCheck(Printed):
    """The comparison of a log with a description; ``print`` shows a table.

    Attributes:
        source: of the log.
        joints: (n) factors and correlations.
        causes: likely ones of torques that do not fit, the likeliest first, with the option of
            ``pinadapt identify`` that corrects each; none: they fit.
        load: at the task frames, in addition to what is described, that explains the torques
            surely better than none [kg]; else zero.
    """

    source: str
    joints: tuple[JointFactor, ...]
    causes: tuple[str, ...]
    load: float = 0.0

    @property
    def fits(self) -> bool:
        """Whether the log can be one of the described robot."""
        return not self.causes

    @property
    def verdict(self) -> str:
        """The result in one line."""
        if self.causes:
            return (
                f"the torques do not fit the description: {'. Or '.join(self.causes)}. Or is it "
                "the log of another robot?"
            )
        factors = ", ".join(f"{one.factor:.2f}" for one in self.joints if one.judged)
        if not factors:
            return "the description predicts too little torque to judge the log by it."
        load = f", with a load of {self.load:.2f} kg at the task frame" if self.load else ""
        return f"the torques fit the description ({factors} times it at the judged joints){load}."

    def table(self) -> Table:
        """Return one row for each joint."""
        rows = [
            [
                *one[:5],
                ("fits" if one.fits else "DOES NOT FIT") if one.judged else "too little to judge",
            ]
            for one in self.joints
        ]
        return Table(rows, [*JointFactor._fields[:5], ""])

    def summary(self) -> dict[str, Any]:
        """Return all numbers and words for a file."""
        return {"fits": self.fits, "verdict": self.verdict, **vars(self)}

    def report(self) -> Report:
        """Return table and verdict."""
        return Report(f"torques of {self.source}", [self.table()], self.verdict)


@threadpool_limits.wrap(limits=1, user_api="blas")
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
    plain = _fit(motion)
    undone = ((cause, _fit(other)) for cause, other in _mistakes(motion))
    likely = sorted(undone, key=lambda one: one[1].score)
    causes = []
    best = likely[0][1].score
    if best < plain.score - _EVIDENCE:
        causes = [cause for cause, fit in likely if fit.score < best + 0.5 * _EVIDENCE]
    elif not plain.fits.all():
        shown = [
            f"{robot.joint_names[j]} is {plain.factor[j]:.2f} times the description (correlation "
            f"{plain.correlation[j]:.2f})"
            for j in np.flatnonzero(~plain.fits)
        ]
        causes = [f"{'; '.join(shown)}, and no single mistake explains that"]
    columns = (part.tolist() for part in (rms(motion.tau, 0), *plain[:5]))
    joints = map(JointFactor, robot.joint_names, *columns)
    return TorqueCheck(log.source, tuple(joints), tuple(causes), plain.load)


def on_wall(log: Log, robot: Robot) -> Robot:
    """Return a robot that hangs on a wall, with down along that axis which its torques show best.

    Args:
        log: checked, its columns in the order of the joints.
        robot: as described, the third axis of its base normal to the wall.
    """

    def likeness(hung: _Motion) -> float:  # whatever units and signs of the torques are
        d = _each(hung, pin.rnea)
        return float(np.sum(_compared(hung, hung.tau, d).correlation ** 2))

    mountings = _mountings(_averages(log, robot))
    walls = (hung for hung in mountings if not hung.robot.model.gravity.linear[2])
    return max(walls, key=likeness).robot


class _Motion(NamedTuple):
    """Averages over K windows (K, n), of joints in rad or m.

    Attributes:
        robot: as described, whose motion it is.
        q, v, a: angles, velocities, accelerations.
        tau: torques.
        signs: of v.
        scale: root (10 n + 10 k, 10 n + 10 k) of the covariance of all bodies and of loads on k.
        added: to these torques by the arm.
    """

    robot: Robot
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    signs: np.ndarray
    scale: np.ndarray
    added: np.ndarray | float = 0.0

    def turned(self, scale: np.ndarray) -> _Motion:
        """Return it scaled by factors (n), the torques as they are."""
        q, v, a = (part * scale for part in self[1:4])
        return self._replace(q=q, v=v, a=a, signs=self.signs * np.sign(scale))

    @property
    def drives(self) -> np.ndarray:
        """Columns (n, K, 3) of what friction and rotor of each joint can explain."""
        return np.stack([self.v.T, self.signs.T, self.a.T], axis=2)

    def without(self, values: np.ndarray, count: int) -> np.ndarray:
        """Return values (K, n, k) less what the first columns of ``drives`` can explain."""
        columns = self.drives[:, :, :count]
        parts = values.swapaxes(0, 1)
        return (parts - columns @ (np.linalg.pinv(columns) @ parts)).swapaxes(0, 1)


def _averages(log: Log, robot: Robot) -> _Motion:
    """Return averages over some windows of a log."""
    motion = motion_of_log(robot, log)
    model = robot.model
    angles = motion.q
    if model.nq != model.nv:
        angles = np.unwrap([angles_from_configuration(model, q) for q in motion.q], axis=0)
    averages = Averages(motion.t, log.period)
    whole = np.flatnonzero(averages.whole)
    # twice as many windows give the same verdicts on the real logs
    some = whole[evenly(len(whole), 125)]
    parts = angles, motion.v, motion.a, motion.tau, np.tanh(motion.v / 0.02)
    means = (averages.mean(part)[some] for part in parts)
    return _Motion(robot, *means, scale=_deviations(robot))  # type: ignore[misc]


class _Fit(NamedTuple):
    """A comparison of torques with described ones, arrays (n).

    Attributes:
        described: root mean squares without friction [N m or N].
        factor, correlation: see the module.
        judged: whether the description predicts enough of each joint.
        fits: whether each joint is as described, as far as it is judged.
        left: what neither the description nor friction and rotor explain, a share of the torque,
            beside what no description explains.
        price: squared size of the errors of bodies and load, per independent row.
        load: that explains what is left of the torques, if it is surely not zero [kg].
    """

    described: np.ndarray
    factor: np.ndarray
    correlation: np.ndarray
    judged: np.ndarray
    fits: np.ndarray
    left: np.ndarray
    price: float = 0.0
    load: float = 0.0

    @property
    def score(self) -> float:
        """The sum of log(residual^2) over the joints, and the price of errors of the bodies."""
        return float(np.log(self.left**2).sum()) + self.price


def _each(motion: _Motion, function: Any) -> np.ndarray:
    """Return a function of configuration, velocity and acceleration in each window."""
    model = motion.robot.model
    data = model.createData()
    q = integrated(model, pin.neutral(model), motion.q)
    return np.array(
        [function(model, data, *each).copy() for each in zip(q, motion.v, motion.a, strict=True)]
    )


def _fit(motion: _Motion) -> _Fit:
    """Return the likelier fit of those without and with errors of the bodies and a load.

    These are the ones that best explain what the description leaves, near the description and a
    usual load. Residuals are relative to the torques of the motion, less what is ``added``.
    """
    d = _each(motion, pin.rnea)
    tau = motion.tau + motion.added
    bare = _compared(motion, tau, d)
    Y = _each(motion, pin.computeJointTorqueRegressor)
    scale = motion.scale
    size = Y.shape[2]
    carrying = np.isin(np.arange(size) // PER_BODY, motion.robot.carriers)
    Y = np.concatenate([Y, Y[:, :, carrying]], axis=2) @ scale
    rows = motion.without(np.concatenate([Y, (tau - d)[..., None]], axis=2), 3)
    heavy = scale[size::PER_BODY].sum(axis=0)  # times x is the mass of the loads
    fit = bare
    for _ in range(2):
        noise = math.sqrt(len(tau) / _WORTH) * fit.left * rms(motion.tau, 0)
        W, r = np.split((rows / noise[:, None]).reshape(-1, rows.shape[2]), [-1], axis=1)
        given = np.column_stack([W.T @ r, heavy])
        x, spread = np.linalg.solve(np.eye(heavy.size) + W.T @ W, given).T
        fit = _compared(motion, tau - Y @ x, d)
    loaded = _compared(motion, tau - Y[:, :, size:] @ x[size:], d)
    mass, deviation = float(heavy @ x), math.sqrt(heavy @ spread)
    mass *= abs(mass) > 2.0 * deviation  # beyond which are 5 % of loads that are none
    fit = loaded._replace(left=fit.left, price=x @ x / _WORTH, load=mass)
    best = min(bare, fit, key=lambda one: one.score)
    return best._replace(fits=bare.fits) if bare.fits.all() else best


def _deviations(robot: Robot) -> np.ndarray:
    """Return ``_Motion.scale``."""
    from scipy.linalg import block_diag  # here, because scipy is slow to import

    bodies = physical_set(BodyDynamics(robot, ALL), robot)
    radius = HEAVIEST * robot.reach
    usual = HEAVIEST * robot.mass * radius ** np.repeat([0, 1, 2], [1, 3, 6])
    loads = np.tile(usual, len(robot.carriers))
    return block_diag(_OFF * bodies.local(bodies.center)[0], np.diag(loads))


def _compared(motion: _Motion, tau: np.ndarray, d: np.ndarray) -> _Fit:
    """Return the comparison of torques (K, n) with described ones."""
    from scipy.optimize import nnls  # here, because scipy is slow to import

    both = motion.without(np.stack([tau, d], axis=2), 2)
    level, size = np.maximum(np.linalg.norm(both, axis=0), _EPS).T
    factor = both.prod(axis=2).sum(axis=0) / size**2
    correlation = factor * size / level
    clear = (np.abs(correlation) >= _CLEAR) | (size >= _LEAST * level)
    judged = clear & (size > _VISIBLE * size.max())
    inside = (factor >= _FACTORS[0]) & (factor <= _FACTORS[1]) & (correlation >= _LEAST)
    left = [nnls(*each)[1] for each in zip(motion.drives, (tau - d).T, strict=True)]
    shares = np.minimum(left / np.maximum(np.linalg.norm(motion.tau, axis=0), _EPS), 1.0)
    shares = np.hypot(shares, _LEAST_RESIDUAL)
    return _Fit(size / math.sqrt(len(tau)), factor, correlation, judged, ~judged | inside, shares)


def _mistakes(motion: _Motion) -> Iterator[tuple[str, _Motion]]:
    """Yield the usual mistakes, and the motion that undoes each."""
    names = motion.robot.joint_names
    for hung in _mountings(motion):
        gravity = ",".join(f"{x + 0.0:.3g}" for x in hung.robot.model.gravity.linear)
        yield f"the base is mounted another way; --gravity={gravity}", hung
    weight = _each(motion._replace(v=0.0 * motion.v, a=0.0 * motion.a), pin.rnea)
    yield (
        "they are without gravity, which the arm adds; --compensated nominal",
        motion._replace(added=weight),
    )
    scale = np.where(motion.robot.sliding, 1.0, math.radians(1.0))
    yield "the angles are degrees; --degrees", motion.turned(scale)
    bare = _compared(motion, motion.tau, _each(motion, pin.rnea))
    noise = bare.left * rms(motion.tau, 0)
    for name, unit in zip(names, np.eye(len(names)), strict=True):
        sign = 1.0 - 2.0 * unit
        yield (
            f"the torque of {name} has the wrong sign; --flip {name}",
            motion._replace(tau=motion.tau * sign),
        )
        yield (
            f"the position of {name} has the wrong sign; --flip q:{name}",
            motion.turned(sign),
        )
        off = 0.0
        for _ in range(3):  # steps of Gauss-Newton
            q = motion.q + off * unit
            d, more = (_each(motion._replace(q=q + step * unit), pin.rnea) for step in (0.0, 1e-4))
            both = motion.without(np.stack([more - d, motion.tau - d], axis=2), 3)
            slope, rest = (both / noise[:, None]).T
            off += 1e-4 * np.sum(slope * rest) / max(np.sum(slope**2), _EPS)
        if abs(off) >= _LEAST_ANGLE:
            yield (
                f"the position of {name} is off; --offset {name}={off:.3g}",
                motion._replace(q=motion.q + off * unit),
            )
    for i, j in combinations(range(len(names)), 2):
        order = list(range(len(names)))
        order[i], order[j] = j, i
        listed = ",".join(names[k] for k in order)
        pair = f"{names[i]} and {names[j]}"
        yield (
            f"the columns of {pair} are swapped; --joints {listed}",
            _Motion._make([motion.robot, *(part[:, order] for part in motion[1:6]), *motion[6:]]),
        )
        yield (
            f"the torques of {pair} are swapped; --joints tau:{listed}",
            motion._replace(tau=motion.tau[:, order]),
        )
    yield (
        "the torque of all joints has the wrong sign; --torque-gain=-1",
        motion._replace(tau=-motion.tau),
    )
    # a load raises factors, up to twice
    clear = bare.judged & (np.abs(bare.correlation) >= _CLEAR)
    factors = bare.factor[clear]
    if factors.size and not _FACTORS[0] < np.abs(factors).mean() < _FACTORS[1] ** 2:
        common = np.exp(np.mean(np.log(np.abs(factors)))) * np.sign(factors[0])
        gains = np.where(clear, bare.factor, common)  # motors may be unlike
        yield (
            f"all torques are about {common:.2g} times the described ones, as motor currents "
            f"(A) or torques before the gear are; --torque-gain={1.0 / common:.3g}, or rather "
            "the data sheet's gains",
            motion._replace(tau=motion.tau / gains),
        )


def _mountings(motion: _Motion) -> Iterator[_Motion]:
    """Yield the motion of a robot with gravity along the other axes of its base."""
    down = motion.robot.model.gravity.linear
    size = np.linalg.norm(down)
    for gravity in size * np.vstack([np.eye(3), -np.eye(3)]):
        if not np.allclose(gravity, down, atol=0.1 * size):
            yield motion._replace(robot=ImportOptions(gravity=gravity).mounted(motion.robot))
