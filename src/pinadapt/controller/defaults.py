"""Gains for a robot nobody has tuned, from its size, its inertia and the sampling period.

The bandwidth w is 20 rad/s, or 0.04 / dt for slow loops. Acceleration laws (V in m^2/s^2) take K_P = w^2, K_v = 2 w,
alpha = w / 4, lambda = w / 2, lambda_a = 1 / (3 w): Wang and Xie's published numbers, at w = 20. Energy laws (V in joules)
multiply K_P and K_v by the mass felt at the frame; on the rotations of a pose by the inertia felt there instead, or
by as much as lets damping change the angular velocity of the lightest axis by its own size in one period, if that is less.
The rates of adaptation follow from how fast they make the closed loop (see ``modes``): over a typical motion the fastest mode
of the bodies' adaptation is 2 w, that of the joints' coefficients 2 w, that of the kinematics w / 4, and R_k lets the filtered
prediction error decay at w / 8. On Wang and Xie's arm the last two are about their published 0.05 and 50.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..laws import Law
from ..parameters import DynamicParameters
from ..robot import PoseTask, Robot

_FASTEST = 20.0  # [rad/s]
_LARGEST_STEP = 0.04  # bandwidth times sampling period
INERTIAL_MODE, JOINT_MODE, KINEMATIC_MODE, PREDICTION_RATE = 2.0, 2.0, 0.25, 0.125  # of the bandwidth
_GRADIENT_RATE = 0.3  # [1/s] at which one parameter alone would be learned
_SAMPLES = 200


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


def felt_mass(robot: Robot) -> float:
    """Return the mean mass [kg] felt at the frame's position at home, one over the mean eigenvalue of J M^-1 J^T."""
    m = robot.task.positions
    return float(1.0 / np.mean(np.linalg.eigvalsh(_mobility(robot)[:m, :m])))


def felt_inertia(robot: Robot, fastest: float) -> float:
    """Return the mean inertia [kg m^2] against turning the frame of a pose task in place at home.

    At most the inertia that damping at the rate ``fastest`` [1/s] stands for on the axis that turns most easily.
    """
    mobility = _mobility(robot)
    in_place = np.linalg.inv(mobility)[3:, 3:]
    return float(min(np.trace(in_place) / 3.0, fastest / np.linalg.eigvalsh(mobility[3:, 3:])[-1]))


def _mobility(robot: Robot) -> np.ndarray:
    """Return J M^-1 J^T (m, m) at home."""
    model, data = robot.model, robot.model.createData()
    M = pin.crba(model, data, robot.q0)
    J = pin.computeFrameJacobian(model, data, robot.q0, robot.frame_id, pin.LOCAL_WORLD_ALIGNED)[robot.task.rows]
    return np.asarray(J @ np.linalg.solve(M, J.T))


def default_gains(robot: Robot, law: type[Law], dt: float) -> Defaults:
    """Return the defaults for a believed robot under a law at sampling period dt [s]."""
    w = min(_FASTEST, _LARGEST_STEP / dt)
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


def default_gradient_gain(robot: Robot, dynamics: DynamicParameters, law: type[Law]) -> np.ndarray:
    """Return the diagonal (p) of Gamma_d: each parameter learns at its own scale.

    G. Niemeyer and J.-J. Slotine, *Performance in adaptive manipulator control*, 1991: Gamma proportional to the inverse
    diagonal of the integral of Y^T Y, here over seeded states around home at typical speeds instead of a trajectory.
    """
    model, data, rng = robot.model, robot.model.createData(), np.random.default_rng(0)
    speed, excitation = 0.5, np.zeros(dynamics.size)
    for _ in range(_SAMPLES):
        q = pin.integrate(model, robot.q0, rng.uniform(-0.3, 0.3, model.nv))
        v, a = speed * rng.standard_normal((2, model.nv))
        Y = dynamics.regressor(q, v, a)
        if not law.energy_based:
            J = pin.computeFrameJacobian(model, data, q, robot.frame_id, pin.LOCAL_WORLD_ALIGNED)[robot.task.rows]
            Y = J @ np.linalg.solve(pin.crba(model, data, q), Y)
        excitation += np.sum(Y * Y, axis=0) / _SAMPLES
    floor = 1e-6 * excitation.max(initial=1e-12)
    return _GRADIENT_RATE / np.maximum(excitation, floor)
