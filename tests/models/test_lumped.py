"""Lumped parameters: exact at any lengths, minimal, and adaptable with every law."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pinadapt as pa
from pinadapt.models.translations import Translation
from pinadapt.scenario.scenario import Scenario
from tests.support.chains import (
    catalogue_robot,
    chains_of,
    each_size,
    random_state,
    seeded,
    seeds,
)
from tests.support.loops import circle_beside, energy_along
from tests.support.paper import BASIS
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow

ROBOTS = ROOT / "robots"
IMPROVED = "adaptive-inverse-dynamics-improved"
SOME = (1, 2, 3, 5, 7)  # numbers of joints; more take long


def translations(robot, rng):
    """Return unknown translations of over half of the joints: whole, or lengths."""
    found = []
    for joint, name in enumerate(robot.joint_names, 1):
        if rng.random() < 0.4 and joint > 1:
            continue
        nominal = robot.model.jointPlacements[joint].translation
        directions = np.eye(3)
        length = np.linalg.norm(nominal)
        if rng.random() < 0.6 and length > 1e-9:
            directions = nominal[:, None] / length
        labels = tuple(f"{name}_{i}" for i in range(directions.shape[1]))
        found.append(Translation(name, joint, directions, labels))
    return found


def another(robot, parts, rng):
    """Return a robot with other lengths and other inertias."""
    shifts = {
        part.name: part.directions @ rng.uniform(-0.3, 0.3, part.directions.shape[1])
        for part in parts
    }
    scales = {name: rng.uniform(0.4, 2.0) for name in robot.joint_names}
    return robot.changed(link_translation=shifts, inertial_scale=scales)


def check_exact(dynamics, true, rng):
    """The wrong robot's parameters, at the true value, give the true torque and mass matrix."""
    a_d = dynamics.value(true)
    assert a_d is not None
    q, v, a = random_state(true, rng)
    v_r, a_r = rng.standard_normal((2, true.model.nv))
    model = true.model
    data = true.model.createData()
    tau = pin.rnea(model, data, q, v, a)
    M = pin.crba(model, data, q).copy()
    g = pin.computeGeneralizedGravity(model, data, q).copy()
    C = pin.computeCoriolisMatrix(model, data, q, v).copy()
    scale = 1.0 + np.abs(tau).max()
    known = dynamics.torque(q, v, a) - dynamics.regressor(q, v, a) @ dynamics.initial
    assert np.allclose(dynamics.regressor(q, v, a) @ a_d + known, tau, atol=1e-9 * scale)
    dynamics.load(a_d)
    assert np.allclose(dynamics.torque(q, v, a), tau, atol=1e-9 * scale)
    assert np.allclose(dynamics.mass_matrix(q), M, atol=1e-8 * (1.0 + np.abs(M).max()))
    Y_r, torque = dynamics.slotine_li(q, v, v_r, a_r)
    expected = M @ a_r + C @ v_r + g
    assert np.allclose(torque, expected, atol=1e-8 * (1.0 + np.abs(expected).max()))
    assert np.allclose(
        Y_r @ (a_d - dynamics.initial),
        torque - at(dynamics, dynamics.initial, q, v, v_r, a_r),
        atol=1e-8 * scale,
    )


def at(dynamics, a_d, *state):
    dynamics.load(a_d)
    return dynamics.slotine_li(*state)[1]


@each_size(SOME, seed=0, rotors=0.2)
@given(robot=chains_of(SOME), seed=seeds, rotors=st.sampled_from([0.0, 0.2]))
@settings(seeded, max_examples=1)
def test_lumped_regressor_equals_rnea_at_the_true_lengths(robot, seed, rotors):
    rng = np.random.default_rng(seed)
    wrong = robot.changed(armature=rotors)
    parts = translations(wrong, rng)
    true = another(wrong, parts, rng)
    dynamics = pa.models.LumpedDynamics(wrong, parts)
    check_exact(dynamics, true, rng)
    q, v, a = random_state(wrong, rng)  # the regressor does not depend on the nominal lengths
    assert np.array_equal(
        dynamics.regressor(q, v, a), pa.models.LumpedDynamics(true, parts).regressor(q, v, a)
    )


@pytest.mark.parametrize("name", ["panda", "scara"])
def test_lumped_parameters_of_catalogue_robots(name):
    robot = catalogue_robot(name)
    rng = np.random.default_rng(0)
    dynamics = pa.models.LumpedDynamics(robot)
    check_exact(dynamics, another(robot, dynamics.translations, rng), rng)


def test_number_of_lumped_parameters():
    ur5 = catalogue_robot("ur5")
    five = pa.models.LumpedDynamics(ur5, [f"{name}:length" for name in ur5.joint_names[1:]])
    assert five.size == len(set(five.names)) == 56
    pendulum = pa.load("planar_2r", gravity=[0.0, -9.81, 0.0])
    assert pa.models.LumpedDynamics(pendulum).size == 8
    with pytest.raises(pa.ParameterError, match="nothing has to be lumped"):
        pa.models.LumpedDynamics(ur5, ["tool"])


def ur5(law, adaptation, **options):
    """Return the true robot, the controller of a wrong one, and a path."""
    robot = catalogue_robot("ur5")
    names = robot.joint_names[1:]
    shifts = {
        name: 0.1 * robot.model.jointPlacements[i].translation for i, name in enumerate(names, 2)
    }
    true = robot.changed(link_translation=shifts)
    lengths = [f"{name}:length" for name in names]
    nominal = robot.changed(inertial_scale=0.7)
    controller = pa.make_controller(
        nominal,
        law=law,
        adaptation=adaptation,
        unknown=pa.Unknown(tool=False, translations=lengths),
        **options,
    )
    return true, controller, circle_beside(true, "yz")


@pytest.mark.parametrize(
    ("law", "adaptation"),
    [
        ("adaptive-jacobian", "gradient"),
        (IMPROVED, "gradient"),
        ("adaptive-inverse-dynamics", "projected"),
    ],
)
def test_lyapunov_equality(law, adaptation):
    """The proofs hold with lengths and inertias both unknown."""
    true, controller, path = ur5(law, adaptation)
    if law == IMPROVED:  # slowly enough that M + M_0 - M_hat stays invertible meanwhile
        true, controller, path = ur5(
            law,
            adaptation,
            gamma_d=0.2
            * controller.adaptation_d.gain(pa.adaptation.Estimate(controller.dynamics.initial)),
        )
    assert controller.dynamics.size == 56
    energy = energy_along(true, controller, path, seconds=0.009, dt=6e-4)
    energy.check()


def projections():
    robot = catalogue_robot("ur5")
    planar = catalogue_robot("planar_2r")
    lengths = [f"{name}:length" for name in robot.joint_names[1:]]
    return {
        "lumped": (robot, pa.models.LumpedDynamics(robot, lengths)),
        "bodies": (robot, pa.models.BodyDynamics(robot)),
        "payload": (robot, pa.models.BodyDynamics(robot, "payload")),
        "basis": (planar, pa.models.BasisDynamics(planar, BASIS)),
    }


@pytest.mark.parametrize("case", ["lumped", "bodies", "payload", "basis"])
def test_projection_keeps_the_mass_matrix_positive_and_reduces_the_distance_to_the_truth(case):
    robot, dynamics = projections()[case]
    rng = np.random.default_rng(2)
    size = dynamics.size
    factor = rng.standard_normal((size, size)) / np.sqrt(size)
    scale = np.diag(np.maximum(np.abs(dynamics.initial), 1e-3 * np.abs(dynamics.initial).max()))
    Gamma = scale @ (factor @ factor.T + np.eye(size)) @ scale
    adaptation = pa.adaptation.MassMatrixProjection(
        pa.adaptation.Gradient(Gamma, size), dynamics, robot
    )
    data = robot.model.createData()
    moved = 0
    for _ in range(30):
        q, _, _ = random_state(robot, rng)
        a = dynamics.initial + 3.0 * scale @ rng.standard_normal(size)
        kept = adaptation.project(pa.adaptation.Estimate(a), q)
        M_0 = pin.crba(robot.model, data, q)
        dynamics.load(kept)
        ratios = np.linalg.eigvals(np.linalg.solve(M_0, dynamics.mass_matrix(q))).real
        assert ratios.min() >= 0.1 - 1e-9
        moved += kept is not a
        for true in (
            dynamics.initial,
            0.3 * dynamics.initial if case != "payload" else dynamics.initial,
        ):
            before = adaptation.storage(pa.adaptation.Estimate(a), true)
            assert adaptation.storage(pa.adaptation.Estimate(kept), true) <= before * (1.0 + 1e-12)
        assert (
            adaptation.project(pa.adaptation.Estimate(dynamics.initial), q) is dynamics.initial
        )  # inside already
    assert moved > 3


def test_projection_prevents_divergence_of_gradient_adaptation():
    """A rate at which law (11) with a plain gradient diverges soon (see test_showcase)."""
    settings = [
        "controller.adaptation=projected",
        "controller.gamma_d=0.1",
        "simulation.duration=0.6",
    ]
    rollout = Scenario.read(ROBOTS / "panda" / "tool_and_load.toml", settings).run()
    assert rollout.diverged is None
    assert rollout.min_eig_M_hat.min() > 0.0


def test_ur5_learns_five_lengths_and_all_inertias():
    shorter = ["simulation.duration=3.0", "controller.dt=0.004"]
    scenario = Scenario.read(ROBOTS / "ur5" / "unknown_lengths.toml", shorter)
    rollout = scenario.run()
    assert rollout.diverged is None
    assert (len(rollout.dynamic_names), len(rollout.kinematic_names)) == (56, 5)
    assert rollout.summary()["max_error_last"] <= 1e-3
    assert rollout.distance[rollout.t < 1.0].max() > 4e-3  # the initial error is large
    assert (np.diff(rollout.lyapunov) < 1e-4 * rollout.lyapunov[0]).all()
    assert rollout.lyapunov[-1] < 0.5 * rollout.lyapunov[0]
