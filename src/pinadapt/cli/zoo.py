"""``pinadapt zoo``: the robots of the catalogue with default gains, adapted and not."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from .._output import check_writable, columns, number, write_text
from ..description.catalogue import catalogue_entry
from ..laws import DEFAULT, LAWS
from ..simulation.simulate import watched
from ..zoo.experiment import CONVERGED, POSE, ZooRow, run_zoo, zoo_names
from .command_line import DONE, INTERRUPTED, add_out, add_seed, names, not_negative

TABLE = "zoo.json"
_DEGREES = 180.0 / math.pi


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "--robots",
        type=names,
        metavar="A,B",
        help="names from `pinadapt robots` (default: all that fit the task)",
    )
    parser.add_argument(
        "--law",
        choices=[
            name
            for name, law in LAWS.items()
            if law.adapts and not (law.joint_space or law.set_point)
        ],
        default=DEFAULT,
        metavar="NAME",
        help="an adaptive law: %(choices)s (default: %(default)s)",
    )
    parser.add_argument(
        "--task",
        choices=("position", "pose"),
        default="position",
        help="position: a circle; pose: a circle with a swinging tool, for chains of six and more "
        "joints (default: %(default)s)",
    )
    add_seed(parser, "friction, tools and model errors")
    parser.add_argument(
        "--processes",
        type=not_negative,
        metavar="N",
        help="number of processes, 0 for none besides this one (default: one per core)",
    )
    add_out(parser, Path("out/zoo"))


def zoo(options: argparse.Namespace) -> int:
    """Run the zoo, print one table and write ``zoo.json``; a failure is a row of the table."""
    names = (
        [catalogue_entry(name).name for name in options.robots]
        if options.robots
        else zoo_names(options.task)
    )
    folder: Path = options.out
    check_writable(folder, [TABLE])
    coming = run_zoo(
        names, options.law, seed=options.seed, processes=options.processes, task=options.task
    )
    found: dict[str, ZooRow] = {}
    rows: list[ZooRow] = []
    status = DONE
    try:
        for row, _ in zip(coming, watched(range(len(names)), None, "zoo"), strict=False):
            found[row.robot] = row
            rows = [found[name] for name in names if name in found]
            text = json.dumps([asdict(row) for row in rows], indent=2) + "\n"
            write_text(folder / TABLE, text)
    except KeyboardInterrupt:
        status = INTERRUPTED
    finally:
        print(zoo_table(rows))
    converged = sum(row.verdict == CONVERGED for row in rows)
    written = f"; written to {folder / TABLE}" if rows else ""
    if len(rows) < len(names):
        written += f"; interrupted, {len(names) - len(rows)} have not run"
    print(f"\n{converged} of {len(rows)} converged{written}")
    return status


def zoo_table(rows: Sequence[ZooRow]) -> str:
    """Return a row for each robot; errors are the largest of the last 10 % of the duration."""
    pose = any(row.task == POSE for row in rows)
    header = (
        "robot",
        "joints",
        "radius [mm]",
        "not adapted [mm]",
        "adapted [mm]",
        "[% of radius]",
        *(["not adapted [deg]", "adapted [deg]"] if pose else []),
        "min eig M_hat [kg m^2]",
        "verdict",
    )
    return columns(header, [_cells(row, pose) for row in rows])


def _cells(row: ZooRow, pose: bool) -> list[str]:
    angles = [number(a, scale=_DEGREES, digits=3) for a in (row.unadapted_angle, row.adapted_angle)]
    share = None if row.adapted is None or row.radius is None else 100.0 * row.adapted / row.radius
    return [
        row.robot,
        "-" if row.joints is None else str(row.joints),
        number(row.radius, scale=1e3, digits=0),
        number(row.unadapted, scale=1e3, digits=2),
        number(row.adapted, scale=1e3, digits=3),
        number(share, digits=2),
        *(angles if pose else []),
        "-" if row.min_eig_M_hat is None else f"{row.min_eig_M_hat:.2g}",
        row.verdict,
    ]
