"""``pinadapt init``: a scenario file for any robot."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..exceptions import InputError
from ..scenario.template import Template
from ..scenario.template_text import scenario_text


def init(options: argparse.Namespace) -> int:
    """Write a scenario that runs as it is for any description or name of a robot.

    Raises:
        InputError: the file exists and is not to be overwritten, or the robot cannot be used.
    """
    template = Template.of(
        options.source,
        frame=options.frame,
        task=options.task,
        xacro=dict(options.xacro),
        mass=options.mass,
    )
    file = options.out or Path(f"{template.name}.toml")
    if file.exists() and not options.force:
        raise InputError(
            "exists already.",
            where=str(file),
            hint="--force overwrites it, --out FILE takes another name.",
        )
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(scenario_text(template, file.parent), encoding="utf-8")
    robot, circle = template.robot, template.circle
    print(f"{file}: {robot.model.nv} joints to '{robot.frame}', task {robot.task.name}, ", end="")
    print(f"a circle of radius {circle.radius} m in {circle.period} s.\n\npinadapt run {file}")
    return 0
