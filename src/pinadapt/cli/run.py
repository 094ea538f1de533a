"""``pinadapt run``, ``demo``, ``view`` and ``cite``: single scenarios, and the files of a run."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from .._output import check_writable, one_run
from ..citation import citation
from ..description.catalogue import robots_folder
from ..exceptions import InputError
from ..information.payload import PayloadEstimate
from ..rollout.rollout import Rollout
from ..rollout.summary import report_of
from ..scenario.comparison import run_beside, run_scenario, unadapted
from ..scenario.scenario import Scenario
from .command_line import Exit, add_out, add_scenario, add_settings, out_folder

RUN_FILES = (
    "rollout.npz",
    "error.png",
    "parameters.png",
    "torque.png",
    "animation.html",
    "learned.json",
    "learned.urdf",
    "summary.json",
)
# of ``demo``: folder and scenario file
SHOWCASE = {
    "planar": "planar_2r/wang_xie_2009.toml",
    "panda": "panda/tool_and_load.toml",
}


def run_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of ``run``."""
    add_scenario(parser)
    add_out(parser, "out/ and the scenario's name")
    parser.add_argument("--no-html", action="store_true", help="write no animation")
    parser.add_argument(
        "--live", action="store_true", help="show the run in a browser, at most in real time"
    )
    parser.add_argument(
        "--unadapted",
        action="store_true",
        help="run the same loop without adaptation as well and report its error",
    )


def run(options: Namespace) -> int:
    """Run a scenario as ``run_into`` does."""
    path = options.scenario
    return run_into(
        options.out or Path("out") / path.stem,
        Scenario.read(path, options.set),
        unadapted(path, options.set) if options.unadapted else None,
        html=not options.no_html,
        live=options.live,
    )


def run_into(
    folder: Path,
    scenario: Scenario,
    without: Scenario | None = None,
    *,
    html: bool = True,
    live: bool = False,
) -> int:
    """Run a scenario, write its outputs, print its table and, as the last line, its verdict.

    Return 3 if the loop diverged, 130 if it was interrupted, else 0.
    """
    check_writable(folder, RUN_FILES)
    rollout = run_beside(scenario, without, live=live)
    try:
        write_run(rollout, folder, html=html)
    finally:
        print(report_of(rollout, rollout.numbers))  # even if it could not be written
    if (load := _load(rollout)) is not None:
        print(f"\n{load}")
    print(f"\nwritten to {folder}\n\n{rollout.verdict}")
    return status_of(rollout)


def status_of(rollout: Rollout) -> int:
    """Return the exit status of a command that ran a rollout."""
    if rollout.interrupted is not None:
        return Exit.INTERRUPTED
    return Exit.DONE if rollout.diverged is None else Exit.DIVERGED


def _load(rollout: Rollout) -> PayloadEstimate | None:
    """Return the load that the run found; None if it identifies no mass, or none was unknown."""
    if rollout.diverged is not None or rollout.evaluated().controller.kinematics.constraints:
        return None
    try:
        found = rollout.payload(refined=True)
    except InputError:  # other parameters than those of the last body, or no sample
        return None
    return found if found.mass_known_to < abs(found.mass) else None


def demo_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of ``demo``."""
    add_out(parser, "out/demo")


def demo(options: Namespace) -> int:
    """Run the showcases with and without adaptation, up to one that does not reach its end."""
    out = out_folder(options, "demo", [])
    for name, file in SHOWCASE.items():
        path = robots_folder() / file
        status = run_into(out / name, Scenario.read(path), unadapted(path))
        if status != Exit.DONE:
            return status
    return Exit.DONE


def view_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of ``view``."""
    parser.add_argument(
        "scenario",
        type=Path,
        nargs="?",
        metavar="DIR|SCENARIO.toml",
        help="a folder that `pinadapt run` wrote, or a scenario to run and watch; nothing is "
        "written",
    )
    add_settings(parser)
    parser.add_argument(
        "--attach",
        type=int,
        metavar="PORT",
        help="show a running `pinadapt drive` of this scenario, or of a Franka without one; it "
        "prints its port",
    )


def view(options: Namespace) -> int:
    """Show the animation in a folder, or run a scenario live and print its table.

    The address of the page is printed; without a display, nothing else happens. Return 3 if the
    loop diverged, else 0.

    Raises:
        InputError: the folder contains no animation, or the scenario cannot be used.
    """
    place = options.scenario
    port = options.attach
    if place is not None and place.is_dir():
        from ..view.live import open_in_browser

        page = place / "animation.html"
        if not page.is_file():
            raise InputError(
                "holds no animation.html.",
                where=place,
                hint="`pinadapt run` writes one unless --no-html is given.",
            )
        address = page.resolve().as_uri()
        print(address)
        open_in_browser(address)
        return Exit.DONE
    if place is not None:
        scenario = Scenario.read(place, options.set)
    elif port is None or options.set:
        raise InputError("is missing: a folder or a scenario.", where="DIR|SCENARIO.toml")
    else:
        from .drive import FRANKA

        scenario = Scenario.build(FRANKA, Path())
    if port is None:
        rollout = run_scenario(scenario, live=True)
        print(rollout)
        return status_of(rollout)
    from ..realtime.recorder import watched
    from ..view.live import LiveView

    with LiveView(
        scenario.true, scenario.controller, scenario.trajectory, duration=scenario.duration
    ) as live:
        coming = watched(port, scenario.controller, scenario.true)
        for _ in live.watch(coming):  # until the loop ends, which does not notice
            pass
    return Exit.DONE


cite_arguments = add_scenario


def cite(options: Namespace) -> int:
    """Print the BibTeX entries of what a scenario's controller uses."""
    print(citation(Scenario.read(options.scenario, options.set).controller), end="")
    return 0


def write_run(rollout: Rollout, folder: Path, *, html: bool) -> None:
    """Replace the files of an earlier run by those of this one; ``html``: with the animation.

    Raises:
        OSError: some could not be written; the folder has the others.
    """
    try:
        with one_run(folder, RUN_FILES) as beside:
            rollout.save(beside)
            rollout.plot(beside)
            if rollout.kinematic_names or rollout.dynamic_names:
                try:
                    rollout.parameters().save(beside / "learned.json")
                    if rollout.evaluated().controller.dynamics.per_body:
                        rollout.learned().save(beside / "learned.urdf")
                except InputError as reason:
                    print(
                        f"pinadapt: some learned parameters were not written: {reason}",
                        file=sys.stderr,
                    )
            if html:
                rollout.animate().save(beside / "animation.html")
    except OSError as error:
        raise OSError(f"{folder}: not all could be written: {error.strerror or error}.") from error
