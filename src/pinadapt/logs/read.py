"""From any file or folder to a log; one registry of formats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from .._checks import instance, name_list
from ..description.chain import is_slide
from ..exceptions import LogError
from ..robot.robot import Robot
from . import bag, csv, npz, rollout
from .check import check
from .columns import Wanted
from .log import Log


class Format(Protocol):
    """A kind of file: a module with these two functions."""

    def accepts(self, path: Path) -> bool:
        """Tell whether a path looks like one, without reading all of it."""

    def read(self, path: Path, wanted: Wanted) -> Log:
        """Return the log of a path.

        Raises:
            LogError: it cannot be read.
        """


# The first one that accepts a path reads it.
FORMATS: Mapping[str, Format] = {"rollout": rollout, "npz": npz, "csv": csv, "bag": bag}


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
            t, q, tau and, if there are, v and x, by joints' names or indices; a bag of ROS 1 or 2
            or MCAP (extra ``bags``); or a ``Log``.
        robot: whose motion it is.
        columns: signal (t, q, v, tau, x, x_time) -> names of its columns in the robot's order, or
            one with a ``*`` for each joint's name or index, where they are not found by themselves.
        degrees: whether angles and their velocities are in degrees.
        topic: of a bag's joint states, where there are several.
        pose_topic: of the frame's position: PointStamped, PoseStamped or TransformStamped.

    Raises:
        LogError: no such file, of no known kind, a missing signal or joint, or numbers that cannot
            be; see ``check``.
    """
    instance(robot, Robot, "robot")
    if not isinstance(source, Log):
        named = {key: name_list(names, "columns") for key, names in (columns or {}).items()}
        wanted = Wanted(robot.joint_names, named, topic, pose_topic)
        source = _read(Path(instance(source, Path | str, "log")), wanted)
    log = source.of(robot).of_its_own_clock()
    if degrees:
        log = _radians(log, robot)
    check(log, robot)
    return log


def _read(path: Path, wanted: Wanted) -> Log:
    if not path.exists():
        raise LogError("there is no such file or folder.", where=str(path))
    for kind in FORMATS.values():
        if kind.accepts(path):
            return kind.read(path, wanted)
    folder = "a folder of `pinadapt run` holds rollout.npz, one of a bag metadata.yaml"
    raise LogError(
        "is no log that can be read.",
        where=str(path),
        hint=f"Known are .npz, {', '.join(csv.SUFFIXES)}, {', '.join(bag.SUFFIXES)}; {folder}.",
    )


def _radians(log: Log, robot: Robot) -> Log:
    """Return a log whose angles were in degrees."""
    if log.q.shape[1] != robot.model.nv:
        return log
    scale = np.array(
        [1.0 if is_slide(joint) else np.pi / 180.0 for joint in robot.model.joints[1:]]
    )
    return replace(log, q=log.q * scale, v=None if log.v is None else log.v * scale)
