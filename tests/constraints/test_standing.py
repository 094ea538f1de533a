"""Robots that stand: regressors and Jacobians of the tree, forces, V, loads found in MuJoCo."""

from itertools import islice

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from benchmarks.standing import Sway
from pinadapt.controller.constraint_forces import ConstraintForces
from pinadapt.models.linear_kinematics import FrameKinematics
from pinadapt.robot.constraints import Constraints
from pinadapt.trajectories.pose import PoseTrajectory, Swing
from tests.support.loops import energy_along

SOLE = (0.1, 0.05)
FEET = {
    "a1": ["FL_foot", "FR_foot", "RL_foot", "RR_foot"],
    "solo12": ["FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"],
    "talos": [pa.Contact("left_sole_link", SOLE), pa.Contact("right_sole_link", SOLE)],
}
TRUNK = pa.Unknown(bodies="payload", friction=False, armature=False)


def standing(name, **options):
    return pa.load(name, base="free", contacts=FEET[name], **options)


def test_a_free_base_is_six_joints_without_motors():
    robot = standing("a1")
    assert robot.model.nv == 18 and robot.motors.tolist() == [False] * 6 + [True] * 12
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, robot.q0)
    heights = [data.oMf[model.getFrameId(foot)].translation[2] for foot in FEET["a1"]]
    assert np.allclose(heights, 0.0, atol=1e-9)
    shapes = robot.visual.createData()
    pin.updateGeometryPlacements(model, data, robot.visual, shapes, robot.q0)
    assert min(place.translation[2] for place in shapes.oMg) == pytest.approx(0.0, abs=1e-3)
    free = pin.buildModelFromUrdf(str(robot.origin.urdf.path), pin.JointModelFreeFlyer())
    assert np.isclose(robot.mass, pin.computeTotalMass(free), rtol=1e-12)
    rng = np.random.default_rng(0)
    base, joints = rng.uniform(-0.5, 0.5, 6), rng.uniform(-1.0, 1.0, 12)
    turned = pin.Quaternion(pin.rpy.rpyToMatrix(*base[:2:-1])).coeffs()
    ours = pin.computeGeneralizedGravity(model, data, np.concatenate([base, joints]))
    q = np.concatenate([base[:3], turned, joints])
    theirs = pin.computeGeneralizedGravity(free, free.createData(), q)
    assert np.allclose(ours[6:], theirs[6:], atol=1e-9)


@pytest.mark.parametrize("frame", [None, "FR_foot", "RL_calf"])
def test_the_kinematics_of_a_frame_of_a_tree_are_those_of_pinocchio(frame):
    robot = standing("a1", frame=frame)
    kinematics = FrameKinematics(robot, ["tool"] if frame else [])
    rng = np.random.default_rng(1)
    q, v = robot.q0 + 0.3 * rng.standard_normal(18), rng.standard_normal(18)
    kinematics.update(kinematics.initial, q, v)
    model, data = robot.model, robot.model.createData()
    pin.computeJointJacobiansTimeVariation(model, data, q, v)
    pin.updateFramePlacements(model, data)
    given = model, data, robot.frame_id, pin.LOCAL_WORLD_ALIGNED
    assert np.allclose(kinematics.J, pin.getFrameJacobian(*given), atol=1e-12)
    rate = kinematics.jacobian_rate(np.zeros(kinematics.size))
    assert np.allclose(rate, pin.getFrameJacobianTimeVariation(*given), atol=1e-12)


@pytest.mark.parametrize("name", ["a1", "talos"])
def test_the_rate_of_the_constraints_is_that_of_differences(name):
    robot = standing(name)
    constraints = Constraints(robot.model, robot.constraints)
    rng, h = np.random.default_rng(2), 1e-6
    v = rng.standard_normal(robot.model.nv)
    q = robot.q0 + 0.1 * rng.standard_normal(robot.model.nv)
    before, after = (constraints.at(q + sign * h * v, v)[0] for sign in (-1.0, 1.0))
    assert np.allclose(constraints.at(q, v)[1], (after - before) / (2.0 * h), atol=1e-6)


@pytest.mark.parametrize("name", ["a1", "talos"])
def test_forces_keep_the_base_and_stay_in_their_cones(name):
    robot = standing(name)
    forces = ConstraintForces(robot, None)
    g = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), robot.q0)
    g[:3] += 0.05 * g[2] * np.array([1.0, -0.5, 0.5])
    torque = forces.torque(robot.q0, g)
    A, _ = forces.constraints.at(robot.q0, np.zeros(g.size))
    assert not torque[:6].any()
    f = np.linalg.lstsq(A.T, g - torque, rcond=None)[0]
    assert np.allclose(A.T @ f, g - torque, atol=1e-4 * abs(g[2]))
    start = 0
    for contact in robot.contacts:
        own = f[start : start + contact.size]
        assert own[2] > 0.0 and np.hypot(*own[:2]) <= contact.friction * own[2] + 1e-4
        if contact.sole is not None:  # the soles stand level at home
            assert abs(own[3]) <= SOLE[1] * own[2] + 1e-4
            assert abs(own[4]) <= SOLE[0] * own[2] + 1e-4
        start += contact.size


def test_a_torque_that_is_infeasible_is_missed_and_no_cone():
    robot = standing("a1")
    forces = ConstraintForces(robot, None)
    g = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), robot.q0)
    g[0] = 5.0 * g[2]  # five times the weight along the ground
    torque = forces.torque(robot.q0, g)
    A, _ = forces.constraints.at(robot.q0, np.zeros(g.size))
    f = np.linalg.solve(A.T[6:], g[6:] - torque[6:]).reshape(4, 3)
    assert (f[:, 2] > -1e-3 * g[0]).all()
    assert (np.linalg.norm(f[:, :2], axis=1) <= 0.6 * f[:, 2] + 2e-3 * g[0]).all()
    assert f[:, 0].sum() > 0.3 * f[:, 2].sum()  # as much as friction allows


def test_a_push_that_is_known_by_its_projection_loads_the_feet_as_it_is():
    robot = standing("a1")
    forces, push = ConstraintForces(robot, None), np.zeros(18)
    push[:2] = 40.0, 10.0
    g = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), robot.q0)
    seen = robot.constrained.free(robot.q0, np.zeros(18))[0] @ push
    truth, found = (
        forces.torque(robot.q0, g - push),
        forces.torque(robot.q0, g - seen, None, seen),
    )
    blind = forces.torque(robot.q0, g - seen)
    off, blindly_off = (np.abs(each - truth).max() for each in (found, blind))
    assert off < 0.3 * blindly_off


def test_contacts_that_leave_a_motion_of_the_base_are_refused():
    for feet in ([], FEET["a1"][:2]):
        robot = pa.load("a1", base="free", contacts=feet)
        with pytest.raises(pa.exceptions.RobotError, match="no motor moves"):
            pa.make_controller(robot)
    with pytest.raises(pa.exceptions.RobotError, match="free base"):
        pa.load("a1", task="joint", contacts=FEET["a1"])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a1", "talos"])
@pytest.mark.parametrize("adaptation", ["natural", "natural-memory"])
def test_lyapunov_equality_whatever_the_constraint_forces_are(name, adaptation):
    robot = standing(name)
    load = pa.Payload(0.1 * robot.mass, [0.02, 0.01, 0.05])
    true = robot.changed(payload=load)
    options = {"adaptation": adaptation, "limits": pa.Limits(guards=False)}
    controller = pa.make_controller(robot, unknown=TRUNK, **options)
    path = PoseTrajectory(
        pa.trajectories.Circle(np.zeros(3), 2e-3, 1.0), Swing((0.0, 1.0, 0.0), 0.02, 1.0)
    ).starting_at(true.position(true.q0))
    energy = energy_along(true, controller, path, seconds=4e-3, dt=1e-4)
    assert energy.mismatch(after=5) <= 5e-5  # by what the solver misses


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "mass", "worst", "end"),
    [("a1", 11.0, 4e-3, 1e-4), ("solo12", 1.0, 2e-3, 1e-4), ("talos", 10.0, 2e-3, 4e-4)],
)
def test_a_load_on_the_trunk_is_found_while_the_robot_stands(name, mass, worst, end):
    """In MuJoCo, whose contacts lift and slide; nothing is tuned by robot."""
    robot = standing(name)
    high = robot.q0[2]
    load = pa.Payload(mass, [0.2 * high, 0.08 * high, 0.32 * high])
    true, path = robot.changed(payload=load), Sway(robot)
    controller = pa.make_controller(robot, unknown=TRUNK)
    stream = pa.run(pa.plants.MujocoPlant(true), controller, path, dt=1e-3)
    samples = list(islice(stream, 4000))
    errors = [np.linalg.norm(s.measurement.x[:3] - s.desired.x_d[:3]) for s in samples]
    trunk = true.model.inertias[6].mass
    assert max(errors) < worst and max(errors[-800:]) < end
    assert abs(samples[-1].state.a_d[0] / trunk - 1.0) < 0.02


def test_what_does_not_hold_under_constraints_is_refused():
    robot = standing("a1")
    with pytest.raises(pa.InputError, match="constraints"):
        pa.make_controller(robot, unknown=TRUNK, law="adaptive-inverse-dynamics")
    linkage = robot.changed()
    object.__setattr__(linkage, "constraints", (pa.Loop("FL_foot", "FR_foot"), *robot.constraints))
    with pytest.raises(pa.InputError, match="would simulate the robot without"):
        pa.plants.MujocoPlant(linkage)


def test_a_governed_reference_of_a_redundant_robot_obeys_the_constraints():
    """Shortened null motions, and speeds of the path, with the rows of 12 constraints."""
    robot = standing("talos")
    limits = pa.Limits(governor=pa.Governor(speed=0.02))
    controller = pa.make_controller(robot, unknown=TRUNK, limits=limits)
    q = robot.q0.copy()
    q[18:] += 0.1  # arms and torso are away from rest
    plant = pa.plants.PinocchioPlant(robot)
    measurement = plant.measurement(q, np.zeros(robot.model.nv))
    state = controller.init(measurement)
    signals = controller.observe(state, measurement, Sway(robot).at(0.3))
    A, _ = robot.constrained.at(q, np.zeros(robot.model.nv))
    qd_r = -controller.law._reference_error(signals)
    assert np.abs(qd_r).max() > 1e-3 and np.abs(A @ qd_r).max() < 1e-9
    torque, _ = controller.step(state, measurement, Sway(robot).at(0.3), 1e-3)
    assert np.isfinite(torque).all() and not torque[:6].any()


def test_an_announced_load_is_that_of_the_trunk_and_a_safe_torque_holds_the_robot():
    robot, load = standing("a1"), pa.Payload(5.0, [0.05, 0.02, 0.08])
    controller = pa.make_controller(robot, unknown=TRUNK)
    plant = pa.plants.MujocoPlant(robot.changed(payload=load))
    state = controller.announce(controller.init(plant.measure()), payload=load)
    assert state.a_d[0] == pytest.approx(robot.model.inertias[6].mass + 5.0, rel=1e-12)
    for _ in range(300):
        torque, state = controller.safe(state, plant.measure())
        assert not torque[:6].any()
        plant.hold(torque, 1e-3)
    assert np.abs(plant.measure().q - robot.q0).max() < 5e-3


def test_a_robot_that_stands_with_friction_in_its_joints_rests():
    robot = standing("a1")
    friction = np.append(np.zeros(6), np.full(robot.model.nv - 6, 3.0))
    plant = pa.plants.PinocchioPlant(robot.changed(coulomb=friction))
    controller = pa.make_controller(robot, unknown=TRUNK)
    torque, _ = controller.safe(controller.init(plant.measure()), plant.measure())
    for _ in range(50):
        plant.hold(torque, 1e-3)
    assert np.abs(plant.measure().v).max() < 1e-6
