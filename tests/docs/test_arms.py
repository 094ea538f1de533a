"""The arms of the pages run against stand-ins with the same calls, without ROS or UR software."""

import importlib.util
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.exceptions import ArmError
from pinadapt.realtime import PlantArm, RealtimeLoop, Safety
from tests.support.arms import ORDINARY, robot
from tests.support.paths import ROOT

PERIOD = 2e-3  # of the arms of the pages


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


@pytest.fixture
def ros(monkeypatch):
    """Put a stand-in of ROS 2 in place; the messages come from a simulated arm."""
    plant, sent = PlantArm(pa.plants.PinocchioPlant(robot()), PERIOD), []

    class Node:
        def create_subscription(self, kind, topic, callback, depth):
            assert (kind.__name__, topic) == ("JointState", "/joint_states")
            self.callback = callback

        def create_publisher(self, kind, topic, depth):
            assert (kind.__name__, topic) == ("Float64MultiArray", "/effort/commands")
            return SimpleNamespace(publish=publish)

    def publish(message):
        sent.append(message.data)
        plant.send(np.array(message.data))

    def spin_once(node, timeout_sec):
        if len(sent) > 80 and plant.mute:
            return
        m = plant.read()
        stamp = SimpleNamespace(sec=int(m.t), nanosec=round(1e9 * (m.t % 1.0)))
        names = robot().joint_names[::-1]  # alphabetical order is that of joint_state_broadcaster
        header = SimpleNamespace(stamp=stamp)
        node.callback(JointState(header=header, name=names, position=m.q[::-1], velocity=m.v[::-1]))

    class JointState(SimpleNamespace):
        pass

    class Float64MultiArray(SimpleNamespace):
        pass

    plant.mute = False
    module(
        monkeypatch,
        "rclpy",
        init=lambda: None,
        create_node=lambda name: Node(),
        spin_once=spin_once,
    )
    module(monkeypatch, "sensor_msgs", msg=None)
    module(monkeypatch, "sensor_msgs.msg", JointState=JointState)
    module(monkeypatch, "std_msgs", msg=None)
    module(monkeypatch, "std_msgs.msg", Float64MultiArray=Float64MultiArray)
    return plant, sent


def joints():
    """Return a controller of joints, for arms without a camera."""
    described = pa.load("planar_2r", task="joint", gravity=[0.0, -9.81, 0.0])
    return pa.make_controller(described, dt=PERIOD, adaptation="natural")


def hold(of, on):
    """Return the ending of a hold of the joints."""
    swing = pa.trajectories.Hold(of.kinematics.robot.home_angles)
    safety = Safety(late=10**6, stale=10**6)
    loop = RealtimeLoop(
        on, of, swing, stage="hold", safety=safety, scheduling=ORDINARY, say=lambda words: None
    )
    with on:
        return loop.run(0.2)


def test_the_node_of_ros_drives_an_arm(ros):
    plant, sent = ros
    ending = hold(joints(), loaded("ros2", "RosArm")("/effort", robot()))
    assert not ending.failed and len(sent) > 100 and sent[-1] == [0.0, 0.0]
    assert np.abs(plant.plant.measure().q - robot().q0).max() < 1e-3
    assert len((ROOT / "docs/arms/ros2.py").read_text().splitlines()) <= 40


def test_a_silent_ros_topic_is_reported(ros):
    plant, _ = ros
    plant.mute = True
    ending = hold(joints(), loaded("ros2", "RosArm")("/effort", robot()))
    assert ending.failed and "no joint state came for 0.5 s" in ending.reason


def test_nothing_in_the_library_imports_ros():
    for path in (ROOT / "src").rglob("*.py"):
        assert "import rclpy" not in path.read_text()


def test_the_arm_of_ur_rtde_runs_and_is_marked_untested(monkeypatch):
    plant = pa.plants.PinocchioPlant(robot(), compensation=pa.robot.Gravity(robot()))
    said = {"now": None, "stopped": False, "script": True}

    class Receive:
        def __init__(self, address, rate):
            assert (address, rate) == ("10.0.0.1", 500.0)
            self.count = -1

        def getActualQ(self):
            self.count += 1
            if said["now"] is not None:
                plant.step(np.array(said["now"]), PERIOD)
            return plant.measure().q.tolist()

        def getActualQd(self):
            return plant.measure().v.tolist()

        def getTimestamp(self):
            return self.count * PERIOD

        def isConnected(self):
            return True

        def isProtectiveStopped(self):
            return said["stopped"]

        def isEmergencyStopped(self):
            return False

        def disconnect(self):
            pass

    class Control:
        def __init__(self, address, rate):
            pass

        def directTorque(self, torque):
            said["now"] = torque
            return len(torque) == 2

        def stopScript(self):
            said["script"] = False

        def disconnect(self):
            pass

    module(monkeypatch, "rtde_receive", RTDEReceiveInterface=Receive)
    module(monkeypatch, "rtde_control", RTDEControlInterface=Control)
    described = pa.load("planar_2r", task="joint", gravity=[0.0, -9.81, 0.0])
    of = pa.make_controller(described, dt=PERIOD, adaptation="natural", compensated="nominal")
    kind = loaded("ur", "UniversalRobot")
    ending = hold(of, kind("10.0.0.1", robot()))
    assert not ending.failed and not said["script"]
    assert np.abs(plant.measure().q - robot().q0).max() < 1e-3
    said["stopped"] = True
    with pytest.raises(ArmError, match="protective or emergency stop"):
        hold(of, kind("10.0.0.1", robot()))
    assert "UNTESTED" in (ROOT / "docs/arms/ur.py").read_text()
