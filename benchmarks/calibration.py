"""Arms with wrong geometry: errors of the position before and after a calibration from a log.

``make calibration.table`` runs the sweep ``calibration.toml``: 13 arms of each of eight robots.
Each placement of an arm, of every joint and of the tool, is off by 2 mm in a random direction and
turned by 2 degrees about a random axis, and each encoder is off by 1 degree (1 mm). A log has 200
to 400 random configurations within 1.5 rad of home, encoders of 17 bits a turn and a tracker with
noise of 0.1 to 0.3 mm, and of 1 mrad where it measures poses. The tracker is in the axes of the
base, or anywhere. A quarter of the frames is held out; besides, the calibrated arm is compared with
the true one, without noise, at 200 other configurations.

``make geometry_online.table`` runs the sweep ``geometry_online.toml``: such arms with right
encoders follow a circle for 6 s at 500 Hz with default gains, tool or whole geometry unknown.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.description.chain import configuration_from_angles
from pinadapt.identification import calibrate

from .shared import COUNT, Row, grouped, markdown, rms, spread

TURN, SHIFT, OFFSET = np.radians(2.0), 2e-3, np.radians(1.0)
SLIDE_OFFSET = 1e-3  # m
WIDTH, SLIDE_WIDTH = 1.5, 0.1  # rad and m, from home
NOISE, TURN_NOISE = (1e-4, 3e-4), 1e-3  # m, rad
FRAMES = (200, 400)
DURATION, PERIOD = 6.0, 2e-3  # s, of a circle


def wrong_arm(
    robot: pa.Robot, rng: np.random.Generator, turn: float = TURN, shift: float = SHIFT
) -> pa.Robot:
    """Return a robot with each placement turned and shifted by so much, in random directions."""
    model = robot.model.copy()
    tip = model.frames[robot.frame_id]
    for joint in range(1, model.njoints):
        model.jointPlacements[joint] = model.jointPlacements[joint] * _small(rng, turn, shift)
    tip.placement = tip.placement * _small(rng, turn, shift)
    return replace(robot, model=model)


def _small(rng: np.random.Generator, turn: float, shift: float) -> pin.SE3:
    axis = rng.standard_normal(3)
    way = rng.standard_normal(3)
    return pin.SE3(pin.exp3(turn * axis / np.linalg.norm(axis)), shift * way / np.linalg.norm(way))


def random_angles(robot: pa.Robot, rng: np.random.Generator, count: int) -> np.ndarray:
    """Return random joint positions (count, n) around home, within the limits [rad or m]."""
    model = robot.model
    home = robot.home_angles
    width = np.where(list(robot.slides.values()), SLIDE_WIDTH, WIDTH)
    low = home - width
    high = home + width
    for j, joint in enumerate(model.joints[1:]):
        if joint.nq == 1:
            low[j] = max(low[j], model.lowerPositionLimit[joint.idx_q])
            high[j] = min(high[j], model.upperPositionLimit[joint.idx_q])
    return rng.uniform(low, high, (count, model.nv))


def measured(
    real: pa.Robot,
    angles: np.ndarray,
    rng: np.random.Generator,
    *,
    noise: float = 0.0,
    offsets: np.ndarray | float = 0.0,
    pose: bool = False,
    tracker: pin.SE3 | None = None,
) -> pa.Log:
    """Return the log of an arm at joint positions (N, n), as its encoders read them.

    Args:
        real: the arm.
        angles: readings [rad or m].
        rng: of the noise.
        noise: of a coordinate of the position [m].
        offsets: (n) what the joints are beyond their encoders [rad or m].
        pose: whether orientations are measured too.
        tracker: placement of the base in the axes of x; None: it is the origin.
    """
    base = pin.SE3.Identity() if tracker is None else tracker
    x = []
    for reading in angles + offsets:
        at = base * real.placement(configuration_from_angles(real.model, reading))
        place = at.translation + noise * rng.standard_normal(3)
        if pose:
            R = pin.exp3(TURN_NOISE * bool(noise) * rng.standard_normal(3)) @ at.rotation
            place = np.concatenate([place, pin.Quaternion(R).coeffs()])
        x.append(place)
    times = np.arange(float(len(x)))
    unknown = np.full(angles.shape, np.nan)
    return pa.Log(times, angles, unknown, x=np.array(x))


def measure(robot: str, frames: str, number: int) -> dict[str, Any]:
    """Return errors of one arm in mm, before and after, and what its motion identifies."""
    described = pa.load(robot)
    rng = np.random.default_rng([zlib.crc32(robot.encode()), number])
    real = wrong_arm(described, rng)
    slides = np.array(list(described.slides.values()))
    offsets = np.where(slides, SLIDE_OFFSET, OFFSET) * rng.choice([-1.0, 1.0], len(slides))
    noise = rng.uniform(*NOISE)
    count = int(rng.integers(*FRAMES))
    step = COUNT[17] * np.where(slides, SLIDE_WIDTH, 1.0)
    angles = np.round(random_angles(described, rng, count) / step) * step
    anywhere = frames != "position"
    tracker = pin.SE3(pin.exp3(rng.uniform(-2.0, 2.0, 3)), rng.uniform(-1.0, 1.0, 3))
    place = tracker if anywhere else None
    log = measured(real, angles, rng, noise=noise, offsets=offsets, pose=anywhere, tracker=place)
    found = calibrate(log, described, tracker=anywhere)
    others = random_angles(described, rng, 200)
    true = measured(real, others, rng, offsets=offsets, tracker=place).x
    seen = measured(found.robot, others, rng, tracker=found.tracker).x
    assert true is not None and seen is not None
    return {
        "before": 1e3 * found.before.position,
        "after": 1e3 * found.after.position,
        "true": 1e3 * rms(np.linalg.norm(true - seen, axis=1)),
    }


def follow(robot: str, unknown: str, number: int) -> dict[str, Any]:
    """Return errors in mm of a circle that a wrong arm follows, learning while it moves."""
    described = pa.load(robot)
    rng = np.random.default_rng([zlib.crc32(robot.encode()), number])
    real = wrong_arm(described, rng)
    controller = pa.make_controller(
        described, unknown=pa.Unknown(geometry=unknown == "geometry"), dt=PERIOD
    )
    circle = pa.reachable_circle(described).starting_at(real.position(real.q0))
    run = pa.simulate(real, controller, circle, duration=DURATION, progress=False)
    return {"last": 1e3 * float(run.distance[run.t > 0.9 * DURATION].max())}


def report(rows: Iterable[Row]) -> str:
    """Return a table in Markdown: median / largest error of the arms of all types, in mm."""
    lines = [
        [
            frames,
            len(own),
            *(spread(row[key] for row in own) for key in ("before", "after", "true")),
        ]
        for frames, own in grouped(rows, "frames").items()
    ]
    return markdown(["frames", "arms", "described", "calibrated", "true error"], lines)
