"""Motion and torque of a run as its sensors said, the motion smooth where they are noisy."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..controller.state import Sample

CUTOFF = 30.0  # [Hz] of the low pass of noisy positions
_ORDER = 4
_END = 0.1  # [s] that is left out at both ends, where a low pass has settled on one side only
_NOISY = 1e-3  # share of the velocity by which it may differ from that of the positions


class MeasuredMotion(NamedTuple):
    """Configuration, velocity, acceleration and torque at N instants.

    Attributes:
        q: (N, nq).
        v, a: (N, nv) [rad/s, rad/s^2 or m].
        tau: (N, nv) [N m or N].
        period: between them [s].
        smooth: whether the motion was noisy and passed a low pass.
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    period: float
    smooth: bool = False


def measured_motion(model: pin.Model, samples: Sequence[Sample]) -> MeasuredMotion:
    """Return the measured motion of samples at a constant rate, in the middle between them.

    The velocity is the mean of both ends, the acceleration their difference: so they are exact to
    the square of the period for torques that are held. Where the measured velocity is not that of
    the measured positions, they are noisy: then q passes a low pass forwards and backwards, and v
    and a are its derivatives. The torque stays as it is: it is compared in averages over times that
    are longer than the low pass's, in which its noise is independent.
    """
    t = np.array([sample.t for sample in samples])
    measured = [sample.measurement for sample in samples]
    steps = len(samples) - 1
    if steps < 1 or t[-1] <= t[0]:
        none = np.zeros((0, model.nv))
        return MeasuredMotion(np.zeros((0, model.nq)), none, none, none, 0.0)
    period = float(t[-1] - t[0]) / steps
    q = np.array([one.q for one in measured])
    v = np.array([one.v for one in measured])
    tau = np.array([_torque(*both) for both in pairwise(samples)])
    way = np.array([pin.difference(model, *ends) for ends in pairwise(q)])
    mean = 0.5 * (v[:-1] + v[1:])
    noisy = np.linalg.norm(way / period - mean) > _NOISY * np.linalg.norm(mean)
    if not noisy or not (1.0 / period > 2.5 * CUTOFF and t[-1] - t[0] > 10.0 * _END):
        middle = [
            pin.integrate(model, start, 0.5 * part) for start, part in zip(q[:-1], way, strict=True)
        ]
        return MeasuredMotion(np.array(middle), mean, np.diff(v, axis=0) / period, tau, period)
    return _smooth(model, q[0], way, tau, period)


def _torque(sample: Sample, after: Sample) -> np.ndarray:
    """Return the torque (nv) between two samples: measured, or as the motors were known to give."""
    measured = after.measurement.tau
    return sample.torque if measured is None else np.asarray(measured, dtype=float)


def _smooth(
    model: pin.Model, q_0: np.ndarray, way: np.ndarray, tau: np.ndarray, period: float
) -> MeasuredMotion:
    """Return the motion without what is faster than ``CUTOFF``, and without ``_END`` at its ends.

    Derivatives are central differences of what is left.
    """
    from scipy.signal import butter, sosfiltfilt  # here, because scipy is slow to import

    low_pass = butter(_ORDER, CUTOFF, fs=1.0 / period, output="sos")
    ends = round(_END / period)
    travelled = sosfiltfilt(low_pass, np.cumsum(way, axis=0) - 0.5 * way, axis=0)
    v = np.gradient(travelled, period, axis=0)
    a = np.gradient(v, period, axis=0)
    travelled, v, a, tau = (part[ends:-ends] for part in (travelled, v, a, tau))
    path = [pin.integrate(model, q_0, part) for part in travelled]
    return MeasuredMotion(np.array(path), v, a, tau, period, True)
