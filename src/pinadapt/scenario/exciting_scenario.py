"""A scenario in which the joints follow an exciting motion."""

from __future__ import annotations

import os
from collections.abc import Mapping, MutableMapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit

from ..description.urdf import is_path
from ..excitation.exciting_motion import ExcitingMotion
from ..robot.robot import Robot

_FILES = (
    ("robot", "source"),
    ("unknown", "basis"),
    ("unknown", "lmi"),
    ("belief", "learned"),
    ("simulation", "engine", "mjcf"),
)
_OF_TRANSLATIONS = (
    ("unknown", "kinematic"),
    ("unknown", "kinematic_box"),
    ("belief", "kinematic"),
    ("belief", "learned"),
    ("controller", "gamma_k"),
)
_HEADER = "A motion that excites the unknown parameters, found by `pinadapt excite`."


def scenario_of_robot(
    source: str, robot: Robot, dynamic: Sequence[str], joint: Sequence[str]
) -> dict[str, Any]:
    """Return the tables of a scenario for a robot, without a motion.

    Args:
        source: a path, relative to the working directory, or a name.
        robot: the robot loaded from it.
        dynamic: unknown bodies, as in [unknown].
        joint: unknown joint coefficients, as in [unknown].
    """
    return {
        "title": f"{robot.name}, an exciting motion",
        "robot": {
            "source": source,
            "frame": robot.frame,
            "q0": [float(f"{angle:.12g}") + 0.0 for angle in robot.home_angles],
        },
        "unknown": {"dynamic": _words(dynamic), "joint": _words(joint)},
    }


def exciting_tables(
    tables: Mapping[str, Any], motion: ExcitingMotion, source_folder: Path, folder: Path
) -> dict[str, Any]:
    """Return the tables of a scenario with joints that follow a motion.

    Task, reference and duration are replaced. Keys of unknown translations are removed, as these
    do not influence the joints. Everything else stays.

    Args:
        tables: the scenario.
        motion: the motion to follow.
        source_folder: folder to which paths in ``tables`` are relative.
        folder: folder to which paths in the result are relative.
    """
    whole: dict[str, Any] = {
        key: dict(table) if isinstance(table, Mapping) else table for key, table in tables.items()
    }
    for path in _FILES:
        _move(whole, path, source_folder, folder)
    for section, key in _OF_TRANSLATIONS:
        whole.get(section, {}).pop(key, None)
    whole["robot"]["task"] = "joint"
    whole["reference"] = motion.reference()
    whole["simulation"] = {**whole.get("simulation", {}), "duration": motion.duration}
    return whole


def exciting_text(tables: Mapping[str, Any]) -> str:
    """Return tables as TOML text."""
    document = tomlkit.document()
    document.add(tomlkit.comment(_HEADER))
    for key, value in tables.items():
        document[key] = value
    for name in ("cosine", "sine"):
        rows = tomlkit.array().multiline(True)  # a line for each joint
        rows.extend(tables["reference"][name])
        document["reference"][name] = rows
    return tomlkit.dumps(document)


def _move(
    tables: MutableMapping[str, Any], path: Sequence[str], source_folder: Path, folder: Path
) -> None:
    """Make the path at a key relative to another folder; absolute paths stay."""
    table: Any = tables
    for key in path[:-1]:
        table = table.get(key) if isinstance(table, Mapping) else None
    name = table.get(path[-1]) if isinstance(table, Mapping) else None
    if not isinstance(name, str) or Path(name).is_absolute():
        return
    if path != ("robot", "source") or is_path(name):
        table[path[-1]] = os.path.relpath((source_folder / name).absolute(), folder.absolute())


def _words(names: Sequence[str]) -> str | list[str]:
    """Return a single word, or a list of names."""
    return names[0] if len(names) == 1 else list(names)
