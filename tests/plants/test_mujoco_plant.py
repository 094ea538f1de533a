"""The MuJoCo plant moves the same robot as the Pinocchio plant."""

import pickle
import sys
from functools import partial

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.description.chain import effort_limits, position_limits
from pinadapt.scenario.scenario import Scenario
from tests.support.chains import catalogue_robot as load
from tests.support.loops import circle_at_home, with_tool_and_load
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow

mujoco = pytest.importorskip("mujoco")  # pip install -e '.[dev]' brings it

SCENARIOS = ROOT / "robots"
# Revolute joints, prismatic and continuous ones about z and x, rotor inertias, inclined axes and an
# inertia that no body has, bodies without mass: MuJoCo's compiler would refuse the last two.
ROBOTS = ("panda", "scara", "pr2_left_arm", "talos_arm", "icub_left_arm", "planar_2r", "massless")


def robot_named(name):
    """Return a robot of the catalogue, or a UR5 two of whose bodies have no mass."""
    if name != "massless":
        return load(name)
    model = load("ur5").model.copy()
    for joint in (2, 5):
        model.inertias[joint] = pin.Inertia.Zero()
    return pa.load(model, frame="tool0", q0=load("ur5").home_angles)


def drive(plant, torque, seconds, dt=1e-3):
    """Apply a torque, a function of time, to a plant; return the last ideal measurement."""
    for _ in range(round(seconds / dt)):
        plant.step(torque(plant.measure().t), dt)
    return plant.measure()


def check_alike(one, other, atol):
    """Check that two measurements agree."""
    for name in ("t", "q", "v", "x", "xd"):
        assert np.allclose(getattr(one, name), getattr(other, name), rtol=0.0, atol=atol), name


# --- the same robot in both engines ---


@pytest.mark.parametrize("name", ROBOTS)
def test_torques_inertia_and_jacobian_are_those_of_pinocchio(name):
    rng, robot = np.random.default_rng(0), robot_named(name)
    robot = robot.changed(
        armature=robot.model.armature + rng.uniform(0.0, 0.1, robot.model.nv),
        viscous=rng.uniform(0.1, 1.0, robot.model.nv),
    )
    plant, model, data = pa.plants.MujocoPlant(robot), robot.model, robot.model.createData()
    own, theirs = plant.model, mujoco.MjData(plant.model)
    own.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    assert own.nv == model.nv
    for _ in range(5):
        angles = rng.uniform(-2.0, 2.0, model.nv)
        q, (v, a) = pin.integrate(model, pin.neutral(model), angles), rng.normal(size=(2, model.nv))

        def inverse(a, at=angles, v=v):
            theirs.qpos[:], theirs.qvel[:], theirs.qacc[:] = at, v, a
            mujoco.mj_inverse(own, theirs)
            return theirs.qfrc_inverse.copy()

        torque = pin.rnea(model, data, q, v, a) + robot.friction.torque(v)
        scale = np.abs(torque).max()
        assert np.allclose(inverse(a), torque, rtol=0.0, atol=1e-12 * scale)
        M = np.array([inverse(e) - inverse(0.0 * e) for e in np.eye(model.nv)])
        assert np.allclose(M, pin.crba(model, data, q), rtol=0.0, atol=1e-12 * scale)
        J = np.empty((6, model.nv))
        mujoco.mj_jacSite(own, theirs, J[:3], J[3:], 0)
        where = pin.LOCAL_WORLD_ALIGNED
        pin.computeJointJacobians(model, data, q)
        ours = pin.getFrameJacobian(model, data, robot.frame_id, where)
        assert np.allclose(J, ours, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_free_motion_is_that_of_pinocchio_to_integration_error(name):
    """Both engines use the classical Runge-Kutta method; robots fall alike to rounding."""
    robot = robot_named(name)
    robot = robot.changed(viscous=0.05, armature=robot.model.armature + 0.01)
    plants = pa.plants.MujocoPlant(robot), pa.plants.PinocchioPlant(robot, integrator="runge-kutta")
    ends, push = [], 10.0 * np.diag(plants[1].mass_matrix(robot.q0))
    for plant in plants:
        ends.append(drive(plant, lambda t: push * np.cos(10.0 * t), 0.15))
    assert np.abs(ends[0].v).max() > 0.1
    check_alike(*ends, atol=1e-9)


@pytest.mark.parametrize("integrator", ["implicitfast", "implicit", "euler"])
def test_other_integrators_agree_to_first_order(integrator):
    robot, errors = load("ur5").changed(viscous=0.5), []
    best = drive(
        pa.plants.PinocchioPlant(robot, integrator="runge-kutta"), lambda t: np.zeros(6), 0.1
    )
    for substeps in (1, 2, 4):
        plant = pa.plants.MujocoPlant(robot, integrator=integrator, substeps=substeps)
        end = drive(plant, lambda t: np.zeros(6), 0.1)
        errors.append(np.linalg.norm(end.v - best.v))
    assert errors[0] > 1.9 * errors[1] > 3.6 * errors[2]


def test_stiff_friction_of_a_light_joint_needs_more_steps():
    robot = load("z1").changed(viscous=5.0)
    plant = pa.plants.MujocoPlant(robot)
    assert plant.steps_in(1e-3) > 2
    still = pa.plants.PinocchioPlant(robot, integrator="runge-kutta", substeps=32)
    check_alike(*(drive(p, lambda t: np.ones(6), 0.05) for p in (plant, still)), atol=1e-4)
    assert pa.plants.MujocoPlant(robot, integrator="implicitfast").steps_in(1e-3) == 1
    assert pa.plants.MujocoPlant(load("z1")).steps_in(5e-3) == 5


def test_a_changed_robot_continues_from_its_state_and_reset_restores_the_first():
    first = load("panda")
    second = first.changed(
        payload=pa.Payload(2.0, [0.0, 0.02, 0.05]), tool_translation=[0.03, 0.0, 0.1], armature=0.2,
        viscous=1.0, link_translation={"panda_joint4": [0.0, 0.0, 0.02]},
    )  # fmt: skip
    ends = []
    for plant in (
        pa.plants.MujocoPlant(first),
        pa.plants.PinocchioPlant(first, integrator="runge-kutta"),
    ):
        drive(plant, lambda t: np.zeros(7), 0.05)
        before = plant.measure()
        plant.become(second)
        after = plant.measure()
        assert after.t == before.t and np.array_equal(after.q, before.q)
        assert np.array_equal(after.v, before.v) and not np.allclose(after.x, before.x)
        ends.append(drive(plant, lambda t: np.zeros(7), 0.05))
    check_alike(*ends, atol=1e-9)
    plant = pa.plants.MujocoPlant(first)
    fresh = drive(plant, lambda t: np.ones(7), 0.02)
    plant.become(second)
    plant.reset()
    assert plant.robot is first
    check_alike(drive(plant, lambda t: np.ones(7), 0.02), fresh, atol=1e-15)
    with pytest.raises(pa.RobotError, match="cannot change"):
        plant.become(load("ur5"))


def test_a_pickled_plant_moves_alike():
    plant = pa.plants.MujocoPlant(load("panda").changed(coulomb=0.5))
    drive(plant, lambda t: np.ones(7), 0.01)
    copy = pickle.loads(pickle.dumps(plant))
    check_alike(*(drive(p, lambda t: -np.ones(7), 0.01) for p in (plant, copy)), atol=0.0)


def mesh_of(model, geom):
    """Return the vertices (N, 3) of the mesh of a geom, or None."""
    mesh = model.geom_dataid[geom]
    if mesh < 0:
        return None
    first = model.mesh_vertadr[mesh]
    return np.array(model.mesh_vert[first : first + model.mesh_vertnum[mesh]], dtype=float)


@pytest.mark.parametrize("name", ["ur5", "scara"])
def test_a_drawn_robot_has_its_meshes_and_moves_like_an_undrawn_one(name):
    robot = load(name)
    plant, model, data = (
        pa.plants.MujocoPlant(robot, drawn=True),
        robot.model,
        robot.model.createData(),
    )
    assert plant.model.ngeom == robot.visual.ngeoms > 4
    assert (plant.model.nmesh > 0) == (name == "ur5")
    shown = robot.visual.createData()
    pin.updateGeometryPlacements(model, data, robot.visual, shown, robot.q0)
    for shape, placement in zip(robot.visual.geometryObjects, shown.oMg, strict=True):
        geom, ours = plant.data.geom(str(shape.name)), np.zeros((1, 3))
        theirs = mesh_of(plant.model, geom.id)
        if theirs is None:
            theirs = ours
        else:
            ours = np.array(shape.geometry.vertices())
        ours = ours @ placement.rotation.T + placement.translation
        theirs = theirs @ geom.xmat.reshape(3, 3).T + geom.xpos
        for end in (np.min, np.max):
            assert np.allclose(end(theirs, axis=0), end(ours, axis=0), atol=1e-6), shape.name
    ends = [
        drive(p, lambda t: np.ones(robot.model.nv), 0.02)
        for p in (plant, pa.plants.MujocoPlant(robot))
    ]
    check_alike(*ends, atol=1e-12)


# --- friction, stops and motors ---


@pytest.mark.parametrize("armature", [0.0, 1.0])
def test_a_joint_held_by_coulomb_friction_creeps_at_the_expected_velocity(armature):
    """Whatever its inertia: f v / threshold below the full friction f."""
    robot = load("panda", gravity=(0.0, 0.0, 0.0)).changed(coulomb=2.0, armature=armature)
    end = drive(pa.plants.MujocoPlant(robot), lambda t: np.full(7, 0.8), 1.0)
    assert np.allclose(end.v, 0.4 * robot.friction.threshold, rtol=0.02)


def test_coulomb_friction_of_a_moving_joint_is_that_of_pinocchio():
    robot = load("panda").changed(coulomb=0.5, viscous=0.5)
    weight = pa.robot.Gravity(robot)(robot.q0)
    ends = [
        drive(plant, lambda t: weight + 8.0, 0.1)
        for plant in (pa.plants.MujocoPlant(robot), pa.plants.PinocchioPlant(robot))
    ]
    assert (ends[0].v > 5 * robot.friction.threshold).all()
    assert np.allclose(ends[0].v, ends[1].v, rtol=1e-2)


def test_stops_hold_joints_at_full_torque():
    robot = load("panda").changed(viscous=5.0)
    lower, upper = position_limits(robot.model)
    for sign in (-1.0, 1.0):
        plant, beyond = pa.plants.MujocoPlant(robot), []
        for _ in range(2000):
            plant.step(sign * effort_limits(robot.model), 1e-3)
            q = plant.measure().q
            beyond.append(np.maximum(lower - q, q - upper))
        beyond = np.array(beyond)
        assert (beyond[-1] > -1e-3).sum() >= 4  # these joints lie at their stops
        assert np.abs(plant.measure().v[beyond[-1] > -1e-3]).max() < 1e-2
        assert beyond[-1].max() < 1e-3 and beyond.max() < 0.03  # after the impact, and in it


def test_continuous_joints_have_no_stops():
    plant = pa.plants.MujocoPlant(load("scara"))
    assert plant.model.jnt_limited.tolist()[3] == 0
    end = drive(plant, lambda t: np.array([0.0, 0.0, 0.0, 0.05]), 0.5)
    assert end.q.shape == (5,) and np.isclose(np.hypot(*end.q[3:]), 1.0)


def test_motors_add_the_compensation_and_limit_the_sum():
    robot = load("panda")
    plant = pa.plants.MujocoPlant(
        robot, compensation=pa.robot.Gravity(robot), torque_limits=effort_limits(robot.model)
    )
    assert np.array_equal(plant.motors(np.zeros(7)), pa.robot.Gravity(robot)(robot.q0))
    assert np.array_equal(plant.motors(np.full(7, 1e3)), effort_limits(robot.model))
    assert np.abs(drive(plant, lambda t: np.zeros(7), 0.1).v).max() < 1e-9


# --- closed loops ---


@pytest.mark.parametrize(
    "sensors",
    [
        {"sensors": pa.Sensors(encoder=1e-4)},
        {"sensors": pa.Sensors(camera=pa.Camera(rate=50, delay=0.02))},
    ],
)
def test_camera_and_encoders_work_with_mujoco(sensors):
    robot = load("ur5")
    true = with_tool_and_load(robot)
    path = circle_at_home(robot).starting_at(true.position(true.q0))
    simulate = partial(
        pa.simulate, true, duration=0.2, engine=pa.Engine(torque_limits=True), **sensors
    )
    run = [
        simulate(
            pa.make_controller(robot, adaptation="natural", **sensors),
            path,
            engine=pa.Engine(engine, substeps=substeps),
        )
        for engine, substeps in (("pinocchio", None), ("mujoco", None), (pa.plants.MujocoPlant, 2))
    ]
    for other in run[1:]:
        assert np.allclose(run[0].x, other.x, rtol=0.0, atol=2e-5)
    assert not np.array_equal(run[1].x, run[2].x)


def test_a_joint_task_runs_with_a_lyapunov_function():
    robot = pa.load("kinova", task="joint")
    controller = pa.make_controller(robot, law="slotine-li", adaptation="natural")
    true = robot.changed(payload=pa.Payload(1.0))
    path = pa.trajectories.Sinusoid(robot.home_angles + 0.1, 0.1, 2.0)
    ours, theirs = (
        pa.simulate(true, controller, path, duration=0.3, engine=e) for e in ("pinocchio", "mujoco")
    )
    assert np.allclose(ours.x, theirs.x, rtol=0.0, atol=1e-6)
    assert np.allclose(ours.lyapunov, theirs.lyapunov, rtol=1e-3)


# --- what is refused ---


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"engine": "mujco"}, "Did you mean 'mujoco'"),
        ({"engine": 3}, "pinocchio"),
        ({"engine": pa.Engine("mujoco", continuous=True)}, "MujocoPlant moves in samples"),
        (
            {"engine": pa.Engine("mujoco", ideal_acceleration=True)},
            "does not provide the acceleration",
        ),
        ({"engine": partial(pa.plants.MujocoPlant, integrator="rk4")}, "runge-kutta"),
        ({"engine": pa.Engine("mujoco", substeps=0)}, "at least 1"),
    ],
)
def test_options_that_mujoco_lacks_are_refused(options, words):
    robot = load("ur5")
    controller = pa.make_controller(robot, law="adaptive-inverse-dynamics")
    with pytest.raises(pa.InputError, match=words):
        pa.simulate(robot, controller, circle_at_home(robot), duration=0.1, **options)


def test_without_mujoco_an_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(pa.InputError, match=r'pip install "pinadapt\[mujoco\]"'):
        pa.plants.MujocoPlant(load("ur5"))
    with pytest.raises(pa.InputError, match=r"simulation\.engine: MuJoCo is not installed"):
        Scenario.read(SCENARIOS / "ur5" / "unknown_lengths.toml", ["simulation.engine=mujoco"])
