"""What a run shows of its estimates: predicted torques, and what the motion identifies."""

import pickle
from functools import partial

import numpy as np
import pytest

from tests.support.loops import run

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("blank_pictures")]


learning = partial(
    run,
    "ur5",
    truth={"inertial_scale": 1.4},
    control={"adaptation": "natural-memory", "dt": 4e-3},
    duration=2.5,
)


@pytest.fixture(scope="module")
def rollout():
    """Return a run of a UR5 that learns: 30 % of the inertias are missing at first."""
    return learning()


def test_errors_of_the_torques_are_those_of_the_estimates(rollout):
    """At every sample with the truth's accelerations, and not only at some of them."""
    found = rollout.prediction
    evaluation = rollout.evaluated()
    dynamics = evaluation.controller.dynamics
    t = rollout.t
    v = rollout.v
    a = np.gradient(v, t, axis=0)
    Y = [dynamics.regressor(*state) for state in zip(rollout.q, v, a, strict=True)]
    missed = np.array(Y)[2:-2] @ (np.array([rollout.a_d[0], rollout.a_d[-1]]) - rollout.a_d_true).T
    exact = np.sqrt(np.mean(missed**2, axis=(0, 1)))
    assert found.error_first == pytest.approx(exact[0], rel=0.02)
    assert found.error_last == pytest.approx(exact[1], rel=0.1, abs=1e-3 * found.rms)
    assert found.share_last < 0.05 * found.share_first
    assert found.identifiable_error < 0.3


def test_a_thinned_run_tells_the_same_and_can_be_copied(rollout):
    """Torques between the samples that are kept count by their mean."""
    thin = learning(record_every=2)
    str(thin)
    found = pickle.loads(pickle.dumps(thin)).prediction
    assert found.error_last == pytest.approx(rollout.prediction.error_last, rel=0.05)
