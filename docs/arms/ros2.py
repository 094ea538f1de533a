"""An arm of ros2_control: ``pinadapt drive docs/arms/ros2.py:RosArm /arm_controller ...``.

UNTESTED on a real controller manager: run against a stand-in with the same calls.
"""

import numpy as np
import rclpy
from rclpy.parameter import parameter_value_to_python as value_of
from rclpy.parameter_client import AsyncParameterClient
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from pinadapt import Measurement, Robot
from pinadapt.exceptions import ArmError
from pinadapt.realtime import Arm, ArmFacts


class RosArm(Arm):
    """Reads /joint_states, and sends efforts to a joint_trajectory_controller with a timeout."""

    def __init__(self, address: str, robot: Robot) -> None:
        rclpy.init()
        self.node, self.heard, self.begun = rclpy.create_node("pinadapt"), [], False
        joints = robot.joint_names
        (rate,) = self.asked("/controller_manager", "update_rate")
        kinds, timeout, least, moving, *damping = self.asked(
            address,
            "command_interfaces",
            "cmd_timeout",
            "constraints.goal_time",
            "allow_nonzero_velocity_at_trajectory_end",
            *(f"gains.{each}.d" for each in joints),
        )
        if list(kinds) != ["effort"] or not (moving and timeout > least and min(damping) > 0.0):
            words = "refuses efforts, or keeps the last one or holds undamped if this program dies."
            raise ArmError(words, where=address, hint="Its parameters are above this example.")
        self.facts = ArmFacts.of(robot, name=address, period=1.0 / rate)
        self.node.create_subscription(JointState, "/joint_states", self.heard.append, 1)
        self.points = self.node.create_publisher(JointTrajectory, f"{address}/joint_trajectory", 1)

    def asked(self, node: str, *names: str) -> list:
        client = AsyncParameterClient(self.node, node)
        if client.wait_for_services(2.0):
            future = client.get_parameters(list(names))
            rclpy.spin_until_future_complete(self.node, future, timeout_sec=2.0)
            if future.done() and len(values := future.result().values) == len(names):
                return [value_of(each) for each in values]
        raise ArmError(f"does not run, or has not {', '.join(names)}.", where=node)

    def read(self) -> Measurement:
        self.heard.clear()
        for _ in range(10):  # callbacks, of which some are the node's own
            rclpy.spin_once(self.node, timeout_sec=0.05)
            if self.heard and set(self.facts.joints) <= set(self.heard[-1].name):
                break
        else:
            raise ArmError("no joint state came for 0.5 s.", where="/joint_states")
        said = self.heard[-1]
        t = said.header.stamp.sec + 1e-9 * said.header.stamp.nanosec
        found = []
        for values in (said.position, said.velocity, said.effort):  # empty where not measured
            of = dict(zip(said.name, values, strict=False))
            found.append(np.array([of.get(joint, np.nan) for joint in self.facts.joints]))
        q, v, tau = found
        if np.isfinite([q, v]).all():
            self.q, self.v = q, v
        return Measurement(t, q, v, tau=tau if np.isfinite(tau).all() else None)

    def begin(self) -> None:
        self.begun = True

    def send(self, torque: np.ndarray) -> None:
        """Its gains add to the effort what q and v change until the controller's next cycle."""
        point = JointTrajectoryPoint(
            positions=self.q.tolist(), velocities=self.v.tolist(), effort=torque.tolist()
        )
        self.points.publish(JointTrajectory(joint_names=list(self.facts.joints), points=[point]))

    def stop(self, reason: str) -> None:
        """Hold the place by the controller's gains, as it does by itself after its timeout."""
        if self.begun:
            self.begun, self.v = False, np.zeros(len(self.facts.joints))
            self.send(self.v)

    def close(self) -> None:
        self.node.destroy_node()
        rclpy.shutdown()
