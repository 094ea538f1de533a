"""Base parameters: the combinations of parameters that motion can identify.

Columns of the stacked regressor W over random states are linearly dependent exactly where no
motion can distinguish their parameters. In the order of the parameters, from base to tip, a column
that depends on those before it is regrouped into them: W = W_b [1 R], W a = W_b (a_b + R a_rest).

M. Gautier, *Numerical calculation of the base inertial parameters of robots*, J. Robotic Systems 8
(1991), here by orthogonalisation and for any linear parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from .._checks import instance, numbers
from .._table import Sheet, Table
from ..exceptions import ParameterError
from ..robot.robot import Robot
from .dynamics import Dynamics
from .task_kinematics import TaskKinematics


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
        a = numbers(a, "a", error=ParameterError)
        if a.shape != (len(self.parameters),):
            raise ParameterError(
                f"expected {len(self.parameters)} numbers, got shape {a.shape}.", where="a"
            )
        return self.regrouping @ a

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
        """Return a table of the combinations."""
        return str(self._sheet())

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def _sheet(self) -> Sheet:
        rows = [(str(i + 1), self.expression(i)) for i in range(self.size)]
        title = f"{self.size} identifiable combinations of {len(self.parameters)} parameters"
        note = ", ".join(self.without_effect)
        return Sheet(
            title, [Table(rows or [("", "none")])], f"without effect: {note}" if note else ""
        )


def base_parameters(
    model: Dynamics | TaskKinematics, robot: Robot, *, samples: int = 60
) -> BaseParameters:
    """Return the identifiable combinations of the parameters of a model.

    Args:
        model: ``controller.dynamics``, identified from the torque, or ``controller.kinematics``,
            identified from the velocity of the task frame.
        robot: with the chain that the model was made for.
        samples: number of seeded random states.

    Raises:
        ParameterError: the model is neither of them.
    """
    instance(model, Dynamics | TaskKinematics, "model", ParameterError)
    rng, rows = np.random.default_rng(0), [np.zeros((0, model.size))]
    for _ in range(samples if model.size else 0):
        q = pin.integrate(
            robot.model, pin.neutral(robot.model), rng.uniform(-2.0, 2.0, robot.model.nv)
        )
        v, a = rng.standard_normal((2, robot.model.nv))
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


_NEGLIGIBLE = 1e-8  # share of a column that counts as rounding; true shares lie far above


def independent_columns(
    W: np.ndarray, largest: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns (b) of W (N, p) that do not depend on those before them, and R (b, p).

    W = W[:, chosen] R. Columns are compared by direction, so that units do not matter.

    Args:
        W: (N, p).
        largest: (p) sizes of the columns of whose rounding W may consist; a column below 1e-8 of
            that is zero. None: the largest column of W.
    """
    sizes = np.linalg.norm(W, axis=0)
    floor = _NEGLIGIBLE * (sizes.max(initial=0.0) if largest is None else largest)
    Q, chosen = np.zeros((len(W), 0)), []
    for j in np.flatnonzero(sizes > floor):
        left = W[:, j] / sizes[j]
        for _ in range(2):  # the second pass removes rounding
            left = left - Q @ (Q.T @ left)
        length = np.linalg.norm(left)
        if length > _NEGLIGIBLE:
            Q = np.column_stack([Q, left / length])
            chosen.append(int(j))
    units = W / np.where(sizes > floor, sizes, 1.0) * (sizes > floor)
    R = np.linalg.lstsq(units[:, chosen], units, rcond=None)[0]
    R[np.abs(R) < _NEGLIGIBLE] = 0.0
    R *= sizes / sizes[chosen][:, None]
    R[:, chosen] = np.eye(len(chosen))
    return np.array(chosen, dtype=int), R
