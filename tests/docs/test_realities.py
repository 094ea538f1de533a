"""What the arms of the table of realities add to the plants of the library is as stated."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from benchmarks import realities
from benchmarks.realities import ElasticArm, Observed, Reality, RigidArm
from pinadapt.plants.elastic_plant import ElasticPlant

SPRINGS = pa.robot.Actuators(stiffness=5e3)


@pytest.fixture(scope="module")
def robot():
    """A UR5 with rotors and without friction."""
    return realities.case_of("ur5").true.changed(viscous=0.0, coulomb=0.0, armature=0.1)


def gravity(robot):
    return pin.computeGeneralizedGravity(robot.model, robot.model.createData(), robot.q0)


@pytest.mark.parametrize("kind", [RigidArm, ElasticArm])
def test_a_push_accelerates_the_links_by_its_torque(robot, kind):
    elastic = {"actuators": SPRINGS} if kind is ElasticArm else {}
    stiffness = 5e3 if elastic else np.inf
    case = Reality(push=40.0, stiffness=stiffness, duration=0.0)
    arm = kind(robot, case=case, seed=0, axis="-z", **elastic)
    q0, h = robot.q0, 1e-6
    arm.step(gravity(robot), h)
    links = robot.changed(armature=0.0) if elastic else robot
    J = np.array(
        [
            robot.position(q0 + 1e-6 * e) - robot.position(q0 - 1e-6 * e)
            for e in np.eye(robot.model.nv)
        ]
    )
    tau = J[:, 2] / 2e-6 * -40.0
    a = np.linalg.solve(pin.crba(links.model, links.model.createData(), q0), tau)
    v = arm._v if elastic else arm.measure().v
    assert v / h == pytest.approx(a, rel=1e-5, abs=1e-6)
    if elastic:
        assert np.abs(arm.measure().v).max() < 1e-3 * np.abs(v).max()


def test_springs_without_play_are_those_of_the_library(robot):
    arm = ElasticArm(robot, case=Reality(stiffness=5e3), seed=0, axis="+x", actuators=SPRINGS)
    plain = ElasticPlant(robot, actuators=SPRINGS)
    for k in range(100):
        tau = gravity(robot) + 5.0 * np.sin(0.1 * k + np.arange(robot.model.nv))
        arm.step(tau, 1e-3)
        plain.step(tau, 1e-3)
    assert arm._links == pytest.approx(plain._links, abs=1e-9)


def test_play_makes_no_energy(robot):
    case = Reality(stiffness=5e3, play=5e-4)
    arm = ElasticArm(robot, case=case, seed=0, axis="+x", actuators=SPRINGS)

    def energy():
        """Return the energy, of the springs beyond their play [J]."""
        d = arm._d
        arm._d = np.sign(d) * np.maximum(np.abs(d) - 0.5 * case.play, 0.0)
        found, arm._d = arm.energy(), d
        return found

    free = np.abs(arm._d) > 0.5 * case.play
    assert arm.spring(arm._d) == pytest.approx(gravity(robot), abs=1e-9) and free.any()
    start, crossed = energy(), 0
    for _ in range(500):  # the arm falls
        before = np.sign(arm._d)
        arm.step(np.zeros(robot.model.nv), 1e-3)
        crossed += int((np.sign(arm._d) != before).sum())
        assert energy() == pytest.approx(start, abs=0.02)
    moving = pin.computeKineticEnergy(arm._model, arm._data, arm._links, arm._v)
    assert crossed > 5 and moving > 10.0


def test_ripple_and_torque_sensor_are_shares_of_the_efforts(robot):
    arm = RigidArm(robot, case=Reality(ripple=0.01, torque_off=0.02), seed=0, axis="+x")
    n, efforts = robot.model.nv, np.array(robot.model.effortLimit)
    turn = np.linspace(0.0, 2.0 * np.pi, 10001)
    torques = np.array([arm.rippled(np.zeros(n), robot.q0 + angle) for angle in turn])
    assert np.abs(torques).max(axis=0) == pytest.approx(0.01 * efforts, rel=1e-2)
    assert (np.diff(np.sign(torques), axis=0) > 0).sum(axis=0).tolist() == [realities.GEAR] * n
    arm.step(gravity(robot), 1e-3)
    assert arm.measure().tau == pytest.approx(gravity(robot) + 0.02 * efforts)


def test_an_observer_sees_a_disturbance_at_its_rate(robot):
    """The push begins after 0.1 s; p is the observer's prediction for the sample that comes."""
    made = pa.make_controller(robot, adaptation="none", limits=pa.Limits(guards=False))
    controller = Observed.around(made, 1.0)
    plant = RigidArm(robot, case=Reality(push=40.0, duration=0.2), seed=0, axis="-z")
    motion, seen, predicted = realities.case_of("ur5").motion, [], np.zeros(robot.model.nv)
    for sample in pa.simulation.run(plant, controller, motion, duration=0.15):
        momentum = plant.mass_matrix(sample.truth.q) @ sample.truth.v
        seen.append(controller.k * (momentum - predicted))
        predicted = controller.p
    pushed = plant.pushed(sample.truth.q)
    share = 1.0 - np.exp(-0.05 * controller.k)
    assert seen[-1] == pytest.approx(share * pushed, abs=0.05 * np.abs(pushed).max())
    assert np.abs(seen[99]).max() < 0.05 * np.abs(pushed).max()
