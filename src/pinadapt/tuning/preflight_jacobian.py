"""Before a simulation: is the believed Jacobian good enough for a law that does not learn it?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..controller.controller import Controller
from ..models.frame_kinematics import FrameKinematics
from ..robot.robot import Robot
from ..tasks.joint import JointTask

_GROWTH = 1e-2  # of the bandwidth


@dataclass(frozen=True)
class WrongJacobian:
    """A believed Jacobian so far from the true one that the loop about home is unstable.

    Attributes:
        law: that does not learn it.
        mismatch: how far, in parts of itself; see ``Law.mismatch``.
        borne: how far it is proved for.
        growth: of the fastest growing mode [1/s].
    """

    law: str
    mismatch: float
    borne: float
    growth: float

    def __str__(self) -> str:
        """Say how wrong it is, and what to do."""
        return (
            f"the Jacobian is believed wrong by {self.mismatch:.2g} of itself at home. The law "
            f"'{self.law}' does not learn it and is proved for {self.borne:.2g}; the loop about "
            f"home grows at {self.growth:.2g} 1/s: the arm swings about its set point or leaves. "
            "Measure the tool, or take the law 'separation', which learns it."
        )


def jacobian_finding(controller: Controller, true: Robot) -> WrongJacobian | None:
    """Return how wrong the believed Jacobian is at the home of a true robot, if it is too wrong.

    Only a simulation can tell: it takes the true robot. The loop is linearised at rest in a set
    point at home, with the true mass matrix and Jacobian and the torque Z a_d as a state of its
    own: M qdd = z - J_hat^T K_P J dq - K_v qd, dz/dt = -Z Gamma Z^T y.
    """
    kinematics, law = controller.kinematics, controller.law
    if not law.set_point or isinstance(true.task, JointTask):
        return None
    rest = np.zeros(kinematics.nv)
    kinematics.update(kinematics.initial, true.q0, rest)
    truth = FrameKinematics(true)
    truth.update(truth.initial, true.q0, rest)
    J_hat, J = kinematics.J, truth.J
    found, loop, motion = law.mismatch(J_hat, J), law.set_point_loop(J_hat, J), controller.motion
    if found is None or loop is None or motion is None or found[0] <= found[1]:
        return None
    n, M = kinematics.nv, pin.crba(true.model, true.model.createData(), true.q0)
    Z = controller.dynamics.regressor(true.q0, rest, rest)
    gain = controller.adaptation_d.gain_times(controller.dynamics.initial, Z.T)
    G, one, none = Z @ gain, np.eye(n), np.zeros((n, n))
    A = np.block(
        [
            [none, one, none],
            [
                -np.linalg.solve(M, loop.stiffness),
                -np.linalg.solve(M, loop.damping),
                np.linalg.inv(M),
            ],
            [-G @ loop.drive, -G, none],
        ]
    )
    growth = float(np.linalg.eigvals(A).real.max())
    if growth <= _GROWTH * motion.bandwidth:
        return None
    return WrongJacobian(law.name, *found, growth)
