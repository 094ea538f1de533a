"""What a log chooses: the effects of the joints, and the weight of the description.

The learning part of a log is split into blocks of time. Each block is predicted from the others,
with and without an effect at a joint. Effects are added one by one, the best one first, as long as
one lowers the error by more than twice the standard error of the gain over the blocks, and by 1 %.
An effect of a shaft that two joints turn adds three coefficients and has to gain ten times as much.

The error is that of all joints together, half of it in N m and half relative to what each joint had
before, so that neither strong joints nor light ones decide alone. For speed the bodies are not kept
in the physical cone here, but near the description by the quadratic form of the same divergence;
its weight is chosen by the same errors.

The weight of the description in the fit of the bodies, gamma of ``physical_fit``, follows from the
evidence, the probability of the torques when bodies are distributed around their description with
the density exp(-gamma D) (D. J. C. MacKay, *Bayesian interpolation*, Neural Computation 4 (1992)
415-447). Of the weights whose evidence differs by less than the factor e from the largest one, it
is the smallest: where the torques do not decide, they are preferred. Cross-validation within a
log chooses by the errors of motions like that log's own, which leaves weights undecided that differ
by a factor of a thousand and predict other motions unlike well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from .._checks import name_list
from ..information.information import Information
from ..information.measured_motion import MeasuredMotion
from ..models.physical_fit import PhysicalSet, physical_path
from ..models.regressor import PER_BODY
from ..robot.changes import Friction, Shaft
from ..robot.robot import Robot
from ..tuning.unknowns import Unknown
from .fits import OVERLAP, Averages, Windows, noise_of, root_of, weighted

BLOCKS = 8  # of time, in cross-validation
_FEWEST = 4  # windows in a block, else there are fewer blocks
_SURE, _LEAST = 2.0, 0.01  # standard errors and share of the error that an effect has to gain
_SHAFT_SURE, _SHAFT_LEAST = 3.0, 0.1  # those of a shaft of two joints
_WIDTHS = (0.003, 0.01, 0.03, 0.1, 0.3)  # [rad/s or m/s] thresholds of Coulomb friction
_OTHER_WIDTHS = (0.003, 0.1)  # a short and a long one, for the spread of estimates
_OTHER_FADINGS = (0.1, 1.0)
_FADINGS = (0.03, 0.1, 0.3, 1.0)  # [rad/s or m/s] of a Stribeck effect
_BREAKAWAY = 5.0  # largest dry friction near rest, as a share of that at speed
_RIDGES = (1e-2, 1e-1, 1.0, 10.0)  # weights of the description
_JITTER = 1e-10  # of a column's square, for columns that depend on each other
_MOST = 40  # effects
GAMMAS = tuple(10.0 ** (0.5 * k) for k in range(6, -9, -1))  # weights of the description
_UNDECIDED = 1.0  # difference of the logarithms of two evidences that decides nothing


def blocks_of(windows: int) -> list[np.ndarray]:
    """Return the indices of windows in blocks of time, without those that two blocks share."""
    count = max(min(BLOCKS, windows // (_FEWEST + OVERLAP - 1)), 2)
    edges = np.linspace(0, windows + OVERLAP - 1, count + 1).round().astype(int)
    return [np.arange(a, b - OVERLAP + 1) for a, b in pairwise(edges)]


def relative_loss(squares: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return the errors of blocks (..., B) from mean squares (..., B, n), one on average before.

    Half of it is the share of all joints' squared error, half the mean share of each joint's.
    """
    whole = squares.sum(axis=-1) / before.sum(axis=-1).mean()
    each = squares / np.maximum(before.mean(axis=0), np.finfo(float).tiny)
    return np.asarray(0.5 * whole + 0.5 * each.mean(axis=-1))


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

    def enough(self, sure: float, least: float) -> bool:
        """Return whether it gains some standard errors and some share of the error."""
        return self.share > max(sure * self.deviation, least)


@dataclass(frozen=True, eq=False)
class ChosenEffects:
    """The effects of the joints that a log shows.

    Attributes:
        friction: with the shapes, the shafts, and the bodies that load the gears.
        words: the unknown coefficients beside friction, as of ``Unknown.effects``.
        gains: of each effect, in the order in which they were chosen.
        loading: a model of the chain, whose gravity torques load the gears.
    """

    friction: Friction
    words: tuple[str, ...]
    gains: tuple[Gain, ...]
    loading: pin.Model

    def unknown(self, given: Unknown) -> dict[str, Any]:
        """Return the fields of ``Unknown`` that differ from those that were given."""
        said = () if not given.effects else name_list(given.effects, "unknown.effects")
        armature = {} if given.armature is not None else {"armature": False}
        return {"effects": (*said, *self.words), **armature}


@dataclass(frozen=True)
class _Candidate:
    """Columns to add to a model, in place of a joint's own dry friction if it is a shape of it."""

    words: str
    columns: tuple[int, ...]
    joint: int
    unknown: str = ""  # the coefficient, for ``Unknown.effects``
    shape: tuple[float, float] | None = None  # threshold, and fading or zero
    shaft: Shaft | None = None


class _Columns:
    """The columns (K, n, P) of all candidates, after those of bodies and viscous friction."""

    def __init__(self, first: np.ndarray) -> None:
        self._parts = [first]
        self._count = first.shape[2]
        self._windows, self._joints = first.shape[:2]

    def add(self, rows: dict[int, np.ndarray]) -> int:
        """Add a column that acts on joints, joint -> (K); return its index."""
        column = np.zeros((self._windows, self._joints, 1))
        for joint, values in rows.items():
            column[:, joint, 0] = values
        self._parts.append(column)
        self._count += 1
        return self._count - 1

    def stacked(self) -> np.ndarray:
        """Return all columns (K, n, P)."""
        return np.concatenate(self._parts, axis=2)


def choose_effects(
    robot: Robot,
    motion: MeasuredMotion,
    period: float,
    windows: Windows,
    physical: PhysicalSet,
    *,
    loading: pin.Model,
    armature: bool,
    effects: bool,
) -> ChosenEffects:
    """Return the effects of the joints that the learning part of a log shows.

    Args:
        robot: as described; its friction has the initial coefficients.
        motion: of the whole log.
        period: typical time between its samples [s].
        windows: of the learning part, of the bodies alone.
        physical: the bodies, centred at the description.
        loading: a model of the chain, whose gravity torques load the gears.
        armature: whether rotor inertias are chosen.
        effects: whether all else is chosen: shapes of friction, loads, asymmetry, offsets, shafts.
    """
    bank = _Bank(robot, motion, Averages(motion.t, period), windows, physical, loading)
    candidates = [
        candidate
        for candidate in bank.candidates
        if (armature if candidate.unknown.endswith(".armature") else effects)
    ]
    model = _Model(bank, windows, physical)
    gains: list[Gain] = []
    chosen: list[_Candidate] = []
    rotors = [part for part in candidates if part.unknown.endswith(".armature")]
    if rotors and (gain := model.gain_of(rotors)).enough(_SURE, _LEAST):
        for part in rotors:  # together, as what one lacks looks like a shaft of two joints
            model.take(part)
        gains.append(gain._replace(words="rotor inertias of all joints"))
        chosen += rotors
    while len(chosen) < _MOST:
        best = model.best([part for part in candidates if part not in chosen])
        if best is None:
            break
        gain, candidate = best
        before, shape = model.squares, model.shapes[candidate.joint].copy()
        model.take(candidate)
        if candidate.shape is not None:  # its ratio is bounded, so it may gain less than promised
            found = model.gain_since(before)
            gain = gain._replace(share=found[0], deviation=found[1])
            if not gain.enough(_SURE, _LEAST):
                model.restore(candidate.joint, shape)
                candidates.remove(candidate)
                continue
        gains.append(gain)
        chosen.append(candidate)
    return _described(robot, model, chosen, gains, loading)


def _described(
    robot: Robot,
    model: _Model,
    chosen: Sequence[_Candidate],
    gains: Sequence[Gain],
    loading: pin.Model,
) -> ChosenEffects:
    """Return the chosen effects as friction and words."""
    friction = robot.friction
    threshold, breakaway, fading = model.shapes.T
    words: list[str] = []
    shafts = list(friction.shafts)
    for part in chosen:
        if part.shape is not None:
            continue
        if part.shaft is not None:
            shafts.append(part.shaft)
            name = part.shaft.name(robot.joint_names)
            words += [f"{name}.armature"]
        else:
            words.append(part.unknown)
    loaded = any(word.endswith(".load") for word in words)
    shaped = replace(
        friction,
        threshold=threshold,
        fading=fading,
        breakaway=breakaway,
        shafts=tuple(shafts),
        bodies=loading if loaded else friction.bodies,
    )
    return ChosenEffects(shaped, tuple(words), tuple(gains), loading)


class _Bank:
    """All columns, and the candidates that consist of them.

    Attributes:
        X: (K, n, P) columns.
        own: joint -> the columns of its dry friction before anything is chosen.
        first: number of columns of bodies, in coordinates in which the divergence is quadratic.
        candidates: what may be chosen.
    """

    def __init__(
        self,
        robot: Robot,
        motion: MeasuredMotion,
        averages: Averages,
        windows: Windows,
        physical: PhysicalSet,
        loading: pin.Model,
    ) -> None:
        names, n, v = robot.joint_names, robot.model.nv, motion.v
        whole = np.isin(averages.t, windows.t)
        T = physical.local(physical.center)[0]
        columns = _Columns(windows.W @ T)
        self.first = windows.W.shape[2]
        self.candidates: list[_Candidate] = []
        self.own: dict[int, tuple[int, ...]] = {}
        load = _loads(loading, motion, averages)[whole]
        self._v, self._whole, self._averages, self._load = v, whole, averages, load
        speed, rotor = averages.mean(v)[whole], averages.rate(v)[whole]
        for j in range(n):
            columns.add({j: speed[:, j]})  # viscous friction, always
        self.always, one = n, np.ones(len(windows.t))
        shape = robot.friction
        self.shapes = np.column_stack([shape.threshold, shape.breakaway, shape.fading])
        for j, name in enumerate(names):
            width = float(shape.threshold[j])
            sign, size = self._signs(j, *self.shapes[j])
            first = columns.add({j: sign})
            self.own[j] = (first,)
            for kind, values in (
                ("asymmetry", size),
                ("load", sign * load[:, j]),
                ("armature", rotor[:, j]),
                ("offset", one),
            ):
                index = columns.add({j: values})
                self.candidates.append(_Candidate(f"{name}.{kind}", (index,), j, f"{name}.{kind}"))
            unit, plain = "m/s" if robot.slides[name] else "rad/s", -1
            for w in dict.fromkeys((*_WIDTHS, width)):
                words = f"{name}: friction builds up within {w:g} {unit}"
                index = columns.add({j: self._signs(j, w, 1.0, 1.0)[0]})
                plain = index if w == width else plain
                self.candidates.append(_Candidate(words, (index,), j, shape=(w, 0.0)))
            for s in _FADINGS:
                words = f"{name}: other friction near rest, up to {s:g} {unit}"
                index = columns.add({j: self._signs(j, width, 0.0, s)[0]})
                pair = _Candidate(words, (plain, index), j, shape=(width, s))
                self.candidates.append(pair)
        for j in range(n - 1):
            if robot.slides[names[j]] != robot.slides[names[j + 1]]:
                continue
            for turn in (1, -1):
                shaft = Shaft((j, j + 1), turn, threshold=float(robot.friction.threshold[j]))
                u = v[:, j] + turn * v[:, j + 1]
                three = tuple(
                    columns.add({j: values, j + 1: turn * values})
                    for values in (
                        averages.rate(u)[whole],
                        averages.mean(u)[whole],
                        averages.mean(np.tanh(u / shaft.threshold))[whole],
                    )
                )
                words = f"a motor that turns with {shaft.name(names)}"
                self.candidates.append(_Candidate(words, three, j, shaft=shaft))
        self.X = columns.stacked()

    def _signs(
        self, j: int, threshold: float, breakaway: float, fading: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the averages (K) of the smoothed sign of a joint's velocity, and of its size."""
        return _signs_of(self._v[:, j], self._averages, self._whole, threshold, breakaway, fading)

    def reshape(self, j: int, threshold: float, breakaway: float, fading: float) -> None:
        """Give the dry friction of a joint another shape, and what has the same one."""
        self.shapes[j] = threshold, breakaway, fading
        sign, size = self._signs(j, threshold, breakaway, fading)
        (dry,) = self.own[j]  # then asymmetry and load
        self.X[:, j, dry : dry + 3] = np.column_stack([sign, size, sign * self._load[:, j]])


def _signs_of(
    v: np.ndarray,
    averages: Averages,
    whole: np.ndarray,
    threshold: float,
    breakaway: float,
    fading: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the averages (K) of the smoothed sign of a velocity (N), and of its size."""
    near = np.exp(-np.abs(v) / fading)
    sigma = np.tanh(v / threshold) * (1.0 + (breakaway - 1.0) * near)
    found = averages.mean(np.column_stack([sigma, np.abs(sigma)]))[whole]
    return found[:, 0], found[:, 1]


def _loads(loading: pin.Model, motion: MeasuredMotion, averages: Averages) -> np.ndarray:
    """Return |g| (K, n) at the middles of the windows."""
    data, last = loading.createData(), len(motion.t) - 1
    near = np.minimum(np.searchsorted(motion.t, averages.t), last)
    rows = [pin.computeGeneralizedGravity(loading, data, motion.q[k]) for k in near]
    return np.abs(np.array(rows).reshape(len(near), -1))


class _Model:
    """A least-squares model that grows, with its errors in cross-validation."""

    def __init__(self, bank: _Bank, windows: Windows, physical: PhysicalSet) -> None:
        self._bank, self._X = bank, bank.X
        self._y = windows.y - windows.W @ physical.center
        self._blocks = blocks_of(len(windows.t))
        self._index = [*range(bank.first + bank.always)]
        self._shapes = dict(bank.own)
        self._size()
        level = np.sqrt(np.mean(windows.tau**2, axis=0))
        self._floor = 1e-4 * np.maximum(level, 1e-12 * level.max())
        self._noise = np.maximum(level, self._floor)
        self._ridge = _RIDGES[1]
        self._renew()
        scores = []
        for ridge in _RIDGES:
            self._ridge = ridge
            scores.append(relative_loss(self._squares(), self._before).mean())
        self._ridge = _RIDGES[int(np.argmin(scores))]
        self._renew()

    def coefficients(self) -> np.ndarray:
        """Return the coefficients (P) of all columns from all blocks, zero of those not taken."""
        index, found = self._all(), np.zeros(self._X.shape[2])
        total = sum(self._H)
        assert isinstance(total, np.ndarray)
        found[index] = np.linalg.solve(
            total[np.ix_(index, index)] + self._prior(index), total[index, -1]
        )
        return found / self._sizes

    def _all(self, without: int = -1) -> list[int]:
        """Return the indices of the columns, without the dry friction of a joint."""
        shapes = [part for j, part in self._shapes.items() if j != without]
        return sorted({*self._index, *(i for part in shapes for i in part)})

    def take(self, candidate: _Candidate) -> None:
        """Take a candidate into the model."""
        joint, shape = candidate.joint, candidate.shape
        if shape is None:
            self._index += candidate.columns
        else:
            threshold, fading, breakaway = *shape, 1.0
            if fading:
                self._shapes[joint] = candidate.columns
                dry, other = self.coefficients()[list(candidate.columns)]
                ratio = dry / (dry + other) if dry + other > 0.0 else _BREAKAWAY
                breakaway = float(np.clip(ratio, 0.0, _BREAKAWAY))
            self._shapes[joint] = self._bank.own[joint]
            self._bank.reshape(joint, threshold, breakaway, fading or 1.0)
            self._size()
        self._renew()

    def restore(self, joint: int, shape: np.ndarray) -> None:
        """Give the dry friction of a joint the shape back that it had."""
        self._bank.reshape(joint, *shape.tolist())
        self._size()
        self._renew()

    @property
    def squares(self) -> np.ndarray:
        """Mean squares (B, n) of the residuals of each block, predicted from the others."""
        return self._before

    def gain_since(self, before: np.ndarray) -> tuple[float, float]:
        """Return how much the error fell since it had these mean squares, and its uncertainty."""
        gains = relative_loss(before, before) - relative_loss(self._before, before)
        return float(gains.mean()), float(gains.std(ddof=1) / np.sqrt(len(gains)))

    @property
    def shapes(self) -> np.ndarray:
        """Threshold, breakaway and fading of each joint (n, 3)."""
        return self._bank.shapes

    def _size(self) -> None:
        """Find the scales of all columns."""
        sizes = np.sqrt(np.einsum("kjp,kjp->p", self._X, self._X))
        self._sizes = np.where(sizes > 0.0, sizes, 1.0)

    def _renew(self) -> None:
        """Find the noise of each joint, and the sums of all blocks."""
        for _ in range(2):
            self._sum()
            x = self.coefficients()
            residual = self._y - self._X @ x
            noise = np.sqrt(np.mean(residual**2, axis=0))
            self._noise = np.maximum(noise, self._floor)
        self._sum()
        self._before = self._squares()

    def _sum(self) -> None:
        """Compute the weighted normal equations (P, P + 1) of each block."""
        self._H = []
        for block in self._blocks:
            A = (self._X[block] / self._sizes / self._noise[:, None]).reshape(-1, self._X.shape[2])
            b = (self._y[block] / self._noise).reshape(-1, 1)
            self._H.append(A.T @ np.hstack([A, b]))

    def _prior(self, index: Sequence[int]) -> np.ndarray:
        """Return the weight of the description (i, i) of some columns."""
        chosen = np.asarray(index)
        weight = np.where(chosen < self._bank.first, self._ridge, 0.0) / self._sizes[chosen] ** 2
        rows = sum(len(block) for block in self._blocks)
        return np.diag(weight + _JITTER * rows)

    def _squares(self) -> np.ndarray:
        """Return the mean squares (B, n) of the residuals of each block, predicted from others."""
        return self._extended(self._all(), [()])[0]

    def _extended(self, index: list[int], added: Sequence[tuple[int, ...]]) -> np.ndarray:
        """Return the mean squares (C, B, n) of a model with each of C sets of columns added."""
        total = sum(self._H)
        assert isinstance(total, np.ndarray)
        J = sorted({column for part in added for column in part})
        place = {column: k for k, column in enumerate(J)}
        sets = [[place[column] for column in part] for part in added]
        found = np.empty((len(added), len(self._blocks), self._y.shape[1]))
        prior, more = self._prior(index), self._prior(J) if J else np.zeros((0, 0))
        for b, (block, own) in enumerate(zip(self._blocks, self._H, strict=True)):
            H = total - own
            right = np.column_stack([H[np.ix_(index, J)], H[index, -1]])
            solved = _least_solution(H[np.ix_(index, index)] + prior, right)
            Z, x = solved[:, :-1], solved[:, -1]
            S = H[np.ix_(J, J)] + more - right[:, :-1].T @ Z
            s = H[J, -1] - right[:, :-1].T @ x
            X = self._X[block] / self._sizes
            own_columns = X[:, :, index]
            r = self._y[block] - own_columns @ x
            E = X[:, :, J] - own_columns @ Z
            for c, part in enumerate(sets):
                if not part:
                    found[c, b] = np.mean(r**2, axis=0)
                    continue
                beta = _least_solution(S[np.ix_(part, part)], s[part])
                found[c, b] = np.mean((r - E[:, :, part] @ beta) ** 2, axis=0)
        return found

    def gain_of(self, candidates: Sequence[_Candidate]) -> Gain:
        """Return what candidates that are no shapes gain together."""
        columns = tuple(column for part in candidates for column in part.columns)
        squares = self._extended(self._all(), [columns])[0]
        gains = relative_loss(self._before, self._before) - relative_loss(squares, self._before)
        return Gain("", float(gains.mean()), float(gains.std(ddof=1) / np.sqrt(len(gains))))

    def best(self, candidates: Sequence[_Candidate]) -> tuple[Gain, _Candidate] | None:
        """Return the candidate that gains most, or None where none gains enough."""
        now = relative_loss(self._before, self._before)
        found: tuple[Gain, _Candidate] | None = None
        adding = [part for part in candidates if part.shape is None]
        groups = [(self._all(), adding)] if adding else []
        for joint in self._shapes:
            shapes = [part for part in candidates if part.shape is not None and part.joint == joint]
            if shapes:
                groups.append((self._all(without=joint), shapes))
        for index, parts in groups:
            squares = self._extended(index, [part.columns for part in parts])
            gains = now - relative_loss(squares, self._before)
            for part, gain in zip(parts, gains, strict=True):
                error = float(gain.std(ddof=1) / np.sqrt(len(gain)))
                one = Gain(part.words, float(gain.mean()), error)
                shaft = part.shaft is not None
                enough = one.enough(*((_SHAFT_SURE, _SHAFT_LEAST) if shaft else (_SURE, _LEAST)))
                if enough and (found is None or one.share > found[0].share):
                    found = one, part
        return found


def _least_solution(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the x of A x = b, the least one where a short motion leaves it undetermined."""
    try:
        return np.linalg.solve(A, b)
    except np.linalg.LinAlgError:
        return np.linalg.lstsq(A, b)[0]


def friction_spread(
    robot: Robot,
    motion: MeasuredMotion,
    period: float,
    windows: Windows,
    physical: PhysicalSet,
    found: Information,
    gamma: float,
    loading: pin.Model,
) -> np.ndarray:
    """Return by how much estimates differ (m, p) with other friction, one joint at a time.

    Each joint is given its viscous and Coulomb friction alone, all effects together, both with
    friction that builds up within the chosen speed, a short and a long one, and other friction near
    rest that fades over a short and a long speed. What a log shows of these is not certain, and
    coefficients depend on it. Least squares take the bodies near the estimate by the same
    divergence. A row is divided by the root of one plus what its friction adds to the squared error
    of the joints, in units of that of one joint.

    Args:
        robot: with the chosen friction.
        motion: of the whole log.
        period: typical time between its samples [s].
        windows: of all parameters, from which they were estimated.
        physical: the set of the parameters.
        found: their estimate.
        gamma: weight of the description.
        loading: a model of the chain, whose gravity torques load the gears.
    """
    averages = Averages(motion.t, period)
    whole, first = np.isin(averages.t, windows.t), PER_BODY * physical.bodies
    load, rotor = _loads(loading, motion, averages)[whole], averages.rate(motion.v)[whole]
    columns, shape, one = _Columns(windows.W), robot.friction, np.ones(len(windows.t))
    others: list[list[dict[str, int]]] = []  # joint -> for each speed, the columns of all kinds
    for j in range(robot.model.nv):
        own = shape.threshold[j], shape.breakaway[j], shape.fading[j]
        same = {"offset": columns.add({j: one}), "armature": columns.add({j: rotor[:, j]})}
        others.append([])
        for way in (own, *((width, 1.0, 1.0) for width in _OTHER_WIDTHS)):
            sign, size = _signs_of(motion.v[:, j], averages, whole, *way)
            parts = {"coulomb": sign, "asymmetry": size, "load": sign * load[:, j]}
            others[j].append(same | {kind: columns.add({j: parts[kind]}) for kind in parts})
        for fading in _OTHER_FADINGS:
            near = _signs_of(motion.v[:, j], averages, whole, own[0], 0.0, fading)[0]
            others[j][0][f"near {fading:g}"] = columns.add({j: near})
    X, a = columns.stacked(), found.estimate
    level = np.sqrt(np.mean(windows.tau**2, axis=0))
    residual = np.sqrt(np.mean(windows.residual(a) ** 2, axis=0))
    noise = np.maximum(residual, 1e-4 * np.maximum(level, 1e-12 * level.max()))
    whitened = (X / noise[:, None]).reshape(-1, X.shape[2])
    sizes, acts = np.linalg.norm(whitened, axis=0), np.argmax(np.abs(X).sum(axis=0), axis=0)
    rows = root_of(np.column_stack([whitened, (windows.residual(a) / noise).ravel()]))
    R, z = rows[:, :-1], rows[:, -1]
    small = sizes * noise[acts] / np.maximum(level[acts], 1e-300) / np.sqrt(len(one))
    prior = np.diag(small)  # a coefficient that explains all torque is one deviation
    prior[:first, :first] = np.sqrt(gamma) * np.linalg.inv(physical.local(a)[0][:first, :first])

    def solved(index: list[int]) -> tuple[np.ndarray, float]:
        """Return the steps (P) from the estimate with some columns, and their squared error."""
        start = np.zeros(X.shape[2])
        start[first : a.size] = a[first:]
        target = z + R[:, : a.size] @ start[: a.size]
        A = np.vstack([R[:, index], prior[np.ix_(index, index)]])
        b = np.concatenate([target, np.zeros(len(index))])
        steps = np.zeros(X.shape[2])
        steps[index] = np.linalg.lstsq(A, b, rcond=None)[0]
        return steps, float(np.sum((R[:, index] @ steps[index] - target) ** 2))

    chosen, least = solved(list(range(a.size)))
    names = {name: k for k, name in enumerate(found.names)}
    spread = []
    for joint, ways in zip(robot.joint_names, others, strict=True):
        if f"{joint}.coulomb" not in names:
            continue
        known = {kind: names.get(f"{joint}.{kind}") for kind in ways[-1]}
        rest = [k for k in range(a.size) if k not in known.values()]
        for columns_of in ways:
            faded = [kind for kind in columns_of if kind not in known]
            every = [kind for kind in columns_of if kind in known]
            for kinds in (["coulomb"], every, *([*every, kind] for kind in faded)):
                steps, error = solved(rest + [columns_of[kind] for kind in kinds])
                for kind in kinds:
                    if (k := known.get(kind)) is not None:
                        steps[k] = steps[columns_of[kind]]
                gone = [k for kind, k in known.items() if k is not None and kind not in kinds]
                steps[gone] = chosen[gone]
                more = max(error - least, 0.0) / len(one)
                spread.append((steps - chosen)[: a.size] / np.sqrt(1.0 + more))
    return np.array(spread).reshape(-1, a.size)


class ChosenWeight(NamedTuple):
    """The weight of the description.

    Attributes:
        gamma: chosen.
        gammas: (G) that were compared, descending.
        evidences: (G) the logarithm of each one's evidence, less the largest.
    """

    gamma: float
    gammas: tuple[float, ...]
    evidences: np.ndarray


def choose_weight(physical: PhysicalSet, windows: Windows) -> ChosenWeight:
    """Return the weight of the description in ``torque_fit`` for windows.

    By Laplace's method, in coordinates u in which D is |u|^2 / 2 around the estimate (p), the
    logarithm of the evidence of rows A and b in units of their noise is

        -|A a - b|^2 / 2 - gamma D(a) - log det(1 + T^T A^T A T / gamma) / 2,    da = T du.
    """
    physical, noise = weighted(physical, windows), noise_of(physical, windows, GAMMAS[-1])
    A = windows.W / noise[:, None]
    both = np.concatenate([A, (windows.y / noise)[:, :, None]], axis=2)
    rows = root_of(both.reshape(-1, both.shape[2]))
    R, z, found = rows[:, :-1], rows[:, -1], np.empty(len(GAMMAS))
    for g, a in enumerate(physical_path(R, z, physical, GAMMAS)):
        stiffness = np.linalg.svd(R @ physical.local(a)[0], compute_uv=False) ** 2
        told = np.log1p(stiffness / GAMMAS[g]).sum()
        misfit = np.sum((R @ a - z) ** 2)
        found[g] = -0.5 * misfit - GAMMAS[g] * physical.divergence(a) - 0.5 * told
    found -= found.max()
    return ChosenWeight(GAMMAS[int(np.flatnonzero(found > -_UNDECIDED)[-1])], GAMMAS, found)
