"""Unknown lengths and inertias together: lumped parameters in which the torque is linear.

Lengths multiply inertias, so that with unknown lengths the regressor of ten parameters per body
depends on the lengths. But the torque of a chain is a polynomial of degree two in its lengths, and
by superposition of chains with fixed random lengths (here: virtual chains, or nodes) it is linear
in lumped parameters whose regressor contains no unknown lengths. ``lumped_base`` finds a base of
these parameters, ``LumpedDynamics`` is the choice of unknowns for a controller.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..exceptions import ParameterError
from ..robot.robot import Robot
from .basis import FittedDynamics, independent_columns
from .regressor import LABELS, PER_BODY, Regressor, State, VirtualChains, random_states
from .translations import LENGTHS, Translation, Words, place, unknown_translations


def lumped_base(
    robot: Robot, translations: Sequence[Translation]
) -> tuple[list[Regressor], list[int], list[State], np.ndarray]:
    """Return the base of a chain's dynamics for unknown translations.

    Of each random node it has the columns outside the span of the nodes before. The search ends
    when two further nodes add no column: a random node lies in the span with probability one only
    if all nodes do.

    Returns:
        k virtual chains, without rotors; the p columns of their regressors (n, 10 n k), side by
        side, that belong to the base; N states and the base there (N n, p).
    """
    model = robot.model
    rng = np.random.default_rng(0)
    states = random_states(model, 40 + 10 * model.nv)
    chains, columns = list[Regressor](), list[int]()
    base = np.zeros((len(states) * model.nv, 0))
    size = sum(part.size for part in translations)
    without_news = 0
    while without_news < 2:
        node = model.copy()
        node.armature = np.zeros(model.nv)
        place(node, 0, translations, rng.uniform(-1.0, 1.0, size))
        regressor = Regressor(node)
        both = np.hstack([base, np.vstack([regressor(*state) for state in states])])
        chosen, _ = independent_columns(both)
        own = chosen[base.shape[1] :] - base.shape[1]
        without_news += 1
        if own.size:
            columns += (PER_BODY * model.nv * len(chains) + own).tolist()
            chains.append(regressor)
            base = both[:, chosen]
            without_news = 0
    return chains, columns, states, base


class LumpedDynamics(FittedDynamics):
    """Dynamics in products of lengths and inertial parameters, for unknown lengths of any chain.

    The parameters generalise a_2 = m_2 l_1 l_c2 of Wang and Xie (2009), section 5. The inertias of
    all bodies are unknown. Torque, mass matrix and regressor are those of the virtual chains
    together.

    Attributes:
        translations: the unknown joint translations; the tool's has no effect on the dynamics.
    """

    def __init__(self, robot: Robot, lengths: Words = LENGTHS) -> None:
        """Choose the unknown translations of a nominal robot, as ``unknown_translations``.

        Raises:
            ParameterError: no joint translation is unknown.
            RobotError: unknown joint.
        """
        parts = unknown_translations(robot, lengths)
        self.translations = [part for part in parts if part.joint is not None]
        if not self.translations:
            raise ParameterError(
                "no joint translation is unknown, so nothing has to be lumped.",
                where="unknown.translations",
                hint="Use BodyDynamics.",
            )
        super().__init__(robot)
        chains, columns, states, base = lumped_base(robot, self.translations)
        self._fit(states, base)
        initial = self.value(robot)
        assert initial is not None  # the nominal translations are along their directions
        self._model = VirtualChains(chains, columns, self._armature)
        names = [f"{joint}.{label}" for joint in robot.joint_names for label in LABELS]
        self.names = tuple(f"{names[c % len(names)]}#{1 + c // len(names)}" for c in columns)
        self.bodies, self.size, self.initial = range(robot.model.nv), len(initial), initial
        self.load(initial)
