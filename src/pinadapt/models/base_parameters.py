"""The combinations of parameters that motion can identify, by name with their regrouping.

The columns of a stacked regressor W over random states are independent but for what no motion tells
apart. Taken in the order of the parameters, from the base to the tip, a column that depends on
those before it is regrouped into them: W = W_b [1 R], so that W a = W_b (a_b + R a_rest). It is the
numerical base of Gautier, *Numerical calculation of the base inertial parameters of robots*,
J. Robotic Systems 8 (1991), by orthogonalisation, for any parameters in which motion is linear.
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
from .linear_algebra import independent_columns
from .task_kinematics import TaskKinematics


@dataclass(frozen=True, eq=False, repr=False)
class BaseParameters:
    """b combinations of p parameters; ``print`` shows them as sums.

    Attributes:
        parameters: names of the parameters (p).
        chosen: (b) index of the parameter that leads each combination.
        regrouping: (b, p) what each combination is of all parameters; one at its leading one.
        without_effect: names of the parameters that no motion shows.
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
        """Return the combinations (b) of parameters a (p).

        Raises:
            ParameterError: not p finite numbers.
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
        title = f"{self.size} combinations of {len(self.parameters)} parameters"
        note = ", ".join(self.without_effect)
        return Sheet(
            title, [Table(rows or [("", "none")])], f"without effect: {note}" if note else ""
        )


def base_parameters(
    model: Dynamics | TaskKinematics, robot: Robot, *, samples: int = 60
) -> BaseParameters:
    """Return which combinations of the parameters of a model any motion can identify.

    Args:
        model: ``controller.dynamics``, whose rows are of the torque, or ``controller.kinematics``,
            whose rows are of the velocity of the frame's position.
        robot: with the chain it was made for.
        samples: number of random states, seeded.

    Raises:
        ParameterError: it is neither.
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
