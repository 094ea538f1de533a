"""``pinadapt sweep``: a scenario or a function with many values, on all cores, as one table."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from .._checks import whole
from ..exceptions import InputError
from ..sweep.cases import COPY, METHODS, Plan
from ..sweep.execution import claimed, run_plan, scenario_of, work_of
from ..sweep.table import CaseTable, read
from .command_line import Exit, add_arguments_of, add_out, add_processes, add_scenario, given
from .run import run_into

_OWN = {
    "samples": int,
    "repeat": int,
    "method": METHODS,
    "seed": int,
    "timeout": float,
    "success": str,
}


def sweep_arguments(parser: ArgumentParser) -> None:
    """Add the command's arguments."""
    add_scenario(parser)
    parser.epilog = (
        "The file is a scenario, a sweep file, or the folder of a sweep. Values: 1.0,2.0 or a,b, "
        "lin(0.5, 2, 16), log(1, 100, 9), uniform(0.5, 2), loguniform(1, 100), normal(1, 0.1), "
        "choice([...]); KEY.* has one number for each joint."
    )
    parser.add_argument(
        "--vary",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=VALUES",
        help="a dotted key of the scenario and its values; several keys are combined",
    )
    add_arguments_of(parser, Plan, _OWN)
    add_processes(parser)
    parser.add_argument(
        "--column", default="", metavar="NAME", help="the result in ranking and figures"
    )
    parser.add_argument("--resume", action="store_true", help="run the cases that are missing")
    parser.add_argument(
        "--retry",
        action="store_true",
        help="with --resume, run what crashed, failed or took too long again",
    )
    parser.add_argument("--case", type=int, metavar="N", help="run one case alone")
    parser.add_argument("--force", action="store_true", help="remove another sweep in the folder")
    add_out(parser, "out/ and the file's name and -sweep")


def sweep(options: Namespace) -> int:
    """Run the cases of a sweep, print its report and write table, figures and page.

    A folder in place of a file: with ``--resume`` its missing cases are run, with ``--case`` one of
    them alone, else its report is made anew.
    """
    from ..sweep.sweep_report import PAGE, SweepReport  # here, because matplotlib is slow to import

    plan, folder = _plan(options)
    if options.case is not None:
        return _alone(plan, options.case, folder)
    again = options.resume or options.retry
    reported = options.scenario.is_dir() and not again
    if not reported:
        claimed(folder, plan, resume=again, anew=options.force)
    try:
        if reported:
            table = read(folder)
        else:
            table = run_plan(plan, options.processes, folder, retry=options.retry)
    except KeyboardInterrupt:
        print(
            f"pinadapt: interrupted; {len(read(folder))} of {len(plan.cases)} cases are kept. "
            f"Go on: pinadapt sweep {folder} --resume",
            file=sys.stderr,
        )
        return Exit.INTERRUPTED
    if not len(table):
        print(f"no case has run; go on: pinadapt sweep {folder} --resume")
        return Exit.DONE
    report = SweepReport(table, plan, options.column, folder)
    report.save(folder)
    if not reported:
        plan.save(folder)
    print(f"{report}\n\nwritten to {folder}, see {folder / PAGE}")
    return Exit.DONE


def _plan(options: Namespace) -> tuple[Plan, Path]:
    """Return the sweep and its folder.

    Raises:
        InputError: a folder holds no sweep, or something is varied that the folder has fixed.
    """
    path = options.scenario
    if not path.is_dir():
        return (
            Plan.read(path, options.vary, options.set, **given(options, _OWN)),
            options.out or Path("out") / f"{path.stem}-sweep",
        )
    fixed = [name for name, value in given(options, (*_OWN, "vary", "set")).items() if value != []]
    if fixed:
        raise InputError(
            f"{', '.join(fixed)}: the folder holds a sweep, which says this.",
            where=path,
            hint=f"Change a copy of {path / COPY} and run that in another folder.",
        )
    return Plan.load(path), path


def _alone(plan: Plan, number: int, folder: Path) -> int:
    """Run one case in this process: of a scenario with all outputs, of a function with its row."""
    case = plan.cases[whole(number, "--case", 0, most=len(plan.cases) - 1)]
    for key, value in case.values.items():
        print(f"{key} = {value}")
    if plan.scenario is None:
        print(CaseTable([{"case": number, "seed": case.seed, **work_of(plan)(case)}]))
        return Exit.DONE
    return run_into(folder / f"case-{number}", scenario_of(plan.scenario, plan.folder, case))
