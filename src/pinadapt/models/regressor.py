"""The regressor of all ten parameters of every body, from Pinocchio, and its Slotine-Li form."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy import empty

from .._kernels import models as kernels
from .._kernels.models import PER_BODY as PER_BODY
from .momentum import MomentumRegressor

LABELS = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")


class Regressor:
    """Y (n, 10 n): M a + C v + g = Y pi, pi the stacked ``toDynamicParameters`` of the bodies.

    It leaves out rotor inertias (``model.armature``) and friction. It contains the placements of
    the joints, which must be the true ones.
    """

    def __init__(self, model: pin.Model) -> None:
        """Copy a chain's model; its inertias do not matter."""
        self._model, self._weightless = model.copy(), model.copy()
        self._weightless.gravity.linear = np.zeros(3)
        self._data = self._model.createData()  # scratch for both
        self._zero = np.zeros(model.nv)
        self._shape = (model.nv, PER_BODY * model.nv)  # Pinocchio returns a single row as a vector

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by what it was made from: Pinocchio's data is scratch."""
        return Regressor, (self._model,)

    def __call__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y(q, v, a) (n, 10 n)."""
        Y = pin.computeJointTorqueRegressor(self._model, self._data, q, v, a)
        return Y if Y.ndim == 2 else Y.reshape(self._shape)

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> np.ndarray:
        """Return Y (n, 10 n) with M a_r + C(q, v) v_r + g = Y pi, C the Christoffel matrix.

        C(q, u) w is bilinear and symmetric in u and w, so polarisation gives it in two calls:
        Y(q, (v + v_r)/2, a_r) - Y0(q, (v - v_r)/2, 0), Y0 without gravity.
        """
        return self.slotine_li_torque(np.zeros(self._shape[1]), q, v, v_r, a_r)[0]

    def slotine_li_torque(
        self, pi: np.ndarray, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Y (n, 10 n) as ``slotine_li``, and the torque Y pi (n) at parameters pi (10 n)."""
        mean, half, tau = empty(v.size), empty(v.size), empty(v.size)
        kernels.polarise(v, v_r, mean, half)
        Y = pin.computeJointTorqueRegressor(self._model, self._data, q, mean, a_r)
        Y_0 = pin.computeJointTorqueRegressor(self._weightless, self._data, q, half, self._zero)
        if Y.ndim == 1:
            Y, Y_0 = Y.reshape(self._shape), Y_0.reshape(self._shape)
        kernels.polarised(Y_0, pi, Y, tau)
        return Y, tau

    def momentum(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_M and Y_0 (n, 10 n): M a + C v + g = d/dt (Y_M pi) + Y_0 pi."""
        return self._momentum(q, v)

    @cached_property
    def _momentum(self) -> MomentumRegressor:
        return MomentumRegressor(self._model)


def inertial_parameters(model: pin.Model) -> np.ndarray:
    """Return pi (10 n), the stacked ten parameters of all moving bodies."""
    return np.concatenate([inertia.toDynamicParameters() for inertia in model.inertias[1:]])
