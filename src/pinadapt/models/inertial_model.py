"""Torque and mass matrix of a chain for any inertial parameters, physical or not."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from .._compiled import compiled
from ..exceptions import ParameterError
from .regressor import PER_BODY, inertial_parameters

_LEAST_MASS = (
    1e-6  # [kg] pin.Inertia stores the centre of mass mc/m, which loses its digits below this mass
)


class InertialModel:
    """A private model whose ten parameters a body may be any numbers.

    RNEA and CRBA are linear in the parameters pi, but ``pin.Inertia`` cannot hold a body without
    mass and CRBA cannot add bodies whose masses sum to less than nothing. Where a mass is not
    positive, a ballast u of one kilogram a body is added c times and its effect taken off again:
    M(pi) = M(pi + c u) - c M(u), exact for every pi.
    """

    def __init__(self, model: pin.Model) -> None:
        """Copy a chain's model."""
        self._model, self._ballast_model = model.copy(), model.copy()
        self._data, self._ballast_data = self._model.createData(), self._ballast_model.createData()
        self._inertias, self._tens = self._model.inertias, np.zeros((model.nv, PER_BODY))
        self._bodies = list(enumerate(self._tens, 1))  # joint and live row of ten parameters
        for joint in range(1, model.njoints):
            self._ballast_model.inertias[joint] = pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3)))
        self._ballast_model.armature = np.zeros(model.nv)
        self._ballast = inertial_parameters(self._ballast_model)
        self._c = 0.0

    def load(self, pi: np.ndarray) -> None:
        """Set the parameters (10 n) of all bodies.

        Raises:
            ParameterError: not so many.
        """
        if pi.size != self._ballast.size:
            raise ParameterError(
                f"expected {self._ballast.size} numbers, got {pi.size}.",
                where="inertial parameters",
            )
        self._c = _take(pi, self._ballast, self._tens)
        inertias, inertia = self._inertias, pin.Inertia.FromDynamicParameters
        for joint, ten in self._bodies:
            inertias[joint] = inertia(ten)

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N], rotors included."""
        tau = pin.rnea(self._model, self._data, q, v, a)
        if self._c:
            tau -= self._c * pin.rnea(self._ballast_model, self._ballast_data, q, v, a)
        return tau

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), rotors included."""
        M = pin.crba(self._model, self._data, q)
        if self._c:
            M = M - self._c * pin.crba(self._ballast_model, self._ballast_data, q)
        return M


@compiled("f8(f8[:], f8[:], f8[:,:])")
def _take(pi: np.ndarray, ballast: np.ndarray, tens: np.ndarray) -> float:
    """Write pi + c ballast (10 n) as n rows of ten; return c, zero where no body needs it."""
    lightest = pi[0]
    for b in range(len(tens)):
        lightest = min(lightest, pi[PER_BODY * b])
    c = 1.0 - lightest if lightest < _LEAST_MASS else 0.0
    for b in range(len(tens)):
        for i in range(PER_BODY):
            tens[b, i] = pi[PER_BODY * b + i] + c * ballast[PER_BODY * b + i]
    return c
