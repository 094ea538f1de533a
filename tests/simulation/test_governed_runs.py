"""Runs that go wrong without the governor: obstacle, blind camera, edge of the workspace, lift."""

import warnings
from itertools import islice

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.plants.sensors import SimulatedSensors
from pinadapt.robot.motors import torque_limits
from pinadapt.rollout.recording import slowdowns
from tests.support.chains import catalogue_robot

pytestmark = pytest.mark.slow
DT = 2e-3  # [s]
TOOL = np.array([0.02, -0.02, 0.04])  # of the reach, in the frame's axes
CAMERA = pa.Sensors(camera=pa.Camera(rate=30.0, delay=0.06))


class Held(pa.plants.PinocchioPlant):
    """A robot whose joints an obstacle holds for a while.

    Attributes:
        held: from when to when [s].
    """

    held = (2.0, 3.0)

    def step(self, torque: np.ndarray, dt: float) -> None:
        """Move for dt [s], or stay where it is held."""
        if self.held[0] <= self._t < self.held[1]:
            self._v, self._t = np.zeros(self.nv), self._t + dt
        else:
            super().step(torque, dt)


class Blinded(SimulatedSensors):
    """Sensors whose camera sees nothing for a while.

    Attributes:
        blind: from when to when [s].
    """

    blind = (2.0, 5.0)

    def measure(self, truth: pa.Measurement, torque: np.ndarray | None = None) -> pa.Measurement:
        """Return the next measurement, without x while the camera is blind."""
        measured = super().measure(truth, torque)
        if self.blind[0] <= truth.t < self.blind[1]:
            return measured._replace(x=None, x_time=None, xd=None)
        return measured


def unknown(robot: pa.Robot) -> tuple[pa.Robot, pa.Robot]:
    """Return the true robot and the model of it, with the unknowns of the README."""
    tool = robot.reach * TOOL
    true = robot.changed(
        tool_translation=tool, payload=pa.Payload(mass=0.05 * robot.mass, com=tool)
    )
    return true, robot.changed(inertial_scale=0.7)


def run(
    true,
    model,
    motion,
    duration,
    *,
    governed,
    plant=pa.plants.PinocchioPlant,
    blind=False,
    dt=1e-3,
    **made,
):
    """Return how one run ended, and what slowed it; lengths in mm, times in s."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        controller = pa.make_controller(
            model,
            sensors=CAMERA if blind else None,
            limits=pa.Limits(governor=governed),
            dt=dt,
            **made,
        )
        driven = plant(true, torque_limits=torque_limits(true, True))
        seen = Blinded(true, dt, CAMERA) if blind else None
        samples, lost = [], None
        try:
            stream = pa.run(driven, controller, motion, dt=dt, sensors=seen)
            samples.extend(islice(stream, round(duration / dt)))
        except pa.DivergedError as error:
            lost = error.time
    distance = 1e3 * np.array(
        [np.linalg.norm(true.task.error(s.truth.x, s.desired.x_d)) for s in samples]
    )
    path = samples[-1].state.path
    return {
        "samples": samples,
        "lost": lost,
        "largest": distance.max(),
        "last": distance[-max(1, len(distance) // 10) :].max(),
        "speed": max((np.abs(s.truth.v) / true.model.velocityLimit).max() for s in samples),
        "late": 0.0 if path is None else path.lag,
        "slowed": list(slowdowns(samples)),
    }


def begun(motion: pa.trajectories.Trajectory, true: pa.Robot) -> pa.trajectories.Trajectory:
    """Return a motion that begins where the true robot is, at rest."""
    return motion.starting_at(true.position(true.q0)).from_rest()


def way_out(true: pa.Robot, reach: float) -> pa.trajectories.Trajectory:
    """Return a way from home to a share of the reach from the base, a second there, and back."""
    start = true.position(true.q0)
    far = reach * true.reach * start / np.linalg.norm(start)
    return pa.trajectories.Waypoints([start, far, far, start], 1.0)


class Shortly(Held):
    """A robot whose joints an obstacle holds for 0.6 s."""

    held = (2.0, 2.6)


@pytest.fixture(scope="module")
def ur5():
    """Return true robot, model and a circle of the UR5."""
    true, model = unknown(catalogue_robot("ur5"))
    return true, model, begun(pa.reachable_circle(model), true)


def test_the_path_waits_at_an_obstacle(ur5):
    """The error while held stops growing."""
    natural = {"dt": DT, "adaptation": "natural"}
    without = run(*ur5, 2.6, governed=False, plant=Shortly, **natural)
    found = run(*ur5, 3.7, governed=True, plant=Shortly, **natural)
    assert without["largest"] > 100.0
    assert found["lost"] is None and found["largest"] < 45.0 and found["last"] < 0.5
    (slowed,) = found["slowed"]
    assert slowed.start == pytest.approx(2.0, abs=0.15) and slowed.least_rate < 1e-3


def test_at_an_obstacle_a_memory_learns_nothing_while_a_motor_saturates(ur5):
    """It does not take the obstacle for inertia: until the arm is let go the estimate stays."""
    samples = run(*ur5, 2.7, governed=True, plant=Shortly, dt=DT)["samples"]
    times = 2.0, 2.1, 2.6, 2.69
    before, soon, late, after = (samples[round(t / DT)].state.a_d for t in times)
    assert np.array_equal(soon, late)
    assert np.linalg.norm(soon - before) < 0.1 * np.linalg.norm(before)
    assert np.linalg.norm(after - late) > 0.1 * np.linalg.norm(late)  # and then it learns again


def test_the_path_waits_for_a_blind_camera(ur5, monkeypatch):
    monkeypatch.setattr(Blinded, "blind", (1.0, 2.5))
    natural = {"dt": DT, "adaptation": "natural"}
    without = run(*ur5, 2.0, governed=False, blind=True, **natural)
    assert without["lost"] == pytest.approx(1.93, abs=0.05)  # a second after the last frame
    with_one = run(*ur5, 3.5, governed=True, blind=True, **natural)
    assert with_one["lost"] is None and with_one["largest"] < 5.0 and with_one["last"] < 0.5
    (slowed,) = with_one["slowed"]
    assert slowed.cause == "frames" and slowed.least_rate < 0.01
    assert 1.4 < with_one["late"] < 2.1


def test_a_camera_that_stays_blind_ends_the_run_at_the_stated_time():
    true, model = unknown(catalogue_robot("ur5"))
    limits = pa.Limits(governor=pa.Governor(blind=2.0))
    sensors = pa.Sensors(camera=pa.Camera(rate=30.0, dropout=0.9999))
    natural = {"dt": DT, "adaptation": "natural"}
    controller = pa.make_controller(model, limits=limits, sensors=sensors, **natural)
    rollout = pa.simulate(true, controller, pa.reachable_circle(model), duration=2.1)
    assert rollout.diverged == pytest.approx(2.0, abs=2e-3)
    assert "'x' has not been seen for" in rollout.reason


def test_a_path_that_leaves_the_workspace_comes_back(ur5):
    """At 1 kHz: at half of it the loop of the true model chatters at the singularity, too."""
    true, model, _ = ur5
    start, far, _, _ = way_out(true, 0.95).points
    way = pa.trajectories.Waypoints([start, far, start], 1.0)
    found = run(true, model, way, 5.8, governed=True, adaptation="natural")
    assert found["lost"] is None and found["last"] < 1.0
    assert found["largest"] > 100.0  # it was outside
    assert found["late"] > 3.0 and any("error" in one.cause for one in found["slowed"])


def test_a_slow_lift_slows_its_path():
    """The circle asks for nine times the velocity limit of Tiago's torso."""
    robot = catalogue_robot("tiago_arm")
    circle = begun(pa.trajectories.Circle(np.zeros(3), 0.15, 1.2, "yz"), robot)
    model, natural = robot.changed(inertial_scale=0.7), {"adaptation": "natural", "dt": DT}
    found = run(robot, model, circle, 3.0, governed=True, **natural)
    assert found["lost"] is None and found["last"] < 1.0
    assert found["speed"] < 1.03  # at rest the unknown load alone moves it at a third of its limit
    assert found["slowed"][0].cause.startswith("joint speed of torso_lift_joint")


def test_the_governor_never_acts_on_good_runs():
    true, model = unknown(catalogue_robot("panda"))
    circle = begun(pa.reachable_circle(model), true)
    found = run(true, model, circle, 1.0, governed=True, dt=DT)
    assert found["lost"] is None and found["slowed"] == [] and found["late"] == 0.0
