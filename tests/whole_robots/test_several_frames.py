"""Several task frames in one controller: kinematics, V, closed loops, loads and tools by frame."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.exceptions import InputError, ParameterError, RobotError
from pinadapt.identification import calibrate
from pinadapt.models import FrameKinematics
from pinadapt.records import Camera
from pinadapt.tasks.frame import turned
from tests.support.identities import check_kinematics
from tests.support.loops import ARRAYS, energy_along
from tests.support.two_arms import (
    ENDS,
    circles,
    torso_with_two_arms,
    two_arms,
    with_tools_and_loads,
)
from tests.view.test_animation import stream

HELD = pa.Loop(*ENDS, closed=False)  # one point of an object
TURNED = pa.Loop(*ENDS, rows=(4,), closed=False)  # the hands turn alike about an axis
TIAGO = ["arm_left_tool_link", "arm_right_tool_link"]
UNPHYSICAL = pytest.mark.filterwarnings("ignore:the inertias of the bodies")  # of TIAGo's shoulders


def test_the_tree_of_the_chains_to_the_frames_is_loaded():
    robot = two_arms()
    assert robot.frames == tuple(ENDS) and robot.frame == ENDS[0]
    assert robot.model.nv == 9 and robot.carriers == [4, 8]
    assert (robot.task.size, robot.task.positions, robot.task.coordinates) == (6, 6, 6)
    x = robot.position(robot.q0)
    there = [robot.of_frame(end).position(robot.q0) for end in ENDS]
    assert np.array_equal(x, np.concatenate(there))
    assert robot.reach == pytest.approx(two_arms(q0=np.zeros(9)).reach)
    assert 1.0 < robot.reach < 1.6  # of one arm, not of both
    assert "left_hand, right_hand" in repr(robot)


def test_one_of_several_frames_is_the_plain_robot():
    one = pa.load("panda", frames=["panda_hand"])
    plain = pa.load("panda", frame="panda_hand")
    assert one.task == plain.task and one.frames == ("panda_hand",)
    assert np.array_equal(one.q0, plain.q0)
    load = pa.Payload(1.0, [0.0, 0.0, 0.1])
    named, bare = (plain.changed(payload=each) for each in ({"panda_hand": load}, load))
    assert named.model == bare.model
    assert type(pa.make_controller(one).kinematics) is FrameKinematics


REFUSED = [
    ({"frames": [ENDS[0], "left_han"]}, "no frame 'left_han'"),
    ({"frames": ENDS, "frame": ENDS[0]}, "not both"),
    ({"frames": 3}, "list of names"),
    ({"frames": [*ENDS, "left_wrist"]}, "singular in every pose"),  # on the same body
    ({"frames": ENDS, "task": "joint"}, "not by the joints"),
    ({"frames": ENDS, "loops": [HELD]}, "6 rows of the task cannot move independently"),
    ({"frames": ENDS, "task": "pose"}, "12 coordinates"),
    ({"frames": ENDS, "task": "image", "pixel": 0.002}, "one task frame"),
]


@pytest.mark.parametrize(("given", "words"), REFUSED)
def test_frames_that_cannot_be_controlled_together_are_refused(given, words):
    with pytest.raises(RobotError, match=words):
        pa.load(torso_with_two_arms(), **given)


@pytest.mark.parametrize("unknown", ["base", "tracker", "geometry", "lengths"])
def test_unknown_translations_beside_the_tools_are_refused(unknown):
    with pytest.raises(ParameterError, match="their tools may be unknown"):
        pa.make_controller(two_arms(), unknown=[unknown, "tool"])


@pytest.mark.parametrize(
    "use",
    [
        lambda robot: robot.changed(payload=pa.Payload(1.0)),
        lambda robot: robot.changed(payload={"hand": pa.Payload(1.0)}),
        lambda robot: robot.changed(payload={ENDS[0]: 1.0}),
        lambda robot: robot.changed(tool_translation=[0.0, 0.0, 0.1]),
        lambda robot: robot.of_frame("hand"),
        lambda robot: robot.filmed_by(pixel=0.002),
        lambda robot: pa.reachable_circle(robot),
        lambda robot: pa.excite(robot),
        lambda robot: pa.make_controller(robot, law="adaptive-jacobian"),
        lambda robot: pa.make_controller(robot, law="slotine-li"),
        lambda robot: pa.make_controller(robot, payload=pa.Payload(1.0)),
    ],
)
def test_what_needs_one_frame_is_refused(use):
    with pytest.raises(InputError):
        use(two_arms())


def tiago(**options):
    return pa.load("tiago_dual", frames=TIAGO, **options)


@pytest.mark.parametrize("make", [two_arms, lambda: tiago(task="pose")])
def test_kinematics_have_exact_rates_and_are_those_of_the_frames(make):
    robot = make()
    rng = np.random.default_rng(1)
    kinematics = FrameKinematics(robot, ["tool"])
    check_kinematics(kinematics)
    q = pin.integrate(robot.model, robot.q0, 0.2 * rng.standard_normal(robot.model.nv))
    a_k = kinematics.initial + 0.05 * rng.standard_normal(kinematics.size)
    true = robot.model.copy()
    kinematics.write(true, a_k)
    assert np.allclose(kinematics.read(true, a_k), a_k)
    kinematics.update(a_k, q, np.zeros(robot.model.nv))
    x, _ = robot.task.motion(true, true.createData(), -1, q, np.zeros(robot.model.nv))
    assert np.allclose(robot.task.error(kinematics.x_hat, x), 0.0, atol=1e-12)
    half = kinematics.positions // 2
    assert not kinematics.X_k[:half, kinematics.size // 2 :].any()


@pytest.mark.parametrize("law", ["separation", "adaptive-inverse-dynamics"])
def test_lyapunov_equality_of_two_arms(law):
    robot = two_arms()
    true = with_tools_and_loads(robot)
    controller = pa.make_controller(robot, law=law, limits=pa.Limits(guards=False))
    path = circles(true).shifted(np.tile([0.01, -0.01, 0.02], 2))
    energy = energy_along(true, controller, path, seconds=0.008, dt=2e-4)
    assert energy.mismatch() <= 1e-5
    assert energy.largest_rise() < 0.0


def test_lyapunov_equality_of_two_arms_under_a_constraint():
    robot = two_arms(loops=[TURNED])
    assert len(robot.constrained.at(robot.q0, np.zeros(9))[0]) == 1
    true = robot.changed(payload={ENDS[0]: pa.Payload(0.8, [0.02, 0.0, 0.05])})
    controller = pa.make_controller(robot, limits=pa.Limits(guards=False))
    energy = energy_along(true, controller, circles(true), seconds=0.008, dt=2e-4)
    assert energy.mismatch(after=5) <= 1e-5


def test_the_second_frame_yields_to_the_first():
    """The right hand is asked beyond its reach, where both would have the torso turn."""
    errors = {}
    ways = {"left_hand": np.zeros(3), "right_hand": np.array([0.2, -0.1, 0.0])}
    for ends in (ENDS, ENDS[::-1]):
        robot = two_arms(frames=ends)
        own = [pa.trajectories.Waypoints([np.zeros(3), ways[end]], 1.0) for end in ends]
        path = pa.trajectories.Stacked(own).starting_at(robot.position(robot.q0))
        controller = pa.make_controller(robot)
        rollout = pa.simulate(robot, controller, path, duration=1.0)
        assert pa.within_limits(path, robot).law.slowness
        last = np.linalg.norm(rollout.error[-1].reshape(2, 3), axis=1)
        errors |= {(ends[0], end): error for end, error in zip(ends, last, strict=True)}
    assert errors["left_hand", "right_hand"] > 0.03 < errors["right_hand", "right_hand"]
    assert errors["left_hand", "left_hand"] < 5e-6  # 3.7 mm where both count alike
    assert errors["right_hand", "left_hand"] > 2e-3


@pytest.mark.slow
@UNPHYSICAL
def test_lyapunov_equality_of_two_poses():
    robot = tiago(task="pose")
    true = with_tools_and_loads(robot)
    controller = pa.make_controller(robot, limits=pa.Limits(guards=False))
    aside = np.concatenate([np.tile([0.01, -0.01, 0.02], 2), np.tile([0.05, 0.02, -0.03], 2)])
    path = circles(true, 0.03, 3.0).shifted(aside)
    energy = energy_along(true, controller, path, seconds=0.008, dt=2e-4)
    assert energy.mismatch() <= 1e-5
    assert np.abs(energy.delta).max() > 1e-3  # both rotations drift
    assert energy.largest_rise() < 0.0


@pytest.fixture(scope="module")
def followed():
    """A closed loop of two arms with unknown tools and loads, friction and late frames."""
    robot = two_arms()
    friction = {"viscous": 0.5, "coulomb": 0.3}
    true = with_tools_and_loads(robot).changed(**friction)
    camera = pa.Sensors(camera=Camera(rate=60.0, delay=0.04))
    controller = pa.make_controller(robot, sensors=camera, dt=4e-3)
    path = circles(true, 0.08, 2.0).from_rest()
    return true, controller, pa.simulate(true, controller, path, duration=3.0)


def test_tools_and_loads_are_learned(followed):
    true, controller, rollout = followed
    assert rollout.window(False).max() < 2e-4
    assert rollout.distance == pytest.approx(np.linalg.norm(rollout.error, axis=1))
    a_k = controller.kinematics.value(true)
    assert np.abs(rollout.a_k[-1] - a_k).max() < 1e-3 < np.abs(rollout.a_k[0] - a_k).max()
    learned = rollout.learned()
    q = true.q0
    assert np.abs(learned.position(q) - true.position(q)).max() < 1e-3
    g = [
        pin.computeGeneralizedGravity(one.model, one.model.createData(), q)
        for one in (true, learned, controller.kinematics.robot)
    ]
    assert np.abs(g[1] - g[0]).max() < 0.1 * np.abs(g[2] - g[0]).max()


def test_a_rollout_is_saved_with_its_task(followed, tmp_path):
    _, controller, rollout = followed
    rollout.save(tmp_path)
    loaded = pa.Rollout.load(tmp_path)
    assert loaded.task == rollout.task and loaded.summary() == rollout.summary()
    assert all(np.array_equal(getattr(loaded, name), getattr(rollout, name)) for name in ARRAYS)
    described = controller.kinematics.robot
    for use in (
        rollout.payload,
        lambda: pa.identify(tmp_path, described),
        lambda: calibrate(tmp_path, described),
    ):
        with pytest.raises(RobotError, match="one task frame"):
            use()
    base = pa.models.base_parameters(controller.kinematics, described)
    assert rollout.excitation().kinematic.rank == base.size == 6
    drawn = stream(rollout.animate())
    assert all(name in drawn for name in (b"tip 2", b"desired 2", b"true 2", b"desired point 2"))


def test_announced_tools_and_loads_are_those_of_their_frames():
    robot = two_arms()
    controller = pa.make_controller(robot)
    state = controller.init(pa.plants.PinocchioPlant(robot).measure())
    load = {ENDS[1]: pa.Payload(0.7, [0.0, 0.02, 0.05])}
    tool = {ENDS[1]: [0.01, 0.02, 0.03]}
    after = controller.announce(state, payload=load, tool_translation=tool)
    true = robot.changed(payload=load, tool_translation=tool)
    assert np.allclose(after.a_k, controller.kinematics.value(true))
    bodies = controller.dynamics.inertial.size
    assert np.allclose(after.a_d[:bodies], controller.dynamics.value(true)[:bodies])
    assert np.array_equal(after.a_k[:3], state.a_k[:3])
    with pytest.raises(InputError):
        controller.announce(state, payload=pa.Payload(0.7))
    with pytest.raises(InputError):
        controller.announce(state, tool_translation=[0.01, 0.02, 0.03])


def test_unknown_payload_is_that_of_every_frame():
    controller = pa.make_controller(two_arms(), unknown="payload")
    assert controller.dynamics.bodies == [4, 8] and controller.kinematics.size == 0


def test_mujoco_has_the_frames_of_pinocchio():
    pytest.importorskip("mujoco")
    true = with_tools_and_loads(two_arms())
    plants = pa.plants.MujocoPlant(true), pa.plants.PinocchioPlant(true)
    tau = np.linspace(-3.0, 3.0, 9)
    for plant in plants:
        for _ in range(20):
            plant.step(tau, 1e-3)
    ours, theirs = (plant.measure() for plant in plants)
    assert np.allclose(ours.x, theirs.x, atol=1e-6) and np.allclose(ours.xd, theirs.xd, atol=1e-4)
    assert np.abs(theirs.xd).max() > 0.05


def test_learned_files_have_all_tools(tmp_path):
    true = with_tools_and_loads(two_arms())
    for name in ("arms.urdf", "arms.xml"):
        true.save(tmp_path / name)
        again = pa.load(tmp_path / name, frames=ENDS, q0=true.home_angles)
        assert np.allclose(again.position(again.q0), true.position(true.q0), atol=1e-8)
        M = [pin.crba(one.model, one.model.createData(), one.q0) for one in (again, true)]
        assert np.allclose(*M, atol=1e-8)


def test_stacked_motions_have_their_places_and_one_kind():
    circle = pa.trajectories.Circle(np.zeros(3), 0.1, 2.0, "yz")
    pose = pa.trajectories.PoseTrajectory(circle, pa.trajectories.Swing((0.0, 1.0, 0.0), 0.3, 2.0))
    task = tiago(task="pose").task
    upright = np.array([0.0, 0.0, 0.0, 1.0])
    start = np.concatenate([np.arange(6.0), turned(upright, np.ones(3)), upright])
    motion = pa.trajectories.Stacked([pose, pose]).from_rest(1.0).starting_at(start)
    assert np.allclose(task.error(motion.at(0.0).x_d, start), 0.0, atol=1e-12)
    assert motion.extent == pytest.approx(0.1 * np.sqrt(2.0))
    for wrong in ([circle], [circle, pose]):
        with pytest.raises(InputError, match="motions"):
            pa.trajectories.Stacked(wrong)
    t = np.linspace(0.0, 1.0, 20)
    with pytest.raises(InputError):  # a spline of two quaternions is none
        pa.trajectories.as_trajectory((t, np.tile(start, (20, 1))), task)


def test_a_scenario_of_two_frames_is_written_and_runs(tmp_path, capsys):
    source = tmp_path / "arms.urdf"
    file = tmp_path / "arms.toml"
    two_arms().save(source)
    frames = ["--frame", ",".join(ENDS)]
    assert main(["init", str(source), *frames, "--out", str(file)]) == 0
    text = file.read_text(encoding="utf-8")
    assert f'frames = ["{ENDS[0]}", "{ENDS[1]}"]' in text and 'kind = "stacked"' in text
    again = ["--frame", ENDS[0], "--frame", ENDS[1], "--force"]
    assert main(["init", str(source), *again, "--out", str(file)]) == 0
    assert file.read_text(encoding="utf-8") == text
    scenario = pa.Scenario.read(file, ["simulation.duration=1.0", "controller.dt=0.004"])
    rollout = scenario.run()
    assert rollout.window(False).max() < 0.2 * rollout.window(True).max()
    assert scenario.true.mass > scenario.estimated.mass
    assert main(["init", str(source), *frames, "--tracker", "--out", str(tmp_path / "b.toml")]) != 0
    assert "one task frame" in capsys.readouterr().err
