"""Windows of a motion: equations without accelerations, solved by the true parameters."""

from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.identification.fits import Windows
from pinadapt.identification.logged_motion import motion_of_log
from pinadapt.information.measured_motion import Averages
from tests.support.chains import catalogue_robot
from tests.support.recorded import recorded, torques, true_robot

CASES = ["ur5", "kinova", "scara"]


def windows(name, log):
    """Return the windows of a log, and the parameters of the true robot."""
    robot = catalogue_robot(name)
    dynamics = pa.make_controller(robot).dynamics
    motion = motion_of_log(robot, log)
    found = Windows.of(motion, Averages(motion.t, log.period), dynamics, robot)
    return found, dynamics.value(true_robot(name))


def missed(found, a):
    """Return the largest residual relative to the largest torque."""
    return np.abs(found.residual(a)).max() / np.abs(found.tau).max()


@pytest.mark.parametrize("name", CASES)
def test_the_true_parameters_solve_the_rows(name):
    found, true = windows(name, recorded(name, duration=2.0, dt=2e-3))
    assert len(found.t) > 20 and missed(found, true) < 2e-4  # Coulomb friction turns in between


@pytest.mark.parametrize("dt", [1e-3, 4e-3])
def test_the_error_is_that_of_friction_alone(dt):
    robot = catalogue_robot("ur5")
    smooth = true_robot("ur5", coulomb=0.0)
    log = recorded("ur5", duration=2.0, dt=dt)
    a = np.gradient(log.v, dt, axis=0, edge_order=2)
    log = replace(log, tau=torques(smooth, log.q, log.v, a))
    dynamics = pa.make_controller(robot).dynamics
    moved = motion_of_log(robot, log)
    found = Windows.of(moved, Averages(moved.t, dt), dynamics, robot)
    assert missed(found, dynamics.value(smooth)) < 20.0 * dt**2  # that of the acceleration here


def test_times_may_jitter_and_a_gap_costs_only_the_windows_around_it():
    log = recorded("ur5", duration=3.0, dt=2e-3)
    kept = np.random.default_rng(0).random(len(log.t)) > 0.3
    kept[(log.t > 1.0) & (log.t < 1.1)] = False
    parts = {name: getattr(log, name)[kept] for name in ("t", "q", "v", "tau")}
    found, true = windows("ur5", replace(log, **parts))
    assert missed(found, true) < 1e-2
    reach = 0.5 * found.length
    assert not ((found.t + reach > 1.0) & (found.t - reach < 1.1)).any()
    whole = windows("ur5", log)[0]
    assert len(whole.t) - len(found.t) <= 3 * (1 + 0.1 / found.length) + 2


def test_averages_are_integrals_and_rates_are_derivatives():
    t = np.linspace(0.0, 3.0, 900)
    averages = Averages(t, t[1])
    mean = averages.mean(np.sin(t))
    rate = -(averages.rate @ np.sin(t))
    assert np.allclose(averages.mean(np.ones_like(t)), 1.0, atol=1e-6)
    damping = mean[10] / np.sin(averages.t[10])  # the low pass of the window
    assert 0.99 < damping < 1.0 and np.allclose(mean, damping * np.sin(averages.t), atol=1e-6)
    assert np.allclose(rate, damping * np.cos(averages.t), atol=1e-6)
