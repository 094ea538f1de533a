"""What every choice of unknown dynamic parameters offers to the laws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from ..robot.robot import Robot
from .regressor import Regressor
from .translations import Translation


class Dynamics(ABC):
    """The believed dynamics of a chain at the current estimate of its unknown parameters.

    The torque is affine in the parameters, M a + C v + g = Y(q, v, a) a_d + tau_0(q, v, a), Wang
    and Xie (2009), equation (7); tau_0 holds the bodies that are not adapted and the rotor inertias
    of ``model.armature``. n: joints, p: number of parameters. ``load`` an estimate, then evaluate
    at it.

    Attributes:
        names: one name a parameter.
        size: p.
        initial: (p) values in the believed robot's own description.
        bodies: indices from 0 of the bodies whose inertias are unknown.
        translations: the unknown translations of joints that the parameters cover.
    """

    names: tuple[str, ...]
    size: int
    initial: np.ndarray
    bodies: Sequence[int] = ()
    translations: Sequence[Translation] = ()

    @abstractmethod
    def load(self, a_d: np.ndarray) -> None:
        """Make a_d (p) the estimate at which torque and mass matrix are evaluated."""

    @abstractmethod
    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N] at the loaded estimate, physical or not."""

    @abstractmethod
    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n) at the loaded estimate, physical or not."""

    @abstractmethod
    def regressor(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y (n, p), (7)."""

    @abstractmethod
    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the Slotine-Li regressor Y_r (n, p) and M a_r + C(q, v) v_r + g (n) at the loaded estimate.

        C is the matrix of Christoffel symbols, so that dM/dt - 2 C is skew-symmetric.
        """

    @abstractmethod
    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of any robot with this chain, or None when none reproduce its dynamics."""


def equivalent_parameters(
    regressor: Regressor, B: np.ndarray, robot: Robot, *, samples: int = 60, tolerance: float = 1e-8
) -> np.ndarray | None:
    """Return the vector a (p) with Y B a equal to a robot's inverse dynamics at random states, or None if there is none.

    Args:
        regressor: of the believed chain, with its own placements.
        B: (10 n, p) basis of the parameters.
        robot: whose dynamics (without friction and rotors) are to be matched.
        samples: number of random states.
        tolerance: relative residual up to which a match counts as exact.
    """
    Y, tau = _random_motion(regressor, robot, samples)
    Y = Y @ B
    a_d = np.linalg.lstsq(Y, tau, rcond=None)[0]
    residual = np.linalg.norm(Y @ a_d - tau)
    return np.asarray(a_d) if residual <= tolerance * np.linalg.norm(tau) else None


def identifiable(regressor: Regressor, B: np.ndarray, robot: Robot, *, samples: int = 60) -> int:
    """Return how many of the parameters a of pi = B a (10 n, p) the torque can tell apart: the rank of Y B."""
    Y = _random_motion(regressor, robot, samples)[0] @ B
    scale = np.linalg.norm(Y, axis=0)
    return int(np.linalg.matrix_rank(Y / np.where(scale > 0.0, scale, 1.0), tol=1e-8 * samples))


def _random_motion(
    regressor: Regressor, robot: Robot, samples: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the regressor (samples n, 10 n) and the torque (samples n) without rotors over seeded random states."""
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
