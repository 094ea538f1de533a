"""``pinadapt demo``: two showcases with reports and animations."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..adaptation.adaptation import Frozen
from ..description.catalogue import robots_folder
from ..exceptions import UnusedGainWarning
from ..rollout.rollout import Rollout
from ..scenario.scenario import Scenario
from .arguments import add_out
from .command_line import interrupted, status_of
from .compare import comparison_table
from .outputs import check_place, run_scenario, write_run

_GRADIENT = ('controller.adaptation="gradient"', "controller.gamma_d=[4.5, 1.5, 1.5]")
_PLANAR, _PANDA = "planar_2r/wang_xie_2009.toml", "panda/tool_and_load.toml"

# folder, scenario file, settings
SHOWCASE: tuple[tuple[str, str, Sequence[str]], ...] = (
    (
        "planar_known",
        _PLANAR,
        (
            'title="planar arm, known"',
            'controller.law="resolved-acceleration"',
            "belief.kinematic=[1.0, 1.2]",
            "belief.dynamic=[3.34, 1.2, 0.97]",
        ),
    ),
    (
        "planar_improved",
        _PLANAR,
        (
            'title="planar arm, improved law"',
            'controller.law="adaptive-inverse-dynamics-improved"',
            *_GRADIENT,
        ),
    ),
    (
        "planar_passivity_based",
        _PLANAR,
        ('title="planar arm, passivity based"', 'controller.law="adaptive-jacobian"', *_GRADIENT),
    ),
    ("panda_unadapted", _PANDA, ('title="panda, unadapted"', 'controller.adaptation="none"')),
    ("panda_adaptive", _PANDA, ('title="panda, unknown tool and load"',)),
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_out(parser, Path("out/demo"))


def demo(options: argparse.Namespace) -> int:
    """Run the showcases, print one table, write all outputs; return 3 if one diverged, else 0."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnusedGainWarning)  # all laws use the gains of one file
        scenarios = [Scenario.read(robots_folder() / file, given) for _, file, given in SHOWCASE]
    folders = [check_place(options.out / name) for name, _, _ in SHOWCASE]
    rollouts: list[Rollout] = []
    unadapted: dict[tuple[str, str], float | None] = {}  # (file, law) -> last error
    try:
        for scenario, folder, (_, file, _) in zip(scenarios, folders, SHOWCASE, strict=True):
            rollout = run_scenario(scenario)
            loop = file, rollout.law
            if rollout.adaptation == Frozen.name:
                unadapted[loop] = rollout.summary()["max_error_last"]
            else:
                rollout = replace(rollout, unadapted=unadapted.get(loop))
            rollouts.append(rollout)
            write_run(rollout, folder, html=True)
            if interrupted(rollouts):
                break
    finally:
        print(comparison_table(rollouts))
    print(
        f"\nplots and animations: {options.out}/*/"
        "error.png, parameters.png, torque.png, animation.html"
    )
    return status_of(*rollouts)
