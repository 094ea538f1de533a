"""Robots that stand and crawl in MuJoCo, with a load on the trunk that nobody announced.

``make standing.table`` runs the sweep ``standing.toml``. Friction 0.6, 1 kHz, nothing tuned by
robot: with ``motion`` "sway" the trunk moves on a circle of 15 mm and pitches by 0.1 rad in 2 s;
with "crawl" it takes twelve steps of a sixth of its height. Sensors are perfect, or by a word:
encoders of 17 or 14 bits, and "imu": then nothing but the legs and an IMU that is off by 0.3 deg
measures the base. A push of 30 N for 0.5 s on the trunk comes from a random side.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

import pinadapt as pa
from pinadapt.plants import MujocoPlant
from pinadapt.records import Desired
from pinadapt.trajectories import Crawl, Trajectory
from pinadapt.trajectories.trajectory import minimum_jerk

from .shared import COUNT, Row, grouped, markdown

SOLE = (0.1, 0.05)
WAY = 0.015, 0.015, 0.01  # [m] of the trunk
ROBOTS: dict[str, list[Any]] = {
    **{name: ["FL_foot", "FR_foot", "RL_foot", "RR_foot"] for name in ("a1", "b1", "go1")},
    "solo12": ["FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"],
    "anymal": ["LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"],
    "hyq": ["lf_foot", "rf_foot", "lh_foot", "rh_foot"],
    "talos": [pa.Contact("left_sole_link", SOLE), pa.Contact("right_sole_link", SOLE)],
}
PUSH, PUSHED = 30.0, (1.5, 2.0)  # [N], [s]
TILT = math.radians(0.3)
FALLEN = 0.5  # of the height of the trunk
UNKNOWN = pa.Unknown(bodies="payload", friction=False, armature=False)


class Sway(Trajectory):
    """The trunk on a circle of 15 mm in 2 s, begun at rest, and pitching by 0.1 rad.

    ``way`` scales and turns the circle.
    """

    def __init__(self, robot: pa.Robot, way: ArrayLike = WAY) -> None:
        """Begin at the home pose of a robot; ``way`` are amplitudes (3) [m]."""
        self.start = robot.position(robot.q0)
        self.turn = np.array([0.0, 0.1, 0.0])
        self.way = np.array(way)

    def at(self, t: float) -> Desired:
        """Return the pose of the trunk at time t [s]."""
        w, (s, sd, sdd) = math.pi, minimum_jerk(min(max(t, 0.0), 1.0))
        phase = w * t + np.array([0.0, math.pi / 2.0, 0.0])
        g = np.sin(phase)
        gd = w * np.cos(phase)
        gdd = -w * w * np.sin(phase)
        h = g[0]
        hd = gd[0]
        hdd = gdd[0]
        home = pin.Quaternion(self.start[3:]).matrix()
        turned = pin.Quaternion(pin.exp3(self.turn * s * h) @ home).coeffs()
        return Desired(
            np.append(self.start[:3] + self.way * s * g, turned),
            np.append(self.way * (s * gd + sd * g), self.turn * (s * hd + sd * h)),
            np.append(
                self.way * (s * gdd + 2.0 * sd * gd + sdd * g),
                self.turn * (s * hdd + 2.0 * sd * hd + sdd * h),
            ),
        )


class Pushed(MujocoPlant):
    """A robot whose trunk is pushed, by a force (3) [N] at the origin of its frame."""

    def __init__(self, robot: pa.Robot, force: np.ndarray, **options: Any) -> None:
        """Take the robot and the force."""
        self._force = np.append(force, np.zeros(robot.model.nv - 3))
        super().__init__(robot, **options)

    def hold(self, tau: np.ndarray, dt: float) -> None:
        """Move for dt [s] under a torque tau (n) and the push."""
        begin, end = PUSHED
        super().hold(tau + self._force if begin <= self._t < end else tau, dt)


@cache
def standing(name: str) -> pa.Robot:
    """Return a robot on its feet."""
    return pa.load(name, base="free", contacts=ROBOTS[name])


def measure(
    robot: str,
    load: float,
    motion: str = "sway",
    sensors: str = "perfect",
    adaptation: str = "natural-memory",
    push: bool = False,
    varied: bool = False,
    case_seed: int = 0,
) -> dict[str, Any]:
    """Return the figures of one run.

    Args:
        robot: a name of ``ROBOTS``.
        load: on the trunk [kg]; with ``varied`` the largest one.
        motion: "sway" or "crawl".
        sensors: words, see above.
        adaptation: of the trunk's inertia; "none"; "known": none, and the load is announced.
        push: whether the trunk is pushed.
        varied: whether load, its place and the path are random.
        case_seed: of what is random.

    The errors are those of the trunk: the largest of the run, the last second's, of its height.
    """
    described = standing(robot)
    rng = np.random.default_rng(case_seed)
    height = described.q0[2]
    way = np.array(WAY)
    com = height * np.array([0.2, 0.08, 0.32])
    if varied:
        load *= rng.uniform()
        com = com * rng.uniform(-1.0, 1.0, 3)
        way = way * rng.uniform(-1.3, 1.3, 3)
        com[2] = abs(com[2])
    angle = rng.uniform(-math.pi, math.pi)
    true = described.changed(payload=pa.Payload(load, com))
    bits = next((bits for bits in COUNT if f"{bits} bit" in sensors), None)
    given = pa.Sensors(
        encoder=0.0 if bits is None else COUNT[bits],
        imu=pa.Imu(tilt=TILT) if "imu" in sensors else None,
    )
    known = adaptation == "known"
    controller = pa.make_controller(
        true if known else described,
        unknown=UNKNOWN,
        sensors=given,
        adaptation="none" if known else adaptation,
    )
    path: Trajectory = Sway(described, way)
    duration = 4.0
    if motion == "crawl":
        path = crawl = Crawl(length=height / 4.0, height=height / 6.0).on(described)
        assert crawl.settles is not None
        duration = crawl.settles + 1.0
    force = PUSH * push * np.array([math.cos(angle), math.sin(angle), 0.0])
    rollout = pa.simulate(
        true, controller, path, duration=duration, sensors=given, seed=case_seed,
        engine=pa.Engine(lambda robot, **options: Pushed(robot, force, **options)), progress=False,
    )  # fmt: skip
    rise = np.abs(rollout.x[:, 2] - rollout.x_d[:, 2])
    last = rollout.t > rollout.t[-1] - 1.0
    if rollout.diverged is not None or rise.max() > FALLEN * height:
        return {"status": "diverged", "reason": f"fell after {rollout.t[-1]:.1f} s"}
    assert rollout.angle is not None
    trunk = described.model.getJointId("base_roll")
    return {
        "largest": float(rollout.distance.max()),
        "last": float(rollout.distance[last].max()),
        "angle": float(rollout.angle[last].max()),
        "height": float(rise.max()),
        "found": float(rollout.learned().model.inertias[trunk].mass),
        "true": float(true.model.inertias[trunk].mass),
    }


# --- tables ---


def _mm(value: float | None) -> str:
    """Return a length in mm with two digits, or where there is none."""
    return "fell" if value is None else f"{1e3 * value:.2g} mm"


def _words(row: Row) -> str:
    """Return robot, load and motion of a row."""
    load = f"{'up to ' * bool(row['varied'])}{row['load']:g} kg"
    return f"`{row['robot']}` + {load}" + " crawls" * (row["motion"] == "crawl")


def report(rows: Iterable[Row]) -> str:
    """Return the table of perfect sensors: each robot and load, with and without adaptation."""
    lines, perfect = [], [row for row in rows if not row["sensors"]]  # by default
    for own in grouped(perfect, "robot", "load", "motion").values():
        runs = {row["adaptation"]: row for row in own}
        row = runs["natural-memory"]
        numbers = ["", ""]
        if row["status"] == "done":
            numbers = [
                f"{math.degrees(row['angle']):.2g}°",
                f"{row['found']:.2f} / {row['true']:.2f}",
            ]
        errors = runs["none"]["last"], row["largest"], row["last"]
        lines.append([_words(row), *map(_mm, errors), *numbers])
    head = ["robot, load", "not adapted", "largest", "last second", "angle then"]
    return markdown([*head, "trunk found / true [kg]"], lines)


def rough(rows: Iterable[Row]) -> str:
    """Return the table of sensors, pushes and random loads."""
    chosen = [row for row in rows if row["sensors"]]
    chosen = [row for row in chosen if row["adaptation"] != "none" or row["varied"]]
    keys = "robot", "load", "motion", "sensors", "push", "varied", "adaptation"
    others = {"none": ", not adapted", "known": ", known"}
    lines = []
    for own in grouped(chosen, *keys).values():
        row, held = own[0], [row for row in own if row["status"] == "done"]
        what = _words(row) + ", pushed" * bool(row["push"]) + others.get(row["adaptation"], "")
        worst = (
            _mm(max((row[key] for row in held), default=None))
            for key in ("largest", "last", "height")
        )
        lines.append([what, row["sensors"], f"{len(own) - len(held)} of {len(own)}", *worst])
    head = ["robot, load", "sensors", "fell", "largest", "last second", "of the height"]
    return markdown(head, lines)
