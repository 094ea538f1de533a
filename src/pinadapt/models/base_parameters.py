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


_NEGLIGIBLE = 1e-8  # share of a column that counts as rounding; true shares lie far above


def independent_columns(
    W: np.ndarray, largest: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns (b) of W (N, p) that do not depend on those before them, and R (b, p).

    W = W[:, chosen] R. Columns count by their directions, so that units do not matter; those that
    are zero but for the rounding of sizes ``largest`` (p), by default the largest column's, are no
    columns.
    """
    sizes = np.linalg.norm(W, axis=0)
    floor = _NEGLIGIBLE * (sizes.max(initial=0.0) if largest is None else largest)
    Q, chosen = np.zeros((len(W), 0)), []
    for j in np.flatnonzero(sizes > floor):
        left = W[:, j] / sizes[j]
        for _ in range(2):  # twice is enough
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
