"""Loops in motion that tests of sensors that lie and of the safe torque begin with."""

import copy

import pytest

from benchmarks.lying_sensors import begun

DT = 2e-3


@pytest.fixture(scope="session")
def moving():
    """Return loops of a UR5 in motion, by whether they measure torques, and where they will be."""
    loops = {measures: begun("ur5", "separation", measures, DT) for measures in (False, True)}
    honest = {
        measures: [s.q for s, _ in copy.deepcopy(loop).samples(1.0)]
        for measures, loop in loops.items()
    }
    return loops, honest
