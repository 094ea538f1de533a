"""Torque and mass matrix of a chain whose bodies have any inertial parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from .._kernels import models as kernels
from .regressor import PER_BODY, Regressor, inertial_parameters, wrong_sizes


class InertialModel(Regressor):
    """A chain whose ten parameters per body may be any numbers: torque and mass matrix.

    RNEA and CRBA are linear in the parameters pi, but ``pin.Inertia`` cannot represent a body
    without mass, and CRBA cannot sum bodies to a mass that is not positive. For such parameters a
    ballast u of one kilogram a body is added c times and its effect subtracted:
    M(pi) = M(pi + c u) - c M(u), exactly, for every pi.
    """

    def __init__(self, model: pin.Model) -> None:
        """Copy a chain's model, and load its own parameters."""
        super().__init__(model)
        self._ballast_model, self._ballast_data = model.copy(), model.createData()
        self._inertias = self._model.inertias
        self._ballast_model.armature = np.zeros(model.nv)
        self.load(inertial_parameters(model))
        self._inertial = np.zeros(PER_BODY * model.nv)
        self._bodies = list(enumerate(self._inertial.reshape(-1, PER_BODY), 1))  # views
        for joint in range(1, model.njoints):  # point masses at the joints
            self._ballast_model.inertias[joint] = pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return type(self), (self._model,), {"_pi": self._pi}

    def load(self, pi: np.ndarray) -> None:
        """Set the parameters (10 n) of all bodies; they must not change until others are set."""
        self._pi = pi
        self._c: float | None = None

    def _written(self) -> float:
        """Return c, with the parameters in the model: for a torque or a mass matrix."""
        if self._c is None:
            self._c = kernels.take(self._pi, self._inertial)
            inertias, from_pi = self._inertias, pin.Inertia.FromDynamicParameters
            for joint, pi in self._bodies:
                inertias[joint] = from_pi(pi)
        return self._c

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N], rotors included."""
        c = self._written()
        try:
            tau = pin.rnea(self._model, self._data, q, v, a)
        except ValueError as error:
            raise wrong_sizes(self._model, q, v, a) from error
        if c:
            tau -= c * pin.rnea(self._ballast_model, self._ballast_data, q, v, a)
        return tau

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), rotors included."""
        c = self._written()
        try:
            M = pin.crba(self._model, self._data, q)
        except ValueError as error:
            raise wrong_sizes(self._model, q) from error
        if c:
            M = M - c * pin.crba(self._ballast_model, self._ballast_data, q)
        return M


class VirtualChains:
    """Torque, mass matrix and regressors of virtual chains together, in the parameters a (p)."""

    def __init__(
        self, models: Sequence[pin.Model], columns: Sequence[int], armature: np.ndarray
    ) -> None:
        """Use k chains without rotors, the rotors (n), and which of 10 n k columns count.

        The columns (p) are those of the chains' regressors side by side.
        """
        self._chains = [InertialModel(model) for model in models]
        self._columns, self._armature = columns, armature

    def load(self, a_d: np.ndarray) -> None:
        """Make a_d (p) the estimate, each virtual chain with its part."""
        self._a_d = a_d
        pi = np.zeros((len(self._chains), PER_BODY * self._armature.size))
        pi.put(self._columns, a_d)
        for chain, own in zip(self._chains, pi, strict=True):
            chain.load(own)

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N], by the regressor, the fastest way."""
        return self(q, v, a).dot(self._a_d) + self._armature * a

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), rotors included."""
        return sum((chain.mass_matrix(q) for chain in self._chains), np.diag(self._armature))

    def __call__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y(q, v, a) (n, p)."""
        return self._of_base([chain(q, v, a) for chain in self._chains])

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> np.ndarray:
        """Return Y_r (n, p)."""
        return self._of_base([chain.slotine_li(q, v, v_r, a_r) for chain in self._chains])

    def momentum(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_M and Y_0 (n, p)."""
        Y_M, Y_0 = zip(*(chain.momentum(q, v) for chain in self._chains), strict=True)
        return self._of_base(Y_M), self._of_base(Y_0)

    def _of_base(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """Return the base's columns (n, p) of the chains' regressors (n, 10 n)."""
        return np.hstack(parts)[:, self._columns]
