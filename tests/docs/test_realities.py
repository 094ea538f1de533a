"""What the arms of the table of realities add to the plants of the library is as stated."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from benchmarks import realities
from benchmarks.realities import ElasticArm, Reality
from tests.support.elastic import energy_of

SPRINGS = pa.robot.Actuators(stiffness=5e3)


@pytest.fixture(scope="module")
def robot():
    """A UR5 with rotors and without friction."""
    return realities.case_of("ur5").true.changed(viscous=0.0, coulomb=0.0, armature=0.1)


def test_play_makes_no_energy(robot):
    case = Reality(stiffness=5e3, play=5e-4)
    arm = ElasticArm(robot, case=case, seed=0, axis="+x", actuators=SPRINGS)

    def energy():
        """Return the energy, of the springs beyond their play [J]."""
        d = arm._d
        arm._d = np.sign(d) * np.maximum(np.abs(d) - 0.5 * case.play, 0.0)
        found = energy_of(arm)
        arm._d = d
        return found

    free = np.abs(arm._d) > 0.5 * case.play
    weight = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), robot.q0)
    assert arm.spring(arm._d) == pytest.approx(weight, abs=1e-9) and free.any()
    start = energy()
    crossed = 0
    for _ in range(500):  # the arm falls
        before = np.sign(arm._d)
        arm.step(np.zeros(robot.model.nv), 1e-3)
        crossed += int((np.sign(arm._d) != before).sum())
        assert energy() == pytest.approx(start, abs=0.02)
    moving = pin.computeKineticEnergy(arm._model, arm._data, arm._links, arm._v)
    assert crossed > 5 and moving > 10.0
