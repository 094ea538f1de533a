"""Robots that stand: regressors and Jacobians of the tree, forces, V, loads found in MuJoCo."""

from functools import cache
from itertools import islice

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from benchmarks.standing import Sway
from pinadapt.controller.constraint_forces import ConstraintForces, Missed
from pinadapt.models.linear_kinematics import FrameKinematics
from pinadapt.robot.constraints import Constraints
from pinadapt.trajectories.pose import PoseTrajectory, Swing
from tests.support.identities import check_kinematics
from tests.support.loops import energy_along

SOLE = (0.1, 0.05)
FEET = {
    "a1": ["FL_foot", "FR_foot", "RL_foot", "RR_foot"],
    "talos": [pa.Contact("left_sole_link", SOLE), pa.Contact("right_sole_link", SOLE)],
}
TRUNK = pa.Unknown(bodies="payload", friction=False, armature=False)


@cache
def standing(name, **options):
    """Return a robot on its feet, loaded once: no test writes to it."""
    return pa.load(name, base="free", contacts=FEET[name], **options)


def test_a_free_base_is_six_joints_without_motors(tmp_path):
    robot = standing("a1")
    assert robot.model.nv == 18 and robot.motors.tolist() == [False] * 6 + [True] * 12
    model = robot.model
    data = robot.model.createData()
    pin.framesForwardKinematics(model, data, robot.q0)
    heights = [data.oMf[model.getFrameId(foot)].translation[2] for foot in FEET["a1"]]
    assert np.allclose(heights, 0.0, atol=1e-9)
    shapes = robot.visual.createData()
    pin.updateGeometryPlacements(model, data, robot.visual, shapes, robot.q0)
    assert min(place.translation[2] for place in shapes.oMg) == pytest.approx(0.0, abs=1e-3)
    free = pin.buildModelFromUrdf(str(robot.origin.urdf.path), pin.JointModelFreeFlyer())
    assert np.isclose(robot.mass, pin.computeTotalMass(free), rtol=1e-12)
    rng = np.random.default_rng(0)
    base = rng.uniform(-0.5, 0.5, 6)
    joints = rng.uniform(-1.0, 1.0, 12)
    turned = pin.Quaternion(pin.rpy.rpyToMatrix(*base[:2:-1])).coeffs()
    own = np.concatenate([base, joints])
    ours = pin.computeGeneralizedGravity(model, data, own)
    q = np.concatenate([base[:3], turned, joints])
    theirs = pin.computeGeneralizedGravity(free, free.createData(), q)
    assert np.allclose(ours[6:], theirs[6:], atol=1e-9)
    robot.save(tmp_path / "a1.xml")
    again = pa.load(tmp_path / "a1.xml", base="free").model
    assert np.allclose(pin.computeGeneralizedGravity(again, again.createData(), own), ours)


@pytest.mark.parametrize("frame", [None, "FR_foot", "RL_calf"])
def test_the_kinematics_of_a_frame_of_a_tree_are_exact_and_those_of_pinocchio(frame):
    robot = standing("a1", frame=frame)
    kinematics = FrameKinematics(robot, ["tool"] if frame else [])
    check_kinematics(kinematics)
    q = robot.q0 + 0.3 * np.random.default_rng(1).standard_normal(18)
    kinematics.update(kinematics.initial, q, np.zeros(18))
    off = robot.task.error(kinematics.x_hat, robot.position(q))
    assert np.allclose(off, 0.0, atol=1e-12)


@pytest.mark.parametrize("name", ["a1", "talos"])
def test_forces_keep_the_base_and_stay_in_their_cones(name):
    robot = standing(name)
    forces = ConstraintForces(robot)
    g = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), robot.q0)
    g[:3] += 0.05 * g[2] * np.array([1.0, -0.5, 0.5])
    torque = forces.solve(robot.q0, g).torque
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
    """And the limit that it misses is named."""
    robot = standing("a1")
    forces = ConstraintForces(robot)
    strong = np.full(18, 50.0)
    g = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), robot.q0)
    assert forces.solve(robot.q0, g, limits=strong).missed == Missed()
    strong[robot.joint_names.index("RR_calf_joint")] = 0.5
    torque, _, missed = forces.solve(robot.q0, g, limits=strong)
    assert missed.cause.startswith("effort of ") and (np.abs(torque[6:]) <= strong[6:]).all()
    _, _, missed = forces.solve(robot.q0, g + np.eye(18)[0] * 0.43 * g[2])  # 0.42 is borne
    assert missed.cause.startswith("contact of") and 0.1 < missed.size < 0.02 * g[2]
    g[0] = 5.0 * g[2]  # five times the weight along the ground
    torque, _, missed = forces.solve(robot.q0, g)
    assert missed.size > g[2] and missed.cause.startswith("contact of ")
    A, _ = forces.constraints.at(robot.q0, np.zeros(g.size))
    f = np.linalg.solve(A.T[6:], g[6:] - torque[6:]).reshape(4, 3)
    assert (f[:, 2] > -1e-3 * g[0]).all()
    assert (np.linalg.norm(f[:, :2], axis=1) <= 0.6 * f[:, 2] + 2e-3 * g[0]).all()
    assert f[:, 0].sum() > 0.3 * f[:, 2].sum()  # as much as friction allows


def test_a_run_says_when_its_torque_was_infeasible():
    """The trunk is shaken with more than friction bears; estimates rest meanwhile."""
    robot = standing("a1")
    controller = pa.make_controller(robot, unknown=TRUNK)
    shaking = PoseTrajectory(pa.trajectories.Circle(np.zeros(3), 0.02, 0.2), None)
    path = shaking.starting_at(robot.position(robot.q0)).from_rest(0.1)
    rollout = pa.simulate(robot, controller, path, duration=0.12)
    first = rollout.infeasible[0]
    assert 0.0 < first.start < first.end and first.cause.startswith("contact of ")
    assert "torque infeasible" in rollout.verdict
    k = np.flatnonzero((rollout.t > first.start) & (rollout.t <= first.end))
    moved = np.abs(np.diff(rollout.a_d, axis=0)).max(axis=1)
    assert not moved[k[:-1]].any() and moved[: k[0] - 2].any()


def test_a_foot_that_slips_ends_the_run_by_its_name():
    """The ground has a tenth of the friction that the controller takes it to have."""
    robot = standing("a1")
    ice = pa.load("a1", base="free", contacts=[pa.Contact(f, friction=0.06) for f in FEET["a1"]])
    path = PoseTrajectory(pa.trajectories.Circle(np.zeros(3), 0.03, 0.5), None)
    path = path.starting_at(robot.position(robot.q0)).from_rest(0.2)
    for guards in (True, False):
        controller = pa.make_controller(robot, unknown=TRUNK, limits=pa.Limits(guards=guards))
        rollout = pa.simulate(ice, controller, path, duration=0.06, engine="mujoco")
        assert (rollout.diverged is not None) == guards
    stream = pa.run(pa.plants.MujocoPlant(ice), pa.make_controller(robot), path, dt=1e-3)
    with pytest.raises(pa.exceptions.ContactError, match="lifted or slipped") as caught:
        list(islice(stream, 60))
    assert caught.value.frame in FEET["a1"] and 0.0 < caught.value.time < 0.06


def test_a_contact_moves_from_where_it_came_down():
    robot = standing("a1")
    constraints = robot.constrained
    q = robot.q0.copy()
    v = np.zeros(18)
    constraints.at(q, v)
    first, moved = constraints.footing(np.zeros((0, 3)), None, 1e-3)
    assert not moved.any()
    q[robot.joint_names.index("FR_calf_joint")] -= 0.1  # lifts
    constraints.at(q, v)
    _, moved = constraints.footing(first, None, 1e-3)
    assert moved[1] > 0.015 and not moved[[0, 2, 3]].any()
    stands = np.array([True, False, True, True])
    there, moved = constraints.footing(first, stands, 1e-3)
    assert not moved.any() and np.isnan(there[1]).all()
    landed, moved = constraints.footing(there, None, 1e-3)
    assert not moved.any() and landed[1, 2] > 1e-3


def test_a_push_that_is_known_by_its_projection_loads_the_feet_as_it_is():
    robot = standing("a1")
    forces = ConstraintForces(robot)
    push = np.zeros(18)
    push[:2] = 40.0, 10.0
    g = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), robot.q0)
    seen = robot.constrained.free(robot.q0, np.zeros(18))[0] @ push
    truth = forces.solve(robot.q0, g - push).torque
    found = forces.solve(robot.q0, g - seen, None, seen).torque
    blind = forces.solve(robot.q0, g - seen).torque
    off, blindly_off = (np.abs(each - truth).max() for each in (found, blind))
    assert off < 0.3 * blindly_off


def test_a_foot_in_the_air_bears_no_force():
    robot = standing("a1")
    forces = ConstraintForces(robot)
    stands = np.array([True, True, False, True])
    A, _ = Constraints(robot.model, robot.constraints).at(robot.q0, np.ones(18))
    assert np.allclose(forces.constraints.jacobian(robot.q0), A, atol=1e-15)
    own = 30.0 * np.outer([1.0, 2.0, 0.0, 1.0], [0.1, -0.1, 1.0])  # of three feet [N]
    for disturbance in (None, 0.1 * A.T @ own.ravel()):
        torque, f, missed = forces.solve(robot.q0, A.T @ own.ravel(), stands, disturbance)
        assert not missed.size and np.abs(f.reshape(4, 3)[2]).max() < 1e-9
        assert np.abs(torque).max() < 30.0


def test_what_constraints_leave_is_known_where_their_rows_depend_on_each_other():
    robot = standing("talos")
    twice = Constraints(robot.model, [*robot.constraints, robot.constraints[0]])
    v = np.random.default_rng(0).standard_normal(robot.model.nv)
    for given, own in zip(
        twice.free(robot.q0, v), robot.constrained.free(robot.q0, v), strict=True
    ):
        assert np.allclose(given, own, atol=1e-10)


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
    energy = energy_along(true, controller, path, seconds=2e-3, dt=1e-4)
    assert energy.mismatch(after=5) <= 5e-5  # by what the solver misses


@pytest.mark.slow
def test_what_a_standing_robot_excites_is_known_to_its_deviations():
    """Under noise of the motors' torques alone; nobody measures the forces of the contacts."""
    robot = standing("a1")
    controller = pa.make_controller(robot, unknown=TRUNK, dt=2e-3)
    run = pa.simulate(robot.changed(payload=pa.Payload(6.0)), controller, Sway(robot), duration=1.5)
    rng = np.random.default_rng(0)
    samples = run.evaluated().samples
    for k, one in enumerate(samples):
        noise = 0.3 * robot.motors * rng.standard_normal(18)
        samples[k] = one._replace(torque=one.torque + noise)
    found = run.excitation().dynamic.refined()
    off = (found.estimate - run.a_d_true) / found.deviations
    assert 0.4 < np.linalg.norm(off) / np.sqrt(10.0) < 1.4


def test_a_load_on_the_trunk_is_found_while_the_robot_stands():
    """In MuJoCo, whose contacts lift and slide; nothing is tuned by robot.

    And it is identified from the log, which has none of the forces that bear it.
    """
    robot = standing("a1")
    high = robot.q0[2]
    load = pa.Payload(11.0, [0.2 * high, 0.08 * high, 0.32 * high])
    true = robot.changed(payload=load)
    controller = pa.make_controller(robot, unknown=TRUNK, dt=2e-3)
    run = pa.simulate(true, controller, Sway(robot), duration=1.2, engine="mujoco")
    trunk = true.model.inertias[6]
    assert run.distance.max() < 4e-3 and run.distance[-250:].max() < 1e-4
    assert abs(run.a_d[-1, 0] / trunk.mass - 1.0) < 0.02
    with pytest.raises(pa.ParameterError, match="not measured"):
        run.payload()
    found = pa.identify(run, robot, unknown="payload")
    learned = found.payload()
    errors = found.torque_errors
    assert learned.mass == pytest.approx(load.mass, abs=0.02)
    assert np.abs(learned.com - load.com).max() < 2e-3
    assert errors.learned_held_out.mean() < 0.05 * errors.described_held_out.mean()
    assert abs(found.dynamic.estimate[0] - trunk.mass) < 4.0 * found.dynamic.deviations[0]


@pytest.mark.slow
def test_a_robot_that_stands_moves_its_trunk_and_a_hand():
    """Talos on two soles, poses of both, with unknown loads on trunk and hand."""
    frames = ("base_link", "gripper_left_base_link")
    n = range(1, 8)
    locked = [*(f"arm_right_{k}_joint" for k in n), "gripper_left_joint", "gripper_right_joint"]
    options = {"frames": frames, "locked": (*locked, "head_1_joint", "head_2_joint")}
    robot = standing("talos", **options)
    bent = {"arm_left_2_joint": 0.4, "arm_left_4_joint": -1.4, "arm_left_6_joint": 0.7}
    home = zip(robot.joint_names, robot.home_angles, strict=True)
    robot = standing("talos", **options, q0=tuple(bent.get(name, angle) for name, angle in home))
    trunk = pa.Payload(8.0, (-0.1, 0.0, 0.2))
    hand = pa.Payload(0.5, (0.0, 0.0, -0.05))
    true = robot.changed(payload=dict(zip(frames, (trunk, hand), strict=True)))
    own = [
        PoseTrajectory(
            pa.trajectories.Circle(np.zeros(3), radius, 2.0, plane),
            Swing((0.0, 1.0, 0.0), turn, 2.0),
        )
        for radius, plane, turn in ((0.015, "xy", 0.05), (0.04, "yz", 0.1))
    ]
    path = pa.trajectories.Stacked(own).starting_at(robot.position(robot.q0)).from_rest()
    controller = pa.make_controller(robot, unknown=TRUNK, dt=2e-3)
    rollout = pa.simulate(true, controller, path, duration=1.2, engine="mujoco")
    assert rollout.distance.max() < 3e-3 and rollout.window(False).max() < 2e-4
    assert rollout.infeasible == ()
    found = rollout.a_d[-1, [0, 10]]
    assert found == pytest.approx(
        [true.model.inertias[k + 1].mass for k in robot.carriers], rel=0.05
    )


def test_what_does_not_hold_under_constraints_is_refused():
    robot = standing("a1")
    with pytest.raises(pa.InputError, match="constraints"):
        pa.make_controller(robot, unknown=TRUNK, law="adaptive-inverse-dynamics")
    for feet in ([], FEET["a1"][:2]):
        with pytest.raises(pa.RobotError, match="no motor moves"):
            pa.make_controller(pa.load("a1", base="free", contacts=feet))
    with pytest.raises(pa.RobotError, match="free base"):
        pa.load("a1", task="joint", contacts=FEET["a1"])
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
    robot = standing("a1")
    load = pa.Payload(5.0, [0.05, 0.02, 0.08])
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
    plant = pa.plants.PinocchioPlant(robot.changed(coulomb=3.0))
    controller = pa.make_controller(robot, unknown=TRUNK)
    torque, _ = controller.safe(controller.init(plant.measure()), plant.measure())
    for _ in range(50):
        plant.hold(torque, 1e-3)
    assert np.abs(plant.measure().v).max() < 1e-6
