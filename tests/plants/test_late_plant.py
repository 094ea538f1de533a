"""Motors that are late: the motion is that of the same torques, applied later."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.description.catalogue import robots_folder
from pinadapt.robot.motors import LateTorque
from pinadapt.scenario.scenario import Scenario
from tests.support.chains import catalogue_robot


def late_plant(robot, delay, **options):
    """Return the robot with late motors."""
    return pa.plants.PinocchioPlant(robot, actuators=pa.robot.Actuators(delay=delay), **options)


def ending(plant, torques, dt):
    """Return q and v of a plant after torques (N, n), each commanded for dt [s]."""
    for torque in torques:
        plant.step(torque, dt)
    last = plant.measure()
    return np.concatenate([last.q, last.v, [last.t]])


@pytest.mark.parametrize(("delay", "whole"), [(0.0, 0), (3e-3, 3), (7e-3, 7)])
def test_torques_arrive_after_the_delay(delay, whole):
    robot, dt = catalogue_robot("ur5"), 1e-3
    torques = 5.0 * np.random.default_rng(0).standard_normal((30, 6))
    late = late_plant(robot, delay)
    arrived = np.vstack([*[torques[:1]] * whole, torques])[: len(torques)]
    assert np.allclose(
        ending(late, torques, dt),
        ending(pa.plants.PinocchioPlant(robot), arrived, dt),
        rtol=1e-12,
        atol=1e-12,
    )


def test_a_delay_of_half_a_period_splits_it():
    robot, dt = catalogue_robot("ur5"), 2e-3
    torques = 5.0 * np.random.default_rng(0).standard_normal((10, 6))
    late = late_plant(robot, 1e-3)
    halves = np.repeat(torques, 2, axis=0)
    arrived = np.vstack([halves[:1], halves])[:20]
    assert np.allclose(
        ending(late, torques, dt), ending(pa.plants.PinocchioPlant(robot), arrived, 1e-3)
    )


def test_reset_forgets_torques_on_their_way_and_limits_hold():
    robot, dt = catalogue_robot("ur5"), 1e-3
    limited = {"torque_limits": np.full(6, 2.0)}
    plant = late_plant(robot, 2e-3, **limited)
    torques = 5.0 * np.random.default_rng(0).standard_normal((10, 6))
    first = ending(plant, torques, dt)
    plant.reset()
    assert np.array_equal(ending(plant, torques, dt), first)
    clipped = late_plant(robot, 2e-3)
    assert np.allclose(ending(clipped, np.clip(torques, -2.0, 2.0), dt), first)


def test_every_joint_has_its_own_delay():
    """Joints with one delay move as their own torques arrive: checked against torques shifted."""
    robot, dt = catalogue_robot("ur5"), 1e-3
    torques = 5.0 * np.random.default_rng(0).standard_normal((20, 6))
    delays = np.array([0.0, 2e-3, 0.0, 5e-3, 5e-3, 0.0])
    arrived = np.empty_like(torques)
    for joint, delay in enumerate(delays):
        whole = round(delay / dt)
        own = torques[:, joint]
        arrived[:, joint] = np.concatenate([np.full(whole, own[0]), own])[: len(torques)]
    late = late_plant(robot, delays)
    assert np.allclose(
        ending(late, torques, dt), ending(pa.plants.PinocchioPlant(robot), arrived, dt), rtol=1e-12
    )


@pytest.mark.parametrize("dt", [1e-3, 4e-3])
def test_a_bandwidth_is_a_first_order_low_pass(dt):
    """The pieces' means are the exact means of the low pass's output, at any period."""
    own = pa.robot.Actuators(bandwidth=[50.0, 200.0, *[np.inf] * 4])
    late, rest, step = LateTorque(own.of(catalogue_robot("ur5"))), np.zeros(6), np.ones(6)
    at_rest, underway = late.after(None, rest, dt, 1e-3)
    assert all(np.array_equal(tau, rest) for tau, _ in at_rest)
    t, pieces, again = 0.0, [], underway
    for _ in range(5):
        more, underway = late.after(underway, step, dt, 1e-3)
        pieces += more
        mean, again = late.mean(again, step, dt)
        assert np.allclose(mean, sum(tau * h for tau, h in more) / dt, rtol=1e-12)
    for tau, h in pieces:
        assert h <= 1e-3 * (1.0 + 1e-6)
        for joint, a in enumerate((50.0, 200.0)):
            mean = 1.0 - (np.exp(-a * t) - np.exp(-a * (t + h))) / (a * h)
            assert tau[joint] == pytest.approx(mean, rel=1e-12)
        assert tau[2] == 1.0
        t += h
    assert t == pytest.approx(5.0 * dt)


def test_mujoco_has_the_same_late_motors():
    robot, dt = catalogue_robot("ur5"), 1e-3
    t = dt * np.arange(100)
    torques = np.outer(np.sin(20.0 * t), [20.0, 30.0, 20.0, 3.0, 2.0, 1.0])
    own = pa.robot.Actuators(delay=3.5e-3, bandwidth=80.0)
    ends = [
        ending(plant(robot, actuators=actuators), torques, dt)
        for actuators in (own, None)
        for plant in (pa.plants.MujocoPlant, pa.plants.PinocchioPlant)
    ]
    same, different = np.abs(ends[0] - ends[1]).max(), np.abs(ends[1] - ends[3]).max()
    assert same < 1e-3 * different


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"delay": -1e-3}, "actuators.delay"),
        ({"delay": np.nan}, "actuators.delay"),
        ({"delay": np.inf}, "actuators.delay"),
        ({"delay": "late"}, "actuators.delay"),
        ({"bandwidth": 0.0}, "actuators.bandwidth"),
        ({"bandwidth": -50.0}, "actuators.bandwidth"),
        ({"bandwidth": np.nan}, "actuators.bandwidth"),
        ({"bandwidth": [[50.0]]}, "one number or one per joint"),
        ({"bandwidth": 1e31}, "too large"),
        ({"stiffness": 0.0}, "actuators.stiffness"),
        ({"stiffness": [1e4, np.inf]}, "all joints or at none"),
        ({"damping": -1.0, "stiffness": 1e4}, "actuators.damping"),
        ({"delay": [1e-3, 2e-3], "bandwidth": [50.0, 60.0, 70.0]}, "one size"),
        ({"stiffness": 1e4, "encoders": "motors"}, "Did you mean 'motor'"),
    ],
)
def test_impossible_actuators_are_refused(given, words):
    with pytest.raises(pa.InputError, match=words):
        pa.robot.Actuators(**given)


def test_actuators_that_do_not_fit_are_refused():
    robot = catalogue_robot("ur5")
    two = pa.robot.Actuators(delay=[1e-3, 2e-3])
    with pytest.raises(pa.InputError, match="6 numbers"):
        pa.plants.PinocchioPlant(robot, actuators=two)
    with pytest.raises(pa.InputError, match="rigid joints"):
        pa.plants.PinocchioPlant(robot, actuators=pa.robot.Actuators(stiffness=1e4))
    with pytest.raises(pa.InputError, match="springs"):
        pa.plants.ElasticPlant(robot.changed(armature=0.1), actuators=pa.robot.Actuators())
    with pytest.raises(pa.InputError, match="rigid joints"):
        pa.Engine("mujoco", actuators=pa.robot.Actuators(stiffness=1e4)).maker()(robot)
    for options, words in (
        ({"continuous": True}, "mode"),
        ({"ideal_acceleration": True}, "actuators"),
    ):
        with pytest.raises(pa.InputError, match=words):
            pa.Engine(actuators=pa.robot.Actuators(delay=1e-3), **options)
    with pytest.raises(pa.InputError, match="expected an Actuators"):
        pa.Engine(actuators=1e-3)


def test_a_scenario_states_late_motors():
    path = robots_folder() / "panda" / "tool_and_load.toml"
    words = ["simulation.actuators={delay=0.006, bandwidth=100.0}"]
    scenario = Scenario.read(path, words)
    assert scenario.engine.actuators == pa.robot.Actuators(delay=6e-3, bandwidth=100.0)
    both = [
        "simulation.actuators={delay=0.006}",
        "simulation.elasticity={stiffness=2e4}",
        "truth.armature=0.1",
    ]
    assert Scenario.read(path, both).engine.actuators == pa.robot.Actuators(6e-3, stiffness=2e4)
    for wrong in (
        ["simulation.actuators={delay=-0.006}"],
        ["simulation.actuators={bandwidth=[100.0, 50.0]}"],
        ["simulation.actuators={dely=0.006}"],
        ["simulation.actuators={stiffness=1e4}", *both[1:]],
    ):
        with pytest.raises(pa.InputError, match=r"actuators|elasticity"):
            Scenario.read(path, wrong)


def test_a_memory_with_a_lag_tolerates_motors_that_are_ten_milliseconds_late():
    """The delay is not declared; without adaptation the error is over ten times as large."""
    robot = catalogue_robot("ur5")
    path, last = pa.reachable_circle(robot), {}
    for adaptation in ("none", "natural-memory"):
        controller = pa.make_controller(
            robot.changed(inertial_scale=0.7), adaptation=adaptation, lag=0.01, dt=4e-3
        )
        rollout = pa.simulate(
            robot,
            controller,
            path.starting_at(robot.position(robot.q0)),
            duration=3.0,
            engine=pa.robot.Actuators(delay=10e-3),
        )
        assert rollout.diverged is None
        last[adaptation] = rollout.distance[rollout.t > 2.0].max()
    assert last["natural-memory"] < 0.1 * last["none"], last
