"""Least squares on the prediction error of the position: its V, and its speed."""

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.loops import circle_beside, energy_along, with_tool_and_load
from tests.support.paper import BASIS, CIRCLE, LMI

pytestmark = pytest.mark.slow

FIT = {"kinematic_adaptation": "least-squares"}
SLOPE = {"kinematic_adaptation": "gradient"}
SLOW = {"gamma_d": 1.0, "unknown": pa.Unknown(friction=False, armature=False)}


def planar(**options):
    robot = catalogue_robot("planar_2r")
    unknown = pa.Unknown(lengths=True, basis=BASIS, lmi=LMI, friction=False, armature=False)
    start = {"a_k": np.array([1.05, 1.3]), "a_d": np.array([4.0, 0.5, 0.5])}
    controller = pa.make_controller(robot, **{**SLOW, **FIT, "unknown": unknown, **options})
    return robot, controller, CIRCLE, start


def arm(name, plane="yz", **options):
    robot = catalogue_robot(name)
    true = with_tool_and_load(robot)
    nominal = robot.changed(inertial_scale=0.8)
    controller = pa.make_controller(nominal, **{**SLOW, **FIT, **options})
    return true, controller, circle_beside(true, plane), {}


def with_base(name, **options):
    unknown = pa.Unknown(tool=True, base=True, friction=False, armature=False)
    true, controller, _, start = arm(name, unknown=unknown, **options)
    base = {controller.kinematics.joint_names[0]: [0.2, -0.1, 0.05]}
    true = true.changed(link_translation=base)
    return true, controller, circle_beside(true, "yz"), start


CASES = {
    "planar": planar,
    "planar, (11)": lambda: planar(law="adaptive-inverse-dynamics"),
    "ur5, base": lambda: with_base("ur5"),
    "ur5, Jacobian": lambda: arm("ur5", law="adaptive-jacobian"),
    "panda, memory": lambda: arm("panda", adaptation="natural-memory"),
    "panda, (25)": lambda: arm("panda", law="adaptive-inverse-dynamics-velocity"),
    "slides": lambda: arm("scara", "xy"),
}


@pytest.mark.parametrize("case", CASES)
def test_lyapunov_equality_along_the_trajectory(case):
    """V contains da_k^T P^-1 da_k / 2 instead of a constant metric, for every law and weight."""
    true, controller, path, start = CASES[case]()
    energy = energy_along(true, controller, path, seconds=0.008, **start)
    energy.check(after=10)  # at first R rises from W_k = 0 in a few samples


def known_after(seconds, name="panda", *, base=False, sensors=None, **options):
    """Return the error of the kinematic estimate [m] after some time on a circle of 10 cm."""
    robot = catalogue_robot(name)
    true = with_tool_and_load(robot).changed(viscous=0.3, coulomb=0.3)
    if base:
        true = true.changed(link_translation={robot.joint_names[0]: [0.2, -0.1, 0.05]})
    unknown = pa.Unknown(tool=True, base=base)
    options = {"adaptation": "natural", "dt": 2e-3, **options}
    controller = pa.make_controller(robot, unknown=unknown, sensors=sensors, **options)
    path = pa.trajectories.Circle(np.zeros(3), 0.1, 3.0, "yz").starting_at(true.position(true.q0))
    rollout = pa.simulate(
        true, controller, path, duration=seconds, record_every=10, sensors=sensors
    )
    assert rollout.diverged is None
    wrong = np.linalg.norm(rollout.a_k - controller.kinematics.value(true), axis=1)
    return float(wrong[-1]), rollout


@pytest.mark.parametrize(("name", "camera"), [("panda", pa.Camera(30.0, 0.06)), ("ur5", None)])
def test_tool_is_identified_within_a_second(name, camera):
    wrong, rollout = known_after(1.0, name, sensors=pa.Sensors(camera=camera), **FIT)
    assert wrong < 1e-4
    assert rollout.distance[-5:].max() < 2e-3


def test_noisy_frames_are_averaged():
    """After three seconds the error is below that of gradient adaptation after ten (0.42 mm)."""
    seen = {"sensors": pa.Sensors(camera=pa.Camera(rate=30.0, delay=0.06), noise={"x": 1e-3})}
    wrong, _ = known_after(3.0, **seen, **FIT)
    assert wrong < 4e-4
    slow, _ = known_after(3.0, **seen, **SLOPE)
    assert slow > 4.0 * wrong


def test_base_and_tool_are_both_identified():
    """A small circle hardly excites both; gradient adaptation would take minutes."""
    wrong, _ = known_after(2.0, base=True, **FIT)
    slow, _ = known_after(2.0, base=True, **SLOPE)
    assert wrong < 1e-3 and slow > 50.0 * wrong and slow > 0.01


def test_directional_forgetting_acts_on_each_direction():
    """With one parameter unexcited the other is followed; bounded-gain forgetting stops both."""
    W = np.array([[1.0, 0.0]])
    ends = {}
    for directional in (False, True):
        fit = pa.adaptation.LeastSquares(
            1.0, 2, weight=10.0, forgetting=1.0, directional=directional
        )
        estimate = fit.init(np.zeros(2))
        excess = []
        for k in range(2000):
            truth = np.array([1.0 if k < 1000 else 2.0, 0.0])
            drive = pa.adaptation.Drive(np.zeros((1, 2)), None).with_prediction_error(
                W, W @ (estimate.value - truth)
            )
            estimate = fit.step(estimate, drive, 0.01)
            excess.append(np.linalg.eigvalsh(fit.gain(estimate) - fit.P_0)[-1])
        ends[directional] = abs(estimate.value[0] - 2.0)
        assert max(excess) <= 1e-12
    assert ends[True] < 1e-3 < 0.3 < ends[False]


def test_box_projects_in_the_metric_of_the_present_gain():
    """The nearest point of the box in the metric P^-1 does not increase da^T P^-1 da."""
    rng = np.random.default_rng(2)
    box = pa.adaptation.BoxProjection(
        pa.adaptation.LeastSquares(1.0, 3, weight=50.0), -np.ones(3), np.ones(3)
    )
    for _ in range(30):
        estimate = box.init(np.zeros(3))
        truth = rng.uniform(-1.0, 1.0, 3)
        for _ in range(5):
            W = rng.standard_normal((1, 3))
            noisy = W @ (estimate.value - truth) + rng.standard_normal(1)
            drive = pa.adaptation.Drive(np.zeros((1, 3)), None).with_prediction_error(W, noisy)
            after, free = (part.step(estimate, drive, 0.5) for part in (box, box.inner))
            assert box.contains(after.value)
            assert box.storage(after, truth) <= box.storage(free, truth) + 1e-12
            estimate = after
