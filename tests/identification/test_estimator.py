"""The estimator is ``identify`` sample by sample: rows, robots, loads that come and go, pushes."""

import pickle
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicSpline

import pinadapt as pa
from pinadapt.identification.fits import Windows
from pinadapt.identification.logged_motion import motion_of_log
from pinadapt.information.measured_motion import Averages
from pinadapt.tuning.unknowns import nominal_dynamics
from tests.constraints.test_loops import five_bar
from tests.support.chains import catalogue_robot
from tests.support.recorded import LOAD, motion, recorded, torques, true_robot

OTHER = pa.Payload(0.8, (0.0, 0.03, 0.08), (0.001, 0.0, 0.001, 0.0, 0.0, 0.001))


def run(estimator, t, q, v, tau, state=None, payload=None):
    """Return the states along a motion; a payload is announced at the first sample."""
    states = [] if state is None else [state]
    for sample in zip(t, q, v, tau, strict=True):
        one = pa.Measurement(float(sample[0]), *sample[1:3], tau=sample[3])
        states.append(estimator.step(states[-1], one) if states else estimator.init(one))
        if payload is not None and len(states) == 1:
            states[0] = estimator.announce(states[0], payload)
    return states


def signals(loads, duration, dt=8e-3):
    """Return a motion during which loads change at times [s]; friction is not as described."""
    t, q, v, a = motion("panda", duration=duration, dt=dt, seed=3)
    robot = catalogue_robot("panda").changed(viscous=0.5, coulomb=0.8)
    tau = np.zeros(q.shape)
    for (since, load), until in zip(loads.items(), [*list(loads)[1:], np.inf], strict=True):
        part = (t >= since) & (t < until)
        true = robot if load is None else robot.changed(payload=load)
        tau[part] = torques(true, q[part], v[part], a[part])
    limits = robot.model.effortLimit
    return t, q, v, tau + 5e-3 * limits * np.random.default_rng(0).standard_normal(q.shape)


def found_load(estimator, state, load):
    """Return by how many of its deviations each number of an estimated load is off."""
    value, known = estimator.estimate(state).load.numbers
    true = np.concatenate([[load.mass], load.com, load.inertia])
    return (value - true) / known


def test_the_rows_are_those_of_identify():
    log = recorded("ur5", duration=2.0, dt=2e-3)
    robot = catalogue_robot("ur5")
    estimator = pa.Estimator(robot, pa.Unknown(friction=True), period=2e-3, held=False)
    found = []
    estimator._compare = lambda state, window: (found.append(window), state)[1]
    moved = motion_of_log(robot, log)
    run(estimator, *moved[:3], moved.tau)
    own = Windows.of(moved, Averages(moved.t, 2e-3), estimator.dynamics, robot)
    assert len(found) >= len(own.t) - 1 > 20
    for k, one in enumerate(found):
        assert np.allclose(one[:, :-2], own.W[k], atol=1e-10)
        assert np.allclose(one[:, -2], own.y[k], atol=1e-10)


def test_loads_that_come_and_go_are_found_within_a_second():
    loads = {0.0: None, 5.0: LOAD, 8.0: None, 10.0: OTHER}
    estimator = pa.Estimator(catalogue_robot("panda"), "payload", period=8e-3, held=False)
    states = run(estimator, *signals(loads, 13.0))
    for since, load in list(loads.items())[1:]:
        now = next(state for state in states if state.t >= since + 1.0)
        got = estimator.estimate(now).load
        mass = 0.0 if load is None else load.mass
        assert abs(got.mass - mass) < 0.03 * max(mass, 1.0), since
    last = estimator.estimate(states[-1])
    assert last.load.mass == pytest.approx(OTHER.mass, rel=0.01) and not last.advice
    assert np.abs(found_load(estimator, states[-1], OTHER)).max() < 4.0
    assert str(last).startswith("load 0.")


@pytest.mark.parametrize("coupled", [True, False])
def test_a_motor_that_both_joints_of_a_wrist_turn_is_found_where_there_is_one(coupled):
    robot = catalogue_robot("panda")
    motor = pa.robot.Shaft((5, 6), -1, viscous=0.3, coulomb=0.4)
    friction = replace(robot.friction, shafts=(motor,) * coupled)
    t, q, v, a = motion("panda", duration=6.0, dt=8e-3, seed=3)
    true = robot.changed(friction=friction, viscous=0.5, coulomb=0.8)
    tau = torques(true, q, v, a)
    tau[:, 5:] += 0.05 * coupled * np.outer(a[:, 5] - a[:, 6], [1.0, -1.0])  # its rotor
    tau += 5e-3 * robot.model.effortLimit * np.random.default_rng(0).standard_normal(q.shape)
    estimator = pa.Estimator(robot, period=8e-3, held=False)
    found = estimator.estimate(run(estimator, t, q, v, tau)[-1]).robot
    armatures = {part.sign: part.armature for part in found.friction.shafts}
    assert bool(armatures) == coupled
    if coupled:
        assert armatures[-1] == pytest.approx(0.05, rel=0.2) and armatures[1] < 0.01


def test_a_joint_that_sticks_says_little_of_a_load():
    """Friction at rest is anything up to Coulomb's; small swings hold the load otherwise."""
    robot = catalogue_robot("panda")
    dt = 8e-3
    true = robot.changed(payload=LOAD)
    t = np.arange(0.0, 6.0, dt)[:, None]
    rates = np.arange(1.5, 5.0, 0.5)
    height = 0.15
    q = robot.q0 + height * np.sin(rates * t)
    v = height * rates * np.cos(rates * t)
    a = -height * rates**2 * np.sin(rates * t)
    slow = np.abs(v) < 0.1 * height * rates  # there they stick
    q = robot.q0 + np.cumsum(np.where(slow, 0.0, v), axis=0) * dt
    v = np.where(slow, 0.0, v)
    a = np.where(slow, 0.0, a)
    tau = torques(true, q, v, a) + 1.0 * np.where(slow, np.cos(3.0 * t), np.sign(v))
    estimator = pa.Estimator(robot, "payload", period=dt, held=False)
    off = found_load(estimator, run(estimator, t[:, 0], q, v, tau)[-1], LOAD)
    assert np.abs(off[:4]).max() < 3.0


def test_gears_rub_under_the_load_too():
    estimator = pa.Estimator(catalogue_robot("panda"), "payload", period=8e-3, held=False)
    t, q, v, tau = signals({0.0: None, 5.0: LOAD}, 6.0)
    for k, now in enumerate(t):
        model = (estimator.robot if now < 5.0 else estimator.robot.changed(payload=LOAD)).model
        g = pin.computeGeneralizedGravity(model, model.createData(), q[k])
        tau[k] += 0.05 * np.abs(g) * np.tanh(v[k] / 0.01)
    found = estimator.estimate(run(estimator, t, q, v, tau)[-1]).load
    assert found.mass == pytest.approx(LOAD.mass, rel=0.02)


def test_a_push_is_not_a_load():
    robot = catalogue_robot("panda")
    force = (0.0, 0.0, -40.0)
    t, q, v, tau = signals({0.0: None}, 7.0)
    data = robot.model.createData()
    for k in np.flatnonzero((t > 4.0) & (t < 4.5)):
        J = pin.computeFrameJacobian(
            robot.model, data, q[k], robot.frame_id, pin.LOCAL_WORLD_ALIGNED
        )
        tau[k] -= J[:3].T @ force
    estimator = pa.Estimator(robot, "payload", period=8e-3, held=False)
    states = run(estimator, t, q, v, tau)
    assert max(len(state.pending) for state in states) > 5  # it was seen
    assert states[-1].accepted[0] == states[-1].accepted[1]
    assert abs(estimator.estimate(states[-1]).load.mass) < 0.02


def test_an_announced_load_is_the_difference_to_an_arm_of_which_nothing_is_known():
    estimator = pa.Estimator(catalogue_robot("panda"), period=4e-3, held=False)
    t, q, v, tau = signals({0.0: None, 6.0: LOAD}, 9.0, dt=4e-3)
    first = t < 6.0
    parts = [part[first] for part in (t, q, v, tau)]
    empty = run(estimator, *parts, payload=pa.Payload(0.0))[-1]
    assert estimator.estimate(empty).load is None and "no load" in str(estimator.estimate(empty))
    taken = estimator.announce(empty, pa.Payload(1.0))
    last = run(estimator, *(part[~first] for part in (t, q, v, tau)), state=taken)[-1]
    load = estimator.estimate(last).load
    assert load.mass == pytest.approx(LOAD.mass, abs=3.0 * load.mass_known_to)
    assert load.mass == pytest.approx(LOAD.mass, rel=0.01)  # no window holds both loads
    assert load.mass_known_to < 0.03 and np.allclose(load.com, LOAD.com, atol=0.01)


def predicted(robot, q, v, a):
    """Return the torques (N, n) of a robot whose friction grows with the load of its gears."""
    data = robot.model.createData()
    gravity = [pin.computeGeneralizedGravity(robot.model, data, q_k) for q_k in q]
    rubbing = [robot.friction.under(g).torque(v_k) for g, v_k in zip(gravity, v, strict=True)]
    moving = [pin.rnea(robot.model, data, *one) for one in zip(q, v, a, strict=True)]
    return np.array(moving) + np.array(rubbing)


def test_bodies_are_found_in_spite_of_noise_and_written(tmp_path):
    """After a second they already are better than the description."""
    log = recorded("panda", noisy=True, duration=8.0, dt=8e-3)
    robot = catalogue_robot("panda")
    estimator = pa.Estimator(robot, period=8e-3, held=False, smooth=True)
    states = run(estimator, log.t, log.configurations(robot), log.v, log.tau)
    found = estimator.estimate(states[-1])
    _, q, v, a = motion("panda", duration=4.0, dt=16e-3, seed=5)
    true = torques(true_robot("panda"), q, v, a)
    early = [estimator.estimate(states[k]).robot for k in (250, 375, 625)]
    before, last, *others = (
        np.sqrt(np.mean((predicted(each, q, v, a) - true) ** 2))
        for each in (robot, found.robot, *early)
    )
    assert last < 0.1 * before and max(others) < 0.7 * before
    found.save(tmp_path / "found.urdf")
    again = pa.load(tmp_path / "found.urdf", frame=robot.frame)
    assert np.allclose(again.model.inertias[7].mass, found.model.inertias[7].mass)
    finger = '<joint type="slide"/><inertial mass="0.3" pos="0 0 0.1" diaginertia="1 1 1"/>'
    text = robot.mjcf().replace("<site", f"<body>{finger}</body><site")  # the last body contains it
    model = mujoco.MjModel.from_xml_string(text)
    found.write(model)
    mujoco.mj_setConst(model, data := mujoco.MjData(model))
    data.qpos[:7], data.qvel[:] = q[0], 0.0
    mujoco.mj_forward(model, data)
    gravity = pin.computeGeneralizedGravity(found.model, found.model.createData(), q[0])
    assert np.allclose(data.qfrc_bias[:7], gravity, atol=1e-8)


def test_steps_are_pure_and_refuse_what_is_no_measurement():
    estimator = pa.Estimator(catalogue_robot("panda"), period=8e-3, held=False)
    parts = signals({0.0: LOAD}, 2.0)
    states = run(estimator, *parts)
    k = len(states) // 2
    copied = pickle.loads(pickle.dumps(states[k]))
    again = run(estimator, *(part[k + 1 :] for part in parts), state=copied)[-1]
    assert all((a == b).all() for a, b in zip(again.products, states[-1].products, strict=True))
    assert (again.sums == states[-1].sums).all() and again.accepted[0] > 10
    sample = pa.Measurement(3.0, parts[1][0], parts[2][0], tau=parts[3][0])
    for name in ("q", "v", "tau"):
        for wrong in (np.full(7, np.nan), np.zeros(3), None):
            with pytest.raises(pa.MeasurementError, match=name):
                estimator.step(states[-1], sample._replace(**{name: wrong}))
    with pytest.raises(pa.ImplausibleError, match="not after"):
        estimator.step(states[-1], sample._replace(t=0.5))
    assert estimator.step(states[-1], sample).t == 3.0


def test_samples_at_another_period_are_told():
    robot = catalogue_robot("panda")
    rest = pa.Measurement(0.0, robot.q0, np.zeros(7), tau=np.zeros(7))
    plain = pa.Estimator(robot, "payload")
    state = plain.step(plain.init(rest), rest._replace(t=0.033))
    assert "is their period 0.001 s" in str(plain.estimate(state))
    smooth = pa.Estimator(robot, "payload", smooth=True)
    state = smooth.init(rest)
    with pytest.raises(pa.InputError, match=r"period: is 0.001 s, and samples come every 0.02 s"):
        for k in range(1, 200):
            state = smooth.step(state, rest._replace(t=0.02 * k))


def test_what_is_no_state_no_load_and_no_contacts_is_refused():
    robot = pa.load("a1", base="free", contacts=["FL_foot", "FR_foot", "RL_foot", "RR_foot"])
    estimator = pa.Estimator(robot, "payload")
    sample = pa.Measurement(0.0, robot.q0, np.zeros(18), tau=np.zeros(18))
    state = estimator.init(sample)
    later = sample._replace(t=1e-3)
    assert estimator.step(state, later, [True] * 4).stands.all()
    for use, *given in (
        (estimator.step, state, later, [True, False, True]),
        (estimator.step, state, later, "a"),
        (estimator.step, None, later),
        (estimator.estimate, None),
        (estimator.announce, state, 1.5),
    ):
        with pytest.raises(pa.InputError, match="expected"):
            use(*given)


def test_too_little_motion_says_which_joint_to_shake():
    robot = catalogue_robot("panda")
    t, q, v, tau = signals({0.0: LOAD}, 1.5)
    estimator = pa.Estimator(robot, period=8e-3, held=False)
    rest = np.broadcast_to(q[:1], q.shape)
    still = run(estimator, t, rest, 0.0 * v, 0.0 * tau + tau[0])[-1]
    assert still.accepted == (0, 0, 0)
    advice = estimator.estimate(still).advice
    assert advice.startswith("not enough motion yet: shake panda_joint")


def test_a_real_log_is_predicted_as_well_as_by_identify():
    robot = pa.load("panda", task="joint")
    log = pa.read_log(Path("tests/data/panda_unisa.csv").resolve(), robot)
    moved = motion_of_log(robot, log)
    split = moved.t[0] + 0.75 * (moved.t[-1] - moved.t[0])
    estimator = pa.Estimator(robot, period=log.period, held=False, smooth=True)
    part = log.t < split
    rows = (log.t[part], log.q[part], log.v[part], log.tau[part])
    found = estimator.estimate(run(estimator, *rows)[-1])
    errors = []
    for each in (robot, found.robot):
        nothing = pa.Unknown(bodies="none", friction=False, armature=False)
        dynamics = nominal_dynamics(each, nothing, ())
        windows = Windows.of(moved, Averages(moved.t, log.period), dynamics, each)
        errors.append(np.sqrt(np.mean(windows.between(split, np.inf).y ** 2)))
    assert errors[0] > 1.0 and errors[1] < 1.3 * 0.134  # that of identify


def test_whatever_force_closes_a_loop_drops_out():
    robot = five_bar()
    true = robot.changed(payload=OTHER)
    data = robot.model.createData()
    t = np.arange(0.0, 4.0, 8e-3)
    home = robot.position(robot.q0)
    swing = 0.3 * np.sin(np.outer(t, [4.0, 6.0]))
    path = []
    q = robot.q0
    for x in home + swing:
        q = robot.at(q).configuration(x)
        path.append(q)
    curve = CubicSpline(t, np.array(path))
    q, v, a = (curve(t, k) for k in range(3))
    tau = np.array([pin.rnea(true.model, data, *one) for one in zip(q, v, a, strict=True)])
    for k, force in enumerate(50.0 * np.cos(np.outer(t, [3.0, 5.0]))):
        tau[k] += force @ robot.constrained.at(q[k], v[k])[0]
    estimator = pa.Estimator(robot, "payload", period=8e-3, held=False)
    found = estimator.estimate(run(estimator, t, q, v, tau)[-1]).load
    assert found.mass == pytest.approx(OTHER.mass, rel=5e-3)
    log = pa.Log(t=t, q=q, v=v, tau=tau)
    bodies = pa.identify(log, robot, unknown="payload").robot.model.inertias
    mass = sum(body.mass for body in bodies) - sum(one.mass for one in true.model.inertias)
    assert mass == pytest.approx(0.0, abs=5e-3 * OTHER.mass)
