"""Default gains of the adaptations that predict the torque."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from .._checks import positive
from ..adaptation.adaptation import Adaptation
from ..adaptation.composite import Composite, CompositeMemory
from ..adaptation.least_squares import LeastSquares
from ..models.typical_motion import TypicalMotion

# of the bandwidth
_LEARNED = 1e3  # by least squares
_FILTER = 1.25
_FORGETTING = 0.125
_DOUBT = 1.0  # at which memory that is contradicted by as much as its noise is forgotten

_NOISE = 0.01  # that memory believes in, in the roots of the units of the floor
_FLOOR = 1e-2  # of what the tracking error's gain would make of the torque over a typical motion


_MEMORIES = ("natural-memory", "composite-memory")
FORGETTING = (*_MEMORIES, LeastSquares.name)
PREDICTING = ("natural-composite", "composite", *FORGETTING)


def predicting(
    kind: str,
    moved: Adaptation,
    motion: TypicalMotion,
    bandwidth: float,
    share: float,
    rates: Mapping[str, Any],
    mode: float,
) -> Adaptation:
    """Return an adaptation of the tracking error that learns from the torque as well.

    The prediction error decays at ``mode`` times the bandwidth w, seen through a low pass of 1.25
    w. Least squares, whose gain falls as it learns, begins at 1000 w: that takes 3 % of the torque
    that the initial uncertainty stands for as its noise, independent after 1 / w. It forgets at
    w / 8. The 1000 are the largest of three that panda, ur5 and z1 were tried with for 3 s; the
    others matter little there.

    A memory moves the estimate at the same rate, whatever noise and period are, which it averages
    and bears. It takes 1 % of the torque that the initial uncertainty stands for as
    noise, and forgets at w where it is contradicted by as much as that. Of perfect sensors 3 w
    would find a changed load twice as fast; with encoders of 17 bits it forgets too much, and a
    Panda is left with four times the error. Without a change neither number matters.

    Args:
        kind: of ``PREDICTING``.
        moved: how the estimate follows the tracking error.
        motion: the believed robot.
        bandwidth: w [rad/s].
        share: of the default rates, as noise and the period bear it.
        rates: given ``prediction_rate``, ``prediction_filter`` and ``forgetting``.
        mode: ``Law.prediction_mode``, half for laws with a drive of their own.

    Raises:
        GainError: a rate that is not positive.
    """
    default = _LEARNED if kind == LeastSquares.name else mode
    rate = _given(rates, "prediction_rate", default * bandwidth * share)
    low_pass = _given(rates, "prediction_filter", _FILTER * bandwidth)
    torques = typical_torques(moved, motion)
    if kind in _MEMORIES:
        rate = _given(rates, "prediction_rate", mode * bandwidth)
        doubt = _given(rates, "forgetting", _DOUBT * bandwidth)
        noise = _NOISE * np.sqrt(torques)
        return CompositeMemory(moved, low_pass, rate=rate, noise=noise, forgetting=doubt)
    if kind != LeastSquares.name:
        return Composite(moved, low_pass, rate=rate, floor=_FLOOR * torques)
    forgetting = _given(rates, "forgetting", _FORGETTING * bandwidth * share)
    P_0, size = moved.gain(_start(moved, motion)), motion.dynamics.size
    return LeastSquares(P_0, size, low_pass, weight=rate / torques, forgetting=forgetting)


def _given(rates: Mapping[str, Any], name: str, default: float) -> float:
    given = rates.get(name)
    return default if given is None else positive(given, name, zero=name == "forgetting")


def _start(adaptation: Adaptation, motion: TypicalMotion) -> np.ndarray:
    """Return the typical parameters (p), moved into the adaptation's domain."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # bodies moved into the cone are told of at the start
        return adaptation.validate(motion.dynamics.typical)


def typical_torques(adaptation: Adaptation, motion: TypicalMotion) -> np.ndarray:
    """Return the mean diagonal (n) of Y Gamma Y^T over a typical motion, positive."""
    start = _start(adaptation, motion)
    squares = [np.sum(Y.T * adaptation.gain_times(start, Y.T), axis=0) for Y in motion.regressors]
    mean = np.mean(squares, axis=0)
    return np.maximum(mean, 1e-12 * max(mean.max(initial=0.0), 1e-300))
