"""A Universal Robot: ``pinadapt drive docs/arms/ur.py:UniversalRobot ADDRESS --scenario ...``.

UNTESTED on any robot: written for the published interface of ``ur-rtde`` (``pip install ur-rtde``,
``directTorque``, PolyScope 5.23 or 10.10 and later), run against a stand-in with the same calls.
The robot adds gravity, with its configured payload, and friction: `compensated = "nominal"`,
`dt = 0.002`. `directTorque` takes other options in each version; its defaults are used here.
"""

import numpy as np
import rtde_control
import rtde_receive

from pinadapt import Measurement, Robot
from pinadapt.exceptions import ArmError
from pinadapt.realtime import Arm, ArmFacts
from pinadapt.robot import Gravity

RATE = 500.0  # [Hz]


class UniversalRobot(Arm):
    """A UR e-series arm in torque control."""

    def __init__(self, address: str, robot: Robot) -> None:
        """Connect."""
        self.facts = ArmFacts.of(
            robot,
            name=f"UR at {address}",
            period=1.0 / RATE,
            paced=False,  # the loop keeps the time; the time stamps are the robot's
            compensation=Gravity(robot),
        )
        self.receive = rtde_receive.RTDEReceiveInterface(address, RATE)
        self.control = rtde_control.RTDEControlInterface(address, RATE)

    def read(self) -> Measurement:
        """Return the latest state."""
        if not self.receive.isConnected():
            raise ArmError("the connection broke.", where=self.facts.name)
        if self.receive.isProtectiveStopped() or self.receive.isEmergencyStopped():
            raise ArmError("is stopped: protective or emergency stop.", where=self.facts.name)
        q, v = self.receive.getActualQ(), self.receive.getActualQd()
        return Measurement(self.receive.getTimestamp(), np.array(q), np.array(v))

    def send(self, torque: np.ndarray) -> None:
        """Send a torque (6) [N m], without gravity."""
        if not self.control.directTorque(torque.tolist()):
            raise ArmError("refuses a torque.", where=self.facts.name)

    def stop(self, reason: str) -> None:
        """End the script on the robot, which then brakes."""
        self.control.stopScript()

    def close(self) -> None:
        """Give the connections back."""
        self.control.disconnect()
        self.receive.disconnect()
