"""Default gains pass the check before a run; gains too fast for the period do not."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.zoo.experiment import zoo_case
from tests.support.chains import catalogue_robot, robot_of

pytestmark = pytest.mark.slow

LAWS = [name for name, law in pa.laws.LAWS.items() if law.adapts]
KINDS = ["separation", "adaptive-inverse-dynamics", "slotine-li"]  # one law of each kind


@pytest.mark.parametrize(
    ("name", "dt", "law"),
    [("panda", 1e-3, law) for law in LAWS]
    + [(name, 5e-3, law) for name in ("scara", "talos_arm") for law in KINDS],
)
def test_default_gains_pass(name, dt, law):
    controller = pa.make_controller(
        robot_of(law, name), law=law, unknown=pa.Unknown(friction=True, armature=False), dt=dt
    )
    assert [str(finding) for finding in pa.preflight(controller, dt)] == []


def test_default_gains_of_a_pose_pass_too_slowed_where_they_must_be():
    robot = pa.load("romeo_right_arm", task="pose")
    controller, fast = (
        pa.make_controller(robot, law="adaptive-jacobian", dt=dt) for dt in (1e-3, 1e-4)
    )
    assert [str(finding) for finding in pa.preflight(controller, 1e-3)] == []
    share = controller.law.alpha / fast.law.alpha
    assert 0.3 < share < 1.0
    assert np.isclose(controller.law.lambda_, share * fast.law.lambda_)
    own = pa.make_controller(
        robot, law="adaptive-jacobian", alpha=fast.law.alpha
    )  # a gain that is given is kept
    assert pa.preflight(own, 1e-3)[0].part == "task feedback"


def loop(robot, controller, dt, **options):
    start = robot.position(robot.q0)
    return pa.simulate(
        robot,
        controller,
        pa.trajectories.Hold(start + np.array([0.01, 0.0, 0.0])),
        duration=1.0,
        engine=pa.Engine(dt=dt),
        **options,
    )


def test_the_longest_period_separates_loops_that_hold_from_loops_that_do_not():
    """The advice has a margin of two: at the advised period the loop holds, not at longer."""
    robot = catalogue_robot("ur5")
    dt = 0.04
    law = "adaptive-jacobian"
    default = pa.make_controller(robot, law=law, adaptation="none")
    gains = {
        "Kp": 16.0 * default.law.K_P,
        "Kv": 4.0 * default.law.K_v,
        "alpha": 4.0 * default.law.alpha,
    }  # four times the bandwidth
    controller = pa.make_controller(robot, law=law, adaptation="none", dt=dt, **gains)
    with pytest.warns(UserWarning, match="too long for the task feedback: take dt <= "):
        assert loop(robot, controller, dt).diverged is not None
    finding = pa.preflight(controller, dt)[0]
    assert finding.longest < dt and max(finding.factors.values()) < 1.0
    assert pa.preflight(controller, 0.99 * finding.longest) == []
    held = loop(robot, controller, 0.99 * finding.longest)
    assert held.diverged is None and held.distance[-1] < 5e-3
    slower = pa.make_controller(
        robot,
        law=law,
        adaptation="none",
        dt=dt,
        **{k: 0.99 * f * gains[k] for k, f in finding.factors.items()},
    )
    assert [finding.part for finding in pa.preflight(slower, dt)] == ["bandwidth"]


def test_default_rates_are_lowered_to_fit_the_period():
    """ANYmal C's leg, damped weakly in its heavy direction, has slower modes than usual."""
    believed = zoo_case("anymal_c_lf_leg").estimated
    controller = pa.make_controller(
        believed, law="adaptive-jacobian", unknown=pa.Unknown(friction=True, armature=False)
    )
    assert pa.preflight(controller, 1e-3) == []
    bodies, joints = (part.gamma for part, _ in controller.adaptation_d.parts)
    usual = {"gamma_d": 1.7 * bodies, "gamma_joint": 1.7 * joints}
    faster = pa.make_controller(
        believed,
        law="adaptive-jacobian",
        unknown=pa.Unknown(friction=True, armature=False),
        **usual,
    )
    assert [finding.part for finding in pa.preflight(faster, 1e-3)] == [
        "adaptation of the dynamics"
    ]
    slow = pa.make_controller(
        believed,
        law="adaptive-jacobian",
        unknown=pa.Unknown(friction=True, armature=False),
        dt=1e-4,
    )
    assert (
        bodies < slow.adaptation_d.parts[0][0].gamma
    )  # with a shorter period the usual rate is borne


def test_a_period_that_leaves_a_slow_feedback_is_found():
    robot = catalogue_robot("panda")
    dt = 2e-2
    (finding,) = pa.preflight(pa.make_controller(robot, dt=dt), dt)
    assert finding.part == "bandwidth"
    shorter = 0.99 * finding.longest
    assert 5e-3 < shorter < dt
    assert pa.preflight(pa.make_controller(robot, dt=shorter), shorter) == []


def test_motors_that_cannot_hold_the_model_are_told_when_it_is_made(recwarn):
    robot = catalogue_robot("panda")
    pa.make_controller(robot, adaptation="natural")
    assert not recwarn.list
    heavy = robot.changed(inertial_scale={robot.joint_names[3]: 300.0})  # a link of some 1000 kg
    with pytest.warns(UserWarning, match=r"cannot hold the model .*panda_joint2 \("):
        pa.make_controller(heavy, adaptation="natural")
