"""A motion that distinguishes parameters, and when an estimate of them has become good."""

from functools import cache

import numpy as np

import pinadapt as pa
from tests.support.chains import catalogue_robot, random_state


class Exciting(pa.trajectories.Trajectory):
    """Each joint at two frequencies of its own, from rest at home."""

    def __init__(self, start, size=0.1):
        n = len(start)
        self._start = np.asarray(start)
        self._size = size
        self._w = np.linspace(2.0, 5.0, n), np.linspace(7.0, 3.5, n)

    def at(self, t):
        x = self._start.copy()
        xd = np.zeros(self._start.size)
        xdd = np.zeros(self._start.size)
        for w in self._w:
            x += self._size * (1.0 - np.cos(w * t))
            xd += self._size * w * np.sin(w * t)
            xdd += self._size * w * w * np.cos(w * t)
        return pa.Desired(x, xd, xdd)


@cache
def times_of_panda(adaptation, shares, friction=False, seconds=1.0):
    """Return when the rms torque error over random states stays below shares of the first [s]."""
    controller, true, path = panda_swung(adaptation, friction)
    rollout = pa.simulate(true, controller, path.as_given(), duration=seconds)
    assert rollout.diverged is None
    truth = controller.dynamics.value(true)
    rng = np.random.default_rng(4)
    regressors = [controller.dynamics.regressor(*random_state(true, rng)) for _ in range(40)]
    every = 10
    wrong = (rollout.a_d[::every] - truth) @ np.vstack(regressors).T
    size = np.linalg.norm(wrong, axis=1)
    times = []
    for share in shares:
        above = np.flatnonzero(size > share * size[0])
        assert above[-1] < len(wrong) - 1  # reached at all
        times.append(every * 1e-3 * (above[-1] + 1))
    return times


def panda_swung(adaptation, friction=False):
    """Return controller, true robot and motion of a Panda whose load and inertias are unknown."""
    robot = catalogue_robot("panda", task="joint")
    true = robot.changed(payload=pa.Payload(1.5, [0.02, -0.01, 0.05]))
    if friction:
        true = true.changed(viscous=1.0, coulomb=0.5)
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.8),
        law="slotine-li",
        adaptation=adaptation,
        unknown=pa.Unknown(friction=friction, armature=friction),
    )
    return controller, true, Exciting(true.home_angles)
