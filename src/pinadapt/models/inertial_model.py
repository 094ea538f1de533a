"""Torque and mass matrix of a chain for any inertial parameters, physical or not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from .._kernels import models as kernels
from ..exceptions import ParameterError
from ..robot.chain import is_slide
from .inertia_memory import inertia_memory
from .regressor import PER_BODY

_ONE_KILOGRAM = np.eye(PER_BODY)[0]  # at the joint


class InertialModel:
    """A private model whose ten parameters a body may be any numbers.

    RNEA and CRBA are linear in the parameters pi, but ``pin.Inertia`` cannot hold a body without
    mass and CRBA cannot add bodies whose masses sum to less than nothing. Where a mass is not
    positive, a ballast u of one kilogram a body is added c times and its effect taken off again:
    M(pi) = M(pi + c u) - c M(u), exact for every pi. Of a chain of revolute joints the ballast has
    no effect, see ``_unfelt_ballast``.
    """

    def __init__(self, model: pin.Model) -> None:
        """Copy a chain's model."""
        self._model, self._ballast_model = model.copy(), model.copy()
        self._data, self._ballast_data = self._model.createData(), self._ballast_model.createData()
        self._memory = inertia_memory(self._model)
        self._inertias, self._tens = self._model.inertias, np.zeros((model.nv, PER_BODY))
        self._bodies = list(enumerate(self._tens, 1))  # joint and live row of ten parameters
        slides = any(is_slide(joint) for joint in model.joints[1:])
        self._ballast = np.tile(_ONE_KILOGRAM, model.nv) if slides else _unfelt_ballast(model)
        for joint, ten in enumerate(self._ballast.reshape(-1, PER_BODY), 1):
            self._ballast_model.inertias[joint] = pin.Inertia.FromDynamicParameters(ten)
        self._ballast_model.armature = np.zeros(model.nv)
        self._c, self._felt = 0.0, slides

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by what it was made from: Pinocchio's data is scratch."""
        return type(self), (self._model,)

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
        if self._memory is not None:
            self._c = kernels.write_inertias(pi, self._ballast, self._memory)
            return
        self._c = kernels.take(pi, self._ballast, self._tens)
        for joint, ten in self._bodies:
            self._inertias[joint] = pin.Inertia.FromDynamicParameters(ten)

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N], rotors included."""
        tau = pin.rnea(self._model, self._data, q, v, a)
        if self._felt and self._c:
            tau -= self._c * pin.rnea(self._ballast_model, self._ballast_data, q, v, a)
        return tau

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), rotors included."""
        M = pin.crba(self._model, self._data, q)
        if self._felt and self._c:
            M = M - self._c * pin.crba(self._ballast_model, self._ballast_data, q)
        return M


def _unfelt_ballast(model: pin.Model) -> np.ndarray:
    """Return parameters (10 n) of one kilogram a body that no joint of revolute ones feels.

    A point mass on a joint's axis may belong to either of the two bodies, so one added to the body
    after the joint and taken off the body before it changes nothing; of the first joint the body
    before is the base.
    """
    n = model.nv
    ballast = np.zeros((n, PER_BODY))
    for body in range(n):
        moved = n - body
        ballast[body] += moved * _ONE_KILOGRAM
        if body:
            at = pin.Inertia(1.0, model.jointPlacements[body + 1].translation, np.zeros((3, 3)))
            ballast[body - 1] -= moved * at.toDynamicParameters()
    return ballast.ravel()
