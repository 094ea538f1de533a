"""MCAP files: written in pieces that are whole at once, and read even if the end is missing.

Messages are those of ROS 2 (CDR, little endian), so Foxglove and everything that reads bags opens
the files. The package mcap writes and reads them; chunks are not compressed.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from ..exceptions import LogError

_CDR = b"\x00\x01\x00\x00"
_LINE = "=" * 80

_TIME = "int32 sec\nuint32 nanosec\n"
_STD_HEADER = "builtin_interfaces/Time stamp\nstring frame_id\n"


def _with(text: str, **parts: str) -> str:
    """Return a message definition with those of its parts."""
    return text + "".join(f"{_LINE}\nMSG: {name}\n{part}" for name, part in parts.items())


_PARTS = {"std_msgs/Header": _STD_HEADER, "builtin_interfaces/Time": _TIME}
_POINT, _TURN = "float64 x\nfloat64 y\nfloat64 z\n", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
DEFINITIONS = {
    "sensor_msgs/msg/JointState": _with(
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
        "float64[] effort\n",
        **_PARTS,
    ),
    "geometry_msgs/msg/PointStamped": _with(
        "std_msgs/Header header\ngeometry_msgs/Point point\n",
        **_PARTS,
        **{"geometry_msgs/Point": _POINT},
    ),
    "geometry_msgs/msg/PoseStamped": _with(
        "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
        **_PARTS,
        **{
            "geometry_msgs/Pose": "geometry_msgs/Point position\n"
            "geometry_msgs/Quaternion orientation\n",
            "geometry_msgs/Point": _POINT,
            "geometry_msgs/Quaternion": _TURN,
        },
    ),
    "std_msgs/msg/String": "string data\n",
}


class Topic(NamedTuple):
    """A topic of a file.

    Attributes:
        name: such as "/joint_states".
        kind: message type, such as "sensor_msgs/msg/JointState".
        definition: of the type; None for one of ``DEFINITIONS``.
    """

    name: str
    kind: str
    definition: str | None = None


class _Unwritten(io.BytesIO):
    """What is to be appended to a file of a known size."""

    size = 0

    def tell(self) -> int:
        """Return the place in the file."""
        return self.size + super().tell()


class McapWriter:
    """Writes messages in chunks; each ``flush`` leaves a file that can be read up to there."""

    def __init__(
        self, file: BinaryIO, topics: Sequence[Topic], about: Mapping[str, str] | None = None
    ) -> None:
        """Begin a file.

        Args:
            file: to write to, at its start.
            topics: of the messages, by number.
            about: texts that are kept with the file.

        Raises:
            OSError: it cannot be written.
        """
        from mcap.writer import CompressionType, Writer

        self._file, self._unwritten = file, _Unwritten()
        self._writer = Writer(self._unwritten, compression=CompressionType.NONE)
        self._writer.start("ros2", "pinadapt")
        self._writer.add_metadata("pinadapt", dict(about or {}))
        self._channels = []
        for name, kind, definition in topics:
            text = DEFINITIONS[kind] if definition is None else definition
            schema = self._writer.register_schema(kind, "ros2msg", text.encode())
            self._channels.append(self._writer.register_channel(name, "cdr", schema))
        self.flush()

    def add(self, topic: int, time: int, data: bytes) -> None:
        """Add a message to the chunk.

        Args:
            topic: its number.
            time: since 1970 [ns].
            data: the message, with the header of its encoding.
        """
        self._writer.add_message(self._channels[topic], time, data, time)

    def flush(self) -> None:
        """Write the chunk, if there is anything in it.

        Raises:
            OSError: it cannot be written; the file is cut to its last whole chunk.
        """
        # the package by itself ends chunks by their size alone
        self._writer._Writer__finalize_chunk()  # type: ignore[attr-defined]
        self._append()

    def _append(self) -> None:
        """Hand what is unwritten to the system."""
        unwritten = self._unwritten
        raw = unwritten.getvalue()
        try:
            self._file.write(raw)
            self._file.flush()
        except OSError:
            with suppress(OSError):
                self._file.truncate(unwritten.size)
            raise
        unwritten.size += len(raw)
        unwritten.seek(0)
        unwritten.truncate()

    def close(self) -> None:
        """Write the rest and the index.

        Raises:
            OSError: it cannot be written; the messages up to the last chunk are there.
        """
        self._writer.finish()
        self._append()


@dataclass(frozen=True)
class McapContent:
    """What is in a file that this library has written.

    Attributes:
        about: texts that are kept with it.
        definitions: message definitions by topic.
        messages: time [ns] and data by topic, in their order.
        whole: whether the file has its end.
    """

    about: dict[str, str]
    definitions: dict[str, str]
    messages: dict[str, list[tuple[int, bytes]]]
    whole: bool


def read_mcap(path: Path) -> McapContent:
    """Return the messages of a file up to where it is whole. It is data, which runs nothing.

    Raises:
        LogError: it cannot be read, or is no such file.
    """
    from mcap.exceptions import McapError
    from mcap.records import Channel, Footer, Message, Metadata, Schema
    from mcap.stream_reader import StreamReader
    from mcap.writer import MCAP0_MAGIC

    about: dict[str, str] = {}
    schemas, topics, whole = {0: ""}, dict[int, Any](), False
    messages: dict[int, list[tuple[int, bytes]]] = {}
    try:
        with path.open("rb") as file:
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise LogError("is not an MCAP file.", where=str(path))
            for record in StreamReader(file, skip_magic=True).records:
                if isinstance(record, Message):
                    one = (record.log_time, record.data)
                    messages.setdefault(record.channel_id, []).append(one)
                elif isinstance(record, Schema):
                    schemas[record.id] = record.data.decode()
                elif isinstance(record, Channel):
                    topics[record.id] = record
                elif isinstance(record, Metadata):
                    about = record.metadata
                whole = whole or isinstance(record, Footer)
    except OSError as error:
        raise LogError(f"cannot be read: {error.strerror or error}.", where=str(path)) from error
    except (McapError, struct.error):  # its end is missing
        pass
    return McapContent(
        about,
        {topic.topic: schemas.get(topic.schema_id, "") for topic in topics.values()},
        {topic.topic: messages.get(number, []) for number, topic in topics.items()},
        whole,
    )


# --- messages -----------------------------------------------------------------------------------


def text_message(text: str) -> bytes:
    """Return a std_msgs/String."""
    raw = text.encode() + b"\0"
    return _CDR + struct.pack("<I", len(raw)) + raw


def text_of(data: bytes) -> str:
    """Return the text of a std_msgs/String."""
    return data[8:-1].decode()


def numbers_definition(fields: Mapping[str, int]) -> str:
    """Return the definition of a message of float64: one number, or several for a size above 1."""
    return "".join(
        f"float64{f'[{size}]' if size > 1 else ''} {name}\n"
        for name, size in fields.items()
        if size
    )


def fields_of(definition: str) -> dict[str, int]:
    """Return the fields of a message that ``numbers_definition`` has defined."""
    found = {}
    for line in definition.splitlines():
        kind, _, name = line.strip().partition(" ")
        if kind.startswith("float64"):
            found[name] = int(kind[8:-1]) if "[" in kind else 1
    return found


def numbers_message(row: np.ndarray) -> bytes:
    """Return a message of float64 alone."""
    return _CDR + row.tobytes()


def numbers_of(data: bytes) -> np.ndarray:
    """Return the numbers of a message of float64 alone."""
    return np.frombuffer(data, offset=len(_CDR))


def _stamped(time: int, frame: str) -> bytes:
    raw = frame.encode() + b"\0"
    body = struct.pack("<iII", time // 10**9, time % 10**9, len(raw)) + raw
    return body + bytes(-len(body) % 4)


class JointStates:
    """Makes sensor_msgs/JointState of joints with fixed names."""

    def __init__(self, joints: Sequence[str]) -> None:
        """Take the names of n joints."""
        body = bytearray(_stamped(0, ""))
        body += struct.pack("<I", len(joints))
        for name in joints:
            raw = name.encode() + b"\0"
            body += bytes(-len(body) % 4) + struct.pack("<I", len(raw)) + raw
        self._names, self._n = bytes(body[8:]), len(joints)

    def message(self, time: int, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> bytes:
        """Return the message of a time since 1970 [ns] with q, v and tau (n)."""
        body = bytearray(struct.pack("<iI", time // 10**9, time % 10**9) + self._names)
        for part in (q, v, tau):
            body += bytes(-len(body) % 4) + struct.pack("<I", self._n)
            body += bytes(-len(body) % 8) + np.asarray(part, dtype=float).tobytes()
        return _CDR + bytes(body)


def pose_message(time: int, x: np.ndarray) -> bytes:
    """Return a PointStamped of x (3) [m], or a PoseStamped of x (7) with a quaternion xyzw."""
    body = _stamped(time, "base")
    return _CDR + body + bytes(-len(body) % 8) + np.asarray(x, dtype=float).tobytes()
