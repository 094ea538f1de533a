"""What a controller does not exceed: torques, the inverse Jacobian, estimates, translations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .._checks import numbers, positive, vector
from ..exceptions import GainError, ParameterError
from ..models.dynamics import Dynamics
from ..models.right_inverse import RightInverse
from ..models.task_kinematics import TaskKinematics
from ..models.translations import FIRST
from ..robot.motors import torque_limits
from ..robot.robot import Robot

_ABSURD = 1e4
_SHORTEST, _LONGEST = 0.2, 5.0
_WIDE, _WIDE_BASE = 0.5, 10.0  # of the reach


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of a controller; the defaults limit nothing.

    Attributes:
        torque: (n) bounds of the motors [N m or N], infinite where there is none, or None for none
            at all.
        singular: s_0, below which the right inverse of J_hat is damped; zero never damps it.
        estimate: bound on the norm of all estimates together; infinite when nobody watches.
        watch: whether estimates that went wrong end the run.
    """

    torque: np.ndarray | None = None
    singular: float = 0.0
    estimate: float = np.inf
    watch: bool = True


def make_limits(
    believed: Robot,
    kinematics: TaskKinematics,
    dynamics: Dynamics,
    *,
    torque: ArrayLike | bool | None,
    damping: float,
    watch: bool,
) -> Limits:
    """Return the limits of a controller for a believed robot.

    Args:
        believed: the believed robot.
        kinematics: its kinematics.
        dynamics: its dynamics.
        torque: (n) bounds, True for the efforts of the robot's description, None or False for none.
        damping: s_0 as a fraction of s at home, zero for no damping; see ``RightInverse``.
        watch: whether estimates that went wrong end the run; estimates are absurd beyond ten
            thousand times the believed parameters, the robot's mass and its reach.

    Raises:
        GainError: torque limits that are not positive, or a damping outside [0, 1).
    """
    fraction = positive(damping, "damping", zero=True)
    if fraction >= 1.0:
        raise GainError(
            f"must be a fraction of home's, below 1, got {fraction:g}.", where="damping"
        )
    kinematics.update(kinematics.initial, believed.q0, np.zeros(believed.model.nv))
    s_home = RightInverse(kinematics.J, 1.0).conditioning  # damped, so that no home is refused
    size = (
        float(np.linalg.norm(dynamics.initial))
        + sum(body.mass for body in believed.model.inertias)
        + believed.reach
    )
    return Limits(
        torque_limits(believed, torque),
        fraction * s_home,
        _ABSURD * size if watch else np.inf,
        watch,
    )


def make_box(
    believed: Robot, kinematics: TaskKinematics, given: ArrayLike | bool | None
) -> np.ndarray | None:
    """Return the box (2, p) of the kinematic estimates, lower bounds first, or None for none.

    Args:
        believed: the believed robot.
        kinematics: its unknown translations.
        given: a margin [m] around the believed values, or p of them; both bounds (2, p) [m]; False
            for none. By default a length lies between a fifth and five times the believed one,
            other coordinates within half the robot's reach, those of the base within ten times.

    Raises:
        ParameterError: wrong size or not numbers, or a negative margin.
    """
    if given is False or not kinematics.size:
        return None
    names, centre = kinematics.names, kinematics.initial
    if given is None or given is True:
        plain = [
            part.directions.shape[1] == 1 and not part.offset.any()
            for part in kinematics.translations
        ]
        sizes = [len(part.labels) for part in kinematics.translations]
        length = np.repeat(plain, sizes) & (centre > 0.0)
        wide = [_WIDE_BASE if part.joint == FIRST else _WIDE for part in kinematics.translations]
        margin = np.repeat(wide, sizes) * believed.reach
        low = np.where(length, _SHORTEST * centre, centre - margin)
        return np.stack([low, np.where(length, _LONGEST * centre, centre + margin)])
    given = numbers(given, "unknown.kinematic_box", error=ParameterError)
    rows = [given] if given.ndim < 2 else list(given)
    if len(rows) > 2:
        raise ParameterError(
            f"expected lower and upper bounds, got {len(rows)} rows.", where="unknown.kinematic_box"
        )
    bounds = [
        vector(row, centre.size, "unknown.kinematic_box", names=names, error=ParameterError)
        for row in rows
    ]
    if len(bounds) == 2:
        return np.stack(bounds)
    if not (bounds[0] > 0.0).all():
        raise ParameterError(
            f"a margin must be positive, got {bounds[0].tolist()}.", where="unknown.kinematic_box"
        )
    return np.stack([centre - bounds[0], centre + bounds[0]])
