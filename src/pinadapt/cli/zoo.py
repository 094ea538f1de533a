"""``pinadapt zoo``: the robots of the catalogue with default gains, adapted and not."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from .._output import Record, check_writable, records_table, write_json
from ..description.catalogue import catalogue, catalogue_entry
from ..simulation.simulate import watched
from ..zoo.experiment import CONVERGED, run_zoo
from .command_line import Exit, add_out, add_processes, names

TABLE = "zoo.json"


def arguments(parser: ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "--robots", type=names, metavar="A,B", help="names from `pinadapt robots` (default: all)"
    )
    add_processes(parser)
    add_out(parser, Path("out/zoo"))


def zoo(options: Namespace) -> int:
    """Run the zoo, print one table and write ``zoo.json``; a failure is a row of the table."""
    names = [catalogue_entry(name).name for name in options.robots or catalogue()]
    folder: Path = options.out
    check_writable(folder)
    coming = run_zoo(names, options.processes)
    rows: list[Record] = []
    with suppress(KeyboardInterrupt):
        for row, _ in zip(coming, watched(range(len(names)), None, "zoo"), strict=False):
            rows.append(row)
    rows.sort(key=lambda row: names.index(row["robot"]))
    write_json(folder / TABLE, rows)
    converged = sum(row["verdict"] == CONVERGED for row in rows)
    print(zoo_table(rows))
    print(f"\n{converged} of {len(names)} converged; written to {folder / TABLE}")
    return Exit.DONE if len(rows) == len(names) else Exit.INTERRUPTED


def zoo_table(rows: Sequence[Record]) -> str:
    """Return a row for each robot; errors are the largest of the last 10 % of the duration."""
    columns = {
        "radius [m]": ("radius", 1.0, 3),
        "unadapted [mm]": ("unadapted", 1e3, 3),
        "adapted [mm]": ("adapted", 1e3, 3),
        "min eig M_hat": ("min_eig_M_hat", 1.0, 5),
        "min sing J_hat": ("min_singular_J_hat", 1.0, 5),
    }
    return str(records_table(rows, {"robot": "robot", "joints": "joints"}, columns, "verdict"))
