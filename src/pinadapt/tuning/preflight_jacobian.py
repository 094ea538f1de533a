"""Before the run: is the believed Jacobian good enough for a law that does not learn it?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..controller.controller import Controller
from ..models.frame_kinematics import FrameKinematics
from ..robot.robot import Robot
from ..tasks.joint import JointTask


@dataclass(frozen=True)
class WrongJacobian:
    """A believed Jacobian too far from the true one at home.

    Attributes:
        law: that does not learn it.
        mismatch: how far, in parts of itself; see ``Law.mismatch``.
        borne: how far it may be.
    """

    law: str
    mismatch: float
    borne: float

    def __str__(self) -> str:
        """Say how wrong it is, and what to do."""
        return (
            f"the Jacobian is believed wrong by {self.mismatch:.2g} of itself at home, and "
            f"'{self.law}', which does not learn it, is proved for {self.borne:.2g}: the arm may "
            "swing about its set point or leave it. Measure the tool, or take the law "
            "'separation', which learns it."
        )


def jacobian_finding(controller: Controller, true: Robot) -> WrongJacobian | None:
    """Return how wrong the believed Jacobian is at the home of a true robot, if it is too wrong.

    Only a simulation can tell: it takes the true robot. Where the estimates start elsewhere than
    believed, those count that are believed.
    """
    kinematics, law = controller.kinematics, controller.law
    if not law.set_point or isinstance(true.task, JointTask):
        return None
    rest = np.zeros(kinematics.nv)
    kinematics.update(kinematics.initial, true.q0, rest)
    truth = FrameKinematics(true)
    truth.update(truth.initial, true.q0, rest)
    found = law.mismatch(kinematics.J, truth.J)
    if found is None or found[0] <= found[1]:
        return None
    return WrongJacobian(law.name, *found)
