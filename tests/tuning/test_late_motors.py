"""Late motors and elastic joints that were not declared."""

import warnings
from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.tuning.defaults import LATE, feedback_lag
from pinadapt.zoo.experiment import zoo_case
from tests.support.chains import catalogue_robot
from tests.tuning.test_heavy_load import light_wrist

MEMORY = "natural-memory"


def rates(law, robot, age=np.inf, **state):
    """Return the eigenvalues of M_0^-1 K_D at home, in ascending order [1/s]."""
    M = pin.crba(robot.model, robot.model.createData(), robot.q0)
    return np.sort(np.linalg.eigvals(np.linalg.solve(M, law.K_D(robot.q0, age, **state))).real)


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_with_a_memory_the_damping_is_for_late_motors_except_at_the_start(name):
    robot = catalogue_robot(name)
    fast, slow = (pa.make_controller(robot, adaptation=a).law for a in ("natural", MEMORY))
    assert rates(fast, robot)[-1] > 1.4 / LATE
    assert rates(slow, robot)[-1] < 1.0 / LATE
    for age in (0.0, 3.0 * LATE):
        assert np.allclose(slow.K_D(robot.q0, age), fast.K_D(robot.q0), rtol=1e-12)
    ages = [rates(slow, robot, age)[-1] for age in np.linspace(3.0, 6.0, 5) * LATE]
    assert (np.diff(ages) < 0.0).all() and ages[-1] == rates(slow, robot)[-1]


def test_torques_in_time_increase_the_damping_again():
    """K_D follows three times the time by which torques may be late, between its bounds."""
    robot = catalogue_robot("panda")
    slow = pa.make_controller(robot).law
    fast = replace(slow, late=0.0)
    times = (0.0, slow.lag / 3.0, 1e-3, 2e-3, LATE / 3.0, 1.0)
    found = [rates(slow, robot, lateness=late) for late in times]
    assert np.allclose(found[:2], rates(fast, robot)) and np.allclose(
        found[-2:], rates(slow, robot)
    )
    between = replace(slow, lag=3e-3, late=0.0)
    assert np.allclose(found[2], rates(between, robot))
    assert (np.diff([each[-1] for each in found[1:5]]) < 0.0).all()


@pytest.mark.slow
def test_a_run_shows_whether_motors_are_late():
    """After 6 s with all of the dynamics unknown, by the states that a run records."""
    case, known = zoo_case("scara"), []
    for late in (0.0, 6e-3):
        controller = pa.make_controller(case.estimated, dt=2e-3, limits=pa.Limits(guards=False))
        engine = pa.Engine(actuators=pa.robot.Actuators(delay=late), torque_limits=False)
        rollout = pa.simulate(
            case.true, controller, case.motion, duration=6.0, engine=engine, record_every=100
        )
        known.append(rollout.evaluation.last_state.dynamic.lateness)
    assert known[0] < 1.5e-3 and known[1] > LATE / 3.0, known


def test_a_joint_too_light_for_the_short_lag_starts_with_the_long_one():
    """TIAGo's wrist of 4e-6 kg m^2 would be lost within half a second with motors 10 ms late."""
    case = zoo_case("tiago_arm")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of bodies that are not physical
        controller = pa.make_controller(case.estimated, limits=pa.Limits(guards=False))
        law, q = controller.law, case.estimated.q0
        assert np.array_equal(law.K_D(q, 0.0), law.K_D(q))
        late = pa.Engine(actuators=pa.robot.Actuators(delay=LATE), torque_limits=False)
        rollout = pa.simulate(case.true, controller, case.motion, duration=0.6, engine=late)
    assert rollout.diverged is None and rollout.distance.max() < 0.05 * case.radius


def test_links_that_swing_slower_than_the_feedback_are_followed():
    """Springs of 400 N m/rad that are not declared, at 2 Hz; the position is the links'."""
    case = zoo_case("planar_2r")
    M = pin.crba(case.true.model, case.true.model.createData(), case.true.q0)
    rotors = 0.5 * np.diag(M)
    true, model = (each.changed(armature=rotors) for each in (case.true, case.estimated))
    soft = pa.robot.Actuators(stiffness=400.0)
    springs = pa.Engine(actuators=soft, torque_limits=False, substeps=1)
    errors, unknown = [], pa.Unknown(armature=False)
    for beta in (None, 20.0):  # the second is that of the first, but the user's
        controller = pa.make_controller(model, unknown=unknown, dt=2e-3, beta=beta)
        law = controller.law
        assert law.beta == pytest.approx(20.0)
        assert np.sqrt(400.0 / np.linalg.eigvalsh(M)[-1]) < 0.7 * law.alpha
        rollout = pa.simulate(true, controller, case.motion, duration=2.4, engine=springs)
        errors.append(rollout.distance[rollout.t > 2.0].max() / case.radius)
    assert errors[0] < 0.02 and errors[1] > 0.1, errors


def test_a_large_error_raises_the_damping_while_loads_may_be_unknown():
    """From 2 % of the reach on, wholly in the first second, until two; for three times the load."""
    robot = catalogue_robot("panda")
    fast, slow = (pa.make_controller(robot, adaptation=a).law for a in ("natural", MEMORY))
    q, direction = robot.q0, np.array([0.6, 0.0, -0.8])

    def gain(share, age):
        return slow.K_D(q, age, share * robot.reach * direction)

    M = pin.crba(robot.model, robot.model.createData(), q)
    heavy = np.linalg.inv(np.linalg.inv(slow.K_far) + slow.lag * np.linalg.inv(M))
    for age in (0.1, 1.0):
        assert np.allclose(gain(0.02, age), heavy, rtol=1e-9)
    loaded = np.diag(slow.K_far) / np.diag(slow.K_v)
    assert loaded.min() > 1.0 and 2.0 < loaded.max() < 3.0
    assert (np.linalg.eigvalsh(heavy - fast.K_D(q)) > 0.0).all()
    assert np.linalg.eigvals(np.linalg.solve(M, heavy)).real.max() < 1.0 / slow.lag
    assert np.array_equal(gain(0.01, 0.5), slow.K_D(q))
    assert np.array_equal(gain(0.5, 2.0), slow.K_D(q))
    sizes = [np.trace(gain(share, 0.5)) for share in (0.011, 0.014, 0.017, 0.02)]
    later = [np.trace(gain(0.03, age)) for age in (2.0, 1.8, 1.5, 1.1)]
    assert (np.diff(sizes) > 0.0).all() and (np.diff(later) > 0.0).all()


def test_a_heavy_unannounced_load_does_not_spin_a_light_wrist():
    """1 kg 0.1 m off the axis of a flange of 80 g, in the first half second."""
    robot = light_wrist()
    true = robot.changed(payload=pa.Payload(1.0, (0.1, 0.0, 0.0)))
    largest = []
    for lasting in (True, False):
        controller = pa.make_controller(robot, adaptation=MEMORY)
        if not lasting:
            controller.law = replace(controller.law, far=np.zeros(3))
        rollout = pa.simulate(true, controller, pa.reachable_circle(robot), duration=0.5)
        largest.append(rollout.distance.max())
    assert largest[0] < 0.8 * largest[1], largest


@pytest.mark.parametrize("given", [{"lag": 0.003}, {"Kv": 5.0}, {"dt": 6e-3}], ids=str)
def test_a_longer_lag_and_gains_of_the_user_stay(given):
    robot = catalogue_robot("ur5")
    plain = pa.make_controller(robot, adaptation="natural", **given).law
    law = pa.make_controller(robot, adaptation=MEMORY, **given).law
    assert law.lag == plain.lag and not law.late
    assert np.array_equal(law.K_D(robot.q0), plain.K_D(robot.q0))


def test_declared_actuators_take_precedence():
    """Springs have a lag of their own; motors are tolerated half as late again as declared."""
    robot, own = catalogue_robot("ur5"), pa.robot.Actuators
    found = [
        pa.make_controller(robot, adaptation=MEMORY, limits=pa.Limits(actuators=each)).law
        for each in (own(stiffness=2e4), own(delay=0.02))
    ]
    assert found[0].lag == pytest.approx(feedback_lag(robot, 1e-3, own(stiffness=2e4)))
    assert not found[0].late and found[1].late == pytest.approx(0.03)


def test_a_joint_light_beside_the_assumed_load_keeps_more_damping():
    """2.5 times that of its own inertia; no joint of an ordinary arm does."""
    robot = light_wrist()
    law = pa.make_controller(robot, adaptation=MEMORY).law
    own = 1.0 / np.diag(np.linalg.inv(law.M_0(robot.q0)))
    assert np.allclose((law.carried * LATE / own)[:4], 0.0)
    assert (law.carried * LATE / own)[4:] == pytest.approx([1.5, 1.5])
    for name in ("panda", "so101"):
        assert not pa.make_controller(catalogue_robot(name), adaptation=MEMORY).law.carried.any()


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_the_tracking_error_adapts_no_faster_than_late_motors_can_follow(name):
    """The mode of the small so101 would be 75 /s."""
    made = pa.make_controller(catalogue_robot(name), adaptation=MEMORY)
    share, w = made.adaptation_d.share, made.motion.bandwidth
    assert made.law.adaptation_mode * w * share**0.5 == pytest.approx(min(1.75 * w, 0.5 / LATE))


@cache
def last_error(name, adaptation, actuators, duration=1.2, **given):
    """Return the largest error of the last tenth, relative to the radius."""
    case = zoo_case(name)
    true, model, unknown = case.true, case.estimated, pa.Unknown()
    if actuators.elastic:
        rotors = 0.5 * np.diag(pin.crba(true.model, true.model.createData(), true.q0))
        true, model = true.changed(armature=rotors), model.changed(armature=rotors)
        unknown = pa.Unknown(armature=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of late motors that are not declared
        controller = pa.make_controller(
            model,
            adaptation=adaptation,
            unknown=unknown,
            limits=pa.Limits(guards=False),
            dt=2e-3,
            **given,
        )
        rollout = pa.simulate(
            true,
            controller,
            case.motion,
            duration=duration,
            engine=pa.Engine(actuators=actuators, torque_limits=case.efforts_suffice),
            record_every=5,
        )
    if rollout.diverged is not None:
        return np.inf
    return float(rollout.distance[rollout.t > 0.9 * duration].max() / case.radius)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "actuators"),
    [("panda", pa.robot.Actuators(delay=10e-3)), ("so101", pa.robot.Actuators(stiffness=5e3))],
    ids=["panda, 10 ms", "so101, soft"],
)
def test_a_memory_is_better_than_no_adaptation_whatever_the_actuators(name, actuators):
    """Than with the damping for ideal motors, and than with the same damping."""
    least = min(last_error(name, "none", actuators, lag=lag) for lag in (2e-3, LATE))
    assert last_error(name, MEMORY, actuators) < 0.15 * least


@pytest.mark.slow
def test_the_damping_for_ideal_motors_rings_where_they_are_late():
    late = pa.robot.Actuators(delay=10e-3)
    assert last_error("panda", MEMORY, late, lag=2e-3) > 20.0 * last_error("panda", MEMORY, late)
