"""The task "image" in scenario files: numbers in pixels, and cameras that cannot be used."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.scenario.scenario import Scenario
from pinadapt.tasks import pinhole_camera

PIXEL, EYE = 0.004, [1.0, 0.3, 4.0]
RAW = {
    "robot": {"source": "planar_2r", "task": "image", "pixel": PIXEL},
    "truth": {"tool_translation": [0.05, 0.02, 0.0], "camera": [{"position": EYE}]},
    "controller": {"adaptation": "natural", "dt": 0.004},
    "trajectory": {"radius": 30.0},
    "simulation": {"duration": 0.6},
    "sensors": {"noise": {"x": 0.5}, "camera": {"rate": 30.0}},
}


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    """Return the scenario of these tables."""
    return Scenario.build(RAW, tmp_path_factory.mktemp("scenario"))


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


def test_the_error_at_the_tool_is_that_of_its_picture(scenario, rollout):
    """To first order the tool is off by the pseudo-inverse of the picture's Jacobian."""
    last = rollout.window(False)
    true = scenario.true
    found = []
    for q, x, x_d in zip(rollout.q, rollout.x, rollout.x_d, strict=True):
        J = true.task.jacobian(true.placement(q), np.eye(6)[:, :3])
        found.append(np.linalg.norm(np.linalg.pinv(J) @ (x - x_d)))
    assert rollout.beside_picture == pytest.approx(max(found[-len(last) :]), rel=0.02)


def test_two_cameras_fix_the_tool_in_space():
    robot = pa.load("ur5")
    at = robot.placement(robot.q0).translation
    cameras = [pinhole_camera(at + np.array([2.0, y, 1.0]), at, 1000.0) for y in (-0.5, 1.5)]
    filmed = robot.filmed_by(*cameras, pixel=0.002)
    assert filmed.task.labels == ("u", "v", "u_2")
    with pytest.raises(pa.RobotError, match="filmed_by"):
        pa.load("ur5", task="image")
    with pytest.raises(pa.ParameterError, match="of measured positions"):
        pa.make_controller(filmed, unknown=pa.Unknown(geometry=True))
