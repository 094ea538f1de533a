"""Motors: limits, delay, bandwidth, elastic gears, gravity torque that some arms add."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from .._checks import joint_numbers, kept_numbers, take_checked, vector, word
from ..description.chain import effort_limits
from ..exceptions import GainError, InputError
from .robot import Robot

Compensation: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""Function of a configuration q (nq): torque (nv) [N m or N] that the arm adds to the command."""

NOMINAL = "nominal"
ENCODERS = ("motor", "link")


class JointActuators(NamedTuple):
    """``Actuators`` of n joints in numbers.

    Attributes:
        delay: (n) [s].
        bandwidth: (n) [rad/s], infinite where a torque rises at once.
        stiffness: (n) [N m/rad or N/m], infinite if the joints are rigid.
        damping: (n) [N m s/rad or N s/m].
    """

    delay: np.ndarray
    bandwidth: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray


@dataclass(frozen=True)
class Actuators:
    """How a commanded torque comes to the links: after a delay, through a low pass, over springs.

    ``pa.Limits(actuators=...)`` declares the actuators to a controller, which takes gains that they
    can follow; ``pa.Engine(actuators=...)``, or ``engine=`` of ``simulate`` itself, gives them to
    the simulated robot. The default is ideal.

    Attributes:
        delay: from a command until the motors have it [s], one number or one per joint (n).
        bandwidth: of the torque's first-order low pass behind the delay [rad/s], one number or one
            per joint (n); infinite: the torque is there at once.
        stiffness: K of the springs between motors (after their gears) and links [N m/rad or N/m],
            one number or one per joint (n); infinite for rigid joints, all or none of them.
        damping: D of the springs, one number or one per joint (n) [N m s/rad or N s/m].
        encoders: what q and qd are measured at where there are springs: "motor" (after the gear)
            or "link".

    Raises:
        InputError: a negative delay or damping, a bandwidth or stiffness that is not positive, NaN,
            no numbers, or another word for ``encoders``.
    """

    delay: ArrayLike = 0.0
    bandwidth: ArrayLike = np.inf
    stiffness: ArrayLike = np.inf
    damping: ArrayLike = 0.0
    encoders: str = "motor"

    sources = ("Spong1987",)

    def __post_init__(self) -> None:
        """Check the actuators, and keep numbers or tuples of them."""
        take_checked(self, kept_numbers, "actuators.", "delay", "damping")
        take_checked(
            self, kept_numbers, "actuators.", "bandwidth", "stiffness", zero=False, infinite=True
        )
        if self.elastic and np.isinf(self.stiffness).any():
            raise InputError(
                f"expected springs at all joints or at none, got {self.stiffness}.",
                where="actuators.stiffness",
                hint="Give a rigid joint a stiffness far above that of the others.",
            )
        word(self.encoders, ENCODERS, "actuators.encoders")

    @property
    def late(self) -> bool:
        """Whether a torque comes later than it is commanded."""
        return bool(np.any(self.delay) or np.isfinite(self.bandwidth).any())

    @property
    def elastic(self) -> bool:
        """Whether there are springs."""
        return bool(np.isfinite(self.stiffness).any())

    @property
    def ideal(self) -> bool:
        """Whether each torque is at the links at once."""
        return not (self.late or self.elastic)

    @property
    def words(self) -> str:
        """What is not ideal, in words."""
        parts = []
        if np.any(self.delay):
            parts.append(f"motors that are {1e3 * float(np.max(self.delay)):.3g} ms late")
        if np.isfinite(self.bandwidth).any():
            parts.append(f"motors of {np.min(self.bandwidth):.3g} rad/s")
        if self.elastic:
            behind = " with encoders at the links" if self.encoders == "link" else ""
            parts.append(f"joints of {np.min(self.stiffness):.3g} N m/rad{behind}")
        return " and ".join(parts)

    def of(self, robot: Robot) -> JointActuators:
        """Return the actuators of a robot's n joints.

        Raises:
            InputError: numbers for another number of joints.
        """
        return JointActuators(
            *(
                joint_numbers(
                    getattr(self, name), f"actuators.{name}", robot.model.nv, infinite=True
                )
                for name in JointActuators._fields
            )
        )


class CommandsUnderway(NamedTuple):
    """What late motors have in hand; n joints.

    Attributes:
        t: time since the first command [s].
        coming: commands that have not arrived, in their order: when they do [s], at which joints
            (n), and the command (n).
        arrived: (n) what has, [N m or N].
        applied: (n) output of the low pass [N m or N].
    """

    t: float
    coming: tuple[tuple[float, np.ndarray, np.ndarray], ...]
    arrived: np.ndarray
    applied: np.ndarray


class LateTorque:
    """What motors apply that follow their commands late: after a delay, through a low pass.

    The first command counts from before the start: until another one has arrived, it is applied.
    The low pass is exact: within each piece of time the mean of its output is held.
    """

    def __init__(self, joints: JointActuators) -> None:
        """Take the delays and bandwidths of n joints."""
        delays = np.unique(joints.delay).tolist()
        self._delayed = [(delay, joints.delay == delay) for delay in delays]
        self._bandwidth = joints.bandwidth
        self._smooth = np.isfinite(joints.bandwidth).any()

    def after(
        self,
        before: CommandsUnderway | None,
        command: np.ndarray,
        dt: float,
        longest: float = math.inf,
    ) -> tuple[list[tuple[np.ndarray, float]], CommandsUnderway]:
        """Return the torques (n) applied over the next dt [s], for how long [s], and what is left.

        Args:
            before: what was left by the last command; None: this one is the first.
            command: (n) [N m or N].
            dt: until the next command [s].
            longest: time for which a torque is held where there is a low pass [s].
        """
        if before is None:
            before = CommandsUnderway(0.0, (), command, command)
        t = before.t
        arrived = before.arrived.copy()
        applied = before.applied
        least = 1e-6 * dt  # rounding
        pieces = []
        sent = [(t + delay, joints, command) for delay, joints in self._delayed]
        coming = sorted([*before.coming, *sent], key=lambda each: each[0])
        end = t + dt
        while t < end - least:
            while coming and coming[0][0] <= t + least:
                _, joints, arriving = coming.pop(0)
                arrived[joints] = arriving[joints]
            stop = min(end, coming[0][0]) if coming else end
            stop = end if stop > end - least else stop
            if self._smooth:
                stop = min(stop, t + longest)
            z = self._bandwidth * (stop - t)
            off = applied - arrived
            applied = arrived + np.exp(-z) * off
            pieces.append((arrived - np.expm1(-z) / z * off, stop - t))
            t = stop
        return pieces, CommandsUnderway(t, tuple(coming), arrived, applied)

    def mean(
        self, before: CommandsUnderway | None, command: np.ndarray, dt: float
    ) -> tuple[np.ndarray, CommandsUnderway]:
        """Return the mean torque (n) over the next dt [s], and what is left; see ``after``."""
        pieces, left = self.after(before, command, dt)
        return np.asarray(sum(h * torque for torque, h in pieces)) / dt, left


def torque_limits(
    robot: Robot, limits: ArrayLike | bool | None, where: str = "limits.torque"
) -> np.ndarray | None:
    """Return torque limits (nv) [N m or N], or None if no joint has one.

    Args:
        robot: read only.
        limits: a number or (nv) [N m or N]; True for the effort limits of the description; False or
            None for no limits.
        where: their name, for messages.

    Raises:
        GainError: wrong size, or limits that are not positive.
    """
    if limits is None or limits is False:
        return None
    bounds = joint_numbers(
        effort_limits(robot.model) if limits is True else limits,
        where,
        robot.model.nv,
        zero=False,
        infinite=True,
        error=GainError,
    )
    return bounds if np.isfinite(bounds).any() else None


def torque_bounds(limits: np.ndarray | None, size: int) -> np.ndarray:
    """Return torque limits (n), those of ``size`` joints without limits where there are none."""
    return np.full(size, np.inf) if limits is None else limits


def overloaded(robot: Robot, limits: np.ndarray, words: str = "the true robot") -> str | None:
    """Return a message if the motors cannot hold a robot at its home pose against gravity, or None.

    Args:
        robot: with its load.
        limits: (nv) torque limits of the motors [N m or N].
        words: which robot it is.
    """
    weight = np.abs(Gravity(robot)(robot.q0))
    short = [
        f"{name} ({tau:.3g} of {limit:.3g} {'N' if slide else 'N m'})"
        for (name, slide), tau, limit in zip(robot.slides.items(), weight, limits, strict=True)
        if tau > limit
    ]
    if not short:
        return None
    return (
        f"the motors cannot hold {words} at its home pose: {', '.join(short)}. Choose a lighter "
        "load or another home pose."
    )


class Gravity:
    """g(q) of a robot: the torque (nv) [N m or N] that holds it at rest at a configuration (nq)."""

    def __init__(self, robot: Robot) -> None:
        """Take the nominal robot, without unknown loads or tools."""
        self._robot = robot
        self._data = robot.model.createData()

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """Return g(q) (nv) at a configuration q (nq)."""
        return np.array(pin.computeGeneralizedGravity(self._robot.model, self._data, q))

    def __reduce__(self) -> tuple[type[Gravity], tuple[Robot]]:
        """Pickle the robot only."""
        return Gravity, (self._robot.undrawn(),)


def compensation_of(robot: Robot, given: Compensation | str | None) -> Compensation | None:
    """Return the compensation that an arm adds to the torque command, or None for none.

    Args:
        robot: the nominal robot.
        given: a function of q (nq), "nominal" for the gravity torque of ``robot``, or None.

    Raises:
        InputError: another word, not callable, or a function that does not return nv finite numbers
            at the home pose.
    """
    if given is None:
        return None
    if given == NOMINAL:
        return Gravity(robot)
    if callable(given):
        vector(given(robot.q0.copy()), robot.model.nv, "compensated", fills=False)
        return given
    raise InputError(f"expected '{NOMINAL}' or a function, got {given!r}.", where="compensated")
