"""Contacts that change: the motion of a crawl, its refusals, and a load found while walking."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.records import DesiredSteps, Feet
from pinadapt.trajectories import Crawl, Retimed, SlowedTime
from tests.constraints.test_standing import FEET, TRUNK, standing


@pytest.mark.parametrize("slowness", [1.0, 1.7])
def test_velocities_of_a_crawl_are_those_of_differences(slowness):
    crawl = Crawl(steps=3).on(standing("a1"))
    h = 1e-4
    motion = Retimed(crawl, SlowedTime(slowness))
    for t in np.linspace(0.05, slowness * crawl.settles - 0.05, 40).tolist():
        before, now, after = (motion.at(t + sign * h) for sign in (-1.0, 0.0, 1.0))
        for m, part in ((3, slice(0, 3)), (4, None)):
            (x_b, v_b, _), (_, v, a), (x_a, v_a, _) = (
                each.feet[1:] if part is None else each[part] for each in (before, now, after)
            )
            assert np.allclose((x_a - x_b)[:m] / (2.0 * h), v[:m], atol=1e-4)
            assert np.allclose((v_a - v_b) / (2.0 * h), a, atol=1e-2)


def test_the_centre_of_mass_is_above_the_feet_that_stand():
    robot = standing("a1")
    crawl = Crawl(steps=8).on(robot)
    model = robot.model
    offset = pin.centerOfMass(model, model.createData(), robot.q0) - robot.q0[:3]
    for k in range(8):
        desired = crawl.at(k * (crawl.shift + crawl.swing) + crawl.shift + 0.5 * crawl.swing)
        triangle = desired.feet.x_d[desired.feet.stands]
        assert len(triangle) == 3
        shares = np.linalg.solve(
            np.vstack([triangle[:, :2].T, np.ones(3)]), np.append((desired.x_d[:3] + offset)[:2], 1)
        )
        assert shares.min() > 0.05
    assert np.allclose(crawl.footholds[8] - crawl.footholds[0], [0.12, 0.0, 0.0])


@pytest.mark.slow
def test_a_load_is_found_while_walking():
    robot = standing("a1")
    true = robot.changed(payload=pa.Payload(mass=6.0, com=(0.05, 0.02, 0.08)))
    controller = pa.make_controller(robot, unknown=TRUNK, dt=2e-3)
    crawl = Crawl(steps=2).on(robot)
    rollout = pa.simulate(true, controller, crawl, duration=2.4, engine="mujoco")
    assert rollout.distance.max() < 2e-3 and rollout.distance[-250:].max() < 2e-4
    model = robot.model
    data = robot.model.createData()
    pin.framesForwardKinematics(model, data, rollout.q[-1])
    feet = [data.oMf[model.getFrameId(foot)].translation for foot in FEET["a1"]]
    assert np.allclose(feet, crawl.footholds[2], atol=1e-3)
    found, truth = (
        each.model.inertias[robot.carriers[0] + 1].mass for each in (rollout.learned(), true)
    )
    assert found == pytest.approx(truth, rel=0.01)
    estimator = pa.Estimator(robot, "payload")
    state = None
    measurements = zip(rollout.t, rollout.q, rollout.v, strict=True)
    for k, sample in enumerate(measurements):
        measurement = pa.Measurement(*sample, tau=rollout.tau[max(k - 1, 0)])
        if state is None:
            state = estimator.init(measurement)
        else:
            state = estimator.step(state, measurement, crawl.at(rollout.t[k - 1]).feet.stands)
    load = estimator.estimate(state).load
    assert abs(load.mass - 6.0) < 0.1
    assert np.allclose(load.com, (0.05, 0.02, 0.08), atol=0.01)
    with pytest.raises(pa.exceptions.LogError, match="moves by"):
        pa.identify(rollout, robot, unknown="payload")


def with_feet(robot, q, places, legs=range(4)):
    """Return q (18) with feet of these legs at their places (4, 3), by steps of Newton."""
    model = robot.model
    data = robot.model.createData()
    q = q.copy()
    for _ in range(20):
        for leg in legs:
            foot = model.getFrameId(robot.contacts[leg].frame)
            dofs = slice(6 + 3 * leg, 9 + 3 * leg)
            J = pin.computeFrameJacobian(model, data, q, foot, pin.LOCAL_WORLD_ALIGNED)[:3, dofs]
            off = pin.updateFramePlacement(model, data, foot).translation - places[leg]
            q[dofs] -= np.linalg.solve(J, off)
    return q


def test_lyapunov_equality_with_a_foot_in_the_air():
    """d/dt of s^T M s / 2 by differences, along the acceleration of a robot on three feet."""
    robot = standing("a1").changed(friction=pa.Friction(), armature=0.0)
    controller = pa.make_controller(robot, unknown=TRUNK, limits=pa.Limits(guards=False))
    crawl = Crawl().on(robot)
    model = robot.model
    data = robot.model.createData()
    t = crawl.shift + 0.5 * crawl.swing
    rng = np.random.default_rng(4)
    h = 1e-5
    stands = np.repeat(crawl.at(t).feet.stands, 3)
    q = robot.q0.copy()
    desired = crawl.at(t)
    q[:3] = desired.x_d[:3]
    q = with_feet(robot, q, desired.feet.x_d)
    v = 0.01 * rng.standard_normal(18)
    A, rate = robot.constrained.at(q, v)
    v -= np.linalg.pinv(A[stands]) @ (A[stands] @ v)
    A, rate = (rows[stands] for rows in robot.constrained.at(q, v))

    def seen(q, v, t):
        measurement = pa.Measurement(t, q, v, robot.position(q))
        state = controller.init(measurement)
        return state, controller.observe(state, measurement, crawl.at(t))

    def energy(q, v, t):
        s = controller.law._reference_error(seen(q, v, t)[1])
        return 0.5 * s @ pin.crba(model, data, q) @ s

    state, signals = seen(q, v, t)
    _, command = controller.command(state, pa.Measurement(t, q, v, robot.position(q)), desired)
    tau = controller._forces.solve(q, command.torque, desired.feet.stands).torque
    M = pin.crba(model, data, q)
    rest = pin.nonLinearEffects(model, data, q, v)
    saddle = np.block([[M, -A.T], [A, np.zeros((9, 9))]])
    a = np.linalg.solve(saddle, np.append(tau - rest, -rate @ v))[:18]
    found = (
        energy(q + h * v + 0.5 * h * h * a, v + h * a, t + h)
        - energy(q - h * v + 0.5 * h * h * a, v - h * a, t - h)
    ) / (2.0 * h)
    s = controller.law._reference_error(signals)
    assert np.abs(A @ s).max() < 1e-9 and np.abs(s).max() > 0.01
    expected = -s @ controller.law.K_D(q, state.a_d) @ s
    assert found == pytest.approx(expected, rel=1e-4)


def test_what_cannot_crawl_is_refused():
    with pytest.raises(pa.exceptions.InputError, match="four point feet"):
        Crawl().on(standing("talos"))
    with pytest.raises(pa.exceptions.InputError, match="pose of the trunk"):
        Crawl().on(standing("a1", task="xyz"))
    with pytest.raises(pa.exceptions.InputError, match="steps"):
        Crawl(steps=0)
    robot = standing("a1")
    with pytest.raises(pa.exceptions.InputError, match="no foot would step"):
        pa.simulate(robot, pa.make_controller(robot), Crawl(), duration=0.1)


def test_feet_that_do_not_fit_are_refused():
    robot = standing("a1")
    controller = pa.make_controller(robot, unknown=TRUNK)
    at = pa.plants.PinocchioPlant(robot).measure()
    state = controller.init(at)
    desired = pa.Desired(at.x, np.zeros(6), np.zeros(6))
    for feet, message in (
        (Feet(np.ones(3, bool), *np.zeros((3, 4, 3))), "4 bools"),
        (Feet(np.ones(4, bool), *np.zeros((3, 3, 3))), "4 x 3 numbers"),
        ((1, 2), "Feet"),
    ):
        with pytest.raises(pa.InputError, match=message):
            controller.step(state, at, DesiredSteps.of(desired, feet), 1e-3)
