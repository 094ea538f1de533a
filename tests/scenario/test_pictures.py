"""The task "image" in scenario files: numbers in pixels, and cameras that cannot be used."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.plots.figures import draw_errors
from pinadapt.robot.robot import difference
from pinadapt.rollout.rollout import Rollout
from pinadapt.scenario.parts import check_in_picture, trajectory_of, true_robot
from pinadapt.scenario.scenario import Scenario, described_robot
from pinadapt.scenario.schema import check_tables, tables_with
from pinadapt.scenario.template import Template, scenario_text
from pinadapt.sweep.execution import numbers_of
from pinadapt.tasks import pinhole_camera
from tests.support.paths import ARM4

PIXEL, EYE = 0.004, [1.0, 0.3, 4.0]
RAW = {
    "robot": {"source": "planar_2r", "task": "image", "pixel": PIXEL},
    "truth": {"tool_translation": [0.05, 0.02, 0.0], "camera": [{"position": EYE}]},
    "controller": {"adaptation": "natural"},
    "reference": {"radius": 30.0},
    "simulation": {"duration": 0.6, "dt": 0.004, "noise": {"x": 0.5}, "camera": {"rate": 30.0}},
}


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    """Return the scenario of these tables."""
    return Scenario.build(check_tables(RAW, "test"), tmp_path_factory.mktemp("scenario"))


@pytest.fixture(scope="module")
def rollout(scenario):
    """Return a short run of it."""
    return scenario.run(False)


def test_a_camera_looks_at_its_target():
    """By hand: 2 m away along y, right is x, down is -z; a metre there is half a focal length."""
    H = pinhole_camera([0.3, -2.0, 0.5], [0.3, 0.0, 0.5], 800.0, centre=[640.0, 480.0])
    places = {
        (0.3, 0.0, 0.5): (640, 480),
        (1.3, 0.0, 0.5): (1040, 480),
        (0.3, 2.0, 1.5): (640, 280),
    }
    for p, y in places.items():
        *seen, depth = H @ [*p, 1.0]
        assert np.array(seen) / depth == pytest.approx(y)
        assert depth == pytest.approx(p[1] + 2.0)
    down = pinhole_camera([0.0, 0.0, 2.0], [0.0, 0.0, 0.0], 800.0, roll=np.pi / 2)
    *seen, depth = down @ [1.0, 0.0, 0.0, 1.0]
    assert np.array(seen) / depth == pytest.approx([0.0, -400.0])
    with pytest.raises(pa.InputError, match="where it stands"):
        pinhole_camera(EYE, EYE, 800.0)


def test_numbers_of_pictures_are_pixels(scenario, rollout):
    described, true = scenario.estimated, scenario.true
    at, p = (robot.placement(robot.q0).translation for robot in (described, true))
    *seen, depth = pinhole_camera(EYE, at, 1000.0, centre=[640.0, 480.0]) @ [*p, 1.0]
    assert true.position(true.q0) / PIXEL == pytest.approx(np.array(seen) / depth)
    assert scenario.trajectory.extent == pytest.approx(30.0 * PIXEL)
    assert scenario.sensors.deviation("x") == pytest.approx(0.5 * PIXEL)
    assert rollout.distance.max() < 3.0 * PIXEL
    assert "px, " in rollout.verdict and "mm at the tool" in rollout.verdict
    figure, axes = draw_errors(rollout)
    assert axes[0].get_ylabel() == "picture error [px]"
    (picture,) = (ax for ax in figure.axes if ax.get_xlabel() == "u [px]")
    assert picture.yaxis_inverted()
    assert np.allclose(np.transpose(picture.lines[0].get_data()), rollout.x / PIXEL)
    numbers = numbers_of(rollout)
    assert numbers["max_pixels_last"] == pytest.approx(rollout.window(False).max() / PIXEL)


def test_the_error_at_the_tool_is_that_of_its_picture(scenario, rollout):
    """To first order the tool is off by the pseudo-inverse of the picture's Jacobian."""
    last, true, found = rollout.window(False), scenario.true, []
    for q, x, x_d in zip(rollout.q, rollout.x, rollout.x_d, strict=True):
        J = true.task.jacobian(true.placement(q), np.eye(6)[:, :3])
        found.append(np.linalg.norm(np.linalg.pinv(J) @ (x - x_d)))
    assert rollout.beside_picture == pytest.approx(max(found[-len(last) :]), rel=0.02)


def test_a_loaded_run_knows_its_pixels(rollout, tmp_path):
    rollout.save(tmp_path)
    loaded = Rollout.load(tmp_path)
    assert loaded.verdict == rollout.verdict
    assert loaded.summary()["pixel"] == PIXEL


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"truth.camera": []}, 'truth.camera: the task "image" needs a camera'),
        (
            {"truth.camera.0.target": [1.0, 0.3, 9.0]},
            "camera.0: it does not see the tool.*behind it",
        ),
        (
            {"truth.camera.0.target": [5.0, 0.0, 0.0]},
            "does not see the tool.*outside of its 1280 x 960 pixels",
        ),
        ({"truth.camera.0.target": EYE}, "truth.camera.0.target: .*where it stands"),
        ({"truth.camera": [{"position": EYE}] * 2}, "stand in one place.*Move one"),
        ({"truth.tracker": {}}, "needs a camera, and no tracker"),
        ({"robot.pixel": 1.0}, "robot.pixel: a pixel of camera 1 covers 0.004.* m at the arm"),
        ({"reference.radius": 900.0}, "outside of the 1280 x 960 pixels of camera 1"),
        ({"reference.radius": 0.1}, "moves by 0.2 pixels"),
        ({"reference.plane": "xy"}, "a picture is a plane by itself"),
        ({"robot.task": "xy"}, "pixel: has a use only with"),
    ],
)
def test_pictures_outside_of_a_camera_are_refused(settings, words, tmp_path):
    raw = {name: dict(table) for name, table in RAW.items()}
    raw["truth"]["camera"] = [dict(RAW["truth"]["camera"][0])]
    tables = tables_with(raw, settings, "test")
    with pytest.raises(pa.InputError, match=words), pa.scenario.schema.prefix_errors("truth"):
        true = true_robot(described_robot(tables, tmp_path), tables.truth)
        with pa.scenario.schema.prefix_errors("reference"):
            motion = trajectory_of(tables.reference, true)
        check_in_picture(motion, true, tables.truth, 3.0)


def test_two_cameras_fix_the_tool_in_space():
    robot = pa.load("ur5")
    at = robot.placement(robot.q0).translation
    cameras = [pinhole_camera(at + np.array([2.0, y, 1.0]), at, 1000.0) for y in (-0.5, 1.5)]
    filmed = robot.filmed_by(*cameras, pixel=0.002)
    assert filmed.task.labels == ("u", "v", "u_2")
    with pytest.raises(pa.RobotError, match="only the first coordinate"):
        robot.filmed_by(cameras[0], 2.0 * cameras[0])
    assert difference(filmed, robot.filmed_by(*cameras[::-1], pixel=0.002)) == "camera"
    with pytest.raises(pa.RobotError, match="single direction"):
        robot.filmed_by(cameras[0][[0, 0, 2]])
    with pytest.raises(pa.RobotError, match="filmed_by"):
        pa.load("ur5", task="image")
    with pytest.raises(pa.ParameterError, match="of measured positions"):
        pa.make_controller(filmed, unknown=pa.Unknown(geometry=True))


@pytest.mark.parametrize("words", [{"task": "image"}, {"tracker": True}])
def test_a_written_scenario_is_complete(words, tmp_path):
    """What `init` writes for a camera and for a tracker is read, and its path is in the picture."""
    path = tmp_path / "mine.toml"
    template = Template.of("planar_2r" if "task" in words else str(ARM4), **words)
    path.write_text(scenario_text(template, tmp_path))
    scenario = Scenario.read(path, ["simulation.dt=0.004", "controller.adaptation='natural'"])
    assert not scenario.controller.kinematics.calibrated
    if "task" not in words:
        return
    assert scenario.tables.robot.pixel is not None
    with pytest.raises(pa.InputError, match="positions"):
        Template.of("planar_2r", task="image", law="adaptive-jacobian")
