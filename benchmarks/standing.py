"""Robots that stand and crawl in MuJoCo, with a load on the trunk that nobody announced.

``make standing.table`` runs the sweep ``standing.toml``. Friction 0.6, 1 kHz, nothing tuned by
robot: with ``motion`` "sway" the trunk moves on a circle of 15 mm and pitches by 0.1 rad in 2 s;
with "crawl" it takes twelve steps of a sixth of its height. Sensors are perfect, or by a word:
encoders of 17 or 14 bits, and "imu": then nothing but the legs and an IMU that is off by 0.3 deg
measures the base. A push of 30 N for 0.5 s on the trunk comes from a random side.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
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

from .timing import markdown

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
        self.start, self.turn = robot.position(robot.q0), np.array([0.0, 0.1, 0.0])
        self.way = np.array(way)

    def at(self, t: float) -> Desired:
        """Return the pose of the trunk at time t [s]."""
        w, (s, sd, sdd) = math.pi, minimum_jerk(min(max(t, 0.0), 1.0))
        phase = w * t + np.array([0.0, math.pi / 2.0, 0.0])
        g, gd, gdd = np.sin(phase), w * np.cos(phase), -w * w * np.sin(phase)
        h, hd, hdd = g[0], gd[0], gdd[0]
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

    The errors are those of the trunk: the largest of the run, the last second's, of its height, and
    of the footholds of a crawl.
    """
    described, rng = standing(robot), np.random.default_rng(case_seed)
    height, way = described.q0[2], np.array(WAY)
    com = height * np.array([0.2, 0.08, 0.32])
    if varied:
        load *= rng.uniform()
        com, way = com * rng.uniform(-1.0, 1.0, 3), way * rng.uniform(-1.3, 1.3, 3)
        com[2] = abs(com[2])
    angle = rng.uniform(-math.pi, math.pi)
    payload = pa.Payload(load, com) if load else None
    true = described.changed(payload=payload)
    words = sensors.split(", ")
    bits = next((int(word.split()[0]) for word in words if word.endswith("bit")), None)
    given = pa.Sensors(
        encoder=0.0 if bits is None else 2.0 * math.pi / 2**bits,
        imu=pa.Imu(tilt=TILT) if "imu" in words else None,
    )
    model = true if adaptation == "known" else described
    kind = "none" if adaptation == "known" else adaptation
    controller = pa.make_controller(model, unknown=UNKNOWN, sensors=given, adaptation=kind)
    path: Any = Sway(described, way)
    if motion == "crawl":
        path = Crawl(length=height / 4.0, height=height / 6.0).on(described)
    duration = 4.0 if motion == "sway" else path.settles + 1.0
    force = PUSH * push * np.array([math.cos(angle), math.sin(angle), 0.0])
    rollout = pa.simulate(
        true, controller, path, duration=duration, sensors=given, seed=case_seed,
        engine=pa.Engine(lambda robot, **options: Pushed(robot, force, **options)), progress=False,
    )  # fmt: skip
    t, error = rollout.t, rollout.distance
    rise = np.abs(rollout.x[:, 2] - rollout.x_d[:, 2])
    found = dict.fromkeys(("largest", "last", "angle", "height", "slip", "found", "true", "step"))
    if rollout.diverged is not None or rise.max() > FALLEN * height:
        return found | {"status": "diverged", "reason": f"fell after {t[-1]:.1f} s"}
    trunk = described.model.getJointId("base_roll")
    found |= {
        "largest": float(error.max()),
        "last": float(error[t > t[-1] - 1.0].max()),
        "angle": 0.0 if rollout.angle is None else float(rollout.angle[t > t[-1] - 1.0].max()),
        "height": float(rise.max()),
        "found": float(rollout.learned().model.inertias[trunk].mass),
        "true": float(true.model.inertias[trunk].mass),
        "step": rollout.step_time,
    }
    if motion == "crawl":
        data = described.model.createData()
        pin.framesForwardKinematics(described.model, data, rollout.q[-1])
        frames = [described.model.getFrameId(each.frame) for each in described.contacts]
        feet = np.array([data.oMf[frame].translation for frame in frames])
        found["slip"] = float(np.linalg.norm(feet - path.footholds[-1], axis=1).max())
    return found


# --- tables ---


def _mm(value: float | None) -> str:
    """Return a length in mm with two digits, or where there is none."""
    return "fell" if value is None else f"{1e3 * value:.2g} mm"


def report(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return the table of perfect sensors: each robot and load, with and without adaptation."""
    lines, rows = [], [row for row in rows if not row["sensors"]]  # perfect by default
    for row in rows:
        if row["adaptation"] != "natural-memory" or row["push"]:
            continue
        same = ("robot", "load", "motion")
        other = next(
            each for each in rows
            if each["adaptation"] == "none" and all(each[key] == row[key] for key in same)
        )  # fmt: skip
        what = f"`{row['robot']}` + {row['load']:g} kg" + " crawls" * (row["motion"] == "crawl")
        numbers = ["", ""]
        if row["found"] is not None:
            numbers = [
                f"{math.degrees(row['angle']):.2g}°",
                f"{row['found']:.2f} / {row['true']:.2f}",
            ]
        lines.append([what, _mm(other["last"]), _mm(row["largest"]), _mm(row["last"]), *numbers])
    head = ["robot, load", "not adapted", "largest", "last second", "angle then"]
    return markdown([*head, "trunk found / true [kg]"], lines)


def rough(rows: Iterable[Mapping[str, Any]]) -> str:
    """Return the table of sensors, pushes and random loads."""
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["sensors"] and (row["adaptation"] != "none" or row["varied"]):
            key = row["robot"], row["load"], row["motion"], row["sensors"], row["push"]
            groups.setdefault((*key, row["varied"], row["adaptation"]), []).append(row)
    lines = []
    for (robot, load, motion, sensors, push, varied, kind), own in groups.items():
        held = [row for row in own if row["last"] is not None]
        what = f"`{robot}` + {'up to ' * bool(varied)}{load:g} kg" + " crawls" * (motion == "crawl")
        what += ", pushed" * bool(push) + {"none": ", not adapted", "known": ", known"}.get(
            kind, ""
        )
        worst = [max((row[key] for row in held), default=None) for key in ("largest", "last")]
        heights = max((row["height"] for row in held), default=None)
        fell = f"{len(own) - len(held)} of {len(own)}"
        lines.append([what, sensors, fell, *map(_mm, worst), _mm(heights)])
    head = ["robot, load", "sensors", "fell", "largest", "last second", "of the height"]
    return markdown(head, lines)
