"""The README's lines on descriptions for which nothing was tuned.

``python -m benchmarks.strangers PATH... [--camera] [--tracker DEGREES] [--duration S]
[--unadapted] [--processes N] [--out DIR]`` runs descriptions and folders of them with the
defaults, as a sweep, and prints a table. A folder DIR keeps the rows: what was interrupted goes on
there. A tool of 5 % of the reach and a load of 5 % of the mass are unknown, every inertia of the
model is 30 % too small, and the motion is four turns of the circle that the library chooses. With
``--camera`` the position comes, as in the README, from a camera of 30 Hz that is 60 ms late. With
``--tracker`` it is given in unknown axes, turned by so many degrees, and found by a wiggle before
the motion. Errors are the largest of the last tenth of the run.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from texttable import Texttable

import pinadapt as pa
from pinadapt.sweep import CaseTable

TOOL = np.array([0.02, -0.02, 0.04])  # of the reach, in the frame's axes
LOAD, INERTIAS = 0.05, 0.7  # relative to the mass; factor on the inertias of the model
TURNS = 4.0
AXIS, PLACE = np.array([0.6, -0.64, 0.48]), np.array([0.5, -0.4, 1.1])  # of a tracker; [m]
CAMERA = pa.Camera(rate=30.0, delay=0.06)
SUFFIXES = (".urdf",)


@dataclass(frozen=True)
class Row:
    """The result of one description; None where there is none.

    Attributes:
        name: of the file.
        frame: the chosen frame.
        joints: number of joints.
        radius, period: of the circle [m], [s].
        error, unadapted: largest in the last tenth of the run [m].
        lost: time at which the loop diverged [s].
        message: why it did not run, or why it ended.
    """

    name: str
    frame: str = ""
    joints: int | None = None
    radius: float | None = None
    period: float | None = None
    error: float | None = None
    unadapted: float | None = None
    lost: float | None = None
    message: str = ""

    @property
    def share(self) -> float | None:
        """The error relative to the radius."""
        return None if self.error is None or self.radius is None else self.error / self.radius


def stranger(
    path: str, duration: float | None, camera: bool, frozen: bool, tracker: float | None = None
) -> dict[str, Any]:
    """Run the README's lines on one description, as a case of a sweep; also without adaptation."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of bodies that are not physical, for example
        try:
            return asdict(_run(Path(path), duration, camera, frozen, tracker))
        except pa.PinadaptError as error:
            return asdict(Row(Path(path).stem, message=f"refused: {error}"))


def rows_of(table: CaseTable) -> list[Row]:
    """Return the rows of a sweep; a case that failed or crashed has its reason as message."""
    names = [each.name for each in fields(Row)]
    found = []
    for row in table.rows():
        if row["status"] != "done":
            row |= {"name": Path(row["path"]).stem, "message": f"FAILED: {row['reason']}"}
        own = {name: row[name] for name in names if row.get(name) is not None}
        joints = own.get("joints")
        found.append(Row(**own | ({} if joints is None else {"joints": int(joints)})))
    return found


def _run(
    path: Path, duration: float | None, camera: bool, frozen: bool, tracker: float | None
) -> Row:
    robot = pa.load(path)
    circle = pa.reachable_circle(robot)
    duration = duration or TURNS * circle.period
    tool = robot.reach * TOOL
    load = pa.Payload(mass=LOAD * robot.mass, com=tool)
    true = robot.changed(tool_translation=tool, payload=load)
    model = robot.changed(inertial_scale=INERTIAS)
    row = Row(path.stem, robot.frame, robot.model.nv, circle.radius, circle.period)
    motion: Any = circle.starting_at(true.position(true.q0))
    if tracker is not None:
        R, seen = pin.exp3(np.radians(tracker) * AXIS), motion
        true = true.seen_from(R, PLACE)

        def motion(t: float) -> np.ndarray:
            return R @ seen.at(t).x_d + PLACE

    sensors = pa.Sensors(CAMERA if camera else None)

    def run(adaptation: str | None = None) -> tuple[pa.Rollout, float | None]:
        unknown = pa.Unknown(tool=True, tracker=tracker is not None)
        controller = pa.make_controller(model, unknown=unknown, adaptation=adaptation)
        rollout = pa.simulate(
            true, controller, motion, duration=duration, record_every=10, sensors=sensors
        )
        lost = rollout.diverged is not None
        last = rollout.distance[rollout.t > 0.9 * duration]
        return rollout, None if lost else float(last.max())

    rollout, error = run()
    without = run("none")[1] if frozen else None
    return replace(
        row,
        error=error,
        unadapted=without,
        lost=rollout.diverged,
        message=str(rollout.reason or ""),
    )


def descriptions(paths: Sequence[Path]) -> Iterator[Path]:
    """Yield the files among paths, and the descriptions in the folders among them."""
    for path in paths:
        if path.is_dir():
            yield from sorted(file for file in path.rglob("*") if file.suffix in SUFFIXES)
        else:
            yield path


def table(rows: Sequence[Row]) -> str:
    """Return rows as text, with the median and the largest error."""
    text = Texttable(max_width=200)
    text.set_deco(Texttable.HEADER)
    text.set_cols_dtype(["t"] * 9)
    text.set_cols_align(["l", "l", *"rrrrrr", "l"])
    text.header(
        [
            "robot",
            "frame",
            "joints",
            "radius [m]",
            "error [mm]",
            "[% of radius]",
            "unadapted [mm]",
            "lost [s]",
            "message",
        ]
    )
    for row in rows:
        text.add_row(
            [
                row.name,
                row.frame,
                _number(row.joints, 1, "d"),
                _number(row.radius, 1),
                _number(row.error, 1e3),
                _number(row.share, 1e2),
                _number(row.unadapted, 1e3),
                _number(row.lost, 1),
                row.message,
            ]
        )
    shares = [row.share for row in rows if row.share is not None]
    ran = [row for row in rows if row.radius is not None]
    summary = f"{len(ran)} of {len(rows)} ran, {len(ran) - len(shares)} of them diverged"
    if shares:
        summary += f"; median {100 * np.median(shares):.2g} %, worst {100 * max(shares):.2g} %"
    return f"{text.draw()}\n{summary}"


def _number(value: float | None, unit: float, form: str = ".3g") -> str:
    return "" if value is None else f"{value * unit:{form}}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", type=Path, nargs="+", metavar="PATH")
    parser.add_argument("--camera", action="store_true")
    parser.add_argument("--tracker", type=float, metavar="DEGREES", help="turned by so much")
    parser.add_argument("--unadapted", action="store_true", help="run each without adaptation, too")
    parser.add_argument("--duration", type=float, help="of the motion [s]; default: four turns")
    parser.add_argument("--processes", type=int, help="0: none besides this one")
    parser.add_argument("--out", type=Path, metavar="DIR", help="keeps the rows")
    options = parser.parse_args()
    fixed = {
        "duration": options.duration,
        "camera": options.camera,
        "frozen": options.unadapted,
        "tracker": options.tracker,
    }
    cases = [{"path": str(path.resolve()), **fixed} for path in descriptions(options.paths)]
    print(table(rows_of(pa.sweep(stranger, cases, executor=options.processes, folder=options.out))))


if __name__ == "__main__":
    main()
