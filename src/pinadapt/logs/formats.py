"""``read_log``, and the formats of log files: tables, rollouts, and bags of ROS and MCAP.

A new format is a subclass of ``Format`` and an entry in ``FORMATS``.
"""

from __future__ import annotations

import csv
import json
import warnings
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .._checks import instance, keywords, name_list, word
from ..exceptions import LogError, did_you_mean
from ..robot.robot import Robot
from .columns import Selection, log_of_columns
from .intake import REPLACED, Intake
from .log import Log, check, match_joints, repeated


class Format(ABC):
    """A kind of file with recorded motions.

    Attributes:
        suffixes: of such files, for messages.
    """

    suffixes: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def accepts(self, path: Path) -> bool:
        """Tell whether a path looks like such a file or folder, without reading all of it."""

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
        """Tell whether a path is the folder of a run, or its arrays."""
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
        except (OSError, ValueError):
            return {}
        return content if isinstance(content, dict) else {}


class Npz(Format):
    """An archive of numpy: arrays by name, each signal a column per joint."""

    suffixes = (".npz",)

    def accepts(self, path: Path) -> bool:
        """Tell whether a path is a file of that name."""
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
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise LogError(f"cannot be read: {error}.", where=str(path)) from error


class Csv(Format):
    """A text file: one row per sample, one column a number, with or without a header."""

    suffixes = (".csv", ".txt", ".dat", ".tsv")

    def accepts(self, path: Path) -> bool:
        """Tell whether a path is a file of such a name."""
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
    """Tell whether cells are numbers, of which some may be missing."""
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
            names, topic = list(selection.joints), _states_topic(bag, selection, path)
            assumed: dict[str, Any] = {} if topic == selection.topic else {"topic": topic}
            matched: dict[tuple[str, ...], list[int] | None] = {}
            rows = []
            for time, message in _samples(bag, topic):
                found = tuple(message.name)
                if found not in matched:
                    matched[found] = _order(
                        found, names, f"{path}, {topic}", matched, named=selection.named
                    )
                order = matched[found]
                if order is not None:
                    fields = message.position, message.velocity, message.effort
                    rows.append((time, *(_picked(part, order, message.name) for part in fields)))
            if not rows:
                raise _missing(bag, topic, names, path)
            used = next([name[k] for k in order] for name, order in matched.items() if order)
            assumed |= {} if used == names else {"joints": used}
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
            assumed=assumed,
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


def _states_topic(bag: Any, selection: Selection, path: Path) -> str:
    """Return the topic of the joint states: the one that was named, or the only one that fits.

    Several topics have joint states if a gripper or another arm has its own; one fits if it has all
    joints of the robot, and efforts.
    """
    kinds = (_JOINTS, _TRAJECTORY)
    found = [name for name, info in bag.topics.items() if info.msgtype in kinds]
    if selection.topic is None and len(found) > 1:
        fitting = [name for name in found if _has_efforts(bag, name, selection.joints)]
        if len(fitting) == 1:
            others = ", ".join(name for name in found if name != fitting[0])
            warnings.warn(
                f"{path}: the joint states are those of '{fitting[0]}'; {others} lack joints or "
                "efforts. --topic names another one.",
                stacklevel=2,
            )
            return fitting[0]
    return _topic(bag, selection.topic, kinds, path, "topic")


def _has_efforts(bag: Any, topic: str, joints: Sequence[str]) -> bool:
    """Tell whether messages of a topic have the efforts of all joints."""
    return any(
        set(joints) <= set(message.name) and len(message.effort) == len(message.name)
        for _, message in islice(_samples(bag, topic), _LOOKED_AT)
    )


class _State(NamedTuple):
    """One point of a trajectory, with the fields of a joint state."""

    name: Sequence[str]
    position: Sequence[float]
    velocity: Sequence[float]
    effort: Sequence[float]


def _samples(bag: Any, topic: str) -> Iterator[tuple[float, Any]]:
    """Yield time [s] and joint state of each message, or of each point of a trajectory."""
    for time, message in _messages(bag, topic):
        if not hasattr(message, "points"):
            yield time, message
            continue
        for point in message.points:
            since = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
            states = point.positions, point.velocities, point.effort
            yield time + since, _State(message.joint_names, *states)


def _messages(bag: Any, topic: str) -> Iterator[tuple[float, Any]]:
    """Yield time [s] and content of each message."""
    for connection, received, raw in bag.messages(bag.topics[topic].connections):
        message = bag.deserialize(raw, connection.msgtype)
        stamp = message.header.stamp
        time = stamp.sec + 1e-9 * stamp.nanosec
        yield (time if time > 0.0 else 1e-9 * received), message


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

    Raises:
        LogError: no such file, an unknown format, a missing signal or joint, or impossible numbers;
            see ``check``.
    """
    instance(robot, Robot, "robot")
    intake = Intake.of(Intake.beside(source) if intake is None else intake)
    if not isinstance(source, Log):
        path = Path(instance(source, Path | str, "log"))
        source = _read(path, _selection(path, intake, robot))
    elif intake.rate is not None:
        source = replace(source, t=np.arange(len(source.t)) / intake.rate)
    log = source.from_zero()
    if intake.repeated == "drop":
        log = _without_repeated(log)
    log = intake.converted(log, robot)
    check(log, robot)
    return log


def _selection(path: Path, intake: Intake, robot: Robot) -> Selection:
    """Return what is to be read from a file, and from others beside it."""
    columns = {key: name_list(names, "columns", LogError) for key, names in intake.columns.items()}
    tables = {}
    for signal, name in intake.files.items():
        word(signal, ("q", "v", "tau"), "intake.files")
        tables[signal] = (_table(path.parent / name), str(path.parent / name))
    foreign = intake.foreign(robot)
    joints = foreign or robot.joint_names
    topics = intake.topic, intake.pose_topic
    return Selection(joints, columns, tables, intake.rate, *topics, named=bool(foreign))


def _table(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of another file."""
    if not path.is_file():
        raise LogError("there is no such file.", where=str(path))
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
