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
from ..information.measured_motion import OVERLAP, Averages, MeasuredMotion
from ..models.physical_fit import PhysicalSet
from ..robot.changes import Friction, Shaft
from ..robot.robot import Robot
from ..tuning.unknowns import Unknown
from .fits import WEIGHT, Windows, columns_rms, noise_levels

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
        friction: with the shapes and the shafts.
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
    whole, blocks = np.isin(averages.t, windows.t), blocks_of(len(windows.t))
    bodies, y = windows.W @ physical.local(physical.center)[0], windows.residual(physical.center)
    friction, chosen, gains = robot.friction, list[_Candidate](), list[Gain]()
    (noise, least), n, count = noise_levels(windows.tau), robot.model.nv, bodies.shape[2]
    while True:
        moved = replace(robot, friction=friction)
        plain, candidates = _candidates(moved, motion, averages, whole)
        taken = {name for one in chosen for name in one.coefficients}
        names = {one.words for one in chosen if one.fading is None}
        kept = [one for one in candidates if one.words in names]
        open_ = [
            one
            for one in candidates
            if not taken & set(one.coefficients)
            and (armature if one.shaft is None and "armature" in one.coefficients[0] else effects)
        ]
        parts = [bodies, plain, *(one.columns for one in (*kept, *open_)), y[:, :, None]]
        X, first = np.concatenate(parts, axis=2), len(kept) + 2
        ends = np.cumsum([part.shape[2] for part in parts])
        index = np.arange(ends[first - 1])
        added = [np.arange(a, b) for a, b in pairwise(ends[first - 1 : -1])]
        solved, _ = _eliminated(_sums(X / noise[:, None], count), index)
        left = X[:, :, -1] - X[:, :, index] @ solved[:, -1]
        noise = np.maximum(columns_rms(left), least)
        squares = _held_out(X / noise[:, None], count, blocks, index, [index[:0], *added])
        shares = (squares[0] - squares[1:]) / squares[0].mean()
        errors = shares.std(axis=1, ddof=1) / np.sqrt(len(blocks))
        found = [
            (share, error, k)
            for k, (share, error) in enumerate(zip(shares.mean(axis=1), errors, strict=True))
            if share > max(_SURE * error, _LEAST if open_[k].shaft is None else _SHAFT_LEAST)
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
            both = np.append(index, added[k])
            solved, _ = _eliminated(_sums(X / noise[:, None], count), both)
            j, speed = best.fading
            dry, other = solved[count + n + j, -1], solved[-1, -1]
            friction = _shaped(friction, j, speed, dry, other)
    words = [name for one in chosen for name in one.coefficients if one.fading is None]
    return ChosenEffects(friction, tuple(words), tuple(gains))


def _candidates(
    robot: Robot, motion: MeasuredMotion, averages: Averages, whole: np.ndarray
) -> tuple[np.ndarray, list[_Candidate]]:
    """Return columns (K, n, 2 n) of viscous and Coulomb friction, and effects that may be added.

    Args:
        robot: as described.
        motion: of the whole log.
        averages: over its windows.
        whole: mask of the windows.
    """
    names, v, friction = robot.joint_names, motion.v, robot.friction
    model, data = robot.model, robot.model.createData()
    gravity = np.abs([pin.computeGeneralizedGravity(model, data, q) for q in motion.q])
    turns = np.eye(model.nv)
    near = np.exp(-np.abs(v) / friction.fading)
    sign = np.tanh(v / friction.threshold) * (1.0 + (friction.breakaway - 1.0) * near)

    def columns(values: np.ndarray) -> np.ndarray:
        """Return columns (K, n, n), each of which acts on one joint, of averages (K, n)."""
        return np.asarray(values[whole][:, :, None] * turns)

    rotor = columns(averages.derivative(v))
    kinds = {
        "gear_friction": columns(averages.mean(sign * gravity)),
        "asymmetry": columns(averages.mean(np.abs(sign))),
        "offset": columns(np.ones(whole.shape + v.shape[1:])),
        "armature": rotor,
    }
    fadings = [(f, columns(averages.mean(sign * np.exp(-np.abs(v) / f)))) for f in _FADINGS]
    plain = np.concatenate([columns(averages.mean(v)), columns(averages.mean(sign))], axis=2)
    armatures = tuple(f"{name}.armature" for name in names)
    found = [_Candidate("rotor inertias of all joints", armatures, rotor)]
    for j, name in enumerate(names):
        unit, own = "m/s" if robot.slides[name] else "rad/s", slice(j, j + 1)
        for kind, part in kinds.items():
            found.append(_Candidate(f"{name}.{kind}", (f"{name}.{kind}",), part[:, :, own]))
        for fading, part in fadings:
            words = f"{name}: other friction near rest, up to {fading:g} {unit}"
            coefficients = (f"{name}.breakaway",)
            found.append(_Candidate(words, coefficients, part[:, :, own], fading=(j, fading)))
    for j, turn in product(range(len(names) - 1), (1, -1)):
        if robot.slides[names[j]] != robot.slides[names[j + 1]]:
            continue
        shaft = Shaft((j, j + 1), turn, threshold=float(friction.threshold[j]))
        u, name = v[:, j] + turn * v[:, j + 1], shaft.name(names)
        dry = averages.mean(np.tanh(u / shaft.threshold))
        signals = np.column_stack([averages.derivative(u), averages.mean(u), dry])[whole]
        both = signals[:, None] * (turns[j] + turn * turns[j + 1])[:, None]
        words = f"a motor that turns with {name}"
        found.append(_Candidate(words, (f"{name}.armature",), both, shaft=shaft))
    return plain, found


def _shaped(friction: Friction, j: int, fading: float, dry: float, other: float) -> Friction:
    """Return friction whose joint j has a dry friction, and other friction near rest."""
    breakaway, fadings = friction.breakaway.copy(), friction.fading.copy()
    ratio = (dry + other) / dry if dry > 0.0 else _BREAKAWAY
    breakaway[j], fadings[j] = np.clip(ratio, 0.0, _BREAKAWAY), fading
    return replace(friction, breakaway=breakaway, fading=fadings)


def _sums(X: np.ndarray, bodies: int) -> np.ndarray:
    """Return X^T X (P, P) of rows X (K, n, P), and the prior of the first columns."""
    rows = X.reshape(-1, X.shape[2])
    return rows.T @ rows + np.diag(np.where(np.arange(X.shape[2]) < bodies, WEIGHT, _JITTER))


def _eliminated(H: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what columns (k) explain of all (k, P), and the sums (P, P) of what is left."""
    solved = np.linalg.lstsq(H[np.ix_(index, index)], H[index], rcond=None)[0]
    return solved, H - H[:, index] @ solved


def _held_out(
    X: np.ndarray,
    bodies: int,
    blocks: Sequence[np.ndarray],
    index: np.ndarray,
    added: Sequence[np.ndarray],
) -> np.ndarray:
    """Return the mean square (C, B) of each block, predicted from the others with columns added.

    Args:
        X: (K, n, P + 1) columns in units of the noise, the last of which is explained.
        bodies: number of columns that have a prior.
        blocks: B of windows.
        index: columns of the model.
        added: C sets of columns.
    """
    own = [_sums(X[block], 0) for block in blocks]
    total, found = sum(own) + _sums(X[:0], bodies), np.empty((len(added), len(blocks)))
    for b, block in enumerate(blocks):
        solved, left = _eliminated(total - own[b], index)
        rows = X[block].reshape(-1, X.shape[2])
        rest = rows - rows[:, index] @ solved
        for c, part in enumerate(added):
            x = np.linalg.lstsq(left[np.ix_(part, part)], left[part, -1], rcond=None)[0]
            found[c, b] = np.mean((rest[:, -1] - rest[:, part] @ x) ** 2)
    return found
