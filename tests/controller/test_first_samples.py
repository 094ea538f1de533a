"""Nonsense is refused at the first samples: units, orders, signs, frames, gravity."""

import math
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.robot import Gravity
from tests.support.chains import catalogue_robot
from tests.support.snapshots import snapshot, unchanged

DT = 1e-3


reachable_circle = cache(pa.reachable_circle)


class Loop:
    """A closed loop, one sample after another, with sensors and a plant that may be spoilt."""

    def __init__(self, robot, *, true=None, plant=None, guards=True, dt=DT, **options):
        self.robot = robot
        self.dt = dt
        self.true = robot if true is None else true
        options = {"adaptation": "natural", "dt": dt, **options}
        if guards is True and not {"sensors", "limits"} & options.keys():
            self.controller = guarded(robot, **options)
        else:
            options = {"limits": pa.Limits(guards=guards), **options}
            self.controller = pa.make_controller(robot, **options)
        self.plant = pa.plants.PinocchioPlant(self.true) if plant is None else plant
        circle = reachable_circle(robot)
        self.path = circle.starting_at(self.true.position(self.true.q0)).from_rest(1.0)

    def run(self, seconds, spoil=lambda sample: sample):
        """Yield the controller's state after each sample; an error leaves the last one as it is."""
        seen = pa.plants.SimulatedSensors(self.true, self.dt, self.controller.sensors)
        state = None
        torque = None
        given = None
        for _ in range(round(seconds / self.dt)):
            truth = self.plant.measure()
            sample = spoil(seen.measure(truth, given))
            state = self.controller.init(sample) if state is None else state
            before = snapshot(state)
            try:
                torque, after = self.controller.step(state, sample, self.path.at(truth.t), self.dt)
            except pa.ImplausibleError:
                assert unchanged(state, before)
                raise
            state = after
            yield state
            given = self.plant.motors(torque)
            self.plant.step(torque, self.dt)

    def refused(self, words, seconds=0.6, **options):
        """Return the error, and how far the farthest joint is from home [deg] when it comes."""
        with pytest.raises(pa.ImplausibleError, match=words) as caught:
            list(self.run(seconds, **options))
        way = pin.difference(self.robot.model, self.true.q0, self.plant.measure().q)
        return caught.value, math.degrees(np.abs(way).max())


@cache
def guarded(robot, off=(), **options):
    """Return a controller, made once, without some of the guards."""
    return pa.make_controller(robot, limits=pa.Limits(guards=dict.fromkeys(off, False)), **options)


# --- units of the first sample ---


@pytest.mark.parametrize("task", ["xyz", "pose"])
def test_a_first_sample_in_other_units_is_refused(task):
    robot = pa.load("panda", task=task)
    sample = pa.plants.PinocchioPlant(robot).measure()
    x = sample.x.copy()
    x[:3] *= 100.0
    for wrong, guard in (
        (sample._replace(x=x), "position"),
        (sample._replace(q=np.degrees(sample.q)), "limits"),
    ):
        with pytest.raises(pa.ImplausibleError, match=guard):
            guarded(robot).init(wrong)
        guarded(robot, ("position", "limits")).init(wrong)


# --- v against the differences of q ---


def test_one_joint_of_the_wrong_sign_is_named():
    robot = catalogue_robot("ur5")
    words = r"is not the rate of q: joint 'shoulder_lift_joint', .*the wrong sign"
    error, moved = Loop(robot).refused(words, spoil=changed(v=lambda v: SECOND * v))
    assert moved < 2.0 and "guards={'differences': False}" in str(error)


@pytest.mark.parametrize(
    "sensors",
    [
        pa.Sensors(encoder=2.0 * np.pi / 2**14),
        pa.Sensors(camera=pa.Camera(rate=30.0, delay=0.06), noise={"x": 1e-3, "v": 0.02}),
    ],
    ids=["14 bits", "camera"],
)
def test_declared_sensors_raise_no_alarm(sensors):
    robot = catalogue_robot("ur5")
    true = robot.changed(inertial_scale=1.3, payload=pa.Payload(0.3 * robot.mass))
    loop = Loop(robot, true=true, sensors=sensors, adaptation="natural-memory", dt=2e-3)
    assert len(list(loop.run(0.5))) == 250


# --- gravity that the arm adds, or not ---

ARMS = ["panda", "scara"]


def adding(robot, true=None):
    """Return the plant of an arm that adds its gravity torque."""
    return pa.plants.PinocchioPlant(robot if true is None else true, compensation=Gravity(robot))


@pytest.mark.parametrize("sensors", [None, pa.Sensors(encoder=2.0 * np.pi / 2**17)])
@pytest.mark.parametrize("name", ARMS)
def test_an_arm_that_adds_gravity_undeclared_is_refused_before_it_has_moved(name, sensors):
    robot = catalogue_robot(name)
    loop = Loop(robot, plant=adding(robot), sensors=sensors)
    error, moved = loop.refused(
        r"adds its own gravity torque.*: \d+ %.*compensated=\"nominal\"", 0.1
    )
    assert moved < 0.5 and 80.0 < float(error.value.split()[0]) < 110.0
    assert "guards={'gravity': False}" in str(error)
    other = Loop(robot, plant=adding(robot), guards={"gravity": False})
    assert len(list(other.run(0.1))) == 100


def test_a_declared_compensation_that_is_missing_is_learned_like_a_load():
    robot = catalogue_robot("tiago_arm")
    controller = pa.make_controller(robot, compensated="nominal", dt=2e-3)
    path = reachable_circle(robot).starting_at(robot.position(robot.q0)).from_rest()
    plant = pa.plants.PinocchioPlant(robot)
    samples = list(pa.run(plant, controller, path, dt=2e-3, duration=2.5))
    errors = [np.linalg.norm(each.truth.x - each.desired.x_d) for each in samples]
    assert max(errors) < 5e-3 and max(errors[-200:]) < 5e-4


def test_friction_is_not_taken_for_gravity_that_is_smaller():
    robot = pa.load("planar_2r", task="joint", locked=["joint2"], gravity=[0.0, -1.0, 0.0])
    swing = pa.trajectories.Sinusoid(robot.home_angles, 0.2, 2.0)
    true = robot.changed(coulomb=2.0)
    assert pa.simulate(true, pa.make_controller(robot), swing, duration=0.1).diverged is None


@pytest.mark.slow
@pytest.mark.parametrize("compensated", [None, "nominal"])
@pytest.mark.parametrize("name", ["kinova", "planar_2r"])
def test_wrong_inertias_and_a_load_raise_no_alarm(name, compensated):
    robot = catalogue_robot(name)
    heavy = robot.changed(inertial_scale=1.5)
    heavy = heavy.changed(payload=pa.Payload(0.3 * heavy.mass))
    for true in (robot.changed(inertial_scale=2.0 / 3.0), heavy):
        plant = None if compensated is None else adding(robot, true)
        loop = Loop(robot, true=true, plant=plant, compensated=compensated, dt=2e-3)
        try:
            list(loop.run(0.1))
        except pa.ImplausibleError as error:  # an arm that falls is one, but for no such reason
            assert "10 times the limit" in str(error)


# --- what is wired or mounted wrong ---


class Wired(pa.plants.PinocchioPlant):
    """An arm with one motor of the other sign, or one that is pushed by 40 N."""

    def __init__(self, robot, signs=1.0, force=0.0):
        super().__init__(robot)
        self.signs = signs
        self.force = np.array([0.0, force, 0.0])

    def step(self, torque, dt):
        q = self.measure().q
        model = self.robot.model
        at = model, model.createData(), q, self.robot.frame_id, pin.LOCAL_WORLD_ALIGNED
        super().step(self.signs * torque + pin.computeFrameJacobian(*at)[:3].T @ self.force, dt)


def changed(**changes):
    """Return what changes signals of a sample by functions of them."""
    return lambda sample: sample._replace(
        **{
            name: change(getattr(sample, name))
            for name, change in changes.items()
            if getattr(sample, name) is not None
        }
    )


SECOND = np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0])  # the sign of joint 2
SWAPPED = [0, 1, 2, 4, 3, 5]
TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
MOMENTUM, FRAME = "more torque beside the motors", "does not move with the joints"
WRONG = {
    "motor of the wrong sign": (MOMENTUM, {}),
    "encoder of the wrong sign": (MOMENTUM, {name: lambda a: SECOND * a for name in "qv"}),
    "joints swapped": (MOMENTUM, {name: lambda a: a[SWAPPED] for name in "qv"}),
    "x mirrored": (FRAME, {"x": lambda x: x * [1.0, 1.0, -1.0]}),
    "x turned": (FRAME, {"x": lambda x: TURNED @ x}),
    "encoder off": (FRAME, {"q": lambda q: q + 0.5 * np.pi * (SECOND < 0.0)}),
    "torque of the wrong sign": ("is not what was sent", {"tau": np.negative}),
}


def wired(words, **options):
    """Return the loop of a UR5 with unknown tool and load, and inertias 30 % too small."""
    robot = pa.load("ur5")
    tool = robot.reach * np.array([0.02, -0.02, 0.04])
    true = robot.changed(tool_translation=tool, payload=pa.Payload(0.05 * robot.mass, com=tool))
    sensors = pa.Sensors(noise={"tau": 0.1}, torque_offset=0.5) if "sent" in words else None
    return Loop(
        robot.changed(inertial_scale=0.7),
        plant=Wired(true, **options),
        true=true,
        adaptation="natural-memory",
        guards={"position": words == FRAME},
        sensors=sensors,
        dt=2e-3,
    )


@pytest.mark.parametrize("fault", WRONG)
def test_what_is_wired_or_mounted_wrong_is_refused(fault):
    words, changes = WRONG[fault]
    loop = wired(words, signs=SECOND if "motor" in fault else 1.0)
    moved = loop.refused(words, 0.4, spoil=changed(**changes))[1]
    assert moved < 20.0 and loop.plant.measure().t < 0.35


@pytest.mark.parametrize("words", [FRAME, "sent"])
def test_a_push_and_a_measured_torque_are_healthy(words):
    states = list(wired(words, force=40.0).run(0.3))
    assert len(states) == 150 and not sum(states[-1].bridged)
