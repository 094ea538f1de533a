"""An arm of ros2_control: ``pinadapt drive docs/arms/ros2.py:RosArm /effort_controller ...``."""

import numpy as np
import rclpy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from pinadapt import Measurement, Robot
from pinadapt.exceptions import ArmError
from pinadapt.realtime import Arm, ArmFacts


class RosArm(Arm):
    """Reads /joint_states, and writes the commands of a forward_command_controller of efforts."""

    def __init__(self, address: str, robot: Robot) -> None:
        """Take the name of the controller and the robot."""
        rclpy.init()
        self.facts = ArmFacts.of(robot, name="ros2_control", period=2e-3)  # of its update_rate
        self.node, self.heard = rclpy.create_node("pinadapt"), None
        self.node.create_subscription(JointState, "/joint_states", self.hear, 1)
        self.commands = self.node.create_publisher(Float64MultiArray, f"{address}/commands", 1)

    def hear(self, message: JointState) -> None:
        """Keep the latest message."""
        self.heard = message

    def read(self) -> Measurement:
        """Wait for the next message."""
        self.heard = None
        rclpy.spin_once(self.node, timeout_sec=0.5)
        if self.heard is None:
            raise ArmError("no joint state came for 0.5 s.", where="/joint_states")
        order = [list(self.heard.name).index(joint) for joint in self.facts.joints]
        q, v = np.array(self.heard.position)[order], np.array(self.heard.velocity)[order]
        stamp = self.heard.header.stamp
        return Measurement(stamp.sec + 1e-9 * stamp.nanosec, q, v)

    def send(self, torque: np.ndarray) -> None:
        """Publish the efforts (n) [N m or N]."""
        self.commands.publish(Float64MultiArray(data=torque.tolist()))

    def stop(self, reason: str) -> None:
        """Publish zeros: right for an arm that adds gravity; engage the brakes of another here."""
        self.send(np.zeros(len(self.facts.joints)))
