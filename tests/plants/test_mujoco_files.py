"""MuJoCo files as the true robot, matched with a description by a table."""

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot as load
from tests.support.loops import circle_at_home

pytest.importorskip("mujoco")  # pip install -e '.[dev]' brings it

from tests.support.mujoco_files import own_file

pytestmark = pytest.mark.slow

STAND = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.0, 0.7), np.array([0.3, 0.1, 0.4]))
FINGER = (
    '<body name="finger" pos="0 0 0.1"><joint name="finger" type="slide" axis="0 0 1"/>'
    '<inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/></body>'
)
BALL = '<body name="ball" pos="2 0 9"><freejoint/><geom size="0.1"/></body>'
TABLE = {f"panda_joint{i}": f"joint{i}" for i in range(1, 8)}
MATCH = {"joints": TABLE, "frame": "flange", "base": "stand"}


def short(name):
    """Return the name of a joint in the file."""
    return name.removeprefix("panda_")


@pytest.fixture
def path(tmp_path):
    """Return a file with the Panda on a stand, a light finger on its hand and a ball beside it."""
    more = {"inside": FINGER.format(mass=1e-9, inertia=1e-12), "scene": BALL}
    return own_file(load("panda"), tmp_path / "own.xml", stand=STAND, rename=short, **more)


def swing(plant, seconds=0.1):
    """Hold a plant against gravity, push it about, and return what it measures."""
    weight = pa.robot.Gravity(plant.robot)
    push = np.linspace(3.0, 0.2, plant.nv)
    for k in range(round(seconds / 1e-3)):
        plant.step(weight(plant.measure().q) + push * np.sin(0.03 * k), 1e-3)
    return plant.measure()


def test_the_same_robot_in_a_file_moves_alike(path):
    robot = load("panda")
    plant = pa.plants.MujocoPlant(robot, mjcf=pa.plants.MujocoFile(path, **MATCH))
    theirs = swing(plant)
    ours = swing(pa.plants.MujocoPlant(robot))
    for name in ("q", "v", "x", "xd"):
        assert np.allclose(getattr(theirs, name), getattr(ours, name), rtol=0.0, atol=1e-5)
    assert np.abs(ours.xd).max() > 0.01
    assert abs(plant.data.joint("finger").qpos[0]) < 1e-4
    assert plant.data.body("ball").xpos[2] < 9.0 - 0.04  # nobody holds what is not of the arm
    plant.reset()
    assert np.array_equal(plant.measure().q, robot.q0) and plant.data.body("ball").xpos[2] == 9.0


def test_actuators_and_gravity_compensation_of_the_file_are_switched_off(tmp_path):
    robot = load("panda")
    path = tmp_path / "own.xml"
    own_file(robot, path, rename=short)
    path.write_text(path.read_text().replace('<body name="link', '<body gravcomp="1" name="link'))
    fallen = []
    for plant in (
        pa.plants.MujocoPlant(robot, mjcf=pa.plants.MujocoFile(path, joints=TABLE, frame="flange")),
        pa.plants.MujocoPlant(robot),
    ):
        plant.step(np.zeros(7), 0.02)
        fallen.append(plant.measure().v)
    assert np.abs(fallen[1]).max() > 0.1 and np.allclose(*fallen, atol=1e-9)


def test_the_adaptive_controller_tracks_a_robot_that_differs_from_its_description(tmp_path):
    """A heavier hand, a longer tool: the file has them, and no true parameters are reported."""
    robot = load("panda")
    real = robot.changed(tool_translation=[0.02, 0.0, 0.05], inertial_scale=1.2)
    heavy = {"inside": FINGER.format(mass=1.0, inertia=1e-3), "stand": STAND}
    own = own_file(real, tmp_path / "own.xml", rename=short, **heavy)
    mjcf = pa.plants.MujocoFile(own, **MATCH)
    path = circle_at_home(real)
    controllers = (
        pa.make_controller(robot, dt=4e-3, **options)
        for options in ({}, {"adaptation": "none", "gamma_k": 0.0})
    )
    runs = [pa.simulate(robot, each, path, duration=1.6, engine=mjcf) for each in controllers]
    ends = [np.linalg.norm(run.error[-75:], axis=1).max() for run in runs]
    assert ends[0] < 1e-3 and ends[1] > 5.0 * ends[0]
    assert runs[0].a_k_true is None and runs[0].a_d_true is None and runs[0].lyapunov is None
    assert "error, last 10 %" in str(runs[0])


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"joints": {}}, "joints"),
        ({"joints": {**TABLE, "panda_jont1": "x"}}, "joints"),
        ({"joints": {**TABLE, "panda_joint1": "joint2"}}, "joints"),
        ({"joints": {**TABLE, "panda_joint1": "finger"}}, "joints"),
        ({"joints": {**TABLE, "panda_joint2": "joint4", "panda_joint4": "joint2"}}, "joints"),
        ({"frame": "ball"}, "frame"),
        ({"base": None}, "joints"),
        ({"base": "link3"}, "base"),
        ({"base": "stnd"}, "base"),
    ],
)
def test_mismatches_are_named(path, options, where):
    mjcf = pa.plants.MujocoFile(path, **{**MATCH, **options})
    with pytest.raises(pa.InputError) as error:
        pa.plants.MujocoPlant(load("panda"), mjcf=mjcf)
    assert error.value.where == where


def test_a_file_that_is_missing_is_named(tmp_path):
    with pytest.raises(pa.InputError, match=r"none\.xml"):
        pa.plants.MujocoPlant(load("panda"), mjcf=pa.plants.MujocoFile(tmp_path / "none.xml"))
