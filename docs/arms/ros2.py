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
        rclpy.init()
        self.facts = ArmFacts.of(robot, name="ros2_control", period=2e-3)  # of its update_rate
        self.node, self.heard = rclpy.create_node("pinadapt"), []
        self.node.create_subscription(JointState, "/joint_states", self.heard.append, 1)
        self.commands = self.node.create_publisher(Float64MultiArray, f"{address}/commands", 1)

    def read(self) -> Measurement:
        self.heard.clear()
        for _ in range(10):  # callbacks, of which some are the node's own
            rclpy.spin_once(self.node, timeout_sec=0.05)
            if self.heard:
                break
        else:
            raise ArmError("no joint state came for 0.5 s.", where="/joint_states")
        said = self.heard[-1]
        t = said.header.stamp.sec + 1e-9 * said.header.stamp.nanosec
        order = [said.name.index(joint) for joint in self.facts.joints]
        return Measurement(t, np.array(said.position)[order], np.array(said.velocity)[order])

    def send(self, torque: np.ndarray) -> None:
        self.commands.publish(Float64MultiArray(data=torque.tolist()))

    def stop(self, reason: str) -> None:  # right for an arm that adds gravity; else use its brakes
        self.send(np.zeros(len(self.facts.joints)))
