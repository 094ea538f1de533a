"""Positions in the axes of a tracker that stands anywhere."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

import pinadapt as pa
from pinadapt.information.tracker import find_tracker
from pinadapt.models.tracker_kinematics import TrackerKinematics
from pinadapt.tasks.frame import turned
from tests.support.chains import catalogue_robot, chains, random_state, seeded
from tests.support.identities import check_kinematics, check_motion
from tests.support.loops import check_kinematic_part, energy_along, with_tool_and_load
from tests.support.recorded import frames_of_small_motions

TURN = np.array([1.2, -1.5, 0.8])  # [rad] 2.1 together
PLACE = np.array([0.5, -0.4, 1.1])
TOOL = [0.02, -0.03, 0.05]
UNKNOWN = pa.Unknown(tracker=True)


@pytest.mark.parametrize("name", ["planar_2r", "scara", "panda", "kinova"])
def test_identities_on_robots(name):
    robot = catalogue_robot(name)
    check_kinematics(TrackerKinematics(robot, ["tool"]))
    check_kinematics(TrackerKinematics(robot, [robot.joint_names[1], "tool:length"]))


def test_identities_of_poses():
    """Of which an observer has the orientation: the velocity and acceleration are linear."""
    robot = pa.load("panda", task="pose")
    rng = np.random.default_rng(5)
    kinematics = TrackerKinematics(robot, ["tool"])
    q, v, a = random_state(robot, rng)
    a_k = kinematics.initial + 0.2 * rng.standard_normal(kinematics.size)
    given = (kinematics, (q, v, a), a_k, rng.standard_normal(a_k.size))
    rows = kinematics.positions
    size = check_motion(*given, accuracy=1e-8, rows=rows)
    assert np.allclose(kinematics.Y_k @ a_k, kinematics.xd_hat, atol=1e-12 * size)
    xdd = kinematics.J @ a + kinematics.Jdot_v
    regressor = kinematics.acceleration_regressor(a)
    assert np.allclose(regressor @ a_k, xdd, atol=1e-11 * size)


@given(robot=chains)
@seeded
def test_identities_on_random_chains(robot):
    check_kinematics(TrackerKinematics(robot, ["tool"]))


@pytest.mark.parametrize("name", ["panda", "scara", "planar_2r"])
def test_the_true_parameters_are_those_of_tracker_and_tool(name):
    robot = catalogue_robot(name)
    rng = np.random.default_rng(2)
    turn = [0.0, 0.0, 2.0] if robot.task.size == 2 else TURN
    true = robot.changed(tool_translation=[0.03, -0.02, 0.0]).seen_from(turn, PLACE)
    kinematics = TrackerKinematics(robot, ["tool"])
    a_k = kinematics.value(true)
    q, v, _ = random_state(robot, rng)
    kinematics.update(a_k, q, v)
    assert kinematics.x_hat == pytest.approx(true.position(q), abs=1e-12)
    found = kinematics.tracker(a_k)
    assert found.placement.rotation == pytest.approx(pin.exp3(np.array(turn)), abs=1e-9)
    assert kinematics.parameters(found) == pytest.approx(a_k, abs=1e-9)
    model = robot.model.copy()
    kinematics.write(model, a_k)
    frame = model.frames[robot.frame_id].placement.translation
    assert frame == pytest.approx(true.model.frames[robot.frame_id].placement.translation)


def circle_of(true, robot, radius=0.05, turn=TURN, by=(0.01, -0.01, 0.02)):
    """Return a circle in the axes of the tracker, beside where the robot is."""
    R = pin.exp3(np.array(turn))
    rows = robot.task.place
    x_0 = true.position(true.q0) + (R @ by)[rows]
    u, w = (R @ e for e in np.eye(3)[:2])

    def path(t):
        phi = np.pi * t
        return x_0 + radius * (u[rows] * (1.0 - np.cos(phi)) + w[rows] * np.sin(phi))

    return pa.trajectories.as_trajectory(path, robot.task)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kinematic"),
    [
        ("planar_2r", "gradient"),
        ("panda", "gradient"),
        ("ur5", "least-squares"),
        ("scara", "least-squares"),
    ],
)
def test_lyapunov_equality_with_an_unknown_tracker(name, kinematic):
    robot = catalogue_robot(name)
    turn = [0.0, 0.0, 0.6] if robot.task.size == 2 else 0.3 * TURN
    true = with_tool_and_load(robot).seen_from(turn, PLACE)
    believed = robot.changed(inertial_scale=0.7)
    controller = pa.make_controller(
        believed,
        unknown=pa.Unknown(tracker=True, friction=False, armature=False),
        adaptation="natural",
        kinematic_adaptation=kinematic,
        limits=pa.Limits(box=False),
        gamma_d=5.0,
        R_k=5.0,
    )
    energy = energy_along(
        true, controller, circle_of(true, robot, turn=turn).as_given(), seconds=0.012
    )
    energy.check()
    check_kinematic_part(energy, controller, true)


def with_marker(robot):
    """Return the robot with a frame that is turned on the tool by 79 degrees."""
    model = robot.model.copy()
    frame = model.frames[robot.frame_id]
    frame.placement = frame.placement * pin.SE3(pin.exp3(np.array([0.5, -1.0, 0.8])), np.zeros(3))
    return replace(robot, model=model)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the inertias of the bodies")  # of tiago_arm's description
@pytest.mark.parametrize(("name", "off"), [("panda", 0.0), ("tiago_arm", 0.0), ("kinova", 1.0)])
def test_lyapunov_equality_of_poses_with_unknown_tracker_and_marker(name, off):
    """Two spherical wrists and a slide among them; the observer begins exact or 31 degrees off."""
    robot = catalogue_robot(name, task="pose")
    true = with_marker(with_tool_and_load(robot)).seen_from(0.3 * TURN, PLACE)
    controller = pa.make_controller(
        robot.changed(inertial_scale=0.7),
        unknown=pa.Unknown(tracker=True, friction=False, armature=False),
        adaptation="natural",
        limits=pa.Limits(box=False),
        gamma_d=0.5,
        R_k=5.0,
    )
    path = pa.trajectories.PoseTrajectory(
        pa.trajectories.Circle(np.zeros(3), 0.05, 2.0, "yz"),
        pa.trajectories.Swing([0.0, 0.0, 1.0], 0.3, 2.0),
    )
    aside = np.array([0.003, -0.003, 0.006, 0.02, 0.0, 0.02])
    path = path.starting_at(robot.task.moved(true.position(true.q0), aside)).as_given()

    def begin(state):
        R = turned(state.filters.R, off * np.array([0.3, -0.2, 0.4]))
        return state._replace(filters=state.filters._replace(R=R))

    energy = energy_along(true, controller, path, seconds=0.0075, dt=3e-4, begin=begin)
    energy.check(within=1e-5)
    check_kinematic_part(energy, controller, true)


def half_a_turn_off():
    """Return a robot, a heavier one with tool and load before a tracker, and its circle."""
    robot = catalogue_robot("panda")
    turn = np.pi * TURN / np.linalg.norm(TURN)
    true = with_tool_and_load(robot.changed(inertial_scale=1 / 0.7)).seen_from(turn, PLACE)
    return robot, true, circle_of(true, robot, 0.1, turn, np.zeros(3))


@pytest.mark.slow
def test_after_an_excitation_the_angle_of_the_tracker_has_no_influence():
    """Frame, tool, load and every inertia unknown; in the first second 3 % of the radius."""
    robot, true, circle = half_a_turn_off()
    controller = pa.make_controller(robot, unknown=UNKNOWN, adaptation="natural", dt=4e-3)
    rollout = pa.simulate(true, controller, circle, duration=2.2, record_every=2)
    assert rollout.diverged is None
    assert rollout.distance.max() < 3e-3
    assert rollout.distance[-30:].max() < 3e-4


@pytest.mark.slow
def test_without_an_excitation_the_path_waits_until_the_axes_are_known():
    """The joints are held, under the load, while the frame moves by millimetres."""
    robot, true, circle = half_a_turn_off()
    controller = pa.make_controller(robot, unknown=UNKNOWN, dt=4e-3)
    rollout = pa.simulate(true, controller, circle, duration=4.8, start={}, record_every=2)
    begins = int(np.argmax(rollout.path_time > 0.0))
    assert rollout.diverged is None and 3.5 < rollout.t[begins] < 4.0
    assert rollout.distance[:begins].max() < 0.01 * robot.reach
    assert rollout.distance[begins:].max() < 1e-4


@pytest.mark.slow
def test_a_pose_is_followed_whose_marker_is_turned_on_the_tool():
    """Tracker at 120 degrees and marker at 79 degrees, both unknown, and a tilt of 0.2 rad."""
    robot = pa.load("ur5", task="pose")
    turn = np.radians(120.0) * TURN / np.linalg.norm(TURN)
    true = with_marker(robot.changed(tool_translation=TOOL)).seen_from(turn, PLACE)
    p_0 = true.placement(true.q0).translation
    R_0 = true.placement(true.q0).rotation

    def path(t):
        tilt = 0.1 * (1.0 - np.cos(np.pi * t)) * pin.exp3(turn)[:, 2]
        moved = p_0 + 0.05 * np.array([1.0 - np.cos(np.pi * t), np.sin(np.pi * t), 0.0])
        return pin.SE3(pin.exp3(tilt) @ R_0, moved)

    controller = pa.make_controller(robot, unknown=UNKNOWN, adaptation="natural", dt=4e-3)
    begun = controller.init(pa.plants.PinocchioPlant(true).measure()).kinematic
    V_k = controller.adaptation_k.storage(begun, controller.kinematics.value(true))
    law = controller.law  # the observed orientation never is half a turn off
    assert 0.0 < V_k < 0.03 * law.c * (np.pi * law.lever) ** 2 / 2.0
    rollout = pa.simulate(true, controller, path, duration=2.0)
    assert rollout.distance.max() < 1e-3 and rollout.distance[-50:].max() < 3e-4
    assert rollout.angle.max() < 2e-3 and rollout.angle[-50:].max() < 2e-4


@pytest.fixture(scope="module")
def frames():
    """Measurements of a wiggling Panda with a tool, seen by a tracker."""
    robot = catalogue_robot("panda")
    true = robot.changed(tool_translation=TOOL).seen_from(TURN, PLACE)
    samples = frames_of_small_motions(robot, true, 0.01)
    return true, TrackerKinematics(robot, ["tool"]), samples


def test_the_tracker_is_that_of_the_closed_form(frames):
    """With the tool known the best rotation is that of two clouds of points (Kabsch)."""
    true, _, samples = frames
    known = TrackerKinematics(catalogue_robot("panda").changed(tool_translation=TOOL))
    rng = np.random.default_rng(3)
    noisy = [s._replace(x=s.x + 1e-3 * rng.standard_normal(3)) for s in samples]
    lost = samples[0]._replace(x=np.full(3, np.nan))
    found = find_tracker(known, [lost, *noisy]).tracker.placement
    p = np.array([known.robot.position(s.q) for s in noisy])
    x = np.array([s.x for s in noisy])
    closed, _ = Rotation.align_vectors(x - x.mean(axis=0), p - p.mean(axis=0))
    t = x.mean(axis=0) - closed.apply(p.mean(axis=0))
    assert found.rotation == pytest.approx(closed.as_matrix(), abs=1e-8)
    assert found.translation == pytest.approx(t, abs=1e-8)
    off = pin.log3(found.rotation @ true.tracker.rotation.T)
    assert 1e-5 < np.linalg.norm(off) < 1e-2  # the noise is felt by both


def test_frames_in_a_plane_are_no_mirrors_and_known_to_their_deviations():
    """The third column of the axes is noise; the rotation vector is known by its own deviations."""
    robot = catalogue_robot("ur5")
    true = robot.seen_from(TURN, PLACE)
    off = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        samples = []
        for t in np.linspace(0.0, 2.0 * np.pi, 40):
            q = robot.q0 + 0.1 * np.array([0.0, np.sin(t), np.cos(t), 0.0, 0.0, 0.0])
            x = true.position(q) + 1e-3 * rng.standard_normal(3)
            samples.append(pa.Measurement(t, q, np.zeros(6), x))
        found = find_tracker(TrackerKinematics(robot), samples)
        off.append((pin.log3(found.tracker.placement.rotation) - TURN) / found.deviations[:3])
    assert (np.abs(np.sqrt(np.mean(np.square(off), axis=0)) - 1.0) < 0.6).all()
