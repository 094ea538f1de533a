"""The picture of the frame in uncalibrated cameras."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given

import pinadapt as pa
from pinadapt.information.tracker import find_camera
from pinadapt.models.camera_kinematics import CameraKinematics
from pinadapt.plants.sensors import SimulatedSensors
from pinadapt.simulation.simulate import after_excitation
from tests.support.chains import catalogue_robot, chains, random_state, seeded
from tests.support.differences import derivative
from tests.support.identities import check_motion, moving
from tests.support.loops import energy_along, with_tool_and_load
from tests.support.recorded import frames_of_small_motions


def camera_at(robot, direction):
    """Return a camera (3, 4) that looks at the frame at home from three reaches away.

    A pixel counts as what it covers at the frame.
    """
    back = np.array(direction) / np.linalg.norm(direction)
    right = np.cross([0.0, 0.0, 1.0] if abs(back[2]) < 0.9 else [1.0, 0.0, 0.0], back)
    right /= np.linalg.norm(right)
    R = pin.exp3(np.array([0.0, 0.0, 0.4])) @ np.array([right, np.cross(back, right), -back])
    distance = 3.0 * robot.reach
    t = -R @ (robot.placement(robot.q0).translation + distance * back)
    K = np.diag([distance, distance, 1.0])
    K[:2, 2] = 0.2, -0.3  # the middle of the picture is not its origin
    return K @ np.column_stack([R, t])


def filmed(robot, count=1):
    """Return a robot with a tool, a load and cameras, and the same without all of that."""
    cameras = [camera_at(robot, way) for way in ([1.0, -0.6, 0.5], [0.2, 1.0, 0.4])][:count]
    true = with_tool_and_load(robot).filmed_by(*cameras)
    return true, robot.filmed_by(*turned(count))


def turned(count):
    """Return cameras that look along different axes from far away."""
    E = np.eye(4)
    return [E[[0, 1, 3]], E[[2, 1, 3]]][:count]


def check(robot, unknown, count=1):
    """Every quantity against finite differences, at an estimate with a depth that changes."""
    rng = np.random.default_rng(5)
    believed = robot.filmed_by(*turned(count))
    kinematics = CameraKinematics(believed, unknown)
    q, v, a = random_state(robot, rng)
    a_k = kinematics.initial + 0.1 * kinematics.sizes * rng.standard_normal(kinematics.size)
    a_k_rate = kinematics.sizes * rng.standard_normal(kinematics.size)

    state = q, v, a
    at = moving(kinematics, state, a_k, a_k_rate)
    learned = derivative(lambda t: at(t, 1.0).p_hat) - derivative(lambda t: at(t).p_hat)
    size = check_motion(kinematics, state, a_k, a_k_rate, accuracy=1e-7)
    assert np.allclose(kinematics.Y_k @ a_k, kinematics.xd_hat, atol=1e-12 * size)
    assert np.allclose(kinematics.X_k @ a_k_rate, learned, atol=1e-7 * size)


@pytest.mark.parametrize("name", ["planar_2r", "scara", "panda"])
def test_identities_on_robots(name):
    check(catalogue_robot(name), ["tool"])


@given(robot=chains)
@seeded
def test_identities_on_random_chains(robot):
    check(robot, ["tool"])


@pytest.mark.parametrize(("name", "count"), [("panda", 1), ("ur5", 2), ("planar_2r", 1)])
def test_the_error_of_a_picture_is_linear_however_wrong_the_estimate_is(name, count):
    robot = catalogue_robot(name)
    rng = np.random.default_rng(3)
    true, believed = filmed(robot, count)
    kinematics = CameraKinematics(believed, ["tool"])
    truth = kinematics.value(true)
    for _ in range(5):
        q, v, _ = random_state(robot, rng)
        q = pin.interpolate(robot.model, robot.q0, q, 0.2)
        wrong = truth + 0.5 * kinematics.sizes * rng.standard_normal(kinematics.size)
        y = true.position(q)
        kinematics.update(truth, q, v)
        assert kinematics.p_hat == pytest.approx(y, abs=1e-9)
        kinematics.update(wrong, q, v)
        X = kinematics.explaining(y)
        assert X @ (wrong - truth) == pytest.approx(kinematics.p_hat - y, abs=1e-9)
        assert kinematics.at(q, y)[1] == pytest.approx(X, abs=1e-12)


def test_velocity_of_a_picture_by_differences():
    robot = catalogue_robot("ur5")
    rng = np.random.default_rng(3)
    true, _ = filmed(robot, 2)
    q, v, _ = random_state(robot, rng)
    q = pin.interpolate(robot.model, robot.q0, q, 0.3)
    plant = pa.plants.PinocchioPlant(true)
    xd = derivative(lambda t: true.position(pin.integrate(robot.model, q, t * v)))
    assert plant.measurement(q, v).xd == pytest.approx(xd, abs=1e-7)


def circle_of(true):
    """Return a circle of the picture that starts where the robot is."""
    y_0 = true.position(true.q0)

    def path(t):
        phi = np.pi * t
        y = y_0.copy()
        y[:2] += 0.05 * true.reach * np.array([1.0 - np.cos(phi), np.sin(phi)])
        return y

    return pa.trajectories.as_trajectory(path, true.task)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "count"), [("planar_2r", 1), ("panda", 2)])
def test_lyapunov_equality_with_an_unknown_camera(name, count):
    robot = catalogue_robot(name)
    true, believed = filmed(robot, count)
    controller = pa.make_controller(
        believed.changed(inertial_scale=0.7),
        unknown=pa.Unknown(friction=False, armature=False),
        adaptation="natural",
        limits=pa.Limits(box=False),
        gamma_d=5.0,
        R_k=5.0,
    )
    start = controller.kinematics.value(true)
    rng = np.random.default_rng(0)
    start = start + 0.05 * controller.kinematics.sizes * rng.standard_normal(start.size)
    energy = energy_along(
        true, controller, circle_of(true).as_given(), seconds=0.008, dt=2e-4, a_k=start
    )
    energy.check()


def test_the_camera_is_found_from_frames():
    robot = catalogue_robot("panda")
    true, believed = filmed(robot)
    kinematics = CameraKinematics(believed, ["tool"])
    samples = frames_of_small_motions(robot, true, 0.04)
    found = find_camera(kinematics, samples)
    kinematics.update(found.estimate, samples[20].q, samples[20].v)
    J_hat = kinematics.J
    kinematics.update(kinematics.value(true), samples[20].q, samples[20].v)
    assert J_hat == pytest.approx(kinematics.J, abs=2e-3 * np.abs(kinematics.J).max())
    for unseen in ([s._replace(x=samples[0].x) for s in samples], []):
        with pytest.raises(pa.LogError, match="do not show the camera"):
            find_camera(kinematics, unseen)
    with pytest.raises(pa.LogError, match="In pixels"):
        find_camera(kinematics, [s._replace(x=500.0 * s.x) for s in samples])
    for late, words in (
        (3, "no camera or tracker explains"),
        (1, r"another clock.* about (2|3|4)\d ms"),
    ):
        shifted = [s._replace(x=o.x) for s, o in zip(samples[late:], samples, strict=False)]
        with pytest.raises(pa.LogError, match=words):
            find_camera(kinematics, shifted)


def pixels_of(model, data, site):
    """Return what MuJoCo's own camera 0 sees of a site: pixels of a picture of 1000 rows."""
    R = data.cam_xmat[0].reshape(3, 3)
    seen = data.site_xpos[site] - data.cam_xpos[0]
    right, up, back = seen @ R
    focal = 500.0 / np.tan(np.radians(model.cam_fovy[0]) / 2.0)
    return focal * np.array([right, -up]) / -back


class Blinking(SimulatedSensors):
    """Sensors whose camera sees nothing for 0.3 s."""

    def measure(self, truth, torque=None):
        seen = super().measure(truth, torque)
        blind = 0.5 < truth.t < 0.8
        return seen._replace(x=None, x_time=None, xd=None) if blind else seen


@pytest.mark.slow
def test_pixels_of_mujocos_own_camera(tmp_path):
    """30 pictures a second, 60 ms late, half a pixel of noise, and for a while nothing at all."""
    mujoco = pytest.importorskip("mujoco")
    robot = catalogue_robot("ur5")
    true, believed = filmed(robot)
    x, y, z = robot.placement(robot.q0).translation + robot.reach * np.array([0.0, -2.0, 0.3])
    eye = f'<camera name="eye" pos="{x} {y} {z}" xyaxes="1 0.1 0 0 0.1 1" fovy="40"/>'
    path = tmp_path / "arm.xml"
    path.write_text(true.mjcf().replace("<worldbody>", f"<worldbody>{eye}", 1))
    pixel = 2.0 * robot.reach * np.tan(np.radians(20.0)) / 500.0  # m that one covers at the arm

    class Filmed(pa.plants.MujocoPlant):
        """MuJoCo's arm in MuJoCo's picture; our projection is not asked."""

        def measure(self):
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_camlight(self.model, self.data)
            seen = pixels_of(self.model, self.data, self._chain.site)
            return super().measure()._replace(x=pixel * seen, xd=None)

    plant = Filmed(true, mjcf=pa.plants.MujocoFile(path))
    sensors = pa.Sensors(camera=pa.Camera(rate=30.0, delay=0.06), noise={"x": 0.5 * pixel})
    controller = pa.make_controller(believed, adaptation="natural", sensors=sensors, dt=4e-3)
    a_k = after_excitation(plant, controller, 4e-3, SimulatedSensors(true, 4e-3, sensors))["a_k"]
    y_0 = plant.measure().x
    radius = 0.06 * robot.reach

    def circle(t):
        phi = np.pi * t
        return y_0 + radius * np.array([1.0 - np.cos(phi), np.sin(phi)])

    motion = pa.reference.starting_from(circle, believed, plant.measure())
    state = controller.init(plant.measure(), a_k=a_k)
    seen = Blinking(true, 4e-3, sensors)
    run = pa.simulation.run(
        plant, controller, motion, dt=4e-3, state=state, sensors=seen, duration=3.0
    )
    off = [np.linalg.norm(s.truth.x - s.desired.x_d) / pixel for s in run]
    assert 2.0 * radius / pixel > 30.0
    assert max(off) < 3.0 and max(off[-150:]) < 1.0
