"""Bodies and joints together: blocks of dynamic parameters, Y = [Y_bodies Y_joints]."""

from __future__ import annotations

import numpy as np

from ..robot.robot import Robot
from .dynamics import Dynamics
from .joint_effects import JointEffects, without_joint_effects
from .momentum import Momentum


class StackedDynamics(Dynamics):
    """Inertial parameters (of bodies, a basis, ...) followed by those of the joints.

    The inertial block must be made for the robot ``without_joint_effects``; all rotors and friction
    are in the joint block, whose coefficients are adapted or known. In the Slotine-Li regressor the
    joints' columns take v_r and a_r, so that viscous and Coulomb friction only add to the
    dissipation.

    Attributes:
        inertial, joint: the two blocks.
    """

    def __init__(self, inertial: Dynamics, joint: JointEffects) -> None:
        """Stack the two blocks."""
        self.inertial, self.joint = inertial, joint
        self.names = (*inertial.names, *joint.names)
        self.size = inertial.size + joint.size
        self.initial = np.concatenate([inertial.initial, joint.initial])
        self.bodies, self.translations = inertial.bodies, inertial.translations
        self.lumped = inertial.lumped

    def load(self, a_d: np.ndarray) -> None:
        """Give each block its part of the estimate a_d (p)."""
        self.inertial.load(a_d[: self.inertial.size])
        self.joint.load(a_d[self.inertial.size :])

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g + friction (n)."""
        return self.joint.torque(v, a, self.inertial.torque(q, v, a))

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), rotors included."""
        M = self.inertial.mass_matrix(q)
        M.flat[:: len(M) + 1] += self.joint.armature
        return M

    def regressor(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y (n, p)."""
        return self.joint.regressor(v, a, self.inertial.regressor(q, v, a))

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_r (n, p) and the torque it gives (n), known parts included."""
        Y, tau = self.inertial.slotine_li(q, v, v_r, a_r)
        return self.joint.regressor(v_r, a_r, Y), self.joint.torque(v_r, a_r, tau)

    def momentum(self, q: np.ndarray, v: np.ndarray) -> Momentum:
        """Return the torque as rate of the momentum and a rest, rotors in the one, friction not."""
        return self.joint.momentum(v, self.inertial.momentum(q, v))

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of any robot with this chain, None where a block has none."""
        inertial, joint = self.inertial.value(without_joint_effects(robot)), self.joint.value(robot)
        return None if inertial is None or joint is None else np.concatenate([inertial, joint])

    def robot(self, a_d: np.ndarray, believed: Robot) -> Robot:
        """Return the believed robot with the bodies and joints that a_d (p) states.

        Raises:
            ParameterError: as the inertial block.
        """
        size = self.inertial.size
        return self.joint.robot(a_d[size:], self.inertial.robot(a_d[:size], believed))

    def moved(self, a_d: np.ndarray, before: Robot, after: Robot) -> np.ndarray | None:
        """Return the estimate (p) once another load is announced; the joints keep theirs."""
        size, bare = self.inertial.size, (without_joint_effects(robot) for robot in (before, after))
        inertial = self.inertial.moved(a_d[:size], *bare)
        return None if inertial is None else np.concatenate([inertial, a_d[size:]])
