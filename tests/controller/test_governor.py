"""The governor: the rate of the path's time, its factors, and what it does to a loop."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.controller.governor import PathTime
from pinadapt.models.right_inverse import RightInverse
from tests.support.chains import catalogue_robot
from tests.support.loops import circle_at_home, with_tool_and_load

JACOBIAN = np.eye(3, 7)
GOVERNED = pa.Limits(governor=True)


@pytest.fixture(scope="module")
def governor():
    """Return the governor of a panda with a camera, and what leaves the path at full rate."""
    robot = catalogue_robot("panda")
    sensors = pa.Sensors(camera=pa.Camera(rate=30.0, delay=0.06))
    return pa.Governor().of(robot, robot.task, sensors), {
        "path": PathTime(),
        "dx": np.zeros(3),
        "q": robot.q0.copy(),
        "desired": (np.zeros(3), np.zeros(3)),
        "inverse": RightInverse(JACOBIAN),
        "torque": np.zeros(7),
        "age": 0.0,
        "limits": np.full(7, 50.0),
    }


# --- the time of the path ---


def test_the_rate_stays_between_zero_and_one(governor):
    """For any targets and periods, however long."""
    rng = np.random.default_rng(1)
    path = PathTime()
    seen = []
    for _ in range(2000):
        goal = float(rng.choice([0.0, 1.0, rng.uniform()]))
        after = governor[0].step(path, goal, "error", float(10.0 ** rng.uniform(-4.0, 0.5)))
        assert 0.0 <= after.rate <= 1.0 and after.lag >= path.lag
        path = after
        seen.append(path.rate)
    assert min(seen) < 0.01 and max(seen) > 0.9


def test_a_step_is_exact_for_any_period(governor):
    """Two halves make a whole, and small steps follow the derivative."""
    found = governor[0]
    for start in (PathTime(0.3, 0.7, -2.0, "error"), PathTime(0.3, 0.2, 1.0, "error")):
        for goal in (0.0, 0.9):
            whole = found.step(start, goal, "error", 0.02)
            half = found.step(found.step(start, goal, "error", 0.01), goal, "error", 0.01)
            np.testing.assert_allclose(half[:3], whole[:3], rtol=1e-9)
            little = np.array(found.step(start, goal, "error", 1e-7)[:3]) - np.array(start[:3])
            np.testing.assert_allclose(
                little / 1e-7, found.rate(start, goal, "error")[:3], rtol=1e-4, atol=1e-4
            )


# --- its factors ---


def test_laws_without_speed_bounds_stop_before_a_singularity():
    """By the distance of J_hat from a singularity, of home's; joint and set-point laws never."""
    robot = catalogue_robot("ur5")
    near = {}
    for law in ("separation", "adaptive-inverse-dynamics", "approximate-jacobian"):
        controller = pa.make_controller(robot, law=law, adaptation="natural", limits=GOVERNED)
        near[law] = controller.limits.governor
        damped = getattr(controller.law, "speeds", None)
        assert (damped is not None) == (law == "separation")
    assert near["separation"].near == near["approximate-jacobian"].near == 0.0
    found = near["adaptive-inverse-dynamics"]
    still = (np.zeros(3), np.zeros(3))
    assert found.near == pytest.approx(2.0 * found.singular)
    for share, expected in ((2.5, 1.0), (1.5, 0.5**3), (1.0, 0.0), (0.1, 0.0)):
        inverse = RightInverse(np.eye(3, 6) * share * found.singular * np.sqrt(3.0))
        rate, cause = found.target(
            PathTime(), np.zeros(3), robot.q0, still, inverse, np.zeros(6), 0.0
        )
        assert rate == pytest.approx(expected)
        assert cause == ("" if expected == 1.0 else "singularity")


# --- the state ---


def loop_of(limits=GOVERNED, adaptation=None, **options):
    """Return a short run of an arm with an unknown tool and load."""
    robot = catalogue_robot("ur5")
    true = with_tool_and_load(robot)
    controller = pa.make_controller(robot, limits=limits, adaptation=adaptation)
    return pa.simulate(true, controller, circle_at_home(true), duration=0.3, **options)


def test_a_run_that_goes_well_is_the_same_to_the_bit():
    with_one = loop_of()
    without = loop_of(limits=None)
    for name in ("q", "v", "tau", "a_d", "a_k", "x_d"):
        assert np.array_equal(getattr(with_one, name), getattr(without, name))
    assert np.array_equal(with_one.path_time, with_one.t) and with_one.slowed == ()
    assert without.path_time is None
    assert "slowed" not in with_one.verdict and with_one.summary()["slowed"] == []


def test_sampled_and_continuous_loops_slow_down_equally():
    """With a governor that takes the first errors for large ones.

    A memory looks at intervals, which have no limit as the period shrinks.
    """
    limits = pa.Limits(governor=pa.Governor(position=2e-3, slow=0.2))
    engines = pa.Engine(dt=4e-4), pa.Engine(dt=2e-3, continuous=True)
    sampled, whole = (loop_of(limits=limits, adaptation="natural", engine=e) for e in engines)
    late = [float(run.t[-1] - run.path_time[-1]) for run in (sampled, whole)]
    assert late[0] > 0.02
    assert late[1] == pytest.approx(late[0], rel=0.05)
    assert whole.slowed[0].cause == sampled.slowed[0].cause == "error"
