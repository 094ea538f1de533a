"""Simulated sensors: noise, cameras with rate, delay and dropout, encoders with counts."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.description.chain import angles_from_configuration
from tests.support.chains import catalogue_robot as load
from tests.support.chains import random_state
from tests.support.loops import circle_at_home

DT = 1e-3


def moving(robot, count, dt=DT):
    """Return ideal measurements of all joints moving from home at 1 rad/s."""
    plant = pa.plants.PinocchioPlant(robot)
    v = np.ones(robot.model.nv)
    return [
        plant.measurement(pin.integrate(robot.model, robot.q0, k * dt * v), v, k * dt)
        for k in range(count)
    ]


def seen(robot, count, dt=DT, **faults):
    """Return ideal measurements and those of the sensors."""
    truths = moving(robot, count, dt)
    sensors = pa.plants.SimulatedSensors(robot, dt, pa.Sensors(**faults))
    return truths, [sensors.measure(truth) for truth in truths]


def arrivals(samples):
    """Return the indices of samples with a frame, and of the samples that the frames show."""
    pairs = [(k, round(s.x_time / DT)) for k, s in enumerate(samples) if s.x is not None]
    return [k for k, _ in pairs], [shown for _, shown in pairs]


# --- noise ---


@pytest.mark.parametrize("channel", ["q", "v", "x"])
def test_noise_has_the_stated_deviation_and_affects_its_channel_only(channel):
    robot = load("scara")
    sensors = pa.plants.SimulatedSensors(robot, 1e-3, pa.Sensors(noise={channel: 0.02}), seed=3)
    q, v, _ = random_state(robot, np.random.default_rng(0))
    true = pa.plants.PinocchioPlant(robot).measurement(q, v)
    errors = {"q": [], "v": [], "x": []}
    for _ in range(1000):
        seen = sensors.measure(true)
        errors["q"].append(pin.difference(robot.model, true.q, seen.q))
        errors["v"].append(seen.v - true.v)
        errors["x"].append(seen.x - true.x)
    for name, error in errors.items():
        assert np.isclose(np.std(error), 0.02 if name == channel else 0.0, rtol=0.1)


# --- cameras ---


def test_frames_are_taken_at_multiples_of_the_interval_and_arrive_late():
    truths, samples = seen(load("panda"), 200, camera=pa.Camera(30.0, 0.06))
    at, of = arrivals(samples)
    taken = [0, 33, 67, 100, 133]  # 1 / 30 s, 2 / 30 s and so on, in whole periods
    # the frame of the first instant, one of the time before that was under way, and the others
    assert at == [0, 27, *[k + 60 for k in taken]] and of == [0, 0, *taken]
    for k, shown in zip(at, of, strict=True):
        assert np.array_equal(samples[k].x, truths[shown].x)
        assert samples[k].x_time == truths[shown].t
    assert all(s.xd is None for s in samples)
    assert all(s.x_time is None for s in samples if s.x is None)
    for truth, sample in zip(truths, samples, strict=True):
        assert sample.t == truth.t and sample.q is truth.q and sample.v is truth.v


# --- encoders ---


@pytest.mark.parametrize(("name", "number"), [("scara", 100), ("kinova", 2250)])
def test_positions_are_whole_counts_and_velocities_their_differences(name, number):
    """Also of continuous joints, which make more than a turn and stay on the circle."""
    robot = load(name)
    dt = 4e-3 if name == "kinova" else DT
    count = np.linspace(1e-4, 6e-3, robot.model.nv)
    truths, samples = seen(robot, number, dt, encoder=count)
    for truth, sample in list(zip(truths, samples, strict=True))[::31]:
        assert np.allclose(pin.normalize(robot.model, sample.q), sample.q)
        counts = angles_from_configuration(robot.model, sample.q) / count
        assert np.allclose(counts, np.rint(counts), atol=1e-6)
        off = pin.difference(robot.model, truth.q, sample.q)
        assert (np.abs(off) <= 0.5 * count * (1.0 + 1e-9)).all()
    v = np.array([s.v for s in samples])
    assert not v[0].any()  # it stood still before
    for k in range(1, number, 31):
        moved = pin.difference(robot.model, samples[k - 1].q, samples[k].q)
        assert np.allclose(v[k], moved / dt, atol=1e-9)
    assert v[1:].min() >= 0.0 and v.max() < 1.0 + count.max() / dt  # no turn counts as a motion
    assert np.allclose(v[1:].mean(axis=0), 1.0, atol=count.max() / ((number - 1) * dt))


# --- in a loop and in a file ---


@pytest.mark.parametrize(
    "faults",
    [{"camera": pa.Camera(30.0)}, {"encoder": 1e-3}],
)
def test_continuous_mode_has_perfect_sensors(faults):
    robot = load("planar_2r")
    with pytest.raises(pa.InputError, match="sampled mode only"):
        pa.simulate(
            robot,
            pa.make_controller(robot, adaptation="natural"),
            circle_at_home(robot),
            engine=pa.Engine(continuous=True),
            sensors=pa.Sensors(**faults),
        )


@pytest.mark.parametrize("task", ["joint", "xyz"])
def test_only_pose_tasks_have_angle_noise(task):
    with pytest.raises(pa.InputError, match="no orientation"):
        pa.plants.SimulatedSensors(pa.load("ur5", task=task), DT, pa.Sensors(noise={"angle": 0.1}))


def test_measured_torques_are_those_of_the_last_period():
    robot = load("ur5")
    declared = pa.Sensors(noise={"tau": 0.0}, torque_offset=1e-9)
    assert not declared.perfect
    controller = pa.make_controller(robot, adaptation="natural", sensors=declared)
    plant = pa.plants.PinocchioPlant(robot)
    sensors = pa.plants.SimulatedSensors(robot, DT, declared)
    samples = list(
        pa.run(plant, controller, pa.reachable_circle(robot), duration=0.05, sensors=sensors)
    )
    assert samples[0].measurement.tau is None
    for before, after in pairwise(samples):
        assert np.allclose(after.measurement.tau, before.torque, atol=1e-7)
