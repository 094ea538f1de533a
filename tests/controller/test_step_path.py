"""The way through a control step: how many files it passes."""

import sys
from pathlib import Path

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot

SOURCE = Path(pa.__file__).parent
FILES = 18


def files_of(call):
    """Return the files of ``src/pinadapt`` of all Python functions that a call enters, in order."""
    entered = []

    def profile(frame, event, _):
        path = Path(frame.f_code.co_filename)
        if event == "call" and path.is_relative_to(SOURCE):
            entered.append(path.relative_to(SOURCE).as_posix())

    sys.setprofile(profile)
    try:
        call()
    finally:
        sys.setprofile(None)
    return entered


@pytest.mark.parametrize(
    "options", [{}, {"kinematic_adaptation": "gradient"}, {"kinematic_adaptation": "least-squares"}]
)
def test_a_step_of_the_default_law_passes_few_files(options):
    """One between two looks of the memory, as most are."""
    robot = catalogue_robot("panda")
    controller = pa.make_controller(robot, **options)
    plant = pa.plants.PinocchioPlant(robot)
    velocity = 0.3 * np.random.default_rng(0).standard_normal(robot.model.nv)
    measurement = plant.measurement(robot.q0, velocity)

    def sample(k):
        """Return the arm's k-th sample, at a constant velocity."""
        return plant.measurement(plant.integrate(robot.q0, 1e-3 * k * velocity), velocity, 1e-3 * k)

    still = np.zeros(3)
    desired = pa.Desired(robot.position(robot.q0), still, still)
    state = controller.init(measurement)
    for k in range(3):
        state = controller.step(state, sample(k), desired, 1e-3)[1]
    measurement = sample(3)
    entered = files_of(lambda: controller.step(state, measurement, desired, 1e-3))
    assert entered[0] == "controller/controller.py"
    assert "_checks.py" not in entered  # no door of a public method is passed
    assert len(set(entered)) <= FILES, sorted(set(entered))
