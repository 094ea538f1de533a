"""A ROS 2 node that publishes the load of an arm: ``python ros2_load.py my_robot.urdf``.

It reads /joint_states with efforts in N m, and publishes ``InertiaStamped`` on /load ten times a
second, in the axes of the task frame. UNTESTED with ROS itself: run against a stand-in.
"""

import sys

import rclpy
from geometry_msgs.msg import InertiaStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState

import pinadapt as pa
from pinadapt.exceptions import MeasurementError

NAMES = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")


class LoadNode(Node):
    """Feeds an estimator with joint states."""

    def __init__(self, urdf: str, period: float = 0.01) -> None:
        """Load the robot and subscribe; ``period`` is that of the joint states [s]."""
        super().__init__("load")
        self.robot, self.state = pa.load(urdf), None
        self.estimator = pa.Estimator(self.robot, unknown="payload", period=period)
        self.publisher = self.create_publisher(InertiaStamped, "/load", 1)
        self.create_subscription(JointState, "/joint_states", self.heard, 100)
        self.create_timer(0.1, self.publish)

    def heard(self, said: JointState) -> None:
        """Take a joint state; its joints may be in any order, with others among them."""
        at = [list(said.name).index(joint) for joint in self.robot.joint_names]
        t = said.header.stamp.sec + 1e-9 * said.header.stamp.nanosec
        q, v, tau = ([part[k] for k in at] for part in (said.position, said.velocity, said.effort))
        sample = pa.Measurement(t, q, v, tau=tau)
        try:
            if self.state is None:
                self.state = self.estimator.init(sample)
            else:
                self.state = self.estimator.step(self.state, sample)
        except MeasurementError as error:
            self.get_logger().warning(str(error))

    def publish(self) -> None:
        """Publish mass, centre of mass and inertia about it."""
        if self.state is None:
            return
        load, message = self.estimator.estimate(self.state).load, InertiaStamped()
        message.header.frame_id, message.inertia.m = self.robot.frame, load.mass
        message.inertia.com.x, message.inertia.com.y, message.inertia.com.z = load.com
        for name, value in zip(NAMES, load.inertia, strict=True):
            setattr(message.inertia, name, float(value))
        self.publisher.publish(message)


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(LoadNode(*sys.argv[1:]))
