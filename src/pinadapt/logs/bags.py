"""Bags of ROS 1 and 2, and MCAP files: joint states, trajectories and poses."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from .._checks import optional
from ..exceptions import LogError
from .import_options import ImportOptions
from .log import Log

_STATES = ("sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory")


# What has the position, and what the rotation as a quaternion
_POSES = {
    "geometry_msgs/msg/PointStamped": ("point", ""),
    "geometry_msgs/msg/PoseStamped": ("pose.position", "pose.orientation"),
    "geometry_msgs/msg/TransformStamped": ("transform.translation", "transform.rotation"),
}


def read_bag(path: Path, joints: Sequence[str], options: ImportOptions) -> Log:
    """Return the log in a bag: one sample a message that has all joints of the robot.

    Times are those of the headers, or of the bag where these are not set. Messages are sorted by
    time, and repeated times are left out. Velocities and efforts that a message leaves out were not
    measured.

    Raises:
        LogError: it cannot be read, has no such topic, or lacks a joint.
    """
    reader = optional("rosbags.highlevel", "bags", str(path), LogError)
    types = optional("rosbags.typesys", "bags", str(path), LogError)
    x = x_time = None
    # for messages whose types it does not hold
    store = types.Stores.ROS1_NOETIC if path.suffix.lower() == ".bag" else types.Stores.ROS2_HUMBLE
    with reader.AnyReader([path], default_typestore=types.get_typestore(store)) as bag:
        topic = _topic(bag, options.topic, _STATES, path)
        t, (q, v, tau) = _series(bag, topic, list(joints), path)
        if options.pose_topic is not None:
            topic = _topic(bag, options.pose_topic, _POSES, path)
            position, rotation = _POSES[str(bag.topics[topic].msgtype)]
            parts = [f"{position}.{axis}" for axis in "xyz"]
            parts += [f"{rotation}.{axis}" for axis in "xyzw" if rotation]
            of = attrgetter(*parts)
            found = np.array([[time, *of(message)] for time, message in _messages(bag, topic)])
            x = found[:, 1:]
            x_time = found[:, 0] - t[0]
    return Log(
        t - t[0],
        q,
        tau,
        v if np.isfinite(v).any() else None,
        tuple(joints),
        x,
        x_time,
        source=str(path),
    )


def _topic(bag: Any, stated: str | None, kinds: Collection[str], path: Path) -> str:
    """Return the stated topic, or the only one, of some types of messages.

    Raises:
        LogError: it does not exist, or none or several have such messages.
    """
    topics = {name: info.msgtype for name, info in bag.topics.items()}
    suitable = [name for name, kind in topics.items() if kind in kinds]
    chosen = suitable if stated is None else [stated]
    if len(chosen) != 1 or chosen[0] not in suitable:
        listed = ", ".join(f"{name} ({kind})" for name, kind in sorted(topics.items()))
        raise LogError(
            f"{len(suitable)} topics have {' or '.join(kinds)}; its topics: {listed}.",
            where=path,
            hint="--topic NAME says which has the joints, --pose-topic NAME which has x.",
        )
    return chosen[0]


def _messages(bag: Any, topic: str) -> Iterator[tuple[float, Any]]:
    """Yield time [s], of the header or else of the bag, and content of each message."""
    for connection, received, raw in bag.messages(bag.topics[topic].connections):
        message = bag.deserialize(raw, connection.msgtype)
        yield _seconds(message.header.stamp) or 1e-9 * received, message


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def _states(bag: Any, topic: str) -> Iterator[tuple[float, list[str], tuple[Any, ...]]]:
    """Yield time [s], names of joints, and their positions, velocities and efforts."""
    for t, message in _messages(bag, topic):
        if hasattr(message, "points"):  # a trajectory
            for one in message.points:
                parts = one.positions, one.velocities, one.effort
                yield t + _seconds(one.time_from_start), message.joint_names, parts
        else:
            yield t, message.name, (message.position, message.velocity, message.effort)


def _series(bag: Any, topic: str, wanted: list[str], path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return times (N) [s], and positions, velocities and efforts (3, N, n).

    Raises:
        LogError: no message has all joints.
    """
    missing = np.full(len(wanted), np.nan)
    rows: dict[float, list[np.ndarray]] = {}
    others: set[str] = set()
    for t, names, parts in _states(bag, topic):
        if not set(wanted) <= set(names):
            others |= set(names)
            continue
        order = [names.index(name) for name in wanted]
        rows.setdefault(
            t, [np.array(part)[order] if len(part) == len(names) else missing for part in parts]
        )
    if not rows:
        raise LogError(
            f"no message of '{topic}' has all of the joints {wanted}; there are {sorted(others)}.",
            where=path,
            hint="Record a topic with all joints in one message, such as that of "
            "joint_state_broadcaster, or name the log's: --joints A,B,....",
        )
    times = sorted(rows)
    return np.array(times), np.array([rows[time] for time in times]).swapaxes(0, 1)
