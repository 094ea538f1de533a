"""Unknown lengths and inertias together: lumped parameters in which the torque is linear.

Lengths multiply inertias, so that with unknown lengths the regressor of ten parameters per body
depends on the lengths. But the torque of a chain is a polynomial of degree two in its lengths, and
by superposition of chains with fixed random lengths (here: virtual chains, or nodes) it is linear
in lumped parameters whose regressor contains no unknown lengths. ``lumped_base`` finds a base of
these parameters, ``LumpedDynamics`` is the choice of unknowns for a controller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pinocchio as pin

from .._checks import instance
from ..exceptions import ParameterError, RobotError
from ..robot.robot import Robot
from .basis import TorqueFit, independent_columns
from .bodies import InertialDynamics
from .dynamics import Dynamics
from .regressor import LABELS, PER_BODY, Momentum, Regressor, random_states
from .translations import LENGTHS, Translation, place, unknown_translations


def lumped_base(
    robot: Robot, translations: Sequence[Translation]
) -> tuple[list[pin.Model], list[np.ndarray], TorqueFit]:
    """Return the base of a chain's dynamics for unknown translations.

    Of each random node it has the columns outside the span of the nodes before. The search ends
    when two further nodes add no column: a random node lies in the span with probability one only
    if all nodes do.

    Returns:
        One virtual chain a node, without rotors; the columns of each node's regressor (n, 10 n)
        that belong to the base; and the parameters of any chain with these joints.
    """
    model, rng = robot.model, np.random.default_rng(0)
    states = random_states(model, 40 + 10 * model.nv)
    models, columns, base = [], [], np.zeros((len(states) * model.nv, 0))
    without_news, size = 0, sum(part.size for part in translations)
    while without_news < 2:
        node = model.copy()
        node.armature = np.zeros(model.nv)
        place(node, 0, translations, rng.uniform(-1.0, 1.0, size))
        regressor = Regressor(node)
        both = np.hstack([base, np.vstack([regressor(*state) for state in states])])
        chosen, _ = independent_columns(both)
        own = chosen[base.shape[1] :] - base.shape[1]
        without_news = 0 if own.size else without_news + 1
        if own.size:
            models.append(node)
            columns.append(own)
            base = both[:, chosen]
    return models, columns, TorqueFit(states, base, np.array(model.armature))


class LumpedDynamics(Dynamics):
    """Dynamics in products of lengths and inertial parameters, for unknown lengths of any chain.

    The parameters generalise a_2 = m_2 l_1 l_c2 of Wang and Xie (2009), section 5. The inertias of
    all bodies are unknown. Torque, mass matrix and regressor are those of the virtual chains
    together.

    Attributes:
        translations: the unknown joint translations; the tool's has no effect on the dynamics.
    """

    def __init__(self, robot: Robot, lengths: str | Sequence[str | Translation] = LENGTHS) -> None:
        """Choose the unknown translations of a nominal robot, as ``unknown_translations``.

        Raises:
            ParameterError: no joint translation is unknown.
            RobotError: unknown joint.
        """
        instance(robot, Robot, "robot", RobotError)
        parts = unknown_translations(robot, lengths)
        self.translations = [part for part in parts if part.joint is not None]
        if not self.translations:
            raise ParameterError(
                "no joint translation is unknown, so nothing has to be lumped.",
                where="unknown.translations",
                hint="Use BodyDynamics.",
            )
        models, columns, self._fit = lumped_base(robot, self.translations)
        models[0].armature = self._armature = np.array(robot.model.armature)
        initial = self._fit.parameters(robot)
        assert initial is not None  # the nominal translations are along their directions
        identity = np.eye(PER_BODY * robot.model.nv)
        self._chains = [
            InertialDynamics(replace(robot, model=model), identity[:, own])
            for model, own in zip(models, columns, strict=True)
        ]
        ends = np.cumsum([0, *(len(own) for own in columns)]).tolist()
        self._windows = [slice(first, last) for first, last in pairwise(ends)]
        self.names = tuple(
            f"{robot.joint_names[column // PER_BODY]}.{LABELS[column % PER_BODY]}#{node}"
            for node, own in enumerate(columns, 1)
            for column in own
        )
        self.bodies, self.size, self.initial = range(robot.model.nv), len(initial), initial
        self.load(initial)

    def load(self, a_d: np.ndarray) -> None:
        """Make a_d (p) the estimate, each virtual chain with its part."""
        self._a_d = a_d
        for chain, window in zip(self._chains, self._windows, strict=True):
            chain.load(a_d[window])

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N], by the regressor, the fastest way."""
        return self.regressor(q, v, a).dot(self._a_d) + self._armature * a

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), rotors included."""
        return np.asarray(sum(chain.mass_matrix(q) for chain in self._chains))

    def regressor(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y (n, p)."""
        return np.concatenate([chain.regressor(q, v, a) for chain in self._chains], axis=1)

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_r (n, p) and the torque M a_r + C v_r + g (n)."""
        found = [chain.slotine_li(q, v, v_r, a_r) for chain in self._chains]
        Y, tau = zip(*found, strict=True)
        return np.concatenate(Y, axis=1), np.asarray(sum(tau))

    def momentum(self, q: np.ndarray, v: np.ndarray) -> Momentum:
        """Return the torque as the rate of a momentum and a rest."""
        Y_M, Y_0, p_0, tau_0 = zip(*(chain.momentum(q, v) for chain in self._chains), strict=True)
        Y_M, Y_0 = (np.concatenate(part, axis=1) for part in (Y_M, Y_0))
        return Momentum(Y_M, Y_0, np.asarray(sum(p_0)), np.asarray(sum(tau_0)))

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of a robot; None if more than lengths and inertias differ."""
        return self._fit.parameters(robot)
