"""Modifications of an adaptation: their effect on dV/dt, composition, and names."""

import math

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.drives import along
from tests.support.loops import circle_beside, energy_along, with_tool_and_load
from tests.support.snapshots import leaves

pytestmark = pytest.mark.slow

_SYMMETRIC = np.array([[[1, 0], [0, 0]], [[0, 1], [1, 0]], [[0, 0], [0, 1]]], dtype=float)
INNER = {
    "natural": lambda: pa.adaptation.Natural(0.7, pa.adaptation.MatrixInequality(_SYMMETRIC)),
    "gradient": lambda: pa.adaptation.Gradient(
        [[0.3, 0.1, 0.0], [0.1, 0.2, 0.0], [0.0, 0.0, 0.5]], 3
    ),
    "composite": lambda: pa.adaptation.Composite(
        pa.adaptation.Gradient(0.3, 3), 10.0, rate=2.0, floor=0.1
    ),
    "natural composite": lambda: pa.adaptation.Composite(
        INNER["natural"](), 10.0, weight=[2.0, 3.0]
    ),
    "least squares": lambda: pa.adaptation.LeastSquares([0.3, 0.2, 0.5], 3, 10.0, weight=3.0),
    "directional": lambda: pa.adaptation.LeastSquares(
        0.3, 3, 10.0, weight=None, rate=4.0, floor=0.1, directional=True
    ),
    "stacked": lambda: pa.adaptation.Stacked(
        [
            (pa.adaptation.Gradient(0.3, 1), 1),
            (pa.adaptation.ExponentiatedGradient(0.5, [2.0, 3.0]), 2),
        ]
    ),
}
WRAPPERS = {
    "sigma": lambda inner: pa.adaptation.Leak(inner, 0.4),
    "e1": lambda inner: pa.adaptation.ErrorLeak(inner, 0.4, 0.3),
    "dead zone": lambda inner: pa.adaptation.DeadZone(inner, [0.2, 0.3], 0.1),
    "normalised": lambda inner: pa.adaptation.Normalised(inner, 2.0),
    "box": lambda inner: pa.adaptation.BoxProjection(inner, [0.5, 0.1, 0.5], [2.0, 0.9, 2.0]),
}
START, TRUTH = np.array([1.2, 0.15, 1.4]), np.array([0.9, 0.4, 1.1])


def drive_at(a, rng_seed=0, noise=0.0):
    """Return a drive with both parts, whose prediction error is W da and noise."""
    rng = np.random.default_rng(rng_seed)
    Y = rng.standard_normal((2, 3))
    e = rng.standard_normal(2)
    W = rng.standard_normal((2, 3))
    residual = W @ (a - TRUTH) + noise * rng.standard_normal(2)
    return pa.adaptation.Drive(Y, e).with_prediction_error(W, residual)


def change_of_storage(adaptation, estimate, drive, h):
    """Return d/dt of the adaptation's part of V along its rate, by central differences."""
    rate = adaptation.rate(estimate, drive)

    def moved(part, slope, h):
        if isinstance(part, tuple):
            return tuple(moved(p, s, h) for p, s in zip(part, slope, strict=True))
        return part + h * slope

    def at(h):
        return adaptation.storage(
            pa.adaptation.Estimate(
                moved(estimate.value, rate.value, h), moved(estimate.memory, rate.memory, h)
            ),
            TRUTH,
        )

    return (at(h) - at(-h)) / (2.0 * h)


def begun(adaptation):
    """Return an estimate whose memory differs from the initial one."""
    estimate = adaptation.init(START)
    for k in range(3):
        estimate = adaptation.step(estimate, drive_at(estimate.value, k), 0.05)
    return estimate


def test_parts_of_a_drive_know_that_a_motor_saturates():
    """Else a memory inside a modification takes an obstacle for a load."""
    drive = drive_at(START).without_tracking()
    parts = drive.scaled(0.5, 0.5), drive.columns(slice(2)), drive.weighted(np.eye(2))
    assert all(part.saturated for part in parts)


@pytest.mark.parametrize("wrapper", WRAPPERS)
@pytest.mark.parametrize("inner", INNER)
def test_dissipation_states_the_change_of_the_rate_of_v(wrapper, inner):
    """dV/dt of the parameters' part is -da^T g plus the adaptation's ``dissipation``."""
    adaptation = WRAPPERS[wrapper](INNER[inner]())
    estimate = begun(adaptation)
    drive = drive_at(estimate.value)
    change = change_of_storage(adaptation, estimate, drive, 1e-5)
    error = estimate.value - TRUTH
    claimed = -error @ drive.gradient + adaptation.dissipation(estimate, drive, TRUTH)
    of_inner = (
        estimate.memory[1:] if isinstance(adaptation, pa.adaptation.Leak) else estimate.memory
    )
    inside = pa.adaptation.Estimate(estimate.value, of_inner)
    plain = -error @ drive.gradient + adaptation.inner.dissipation(inside, drive, TRUTH)
    assert change == pytest.approx(claimed, rel=1e-5, abs=1e-8)
    if wrapper != "box":
        assert abs(claimed - plain) > 1e-3  # the modification has an effect here


@pytest.mark.parametrize("wrapper", [None, "sigma"])
@pytest.mark.parametrize("inner", INNER)
def test_small_steps_follow_the_rate(inner, wrapper):
    adaptation = INNER[inner]()
    adaptation = WRAPPERS[wrapper](adaptation) if wrapper else adaptation
    estimate = begun(adaptation)
    drive = drive_at(estimate.value, noise=0.1)
    h = 1e-6
    rate = adaptation.rate(estimate, drive)
    after = adaptation.step(estimate, drive, h)
    for new, old, slope in zip(*map(leaves, (after, estimate, rate)), strict=True):
        assert np.abs((new - old) / h - slope).max() <= 1e-4 * np.abs(slope).max()


@pytest.mark.parametrize("inner", INNER)
def test_the_gain_is_that_of_a_gradient(inner):
    adaptation = INNER[inner]()
    G = np.random.default_rng(0).standard_normal((3, 4))
    estimate = begun(adaptation)
    rates = [adaptation.rate(estimate, along(g)).value for g in G.T]
    assert np.allclose(adaptation.gain_times(estimate, G), -np.array(rates).T, rtol=1e-12)


LOOPS = [
    ("slotine-li", "panda", "natural", ["sigma", "normalised"]),
    ("separation", "ur5", "natural", {"e1": 2.0, "dead-zone": 0.01}),
    ("separation", "ur5", "natural-composite", {"dead-zone": 0.01, "sigma": 0.5}),
    ("adaptive-jacobian", "panda", "gradient", {"dead-zone": 0.01, "normalised": 2.0}),
    ("slotine-li", "scara", "least-squares", {"normalised": 1.0, "sigma": 0.5}),
    ("adaptive-inverse-dynamics", "ur5", "natural", ["normalised", "sigma"]),
]


@pytest.mark.parametrize(("law", "name", "adaptation", "modifications"), LOOPS)
def test_lyapunov_equality_along_the_trajectory(law, name, adaptation, modifications):
    robot = catalogue_robot(name, task="joint" if law == "slotine-li" else None)
    joints = law == "slotine-li"
    true = robot.changed(payload=pa.Payload(1.0)) if joints else with_tool_and_load(robot)
    rates = {"natural": 1.0, "natural-composite": 1.0, "gradient": 1e-3, "least-squares": 1e-3}
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.8),
        law=law,
        adaptation=adaptation,
        modifications=modifications,
        gamma_d=rates[adaptation],
        **(
            {"gamma_joint": 1.0, "unknown": pa.Unknown(friction="viscous", armature=False)}
            if name == "panda"
            else {"unknown": pa.Unknown(friction=False, armature=False)}
        ),
    )
    path = (
        pa.trajectories.Sinusoid(robot.home_angles + 0.1, 0.1, 2.0)
        if joints
        else circle_beside(true, "yz")
    )
    energy = energy_along(true.changed(viscous=0.3) if name == "panda" else true, controller, path,
                          seconds=0.01)  # fmt: skip
    assert energy.mismatch(after=10) <= 1e-4
    assert np.abs(energy.rate).max() > 1e-4


def test_dead_zone_is_continuous_and_zero_inside():
    zone = pa.adaptation.DeadZone(pa.adaptation.Gradient(1.0, 1), 0.5)
    start = zone.init(np.zeros(1))
    for e in np.linspace(-2.0, 2.0, 41):
        rate = zone.rate(start, pa.adaptation.Drive(np.ones((1, 1)), np.array([e]))).value[0]
        assert rate == pytest.approx(-math.copysign(max(abs(e) - 0.5, 0.0), e))


@pytest.mark.parametrize("inner", ["gradient", "least squares", "natural"])
def test_noise_inside_the_dead_zone_never_increases_v(inner):
    """Prediction error with noise n of at most the zone, R = 1: V never increases, for any n."""
    own = INNER[inner]()
    rng = np.random.default_rng(4)
    rises = 0
    zone = pa.adaptation.DeadZone(own, None, 0.3)
    estimate = zone.init(START)
    for _ in range(300):
        W = rng.standard_normal((2, 3))
        n = rng.uniform(-0.3, 0.3, 2)
        residual = W @ (estimate.value - TRUTH) + n
        drive = pa.adaptation.Drive(np.zeros((1, 3)), None, W, residual, np.eye(2))
        V = [a.storage(a.step(estimate, drive, 1e-4), TRUTH) for a in (zone, own)]
        before = own.storage(estimate, TRUTH)
        assert V[0] <= before + 1e-7 * abs(before)
        rises += V[1] > before
        estimate = zone.step(estimate, drive, 0.02)
    assert rises > 10  # without the zone


def test_normalised_adaptation_is_bounded_for_large_regressors():
    rng = np.random.default_rng(5)
    slow = pa.adaptation.Normalised(pa.adaptation.Gradient([0.5, 1.0, 2.0], 3), 3.0)
    start = slow.init(np.zeros(3))
    e = np.array([0.3, -0.4])
    for size in np.geomspace(1e-2, 1e4, 20):
        Y = size * rng.standard_normal((2, 3))
        rate = slow.rate(start, pa.adaptation.Drive(Y, e)).value
        assert np.linalg.norm(Y @ rate) <= 3.0 * np.linalg.norm(e)
    small = slow.rate(start, pa.adaptation.Drive(1e-4 * np.ones((2, 3)), e)).value
    assert np.allclose(
        small, slow.inner.rate(start, pa.adaptation.Drive(1e-4 * np.ones((2, 3)), e)).value
    )
