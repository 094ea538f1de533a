"""The log of every cycle, and the process beside the loop that writes it and answers requests.

The loop fills one record of numbers a cycle in a ring of shared memory, and does nothing else. The
process beside it writes the records as MCAP, answers on the loopback, and hands commands on. If the
loop dies, the process writes what the ring still holds and ends the file; if it dies itself, the
file is readable up to the last 0.1 s and the loop stops the arm.

Messages are those of ROS 2 (CDR, little endian), so Foxglove and everything that reads bags opens
the file.
"""

from __future__ import annotations

import json
import math
import select
import signal
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._checks import mapping, whole, word
from .._output import read_as_data
from .._version import __version__
from ..exceptions import InputError, LogError, ParameterError
from ..records import Desired, DesiredSteps, Feet, Measurement
from ..robot.changes import Payload
from .processes import MAIN, end_process, start_process

if TYPE_CHECKING:
    from ..controller.controller import Controller
    from ..controller.state import ControllerState, Sample
    from ..robot.robot import Robot

COMMANDS = ("state", "latch", "stop", "hold", "go", "adapt", "load", "reference", "frame")
_STATED = ("t", "a_k", "a_d", "q", "v", "x", "x_d", "sent", "tau", "residual", "step_us")
_ROWS = 8192  # of the ring: eight seconds at 1 kHz; half, twice: four, sixteen
# [s] of a chunk of the file, the last of which a killed process loses; half, twice: half, twice of
# it
_CHUNK = 0.05

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"  # with which a message of CDR begins
_LINE = "================================================================================"
_HEADER = f"""{_LINE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_LINE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
# Topic -> kind and definition of its messages, beside that of the cycles
_TOPICS = {
    "/joint_states": (
        "sensor_msgs/msg/JointState",
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
        f"float64[] effort\n{_HEADER}",
    ),
    "/pinadapt/events": ("std_msgs/msg/String", "string data\n"),
}
Translator = Callable[[Any, Measurement], Any]


class Phase(IntEnum):
    """Phases of the loop, in their order; only a commanded hold returns to running."""

    STARTING, RUNNING, HOLDING, DAMPING, STOPPED = range(5)


def shapes_of(controller: Controller) -> dict[str, list[int]]:
    """Return the shapes of a cycle's numbers by name; a signal that was not measured is NaN."""
    kinematics = controller.kinematics
    task = kinematics.task
    of_joints = "v", "a", "tau", "w", "asked", "sent", "given", "residual"
    sizes = {
        **dict.fromkeys(of_joints, kinematics.nv),
        "q": kinematics.nq,
        **dict.fromkeys(("x", "x_d"), task.coordinates),
        **dict.fromkeys(("xd", "xd_d", "xdd_d"), task.size),
        "a_k": kinematics.size,
        "a_d": controller.dynamics.size,
        "feet": 10 * len(kinematics.robot.contacts),  # NaN: all stand
    }
    one = ("t", "host", "dt", "phase", "adapting", "step_us", "received", "x_time")
    return {name: [] for name in one} | {name: [size] for name, size in sizes.items()}


def tick_of(about: Mapping[str, str]) -> np.dtype[Any]:
    """Return the record of a cycle that the texts of a log describe."""
    shapes = json.loads(about["record"])
    return np.dtype([(name, float, tuple(shape)) for name, shape in shapes.items()])


def cdr(*values: str | int | np.ndarray) -> bytes:
    """Return a message of texts, 32-bit integers and lists of float64, each aligned."""
    body = bytearray()
    for value in values:
        raw = value.encode() + b"\0" if isinstance(value, str) else b""
        number = value.size if isinstance(value, np.ndarray) else len(raw) or value
        body += bytes(-len(body) % 4) + struct.pack("<I", number) + raw
        if isinstance(value, np.ndarray):
            body += bytes(-len(body) % 8) + value.tobytes()
    return _LITTLE_ENDIAN + bytes(body)


class Recorder:
    """Writes the log of a loop and takes its commands, by a process of its own.

    Attributes:
        path: of the log.
        port: on the loopback, or None.
        trouble: what is wrong with the log or its process, or an empty text.
    """

    def __init__(
        self,
        path: Path | str,
        controller: Controller,
        *,
        about: Mapping[str, str] | None = None,
        port: int | None = None,
        translate: Mapping[str, Translator] | None = None,
    ) -> None:
        """Start the process.

        Args:
            path: of the MCAP file, replaced if there is one.
            controller: whose cycles are recorded.
            about: texts kept with the log.
            port: for commands and state, on the loopback only; 0 takes any free one, None: none.
            translate: functions of a command's value and the latest measurement that return what
                the loop gets, run in the other process; for "reference".

        Raises:
            InputError: the file cannot be written, or the port is in use.
        """
        kinematics = controller.kinematics
        self.path = Path(path)
        self.trouble = ""
        if port is not None:
            whole(port, "port", 0, most=2**16 - 1)
        about = {
            "version": __version__,
            "robot": kinematics.robot.name,
            "joints": json.dumps(kinematics.joint_names),
            "law": controller.law.name,
            "period": repr(controller.period),
            "record": json.dumps(shapes_of(controller)),
            "kinematic_names": json.dumps(kinematics.names),
            "dynamic_names": json.dumps(controller.dynamics.names),
            **(about or {}),
        }
        context = get_context("spawn")
        tick = tick_of(about)
        shared = context.RawArray("b", _ROWS * tick.itemsize), context.RawArray("Q", 2)
        self._ring = np.frombuffer(shared[0], tick)
        self._counts = np.frombuffer(shared[1], "u8")
        failure = InputError("the process of the log has not started.", where=path, hint=MAIN)
        self._process, self._link, self.port = start_process(
            _serve, failure, shared, about, self.path, port, dict(translate or {})
        )
        self.pid = self._process.pid

    def record(self, cycle: Mapping[str, Any]) -> None:
        """Hand on the record of a cycle; a full ring drops it, and says so.

        Args:
            cycle: numbers by name; what is None or missing is NaN.
        """
        written, read = self._counts.tolist()
        if written - read >= len(self._ring):
            self.trouble = "cycles are not in the log; its disk is too slow"
            return
        row = self._ring[written % len(self._ring)]
        for name in row.dtype.names or ():
            row[name] = cycle.get(name)  # None is NaN there
        self._counts[0] = written + 1

    def event(self, **what: Any) -> None:
        """Log something that happens, as JSON, with the number of the coming cycle."""
        with suppress(OSError):
            self._link.send({"cycle": int(self._counts[0]), **what})

    def commands(self) -> Iterator[tuple[str, Any]]:
        """Yield the commands that have come; ``trouble`` may have changed then."""
        try:
            while select.select([self._link], [], [], 0.0)[0]:
                name, value = self._link.recv()
                if name == "trouble":
                    self.trouble = value
                else:
                    yield name, value
        except (OSError, EOFError):
            self.trouble = "the process has died"

    def close(self) -> None:
        """Have the rest written and end the process."""
        with suppress(OSError):
            self._link.send(None)
        end_process(self._process, self._link)

    def __enter__(self) -> Recorder:
        """Return the recorder."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self.close()


class _LogProcess:
    """What the process beside the loop does.

    Attributes:
        port: at which it answers, or None.
    """

    def __init__(
        self,
        link: Connection,
        shared: tuple[Any, Any],
        about: dict[str, str],
        path: Path,
        port: int | None,
        translate: dict[str, Translator],
    ) -> None:
        self._server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            if port is not None:
                self._server.bind(("127.0.0.1", port))
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("wb")
        except OSError as error:
            raise InputError(
                f"log or port {port} cannot be used: {error.strerror or error}.",
                where=path,
                hint="Choose another file by --log, and another port, or 0 for any.",
            ) from error
        self.port = None if port is None else self._server.getsockname()[1]
        self._ring = np.frombuffer(shared[0], tick_of(about))
        self._counts = np.frombuffer(shared[1], "u8")  # of records, written and read
        self._link = link
        self._translate = translate
        self._sending = threading.Lock()
        self._translating = threading.Lock()
        self._read = 0
        self._row = self._ring[0].copy()
        self._joints = json.loads(about["joints"])
        self._start = time.time_ns()  # at the arm's time zero, once it is known
        self._messages = deque[str](maxlen=20)
        from mcap.writer import CompressionType, Writer

        chunk = int(self._ring.itemsize * _CHUNK / float(about["period"]))
        self._writer: Any = Writer(self._file, max(chunk, 1), CompressionType.ZSTD)
        self._writer.start("ros2", "pinadapt")
        self._channels = {}
        shapes = json.loads(about["record"]).items()
        lines = [f"float64{shape or ''} {name}\n" for name, shape in shapes if shape != [0]]
        cycle = "pinadapt_msgs/msg/Cycle", "".join(lines)
        for topic, (kind, text) in {"/pinadapt/cycle": cycle, **_TOPICS}.items():
            schema = self._writer.register_schema(kind, "ros2msg", text.encode())
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schema, about)

    def run(self) -> None:
        """Write and answer until the loop closes or dies."""
        waited: list[Any] = [self._link, self._server]
        said: dict[str, Any] | None = {}
        while said is not None:
            ready = select.select(waited, [], [], 0.02)[0]
            try:
                said = self._link.recv() if self._link in ready else {}
            except (OSError, EOFError):
                said = None
                self._drain()
                self._note({"lost": "the process of the loop has died", "cycle": self._read})
            if said:  # before a backlog of cycles, after which a killed process would lose it
                self._note(said)
            self._drain()
            if self._server in ready:
                with suppress(OSError):
                    asked = self._server.recvfrom(1 << 16)
                    threading.Thread(target=self._answer, args=asked).start()
        if self._writer is not None:
            self._guarded(self._writer.finish)

    def _guarded(self, write: Callable[..., object], *arguments: Any) -> None:
        """Write; a failure is reported to the loop, and the log ends at its last whole chunk."""
        try:
            write(*arguments)
            self._file.flush()
        except OSError as error:
            self._writer = None
            self._send("trouble", f"the log cannot be written: {error.strerror or error}")

    def _send(self, name: str, value: Any) -> None:
        with self._sending, suppress(OSError):
            self._link.send((name, value))

    def _add(self, topic: str, data: bytes) -> None:
        if self._writer is not None:
            stamp = self._stamp()
            self._guarded(self._writer.add_message, self._channels[topic], stamp, data, stamp)

    def _stamp(self) -> int:
        """Return the time of the latest record, by the arm's clock [ns since 1970]."""
        return self._start + round(1e9 * self._row["t"])

    def _drain(self) -> None:
        """Take the records that have come."""
        while self._read < self._counts[0]:
            self._row = row = self._ring[self._read % len(self._ring)].copy()
            if not self._read:
                self._start -= round(1e9 * row["t"])
            self._read += 1
            self._counts[1] = self._read
            self._add("/pinadapt/cycle", _LITTLE_ENDIAN + row.tobytes())
            q = row["q"]
            n = len(self._joints)
            if q.size == n:
                tau = row["given"] if np.isnan(row["tau"]).any() else row["tau"]
                header = divmod(self._stamp(), 10**9)
                self._add("/joint_states", cdr(*header, "", n, *self._joints, q, row["v"], tau))

    def _note(self, what: dict[str, Any]) -> None:
        text = json.dumps(what)
        self._messages.append(text)
        self._add("/pinadapt/events", cdr(text))

    def _answer(self, said: bytes, sender: Any) -> None:
        """Answer one datagram, in a thread of its own: what is slow to read delays no latch."""
        with suppress(OSError):
            try:
                reply = self._reply(json.loads(said))
            except Exception as error:  # a command must not end the log
                reply = {"error": str(error)}
            self._server.sendto(json.dumps(reply).encode(), sender)

    def _reply(self, asked: Any) -> dict[str, Any]:
        """Return the answer to a command.

        Raises:
            InputError: it is none, or cannot be done yet.
        """
        asked = mapping(asked, "datagram")
        row = self._row
        name = word(asked.get("command"), COMMANDS, "command")
        value = asked.get("value")
        if name == "state":
            return {
                "cycle": self._read,
                "phase": Phase(int(row["phase"])).name.lower(),
                "adapting": bool(row["adapting"]),
                "messages": list(self._messages),
                **{key: np.nan_to_num(row[key]).tolist() for key in _STATED},
            }
        if name in self._translate:
            if not self._read:
                raise InputError("the loop has not started.")
            with self._translating:  # whose models are not for several threads
                value = self._translate[name](value, measurement_of(row))
        self._send(name, value)
        return {"sent": name}


def _serve(link: Connection, *arguments: Any) -> None:
    """Serve in the process beside the loop."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the loop's
    try:
        process = _LogProcess(link, *arguments)
    except InputError as refusal:
        link.send(refusal)
        return
    link.send(process.port)
    process.run()


def tell(port: int, command: str, value: Any = None, *, timeout: float = 2.0) -> dict[str, Any]:
    """Send a command to a running loop, and return its answer.

    Args:
        port: of the loop, on this machine.
        command: "state" asks what it does; "hold" stops the path and "go" goes on; "stop" holds,
            damps and stops; "latch" damps and stops at once; "adapt" takes True or False; "load"
            takes a table of mass, com and inertia of a load that is attached, or None for none;
            "reference" takes the table of a motion; "frame" one of x and its age [s]
        value: of the command.
        timeout: for the answer [s].

    Raises:
        InputError: no loop answers there, or the command cannot be read. What the loop refuses is
            among the messages of "state".
    """
    whole(port, "port", 1, most=2**16 - 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.settimeout(timeout)
        try:
            link.sendto(
                json.dumps({"command": command, "value": value}).encode(), ("127.0.0.1", port)
            )
            reply = json.loads(link.recv(1 << 20))
        except OSError as error:
            raise InputError(
                f"no answer: {error}.",
                where=f"127.0.0.1:{port}",
                hint="Is the loop running? It prints its port when it starts.",
            ) from error
    if "error" in reply:
        raise InputError(reply["error"], where=command)
    return reply


def watched(port: int, controller: Controller, robot: Robot) -> Iterator[Sample]:
    """Yield samples of a running loop as a live view takes them, until it ends.

    The process of the log answers, not the loop. The torque is not in the samples: between
    two of them there are many cycles.

    Args:
        port: of the loop, on this machine.
        controller: as the loop has it.
        robot: that is shown where the arm is; of a real arm the description.

    Raises:
        InputError: no loop answers there.
    """
    from ..controller.state import Sample

    said = tell(port, "state")
    rest = np.zeros(controller.kinematics.task.size)
    while said["phase"] != "stopped":
        if said["cycle"]:
            q, v, x_d, a_k, a_d = (np.array(said[name]) for name in ("q", "v", "x_d", "a_k", "a_d"))
            seen = Measurement(said["t"], q, v, robot.position(q))
            state = controller.init(seen, a_k=a_k, a_d=a_d)
            desired = Desired(x_d, rest, rest)
            yield Sample(seen.t, seen, desired, state, np.full(v.size, math.nan), seen)
        time.sleep(1.0 / 30.0)  # smooth to the eye
        try:
            said = tell(port, "state")
        except InputError:
            return


# --- reading and replaying ----------------------------------------------------------------------


def measurement_of(row: np.void) -> Measurement:
    """Return the measurement in a record of a cycle."""
    return Measurement(*(_signal(row, name) for name in Measurement._fields))


def _signal(row: np.void, name: str) -> Any:
    """Return a number or an array in a record of a cycle, None for one that it lacks."""
    return None if np.isnan(row[name]).all() else row[name].copy()


@dataclass(frozen=True, eq=False)
class CycleLog:
    """The cycles of a run.

    Attributes:
        about: texts kept with the log.
        cycles: all records; ``cycles.t`` is (N), ``cycles.q`` is (N, nq), and so on.
        events: what happened, in order; each has the number of the cycle before which it did.
        whole: whether the file has its end.
    """

    about: dict[str, str]
    cycles: np.recarray[Any, Any]
    events: list[dict[str, Any]]
    whole: bool

    @classmethod
    def read(cls, path: Path | str) -> CycleLog:
        """Return the log in a file, up to where it is whole. It is data, which runs nothing.

        Raises:
            LogError: it is no log of a loop, or has no cycle.
        """
        from mcap.exceptions import McapError
        from mcap.reader import NonSeekingReader

        about: dict[str, str] = {}
        found: dict[str, list[bytes]] = {}
        whole = False
        with read_as_data(Path(path), LogError), Path(path).open("rb") as file:
            with suppress(McapError, struct.error):  # where its end is missing
                for _, channel, message in NonSeekingReader(file).iter_messages(
                    log_time_order=False
                ):
                    found.setdefault(channel.topic, []).append(message.data[4:])
                    about = channel.metadata
                whole = True
            if "/pinadapt/cycle" not in found:
                raise LogError(f"is no log of a loop; it has {sorted(found)}.", where=path)
            data = b"".join(found["/pinadapt/cycle"])
            cycles = np.frombuffer(data, tick_of(about)).view(np.recarray)
            events = [json.loads(data[4:-1]) for data in found.get("/pinadapt/events", ())]
        return cls(about, cycles, events, whole)

    def __len__(self) -> int:
        """Return the number of cycles."""
        return len(self.cycles)

    @property
    def stepped(self) -> np.ndarray:
        """(N) in which cycles the controller was asked."""
        return np.isfinite(self.cycles.asked).all(axis=1)

    def replay(self, controller: Controller) -> ReplayedTorques:
        """Return what a controller asks for, given the same measurements and desired motion.

        The controller that was run asks for the same torques bit for bit. Another one shows what
        it would have asked for at each instant, had the arm moved the same.

        Args:
            controller: the one that was run, or another one for the same arm.

        Raises:
            LogError: the log does not contain the start of the loop.
            PinadaptError: the controller refuses a sample, as of another arm.
        """
        begun = next((event["begun"] for event in self.events if "begun" in event), None)
        if begun is None:
            raise LogError("does not contain the start of the loop.", where="log")
        announced = {event["cycle"]: event["load"] for event in self.events if "load" in event}
        state: ControllerState | None = None
        found = []
        stepped = self.stepped
        for k, row in enumerate(self.cycles):
            if k in announced and state is not None:
                state = controller.announce(state, payload=load_of(announced[k]))
            if not stepped[k]:
                continue
            m = measurement_of(row)
            desired = Desired(*(_signal(row, name) for name in Desired._fields))
            if np.isfinite(row["feet"]).any():
                desired = DesiredSteps.of(desired, Feet.of_table(row["feet"]))
            if state is None:
                controller = controller.resting_at(m.q)
                try:
                    state = controller.init(m, **begun["start"])
                except ParameterError:  # other unknowns: from its own estimates
                    state = controller.init(m)
            state = state.adapt(bool(row["adapting"])).gave(_signal(row, "given"))
            torque, state = controller.step(state, m, desired, begun["period"])
            found.append(torque)
        logged = self.cycles.asked[stepped]
        return ReplayedTorques(np.reshape(found, logged.shape), logged)


@dataclass(frozen=True, eq=False)
class ReplayedTorques:
    """Torques of a replay beside those of the log, of the N cycles that asked for one; n joints.

    Attributes:
        torque: (N, n) of the replay [N m or N].
        logged: (N, n) of the log.
    """

    torque: np.ndarray
    logged: np.ndarray

    @property
    def same(self) -> bool:
        """Whether all torques are the same to the bit, and there are any."""
        return bool(self.torque.size) and self.torque.tobytes() == self.logged.tobytes()

    @property
    def difference(self) -> np.ndarray:
        """(n) root mean square of the differences [N m or N]."""
        return np.sqrt(np.mean((self.torque - self.logged) ** 2, axis=0))


def load_of(table: Mapping[str, Any] | None) -> Payload | None:
    """Return the load of a table of mass, com and inertia, or None for none.

    Raises:
        InputError: it is none.
    """
    if table is None:
        return None
    for key in mapping(table, "load"):
        word(key, Payload.__annotations__, "load")
    return Payload(**{"mass": None, **table})
