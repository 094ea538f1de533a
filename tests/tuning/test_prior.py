"""The shape of a constant gain: how far the truth may be from the model."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.adaptation.natural import BodyInequality
from pinadapt.models.bodies import pseudo_inertia
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


def test_covariance_of_bodies_is_the_metric_of_natural_adaptation(monkeypatch):
    """To first order it is s^2 H^-1, H the Hessian of the log-det divergence at the body."""
    monkeypatch.setattr(prior, "INERTIA", 0.01)
    robot = catalogue_robot("panda")
    dynamics = pa.models.BodyDynamics(robot, "payload")
    tens, stretched = plausible(robot, dynamics, 4000)
    errors = dynamics.values(robot, tens, stretched) - dynamics.initial
    G = np.linalg.solve(pseudo_inertia(dynamics.initial), BodyInequality(["last"]).F)
    H = np.einsum("iab,jba->ij", G, G)
    root = np.linalg.cholesky(H)
    whitened = root.T @ (errors.T @ errors / len(errors)) @ root / 0.01**2
    assert (
        np.abs(np.linalg.eigvalsh(whitened) - 1.0).max() < 0.15
    )  # sampling: 10 numbers by 4000 samples


@pytest.mark.parametrize(
    ("law", "unknown"),
    [
        ("adaptive-jacobian", "lumped"),
        ("adaptive-inverse-dynamics", "bodies"),
        ("adaptive-inverse-dynamics", "basis"),
    ],
)
def test_default_gain_puts_the_fastest_mode_where_it_belongs(law, unknown):
    robot = catalogue_robot("ur5" if unknown == "bodies" else "planar_2r")
    words = {
        "lumped": {"tool": False, "translations": lengths(robot)},
        "bodies": {},
        "basis": {"basis": BASIS},
    }
    controller = pa.make_controller(
        robot, law=law, adaptation="projected", unknown=pa.Unknown(**words[unknown])
    )
    w = bandwidth(robot, 1e-3)
    law = controller.law
    motion = pa.models.TypicalMotion(robot, controller.kinematics, controller.dynamics, w)
    Gamma = controller.adaptation_d.gain(pa.adaptation.Estimate(controller.dynamics.initial))
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


def test_a_gain_with_units_far_apart_is_accepted():
    tiny = np.diag([1e9, 1e-9])
    assert np.array_equal(pa.adaptation.Gradient(tiny, 2).Gamma, tiny)
    correlated = np.array([[1e9, 0.999], [0.999, 1e-9]])
    assert pa.adaptation.Gradient(correlated, 2).Gamma[0, 1] == 0.999
    for wrong, words in ((1.001, "definite"), (0.998, "symmetric")):
        with pytest.raises(pa.GainError, match=words):
            pa.adaptation.Gradient(np.array([[1e9, wrong], [max(wrong, 0.999), 1e-9]]), 2)
