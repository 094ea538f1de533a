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

import coal
import fast_simplification
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy.spatial import ConvexHull

import pinadapt as pa
from pinadapt.zoo.experiment import PERIOD, ZooCase, zoo_case

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
fitted to its workspace. On the left is the robot at the end, in the shapes of its description, and
in orange the path of its tip. The plot on the right is the distance from the desired path, with and
without adaptation; the table has the largest distance of the last second. `docs/gallery.py` runs
and draws them whenever this site is built; `pinadapt zoo` runs all 129 chains for longer.

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


_ROUNDING = 1e-6  # [m] of error at the first samples, before the path has left the start
_ROUND = 24  # corners of a circle
_MOST = 1500  # triangles of a shape
_LIGHT = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])


def triangles(shape: pin.GeometryObject) -> np.ndarray:
    """Return the triangles (N, 3, 3) of a shape [m], in its own axes; simplified if many."""
    solid = shape.geometry
    if isinstance(solid, coal.BVHModelBase):
        vertices = np.array(solid.vertices(), dtype=np.float32)
        corners = (solid.tri_indices(k) for k in range(solid.num_tris))
        faces = np.array([[corner[k] for k in range(3)] for corner in corners], dtype=np.int32)
        if len(faces) > _MOST:
            vertices, faces = fast_simplification.simplify(vertices, faces, target_count=_MOST)
        return np.asarray(vertices, dtype=float)[faces]
    vertices = _corners(solid)
    return np.asarray(vertices[ConvexHull(vertices).simplices])


def _corners(solid: coal.ShapeBase) -> np.ndarray:
    """Return points (N, 3) [m] whose convex hull is a box, a ball, a cylinder or a capsule."""
    turn = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    rise = np.linspace(-0.5, 0.5, _ROUND // 2) * np.pi
    ball = np.array(
        [(np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)) for a in turn for b in rise]
    )
    ends = np.array([[[0.0, 0.0, -1.0]], [[0.0, 0.0, 1.0]]])
    if isinstance(solid, coal.Box):
        sides = np.asarray(solid.halfSide)
        return np.array(np.meshgrid(*((-side, side) for side in sides))).reshape(3, -1).T
    if isinstance(solid, coal.Sphere):
        return solid.radius * ball
    if isinstance(solid, coal.Capsule):
        return (solid.radius * ball + solid.halfLength * ends).reshape(-1, 3)
    assert isinstance(solid, coal.Cylinder), solid
    rim = solid.radius * np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    return (rim + solid.halfLength * ends).reshape(-1, 3)


def drawn(robot: pa.Robot, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return triangles (N, 3, 3) [m] of a robot at q (nq), world axes, and their colours (N, 3).

    Of what stands still only the shapes near the first joint are drawn.
    """
    data, parts, colours = robot.model.createData(), [], []
    pin.forwardKinematics(robot.model, data, q)
    first, visual = data.oMi[1].translation, robot.visual
    assert visual is not None  # of the catalogue
    for shape in visual.geometryObjects:
        place = data.oMi[shape.parentJoint] * shape.placement
        corners = triangles(shape) @ place.rotation.T + place.translation
        if shape.parentJoint == 0 and np.abs(corners.mean(axis=(0, 1)) - first).max() > robot.reach:
            continue
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        shade = 0.55 + 0.45 * np.abs(normals @ _LIGHT)
        colour = 0.25 + 0.7 * np.asarray(shape.meshColor[:3])  # black would hide all edges
        parts.append(corners)
        colours.append(shade[:, None] * colour)
    return np.concatenate(parts), np.concatenate(colours).clip(0.0, 1.0)


def draw(case: ZooCase, runs: dict[str, pa.Rollout], path: Path) -> None:
    """Draw the robot with the path of its tip, and both errors; axes begin where the data do."""
    figure = plt.figure(figsize=(7.2, 3.2), layout="constrained")
    space = figure.add_subplot(1, 2, 1, projection="3d")
    adapted = runs["adapted"]
    body, colours = drawn(case.true, adapted.q[-1])
    tips = np.array([case.true.placement(q).translation for q in adapted.q])
    space.add_collection3d(
        Poly3DCollection(body, facecolors=colours, edgecolors=colours, linewidth=0.2)
    )
    space.plot(*tips.T, color=TRUE, linewidth=1.5, zorder=10)
    everything = np.vstack([body.reshape(-1, 3), tips])
    low, high = everything.min(axis=0), everything.max(axis=0)
    space.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    space.set_box_aspect(np.maximum(high - low, 1e-3), zoom=0.85)
    space.locator_params(nbins=3)
    space.tick_params(labelsize=7)
    for axis, label in zip((space.xaxis, space.yaxis, space.zaxis), "xyz", strict=True):
        axis.set_label_text(f"{label} [m]", fontsize=8)

    panel = figure.add_subplot(1, 2, 2)
    for (name, run), style in zip(runs.items(), ("--", "-"), strict=True):
        color = ADAPTED if name == "adapted" else TRUE
        panel.semilogy(run.t, 1e3 * run.distance, style, color=color, label=name, linewidth=1)
    panel.set(xlabel="t [s]", ylabel="error [mm]", xlim=(adapted.t[0], adapted.t[-1]))
    started = [1e3 * run.distance[run.distance > _ROUNDING] for run in runs.values()]
    shown = np.concatenate(started)
    panel.set_ylim(shown.min(), 1.2 * shown.max())
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
