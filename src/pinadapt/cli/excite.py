"""``pinadapt excite``: a motion that excites unknown parameters."""

from __future__ import annotations

import warnings
from argparse import ArgumentParser, Namespace
from pathlib import Path

import tomlkit

from .._output import write_text
from ..description.urdf import is_path
from ..excitation.exciting_motion import excite as find
from ..robot.loading import load
from ..scenario.scenario import Scenario
from ..scenario.template import Template, significant
from ..tuning.unknowns import Unknown
from .command_line import (
    add_arguments_of,
    add_out_file,
    given,
    new_file,
    word_or_names,
)

_SEARCH = {
    "duration": float,
    "excursion": float,
    "load": float,
    "floor": float,
    "srdf": Path,
    "seed": int,
}
_HEADER = "A motion that excites the unknown parameters, found by `pinadapt excite`."


def excite_arguments(parser: ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("source", metavar="ROBOT", help="a robot as for `init`")
    parser.add_argument(
        "--unknown",
        type=word_or_names,
        metavar="A,B",
        help="unknown bodies: all, payload (the last body), none or joint names (default: all)",
    )
    parser.add_argument(
        "--joint",
        type=word_or_names,
        metavar="A,B",
        help="unknown joint coefficients: armature, viscous, coulomb, all or none (default: all)",
    )
    add_arguments_of(parser, load, {"frame": str})
    add_arguments_of(parser, find, _SEARCH)
    add_out_file(parser, "the robot's name and _excited.toml")


def excite(options: Namespace) -> int:
    """Find an exciting motion for a robot, print it and write a scenario with it.

    Raises:
        InputError: the file exists and --force is not given, or no motion was found.
    """
    source = options.source
    out = new_file(options, f"{Template(source).name}_excited")
    robot = load(source, frame=options.frame)
    unknown = Unknown(tool=False).with_names(
        dynamic=options.unknown or "all", joint=options.joint or "all"
    )
    motion = find(robot, unknown=unknown, **given(options, _SEARCH))
    print(motion)
    tables = {
        "title": f"{robot.name}, an exciting motion",
        "robot": {
            "source": str(Path(source).absolute()) if is_path(source) else source,
            "task": "joint",
            "frame": robot.frame,
            "q0": significant(robot.home_angles, digits=12),
        },
        "unknown": {
            "bodies": unknown.bodies,
            "friction": unknown.friction,
            "armature": unknown.armature,
            "effects": list(unknown.effects),
        },
        "trajectory": motion.reference(),
        "simulation": {"duration": motion.duration},
    }
    scenario = Scenario.build(tables, out.parent)
    write_text(out, f"# {_HEADER}\n{tomlkit.dumps(tables)}")
    for finding in scenario.findings():
        warnings.warn(finding, stacklevel=1)
    print(f"\npinadapt run {out}")
    return 0
