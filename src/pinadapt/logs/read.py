"""``read_log``: from any file or folder to a checked log; the registry of formats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from .._checks import instance, name_list
from ..description.chain import is_slide
from ..exceptions import LogError
from ..robot.robot import Robot
from .bag import Bag
from .columns import Selection
from .formats import Csv, Format, Npz, RolloutFile
from .log import Log, check

# The first format that accepts a path reads it.
FORMATS: Mapping[str, Format] = {
    "rollout": RolloutFile(),
    "npz": Npz(),
    "csv": Csv(),
    "bag": Bag(),
}


def read_log(
    source: Path | str | Log,
    robot: Robot,
    *,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    degrees: bool = False,
    topic: str | None = None,
    pose_topic: str | None = None,
) -> Log:
    """Return a recorded motion of a robot, checked, its columns in the order of the joints.

    Units are rad, m, N m, N and s.

    Args:
        source: a folder or ``rollout.npz`` that `pinadapt run` has written; an npz or CSV file with
            t, q, tau and optionally v and x, by the joints' names or indices; a bag of ROS 1 or 2
            or MCAP (extra ``bags``); or a ``Log``.
        robot: whose motion it is.
        columns: signal (t, q, v, tau, x, x_time) -> names of its columns in the robot's order, or
            one with a ``*`` for each joint's name or index, for columns of unusual names.
        degrees: whether angles and their velocities are in degrees.
        topic: of a bag's joint states, where there are several.
        pose_topic: of the frame's position: PointStamped, PoseStamped or TransformStamped.

    Raises:
        LogError: no such file, an unknown format, a missing signal or joint, or impossible numbers;
            see ``check``.
    """
    instance(robot, Robot, "robot")
    if not isinstance(source, Log):
        named = {key: name_list(names, "columns") for key, names in (columns or {}).items()}
        selection = Selection(robot.joint_names, named, topic, pose_topic)
        source = _read(Path(instance(source, Path | str, "log")), selection)
    log = source.of(robot).from_zero()
    if degrees:
        log = _in_radians(log, robot)
    check(log, robot)
    return log


def _read(path: Path, selection: Selection) -> Log:
    if not path.exists():
        raise LogError("there is no such file or folder.", where=str(path))
    for kind in FORMATS.values():
        if kind.accepts(path):
            return kind.read(path, selection)
    known = ", ".join(suffix for kind in FORMATS.values() for suffix in kind.suffixes)
    raise LogError(
        "is not a log of a known format.",
        where=str(path),
        hint=f"Known are {known}, folders of `pinadapt run`, which have a rollout.npz, and those "
        "of bags, which have a metadata.yaml.",
    )


def _in_radians(log: Log, robot: Robot) -> Log:
    """Return a log whose angles were in degrees."""
    if log.q.shape[1] != robot.model.nv:
        return log
    scale = np.array(
        [1.0 if is_slide(joint) else np.pi / 180.0 for joint in robot.model.joints[1:]]
    )
    return replace(log, q=log.q * scale, v=None if log.v is None else log.v * scale)
