"""``pinadapt compare`` and ``demo``: several runs, one table."""

from __future__ import annotations

import warnings
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable
from pathlib import Path

from .._output import one_run, write_json
from ..description.catalogue import robots_folder
from ..exceptions import UnusedGainWarning
from ..laws import LAWS
from ..plots.figures import overlay_figure
from ..rollout.rollout import Rollout
from ..scenario.comparison import (
    NOT_ADAPTED,
    comparison_table,
    run_beside,
    under_laws,
)
from ..scenario.scenario import Scenario
from .command_line import Exit, add_out, add_scenario, names, out_folder
from .run import RUN_FILES, status_of, write_run

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
    with one_run(folder, _FILES, partly=False) as beside:
        pairs = ((beside / law, scenario, None) for law, scenario in scenarios.items())
        rollouts = _run_all(pairs, html=False)
        (beside / FIGURE).write_bytes(overlay_figure(rollouts).png(dpi=130))
        write_json(beside / TABLE, [rollout.summary() for rollout in rollouts])
    print(f"\nwritten to {folder}")
    return Exit.DONE if rollouts[-1].interrupted is None else Exit.INTERRUPTED


def _run_all(
    pairs: Iterable[tuple[Path, Scenario, Scenario | None]], *, html: bool
) -> list[Rollout]:
    """Run scenarios, each into its folder, beside those without adaptation; print one table.

    It ends with the first that is interrupted.
    """
    rollouts = []
    try:
        for folder, scenario, without in pairs:
            rollouts.append(run_beside(scenario, without))
            write_run(rollouts[-1], folder, html=html)
            if rollouts[-1].interrupted is not None:
                break
    finally:
        if rollouts:
            print(comparison_table(rollouts))
    return rollouts


# The demo

# folder and scenario file
SHOWCASE = {
    "planar": "planar_2r/wang_xie_2009.toml",
    "panda": "panda/tool_and_load.toml",
}


def demo_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of ``demo``."""
    add_out(parser, "out/demo")


def demo(options: Namespace) -> int:
    """Run the showcases, print one table, write all outputs; return 3 if one diverged, else 0."""
    out = out_folder(options, "demo", [])
    pairs = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnusedGainWarning)  # of a run without adaptation
        for name, file in SHOWCASE.items():
            path = robots_folder() / file
            pairs.append((out / name, Scenario.read(path), Scenario.read(path, [NOT_ADAPTED])))
    rollouts = _run_all(pairs, html=True)
    print(f"\nplots and animations: {out}/*/error.png, parameters.png, torque.png, animation.html")
    return status_of(*rollouts)
