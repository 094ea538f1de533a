"""What the library needs of an arm, and any ``Plant`` as one: here, or in a process of its own."""

from __future__ import annotations

import gc
import signal
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from .._checks import instance, joint_numbers, positive, take_checked, word
from ..description.chain import effort_limits, velocity_limits
from ..exceptions import ArmError, InputError
from ..plants.plant import Plant
from ..plants.sensors import SimulatedSensors
from ..records import Measurement, Sensors
from ..robot.motors import Compensation
from ..robot.robot import Robot
from .processes import MAIN, ORDINARY, Scheduling, end_process, start_process


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
        compensation: what the arm adds to a torque that it is sent, of q (nq): gravity mostly; or
            None.
        torque: (n) limits of the torque [N m or N].
        torque_rate: (n) largest change of a torque [N m/s or N/s]; infinite for none.
        velocity: (n) limits of the joint velocity [rad/s or m/s].
    """

    name: str
    joints: tuple[str, ...]
    period: float
    torque: np.ndarray
    velocity: np.ndarray
    torque_rate: np.ndarray = np.inf  # type: ignore[assignment]
    paced: bool = True
    clock: str = "arm"
    compensation: Compensation | None = None

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: a period that is not positive, limits of another number than the joints, or
                an unknown word.
        """
        positive(self.period, "period")
        word(self.clock, ("arm", "host", "simulated"), "clock")
        limits = "torque", "velocity", "torque_rate"
        n = len(self.joints)
        take_checked(self, joint_numbers, "", *limits, size=n, zero=False, infinite=True)

    @classmethod
    def of(cls, robot: Robot, **given: Any) -> ArmFacts:
        """Return the facts of an arm with the joints and limits of a description."""
        described: dict[str, Any] = {
            "name": robot.name,
            "joints": tuple(robot.joint_names),
            "torque": effort_limits(robot.model),
            "velocity": velocity_limits(robot.model),
        }
        return cls(**described | given)


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
        stopped: why it was stopped, or an empty text.
    """

    facts: ArmFacts
    received: float = np.nan
    stopped: str = ""

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

    def _runs(self) -> None:
        """Refuse to go on after a stop.

        Raises:
            ArmError: the arm has stopped.
        """
        if self.stopped:
            raise ArmError(f"has stopped: {self.stopped}.", where=self.facts.name)

    def _ends(self, reason: str) -> bool:
        """Keep the first reason of a stop; return whether it is this one."""
        first = not self.stopped
        self.stopped = self.stopped or reason.rstrip(".") or "stopped"
        return first

    def __enter__(self) -> Arm:
        """Return the arm."""
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Stop the arm and close it."""
        self.stop("the program has ended" if error is None else f"{type(error).__name__}: {error}")
        self.close()


class PlantArm(Arm):
    """Any ``Plant`` as an arm in this process.

    Each ``read`` moves the plant on by one period, under the torque that was sent last; before the
    first torque it rests.

    Attributes:
        plant: the plant.
    """

    def __init__(
        self,
        plant: Plant,
        period: float = 1e-3,
        *,
        sensors: Sensors | None = None,
    ) -> None:
        """Take a plant.

        Args:
            plant: it is reset; it has a ``robot``, as a ``SimulatedPlant``.
            period: of its cycle [s].
            sensors: through which it is seen; None for perfect ones.

        Raises:
            InputError: no plant, or one without a robot.
        """
        self.plant = instance(plant, Plant, "plant")
        robot = instance(getattr(plant, "robot", None), Robot, "plant.robot")
        self.facts = ArmFacts.of(
            robot,
            period=period,
            clock="simulated",
            compensation=getattr(plant, "compensation", None),
        )
        self._sensors = None if sensors is None else SimulatedSensors(robot, period, sensors)
        self._sent: np.ndarray | None = None
        self._count = -1  # the first measurement is of time zero
        plant.reset()

    def read(self) -> Measurement:
        """Move on by a period and return what the sensors say.

        Raises:
            ArmError: the arm has stopped.
        """
        self._runs()
        self._count += 1
        given = None
        if self._sent is not None:
            given = self.plant.motors(self._sent.copy())
            self.plant.step(self._sent.copy(), self.facts.period)
        truth = self.plant.measure()._replace(t=self._count * self.facts.period)
        return truth if self._sensors is None else self._sensors.measure(truth, given)

    def send(self, torque: np.ndarray) -> None:
        """Hold a torque (n) [N m or N] from now on."""
        self._sent = np.array(torque, dtype=float)

    def stop(self, reason: str) -> None:
        """Stop: nothing moves or is measured any more."""
        self._ends(reason)


class ProcessArm(Arm):
    """A plant that moves in a process of its own, on its own clock, behind a pipe.

    The process sends a measurement each period and applies the latest torque it has got, whether
    the loop is late or not. It ends with the loop's process.

    Attributes:
        pid: of the process.
    """

    def __init__(
        self,
        make: Callable[[], Plant],
        period: float = 1e-3,
        *,
        sensors: Sensors | None = None,
        scheduling: Scheduling = ORDINARY,
        timeout: float = 1.0,
    ) -> None:
        """Start the process.

        Args:
            make: returns the plant; a ``functools.partial`` of its class, as it is sent to the
                process.
            period: of the plant's cycle [s].
            sensors: through which it is seen; None for perfect ones.
            scheduling: of the process, as far as the system allows it.
            timeout: for the next measurement [s].

        Raises:
            ArmError: the process does not start.
        """
        failure = ArmError("the process of the plant has not started.", where="plant", hint=MAIN)
        self._process, self._link, facts = start_process(
            _serve, failure, make, period, sensors, scheduling
        )
        self.pid = self._process.pid
        self._timeout = timeout
        self.facts = replace(facts, clock="arm")  # its process keeps the time

    def read(self) -> Measurement:
        """Wait for the next measurement and return the newest.

        Raises:
            ArmError: none comes in time, or the process has ended.
        """
        name = self.facts.name
        try:
            if not self._link.poll(self._timeout):
                raise ArmError(f"no measurement came for {self._timeout:g} s.", where=name)
            newest = self._link.recv()
            while self._link.poll():
                newest = self._link.recv()
        except (OSError, EOFError) as error:
            raise ArmError(
                f"the arm has ended its connection{self.stopped and f': {self.stopped}'}.",
                where=name,
                hint="Its process has died or was stopped.",
            ) from error
        return newest

    def send(self, torque: np.ndarray) -> None:
        """Send a torque (n) [N m or N]."""
        with suppress(OSError):  # the process has ended, which ``read`` notices
            self._link.send(np.asarray(torque, dtype=float))

    def stop(self, reason: str) -> None:
        """Tell the process to stop its plant."""
        if self._ends(reason):
            with suppress(OSError):
                self._link.send(self.stopped)

    def close(self) -> None:
        """End the process."""
        end_process(self._process, self._link)


def _serve(
    link: Connection,
    make: Callable[[], Plant],
    period: float,
    sensors: Sensors | None,
    scheduling: Scheduling,
) -> None:
    """Move a plant on its own clock until the loop stops it or ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the loop's
    try:
        plant = make()
        arm = PlantArm(plant, period, sensors=sensors)
        plant.step(np.zeros(plant.nv), period)  # kernels are compiled and touched
        plant.reset()
    except Exception as error:
        link.send(error if isinstance(error, InputError) else ArmError(str(error)))
        return
    link.send(arm.facts)
    gc.freeze()
    gc.disable()
    due = time.monotonic()
    # until it has stopped, or the loop has ended
    with scheduling.applied(), suppress(ArmError, OSError, EOFError):
        while True:
            link.send(arm.read())
            due = max(due + period, time.monotonic() - 10.0 * period)
            time.sleep(max(due - time.monotonic(), 0.0))
            while link.poll():
                said = link.recv()
                arm.stop(said) if isinstance(said, str) else arm.send(said)
    arm.stop("the loop has ended")
    link.close()
