"""The separation law against its own Lyapunov equality on every kind of task and parameter."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.models import SensedState
from pinadapt.signals import Signals
from tests.support.chains import catalogue_robot
from tests.support.loops import (
    check_kinematic_part,
    circle_beside,
    energy_along,
    with_tool_and_load,
)
from tests.support.paper import BASIS, CIRCLE, LMI

pytestmark = pytest.mark.slow

LENGTHS = ["elbow_joint:length", "wrist_1_joint:length"]


# rates that fixed steps of an ODE solver can follow
SLOW, JOINTS = {"gamma_d": 1.0}, {"gamma_joint": 1.0}


def frame(name, plane="yz", **options):
    robot = catalogue_robot(name)
    true = with_tool_and_load(robot).changed(viscous=0.2)
    believed = robot.changed(inertial_scale=0.7)
    rates = options or SLOW | JOINTS
    controller = pa.make_controller(
        believed, law="separation", unknown=pa.Unknown(friction="viscous", armature=False), **rates
    )
    return true, controller, circle_beside(true, plane)


def based():
    """Where the base stands in the camera's frame is unknown as well as the tool."""
    robot = catalogue_robot("panda")
    true = with_tool_and_load(robot).changed(
        link_translation={robot.joint_names[0]: [0.3, -0.2, 0.1]}
    )
    unknown = {"unknown": pa.Unknown(tool=True, base=True, friction=False, armature=False)}
    controller = pa.make_controller(robot, law="separation", **unknown, **SLOW)
    return true, controller, circle_beside(true, "yz")


def planar():
    robot = catalogue_robot("planar_2r")
    own = {"unknown": pa.Unknown(lengths=True, basis=BASIS, lmi=LMI)}
    controller = pa.make_controller(robot, law="separation", **own, **SLOW, **JOINTS)
    return robot, controller, CIRCLE


def lumped():
    robot = catalogue_robot("ur5")
    true = robot.changed(inertial_scale=1.3)
    controller = pa.make_controller(
        robot,
        law="separation",
        unknown=pa.Unknown(tool=False, translations=LENGTHS),
        adaptation="gradient",
    )
    return true, controller, circle_beside(true, "yz")


def pose(adaptation="natural"):
    robot = catalogue_robot("panda", task="pose")
    true = with_tool_and_load(robot)
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.7), law="separation", adaptation=adaptation, **SLOW
    )
    path = pa.trajectories.PoseTrajectory(
        pa.trajectories.Circle(np.zeros(3), 0.05, 2.0, "yz"),
        pa.trajectories.Swing([0.0, 0.0, 1.0], 0.3, 2.0),
    )
    aside = np.array([0.01, 0.01, 0.0, 0.1, 0.0, 0.1])
    return true, controller, path.starting_at(robot.task.moved(true.position(true.q0), aside))


def joints():
    robot = catalogue_robot("ur5", task="joint")
    true = robot.changed(inertial_scale=1.3, viscous=0.2)
    controller = pa.make_controller(
        robot,
        law="separation",
        unknown=pa.Unknown(friction="viscous", armature=False),
        **SLOW,
        **JOINTS,
    )
    return true, controller, pa.trajectories.Sinusoid(robot.home_angles + 0.05, 0.2, 2.0)


CASES = {
    "base": based,
    "planar": planar,
    "lumped": lumped,
    "pose": pose,
    "memory": lambda: pose(None),  # the default
    "joints": joints,
    "panda": lambda: frame("panda"),
    "scara": lambda: frame("scara", "xy"),
    "kinova": lambda: frame("kinova"),
    "gradient": lambda: frame("ur5", adaptation="gradient", gamma_d=1e-3, gamma_joint=1e-3),
}


def begun(controller):
    """Return after how many samples a memory's H has grown from nothing."""
    return 10 if isinstance(controller.adaptation_d, pa.adaptation.CompositeMemory) else 0


@pytest.mark.parametrize("case", CASES)
def test_equality_along_the_trajectory(case):
    true, controller, path = CASES[case]()
    energy = energy_along(true, controller, path, seconds=0.00625, dt=2.5e-4)
    energy.check(after=begun(controller))


@pytest.mark.parametrize("case", ["base", "planar", "scara"])
def test_equality_of_the_kinematic_part_from_a_wrong_observed_position(case):
    true, controller, path = CASES[case]()

    def begin(state):
        memory = state.filters.memory.copy()
        memory[: controller.kinematics.positions] += 0.01
        return state._replace(filters=state.filters._replace(memory=memory))

    energy = energy_along(true, controller, path, seconds=0.006, begin=begin)
    check_kinematic_part(energy, controller, true)


def test_equality_with_a_reference_that_keeps_speeds():
    """The error always demands more than the joints' limits; they lag behind."""
    true, controller, path = frame("panda")
    speeds = np.full(7, 0.04)
    controller.law = controller.law.adjusted(speeds=speeds)
    energy = energy_along(true, controller, path, seconds=0.00625, dt=2.5e-4)
    energy.check(after=begun(controller))
    plant = pa.plants.PinocchioPlant(true)
    state = controller.init(plant.measure())
    s = controller.observe(state, plant.measure(), path.at(0.0))
    asked = s.v - controller.law._reference_error(s)
    assert 0.03 < np.abs(asked).max() < 1.06 * 0.04


@pytest.mark.parametrize("task", [None, "pose"])
def test_the_observer_is_that_of_its_differential_equation(task):
    """dx_o/dt = J_hat qd - beta (x_o - x): halving dt leaves less than half of the difference."""
    robot = catalogue_robot("ur5", task=task)
    unknown = pa.Unknown(tracker=True) if task else None
    controller = pa.make_controller(robot, unknown=unknown, limits=pa.Limits(guards=False))
    plant = pa.plants.PinocchioPlant(robot)
    at_home = plant.measure()
    v = np.full(6, 0.2)
    begun = {"a_k": controller.kinematics.initial_at(at_home.q, at_home.x)} if task else {}
    state = controller.init(at_home, **begun)
    still = np.zeros(robot.task.size)
    path = pa.Desired(at_home.x, still, still)
    x = robot.task.moved(at_home.x, still + 0.01)
    ends = []
    for steps in (1, 2, 64):
        after = state
        for _ in range(steps):
            measurement = plant.measurement(robot.q0, v, after.t)._replace(x=x)
            after = controller.step(after.adapt(False), measurement, path, 0.01 / steps)[1]
        filtered = controller.observe(after, measurement, path).filtered
        ends.append(filtered.eta if task else filtered.dx_o)
    coarse, fine = (np.abs(end - ends[2]).max() for end in ends[:2])
    assert 0.0 < fine < 0.6 * coarse < 1e-3


@pytest.mark.parametrize(("task", "samples"), [(None, 1500), ("pose", 300)])
def test_the_observer_is_ahead_of_a_velocity_that_is_late(task, samples):
    """Joints that swing, their velocity behind a low pass of 50 /s, the position in time."""
    robot = catalogue_robot("ur5" if task else "planar_2r", task=task)
    unknown = pa.Unknown(tracker=True) if task else None
    kinematics = pa.make_controller(robot, unknown=unknown).kinematics
    low_pass = pa.filters.LowPass(50.0)
    dt = 2e-3
    left = {}
    rates = np.array([0.9, -0.6, 0.8, 0.7, -0.5, 0.9])[: kinematics.nv]
    for lead in (0.0, 1.0 / 50.0):
        observer = pa.filters.PositionObserver(4.0, lead=lead, orientation=bool(task))
        s = Signals()
        v = rates
        s.residual = None
        state = None
        errors = []
        for k in range(samples):
            q = pin.integrate(robot.model, robot.q0, rates / 3.0 * np.sin(3.0 * k * dt))
            sensed = SensedState(q, v, robot.position(q))
            kinematics.update(kinematics.initial, q, v)
            state = observer.init(sensed, kinematics) if state is None else state
            s.filtered = observer.observe(state, sensed, kinematics)
            s.xd_hat = kinematics.xd_hat
            errors.append(np.abs(s.filtered.eta if task else s.filtered.dx_o).max())
            state = observer.step(state, s, dt)
            v = low_pass.advance(v, rates * np.cos(3.0 * (k + 0.5) * dt), dt)
        left[lead] = max(errors[samples // 2 :])
    assert errors[0] < 1e-12 and left[0.02] < 0.3 * left[0.0], left


@pytest.mark.parametrize("name", ["so101", "panda"])
def test_default_damping_leaves_no_direction_undamped_and_none_too_fast(name):
    """Links that are light together have directions that caps of single joints do not damp."""
    robot = catalogue_robot(name)
    dt = 1e-3
    controller = pa.make_controller(robot, adaptation="natural-memory", dt=dt)
    law = controller.law
    motion = controller.motion
    rates = [
        np.sort(np.linalg.eigvals(np.linalg.solve(M, law.K_D(q, motion.dynamics.initial))).real)
        for M, q in zip(motion.mass_matrices, motion.states.q, strict=True)
    ]
    assert np.median(rates, axis=0)[0] > 0.8 * law.alpha
    assert 0.0 < np.max(rates) * dt < 0.51


def test_a_loop_that_knows_the_truth_is_left_with_what_sampling_leaves():
    """The observer follows an accelerated frame; by one end's velocity it lagged 3 to 5 um here."""
    robot = catalogue_robot("z1")
    path = pa.trajectories.Circle(np.zeros(3), 0.1, 3.0, "yz").starting_at(robot.position(robot.q0))
    controller = pa.make_controller(
        robot, adaptation="none", unknown=pa.Unknown(friction=False, armature=False)
    )
    rollout = pa.simulate(robot, controller, path, duration=2.0, record_every=5)
    assert rollout.distance[-200:].max() < 1.5e-6
