"""Unknown lengths and inertias together: lumped parameters in which the torque is linear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin

from .._kernels import models as kernels
from ..exceptions import ParameterError
from ..robot.robot import Robot
from .bodies import ALL, InertialDynamics, InertialModel, chosen_bodies
from .regressor import LABELS, PER_BODY, Regressor
from .translations import LENGTHS, PlacedTranslations, Translation, unknown_translations

_DEPENDENT = 1e-8  # relative rest of a dependent column; it is below 1e-12, others' above 1e-4
_DEAD = 1e-12  # relative size of columns that are zero but for rounding
_UNEVENTFUL = 2  # random nodes in a row that must bring nothing new


@dataclass(frozen=True, eq=False)
class LumpedBasis:
    """The base found for one chain and one choice of unknown lengths.

    Attributes:
        models: one virtual chain a node; its inertias do not matter, it has no rotors.
        columns: for each node, which of the 10 n columns of its regressor belong to the base.
        states: (q, v, a) at which the base was found.
    """

    models: tuple[pin.Model, ...]
    columns: tuple[np.ndarray, ...]
    states: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]
    _Q: np.ndarray
    _R: np.ndarray

    @property
    def size(self) -> int:
        """Number of lumped parameters."""
        return sum(len(columns) for columns in self.columns)

    @property
    def weights(self) -> np.ndarray:
        """Size (p) of each parameter's column over the states: it makes parameters comparable."""
        return np.asarray(np.linalg.norm(self._R, axis=0))

    def fit(self, model: pin.Model, *, tolerance: float = 1e-8) -> np.ndarray | None:
        """Return the lumped vector of a model without rotors, or None if it has none.

        Args:
            model: any chain with these joints.
            tolerance: relative residual of the torque up to which a match counts as exact.
        """
        from scipy.linalg import solve_triangular

        rotorless = model.copy()
        rotorless.armature = np.zeros(model.nv)
        data = rotorless.createData()
        tau = np.concatenate([pin.rnea(rotorless, data, *state) for state in self.states])
        components = self._Q.T @ tau
        residual = np.linalg.norm(tau - self._Q @ components)
        return (
            np.asarray(solve_triangular(self._R, components))
            if residual <= tolerance * np.linalg.norm(tau)
            else None
        )


def lumped_basis(model: pin.Model, translations: Sequence[Translation]) -> LumpedBasis:
    """Return the base of a chain's dynamics for unknown translations; found once a process."""
    bare = model.copy()
    bare.armature, bare.name = np.zeros(model.nv), ""
    for joint in range(1, model.njoints):
        bare.inertias[joint] = pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3)))
    parts = tuple(
        (part.joint or 0, tuple(map(tuple, part.directions.tolist())), tuple(part.offset.tolist()))
        for part in translations
    )
    placed = PlacedTranslations(bare, 0, translations)
    placed.write(np.zeros(placed.size))
    return _find(bare.saveToString(), parts)


_Part = tuple[int, tuple[tuple[float, ...], ...], tuple[float, ...]]  # joint, directions, offset


@lru_cache(maxsize=32)
def _find(description: str, parts: tuple[_Part, ...]) -> LumpedBasis:
    """Take random nodes, and of each the columns that the nodes before do not span.

    The search ends when further nodes bring nothing: a node drawn at random lies in the span only
    if, but for a set of measure zero, all do.
    """
    model, rng = pin.Model(), np.random.default_rng(0)
    model.loadFromString(description)
    states = _random_states(model, rng)
    translations = [
        Translation("", joint, np.array(directions), np.array(offset), ())
        for joint, directions, offset in parts
    ]
    models, kept, Y_kept, Q = [], [], [], np.zeros((len(states) * model.nv, 0))
    uneventful = 0
    while uneventful < _UNEVENTFUL:
        node = model.copy()
        placed = PlacedTranslations(node, 0, translations)
        placed.write(rng.uniform(-1.0, 1.0, placed.size))
        regressor = Regressor(node)
        Y = np.vstack([regressor(*state) for state in states])
        columns, directions = _independent(Y, Q)
        if not len(columns):
            uneventful += 1
            continue
        uneventful, Q = 0, np.hstack([Q, directions])
        models.append(node)
        kept.append(columns)
        Y_kept.append(Y[:, columns])
    return LumpedBasis(tuple(models), tuple(kept), states, *np.linalg.qr(np.hstack(Y_kept)))


def _independent(Y: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns of Y independent of Q and each other, and what they add to Q."""
    from scipy.linalg import qr  # here, because scipy is slow to import

    norms = np.linalg.norm(Y, axis=0)
    alive = np.flatnonzero(norms > _DEAD * norms.max())
    rest = Y[:, alive] / norms[alive]
    for _ in range(2):  # the second time removes what rounding left
        rest = rest - Q @ (Q.T @ rest)
    directions, R, order = qr(rest, mode="economic", pivoting=True)
    rank = int(np.count_nonzero(np.abs(np.diag(R)) > _DEPENDENT))
    chosen = np.argsort(alive[order[:rank]])
    return alive[order[:rank]][chosen], directions[:, :rank]


def _random_states(
    model: pin.Model, rng: np.random.Generator
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]:
    """Return more than enough (q, v, a) for the largest base that a chain of n joints can have."""
    n, neutral = model.nv, pin.neutral(model)
    return tuple(
        (pin.integrate(model, neutral, rng.uniform(-2.0, 2.0, n)), *rng.standard_normal((2, n)))
        for _ in range(40 + 10 * n)
    )


class LumpedRegressor(Regressor):
    """Y (n, p) of the lumped vector, side by side the base columns of every virtual chain."""

    def __init__(self, found: LumpedBasis) -> None:
        """Prepare one regressor a node."""
        self._found = found
        self._parts = [
            (Regressor(model), slice(int(first), int(last)), columns.astype(np.int64))
            for model, (first, last), columns in zip(
                found.models,
                pairwise(np.cumsum([0, *map(len, found.columns)])),
                found.columns,
                strict=True,
            )
        ]
        self._shape = (found.models[0].nv, found.size)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by what it was made from: Pinocchio's data is scratch."""
        return LumpedRegressor, (self._found,)

    def __call__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y(q, v, a) (n, p)."""
        Y = np.empty(self._shape)
        for regressor, window, columns in self._parts:
            kernels.take_columns(regressor(q, v, a), columns, Y[:, window])
        return Y

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> np.ndarray:
        """Return Y(q, v, v_r, a_r) (n, p)."""
        Y = np.empty(self._shape)
        for regressor, window, columns in self._parts:
            kernels.take_columns(regressor.slotine_li(q, v, v_r, a_r), columns, Y[:, window])
        return Y

    def slotine_li_torque(
        self, pi: np.ndarray, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Y (n, p) as ``slotine_li``, and the torque Y pi (n) at a lumped vector pi (p)."""
        Y = self.slotine_li(q, v, v_r, a_r)
        return Y, Y.dot(pi)

    def momentum(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_M and Y_0 (n, p): M a + C v + g = d/dt (Y_M a) + Y_0 a, a the lumped vector."""
        Y_M, Y_0 = np.empty(self._shape), np.empty(self._shape)
        for regressor, window, columns in self._parts:
            for own, Y in zip(regressor.momentum(q, v), (Y_M, Y_0), strict=True):
                kernels.take_columns(own, columns, Y[:, window])
        return Y_M, Y_0


class LumpedModel(InertialModel):
    """Torque and mass matrix of the virtual chains together, rotors of the real chain included."""

    def __init__(
        self, found: LumpedBasis, regressor: LumpedRegressor, armature: np.ndarray
    ) -> None:
        """Prepare one model a node."""
        self._found = found
        self._regressor, self._armature, self._rotors = regressor, armature, np.diag(armature)
        self._nodes = [InertialModel(model) for model in found.models]
        self._pi = np.zeros((len(found.models), PER_BODY * found.models[0].nv))
        counts = [len(columns) for columns in found.columns]
        self._where = np.repeat(np.arange(len(counts)), counts) * self._pi.shape[
            1
        ] + np.concatenate(found.columns)
        self._a, self._loaded = np.full(found.size, np.nan), False

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by what it was made from: Pinocchio's data is scratch."""
        return LumpedModel, (self._found, self._regressor, self._armature)

    def load(self, pi: np.ndarray) -> None:
        """Set the lumped vector (p)."""
        self._loaded = self._loaded and np.array_equal(pi, self._a)
        self._a = pi.copy()

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N], by the regressor, which is the quickest way."""
        return self._regressor(q, v, a).dot(self._a) + self._armature * a

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), the sum of the virtual chains' by CRBA."""
        if not self._loaded:  # not every law asks for it
            self._pi.put(self._where, self._a)
            for node, pi in zip(self._nodes, self._pi, strict=True):
                node.load(pi)
            self._loaded = True
        M = self._rotors.copy()
        for node in self._nodes:
            M += node.mass_matrix(q)
        return M


_NEGLIGIBLE = 1e-8  # relative size of what is left of a dependent entry


class LumpedDynamics(InertialDynamics):
    """Products of lengths and inertial parameters in which the torque of any chain is linear.

    Lengths multiply inertias, so where lengths are unknown the ten parameters a body are too few:
    their regressor contains the lengths. The torque of a chain is a polynomial of degree two in its
    lengths; its coefficients, regrouped to a base, are parameters of a regressor that contains none
    (see ``superposition``). Bodies whose inertias are known still contribute products of known
    inertias and unknown lengths; with ``unknown`` bodies chosen, the parameters are the smallest
    set of entries that determines the whole lumped vector, which is affine in them.

    The generalisation of a_2 = m_2 l_1 l_c2 of Wang and Xie (2009), section 5.

    Attributes:
        translations: the unknown joint translations; a tool's has no part in the dynamics.
    """

    def __init__(
        self,
        robot: Robot,
        lengths: str | Sequence[str | Translation] = LENGTHS,
        unknown: str | Sequence[str] = ALL,
    ) -> None:
        """Take a believed robot, unknown translations as ``FrameKinematics`` does, and bodies.

        Raises:
            ParameterError: no joint's translation among the unknown.
            RobotError: unknown joint.
        """
        super().__init__(robot)
        self.translations = [
            part for part in unknown_translations(robot, lengths) if part.joint is not None
        ]
        if not self.translations:
            raise ParameterError(
                "no joint's translation is unknown, so nothing has to be lumped.",
                where="unknown.kinematic",
                hint="Use BodyDynamics.",
            )
        self._found = lumped_basis(robot.model, self.translations)
        self._regressor = LumpedRegressor(self._found)
        self._believed = LumpedModel(self._found, self._regressor, self._armature)
        names = [
            f"{robot.joint_names[column // PER_BODY]}.{LABELS[column % PER_BODY]}#{node}"
            for node, columns in enumerate(self._found.columns, 1)
            for column in columns
        ]
        whole = self._found.fit(robot.model)
        if whole is None:
            raise ParameterError(
                "the directions and offsets do not contain the believed robot's own placements."
            )
        self._B, self._rest, rows = None, np.zeros(len(whole)), np.arange(len(whole))
        self.bodies = chosen_bodies(robot, unknown)
        if len(self.bodies) < robot.model.nv:
            self._B, self._rest, rows = _affine_hull(
                self._possible(robot, whole), self._found.weights
            )
        self._rows = rows
        self.names = tuple(names[row] for row in rows)
        self.size, self.initial = len(rows), whole[rows].copy()
        self.load(self.initial)

    def expand(self, a_d: np.ndarray) -> np.ndarray:
        """Return the whole lumped vector at a_d (p)."""
        return a_d if self._B is None else self._B.dot(a_d) + self._rest

    def reduce(self, Y: np.ndarray) -> np.ndarray:
        """Return the regressor (n, p) from that of the whole lumped vector."""
        return Y if self._B is None else Y.dot(self._B)

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the lumped vector (p) of a robot; None when more than lengths, inertias differ."""
        whole = self._found.fit(robot.model) if self.shares_the_rest(robot) else None
        if whole is None:
            return None
        a_d, weights = whole[self._rows], self._found.weights
        missed = (self.expand(a_d) - whole) * weights
        return (
            a_d if np.linalg.norm(missed) <= _NEGLIGIBLE * np.linalg.norm(whole * weights) else None
        )

    def _possible(self, robot: Robot, whole: np.ndarray) -> np.ndarray:
        """Return lumped vectors (N, p) at random lengths and inertias, the believed one first."""
        rng, model = np.random.default_rng(1), robot.model.copy()
        placed = PlacedTranslations(model, robot.frame_id, self.translations)
        samples = [whole]
        for _ in range(len(whole) + 20):
            placed.write(rng.uniform(-1.0, 1.0, placed.size))
            for body in self.bodies:
                model.inertias[body + 1] = _random_inertia(rng)
            sample = self._found.fit(model)
            assert sample is not None
            samples.append(sample)
        return np.array(samples)


def _random_inertia(rng: np.random.Generator) -> pin.Inertia:
    ten = rng.standard_normal(PER_BODY)
    ten[0] = 1.0 + abs(ten[0])
    return pin.Inertia.FromDynamicParameters(ten)


def _affine_hull(
    samples: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return B (P, p), b (P), rows (p): sample = B sample[rows] + b of all samples (N, P).

    p is the least possible. The weights (P) make the entries comparable, so that rounding can be
    told from change.
    """
    from scipy.linalg import qr  # here, because scipy is slow to import

    changes = (samples[1:] - samples[0]) * weights
    _, R, order = qr(changes, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(R))
    rank = int(np.count_nonzero(sizes > _NEGLIGIBLE * sizes.max(initial=0.0)))
    rows = np.sort(order[:rank])
    B = np.linalg.lstsq(changes[:, rows], changes, rcond=None)[0].T
    B[rows] = np.eye(rank)
    B *= weights[rows] / weights[:, None]
    return B, samples[0] - B @ samples[0][rows], rows
