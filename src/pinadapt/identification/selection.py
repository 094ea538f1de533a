"""The effects of the joints that a log shows, beside viscous and Coulomb friction.

The learning part of a log is split into blocks of time. Each block is predicted from the others,
with and without an effect at a joint. Effects are added one by one, the best one first, as long as
one lowers the squared error by more than twice the standard error of the gain over the blocks, and
by 1.5 %.

The error of a joint is relative to its noise, so that neither strong nor light joints decide alone.
For speed the bodies are not kept in the physical cone here, but near the description by the
quadratic form of the same divergence.
"""

from __future__ import annotations

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
from .fits import WEIGHT, Windows, noise_levels

# Blocks of time in cross-validation. Half as many leave too little to learn from, and twice as many
# are predicted from neighbours that share their errors.
_BLOCKS = 8
# Standard errors that an effect has to gain: of a hundred that are none, 2 take two, 1 sixteen; 4
# takes hardly any that a log of a minute shows.
_SURE = 2.0
# Share of the squared error that it has to gain: half as much takes what is none, twice as much
# leaves out effects that lower the held-out error of a TIAGo by a sixth.
_LEAST = 0.015
_FADINGS = (0.03, 0.1, 0.3, 1.0)  # [rad/s or m/s] of friction near rest; every second costs 14 %
_BREAKAWAY = 5.0  # largest dry friction near rest, as a share of that at speed; no log had 2


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
    bodies, y = windows.W @ physical.local(physical.center)[0], windows.residual(physical.center)
    plain, rotors, others = _candidates(robot, motion, averages, np.isin(averages.t, windows.t))
    candidates = [rotors] * armature + others * effects
    parts = [bodies, plain, *(one.columns for one in candidates), y[:, :, None]]
    X, ends = np.concatenate(parts, axis=2), np.cumsum([part.shape[2] for part in parts])
    # products of all columns, by block of time and joint; no window is in two blocks
    edges = np.linspace(0, len(X) + OVERLAP - 1, _BLOCKS + 1).round().astype(int)
    blocks = [X[a : max(b - OVERLAP + 1, a)].swapaxes(0, 1) for a, b in pairwise(edges)]
    products = np.array([block.swapaxes(1, 2) @ block for block in blocks])
    rows = np.array([block.shape[0] * block.shape[1] for block in blocks])
    prior = np.where(np.arange(ends[-1]) < ends[0], WEIGHT, 0.0)
    (noise, least), index = noise_levels(windows.tau), np.arange(ends[1])
    open_ = list(zip(candidates, map(np.arange, ends[1:-2], ends[2:-1]), strict=True))
    friction, words, gains = robot.friction, list[str](), list[Gain]()
    while True:
        left = _fitted(np.tensordot(noise**-2.0, products.sum(axis=0), axes=1), prior, index)
        squares = left @ products.sum(axis=0) @ left
        noise = np.maximum(np.sqrt(squares / rows.sum() * len(noise)), least)
        H = np.tensordot(noise**-2.0, products, axes=(0, 1))
        before, found = _held_out(H, prior, index) / rows, []
        for one, columns in open_:
            after = _held_out(H, prior, np.append(index, columns)) / rows
            shares = (before - after) / before.mean()
            share, error = float(shares.mean()), float(shares.std(ddof=1) / np.sqrt(_BLOCKS))
            if share > max(_SURE * error, _LEAST):
                found.append((Gain(one.words, share, error), one, columns))
        if not found:
            return ChosenEffects(friction, tuple(words), tuple(gains))
        gain, best, columns = max(found, key=lambda one: one[0].share)
        gains.append(gain)
        index = np.append(index, columns)
        taken = set(best.coefficients)
        open_ = [pair for pair in open_ if not taken & set(pair[0].coefficients)]
        if best.fading is not None:
            fit, (j, fading) = _fitted(H.sum(axis=0), prior, index), best.fading
            dry = -fit[ends[0] + len(noise) + j]
            ratio = 1.0 - fit[index[-1]] / dry if dry > 0.0 else _BREAKAWAY
            friction = _shaped(friction, j, float(np.clip(ratio, 0.0, _BREAKAWAY)), fading)
            continue
        words += best.coefficients
        if best.shaft is not None:
            friction = replace(friction, shafts=(*friction.shafts, best.shaft))


def _shaped(friction: Friction, j: int, ratio: float, fading: float) -> Friction:
    """Return friction whose joint j has another dry friction near rest."""
    breakaway, fadings = friction.breakaway.copy(), friction.fading.copy()
    breakaway[j], fadings[j] = ratio, fading
    return replace(friction, breakaway=breakaway, fading=fadings)


def _fitted(H: np.ndarray, prior: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return the weights (..., P) of columns in what a least-squares fit of the last one leaves.

    Args:
        H: (..., P, P) products of all columns.
        prior: (P) inverse variances of their coefficients.
        index: columns that are fitted.
    """
    A = H[..., index[:, None], index]
    size = np.diagonal(A, axis1=-2, axis2=-1)
    A = A + (prior[index] + 1e-9 * size + (size == 0.0))[..., None, :] * np.eye(len(index))
    left = np.zeros(H.shape[:-1])
    left[..., -1] = 1.0
    left[..., index] = -np.linalg.solve(A, H[..., index, -1:])[..., 0]
    return left


def _held_out(H: np.ndarray, prior: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return the squared error (B) of each block, of products H (B, P, P), by the others' fit."""
    left = _fitted(H.sum(axis=0) - H, prior, index)
    return np.einsum("bi,bij,bj->b", left, H, left)


def _candidates(
    robot: Robot, motion: MeasuredMotion, averages: Averages, whole: np.ndarray
) -> tuple[np.ndarray, _Candidate, list[_Candidate]]:
    """Return columns (K, n, 2 n) of viscous and Coulomb friction, rotor inertias, other effects.

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

    kinds: list[tuple[str, np.ndarray, float | None]] = [
        ("gear_friction", columns(averages.mean(sign * gravity)), None),
        ("asymmetry", columns(averages.mean(np.abs(sign))), None),
        ("offset", columns(np.ones(whole.shape + v.shape[1:])), None),
    ]
    for fading in _FADINGS:
        near = averages.mean(sign * np.exp(-np.abs(v) / fading))
        kinds.append(("breakaway", columns(near), fading))
    plain = np.concatenate([columns(averages.mean(v)), columns(averages.mean(sign))], axis=2)
    armatures = tuple(f"{name}.armature" for name in names)
    rotors = _Candidate("rotor inertias of all joints", armatures, columns(averages.derivative(v)))
    found = []
    for (j, name), (kind, part, speed) in product(enumerate(names), kinds):
        words, shape = f"{name}.{kind}", None
        if speed is not None:
            unit = "m/s" if robot.slides[name] else "rad/s"
            words, shape = f"{name}: other friction near rest, up to {speed:g} {unit}", (j, speed)
        found.append(_Candidate(words, (f"{name}.{kind}",), part[:, :, j : j + 1], fading=shape))
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
    return plain, rotors, found
