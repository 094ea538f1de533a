"""A chain whose lengths are unknown as the sum of virtual chains whose lengths are known.

The ten-per-body regressor is a polynomial Y(theta) of degree two in the unknown lengths theta. The
columns that it has at all theta together span a space of finite dimension; columns of a few
``nodes`` theta_k are a base of it. Hence a chain of any lengths and inertias moves as the sum of
virtual chains of the same joints with the lengths theta_k, each with some of its inertial
parameters at work: tau = sum_k Y(theta_k)[:, columns_k] a_k. The stack a of the a_k is the lumped
vector. Neither nodes nor columns depend on the true or believed lengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin

from .._kernels import models as kernels
from .inertial_model import InertialModel
from .regressor import PER_BODY, Regressor
from .translations import PlacedTranslations, Translation

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
