"""Arms that compensate gravity by themselves."""

import pickle
from functools import partial

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.scenario.scenario import Scenario
from tests.support.chains import catalogue_robot as load
from tests.support.chains import random_state
from tests.support.loops import motion_at_home, with_tool_and_load


def loops(
    robot,
    true,
    compensated,
    *,
    limits=False,
    law="adaptive-inverse-dynamics",
    continuous=False,
    duration,
):
    """Return a plain run, and one whose arm adds a torque that the controller subtracts."""
    make = partial(pa.make_controller, robot, law=law)
    engine = pa.Engine(continuous=continuous, torque_limits=limits)
    simulate = partial(pa.simulate, engine=engine, duration=duration)
    path = motion_at_home(robot)
    plain = simulate(true, make(), path)
    return plain, simulate(true, make(compensated=compensated), path)


def check_alike(plain, own):
    """Check that joints saw the same torques and moved alike."""
    assert np.allclose(own.tau, plain.tau, rtol=0.0, atol=1e-9 * np.abs(plain.tau).max())
    assert np.allclose(own.q, plain.q, atol=1e-9) and np.allclose(own.a_d, plain.a_d, atol=1e-6)
    assert np.array_equal(own.saturated, plain.saturated)


@pytest.mark.parametrize("law", ["adaptive-inverse-dynamics", "adaptive-jacobian", "separation"])
@pytest.mark.parametrize("task", ["xyz", "joint"])
def test_the_joint_torque_is_the_same_with_and_without_compensation(task, law):
    robot = pa.load("panda", task=task)
    true = robot.changed(payload=pa.Payload(1.5), viscous=0.2)
    check_alike(*loops(robot, true, "nominal", law=law, duration=0.3))


@pytest.mark.parametrize("continuous", [False, True], ids=["sampled", "continuous"])
def test_the_arm_may_add_any_torque(continuous):
    robot = load("ur5")
    pull = np.array([3.0, -20.0, 10.0, 1.0, 0.5, -0.5])
    check_alike(
        *loops(
            robot,
            with_tool_and_load(robot),
            lambda q: pull * np.cos(q),
            continuous=continuous,
            duration=0.1,
        )
    )


def test_motors_limit_the_sum_of_command_and_compensation():
    """The limits are those of the joints: with compensation and without, they bind alike."""
    robot = load("ur5")
    free, _ = loops(robot, with_tool_and_load(robot), "nominal", duration=0.2)
    weak = with_tool_and_load(robot)
    weak.model.effortLimit = np.quantile(np.abs(free.tau), 0.9, axis=0)
    plain, own = loops(robot, weak, "nominal", limits=True, duration=0.2)
    assert plain.saturated.any() and not plain.saturated.all()
    check_alike(plain, own)
    assert (np.abs(own.tau) <= weak.model.effortLimit).all()


def test_the_controller_subtracts_the_compensation():
    robot, rng = load("panda"), np.random.default_rng(0)
    anywhere = pa.Limits(guards={"limits": False})
    plain, own = (
        pa.make_controller(robot, adaptation="natural", compensated=c, limits=anywhere)
        for c in (None, "nominal")
    )
    plant, data = pa.plants.PinocchioPlant(robot), robot.model.createData()
    for _ in range(5):
        q, v, _ = random_state(robot, rng)
        measured, desired = plant.measurement(q, v), motion_at_home(robot).at(0.1)
        state = plain.init(measured)
        total, _ = plain.step(state, measured, desired, 1e-3)
        sent, _ = own.step(state, measured, desired, 1e-3)
        g = pin.computeGeneralizedGravity(robot.model, data, q)
        assert np.allclose(total - sent, g, atol=1e-9) and np.abs(g).max() > 1.0


def test_a_plant_adds_the_compensation():
    robot = load("panda")
    still = pa.plants.PinocchioPlant(robot, compensation=pa.robot.Gravity(robot))
    held = pa.plants.PinocchioPlant(robot)
    for plant, asked in ((still, np.zeros(7)), (held, pa.robot.Gravity(robot)(robot.q0))):
        assert np.array_equal(plant.motors(asked), pa.robot.Gravity(robot)(robot.q0))
        plant.step(asked, 1e-3)
        assert np.abs(plant.measure().v).max() < 1e-12
    clipped = pa.plants.PinocchioPlant(
        robot, compensation=lambda q: np.full(7, 30.0), torque_limits=np.full(7, 50.0)
    )
    assert np.array_equal(clipped.motors(np.full(7, 40.0)), np.full(7, 50.0))
    assert np.array_equal(clipped.motors(np.full(7, -40.0)), np.full(7, -10.0))


def test_a_controller_is_copied_with_its_compensation():
    robot = load("ur5")
    controller = pa.make_controller(
        robot, adaptation="natural", compensated="nominal", limits=pa.Limits(torque=True)
    )
    measured = pa.plants.PinocchioPlant(robot).measure()
    state, desired = controller.init(measured), motion_at_home(robot).at(0.0)
    torque, _ = controller.step(state, measured, desired, 1e-3)
    for other in (pickle.loads(pickle.dumps(controller)), controller.limited(None)):
        assert np.array_equal(other.step(state, measured, desired, 1e-3)[0], torque)


def test_a_scenario_compensates_the_description_without_the_believed_load(tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_text(
        '[robot]\nsource = "ur5"\n[belief]\npayload = { mass = 2.0 }\n[truth]\n'
        "payload = { mass = 3.0 }\n[simulation]\nduration = 0.05\n"
    )
    plain, own = (
        Scenario.read(path, settings) for settings in ([], ['simulation.compensated="nominal"'])
    )
    described, q = load("ur5"), own.true.q0
    assert np.allclose(own.controller.compensation(q), pa.robot.Gravity(described)(q))
    assert not np.allclose(pa.robot.Gravity(own.estimated)(q), pa.robot.Gravity(described)(q))
    assert plain.controller.compensation is None
    check_alike(plain.run(), own.run())
    with pytest.raises(pa.InputError, match=r"simulation\.compensated.*Did you mean 'nominal'"):
        Scenario.read(path, ["simulation.compensated=nominl"])


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("nominl", "Did you mean 'nominal'"),
        (3.0, "function"),
        (lambda q: np.zeros(3), "returns 6 torques"),
        (lambda q: np.full(6, np.nan), "returns 6 torques"),
        (lambda q: None, "returns 6 torques"),
    ],
)
def test_impossible_compensations_are_refused(given, words):
    with pytest.raises(pa.InputError, match=words):
        pa.make_controller(load("ur5"), adaptation="natural", compensated=given)
