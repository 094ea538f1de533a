"""The tables of a scenario file: arguments of the library's classes and functions, by name.

A table has the name of an argument or of a function's result, and its keys are the arguments of one
class or function: ``[sensors]`` is ``pa.Sensors``, ``[robot]`` what ``pa.load`` takes. Nothing is
translated: what a key may be, its default and its errors are those of that class or function.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from copy import deepcopy
from dataclasses import is_dataclass
from functools import cache, partial
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

from .._checks import flag, instance, located, shown, word
from .._output import Record, read_toml, toml
from ..controller.limits import Limits
from ..description.description import is_robot_name
from ..description.urdf import is_path
from ..exceptions import ScenarioError, did_you_mean
from ..laws import LAWS
from ..laws.law import NAMES
from ..records import Sensors
from ..robot.loading import load
from ..robot.robot import Robot
from ..simulation.engine import Engine
from ..tasks.frame import pinhole_camera
from ..trajectories.crawl import Crawl
from ..trajectories.periodic import Circle, FourierSeries, Lissajous, Sinusoid
from ..trajectories.pose import PoseTrajectory, Swing
from ..trajectories.stacked import Stacked
from ..trajectories.trajectory import Hold, Trajectory, Waypoints
from ..tuning.make_controller import make_controller
from ..tuning.rates import ADAPTATIONS, KINEMATIC_ADAPTATIONS, RATES
from ..tuning.unknowns import Unknown

Tables = dict[str, Any]
Make = Callable[..., Any]  # a class or function that takes the keys of a table as arguments

MOTIONS: dict[str, type[Trajectory]] = {
    "crawl": Crawl,
    "circle": Circle,
    "lissajous": Lissajous,
    "sinusoid": Sinusoid,
    "fourier": FourierSeries,
    "waypoints": Waypoints,
    "hold": Hold,
    "pose": PoseTrajectory,
    "swing": Swing,
    "stacked": Stacked,
}
_OF_MOTIONS = ("kind", "as_given", "from_rest")
_DESCRIPTIONS = (".urdf", ".xacro", ".xml", ".mjcf")  # files that describe robots
_WORDS = {"law": LAWS, "adaptation": ADAPTATIONS, "kinematic_adaptation": KINEMATIC_ADAPTATIONS}
_PATHS = ("robot.source", "unknown.basis", "unknown.lmi", "model.learned", "engine.plant.path")


@cache
def arguments(make: Make) -> tuple[str, ...]:
    """Return the names of the arguments that a class, function or method has, in order."""
    return tuple(
        name
        for name, each in signature(make).parameters.items()
        if name != "self" and each.kind not in (Parameter.VAR_KEYWORD, Parameter.VAR_POSITIONAL)
    )


_CHANGES = arguments(Robot.changed)
_OWN = ("robot", "unknown", "sensors", "limits")  # arguments that are tables of their own
_CONTROLLER = [name for name in arguments(make_controller) if name not in _OWN]

# What each table is made of: a class or function, and those of its arguments.
KEYS: dict[str, tuple[Make, tuple[str, ...]]] = {
    "robot": (load, arguments(load)),
    "truth": (Robot.changed, (*_CHANGES, "tracker", "camera")),
    "model": (Robot.changed, (*_CHANGES, "learned")),
    "controller": (make_controller, (*_CONTROLLER, *NAMES, *RATES)),
    "start": (dict, ("a_k", "a_d")),
    "events": (dict, ("changes", "announcements")),
    "simulation": (dict, ("duration", "seed", "record_every")),
    "moteus": (dict, ("motors", "interface", "channel", "timeout")),
    "unknown": (Unknown, arguments(Unknown)),
    "sensors": (Sensors, arguments(Sensors)),
    "limits": (Limits, arguments(Limits)),
    "engine": (Engine, arguments(Engine)),
}
TABLES = ("title", *KEYS, "trajectory")


def in_table(name: str) -> AbstractContextManager[None]:
    """Let errors raised inside name their place in a table of this name."""
    return located(name, KEYS[name][1] if name in KEYS else (), TABLES)


@cache
def _hints(make: Make) -> Tables:
    """Return the types of the arguments of a class or function."""
    if make in (dict, load):  # in which no table stands for an object
        return {}
    return get_type_hints(vars(make)["__init__"] if isinstance(make, type) else make)


def _classes(hint: Any) -> list[type]:
    """Return the classes of arguments that a type allows, at any depth."""
    if isinstance(hint, type) and (is_dataclass(hint) or hint is Trajectory):
        return [hint] if hint.__module__.startswith("pinadapt.") else []
    return [each for part in get_args(hint) for each in _classes(part)]


def checked(table: Any, path: str, names: Sequence[str]) -> Record:
    """Return a table if it is one, with keys of these names.

    Raises:
        ScenarioError: it is none, or a key is not allowed; the nearest is suggested.
    """
    if not isinstance(table, Mapping):
        raise ScenarioError(f"expected a table, got {shown(table)}.", where=path)
    for key in table:
        if key not in names:
            raise ScenarioError(
                f"unknown key; allowed here: {', '.join(names)}.{did_you_mean(key, names)}",
                where=f"{path}.{key}" if path else key,
            )
    return table


def read(table: Any, path: str, make: Make, names: Sequence[str] = ()) -> Tables:
    """Return the arguments of a class or function that a table holds, tables in it as objects.

    Raises:
        InputError: a key is not allowed, or a value is refused by its class.
    """
    return {
        key: _value(_hints(make).get(key), value, f"{path}.{key}")
        for key, value in checked(table, path, names or arguments(make)).items()
    }


def _value(hint: Any, value: Any, path: str) -> Any:
    """Return a value, or the objects that tables stand for, where the argument is of a class."""
    found = _classes(hint)
    if not found:
        return value
    make = motion if Trajectory in found else partial(made, found[0])
    if isinstance(value, Mapping):
        by_name = any(get_origin(part) is Mapping and _classes(part) for part in get_args(hint))
        if by_name and value and all(isinstance(each, Mapping) for each in value.values()):
            return {key: make(each, f"{path}.{key}") for key, each in value.items()}
        return make(value, path)
    if isinstance(value, list) and all(isinstance(each, Mapping) for each in value):
        return tuple(make(each, f"{path}.{i}") for i, each in enumerate(value))
    return value


def made(make: Make, table: Any, path: str) -> Any:
    """Return what a class or function makes of a table.

    Raises:
        InputError: a key is missing or not allowed, or a value is refused.
    """
    given = read(table, path, make)
    for name in arguments(make):
        if name not in given and signature(make).parameters[name].default is Parameter.empty:
            raise _required(f"{path}.{name}")
    with located(path, arguments(make), TABLES):
        return make(**given)


def motion(table: Any, path: str = "trajectory") -> Trajectory:
    """Return the motion that a table describes: its kind, and the arguments of that class.

    ``as_given = true`` and ``from_rest = 2.0`` (s) are the methods of ``Trajectory``.

    Raises:
        InputError: there is no such kind, or its class refuses the arguments.
    """
    usual = "swing" if path.endswith(".orientation") else "circle"
    kind = table.get("kind", usual) if isinstance(table, Mapping) else usual
    word(kind, MOTIONS, f"{path}.kind")
    table = dict(checked(table, path, (*_OF_MOTIONS, *arguments(MOTIONS[kind]))))
    _, as_given, ramp = (table.pop(key, None) for key in _OF_MOTIONS)
    found = made(MOTIONS[kind], table, path)
    with located(path, _OF_MOTIONS):
        found = found if ramp is None else found.from_rest(ramp)
    return found.as_given() if flag(as_given or False, f"{path}.as_given") else found


def parts(tables: Tables) -> Tables:
    """Return objects of the tables that are classes, and arguments of those that are functions.

    Raises:
        InputError: a key is not allowed, or a value is refused by its class.
    """
    checked(tables, "", TABLES)
    found: Tables = {
        "title": instance(tables.get("title", ""), str, "title", ScenarioError),
        "trajectory": motion(tables.get("trajectory", {})),
    }
    for name, (make, names) in KEYS.items():
        table = tables.get(name, {})
        if name in ("unknown", "engine") and not isinstance(table, Mapping):
            with located(name):
                found[name] = make.of(table)  # type: ignore[attr-defined]
        elif is_dataclass(make):
            found[name] = made(make, table, name)
        else:
            found[name] = read(table, name, make, names)
    if "source" not in found["robot"]:
        raise _required("robot.source")
    for key, allowed in _WORDS.items():
        if key in found["controller"]:
            word(found["controller"][key], allowed, f"controller.{key}")
    for table, key, make, allowed in (
        ("truth", "camera", pinhole_camera, ()),
        ("events", "changes", Robot.changed, ("at", *KEYS["truth"][1])),
        ("events", "announcements", Robot.changed, ("at", "payload", "tool_translation")),
    ):
        place = f"{table}.{key}"
        listed = instance(found[table].get(key, []), list, place, ScenarioError)
        found[table][key] = [
            read(each, f"{place}.{i}", make, allowed) for i, each in enumerate(listed)
        ]
    return found


def _required(key: str) -> ScenarioError:
    """Return the error of a key that is missing."""
    return ScenarioError(f"this key is required; in the file, or by --set {key}=VALUE", where=key)


# Files and settings


def read_tables(path: Path, settings: Sequence[str] = ()) -> Tables:
    """Return the tables of a scenario file after ``key=value`` settings.

    Paths in the file are relative to it, those in settings to the working directory.

    Raises:
        ScenarioError: the file is missing or not TOML, or a setting cannot be written into it.
    """
    if path.suffix.lower() in _DESCRIPTIONS or (not path.exists() and is_robot_name(str(path))):
        raise ScenarioError(
            "this is a robot, not a scenario.",
            where=path,
            hint=f"Write a scenario for it first: `pinadapt init {path}`.",
        )
    return with_values(read_toml(path), dict(map(setting, settings)))


def with_values(tables: Record, values: Record) -> Tables:
    """Return a copy of tables with other values by dotted keys.

    Raises:
        ScenarioError: a key has an empty part, or a part of it is not a table.
    """
    found = deepcopy(dict(tables))
    for key, value in values.items():
        table: Any = found
        *way, last = names = key.split(".")
        for part in way:
            table = table.setdefault(part, {}) if isinstance(table, dict) else None
        if not all(names) or not isinstance(table, dict):
            raise ScenarioError(f"'{key}' is not the key of a table.", where="--set")
        table[last] = value
    return found


def setting(text: str, where: str = "--set") -> tuple[str, Any]:
    """Return key and value of one ``key=value``; a relative path is one of the working directory.

    Raises:
        ScenarioError: there is no equals sign or no key.
    """
    key, equals, value = (part.strip() for part in text.partition("="))
    if not (equals and key):
        raise ScenarioError(f"expected key=value with a dotted key, got '{text}'.", where=where)
    found = toml_value(value)
    return key, os.path.abspath(found) if names_file(key, found) else found


def names_file(key: str, value: Any) -> bool:
    """Return whether the value of a dotted key is a path."""
    return key in _PATHS and isinstance(value, str) and (key != "robot.source" or is_path(value))


def toml_value(text: str) -> Any:
    """Return the value of a TOML expression; text that is not TOML is taken as a string."""
    try:
        return toml.loads(f"value = {text}")["value"]
    except toml.TOMLDecodeError:
        return text
    except (ValueError, RecursionError) as error:
        raise ScenarioError("the value is too long or nested too deeply.", where="--set") from error


def at_folder(tables: Tables, folder: Path) -> Tables:
    """Return a copy of tables with the paths in them, relative to a folder, usable here."""
    return with_values(
        tables,
        {key: str(folder / name) for key, name in flat(tables).items() if names_file(key, name)},
    )


def flat(table: Record, prefix: str = "") -> Tables:
    """Return the entries of nested tables by dotted keys."""
    found: Tables = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            found |= flat(value, f"{prefix}{key}.")
        else:
            found[f"{prefix}{key}"] = value
    return found


def plain(value: Any) -> Any:
    """Return a value as JSON and TOML have it, without what is None in a table."""
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items() if each is not None}
    if isinstance(value, list | tuple | range):
        return [plain(each) for each in value]
    return value if isinstance(value, bool | int | float | str | None) else str(value)
