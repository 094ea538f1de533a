"""Fast feedback of elastic joints: boundary layer, closed loops, what is refused."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.laws import FastFeedback
from pinadapt.robot import Actuators
from pinadapt.tuning.preflight import preflight
from tests.support.chains import catalogue_robot
from tests.support.loops import circle_at_home, with_tool_and_load

SOFT = Actuators(stiffness=5e3, encoders="link")


def geared(name):
    """Return a robot with rotors of half of what each joint moves."""
    robot = catalogue_robot(name)
    own = np.diag(pin.crba(robot.model, robot.model.createData(), robot.q0))
    return robot.changed(armature=np.maximum(0.5 * own, 1e-3 * own.max()))


def made(robot, law="separation", actuators=None, **options):
    return pa.make_controller(
        robot,
        law=law,
        limits=pa.Limits(actuators=actuators),
        unknown=pa.Unknown(armature=False),
        **options,
    )


@pytest.mark.parametrize("eps", [1.0, 0.1])
def test_the_boundary_layer_of_one_joint(eps):
    """A motor and a link on a spring decay as eta'' + K_f / B eta' + K (1 / B + 1 / M) eta = 0.

    K = K_1 / eps^2 and K_f = K_2 / eps: in fast time t / eps the eigenvalues are always the same.
    """
    B = 0.4
    K_1 = 800.0
    K_2 = 20.0
    K = K_1 / eps**2
    K_f = K_2 / eps
    dt = 1e-5 * eps
    robot = catalogue_robot("planar_2r")
    robot = pa.load("planar_2r", locked=[robot.joint_names[1]], frame=robot.frame, task="joint")
    robot = robot.changed(armature=B)
    actuators = Actuators(stiffness=K, encoders="link")
    law = made(robot, FastFeedback("slotine-li", K_f), actuators, adaptation="none").law
    assert np.array_equal(law.gain, [K_f])
    M = float(pin.crba(robot.model, robot.model.createData(), robot.q0)[0, 0]) - B
    plant = pa.plants.ElasticPlant(robot, actuators=actuators)
    moves = []
    for d, w in ((1e-4, 0.0), (0.0, 1e-2)):
        plant.reset()
        plant._d = np.array([d])
        plant._w = np.array([w])
        at = plant.measure()
        plant.step(law.gain * (at.v - at.w), dt)
        moves.append([plant._d[0], plant._w[0] - plant._v[0]])
    transition = np.array(moves).T / [1e-4, 1e-2]
    found = np.sort_complex(np.log(np.linalg.eigvals(transition).astype(complex)) / dt)
    layer = np.sort_complex(np.roots([1.0, K_f / B, K * (1.0 / B + 1.0 / M)]))
    assert np.allclose(found, layer, rtol=2e-3)
    fast = np.sort_complex(np.roots([1.0, K_2 / B, K_1 * (1.0 / B + 1.0 / M)]))
    assert np.allclose(eps * layer, fast) and fast.real.max() < 0.0


def test_the_gain_damps_the_springs_of_every_joint():
    robot = geared("ur5")
    controller = made(robot, FastFeedback("separation"), SOFT)
    controller.resting_at(robot.q0)
    B = robot.model.armature
    M = np.diag(pin.crba(robot.model, robot.model.createData(), robot.q0)) - B
    fast = np.sqrt(5e3 * (1.0 / B + 1.0 / M))
    damping = controller.law.gain / (2.0 * fast * B)
    slow = controller.law.gain < 0.4 * B / 1e-3 * (1.0 - 1e-9)
    assert slow.sum() >= 4 and np.allclose(damping[slow], np.sqrt(0.5))
    assert preflight(controller, 1e-3) == []
    assert preflight(made(robot, "separation"), 1e-3, SOFT) != []


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:dt = .* behind joints")
def test_a_loop_on_soft_joints_is_quiet_with_it_and_lost_without():
    robot = geared("panda")
    true = with_tool_and_load(robot)
    runs = []
    for law, declared in (("separation", None), (FastFeedback("separation"), SOFT)):
        controller = made(robot.changed(inertial_scale=0.8), law, declared)
        run = pa.simulate(
            true,
            controller,
            circle_at_home(true),
            duration=1.2,
            engine=SOFT,
        )
        runs.append(run)
    rigid, fast = runs
    assert rigid.diverged is not None
    assert fast.diverged is None and fast.ringing is None
    chatter = [np.sqrt(np.mean(np.diff(run.tau[-200:], axis=0) ** 2)) for run in runs]
    assert chatter[1] < 0.02 * chatter[0]
    assert fast.distance[-200:].max() < 1e-3
    assert fast.law == "separation, fast feedback"
