"""Motions slowed down to a robot's limits, against independent runs and formulas."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.description.chain import effort_limits, velocity_limits
from pinadapt.reference import joint_motion
from tests.support.chains import catalogue_robot
from tests.support.differences import derivative


def fast_circle(robot, period, radius=0.1):
    """Return a circle through home, too fast for a robot."""
    plane = "xy" if robot.task.size == 2 else "yz"
    path = pa.trajectories.Circle(np.zeros(robot.task.size), radius, period, plane)
    return path.starting_at(robot.position(robot.q0))


def test_a_motion_within_the_limits_keeps_its_own_time():
    robot = catalogue_robot("panda")
    circle = fast_circle(robot, 3.0)
    slowed = pa.within_limits(circle, robot)
    begun = circle.from_rest()
    for t in (0.0, 0.4, 2.0, 33.3):
        assert all(np.allclose(*pair) for pair in zip(slowed.at(t), begun.at(t), strict=True))
    assert "not slowed" in repr(slowed) and slowed.law.slowness == 1.0


@pytest.mark.parametrize(
    ("name", "period", "options"),
    [
        ("panda", 0.3, {}),
        ("scara", 0.3, {}),
        ("panda", 1.0, {"efforts": [10.0, 60.0, 20.0, 40.0, 5.0, 6.0, 3.0]}),
        ("panda", 2.0, {"acceleration": 0.5}),
    ],
    ids=["panda, speed", "scara, a slide", "panda, weak motors", "panda, accelerations"],
)
def test_a_fast_circle_keeps_the_limits_for_as_long_as_it_goes_on(name, period, options):
    """The joints of one robot with the exact model, computed again in the slowed motion's time."""
    robot = catalogue_robot(name).changed(viscous=0.5, coulomb=0.2)
    circle = fast_circle(robot, period)
    slowed = pa.within_limits(circle, robot, horizon=10.0, **options)
    turn = slowed.law.slowness * period
    assert turn > 1.2 * period
    s = np.arange(0.0, 4.0 + 2.2 * turn, 8e-3)
    again = joint_motion(slowed, robot, s)
    assert again.off.max() < 0.05
    limit = velocity_limits(robot.model)
    speeds = np.abs(again.v) / limit
    most = np.asarray(options.get("efforts", effort_limits(robot.model)))
    efforts = np.abs(again.still + again.drag + again.curve) / most
    accelerations = np.abs(again.a[2:-2]) / options.get("acceleration", np.inf)
    used = speeds.max() / 0.8, efforts.max() / (0.8 / 1.3), accelerations.max()
    # 3 %: the null space has more time to return than at the motion's own speed
    assert max(used) < 1.03
    assert max(used) > 0.9  # and not slower than it has to be


def test_the_whole_motion_is_slowed_to_the_rate_that_its_fastest_instant_asks_for():
    robot = catalogue_robot("panda", task="joint")
    home = robot.home_angles

    def swing(t):  # fastest at 2 s
        return home + 0.4 * np.tanh(6.0 * (t - 2.0)) * np.eye(7)[0]

    slowed = pa.within_limits(swing, robot, horizon=4.0)
    assert slowed.law.cause == "speed of panda_joint1"
    assert 1.0 / slowed.law.slowness == pytest.approx(0.8 * 2.175 / 2.4, rel=2e-3)  # tanh' = 1
    speeds = np.array([slowed.at(t).xd_d[0] for t in np.arange(0.0, 4.5, 5e-3)])
    assert np.abs(speeds).max() <= 0.8 * 2.175 * 1.002
    for t in (1.7, 1.9, 2.2):
        found = derivative(lambda h, t=t: slowed.at(t + h).x_d)
        assert np.allclose(slowed.at(t).xd_d, found, atol=1e-5)
        s = slowed.law.at(t)[0]
        assert np.allclose(slowed.at(t).x_d, swing(s))  # on the same path


def test_samples_that_begin_at_speed_keep_the_limits_from_rest():
    robot = catalogue_robot("ur5", task="joint")
    s = 0.01 * np.arange(100)
    x = robot.home_angles + 0.4 * np.sin(1.5 * s)[:, None]
    slowed = pa.within_limits((s, x), robot, acceleration=8.0)
    most = max(np.abs(slowed.at(t).xdd_d).max() for t in np.arange(0.0, 0.1, 1e-3))
    assert most == pytest.approx(8.0, rel=0.02)


def test_a_motion_without_a_place_is_judged_at_home():
    robot = catalogue_robot("ur5")
    circle = pa.trajectories.Circle(radius=0.1, period=1.2)
    placed, given = (
        pa.within_limits(each, robot, horizon=5.0)
        for each in (circle.placed(robot.position(robot.q0)), circle)
    )
    assert repr(given) == repr(placed)


def test_a_robot_that_follows_the_slowed_motion_keeps_its_limits():
    robot = catalogue_robot("panda")
    slowed = pa.within_limits(fast_circle(robot, 0.5, 0.15), robot, horizon=10.0)
    controller = pa.make_controller(robot, dt=2e-3)
    rollout = pa.simulate(robot, controller, slowed, duration=2.0)
    assert rollout.distance.max() < 2e-3
    assert (np.abs(rollout.v) <= 0.83 * velocity_limits(robot.model)).all()
    assert (np.abs(rollout.tau) <= 0.8 / 1.3 * 1.05 * effort_limits(robot.model)).all()
