"""``pinadapt zoo``: the robots of the catalogue with default gains, adapted and not."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from contextlib import suppress

from .._output import Record, records_table, write_json
from ..description.catalogue import catalogue
from ..simulation.simulate import watched
from ..tasks.task import DISPLAYS
from ..zoo.experiment import CONVERGED, POSE, POSITION, run_zoo
from .command_line import Exit, add_arguments_of, add_out, add_processes, names, out_folder

TABLE = "zoo.json"


def zoo_arguments(parser: ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "--robots",
        type=names,
        metavar="A,B",
        help="names from `pinadapt robots` (default: all that fit)",
    )
    add_arguments_of(parser, run_zoo, {"task": (POSITION, POSE)})
    add_processes(parser)
    add_out(parser, "out/zoo")


def zoo(options: Namespace) -> int:
    """Run the zoo, print one table and write ``zoo.json``; a failure is a row of the table."""
    task = options.task or POSITION
    least = 6 if task == POSE else 0  # position and orientation
    fit = [name for name, entry in catalogue().items() if entry.joints >= least]
    names = options.robots or fit
    folder = out_folder(options, "zoo", [TABLE])
    coming = run_zoo(names, options.processes, task)
    rows = []
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
    degrees = DISPLAYS["rad"].scale
    columns = {
        "radius [m]": ("radius", 1.0, 3),
        "unadapted [mm]": ("unadapted", 1e3, 3),
        "adapted [mm]": ("adapted", 1e3, 3),
        "unadapted [deg]": ("unadapted_angle", degrees, 3),
        "adapted [deg]": ("adapted_angle", degrees, 3),
        "min eig M_hat": ("min_eig_M_hat", 1.0, 5),
        "min sing J_hat": ("min_singular_J_hat", 1.0, 5),
    }
    return str(records_table(rows, ("robot", "joints"), columns))
