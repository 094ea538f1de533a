"""Laws of joint space: the task-space laws on a joint task, each with its V and dV/dt.

Their torques with an exact model: test_contract.py.
"""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.description import robots_folder
from pinadapt.scenario import Scenario
from tests.support.chains import catalogue_robot, mixed_robot
from tests.support.joint_motions import joint_robot, loaded, swinging
from tests.support.loops import energy_along

pytestmark = pytest.mark.slow

ADAPTIVE = ["slotine-li", "craig", "spong-ortega"]
# Craig's law needs M_hat invertible, Spong and Ortega's M + M_0 - M_hat: they get low rates.
RATES = {"slotine-li": 1e-4, "craig": 1e-6, "spong-ortega": 1e-6}  # test_contract.py: natural


# --- the proofs ---


@pytest.mark.parametrize("name", ["planar_2r", "mixed"])
@pytest.mark.parametrize("law", ADAPTIVE)
def test_equality_along_the_trajectory_under_gamma(law, name):
    robot = joint_robot(name)
    believed = robot.changed(inertial_scale=0.8)
    controller = pa.make_controller(believed, law=law, adaptation="gradient", gamma_d=RATES[law])
    energy = energy_along(loaded(robot), controller, swinging(robot), seconds=0.006)
    energy.check()


def test_a_continuous_joint_goes_the_short_way():
    robot = mixed_robot("joint")
    task = robot.task
    x = robot.home_angles
    assert robot.model.nq == 5 and task.size == task.coordinates == 4
    assert np.allclose(task.of(robot.q0), x)
    far = x + np.array([0.0, 6.0, 0.0, 0.0])
    assert np.allclose(task.error(far, x), [0.0, 6.0 - 2.0 * np.pi, 0.0, 0.0])
    q = pin.integrate(robot.model, robot.q0, np.array([0.1, 5.0, -0.2, 0.3]))
    assert np.allclose(
        task.error(task.of(q), x), pin.difference(robot.model, robot.q0, q), atol=1e-12
    )


# --- at work ---


@pytest.mark.parametrize(
    ("law", "scale", "size", "share"),
    [
        # M_0 must not be far below M: from a belief that is too light, the wrist is lost
        ("spong-ortega", 1.3, 0.2, 0.2),
        ("middleton-goodwin", 0.8, 0.1, 0.15),
    ],
)
def test_an_unknown_load_is_tracked(law, scale, size, share):
    robot = catalogue_robot("panda", task="joint")
    path = pa.trajectories.Sinusoid(robot.home_angles, size, 2.0)
    believed = robot.changed(inertial_scale=scale)
    ends = []
    for adaptation in ("natural", "none"):
        controller = pa.make_controller(believed, law=law, adaptation=adaptation, dt=4e-3)
        run = pa.simulate(loaded(robot), controller, path, duration=3.0)
        ends.append(run.summary()["max_error_last"])
        assert run.diverged is None or adaptation == "none"
    assert ends[0] < share * ends[1] and ends[0] < np.radians(0.5)


def test_the_two_link_arm_of_slotine_and_li():
    """Example 9.3 of *Applied Nonlinear Control*, in numbers of an independent simulation."""
    scenario = robots_folder() / "two_link" / "slotine_li_1991.toml"
    rollout = Scenario.read(scenario, ["engine.dt=2e-3"]).run()
    rms = np.degrees(np.sqrt(np.mean(rollout.error**2, axis=0)))
    assert np.allclose(rms, [0.693, 0.333], atol=5e-4)
    assert np.allclose(rollout.a_d[-1], [0.173, 0.661, 1.759, 1.320], atol=6e-4)
    largest = np.degrees(np.abs(rollout.error).max(axis=0))
    assert np.allclose(largest, [3.25, 1.29], atol=6e-3)
