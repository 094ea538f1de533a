"""The gallery: robots of the catalogue, each tracking a circle with a wrong model.

``python docs/gallery.py`` runs cases of `pinadapt zoo` for ten seconds, with and without
adaptation, writes the animation of each run and a picture of it into docs/gallery/, and the page
docs/gallery/index.md. Pictures need Chromium or Chrome; without, the page has its table alone.
"""

from __future__ import annotations

import asyncio
import os
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import get_context
from pathlib import Path

from moving_picture import browser, frames, installed_browser

import pinadapt as pa
from pinadapt._output import number
from pinadapt.zoo.experiment import PERIOD, ZooCase, zoo_case

FOLDER = Path(__file__).parent / "gallery"
ROBOTS = (
    *("panda", "ur5", "ur10", "kinova", "xarm7", "z1", "talos_left_arm", "baxter_left"),
    *("g1_right_leg", "anymal_c_lf_leg", "allegro_right_index", "scara"),
)
DURATION = 10.0  # [s]
SIZE = 900, 600  # [pixels]
LONGEST = 60.0  # [s] for a picture; a page that takes longer has none
LAYOUT = """
  document.head.insertAdjacentHTML("beforeend", `<style>
    .panel, .dg.main { display: none }
  </style>`);
  look();
"""

HEAD = """# Gallery

Chains of the catalogue under the default law and default gains, at 1 kHz with perfect sensors. The
true robot has friction, a tool moved by 5 % of the reach, and a load. In the model, each body is
30 % too light or too heavy, and there is no friction. Each robot follows a circle fitted to its
workspace: green is the desired path, red the one of its tip. The table has the largest error of the
last second, with and without adaptation; **each name leads to the run**, an animation
with its curves. `docs/gallery.py` runs them whenever this site is built; `pinadapt zoo` runs all
chains for longer.

| robot | joints | radius of the circle | error, not adapted | adapted |
|---|---|---|---|---|
"""


def simulated(case: ZooCase, adaptation: str) -> pa.Rollout:
    """Return a run of a case."""
    controller = pa.make_controller(
        case.estimated,
        adaptation=adaptation,
        limits=pa.Limits(torque=case.efforts_suffice),
        dt=PERIOD,
    )
    return pa.simulate(
        case.true,
        controller,
        case.motion,
        duration=DURATION,
        engine=pa.Engine(torque_limits=case.efforts_suffice),
        record_every=5,
        title=case.true.name,
    )


def show(name: str) -> str:
    """Run one robot, write its animation and picture, and return its row of the table."""
    case = zoo_case(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of descriptions with unphysical bodies
        without, adapted = simulated(case, "none"), simulated(case, "natural")
    page = adapted.animate().save(FOLDER / f"{name}.html")
    if installed_browser():
        with browser(page) as address, suppress(asyncio.TimeoutError):
            drawn = asyncio.wait_for(frames(address, [DURATION], SIZE, LAYOUT), LONGEST)
            asyncio.run(drawn)[0].save(FOLDER / f"{name}.png")
    last = (run.distance[run.t >= DURATION - 1.0].max() for run in (without, adapted))
    first, second = (f"{number(float(error), scale=1e3, digits=3)} mm" for error in last)
    radius = f"{number(case.radius, scale=1e3, digits=0)} mm"
    return f"| [{name}]({name}.html) | {case.true.model.nv} | {radius} | {first} | **{second}** |\n"


def main() -> None:
    """Show the robots, all or those named, and write the page."""
    FOLDER.mkdir(exist_ok=True)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    names = sys.argv[1:] or ROBOTS
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        table = "".join(pool.map(show, names))
    pictures = "".join(
        f"\n## {name}\n\n[![{name}]({name}.png)]({name}.html)\n"
        for name in names
        if (FOLDER / f"{name}.png").exists()
    )
    (FOLDER / "index.md").write_text(HEAD + table + pictures)


if __name__ == "__main__":
    main()
