"""Contacts in pictures: the chosen forces, their spikes and cones, and feet in the air."""

from functools import cache

import meshcat
import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.trajectories import Crawl
from pinadapt.view.contacts import DrawnContacts
from pinadapt.view.drawing import Window
from tests.constraints.test_standing import FEET, TRUNK, standing
from tests.view.test_animation import animated, messages


@cache
def at_rest(name):
    """Return a robot that stands at home, its controller, and the arguments of a step."""
    robot = standing(name)
    controller = pa.make_controller(robot, unknown=TRUNK)
    measurement = pa.plants.PinocchioPlant(robot).measure()
    desired = pa.Desired(measurement.x, np.zeros(6), np.zeros(6))
    return robot, controller, (controller.init(measurement), measurement, desired)


@pytest.mark.parametrize("name", ["a1", "talos"])
def test_chosen_forces_bear_the_weight_and_are_those_of_the_torque(name):
    robot, controller, given = at_rest(name)
    forces = controller.contact_forces(*given)
    weight = robot.mass * 9.81
    assert np.allclose(forces[:, :3].sum(axis=0), [0.0, 0.0, weight], atol=1e-5 * weight)
    along = np.linalg.norm(forces[:, :2], axis=1)
    assert (along <= 0.6 * forces[:, 2] + 1e-6 * weight).all()
    torque, _ = controller.step(*given, 1e-3)
    f = np.concatenate([f[: c.size] for f, c in zip(forces, robot.contacts, strict=True)])
    A, _ = robot.constrained.at(robot.q0, np.zeros(robot.model.nv))
    gravity = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), robot.q0)
    assert np.allclose(torque + A.T @ f, gravity, atol=1e-5 * weight)


def test_a_foot_in_the_air_has_no_force_and_a_chain_no_contact():
    robot, controller, (state, measurement, _) = at_rest("a1")
    desired = Crawl().on(robot).at(0.8)
    forces = controller.contact_forces(state, measurement, desired)
    stands = desired.feet.stands
    assert stands.sum() == 3 and not forces[~stands].any() and forces[stands, 2].min() > 1.0
    arm = pa.load("planar_2r")
    m = pa.plants.PinocchioPlant(arm).measure()
    of_arm = pa.make_controller(arm)
    rest = pa.Desired(m.x, np.zeros(2), np.zeros(2))
    assert of_arm.contact_forces(of_arm.init(m), m, rest).shape == (0, 6)


class Placed(dict):
    """Keeps where nodes are moved, in place of keyframes."""

    def move(self, node, position, rotation=None, scale=None):
        self[node.path.lower().rpartition("contacts/")[2]] = position, rotation, scale


def test_spikes_begin_at_the_centre_of_pressure_and_end_at_the_force():
    robot = standing("talos")
    node = meshcat.Visualizer(window=Window())["contacts"]
    joints = np.tile(np.eye(4), (1, robot.model.njoints, 1, 1))
    poses = Placed()
    frame = robot.model.frames[robot.model.getFrameId("left_sole_link")]
    joints[0, frame.parentJoint] = frame.placement.inverse().homogeneous  # the sole at the origin
    force = np.array([[10.0, 0.0, 400.0, 4.0, -8.0, 0.0], np.zeros(6)])
    drawn = DrawnContacts(node, robot, 1.0)
    drawn.place(joints, force[None], poses)
    middle, turn, (scale,) = poses["left_sole_link/force"]
    half = 0.5 * turn.apply([0.0, scale[1], 0.0])
    begin = middle - half
    end = middle + half
    assert np.allclose(begin, [8.0 / 400.0, 4.0 / 400.0, 0.0])  # n x m / (n f)
    assert np.allclose(end - begin, force[0, :3] / (robot.mass * 9.81))
    _, _, (cone,) = poses["left_sole_link/cone"]
    assert cone[0] == pytest.approx(0.6 * cone[1])
    assert poses["right_sole_link/cone"][2].max() < 1e-3  # it bears nothing


@pytest.mark.slow
def test_a_page_of_a_robot_that_stands_has_cones_and_forces():
    robot, controller, _ = at_rest("a1")
    rollout = pa.simulate(
        robot, controller, Crawl(steps=1), duration=0.1, progress=False, engine="mujoco"
    )
    animation = rollout.animate()
    commands, _ = messages(animation)
    for foot in FEET["a1"]:
        for part in ("cone", "force"):
            assert ("set_object", f"/meshcat/contacts/{foot}/{part}") in commands
    assert "friction cone" in animation.html and "chosen contact force" in animation.html
    assert "friction cone" not in animated("planar_2r")[1].html
