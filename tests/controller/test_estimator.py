"""An estimator beside any controller learns what a controller would, never from nonsense."""

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.recorded import recorded, true_robot

pytestmark = pytest.mark.slow


def samples(name, **options):
    """Return measurements of a recorded motion, each with the mean torque since the last one."""
    log, robot = recorded(name, dt=4e-3, **options), catalogue_robot(name)
    q = log.configurations(robot)
    mean = np.vstack([log.tau[:1], 0.5 * (log.tau[1:] + log.tau[:-1])])
    seen = dict(zip(log.x_time.tolist(), log.x, strict=True))
    return [
        pa.Measurement(t, q[k], log.v[k], seen.get(t), tau=mean[k])
        for k, t in enumerate(log.t.tolist())
    ]


def learned(estimator, measurements):
    """Return the states along measurements."""
    states = [estimator.init(measurements[0])]
    for measurement in measurements[1:]:
        states.append(estimator.step(states[-1], measurement))
    return states


@pytest.mark.parametrize(
    ("name", "adaptation", "share"),
    [
        ("panda", "natural-memory", 0.1),
        ("ur5", "natural-composite", 0.5),
        ("kinova", "least-squares", 0.1),
    ],
)
def test_predictions_of_torque_and_position_converge(name, adaptation, share):
    measurements = samples(name, duration=2.5)
    estimator = pa.make_estimator(catalogue_robot(name), adaptation=adaptation, dt=4e-3)
    states = learned(estimator, measurements)
    start, late = states[0], states[-200:]

    def missed(state):
        W, y, *_ = state.torque_filter
        return [np.linalg.norm(W @ a_d - y) for a_d in (start.a_d, state.a_d)]

    first, last = (np.mean(missed) for missed in zip(*map(missed, late), strict=True))
    assert last < share * first
    truth = estimator.controller.kinematics.value(true_robot(name))
    assert np.linalg.norm(states[-1].a_k - truth) < 0.02 * np.linalg.norm(start.a_k - truth)
    kept = pa.LearnedParameters.of(estimator.controller, states[-1])
    assert np.array_equal(kept.start(estimator.controller)["a_d"], states[-1].a_d)
    if adaptation != "least-squares":  # least squares keeps no body physical
        robot = estimator.learned(states[-1])
        assert np.allclose(estimator.controller.dynamics.value(robot), states[-1].a_d)


def test_a_pause_resets_filters_and_keeps_estimates():
    measurements = samples("ur5", duration=1.5)
    estimator = pa.make_estimator(catalogue_robot("ur5"), dt=4e-3)
    *_, last, before = learned(estimator, measurements[:150])
    again = estimator.step(last, measurements[149])
    assert np.array_equal(again.a_d, before.a_d) and np.array_equal(again.a_k, before.a_k)
    after = estimator.step(before, measurements[250])
    assert np.array_equal(after.a_d, before.a_d) and np.array_equal(after.a_k, before.a_k)
    assert not after.torque_filter.W.any() and not after.torque_filter.y.any()
    assert not np.array_equal(estimator.step(after, measurements[251]).a_d, before.a_d)
