"""An estimator beside any controller learns what a controller would, never from nonsense."""

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.recorded import motion, recorded, torques, true_robot

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


def spoilt(measurements, change):
    """Return measurements whose torques are changed, given their configurations."""
    return [one._replace(tau=change(one.tau, one.q)) for one in measurements]


def test_torques_of_another_kind_are_refused_in_the_first_seconds():
    robot, measurements = catalogue_robot("ur5"), samples("ur5", duration=5.0)
    gravity, n = pa.robot.Gravity(robot), robot.model.nv
    sign = np.where(np.arange(n) == 1, -1.0, 1.0)
    for words, change in (
        ("in amperes", lambda tau, q: 0.1 * tau),
        ("sign", lambda tau, q: -tau),
        ("the wrong sign", lambda tau, q: sign * tau),
        ("more than the motors give", lambda tau, q: 1e3 * tau),
        ("without gravity", lambda tau, q: tau - 1.2 * gravity(q)),
        ("order of the joints", lambda tau, q: tau[::-1]),
    ):
        estimator = pa.make_estimator(robot, dt=4e-3)
        state = estimator.init(measurements[0])
        with pytest.raises(pa.ImplausibleError, match=words) as refused:
            for measurement in spoilt(measurements, change)[1:]:
                state = estimator.step(state, measurement)
        at_once = words == "more than the motors give"  # no motor is that strong
        assert refused.value.field == "tau" and (state.t < 0.1 if at_once else 0.9 < state.t < 4.5)
    off = pa.make_estimator(robot, dt=4e-3, limits=pa.Limits(guards={"gravity": False}))
    assert learned(off, spoilt(measurements[:400], lambda tau, q: -tau))[-1].filters == ()


def test_torques_with_loads_and_wrong_inertias_are_accepted():
    robot, (t, q, v, a) = catalogue_robot("ur5"), motion("ur5", duration=9.0, dt=8e-3)
    for scale in (2.0 / 3.0, 4.0 / 3.0):
        true = true_robot("ur5", inertial_scale=scale, payload=pa.Payload(5.0, (0.05, 0.0, 0.05)))
        tau = torques(true, q, v, a)
        mean = np.vstack([tau[:1], 0.5 * (tau[1:] + tau[:-1])])
        estimator = pa.make_estimator(robot, dt=8e-3)
        rows = zip(t.tolist(), q, v, mean, strict=True)
        states = learned(estimator, [pa.Measurement(*row[:3], tau=row[3]) for row in rows])
        assert states[100].filters and states[-1].filters == ()


def test_steps_are_pure():
    measurements = samples("ur5", duration=1.0)
    estimator = pa.make_estimator(catalogue_robot("ur5"), dt=4e-3)
    states = learned(estimator, measurements)
    again = estimator.step(states[99], measurements[100])
    assert np.array_equal(again.a_d, states[100].a_d)
    assert np.array_equal(again.a_k, states[100].a_k)


def test_a_pause_resets_filters_and_keeps_estimates():
    measurements = samples("ur5", duration=1.5)
    estimator = pa.make_estimator(catalogue_robot("ur5"), dt=4e-3)
    before = learned(estimator, measurements[:150])[-1]
    after = estimator.step(before, measurements[250])
    assert np.array_equal(after.a_d, before.a_d) and np.array_equal(after.a_k, before.a_k)
    assert not after.torque_filter.W.any() and not after.torque_filter.y.any()
    assert not np.array_equal(estimator.step(after, measurements[251]).a_d, before.a_d)
