"""A scenario whose joints follow an exciting motion."""

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
_HEADER = "A motion made to tell the unknown parameters apart, by `pinadapt excite`."


def scenario_of_robot(
    source: str, robot: Robot, dynamic: Sequence[str], joint: Sequence[str]
) -> dict[str, Any]:
    """Return the tables of a scenario of a robot, from the working directory, without a motion.

    Args:
        source: a path or a name.
        robot: that was loaded from it.
        dynamic: unknown bodies.
        joint: unknown coefficients of the joints.
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
    """Return given tables with joints that follow a motion; nothing else is changed.

    Args:
        tables: of a scenario. Task and motion are replaced, and what it says of unknown
            translations, which do not show in joints, goes.
        motion: to follow.
        source_folder: where relative paths in the tables start.
        folder: where they are to start.
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
    """Return tables as the text of a file."""
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
    """Let a relative path in the tables start at another folder."""
    table: Any = tables
    for key in path[:-1]:
        table = table.get(key) if isinstance(table, Mapping) else None
    name = table.get(path[-1]) if isinstance(table, Mapping) else None
    if not isinstance(name, str) or Path(name).is_absolute():
        return
    if path != ("robot", "source") or is_path(name):
        table[path[-1]] = os.path.relpath((source_folder / name).absolute(), folder.absolute())


def _words(names: Sequence[str]) -> str | list[str]:
    """Return one of the words, or a list of names."""
    return names[0] if len(names) == 1 else list(names)
