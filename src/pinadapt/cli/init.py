"""``pinadapt init``: a scenario file for any robot."""

from __future__ import annotations

import argparse
from pathlib import Path

from .._files import check_writable, write_text
from ..exceptions import InputError
from ..scenario.scenario import Scenario
from ..scenario.template import Template, scenario_text
from .outputs import warn_of_findings


def init(options: argparse.Namespace) -> int:
    """Write a scenario that runs as it is for any description or name of a robot, and check it.

    Raises:
        InputError: the file exists and is not to be overwritten, or the robot cannot be used.
    """
    template = Template.of(
        options.source,
        frame=options.frame,
        task=options.task,
        xacro=dict(options.xacro),
        mass=options.mass,
        law=options.law,
    )
    file = options.out or Path(f"{template.name}.toml")
    if file.exists() and not options.force:
        raise InputError(
            "exists already.",
            where=str(file),
            hint="--force overwrites it, --out FILE takes another name.",
        )
    check_writable(file.parent, [file.name])
    write_text(file, scenario_text(template, file.parent))
    robot, circle = template.robot, template.circle
    print(f"{file}: {robot.model.nv} joints to '{robot.frame}', task {robot.task.name}, ", end="")
    way = f"a circle of radius {circle.radius} m in {circle.period} s"
    print(f"{'to a set point' if template.rests else way}.")
    warn_of_findings(Scenario.read(file))
    print(f"\npinadapt run {file}")
    return 0
