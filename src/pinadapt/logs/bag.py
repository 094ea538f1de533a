"""Bags of ROS 1 and 2 and MCAP files: joint states by name, optionally a pose of the frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..exceptions import LogError, did_you_mean
from .columns import Selection
from .formats import Format
from .log import Log

_JOINTS = "sensor_msgs/msg/JointState"
_INSTALL = 'Install it: pip install "pinadapt[bags]".'


def _position(part: Any) -> list[float]:
    return [part.x, part.y, part.z]


def _pose(position: Any, rotation: Any) -> list[float]:
    return [*_position(position), rotation.x, rotation.y, rotation.z, rotation.w]


# Message type -> coordinates (3) or (7), position and quaternion xyzw.
_POSES: dict[str, Callable[[Any], list[float]]] = {
    "geometry_msgs/msg/PointStamped": lambda m: _position(m.point),
    "geometry_msgs/msg/PoseStamped": lambda m: _pose(m.pose.position, m.pose.orientation),
    "geometry_msgs/msg/TransformStamped": lambda m: _pose(
        m.transform.translation, m.transform.rotation
    ),
}


class Bag(Format):
    """A bag of ROS 1 or 2 or an MCAP file with joint states, optionally with a pose topic."""

    suffixes = (".bag", ".mcap", ".db3")

    def accepts(self, path: Path) -> bool:
        """Tell whether a path looks like a bag: a file, or a folder of ROS 2."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return path.suffix.lower() in self.suffixes

    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log in a bag: one sample a message that has all joints of the robot.

        Times are those of the headers, or of the bag where these are not set. Messages are sorted
        by time, and repeated times are left out. Velocities and efforts that a message leaves out
        were not measured.

        Raises:
            LogError: it cannot be read, has no such topic, or lacks a joint.
        """
        with _opened(path) as bag:
            names, topic = (
                list(selection.joints),
                _topic(bag, selection.topic, (_JOINTS,), path, "topic"),
            )
            order, rows = None, []
            for time, message in _messages(bag, topic):
                if order is None or [message.name[i] for i in order] != names:
                    order = _order(list(message.name), names)
                if order is not None:
                    fields = message.position, message.velocity, message.effort
                    rows.append((time, *(_picked(part, order, message.name) for part in fields)))
            if not rows:
                raise _missing(bag, topic, names, path)
            x_time, x = None, None
            if selection.pose_topic is not None:
                pose = _topic(bag, selection.pose_topic, tuple(_POSES), path, "pose-topic")
                of = _POSES[bag.topics[pose].msgtype]
                frames = [(time, of(message)) for time, message in _messages(bag, pose)]
                x_time = np.array([time for time, _ in frames])
                x = np.array([frame for _, frame in frames])
        _, once = np.unique([row[0] for row in rows], return_index=True)
        t, q, v, tau = (np.array([rows[i][k] for i in once]) for k in range(4))
        if not np.isfinite(tau).any():
            raise LogError(
                f"the joint states of '{topic}' have no effort, and without torques no dynamic "
                "parameters can be estimated.",
                where=str(path),
                hint="Record the topic of a driver that publishes effort.",
            )
        start = t[0]
        return Log(
            t - start,
            q,
            tau,
            v if np.isfinite(v).any() else None,
            tuple(names),
            x,
            None if x_time is None else x_time - start,
            source=str(path),
        )


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a bag with the message types that it holds, or else those of ROS 2 Humble."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise LogError(
            f"a bag needs the package rosbags: {error}.", where=str(path), hint=_INSTALL
        ) from error
    store = Stores.ROS1_NOETIC if path.suffix.lower() == ".bag" else Stores.ROS2_HUMBLE
    try:
        with AnyReader([path], default_typestore=get_typestore(store)) as bag:
            yield bag
    except (AnyReaderError, OSError) as error:
        raise LogError(f"cannot be read: {error}.", where=str(path)) from error


def _topic(bag: Any, named: str | None, kinds: tuple[str, ...], path: Path, option: str) -> str:
    """Return the topic that was named, or the only one of some message types."""
    found = {name: info.msgtype for name, info in bag.topics.items()}
    fitting = [name for name, kind in found.items() if kind in kinds]
    if named is None and len(fitting) == 1:
        return fitting[0]
    if named in fitting:
        return str(named)
    wanted = " or ".join(kind.replace("/msg/", "/") for kind in kinds)
    if named is None:
        what = f"has {len(fitting)} topics of type {wanted}: {fitting}"
        hint = f"Say which: --{option} NAME." if fitting else f"Its topics: {sorted(found)}."
    else:
        kind = found.get(named)
        what = f"'{named}' is {'not a topic of it' if kind is None else f'of type {kind}'}"
        hint = f"Topics of type {wanted}: {fitting}.{did_you_mean(named, fitting)}"
    raise LogError(f"{what}.", where=str(path), hint=hint)


def _messages(bag: Any, topic: str) -> Iterator[tuple[float, Any]]:
    """Yield time [s] and content of each message."""
    for connection, received, raw in bag.messages(bag.topics[topic].connections):
        message = bag.deserialize(raw, connection.msgtype)
        stamp = message.header.stamp
        time = stamp.sec + 1e-9 * stamp.nanosec
        yield (time if time > 0.0 else 1e-9 * received), message


def _order(names: list[str], joints: list[str]) -> list[int] | None:
    """Return the index of each joint in a message, None where not all are in it."""
    return [names.index(joint) for joint in joints] if set(joints) <= set(names) else None


def _picked(values: Any, order: list[int], names: list[str]) -> list[float]:
    """Return the values of the joints; NaN where a message leaves them out."""
    whole = len(values) == len(names)
    return [float(values[i]) if whole else np.nan for i in order]


def _missing(bag: Any, topic: str, joints: list[str], path: Path) -> LogError:
    """Return the error of a topic none of whose messages has all joints."""
    names = sorted({name for _, message in _messages(bag, topic) for name in message.name})
    lacking = [joint for joint in joints if joint not in names]
    if not lacking:
        return LogError(
            f"no message of '{topic}' has all of the joints {joints}; they are in separate ones.",
            where=str(path),
            hint="Record a topic with all joints, such as that of joint_state_broadcaster.",
        )
    return LogError(
        f"no message of '{topic}' has the robot's joint '{lacking[0]}'; there are {names}."
        f"{did_you_mean(lacking[0], names)}",
        where=str(path),
        hint="Lock joints that are not in it (--lock), or choose another frame or topic.",
    )
