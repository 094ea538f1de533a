"""Torque and mass matrix of a chain whose bodies have any inertial parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from .._kernels import models as kernels
from .regressor import PER_BODY, inertial_parameters


class InertialModel:
    """A private Pinocchio model whose ten parameters per body may be any numbers.

    RNEA and CRBA are linear in the parameters pi, but ``pin.Inertia`` cannot represent a body
    without mass, and CRBA cannot sum bodies to a mass that is not positive. For such parameters a
    ballast u of one kilogram a body is added c times and its effect subtracted:
    M(pi) = M(pi + c u) - c M(u), exactly, for every pi.
    """

    def __init__(self, model: pin.Model) -> None:
        """Copy a chain's model."""
        self._model, self._ballast_model = model.copy(), model.copy()
        self._data, self._ballast_data = self._model.createData(), self._ballast_model.createData()
        self._inertias, self._ballast_model.armature = self._model.inertias, np.zeros(model.nv)
        self._pi, self._written, self._c = inertial_parameters(model), True, 0.0
        self._tens = self._pi.copy()
        self._bodies = list(enumerate(self._tens.reshape(-1, PER_BODY), 1))  # views
        self._ballast = np.tile(np.eye(PER_BODY)[0], model.nv)  # point masses at the joints
        for joint in range(1, model.njoints):
            point = pin.Inertia.FromDynamicParameters(self._ballast[:PER_BODY])
            self._ballast_model.inertias[joint] = point

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return type(self), (self._model,)

    def load(self, pi: np.ndarray) -> None:
        """Set the parameters (10 n) of all bodies; they must not change until others are set."""
        self._pi, self._written = pi, False

    def _write(self) -> None:
        """Write the parameters into the model, before a torque or a mass matrix is computed."""
        self._c = kernels.take(self._pi, self._ballast, self._tens)
        inertias, from_ten = self._inertias, pin.Inertia.FromDynamicParameters
        for joint, ten in self._bodies:
            inertias[joint] = from_ten(ten)
        self._written = True

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N], rotors included."""
        if not self._written:
            self._write()
        tau = pin.rnea(self._model, self._data, q, v, a)
        if self._c:
            tau -= self._c * pin.rnea(self._ballast_model, self._ballast_data, q, v, a)
        return tau

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), rotors included."""
        if not self._written:
            self._write()
        M = pin.crba(self._model, self._data, q)
        if self._c:
            M = M - self._c * pin.crba(self._ballast_model, self._ballast_data, q)
        return M
