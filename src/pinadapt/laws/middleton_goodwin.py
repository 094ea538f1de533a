"""Adaptive computed torque that learns from the prediction of the torque alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from ..adaptation.adaptation import Drives
from ..signals import Signals
from .acceleration_law import AccelerationLaw
from .law import Command, EstimatedModel, Law, Truth

# [rad or m] of a central difference, where truncation and rounding are as large
_STEP = float(np.cbrt(np.finfo(float).eps))


@dataclass(frozen=True, eq=False)
class MiddletonGoodwin(AccelerationLaw):
    """Computed torque modified for an estimate from filtered torques, without accelerations.

    R. Middleton, G. Goodwin, *Adaptive computed torque control for rigid link manipulators*, Syst.
    Control Lett. 10 (1988) 9-16: least squares on the prediction error of the filtered torque, and
    computed torque with a term for the motion of the estimate. Their text could not be recovered
    exactly; the modification below is derived from its proof, in three lines.

    Law:          tau = M_hat u + C_hat qd + g_hat + W (da_d/dt) / lambda - (dM_hat/dt) zeta,
                  u = qdd_d - K_v ed - K_P e, e = q - q_d on the manifold;
                  zeta = M_hat^-1 epsilon / lambda, epsilon = W a_d - y the prediction error.
                  W = F Y and y = F tau are regressor and torque through F = lambda / (p + lambda),
                  see ``FilteredRegressor``; dM_hat/dt holds the motion of the estimate, too.
    Adaptation:   da_d/dt = -P W^T R epsilon, dP/dt = forgetting - P W^T R W P ("least-squares", as
                  published but for the forgetting, which is that of ``LeastSquares``), or the same
                  gradient in another metric ("natural-composite", "composite"). The tracking error
                  drives nothing.
    Closed loop:  edd + K_v ed + K_P e = d(zeta)/dt + lambda zeta.
                  Proof: the torque gives M_hat (qdd - u) = Y da_d + (what was added), da_d = a_d -
                  a; epsilon = W da_d and dW/dt = lambda (Y - W) give d(epsilon)/dt = lambda (Y da_d
                  - epsilon) + W da_d/dt, so Y da_d = epsilon + d(epsilon)/dt / lambda - W (da_d/dt)
                  / lambda; and d(zeta)/dt = M_hat^-1 (d(epsilon)/dt - (dM_hat/dt) M_hat^-1 epsilon)
                  / lambda.
    V:            D_d(a_d), of least squares da_d^T P^-1 da_d / 2, whatever the torque is: dV/dt =
                  -epsilon^T R epsilon, of least squares half of that and less what is forgotten.
    Convergence:  zeta is square integrable as epsilon is, and so are e and ed - zeta, by the stable
                  transfer (p + lambda) / (p^2 + K_v p + K_P): d/dt (ed - zeta) = -K_v ed - K_P e +
                  lambda zeta. e is then uniformly continuous, and goes to zero.
    Assumptions:  constant parameters, all of the joints' torques predicted, friction among them;
                  M_hat^-1 bounded, which natural adaptation keeps and least squares does not.
                  Needed are q, qd and the torque that was given.
    Task space:   where the kinematics are known a joint motion says as much; where they are not,
                  J_hat zeta in the task's error would enter the drive of the kinematics, and its
                  proof does not go through.

    Without an adaptation that predicts, it is computed torque. By default the prediction error
    decays at four times the bandwidth, as nothing else moves the estimate; of least squares at the
    rate of ``predicting``.

    Attributes:
        K_v, K_P, alpha: as ``AccelerationLaw``; alpha is not used here.
    """

    posture: Any = None

    name = "middleton-goodwin"
    sources = ("MiddletonGoodwin1988",)
    joint_space = True
    inverts_estimate = True
    learns_from_torque = True
    uses_acceleration = False
    prediction_mode = 4.0

    filters = Law.filters  # type: ignore[assignment]  # those of the prediction are the controller's

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return the modified computed torque; the controller adds the prediction error."""
        drives = Drives.none(s.a_d.size, s.a_k.size)
        u = s.xdd_d - self.K_v.dot(s.dxd_hat) - self.K_P.dot(s.dx)
        torque = model.dynamics.torque(s.q, s.v, u)  # M_hat u + C_hat qd + g_hat
        if s.filtered_torque is None:
            return Command(torque, drives)
        W = s.filtered_torque.W
        lambda_ = s.filtered_torque.bandwidth
        epsilon = s.filtered_torque.error(s.a_d)  # W a_d - y
        predicting = drives.dynamic.with_prediction_error(W, epsilon)
        if model.dt:  # the mean over the period
            after = model.adaptation_d.step(model.dynamic, predicting, model.dt)
            a_rate = (after.value - model.dynamic.value) / model.dt
        else:
            a_rate = model.adaptation_d.rate(model.dynamic, predicting).value
        M_hat = model.dynamics.mass_matrix(s.q)
        zeta = model.acceleration_drive(M_hat, s.J, epsilon, W).e / lambda_
        # + W (da_d/dt) / lambda - (dM_hat/dt) zeta
        torque = torque + W.dot(a_rate) / lambda_ - _mass_rate_times(s, model, a_rate, zeta)
        return Command(torque, drives)

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return zero: V is of the parameters alone."""
        return 0.0

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return zero."""
        return 0.0


def _mass_rate_times(
    s: Signals, model: EstimatedModel, a_rate: np.ndarray, z: np.ndarray
) -> np.ndarray:
    """Return (dM_hat/dt) z (n): a central difference along the motion, exact in the estimate.

    M_hat(q; a) z is Y(q, 0, z) a - Y(q, 0, 0) a plus a part that does not depend on a.
    """
    rest = np.zeros(s.v.size)
    chain = model.kinematics.robot.model
    dynamics = model.dynamics
    of_estimate = dynamics.regressor(s.q, rest, z) - dynamics.regressor(s.q, rest, rest)
    h = _STEP / max(np.abs(s.v).max(), _STEP)
    ahead, behind = (
        dynamics.mass_matrix(pin.integrate(chain, s.q, way * s.v)).dot(z) for way in (h, -h)
    )
    return (ahead - behind) / (2.0 * h) + of_estimate.dot(a_rate)
