"""The effects of the joints that a log shows, beside viscous and Coulomb friction.

The learning part of a log is split into blocks of time. Each block is predicted from the others,
with and without an effect at a joint. Effects are added one by one, the best one first, as long as
one lowers the squared error by more than twice the standard error of the gain over the blocks, and
by 1.5 %. A motor that two joints turn also needs a rotor and friction that are not negative.

The error of a joint is relative to its noise, so that neither strong nor light joints decide alone.
For speed the bodies are not kept in the physical cone here, but near the description by the
quadratic form of the same divergence.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from ..information.measured_motion import OVERLAP, Averages, MeasuredMotion
from ..models.dynamics import Dynamics
from ..models.joint_effects import USUAL
from ..models.physical_fit import physical_set
from ..robot.changes import Friction, Shaft
from ..robot.robot import Robot
from ..tuning.unknowns import EFFECTS
from .fits import WEIGHT, Windows, noise_levels

# Blocks of time in cross-validation. Half as many leave too little to learn from, and twice as many
# are predicted from neighbours that share their errors.
_BLOCKS = 8
# Standard errors that an effect has to gain: of a hundred that are none, 2 take two, 1 sixteen; 4
# takes hardly any that a log of a minute shows.
_SIGNIFICANCE = 2.0
# Share of the squared error that it has to gain: half as much takes what is none, twice as much
# leaves out effects that lower the held-out error of a TIAGo by a sixth.
LEAST_GAIN = 0.015
# [rad/s or m/s] of friction near rest; every second alone costs 14 %; half, twice: held-out errors
# of a Panda and a TX40 the same to 0.7 %
_FADINGS = (0.03, 0.1, 0.3, 1.0)
_PLAIN = "viscous", "coulomb"  # that every joint has


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


class ChosenEffects(NamedTuple):
    """The effects of the joints that a log shows.

    Attributes:
        friction: with the shapes and the shafts.
        words: the unknown coefficients beside friction, as of ``Unknown.effects``.
        gains: of each effect, in the order in which they were chosen.
    """

    friction: Friction
    words: tuple[str, ...]
    gains: tuple[Gain, ...]


class _Candidate(NamedTuple):
    """An effect that may be added.

    Attributes:
        words: what it is.
        coefficients: their names; of two effects with a common one, one is taken.
        columns: of its coefficients.
        fading: joint and speed of other friction near rest.
        shafts: that two joints turn.
    """

    words: str
    coefficients: tuple[str, ...]
    columns: list[int]
    fading: tuple[int, float] | None = None
    shafts: tuple[Shaft, ...] = ()


def with_shafts(robot: Robot, first: int = 0) -> Robot:
    """Return a robot with all shafts that two neighbouring joints may turn, from a joint on."""
    slides = robot.sliding
    shafts = tuple(
        Shaft((j, j + 1), turn, threshold=float(robot.friction.threshold[j]))
        for j, turn in product(range(first, len(slides) - 1), (1, -1))
        if slides[j] == slides[j + 1] and robot.model.parents[j + 2] == j + 1
    )
    return replace(robot, friction=replace(robot.friction, shafts=shafts))


def choose_effects(
    robot: Robot,
    motion: MeasuredMotion,
    averages: Averages,
    windows: Windows,
    dynamics: Dynamics,
    *,
    armature: bool,
    effects: bool,
) -> ChosenEffects:
    """Return the effects of the joints that the learning part of a log shows.

    Args:
        robot: as described; its friction has the initial coefficients.
        motion: of the whole log.
        averages: over its windows.
        windows: of the learning part.
        dynamics: of the bodies and of all effects, those of shafts included, see ``with_shafts``.
        armature: whether rotor inertias are chosen.
        effects: whether all else is chosen: friction near rest, loads, asymmetry, offsets, shafts.
    """
    physical = physical_set(dynamics.inertial, robot)
    n = robot.model.nv
    size = physical.center.size
    bodies = windows.W[:, :, :size]
    sign = np.tanh(motion.v / robot.friction.threshold)
    chosen = np.isin(averages.t, windows.t)
    near = [
        averages.mean(sign * np.exp(-np.abs(motion.v) / fading))[chosen][:, :, None] * np.eye(n)
        for fading in _FADINGS
    ]
    y = windows.y - bodies @ physical.center
    local = bodies @ physical.local(physical.center)[0]
    X = np.concatenate([local, windows.W[:, :, size:], *near, y[:, :, None]], axis=2)
    # products of all columns, by block of time and joint; no window is in two blocks
    edges = np.linspace(0, len(X) + OVERLAP - 1, _BLOCKS + 1).round().astype(int)
    blocks = [X[a : max(b - OVERLAP + 1, a)].swapaxes(0, 1) for a, b in pairwise(edges)]
    products = np.array([block.swapaxes(1, 2) @ block for block in blocks])
    rows = np.array([block[..., 0].size for block in blocks])
    prior = np.where(np.arange(X.shape[2]) < size, WEIGHT, 0.0)
    (noise, least), names = noise_levels(windows.tau), robot.joint_names
    plain = [dynamics.names.index(f"{name}.{kind}") for kind in _PLAIN for name in names]
    index = np.array([*range(size), *plain])
    open_ = [
        one
        for one in _candidates(robot, dynamics)
        if (armature if len(one.coefficients) > 1 else effects)
    ]
    friction = robot.friction
    words = list[str]()
    gains = list[Gain]()
    while True:
        left = _fitted(np.tensordot(noise**-2.0, products.sum(axis=0), axes=1), prior, index)
        squares = left @ products.sum(axis=0) @ left
        noise = np.maximum(np.sqrt(squares / rows.sum() * n), least)
        H = np.tensordot(noise**-2.0, products, axes=(0, 1))
        before = _held_out(H, prior, index) / rows
        found = []
        for one in open_:
            whole = np.append(index, one.columns)
            if one.shafts and (_fitted(H.sum(axis=0), prior, whole)[one.columns] > 0.0).any():
                continue  # with negative friction or a negative rotor it is something else
            after = _held_out(H, prior, whole) / rows
            shares = (before - after) / before.mean()
            share = float(shares.mean())
            error = float(shares.std(ddof=1) / np.sqrt(_BLOCKS))
            if share > max(_SIGNIFICANCE * error, LEAST_GAIN):
                found.append((Gain(one.words, share, error), one))
        if not found:
            return ChosenEffects(friction, tuple(words), tuple(gains))
        gain, best = max(found, key=lambda one: one[0].share)
        gains.append(gain)
        index = np.append(index, best.columns)
        open_ = [one for one in open_ if not set(best.coefficients) & set(one.coefficients)]
        friction = replace(friction, shafts=(*friction.shafts, *best.shafts))
        if best.fading is None:
            words += best.coefficients
        else:
            fit, (j, fading) = _fitted(H.sum(axis=0), prior, index), best.fading
            dry = -fit[plain[n + j]]
            ratio = 1.0 - fit[index[-1]] / dry if dry > 0.0 else 1.0
            breakaway = friction.breakaway.copy()
            fadings = friction.fading.copy()
            breakaway[j], fadings[j] = max(ratio, 0.0), fading
            friction = replace(friction, breakaway=breakaway, fading=fadings)


def _candidates(robot: Robot, dynamics: Dynamics) -> Iterator[_Candidate]:
    """Yield the effects that may be added; columns of friction near rest are the last ones."""
    names = dynamics.names
    joints = robot.joint_names
    armatures = tuple(f"{name}.armature" for name in joints)
    yield _Candidate("rotor inertias of all joints", armatures, list(map(names.index, armatures)))
    for word in names[dynamics.inertial.size :]:
        if word.rpartition(".")[2] in EFFECTS:
            yield _Candidate(word, (word,), [names.index(word)])
    for k, (fading, (j, name)) in enumerate(product(_FADINGS, enumerate(joints))):
        unit = "m/s" if robot.slides[name] else "rad/s"
        words = f"{name}: other friction near rest, up to {fading:g} {unit}"
        yield _Candidate(words, (f"{name}.breakaway",), [len(names) + k], fading=(j, fading))
    for shaft in with_shafts(robot).friction.shafts:
        name = shaft.name(joints)
        columns = [names.index(f"{name}.{kind}") for kind in USUAL]
        words = f"a motor that turns with {name}"
        yield _Candidate(words, (f"{name}.armature",), columns, shafts=(shaft,))


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
