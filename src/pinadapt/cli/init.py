"""``pinadapt init``: a scenario file for any robot."""

from __future__ import annotations

import warnings
from argparse import ArgumentParser, Namespace
from pathlib import Path

from .._output import write_text
from ..scenario.scenario import Scenario
from ..scenario.template import Template, scenario_text
from .command_line import add_arguments_of, add_description, add_out_file, check_new, given, names

_CHOICES = {
    "frame": {"type": names, "action": "extend"},
    "contacts": {"type": names, "action": "extend"},
    "task": str,
    "tracker": bool,
}


def arguments(parser: ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "source",
        metavar="ROBOT",
        help="URDF, xacro or MJCF file, a name from `pinadapt robots`, or a name from the package "
        "robot_descriptions",
    )
    add_arguments_of(parser, Template.of, _CHOICES)
    add_description(parser)
    add_out_file(parser, "the robot's name and .toml")


def init(options: Namespace) -> int:
    """Write a scenario for a robot description or a robot's name, ready to run, and check it.

    Raises:
        InputError: the file exists and --force is not given, or the robot cannot be used.
    """
    template = Template.of(
        options.source,
        xacro=dict(options.xacro),
        **given(options, (*_CHOICES, "mass")),
    )
    file = options.out or Path(f"{template.name}.toml")
    check_new(file, force=options.force)
    write_text(file, scenario_text(template, file.parent))
    robot, task = template.robot, template.task
    ends = [contact.frame for contact in robot.contacts] or robot.frames
    which = "the whole robot" if template.whole else f"to {', '.join(ends)}"
    print(f"{file}: {robot.model.nv} joints, {which}, task {task}.")
    if robot.locked:
        print(
            f"Not controlled: {', '.join(robot.locked)}. All joints: --task joint; several ends: "
            "--frame A,B; feet to stand on: --contacts A,B,C."
        )
    for finding in Scenario.read(file).findings():
        warnings.warn(finding, stacklevel=1)
    print(f"\npinadapt run {file}")
    return 0
