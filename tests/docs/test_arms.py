"""The arms of the pages run against stand-ins with the same calls, without ROS or UR software."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.realtime import PlantArm, RealtimeLoop, Safety
from tests.support.arms import ORDINARY, robot
from tests.support.paths import page_module
from tests.support.ros import joint_state, put_in_place

PERIOD = 2e-3  # of the arms of the pages
JOINTS, GAINS = ["joint1", "joint2"], {"p": 600.0, "d": 60.0}


PARAMETERS = {
    "update_rate": 500,
    "command_interfaces": ["effort"],
    "cmd_timeout": 0.05,
    "constraints.goal_time": 0.0,
    "allow_nonzero_velocity_at_trajectory_end": True,
    **{f"gains.{joint}.{part}": gain for joint in JOINTS for part, gain in GAINS.items()},
}


class Manager:
    """A controller manager with a joint_trajectory_controller of efforts, as in ros2_controllers.

    The effort of the last point is kept, plus gains times its distance; before the first point it
    holds the place where the arm is.

    Attributes:
        efforts: commanded, one of each cycle.
        running: nodes that are not destroyed yet.
    """

    def __init__(self):
        self.plant = PlantArm(pa.plants.PinocchioPlant(robot()), PERIOD)
        self.efforts = [np.zeros(2)]
        self.running = []
        self.point = None

    def receive(self, message):
        (self.point,) = message.points
        assert list(message.joint_names) == JOINTS

    def update(self):
        """Run one cycle and return the joint state that is published."""
        m = self.plant.read()
        zero = np.zeros(2)
        if self.point is None:
            self.point = SimpleNamespace(positions=m.q, velocities=zero, effort=zero)
        point = self.point
        p = GAINS["p"]
        d = GAINS["d"]
        effort = point.effort + p * (point.positions - m.q) + d * (point.velocities - m.v)
        before = self.efforts[-1]
        self.efforts.append(effort)
        self.plant.send(effort)
        return joint_state(m, JOINTS, before)


@pytest.fixture
def ros(monkeypatch):
    """Put a stand-in of ROS 2 in place, and return its controller manager."""
    manager = Manager()

    class Node:
        def create_subscription(self, kind, topic, callback, depth):
            assert (kind.__name__, topic) == ("JointState", "/joint_states")
            self.callback = callback

        def create_publisher(self, kind, topic, depth):
            assert (kind.__name__, topic) == ("JointTrajectory", "/arm/joint_trajectory")
            return SimpleNamespace(publish=manager.receive)

        def destroy_node(self):
            manager.running.remove(self)

    def client(node, name):
        def get_parameters(names):
            result = SimpleNamespace(values=[PARAMETERS[name] for name in names])
            return SimpleNamespace(done=lambda: True, result=lambda: result)

        return SimpleNamespace(wait_for_services=bool, get_parameters=get_parameters)

    def create_node(name):
        manager.running.append(Node())
        return manager.running[-1]

    def spin_once(node, timeout_sec):
        node.callback(manager.update())

    def message(name):
        return type(name, (SimpleNamespace,), {})

    kinds = ("JointTrajectory", "JointTrajectoryPoint")
    modules = {
        "rclpy": {
            "init": lambda: None,
            "create_node": create_node,
            "shutdown": lambda: None,
            "spin_once": spin_once,
            "spin_until_future_complete": lambda node, future, timeout_sec: None,
        },
        "rclpy.parameter": {"parameter_value_to_python": lambda value: value},
        "rclpy.parameter_client": {"AsyncParameterClient": client},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"JointState": message("JointState")},
        "trajectory_msgs": {},
        "trajectory_msgs.msg": {name: message(name) for name in kinds},
    }
    put_in_place(monkeypatch, modules)
    return manager


def test_the_node_of_ros_drives_an_arm(ros):
    on = page_module("arms", "ros2").RosArm("/arm", robot())
    assert on.facts.period == PERIOD
    described = pa.load("planar_2r", task="joint", gravity=[0.0, -9.81, 0.0])  # without a camera
    of = pa.make_controller(described, dt=PERIOD, adaptation="natural")
    on.facts = replace(on.facts, clock="simulated")
    safety = Safety(late=10**6, stale=10**6)
    with on:
        ending = RealtimeLoop(
            on, of, None, stage="hold", safety=safety, scheduling=ORDINARY, say=lambda words: None
        ).run(0.2)
    assert not ending.failed and len(ros.efforts) > 100 and not ros.running
    assert np.abs(ros.plant.plant.measure().q - robot().q0).max() < 1e-3
    assert not ros.point.effort[0] and not any(ros.point.velocities)  # by its own gains from now on
