"""Default gains pass the check before a run; gains too fast for the period do not."""

import warnings

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.zoo.experiment import zoo_case
from tests.support.chains import catalogue_robot, robot_of

pytestmark = pytest.mark.slow

LAWS = [name for name, law in pa.laws.LAWS.items() if law.adapts]
EVERY = [("panda", 1e-3), ("scara", 5e-3), ("planar_2r", 5e-4)]  # under every law
ROBOTS = ["kinova", "talos_arm", "finger_edu"]  # under one law of each kind
KINDS = ["separation", "adaptive-inverse-dynamics", "slotine-li"]


@pytest.mark.parametrize(
    ("name", "dt", "law"),
    [(*loop, law) for loop in EVERY for law in LAWS]
    + [(name, 1e-3, law) for name in ROBOTS for law in KINDS]
    + [("talos_arm", 5e-3, "adaptive-jacobian")],
)
def test_default_gains_pass(name, dt, law):
    controller = pa.make_controller(
        robot_of(law, name), law=law, unknown=pa.Unknown(friction=True, armature=False), dt=dt
    )
    assert [str(finding) for finding in pa.preflight(controller, dt)] == []


@pytest.mark.parametrize("name", ["panda", "romeo_right_arm"])
def test_default_gains_of_a_pose_pass_too_slowed_where_they_must_be(name):
    robot = pa.load(name, task="pose")
    controller, fast = (
        pa.make_controller(robot, law="adaptive-jacobian", dt=dt) for dt in (1e-3, 1e-4)
    )
    assert [str(finding) for finding in pa.preflight(controller, 1e-3)] == []
    share = controller.law.alpha / fast.law.alpha
    assert 0.3 < share < 1.0
    assert np.isclose(controller.law.lambda_, share * fast.law.lambda_)
    filters, others = controller.law.filters, fast.law.filters
    for slowed, other in zip(vars(filters).values(), vars(others).values(), strict=True):
        assert np.isclose(slowed.bandwidth, share * other.bandwidth)
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


@pytest.mark.parametrize("law", ["adaptive-inverse-dynamics", "adaptive-jacobian"])
def test_the_longest_period_separates_loops_that_hold_from_loops_that_do_not(law):
    """The advice has a margin of two: at the advised period the loop holds, not at longer."""
    robot, dt = catalogue_robot("ur5"), 0.04
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
    assert pa.preflight(slower, dt) == []


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


def snake(joints):
    """Return a chain of equal links, their axes across and along in turn, without rotors."""
    model, parent, length = pin.Model(), 0, 0.1
    for i in range(joints):
        joint = pin.JointModelRZ() if i % 2 else pin.JointModelRY()
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, length if i else 0.0]))
        parent = model.addJoint(parent, joint, place, f"joint{i}")
        body = pin.Inertia(0.5, np.array([0.0, 0.0, 0.5 * length]), 1e-3 * np.eye(3))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, length]))
    model.addFrame(pin.Frame("tip", parent, 0, tip, pin.FrameType.BODY))
    return pa.load(model, frame="tip", q0=np.full(joints, 0.1))


def test_rotors_that_are_guessed_too_heavy_for_light_links_are_found():
    """Of 30 joints the guess for the first is 2 kg m^2, and the last link moves 1e-3 of it."""
    robot = snake(30)

    def held(dt, **options):
        controller = pa.make_controller(robot, dt=dt, adaptation="none", **options)
        found, engine = pa.preflight(controller, dt), pa.Engine(dt=dt)
        path = pa.trajectories.Hold(robot.position(robot.q0) - [0.0, 0.0, 0.01])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            rollout = pa.simulate(robot, controller, path, duration=0.03, engine=engine)
        return found, rollout.diverged is None

    (finding,), holds = held(1e-3)
    assert not holds and finding.part.startswith("task feedback") and finding.longest < 3e-4
    assert str(finding).endswith("unknown rotors is heavy beside these links.")
    assert "unknown=pa.Unknown(armature=False)" in str(finding)
    assert held(0.99 * finding.longest)[1]
    assert held(1e-3, unknown=pa.Unknown(armature=False)) == ([], True)


@pytest.mark.parametrize("name", ["panda", "tiago_arm", "allegro_left_index"])
def test_a_period_that_leaves_no_stiffness_against_gravity_is_found(name):
    robot = catalogue_robot(name)
    findings = {}
    for dt in (4e-3, 2e-2, 0.1):
        controller = pa.make_controller(robot, adaptation="natural", dt=dt)
        findings[dt] = pa.preflight(controller, dt)
    assert findings[4e-3] == []
    for dt in (2e-2, 0.1):
        (finding,) = findings[dt]
        assert finding.part == "bandwidth" and "displaces the arm by" in str(finding)
        shorter = 0.99 * finding.longest
        assert 5e-3 < shorter < dt
        assert pa.preflight(pa.make_controller(robot, dt=shorter), shorter) == []


def test_motors_that_cannot_hold_the_model_are_found():
    robot = catalogue_robot("panda")
    limits = pa.Limits(torque=np.full(robot.model.nv, 1e-7))
    controller = pa.make_controller(robot, adaptation="natural", limits=limits)
    (finding,) = pa.preflight(controller, 1e-3)
    assert finding.part == "motors" and "the motors cannot hold the model" in str(finding)
    assert pa.preflight(pa.make_controller(robot, adaptation="natural"), 1e-3) == []
