"""Middleton and Goodwin's law: what its modification is for, and what it learns from."""

from itertools import islice

import numpy as np
import pytest

import pinadapt as pa
from tests.support.differences import sampled_derivative
from tests.support.joint_motions import joint_robot, loaded, swinging
from tests.support.loops import energy_along

pytestmark = pytest.mark.slow

LAW = "middleton-goodwin"
ADAPTATIONS = ["least-squares", "natural-composite", "composite"]
GAINS = {"least-squares": {"prediction_rate": 20.0}}  # slow enough for a step of 0.2 ms
ROBOTS = ["planar_2r", "panda", "mixed"]  # the last with a slide and a continuous joint

LOOPS = [
    *((name, "least-squares") for name in ROBOTS),
    *(("mixed", kind) for kind in ADAPTATIONS[1:]),
]


def loop(name, adaptation):
    robot = joint_robot(name)
    believed = robot.changed(inertial_scale=0.9)
    gains = GAINS.get(adaptation, {})
    controller = pa.make_controller(believed, law=LAW, adaptation=adaptation, **gains)
    return loaded(robot), controller, swinging(robot)


def zeta(controller, s):
    """Return M_hat^-1 (W a_d - y) / lambda."""
    controller.dynamics.load(s.a_d)
    M = controller.dynamics.mass_matrix(s.q)
    W = s.filtered_torque.W
    y = s.filtered_torque.y
    return np.linalg.solve(M, W @ s.a_d - y) / controller.adaptation_d.torque_bandwidth


@pytest.mark.parametrize(("name", "adaptation"), LOOPS)
def test_the_parameters_part_of_v_falls_with_the_prediction_error(name, adaptation):
    true, controller, path = loop(name, adaptation)
    dt = 2e-4 if name == "planar_2r" else 4e-4  # its R rises faster
    energy = energy_along(true, controller, path, seconds=0.012, dt=dt)
    # at first R rises from W = 0 within a few samples
    assert energy.mismatch(after=round(4e-3 / dt)) <= 1e-4
    assert np.abs(energy.rate).max() > 1e-9 * energy.V[0]
    assert (energy.rate <= 0.0).all() and energy.largest_rise() <= 1e-12


@pytest.mark.parametrize(("name", "adaptation"), LOOPS)
def test_the_error_is_driven_by_the_prediction_error_alone(name, adaptation):
    """d/dt (ed - zeta) = -K_v ed - K_P e + lambda zeta, with the estimate on its way."""
    true, controller, path = loop(name, adaptation)
    controller = controller.limited(None)
    dt = 1e-4
    law = controller.law
    rate = controller.adaptation_d.torque_bandwidth
    left = []
    right = []
    size = 0.0
    for sample in islice(
        pa.simulation.run_continuous(pa.plants.PinocchioPlant(true), controller, path, dt=dt), 20
    ):
        s, _ = controller.command(sample.state, sample.measurement, sample.desired)
        left.append(s.dxd_hat - zeta(controller, s))
        right.append(-law.K_v @ s.dxd_hat - law.K_P @ s.dx + rate * zeta(controller, s))
        size = max(size, np.abs(rate * zeta(controller, s)).max())
    left = np.array(left)
    right = np.array(right)
    found = np.column_stack([sampled_derivative(column, dt) for column in left.T])
    assert np.abs(found - right[2:-2]).max() <= 1e-5 * size
