"""Runs that go wrong without the governor: obstacle, blind camera, edge of the workspace, lift."""

import warnings

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.plants.sensors import SimulatedSensors
from tests.support.chains import catalogue_robot

pytestmark = pytest.mark.slow
DT = 2e-3  # [s]
TOOL = np.array([0.02, -0.02, 0.04])  # of the reach, in the frame's axes
CAMERA = pa.Sensors(camera=pa.Camera(rate=30.0, delay=0.06))


class Shortly(pa.plants.PinocchioPlant):
    """A robot whose joints an obstacle holds for 0.6 s."""

    def step(self, torque, dt):
        if 2.0 <= self._t < 2.6:
            self._v = np.zeros(self.nv)
            self._t = self._t + dt
        else:
            super().step(torque, dt)


def unknown(robot: pa.Robot) -> tuple[pa.Robot, pa.Robot]:
    """Return the true robot and the model of it, with the unknowns of the README."""
    tool = robot.reach * TOOL
    true = robot.changed(
        tool_translation=tool, payload=pa.Payload(mass=0.05 * robot.mass, com=tool)
    )
    return true, robot.changed(inertial_scale=0.7)


def run(true, model, motion, duration, *, governed, plant=None, sensors=None, **made):
    """Return how one run ended."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        declared = sensors and CAMERA
        options = {"limits": pa.Limits(governor=governed), "sensors": declared, "dt": DT, **made}
        return pa.simulate(
            true,
            pa.make_controller(model, **options),
            motion,
            duration=duration,
            engine=pa.Engine(plant or "pinocchio"),
            sensors=sensors,
        )


def last(rollout):
    """Return the largest error of the last tenth [m]."""
    return rollout.distance[-len(rollout.t) // 10 :].max()


def begun(motion: pa.trajectories.Trajectory, true: pa.Robot) -> pa.trajectories.Trajectory:
    """Return a motion that begins where the true robot is, at rest."""
    return motion.starting_at(true.position(true.q0)).from_rest()


@pytest.fixture(scope="module")
def ur5():
    """Return true robot, model and a circle of the UR5."""
    true, model = unknown(catalogue_robot("ur5"))
    return true, model, begun(pa.reachable_circle(model), true)


def test_the_path_waits_at_an_obstacle(ur5):
    """The error while held stops growing."""
    natural = {"plant": Shortly, "adaptation": "natural"}
    without = run(*ur5, 2.6, governed=False, **natural)
    found = run(*ur5, 3.7, governed=True, **natural)
    assert without.distance.max() > 0.1
    assert found.diverged is None and found.distance.max() < 0.045 and last(found) < 5e-4
    (slowed,) = found.slowed
    assert slowed.start == pytest.approx(2.0, abs=0.15) and slowed.least_rate < 1e-3


def test_at_an_obstacle_a_memory_learns_nothing_while_a_motor_saturates(ur5):
    """It does not take the obstacle for inertia: until the arm is let go the estimate stays."""
    a_d = run(*ur5, 2.7, governed=True, plant=Shortly).a_d
    before, soon, late, after = (a_d[round(t / DT)] for t in (2.0, 2.1, 2.6, 2.69))
    assert np.array_equal(soon, late)
    assert np.linalg.norm(soon - before) < 0.1 * np.linalg.norm(before)
    assert np.linalg.norm(after - late) > 0.1 * np.linalg.norm(late)  # and then it learns again


def test_the_path_waits_for_a_blind_camera(ur5, monkeypatch):
    seen = SimulatedSensors.measure

    def blinded(sensors, truth, torque=None):
        measured = seen(sensors, truth, torque)
        blind = 1.0 <= truth.t < 2.5
        return measured._replace(x=None, x_time=None, xd=None) if blind else measured

    monkeypatch.setattr(SimulatedSensors, "measure", blinded)
    natural = {"sensors": CAMERA, "adaptation": "natural"}
    without = run(*ur5, 2.1, governed=False, **natural)
    assert without.diverged == pytest.approx(2.03, abs=0.05)  # a second after one is overdue
    found = run(*ur5, 3.5, governed=True, **natural)
    assert found.diverged is None and found.distance.max() < 5e-3 and last(found) < 5e-4
    (slowed,) = found.slowed
    assert slowed.cause == "frames" and slowed.least_rate < 0.01
    assert 1.4 < found.t[-1] - found.path_time[-1] < 2.1


def test_a_camera_that_stays_blind_ends_the_run_at_the_stated_time(ur5):
    sensors = pa.Sensors(camera=pa.Camera(rate=30.0, dropout=0.9999))
    governed = pa.Governor(blind=2.0)
    rollout = run(*ur5, 2.2, governed=governed, sensors=sensors, adaptation="natural")
    assert rollout.diverged == pytest.approx(2.0 + 1 / 30 + 0.06, abs=2e-3)
    assert "'x' has not been seen for" in rollout.reason


def test_a_path_that_leaves_the_workspace_comes_back(ur5):
    true, model, _ = ur5
    start = true.position(true.q0)
    far = 0.95 * true.reach * start / np.linalg.norm(start)
    way = pa.trajectories.Waypoints([start, far, start], 1.0)
    found = run(true, model, way, 5.8, governed=True, adaptation="natural")
    assert found.diverged is None and last(found) < 1e-3
    assert found.distance.max() > 0.1  # it was outside
    assert found.t[-1] - found.path_time[-1] > 3.0
    assert any("error" in one.cause for one in found.slowed)


def test_a_slow_lift_slows_its_path():
    """The circle asks for nine times the velocity limit of Tiago's torso."""
    robot = catalogue_robot("tiago_arm")
    circle = begun(pa.trajectories.Circle(np.zeros(3), 0.15, 1.2, "yz"), robot)
    model = robot.changed(inertial_scale=0.7)
    found = run(robot, model, circle, 3.0, governed=True, adaptation="natural")
    assert found.diverged is None and last(found) < 1e-3
    speed = (np.abs(found.v) / robot.model.velocityLimit).max()
    assert speed < 1.03  # at rest the unknown load alone moves it at a third of its limit
    assert found.slowed[0].cause.startswith("joint speed of torso_lift_joint")
