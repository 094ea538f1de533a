"""``pinadapt tune``: gains by search over a distribution of cases, compared with the defaults."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from .._output import write_json
from ..sweep.cases import Plan
from ..sweep.tune import tune as search
from .command_line import (
    Exit,
    add_arguments_of,
    add_out,
    add_processes,
    add_scenario,
    assignment,
    given,
    out_folder,
)

FILE = "tune.json"
_SEARCH = {"trials": int, "validation": int, "objective": str, "share": float}


def tune_arguments(parser: ArgumentParser) -> None:
    """Add the command's arguments."""
    add_scenario(parser)
    parser.epilog = (
        "The file is a sweep file, or a scenario with --vary: the cases over which gains are "
        "judged. Each trial runs all of them."
    )
    parser.add_argument(
        "--gain",
        nargs="+",
        action="extend",
        type=assignment,
        required=True,
        metavar="KEY=RANGE",
        help="what is searched: controller.alpha=loguniform(5, 100), uniform(a, b), choice([...])",
    )
    parser.add_argument("--vary", nargs="+", action="extend", default=[], metavar="KEY=VALUES")
    add_arguments_of(parser, search, {"samples": int, **_SEARCH})
    add_processes(parser)
    add_out(parser, "out/ and the file's name and -tune")


def tune(options: Namespace) -> int:
    """Search gains, validate them on other seeds, and say whether the defaults are as good.

    Writes ``tune.json`` with all trials.
    """
    plan = Plan.read(options.scenario, options.vary, options.set, samples=options.samples)
    folder = out_folder(options, f"{options.scenario.stem}-tune", [FILE])
    found = search(
        plan,
        dict(options.gain),
        executor=options.processes,
        **given(options, _SEARCH),
    )
    write_json(folder / FILE, found.numbers)
    print(f"{found}\n\nwritten to {folder}")
    return Exit.DONE
