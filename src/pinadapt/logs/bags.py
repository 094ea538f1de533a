"""Bags of ROS 1 and 2, and MCAP files: joint states, trajectories, arrays and poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..exceptions import LogError, did_you_mean
from .columns import SIDES, Selection, at_times
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
    measured. Those of a topic of their own are interpolated, see ``at_times``.

    Raises:
        LogError: it cannot be read, has no such topic, or lacks a joint.
    """
    with _opened(path) as bag:
        places = _places(bag, selection, path)
        found = {place: _series(bag, place, selection, path) for place in set(places.values())}
        frames = _frames(bag, selection.pose_topic, path)
    main = found[places["q"]]
    others = main.joints if main.joints != list(selection.joints) else []
    t, late = main.t, float(np.median(main.received - main.t))
    parts = dict(zip(SIDES, main.parts, strict=True))
    for signal, place in places.items():
        if place != places["q"]:
            own, both = found[place], main.stamped and found[place].stamped
            times = own.t if both else own.received - late  # the bag's clock is that of both
            values = own.parts[SIDES.index(signal)]
            parts[signal] = at_times(t, values, times, f"{path}, {place}")
    if selection.torques and not np.isfinite(parts["tau"]).any():
        raise LogError(
            f"'{places.get('tau', places['q'])}' has no efforts of the joints.",
            where=str(path),
            hint="--topic tau=NAME, or tau=NAME:FIELD, names a topic that has them.",
        )
    return Log(
        t - t[0],
        parts["q"],
        parts["tau"],
        parts["v"] if np.isfinite(parts["v"]).any() else None,
        tuple(selection.joints) if main.joints else (),
        None if frames is None else frames[:, 1:],
        None if frames is None else frames[:, 0] - t[0],
        source=str(path),
        assumed={"joints": others} if others else {},
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


def _places(bag: Any, selection: Selection, path: Path) -> dict[str, str]:
    """Return where q is, and v and tau if they are elsewhere: TOPIC or TOPIC:FIELD.

    If q has none, it is that of the only topic of joint states.

    Raises:
        LogError: a topic that does not exist, or none or several have joint states.
    """
    stated = dict(selection.topics)
    for signal, place in stated.items():
        topic = place.partition(":")[0]
        if topic not in bag.topics:
            guess = did_you_mean(topic, list(bag.topics))
            words = f"'{topic}' is not a topic of it. {_contents(bag)}{guess}"
            raise LogError(words, where=f"{path}: {signal}")
    if "q" in stated:
        return stated
    states = [name for name, info in bag.topics.items() if info.msgtype in _STATES]
    if len(states) != 1:
        raise LogError(
            f"{len(states)} topics have joint states. {_contents(bag)}",
            where=str(path),
            hint="Say which: --topic NAME, or --topic q=NAME,tau=NAME.",
        )
    return {"q": states[0], **stated}


def _contents(bag: Any) -> str:
    """Return the topics of a bag in words."""
    topics = sorted((name, info.msgtype) for name, info in bag.topics.items())
    return f"Its topics: {', '.join(f'{name} ({kind})' for name, kind in topics)}."


class _Time(NamedTuple):
    """The time of a message [s], when the bag received it, and whether its header has the time."""

    stamp: float
    received: float
    stamped: bool


class _State(NamedTuple):
    """Names of joints, their positions, velocities and efforts, and how late they are [s]."""

    joints: Sequence[str]
    parts: tuple[Sequence[float], Sequence[float], Sequence[float]]
    since: float = 0.0


class _Series(NamedTuple):
    """The messages of one topic, sorted by time.

    Attributes:
        t: (N) times [s] of the headers, or of the bag where they have none.
        received: (N) times of the bag [s].
        stamped: whether the headers have times.
        parts: (3, N, n) positions, velocities and efforts; the same numbers three times if they are
            those of a field.
        joints: names of the columns; none if the messages do not name joints.
    """

    t: np.ndarray
    received: np.ndarray
    stamped: bool
    parts: np.ndarray
    joints: list[str]


def _messages(bag: Any, topic: str) -> Iterator[tuple[_Time, Any]]:
    """Yield time and content of each message."""
    for connection, received, raw in bag.messages(bag.topics[topic].connections):
        message, at = bag.deserialize(raw, connection.msgtype), 1e-9 * received
        header = getattr(message, "header", None)
        stamp = 0.0 if header is None else _seconds(header.stamp)
        yield _Time(stamp if stamp > 0.0 else at, at, stamp > 0.0), message


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def _states(message: Any, field: str) -> Iterator[_State]:
    """Yield the joint state of a message, of each point of a trajectory, or a field of numbers."""
    if field:
        yield _State((), (attrgetter(field)(message),) * 3)
    elif hasattr(message, "points"):
        for one in message.points:
            parts = one.positions, one.velocities, one.effort
            yield _State(message.joint_names, parts, _seconds(one.time_from_start))
    else:
        yield _State(message.name, (message.position, message.velocity, message.effort))


def _fields(message: Any, size: int, prefix: str = "") -> Iterator[str]:
    """Yield the names of the fields of a message that are a number of numbers, inner ones too."""
    for name in getattr(message, "__dataclass_fields__", ()):
        part = getattr(message, name)
        if isinstance(part, np.ndarray) and part.shape == (size,) and part.dtype.kind in "fiu":
            yield prefix + name
        yield from _fields(part, size, f"{prefix}{name}.")


def _series(bag: Any, place: str, selection: Selection, path: Path) -> _Series:
    """Return the messages of a topic that have all joints, or the numbers of a field.

    Raises:
        LogError: none has, or there is no such field.
    """
    (topic, _, field), wanted = place.partition(":"), list(selection.joints)
    where = f"{path}, {topic}"
    if bag.topics[topic].msgtype not in _STATES:
        fields = list(_fields(next((one for _, one in _messages(bag, topic)), None), len(wanted)))
        field = field or (fields[0] if len(fields) == 1 else "")
        if field not in fields:
            raise LogError(
                f"no field '{field}' of its messages has {len(wanted)} numbers, one for each "
                f"joint; these have: {fields}.",
                where=where,
                hint="--topic SIGNAL=TOPIC:FIELD names it.",
            )
    orders: dict[tuple[str, ...], list[int] | None] = {(): list(range(len(wanted)))}
    rows: dict[float, tuple[_Time, list[list[float]]]] = {}
    joints: list[str] = []
    for time, message in _messages(bag, topic):
        for state in _states(message, field):
            names = tuple(state.joints)
            if names not in orders:
                exact = set(wanted) <= set(names)  # other names are matched once
                orders[names] = match_joints(names, wanted, where) if exact or not joints else None
            if (order := orders[names]) is None:
                continue
            joints = joints or [names[k] for k in order if names]
            values = [
                [float(part[k]) for k in order] if len(part) > max(order) else [np.nan] * len(order)
                for part in state.parts
            ]
            rows.setdefault(time.stamp + state.since, (time, values))
    if not rows:
        others = sorted({name for found in orders for name in found})
        raise LogError(
            f"no message of '{topic}' has all of the joints {wanted}; there are {others}.",
            where=str(path),
            hint="Record a topic with all joints in one message, such as that of "
            "joint_state_broadcaster, or name the log's: --joints A,B,....",
        )
    t = np.array(sorted(rows))
    times = [rows[stamp][0] for stamp in t]
    return _Series(
        t,
        t + np.array([time.received - time.stamp for time in times]),
        all(time.stamped for time in times),
        np.array([rows[stamp][1] for stamp in t]).swapaxes(0, 1),
        joints,
    )


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
    return np.array(
        [[time.stamp, *_POSES[kind](message)] for time, message in _messages(bag, topic)]
    )
