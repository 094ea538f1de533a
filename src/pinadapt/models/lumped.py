"""Unknown lengths and inertias together: lumped parameters in which the torque is linear.

Lengths multiply inertias, so that with unknown lengths the regressor of ten parameters per body
depends on the lengths. But the torque of a chain is a polynomial of degree two in its lengths, and
by superposition of chains with fixed random lengths (here: virtual chains, or nodes) it is linear
in lumped parameters whose regressor contains no unknown lengths. ``lumped_basis`` finds a base of
these parameters, ``LumpedRegressor`` and ``LumpedModel`` evaluate it, and ``LumpedDynamics`` is the
choice of unknowns for a controller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ..exceptions import ParameterError
from ..robot.robot import Robot
from .bodies import InertialDynamics, InertialModel
from .regressor import LABELS, PER_BODY, Regressor
from .translations import LENGTHS, PlacedTranslations, Translation, unknown_translations

_DEPENDENT = 1e-8  # relative residual of dependent columns: below 1e-12; of others: above 1e-4
_ZERO = 1e-12  # relative size of columns that are zero up to rounding
_REPEATS = 2  # random nodes in a row that must add no column before the search ends


@dataclass(frozen=True, eq=False)
class LumpedBasis:
    """The base of lumped parameters of one chain and one choice of unknown lengths.

    Attributes:
        models: one virtual chain a node, without rotors; its inertias are not used.
        columns: for each node, the columns of its regressor (n, 10 n) that belong to the base.
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

    def fit(self, model: pin.Model, *, tolerance: float = 1e-8) -> np.ndarray | None:
        """Return the lumped vector (p) of a model without rotors; None if it has none.

        Args:
            model: any chain with these joints.
            tolerance: relative residual of the torque below which a fit counts as exact.
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
    """Return the base of a chain's dynamics for unknown translations.

    Of each random node it has the columns outside the span of the nodes before. The search ends
    when further nodes add no column: a random node lies in the span with probability one only if
    all nodes do.
    """
    rng = np.random.default_rng(0)
    states = _random_states(model, rng)
    models, kept, Y_kept, Q = [], [], [], np.zeros((len(states) * model.nv, 0))
    without_news = 0
    while without_news < _REPEATS:
        node = model.copy()
        node.armature = np.zeros(model.nv)
        placed = PlacedTranslations(node, 0, translations)
        placed.write(rng.uniform(-1.0, 1.0, placed.size))
        regressor = Regressor(node)
        Y = np.vstack([regressor(*state) for state in states])
        columns, directions = _independent(Y, Q)
        if not len(columns):
            without_news += 1
            continue
        without_news, Q = 0, np.hstack([Q, directions])
        models.append(node)
        kept.append(columns)
        Y_kept.append(Y[:, columns])
    return LumpedBasis(tuple(models), tuple(kept), states, *np.linalg.qr(np.hstack(Y_kept)))


def _independent(Y: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns of Y independent of Q and of each other, and their directions."""
    from scipy.linalg import qr  # here, because scipy is slow to import

    norms = np.linalg.norm(Y, axis=0)
    nonzero = np.flatnonzero(norms > _ZERO * norms.max())
    rest = Y[:, nonzero] / norms[nonzero]
    for _ in range(2):  # the second pass removes rounding
        rest = rest - Q @ (Q.T @ rest)
    directions, R, order = qr(rest, mode="economic", pivoting=True)
    rank = int(np.count_nonzero(np.abs(np.diag(R)) > _DEPENDENT))
    chosen = np.argsort(nonzero[order[:rank]])
    return nonzero[order[:rank]][chosen], directions[:, :rank]


def _random_states(
    model: pin.Model, rng: np.random.Generator
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]:
    """Return enough states (q, v, a) for the largest base of a chain of n joints."""
    n, neutral = model.nv, pin.neutral(model)
    return tuple(
        (pin.integrate(model, neutral, rng.uniform(-2.0, 2.0, n)), *rng.standard_normal((2, n)))
        for _ in range(40 + 10 * n)
    )


class LumpedRegressor(Regressor):
    """Y (n, p) of the lumped vector: the base columns of all virtual chains side by side."""

    def __init__(self, found: LumpedBasis) -> None:
        """Make one regressor a node."""
        self._found, self._parts = found, [Regressor(model) for model in found.models]

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return LumpedRegressor, (self._found,)

    def _side_by_side(self, found: Sequence[np.ndarray]) -> np.ndarray:
        """Return the base columns (n, p) of the regressors (n, 10 n) of all chains."""
        pairs = zip(found, self._found.columns, strict=True)
        return np.concatenate([Y[:, columns] for Y, columns in pairs], axis=1)

    def __call__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y(q, v, a) (n, p)."""
        return self._side_by_side([part(q, v, a) for part in self._parts])

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> np.ndarray:
        """Return Y(q, v, v_r, a_r) (n, p)."""
        return self._side_by_side([part.slotine_li(q, v, v_r, a_r) for part in self._parts])

    def slotine_li_torque(
        self, pi: np.ndarray, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Y (n, p) as ``slotine_li``, and the torque Y pi (n) at a lumped vector pi (p)."""
        Y = self.slotine_li(q, v, v_r, a_r)
        return Y, Y.dot(pi)

    def momentum(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_M and Y_0 (n, p): M a + C v + g = d/dt (Y_M a) + Y_0 a, a the lumped vector."""
        Y_M, Y_0 = zip(*(part.momentum(q, v) for part in self._parts), strict=True)
        return self._side_by_side(Y_M), self._side_by_side(Y_0)


class LumpedModel(InertialModel):
    """Torque and mass matrix: the sum over the virtual chains, plus the rotors of the real one."""

    def __init__(
        self, found: LumpedBasis, regressor: LumpedRegressor, armature: np.ndarray
    ) -> None:
        """Make one model a node."""
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
        """Copy by the arguments: Pinocchio's data is scratch."""
        return LumpedModel, (self._found, self._regressor, self._armature)

    def load(self, pi: np.ndarray) -> None:
        """Set the lumped vector (p)."""
        self._loaded = self._loaded and np.array_equal(pi, self._a)
        self._a = pi.copy()

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N], by the regressor, the fastest way."""
        return self._regressor(q, v, a).dot(self._a) + self._armature * a

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), the sum of the virtual chains' mass matrices by CRBA."""
        if not self._loaded:  # written only now, since not every law uses M
            self._pi.put(self._where, self._a)
            for node, pi in zip(self._nodes, self._pi, strict=True):
                node.load(pi)
            self._loaded = True
        M = self._rotors.copy()
        for node in self._nodes:
            M += node.mass_matrix(q)
        return M


class LumpedDynamics(InertialDynamics):
    """Dynamics in products of lengths and inertial parameters, for unknown lengths of any chain.

    The parameters generalise a_2 = m_2 l_1 l_c2 of Wang and Xie (2009), section 5. The inertias of
    all bodies are unknown.

    Attributes:
        translations: the unknown joint translations; the tool's has no effect on the dynamics.
    """

    complete = True

    def __init__(self, robot: Robot, lengths: str | Sequence[str | Translation] = LENGTHS) -> None:
        """Choose the unknown translations of a nominal robot, as ``unknown_translations``.

        Raises:
            ParameterError: no joint translation is unknown, or their directions and offsets exclude
                the nominal robot.
            RobotError: unknown joint.
        """
        super().__init__(robot)
        self.translations = [
            part for part in unknown_translations(robot, lengths) if part.joint is not None
        ]
        if not self.translations:
            raise ParameterError(
                "no joint translation is unknown, so nothing has to be lumped.",
                where="unknown.translations",
                hint="Use BodyDynamics.",
            )
        self._found = lumped_basis(robot.model, self.translations)
        self._regressor = LumpedRegressor(self._found)
        self._model = LumpedModel(self._found, self._regressor, self._armature)
        self.names = tuple(
            f"{robot.joint_names[column // PER_BODY]}.{LABELS[column % PER_BODY]}#{node}"
            for node, columns in enumerate(self._found.columns, 1)
            for column in columns
        )
        initial = self._found.fit(robot.model)
        if initial is None:
            raise ParameterError(
                "the directions and offsets do not contain the placements of the nominal robot.",
                where="unknown.translations",
                hint="Use an offset on the line or plane of the nominal translation.",
            )
        self.bodies, self.size, self.initial = range(robot.model.nv), len(initial), initial
        self.load(initial)

    def expand(self, a_d: np.ndarray) -> np.ndarray:
        """Return the lumped vector a_d (p)."""
        return a_d

    def reduce(self, Y: np.ndarray) -> np.ndarray:
        """Return the regressor (n, p) of the lumped vector."""
        return Y

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of a robot; None if more than lengths and inertias differ."""
        robot = robot.in_base_axes
        return self._found.fit(robot.model) if self.differs_only_in_bodies(robot) else None
