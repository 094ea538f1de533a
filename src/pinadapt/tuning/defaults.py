"""Constants of the default gains, and the bandwidth from which they follow.

The bandwidth is w = 20 rad/s sqrt(2.2 m / reach), or 0.075 / dt for slow loops: gravity and the
centrifugal forces of similar motions accelerate a robot of reach L at the rate sqrt(g / L), and
what is wrong with the model then moves it by the same part of its size. Each law states its own
gains for a bandwidth (``Law.tuned``); where the check before a run finds the feedback too fast for
dt, w is lowered until it passes.

The rates of adaptation follow from how fast they make the closed loop (see ``linearised_loop``):
over a typical motion the fastest mode of the bodies' adaptation is ``Law.adaptation_mode`` w, that
of the joints' coefficients ``Law.joint_mode`` w, that of the kinematics ``Law.kinematic_mode`` w,
and R_k lets the prediction error decay at w / 8. On the Panda gamma_k of the published laws is
about the 0.05 that Wang and Xie took for their arm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..models.dynamics import Dynamics
from ..robot.robot import Robot
from .prior import prior_covariance

_PUBLISHED, _REACH = 20.0, 2.2  # [rad/s], [m], of Wang and Xie's arm
_LEAST_REACH = 1e-6  # [m]
_LARGEST_STEP = 0.075  # bandwidth times sampling period
_LEAST_EXCITATION = 1e-6  # relative

# of the bandwidth
PREDICTION_RATE = 0.125


def bandwidth(robot: Robot, dt: float) -> float:
    """Return the default bandwidth w [rad/s] for a believed robot at sampling period dt [s]."""
    return min(_PUBLISHED * (_REACH / max(robot.reach, _LEAST_REACH)) ** 0.5, _LARGEST_STEP / dt)


def gradient_shape(robot: Robot, dynamics: Dynamics, effects: Sequence[np.ndarray]) -> np.ndarray:
    """Return a constant Gamma_d (p, p) up to a factor, which the fastest mode of the loop fixes.

    It is the covariance of the parameters' errors when inertias are off by 30 % and lengths by
    10 %: the estimate moves in the directions in which the truth may lie, each at its own scale,
    and V weighs an error by how unlikely it is. Where no plausible truth has a value in these
    parameters, as in most bases of a user's own, it is Niemeyer and Slotine's: the inverse diagonal
    of the mean of Phi^T Phi over a typical motion (*Performance in adaptive manipulator control*,
    1991).

    Args:
        robot: the believed robot.
        dynamics: the parameters, made for it.
        effects: Phi of the loop at typical states.
    """
    covariance = prior_covariance(robot, dynamics)
    if covariance is not None:
        return covariance
    excitation = np.mean([np.sum(Phi * Phi, axis=0) for Phi in effects], axis=0)
    return np.diag(1.0 / np.maximum(excitation, _LEAST_EXCITATION * excitation.max(initial=1e-12)))
