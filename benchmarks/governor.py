"""What the governor does to runs that go wrong without it, and to runs that go well.

``python -m benchmarks.governor [PATH...] [--cases PATTERN] [--save FILE]`` runs each case without
and with ``pa.Limits(governor=True)``, from rest, with the unknowns of the README: a tool of 5 % of
the reach, a load of 5 % of the mass, every inertia of the model 30 % too small.

* leaves: a way out of the workspace, a second beyond it, and back, each in a second;
* held: an obstacle holds every joint for a second, and for four;
* blind: three seconds without frames of a camera of 30 Hz that is 60 ms late;
* slow torso: a circle for which J_hat^+ moves a lift at eight times its velocity limit;
* everything: tool 20 % of the reach, load 30 % of the mass, inertias a third too small, a joint
  placed 0.1 m from where the model has it; six draws of the directions and of the joint;
* healthy: ten arms of the catalogue on the circle that the library chooses.

PATHs are URDFs of other arms for "everything", or NAME.urdf:FRAME for "slow torso". Errors are the
largest of the run, and of its last tenth.
"""

from __future__ import annotations

import argparse
import re
import warnings
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.plants.sensors import SimulatedSensors
from pinadapt.robot.motors import torque_limits
from pinadapt.rollout.recording import slowdowns

from .timing import HERE, in_turn, save, saved

DT = 1e-3  # [s]
TOOL = np.array([0.02, -0.02, 0.04])  # of the reach, in the frame's axes
CAMERA = pa.Sensors(camera=pa.Camera(rate=30.0, delay=0.06))
HEALTHY = (
    "panda", "ur5", "ur10", "xarm7", "kinova", "z1", "tiago_pro_left_arm", "so100", "scara",
    "planar_2r",
)  # fmt: skip
FAR = {"ur5": 0.95, "panda": 1.1}  # of the reach from the base, outside of the workspace
DRAWS = 6


class Held(pa.plants.PinocchioPlant):
    """A robot whose joints an obstacle holds for a while.

    Attributes:
        held: from when to when [s].
    """

    held = (2.0, 3.0)

    def step(self, torque: np.ndarray, dt: float) -> None:
        """Move for dt [s], or stay where it is held."""
        if self.held[0] <= self._t < self.held[1]:
            self._v, self._t = np.zeros(self.nv), self._t + dt
        else:
            super().step(torque, dt)


class HeldLonger(Held):
    """The same for four seconds."""

    held = (2.0, 6.0)


class Blinded(SimulatedSensors):
    """Sensors whose camera sees nothing for a while.

    Attributes:
        blind: from when to when [s].
    """

    blind = (2.0, 5.0)

    def measure(self, truth: pa.Measurement, torque: np.ndarray | None = None) -> pa.Measurement:
        """Return the next measurement, without x while the camera is blind."""
        measured = super().measure(truth, torque)
        if self.blind[0] <= truth.t < self.blind[1]:
            return measured._replace(x=None, x_time=None, xd=None)
        return measured


def unknown(robot: pa.Robot) -> tuple[pa.Robot, pa.Robot]:
    """Return the true robot and the model of it, with the unknowns of the README."""
    tool = robot.reach * TOOL
    true = robot.changed(
        tool_translation=tool, payload=pa.Payload(mass=0.05 * robot.mass, com=tool)
    )
    return true, robot.changed(inertial_scale=0.7)


def everything(robot: pa.Robot, draw: int) -> tuple[pa.Robot, pa.Robot]:
    """Return the true robot and the model of it, which is wrong in every way at once."""
    rng = np.random.default_rng(draw)
    tool, off = (part / np.linalg.norm(part) for part in rng.standard_normal((2, 3)))
    joint = robot.joint_names[int(rng.integers(1, robot.model.nv))]
    tool = 0.2 * robot.reach * tool
    load = pa.Payload(mass=0.3 * robot.mass, com=tool)
    true = robot.changed(tool_translation=tool, payload=load, link_translation={joint: 0.1 * off})
    return true, robot.changed(inertial_scale=2 / 3)


def run(
    true: pa.Robot,
    model: pa.Robot,
    motion: pa.trajectories.Trajectory,
    duration: float,
    *,
    governed: bool,
    plant: type[pa.plants.PinocchioPlant] = pa.plants.PinocchioPlant,
    blind: bool = False,
    dt: float = DT,
    **made: str,
) -> dict[str, Any]:
    """Return how one run ended, and what slowed it; lengths in mm, times in s."""
    sensors = CAMERA if blind else None
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        controller = pa.make_controller(
            model,
            unknown=pa.Unknown(tool=True, bodies="all"),
            sensors=sensors,
            limits=pa.Limits(governor=governed),
            dt=dt,
            **made,  # type: ignore[arg-type]
        )
        driven = plant(true, torque_limits=torque_limits(true, True))
        seen = None if sensors is None else Blinded(true, dt, sensors)
        stream = pa.run(driven, controller, motion, dt=dt, sensors=seen)
        samples: list[pa.Sample] = []
        lost = None
        try:
            samples.extend(islice(stream, round(duration / dt)))
        except pa.DivergedError as error:
            lost = error.time
    return summary(true, samples, lost)


def summary(true: pa.Robot, samples: list[pa.Sample], lost: float | None) -> dict[str, Any]:
    """Return what became of a run, and what slowed it.

    ``weight`` is the largest share of a motor's limit that gravity takes from the true robot,
    ``speed`` the largest share of a velocity limit, ``estimates`` the largest norm of the dynamic
    estimate.
    """
    m = true.task.groups[0].rows
    error = [
        np.linalg.norm(true.task.error(sample.truth.x, sample.desired.x_d)[m])
        for sample in samples
        if sample.truth.x is not None
    ]  # fmt: skip
    distance = 1e3 * np.array(error if error else [np.nan])
    limits, efforts = true.model.velocityLimit, true.model.effortLimit
    data = true.model.createData()
    weight = [
        np.abs(pin.computeGeneralizedGravity(true.model, data, sample.truth.q)) / efforts
        for sample in samples[::50]
    ]
    last = samples[-1] if samples else None
    path = None if last is None else last.state.path
    return {
        "lost": lost,
        "largest": float(distance.max()),
        "last": float(distance[-max(1, len(distance) // 10) :].max()),
        "weight": float(np.max(weight, initial=0.0)),
        "speed": float(max((np.abs(s.truth.v) / limits).max() for s in samples)),
        "estimates": float(max(np.linalg.norm(s.state.a_d) for s in samples)),
        "late": 0.0 if path is None or last is None else path.lag,
        "slowed": [
            {"from": one.start, "to": one.end, "cause": one.cause, "least_rate": one.least_rate}
            for one in slowdowns(samples)
        ],
    }


def begun(motion: pa.trajectories.Trajectory, true: pa.Robot) -> pa.trajectories.Trajectory:
    """Return a motion that begins where the true robot is, at rest."""
    return motion.starting_at(true.position(true.q0)).from_rest()


def way_out(true: pa.Robot, reach: float) -> pa.trajectories.Trajectory:
    """Return a way from home to a share of the reach from the base, a second there, and back."""
    start = true.position(true.q0)
    far = reach * true.reach * start / np.linalg.norm(start)
    return pa.trajectories.Waypoints([start, far, far, start], 1.0)


Case = tuple[str, str, dict[str, Any]]  # what happens, robot, options of ``run``


def case(name: str, robot: str, **options: Any) -> Case:
    """Return what happens, the robot and the options of ``run``."""
    return name, robot, options


def both(name: str, robot: str, **options: Any) -> dict[str, Any]:
    """Return a row: the run without and with the governor."""
    row: dict[str, Any] = {"name": f"{name} {robot}", "case": name, "robot": robot}
    for key, governed in (("without", False), ("with", True)):
        row[key] = run(**options, governed=governed)
    print(line(row), flush=True)
    return row


def small_cases() -> Iterator[Case]:
    """Yield each case but "everything"."""
    for name in ("ur5", "panda"):
        true, model = unknown(pa.load(name))
        arm = {"true": true, "model": model}
        circle = begun(pa.reachable_circle(model), true)
        yield case("leaves", name, **arm, motion=way_out(true, FAR[name]), duration=30.0)
        yield case("leaves, law (11)", name, **arm, motion=way_out(true, FAR[name]), duration=30.0,
                   law="adaptive-inverse-dynamics")  # fmt: skip
        yield case("held 1 s", name, **arm, motion=circle, duration=12.0, plant=Held)
        yield case("held 4 s", name, **arm, motion=circle, duration=15.0, plant=HeldLonger)
        yield case("blind 3 s", name, **arm, motion=circle, duration=12.0, blind=True)


def slow_torso(fetch: Path | None) -> Iterator[Case]:
    """Yield Tiago's lift, and Fetch's if there is its description."""
    circle = pa.trajectories.Circle(np.zeros(3), 0.15, 1.2, "yz")
    robots = {"tiago_arm": pa.load("tiago_arm")}
    if fetch is not None:
        base = [name for name in ("base_joint1", "base_joint2") if name in fetch.read_text()]
        robots["fetch"] = pa.load(fetch, frame="gripper_link", locked=base)
    for name, robot in robots.items():
        true = robot.changed(tool_translation=robot.reach * TOOL)
        model = robot.changed(inertial_scale=0.7)
        yield case("slow torso", name, true=true, model=model, motion=begun(circle, true),
                   duration=20.0)  # fmt: skip


def all_at_once(paths: list[Path]) -> Iterator[Case]:
    """Yield each draw of "everything", arm and adaptation."""
    robots = {name: pa.load(name) for name in ("panda", "ur5", "kinova")}
    robots |= {path.parent.name: pa.load(path) for path in paths}
    for name, robot in robots.items():
        for adaptation in ("natural", "natural-memory"):
            for draw in range(DRAWS):
                true, model = everything(robot, draw)
                circle = begun(pa.reachable_circle(robot), true)
                yield case(
                    f"everything {draw}, {adaptation}", name, true=true, model=model,
                    motion=circle, duration=12.0, adaptation=adaptation,
                )  # fmt: skip


def healthy() -> Iterator[Case]:
    """Yield each arm on which nothing goes wrong."""
    for name in HEALTHY:
        true, model = unknown(pa.load(name))
        circle = begun(pa.reachable_circle(model), true)
        yield case("healthy", name, true=true, model=model, motion=circle, duration=8.0)


def cost() -> dict[str, Any]:
    """Return the time of a step of the Panda's default controller [us], and the governor's part."""
    true, model = unknown(pa.load("panda"))
    measurement = pa.plants.PinocchioPlant(true).measure()
    motion = pa.reachable_circle(model).starting_at(true.position(true.q0))
    calls: dict[str, Callable[[], float | None]] = {}
    for key, governed in (("without", False), ("with", True)):
        controller = pa.make_controller(model, limits=pa.Limits(governor=governed))
        start = controller.init(measurement)

        def steps(controller: pa.Controller = controller, state: Any = start) -> float | None:
            for k in range(50):
                at = k * DT
                desired = controller.desired(state, motion, at)
                _, state = controller.step(state, measurement._replace(t=at), desired, DT)
            return None

        calls[key] = steps
    times = in_turn(calls, 200)
    least = {key: 1e6 * float(values.min()) / 50 for key, values in times.items()}
    part = least["with"] - least["without"]
    return {"name": "cost of a step [us]", "case": "cost", **least, "governor": part}


def short(value: float) -> str:
    """Return a number with two digits, and no exponent."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.2g}"


def outcome(result: dict[str, Any]) -> str:
    """Return the largest and the last error and the largest joint speed, or when it was lost."""
    if result["lost"] is not None:
        return f"lost at {result['lost']:.2g} s"
    largest, last = short(result["largest"]), short(result["last"])
    return f"{largest}, {last}, {100 * result['speed']:.0f} %"


def causes(result: dict[str, Any]) -> str:
    """Return what slowed a run, for how long, and how late its path is at the end."""
    named = sorted({part for one in result["slowed"] for part in one["cause"].split(", ") if part})
    if not named:
        return "-"
    least = min(one["least_rate"] for one in result["slowed"])
    return f"{', '.join(named)}; rate down to {least:.2f}, {result['late']:.2g} s late"


def line(row: dict[str, Any]) -> str:
    """Return a row of the table."""
    cells = (row["case"], row["robot"], outcome(row["without"]), outcome(row["with"]))
    return f"| {' | '.join(cells)} | {causes(row['with'])} |"


def table(rows: list[dict[str, Any]]) -> str:
    """Return the table of the page on motions."""
    shown = [row for row in rows if row["case"].startswith(("leaves", "held", "blind", "slow"))]
    head = "| case | robot | without | with the governor | what slowed the path |"
    return "\n".join([head, "|---|---|---|---|---|", *(line(row) for row in shown)])


def counts(rows: list[dict[str, Any]]) -> str:
    """Return the table of "everything": how many draws were lost, and the errors of the others."""
    lines = [
        "| robot | adaptation | motors | lost without | with | last error without [mm] | with |"
    ]
    lines.append("|---|---|---|---|---|---|---|")
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        if row["case"].startswith("everything"):
            groups.setdefault((row["robot"], row["case"].split(", ")[1]), []).append(row)
    for (robot, adaptation), draws in groups.items():
        weak = sum(row["without"]["weight"] > 1.0 for row in draws)
        cells = [robot, adaptation, f"too weak in {weak} of {len(draws)}"]
        cells += [str(sum(row[key]["lost"] is not None for row in draws)) for key in KEYS]
        for key in KEYS:
            kept = [row[key]["last"] for row in draws if row[key]["lost"] is None]
            cells.append(f"{short(min(kept))} to {short(max(kept))}" if kept else "-")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


KEYS = ("without", "with")


def main() -> None:
    """Measure, print the tables and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paths", nargs="*", type=Path, help="URDFs of other arms")
    parser.add_argument("--fetch", type=Path, help="URDF of Fetch")
    parser.add_argument("--cases", default="", help="pattern of names; the other rows stay")
    parser.add_argument("--save", type=Path, default=HERE / "governor.json")
    given = parser.parse_args()
    cases = *small_cases(), *slow_torso(given.fetch), *healthy(), *all_at_once(given.paths)
    rows = saved(given.save)
    for name, robot, options in cases:
        if re.search(given.cases, f"{name} {robot}"):
            row = both(name, robot, **options)
            rows[row["name"]] = row
            save(given.save, list(rows.values()))
    if re.search(given.cases, "cost"):
        row = cost()
        rows[row["name"]] = row
    found = list(rows.values())
    save(given.save, found)
    print(f"\n{table(found)}\n\n{counts(found)}\n\n{rows.get('cost of a step [us]', '')}")


if __name__ == "__main__":
    main()
