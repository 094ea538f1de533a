"""Unknown parameters that enter through the ten inertial parameters of each body."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import Any

import numpy as np

from ..robot.robot import Robot
from .dynamics import Dynamics
from .inertial_model import InertialModel
from .momentum import Momentum
from .regressor import Regressor, inertial_parameters


class InertialDynamics(Dynamics):
    """Parameters a_d with pi (10 n), the stack of ten parameters a body, affine in a_d.

    Torque and mass matrix come from Pinocchio's RNEA and CRBA on a private model, the regressor
    from its joint torque regressor. Subclasses say how pi follows from a_d and what that does to
    the regressor's columns.
    """

    def __init__(self, robot: Robot) -> None:
        """Copy what is believed of the robot."""
        self._believed = InertialModel(robot.model)
        self._regressor = Regressor(robot.model)
        self._armature = np.array(robot.model.armature)
        self._rotors = bool(self._armature.any())
        self._pi = inertial_parameters(robot.model)
        self._gravity = np.array(robot.model.gravity.linear)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Load the estimate into a copied model, whose own one is scratch."""
        self.__dict__.update(state)
        self._believed.load(self._pi)

    def shares_the_rest(self, robot: Robot) -> bool:
        """Tell whether rotors and gravity are as believed and the joints free of friction."""
        rotors = np.allclose(robot.model.armature, self._armature)
        return (
            not robot.friction.present
            and rotors
            and np.allclose(robot.model.gravity.linear, self._gravity)
        )

    @abstractmethod
    def expand(self, a_d: np.ndarray) -> np.ndarray:
        """Return pi (10 n) at parameters a_d (p)."""

    @abstractmethod
    def reduce(self, Y: np.ndarray) -> np.ndarray:
        """Return the regressor (n, p) of a_d from that of pi, Y (n, 10 n)."""

    def load(self, a_d: np.ndarray) -> None:
        """Write the estimate a_d (p) into the private model."""
        self._pi = self.expand(a_d)
        self._believed.load(self._pi)

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) by RNEA."""
        return self._believed.torque(q, v, a)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n) by CRBA."""
        return self._believed.mass_matrix(q)

    def regressor(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y (n, p)."""
        return self.reduce(self._regressor(q, v, a))

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_r (n, p) and the torque it gives (n), known bodies and rotors included."""
        Y, tau = self._regressor.slotine_li_torque(self._pi, q, v, v_r, a_r)
        return self.reduce(Y), tau + self._armature * a_r if self._rotors else tau

    def momentum(self, q: np.ndarray, v: np.ndarray) -> Momentum:
        """Return the torque as rate of the momentum and a rest, known bodies and rotors included.

        See ``MomentumRegressor`` for its source.
        """
        Y_M, Y_0 = self._regressor.momentum(q, v)
        p_0, known = self._armature * v, self._known
        if not known.any():
            return Momentum(self.reduce(Y_M), self.reduce(Y_0), p_0, np.zeros(v.size))
        return Momentum(self.reduce(Y_M), self.reduce(Y_0), p_0 + Y_M.dot(known), Y_0.dot(known))

    @cached_property
    def _known(self) -> np.ndarray:
        """The part of pi (10 n) that no parameter changes."""
        return self.expand(np.zeros(self.size))
