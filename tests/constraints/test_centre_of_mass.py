"""The centre of mass of robots that stand: its Jacobian, V, loads found, and what x is."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from benchmarks.standing import Sway
from pinadapt.models import ComKinematics
from pinadapt.plants import PinocchioPlant, SimulatedSensors
from pinadapt.trajectories import Circle, Crawl
from pinadapt.trajectories.pose import PoseTrajectory, Swing
from tests.constraints.test_standing import FEET, TRUNK, standing
from tests.support.identities import check_motion
from tests.support.loops import energy_along

LOADS = {"a1": 5.0, "talos": 10.0}  # [kg]


def loaded(robot):
    """Return the robot with a load on its trunk, beside and above its frame."""
    high = robot.q0[2]
    return robot.changed(
        payload=pa.Payload(LOADS[robot.name], [0.2 * high, 0.08 * high, 0.32 * high])
    )


@pytest.mark.parametrize("name", LOADS)
def test_jacobian_and_rates_are_those_of_pinocchio_and_of_differences(name):
    robot = standing(name, task="com")
    kinematics = ComKinematics(robot)
    rng = np.random.default_rng(0)
    none = np.zeros(0)
    q, (v, a) = robot.q0.copy(), rng.standard_normal((2, robot.model.nv))
    q += 0.3 * rng.standard_normal(q.size)
    check_motion(kinematics, (q, v, a), none, none, accuracy=5e-11)
    data = robot.model.createData()
    assert np.allclose(kinematics.J[:3], pin.jacobianCenterOfMass(robot.model, data, q), atol=1e-14)
    found = robot.task.motion(robot.model, data, robot.frame_id, q, v)
    assert np.allclose(found[0], kinematics.x_hat)
    assert np.allclose(found[1], kinematics.xd_hat, atol=1e-8)
    assert np.allclose(found[0][3:], robot.task.measured(None, q)[3:])
    assert kinematics.task.levels.tolist() == [0.0] * 3 + [1.0] * 3


def test_a_load_does_not_move_x_which_nobody_measures():
    robot = standing("a1", task="com")
    true = loaded(robot)
    q = robot.q0 + 0.1
    centre = pin.centerOfMass(robot.model, robot.model.createData(), q)
    assert np.allclose(robot.position(q)[:3], centre, atol=1e-15)
    assert np.array_equal(true.position(q), robot.position(q))
    sensors = SimulatedSensors(true, 1e-3, pa.Sensors(noise={"x": 0.1}))
    seen = sensors.measure(PinocchioPlant(true).measure())
    assert seen.x is None
    controller = pa.make_controller(robot, unknown=TRUNK)
    desired = Sway(robot).at(0.0)
    torque, _ = controller.step(controller.init(seen), seen, desired, 1e-3)
    elsewhere = seen._replace(x=np.ones(7))
    again, _ = controller.step(controller.init(elsewhere), elsewhere, desired, 1e-3)
    assert np.array_equal(torque, again) and torque[6:].any()


@pytest.mark.parametrize("name", ["a1", pytest.param("talos", marks=pytest.mark.slow)])
def test_the_reference_acceleration_is_the_derivative_of_the_reference(name):
    """On which dV/dt as an equality rests; the loop below is too slow to show it."""
    robot = standing(name, task="com")
    h = 1e-5
    controller = pa.make_controller(robot, unknown=TRUNK, limits=pa.Limits(guards=False))
    v = np.random.default_rng(1).uniform(-0.5, 0.5, robot.model.nv)
    path = Sway(robot)

    def sample(by):
        measurement = pa.Measurement(0.0, robot.q0 + by * v, v)
        return controller.init(measurement), measurement, path.at(0.4 + by)

    before, now, after = (
        v - controller.law._reference_error(controller.observe(*sample(by))) for by in (-h, 0.0, h)
    )
    A, _ = robot.constrained.at(robot.q0, v)
    assert np.abs(now).max() > 0.05 and np.abs(A @ now).max() < 1e-9
    _, command = controller.command(*sample(0.0))
    given = robot.q0, v, now, (after - before) / (2.0 * h)
    _, torque = controller.dynamics.slotine_li(*given)
    assert np.allclose(command.feedforward, torque, rtol=0.0, atol=1e-6 * np.abs(torque).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", LOADS)
def test_lyapunov_equality(name):
    robot = standing(name, task="com")
    true = loaded(robot)
    guards = pa.Limits(guards=False)
    controller = pa.make_controller(robot, unknown=TRUNK, limits=guards)
    path = PoseTrajectory(Circle(np.zeros(3), 2e-3, 1.0), Swing((0.0, 1.0, 0.0), 0.02, 1.0))
    path = path.starting_at(true.position(true.q0))
    energy = energy_along(true, controller, path, seconds=2e-3, dt=1e-4)
    assert energy.mismatch(after=5) <= 5e-5  # by what the solver of the forces misses


@pytest.mark.slow
def test_a_crawl_moves_the_centre_of_mass_above_the_feet_that_stand():
    robot = standing("a1", task="com")
    crawl = Crawl(steps=1).on(robot)
    controller = pa.make_controller(robot, unknown=TRUNK, dt=2e-3)
    above = crawl.at(crawl.shift + 0.5 * crawl.swing)
    three = above.feet.x_d[above.feet.stands][:, :2]
    shares = np.linalg.solve(np.vstack([three.T, np.ones(3)]), np.append(above.x_d[:2], 1.0))
    assert shares.min() > 0.05
    true = loaded(robot)
    rollout = pa.simulate(true, controller, crawl, duration=1.4, engine="mujoco")
    assert rollout.diverged is None and rollout.distance.max() < 2e-3
    assert rollout.window(False).max() < 1e-4 and rollout.angle[-65:].max() < 1e-4
    assert rollout.a_d[-1, 0] == pytest.approx(true.model.inertias[6].mass, rel=2e-3)


def test_a_reachable_circle_keeps_it_above_the_feet():
    robot = standing("a1", task="com")
    path = pa.reachable_circle(robot)
    data = robot.model.createData()
    assert np.allclose(path.at(0.0).x_d, robot.position(robot.q0), atol=1e-12)
    pin.framesForwardKinematics(robot.model, data, robot.q0)
    feet = np.array([data.oMf[robot.model.getFrameId(foot)].translation for foot in FEET["a1"]])
    x = path.positions(np.linspace(0.0, path.period, 50))[:, :2]
    assert (x > feet[:, :2].min(axis=0)).all() and (x < feet[:, :2].max(axis=0)).all()
    assert np.ptp(x[:, 0]) > 0.05


@pytest.mark.parametrize(
    ("source", "options", "message"),
    [
        ("panda", {}, "free base"),
        ("a1", {"base": "free", "frames": ["base", "FL_foot"]}, "or the centre of mass"),
    ],
)
def test_what_has_no_such_task_is_refused(source, options, message):
    with pytest.raises(pa.RobotError, match=message):
        pa.load(source, task="com", **options)
    with pytest.raises(pa.ParameterError, match="no effect on a com task"):
        pa.make_controller(standing("a1", task="com"), unknown=pa.Unknown(translations=["tool"]))
