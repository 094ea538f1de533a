"""What the library needs of an arm, and any ``Plant`` as one: here, or in a process of its own.

And x from the pictures of a camera: a coloured ball at the tool, found by OpenCV.
"""

from __future__ import annotations

import math
import os
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from types import ModuleType, TracebackType
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from .._checks import instance, positive, shown, vector, word
from ..description.chain import effort_limits, velocity_limits
from ..exceptions import ArmError, InputError
from ..plants.plant import Plant, SimulatedPlant
from ..plants.sensors import SimulatedSensors
from ..records import Measurement, Sensors
from ..robot.motors import Compensation, Gravity
from ..robot.robot import Robot

_BRAKE = 20.0  # [1/s] at which the brakes of a simulated arm take its speed
_REST, _BRAKING = 1e-3, 1.0  # [rad/s or m/s] at rest, and longest time to it [s]
_SILENT = 0.1  # [s] without a torque after which a simulated arm stops by itself
_STARTING = 60.0  # [s] that a new process may take
_FIELDS = ("q", "v", "x", "xd", "tau")
SIDES = ("joint", "motor")
Frames = Callable[[], tuple[np.ndarray, float] | None]
"""Returns x of a new frame and when it was taken [s], or None while there is no new one."""

_SATURATED, _BRIGHT = 90, 40  # of 255, saturation and value above which a pixel counts
_ROUND = 0.8  # least share of its smallest enclosing circle that a ball fills, if seen whole
MAIN = "In a script, what starts processes stands below `if __name__ == '__main__':`."


@dataclass(frozen=True, eq=False)
class ArmFacts:
    """Properties of an arm: joints, period, limits, gravity compensation.

    Attributes:
        name: for messages.
        joints: names of the n joints, in the order of q.
        period: of its cycle [s].
        paced: whether ``read`` waits for the arm's own cycle; if not, the loop keeps the time.
        clock: whose clock ``Measurement.t`` counts: "arm" or "host", on both of which a period
            also takes that long by this computer's clock, and is checked; or "simulated", on which
            it may take any time.
        side: "joint" if a torque is that behind the gear, "motor" if before it.
        compensation: what the arm adds to a torque that it is sent, of q (nq): gravity mostly; or
            None.
        friction: whether the arm compensates the friction of its motors by itself.
        torque: (n) limits of the torque [N m or N].
        torque_rate: (n) largest change of a torque [N m/s or N/s]; infinite for none.
        velocity: (n) limits of the joint velocity [rad/s or m/s].
        silence: time without a torque after which the arm stops by itself [s].
    """

    name: str
    joints: tuple[str, ...]
    period: float
    torque: np.ndarray
    velocity: np.ndarray
    torque_rate: np.ndarray = field(default_factory=lambda: np.array(np.inf))
    paced: bool = True
    clock: str = "arm"
    side: str = "joint"
    compensation: Compensation | None = None
    friction: bool = False
    silence: float = _SILENT

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: a period that is not positive, limits of another number than the joints, or
                an unknown word.
        """
        positive(self.period, "period")
        word(self.side, SIDES, "side")
        word(self.clock, ("arm", "host", "simulated"), "clock")
        n = len(self.joints)
        for name in ("torque", "velocity", "torque_rate"):
            given = np.broadcast_to(np.asarray(getattr(self, name), dtype=float), n).copy()
            if not (given > 0.0).all():
                raise InputError(f"must be positive, got {given.tolist()}.", where=name)
            object.__setattr__(self, name, given)

    @classmethod
    def of(cls, robot: Robot, **given: object) -> ArmFacts:
        """Return the facts of an arm with the joints and limits of a description."""
        model = robot.model
        limits = {"torque": effort_limits(model), "velocity": velocity_limits(model)}
        parts = {"name": robot.name, "joints": tuple(robot.joint_names), **limits, **given}
        return cls(**parts)  # type: ignore[arg-type]


def as_measured(given: Any, sizes: Mapping[str, int], t: float) -> tuple[Measurement, str]:
    """Return a driver's measurement in new arrays, and what is wrong with it, or "".

    Lists and integers are converted. What is wrong becomes NaN, a signal that may be missing None,
    and a time that is none becomes t.

    Args:
        given: anything.
        sizes: of the signals, by name.
        t: expected time [s].
    """
    if not isinstance(given, Measurement):
        words = f"`read` returned {shown(given)}; expected a pinadapt.Measurement"
        n = np.full(sizes["q"], np.nan), np.full(sizes["v"], np.nan)
        return Measurement(t, *n), words
    wrong = ""
    found: dict[str, Any] = {}
    for name, size in sizes.items():
        value, needed = getattr(given, name), name in ("q", "v")
        if value is None and not needed:
            continue
        array = _real_numbers(value)
        if array is None or array.shape != (size,):
            wrong = wrong or f"measurement '{name}': expected {size} numbers, got {shown(value)}"
            array = np.full(size, np.nan) if needed else None
        elif needed and not math.isfinite(array.dot(array)):
            wrong = wrong or f"measurement '{name}' is not finite"
        found[name] = array
    seen_at = given.x_time if found.get("x") is not None else None
    for name, value in (("t", given.t), ("x_time", seen_at)):
        number = _real_numbers(value)
        if number is not None and not number.shape and math.isfinite(number):
            found[name] = float(number)
        elif name == "t" or value is not None:
            wrong = wrong or f"measurement '{name}': expected a time, got {shown(value)}"
    return Measurement(**{"t": t, **found}), wrong


def _real_numbers(value: Any) -> np.ndarray | None:
    """Return real numbers as a new array of floats, or None if they are none."""
    try:
        array = np.asarray(value)
        return array.astype(float) if array.dtype.kind in "fiu" else None
    except Exception:  # whatever an object of a driver does
        return None


class Arm(ABC):
    """An arm that can be measured and sent torques, used in a ``with`` statement.

    The loop calls ``read`` first, then ``begin``, and from then on ``read`` and ``send`` once a
    cycle. In log-only mode it calls ``read`` alone. ``stop`` may be called at any time and more
    than once; leaving the ``with`` statement calls ``close``. One loop at a time may drive it; that
    no other program does is up to the arm.

    Attributes:
        facts: what it declares.
        received: share of the last torques that have reached the arm, updated by ``read``; NaN
            if unknown.
    """

    facts: ArmFacts
    received: float = math.nan

    @abstractmethod
    def read(self) -> Measurement:
        """Return the latest measurement, after waiting for the next cycle if the arm has its own.

        Raises:
            ArmError: the arm is silent, has stopped, or reports an error.
        """

    def begin(self) -> None:  # noqa: B027
        """Take over the control: from now on a torque follows each measurement.

        Raises:
            ArmError: the arm refuses: brakes, an error that must be acknowledged, another program.
        """

    @abstractmethod
    def send(self, torque: np.ndarray) -> None:
        """Send a torque (n) [N m or N], without what the arm adds by itself.

        Raises:
            ArmError: it cannot be sent.
        """

    @abstractmethod
    def stop(self, reason: str) -> None:
        """Let the arm stop in its own safe way, with the brakes where it has any; never raises."""

    def close(self) -> None:  # noqa: B027
        """Give the connection back; never raises."""

    def __enter__(self) -> Arm:
        """Return the arm."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop the arm and close it."""
        self.stop("the program has ended" if error is None else f"{type(error).__name__}: {error}")
        self.close()


PlantSource: TypeAlias = Callable[[], Plant]


class PlantArm(Arm):
    """Any ``Plant`` as an arm in this process.

    Each ``read`` moves the plant on by one period, under the torque that was sent last; before the
    first torque its brakes hold it. With a clock the plant keeps up with that instead: it then
    moves by as many periods as have passed.

    Attributes:
        plant: the plant.
        stopped: why it was stopped, or an empty text.
    """

    def __init__(
        self,
        plant: Plant,
        period: float = 1e-3,
        *,
        sensors: Sensors | None = None,
        robot: Robot | None = None,
        clock: Callable[[], float] | None = None,
        silence: float = _SILENT,
        seed: int = 0,
    ) -> None:
        """Take a plant.

        Args:
            plant: it is reset.
            period: of its cycle [s].
            sensors: through which it is seen; None for perfect ones.
            robot: whose joints it has; None: those of a ``SimulatedPlant``.
            clock: seconds of some clock that the plant follows, such as ``time.monotonic``; None:
                a read is a period.
            silence: time without a torque after which it stops by itself [s].
            seed: of the noise.

        Raises:
            InputError: no plant, or one of unknown joints.
        """
        self.plant = instance(plant, Plant, "plant")
        if robot is None and isinstance(plant, SimulatedPlant):
            robot = plant.robot
        robot = instance(robot, Robot, "robot")
        added = plant.compensation if isinstance(plant, SimulatedPlant) else None
        self.facts = ArmFacts.of(
            robot,
            period=period,
            paced=clock is None,
            clock="simulated" if clock is None else "host",
            compensation=added,
            silence=silence,
        )
        self._sensors = (
            None if sensors is None else SimulatedSensors(robot, period, sensors, seed=seed)
        )
        self._clock = clock
        self._start: float | None = None
        self._sent: np.ndarray | None = None
        self._given: np.ndarray | None = None
        self._count, self._quiet = -1, 0  # the first measurement is of time zero
        self.stopped = ""
        plant.reset()

    def read(self) -> Measurement:
        """Move on to the present and return what the sensors say.

        Raises:
            ArmError: the arm has stopped.
        """
        if self.stopped:
            raise ArmError(f"the arm has stopped: {self.stopped}.", where=self.facts.name)
        for _ in range(self._due()):
            self._count += 1
            if self._sent is None:
                continue
            self._quiet += 1
            if self._quiet * self.facts.period > self.facts.silence:
                self.stop(f"no torque came for {self.facts.silence:g} s")
                raise ArmError(f"the arm has stopped: {self.stopped}.", where=self.facts.name)
            self.plant.step(self._sent.copy(), self.facts.period)
        truth = self.plant.measure()._replace(t=self._count * self.facts.period)
        return truth if self._sensors is None else self._sensors.measure(truth, self._given)

    def _due(self) -> int:
        """Return by how many periods the plant is to move."""
        if self._clock is None:
            return 1
        now = self._clock()
        if self._start is None:
            self._start = now
        return max(int((now - self._start) / self.facts.period + 1e-6) - self._count, 0)

    def send(self, torque: np.ndarray) -> None:
        """Hold a torque (n) [N m or N] from now on.

        Raises:
            InputError: not n finite numbers.
        """
        self._sent = vector(torque, len(self.facts.joints), "torque", fills=False)
        self._given = self.plant.motors(self._sent.copy())
        self._quiet = 0

    def stop(self, reason: str) -> None:
        """Bring the plant to rest by brakes, as a real arm does by itself."""
        if self.stopped:
            return
        self.stopped = reason.rstrip(".") or "stopped"
        plant = self.plant
        if self._sent is None or not isinstance(plant, SimulatedPlant):
            return
        robot, period = plant.robot, self.facts.period
        gravity, data = Gravity(robot), robot.model.createData()
        for _ in range(round(_BRAKING / period)):
            seen = plant.measure()
            if not np.isfinite(seen.v).all() or np.abs(seen.v).max() < _REST:
                break
            added = 0.0 if plant.compensation is None else plant.compensation(seen.q)
            inertia = np.diag(pin.crba(robot.model, data, seen.q))
            plant.step(gravity(seen.q) - added - _BRAKE * inertia * seen.v, period)


class ProcessArm(Arm):
    """A plant that moves in a process of its own, on its own clock, behind a pair of sockets.

    The process sends a measurement each period and applies the latest torque it has got, whether
    the loop is late or not. If no torque comes for a while, or the loop's process has died, it
    brings the plant to rest by its brakes.

    Attributes:
        pid: of the process.
    """

    def __init__(
        self,
        make: PlantSource,
        period: float = 1e-3,
        *,
        sensors: Sensors | None = None,
        core: int | None = None,
        priority: int | None = None,
        silence: float = _SILENT,
        timeout: float = 1.0,
        seed: int = 0,
    ) -> None:
        """Start the process.

        Args:
            make: returns the plant; a ``functools.partial`` of its class, as it is sent to the
                process.
            period: of the plant's cycle [s].
            sensors: through which it is seen; None for perfect ones.
            core: processor core for the process; None for any.
            priority: real-time priority of the process, if the system allows it; None: ordinary.
            silence: time without a torque after which it stops by itself [s].
            timeout: for the next measurement [s].
            seed: of the noise.

        Raises:
            ArmError: the process does not start.
        """
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        options = {"sensors": sensors, "silence": silence, "seed": seed}
        context = get_context("spawn")
        self._process = context.Process(
            target=_serve, args=(there, make, period, options, (core, priority)), daemon=True
        )
        self._process.start()
        there.close()
        self.pid = self._process.pid
        self._socket, self._timeout = here, timeout
        here.settimeout(_STARTING)
        facts, sizes = self._opening()
        self.facts = replace(facts, clock="arm")  # its process keeps the time
        self._layout = _Layout(sizes)
        self._stopped = ""

    def _opening(self) -> tuple[ArmFacts, dict[str, int]]:
        """Return what the process says of its plant."""
        import pickle

        try:
            said = self._socket.recv(1 << 20)
        except (TimeoutError, OSError):
            said = b""
        if not said:
            raise ArmError("the process of the plant has not started.", where="plant", hint=MAIN)
        found = pickle.loads(said)  # of our own child
        if isinstance(found, Exception):
            raise found
        facts, sizes = found
        return facts, sizes

    def read(self) -> Measurement:
        """Wait for the next measurement and return the newest; frames of skipped ones stay.

        Raises:
            ArmError: none comes in time, or the process has ended.
        """
        frame: Measurement | None = None
        self._socket.settimeout(self._timeout)
        try:
            newest = self._taken()
            self._socket.setblocking(False)
            with suppress(BlockingIOError):
                while True:
                    frame = newest if newest.x is not None else frame
                    newest = self._taken()
        except TimeoutError:
            raise ArmError(
                f"no measurement came for {self._timeout:g} s.", where=self.facts.name
            ) from None
        except OSError as error:
            raise ArmError(f"the connection broke: {error}.", where=self.facts.name) from error
        if newest.x is None and frame is not None:
            seen_at = frame.t if frame.x_time is None else frame.x_time
            newest = newest._replace(x=frame.x, x_time=seen_at, xd=frame.xd)
        return newest

    def _taken(self) -> Measurement:
        """Return one measurement from the socket."""
        said = self._socket.recv(1 << 16)
        if not said:
            raise ArmError(
                f"the arm has ended its connection{self._stopped and f': {self._stopped}'}.",
                where=self.facts.name,
                hint="Its process has died or was stopped.",
            )
        return self._layout.unpack(said)

    def send(self, torque: np.ndarray) -> None:
        """Send a torque (n) [N m or N].

        Raises:
            ArmError: the process has ended.
        """
        try:
            self._socket.send(np.asarray(torque, dtype=float).tobytes())
        except BlockingIOError:
            return  # the arm has not taken the last ones yet
        except OSError as error:
            raise ArmError(f"the torque cannot be sent: {error}.", where=self.facts.name) from error

    def stop(self, reason: str) -> None:
        """Tell the process to stop its plant."""
        if not self._stopped:
            self._stopped = reason.rstrip(".") or "stopped"
            with suppress(OSError):
                self._socket.send(b"stop" + self._stopped.encode()[:200])

    def close(self) -> None:
        """End the process."""
        self._socket.close()
        self._process.join(2.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(1.0)


class _Layout:
    """Measurements as bytes: flags, times, then the fields one after the other."""

    def __init__(self, sizes: dict[str, int]) -> None:
        self._sizes = sizes
        self._row = np.zeros(2 + len(_FIELDS) + sum(sizes.values()))
        self._parts, start = {}, 2 + len(_FIELDS)
        for name in _FIELDS:
            self._parts[name] = slice(start, start + sizes[name])
            start += sizes[name]

    @classmethod
    def of(cls, measurement: Measurement) -> dict[str, int]:
        """Return the sizes of the fields of a measurement that has them all."""
        n = measurement.v.size
        x = 0 if measurement.x is None else measurement.x.size
        xd = 0 if measurement.xd is None else measurement.xd.size
        return {"q": measurement.q.size, "v": n, "x": x, "xd": xd, "tau": n}

    def pack(self, measurement: Measurement) -> bytes:
        """Return a measurement as bytes."""
        row = self._row
        row[0] = measurement.t
        row[1] = np.nan if measurement.x_time is None else measurement.x_time
        for k, name in enumerate(_FIELDS):
            value = getattr(measurement, name)
            row[2 + k] = value is not None
            if value is not None:
                row[self._parts[name]] = value
        return row.tobytes()

    def unpack(self, said: bytes) -> Measurement:
        """Return the measurement in bytes; a signal that was not sent is None."""
        row = np.frombuffer(said).copy()
        found = {
            name: row[self._parts[name]] if row[2 + k] else None for k, name in enumerate(_FIELDS)
        }
        seen = row[1]
        x_time = None if np.isnan(seen) else float(seen)
        return Measurement(float(row[0]), x_time=x_time, **found)  # type: ignore[arg-type]


def _serve(
    link: socket.socket,
    make: PlantSource,
    period: float,
    options: dict[str, object],
    place: tuple[int | None, int | None],
) -> None:
    """Move a plant on its own clock until the loop ends, stops it, or goes silent."""
    import gc
    import pickle
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the loop's
    try:
        core, priority = place
        with suppress(OSError, AttributeError):
            if core is not None:
                os.sched_setaffinity(0, {core})
            if priority is not None:
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        plant = make()
        arm = PlantArm(plant, period, **options)  # type: ignore[arg-type]
        layout = _Layout(sizes := _Layout.of(plant.measure()))
        plant.step(np.zeros(plant.nv), period)  # kernels are compiled and touched
        plant.reset()
    except Exception as error:
        link.send(pickle.dumps(error if isinstance(error, InputError) else ArmError(str(error))))
        return
    link.send(pickle.dumps((arm.facts, sizes)))
    gc.freeze()
    gc.disable()
    link.setblocking(False)
    size, due = plant.nv * 8, time.monotonic()
    while not arm.stopped:
        with suppress(ArmError):
            said = layout.pack(arm.read())
            try:
                link.send(said)
            except BlockingIOError:
                pass  # the loop is late; what it does not read is lost
            except OSError:
                arm.stop("the loop has ended")
        due = max(due + period, time.monotonic() - 10.0 * period)
        while (left := due - time.monotonic()) > 0.0:
            time.sleep(left)
        torque = None
        try:
            while True:
                heard = link.recv(1 << 12)
                if not heard:
                    arm.stop("the loop has ended")
                    break
                if heard.startswith(b"stop") and len(heard) != size:
                    arm.stop(heard[4:].decode(errors="replace"))
                    break
                torque = np.frombuffer(heard)
        except BlockingIOError:
            pass
        except OSError:
            arm.stop("the loop has ended")
        if torque is not None and not arm.stopped:
            arm.send(vector(torque, plant.nv, "torque", fills=False))
    link.close()


# A ball at the tool, in the pictures of a camera


class BallCamera:
    """x from the pictures of a ball of one colour at the tool, for the task "image".

    Call it once in each cycle: in the ``read`` of an arm of your own, or as
    ``FrankaArm(camera=...)``. It returns x, the ball's centre in pixels times ``pixel``, with the
    time of the picture; None while there is no new one, and where the ball is not seen whole, see
    ``ball_centre``. The centre of a ball's outline is not the picture of its centre: with a radius
    r at a distance d and an angle a off the camera's axis it is about (r / d)^2 tan(a) focal
    lengths further out, some hundredths of a pixel.

    Attributes:
        seen: number of pictures in which the ball was found.
        unseen: number of the others.
    """

    def __init__(
        self,
        read: Callable[[], tuple[np.ndarray, float] | None],
        hue: tuple[float, float],
        pixel: float,
    ) -> None:
        """Take where pictures come from.

        Args:
            read: returns a new picture (h, w, 3), bytes in the order blue, green, red as OpenCV
                has them, and when it was taken [s], on the clock of the arm; or None. It must not
                wait: let a thread fetch the pictures.
            hue: of the ball, from and to, as of ``ball_centre``.
            pixel: length [m] that a pixel counts as, as of ``Robot.filmed_by``.

        Raises:
            InputError: OpenCV is not installed, or no function, no hues or no length.
        """
        _opencv()
        if not callable(read):
            raise InputError("expected a function that returns a picture.", where="read")
        vector(hue, 2, "hue")
        self._read, self._hue = read, hue
        self._pixel = positive(pixel, "pixel", error=InputError)
        self.seen = self.unseen = 0

    def __call__(self) -> tuple[np.ndarray, float] | None:
        """Return x (2) [m] and time [s] of a new picture, or None.

        Raises:
            InputError: as ``ball_centre``.
        """
        new = self._read()
        if new is None:
            return None
        found = ball_centre(new[0], self._hue)
        if found is None:
            self.unseen += 1
            return None
        self.seen += 1
        return self._pixel * found, new[1]


def ball_centre(
    picture: np.ndarray, hue: tuple[float, float], *, smallest: float = 3.0
) -> np.ndarray | None:
    """Return the centre (2) [pixels] of the largest ball of a colour, or None if it is not whole.

    u counts to the right and v downwards, from the middle of the first pixel. The centre is that of
    the area within the outline, so that reflections on the ball do not matter. A ball that is cut
    by the border of the picture, or hidden so far that it is no longer round, is not seen.

    Args:
        picture: (h, w, 3) bytes, blue, green, red.
        hue: from and to [deg]: red is 0, green 120, blue 240; (340, 20) passes through red.
        smallest: radius of a ball [pixels].

    Raises:
        InputError: OpenCV is not installed, or something else than a picture or an angle.
    """
    cv = _opencv()
    of_bytes = isinstance(picture, np.ndarray) and picture.dtype == np.uint8
    if not of_bytes or picture.ndim != 3 or picture.shape[2] != 3 or not picture.size:
        raise InputError("expected bytes (h, w, 3): blue, green, red.", where="picture")
    low, high = (0.5 * float(each) for each in vector(hue, 2, "hue"))
    if not (0.0 <= low <= 180.0 and 0.0 <= high <= 180.0):
        raise InputError(f"expected angles from 0 to 360 deg, got {hue}.", where="hue")
    colours = cv.cvtColor(np.ascontiguousarray(picture), cv.COLOR_BGR2HSV)
    spans = [(low, high)] if low <= high else [(low, 180.0), (0.0, high)]
    of_ball = np.zeros(picture.shape[:2], dtype=np.uint8)
    for first, last in spans:
        of_ball |= cv.inRange(colours, (first, _SATURATED, _BRIGHT), (last, 255.0, 255.0))
    outlines, _ = cv.findContours(of_ball, cv.RETR_EXTERNAL, cv.CHAIN_APPROX_NONE)
    if not outlines:
        return None
    outline = max(outlines, key=cv.contourArea)
    moments, (_, radius) = cv.moments(outline), cv.minEnclosingCircle(outline)
    u, v, width, height = cv.boundingRect(outline)
    whole = u > 0 and v > 0 and u + width < picture.shape[1] and v + height < picture.shape[0]
    area = moments["m00"]
    if not whole or radius < smallest or area < _ROUND * np.pi * radius**2:
        return None
    return np.array([moments["m10"], moments["m01"]]) / area


def _opencv() -> ModuleType:
    """Return the module cv2, imported at first use."""
    try:
        import cv2
    except ImportError as error:
        raise InputError(
            "OpenCV is not installed.", hint='Install it: pip install "pinadapt[camera]".'
        ) from error
    return cv2
