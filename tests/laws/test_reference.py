"""The closed loops of Wang and Xie's arm against hand-written closed-form equations."""

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.paper import CIRCLE, WRONG, paper_controller
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow

HERE = ROOT / "tests"
PUBLISHED = {"gamma_k": 0.05, "R_k": 50.0, "lambda_": 10.0, "lambda_a": 1 / 60}

# file: law, acceleration, integration step [s], which may be long where the bounds below are still
# kept with room to spare, end [s], further gains. The differences are largest in the first half of
# a turn, after which the loops end; the filters need short steps.
LOOPS = {
    "known": ("resolved-acceleration", "filtered", 0.01 / 2, 0.5, {}),
    "improved_filtered": ("adaptive-inverse-dynamics-improved", "filtered", 0.01 / 14, 0.5, {}),
    "cheah": ("adaptive-jacobian", "ideal", 0.01 / 4, 0.5, {}),
    "velocity_ideal": ("adaptive-inverse-dynamics-velocity", "ideal", 0.01 / 3, 0.5, {"Q": 1.0}),
    "idc_filtered_first_30ms": ("adaptive-inverse-dynamics", "filtered", 2e-4, 0.03, {}),
    "idc_ideal_first_30ms": ("adaptive-inverse-dynamics", "ideal", 2e-4, 0.03, {}),
}


def controller(law, adaptation="gradient", **gains):
    return paper_controller(law, adaptation, **PUBLISHED, **gains)


@pytest.mark.parametrize("name", LOOPS)
def test_loop_falls_on_its_reference(name):
    law, acceleration, dt, end, gains = LOOPS[name]
    expected = np.genfromtxt(HERE / "reference" / f"{name}.csv", delimiter=",", names=True)
    expected = expected[expected["t"] < end + 1e-9]
    assert expected["t"][-1] == pytest.approx(end)
    rollout = pa.simulate(
        catalogue_robot("planar_2r"),
        controller(law, gamma_d=[4.5, 1.5, 1.5], **gains),
        CIRCLE,
        duration=float(expected["t"][-1]),
        engine=pa.Engine(dt=dt, continuous=True, ideal_acceleration=acceleration == "ideal"),
        record_every=round(expected["t"][1] / dt),
        start={} if name == "known" else WRONG,
    )
    assert rollout.diverged is None
    assert len(expected) > 30
    assert np.allclose(rollout.t, expected["t"])

    def reference(*names):
        return np.stack([expected[column] for column in names], axis=1)

    assert np.abs(rollout.x - reference("x1", "x2")).max() <= 1e-6
    assert np.abs(rollout.error - reference("ex1", "ex2")).max() <= 1e-6
    assert np.abs(rollout.a_d - reference("ad1", "ad2", "ad3")).max() <= 1e-5
    assert np.abs(rollout.a_k - reference("ak1", "ak2")).max() <= 1e-5
    assert np.abs(rollout.tau - reference("tau1", "tau2")).max() <= 1e-3


@pytest.mark.parametrize("dt", [1e-3, 5e-3])
def test_natural_adaptation_is_stable_at_every_sampling_period(dt):
    """Law (11) with the published filter; the published adaptation makes M_hat singular."""
    natural = controller("adaptive-inverse-dynamics", "natural", gamma_d=1.0)
    rollout = pa.simulate(
        catalogue_robot("planar_2r"),
        natural,
        CIRCLE,
        duration=1.5,
        engine=pa.Engine(dt=dt),
        start=WRONG,
    )
    assert rollout.diverged is None
    assert rollout.distance[rollout.t >= 1.0].max() < 0.01
    assert rollout.min_eig_M_hat.min() > 0.0


def test_published_adaptation_drives_the_mass_matrix_through_singularity():
    published = controller(
        "adaptive-inverse-dynamics",
        gamma_d=[4.5, 1.5, 1.5],
        limits=pa.Limits(stop_on_divergence=False),
    )  # step over it
    rollout = pa.simulate(
        catalogue_robot("planar_2r"),
        published,
        CIRCLE,
        duration=0.0325,
        engine=pa.Engine(dt=2.5e-5, continuous=True, ideal_acceleration=True),
        start=WRONG,
    )
    a1, a2, a3 = rollout.a_d.T
    c = np.cos(rollout.q[:, 1])
    det = (a1 + 2 * a2 * c) * a3 - (a3 + a2 * c) ** 2
    crossing = int(np.argmax(det < 0.0))
    assert det[0] > 1.6 and (det[:crossing] > 0.0).all()
    assert rollout.t[crossing] == pytest.approx(0.03218, abs=2e-5)
    assert det[crossing] < -0.3  # what follows is sensitive to rounding
