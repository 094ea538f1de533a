"""Examples of other people's loops: with a model that learns the load they err less."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import pinadapt as pa
from tests.support.paths import page_module
from tests.support.ros import joint_state, put_in_place

example = partial(page_module, "loops")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "needs", "duration", "share"),
    [
        ("pink_gravity", "pink", 0.5, 0.3),
        ("learning_policy", "pinadapt", 0.8, 0.1),
        ("quadruped_qp", "qpsolvers", 0.7, 0.05),
        ("mujoco_sampling", "mujoco", 1.2, 0.1),
    ],
)
def test_a_learned_model_errs_less(name, needs, duration, share):
    pytest.importorskip(needs)
    found = example(name)
    found.SAMPLES = 20  # half of what the last one draws
    without, learned = (found.run(learn, duration)[-1] for learn in (False, True))
    assert learned < share * without


def test_a_node_publishes_the_load(monkeypatch):
    published = []
    timers = []

    class Node:
        def __init__(self, name):
            pass

        def create_publisher(self, kind, topic, depth):
            return SimpleNamespace(publish=published.append)

        def create_subscription(self, kind, topic, callback, depth):
            assert (kind, topic) == ("JointState", "/joint_states")

        def create_timer(self, period, callback):
            timers.append(callback)

    def inertia():
        parts = SimpleNamespace(com=SimpleNamespace())
        return SimpleNamespace(header=SimpleNamespace(), inertia=parts)

    kinds = {"rclpy": {}, "rclpy.node": {"Node": Node}, "sensor_msgs": {}, "geometry_msgs": {}}
    kinds["sensor_msgs.msg"] = {"JointState": "JointState"}
    kinds["geometry_msgs.msg"] = {"InertiaStamped": inertia}
    put_in_place(monkeypatch, kinds)
    robot = pa.load("planar_2r", gravity=[0.0, -9.81, 0.0], task="joint")
    monkeypatch.setattr(pa, "load", lambda urdf: robot)
    node = example("ros2_load").LoadNode("arm.urdf")
    plant = pa.plants.PinocchioPlant(robot.changed(payload=pa.Payload(1.0)))
    torque = np.zeros(2)
    for k in range(400):
        m = plant.measure()
        node.heard(joint_state(m, robot.joint_names, torque))
        target = robot.q0 + 0.3 * np.sin(np.array([2.0, 3.0]) * k * 0.01)
        torque = 50.0 * (target - m.q) - 8.0 * m.v
        plant.step(torque, 0.01)
    timers[0]()
    (message,) = published
    assert message.header.frame_id == robot.frame
    assert message.inertia.m == pytest.approx(1.0, abs=0.05)
