"""Default gains pass the check before a run on every robot; gains that a sampling period cannot carry do not."""

import numpy as np
import pytest

import pinadapt as pa
from chains import catalogue_robot

LAWS = [law for law in pa.LAWS if law != "resolved-acceleration"]
ROBOTS = ["planar_2r", "scara", "ur5", "panda", "kinova", "talos_arm", "finger_edu"]


@pytest.mark.parametrize("dt", [5e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("name", ROBOTS)
def test_default_gains_pass(name, law, dt):
    controller = pa.make_controller(catalogue_robot(name), law=law, joint=["viscous", "coulomb"], dt=dt)
    assert [str(finding) for finding in pa.preflight(controller, dt)] == []


def loop(robot, controller, dt, **options):
    start = robot.position(robot.q0)
    return pa.simulate(robot, controller, pa.Hold(start + np.array([0.01, 0.0, 0.0])), duration=1.0, dt=dt, **options)


@pytest.mark.parametrize("law", ["adaptive-inverse-dynamics", "adaptive-jacobian"])
def test_the_longest_period_separates_loops_that_hold_from_loops_that_do_not(law):
    """The advice carries a margin of two on the gains: at the advised period the loop holds, at a longer one it is lost."""
    robot, dt = catalogue_robot("ur5"), 0.04
    default = pa.make_controller(robot, law=law, adaptation="none")
    gains = {
        "Kp": 16.0 * default.law.gains.K_P,
        "Kv": 4.0 * default.law.gains.K_v,
        "alpha": 4.0 * default.law.gains.alpha,
    }  # four times the bandwidth
    controller = pa.make_controller(robot, law=law, adaptation="none", dt=1e-3, **gains)
    with pytest.warns(UserWarning, match="too long for the task feedback: take dt <= "):
        assert loop(robot, controller, dt).diverged is not None
    finding = pa.preflight(controller, dt)[0]
    assert finding.longest < dt and max(finding.factors.values()) < 1.0
    assert pa.preflight(controller, 0.99 * finding.longest) == []
    held = loop(robot, controller, 0.99 * finding.longest)
    assert held.diverged is None and held.distance[-1] < 5e-3
    slower = pa.make_controller(
        robot, law=law, adaptation="none", **{k: 0.9 * f * gains[k] for k, f in finding.factors.items()}
    )
    assert pa.preflight(slower, dt) == []


def test_rates_that_are_too_fast_are_named():
    robot = catalogue_robot("ur5")
    fast = pa.make_controller(robot, gamma_d=1e5, gamma_k=200.0, joint="all", gamma_joint=1e6)
    parts = {finding.part: finding for finding in pa.preflight(fast, 1e-3)}
    assert set(parts) == {"adaptation of the dynamics", "adaptation of the kinematics"}
    finding = parts["adaptation of the kinematics"]
    slower = pa.make_controller(robot, gamma_k=0.99 * finding.factors["gamma_k"] * 200.0)
    assert pa.preflight(slower, 1e-3) == []
    assert "gamma_k by at most" in str(finding)


def test_a_controller_put_together_by_hand_is_not_checked():
    made = pa.make_controller(catalogue_robot("ur5"))
    own = pa.Controller(
        made.law,
        made.kinematics,
        made.dynamics,
        adaptation_k=made.adaptation_k,
        adaptation_d=made.adaptation_d,
        velocity_filter=made.velocity_filter,
        acceleration_filter=made.acceleration_filter,
    )
    assert pa.preflight(own, 1.0) == []
    assert np.isfinite(pa.preflight(made, 1.0)[0].longest)
