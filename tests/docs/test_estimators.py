"""The estimators of dynamics that others are compared with."""

from functools import cache

import numpy as np
import pytest

from benchmarks.contenders.estimation import Estimates, LearningProblem
from benchmarks.contenders.kalman_filter import kalman_filter
from benchmarks.contenders.recursive_least_squares import recursive_least_squares
from benchmarks.estimators import problem_of
from tests.support.chains import catalogue_robot
from tests.support.recorded import recorded


@cache
def problem() -> LearningProblem:
    """Return the exact log of a UR5 with friction and a load of 1.5 kg, and its description."""
    return problem_of(recorded("ur5", dt=5e-3), catalogue_robot("ur5"))


def judged(found: Estimates) -> tuple[float, int, float]:
    """Return held-out error [N m], bodies that are not physical, and the load [kg]."""
    a = found.at(problem().split)
    return problem().rms(a), problem().unphysical(a), found.load(problem(), np.inf)


def test_recursive_least_squares_find_the_torques():
    described = problem().rms(problem().dynamics.initial)
    error, _, load = judged(recursive_least_squares(problem()))
    assert error < 0.001 * described
    assert load == pytest.approx(1.5, rel=0.05)


def test_the_kalman_filter_stays_physical():
    described = problem().rms(problem().dynamics.initial)
    error, unphysical, _ = judged(kalman_filter(problem()))
    assert error < 0.2 * described
    assert unphysical == 0
    wrong = problem().physical.center.copy()
    wrong[[0, 24]] *= -1.0
    assert problem().unphysical(wrong) == 2
