"""The arms of the pages run against stand-ins with the same calls, without ROS or UR software."""

import importlib.util
import sys
from dataclasses import replace
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.realtime import PlantArm, RealtimeLoop, Safety
from tests.support.arms import ORDINARY, robot
from tests.support.paths import ROOT

PERIOD = 2e-3  # of the arms of the pages
JOINTS, GAINS = ["joint1", "joint2"], {"p": 600.0, "d": 60.0}


def module(monkeypatch, name, **things):
    """Put a module with these attributes in place of one that is not installed."""
    made = ModuleType(name)
    vars(made).update(things)
    monkeypatch.setitem(sys.modules, name, made)


def loaded(name, thing):
    """Return an object that a file of the documentation defines."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / "arms" / f"{name}.py")
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return getattr(found, thing)


SAFE = {
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
        parameters: by node.
        efforts: commanded, one of each cycle.
        running: nodes that are not destroyed yet.
    """

    def __init__(self):
        self.plant = PlantArm(pa.plants.PinocchioPlant(robot()), PERIOD)
        self.parameters = {"/controller_manager": {"update_rate": 500}, "/arm": dict(SAFE)}
        self.efforts, self.running, self.point = [], [], None

    def receive(self, message):
        (self.point,) = message.points
        assert list(message.joint_names) == JOINTS

    def update(self):
        """Run one cycle and return the joint state that is published, in alphabetical order."""
        m = self.plant.read()
        if self.point is None:
            self.point = SimpleNamespace(positions=m.q, velocities=self.zero, effort=self.zero)
        point, p, d = self.point, GAINS["p"], GAINS["d"]
        effort = point.effort + p * (point.positions - m.q) + d * (point.velocities - m.v)
        before = self.efforts[-1] if self.efforts else self.zero
        self.efforts.append(effort)
        self.plant.send(effort)
        stamp = SimpleNamespace(sec=int(m.t), nanosec=round(1e9 * (m.t % 1.0)))
        return SimpleNamespace(
            header=SimpleNamespace(stamp=stamp),
            name=JOINTS[::-1],
            position=m.q[::-1],
            velocity=m.v[::-1],
            effort=before[::-1],
        )

    zero = np.zeros(2)


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

    class AsyncParameterClient:
        def __init__(self, node, name):
            self.found = manager.parameters.get(name)

        def wait_for_services(self, timeout):
            return self.found is not None

        def get_parameters(self, names):  # one that is not declared: none at all
            known = set(names) <= set(self.found)
            values = [self.found[name] for name in names] if known else []
            result = SimpleNamespace(values=values)
            return SimpleNamespace(done=lambda: True, result=lambda: result)

    def create_node(name):
        manager.running.append(Node())
        return manager.running[-1]

    def spin_once(node, timeout_sec):
        node.callback(manager.update())

    def message(name):
        return type(name, (SimpleNamespace,), {})

    module(
        monkeypatch,
        "rclpy",
        init=lambda: None,
        create_node=create_node,
        shutdown=lambda: None,
        spin_once=spin_once,
        spin_until_future_complete=lambda node, future, timeout_sec: None,
    )
    module(monkeypatch, "rclpy.parameter", parameter_value_to_python=lambda value: value)
    module(monkeypatch, "rclpy.parameter_client", AsyncParameterClient=AsyncParameterClient)
    module(monkeypatch, "sensor_msgs", msg=None)
    module(monkeypatch, "sensor_msgs.msg", JointState=message("JointState"))
    module(monkeypatch, "trajectory_msgs", msg=None)
    kinds = {name: message(name) for name in ("JointTrajectory", "JointTrajectoryPoint")}
    module(monkeypatch, "trajectory_msgs.msg", **kinds)
    return manager


def joints():
    """Return a controller of joints, for arms without a camera."""
    described = pa.load("planar_2r", task="joint", gravity=[0.0, -9.81, 0.0])
    return pa.make_controller(described, dt=PERIOD, adaptation="natural")


def hold(of, on, stage="hold", motion=None, seconds=0.2):
    """Return the ending of a hold of the joints, or of another stage, without a wall clock."""
    on.facts = replace(on.facts, clock="simulated")
    safety = Safety(late=10**6, stale=10**6)
    loop = RealtimeLoop(
        on, of, motion, stage=stage, safety=safety, scheduling=ORDINARY, say=lambda words: None
    )
    with on:
        return loop.run(seconds)


def test_the_node_of_ros_drives_an_arm(ros):
    on = loaded("ros2", "RosArm")("/arm", robot())
    assert on.facts.period == PERIOD
    ending = hold(joints(), on)
    assert not ending.failed and len(ros.efforts) > 100 and not ros.running
    assert np.abs(ros.plant.plant.measure().q - robot().q0).max() < 1e-3
    assert not ros.point.effort[0] and not any(ros.point.velocities)  # by its own gains from now on
