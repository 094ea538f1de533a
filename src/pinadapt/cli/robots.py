"""``pinadapt robots``: the catalogue."""

from __future__ import annotations

import argparse

from .._output import columns
from ..description.catalogue import CatalogueEntry, catalogue


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the command has no arguments."""


def robots(options: argparse.Namespace) -> int:
    """Print the catalogue: name, number of joints, task, frame, source of the model, remark."""
    print(
        columns(
            ("name", "joints", "task", "frame", "from", "about"),
            [_row(entry) for entry in catalogue().values()],
        )
    )
    return 0


def _row(entry: CatalogueEntry) -> list[str]:
    source = "pinadapt" if entry.path else entry.origin
    return [entry.name, str(entry.joints), entry.task, entry.frame, source, entry.about]
