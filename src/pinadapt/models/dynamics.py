"""What every choice of unknown dynamic parameters offers to the laws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from ..exceptions import InputError, ParameterError
from ..robot.robot import Robot
from .joint_effects import JointEffects, without_joint_effects
from .regressor import Momentum
from .translations import Translation


class Dynamics(ABC):
    """The estimated dynamics of a chain, linear in its unknown parameters.

    The torque is affine in the parameters, M a + C v + g = Y(q, v, a) a_d + tau_0(q, v, a), Wang
    and Xie (2009), equation (7); tau_0 holds the bodies that are not adapted and the rotor inertias
    of ``model.armature``. n: joints, p: number of parameters. ``load`` an estimate, then evaluate
    at it.

    The parameters stand in two blocks: first ``inertial``, those of bodies, then ``joints``, the
    coefficients of rotors and friction. Most dynamics have the first block alone.

    Attributes:
        names: one name a parameter.
        size: p.
        initial: (p) values in the description of the nominal robot.
        bodies: indices from 0 of the bodies whose inertias are unknown.
        per_body: whether the inertial parameters are the ten of each of ``bodies``, one body after
            the other, so that bodies follow from them; else they are combinations of such.
        translations: the unknown translations of joints that the parameters cover.
        joints: the block of the joints' coefficients; None: rotors are as described, and there is
            no friction.
    """

    names: tuple[str, ...]
    size: int
    initial: np.ndarray
    bodies: Sequence[int] = ()
    per_body: bool = False
    translations: Sequence[Translation] = ()
    joints: JointEffects | None = None

    @property
    def inertial(self) -> Dynamics:
        """The block of the inertial parameters, as dynamics of the robot that ``bare`` returns."""
        return self

    def bare(self, robot: Robot) -> Robot:
        """Return a robot without what the block ``joints`` states of it."""
        return robot

    @property
    def typical(self) -> np.ndarray:
        """Values (p) to be expected: ``initial``, and typical coefficients of the joints."""
        return self.initial

    @property
    def units(self) -> tuple[str, ...]:
        """One unit a parameter; empty for combinations of parameters."""
        return ("",) * self.size

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
        """Return Y_r (n, p) of Slotine and Li, and M a_r + C(q, v) v_r + g (n) at the estimate.

        C is the matrix of Christoffel symbols, so that dM/dt - 2 C is skew-symmetric.
        """

    def momentum(self, q: np.ndarray, v: np.ndarray) -> Momentum:
        """Return the torque as rate of the momentum and a rest, in which there is no acceleration.

        M a + C v + g = d/dt (Y_M a_d + p_0) + Y_0 a_d + tau_0, whatever estimate is loaded.

        Raises:
            InputError: these dynamics do not state it.
        """
        raise InputError(
            f"{type(self).__name__} does not state the momentum, from which the prediction of the "
            "torque comes.",
            where="adaptation",
            hint="Override Dynamics.momentum, or take an adaptation that does not predict.",
        )

    @abstractmethod
    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of any robot with this chain, None when none reproduce it."""

    def robot(self, a_d: np.ndarray, believed: Robot) -> Robot:
        """Return the believed robot with the parameters a_d (p) in place of its own.

        Raises:
            ParameterError: no bodies have these parameters.
        """
        if not self.size:
            return believed
        raise ParameterError(
            f"no bodies follow from the {self.size} parameters, which are lumped.",
            where="learned",
            hint="Their values can be kept, see LearnedParameters.",
        )

    def moved(self, a_d: np.ndarray, before: Robot, after: Robot) -> np.ndarray | None:
        """Return an estimate (p) once the last body is announced to carry another load.

        Args:
            a_d: (p) the estimate until now.
            before: the robot as described, with the load it was announced to carry until now.
            after: the same with the load it carries from now on.

        Returns:
            The estimate moved by the difference of the two, exact as the parameters are affine in
            the inertias; None where they cannot express the load.
        """
        old, new = self.value(before), self.value(after)
        return None if old is None or new is None else a_d + (new - old)


class StackedDynamics(Dynamics):
    """Inertial parameters (of bodies, a basis, ...) followed by those of the joints.

    The inertial block must be made for the robot ``without_joint_effects``; all rotors and friction
    are in the joint block, whose coefficients are adapted or known. In the Slotine-Li regressor the
    joints' columns take v_r and a_r, so that viscous and Coulomb friction only add to the
    dissipation.

    """

    joints: JointEffects

    def __init__(self, inertial: Dynamics, joints: JointEffects) -> None:
        """Stack the two blocks."""
        self._inertial, self.joints = inertial, joints
        self.names = (*inertial.names, *joints.names)
        self.size = inertial.size + joints.size
        self.initial = np.concatenate([inertial.initial, joints.initial])
        self.bodies, self.per_body = inertial.bodies, inertial.per_body
        self.translations = inertial.translations

    @property
    def inertial(self) -> Dynamics:
        """The block of the inertial parameters, as dynamics of a robot without joint effects."""
        return self._inertial

    def bare(self, robot: Robot) -> Robot:
        """Return a robot without rotors and friction."""
        return without_joint_effects(robot)

    @property
    def typical(self) -> np.ndarray:
        """Values (p) to be expected: typical coefficients of the joints."""
        return np.concatenate([self._inertial.typical, self.joints.typical])

    @property
    def units(self) -> tuple[str, ...]:
        """One unit a parameter."""
        return (*self._inertial.units, *self.joints.units)

    def load(self, a_d: np.ndarray) -> None:
        """Give each block its part of the estimate a_d (p)."""
        self._inertial.load(a_d[: self._inertial.size])
        self.joints.load(a_d[self._inertial.size :])

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g + friction (n)."""
        return self.joints.torque(v, a, self._inertial.torque(q, v, a))

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), rotors included."""
        M = self._inertial.mass_matrix(q)
        M.flat[:: len(M) + 1] += self.joints.armature
        return M

    def regressor(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y (n, p)."""
        return self.joints.regressor(v, a, self._inertial.regressor(q, v, a))

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_r (n, p) and the torque it gives (n), known parts included."""
        Y, tau = self._inertial.slotine_li(q, v, v_r, a_r)
        return self.joints.regressor(v_r, a_r, Y), self.joints.torque(v_r, a_r, tau)

    def momentum(self, q: np.ndarray, v: np.ndarray) -> Momentum:
        """Return the torque as rate of the momentum and a rest, rotors in the one, friction not."""
        return self.joints.momentum(v, self._inertial.momentum(q, v))

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of any robot with this chain, None where a block has none."""
        inertial, joints = self._inertial.value(self.bare(robot)), self.joints.value(robot)
        return None if inertial is None or joints is None else np.concatenate([inertial, joints])

    def robot(self, a_d: np.ndarray, believed: Robot) -> Robot:
        """Return the believed robot with the bodies and joints that a_d (p) states.

        Raises:
            ParameterError: as the inertial block.
        """
        size = self._inertial.size
        return self.joints.robot(a_d[size:], self._inertial.robot(a_d[:size], believed))

    def moved(self, a_d: np.ndarray, before: Robot, after: Robot) -> np.ndarray | None:
        """Return the estimate (p) once another load is announced; the joints keep theirs."""
        size, bare = self._inertial.size, (self.bare(robot) for robot in (before, after))
        inertial = self._inertial.moved(a_d[:size], *bare)
        return None if inertial is None else np.concatenate([inertial, a_d[size:]])
