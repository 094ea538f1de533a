"""What the governor does to runs that go wrong without it, and to runs that go well.

``make governor.table`` runs the sweep ``governor.toml`` and writes ``governor.csv``: each case
without and with ``pa.Limits(governor=True)``, from rest, with the unknowns of the README: a tool of
5 % of the reach, a load of 5 % of the mass, every inertia of the model 30 % too small.

* leaves: a way out of the workspace, a second beyond it, and back, each in a second;
* held: an obstacle holds every joint for a second, and for four;
* blind: three seconds without frames of a camera of 30 Hz that is 60 ms late;
* slow torso: a circle for which J_hat^+ moves a lift at eight times its velocity limit;
* everything: tool 20 % of the reach, load 30 % of the mass, inertias a third too small, a joint
  placed 0.1 m from where the model has it; six draws of the directions and of the joint;
* healthy: ten arms of the catalogue on the circle that the library chooses;
* cost: of a step of the Panda's default controller.

Fetch and pybullet's iiwa are ``fetch.urdf`` and ``kuka_iiwa.urdf`` in a folder that the environment
variable ``URDFS`` names. Errors are the largest of the run, and of its last tenth.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.plants.sensors import SimulatedSensors
from pinadapt.robot.motors import torque_limits
from pinadapt.rollout.recording import slowdowns

from .timing import in_turn, markdown

DT = 1e-3  # [s]
TOOL = np.array([0.02, -0.02, 0.04])  # of the reach, in the frame's axes
CAMERA = pa.Sensors(camera=pa.Camera(rate=30.0, delay=0.06))
FAR = {"ur5": 0.95, "panda": 1.1}  # of the reach from the base, outside of the workspace
URDFS = {"fetch": "gripper_link", "kuka_iiwa": None}  # frames of arms from a folder


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


def arm(name: str) -> pa.Robot:
    """Return a robot of the catalogue, or from the folder of descriptions."""
    if name not in URDFS:
        return pa.load(name)
    path = Path(os.environ.get("URDFS", ".")) / f"{name}.urdf"
    base = [joint for joint in ("base_joint1", "base_joint2") if joint in path.read_text()]
    return pa.load(path, frame=URDFS[name], locked=base)


def options(event: str, robot: pa.Robot, draw: int) -> dict[str, Any]:
    """Return the options of ``run`` for what happens."""
    if event == "slow torso":
        lift = pa.trajectories.Circle(np.zeros(3), 0.15, 1.2, "yz")
        true = robot.changed(tool_translation=robot.reach * TOOL)
        model = robot.changed(inertial_scale=0.7)
        return {"true": true, "model": model, "motion": begun(lift, true), "duration": 20.0}
    true, model = everything(robot, draw) if event == "everything" else unknown(robot)
    found: dict[str, Any] = {"true": true, "model": model}
    if event.startswith("leaves"):
        found |= {"law": "adaptive-inverse-dynamics"} if event.endswith("law (11)") else {}
        return found | {"motion": way_out(true, FAR[robot.name]), "duration": 30.0}
    circle = pa.reachable_circle(robot if event == "everything" else model)
    return found | {"motion": begun(circle, true)} | OPTIONS[event]


OPTIONS: dict[str, dict[str, Any]] = {
    "held 1 s": {"duration": 12.0, "plant": Held},
    "held 4 s": {"duration": 15.0, "plant": HeldLonger},
    "blind 3 s": {"duration": 12.0, "blind": True},
    "everything": {"duration": 12.0},
    "healthy": {"duration": 8.0},
}


def measure(
    event: str, robot: str, governor: bool = False, adaptation: str = "", draw: int = 0
) -> dict[str, Any]:
    """Return the numbers of one run, or the cost of a step."""
    if event == "cost":
        return cost()
    made: dict[str, Any] = {"adaptation": adaptation} if adaptation else {}
    found = run(**options(event, arm(robot), draw), governed=governor, **made)
    slowed, lost = found.pop("slowed"), found["lost"]
    if slowed:
        named = {part for one in slowed for part in one["cause"].split(", ") if part}
        found["causes"] = ", ".join(sorted(named))
        found["least_rate"] = min(one["least_rate"] for one in slowed)
    return found if lost is None else found | {"status": "diverged", "reason": f"at {lost:.2g} s"}


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
    return {"without_us": least["without"], "governor_us": part}


def short(value: float) -> str:
    """Return a number with two digits, and no exponent."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.2g}"


Row = Mapping[str, Any]


def outcome(row: Row) -> str:
    """Return the largest and the last error and the largest joint speed, or when it was lost."""
    if row["lost"] is not None:
        return f"lost {row['reason']}"
    return f"{short(row['largest'])}, {short(row['last'])}, {100 * row['speed']:.0f} %"


def causes(row: Row) -> str:
    """Return what slowed a run, for how long, and how late its path is at the end."""
    if row["causes"] is None:
        return "-"
    return f"{row['causes']}; rate down to {row['least_rate']:.2f}, {row['late']:.2g} s late"


def pairs(rows: Sequence[Row], events: Sequence[str]) -> list[tuple[Row, Row]]:
    """Return the rows of some events, without and with the governor."""
    own = [row for row in rows if row["event"] in events]
    return list(zip(own[::2], own[1::2], strict=True))


def report(rows: Sequence[Row]) -> str:
    """Return the runs that go wrong, by robot."""
    names = [name for name in dict.fromkeys(r["event"] for r in rows) if name not in OTHERS]
    cells = [
        [a["event"], a["robot"], outcome(a), outcome(b), causes(b)]
        for a, b in sorted(pairs(rows, names), key=lambda pair: pair[0]["robot"] != "ur5")
    ]
    return markdown(
        ["case", "robot", "without", "with the governor", "what slowed the path"], cells
    )


OTHERS = ("healthy", "everything", "cost")


def counts(rows: Sequence[Row]) -> str:
    """Return the table of "everything": how many draws were lost, and the errors of the others."""
    groups: dict[tuple[str, str], list[tuple[Row, Row]]] = {}
    for pair in pairs(rows, ["everything"]):
        groups.setdefault((pair[0]["robot"], pair[0]["adaptation"]), []).append(pair)
    cells = []
    for (robot, adaptation), draws in groups.items():
        weak = sum(without["weight"] > 1.0 for without, _ in draws)
        runs = list(zip(*draws, strict=True))
        lost = [sum(row["lost"] is not None for row in each) for each in runs]
        kept = [[row["last"] for row in each if row["lost"] is None] for each in runs]
        errors = [f"{short(min(each))} to {short(max(each))}" if each else "-" for each in kept]
        cells.append([robot, adaptation, f"too weak in {weak} of {len(draws)}", *lost, *errors])
    head = ["robot", "adaptation", "motors", "lost without", "with"]
    return markdown([*head, "last error without [mm]", "with"], cells)
