"""``pinadapt robots``: the catalogue."""

from __future__ import annotations

import argparse

from ..exceptions import RobotError
from ..robot import CatalogueEntry, catalogue, load
from ..rollout.table import columns


def robots(options: argparse.Namespace) -> int:
    """Print every robot of the catalogue: name, joints, frame, where it comes from."""
    print(columns(("name", "joints", "task", "frame", "from", "about"), [_row(entry) for entry in catalogue().values()]))
    return 0


def _row(entry: CatalogueEntry) -> list[str]:
    try:
        joints = str(load(entry.name).model.nv)
    except RobotError as error:
        joints = f"({error.what})"
    source = "pinadapt" if entry.path else f"example-robot-data {entry.origin}"
    return [entry.name, joints, entry.task, entry.frame, source, entry.about]
