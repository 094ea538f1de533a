"""``read_log``, and the formats of log files: tables, rollouts, and bags of ROS and MCAP.

A new format is a subclass of ``Format`` and an entry in ``FORMATS``.
"""

from __future__ import annotations

import csv
import json
import sys
import warnings
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from operator import attrgetter
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .._checks import instance, keywords, name_list, word
from .._output import read_as_data
from ..exceptions import LogError, did_you_mean
from ..robot.robot import Robot
from .columns import Selection, at_times, log_of_columns
from .intake import REPLACED, SIDES, Intake
from .log import Log, check, match_joints, repeated


class Format(ABC):
    """A kind of file with recorded motions.

    Attributes:
        suffixes: of such files, for messages.
    """

    suffixes: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def accepts(self, path: Path) -> bool:
        """Return whether a path looks like such a file or folder, without reading all of it."""

    @abstractmethod
    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log at a path.

        Raises:
            LogError: it cannot be read, or lacks a signal.
        """


class RolloutFile(Format):
    """The folder of a run of ``pinadapt run``, or its ``rollout.npz``."""

    _FILE, _SUMMARY = "rollout.npz", "summary.json"
    _ANNOUNCEMENTS = ("announced", "told")  # events that left the robot as it was; now, formerly
    _ARRAYS = frozenset({"t", "q", "v", "tau", "x", "x_d", "saturated"})

    def accepts(self, path: Path) -> bool:
        """Return whether a path is the folder of a run, or its arrays."""
        if path.is_dir():
            return (path / self._FILE).is_file()
        try:
            with zipfile.ZipFile(path) as archive:
                names = {name.removesuffix(".npy") for name in archive.namelist()}
        except (OSError, zipfile.BadZipFile):
            return False
        return names >= self._ARRAYS

    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log of a run, from the last change of its robot on.

        Torques are the controller's, held from each sample to the next; x is the true position of
        the task frame. A joint task's x is q and is left out.

        Raises:
            LogError: it cannot be read, or has no sample.
        """
        file = path / self._FILE if path.is_dir() else path
        found, about = _arrays(file), self._summary(file.with_name(self._SUMMARY))
        if not len(found["t"]):
            raise LogError("the run has no sample.", where=str(file))
        log = Log(
            found["t"],
            found["q"],
            found["tau"],
            found["v"],
            tuple(about.get("joint_names", ())) if found["q"].shape == found["v"].shape else (),
            None if about.get("task") == "joint" else found["x"],
            held=True,
            source=str(path),
        )
        events = about.get("changes", ())
        changes = [event["at"] for event in events if event["what"] not in self._ANNOUNCEMENTS]
        since = max((at for at in changes if at <= log.t[-1]), default=-np.inf)
        return log.after(since)

    def _summary(self, file: Path) -> dict[str, Any]:
        """Return what else is known of a run, nothing where there is no summary."""
        try:
            content = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return {}
        return content if isinstance(content, dict) else {}


class Npz(Format):
    """An archive of numpy: arrays by name, each signal a column per joint."""

    suffixes = (".npz",)

    def accepts(self, path: Path) -> bool:
        """Return whether a path is a file of that name."""
        return path.is_file() and path.suffix.lower() in self.suffixes

    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log in an archive: t (N), q, tau (N, n), also v, x, x_time, joint_names.

        Raises:
            LogError: it cannot be read, or lacks a signal.
        """
        return log_of_columns(_arrays(path), selection, str(path))


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an archive by name.

    Raises:
        LogError: it cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            found = {name: archive[name] for name in archive.files}
        for name, array in found.items():
            if array.dtype.kind == "U":  # numpy does not check the characters
                codes = np.ascontiguousarray(array).reshape(-1).view(f"{array.dtype.byteorder}u4")
                if ((codes > sys.maxunicode) | ((codes >= 0xD800) & (codes < 0xE000))).any():
                    raise ValueError(f"{name} has texts with characters that do not exist")
        return found
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise LogError(f"cannot be read: {error}.", where=str(path)) from error


class Csv(Format):
    """A text file: one row per sample, one column a number, with or without a header."""

    suffixes = (".csv", ".txt", ".dat", ".tsv")

    def accepts(self, path: Path) -> bool:
        """Return whether a path is a file of such a name."""
        return path.is_file() and path.suffix.lower() in self.suffixes

    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log in a text file; an empty cell was not measured.

        Cells are separated by commas, semicolons, tabs or spaces. Lines that begin with ``#`` are
        comments; without another header the last one before the numbers is the header. Without any,
        columns are called 1, 2 and so on.

        Raises:
            LogError: rows of other lengths, or cells that are not numbers.
        """
        return log_of_columns(self.table(path), selection, str(path))

    def table(self, path: Path) -> dict[str, np.ndarray]:
        """Return the columns (N) of a text file by name.

        Raises:
            LogError: as ``read``.
        """
        try:
            lines = path.read_text(encoding="utf-8-sig").splitlines()
        except UnicodeDecodeError as error:
            raise LogError(f"is not text: {error.reason}.", where=str(path)) from error
        header, rows = _split([line for line in lines if line.strip()], str(path))
        values = np.array(
            [_numbers(cells, header, line, str(path)) for line, cells in rows], dtype=float
        ).reshape(len(rows), len(header))
        return dict(zip(header, values.T, strict=True))


_MISSING = {"", "nan", "null", "none", "na"}  # cells of what was not measured


def _split(lines: Sequence[str], where: str) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return the header, and the cells of each row with the number of its line."""
    comments = [line.lstrip("# ") for line in lines if line.startswith("#")]
    plain = [(k + 1, line) for k, line in enumerate(lines) if not line.startswith("#")]
    if not plain:
        raise LogError("is empty.", where=where)
    mark = next((mark for mark in ",;\t" if mark in plain[0][1]), " ")
    cells = [(number, _cells(line, mark)) for number, line in plain]
    if not _is_row(cells[0][1]):
        return [name.strip() for name in cells[0][1]], cells[1:]
    if comments and len(names := _cells(comments[-1], mark)) == len(cells[0][1]):
        return [name.strip() for name in names], cells
    return [str(k + 1) for k in range(len(cells[0][1]))], cells


def _cells(line: str, mark: str) -> list[str]:
    if mark == " ":
        return line.split()
    return next(csv.reader([line], delimiter=mark, skipinitialspace=True))


def _is_row(cells: Sequence[str]) -> bool:
    """Return whether cells are numbers, of which some may be missing."""
    try:
        return bool(cells) and any(np.isfinite([_number(cell) for cell in cells]))
    except ValueError:
        return False


def _number(cell: str) -> float:
    text = cell.strip()
    return np.nan if text.lower() in _MISSING else float(text)


def _numbers(cells: Sequence[str], header: Sequence[str], line: int, where: str) -> list[float]:
    """Return the numbers of a row."""
    if len(cells) != len(header):
        raise LogError(
            f"{len(cells)} cells, and the header has {len(header)}.", where=f"{where}, line {line}"
        )
    try:
        return [_number(cell) for cell in cells]
    except ValueError:
        bad = next(k for k, cell in enumerate(cells) if not _is_number(cell))
        raise LogError(
            f"'{cells[bad]}' in column '{header[bad]}' is not a number.",
            where=f"{where}, line {line}",
            hint="Decimals need a point; an empty cell was not measured.",
        ) from None


def _is_number(cell: str) -> bool:
    try:
        _number(cell)
    except ValueError:
        return False
    return True


_JOINTS, _TRAJECTORY = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"
_LOOKED_AT = 50  # messages of a topic, by which it is chosen
_DEPTH = 2  # of messages inside messages, whose numbers are offered
_WORDS = ("positions", "velocities", "efforts")
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
        """Return whether a path looks like a bag: a file, or a folder of ROS 2."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return path.suffix.lower() in self.suffixes

    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log in a bag: one sample a message that has all joints of the robot.

        Times are those of the headers, or of the bag where these are not set. Messages are sorted
        by time, and repeated times are left out. Velocities and efforts that a message leaves out
        were not measured. Those of a topic of their own are interpolated, see ``at_times``.

        Raises:
            LogError: it cannot be read, has no such topic, or lacks a joint.
        """
        with _opened(path) as bag:
            topics = _topics(bag, selection, path)
            found = {place: _series(bag, place, selection, path) for place in set(topics.values())}
            main = found[topics["q"]]
            assumed: dict[str, Any] = {}
            if len(topics) > len(selection.topics):
                stated = {signal: str(place) for signal, place in topics.items()}
                assumed["topic"] = stated["q"] if len(stated) == 1 else stated
            if main.joints and main.joints != list(selection.joints):
                assumed["joints"] = main.joints
            x_time, x = None, None
            if selection.pose_topic is not None:
                pose = _topic(bag, selection.pose_topic, tuple(_POSES), path, "pose-topic")
                of = _POSES[bag.topics[pose].msgtype]
                frames = [(time.stamp, of(message)) for time, message in _messages(bag, pose)]
                x_time = np.array([time for time, _ in frames])
                x = np.array([frame for _, frame in frames])
            parts = {"q": main.signal("q")}
            for signal in ("v", "tau"):
                parts[signal] = main.signal(signal)
                if (place := topics.get(signal, topics["q"])) != topics["q"]:
                    own, where = found[place], f"{path}, {place}"
                    times = own.times_by(main, where)
                    parts[signal] = at_times(main.t, own.signal(signal), times, where)
            if selection.torques and not np.isfinite(parts["tau"]).any():
                raise _no_effort(bag, topics, selection, path)
        start, v = main.t[0], parts["v"]
        return Log(
            main.t - start,
            parts["q"],
            parts["tau"],
            v if np.isfinite(v).any() else None,
            tuple(selection.joints) if main.joints else (),
            x,
            None if x_time is None else x_time - start,
            source=str(path),
            assumed=assumed,
        )


class _Place(NamedTuple):
    """Where a bag has a signal: a topic, and a field of its messages if they are no joint states.

    Written as TOPIC or TOPIC:FIELD, such as /states:tau_J.
    """

    topic: str
    field: str = ""

    def __str__(self) -> str:
        """Return it as it is written."""
        return f"{self.topic}:{self.field}" if self.field else self.topic

    @classmethod
    def of(cls, text: str) -> _Place:
        """Return the place that a text names."""
        topic, _, field = text.partition(":")
        return cls(topic, field)


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

    def signal(self, name: str) -> np.ndarray:
        """Return q, v or tau (N, n)."""
        return np.asarray(self.parts[SIDES.index(name)])

    def times_by(self, other: _Series, where: str) -> np.ndarray:
        """Return the times (N) by the clock of another series [s].

        If the headers of only one of them have times, both are compared by when the bag received
        them, by the median of its delay; a warning with ``where`` says so.
        """
        if self.stamped == other.stamped:
            return self.t
        lag, other_lag = (float(np.median(each.received - each.t)) for each in (self, other))
        without, delay = ("it", other_lag) if other.stamped else ("the positions' topic", lag)
        warnings.warn(
            f"{where}: the messages of {without} have no times, so those of the bag were taken, "
            f"less the {1e3 * delay:.3g} ms by which the bag is late with the other topic.",
            stacklevel=3,
        )
        return np.asarray(self.t + lag - other_lag)


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


def _topics(bag: Any, selection: Selection, path: Path) -> dict[str, _Place]:
    """Return where q is, and v and tau if they are elsewhere: as stated, or the only fitting ones.

    Several topics have joint states if a gripper or another arm has its own, or if torques are
    published apart. One topic fits if it has positions and efforts of all joints; or else one that
    has the positions together with one that has the efforts.

    Raises:
        LogError: a topic that does not exist, or several fit.
    """
    places = {signal: _Place.of(text) for signal, text in selection.topics.items()}
    for signal, place in places.items():
        if place.topic not in bag.topics:
            guess = did_you_mean(place.topic, list(bag.topics))
            raise LogError(
                f"'{place.topic}' is not a topic of it. {_contents(bag, selection)}{guess}",
                where=f"{path}: {signal}",
            )
    kinds = (_JOINTS, _TRAJECTORY)
    if "q" in places:
        return places
    states = [name for name, info in bag.topics.items() if info.msgtype in kinds]
    if len(states) == 1:
        return {"q": _Place(states[0]), **places}
    filled = {name: _filled(bag, name, selection.joints) for name in states}
    whole = {"q"} if "tau" in places else {"q", "tau"}
    fitting = [name for name, signals in filled.items() if whole <= signals]
    found = {"q": fitting[0]} if len(fitting) == 1 else {}
    if not fitting:
        parts = {
            signal: [name for name, signals in filled.items() if signal in signals]
            for signal in ("q", "tau")
        }
        if all(len(names) == 1 for names in parts.values()):
            found = {signal: names[0] for signal, names in parts.items()}
    if not found:
        several = f"several topics fit: {fitting}" if fitting else "no topic of joint states fits"
        raise LogError(
            f"{several}. {_contents(bag, selection)}",
            where=str(path),
            hint=_NAME_TOPICS,
        )
    words = f"the joint states are those of '{found['q']}'"
    words += f", the torques those of '{found['tau']}'" if "tau" in found else ""
    others = ", ".join(name for name in states if name not in found.values())
    lack = f"; {others} lack joints or efforts" if others else ""
    warnings.warn(f"{path}: {words}{lack}. --topic names others.", stacklevel=2)
    return {**{signal: _Place(name) for signal, name in found.items()}, **places}


_NAME_TOPICS = "Say which: --topic NAME, or --topic q=NAME,tau=NAME if they are in different ones."


def _filled(bag: Any, topic: str, joints: Sequence[str]) -> set[str]:
    """Return which of q, v and tau the messages of a topic have for all joints."""
    found: set[str] = set()
    for _, message in islice(_samples(bag, topic), _LOOKED_AT):
        if set(joints) <= set(message.name):
            parts = zip(SIDES, _fields(message), strict=True)
            found |= {signal for signal, part in parts if len(part) == len(message.name)}
    return found


def _contents(bag: Any, selection: Selection) -> str:
    """Return which topics have joint states, or as many numbers as there are joints."""
    found, n = [], len(selection.joints)
    for name, info in sorted(bag.topics.items()):
        if info.msgtype in (_JOINTS, _TRAJECTORY):
            filled = _filled(bag, name, selection.joints)
            has = [word for signal, word in zip(SIDES, _WORDS, strict=True) if signal in filled]
            some = [each for _, message in islice(_samples(bag, name), 1) for each in message.name]
            found.append(f"{name} ({', '.join(has) or f'not of all joints: {some}'})")
        elif info.msgtype not in _POSES:
            first = next((message for _, message in _messages(bag, name)), None)
            found += [f"{_Place(name, field)} ({n} numbers)" for field in _arrays_in(first, n)]
    return f"Its topics with signals of joints: {'; '.join(found) or 'none'}."


def _arrays_in(message: Any, size: int, depth: int = _DEPTH) -> Iterator[str]:
    """Yield the names of the fields of a message that are a number of numbers, inner ones too."""
    for name in getattr(message, "__dataclass_fields__", ()):
        part = getattr(message, name)
        if isinstance(part, np.ndarray) and part.shape == (size,) and part.dtype.kind in "fiu":
            yield name
        elif depth:
            yield from (f"{name}.{inner}" for inner in _arrays_in(part, size, depth - 1))


def _no_effort(
    bag: Any, topics: Mapping[str, _Place], selection: Selection, path: Path
) -> LogError:
    """Return the error of joint states without torques."""
    return LogError(
        f"the joint states of '{topics.get('tau', topics['q'])}' have no effort, and without "
        f"torques no dynamic parameters can be estimated. {_contents(bag, selection)}",
        where=str(path),
        hint="--topic tau=NAME names another topic that has them. Otherwise record that of a "
        "driver that publishes effort.",
    )


def _series(bag: Any, place: _Place, selection: Selection, path: Path) -> _Series:
    """Return the messages of a topic that have all joints, or the numbers of a field.

    Raises:
        LogError: none has, or there is no such field.
    """
    joint_states = bag.topics[place.topic].msgtype in (_JOINTS, _TRAJECTORY)
    if joint_states and not place.field:
        rows, joints = _joint_rows(bag, place.topic, selection, path)
    else:
        rows, joints = _field_rows(bag, place, selection, path), list[str]()
    _, once = np.unique([time.stamp for time, _ in rows], return_index=True)
    times = [rows[k][0] for k in once]
    return _Series(
        np.array([time.stamp for time in times]),
        np.array([time.received for time in times]),
        all(time.stamped for time in times),
        np.array([rows[k][1] for k in once]).swapaxes(0, 1),
        joints,
    )


def _joint_rows(
    bag: Any, topic: str, selection: Selection, path: Path
) -> tuple[list[tuple[_Time, Any]], list[str]]:
    """Return time and q, v, tau (3, n) of each message with all joints, and their names there."""
    names = list(selection.joints)
    matched: dict[tuple[str, ...], list[int] | None] = {}
    rows = []
    for time, message in _samples(bag, topic):
        found = tuple(message.name)
        if found not in matched:
            where = f"{path}, {topic}"
            matched[found] = _order(found, names, where, matched, named=selection.named)
        order = matched[found]
        if order is not None:
            rows.append((time, [_picked(part, order, message.name) for part in _fields(message)]))
    if not rows:
        raise _missing(bag, topic, names, path)
    return rows, next([name[k] for k in order] for name, order in matched.items() if order)


def _field_rows(
    bag: Any, place: _Place, selection: Selection, path: Path
) -> list[tuple[_Time, Any]]:
    """Return time and three times the numbers (n) of a field, in the order of the joints."""
    rows, n = [], len(selection.joints)
    for time, message in _messages(bag, place.topic):
        fields = list(_arrays_in(message, n))
        field = place.field or (fields[0] if len(fields) == 1 else "")
        if field not in fields:
            what = f"no field '{field}' of" if field else "not one field with"
            raise LogError(
                f"its messages have {what} {n} numbers, one for each joint. "
                f"{_contents(bag, selection)}",
                where=f"{path}, {place.topic}",
                hint="--topic SIGNAL=TOPIC:FIELD names it.",
            )
        rows.append((time, [attrgetter(field)(message)] * 3))
    if not rows:
        raise LogError("has no message.", where=f"{path}, {place.topic}")
    return rows


class _State(NamedTuple):
    """One point of a trajectory, with the fields of a joint state."""

    name: Sequence[str]
    position: Sequence[float]
    velocity: Sequence[float]
    effort: Sequence[float]


def _fields(message: Any) -> tuple[Sequence[float], ...]:
    """Return q, v and tau of a joint state; empty where they were left out."""
    return message.position, message.velocity, message.effort


class _Time(NamedTuple):
    """The time of a message [s], when the bag received it, and whether its header has the time."""

    stamp: float
    received: float
    stamped: bool


def _samples(bag: Any, topic: str) -> Iterator[tuple[_Time, Any]]:
    """Yield time and joint state of each message, or of each point of a trajectory."""
    for time, message in _messages(bag, topic):
        if not hasattr(message, "points"):
            yield time, message
            continue
        for point in message.points:
            since = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
            states = point.positions, point.velocities, point.effort
            moved = _Time(time.stamp + since, time.received + since, time.stamped)
            yield moved, _State(message.joint_names, *states)


def _messages(bag: Any, topic: str) -> Iterator[tuple[_Time, Any]]:
    """Yield time and content of each message."""
    for connection, received, raw in bag.messages(bag.topics[topic].connections):
        message, at = bag.deserialize(raw, connection.msgtype), 1e-9 * received
        header = getattr(message, "header", None)
        stamp = 0.0 if header is None else header.stamp.sec + 1e-9 * header.stamp.nanosec
        yield _Time(stamp if stamp > 0.0 else at, at, stamp > 0.0), message


def _order(
    found: Sequence[str],
    joints: Sequence[str],
    where: str,
    matched: Mapping[tuple[str, ...], list[int] | None],
    *,
    named: bool,
) -> list[int] | None:
    """Return the index of each joint in a message, None where not all are in it.

    Names that are not the robot's are matched only while no message has those, and only if the
    log's names were not stated (``named``).
    """
    if set(joints) <= set(found):
        return [list(found).index(joint) for joint in joints]
    if named or any(order is not None for order in matched.values()):
        return None
    return match_joints(found, joints, where)


def _picked(values: Any, order: list[int], names: list[str]) -> list[float]:
    """Return the values of the joints; NaN where a message leaves them out."""
    whole = len(values) == len(names)
    return [float(values[i]) if whole else np.nan for i in order]


def _missing(bag: Any, topic: str, joints: list[str], path: Path) -> LogError:
    """Return the error of a topic none of whose messages has all joints."""
    names = sorted({name for _, message in _samples(bag, topic) for name in message.name})
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


# The first format that accepts a path reads it.
FORMATS: Mapping[str, Format] = {
    "rollout": RolloutFile(),
    "npz": Npz(),
    "csv": Csv(),
    "bag": Bag(),
}


@keywords(**REPLACED)
def read_log(
    source: Path | str | Log,
    robot: Robot,
    *,
    intake: Intake | Mapping[str, Any] | Path | str | None = None,
    torques: bool = True,
) -> Log:
    """Return a recorded motion of a robot, checked, its columns in the order of the joints.

    Units are rad, m, N m, N and s.

    Args:
        source: a folder or ``rollout.npz`` that `pinadapt run` has written; an npz or CSV file with
            t, q, tau and optionally v and x, by the joints' names or indices; a bag of ROS 1 or 2
            or MCAP (extra ``bags``); or a ``Log``.
        robot: whose motion it is.
        intake: how it is to be read, an ``Intake``, its fields, or a TOML file of it; by default
            the one beside the log, ``run.intake.toml`` of ``run.csv``, if there is one.
        torques: whether they are needed. A log for the geometry alone may have none, and as few
            samples as there are frames.

    Raises:
        LogError: no such file, an unknown format, a missing signal or joint, or impossible numbers;
            see ``check``.
    """
    instance(robot, Robot, "robot")
    intake = Intake.of(Intake.beside(source) if intake is None else intake)
    if not isinstance(source, Log):
        path = Path(instance(source, Path | str, "log"))
        source = _read(path, _selection(path, intake, robot, torques=torques))
    elif intake.rate is not None:
        source = replace(source, t=np.arange(len(source.t)) / intake.rate)
    log = source.from_zero()
    if intake.repeated == "drop":
        log = _without_repeated(log)
    log = intake.converted(log, robot)
    check(log, robot, torques=torques)
    return log


def _selection(path: Path, intake: Intake, robot: Robot, *, torques: bool) -> Selection:
    """Return what is to be read from a file, and from others beside it."""
    columns = {key: name_list(names, "columns", LogError) for key, names in intake.columns.items()}
    tables = {}
    for signal, name in intake.files.items():
        word(signal, ("q", "v", "tau"), "intake.files")
        tables[signal] = (_table(path.parent / name), str(path.parent / name))
    foreign = intake.foreign(robot)
    joints = foreign or robot.joint_names
    topics = intake.topics, intake.pose_topic
    return Selection(
        joints, columns, tables, intake.rate, *topics, named=bool(foreign), torques=torques
    )


def _table(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of another file."""
    if not path.is_file():
        raise LogError("there is no such file.", where=str(path))
    with read_as_data(path, LogError):
        if path.suffix.lower() in Npz.suffixes:
            return _arrays(path)
        if path.suffix.lower() in Csv.suffixes:
            return Csv().table(path)
    raise LogError(
        "a signal of its own is read from text files and npz archives only.", where=str(path)
    )


def _without_repeated(log: Log) -> Log:
    """Return a log without samples that repeat earlier ones; a warning says how many they were."""
    kept = ~repeated(log)
    if kept.all():
        return log
    warnings.warn(
        f"{log.source}: {np.count_nonzero(~kept)} of {len(kept)} samples repeat earlier ones and "
        "are left out.",
        stacklevel=2,
    )
    v, own = None if log.v is None else log.v[kept], log.x is not None and log.x_time is None
    x = log.x[kept] if own and log.x is not None else log.x
    return replace(log, t=log.t[kept], q=log.q[kept], tau=log.tau[kept], v=v, x=x)


def _read(path: Path, selection: Selection) -> Log:
    if not path.exists():
        raise LogError("there is no such file or folder.", where=str(path))
    with read_as_data(path, LogError):
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
