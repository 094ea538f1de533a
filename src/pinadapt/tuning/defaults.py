"""Gains for a robot nobody has tuned, from its size, its inertia and the sampling period.

The bandwidth is w = 20 rad/s sqrt(2.2 m / reach), or 0.05 / dt for slow loops: gravity and the
centrifugal forces of similar motions accelerate a robot of reach L at the rate sqrt(g / L), and
what is wrong with the model then moves it by the same part of its size. Acceleration laws (V in
m^2/s^2) take K_P = w^2, K_v = 2 w, alpha = w / 4, lambda = w / 2, lambda_a = 1 / (3 w): on Wang and
Xie's arm, which reaches 2.2 m, their published numbers. Energy laws (V in joules) multiply K_P and
K_v by the mass felt at the frame; on the rotations of a pose by the inertia felt there instead, or
by as much as lets damping change the angular velocity of the lightest axis by its own size in one
period, if that is less; and where the check before a run finds the feedback too fast for dt, w is
lowered until it passes. The rates of adaptation follow from how fast they make the closed loop (see
``modes``): over a typical motion the fastest mode of the bodies' adaptation is 3 w, under energy
laws, which damp light directions more than heavy ones, 2 w, that of the joints' coefficients 3 w,
that of the kinematics 0.15 w, and R_k lets the filtered prediction error decay at w / 8. On the
Panda gamma_k is about the 0.05 that Wang and Xie published for their arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from ..laws.law import Law
from ..models.dynamics import Dynamics
from ..robot.robot import Robot
from ..robot.workspace import reach
from ..tasks.pose import PoseTask
from .prior import prior_covariance

_PUBLISHED, _REACH = 20.0, 2.2  # [rad/s], [m], of Wang and Xie's arm
_LEAST_REACH = 1e-6  # [m]
_LARGEST_STEP = 0.05  # bandwidth times sampling period
INERTIAL_MODE, ENERGY_MODE, JOINT_MODE, KINEMATIC_MODE, PREDICTION_RATE = (
    3.0,
    2.0,
    3.0,
    0.15,
    0.125,
)  # of the bandwidth
_LEAST_EXCITATION = 1e-6  # relative


@dataclass(frozen=True)
class Defaults:
    """Default gains; see the module for the rule.

    Attributes:
        bandwidth: w [rad/s].
        Kv, Kp, alpha: gains of the law.
        lambda_: velocity filter [1/s].
        lambda_a: acceleration filter [s].
    """

    bandwidth: float
    Kv: float | np.ndarray
    Kp: float | np.ndarray
    alpha: float
    lambda_: float
    lambda_a: float

    def slowed(self, share: float) -> Defaults:
        """Return the defaults for this share of the bandwidth."""
        return replace(
            self,
            bandwidth=share * self.bandwidth,
            Kv=share * self.Kv,
            Kp=share**2 * self.Kp,
            alpha=share * self.alpha,
            lambda_=share * self.lambda_,
            lambda_a=self.lambda_a / share,
        )


def felt_mass(robot: Robot) -> float:
    """Return the mean mass [kg] felt at the frame's position at home, one over the mean eigenvalue of J M^-1 J^T."""
    m = robot.task.positions
    return float(1.0 / np.mean(np.linalg.eigvalsh(_mobility(robot)[:m, :m])))


def felt_inertia(robot: Robot, fastest: float) -> float:
    """Return the mean inertia [kg m^2] against turning the frame of a pose task in place at home.

    At most the inertia that damping at the rate ``fastest`` [1/s] stands for on the axis that turns
    most easily.
    """
    mobility = _mobility(robot)
    in_place = np.linalg.inv(mobility)[3:, 3:]
    return float(min(np.trace(in_place) / 3.0, fastest / np.linalg.eigvalsh(mobility[3:, 3:])[-1]))


def _mobility(robot: Robot) -> np.ndarray:
    """Return J M^-1 J^T (m, m) at home."""
    model, data = robot.model, robot.model.createData()
    M = pin.crba(model, data, robot.q0)
    J = pin.computeFrameJacobian(model, data, robot.q0, robot.frame_id, pin.LOCAL_WORLD_ALIGNED)[
        robot.task.rows
    ]
    return np.asarray(J @ np.linalg.solve(M, J.T))


def default_gains(robot: Robot, law: type[Law], dt: float) -> Defaults:
    """Return the defaults for a believed robot under a law at sampling period dt [s]."""
    w = min(_PUBLISHED * (_REACH / max(reach(robot), _LEAST_REACH)) ** 0.5, _LARGEST_STEP / dt)
    scale = felt_mass(robot) if law.energy_based else 1.0
    rows: float | np.ndarray = scale
    if law.energy_based and isinstance(robot.task, PoseTask):
        rows = np.repeat([scale, felt_inertia(robot, 1.0 / (2.0 * w * dt))], 3)
    return Defaults(
        bandwidth=w,
        Kv=2.0 * w * rows,
        Kp=w * w * rows,
        alpha=w / 4.0,
        lambda_=w / 2.0,
        lambda_a=1.0 / (3.0 * w),
    )


def inertial_mode(law: type[Law]) -> float:
    """Return the fastest mode of the bodies' adaptation, in bandwidths."""
    return ENERGY_MODE if law.energy_based else INERTIAL_MODE


def gradient_shape(robot: Robot, dynamics: Dynamics, effects: Sequence[np.ndarray]) -> np.ndarray:
    """Return a constant Gamma_d (p, p) up to a factor, which the fastest mode of the loop then fixes (see ``modes``).

    It is the covariance of the parameters' errors when inertias are off by 30 % and lengths by 10
    %: the estimate moves in the directions in which the truth may lie, each at its own scale, and V
    weighs an error by how unlikely it is. Where no plausible truth has a value in these parameters,
    as in most bases of a user's own, it is Niemeyer and Slotine's: the inverse diagonal of the mean
    of Phi^T Phi over a typical motion (*Performance in adaptive manipulator control*, 1991).

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
