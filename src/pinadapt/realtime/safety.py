"""The safety checklist: the checks of every cycle, and the response to each finding.

Every way out ends in damped rest: the path is held, then the arm is damped by gravity compensation,
with the disturbance that the law observes, such as that of an unknown load, and -D v, then the
arm's own stop takes over. A finding says at which of the three the loop enters. This is a checklist
of a program that may itself fail. It does not replace the arm's emergency stop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import joint_numbers, numbers, positive
from ..controller.controller import Controller
from ..controller.governor import explained_age
from ..description.chain import effort_limits, position_limits, velocity_limits
from ..exceptions import InputError
from ..models.typical_motion import joint_inertia
from ..records import Measurement
from ..robot.motors import torque_bounds
from ..simulation.loop import STILL
from .arm import ArmFacts
from .recorder import Phase

_DEVIATIONS = 10.0  # of noise that are no contact; at half of it the adaptation rests
_SLOW = 2.0  # [1/s] up to which a disturbance is no contact; 1: as well; 4: 30 N on a UR5 are none
_SETTLED = 0.33  # [s] in which all of it is none; half: a load rests the adaptation; twice: as well
# of the last torques; libfranka's communication_test calls more insufficient; half, twice: the same
_LOST = 0.1

# Words of the checks
_STALE = "the last {value} measurements are of the same instant"
_GAP = "{value:.3g} periods passed between two measurements"
_DROPPED = "{value:.0%} of the last torques have not reached the arm, at most {limit:.0%} may"
_LATE = "too many cycles in a short while were late"
_FAST = "{joint} at {value:.3g} rad/s or m/s, limit {limit:.3g}"
_STOP = "{joint} cannot brake before its limit: {value:.3g} rad or m are missing"
_CONTACT = "{value:.3g} N m or N at {joint} that the model does not explain, limit {limit:.3g}"
_OUTSIDE = "coordinate {coordinate} of the frame is {value:.3g} m outside of its box"
_FAR = "coordinate {coordinate} is {value:.3g} m or rad off, limit {limit:.3g}"
_PUSHING = "{joint} stays at its limit; brakes, or a heavy load?"


@dataclass(frozen=True)
class SafetyFinding:
    """What one check found.

    Attributes:
        check: its name.
        words: what is wrong, with numbers.
        phase: in which the loop goes on: RUNNING, where the adaptation alone rests; HOLDING, where
            the path stops; DAMPING, until the arm rests; STOPPED, by the arm's own stop at once.
    """

    check: str
    words: str
    phase: Phase

    def __str__(self) -> str:
        """Return name and words."""
        return f"{self.check}: {self.words}"


@dataclass(frozen=True, eq=False)
class Safety:
    """The numbers of the checklist; the defaults come from the description of the arm.

    Attributes:
        torque_rate: largest change of a sent torque [N m/s or N/s], one number or one per joint;
            the arm's own limit holds besides.
        velocity: share of the velocity limits at which the arm is damped.
        margin: to a joint's stop that the arm must not enter, with its braking distance [rad or m].
        box: (2, k) corners between which the task position must stay [m], or None.
        error: largest task error of positions [m]; None: a tenth of the reach.
        angle: largest error of rotations and of turning joints [rad].
        saturated: longest time at a torque limit [s].
        contact: unexplained torque, as a share of the effort limits, at which the arm is damped, or
            ten deviations of what the declared noise makes of it, if that is more; at half of it
            the adaptation rests.
        camera: longest time without a frame beyond what the declared camera explains [s].
        stale: cycles with the same measurement after which the arm is damped.
        late: cycles that may be late in a short while, by the arm's clock or by this computer's;
            fifty on time make up for one.
        damping: rate at which a damped arm loses its speed [1/s].

    Raises:
        InputError: a number that is not positive, or a box that is none.
    """

    torque_rate: ArrayLike = 1000.0
    velocity: float = 0.9
    margin: float = 0.02
    box: ArrayLike | None = None
    error: float | None = None
    angle: float = 0.5
    saturated: float = 0.3
    contact: float = 0.1
    camera: float = 0.5
    stale: int = 5
    late: int = 10
    damping: float = 30.0

    def __post_init__(self) -> None:
        """Refuse numbers that make no checklist."""
        for part in fields(self):
            value = getattr(self, part.name)
            if part.name not in ("torque_rate", "box") and value is not None:
                positive(value, f"safety.{part.name}")
        joint_numbers(self.torque_rate, "safety.torque_rate", zero=False, infinite=True)
        if self.box is not None:
            box = numbers(self.box, "safety.box")
            if box.ndim != 2 or len(box) != 2 or not (box[0] < box[1]).all():
                raise InputError(
                    f"expected lower and upper corner, got {box.tolist()}.", where="safety.box"
                )


class Checklist:
    """The checks of one run, with their state.

    Attributes:
        limit: (n) torques that are sent at most [N m or N].
        rate: (n) by which they change at most [N m/s or N/s].
        latched: why the operator's latch is set, or an empty text; nothing in the program opens it.
        residual: (n) torque that the model does not explain [N m or N], if it is watched.
    """

    def __init__(self, safety: Safety, controller: Controller, facts: ArmFacts) -> None:
        """Take the numbers, a controller with a model of the arm, and the arm's facts.

        Raises:
            InputError: a box for another number of coordinates.
        """
        robot = controller.kinematics.robot
        self._task = controller.kinematics.task
        model = robot.model
        n = model.nv
        self._safety = safety
        self._period = facts.period
        self._joints = robot.joint_names
        declared = torque_bounds(controller.limits.torque, n)
        self.limit = np.minimum.reduce([facts.torque, effort_limits(model), declared])
        rate = joint_numbers(safety.torque_rate, "safety.torque_rate", n, infinite=True)
        self.rate = np.minimum(rate, facts.torque_rate)
        self._fast = safety.velocity * np.minimum(facts.velocity, velocity_limits(model))
        lower, upper = position_limits(model)
        self._places = model.idx_qs.tolist()[1:]
        self._lower = lower + safety.margin
        self._upper = upper - safety.margin
        self._braked = joint_inertia(robot) / self.limit
        k = self._task.positions
        self._box = None if safety.box is None else numbers(safety.box, "safety.box")
        if self._box is not None and self._box.shape[1] != k:
            raise InputError(
                f"has {self._box.shape[1]} coordinates; the task has {k}.", where="safety.box"
            )
        length = 0.1 * robot.reach if safety.error is None else safety.error
        self._far = self._task.per_row(length, safety.angle)
        self._blind = explained_age(controller.sensors) + safety.camera if k else math.inf
        noise = controller.disturbance_noise(robot.q0, facts.period)
        least = 0.0 if noise is None else _DEVIATIONS * noise
        self._contact = np.maximum(safety.contact * self.limit, least)
        self.residual = np.zeros(n)
        self.latched = ""
        self._same = 0
        self._late = 0.0
        self._before = -math.inf
        self._pushing = 0.0  # [s] at a limit
        self.announced()

    def announced(self) -> None:
        """Take what is unexplained from now on for a part of the model: a load was attached."""
        self._mean = np.zeros(self.limit.size)
        self._time = 0.0

    def of_arm(
        self, m: Measurement, dt: float, host: float = 0.0, received: float = math.nan
    ) -> SafetyFinding | None:
        """Return the first finding of what is checked whenever torques are sent.

        Args:
            m: the measurement.
            dt: since the one before, by its time [s].
            host: the same by this computer's clock [s]; 0 where the arm does not follow it.
            received: share of the last torques that the arm has received; NaN: not known.
        """
        safety = self._safety
        speed = np.abs(m.v)
        periods = max(dt, host) / self._period
        self._same = self._same + 1 if m.t == self._before else 0
        self._before = m.t
        self._late = max(self._late + (1.0 if periods > 1.5 else -0.02), 0.0)
        way = np.maximum(1.5 / safety.damping * speed, self._braked * speed**2)
        q = m.q[self._places]  # or a cosine, without limits
        room = np.where(m.v > 0.0, self._upper - q, q - self._lower)
        missing = np.where(speed > STILL, way - room, 0.0)
        if self.latched:
            return SafetyFinding("latch", self.latched, Phase.DAMPING)
        return self._first(
            ("stale data", Phase.DAMPING, self._same + 1, safety.stale, _STALE),
            ("clock", Phase.DAMPING, -dt, 0.0, "the time jumped back by {value:.3g} s"),
            ("late", Phase.DAMPING, periods, 10.0, _GAP),
            ("velocity", Phase.DAMPING, speed, self._fast, _FAST),
            ("joint stop", Phase.DAMPING, missing, 0.0, _STOP),
            ("late", Phase.HOLDING, self._late >= safety.late, False, _LATE),
            ("commands", Phase.HOLDING, 1.0 - received, _LOST, _DROPPED),
        )

    def of_motion(
        self,
        dt: float,
        x: np.ndarray,
        dx: np.ndarray,
        frame_age: float,
        torque: np.ndarray,
        disturbance: np.ndarray | None,
    ) -> SafetyFinding | None:
        """Return the first finding of what is checked besides while a controller moves the arm.

        A contact is sudden; the disturbance by a wrong model, or by a load that is being learned,
        changes with the motion. So its slow part is no contact.

        Args:
            dt: since the sample before [s].
            x: estimated position of the task frame now.
            dx: (m) task error.
            frame_age: of the latest frame [s].
            torque: (n) that the motors are to give now [N m or N].
            disturbance: (n) that the law observes [N m or N], or None.
        """
        if disturbance is not None:
            self._time += dt
            slow = 1.0 if self._time < _SETTLED else -math.expm1(-_SLOW * dt)
            self._mean = self._mean + slow * (disturbance - self._mean)
            self.residual = disturbance - self._mean
        full = np.abs(torque) > 0.999 * self.limit
        self._pushing = self._pushing + dt if full.any() else 0.0
        pushing = full & (self._pushing >= self._safety.saturated)
        residual = np.abs(self.residual)
        outside: Any = False
        if self._box is not None:
            p = self._task.position(x)
            outside = np.maximum(self._box[0] - p, p - self._box[1])
        return self._first(
            ("contact", Phase.DAMPING, residual, self._contact, _CONTACT),
            ("workspace", Phase.DAMPING, outside, False, _OUTSIDE),
            ("error", Phase.DAMPING, np.abs(dx), self._far, _FAR),
            ("torque", Phase.HOLDING, pushing, False, _PUSHING),
            ("camera", Phase.HOLDING, frame_age, self._blind, "no frame for {value:.2g} s"),
            ("contact", Phase.RUNNING, residual, 0.5 * self._contact, _CONTACT),
        )

    def _first(self, *checks: tuple[str, Phase, Any, Any, str]) -> SafetyFinding | None:
        """Return the first finding: of a check whose value, or one of them, is beyond its limit.

        Args:
            checks: name, phase, value or values, limit or limits, and words with ``value`` and
                ``limit``, the ``joint``, or the number of the ``coordinate``.
        """
        for check, phase, value, limit, words in checks:
            beyond = value > limit
            if beyond if beyond.__class__ is bool else beyond.any():
                k = int(np.argmax(beyond))
                text = words.format(
                    value=np.ravel(value)[k],
                    limit=np.broadcast_to(limit, np.size(beyond))[k],
                    joint=self._joints[min(k, len(self._joints) - 1)],
                    coordinate=k + 1,
                )
                return SafetyFinding(check, text, phase)
        return None

    @property
    def unexplained(self) -> np.ndarray:
        """The torque (n) [N m or N] to add to the model's against the mean residual.

        At most half of the limits.
        """
        return np.clip(-self._mean, -0.5 * self.limit, 0.5 * self.limit)


@np.errstate(over="ignore", invalid="ignore")  # a limit beyond the largest float is none
def limited_torque(
    torque: np.ndarray, limit: np.ndarray, before: np.ndarray, change: np.ndarray
) -> np.ndarray:
    """Return a torque within its limits and, inside them, within a change of the last; all (n).

    NaN becomes 0, and a last torque that is NaN limits no change.
    """
    x = np.where(np.isnan(torque), 0.0, torque)
    last = np.where(np.isnan(before), x, np.clip(before, -limit, limit))
    near = np.fmin(np.fmax(x, last - change), last + change)  # NaN, of two infinities, is no bound
    return np.clip(near, -limit, limit)
