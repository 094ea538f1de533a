"""Bases of dynamic parameters: a user's own, pi = B a, and those that motion can identify.

A user's own basis is what Wang and Xie use for their arm. Base parameters are the combinations of
parameters that motion can identify: columns of the stacked regressor W over random states are
linearly dependent exactly where no motion can distinguish their parameters. In the order of the
parameters, from base to tip, a column that depends on those before it is regrouped into them:
W = W_b [1 R], W a = W_b (a_b + R a_rest).

M. Gautier, *Numerical calculation of the base inertial parameters of robots*, J. Robotic Systems 8
(1991), here by orthogonalisation and for any linear parameters.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import ROUNDING, instance, numbers, vector
from ..exceptions import ParameterError
from ..robot.robot import Robot
from .bodies import InertialDynamics
from .dynamics import Dynamics
from .regressor import PER_BODY, SAMPLES, State, random_states
from .task_kinematics import TaskKinematics


class BasisDynamics(InertialDynamics):
    """Parameters a with pi = B a, so that the torque is Y B a; pi stacks ten parameters per body.

    pi need not be physical, and masses may be zero or negative. Lumped parameters with unknown
    lengths are allowed if B is such that Y B does not depend on the lengths.
    """

    def __init__(self, robot: Robot, B: ArrayLike, names: tuple[str, ...] | None = None) -> None:
        """Use a basis B (10 n, p) for a nominal robot of n joints; default names are a1, a2, ...

        Raises:
            ParameterError: wrong shape, entries that are not finite, columns that cannot be
                identified separately, or a basis that does not contain the nominal robot.
        """
        B, rows = numbers(B, "unknown.basis", error=ParameterError), PER_BODY * robot.model.nv
        if B.ndim != 2 or len(B) != rows or not B.size:
            raise ParameterError(
                f"expected a matrix with {rows} rows ({PER_BODY} a body), got shape {B.shape}.",
                where="unknown.basis",
            )
        super().__init__(robot, B)
        self.bodies = range(robot.model.nv)
        self.names = names or tuple(f"a{i + 1}" for i in range(self.size))
        states = random_states(robot.model, SAMPLES)
        Y = np.vstack([self._regressor(*state) for state in states])
        sizes = np.maximum(np.linalg.norm(B, axis=0), np.finfo(float).tiny)
        if len(independent_columns(Y @ (B / sizes))[0]) < self.size:
            raise ParameterError(
                "not all columns of the basis can be identified: Y B has dependent columns.",
                where="unknown.basis",
                hint="Remove parameters without effect on the torque, and lump dependent ones.",
            )
        self._fit = TorqueFit(states, Y @ B, self._armature)
        initial = self._fit.parameters(robot)
        if initial is None:
            raise ParameterError(
                "the basis cannot represent the robot's dynamics: no a gives Y B a = rnea.",
                where="unknown.basis",
                hint="Check the order of the rows: m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz "
                "about each joint.",
            )
        self.initial = initial
        self.load(initial)

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the a (p) that reproduces a robot's torque with this chain's placements.

        None if there is none.
        """
        return self._fit.parameters(robot)


class TorqueFit:
    """The parameters a whose torque Y a is that of a robot, exactly, at seeded states."""

    def __init__(self, states: Sequence[State], Y: np.ndarray, armature: np.ndarray) -> None:
        """Use N states (q, v, a), regressors (N n, p) there, of full rank, and known rotors (n)."""
        self._states, self._armature = states, armature
        self._Q, self._R = np.linalg.qr(Y)

    def parameters(self, robot: Robot) -> np.ndarray | None:
        """Return the a (p) of a robot with these joints; None if it has none, as with friction."""
        model, data = robot.in_base_axes.model, robot.model.createData()
        tau = np.concatenate(
            [pin.rnea(model, data, q, v, a) - self._armature * a for q, v, a in self._states]
        )
        components = self._Q.T @ tau
        left = np.linalg.norm(tau - self._Q @ components)
        if robot.friction.present or left > ROUNDING * np.linalg.norm(tau):
            return None
        return np.asarray(np.linalg.solve(self._R, components))


def read_matrix(path: Path) -> np.ndarray:
    """Return the matrix in a CSV file; lines that start with # are comments.

    Raises:
        ParameterError: no such file, or entries that are not numbers.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # of an empty file
            matrix = np.loadtxt(path, delimiter=",", ndmin=2, encoding="utf-8-sig")
    except (OSError, ValueError, UserWarning) as error:
        raise ParameterError(
            f"expected a file of numbers separated by commas: {error}", where=str(path)
        ) from error
    return numbers(matrix, str(path), error=ParameterError)


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

    @property
    def names(self) -> tuple[str, ...]:
        """The leading parameter of each combination."""
        return tuple(self.parameters[index] for index in self.chosen)

    def values(self, a: np.ndarray) -> np.ndarray:
        """Return the values (b) of the combinations for parameters a (p).

        Raises:
            ParameterError: a is not p finite numbers.
        """
        return self.regrouping @ vector(a, len(self.parameters), "a", error=ParameterError)

    def expression(self, index: int) -> str:
        """Return a combination as a sum of parameters, the leading one first."""
        row, lead = self.regrouping[index], self.chosen[index]
        others = (
            f" {'-' if factor < 0 else '+'} {abs(factor):.4g} {name}"
            for j, (factor, name) in enumerate(zip(row, self.parameters, strict=True))
            if factor and j != lead
        )
        return self.parameters[lead] + "".join(others)

    def __repr__(self) -> str:
        """Return the combinations, one a line."""
        rows = [f"{i + 1:4d}  {self.expression(i)}" for i in range(self.size)]
        title = f"{self.size} identifiable combinations of {len(self.parameters)} parameters"
        return "\n".join([title, *rows, f"without effect: {', '.join(self.without_effect) or '-'}"])


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
    rows = [np.zeros((0, model.size))]
    for q, v, a in random_states(robot.model, SAMPLES):
        if isinstance(model, Dynamics):
            rows.append(model.regressor(q, v, a))
        else:
            model.update(model.initial, q, v)
            rows.append(model.Y_p)
    chosen, regrouping = independent_columns(np.vstack(rows))
    dead = tuple(
        name for name, column in zip(model.names, regrouping.T, strict=True) if not column.any()
    )
    return BaseParameters(tuple(model.names), chosen, regrouping, dead)


def independent_columns(W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns (b) of W (N, p) that do not depend on those before them, and R (b, p).

    W = W[:, chosen] R. Columns are compared by direction, so that units do not matter; one below
    1e-8 of the largest is zero.
    """
    sizes = np.linalg.norm(W, axis=0)
    floor = ROUNDING * sizes.max(initial=0.0)
    units = W / np.where(sizes > floor, sizes, 1.0) * (sizes > floor)
    left, chosen = units.copy(), []
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
