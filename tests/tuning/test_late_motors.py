"""Late motors and elastic joints that were not declared."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.tuning.defaults import frequency, quiet_start
from tests.support.chains import catalogue_robot
from tests.tuning.test_heavy_load import light_wrist

MEMORY = "natural-memory"


@pytest.mark.parametrize(
    ("adaptation", "dt", "lag"), [("natural", 1e-3, 8e-3), (MEMORY, 5e-3, 10e-3)]
)
def test_the_damping_is_for_torques_that_are_late_by_a_few_milliseconds(adaptation, dt, lag):
    """K_D^-1 = K_v^-1 + lag M_hat^-1 with any adaptation, lag the larger of 8 ms and 2 dt."""
    for name in ("panda", "so101"):
        robot = catalogue_robot(name)
        known = pa.Unknown(armature=False)
        controller = pa.make_controller(robot, adaptation=adaptation, unknown=known, dt=dt)
        law = controller.law
        a_d = controller.dynamics.initial
        assert law.lag == lag
        M = pin.crba(robot.model, robot.model.createData(), robot.q0)
        K_D = np.linalg.inv(np.linalg.inv(law.K_v) + lag * np.linalg.inv(M))
        assert np.allclose(law.K_D(robot.q0, a_d), K_D, rtol=1e-9)
        fastest = np.linalg.eigvals(np.linalg.solve(M, K_D)).real.max()
        assert 0.3 / lag < fastest < 1.0 / lag


def test_a_heavy_unannounced_load_does_not_spin_a_light_wrist():
    """1 kg 0.1 m off the axis of a flange of 80 g, in the first half second."""
    robot = light_wrist()
    true = robot.changed(payload=pa.Payload(1.0, (0.1, 0.0, 0.0)))
    controller = pa.make_controller(robot, adaptation=MEMORY)
    rollout = pa.simulate(true, controller, pa.reachable_circle(robot), duration=0.8)
    assert rollout.diverged is None and rollout.distance.max() < 0.11
    assert rollout.distance[-50:].max() < 2e-3


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_the_tracking_error_adapts_at_the_bandwidth(name):
    """Of robots of every size."""
    made = pa.make_controller(catalogue_robot(name), adaptation=MEMORY)
    w = made.motion.bandwidth
    motion = made.motion
    inner = made.adaptation_d.inner
    bodies = slice(0, motion.dynamics.inertial.size)
    Gamma = inner.gain(quiet_start(inner, motion.dynamics.typical))[bodies, bodies]
    effects = [Phi[:, bodies] for Phi in made.law.parameter_effects(motion)]
    assert w == made.law.alpha == made.law.lambda_d.max() == 30.0
    assert w <= frequency(effects, Gamma) < 1.5 * w  # a last body that may carry a load adds to it
