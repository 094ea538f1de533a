"""The shape of a constant gain: how far the truth may be from the belief."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.adaptation.natural import BodyInequality
from pinadapt.description.chain import is_physical
from pinadapt.models.pseudo_inertia import pseudo_inertia, ten_parameters
from pinadapt.tuning import defaults as prior
from pinadapt.tuning.defaults import (
    bandwidth,
    frequency,
    gradient_shape,
    plausible,
    prior_covariance,
)
from tests.support.chains import catalogue_robot
from tests.support.paper import BASIS

pytestmark = pytest.mark.slow


def lengths(robot):
    return [f"{name}:length" for name in robot.joint_names[1:]]


def test_ten_parameters_invert_the_pseudo_inertia():
    ten = np.arange(1.0, 11.0)
    assert np.allclose(ten_parameters(pseudo_inertia(ten)), ten)


def test_plausible_robots_are_physical_and_differ_only_where_they_may():
    robot = catalogue_robot("ur5")
    dynamics = pa.models.LumpedDynamics(robot, ["elbow_joint:length"], ["wrist_1_joint"])
    masses, stretched = [], []
    for true in plausible(robot, dynamics, 400):
        for joint in range(1, 7):
            same = true.model.inertias[joint].isApprox(robot.model.inertias[joint])
            assert same == (joint != 4)
            moved = not true.model.jointPlacements[joint].isApprox(
                robot.model.jointPlacements[joint]
            )
            assert moved == (joint == 3)
        assert is_physical(true.model.inertias[4].toDynamicParameters())
        masses.append(true.model.inertias[4].mass / robot.model.inertias[4].mass)
        stretched.append(np.linalg.norm(true.model.jointPlacements[3].translation))
    assert np.std(np.log(masses)) == pytest.approx(0.3, rel=0.2)
    assert np.std(stretched) == pytest.approx(0.1 * np.mean(stretched), rel=0.15)


def test_covariance_of_bodies_is_the_metric_of_natural_adaptation(monkeypatch):
    """To first order it is s^2 H^-1, H the Hessian of the log-det divergence at the body."""
    monkeypatch.setattr(prior, "INERTIA", 0.01)
    robot = catalogue_robot("panda")
    dynamics = pa.models.BodyDynamics(robot, "payload")
    samples = list(plausible(robot, dynamics, 4000))
    errors = np.array([dynamics.value(true) - dynamics.initial for true in samples])
    G = np.linalg.solve(pseudo_inertia(dynamics.initial), BodyInequality(["last"]).F)
    H = np.einsum("iab,jba->ij", G, G)
    root = np.linalg.cholesky(H)
    whitened = root.T @ (errors.T @ errors / len(errors)) @ root / 0.01**2
    assert (
        np.abs(np.linalg.eigvalsh(whitened) - 1.0).max() < 0.15
    )  # sampling: 10 numbers by 4000 samples


@pytest.mark.parametrize("law", ["adaptive-jacobian", "adaptive-inverse-dynamics"])
@pytest.mark.parametrize("unknown", ["lumped", "bodies", "basis"])
def test_default_gain_puts_the_fastest_mode_where_it_belongs(law, unknown):
    robot = catalogue_robot("planar_2r" if unknown == "basis" else "ur5")
    words = {
        "lumped": {"tool": False, "translations": lengths(robot)},
        "bodies": {},
        "basis": {"basis": BASIS},
    }
    controller = pa.make_controller(
        robot, law=law, adaptation="projected", unknown=pa.Unknown(**words[unknown])
    )
    w, law = bandwidth(robot, 1e-3), controller.law
    motion = pa.models.TypicalMotion(robot, controller.kinematics, controller.dynamics, w)
    Gamma = controller.adaptation_d.gain(controller.dynamics.initial)
    assert frequency(law.parameter_effects(motion), Gamma) == pytest.approx(
        law.adaptation_mode * w, rel=1e-6
    )


def test_a_basis_without_plausible_values_is_shaped_by_its_excitation():
    robot = catalogue_robot("planar_2r")
    effects = [np.array([[1.0, 2.0, 0.0]]), np.array([[1.0, 2.0, 0.0]])]
    basis = pa.make_controller(
        robot, adaptation="gradient", unknown=pa.Unknown(friction=False, armature=False)
    ).dynamics
    assert prior_covariance(robot, basis) is not None

    class Opaque(pa.models.BodyDynamics):
        def value(self, robot):
            return None

    assert np.allclose(
        np.diag(gradient_shape(robot, Opaque(robot), effects)), [1.0, 0.25, 1.0 / 4e-6]
    )


def test_units_far_apart_are_no_reason_to_refuse_a_gain():
    tiny = np.diag([1e9, 1e-9])
    assert np.array_equal(pa.adaptation.Gradient(tiny, 2).Gamma, tiny)
    correlated = np.array([[1e9, 0.999], [0.999, 1e-9]])
    assert pa.adaptation.Gradient(correlated, 2).Gamma[0, 1] == 0.999
    with pytest.raises(pa.GainError, match="definite"):
        pa.adaptation.Gradient(np.array([[1e9, 1.001], [1.001, 1e-9]]), 2)
