"""Frames of a camera that come late, seldom, twice, in any order, or not at all."""

import copy
import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.models.delay_compensation import DelayCompensator, SensedState
from tests.support.chains import catalogue_robot
from tests.support.loops import with_tool_and_load
from tests.support.snapshots import snapshot, unchanged

pytestmark = pytest.mark.slow

DT = 1e-3  # [s]
CAMERA = pa.Camera(30.0, 0.06)


class Stream:
    """An arm whose joints move as prescribed, measured at 1 kHz, and a controller that observes it.

    Joint i goes through q0 + 0.4 sin(3 t + i); between samples it moves evenly.
    """

    def __init__(self, name, task=None, *, changed=None, sensors=None, **unknown):
        self.robot = catalogue_robot(name, **({} if task is None else {"task": task}))
        tool = [0.03, -0.02, 0.08 * (self.robot.task.positions == 3)]
        self.true = self.robot.changed(tool_translation=tool, **(changed or {}))
        self.options = {
            "unknown": pa.Unknown(bodies="none", friction=False, armature=False, **unknown),
            "limits": pa.Limits(torque=False, guards={"limits": False}),  # it goes past its stops
        }
        self.controller = pa.make_controller(self.robot, sensors=sensors, **self.options)
        self.plant = pa.plants.PinocchioPlant(self.true)
        self.nv = self.robot.model.nv
        self.a_k = self.controller.kinematics.value(self.true)
        still = np.zeros(self.robot.task.size)
        self.desired = pa.Desired(self.true.position(self.true.q0), still, still)

    def q(self, t):
        """Return the configuration at time t [s]."""
        k = math.floor(t / DT + 1e-6)
        share = t / DT - k
        here, there = (self._sampled(i) for i in (k, k + 1))
        return here if share < 1e-6 else pin.interpolate(self.robot.model, here, there, share)

    def _sampled(self, k):
        way = 0.4 * np.sin(3.0 * k * DT + np.arange(self.nv)) + np.linspace(0.0, 2.9, self.nv)
        return pin.integrate(self.robot.model, self.robot.q0, way)

    def x(self, t):
        """Return the true task coordinates at time t [s]."""
        return self.plant.measurement(self.q(t), np.zeros(self.nv)).x

    def sample(self, k, taken=None):
        """Return sample k; with the frame of a time ``taken`` [s], or without one."""
        v = 1.2 * np.cos(3.0 * k * DT + np.arange(self.nv))
        x = None if taken is None else self.x(taken)
        return pa.Measurement(k * DT, self.q(k * DT), v, x, taken)

    def start(self, **options):
        """Return the state after sample 0, which shows its own frame."""
        return self.controller.init(self.sample(0, 0.0), **options)

    def signals(self, frames, *, count=None, **options):
        """Yield what the law sees at each sample; frames: sample -> when its frame was taken."""
        state = self.start(**options)
        for k in range(max(frames, default=0) + 1 if count is None else count):
            sample = self.sample(k, frames.get(k))
            yield k, self.controller.observe(state, sample, self.desired)
            _, state = self.controller.step(state, sample, self.desired, DT)

    def torques(self, frames, count):
        """Return the torques (count, n) from the first sample on, and the state after them."""
        state = self.start()
        torques = []
        for k in range(count):
            sample = self.sample(k, frames.get(k))
            torque, state = self.controller.step(state, sample, self.desired, DT)
            torques.append(torque)
        return np.array(torques), state


STREAMS = {
    "panda": lambda **options: Stream("panda", **options),
    "kinova": lambda **options: Stream("kinova", **options),  # continuous joints pass half a turn
    "link": lambda **options: Stream(
        "ur5",
        changed={"link_translation": {"elbow_joint": [0.02, 0.01, 0.0]}},
        translations=["elbow_joint"],
        regressor="nominal",
        **options,
    ),
    "pose": lambda **options: Stream("panda", "pose", **options),
}
FRAMES = {5: 3.0, 6: 3.4, 30: 27.75, 40: 40.0, 41: 41.0, 90: 45.5, 91: 91.0, 120: 91.0 + 1 / 3}
FRAMES = {k: taken * DT for k, taken in FRAMES.items()}  # [s] ages from 1 sample to 45.5 samples


@pytest.fixture(params=STREAMS, scope="module")
def stream(request):
    return STREAMS[request.param]()


@pytest.fixture(scope="module")
def panda():
    return STREAMS["panda"]()


# --- what a late frame tells ---


def test_a_late_frame_tells_the_error_of_todays_estimate_and_is_carried_to_today(stream):
    """At any age, between samples too, while the estimate learns.

    The carried position is off by (X_k(q) - X_k(q_c)) da_k: by nothing with true parameters.
    """
    kinematics, task, off, moved = stream.controller.kinematics, stream.robot.task, 0.0, 0.0
    for k, s in stream.signals(FRAMES, count=130):
        taken = max((t for at, t in FRAMES.items() if at <= k), default=0.0)
        x_hat, X_k = kinematics.at(stream.q(taken))
        seen = task.position(stream.x(taken))
        da_k = s.a_k - stream.a_k
        assert np.abs(s.X_k - X_k).max() <= 1e-12
        assert np.abs(s.epsilon - X_k @ da_k).max() <= 1e-12
        assert np.abs(s.epsilon - (task.position(x_hat) - seen)).max() <= 1e-12
        carried = (kinematics.at(stream.q(k * DT))[1] - s.X_k) @ da_k
        missed = task.error(s.x, stream.x(k * DT))
        assert np.abs(missed[: task.positions] - carried).max() <= 1e-12
        assert np.abs(missed[task.positions :]).max(initial=0.0) <= 1e-12
        off = max(off, np.abs(carried).max())
        moved = max(moved, np.abs(s.epsilon).max())
    assert off > 1e-5 and moved > 1e-3
    assert not np.array_equal(s.a_k, kinematics.initial)


def test_frames_without_delay_are_used_unchanged(stream):
    """To the bit as by a controller that never carries."""
    fresh = {k: k * DT for k in range(20)}
    plain = copy.copy(stream)
    held = DelayCompensator(enabled=False)
    plain.controller = copy.copy(stream.controller)
    plain.controller.senses = replace(stream.controller.senses, compensator=held)
    torques, state = stream.torques(fresh, 20)
    same, end = plain.torques(fresh, 20)
    assert torques.tobytes() == same.tobytes() and state.a_d.tobytes() == end.a_d.tobytes()
    assert state.sensed.frame is None


# --- lost, repeated, out of order ---


def test_repeated_and_older_frames_change_nothing(panda):
    once = {10: 6 * DT, 25: 20 * DT}
    again = {10: 6 * DT, 11: 6 * DT, 12: 3 * DT, 13: 6 * DT, 25: 20 * DT, 26: 19.5 * DT}
    torques, state = panda.torques(once, 40)
    same, end = panda.torques(again, 40)
    assert same.tobytes() == torques.tobytes()
    assert unchanged(end, snapshot(state))


def test_frames_from_the_future_are_refused(panda):
    _, state = panda.torques({10: 6 * DT}, 20)
    before = snapshot(state)
    for late in (1e-6, 0.5, math.inf, math.nan):
        sample = panda.sample(20, 20 * DT)._replace(x_time=20 * DT + late)
        with pytest.raises(pa.MeasurementError, match="'x_time'"):
            panda.controller.step(state, sample, panda.desired, DT)
    assert unchanged(state, before)


def test_samples_too_long_without_frames_are_refused_until_one_arrives(panda):
    blind = panda.controller.senses.compensator.longest_gap
    last = round(blind / DT)
    _, state = panda.torques({}, last + 1)  # the frame of sample 0 is not older than that
    before = snapshot(state)
    with pytest.raises(pa.ImplausibleError, match="'x' has not been seen for"):
        panda.controller.step(state, panda.sample(last + 1), panda.desired, DT)
    assert unchanged(state, before)
    seen = panda.sample(last + 1, last * DT)
    _, after = panda.controller.step(state, seen, panda.desired, DT)
    assert after.sensed.frame.t == pytest.approx(last * DT)


# --- noise of the frames ---


def test_smoothing_lowers_the_variance_as_a_first_order_low_pass(panda):
    """By (1 - r) / (1 + r), r = exp(-smoothing T), while the arm moves."""
    rng, kinematics, T, sigma = np.random.default_rng(3), panda.controller.kinematics, 1 / 30, 1e-3
    rates = (5.0, 20.0)
    still = np.zeros(7)
    compensators = [DelayCompensator(), *map(DelayCompensator, rates)]
    begun = panda.controller.senses.init(panda.sample(0, 0.0), kinematics, panda.a_k)
    states = [begun] * 3
    off = []
    for k in range(1, 1200):
        q = panda.q(DT * (k % 1000))
        true = panda.plant.measurement(q, still).x
        x = true + sigma * rng.standard_normal(3)
        kinematics.update(panda.a_k, q, still)
        states = [
            SensedState(q, still, *one.update(before, (k - 1) * T, k * T, q, x, None, kinematics))
            for one, before in zip(compensators, states, strict=True)
        ]
        off.append([state.x - true for state in states])
    plain, *smooth = np.square(off[200:]).mean(axis=(0, 2))
    assert plain == pytest.approx(sigma**2, rel=0.05)
    for rate, variance in zip(rates, smooth, strict=True):
        r = math.exp(-rate * T)
        assert variance / plain == pytest.approx((1.0 - r) / (1.0 + r), rel=0.2)


def test_smoothing_adds_no_lag(panda):
    """The low pass is on the prediction error: with the true parameters nothing passes it."""
    smooth = STREAMS["panda"](sensors=pa.Sensors(noise={"x": 1e-3}))
    assert smooth.controller.senses.compensator.smoothing < 60.0
    for k, s in smooth.signals(FRAMES, count=130, a_k=smooth.a_k, adapting=False):
        assert np.abs(s.x - smooth.x(k * DT)).max() <= 1e-12


# --- closed loops ---


ERRORS = {  # [mm] at the end of three seconds, with a camera of 30 frames a second 60 ms late
    "separation": 0.06,
    "resolved-acceleration": 0.01,  # told the truth: frames are carried without error
    "adaptive-inverse-dynamics": 0.3,
    "adaptive-jacobian": 0.4,
}


@pytest.mark.parametrize("law", ERRORS)
def test_task_space_laws_tolerate_a_slow_and_late_camera(law):
    """A panda with unknown tool and load on a circle of 10 cm, at speed."""
    robot = catalogue_robot("panda")
    true = with_tool_and_load(robot)
    believed = robot if pa.laws.LAWS[law].adapts else true
    sensors = pa.Sensors(camera=CAMERA)
    controller = pa.make_controller(believed, law=law, sensors=sensors, dt=2e-3)
    path = pa.trajectories.Circle(np.zeros(3), 0.1, 3.0, "yz").starting_at(true.position(true.q0))
    rollout = pa.simulate(true, controller, path.as_given(), duration=3.0, record_every=7)
    assert rollout.diverged is None
    assert 1e3 * rollout.window(first=False).max() < ERRORS[law]
