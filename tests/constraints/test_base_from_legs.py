"""The base of a robot that stands, by an IMU and its legs."""

import math
from itertools import islice

import numpy as np
import pytest

import pinadapt as pa
from benchmarks.standing import Sway
from pinadapt.robot import BaseFromLegs
from pinadapt.trajectories import Crawl
from tests.constraints.test_crawl import with_feet
from tests.constraints.test_standing import TRUNK, standing


def test_legs_tell_where_a_moving_base_is():
    """Along a motion that keeps the feet; joints, pitch and roll are all that is read."""
    robot = standing("a1")
    legs = BaseFromLegs(robot)
    constraints = robot.constrained
    q = robot.q0.copy()
    dt = 1e-3
    rng = np.random.default_rng(0)
    wish = 0.2 * rng.standard_normal(6)
    for _ in range(300):
        A, _ = constraints.at(q, np.zeros(18))
        v = np.append(wish, np.zeros(12))
        v[6:] = np.linalg.solve(A[:, 6:], -A[:, :6] @ wish)
        blind_q = q.copy()
        blind_v = v.copy()
        blind_q[:6], blind_v[:6] = np.nan, np.nan
        found, rate = legs(blind_q, blind_v, q[4:6], v[4:6])
        assert np.allclose(found, q, atol=1e-4) and np.allclose(rate, v, atol=1e-9)
        q = q + dt * v  # the feet drift by the step's error alone


def test_a_foot_that_came_down_elsewhere_is_a_new_foothold():
    robot = standing("a1")
    legs = BaseFromLegs(robot)
    still = np.zeros(18)
    q = robot.q0
    crawl = Crawl(steps=1).on(robot)
    for t in np.arange(0.0, crawl.settles, 0.01):
        desired = crawl.at(t)
        # the other legs stand where they do, the trunk rests
        q = with_feet(robot, q, desired.feet.x_d, crawl._order[:1])
        found, _ = legs(q, still, q[4:6], still[4:6])
        assert np.allclose(found, q, atol=1e-3)  # a foot that is barely lifted counts as standing
    assert np.allclose(found, q, atol=2e-3)
    assert np.allclose(legs.footholds, crawl.footholds[1], atol=5e-3)


@pytest.mark.slow
def test_a_heavy_load_is_held_with_coarse_encoders_and_a_tilted_imu():
    """11 kg on 13 kg: height within 10 mm, as nothing else measures the base."""
    robot = standing("a1")
    true = robot.changed(payload=pa.Payload(11.0, (0.05, 0.02, 0.08)))
    sensors = pa.Sensors(encoder=2.0 * math.pi / 2**14, imu=pa.Imu(tilt=math.radians(0.3)))
    controller = pa.make_controller(robot, unknown=TRUNK, sensors=sensors, dt=2e-3)
    simulated = pa.plants.SimulatedSensors(true, 2e-3, sensors)
    plant = pa.plants.MujocoPlant(true)
    stream = pa.run(plant, controller, Sway(robot), dt=2e-3, sensors=simulated)
    samples = list(islice(stream, 750))
    heights = [sample.truth.x[2] - sample.desired.x_d[2] for sample in samples]
    assert np.abs(heights).max() < 5e-3
    assert samples[-1].state.a_d[0] == pytest.approx(true.model.inertias[6].mass, rel=0.02)


def test_robots_without_three_point_feet_are_refused():
    with pytest.raises(pa.exceptions.RobotError, match="three point feet"):
        BaseFromLegs(standing("talos"))
    with pytest.raises(pa.exceptions.InputError, match=r"imu\.tilt"):
        pa.Imu(tilt=-1.0)
