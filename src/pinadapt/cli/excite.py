"""``pinadapt excite``: a motion that tells unknown parameters apart."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .._files import check_writable, read_toml, write_text
from ..description.urdf import is_path
from ..exceptions import InputError
from ..excitation.exciting_motion import ExcitingMotion
from ..excitation.search import excite as find
from ..models.translations import BASE, TOOL
from ..robot.loading import load
from ..robot.robot import Robot
from ..scenario.exciting_scenario import exciting_tables, exciting_text, scenario_of_robot
from ..scenario.scenario import Scenario
from ..scenario.validation import check_tables
from .outputs import warn_of_findings

_SCENARIO = ".toml"


def excite(options: argparse.Namespace) -> int:
    """Find an exciting motion for a robot or a scenario, print it, and write a scenario of it.

    Raises:
        InputError: the file exists and is not to be overwritten, or no such motion can be found.
    """
    source = str(options.source)
    out = options.out or Path(f"{_name(source)}_excited{_SCENARIO}")
    if out.exists() and not options.force:
        raise InputError(
            "exists already.",
            where=str(out),
            hint="--force overwrites it, --out FILE takes another name.",
        )
    check_writable(out.parent, [out.name])
    tables, motion = _of_scenario(options) if _is_scenario(source) else _of_robot(options)
    print(motion)
    folder = Path(source).parent if _is_scenario(source) else Path()
    tables = exciting_tables(tables, motion, folder, out.parent)
    scenario = Scenario.build(check_tables(tables, str(out)), out.parent)
    write_text(out, exciting_text(tables))
    warn_of_findings(scenario)
    print(f"\npinadapt run {out}")
    return 0


def _of_scenario(options: argparse.Namespace) -> tuple[dict[str, Any], ExcitingMotion]:
    """Return the tables of a scenario, and a motion for what is unknown in it."""
    if options.unknown or options.joint:
        raise InputError(
            "the table [unknown] of the scenario says what is unknown.",
            where="--unknown" if options.unknown else "--joint",
        )
    path = Path(options.source)
    return read_toml(path), find(Scenario.read(path).controller, **_found(options))


def _of_robot(options: argparse.Namespace) -> tuple[dict[str, Any], ExcitingMotion]:
    """Return the tables of a scenario of a robot, and a motion for what is said to be unknown."""
    robot: Robot = load(options.source, frame=options.frame)
    unknown, joint = options.unknown or ["all"], options.joint or ["all"]
    kinematic = [name for name in unknown if name in (TOOL, BASE)]
    dynamic = [name for name in unknown if name not in kinematic] or ["none"]
    motion = find(
        robot,
        dynamic=_words(dynamic),
        joint=_words(joint),
        kinematic=kinematic,
        **_found(options),
    )
    return scenario_of_robot(options.source, robot, dynamic, joint), motion


def _found(options: argparse.Namespace) -> dict[str, Any]:
    """Return how to find it."""
    return {
        "duration": options.duration,
        "excursion": options.excursion,
        "load": options.load,
        "seed": options.seed,
    }


def _words(names: list[str]) -> str | list[str]:
    return names[0] if len(names) == 1 else names


def _is_scenario(source: str) -> bool:
    return source.endswith(_SCENARIO)


def _name(source: str) -> str:
    """Return what a robot or a scenario is called."""
    return Path(source.removesuffix(".xacro")).stem if is_path(source) else source
