"""A robot with elastic joints: energy, the rigid limit, encoders, refused input."""

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.elastic import energy_of
from tests.support.loops import circle_beside, with_tool_and_load

pytestmark = pytest.mark.slow


def robot_with_motors(name="ur5", **changes):
    robot = catalogue_robot(name)
    return robot.changed(armature=np.linspace(0.3, 0.02, robot.model.nv), **changes)


def elastic(robot, stiffness, *, substeps=None, **springs):
    """Return the robot with springs between its motors and links."""
    own = pa.robot.Actuators(stiffness=stiffness, **springs)
    return pa.plants.ElasticPlant(robot, actuators=own, substeps=substeps)


@pytest.mark.parametrize("name", ["scara", "kinova"])
def test_energy_is_conserved(name):
    """After a push, without torque: the energy error decreases with the square of the step."""
    robot = robot_with_motors(name)
    lost = []
    for substeps in (4, 8):
        plant = elastic(robot, 2000.0, substeps=substeps)
        for _ in range(50):
            plant.step(np.linspace(5.0, 0.5, plant.nv), 1e-3)
        start = energy_of(plant)
        for _ in range(100):
            plant.step(np.zeros(plant.nv), 1e-3)
        assert np.linalg.norm(plant.measure().v) > 0.1
        lost.append(abs(energy_of(plant) - start))
    assert lost[1] < 0.35 * lost[0] + 1e-9
    assert lost[1] < 1e-3


def test_stiff_springs_give_the_rigid_robot():
    """The difference decreases with the stiffness, down to that of two integrators."""
    robot = robot_with_motors(viscous=0.5, coulomb=0.5)
    rigid = pa.plants.PinocchioPlant(robot, substeps=8)
    ends = []
    t = 1e-3 * np.arange(200)
    torque = np.outer(np.sin(5.0 * t), [20.0, 30.0, 20.0, 3.0, 2.0, 1.0])
    stiffnesses = (1e4, 1e5, 1e8)
    plants = [rigid, *(elastic(robot, K, damping=5.0, substeps=8) for K in stiffnesses)]
    for plant in plants:
        for tau in torque:
            plant.step(tau, 1e-3)
        ends.append(plant.measure())
    off = [np.abs(end.q - ends[0].q).max() for end in ends[1:]]
    assert off[0] > 3.0 * off[1] > 30.0 * off[2]
    assert off[2] < 1e-5
    assert np.abs(ends[3].v - ends[0].v).max() < 1e-3 * np.abs(ends[0].v).max()
    assert np.abs(ends[3].x - ends[0].x).max() < 1e-5


def test_a_joint_oscillates_at_the_frequency_of_its_spring():
    """A motor and a link on a spring: w^2 = K (1 / B + 1 / M)."""
    robot = catalogue_robot("planar_2r")
    K = 800.0
    B = 0.4
    robot = pa.load("planar_2r", locked=[robot.joint_names[1]], frame=robot.frame, task="joint")
    robot = robot.changed(armature=B)
    plant = elastic(robot, K, substeps=5)
    M = float(pa.plants.PinocchioPlant(robot.changed(armature=0.0)).mass_matrix(robot.q0)[0, 0])
    w = np.sqrt(K * (1.0 / B + 1.0 / M))
    plant._w = np.array([0.1])
    speeds = []
    for _ in range(400):
        plant.step(np.zeros(1), 1e-3)
        speeds.append(plant.measure().v[0])
    above = np.diff(np.sign(np.array(speeds) - np.mean(speeds))) > 0
    crossings = 1e-3 * np.flatnonzero(above)
    assert 2.0 * np.pi / np.diff(crossings).mean() == pytest.approx(w, rel=0.02)


def test_a_loop_holds_an_elastic_robot_that_changes():
    robot = catalogue_robot("ur5").changed(armature=0.2)
    true = with_tool_and_load(robot).changed(coulomb=0.3)
    controller = pa.make_controller(robot, adaptation="natural")
    springs = pa.robot.Actuators(stiffness=2e4, damping=5.0)
    heavier = true.changed(payload=pa.Payload(0.5))
    rollout = pa.simulate(
        true,
        controller,
        circle_beside(true, "yz"),
        duration=0.7,
        engine=springs,
        events=pa.Events(changes={0.5: heavier}),
        record_every=5,
    )
    assert rollout.diverged is None
    assert rollout.distance[rollout.t > 0.4].max() < 5e-3
