"""Limits of a controller: torques, the inverse Jacobian, estimates, translations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .._checks import flag, instance, joint_numbers, mapping, numbers, positive, vector, word
from ..exceptions import GainError, ParameterError
from ..laws.law import Law
from ..models.dynamics import Dynamics
from ..models.task_kinematics import TaskKinematics
from ..records import Sensors
from ..robot.motors import Actuators, torque_limits
from ..robot.robot import Robot
from .governor import Governor, PathGovernor

GUARDS = ("position", "velocity", "time", "rest", "limits", "differences", "gravity")
# of the sizes of estimates, or a norm of joint velocities [rad/s or m/s]: a loop that has diverged;
# half or twice: it ends a sample or two earlier or later
ABSURD = 1e4
# [m] by which a contact may move. Half: an A1 with a tenth of the declared friction is stopped
# after 25 ms in place of 36, with half of it after 92 in place of 114, and so is a healthy Talos,
# whose soles tip by 11.5 mm where its torque is infeasible; others that stand move by 2.4 at most
SLIP = 0.02
_IDEAL = Actuators()


@dataclass(frozen=True, eq=False)
class Limits:
    """Bounds of torques, estimates and measurements of a controller made by ``make_controller``.

    Attributes:
        torque: (n) bounds [N m or N] at which the torque is clipped and the adaptation of the
            tracking error rests; True for the efforts of the description, False for none.
        box: where the kinematic estimates stay: a margin [m] around the nominal values, or p of
            them; lower and upper bounds (2, p) [m]; False for no box. By default a length stays
            within a tenth and ten times its nominal value, other coordinates within half the
            robot's reach, those of the base within ten times.
        damping: the right inverse of J_hat is damped where its smallest singular value, estimated
            from below, falls under this fraction of its value at home; zero never damps.
        guards: which measurements are refused as implausible, and when estimates rest; False for no
            guard, or a mapping from some of "position", "velocity", "time", "rest", "limits",
            "differences" and "gravity" to False. See ``Guards`` and ``FirstSamples``.
        stop_on_divergence: whether a run ends, with a message, when an M_hat to be inverted is not
            positive definite or the estimates run away.
        governor: whether the time of the path slows where the arm cannot follow it, see
            ``Governor``; True for its defaults. ``Controller.desired`` gives the desired motion at
            the time of the path.
        actuators: what the motors can follow: their delay and bandwidth, and the stiffness of the
            joints. Default gains and rates are made for them, and the check before a run has them
            in its loop. None: ideal ones.

    Raises:
        GainError: a damping outside [0, 1).
        InputError: a ``stop_on_divergence`` that is neither True nor False, a ``governor`` that is
            none, or ``actuators`` that are none.
    """

    torque: ArrayLike | bool | None = True
    box: ArrayLike | bool | None = None
    damping: float = 0.2
    guards: Mapping[str, bool] | bool = True
    stop_on_divergence: bool = True
    governor: Governor | bool = False
    actuators: Actuators | None = None

    def __post_init__(self) -> None:
        """Refuse what does not depend on the robot."""
        if positive(self.damping, "limits.damping", zero=True) >= 1.0:
            raise GainError(
                f"must be a fraction of home's, below 1, got {self.damping:g}.",
                where="limits.damping",
            )
        flag(self.stop_on_divergence, "limits.stop_on_divergence")
        if not isinstance(self.governor, Governor):
            flag(self.governor, "limits.governor")
        instance(self.actuators, Actuators | None, "limits.actuators")
        if not isinstance(self.guards, bool):
            for name, wanted in mapping(self.guards, "limits.guards").items():
                flag(wanted, f"limits.guards.{word(name, GUARDS, 'limits.guards')}")
        if not isinstance(self.box, bool | None):
            box = numbers(self.box, "limits.box", error=ParameterError)
            if box.ndim < 2:  # a margin
                joint_numbers(box, "limits.box", zero=False, error=ParameterError)
        if not isinstance(self.torque, bool | None):
            joint_numbers(self.torque, "limits.torque", zero=False, infinite=True, error=GainError)

    @property
    def watched(self) -> dict[str, bool]:
        """Which of ``GUARDS`` there are."""
        given = self.guards if isinstance(self.guards, Mapping) else {}
        return dict.fromkeys(GUARDS, self.guards is not False) | dict(given)


@dataclass(frozen=True, eq=False)
class ControllerLimits:
    """Limits of a controller in numbers; the defaults limit nothing.

    Attributes:
        torque: (n) bounds of the motors [N m or N], infinite where there is none, or None for none
            at all.
        singular: s_0, below which the right inverse of J_hat is damped; zero never damps it.
        estimate: bound on the norm of all estimates together, infinite for none.
        stop_on_divergence: whether estimates that went wrong end the run.
        governor: of the time of the path, or None.
        slip: by which a contact may move while it stands [m].
        actuators: for which gains and rates were made.
    """

    torque: np.ndarray | None = None
    singular: float = 0.0
    estimate: float = np.inf
    stop_on_divergence: bool = True
    governor: PathGovernor | None = None
    slip: float = np.inf
    actuators: Actuators = _IDEAL


def limits_for(
    robot: Robot,
    kinematics: TaskKinematics,
    dynamics: Dynamics,
    limits: Limits,
    sensors: Sensors,
    law: type[Law],
) -> ControllerLimits:
    """Return the limits of a controller for a robot.

    The estimates have run away beyond ten thousand times the sum of the nominal parameters' norm,
    the robot's mass and its reach.

    Args:
        robot: the model.
        kinematics: its kinematics.
        dynamics: its dynamics.
        limits: as given.
        sensors: as declared.
        law: the kind of law.

    Raises:
        GainError: torque limits that are not positive.
    """
    still = np.zeros(robot.model.nv)
    kinematics.update(kinematics.initial, robot.q0, still)
    s_home = kinematics.inverse(robot.q0, still, 1.0).conditioning  # damped: no home is refused
    size = np.linalg.norm(dynamics.initial) + robot.mass + robot.reach
    path = None
    if limits.governor:
        governor = Governor() if limits.governor is True else limits.governor
        home = 0.0 if law.keeps_speeds or law.set_point else s_home
        path = governor.of(robot, kinematics.task, sensors, home)
    return ControllerLimits(
        torque_limits(robot, limits.torque),
        limits.damping * s_home,
        ABSURD * size if limits.stop_on_divergence else np.inf,
        limits.stop_on_divergence,
        path,
        np.inf if limits.guards is False else SLIP,
        limits.actuators or _IDEAL,
    )


def make_box(kinematics: TaskKinematics, given: ArrayLike | bool | None) -> np.ndarray | None:
    """Return the box (2, p) of the kinematic estimates, lower bounds first, or None for none.

    Args:
        kinematics: the unknown translations.
        given: a margin [m] around the nominal values, or p of them; both bounds (2, p) [m]; False
            for none. By default a length lies between a tenth and ten times the nominal one,
            other coordinates within half the robot's reach, those of the base within ten times.

    Raises:
        ParameterError: wrong size or not numbers, or a negative margin.
    """
    if given is False or not kinematics.size:
        return None
    if given is None or given is True:
        return kinematics.bounds
    p = kinematics.size
    given = numbers(given, "limits.box", error=ParameterError)
    if given.shape == (2, p):
        return given
    margin = vector(given, p, "limits.box", names=kinematics.names, error=ParameterError)
    return kinematics.initial + np.stack([-margin, margin])
