"""The log of every cycle, and the process beside the loop that writes it and answers requests.

The loop copies one row of numbers a cycle into a ring in shared memory, and does nothing else. The
process beside it writes the rows as MCAP, twenty times a second, answers on the loopback, and hands
commands on. If the loop dies, the process writes what the ring still holds and ends the file; if it
dies itself, the file is readable up to the last 0.1 s and the loop stops the arm.
"""

from __future__ import annotations

import json
import math
import os
import pickle
import select
import signal
import socket
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._output import read_as_data
from .._version import __version__
from ..exceptions import InputError, LogError
from ..logs.mcap import (
    JointStates,
    McapWriter,
    Topic,
    fields_of,
    numbers_definition,
    numbers_message,
    numbers_of,
    pose_message,
    read_mcap,
    text_message,
    text_of,
)
from .arm import MAIN

if TYPE_CHECKING:
    from ..controller.controller import Controller
    from ..controller.state import ControllerState, Sample
    from ..records import Desired, Measurement
    from ..robot.robot import Robot

PHASES = ("starting", "running", "holding", "damping", "stopped")
COMMANDS = ("state", "latch", "stop", "hold", "go", "adapt", "load", "reference", "frame")
_CYCLE, _STATES, _FRAMES, _EVENTS, _ESTIMATES = range(5)
_ROWS = 8192  # of the ring: eight seconds at 1 kHz
_EVERY = 0.05  # [s] between two chunks of the file
_SLOWLY = 0.1  # [s] between two records of the estimates
_WRITTEN, _READ, _DROPPED, _WAITING, _FAILED, _CLOSED, _ALIVE = range(7)
_HAS = ("x", "xd", "tau", "w")


def _fields(nq: int, n: int, x: int, m: int) -> dict[str, int]:
    """Return the fields of a row and their sizes."""
    one = "t host dt phase stepped adapting step_us received age has x_time"
    return {
        **dict.fromkeys(one.split(), 1),
        **{"q": nq, "v": n, "x": x, "xd": m, "tau": n, "w": n},
        **{"x_d": x, "xd_d": m, "xdd_d": m, "asked": n, "sent": n, "given": n, "residual": n},
    }


class Row:
    """One row of numbers with its fields as views, of which the last axis are the numbers.

    Attributes:
        values: (width) the numbers.
    """

    def __init__(self, fields: Mapping[str, int], values: np.ndarray | None = None) -> None:
        """Take the fields and their sizes, and the numbers of an existing row or of many."""
        self.fields = dict(fields)
        self.values = np.zeros(sum(fields.values())) if values is None else values
        at = 0
        for name, size in fields.items():
            part = self.values[..., at : at + size]
            setattr(self, name, part)
            at += size

    def __getattr__(self, name: str) -> Any:
        """Return a field; this is reached only by names that are none."""
        raise AttributeError(name)

    def measured(self, m: Measurement) -> None:
        """Write a measurement."""
        has = 0
        self.t[0], self.q[:], self.v[:] = m.t, m.q, m.v
        for k, name in enumerate(_HAS):
            value = getattr(m, name)
            if value is not None:
                has |= 1 << k
                getattr(self, name)[:] = value
        self.has[0] = has
        self.x_time[0] = math.nan if m.x_time is None else m.x_time

    def measurement(self) -> Measurement:
        """Return the measurement that was written."""
        from ..records import Measurement

        has, seen = int(self.has[0]), float(self.x_time[0])
        found = {
            name: getattr(self, name).copy() if has >> k & 1 else None
            for k, name in enumerate(_HAS)
        }
        x_time = None if math.isnan(seen) else seen
        return Measurement(float(self.t[0]), self.q.copy(), self.v.copy(), x_time=x_time, **found)

    def desired(self) -> Desired:
        """Return the desired motion that was written."""
        from ..records import Desired

        return Desired(self.x_d.copy(), self.xd_d.copy(), self.xdd_d.copy())


Translator = Callable[[Any, "Measurement"], Any]


class Recorder:
    """Writes the log of a loop and takes its commands, by processes of their own.

    Attributes:
        row: to be filled before ``commit``.
        path: of the log, or None.
        port: on the loopback, or None.
    """

    def __init__(
        self,
        path: Path | str | None,
        controller: Controller,
        *,
        about: Mapping[str, str] | None = None,
        port: int | None = None,
        translate: Mapping[str, Translator] | None = None,
        rows: int = _ROWS,
    ) -> None:
        """Start the process.

        Args:
            path: of the MCAP file, replaced if there is one; None for no log.
            controller: whose cycles are recorded.
            about: texts kept with the log.
            port: for commands and state, on the loopback only; 0 takes any free one, None: none.
            translate: functions of a command's value and the latest measurement that return what
                the loop gets, run in the other process; for "reference".
            rows: of the ring.

        Raises:
            InputError: the file cannot be written, or the port is in use.
        """
        kinematics = controller.kinematics
        robot, task = kinematics.robot, kinematics.task
        fields = _fields(robot.model.nq, robot.model.nv, task.coordinates, task.size)
        self.row, self.path = Row(fields), None if path is None else Path(path)
        server = None if port is None else _server(port)
        self.port: int | None = None if server is None else server.getsockname()[1]
        if self.path is not None:
            self._check(self.path)
        context = get_context("spawn")
        width, sizes = self.row.values.size, (kinematics.size, controller.dynamics.size)
        try:
            self._raw = context.RawArray("d", rows * width)
            self._head_raw = context.RawArray("Q", 8)
            self._now_raw = context.RawArray("d", max(sum(sizes), 1))
        except OSError as error:
            raise InputError(
                f"no memory can be shared: {error.strerror or error}.",
                where=str(path),
                hint="Make room in /dev/shm, or in the folder of temporary files.",
            ) from error
        self._ring = np.frombuffer(self._raw).reshape(rows, width)
        self._head = np.frombuffer(self._head_raw, dtype=np.uint64)
        self._estimates, self._split = np.frombuffer(self._now_raw), sizes[0]
        self._rows, self._count = rows, 0
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        told = {
            "version": __version__,
            "robot": robot.name,
            "joints": json.dumps(robot.joint_names),
            "law": str(getattr(controller.law, "name", "")),
            "period": repr(controller.period),
            "kinematic_names": json.dumps(list(kinematics.names)),
            "dynamic_names": json.dumps(list(controller.dynamics.names)),
            **(about or {}),
        }
        place = None if self.path is None else str(self.path)
        arguments = (
            (self._raw, self._head_raw, self._now_raw), fields, sizes, place, told, there, server,
            dict(translate or {}),
        )  # fmt: skip
        self._process = context.Process(target=_serve, args=arguments, daemon=True)
        self._process.start()
        there.close()
        if server is not None:
            server.close()
        self._link = here
        here.settimeout(60.0)
        try:
            ready = here.recv(1 << 12)
        except OSError:
            ready = b""
        if ready != b"ready":
            self.close()
            raise InputError(
                f"the process of the log has not started: {ready.decode() or 'no answer'}.",
                where=str(path),
                hint=MAIN,
            )
        here.setblocking(False)
        self.pid = self._process.pid

    @staticmethod
    def _check(path: Path) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("wb"):
                pass
        except OSError as error:
            raise InputError(
                f"cannot be written: {error.strerror or error}.",
                where=str(path),
                hint="Choose another file by --log.",
            ) from error

    def commit(self) -> None:
        """Hand the row on; a full ring drops it and counts it."""
        head = self._head
        if self._count - int(head[_READ]) >= self._rows:
            head[_DROPPED] += np.uint64(1)
            return
        self._ring[self._count % self._rows] = self.row.values
        self._count += 1
        head[_WRITTEN] = self._count

    def estimates(self, a_k: np.ndarray, a_d: np.ndarray) -> None:
        """Show the present estimates, for the log's slow topic and for viewers."""
        self._estimates[: self._split] = a_k
        self._estimates[self._split : self._split + a_d.size] = a_d

    def event(self, **what: Any) -> None:
        """Log something that happens, as JSON, with the number of the coming cycle."""
        with suppress(OSError):
            self._link.send(json.dumps({"cycle": self._count, **what}).encode())

    def commands(self) -> list[tuple[str, Any]]:
        """Return the commands that have come."""
        if not self._head[_WAITING]:
            return []
        self._head[_WAITING] = 0
        found = []
        try:
            while said := self._link.recv(1 << 20):
                found.append(pickle.loads(said))  # of our own child
        except OSError:  # nothing is there any more
            pass
        return found

    @property
    def trouble(self) -> str:
        """What is wrong with the log or its process, or an empty text."""
        head = self._head
        if head[_FAILED]:
            return f"the log cannot be written: {os.strerror(int(head[_FAILED]))}"
        if head[_DROPPED]:
            return f"{int(head[_DROPPED])} cycles are not in the log; its disk is too slow"
        return ""

    def alive(self) -> bool:
        """Return whether the process runs; a system call."""
        return self._process.is_alive()

    def close(self) -> None:
        """Have the rest written and end the process."""
        self._head[_CLOSED] = 1
        self._process.join(10.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(1.0)
        self._link.close()

    def __enter__(self) -> Recorder:
        """Return the recorder."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self.close()


def _server(port: int) -> socket.socket:
    server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        server.bind(("127.0.0.1", port))
    except OSError as error:
        server.close()
        raise InputError(
            f"port {port} cannot be used: {error.strerror or error}.",
            where="port",
            hint="Another loop may be running; take another port, or 0 for any.",
        ) from error
    return server


class _LogProcess:
    """What the process beside the loop does."""

    def __init__(
        self,
        shared: tuple[Any, Any, Any],
        fields: dict[str, int],
        sizes: tuple[int, int],
        path: str | None,
        about: dict[str, str],
        link: socket.socket,
        server: socket.socket | None,
        translate: dict[str, Translator],
    ) -> None:
        raw, head, now = shared
        width = sum(fields.values())
        self._ring = np.frombuffer(raw).reshape(-1, width)
        self._head = np.frombuffer(head, dtype=np.uint64)
        self._now, self._sizes = np.frombuffer(now), sizes
        self._row = Row(fields)
        self._about, self._link, self._server = about, link, server
        self._translate, self._read = translate, 0
        self._start = time.time_ns()
        self._zero: float | None = None
        self._messages: list[str] = []
        self._states = JointStates(json.loads(about["joints"]))
        self._writer: McapWriter | None = None
        self._plain = fields["q"] == fields["v"]
        if path is not None:
            pose = "PoseStamped" if fields["x"] == 7 else "PointStamped"
            estimates = {"t": 1, "a_k": sizes[0], "a_d": sizes[1]}
            topics = [
                Topic("/pinadapt/cycle", "pinadapt_msgs/msg/Cycle", numbers_definition(fields)),
                Topic("/joint_states", "sensor_msgs/msg/JointState"),
                Topic("/task_frame", f"geometry_msgs/msg/{pose}"),
                Topic("/pinadapt/events", "std_msgs/msg/String"),
                Topic(
                    "/pinadapt/estimates",
                    "pinadapt_msgs/msg/Estimates",
                    numbers_definition(estimates),
                ),
            ]
            file = Path(path).open("wb", buffering=0)  # noqa: SIM115  # until the loop ends
            self._writer = McapWriter(file, topics, about)

    def run(self) -> None:
        """Write and answer until the loop closes or dies."""
        waited = [self._link] + ([] if self._server is None else [self._server])
        flushed = slowly = 0.0
        while True:
            ready = select.select(waited, [], [], 0.02)[0]
            lost = self._link in ready and not self._heard()
            closed = bool(self._head[_CLOSED])
            self._drain()
            if self._server in ready:
                self._answer()
            now = time.monotonic()
            if now - slowly > _SLOWLY and self._read:
                slowly = now
                values = np.concatenate([self._row.t, self._now[: sum(self._sizes)]])
                self._add(_ESTIMATES, numbers_message(values))
            if now - flushed > _EVERY:
                flushed = now
                self._guarded(lambda writer: writer.flush())
            if lost:
                self._note({"lost": "the process of the loop has died", "cycle": self._read})
            if lost or closed:
                while not lost and select.select([self._link], [], [], 0.0)[0]:
                    lost = not self._heard()  # the last events may still wait
                self._drain()
                self._guarded(lambda writer: writer.close())
                return

    def _stamp(self) -> int:
        """Return the time of the row, by the arm's clock [ns]."""
        t = float(self._row.t[0])
        if not math.isfinite(t):
            return self._start
        self._zero = t if self._zero is None else self._zero
        return self._start + round(1e9 * (t - self._zero))

    def _guarded(self, write: Callable[[McapWriter], None]) -> None:
        """Write; failures are reported to the loop, and the log ends at its last whole chunk."""
        if self._writer is None:
            return
        try:
            write(self._writer)
        except OSError as error:
            self._head[_FAILED] = error.errno or 5
            self._writer = None

    def _add(self, topic: int, data: bytes) -> None:
        if self._writer is not None:
            self._writer.add(topic, self._stamp(), data)

    def _drain(self) -> None:
        """Take the rows that have come."""
        row, rows = self._row, len(self._ring)
        while self._read < int(self._head[_WRITTEN]):
            row.values[:] = self._ring[self._read % rows]
            self._read += 1
            self._head[_READ] = self._read
            if self._writer is None:
                continue
            stamp, has = self._stamp(), int(row.has[0])
            self._add(_CYCLE, numbers_message(row.values))
            if self._plain:
                tau = row.tau if has >> 2 & 1 else row.given
                self._add(_STATES, self._states.message(stamp, row.q, row.v, tau))
            if has & 1 and row.x.size in (3, 7):
                self._add(_FRAMES, pose_message(stamp, row.x))

    def _heard(self) -> bool:
        """Log an event of the loop; return False if the loop has died."""
        said = self._link.recv(1 << 16)
        if said:
            self._drain()
            self._note(json.loads(said))
        return bool(said)

    def _note(self, what: dict[str, Any]) -> None:
        self._messages = [*self._messages[-19:], json.dumps(what)]
        self._add(_EVENTS, text_message(json.dumps(what)))

    def _answer(self) -> None:
        """Answer one datagram."""
        assert self._server is not None
        try:
            said, sender = self._server.recvfrom(1 << 16)
        except OSError:
            return
        try:
            reply = self._reply(json.loads(said))
        except Exception as error:  # a command must not end the log
            reply = {"error": f"{error}"}
        with suppress(OSError):
            self._server.sendto(json.dumps(reply).encode(), sender)

    def _reply(self, asked: Any) -> dict[str, Any]:
        name = asked.get("command") if isinstance(asked, dict) else None
        if name not in COMMANDS:
            return {
                "error": f"there is no command {name!r}; expected one of {', '.join(COMMANDS)}."
            }
        row = self._row
        if name == "state":
            found: dict[str, Any] = {
                key: getattr(row, key).tolist() for key in ("q", "v", "x", "x_d", "sent", "tau")
            }
            k, p = self._sizes
            estimates = self._now[: k + p].tolist()
            return {
                "t": float(row.t[0]),
                "cycle": self._read,
                "phase": PHASES[int(row.phase[0])],
                "adapting": bool(row.adapting[0]),
                "step_us": float(row.step_us[0]),
                "residual": row.residual.tolist(),
                "a_k": estimates[:k],
                "a_d": estimates[k:],
                "messages": self._messages,
                "about": self._about,
                **found,
            }
        value = asked.get("value")
        if name in self._translate:
            if not self._read:
                return {"error": "the loop has not started."}
            value = self._translate[name](value, row.measurement())
        self._link.send(pickle.dumps((name, value)))
        self._head[_WAITING] = 1
        return {"done": name}


def _serve(*arguments: Any) -> None:
    """Serve in the process beside the loop."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the loop's
    link = arguments[5]
    try:
        process = _LogProcess(*arguments)
    except Exception as error:
        link.send(f"{error}".encode()[:1000])
        return
    link.send(b"ready")
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
        InputError: no loop answers there, or the command is refused.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.settimeout(timeout)
        try:
            link.sendto(
                json.dumps({"command": command, "value": value}).encode(), ("127.0.0.1", port)
            )
            reply: dict[str, Any] = json.loads(link.recv(1 << 20))
        except OSError as error:
            raise InputError(
                f"no answer: {error}.",
                where=f"127.0.0.1:{port}",
                hint="Is the loop running? It prints its port when it starts.",
            ) from error
    if "error" in reply:
        raise InputError(reply["error"], where=command)
    return reply


def watched(
    port: int, controller: Controller, robot: Robot, *, rate: float = 30.0
) -> Iterator[Sample]:
    """Yield samples of a running loop as a live view takes them, until it ends.

    The process of the log answers, not the loop. The torque is not in the samples: between
    two of them there are many cycles.

    Args:
        port: of the loop, on this machine.
        controller: as the loop has it.
        robot: that is shown where the arm is; of a real arm the description.
        rate: samples a second.

    Raises:
        InputError: no loop answers there.
    """
    from ..controller.state import Sample
    from ..records import Desired, Measurement

    state: ControllerState | None = None
    said = tell(port, "state")
    rest = np.zeros(controller.kinematics.task.size)
    while said["phase"] != PHASES[-1]:
        if said["cycle"]:
            q, v = np.array(said["q"]), np.array(said["v"])
            seen = Measurement(said["t"], q, v, robot.position(q))
            state = controller.init(seen) if state is None else state
            state = state._replace(
                t=seen.t,
                dynamic=state.dynamic.with_value(np.array(said["a_d"])),
                kinematic=state.kinematic.with_value(np.array(said["a_k"])),
            )
            desired = Desired(np.array(said["x_d"]), rest, rest)
            yield Sample(seen.t, seen, desired, state, np.full(v.size, math.nan), seen)
        time.sleep(1.0 / rate)
        try:
            said = tell(port, "state")
        except InputError:
            return


# --- reading and replaying ----------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class CycleLog:
    """The cycles of a run.

    Attributes:
        about: texts kept with the log.
        cycles: all rows; ``cycles.q`` is (N, nq), and so on.
        events: what happened, in order; each has the number of the cycle before which it did.
        estimates: (M, 1 + p_k + p_d) times [s] and estimates, ten a second.
        whole: whether the file has its end.
    """

    about: dict[str, str]
    cycles: Row
    events: list[dict[str, Any]]
    estimates: np.ndarray
    whole: bool

    @classmethod
    def read(cls, path: Path | str) -> CycleLog:
        """Return the log in a file, up to where it is whole.

        Raises:
            LogError: it is no log of a loop, or has no cycle.
        """
        with read_as_data(Path(path), LogError):
            content = read_mcap(Path(path))
            rows = content.messages.get("/pinadapt/cycle", [])
            if not rows:
                raise LogError("has no cycle of a loop.", where=str(path))
            fields = fields_of(content.definitions["/pinadapt/cycle"])
            values = np.array([numbers_of(data) for _, data in rows])
            events = [
                json.loads(text_of(data))
                for _, data in content.messages.get("/pinadapt/events", [])
            ]
            slow = [numbers_of(data) for _, data in content.messages.get("/pinadapt/estimates", [])]
            return cls(content.about, Row(fields, values), events, np.array(slow), content.whole)

    def __len__(self) -> int:
        """Return the number of cycles."""
        return len(self.cycles.values)

    def row(self, k: int) -> Row:
        """Return one cycle."""
        return Row(self.cycles.fields, self.cycles.values[k])

    def replay(self, controller: Controller, *, sent: bool = False) -> ReplayedTorques:
        """Return what a controller asks for, given the same measurements and desired motion.

        The controller that was run asks for the same torques bit for bit. Another one shows what
        it would have asked for at each instant, had the arm moved the same.

        Args:
            controller: the one that was run, or another one for the same arm.
            sent: compare with the torques that were sent instead of those asked for.

        Raises:
            LogError: the log belongs to another arm.
            PinadaptError: the controller refuses a sample.
        """
        cycles = self.cycles
        n = controller.kinematics.nv
        if cycles.fields["v"] != n or cycles.fields["q"] != controller.kinematics.nq:
            raise LogError(
                f"has {cycles.fields['v']} joints; the controller is for {n}.", where="log"
            )
        begun = next((event["begun"] for event in self.events if "begun" in event), None)
        if begun is None:
            raise LogError("does not contain the start of the loop.", where="log")
        start: dict[str, Any] = {
            name: None if value is None else np.array(value)
            for name, value in begun["start"].items()
        }
        if any(
            value is not None and value.shape[-1:] != (size,)
            for name, size in (
                ("a_k", controller.kinematics.size),
                ("a_d", controller.dynamics.size),
                ("information", controller.dynamics.size),
                ("information_k", controller.kinematics.size),
            )
            if (value := start.get(name)) is not None
        ):
            start = {}  # another choice of unknowns: from its own estimates
        announced = {int(event["cycle"]): event["load"] for event in self.events if "load" in event}
        state: ControllerState | None = None
        found = np.full((len(self), n), math.nan)
        period = float(begun["period"])
        for k in range(len(self)):
            row = self.row(k)
            if k in announced and state is not None:
                state = controller.announce(state, payload=load_of(announced[k]))
            if not row.stepped[0]:
                continue
            m = row.measurement()
            if state is None:
                state = controller.init(m, **start)
            given = row.given.copy() if np.isfinite(row.given).all() else None
            state = state.adapt(bool(row.adapting[0])).gave(given)
            found[k], state = controller.step(state, m, row.desired(), period)
        return ReplayedTorques(cycles.t[:, 0], found, cycles.sent if sent else cycles.asked)


@dataclass(frozen=True, eq=False)
class ReplayedTorques:
    """Torques of a replay beside those of the log; N cycles, n joints.

    Attributes:
        t: (N) [s].
        torque: (N, n) of the replay, NaN where the controller was not asked [N m or N].
        logged: (N, n) of the log.
    """

    t: np.ndarray
    torque: np.ndarray
    logged: np.ndarray

    @property
    def asked(self) -> np.ndarray:
        """(N) whether the controller was asked."""
        return np.isfinite(self.torque).all(axis=1)

    @property
    def same(self) -> bool:
        """Whether all torques are the same to the bit."""
        at = self.asked
        return bool(at.any()) and self.torque[at].tobytes() == self.logged[at].tobytes()

    @property
    def difference(self) -> np.ndarray:
        """(n) root mean square of the differences [N m or N]."""
        at = self.asked
        return np.asarray(np.sqrt(np.mean((self.torque[at] - self.logged[at]) ** 2, axis=0)))


def load_of(table: Mapping[str, Any] | None) -> Any:
    """Return the load of a table of mass, com and inertia, or None for none.

    Raises:
        InputError: it is none.
    """
    from ..robot.changes import Payload

    if table is None:
        return None
    if not isinstance(table, Mapping) or "mass" not in table:
        raise InputError('expected a table such as {"mass": 1.0}.', where="load")
    com: Sequence[float] = table.get("com", (0.0, 0.0, 0.0))
    return Payload(table["mass"], com, table.get("inertia", (0.0,) * 6))
