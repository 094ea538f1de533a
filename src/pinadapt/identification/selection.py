"""The effects of the joints that a log shows, beside viscous and Coulomb friction.

The learning part of a log is split into blocks of time. Each block is predicted from the others,
with and without an effect at a joint. Effects are added one by one, the best one first, as long as
one lowers the squared error by more than twice the standard error of the gain over the blocks, and
by 1.5 %. An effect of a shaft that two joints turn adds three coefficients and has to gain 10 %.

The error of a joint is relative to its noise, so that neither strong nor light joints decide alone.
For speed the bodies are not kept in the physical cone here, but near the description by the
quadratic form of the same divergence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from .._checks import name_list
from ..information.information import Information
from ..information.measured_motion import OVERLAP, Averages, MeasuredMotion
from ..models.physical_fit import PhysicalSet
from ..models.regressor import PER_BODY
from ..robot.changes import Friction, Shaft
from ..robot.robot import Robot
from ..tuning.unknowns import Unknown
from .fits import WEIGHT, Windows, noise_levels

# Blocks of time in cross-validation. Half as many leave too little to learn from, and twice as many
# are predicted from neighbours that share their errors.
BLOCKS = 8
_FEWEST = 4  # windows in a block, else there are fewer blocks; it matters for logs of some seconds
# Standard errors that an effect has to gain: of a hundred that are none, 2 take two, 1 sixteen; 4
# takes hardly any that a log of a minute shows.
_SURE = 2.0
# Share of the squared error that it has to gain: half as much takes what is none, twice as much
# leaves out effects that lower the held-out error of a TIAGo by a sixth. A shaft has three numbers.
_LEAST, _SHAFT_LEAST = 0.015, 0.1
_FADINGS = (0.03, 0.1, 0.3, 1.0)  # [rad/s or m/s] of friction near rest; every second costs 14 %
_BREAKAWAY = 5.0  # largest dry friction near rest, as a share of that at speed; no log had 2
_JITTER = 1e-9  # of a squared column, where columns depend on each other; a thousand times is alike


def blocks_of(windows: int) -> list[np.ndarray]:
    """Return the indices of windows in blocks of time, without those that two blocks share."""
    count = max(min(BLOCKS, windows // (_FEWEST + OVERLAP - 1)), 2)
    edges = np.linspace(0, windows + OVERLAP - 1, count + 1).round().astype(int)
    return [np.arange(a, b - OVERLAP + 1) for a, b in pairwise(edges)]


class Gain(NamedTuple):
    """What an effect gains.

    Attributes:
        words: what it is.
        share: of the squared error of torques held out in cross-validation.
        deviation: its standard error.
    """

    words: str
    share: float
    deviation: float


@dataclass(frozen=True, eq=False)
class ChosenEffects:
    """The effects of the joints that a log shows.

    Attributes:
        friction: with the shapes, the shafts, and the bodies that load the gears.
        words: the unknown coefficients beside friction, as of ``Unknown.effects``.
        gains: of each effect, in the order in which they were chosen.
    """

    friction: Friction
    words: tuple[str, ...]
    gains: tuple[Gain, ...]

    def unknown(self, given: Unknown) -> dict[str, Any]:
        """Return the fields of ``Unknown`` that differ from those that were given."""
        said = () if not given.effects else name_list(given.effects, "unknown.effects")
        armature = {} if given.armature is not None else {"armature": False}
        return {"effects": (*said, *self.words), **armature}


class _Candidate(NamedTuple):
    """An effect that may be added.

    Attributes:
        words: what it is.
        coefficients: their names; of two effects with a common one, one is taken.
        columns: (K, n, k) of its coefficients.
        fading: joint and speed of other friction near rest.
        shaft: that two joints turn.
    """

    words: str
    coefficients: tuple[str, ...]
    columns: np.ndarray
    fading: tuple[int, float] | None = None
    shaft: Shaft | None = None

    @property
    def is_rotor(self) -> bool:
        """Whether it is the rotor inertia of joints."""
        return self.shaft is None and self.coefficients[0].endswith(".armature")

    @property
    def least(self) -> float:
        """Share of the squared error that it has to gain."""
        return _LEAST if self.shaft is None else _SHAFT_LEAST


def choose_effects(
    robot: Robot,
    motion: MeasuredMotion,
    averages: Averages,
    windows: Windows,
    physical: PhysicalSet,
    *,
    armature: bool,
    effects: bool,
) -> ChosenEffects:
    """Return the effects of the joints that the learning part of a log shows.

    Args:
        robot: as described; its friction has the initial coefficients.
        motion: of the whole log.
        averages: over its windows.
        windows: of the learning part, of the bodies alone.
        physical: the bodies, centred at the description.
        armature: whether rotor inertias are chosen.
        effects: whether all else is chosen: friction near rest, loads, asymmetry, offsets, shafts.
    """
    whole, gravity = np.isin(averages.t, windows.t), _loads(robot, motion)
    bodies = windows.W @ physical.local(physical.center)[0]
    y = (windows.y - windows.W @ physical.center)[:, :, None]
    count, blocks = bodies.shape[2], blocks_of(len(windows.t))
    friction, chosen, gains = robot.friction, list[_Candidate](), list[Gain]()
    noise, least = noise_levels(windows.tau)
    while True:
        moved = replace(robot, friction=friction)
        plain, candidates = _candidates(moved, motion, averages, whole, gravity)
        open_ = [
            one
            for one in candidates
            if (armature if one.is_rotor else effects) and not _taken(one, chosen)
        ]
        taken = {one.words for one in chosen if one.fading is None}
        model = [bodies, plain, *(one.columns for one in candidates if one.words in taken)]
        X = np.concatenate([*model, *(one.columns for one in open_), y], axis=2)
        index = np.arange(sum(part.shape[2] for part in model))
        ends = np.cumsum([index.size, *(one.columns.shape[2] for one in open_)])
        added = [np.arange(a, b) for a, b in pairwise(ends)]
        prior = np.full(X.shape[2], _JITTER)
        prior[:count] = WEIGHT
        x = _solved(X / noise[:, None], prior, index)
        left = X[:, :, -1] - X[:, :, index] @ x
        noise = np.maximum(np.sqrt(np.mean(left**2, axis=0)), least)
        squares = _held_out(X / noise[:, None], prior, blocks, index, [index[:0], *added])
        shares = (squares[0] - squares[1:]) / squares[0].mean()
        errors = shares.std(axis=1, ddof=1) / np.sqrt(len(blocks))
        found = [
            (share, error, k)
            for k, (share, error) in enumerate(zip(shares.mean(axis=1), errors, strict=True))
            if share > max(_SURE * error, open_[k].least)
        ]
        if not found:
            break
        share, error, k = max(found)
        best = open_[k]
        gains.append(Gain(best.words, float(share), float(error)))
        chosen.append(best)
        if best.shaft is not None:
            friction = replace(friction, shafts=(*friction.shafts, best.shaft))
        if best.fading is not None:
            x = _solved(X / noise[:, None], prior, np.append(index, added[k]))
            j, speed = best.fading
            friction = _shaped(friction, j, speed, x[count + robot.model.nv + j], x[-1])
    words = [name for one in chosen for name in one.coefficients if one.fading is None]
    return ChosenEffects(friction, tuple(words), tuple(gains))


def _taken(candidate: _Candidate, chosen: Sequence[_Candidate]) -> bool:
    """Return whether one of the coefficients was chosen before."""
    return any(set(candidate.coefficients) & set(one.coefficients) for one in chosen)


def _loads(robot: Robot, motion: MeasuredMotion) -> np.ndarray:
    """Return the gravity torques |g| (N, n) that load the gears."""
    model = robot.friction.bodies or robot.model
    data = model.createData()
    return np.abs([pin.computeGeneralizedGravity(model, data, q) for q in motion.q])


def _candidates(
    robot: Robot,
    motion: MeasuredMotion,
    averages: Averages,
    whole: np.ndarray,
    gravity: np.ndarray,
) -> tuple[np.ndarray, list[_Candidate]]:
    """Return columns (K, n, 2 n) of viscous and Coulomb friction, and effects that may be added.

    Args:
        robot: as described.
        motion: of the whole log.
        averages: over its windows.
        whole: mask of the windows.
        gravity: (N, n) that loads the gears.
    """
    names, v, friction = robot.joint_names, motion.v, robot.friction
    n, turns = robot.model.nv, np.eye(robot.model.nv)
    near = np.exp(-np.abs(v) / friction.fading)
    sign = np.tanh(v / friction.threshold) * (1.0 + (friction.breakaway - 1.0) * near)
    speed, rotor = averages.mean(v)[whole], averages.rate(v)[whole]
    signals = {
        "gear_friction": averages.mean(sign * gravity)[whole],
        "asymmetry": averages.mean(np.abs(sign))[whole],
        "offset": np.ones(speed.shape),
        "armature": rotor,
    }
    plain = np.concatenate([_of_joints(speed), _of_joints(averages.mean(sign)[whole])], axis=2)
    found = [
        _Candidate(
            "rotor inertias of all joints",
            tuple(f"{name}.armature" for name in names),
            _of_joints(rotor),
        )
    ]
    for j, name in enumerate(names):
        unit = "m/s" if robot.slides[name] else "rad/s"
        for kind, values in signals.items():
            found.append(
                _Candidate(
                    f"{name}.{kind}", (f"{name}.{kind}",), _of_joints(values)[:, :, j : j + 1]
                )
            )
        for fading in _FADINGS:
            other = averages.mean(sign * np.exp(-np.abs(v) / fading))[whole]
            words = f"{name}: other friction near rest, up to {fading:g} {unit}"
            columns = _of_joints(other)[:, :, j : j + 1]
            found.append(_Candidate(words, (f"{name}.breakaway",), columns, fading=(j, fading)))
    for j, turn in product(range(n - 1), (1, -1)):
        if robot.slides[names[j]] == robot.slides[names[j + 1]]:
            shaft = Shaft((j, j + 1), turn, threshold=float(friction.threshold[j]))
            u = v[:, j] + turn * v[:, j + 1]
            both = turns[j] + turn * turns[j + 1]
            parts = (
                averages.rate(u)[whole],
                averages.mean(u)[whole],
                averages.mean(np.tanh(u / shaft.threshold))[whole],
            )
            name = shaft.name(names)
            columns = np.einsum("pk,j->kjp", np.array(parts), both)
            found.append(
                _Candidate(
                    f"a motor that turns with {name}", (f"{name}.armature",), columns, shaft=shaft
                )
            )
    return plain, found


def _of_joints(values: np.ndarray) -> np.ndarray:
    """Return columns (K, n, n), each of which acts on one joint, of values (K, n)."""
    return np.asarray(values[:, :, None] * np.eye(values.shape[1]))


def _shaped(friction: Friction, j: int, fading: float, dry: float, other: float) -> Friction:
    """Return friction whose joint j has a dry friction, and other friction near rest."""
    breakaway, fadings = friction.breakaway.copy(), friction.fading.copy()
    ratio = (dry + other) / dry if dry > 0.0 else _BREAKAWAY
    breakaway[j], fadings[j] = np.clip(ratio, 0.0, _BREAKAWAY), fading
    return replace(friction, breakaway=breakaway, fading=fadings)


def effect_spread(
    robot: Robot,
    motion: MeasuredMotion,
    averages: Averages,
    windows: Windows,
    physical: PhysicalSet,
    found: Information,
) -> np.ndarray:
    """Return by how much an estimate changes (m, p) with one more effect of a joint.

    What a log shows of these effects is not certain, and coefficients depend on them.

    Args:
        robot: with the chosen friction.
        motion: of the whole log.
        averages: over its windows.
        windows: of all parameters, from which they were estimated.
        physical: the set of the parameters.
        found: their estimate.
    """
    whole, count = np.isin(averages.t, windows.t), PER_BODY * physical.bodies
    _, candidates = _candidates(robot, motion, averages, whole, _loads(robot, motion))
    added = [one.columns for one in candidates if one.columns.shape[2] == 1]
    T = np.eye(len(found.names))
    T[:count, :count] = physical.local(found.estimate)[0][:count, :count]
    left = windows.residual(found.estimate)
    noise = np.maximum(np.sqrt(np.mean(left**2, axis=0)), noise_levels(windows.tau)[1])
    X = np.concatenate([windows.W @ T, *added, left[:, :, None]], axis=2) / noise[:, None]
    rows, p = X.reshape(-1, X.shape[2]), len(found.names)
    H = rows.T @ rows + _JITTER * np.eye(X.shape[2])
    H[:count, :count] += WEIGHT * np.eye(count)
    solved = np.linalg.lstsq(H[:p, :p], H[:p], rcond=None)[0]
    rest = H[p:, p:] - H[p:, :p] @ solved[:, p:]
    effects = rest[:-1, -1] / np.diag(rest)[:-1]
    return np.asarray((T @ (solved[:, p:-1] * effects)).T)


def _solved(X: np.ndarray, prior: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return the coefficients of some columns of X (K, n, P + 1), whose last one they explain."""
    rows = X.reshape(-1, X.shape[2])[:, [*index, -1]]
    H = rows.T @ rows
    return np.linalg.lstsq(H[:-1, :-1] + np.diag(prior[index]), H[:-1, -1], rcond=None)[0]


def _held_out(
    X: np.ndarray,
    prior: np.ndarray,
    blocks: Sequence[np.ndarray],
    index: np.ndarray,
    added: Sequence[np.ndarray],
) -> np.ndarray:
    """Return the mean square (C, B) of each block, predicted from the others with columns added.

    Args:
        X: (K, n, P + 1) columns in units of the noise, the last of which is explained.
        prior: (P + 1) weights of zero as the value of a coefficient.
        blocks: B of windows.
        index: columns of the model.
        added: C sets of columns.
    """
    flat = [X[block].reshape(-1, X.shape[2]) for block in blocks]
    own = [rows.T @ rows for rows in flat]
    total, found = sum(own), np.empty((len(added), len(blocks)))
    for b, rows in enumerate(flat):
        H = total - own[b] + np.diag(prior)
        solved = np.linalg.lstsq(H[np.ix_(index, index)], H[index], rcond=None)[0]
        rest, left = rows - rows[:, index] @ solved, H - H[:, index] @ solved
        for c, part in enumerate(added):
            x = np.linalg.lstsq(left[np.ix_(part, part)], left[part, -1], rcond=None)[0]
            found[c, b] = np.mean((rest[:, -1] - rest[:, part] @ x) ** 2)
    return found
