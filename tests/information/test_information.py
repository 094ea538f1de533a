"""Information of a run: identifiable combinations, their uncertainty, and the load."""

from functools import cache

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.information.information import dynamic_information
from tests.support.chains import catalogue_robot
from tests.support.two_arms import ENDS, two_arms

pytestmark = pytest.mark.slow

ROBOTS = ["scara", "kinova"]
MASS, COM = 0.5, np.array([0.01, -0.01, 0.03])
INERTIA = np.array([2e-3, 0.0, 3e-3, 0.0, 0.0, 1e-3])


@cache
def run(name, camera=False, **options):
    """Return a run on a robot whose tool and load differ from the model's."""
    described = two_arms().of_frame(ENDS[0]) if name == "tree" else catalogue_robot(name)
    true = described.changed(
        payload=pa.Payload(MASS, COM, INERTIA), tool_translation=(0.01, 0.02, 0.03)
    )
    frames = pa.Camera(30.0, 0.06) if camera else None
    controller = pa.make_controller(
        described, sensors=pa.Sensors(camera=frames), dt=4e-3, **options
    )
    path = pa.reachable_circle(true)
    return pa.simulate(true, controller, path, duration=2.0, sensors=pa.Sensors(camera=frames))


def information(rollout):
    """Return the information in the torques of a run, at its last estimate."""
    evaluation = rollout.evaluated()
    controller = evaluation.controller
    a_d = evaluation.last_state.a_d
    return dynamic_information(controller.dynamics, controller.kinematics, evaluation.samples, a_d)


@pytest.mark.parametrize("name", ROBOTS)
def test_identifiable_combinations_are_estimated_correctly(name):
    rollout = run(name)
    best = information(rollout).refined()
    true = rollout.a_d_true
    kept = best.R
    noise = np.abs(kept @ (best.estimate - true)) / np.abs(kept @ best.estimate).max()
    first = np.abs(kept @ (rollout.a_d[0] - true)) / np.abs(kept @ best.estimate).max()
    assert noise.max() < 0.02 * first.max()
    base = pa.models.base_parameters(rollout.evaluated().controller.dynamics, catalogue_robot(name))
    assert 3 < best.rank <= base.size


@pytest.mark.parametrize(
    ("dynamic", "name"),
    [("all", "kinova"), ("payload", "scara"), ("all", "tree")],
)
def test_the_load_is_estimated_within_its_uncertainty(name, dynamic):
    rollout = run(name, **({} if dynamic == "all" else {"unknown": pa.Unknown(bodies=dynamic)}))
    learned = rollout.payload()
    refined = rollout.payload(refined=True)
    for estimate, times in ((learned, 3.0), (refined, 30.0)):
        pairs = [
            (estimate.mass, MASS, estimate.mass_known_to, 1e-4),
            *zip(estimate.com, COM, estimate.com_known_to, [1e-4] * 3, strict=True),
            *zip(estimate.inertia, INERTIA, estimate.inertia_known_to, [1e-4] * 6, strict=True),
        ]
        assert all(abs(ours - true) <= times * known + rest for ours, true, known, rest in pairs)
    assert refined.explained > 0.9999
    if np.isfinite(refined.mass_known_to):
        assert abs(refined.mass - MASS) < 2e-3 and refined.mass_known_to < 1e-3


def test_heavier_links_are_no_certain_load():
    """All masses and inertias 30 % larger, without a load."""
    described = catalogue_robot("ur5")
    controller = pa.make_controller(
        described, adaptation="natural", unknown=pa.Unknown(bodies="payload"), dt=4e-3
    )
    true = described.changed(inertial_scale=1.3)
    rollout = pa.simulate(true, controller, pa.reachable_circle(true), duration=2.0)
    for refined in (False, True):
        estimate = rollout.payload(refined=refined)
        assert abs(estimate.mass) <= 2.0 * estimate.mass_known_to


def test_a_parameter_without_effect_is_not_identifiable():
    rollout = run("ur5")
    known = dict(zip(rollout.dynamic_names, rollout.excitation().dynamic.deviations, strict=True))
    assert np.isinf(known["shoulder_pan_joint.m"]) and np.isinf(known["wrist_3_joint.m"])
    assert np.isfinite(known["shoulder_lift_joint.mcx"])


def test_without_unknown_lengths_none_are_identified():
    found = run("scara", unknown="payload").excitation()
    assert not found.kinematic.names and found.dynamic.rank > 0


@pytest.mark.parametrize("camera", [False, True])
def test_the_tool_is_identified_from_measured_positions(camera):
    rollout = run("panda", camera=camera)
    found = rollout.excitation().kinematic
    assert found.rank == 3 and np.isfinite(found.deviations).all()
    missed = np.abs(found.refined().estimate - rollout.a_k_true)
    assert missed.max() < (1e-5 if camera else 1e-9)
    assert (np.abs(found.estimate - rollout.a_k_true) < 3.0 * found.deviations + 1e-5).all()


def test_only_measurements_since_the_last_change_count():
    described = catalogue_robot("ur5")
    loaded = described.changed(payload=pa.Payload(MASS, COM, INERTIA))
    controller = pa.make_controller(
        described, adaptation="natural", unknown=pa.Unknown(bodies="payload"), dt=4e-3
    )
    rollout = pa.simulate(
        described,
        controller,
        pa.reachable_circle(loaded),
        duration=4.0,
        events=pa.Events(changes={2.0: loaded}),
    )
    assert rollout.payload(refined=True).mass == pytest.approx(MASS, abs=2e-3)


def test_an_uncertain_arm_widens_the_uncertainty_of_the_load_even_without_noise():
    """The information without noise is so large that H - H L (1 + L^T H L)^-1 L^T H cancels."""
    rollout = run("ur5")
    exact, loose = (rollout.payload(refined=True, arm=arm) for arm in (0.0, 0.05))
    assert np.isfinite(loose.mass) and np.isfinite(loose.com).all()
    assert exact.mass_known_to < loose.mass_known_to < np.inf
    assert abs(loose.mass - MASS) < 3.0 * loose.mass_known_to
