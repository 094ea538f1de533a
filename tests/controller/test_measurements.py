"""One table of healthy signals, which pass, and of faults, which end bridged or refused."""

import copy
import math
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import lfilter

import pinadapt as pa
from benchmarks.lying_sensors import CONTINUOUS, FAULTS, MEASURES, WRAPS, _apart, begun
from pinadapt.controller.sensing import new_trail
from pinadapt.models.delay_compensation import SensedState
from tests.support.paths import ROOT

LOGS = ROOT.parent / "shared" / "real"
RATES = [1000.0, 500.0, 250.0, 200.0, 100.0]
VELOCITIES = {
    "differenced": lambda q, dt: np.diff(q, axis=0, prepend=q[:1]) / dt,
    "low-passed at 5 Hz": lambda q, dt: lfilter(
        [1.0 - math.exp(-2.0 * math.pi * 5.0 * dt)],
        [1.0, -math.exp(-2.0 * math.pi * 5.0 * dt)],
        np.diff(q, axis=0, prepend=q[:1]) / dt,
        axis=0,
    ),
    "central": lambda q, dt: np.gradient(q, dt, axis=0),
}
ENCODERS = {"perfect": 0.0, "17 bits": 2.0 * math.pi / 2**17, "14 bits": 2.0 * math.pi / 2**14}
DECELERATIONS = {"friction": 20.0, "brake": 100.0, "obstacle": math.inf}  # [rad/s^2]
JOINT, STOP = 1, 0.35  # which joint stops, and when [s]


def read(controller, t, q, v):
    """Let a controller's sensing read samples of q and v; return what it holds last."""
    senses, kinematics = controller.senses, controller.kinematics
    sensed = SensedState(q[0], v[0], trail=new_trail(v[0]))
    now, period = t[0], controller.period
    for k in range(1, len(t)):
        sample = pa.Measurement(t[k], q[k], v[k])
        guards = senses.guards
        elapsed = guards.elapsed(now, t[k], period, period, sensed.trail)
        since = t[k] - now if guards.clock else elapsed
        given = sensed, now, sample, kinematics, kinematics.initial, since, False
        sensed, now = senses.read(*given)[0], t[k]
    return sensed


@cache
def logged():
    """Return time [s] and q (N, 6) [rad] of a recorded motion of a TX40."""
    path = LOGS / "tx40.csv"
    if not path.exists():
        pytest.skip("the recorded log is not here")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    return table[:, 0], table[:, 1:7]


@cache
def controller_of(name, rate, encoder=0.0):
    robot = pa.load(str(Path(LOGS / "tx40.urdf"))) if name == "tx40" else pa.load(name)
    return pa.make_controller(robot, dt=1.0 / rate, sensors=pa.Sensors(encoder=encoder))


@pytest.mark.parametrize("kind", VELOCITIES)
@pytest.mark.parametrize("rate", RATES)
def test_a_recorded_motion_is_healthy(rate, kind):
    """Coarse or filtered velocities, none of it declared."""
    t_log, q_log = logged()
    t = np.arange(t_log[0], t_log[-1], 1.0 / rate)
    q = q_log[np.searchsorted(t_log, t - 1e-9)]
    sensed = read(controller_of("tx40", rate), t, q, VELOCITIES[kind](q, 1.0 / rate))
    assert not sensed.trail[0]  # none was bridged


@cache
def stopping(name, cause, rate):
    """Return t, q and v of an arm on a sinusoid, of which one joint stops and is held.

    The others are pushed as the arm's momentum has it, and held on their way by their motors.
    """
    robot = pa.load(name)
    model, data = robot.model, robot.model.createData()
    n, fine = model.nv, 8000.0
    others = np.arange(n) != JOINT
    amplitude, omega = np.linspace(0.3, 0.2, n), np.linspace(3.0, 4.0, n)
    q, v, t, found, held = robot.q0.copy(), amplitude * omega, 0.0, [], False
    while t < STOP + 0.2:
        if len(found) <= t * rate + 1e-9:
            found.append((t, q.copy(), v.copy()))
        desired = amplitude * np.sin(omega * t)
        rate_d, a_d = amplitude * omega * np.cos(omega * t), -(omega**2) * desired
        off = pin.difference(model, pin.integrate(model, robot.q0, desired), q)
        a = a_d - 100.0 * off - 20.0 * (v - rate_d)
        if t >= STOP:
            M, way = pin.crba(model, data, q), 0.0 if held else -np.sign(v[JOINT])
            slowing = min(DECELERATIONS[cause], abs(v[JOINT]) * fine)
            reaction = way * slowing - a[JOINT]  # acceleration that friction or contact adds
            a[JOINT] += reaction
            a[others] -= np.linalg.solve(M[np.ix_(others, others)], M[others, JOINT]) * reaction
            held = held or abs(v[JOINT] + a[JOINT] / fine) < 1e-9
        after = v + a / fine
        if held:
            after[JOINT] = 0.0
        way = 0.5 * (v + after) / fine
        if held:
            way[JOINT] = 0.0
        q, v, t = pin.integrate(model, q, way), after, t + 1.0 / fine
    t, q, v = (np.array(column) for column in zip(*found, strict=True))
    return t, q, v


def counted(q, count, dt):
    """Return q in counts, and its differences."""
    q = np.round(q / count) * count
    return q, np.diff(q, axis=0, prepend=q[:1]) / dt


@pytest.mark.parametrize("bits", ENCODERS)
@pytest.mark.parametrize("rate", [200.0, 1000.0, 4000.0])
@pytest.mark.parametrize("cause", DECELERATIONS)
@pytest.mark.parametrize("name", ["ur5", pytest.param("panda", marks=pytest.mark.slow)])
def test_a_joint_that_stops_at_once_is_healthy(name, cause, rate, bits):
    t, q, v = stopping(name, cause, rate)
    if ENCODERS[bits]:
        q, v = counted(q, ENCODERS[bits], 1.0 / rate)
    read(controller_of(name, rate, ENCODERS[bits]), t[1:], q[1:], v[1:])


@pytest.mark.parametrize("fault", ["rounded", "pause"])
def test_times_of_a_fast_loop_may_be_rounded_or_pause(fault):
    t, q, v = stopping("ur5", "friction", 4000.0)
    if fault == "rounded":
        t = np.round(t, 3)
    else:
        kept = np.arange(len(t)) % 10**6
        kept = (kept < 800) | (kept >= 812)
        t, q, v = t[kept], q[kept], v[kept]
    read(controller_of("ur5", 4000.0), t[1:1200], q[1:1200], v[1:1200])


@cache
def moving(name, measures):
    loop = begun(name, "separation", measures)
    return loop, [s.q for s, _ in copy.deepcopy(loop).samples(0.3)]


@pytest.mark.parametrize("name", ["ur5", pytest.param("kinova", marks=pytest.mark.slow)])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_bridged_or_refused(name, fault):
    """Within 150 ms, and before a joint is two degrees away from where it would be without it."""
    if fault in (CONTINUOUS if name == "ur5" else WRAPS):
        pytest.skip("this robot cannot have it")
    loop, honest = moving(name, fault in MEASURES)
    model, loop = loop.true.model, loop.lying(fault)
    refused, farthest, k = False, 0.0, 0
    try:
        for truth, _ in loop.samples(0.15):
            farthest = max(farthest, _apart(model, honest[k], truth.q))
            k += 1
    except pa.PinadaptError:
        refused = True
    harmless = fault in ("x not given", "time of every second sample")
    assert refused or sum(loop.state.bridged) or harmless
    assert farthest < 2.0
    if not refused:
        return
    start = last = loop.plant.measure()
    drift = 0.0
    for last in loop.rest(1.5):
        drift = max(drift, _apart(model, start.q, last.q))
    assert drift < 20.0 and (loop.state.unseen.any() or np.abs(last.v).max() < 0.01)
