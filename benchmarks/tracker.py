"""An uncalibrated tracker: the error while its axes are learned, and in the end.

``make tracker.table`` runs the sweep ``tracker.toml``. The tracker is turned against the base by
some angle about a random axis and stands up to a metre away in each coordinate. Unknown are that, a
tool of 5 % of the reach, a load of 5 % of the mass, every inertia (30 % too small in the model) and
friction and rotors, of which the arm has none. The arm follows a circle within its workspace for
8 s, begun at rest, with default gains at 500 Hz. A small motion of all joints comes first,
for two seconds ("excited"); or the arm begins as soon as motions of millimetres have identified the
axes. Sensors are
perfect, or the tracker has 30 frames a second that are 60 ms late with noise of 1 mm. For poses the
marker is turned on the tool as well, by 79 degrees, and the tool tilts by 17 degrees and back
during each 2 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.tasks.frame import matrix, quaternion

from .shared import Row, grouped, markdown, quiet
from .uncalibrated import DURATION, PERIOD, errors, in_percent, random_of, sensors_of, spoiled

WAITING, NOISY = 4.0, 30.0  # [s] and [s m^2] over the reach's square, longer without an excitation
TILT, MARKER = 0.3, np.array([0.5, -1.0, 0.8])  # [rad]
NOISE = 1e-3  # [m]


@quiet()
def measure(robot: str, angle: float, start: str, sensors: str) -> dict[str, Any]:
    """Return largest errors relative to the radius, of poses those of orientation [deg] too."""
    posed = start.startswith("pose")
    described = pa.load(robot, task="pose" if posed else None)
    rng = random_of(robot)
    axis = rng.standard_normal(3)
    place = rng.uniform(-1.0, 1.0, 3)
    turn = np.radians(angle) * axis / np.linalg.norm(axis)
    real = spoiled(described)
    real = with_marker(real) if posed else real
    circle = pa.reachable_circle(described).starting_at(real.position(real.q0))
    R = pin.exp3(turn)

    def path(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        x_d, xd_d, xdd_d = circle.at(t)
        seen = R @ x_d[:3] + place, R @ xd_d[:3], R @ xdd_d[:3]
        if not posed:
            return seen
        z = R[:, 2]
        w = 0.5 * np.pi
        tilt = TILT * np.array([np.sin(w * t) ** 2, w * np.sin(2 * w * t), 0.0])
        tilt[2] = TILT * 2.0 * w**2 * np.cos(2 * w * t)
        turned = quaternion(pin.exp3(tilt[0] * z) @ R @ matrix(x_d[3:]))
        parts = turned, tilt[1] * z, tilt[2] * z
        x_d, xd_d, xdd_d = (np.append(*each) for each in zip(seen, parts, strict=True))
        return x_d, xd_d, xdd_d

    duration = DURATION
    at_once = start.endswith("at once")
    if at_once:
        duration += WAITING + (NOISY / described.reach**2 if sensors == "camera" else 0.0)
    controller = pa.make_controller(
        described,
        unknown=pa.Unknown(tracker=True),
        sensors=sensors_of(sensors, NOISE),
        dt=PERIOD,
    )
    rollout = pa.simulate(
        real.seen_from(turn, place),
        controller,
        path,
        duration=duration,
        start={} if at_once else None,
        progress=False,
    )
    assert circle.extent is not None
    found = errors(rollout, circle.extent, duration)
    t = rollout.t
    if rollout.diverged is not None:
        return found
    if rollout.path_time is not None:
        found["waited"] = float(t[np.argmax(rollout.path_time > 0.0)])
    if rollout.angle is not None:
        late = t > duration - 0.1 * DURATION
        found["turned"] = float(np.degrees(rollout.angle.max()))
        found["last_turned"] = float(np.degrees(rollout.angle[late].max()))
    return found


def with_marker(robot: pa.Robot) -> pa.Robot:
    """Return a robot whose frame is that of a marker which is turned on the tool."""
    model = robot.model.copy()
    frame = model.frames[robot.frame_id]
    frame.placement = frame.placement * pin.SE3(pin.exp3(MARKER), np.zeros(3))
    return replace(robot, model=model)


STARTS = {
    "excited": "excitation of 2 s first",
    "at once": "at once",
    "pose, excited": "pose, excitation of 2 s first",
    "pose, at once": "pose, at once",
}


def report(rows: Sequence[Row]) -> str:
    """Return a table in Markdown: the worst of arms and angles, in % of the radius, by start.

    Largest error of the run and of its last tenth, of poses that of the orientation too, and the
    time at which the path begins.
    """
    lines = [
        [STARTS[start], *map(_worst, grouped(own, "sensors").values())]
        for start, own in grouped(rows, "start").items()
    ]
    return markdown(["start", *grouped(rows, "sensors")], lines)


def _worst(rows: Sequence[Row]) -> str:
    if not all(row["status"] == "done" for row in rows):
        return "lost"
    keys = ("largest", "last", "turned", "last_turned", "waited")
    found = {key: max(row[key] for row in rows) for key in keys if rows[0][key] is not None}
    parts = [in_percent(found)]
    if "turned" in found:
        parts.append(f"{found['turned']:.2g}° / {found['last_turned']:.2g}°")
    if "waited" in found:
        parts.append(f"{found['waited']:.3g} s")
    return ", ".join(parts)
