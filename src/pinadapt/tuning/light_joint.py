"""A joint too light for an unknown load under a law that commands accelerations.

Such a law answers an error with M_hat times an acceleration. A joint that is believed to move next
to no inertia then gets next to no torque, whatever the gains, and the weight of a load off its axis
turns it away before the adaptation has learned it. The theorems allow that: V bounds the error by
what is not known, and that is much where the truth is many times the belief.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..laws.acceleration_law import AccelerationLaw
from ..laws.law import Law
from ..models.typical_motion import TypicalMotion
from ..robot.workspace import rounded_down

_LOAD, _ARM = 0.1, 0.05  # of the robot's mass, of its reach off the axis: such a load ...
_ANGLE = 0.25  # [rad] ... turns no joint further than this against its position feedback


@dataclass(frozen=True)
class LightJoint:
    """A revolute joint that a load would turn away.

    The load is a tenth of the robot's mass, a twentieth of its reach off the axis.

    Attributes:
        joint: its name.
        inertia: what it is believed to move, the least over a typical motion [kg m^2].
        load: the largest load that it bears [kg].
        arm: at this distance from its axis [m].
    """

    joint: str
    inertia: float
    load: float
    arm: float

    def __str__(self) -> str:
        """Say what is light, what it bears, and what to do."""
        return (
            f"{self.joint} is believed to move only {self.inertia:.2g} kg m^2, and this law's "
            "feedback is that times an acceleration: an unknown load above "
            f"{rounded_down(self.load):.2g} kg, {1e3 * self.arm:.0f} mm off its axis, can spin it "
            "before it is learned. With such a load take the law 'separation', whose gains "
            "are torques, or believe in it from the start, its inertia included (Robot.changed, "
            "belief.payload)."
        )


def lightest_joint(motion: TypicalMotion, law: Law) -> LightJoint | None:
    """Return the joint that bears least, or None where all bear enough.

    None too where the law's gains are forces or the last body is known.

    At each state of the typical motion, the weight of the load at its distance from a joint's axis
    is divided by the believed inertia M_jj and by the least position gain: the angle at which the
    feedback balances it. On the catalogue, with 30 % wrong inertias and loads of at most the last
    body's mass, law (11) of Wang and Xie lost four joints, all of them told of here.
    """
    believed, dynamics = motion.robot, motion.dynamics
    model, n = believed.model, believed.model.nv
    if not isinstance(law, AccelerationLaw) or not law.adapts or n - 1 not in dynamics.bodies:
        return None
    rows, arm = believed.task.groups[0].rows, _ARM * believed.reach
    stiffness, data = float(np.linalg.eigvalsh(law.K_P[rows, rows])[0]), model.createData()
    angles, inertias = [], []  # (N, n) per kilogram of load, and M_jj
    for q, M in zip(motion.states.q, motion.mass_matrices, strict=True):
        inertia = np.diag(M)
        J = pin.computeJointJacobians(model, data, q).reshape(6, n)
        weight = np.linalg.norm(np.cross(J[3:].T, model.gravity.linear), axis=1)  # zero for slides
        floor = np.finfo(float).eps * inertia.max()
        angles.append(weight * arm / (np.maximum(inertia, floor) * stiffness))
        inertias.append(inertia)
    largest = np.max(angles, axis=0)
    j = int(np.argmax(largest))
    if _LOAD * pin.computeTotalMass(model) * largest[j] <= _ANGLE:
        return None
    least, load = float(np.min(inertias, axis=0)[j]), _ANGLE / float(largest[j])
    return LightJoint(believed.joint_names[j], least, load, arm)
