"""A reading that contradicts the one before is bridged, and refused if that lasts."""

import copy
import math

import numpy as np
import pytest

import pinadapt as pa
from benchmarks.lying_sensors import FAULTS, Liar, Loop, _apart
from pinadapt.controller.sensing import new_trail
from pinadapt.models.delay_compensation import SensedState

DT = 2e-3
ONCE = [name for name in FAULTS if name.endswith("once")]
LASTING = {
    "v of a joint stuck": "not the rate of q.*v stuck",
    "v of a joint zero": "not the rate of q.*v stuck",
    "v of the wrong sign": "not the rate of q",
    "v in degrees": "'v'",
    "q of a joint stuck": "q stuck",
    "encoder stuck, v zero with it": "'q' is stuck",
    "q wraps by 2 pi": "'q' has jumped.*a wrap at",
    "q in degrees": "'q' has jumped",
    "q off by 0.1 for good": "'q' has jumped.*a lost count",
    "x off by 0.3 m for good": "'x' has jumped.*another marker",
    "x frozen": "'x' has not changed.*repeat its last frame",
    "torque times 100": "'tau' is more than the motors give",
    "time stands": "'t' has been the same",
    "all repeated, time goes on": "not the rate of q.*q and v stuck",
    "v of a joint not a number": "'v' is not finite",
}
SOON = ("v of a joint stuck", "q of a joint stuck")  # to the bit, before sums show it
BLIND = ("encoder stuck, v zero with it", "all repeated, time goes on")  # only brakes rest them


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
def test_a_lasting_fault_is_refused_with_its_likely_cause_and_the_arm_comes_to_rest(moving, fault):
    """Within 20 ms, or two degrees of another way; then up to three seconds on the safe torque."""
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
    start, last = loop.plant.measure().q, loop.plant.measure()
    drift = 0.0
    for last in loop.rest(3.0 if fault == "v of a joint stuck" else 0.6):
        drift = max(drift, _apart(loop.true.model, start, last.q))
    assert loop.state.unseen.any() == (fault in BLIND)
    assert drift < 6.0 and (fault in BLIND or np.abs(last.v).max() < 0.03)


SLOW, PERIOD = 0.08, 3e-3  # [s] time constant of the filter of a driver, and its period
HONEST = {
    "v in steps of 0.05": lambda q, v: (q, np.round(v / 0.05) * 0.05),
    "v in steps of 0.1": lambda q, v: (q, np.round(v / 0.1) * 0.1),
    "v in steps of 0.05, cut off": lambda q, v: (q, np.floor(v / 0.05) * 0.05),
    "v in steps of 0.01, filtered": lambda q, v: (q, filtered(np.round(v / 0.01) * 0.01, 0.02)),
    "v that is zero below 0.02": lambda q, v: (q, np.where(np.abs(v) < 0.02, 0.0, v)),
    "v fifty times a second": lambda q, v: (q, v[np.arange(len(v)) // 6 * 6]),
    "v late by a filter": lambda q, v: (q, filtered(v, SLOW)),
    "v off by 0.02": lambda q, v: (q, v + 0.02),
    "encoders of 12 bits": lambda q, v: (counted(q), v),
    "encoders of 12 bits, v in steps": lambda q, v: (counted(q), np.round(v / 0.05) * 0.05),
    "stiction": lambda q, v: caught(q.copy(), v.copy()),
    "stiction, v late by a filter": lambda q, v: (
        stopped(q),
        filtered(v * (q == stopped(q)), SLOW),
    ),
}


def summed(v):
    """Return the angles of velocities."""
    return np.vstack([0.0 * v[:1], np.cumsum(0.5 * PERIOD * (v[1:] + v[:-1]), axis=0)])


def caught(q, v):
    """Return a motion in which friction stops a joint at once, where it would have turned back."""
    k = next(k for k in range(len(v) // 2, len(v)) if abs(v[k, 1]) < 0.2 * abs(v[0:k, 1]).max())
    k += int(np.argmin(np.abs(np.abs(v[k : k + 40, 1]) - 0.018)))
    q[k:, 1], v[k:, 1] = q[k - 1, 1], 0.0
    return q, v


def counted(q):
    """Return angles in counts of 12 bits."""
    return np.round(q / (2.0 * math.pi / 2**12)) * 2.0 * math.pi / 2**12


def filtered(v, late):
    """Return velocities behind a low pass with a time constant [s]."""
    low = v.copy()
    for k in range(1, len(v)):
        low[k] = low[k - 1] + PERIOD / late * (v[k] - low[k - 1])
    return low


def stopped(q):
    """Return angles that stand from the middle on."""
    return np.where(np.arange(len(q))[:, None] < len(q) // 2, q, q[len(q) // 2])


@pytest.mark.parametrize(
    ("kind", "rate", "slow"),
    [(kind, 0.1, -0.01) for kind in HONEST]
    + [(kind, 0.8, 0.045) for kind in HONEST if "late" not in kind],
)
def test_imperfections_of_real_sensors_are_not_refused(moving, kind, rate, slow):
    """Nothing of it is declared. Joints turn back at rates [rad/s], and one is slow throughout."""
    n, t = 6, PERIOD * np.arange(500.0)
    rates, frequency = rate * np.ones(n), np.linspace(3.0, 9.0, n)
    rates[0], frequency[0] = slow, 0.3
    v = rates * np.cos(np.outer(t, frequency)) * np.minimum(t / (0.0125 * rate), 1.0)[:, None]
    read(moving[0][False].controller, t, *HONEST[kind](summed(v), v))


def read(controller, t, q, v):
    """Let the senses of a controller read samples of q and v; raise what they refuse."""
    senses, kinematics = controller.senses, controller.kinematics
    sensed = SensedState(q[0], v[0], trail=new_trail(v[0]))
    a_k = kinematics.initial
    for k in range(1, len(t)):
        sample = pa.Measurement(t[k], q[k], v[k])
        sensed, _, _ = senses.read(
            sensed, t[k - 1], sample, kinematics, a_k, t[k] - t[k - 1], False
        )


def test_cosine_and_sine_of_a_continuous_joint_are_checked_at_every_sample():
    loop = Loop("kinova", "separation", dt=DT)
    for _ in loop.samples(0.02):
        pass
    loop.liar = Liar(loop.true, FAULTS["(cos, sin) times 1.2"])
    with pytest.raises(pa.ImplausibleError, match="cosine and sine"):
        for _ in loop.samples(0.1):
            pass
    assert loop.liar.count == 9 and loop.state.bridged.joints == 8
