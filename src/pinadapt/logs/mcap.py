"""MCAP files: written in pieces that are whole at once, and read even if the end is missing.

Messages are those of ROS 2 (CDR, little endian), so Foxglove and everything that reads bags opens
the files. The format is specified at https://mcap.dev/spec; chunks are not compressed.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from ..exceptions import LogError

_MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = range(1, 7)
_MESSAGE_INDEX, _CHUNK_INDEX, _STATISTICS = 7, 8, 11
_METADATA, _METADATA_INDEX, _DATA_END = 12, 13, 15
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


def _text(text: str) -> bytes:
    raw = text.encode()
    return struct.pack("<I", len(raw)) + raw


def _table(table: Mapping[str, str]) -> bytes:
    body = b"".join(_text(key) + _text(value) for key, value in table.items())
    return struct.pack("<I", len(body)) + body


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


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


class McapWriter:
    """Writes messages in chunks; each ``flush`` leaves a file that can be read up to there.

    Attributes:
        size: of the file up to the last whole chunk [bytes].
    """

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
        self._file, self._chunk = file, bytearray()
        self._times: list[list[tuple[int, int]]] = [[] for _ in topics]
        self._counts, self._chunks = [0] * len(topics), []  # type: ignore[var-annotated]
        self._span = [0, 0]
        kinds = list(dict.fromkeys((topic.kind, topic.definition) for topic in topics))
        self._known = b"".join(
            _record(
                _SCHEMA,
                struct.pack("<H", k + 1) + _text(kind) + _text("ros2msg")
                + _text(DEFINITIONS[kind] if definition is None else definition),
            )
            for k, (kind, definition) in enumerate(kinds)
        )  # fmt: skip
        self._known += b"".join(
            _record(
                _CHANNEL,
                struct.pack("<HH", k, kinds.index((topic.kind, topic.definition)) + 1)
                + _text(topic.name) + _text("cdr") + _table({}),
            )
            for k, topic in enumerate(topics)
        )  # fmt: skip
        self._schemas = len(kinds)
        start = _MAGIC + _record(_HEADER, _text("ros2") + _text("pinadapt"))
        metadata = _record(_METADATA, _text("pinadapt") + _table(about or {}))
        self._metadata = len(start), len(metadata)
        self.size = 0
        self._append(start + metadata + self._known)

    def _append(self, raw: bytes) -> None:
        """Write bytes and hand them to the system."""
        self._file.write(raw)
        self._file.flush()
        self.size += len(raw)

    def add(self, topic: int, time: int, data: bytes) -> None:
        """Add a message to the chunk.

        Args:
            topic: its number.
            time: since 1970 [ns].
            data: the message, with the header of its encoding.
        """
        self._times[topic].append((time, len(self._chunk)))
        head = struct.pack("<HIQQ", topic, self._counts[topic] & 0xFFFFFFFF, time, time)
        self._chunk += struct.pack("<BQ", _MESSAGE, len(head) + len(data)) + head + data
        self._counts[topic] += 1

    def flush(self) -> None:
        """Write the chunk, if there is anything in it.

        Raises:
            OSError: it cannot be written; the file is cut to its last whole chunk.
        """
        if not self._chunk:
            return
        times = [time for topic in self._times for time, _ in topic]
        span, size, start = (min(times), max(times)), len(self._chunk), self.size
        chunk = _record(
            _CHUNK,
            struct.pack("<QQQI", *span, size, 0) + _text("") + struct.pack("<Q", size)
            + bytes(self._chunk),
        )  # fmt: skip
        index, offsets = b"", {}
        for topic, messages in enumerate(self._times):
            if messages:
                offsets[topic] = start + len(chunk) + len(index)
                rows = b"".join(struct.pack("<QQ", *row) for row in messages)
                index += _record(_MESSAGE_INDEX, struct.pack("<HI", topic, len(rows)) + rows)
        try:
            self._append(chunk + index)
        except OSError:
            self._cut()
            raise
        places = b"".join(struct.pack("<HQ", *item) for item in offsets.items())
        self._chunks.append(
            struct.pack("<QQQQI", *span, start, len(chunk), len(places)) + places
            + struct.pack("<Q", len(index)) + _text("") + struct.pack("<QQ", size, size)
        )  # fmt: skip
        self._span = [self._span[0] or span[0], span[1]]
        self._chunk.clear()
        for messages in self._times:
            messages.clear()

    def _cut(self) -> None:
        """Cut the file to its last whole chunk."""
        try:
            self._file.truncate(self.size)
            self._file.seek(self.size)
        except OSError:
            pass

    def close(self) -> None:
        """Write the rest and the index.

        Raises:
            OSError: it cannot be written; the messages up to the last chunk are there.
        """
        self.flush()
        end = _record(_DATA_END, struct.pack("<I", 0))
        start = self.size + len(end)
        counts = b"".join(struct.pack("<HQ", k, n) for k, n in enumerate(self._counts))
        statistics = struct.pack(
            "<QHIIIIQQI", sum(self._counts), self._schemas, len(self._counts), 0, 1,
            len(self._chunks), *self._span, len(counts),
        )  # fmt: skip
        summary = self._known
        summary += b"".join(_record(_CHUNK_INDEX, each) for each in self._chunks)
        summary += _record(_METADATA_INDEX, struct.pack("<QQ", *self._metadata) + _text("pinadapt"))
        summary += _record(_STATISTICS, statistics + counts)
        footer = _record(_FOOTER, struct.pack("<QQI", start, 0, 0))
        try:
            self._append(end + summary + footer + _MAGIC)
        except OSError:
            self._cut()
            raise


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
    """Return the messages of a file up to where it is whole; chunks must not be compressed.

    Raises:
        LogError: it cannot be read, or is no such file.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise LogError(f"cannot be read: {error.strerror or error}.", where=str(path)) from error
    if not raw.startswith(_MAGIC):
        raise LogError("is not an MCAP file.", where=str(path))
    about: dict[str, str] = {}
    schemas: dict[int, str] = {}
    topics: dict[int, tuple[str, int]] = {}
    messages: dict[int, list[tuple[int, bytes]]] = {}
    waiting = [_records(raw, len(_MAGIC), len(raw))]
    whole = False
    while waiting:
        found = next(waiting[-1], None)
        if found is None:
            waiting.pop()
            continue
        kind, at, end = found
        if kind == _CHUNK:
            compression, at = _read_text(raw, at + 28)
            if compression:
                raise LogError(f"has chunks compressed by {compression}.", where=str(path))
            waiting.append(_records(raw, at + 8, end))
        elif kind == _MESSAGE:
            topic, _, time, _ = struct.unpack_from("<HIQQ", raw, at)
            messages.setdefault(topic, []).append((time, raw[at + 22 : end]))
        elif kind == _SCHEMA:
            _, after = _read_text(raw, at + 2)
            _, after = _read_text(raw, after)
            schemas[struct.unpack_from("<H", raw, at)[0]] = _read_text(raw, after)[0]
        elif kind == _CHANNEL:
            topic, schema = struct.unpack_from("<HH", raw, at)
            topics[topic] = _read_text(raw, at + 4)[0], schema
        elif kind == _METADATA:
            _, after = _read_text(raw, at)
            about = dict(_read_table(raw, after))
        elif kind == _DATA_END:
            whole = raw.endswith(_MAGIC)
            break
    return McapContent(
        about,
        {name: schemas.get(schema, "") for name, schema in topics.values()},
        {name: messages.get(topic, []) for topic, (name, _) in topics.items()},
        whole,
    )


def _records(raw: bytes, at: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield kind, start and end of the records that are whole."""
    while at + 9 <= end:
        kind, size = struct.unpack_from("<BQ", raw, at)
        if at + 9 + size > end:
            return
        yield kind, at + 9, at + 9 + size
        at += 9 + size


def _read_text(raw: bytes, at: int) -> tuple[str, int]:
    (size,) = struct.unpack_from("<I", raw, at)
    return raw[at + 4 : at + 4 + size].decode(errors="replace"), at + 4 + size


def _read_table(raw: bytes, at: int) -> Iterator[tuple[str, str]]:
    (size,) = struct.unpack_from("<I", raw, at)
    at, end = at + 4, at + 4 + size
    while at < end:
        key, at = _read_text(raw, at)
        value, at = _read_text(raw, at)
        yield key, value


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
