"""A reading that does not follow from the one before is bridged, and refused if it lasts."""

import copy
import math

import numpy as np
import pytest

import pinadapt as pa
from benchmarks.lying_sensors import FAULTS, Liar, Loop, _apart, begun
from pinadapt._kernels import samples as kernels

DT = 2e-3
ONCE = [name for name in FAULTS if name.endswith("once")]
LASTING = {
    "v of a joint stuck": "not the rate of q.*v stuck, the same for the last samples",
    "v of a joint zero": "not the rate of q.*v stuck",
    "v of the wrong sign": "not the rate of q",
    "v in degrees": "'v'",
    "q of a joint stuck": "q stuck",
    "encoder stuck, v zero with it": "'q' is stuck.* since it moved at (?!0 rad/s)",
    "q wraps by 2 pi": "'q' has jumped.*a wrap at",
    "q in degrees": r"'q' has jumped.*is q in degrees\?",
    "q off by 0.1 for good": "'q' has jumped.*encoder",
    "x off by 0.3 m for good": "'x' has jumped.*another marker",
    "x frozen": "'x' has not changed.*repeat its last frame",
    "torque times 100": "'tau' is more than the motors give",
    "time stands": "'t' has been the same",
    "all repeated, time goes on": "'q' is stuck.*repeat a measurement",
    "not a number": "'v' is not finite",
}
SOON = ("v of a joint stuck", "q of a joint stuck")  # to the bit, before sums show it
BLIND = ("encoder stuck, v zero with it", "all repeated, time goes on")  # no torque can rest on it


@pytest.fixture(scope="module")
def moving():
    """Return loops of a UR5 in motion, by whether they measure torques, and where they will be."""
    loops = {measures: begun("ur5", "separation", measures, DT) for measures in (False, True)}
    honest = {
        measures: [s.q for s, _ in copy.deepcopy(loop).samples(1.0)]
        for measures, loop in loops.items()
    }
    return loops, honest


@pytest.mark.parametrize("fault", ONCE)
def test_one_bad_sample_is_bridged_and_counted(moving, fault):
    loops, honest = moving
    measures = fault.startswith("torque")
    loop = loops[measures].lying(fault)
    apart = [
        _apart(loop.true.model, q, truth.q)
        for q, (truth, _) in zip(honest[measures], loop.samples(0.06), strict=False)
    ]
    assert sum(loop.state.bridged) == 1 and sum(loops[measures].state.bridged) == 0
    assert max(apart) < 0.1  # [deg]; unbridged up to 20


@pytest.mark.parametrize("fault", LASTING)
def test_a_lasting_one_is_refused_with_its_likely_cause_and_the_arm_comes_to_rest(moving, fault):
    """Within 20 ms, or two degrees of another way; then three seconds on the safe torque."""
    loops, honest = moving
    measures = fault.startswith("torque")
    loop, k, farthest = loops[measures].lying(fault), 0, 0.0
    before = copy.deepcopy(loop.state.flat())
    with pytest.raises(pa.MeasurementError, match=LASTING[fault]):
        for truth, _ in loop.samples(1.0):
            farthest = max(farthest, _apart(loop.true.model, honest[measures][k], truth.q))
            k += 1
    assert k * DT < 0.02 or farthest < (0.3 if fault in SOON else 2.0)
    assert np.array_equal(loops[measures].state.flat(), before)
    if fault in BLIND:
        return
    start, last = loop.plant.measure().q, loop.plant.measure()
    drift = 0.0
    for last in loop.rest(3.0 if fault.startswith("v of a") else 0.8):
        drift = max(drift, _apart(loop.true.model, start, last.q))
    assert drift < 6.0 and np.abs(last.v).max() < 0.03


SLOW = 0.08  # [s] time constant of the filter of a driver
HONEST = {
    "v in steps of 0.05": lambda q, v: (q, np.round(v / 0.05) * 0.05),
    "v in steps of 0.01, filtered": lambda q, v: (q, filtered(np.round(v / 0.01) * 0.01, 0.02)),
    "v that is zero below 0.02": lambda q, v: (q, np.where(np.abs(v) < 0.02, 0.0, v)),
    "v ten times a second less often": lambda q, v: (q, v[np.arange(len(v)) // 5 * 5]),
    "v late by a filter": lambda q, v: (q, filtered(v, SLOW)),
    "v off by 0.02": lambda q, v: (q, v + 0.02),
    "encoders of 12 bits": lambda q, v: (counted(q), v),
    "encoders of 12 bits, v in steps": lambda q, v: (counted(q), np.round(v / 0.05) * 0.05),
    "stiction, v late by a filter": lambda q, v: (
        stopped(q),
        filtered(v * (q == stopped(q)), SLOW),
    ),
}


def counted(q):
    """Return angles in counts of 12 bits."""
    return np.round(q / (2.0 * math.pi / 2**12)) * 2.0 * math.pi / 2**12


def filtered(v, late):
    """Return velocities behind a low pass with a time constant [s]."""
    low = v.copy()
    for k in range(1, len(v)):
        low[k] = low[k - 1] + DT / late * (v[k] - low[k - 1])
    return low


def stopped(q):
    """Return angles that stand from the middle on."""
    return np.where(np.arange(len(q))[:, None] < len(q) // 2, q, q[len(q) // 2])


@pytest.mark.parametrize(
    ("kind", "rate"),
    [(kind, 0.1) for kind in HONEST] + [(kind, 0.5) for kind in HONEST if "late" not in kind],
)
def test_what_sensors_of_real_arms_do_is_no_fault(moving, kind, rate):
    """Nothing of it is declared. A second of a motion [rad/s] in which joints turn back."""
    guards = moving[0][False].controller.senses.guards
    t, n, nothing = DT * np.arange(500.0), guards.bounds.shape[1], np.zeros(0)
    frequency = np.linspace(3.0, 9.0, n)
    q = rate * np.sin(np.outer(t, frequency)) / frequency
    q, v = HONEST[kind](q, rate * np.cos(np.outer(t, frequency)))
    trail = guards.trail(v[0])
    for k in range(1, len(t)):
        before, trail = trail, np.empty(trail.size)
        found = kernels.check_sample(
            q[k], q[k - 1], v[k], nothing, nothing, nothing, DT,
            guards.bounds, guards.places, guards.numbers, before, trail,
        )  # fmt: skip
        assert found <= kernels.STILL, (k, divmod(found - kernels.JOINTS, kernels.KINDS))


def test_the_torque_of_before_moves_an_arm_far_that_the_safe_one_holds(moving):
    """What used to be the advice after a refused sample."""
    loop = copy.deepcopy(moving[0][False])
    _, torque = next(iter(loop.samples(DT)))
    held, start = copy.deepcopy(loop.plant), loop.plant.measure().q
    for _ in range(round(1.0 / DT)):
        held.step(torque, DT)
    for _ in loop.rest(1.0):
        pass
    assert _apart(loop.true.model, start, held.measure().q) > 20.0
    assert _apart(loop.true.model, start, loop.plant.measure().q) < 3.0


def test_the_safe_torque_needs_no_measurement_at_all(moving):
    """And its state is a new one, with the estimates and counters as they were."""
    loop = copy.deepcopy(moving[0][False])
    before = loop.state
    torque, state = loop.controller.safe(before)
    assert np.isfinite(torque).all() and state.t == before.t + DT
    assert np.array_equal(state.flat(), before.flat()) and state.bridged == before.bridged
    slower = [np.abs(state.sensed.v).max()]
    for _ in range(100):
        _, state = loop.controller.safe(state)
        slower.append(np.abs(state.sensed.v).max())
    assert slower[-1] < 0.01 * slower[0] and (np.diff(slower) <= 0.0).all()
    for wrong in (-1.0, math.nan):
        with pytest.raises(pa.InputError, match="damping"):
            loop.controller.safe(state, damping=wrong)


def test_a_continuous_joint_is_a_point_of_the_circle_at_every_sample():
    loop = Loop("kinova", "separation", dt=DT)
    for _ in loop.samples(0.02):
        pass
    loop.liar = Liar(loop.true, FAULTS["(cos, sin) times 1.2"])
    with pytest.raises(pa.ImplausibleError, match="cosine and the sine"):
        for _ in loop.samples(0.1):
            pass
    assert loop.liar.count == 9 and loop.state.bridged.joints == 8


def test_a_repeated_time_is_no_period(moving):
    """Nothing is learned, and no filter moves on, in a sample that has the time of the last."""
    loop = copy.deepcopy(moving[0][False])
    _, sample = loop.measured()
    desired = loop.motion.at(sample.t)
    _, once = loop.controller.step(loop.state, sample, desired, DT)
    _, twice = loop.controller.step(once, sample, desired, DT)
    assert np.array_equal(once.a_d, twice.a_d) and np.array_equal(once.a_k, twice.a_k)
    assert (once.a_d != loop.state.a_d).any() and twice.bridged.times == 1


def test_a_run_says_how_many_samples_were_bridged(tmp_path):
    robot = pa.load("planar_2r")

    class Glitch(pa.plants.PinocchioPlant):
        def measure(self):
            sample = super().measure()
            return sample._replace(x=sample.x + 1.0 * (abs(sample.t - 0.05) < 1e-9))

    controller = pa.make_controller(robot, adaptation="natural")
    rollout = pa.simulate(
        robot, controller, pa.reachable_circle(robot), duration=0.1,
        engine=pa.Engine(plant=lambda robot, **given: Glitch(robot, **given)),
    )  # fmt: skip
    rollout.save(tmp_path)
    assert rollout.bridged.frames == 1 and "1 of frames" in str(rollout)
    assert pa.Rollout.load(tmp_path).bridged == rollout.bridged
