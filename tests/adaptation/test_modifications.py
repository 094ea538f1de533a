"""Modifications of an adaptation: their effect on dV/dt, composition, and names."""

import math
import pickle
from itertools import islice, permutations

import numpy as np
import pytest

import pinadapt as pa
from benchmarks.modifications import measure
from pinadapt.description.catalogue import robots_folder
from pinadapt.scenario.scenario import Scenario
from tests.support.chains import catalogue_robot
from tests.support.drives import along
from tests.support.loops import circle_beside, energy_along, with_tool_and_load

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
    Y, e, W = rng.standard_normal((2, 3)), rng.standard_normal(2), rng.standard_normal((2, 3))
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


@pytest.mark.parametrize("first", WRAPPERS)
@pytest.mark.parametrize("second", WRAPPERS)
@pytest.mark.parametrize("inner", ["natural", "directional", "composite"])
def test_modifications_compose_in_any_order(inner, first, second):
    adaptation = WRAPPERS[first](WRAPPERS[second](INNER[inner]()))
    estimate = adaptation.init(START)
    for k in range(6):
        drive = drive_at(estimate.value, k, noise=0.1)
        rate, after = adaptation.rate(estimate, drive), adaptation.step(estimate, drive, 1e-6)
        assert np.allclose((after.value - estimate.value) / 1e-6, rate.value, rtol=2e-3, atol=1e-4)
        estimate = adaptation.step(estimate, drive, 0.02)
        assert adaptation.contains(estimate.value) and np.isfinite(estimate.value).all()
    same = pickle.loads(pickle.dumps(adaptation)).step(estimate, drive, 0.02)
    assert np.array_equal(same.value, adaptation.step(estimate, drive, 0.02).value)


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


def test_effect_of_the_leak_is_bounded_by_the_initial_error():
    """For a constant Gamma dV/dt changes by at most -lambda (D(a) - D(a_0))."""
    rng, lambda_ = np.random.default_rng(3), 0.4
    leak = pa.adaptation.Leak(pa.adaptation.Gradient([0.2, 0.5, 1.0], 3), lambda_)
    quiet = pa.adaptation.Drive(np.zeros((1, 3)), None)
    for _ in range(200):
        start, a, truth = rng.standard_normal((3, 3))
        D = leak.inner.divergence
        gained = leak.dissipation(pa.adaptation.Estimate(a, (start,)), quiet, truth)
        assert gained <= -lambda_ * (D(a, truth) - D(start, truth)) + 1e-12


def test_error_leak_vanishes_with_the_error():
    leak = pa.adaptation.ErrorLeak(pa.adaptation.Gradient(1.0, 3), 2.0, [0.1, 0.2])
    estimate = leak.init(np.zeros(3)).with_value(np.ones(3))
    Y = np.zeros((2, 3))
    for e, share in (([0.0, 0.0], 0.0), ([0.1, 0.2], 1.0), ([0.3, 0.0], 3.0 / math.sqrt(2.0))):
        after = leak.step(estimate, pa.adaptation.Drive(Y, np.array(e)), 0.1)
        assert np.allclose(after.value, math.exp(-2.0 * share * 0.1))
    assert np.allclose(leak.step(estimate, pa.adaptation.Drive(Y, None), 0.1).value, 1.0)


def test_dead_zone_is_continuous_and_zero_inside():
    zone = pa.adaptation.DeadZone(pa.adaptation.Gradient(1.0, 1), 0.5)
    start = zone.init(np.zeros(1))
    for e in np.linspace(-2.0, 2.0, 41):
        rate = zone.rate(start, pa.adaptation.Drive(np.ones((1, 1)), np.array([e]))).value[0]
        assert rate == pytest.approx(-math.copysign(max(abs(e) - 0.5, 0.0), e))


@pytest.mark.parametrize("inner", ["gradient", "least squares", "natural"])
def test_noise_inside_the_dead_zone_never_increases_v(inner):
    """Prediction error with noise n of at most the zone, R = 1: V never increases, for any n."""
    own, rng, rises = INNER[inner](), np.random.default_rng(4), 0
    zone = pa.adaptation.DeadZone(own, None, 0.3)
    estimate = zone.init(START)
    for _ in range(300):
        W, n = rng.standard_normal((2, 3)), rng.uniform(-0.3, 0.3, 2)
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
    start, e = slow.init(np.zeros(3)), np.array([0.3, -0.4])
    for size in np.geomspace(1e-2, 1e4, 20):
        Y = size * rng.standard_normal((2, 3))
        rate = slow.rate(start, pa.adaptation.Drive(Y, e)).value
        assert np.linalg.norm(Y @ rate) <= 3.0 * np.linalg.norm(e)
    small = slow.rate(start, pa.adaptation.Drive(1e-4 * np.ones((2, 3)), e)).value
    assert np.allclose(
        small, slow.inner.rate(start, pa.adaptation.Drive(1e-4 * np.ones((2, 3)), e)).value
    )


def test_saturation_leaves_the_prediction_part():
    robot = catalogue_robot("ur5", task="joint")
    true = robot.changed(payload=pa.Payload(2.0))
    weak = pa.make_controller(
        robot,
        law="slotine-li",
        adaptation="natural-composite",
        unknown=pa.Unknown(friction=False, armature=False),
        modifications={"normalised": 0.5, "dead-zone": 1e-4},
    ).limited(np.full(6, 1e-3))
    path = pa.trajectories.Sinusoid(robot.home_angles + 0.1, 0.1, 2.0)
    rollout = pa.simulate(true, weak, path.as_given(), duration=0.2)
    V = [weak.adaptation_d.divergence(a, weak.dynamics.value(true)) for a in rollout.a_d]
    assert V[-1] < V[0] and (np.diff(V) <= 1e-9 * V[0]).all()


def chain(adaptation):
    """Return the names of the classes from the outermost wrapper to the inner adaptation."""
    names = []
    while isinstance(adaptation, pa.adaptation.Wrapper):
        names.append(type(adaptation).__name__)
        adaptation = adaptation.inner
    return names


def test_names_and_gains():
    robot = catalogue_robot("ur5")

    def made(modifications, **options):
        options = {"adaptation": "natural"} | options
        return pa.make_controller(robot, modifications=modifications, **options).adaptation_d

    classes = {"sigma": "Leak", "e1": "ErrorLeak", "normalised": "Normalised"}
    for order in permutations(classes):
        assert chain(made(order)) == [classes[name] for name in reversed(order)]
    assert chain(made("projection")) == ["MassMatrixProjection"]
    assert made({"sigma": 0.3}).bandwidth == 0.3
    assert chain(made({"sigma": True, "e1": False})) == ["Leak"]
    noisy = {"sensors": pa.Sensors(encoder=2.0 * np.pi / 2**17)}
    assert chain(made(None, **noisy)) == ["Leak"]  # the default for noise
    assert chain(made({"sigma": 0.3}, **noisy)) == ["Leak"]  # instead of the default
    assert not chain(made({"sigma": False}, **noisy))
    assert chain(made(None, **noisy, adaptation=None)) == ["CompositeMemory"]  # it averages
    assert chain(made("sigma", adaptation=None)) == ["Leak", "CompositeMemory"]
    zone = made("dead-zone", **noisy)
    assert chain(zone) == ["Leak", "DeadZone"] and 0.0 < zone.inner.size < 0.1
    own = made(["sigma"], adaptation=pa.adaptation.Gradient(1e-3, 78))
    assert chain(own) == ["Leak"] and isinstance(own.inner, pa.adaptation.Gradient)
    assert made("sigma", adaptation="none").name == "none"
    cited = pa.citation(pa.make_controller(robot, modifications=["e1", "normalised"]))
    assert "NarendraAnnaswamy1987" in cited and "IoannouSun1996" in cited


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("sigmma", "Did you mean 'sigma'"),
        (["e1", "deadzone"], "Did you mean 'dead-zone'"),
        (3.0, "modifications"),
        ("dead-zone", "no noise"),
        ({"projection": 2.0}, "no gain"),
        ({"sigma": -1.0}, "leak"),
        ({"e1": 0.0}, "leak"),
        ({"normalised": -1.0}, "normalised"),
        ({"dead-zone": [0.1, -0.1]}, "positive"),
    ],
)
def test_invalid_modifications_are_refused(given, message):
    with pytest.raises(pa.InputError, match=message):
        pa.make_controller(catalogue_robot("ur5"), modifications=given)


def test_laws_with_another_error_have_no_default_size():
    robot, law = catalogue_robot("ur5"), "adaptive-inverse-dynamics"
    for given in ("e1", "dead-zone"):
        with pytest.raises(pa.GainError, match="another error"):
            pa.make_controller(
                robot, law=law, modifications=given, sensors=pa.Sensors(encoder=1e-4)
            )
    made = pa.make_controller(robot, law=law, modifications={"dead-zone": 0.1})
    assert chain(made.adaptation_d) == ["DeadZone"]


def test_scenario_with_the_names():
    path = robots_folder() / "panda" / "tool_and_load.toml"
    natural = "controller.adaptation=natural"
    words = [natural, 'controller.modifications=["e1", "normalised"]']
    assert chain(Scenario.read(path, words).controller.adaptation_d) == ["Normalised", "ErrorLeak"]
    table = [natural, "controller.modifications={sigma=0.3, dead-zone=0.02}"]
    made = Scenario.read(path, table).controller.adaptation_d
    assert chain(made) == ["DeadZone", "Leak"] and made.inner.bandwidth == 0.3
    for wrong in ('"sigmaa"', "{sigma=-1.0}", "{normalized=true}"):
        with pytest.raises(pa.InputError):
            Scenario.read(path, [f"controller.modifications={wrong}"])


def test_a_copy_gives_the_same_torques():
    robot = catalogue_robot("ur5")
    true = with_tool_and_load(robot)
    controller = pa.make_controller(
        robot, modifications={"dead-zone": 0.01, "sigma": 0.1, "e1": 1.0}
    )
    run = list(
        islice(pa.run(pa.plants.PinocchioPlant(true), controller, circle_beside(true, "yz")), 20)
    )
    copied = pickle.loads(pickle.dumps(controller))
    for sample in run:
        torque, _ = copied.step(sample.state, sample.measurement, sample.desired, 1e-3)
        assert np.array_equal(torque, sample.torque)
    announced = controller.announce(run[-1].state, payload=pa.Payload(1.0))
    assert np.isfinite(
        controller.adaptation_d.step(announced.dynamic, along(np.zeros(78)), 1.0).value
    ).all()


@pytest.mark.parametrize(("kind", "factor"), [("none", 1.0), ("normalised", 3.0)])
def test_late_motors_cause_no_chatter_also_without_normalisation(kind, factor):
    """The feedback is for a lag of 5 ms, the motors are 6 ms late."""
    found = measure("ur5", "late motors", kind, factor)
    assert found["chatter"] < 0.05 and found["error_mm"] < 0.05


def test_projection_prevents_divergence_of_law_11_under_noise():
    plain, kept = (
        measure("ur5", "noise, law (11), gradient", kind, 3.0) for kind in ("none", "projection")
    )
    assert plain["diverged"] is not None and kept["diverged"] is None
    assert kept["error_mm"] < 5.0
