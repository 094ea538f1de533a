"""Bags of ROS 1 and 2, and MCAP files: joint states, trajectories and poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..exceptions import LogError, did_you_mean
from .columns import Selection
from .log import Log, match_joints

_STATES = ("sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory")


def _pose(position: Any, rotation: Any = None) -> list[float]:
    turn = () if rotation is None else (rotation.x, rotation.y, rotation.z, rotation.w)
    return [position.x, position.y, position.z, *turn]


# Message type -> coordinates (3) or (7), position and quaternion xyzw.
_POSES: dict[str, Callable[[Any], list[float]]] = {
    "geometry_msgs/msg/PointStamped": lambda m: _pose(m.point),
    "geometry_msgs/msg/PoseStamped": lambda m: _pose(m.pose.position, m.pose.orientation),
    "geometry_msgs/msg/TransformStamped": lambda m: _pose(
        m.transform.translation, m.transform.rotation
    ),
}


def read_bag(path: Path, selection: Selection) -> Log:
    """Return the log in a bag: one sample a message that has all joints of the robot.

    Times are those of the headers, or of the bag where these are not set. Messages are sorted by
    time, and repeated times are left out. Velocities and efforts that a message leaves out were not
    measured.

    Raises:
        LogError: it cannot be read, has no such topic, or lacks a joint.
    """
    with _opened(path) as bag:
        topic = _topic(bag, selection, path)
        t, (q, v, tau), joints = _series(bag, topic, selection, path)
        frames = _frames(bag, selection.pose_topic, path)
    if selection.torques and not np.isfinite(tau).any():
        raise LogError(
            f"'{topic}' has no efforts of the joints.",
            where=str(path),
            hint="--topic names another.",
        )
    return Log(
        t - t[0],
        q,
        tau,
        v if np.isfinite(v).any() else None,
        tuple(selection.joints),
        None if frames is None else frames[:, 1:],
        None if frames is None else frames[:, 0] - t[0],
        source=str(path),
        assumed={} if joints == list(selection.joints) else {"joints": joints},
    )


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a bag with the message types that it holds, or else those of ROS 2 Humble."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise LogError(
            f"a bag needs the package rosbags: {error}.",
            where=str(path),
            hint='Install it: pip install "pinadapt[bags]".',
        ) from error
    store = Stores.ROS1_NOETIC if path.suffix.lower() == ".bag" else Stores.ROS2_HUMBLE
    try:
        with AnyReader([path], default_typestore=get_typestore(store)) as bag:
            yield bag
    except (AnyReaderError, OSError) as error:
        raise LogError(f"cannot be read: {error}.", where=str(path)) from error


def _topic(bag: Any, selection: Selection, path: Path) -> str:
    """Return the stated topic of joint states, or the only one.

    Raises:
        LogError: it does not exist, or none or several have joint states.
    """
    states = [name for name, info in bag.topics.items() if info.msgtype in _STATES]
    topic = selection.topic
    if topic is not None and topic not in states:
        words = f"'{topic}' is no topic of joint states. {_contents(bag)}"
        raise LogError(words + did_you_mean(topic, states), where=str(path))
    if topic is None and len(states) != 1:
        raise LogError(
            f"{len(states)} topics have joint states. {_contents(bag)}",
            where=str(path),
            hint="Say which: --topic NAME.",
        )
    return topic or states[0]


def _contents(bag: Any) -> str:
    """Return the topics of a bag in words."""
    topics = sorted((name, info.msgtype) for name, info in bag.topics.items())
    return f"Its topics: {', '.join(f'{name} ({kind})' for name, kind in topics)}."


class _State(NamedTuple):
    """Names of joints, their positions, velocities and efforts, and how late they are [s]."""

    joints: Sequence[str]
    parts: tuple[Sequence[float], Sequence[float], Sequence[float]]
    since: float = 0.0


def _messages(bag: Any, topic: str) -> Iterator[tuple[float, Any]]:
    """Yield time [s], of the header or else of the bag, and content of each message."""
    for connection, received, raw in bag.messages(bag.topics[topic].connections):
        message = bag.deserialize(raw, connection.msgtype)
        yield _seconds(message.header.stamp) or 1e-9 * received, message


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def _states(message: Any) -> Iterator[_State]:
    """Yield the joint state of a message, or of each point of a trajectory."""
    if hasattr(message, "points"):
        for one in message.points:
            parts = one.positions, one.velocities, one.effort
            yield _State(message.joint_names, parts, _seconds(one.time_from_start))
    else:
        yield _State(message.name, (message.position, message.velocity, message.effort))


def _series(
    bag: Any, topic: str, selection: Selection, path: Path
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return times (N) [s], positions, velocities and efforts (3, N, n) and names of the joints.

    Raises:
        LogError: no message has all joints.
    """
    wanted, where = list(selection.joints), f"{path}, {topic}"
    orders: dict[tuple[str, ...], list[int] | None] = {}
    rows: dict[float, list[list[float]]] = {}
    joints: list[str] = []
    for time, message in _messages(bag, topic):
        for state in _states(message):
            names = tuple(state.joints)
            if names not in orders:
                exact = set(wanted) <= set(names)  # other names are matched once
                orders[names] = match_joints(names, wanted, where) if exact or not joints else None
            if (order := orders[names]) is None:
                continue
            joints = joints or [names[k] for k in order]
            values = [
                [float(part[k]) for k in order] if len(part) > max(order) else [np.nan] * len(order)
                for part in state.parts
            ]
            rows.setdefault(time + state.since, values)
    if not rows:
        others = sorted({name for found in orders for name in found})
        raise LogError(
            f"no message of '{topic}' has all of the joints {wanted}; there are {others}.",
            where=str(path),
            hint="Record a topic with all joints in one message, such as that of "
            "joint_state_broadcaster, or name the log's: --joints A,B,....",
        )
    t = np.array(sorted(rows))
    return t, np.array([rows[time] for time in t]).swapaxes(0, 1), joints


def _frames(bag: Any, topic: str | None, path: Path) -> np.ndarray | None:
    """Return times [s] and coordinates (M, 1 + 3 or 7) of a topic of positions or poses."""
    if topic is None:
        return None
    kind = bag.topics[topic].msgtype if topic in bag.topics else "not a topic of it"
    if kind not in _POSES:
        raise LogError(
            f"'{topic}' is {kind}, and has no positions. {_contents(bag)}",
            where=str(path),
            hint=f"Positions are {', '.join(_POSES)}: --pose-topic NAME.",
        )
    return np.array([[time, *_POSES[kind](message)] for time, message in _messages(bag, topic)])
