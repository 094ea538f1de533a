"""``pinadapt init``: a scenario file for any robot."""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

from .._output import write_text
from ..laws import DEFAULT, LAWS
from ..scenario.scenario import Scenario
from ..scenario.template import Template, scenario_text
from .command_line import add_description, add_out_file, check_new


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "source",
        metavar="ROBOT",
        help="URDF, xacro or MJCF file, a name from `pinadapt robots`, or a name from the package "
        "robot_descriptions",
    )
    parser.add_argument(
        "--frame",
        action="append",
        default=[],
        metavar="LINK",
        help="task frame (default: the likeliest link at the robot's end); several, given again or "
        "with commas between, are moved by one controller",
    )
    parser.add_argument(
        "--task",
        metavar="TASK",
        help="xyz, xy, xz, yz, pose, image (of an uncalibrated camera) or joint (default: "
        "xyz, or a plane if the chain is planar)",
    )
    parser.add_argument(
        "--law",
        choices=[name for name, law in LAWS.items() if law.adapts],
        default=DEFAULT,
        metavar="NAME",
        help="an adaptive law: %(choices)s; those of joint space get the task joint (default: "
        "%(default)s)",
    )
    parser.add_argument(
        "--tracker",
        action="store_true",
        help="x is measured in the axes of an uncalibrated tracker",
    )
    add_description(parser)
    add_out_file(parser, "the robot's name and .toml")


def init(options: argparse.Namespace) -> int:
    """Write a scenario for a robot description or a robot's name, ready to run, and check it.

    Raises:
        InputError: the file exists and --force is not given, or the robot cannot be used.
    """
    frames = [name.strip() for given in options.frame for name in given.split(",")]
    template = Template.of(
        options.source,
        frames=frames,
        task=options.task,
        xacro=dict(options.xacro),
        mass=options.mass,
        law=options.law,
        tracker=options.tracker,
    )
    file = options.out or Path(f"{template.name}.toml")
    check_new(file, force=options.force)
    write_text(file, scenario_text(template, file.parent))
    robot, task = template.robot, template.task
    ends = "', '".join(robot.frames)
    which = "the whole robot" if template.whole else f"to '{ends}'"
    print(f"{file}: {robot.model.nv} joints, {which}, task {task}.")
    if robot.locked:
        print(f"Not controlled: {', '.join(robot.locked)}. All joints: --task joint.")
    warn_of_findings(Scenario.read(file))
    print(f"\npinadapt run {file}")
    return 0


def warn_of_findings(scenario: Scenario) -> None:
    """Warn of what the pre-run check finds in a scenario, or say that it passed."""
    found = scenario.findings()
    for finding in found:
        warnings.warn(finding, stacklevel=2)
    if not found:
        law, dt = scenario.controller.law.name, scenario.engine.period(scenario.controller)
        print(f"Pre-run check passed: '{law}' is stable at {1e3 * dt:g} ms.")
