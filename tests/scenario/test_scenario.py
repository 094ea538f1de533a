"""Scenario files: allowed keys, their meaning, and errors."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.description.catalogue import robots_folder
from pinadapt.scenario.scenario import Scenario
from tests.support.paths import ARM4

PLANAR = robots_folder() / "planar_2r" / "wang_xie_2009.toml"


def write(tmp_path, text):
    """Write a scenario file and return its path."""
    path = tmp_path / "scenario.toml"
    path.write_text(text)
    return path


def planar(*settings):
    """Return the planar scenario with settings."""
    return Scenario.read(PLANAR, settings)


def scara(tmp_path, text):
    """Return a scenario of the scara with more tables."""
    return Scenario.read(write(tmp_path, f'[robot]\nsource = "scara"\n{text}'))


# --- what a file means ---


def test_a_circle_without_centre_starts_at_the_true_initial_position(tmp_path):
    scenario = scara(
        tmp_path, "[truth]\ntool_translation = [0.1, 0.0, 0.05]\n[trajectory]\nphase = 0.8"
    )
    start = scenario.true.position(scenario.true.q0)
    assert np.allclose(scenario.trajectory.at(0.0).x_d, start, atol=1e-12)
    assert np.linalg.norm(start - scenario.estimated.position(scenario.estimated.q0)) > 0.1
    assert np.isclose(
        np.linalg.norm(scenario.trajectory.at(0.0).x_d - scenario.trajectory.at(1.5).x_d), 0.2
    )


def test_relative_waypoints_are_offsets_from_the_start(tmp_path):
    points = "points = [[0.1, 0.0, 0.0], [0.1, 0.1, 0.0]]"
    text = f'[trajectory]\nkind = "waypoints"\n{points}\nsegment = 0.5\n'
    scenario = scara(tmp_path, text + "relative = true")
    start = scenario.true.position(scenario.true.q0)
    assert np.allclose(
        scenario.trajectory.positions([0.0, 0.5, 1.0]) - start,
        [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0]],
        atol=1e-12,
    )
    absolute = scara(tmp_path, text)
    assert np.allclose(
        absolute.trajectory.positions([0.0, 0.5]), [[0.1, 0.0, 0.0], [0.1, 0.1, 0.0]], atol=1e-12
    )


def test_paths_are_relative_to_the_scenario_file(tmp_path, monkeypatch):
    folder = tmp_path / "somewhere"
    (folder / "robots").mkdir(parents=True)
    (folder / "robots" / "arm.urdf").write_text(ARM4.read_text())
    (folder / "scenario.toml").write_text('[robot]\nsource = "robots/arm.urdf"\nframe = "tip"')
    monkeypatch.chdir(tmp_path)
    assert Scenario.read("somewhere/scenario.toml").true.model.nv == 4


# --- settings ---


def test_settings_take_dotted_keys_and_toml_values():
    scenario = planar(
        "controller.Kv=[41.0, 42.0]",
        "engine.torque_limits=true",
        "sensors.noise={ x = 1e-3 }",
    )
    assert np.allclose(np.diag(scenario.controller.law.K_v), [41.0, 42.0])
    assert scenario.engine.torque_limits is True
    assert scenario.sensors.noise["x"] == 1e-3


@pytest.mark.parametrize("name", ["arm.urdf", "arm.xml", "arm.urdf.xacro", "panda", "solo12"])
def test_a_robot_in_place_of_a_scenario_is_sent_to_init(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        pa.exceptions.ScenarioError, match=f"not a scenario.*`pinadapt init {name}`"
    ):
        Scenario.read(name)


# --- refusals ---


@pytest.mark.parametrize(
    ("setting", "key", "suggestion"),
    [
        ("contoller.Kv=3.0", "contoller", "controller"),
        ("robot.sorce='ur5'", "robot.sorce", "source"),
        ("truth.payload={ mass = 1.0, con = [0, 0, 0] }", "truth.payload.con", "com"),
        ("truth.friction.shafts=[{ joint = [] }]", "truth.friction.shafts.0.joint", "joints"),
        ("unknown.translation=[]", "unknown.translation", "translations"),
        ("controller.lamda=3.0", "controller.lamda", "lambda_"),
        ("trajectory.radus=1.0", "trajectory.radus", "radius"),
    ],
)
def test_a_wrong_key_is_named_and_the_nearest_suggested(setting, key, suggestion):
    with pytest.raises(pa.ScenarioError) as error:
        planar(setting)
    assert f"{key}: unknown key; allowed here: " in str(error.value)
    assert f"Did you mean '{suggestion}'?" in str(error.value)


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ("title=3", "title"),
        ("truth.camera=3", "truth.camera"),
        ("robot.q0=[nan, 1.0]", "robot.q0"),
        ("robot.gravity=[0.0, 0.0]", "robot.gravity"),
        ("truth.payload={ com = [0.0, 0.0, 0.0] }", "truth.payload.mass"),
        ("truth.inertial_scale={ joint1 = -1.0 }", "truth.inertial_scale.joint1"),
        ("truth.friction.viscous=-1.0", "truth.friction.viscous"),
        ("start.a_d='a'", "start.a_d"),
        ("trajectory.radius=-1.0", "trajectory.radius"),
        ("trajectory.plane='yz'", "trajectory.plane"),
        ("simulation.duration=-1.0", "simulation.duration"),
        ("controller.dt=0.0", "controller.dt"),
        ("engine.substeps=0", "engine.substeps"),
        ("sensors.camera.delay=-1.0", "sensors.camera.delay"),
        ("engine.torque_limits='maybe'", "engine.torque_limits"),
        # found when robot, controller and motion are built
        ("robot.source=planr_2r", "robot.source"),
        ("robot.frame=tp", "robot.frame"),
        ("robot.locked=['joint3']", "robot.locked"),
        ("truth.inertial_scale={ joint3 = 1.0 }", "truth.inertial_scale"),
        ("truth.friction.viscous=[1.0]", "truth.friction.viscous"),
        (
            "truth.payload={ mass = 1.0, inertia = [-1.0, 0.0, 1.0, 0.0, 0.0, 1.0] }",
            "truth.payload.inertia",
        ),
        ("unknown.translations=['joint1']", "unknown.translations"),
        ("unknown.basis=bsis.csv", "unknown.basis"),
        ("controller.Kv=-1.0", "controller.Kv"),
        ("controller.alpha=100.0", "controller.alpha"),
        ("controller.gamma_d=[1.0, 2.0, 3.0]", "controller.gamma_d"),
        ("controller.lambda_a=0.0", "controller.lambda_a"),
        (
            "trajectory={ kind = 'lissajous', amplitude = [0.1], cycles = [1.0, 2.0] }",
            "trajectory.amplitude",
        ),
        (
            "trajectory={ kind = 'waypoints', relative = true, points = [[0.1, 0.1, 0.1]] }",
            "trajectory",
        ),
        (
            "trajectory={ kind = 'waypoints', points = [[1, 1, 1], [1, 1, 2]] }",
            "trajectory: ",
        ),
        # found when the run begins
        ("start.a_k=[1.0]", "start.a_k"),
        ("start.a_d=[1.0, 5.0, 1.0]", "start.a_d"),
    ],
)
def test_a_wrong_value_names_its_dotted_key(setting, key):
    with pytest.raises(pa.InputError) as error:
        planar("simulation.duration=0.002", setting).run()
    assert key in str(error.value)
