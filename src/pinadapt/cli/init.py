"""``pinadapt init``: a scenario file for any robot."""

from __future__ import annotations

import re
import shlex
import warnings
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from itertools import compress

from .._output import write_text
from ..robot.loading import limbs
from ..scenario.scenario import Scenario
from ..scenario.template import Template, scenario_text
from .command_line import add_arguments_of, add_description, add_out_file, given, names, new_file

_CHOICES = {
    "frame": {"type": names, "action": "extend"},
    "contacts": {"type": names, "action": "extend"},
    "task": str,
    "tracker": bool,
}
_FOOT = re.compile(r"foot|sole|toe|ankle|contact")  # in names of ends of legs


def init_arguments(parser: ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "source",
        metavar="ROBOT",
        help="URDF, xacro or MJCF file, a name from `pinadapt robots`, or a name from the package "
        "robot_descriptions",
    )
    add_arguments_of(parser, Template, _CHOICES)
    add_description(parser)
    add_out_file(parser, "the robot's name and .toml")


def init(options: Namespace) -> int:
    """Write a scenario for a robot description or a robot's name, ready to run, and check it.

    Raises:
        InputError: the file exists and --force is not given, or the robot cannot be used.
    """
    template = Template(
        options.source,
        xacro=dict(options.xacro),
        **given(options, (*_CHOICES, "mass")),
    )
    file = new_file(options, template.name)
    write_text(file, scenario_text(template, file.parent))
    robot = template.robot
    found = limbs(robot)
    if len(found) > 1 and not (template.whole or robot.contacts or len(robot.frames) > 1):
        print(f"An arm or leg of {len(found)}. For the whole robot:")
        for command in _commands(options, found):
            print(f"  {command}")
    ends = [contact.frame for contact in robot.contacts] or robot.frames
    which = "the whole robot" if template.whole else f"to {', '.join(ends)}"
    print(f"{file}: {robot.model.nv} joints, {which}, task {template.task or robot.task.name}.")
    if robot.locked:
        print(f"Controlled: {', '.join(compress(robot.joint_names, robot.motors))}.")
        print(f"Not controlled: {', '.join(robot.locked)}. All joints: --task joint.")
    for finding in Scenario.read(file).findings():
        warnings.warn(finding, stacklevel=1)
    print(f"\npinadapt run {file}")
    return 0


def _commands(options: Namespace, limbs: list[str]) -> Iterator[str]:
    """Yield commands that take all joints, the ends of all arms, and all feet, of which three hold.

    They write the same file as the command with these options.
    """
    kept = [f"--xacro={name}={value}" for name, value in options.xacro]
    kept += [f"--{name}={value}" for name, value in given(options, ("mass", "out")).items()]
    feet = [end for end in limbs if _FOOT.search(end.lower())]
    arms = [end for end in limbs if end not in feet]
    for option, chosen, least in (
        ("--task", ["joint"], 1),
        ("--frame", arms, 2),
        ("--contacts", feet, 3),
    ):
        if len(chosen) >= least:
            words = ["pinadapt", "init", options.source, option, ",".join(chosen)]
            yield shlex.join([*words, *kept, "--force"])
