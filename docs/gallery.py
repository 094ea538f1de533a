"""The gallery: robots of the catalogue, each tracking a circle with a wrong model.

``python docs/gallery.py`` runs cases of `pinadapt zoo` for ten seconds, with and without
adaptation, draws each run into docs/gallery/, and writes the page docs/gallery/index.md.
"""

from __future__ import annotations

import os
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.zoo.case import PERIOD, ZooCase, zoo_case

FOLDER = Path(__file__).parent / "gallery"
ROBOTS = (
    "panda",
    "ur5",
    "ur10",
    "kinova",
    "xarm7",
    "z1",
    "talos_left_arm",
    "baxter_left",
    "g1_right_leg",
    "anymal_c_lf_leg",
    "allegro_right_index",
    "scara",
)
DURATION = 10.0  # [s]
ADAPTED, TRUE, PATH = "#0072B2", "#D55E00", "#000000"

HEAD = """# Gallery

Twelve chains of the catalogue under the default law and default gains, at 1 kHz with perfect
sensors. The true robot has friction, a tool moved by 5 % of the reach, and a load. In the model,
each body is 30 % too light or too heavy, and there is no friction. Each robot follows a circle
fitted to its workspace. Orange is the robot at the end, black the path of its tip. The plot on the
right is the distance from the desired path, with and without adaptation; the table has the largest
distance of the last second. `docs/gallery.py` runs and draws them whenever this site is built;
`pinadapt zoo` runs all 129 chains for longer.

| robot | joints | radius of the circle | error, not adapted | adapted |
|---|---|---|---|---|
"""


@dataclass(frozen=True)
class Shown:
    """The row of one robot: lengths in mm, errors the largest of the last second."""

    name: str
    joints: int
    radius: float
    unadapted: float
    adapted: float


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
    )


def points(robot: pa.Robot, q: np.ndarray) -> np.ndarray:
    """Return the positions of base, joints and task frame (n + 2, 3) [m]."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    joints = [data.oMi[j].translation for j in range(1, robot.model.njoints)]
    return np.array([np.zeros(3), *joints, data.oMf[robot.frame_id].translation])


def draw(case: ZooCase, runs: dict[str, pa.Rollout], path: Path) -> None:
    """Draw the robot with the path of its tip, and both errors."""
    figure = plt.figure(figsize=(7.2, 3.2), layout="constrained")
    space = figure.add_subplot(1, 2, 1, projection="3d")
    adapted = runs["adapted"]
    body = points(case.true, adapted.q[-1])
    tips = np.array([points(case.true, q)[-1] for q in adapted.q])
    space.plot(*body.T, "o-", color=TRUE, linewidth=3, markersize=4)
    space.plot(*tips.T, color=PATH, linewidth=1)
    space.set_aspect("equal")
    space.locator_params(nbins=3)
    space.tick_params(labelsize=7)
    for axis, label in zip((space.xaxis, space.yaxis, space.zaxis), "xyz", strict=True):
        axis.set_label_text(f"{label} [m]", fontsize=8)

    panel = figure.add_subplot(1, 2, 2)
    for (name, run), style in zip(runs.items(), ("--", "-"), strict=True):
        color = ADAPTED if name == "adapted" else TRUE
        panel.semilogy(run.t, 1e3 * run.distance, style, color=color, label=name, linewidth=1)
    panel.set(xlabel="t [s]", ylabel="error [mm]")
    panel.grid(alpha=0.3)
    panel.legend(loc="upper center", bbox_to_anchor=(0.5, 1.15), ncols=2, frameon=False)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def show(name: str) -> Shown:
    """Run and draw one robot."""
    case = zoo_case(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of descriptions with unphysical bodies
        runs = {"not adapted": simulated(case, "none"), "adapted": simulated(case, "natural")}
    draw(case, runs, FOLDER / f"{name}.png")
    last = [1e3 * float(run.distance[run.t >= DURATION - 1.0].max()) for run in runs.values()]
    return Shown(name, case.true.model.nv, 1e3 * case.radius, *last)


def main() -> None:
    """Draw all robots and write the page."""
    FOLDER.mkdir(exist_ok=True)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        rows = list(pool.map(show, ROBOTS))
    table = "".join(
        f"| {row.name} | {row.joints} | {row.radius:.0f} mm | {row.unadapted:.2g} mm "
        f"| **{row.adapted:.2g} mm** |\n"
        for row in rows
    )
    pictures = "".join(f"\n## {row.name}\n\n![{row.name}]({row.name}.png)\n" for row in rows)
    (FOLDER / "index.md").write_text(HEAD + table + pictures)


if __name__ == "__main__":
    main()
