"""A user's own basis of dynamic parameters, pi = B a, as Wang and Xie use for their arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..exceptions import ParameterError
from ..robot import Robot
from .dynamic import DynamicParameters, equivalent_parameters
from .inertial_model import InertialModel
from .regressor import PER_BODY, Regressor


class BasisParameters(DynamicParameters):
    """Parameters a with pi = B a, so that the torque is Y B a; pi is the stack of ten parameters a body.

    pi need not be physical, nor even have masses. Lumped parameters that
    contain unknown lengths are allowed when B is built so that Y B does not depend on them.
    """

    def __init__(self, robot: Robot, B: ArrayLike, names: tuple[str, ...] | None = None) -> None:
        """Take a basis B (10 n, p) for a believed robot of n joints; names default to a1, a2, ...

        Raises:
            ParameterError: wrong shape, non-finite entries, or columns that the dynamics cannot tell apart.
        """
        rows = PER_BODY * robot.model.nv
        self.B = np.array(B, dtype=float)
        if self.B.ndim != 2 or self.B.shape[0] != rows or not self.B.shape[1]:
            raise ParameterError(
                f"expected a matrix with {rows} rows ({PER_BODY} a body), got shape {self.B.shape}.", where="unknown.basis"
            )
        if not np.isfinite(self.B).all():
            raise ParameterError("all entries must be finite.", where="unknown.basis")
        self.size = self.B.shape[1]
        self.names = names or tuple(f"a{i + 1}" for i in range(self.size))
        self._armature = np.array(robot.model.armature)
        self._regressor = Regressor(robot.model)
        self._believed = InertialModel(robot.model)
        initial = equivalent_parameters(self._regressor, self.B, robot)
        if initial is None:
            raise ParameterError(
                "the basis cannot represent the robot's own dynamics: no a gives Y B a = rnea.",
                where="unknown.basis",
                hint="Check the order of the rows: m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about each joint.",
            )
        self.initial = initial
        self.load(initial)

    @classmethod
    def from_file(cls, robot: Robot, path: Path) -> BasisParameters:
        """Read B from a CSV file with 10 n rows and one column a parameter.

        Raises:
            ParameterError: no such file, not numbers, or wrong shape.
        """
        return cls(robot, read_matrix(path))

    def load(self, a_d: np.ndarray) -> None:
        """Set pi = B a_d."""
        self._pi = self.B @ a_d
        self._believed.load(self._pi)

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) = Y B a_d + rotors, by RNEA."""
        return self._believed.torque(q, v, a)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n) by CRBA."""
        return self._believed.mass_matrix(q)

    def regressor(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y B (n, p)."""
        return self._regressor(q, v, a) @ self.B

    def slotine_li(self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_r B (n, p) and the torque it gives (n)."""
        Y = self._regressor.slotine_li(q, v, v_r, a_r)
        return Y @ self.B, Y @ self._pi + self._armature * a_r

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the a that reproduces a robot's dynamics with the believed placements, or None if none does."""
        if not np.allclose(robot.model.armature, self._armature):
            return None
        return equivalent_parameters(self._regressor, self.B, robot)


def read_matrix(path: Path) -> np.ndarray:
    """Return the matrix in a CSV file; lines that begin with # are comments.

    Raises:
        ParameterError: no such file, or entries that are not numbers.
    """
    if not path.is_file():
        raise ParameterError("no such file.", where=str(path))
    try:
        return np.loadtxt(path, delimiter=",", ndmin=2)
    except ValueError as error:
        raise ParameterError(f"not a table of numbers separated by commas: {error}", where=str(path)) from error
