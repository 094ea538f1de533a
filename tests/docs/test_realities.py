"""What the arms of the table of realities add to the plants of the library is as stated."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from benchmarks import realities
from benchmarks.realities import ElasticArm, Reality, RigidArm

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
