"""The closed loops that docstrings and the theory page state, against differences of the error."""

from itertools import islice

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.differences import sampled_derivative
from tests.support.loops import circle_beside, with_tool_and_load

pytestmark = pytest.mark.slow

DT, SAMPLES = 2e-4, 30
IMPROVED = "adaptive-inverse-dynamics-improved"


def inertia(controller, state, q, initial):
    """Return the estimated mass matrix, the moving one or the one of the initial estimate."""
    controller.dynamics.load(state.a_0 if initial else state.a_d)
    return controller.dynamics.mass_matrix(q)


@pytest.mark.parametrize("law", ["adaptive-inverse-dynamics", IMPROVED])
def test_the_error_obeys_17(law):
    """de/dt = -(K_v - alpha I) dxd_hat - K_P dx + Phi da_d - alpha Y_k da_k, (17)."""
    robot = catalogue_robot("panda")
    true = with_tool_and_load(robot)
    believed = robot.changed(inertial_scale=0.7)
    controller = pa.make_controller(believed, law=law, gamma_d=0.05).limited(None)
    plant = pa.plants.PinocchioPlant(true)
    path = circle_beside(true, "yz")
    a_k = controller.kinematics.value(true)
    a_d = controller.dynamics.value(true)
    K_v = controller.law.K_v
    K_P = controller.law.K_P
    alpha = controller.law.alpha
    e = []
    stated = []
    kinematic = []
    stream = pa.simulation.run_continuous(plant, controller, path, dt=DT, ideal_acceleration=True)
    for sample in list(islice(stream, SAMPLES)):
        state, (_, q, v, *_) = sample.state, sample.measurement
        s = controller.observe(state, sample.measurement, sample.desired)
        a = plant.acceleration_at(q, v, sample.torque)
        Y = controller.dynamics.regressor(q, v, a)
        M = inertia(controller, state, q, initial=law == IMPROVED)
        Phi_da = s.J @ np.linalg.solve(M, Y @ (s.a_d - a_d))
        missing = alpha * s.Y_k @ (s.a_k - a_k)
        e.append(s.dxd_hat + controller.law.alpha * s.dx)
        stated.append(-(K_v - alpha * np.eye(3)) @ s.dxd_hat - K_P @ s.dx + Phi_da - missing)
        kinematic.append(missing)
    numerical = np.column_stack([sampled_derivative(row, DT) for row in np.array(e).T])
    error = np.abs(numerical - np.array(stated)[2:-2]).max()
    assert error < 1e-4 * np.abs(stated).max()
    assert np.abs(kinematic).max() > 20 * error  # each term counts
