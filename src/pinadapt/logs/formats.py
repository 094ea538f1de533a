"""``read_log``, and the formats of log files: tables, rollouts, and bags of ROS and MCAP.

A new format is a subclass of ``Format`` and an entry in ``FORMATS``.
"""

from __future__ import annotations

import csv
import json
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from .._checks import instance, name_list
from ..description.chain import is_slide
from ..exceptions import LogError, did_you_mean
from ..robot.robot import Robot
from .columns import Selection, log_of_columns
from .log import Log, check


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
    """A text file with a header: one row per sample, one column a number."""

    suffixes = (".csv", ".txt", ".dat", ".tsv")

    def accepts(self, path: Path) -> bool:
        """Tell whether a path is a file of such a name."""
        return path.is_file() and path.suffix.lower() in self.suffixes

    def read(self, path: Path, selection: Selection) -> Log:
        """Return the log in a text file; an empty cell was not measured.

        Cells are separated by commas, semicolons, tabs or spaces. Lines that begin with ``#`` are
        comments; without another header the last one before the numbers is the header.

        Raises:
            LogError: no header, rows of other lengths, or cells that are not numbers.
        """
        try:
            lines = path.read_text(encoding="utf-8-sig").splitlines()
        except UnicodeDecodeError as error:
            raise LogError(f"is not text: {error.reason}.", where=str(path)) from error
        header, rows = _split([line for line in lines if line.strip()], str(path))
        values = np.array(
            [_numbers(cells, header, line, str(path)) for line, cells in rows], dtype=float
        ).reshape(len(rows), len(header))
        return log_of_columns(dict(zip(header, values.T, strict=True)), selection, str(path))


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
    raise LogError(
        "has no header: its first row holds numbers.",
        where=where,
        hint="Begin with a line of column names such as t,q0,q1,v0,v1,tau0,tau1.",
    )


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
