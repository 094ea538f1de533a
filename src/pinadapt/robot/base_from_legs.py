"""Where the base of a robot is that stands, by an IMU and the joints of its legs."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from .._checks import vector
from ..exceptions import RobotError
from ..tasks.task import Moving
from .constraints import Constraints
from .robot import Robot

# [m] above the lowest foot: in the air. Half and twice: an A1 with 14 bits and an IMU that is off
# by 0.3 deg drifts by 2.0 and 7.3 mm in four steps in place of 3.2; that IMU shows standing feet
# that are 0.7 m apart at heights that differ by 4 mm
_LIFTED = 5e-3


class BaseFromLegs:
    """Position, yaw and velocity of a free base, the feet that stand being at rest on level ground.

    An IMU gives roll and pitch, and their rates. Position and yaw are those at which the feet are
    nearest to where each has stood since it came down (least squares); velocity and yaw rate those
    at which they move least. Nothing else tells where the robot is, so errors of the footholds add
    up over steps.

    Attributes:
        footholds: (c, 3) where the feet stand in world axes [m].
    """

    def __init__(self, robot: Robot) -> None:
        """Begin at the home pose of a robot that stands on point feet.

        Raises:
            RobotError: it has fewer than three, or soles.
        """
        contacts = robot.contacts
        if len(contacts) < 3 or any(contact.sole is not None for contact in contacts):
            raise RobotError("legs tell where a base is by three point feet.", where="contacts")
        self._contacts = Constraints(robot.model, contacts)
        self._stood = np.ones(len(contacts), dtype=bool)
        self._contacts.jacobian(robot.q0)
        self.footholds = self._contacts.feet

    def __call__(self, q: np.ndarray, v: np.ndarray, tilt: np.ndarray, rates: np.ndarray) -> Moving:
        """Return q (nq) and v (n) with the base's coordinates of this sample.

        Args:
            q: (nq) with measured joints; the first six are not read.
            v: (n) with measured velocities of the joints [rad/s]; the first six are not read.
            tilt: pitch and roll (2) [rad].
            rates: of pitch and roll (2) [rad/s].
        """
        q = q.copy()
        v = v.copy()
        q[:4] = v[:4] = 0.0
        q[4:6] = vector(tilt, 2, "tilt")
        v[4:6] = vector(rates, 2, "rates")
        A = self._contacts.jacobian(q)
        feet = self._contacts.feet
        stands = feet[:, 2] < feet[:, 2].min() + _LIFTED
        both = stands & self._stood
        # the angle that turns the feet x + iy onto the footholds, about their middles
        a, b = (at[both, 0] + 1j * at[both, 1] for at in (feet, self.footholds))
        q[3] = np.angle(np.vdot(a - a.mean(), b - b.mean()))
        R = pin.rpy.rpyToMatrix(0.0, 0.0, q[3])
        turned = feet @ R.T
        q[:3] = (self.footholds - turned)[both].mean(axis=0)
        landed = stands & ~self._stood
        self.footholds[landed, :2] = (turned + q[:3])[landed, :2]  # on level ground
        self._stood = stands
        A = A[self._contacts.holding(stands)]
        v[:4] = np.linalg.lstsq(A[:, :4], -A @ v, rcond=None)[0]
        v[:3] = R @ v[:3]
        return q, v
