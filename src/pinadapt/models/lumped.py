"""Unknown lengths and inertias together: lumped parameters in which the torque is linear."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from ..exceptions import ParameterError
from ..robot.robot import Robot
from .bodies import ALL, chosen_bodies
from .inertial import InertialDynamics
from .lumped_basis import LumpedModel, LumpedRegressor, lumped_basis
from .regressor import LABELS, PER_BODY
from .translations import LENGTHS, PlacedTranslations, Translation, unknown_translations

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

    lumped = True

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
