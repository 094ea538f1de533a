"""Hostile input: each piece is refused with a typed error that names it, or it works."""

import re
import warnings
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pinadapt as pa
from pinadapt._output import read_toml
from pinadapt.cli.command_line import main
from pinadapt.scenario.scenario import Scenario
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow

ROBOTS = ROOT / "robots"
URDF = (ROBOTS / "planar_2r" / "planar_2r.urdf").read_text()
SCENARIO = '[robot]\nsource = "planar_2r"\n[simulation]\nduration = 0.005\n'
HUGE = 10**400


def refused(folder, capsys, text, *settings):
    """Return the one message of a scenario that the command line refuses."""
    file = folder / "scenario.toml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    options = ["--set", *settings] if settings else []
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        assert main(["run", str(file), "--no-html", "--out", str(folder / "out"), *options]) == 2
    message = capsys.readouterr().err
    assert message.startswith("pinadapt: ") and message.count("\n") == 1
    return message


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        (
            "truth.payload.mass=1e308",
            "truth.payload.mass: is too large to compute with, over 3.4e.38",
        ),
        ("simulation.duration=1e300", "simulation.duration: is too large"),
        ("controller.dt=1e-300", "controller.dt: is too small to compute with, under 1.18e-38"),
        ("robot.gravity=[0.0,0.0,1e200]", "robot.gravity: is too large"),
        (f"simulation.seed={'9' * 5000}", "--set: the value is too long"),
        ("simulation.duration=true", "simulation.duration: .* number, got True"),
        ('simulation.duration="0.02"', "simulation.duration: .* number, got '0.02'"),
        ("truth.payload.com=[true,0.0,0.0]", "truth.payload.com: expected numbers.*True"),
        ("title=" + "[" * 50_000, "--set: the value is too long or nested too deeply"),
    ],
)
def test_a_setting_is_refused_by_its_key(setting, words, tmp_path, capsys):
    mass = ["truth.payload.mass=1.0"] if "payload.com" in setting else []
    assert re.search(words, refused(tmp_path, capsys, SCENARIO, *mass, setting))


@pytest.fixture(scope="module")
def robot():
    return pa.load("planar_2r")


@pytest.fixture(scope="module")
def controller(robot):
    return pa.make_controller(robot, adaptation="natural")


CALLS = {
    "load": lambda r, c, bad: pa.load(bad),
    "locked": lambda r, c, bad: pa.load("planar_2r", locked=[bad]),
    "q0": lambda r, c, bad: r.at([bad, 0.1]),
    "payload": lambda r, c, bad: r.changed(payload=bad),
    "mass": lambda r, c, bad: r.changed(payload=pa.Payload(bad)),
    "viscous": lambda r, c, bad: r.changed(viscous=[bad, 0.1]),
    "circle": lambda r, c, bad: pa.trajectories.Circle([0.5, 0.5], bad, 3.0),
    "waypoints": lambda r, c, bad: pa.trajectories.Waypoints([[0.0, 0.0], [bad, 0.0]], 1.0),
    "camera": lambda r, c, bad: pa.Camera(rate=bad),
    "natural": lambda r, c, bad: pa.adaptation.Natural(
        bad, pa.adaptation.MatrixInequality(np.eye(2)[None])
    ),
    "low pass": lambda r, c, bad: pa.filters.LowPass(bad),
    "estimated": lambda r, c, bad: pa.make_controller(bad, adaptation="natural"),
    "Kv": lambda r, c, bad: pa.make_controller(r, adaptation="natural", Kv=bad),
    "dt": lambda r, c, bad: pa.make_controller(r, adaptation="natural", dt=bad),
    "basis": lambda r, c, bad: pa.make_controller(r, unknown=pa.Unknown(basis=[[bad]])),
    "simulated": lambda r, c, bad: pa.simulate(bad, c, hold(r), duration=0.01),
    "trajectory": lambda r, c, bad: pa.simulate(r, c, bad, duration=0.01),
    "duration": lambda r, c, bad: pa.simulate(r, c, hold(r), duration=bad),
    "every": lambda r, c, bad: pa.simulate(r, c, hold(r), duration=0.01, record_every=bad),
    "changes": lambda r, c, bad: pa.simulate(
        r, c, hold(r), duration=0.01, events=pa.Events(changes=bad)
    ),
    "preflight": lambda r, c, bad: pa.preflight(c, bad),
}


def hold(robot):
    return pa.trajectories.Hold(robot.position(robot.q0))


@pytest.mark.parametrize("name", CALLS)
def test_absurd_numbers_get_a_typed_error(name, robot, controller):
    for bad in (np.nan, np.inf, HUGE, 1e308, "0.02", b"1", 1j, {"a": 1}):
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            with pytest.raises(pa.InputError):
                CALLS[name](robot, controller, bad)


def test_an_unused_gain_is_warned_of(robot):
    with pytest.warns(pa.UnusedGainWarning, match="nothing uses lambda_a: .* use Kv, alpha"):
        pa.make_controller(robot, lambda_a=0.1)
    with pytest.warns(pa.UnusedGainWarning, match="nothing uses gamma_d"):
        pa.make_controller(robot, adaptation="none", gamma_d=1.0)


@pytest.mark.parametrize("name", ["x\r\ny = 1\n[evil]", '"""a]b\'\\c\x7f\u2028\u202eé☃'])
def test_init_writes_toml_for_any_name_and_it_runs(name, tmp_path, capsys):
    text = URDF
    for word in ("joint1", "tip", "planar_2r"):
        given = quoteattr(name + word).replace("\n", "&#10;").replace("\r", "&#13;")
        text = text.replace(f'"{word}"', given)
    (tmp_path / "'a\\ b].urdf").write_text(text)
    file = tmp_path / "scenario.toml"
    assert main(["init", str(tmp_path / "'a\\ b].urdf"), "--out", str(file)]) == 0
    tables = read_toml(file)
    assert "y" not in tables and "evil" not in tables
    assert tables["robot"]["frame"] == name + "tip"
    assert Scenario.read(file, ["simulation.duration=0.003"]).run().diverged is None


DAE = (
    '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
    '<library_images><image id="i"><init_from>{}</init_from></image></library_images>'
    '<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="9">'
    "0 0 0 1 0 0 0 1 0</float_array><technique_common>"
    '<accessor source="#a" count="3" stride="3"><param name="X" type="float"/>'
    '<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>'
    '</source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
    '<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/>'
    '<input semantic="TEXCOORD" source="#p" offset="1"/><p>0 0 1 1 2 2</p>'
    "</triangles></mesh></geometry></library_geometries><library_visual_scenes>"
    '<visual_scene id="s"><node><instance_geometry url="#g"/></node></visual_scene>'
    '</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
)


@pytest.fixture
def textured(tmp_path):
    """Return a function that writes a robot whose mesh names an image, beside a secret."""
    (tmp_path / "secret.txt").write_text("the secret")
    folder = tmp_path / "robot"
    (folder / "meshes").mkdir(parents=True)
    (folder / "own.png").write_bytes(b"an image")
    (folder / "link.png").symlink_to(tmp_path / "secret.txt")
    visual = '<visual><geometry><mesh filename="meshes/m.dae"/></geometry></visual>'

    def write(image):
        (folder / "meshes" / "m.dae").write_text(DAE.format(image))
        text = URDF.replace('<link name="link1">', f'<link name="link1">{visual}', 1)
        (folder / "arm.urdf").write_text(text.replace("meshes/m.dae", f"{folder}/meshes/m.dae"))
        return folder / "arm.urdf"

    return write


@pytest.mark.parametrize("image", ["../../secret.txt", "{}/secret.txt", "../link.png"])
def test_a_page_embeds_and_names_no_image(image, textured, tmp_path):
    from pinadapt.view.drawing import Artist

    robot = pa.load(textured(image.format(tmp_path)), task="xy", frame="tip")
    (shape,) = [s for s in robot.visual.geometryObjects if s.meshPath.endswith(".dae")]
    mesh = Artist(robot.model, None, robot.visual).loadMeshFromFile(shape)
    assert not mesh.img_resources and image.format(tmp_path) not in mesh.dae_raw
    # the viewer cannot merge parts of which some have coordinates on an image
    assert 'semantic="VERTEX"' in mesh.dae_raw and "TEXCOORD" not in mesh.dae_raw


WILD = st.one_of(
    st.floats(),
    st.integers(-3, 3),
    st.sampled_from([HUGE, True, "0.02", None, 1e30, 1e-30, -1e30]),
    st.lists(st.floats(), max_size=3),
)
KEYS = [
    "controller.Kv",
    "controller.alpha",
    "controller.gamma_d",
    "controller.gamma_k",
    "controller.R_k",
    "controller.dt",
    "sensors.noise.v",
    "sensors.encoder",
    "truth.inertial_scale",
    "truth.armature",
    "truth.tool_translation",
    "trajectory.radius",
    "trajectory.period",
    "robot.gravity",
    "robot.q0",
]


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.sampled_from(KEYS), WILD)
def test_any_value_is_refused_or_runs_to_finite_numbers(key, value):
    section, *path = key.split(".")
    tables = {"robot": {"source": "planar_2r"}, "simulation": {"duration": 3e-3}}
    table = tables.setdefault(section, {})
    for part in path[:-1]:
        table = table.setdefault(part, {})
    table[path[-1]] = value
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        warnings.simplefilter("error", RuntimeWarning)
        try:
            rollout = Scenario.build(tables, ROBOTS).run()
        except pa.InputError:
            return
    assert np.isfinite(rollout.q).all() and np.isfinite(rollout.tau).all()


# --- what would be wrong in silence ---


def _stepped_from_a_noisy_arm():
    """Step a controller from the state of one for other sensors."""
    robot = pa.load("planar_2r")
    measurement = pa.plants.PinocchioPlant(robot).measure()
    state = pa.make_controller(robot, sensors=pa.Sensors(encoder=1e-4)).init(measurement)
    desired = pa.Desired(measurement.x, np.zeros(2), np.zeros(2))
    pa.make_controller(robot).step(state, measurement._replace(t=1e-3), desired, 1e-3)


def _tool_in_a_picture():
    """Announce a tool to a controller whose task is a picture."""
    robot = pa.load("ur5", task="image", pixel=0.002)
    controller = pa.make_controller(robot)
    state = controller.init(pa.plants.PinocchioPlant(robot).measure())
    controller.announce(state, tool_translation=[0.0, 0.0, 0.1])


def _parts():
    """Return kinematics and dynamics of a controller."""
    controller = pa.make_controller(pa.load("planar_2r"))
    return controller.kinematics, controller.dynamics


SILENT = {
    "kinematics at more parameters": (
        lambda: _parts()[0].update(np.zeros(9), np.zeros(2), np.zeros(2)),
        "a_k: expected 3 numbers",
    ),
    "dynamics at fewer parameters": (lambda: _parts()[1].load(np.zeros(5)), "a_d: expected"),
    "state of a noisy arm": (_stepped_from_a_noisy_arm, "another controller"),
    "a slower motion that is faster": (lambda: pa.trajectories.SlowedTime(0.5), "slowness: must"),
    "an axis of zeros": (lambda: pa.trajectories.Swing([0, 0, 0], 0.3, 2.0), "orientation.axis"),
    "a tool in a picture": (_tool_in_a_picture, "cannot express this tool"),
    "milliseconds": (lambda: pa.Camera(rate=30.0, delay=300.0), "30 ms are 0.03"),
    "a frame twice": (
        lambda: pa.load("tiago_dual", frames=["a", "a"]),
        "frames: one is given twice",
    ),
    "a translation twice": (
        lambda: pa.make_controller(
            pa.load("ur5"), unknown=pa.Unknown(translations=["elbow_joint"] * 2)
        ),
        "translations: one occurs twice",
    ),
    "a gain that a law has not": (
        lambda: pa.make_controller(pa.load("ur5", task="joint"), law="slotine-li", Kp=3.0),
        "Kp: the law 'slotine-li' has none",
    ),
    "a dead zone of no size": (
        lambda: pa.make_controller(pa.load("ur5"), modifications="dead-zone"),
        "dead-zone: no noise of the joint velocity",
    ),
}


@pytest.mark.parametrize("what", SILENT)
def test_what_would_be_wrong_in_silence_is_refused(what):
    make, words = SILENT[what]
    with pytest.raises(pa.PinadaptError, match=words):
        make()


@pytest.mark.parametrize("task", ["xyz", "joint"])
def test_models_refuse_a_q_of_another_size(task):
    control = pa.make_controller(pa.load("ur5", task=task))
    q = np.zeros(5)
    v = np.zeros(6)
    with pytest.raises(pa.InputError, match=r"\(6,\).*\(5,\)"):
        control.kinematics.update(control.kinematics.initial, q, v)
    rates = {"mass_matrix": 0, "torque": 2, "regressor": 2, "slotine_li": 3, "momentum": 1}
    for name, count in rates.items():
        with pytest.raises(pa.InputError, match=r"\(6,\).*\(5,\)"):
            getattr(control.dynamics, name)(q, *[v] * count)


def test_a_folder_with_the_name_of_an_output_is_told_before_the_run(tmp_path, capsys):
    (tmp_path / "out" / "rollout.npz").mkdir(parents=True)
    assert "rollout.npz: is a folder" in refused(tmp_path, capsys, SCENARIO)
