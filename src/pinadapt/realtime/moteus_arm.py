"""An arm of moteus motors on a CAN-FD bus, by ``moteus`` and ``python-can`` (extra ``moteus``).

The vendor's client makes the commands and reads the replies, python-can carries them. A cycle asks
every motor for position, velocity and torque, and sends a torque to each: position mode without
stiffness and damping, with the watchdog of the motors set, so that they brake by themselves if the
program dies. Arms of other motors need a file like this one.

With the sign s, the ratio r (turns that the motor counts in one of the joint), the offset and the
scale k (torque in N m for one that the motor reports),

    q = s 2 pi p / r + offset,        tau = s k r tau_motor.

This was run on python-can's virtual bus with simulated motors, and on no real one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._checks import instance, optional, positive, take_checked, vector, whole
from ..exceptions import ArmError, InputError
from ..records import Measurement
from ..robot.robot import Robot
from .arm import Arm, ArmFacts

# cycles without a reply after which a motor is lost; one: a single lost message ends a run
_MISSED = 3  # twice: the others move on for twice as long
_NOTHING = b"\x50"  # a command that does nothing, as padding


@dataclass(frozen=True)
class Motor:
    """A motor of a joint.

    Attributes:
        joint: name of the joint.
        id: on the bus, 1 to 126.
        sign: 1, or -1 if it turns against the joint.
        ratio: turns that the motor counts in one turn of the joint; 1 if it counts those behind the
            gear.
        offset: angle of the joint where the motor counts zero [rad].
        torque: true torque over the one that the motor reports.

    Raises:
        InputError: numbers that no motor has.
    """

    joint: str
    id: int
    sign: int = 1
    ratio: float = 1.0
    offset: float = 0.0
    torque: float = 1.0

    def __post_init__(self) -> None:
        """Refuse numbers that no motor has."""
        whole(self.id, "motor.id", 1, most=126)
        if self.sign not in (1, -1):
            raise InputError(f"must be 1 or -1, got {self.sign!r}.", where="motor.sign")
        vector([self.offset], 1, "motor.offset")
        take_checked(self, positive, "motor.", "ratio", "torque")


class MoteusArm(Arm):
    """An arm of moteus motors.

    Attributes:
        motors: in the order of the joints.
    """

    def __init__(
        self,
        robot: Robot,
        motors: Sequence[Motor],
        *,
        interface: str = "socketcan",
        channel: str = "can0",
        period: float = 2e-3,
        timeout: float = 1e-2,
        silence: float = 0.1,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open the bus; nothing moves.

        Args:
            robot: the description, whose joints the motors move.
            motors: one for each joint.
            interface: of python-can, such as "socketcan" or "virtual".
            channel: of the interface.
            period: of the loop [s].
            timeout: for the replies of a cycle [s].
            silence: time without a torque after which the motors stop by themselves [s].
            clock: of the measurements.

        Raises:
            InputError: a package is missing, the bus cannot be opened, or the motors are not those
                of the joints.
        """
        can, moteus = (optional(name, "moteus", "moteus") for name in ("can", "moteus"))
        names = instance(robot, Robot, "robot").joint_names
        of = [motor.joint for motor in motors]
        if sorted(of) != sorted(names) or len({motor.id for motor in motors}) < len(names):
            raise InputError(
                f"expected a motor with an id of its own for each of the joints {names}, got {of}.",
                where="motors",
            )
        self.motors = [motors[of.index(name)] for name in names]
        self._can = can
        self._moteus = moteus
        self._clock = clock
        self._timeout = positive(timeout, "timeout")
        self._silence = positive(silence, "silence")
        self.facts = ArmFacts.of(
            robot,
            name=f"motors at {channel}",
            period=period,
            paced=False,
            clock="host",
        )
        rows = [(one.sign, one.ratio, one.offset, one.torque) for one in self.motors]
        signs, ratios, self._offset, scales = np.array(rows).T
        self._angle = signs * 2.0 * math.pi / ratios
        self._torque = signs * ratios * scales
        self._places = {motor.id: k for k, motor in enumerate(self.motors)}
        self._nodes = [moteus.Controller(motor.id) for motor in self.motors]
        self._queries = [self._message(node.make_query()) for node in self._nodes]
        self._raw = np.zeros((3, len(names)))
        self._missed = np.full(len(names), _MISSED)
        try:
            self._bus = can.Bus(interface=interface, channel=channel, fd=True)
        except (can.CanError, OSError, ValueError, NotImplementedError) as error:
            raise InputError(
                f"the bus cannot be opened: {error}.",
                where=f"{interface}:{channel}",
                hint="Is the interface up? `ip link set can0 up type can bitrate 1000000 dbitrate "
                "5000000 fd on`",
            ) from error

    def _message(self, command: Any) -> Any:
        """Return the message of a command: destination and reply bit are in its id."""
        size = self._can.util.dlc2len(self._can.util.len2dlc(len(command.data)))
        return self._can.Message(
            arbitration_id=command.destination | (0x8000 if command.reply_required else 0),
            is_extended_id=command.reply_required,
            data=command.data.ljust(size, _NOTHING),
            is_fd=True,
            bitrate_switch=True,
        )

    def _ask(self) -> np.ndarray:
        """Ask all motors and take their replies; return which (n) answered in time.

        Raises:
            ArmError: a motor reports a fault, or has stopped by its watchdog, or the bus failed.
        """
        register = self._moteus.Register
        modes = self._moteus.Mode
        asked = register.POSITION, register.VELOCITY, register.TORQUE
        answered = np.zeros(len(self._nodes), dtype=bool)
        try:
            while self._bus.recv(0.0) is not None:
                pass  # late replies of an earlier cycle
            for query in self._queries:
                self._bus.send(query)
            until = time.monotonic() + self._timeout
            while not answered.all() and (left := until - time.monotonic()) > 0.0:
                message = self._bus.recv(left)
                number = 0 if message is None else message.arbitration_id
                k = self._places.get(number >> 8 & 0x7F)
                if k is None or number & 0x7F:
                    continue
                values = self._moteus.parse_registers(bytes(message.data)).response
                if values.get(register.MODE) in (modes.FAULT, modes.TIMEOUT):
                    raise ArmError(
                        f"the motor of {self.motors[k].joint} has fault "
                        f"{values.get(register.FAULT, 0)}, or was stopped by its watchdog.",
                        where=self.facts.name,
                        hint="Faults are listed in moteus' reference; a stop command ends them.",
                    )
                self._raw[:, k] = [values[each] for each in asked]
                answered[k] = True
        except self._can.CanError as error:
            raise ArmError(f"the bus failed: {error}.", where=self.facts.name) from error
        return answered

    def read(self) -> Measurement:
        """Ask all motors and return what they say; one that misses a cycle keeps its last values.

        Raises:
            ArmError: a motor has a fault or has missed three cycles, or the bus failed.
        """
        self._runs()
        self._missed = np.where(self._ask(), 0, self._missed + 1)
        if (self._missed >= _MISSED).any():
            lost = self.motors[self._missed.argmax()].joint
            raise ArmError(
                f"the motor of {lost} has not answered for {_MISSED} cycles.",
                where=self.facts.name,
                hint="Is it powered, and its id that of the table? Raise `timeout` if the bus is "
                "slow.",
            )
        position, velocity, torque = self._raw
        return Measurement(
            self._clock(),
            self._angle * position + self._offset,
            self._angle * velocity,
            tau=self._torque * torque,
        )

    def send(self, torque: np.ndarray) -> None:
        """Send a torque (n) of the joints [N m].

        Raises:
            ArmError: the bus failed.
            InputError: not n finite numbers.
        """
        given = vector(torque, len(self.motors), "torque", fills=False) / self._torque
        try:
            for node, each in zip(self._nodes, given.tolist(), strict=True):
                command = node.make_position(
                    position=math.nan,
                    velocity=0.0,
                    feedforward_torque=each,
                    kp_scale=0.0,
                    kd_scale=0.0,
                    watchdog_timeout=self._silence,
                )
                self._bus.send(self._message(command))
        except self._can.CanError as error:
            raise ArmError(f"the bus failed: {error}.", where=self.facts.name) from error

    def stop(self, reason: str) -> None:
        """Let the motors brake, their windings shorted; an arm without brakes sinks slowly."""
        if self._ends(reason):
            for node in self._nodes:
                with suppress(self._can.CanError, OSError, ValueError):
                    self._bus.send(self._message(node.make_brake()))

    def close(self) -> None:
        """Close the bus."""
        self._bus.shutdown()
