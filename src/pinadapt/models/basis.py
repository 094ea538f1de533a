"""A user's own basis of dynamic parameters, pi = B a, as Wang and Xie use for their arm."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy import empty
from numpy.typing import ArrayLike

from .._checks import numbers
from .._kernels import linear_algebra as kernels
from ..exceptions import ParameterError
from ..robot.robot import Robot
from .base_parameters import independent_columns
from .bodies import InertialDynamics
from .regressor import PER_BODY, Regressor

_NEGLIGIBLE = 1e-8  # share of a torque that counts as rounding; true shares lie far above


class BasisDynamics(InertialDynamics):
    """Parameters a with pi = B a, so that the torque is Y B a; pi stacks ten parameters per body.

    pi need not be physical, and masses may be zero or negative. Lumped parameters with unknown
    lengths are allowed if B is such that Y B does not depend on the lengths.

    Attributes:
        B: (10 n, p) the basis.
    """

    def __init__(self, robot: Robot, B: ArrayLike, names: tuple[str, ...] | None = None) -> None:
        """Use a basis B (10 n, p) for a nominal robot of n joints; default names are a1, a2, ...

        Raises:
            ParameterError: wrong shape, entries that are not finite, columns that cannot be
                identified separately, or a basis that does not contain the nominal robot.
        """
        super().__init__(robot)
        rows = PER_BODY * robot.model.nv
        self.B = numbers(B, "unknown.basis", error=ParameterError)
        if self.B.ndim != 2 or self.B.shape[0] != rows or not self.B.shape[1]:
            raise ParameterError(
                f"expected a matrix with {rows} rows ({PER_BODY} a body), got shape "
                f"{self.B.shape}.",
                where="unknown.basis",
            )
        self.size, self.bodies = self.B.shape[1], range(robot.model.nv)
        self.names = names or tuple(f"a{i + 1}" for i in range(self.size))
        if identifiable(self._regressor, self.B, robot) < self.size:
            raise ParameterError(
                "not all columns of the basis can be identified: Y B has dependent columns.",
                where="unknown.basis",
                hint="Remove parameters without effect on the torque, and lump dependent ones.",
            )
        initial = equivalent_parameters(self._regressor, self.B, robot)
        if initial is None:
            raise ParameterError(
                "the basis cannot represent the robot's dynamics: no a gives Y B a = rnea.",
                where="unknown.basis",
                hint="Check the order of the rows: m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz "
                "about each joint.",
            )
        self.initial = initial
        self.load(initial)

    def expand(self, a_d: np.ndarray) -> np.ndarray:
        """Return pi = B a_d (10 n)."""
        pi = empty(len(self.B))
        kernels.apply(self.B, a_d, pi)
        return pi

    def reduce(self, Y: np.ndarray) -> np.ndarray:
        """Return Y B (n, p)."""
        product = empty((len(Y), self.size))
        kernels.multiply(Y, self.B, product)
        return product

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the a (p) that reproduces a robot's torque with this chain's placements.

        None if there is none.
        """
        if not self.differs_only_in_bodies(robot):
            return None
        return equivalent_parameters(self._regressor, self.B, robot)


def equivalent_parameters(
    regressor: Regressor, B: np.ndarray, robot: Robot, *, samples: int = 60
) -> np.ndarray | None:
    """Return the a (p) for which Y B a is a robot's torque; None if there is none.

    Args:
        regressor: Y of the nominal chain.
        B: (10 n, p) basis of the parameters.
        robot: whose torque is matched, without friction and rotors.
        samples: number of random states.
    """
    Y, tau = _random_motion(regressor, robot, samples)
    Y = Y @ B
    a_d = np.linalg.lstsq(Y, tau, rcond=None)[0]
    residual = np.linalg.norm(Y @ a_d - tau)
    return np.asarray(a_d) if residual <= _NEGLIGIBLE * np.linalg.norm(tau) else None


def identifiable(regressor: Regressor, B: np.ndarray, robot: Robot, *, samples: int = 60) -> int:
    """Return the number of identifiable parameters a of pi = B a, B (10 n, p): the rank of Y B.

    Columns of Y B that are zero up to the rounding of Y, of size at most |Y| |B_j|, do not count;
    see ``independent_columns``.
    """
    Y = _random_motion(regressor, robot, samples)[0]
    largest = np.linalg.norm(Y, axis=0).max() * np.linalg.norm(B, axis=0)
    return len(independent_columns(Y @ B, largest)[0])


def _random_motion(
    regressor: Regressor, robot: Robot, samples: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return Y (samples n, 10 n) and torque (samples n) without rotors at seeded random states."""
    model, rng = robot.model.copy(), np.random.default_rng(0)
    model.armature = np.zeros(model.nv)
    data = model.createData()
    rows, torques = [], []
    for _ in range(samples):
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-2.0, 2.0, model.nv))
        v, a = rng.standard_normal((2, model.nv))
        rows.append(regressor(q, v, a))
        torques.append(pin.rnea(model, data, q, v, a))
    return np.vstack(rows), np.concatenate(torques)


def read_matrix(path: Path) -> np.ndarray:
    """Return the matrix in a CSV file; lines that start with # are comments.

    Raises:
        ParameterError: no such file, or entries that are not numbers.
    """
    if not path.is_file():
        raise ParameterError("no such file.", where=str(path))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about an empty file, refused below
            matrix = np.loadtxt(path, delimiter=",", ndmin=2, encoding="utf-8-sig")
    except ValueError as error:
        raise ParameterError(
            f"expected numbers separated by commas: {error}", where=str(path)
        ) from error
    if not matrix.size:
        raise ParameterError("the file contains no numbers.", where=str(path))
    return numbers(matrix, str(path), error=ParameterError)
