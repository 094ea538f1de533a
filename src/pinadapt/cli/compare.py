"""``pinadapt compare``: several runs, one table."""

from __future__ import annotations

import warnings
from argparse import ArgumentParser, Namespace

from .._output import one_run, write_json
from ..laws import LAWS
from ..plots.figures import overlay_figure
from ..rollout.rollout import Rollout
from ..scenario.comparison import comparison_table, run_scenario, under_laws
from .command_line import Exit, add_out, add_scenario, names, out_folder
from .run import RUN_FILES, write_run

TABLE, FIGURE = "compare.json", "compare.png"
_FILES = [*(f"{law}/{name}" for law in LAWS for name in RUN_FILES), FIGURE, TABLE]


def compare_arguments(parser: ArgumentParser) -> None:
    """Add the command's arguments."""
    add_scenario(parser)
    add_out(parser, "out/ and the scenario's name and -compare")
    parser.add_argument(
        "--laws",
        type=names,
        metavar="A,B",
        help=f"names among {', '.join(LAWS)} (default: all that fit the task)",
    )


def compare(options: Namespace) -> int:
    """Run a scenario under several laws, print one table, write outputs, table and one figure.

    The table is ``compare.json``, the figure with the errors of all laws ``compare.png``. Files of
    an earlier comparison stay until those of this one are complete. A law that diverges is a row
    of the table, not a failure of the command.
    """
    folder = out_folder(options, f"{options.scenario.stem}-compare", _FILES)
    scenarios = under_laws(options.scenario, options.laws, options.set)
    for law, scenario in scenarios.items():
        for finding in scenario.findings():
            warnings.warn(f"{law}: {finding}", stacklevel=1)
    rollouts: list[Rollout] = []
    with one_run(folder, _FILES, partly=False) as beside:
        try:
            for law, scenario in scenarios.items():
                rollouts.append(run_scenario(scenario))
                write_run(rollouts[-1], beside / law, html=False)
                if rollouts[-1].interrupted is not None:
                    break
        finally:
            if rollouts:
                print(comparison_table(rollouts))
        (beside / FIGURE).write_bytes(overlay_figure(rollouts).png(dpi=130))
        write_json(beside / TABLE, [rollout.summary() for rollout in rollouts])
    print(f"\nwritten to {folder}")
    return Exit.DONE if rollouts[-1].interrupted is None else Exit.INTERRUPTED
