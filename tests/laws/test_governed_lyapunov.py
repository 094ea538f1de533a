"""dV/dt of the laws while a governor slows the time of the path."""

import copy
from dataclasses import replace

import pytest

import pinadapt as pa
from tests.laws.test_lyapunov_equalities import ROBOTS
from tests.laws.test_separation import frame, planar
from tests.support.loops import energy_along

pytestmark = pytest.mark.slow

# acts at the errors of a start beside the path, and fast enough for a run of 30 ms
ACTS = pa.Governor(position=0.02, slow=0.2, quick=200.0, recovery=20.0)
LAWS = ["separation", "adaptive-inverse-dynamics", "adaptive-jacobian"]


def governed(controller, robot):
    """Return the controller with a governor that acts at once."""
    governor = ACTS.of(robot, controller.kinematics.task, controller.sensors)
    other = copy.copy(controller)
    other.limits = replace(controller.limits, governor=governor)
    return other


def case(law, name):
    """Return true robot, controller, path and start as in the tests of the equalities."""
    if law != "separation":
        return ROBOTS[name](law, "gradient")
    true, controller, path = planar() if name == "planar_2r" else frame(name)
    return true, controller, path, {"a_k": [1.4, 1.5]} if name == "planar_2r" else {}


@pytest.mark.parametrize("name", ["planar_2r", "panda"])
@pytest.mark.parametrize("law", LAWS)
def test_the_equality_holds_while_the_path_is_slowed(law, name):
    """Along x_d(s(t)) with a rate ds/dt that falls, to the tolerance of the path in time."""
    true, controller, path, start = case(law, name)
    controller = governed(controller, true)
    rates = []
    desired = controller.desired

    def watched(state, motion, t):
        rates.append(state.path.rate)
        return desired(state, motion, t)

    controller.desired = watched
    energy = energy_along(true, controller, path, seconds=0.008, **start)
    assert rates[0] == 1.0 and 0.05 < min(rates) < 0.9
    rising = 10 if controller.adaptation_d.torque_bandwidth else 0  # the memory, from nothing
    energy.check(after=rising)
