"""``pinadapt excite``: a motion that excites unknown parameters."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

import tomlkit

from .._output import read_toml, write_text
from ..description.urdf import is_path
from ..exceptions import InputError
from ..excitation.exciting_motion import ExcitingMotion
from ..excitation.exciting_motion import excite as find
from ..robot.loading import load
from ..scenario.scenario import Scenario
from ..scenario.tables import Tables, at_folder, parts
from ..scenario.template import significant
from ..tuning.unknowns import Unknown
from .command_line import (
    SCENARIO,
    add_arguments_of,
    add_out_file,
    check_new,
    given,
    names,
    one_word,
)
from .init import warn_of_findings

_SEARCH = {
    **dict.fromkeys(("duration", "excursion", "load", "floor"), float),
    "srdf": Path,
    "seed": int,
}


def arguments(parser: ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "source",
        metavar="ROBOT|SCENARIO.toml",
        help="a robot as for `init`, or a scenario with its robot and its table [unknown]",
    )
    parser.add_argument(
        "--unknown",
        type=names,
        metavar="A,B",
        help="unknown bodies: all, payload (the last body), none or joint names (default: all)",
    )
    parser.add_argument(
        "--joint",
        type=names,
        metavar="A,B",
        help="unknown joint coefficients: armature, viscous, coulomb, all or none (default: all)",
    )
    add_arguments_of(parser, load, {"frame": str})
    add_arguments_of(parser, find, _SEARCH)
    add_out_file(parser, "the robot's name and _excited.toml")


def excite(options: Namespace) -> int:
    """Find an exciting motion for a robot or a scenario, print it and write a scenario with it.

    Raises:
        InputError: the file exists and --force is not given, or no motion was found.
    """
    source = str(options.source)
    name = Path(source.removesuffix(".xacro")).stem if is_path(source) else source
    out = options.out or Path(f"{name}_excited{SCENARIO}")
    check_new(out, force=options.force)
    found, folder = _of_robot, Path()
    if source.endswith(SCENARIO):
        found, folder = _of_scenario, Path(source).parent
    tables, motion = found(options)
    print(motion)
    tables = exciting_tables(at_folder(tables, folder.absolute()), motion)
    scenario = Scenario.build(tables, out.parent)
    write_text(out, f"# {_HEADER}\n{tomlkit.dumps(tables)}")
    warn_of_findings(scenario)
    print(f"\npinadapt run {out}")
    return 0


def _of_scenario(options: Namespace) -> tuple[Tables, ExcitingMotion]:
    """Return the tables of a scenario and a motion for its unknown parameters."""
    if options.unknown or options.joint:
        raise InputError(
            "the table [unknown] of the scenario says what is unknown.",
            where="--unknown" if options.unknown else "--joint",
        )
    path = Path(options.source)
    scenario = Scenario.read(path)
    unknown = parts(scenario.tables)["unknown"]
    return read_toml(path), find(scenario.estimated, unknown=unknown, **given(options, _SEARCH))


def _of_robot(options: Namespace) -> tuple[Tables, ExcitingMotion]:
    """Return tables of a scenario for a robot and a motion for the given unknown parameters."""
    robot = load(options.source, frame=options.frame)
    bodies, joint = one_word(options.unknown) or "all", one_word(options.joint) or "all"
    unknown = Unknown(tool=False, bodies=bodies).with_names(joint=joint)
    tables = {
        "title": f"{robot.name}, an exciting motion",
        "robot": {
            "source": options.source,
            "frame": robot.frame,
            "q0": significant(robot.home_angles, digits=12),
        },
        "unknown": {
            "bodies": unknown.bodies,
            "friction": unknown.friction,
            "armature": unknown.armature,
            "effects": list(unknown.effects),
        },
    }
    return tables, find(robot, unknown=unknown, **given(options, _SEARCH))


_OF_TRANSLATIONS = (
    ("unknown", ("tool", "base", "tracker", "geometry", "translations", "lengths")),
    ("limits", ("box",)),
    ("start", ("a_k",)),
    ("model", ("learned",)),
    ("controller", ("gamma_k",)),
)
_HEADER = "A motion that excites the unknown parameters, found by `pinadapt excite`."


def exciting_tables(tables: Tables, motion: ExcitingMotion) -> Tables:
    """Return the tables of a scenario with joints that follow a motion.

    Task, motion and duration are replaced. Keys of unknown translations are removed, as these do
    not influence the joints. Everything else stays.
    """
    whole = dict(tables)
    for section, keys in _OF_TRANSLATIONS:
        for key in keys:
            whole.get(section, {}).pop(key, None)
    whole["robot"]["task"] = "joint"
    whole["trajectory"] = motion.reference()
    whole["simulation"] = {**whole.get("simulation", {}), "duration": motion.duration}
    return whole
