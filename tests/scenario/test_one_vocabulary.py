"""A table of a file, Python arguments and a --set path: the same run, for every field."""

import warnings
from dataclasses import MISSING, fields, is_dataclass
from inspect import Parameter, signature

import numpy as np
import pytest
import tomlkit

import pinadapt as pa
from pinadapt.controller import Governor
from pinadapt.laws.law import NAMES
from pinadapt.robot import Actuators, Shaft
from pinadapt.robot.robot import Robot
from pinadapt.scenario.scenario import Scenario
from pinadapt.scenario.tables import KEYS, MOTIONS, TABLES, arguments, read_tables
from pinadapt.tuning.rates import RATES
from tests.support.paths import ROOT

pytestmark = pytest.mark.slow

HOME = ROOT / "robots" / "planar_2r"
FRICTION = pa.Friction(
    viscous=0.3,
    coulomb={"joint2": 0.2},
    threshold=0.05,
    gear_friction=0.01,
    asymmetry=0.02,
    offset=0.1,
    breakaway=1.2,
    fading=0.2,
    shafts=(Shaft(("joint1", "joint2"), -1, 0.01, 0.02, 0.03, 0.04),),
)
PAYLOAD = pa.Payload(0.2, (0.01, 0.0, 0.0), (1e-3, 0.0, 1e-3, 0.0, 0.0, 1e-3))
CHANGES = {
    "inertial_scale": 0.9,
    "payload": PAYLOAD,
    "tool_translation": [0.02, 0.0, 0.0],
    "link_translation": {"joint2": [0.01, 0.0, 0.0]},
    "armature": 0.05,
    "viscous": 0.2,
    "coulomb": [0.1, 0.2],
    "friction": FRICTION,
}
GAINS = (*NAMES, *RATES)
# A value for each field; a field without one fails the test below.
VALUES = {
    "robot": {
        "frame": "tip",
        "frames": [],
        "task": "joint",
        "locked": [],
        "q0": [0.4, 0.9],
        "gravity": [0.0, -9.81, 0.0],
        "mass": None,
        "xacro": None,
        "joint_effects": True,
        "pixel": None,
        "base": "fixed",
        "contacts": [],
        "loops": [],
        "passive": [],
    },
    "truth": CHANGES,
    "model": CHANGES,
    "controller": {
        "law": "adaptive-jacobian",
        "adaptation": "natural",
        "kinematic_adaptation": "gradient",
        "modifications": {"sigma": 0.01},
        "payload": PAYLOAD,
        "compensated": "nominal",
        "dt": 2e-3,
        **{name: 1.5 + 0.1 * k for k, name in enumerate(GAINS)},
        "lambda_s": 50.0,
        "lag": 0.01,
        "posture": None,
    },
    "unknown": {
        "tool": True,
        "base": True,
        "tracker": None,
        "geometry": True,
        "translations": ["joint2", "tool"],
        "lengths": ["joint2"],
        "bodies": "payload",
        "friction": "viscous",
        "armature": True,
        "effects": ["offset"],
        "basis": HOME / "basis.csv",
        "lmi": None,
        "regressor": "exact",
    },
    "sensors": {
        "camera": pa.Camera(100.0, 0.01, 0.1),
        "encoder": 1e-4,
        "noise": {"q": 1e-5, "v": 1e-3, "x": 1e-4},
        "compensate_delay": False,
        "torque_offset": None,
        "imu": None,
    },
    "limits": {
        "torque": [5.0, 6.0],
        "box": 0.2,
        "damping": 0.1,
        "guards": {"velocity": False},
        "stop_on_divergence": False,
        "governor": Governor(**{each.name: 0.9 * each.default for each in fields(Governor)}),
        "actuators": Actuators(0.001, 300.0, 4e4, 1.0, "link"),
    },
    "engine": {
        "plant": "pinocchio",
        "dt": 5e-4,
        "substeps": 3,
        "continuous": True,
        "ideal_acceleration": True,
        "torque_limits": False,
        "actuators": Actuators(0.001, 300.0),
    },
    "start": {"a_k": [0.01, 0.02], "a_d": None},
    "simulation": {"duration": 0.03, "seed": 3, "record_every": 2},
}
MOTION = {
    "center": [1.2, 0.3],
    "radius": 0.2,
    "period": 2.0,
    "plane": "xy",
    "phase": 0.3,
    "amplitude": [0.1, 0.2],
    "cycles": [1.0, 2.0],
    "cosine": [[0.1], [0.2]],
    "sine": [[0.0], [0.1]],
    "points": [[0.1, 0.0], [0.1, 0.1]],
    "segment": 0.5,
    "relative": True,
    "point": [1.2, 0.3],
}
PLANAR = [kind for kind in MOTIONS if kind not in ("pose", "swing", "stacked", "crawl")]
ELSEWHERE = {"source", "robot", "learned", "tracker", "camera", "self"}  # tested by their own


def test_every_field_has_a_value():
    for table, values in VALUES.items():
        assert set(values) - ELSEWHERE == set(KEYS[table][1]) - ELSEWHERE, table
    assert set(VALUES) == set(TABLES) - {"title", "trajectory", "events", "moteus"}
    assert {name for kind in PLANAR for name in arguments(MOTIONS[kind])} == set(MOTION)


CASES = [
    (table, {name: value})
    for table, values in VALUES.items()
    for name, value in values.items()
    if value is not None and name not in GAINS
]
CASES += [
    ("controller", {name: VALUES["controller"][name] for name in GAINS if name != "posture"}),
    *(
        ("trajectory", {"kind": kind, **{n: MOTION[n] for n in arguments(MOTIONS[kind])}})
        for kind in PLANAR
    ),
]


def toml(value):
    """Return a value as a file has it: objects as tables of what differs from the default."""
    if is_dataclass(value):
        usual = {
            each.name: each.default if each.default is not MISSING else None
            for each in fields(value)
        }
        own = {name: getattr(value, name) for name in usual}
        return {
            name: toml(each)
            for name, each in own.items()
            if each is not None and not np.array_equal(each, usual[name])
        }
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {name: toml(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [toml(each) for each in value]
    return value if isinstance(value, bool | int | float | str) else str(value)


def written(value):
    """Return a TOML value on one line."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {written(each)}' for key, each in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(written, value))}]"
    return tomlkit.item(value).as_string()


BASE = {"robot": {"source": "planar_2r", "q0": [0.5, 1.0]}, "simulation": {"duration": 4e-3}}


def run_of_python(table, given):
    """Return the run that Python arguments describe."""
    tables = {name: dict(part) for name, part in BASE.items()}
    tables.setdefault(table, {}).update(given)
    robot = pa.load(**tables["robot"])
    controller = pa.make_controller(
        robot.changed(**tables.get("model", {})),
        unknown=pa.Unknown(**tables.get("unknown", {})),
        sensors=pa.Sensors(**tables.get("sensors", {})),
        limits=pa.Limits(**tables.get("limits", {})),
        **tables.get("controller", {}),
    )
    motion = dict(tables.get("trajectory", {"kind": "circle"}))
    kind = MOTIONS[motion.pop("kind")]
    if robot.task.name == "joint":
        kind = MOTIONS["sinusoid"]
    return pa.simulate(
        robot.changed(**tables.get("truth", {})),
        controller,
        kind(**motion),
        engine=pa.Engine(**tables.get("engine", {})),
        start=tables.get("start"),
        **tables["simulation"],
    )


def tables_with(table, given):
    """Return the tables of the file."""
    tables = {name: dict(part) for name, part in BASE.items()}
    tables.setdefault(table, {}).update(toml(given))
    if tables["robot"].get("task") == "joint":
        tables["trajectory"] = {"kind": "sinusoid"}
    return tables


def outcome(make):
    """Return the arrays of a run, or why it was refused."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            rollout = make()
        except pa.InputError as error:
            return type(error), error.what
    return [getattr(rollout, name) for name in ("t", "q", "v", "tau", "a_k", "a_d", "x_d")]


def same(one, other):
    """Return whether two outcomes are equal to the bit."""
    if isinstance(one, tuple) or isinstance(other, tuple):
        return one == other
    return all(a.tobytes() == b.tobytes() for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize(
    ("table", "given"), CASES, ids=[f"{table}.{'-'.join(given)}" for table, given in CASES]
)
def test_file_python_and_set_are_the_same(table, given, tmp_path):
    tables = tables_with(table, given)
    (tmp_path / "all.toml").write_text(tomlkit.dumps(tables))
    base = {
        name: BASE.get(name, part) for name, part in tables.items() if name != table or name in BASE
    }
    (tmp_path / "base.toml").write_text(tomlkit.dumps(base))
    settings = [f"{table}.{name}={written(value)}" for name, value in toml(given).items()]
    assert read_tables(tmp_path / "base.toml", settings) == read_tables(tmp_path / "all.toml")
    python = outcome(lambda: run_of_python(table, given))
    assert same(python, outcome(lambda: Scenario.read(tmp_path / "all.toml").run(False)))


def test_the_tables_of_functions_are_their_arguments():
    """Nothing is named twice: a key of a table is an argument, and the other way round."""
    for table, make in (("robot", pa.load), ("truth", Robot.changed), ("engine", pa.Engine)):
        parameters = signature(make).parameters.values()
        own = {each.name for each in parameters if each.kind is not Parameter.VAR_KEYWORD}
        assert own - {"self"} <= set(KEYS[table][1])
