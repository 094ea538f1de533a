"""Changes of the true robot during a run, announced or not: loads, tools, friction."""

from functools import cache

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.description.catalogue import robots_folder
from pinadapt.scenario.scenario import Scenario
from tests.support.chains import catalogue_robot
from tests.support.loops import ARRAYS, circle_at_home
from tests.support.paper import BASIS
from tests.support.snapshots import snapshot, unchanged

pytestmark = pytest.mark.slow

CHANGES = robots_folder() / "panda" / "load_changes.toml"
LIGHT = pa.Payload(0.4, [0.01, 0.0, 0.03], [2e-3, 0.0, 2e-3, 0.0, 0.0, 1e-3])
HEAVY = pa.Payload(1.2, [0.0, 0.02, 0.05], [4e-3, 0.0, 5e-3, 0.0, 0.0, 3e-3])
TOOL = [0.02, -0.01, 0.06]


def arm(**changes):
    """Return a z1, changed."""
    return catalogue_robot("z1").changed(**changes)


def told(controller, state, **news):
    """Return the state after ``believe``, which must not have written to the one before."""
    before = snapshot(state)
    after = controller.announce(state, **news)
    assert unchanged(state, before)
    return after


def started(controller, true, **start):
    """Return the state that a controller starts from on a robot at rest."""
    return controller.init(pa.plants.PinocchioPlant(true).measure(), **start)


# --- the plant ---


def test_a_plant_moves_as_the_robot_it_became_from_that_instant_to_the_bit():
    first = arm(payload=LIGHT, viscous=0.2)
    second = arm(payload=HEAVY, coulomb=0.3, tool_translation=TOOL)
    plant, alone = (pa.plants.PinocchioPlant(robot) for robot in (first, second))
    tau = np.linspace(1.0, -1.0, plant.nv)
    for _ in range(20):
        plant.step(tau, 2e-3)
    before = plant.measure()
    plant.become(second)
    alone._q = before.q.copy()
    alone._v = before.v.copy()
    alone._t = before.t
    assert not np.allclose(plant.measure().x, before.x)  # another tool is elsewhere
    for _ in range(20):
        for one, other in zip(plant.measure()[:4], alone.measure()[:4], strict=True):
            assert np.array_equal(one, other)
        q = plant.measure().q
        v = plant.measure().v
        assert np.array_equal(plant.acceleration_at(q, v, tau), alone.acceleration_at(q, v, tau))
        plant.step(tau, 2e-3)
        alone.step(tau, 2e-3)
    plant.reset()
    assert plant.robot is first and np.array_equal(plant.measure().x, first.position(first.q0))


# --- the loop ---


def loop(changes=None, guards=True, adaptation=None, **options):
    """Return a short rollout of a z1 that carries a light load at first."""
    true = arm(payload=LIGHT)
    controller = pa.make_controller(
        arm(inertial_scale=0.9),
        adaptation=adaptation,
        unknown=pa.Unknown(friction=False, armature=False),
        limits=pa.Limits(guards=guards),
    )
    options = {
        "duration": 0.06,
        "events": pa.Events(changes=changes),
        **options,
    }
    return pa.simulate(true, controller, circle_at_home(true), **options)


@pytest.mark.parametrize("mode", ["sampled", "continuous"])
def test_a_run_is_the_same_until_the_change_and_another_after_it(mode):
    engine = pa.Engine(continuous=mode == "continuous")
    plain = loop(engine=engine)
    changed = loop({0.03: arm(payload=HEAVY)}, engine=engine)
    idle = loop({0.03: arm(payload=LIGHT)}, engine=engine)  # the same robot once more
    for name in ARRAYS:
        assert np.array_equal(getattr(idle, name), getattr(plain, name)), name
        assert np.array_equal(getattr(changed, name)[:31], getattr(plain, name)[:31]), name
    assert not np.allclose(changed.q[32], plain.q[32], rtol=0.0, atol=1e-9)


def test_the_true_parameters_are_those_of_each_time():
    anywhere = {"position": False}  # by default a frame jumping with an unannounced tool is refused
    rollout = loop({0.03: arm(payload=HEAVY, tool_translation=TOOL)}, guards=anywhere)
    plain = loop()
    value = pa.models.BodyDynamics(arm()).value
    assert plain.a_d_true.shape == (60,) and rollout.a_d_true.shape == (60, 60)
    assert np.array_equal(rollout.a_d_true[29], plain.a_d_true)
    assert np.array_equal(rollout.a_d_true[30], value(arm(payload=HEAVY)))
    assert np.allclose(rollout.a_k_true[30] - rollout.a_k_true[29], TOOL)
    assert np.isfinite(rollout.lyapunov).all()
    longer = {0.03: arm(link_translation={"joint3": [0.0, 0.0, 0.01]})}
    assert loop(longer, guards=anywhere).a_d_true is None


def test_v_falls_on_either_side_of_a_change_and_jumps_there():
    """Continuous time, ideal acceleration: V never rises but where the truth does.

    Without a memory: behind the low pass of the torque the old truth goes on for a while.
    """
    rollout = loop(
        {0.03: arm(payload=HEAVY)},
        adaptation="natural",
        engine=pa.Engine(continuous=True, ideal_acceleration=True),
    )
    rises = np.diff(rollout.lyapunov)
    assert rises[29] > 0.1 * rollout.lyapunov[0]
    assert np.delete(rises, 29).max() < 1e-9 * rollout.lyapunov[0]


# --- what a controller is told ---


@pytest.mark.parametrize("dynamic", ["all", "payload", ["joint2", "joint6"]])
def test_an_announced_load_is_exact_and_the_other_bodies_keep_what_they_learned(dynamic):
    controller = pa.make_controller(
        arm(), unknown=pa.Unknown(bodies=dynamic, friction=False, armature=False)
    )
    state = started(controller, arm())
    learned = state.a_d * np.linspace(1.0, 1.2, state.a_d.size // 10).repeat(10)
    state = state._replace(dynamic=state.dynamic.with_value(learned))
    truth = pa.models.BodyDynamics(arm(), dynamic).value
    after = told(controller, state, payload=HEAVY)
    assert np.array_equal(after.a_d[-10:], truth(arm(payload=HEAVY))[-10:])
    assert np.array_equal(after.a_d[:-10], learned[:-10])
    assert np.array_equal(after.a_0, truth(arm(payload=HEAVY))) and after.load is HEAVY
    again = told(controller, told(controller, after, payload=LIGHT), payload=None)
    assert np.array_equal(again.a_d[-10:], truth(arm())[-10:]) and again.load is None
    assert after.a_k is state.a_k and after.t == state.t
    assert after.filters.memory is state.filters.memory and not after.filters.disturbance.any()


LENGTHS = ("joint2", "joint3:length")


@cache
def lumped(translations=LENGTHS):
    """Return a controller of lumped parameters."""
    words = pa.Unknown(tool=False, translations=translations)
    return pa.make_controller(arm(), law="adaptive-jacobian", adaptation="gradient", unknown=words)


def planar(**options):
    """Return a controller of Wang and Xie's arm with their three parameters."""
    robot = catalogue_robot("planar_2r")
    return robot, pa.make_controller(
        robot,
        unknown=pa.Unknown(friction=False, armature=False, basis=BASIS),
        adaptation="gradient",
        **options,
    )


def test_a_basis_moves_by_the_difference_to_the_load_announced_last():
    robot, controller = planar()
    weight = pa.Payload(0.5, [0.0, 0.0, 0.0])
    state = started(controller, robot, a_d=np.array([4.0, 0.9, 0.7]))
    after = told(controller, state, payload=weight)
    l1 = 1.0
    l2 = 1.2
    expected = 0.5 * np.array([l1**2 + l2**2, l1 * l2, l2**2])
    assert np.allclose(after.a_d - state.a_d, expected)
    assert np.allclose(after.a_0 - state.a_0, expected)
    assert np.allclose(told(controller, after, payload=weight).a_d, after.a_d)
    assert np.allclose(told(controller, after, payload=None).a_d, state.a_d)


def test_a_tool_is_announced_by_its_translation_and_the_lengths_keep_theirs():
    controller = lumped(("tool", *LENGTHS))
    state = started(controller, arm())
    moved = state.a_k + 0.01
    state = state._replace(kinematic=state.kinematic.with_value(moved))
    after = told(controller, state, tool_translation=TOOL)
    assert np.allclose(after.a_k[:3], controller.kinematics.value(arm(tool_translation=TOOL))[:3])
    assert np.array_equal(after.a_k[3:], moved[3:]) and after.a_d is state.a_d


def test_a_controller_put_together_by_hand_adds_a_load_to_the_robot_of_its_kinematics():
    made = pa.make_controller(arm(), law="separation")
    parts = {"adaptation_k": made.adaptation_k, "adaptation_d": made.adaptation_d}
    by_hand = pa.Controller(made.law, made.kinematics, made.dynamics, **parts)
    state = started(made, arm())
    after = [told(each, state, payload=HEAVY).a_d for each in (made, by_hand)]
    assert np.array_equal(*after)


@pytest.mark.parametrize(
    ("make", "news"),
    [
        (
            lambda: pa.make_controller(arm(), unknown=pa.Unknown(bodies=["joint2"])),
            {"payload": HEAVY},
        ),
        (lambda: pa.make_controller(arm()), {"payload": 3.0}),
        (lambda: pa.make_controller(arm()), {"tool_translation": [9.0, 0.0, 0.0]}),
        (lumped, {"tool_translation": TOOL}),
    ],
)
def test_announcements_that_the_parameters_cannot_express_are_refused(make, news):
    controller = make()
    true = arm()
    with pytest.raises(pa.InputError):
        told(controller, started(controller, true), **news)
    events = pa.Events(announcements={5e-3: news})
    with pytest.raises(pa.InputError):  # before anything moves
        pa.simulate(true, controller, circle_at_home(true), duration=0.01, events=events)


# --- the panda of the example, its changes sooner ---


def changing(table):
    """Return a setting: a load dropped after 0.7 s, another lifted after 1.4 s, the later first."""
    return (
        f"events.{table}=[{{ at = 1.4, payload = {{ mass = 3.0, com = [0.0, 0.0, 0.05] }} }}, "
        "{ at = 0.7, payload = { mass = 0.0 } }]"
    )


TOLD, NATURAL = changing("announcements"), 'controller.adaptation="natural"'


@cache
def ran(*settings):
    """Return the rollout of the example, its changes after 0.7 and 1.4 of 2.4 seconds."""
    shorter = [changing("changes"), "simulation.duration=2.4"]
    return Scenario.read(CHANGES, [*shorter, *settings]).run()


def test_the_panda_is_back_within_a_fifth_of_a_second_and_errs_less_if_it_is_told():
    """Told, only the last body is replaced; the others keep what they have learned so far."""
    drop, lift = ran(NATURAL).transients
    assert (drop.at, drop.what, lift.at, lift.what) == (0.7, "-1.5 kg", 1.4, "+3 kg")
    assert 0.5e-3 < drop.max_error < 2e-3 and drop.time_back < 0.2
    assert 1.5e-3 < lift.max_error < 4.5e-3 and 0.05 < lift.time_back < 0.3
    assert ran(NATURAL).distance[-500:].max() < 0.3e-3
    told = ran(TOLD, NATURAL).transients
    for transient, other in zip(told, (drop, lift), strict=True):
        assert transient.what == f"{other.what}, announced"
        assert transient.max_error < other.max_error and transient.time_back == 0.0
    assert told[1].max_error < 0.12e-3


def test_the_scenario_and_simulate_agree():
    light, heavy = ({"at": 0.01, "payload": {"mass": mass}} for mass in (0.0, 1.0))
    tables = {
        "robot": {"source": "planar_2r"},
        "truth": {"payload": {"mass": 0.5}},
        "simulation": {"duration": 0.04},
        "events": {"changes": [{**heavy, "at": 0.03}, light], "announcements": [light]},
    }
    robot = pa.load("planar_2r")
    true, loaded = (robot.changed(payload=pa.Payload(mass)) for mass in (0.5, 1.0))
    events = pa.Events(changes={0.01: robot, 0.03: loaded}, announcements={0.01: {"payload": None}})
    circle = pa.trajectories.Circle()
    ours = pa.simulate(true, pa.make_controller(robot), circle, duration=0.04, events=events)
    theirs = Scenario.build(tables, robots_folder()).run(False)
    for name in (*ARRAYS, "a_d_true", "a_k_true"):
        assert np.array_equal(getattr(ours, name), getattr(theirs, name)), name
    assert ours.marks == theirs.marks
