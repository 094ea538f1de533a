"""Composite adaptation and least squares: their part of V and their speed."""

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.composite_arm import WEIGHT, tracked
from tests.support.exciting import times_of_panda
from tests.support.loops import circle_beside, energy_along, with_tool_and_load

pytestmark = pytest.mark.slow

# Slow enough for the constant metrics to keep the estimates where the laws' hypotheses hold.
RATES = {"natural-composite": 5.0, "composite": 1e-5, "least-squares": 1e-3}
LOOPS = [
    *(("separation", "panda", kind) for kind in RATES),
    ("adaptive-jacobian", "panda", "least-squares"),
    ("slotine-li", "kinova", "composite"),
    ("slotine-li", "scara", "least-squares"),
    # the others do not keep M_hat positive definite, which (11) inverts
    ("adaptive-inverse-dynamics", "panda", "natural-composite"),
]


def loop(law, name, adaptation, **gains):
    """Return a true robot, a controller of a lighter one, and a motion beside home."""
    robot = catalogue_robot(name, task="joint" if law == "slotine-li" else None)
    if law == "slotine-li":
        true = robot.changed(payload=pa.Payload(1.0))
        path = pa.trajectories.Sinusoid(robot.home_angles + 0.1, 0.1, 2.0)
    else:
        true = with_tool_and_load(robot)
        path = circle_beside(true, "xy" if name == "scara" else "yz")
    gains = {
        "gamma_d": RATES[adaptation],
        "unknown": pa.Unknown(friction=False, armature=False),
        **gains,
    }
    nominal = robot.changed(inertial_scale=0.7)
    return true, pa.make_controller(nominal, law=law, adaptation=adaptation, **gains), path


@pytest.mark.parametrize(("law", "name", "adaptation"), LOOPS)
def test_lyapunov_equality_along_the_trajectory(law, name, adaptation):
    """dV/dt is that of the law plus the term of the prediction error, for every law and metric."""
    true, controller, path = loop(law, name, adaptation)
    energy = energy_along(true, controller, path, seconds=0.004, dt=1e-4)
    energy.check(after=20)  # at first R rises from W = 0 within a few samples


@pytest.mark.parametrize("adaptation", RATES)
def test_lyapunov_equality_with_friction_and_rotors(adaptation):
    robot = catalogue_robot("ur5")
    true = with_tool_and_load(robot).changed(viscous=0.5, coulomb=0.2, armature=0.05)
    gains = {
        "gamma_d": RATES[adaptation],
        "gamma_joint": 1.0,
        "unknown": pa.Unknown(friction=True, armature=True),
    }
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.8), adaptation=adaptation, **gains
    )
    energy = energy_along(true, controller, circle_beside(true, "yz"), seconds=0.01)
    energy.check(after=10)


PUBLISHED = {  # adaptation, step [s], largest errors [degrees] from 0, 1.5 and 3 s on, estimate
    "none": (
        pa.adaptation.Frozen,
        1.25e-2,
        [[13.5, 7.8], [12.5, 5.8], [9.2, 2.8]],
        np.zeros(4),
    ),
    "direct": (
        lambda: pa.adaptation.Gradient(0.03, 4),
        6.25e-3,
        [[5.04, 1.15], [0.81, 1.15], [0.15, 0.07]],
        [0.1458, 0.0369, 0.0295, 0.0241],
    ),
    "least-squares": (
        lambda: pa.adaptation.LeastSquares(0.03, 4, 10.0, weight=WEIGHT, forgetting=4.0),
        6.25e-3,
        [[4.71, 1.56], [0.28, 0.44], [0.007, 0.009]],
        [0.1499, 0.0399, 0.03, 0.025],
    ),
}


@pytest.mark.parametrize("kind", PUBLISHED)
def test_case_of_slotine_and_li_1989(kind):
    """Slotine and Li (1989), to the digits."""
    adaptation, dt, errors, estimate = PUBLISHED[kind]
    e, a = tracked(adaptation(), dt)
    digits = (1, 1, 1) if kind == "none" else (2, 2, 3) if kind == "least-squares" else (2, 2, 2)
    for start, printed, places in zip((0.0, 1.5, 3.0), errors, digits, strict=True):
        assert np.round(e[round(start / dt) :].max(axis=0), places).tolist() == printed
    assert np.abs(a[-1] - estimate).max() <= (6e-5 if kind == "direct" else 1e-4)


def test_composite_adaptation_of_a_panda_is_at_least_twice_as_fast():
    (plain,) = times_of_panda("natural", (0.1,), False, seconds=1.3)
    (composite,) = times_of_panda("natural-composite", (0.1,))
    assert composite <= 0.5 * plain


def test_least_squares_without_forgetting_equals_the_weighted_fit():
    """Steps of any length solve min sum dt |W a - y|_R^2 + |a - a_0|^2 in the metric P(0)^-1."""
    rng, p, n, dt = np.random.default_rng(0), 4, 2, 0.3
    P_0 = np.diag(rng.uniform(0.5, 2.0, p))
    R = np.array([[2.0, 0.3], [0.3, 1.0]])
    adaptation = pa.adaptation.LeastSquares(P_0, p, 10.0, weight=R, forgetting=0.0)
    a_0 = rng.standard_normal(p)
    estimate = adaptation.init(a_0)
    information = np.linalg.inv(P_0)
    right = np.zeros(p)
    for _ in range(30):
        W = rng.standard_normal((n, p))
        y = rng.standard_normal(n)
        drive = pa.adaptation.Drive(np.zeros((1, p)), None).with_prediction_error(
            W, W @ estimate.value - y
        )
        estimate = adaptation.step(estimate, drive, dt)
        information = information + dt * W.T @ R @ W
        right = right + dt * W.T @ R @ (y - W @ a_0)
    assert np.allclose(estimate.value, a_0 + np.linalg.solve(information, right), atol=1e-12)
    assert np.allclose(estimate.memory[0], information, rtol=1e-12)


def test_gain_with_forgetting_stays_bounded():
    """P <= P(0) for any step, and without excitation P returns to P(0)."""
    rng = np.random.default_rng(0)
    p = 5
    adaptation = pa.adaptation.LeastSquares(
        np.linspace(0.5, 2.0, p), p, 10.0, weight=10.0, forgetting=3.0
    )
    estimate = adaptation.init(np.zeros(p))
    excess = []
    for k in range(400):
        W = rng.standard_normal((2, p)) if k < 200 else np.zeros((2, p))
        drive = pa.adaptation.Drive(np.zeros((1, p)), None).with_prediction_error(W, np.zeros(2))
        estimate = adaptation.step(estimate, drive, 0.05)
        P = adaptation.gain(estimate)
        excess.append(np.linalg.eigvalsh(P - adaptation.P_0)[-1])
        assert np.linalg.eigvalsh(P)[0] > 0.0
        if k == 199:
            assert adaptation.size(estimate.memory[0]) < 0.5
    assert max(excess) <= 1e-12
    assert abs(adaptation.size(estimate.memory[0]) - 1.0) < 1e-9


@pytest.mark.parametrize("adaptation", RATES)
def test_prediction_error_adapts_while_the_motors_saturate(adaptation):
    """The tracking part is dropped; the prediction error still improves the estimate."""
    limits = pa.Limits(guards=False)  # motors that cannot carry the arm look like a wrong sign
    true, controller, path = loop("slotine-li", "ur5", adaptation, limits=limits)
    weak = controller.limited(np.full(6, 1e-3))
    rollout = pa.simulate(true, weak, path, duration=0.2)
    truth = controller.dynamics.value(true)
    V = [weak.adaptation_d.storage(pa.adaptation.Estimate(a), truth) for a in rollout.a_d]
    assert V[-1] < V[0]
    assert (np.diff(V) <= 1e-9 * V[0]).all()
