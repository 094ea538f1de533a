"""The estimators of dynamics that others are compared with."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from benchmarks.contenders.estimation import Estimates, LearningProblem
from benchmarks.contenders.kalman_filter import kalman_filter
from benchmarks.contenders.recursive_least_squares import recursive_least_squares
from benchmarks.estimators import problem_of

TRUE = {"viscous": 0.5, "coulomb": 0.8, "armature": 0.05}


@cache
def problem() -> LearningProblem:
    """Return the exact log of a UR5 with friction and a load of 2 kg, and its description."""
    robot = pa.load("ur5")
    true = robot.changed(payload=pa.Payload(2.0, (0.02, -0.01, 0.05)), **TRUE)
    t = np.arange(0.0, 6.0, 0.005)
    n = robot.model.nv
    rates = np.outer(1.3 + 0.4 * np.arange(n), [1.0, 2.3])
    phases = np.arange(n)[:, None]
    angles = rates * t[:, None, None] + phases
    q = robot.q0 + 0.3 * np.sin(angles).sum(axis=2)
    v = (0.3 * rates * np.cos(angles)).sum(axis=2)
    a = -(0.3 * rates**2 * np.sin(angles)).sum(axis=2)
    data = true.model.createData()
    tau = [
        pin.rnea(true.model, data, *state) + true.friction_at(state[0]).torque(state[1])
        for state in zip(q, v, a, strict=True)
    ]
    return problem_of(pa.Log(t, q, np.array(tau), v), robot)


def judged(found: Estimates) -> tuple[float, int, float]:
    """Return held-out error [N m], bodies that are not physical, and the load [kg]."""
    a = found.at(problem().split)
    return problem().rms(a), problem().unphysical(a), found.load(problem(), np.inf)


def test_recursive_least_squares_find_the_torques():
    described = problem().rms(problem().dynamics.initial)
    error, _, load = judged(recursive_least_squares(problem()))
    assert error < 0.001 * described
    assert load == pytest.approx(2.0, rel=0.05)


def test_the_kalman_filter_stays_physical():
    described = problem().rms(problem().dynamics.initial)
    error, unphysical, _ = judged(kalman_filter(problem()))
    assert error < 0.2 * described
    assert unphysical == 0
    wrong = problem().physical.center.copy()
    wrong[[0, 24]] *= -1.0
    assert problem().unphysical(wrong) == 2
