"""Bases of dynamic parameters: a user's own, lumped ones, and those that motion can identify.

A user's own basis, pi = B a, is what Wang and Xie use for their arm.

Lengths multiply inertias, so that with unknown lengths the regressor of ten parameters per body
depends on the lengths. But the torque of a chain is a polynomial of degree two in its lengths, and
by superposition of chains with fixed random lengths (here: virtual chains, or nodes) it is linear
in lumped parameters whose regressor contains no unknown lengths. ``lumped_base`` finds a base of
these parameters, ``LumpedDynamics`` is the choice of unknowns for a controller.

Base parameters are the combinations of
parameters that motion can identify: columns of the stacked regressor W over random states are
linearly dependent exactly where no motion can distinguish their parameters. In the order of the
parameters, from base to tip, a column that depends on those before it is regrouped into them:
W = W_b [1 R], W a = W_b (a_b + R a_rest).

M. Gautier, *Numerical calculation of the base inertial parameters of robots*, J. Robotic Systems 8
(1991), here by orthogonalisation and for any linear parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from .._checks import ROUNDING, instance, numbers
from ..exceptions import ParameterError
from ..robot.robot import Robot
from .dynamics import Dynamics
from .regressor import (
    LABELS,
    PER_BODY,
    SAMPLES,
    Regressor,
    State,
    VirtualChains,
    random_states,
)
from .task_kinematics import TaskKinematics
from .translations import LENGTHS, Translation, Words, place, unknown_translations


class FittedDynamics(Dynamics):
    """Dynamics whose parameters a are those with the torque Y a of a robot, at seeded states."""

    def _fit(self, states: Sequence[State], Y: np.ndarray) -> None:
        """Use N states (q, v, a), and the regressors (N n, p) there, of full rank."""
        self._states = states
        (self._Q, self._R) = np.linalg.qr(Y)

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the a (p) with exactly the torque of a robot with these joints; None if none has.

        None has that of friction.
        """
        tau = self._of_bodies(robot, self._states)
        components = self._Q.T @ tau
        left = np.linalg.norm(tau - self._Q @ components)
        if robot.friction.present or left > ROUNDING * np.linalg.norm(tau):
            return None
        return np.linalg.solve(self._R, components)


class BasisDynamics(FittedDynamics):
    """Parameters a with pi = B a, so that the torque is Y B a; pi stacks ten parameters per body.

    pi need not be physical, and masses may be zero or negative. Lumped parameters with unknown
    lengths are allowed if B is such that Y B does not depend on the lengths.
    """

    def __init__(self, robot: Robot, B: ArrayLike) -> None:
        """Use a basis B (10 n, p) for a nominal robot of n joints; the names are a1, a2, ...

        Raises:
            ParameterError: wrong shape, entries that are not finite, columns that cannot be
                identified separately, or a basis that does not contain the nominal robot.
        """
        B = numbers(B, "unknown.basis", error=ParameterError)
        rows = PER_BODY * robot.model.nv
        if B.ndim != 2 or len(B) != rows or not B.size:
            raise ParameterError(
                f"expected a matrix with {rows} rows ({PER_BODY} a body), got shape {B.shape}.",
                where="unknown.basis",
            )
        super().__init__(robot, B)
        self.bodies = range(robot.model.nv)
        self.names = tuple(f"a{i + 1}" for i in range(self.size))
        states = random_states(robot.model, SAMPLES)
        Y = np.vstack([self._model(*state) for state in states]) @ B
        self._fit(states, Y)
        one = len(independent_columns(Y)[0]) == self.size
        initial = self.value(robot) if one else None
        if initial is None:
            raise ParameterError(
                "no a gives Y B a = rnea, the robot's dynamics, or more than one does.",
                where="unknown.basis",
                hint="Check the order of the rows: m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz "
                "about each joint. Remove parameters without effect on the torque, and lump "
                "dependent ones.",
            )
        self.initial = initial
        self.load(initial)


def read_matrix(path: Path) -> np.ndarray:
    """Return the matrix in a CSV file; lines that start with # are comments.

    Raises:
        ParameterError: no such file, or entries that are not numbers.
    """
    try:
        matrix = np.loadtxt(path, delimiter=",", ndmin=2, encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"expected a file of numbers separated by commas: {error}", where=path
        ) from error
    return numbers(matrix, str(path), error=ParameterError)


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
    chains = list[Regressor]()
    columns = list[int]()
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
        self.bodies = range(robot.model.nv)
        self.size = len(initial)
        self.initial = initial
        self.load(initial)


@dataclass(frozen=True, eq=False, repr=False)
class BaseParameters:
    """b identifiable combinations of p parameters; ``print`` shows them as sums.

    Attributes:
        parameters: names of the parameters (p).
        chosen: (b) index of the leading parameter of each combination.
        regrouping: (b, p) coefficients of the combinations, one at the leading parameter.
        without_effect: names of the parameters that have no effect in any motion.
    """

    parameters: tuple[str, ...]
    chosen: np.ndarray
    regrouping: np.ndarray
    without_effect: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number b of combinations."""
        return len(self.chosen)

    def __repr__(self) -> str:
        """Return the combinations, one a line, as sums with the leading parameter first."""
        lines = [f"{self.size} identifiable combinations of {len(self.parameters)} parameters"]
        for number, (lead, row) in enumerate(zip(self.chosen, self.regrouping, strict=True), 1):
            line = f"{number:4d}  {self.parameters[lead]}"
            for j in np.flatnonzero(row).tolist():
                if j != lead:
                    line += f" {'-' if row[j] < 0 else '+'} {abs(row[j]):.4g} {self.parameters[j]}"
            lines.append(line)
        return "\n".join([*lines, f"without effect: {', '.join(self.without_effect) or '-'}"])


def base_parameters(model: Dynamics | TaskKinematics, robot: Robot) -> BaseParameters:
    """Return the identifiable combinations of the parameters of a model.

    Args:
        model: ``controller.dynamics``, identified from the torque, or ``controller.kinematics``,
            identified from the velocity of the task frame.
        robot: with the chain that the model was made for.

    Raises:
        ParameterError: the model is neither of them.
    """
    instance(model, Dynamics | TaskKinematics, "model", ParameterError)
    rows = []
    for q, v, a in random_states(robot.model, SAMPLES):
        if isinstance(model, Dynamics):
            rows.append(model.regressor(q, v, a))
        else:
            model.update(model.initial, q, v)
            rows.append(model.Y_p)
    chosen, regrouping = independent_columns(np.vstack(rows))
    dead = [model.names[i] for i in np.flatnonzero(~regrouping.any(axis=0)).tolist()]
    return BaseParameters(model.names, chosen, regrouping, tuple(dead))


def independent_columns(W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns (b) of W (N, p) that do not depend on those before them, and R (b, p).

    W = W[:, chosen] R. Columns are compared by direction, so that units do not matter; one below
    1e-8 of the largest is zero.
    """
    sizes = np.linalg.norm(W, axis=0)
    felt = sizes > ROUNDING * sizes.max(initial=0.0)
    units = felt * W / np.where(felt, sizes, 1.0)
    left = units.copy()
    chosen = []
    for j in range(len(sizes)):
        length = np.linalg.norm(left[:, j])
        if length > ROUNDING:
            chosen.append(j)
            direction = left[:, j] / length
            left -= np.outer(direction, direction @ left)
    R = np.linalg.lstsq(units[:, chosen], units, rcond=None)[0]
    R[np.abs(R) < ROUNDING] = 0.0
    R *= sizes / sizes[chosen][:, None]
    R[:, chosen] = np.eye(len(chosen))
    return np.array(chosen, dtype=int), R
