"""The separation law: kinematics learned from the position, dynamics from the joints."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from numpy import empty

from .._checks import definite_matrix, joint_numbers, positive, take_checked
from .._kernels import laws as kernels
from ..adaptation.adaptation import Drive, Drives
from ..exceptions import GainError
from ..filters import PositionObserver
from ..models.dynamics import Dynamics
from ..models.typical_motion import TypicalMotion, joint_inertia
from ..robot.changes import Payload
from ..robot.robot import LOAD, Robot
from ..signals import Signals
from ..tasks.frame import rotation_drift
from ..tasks.task import JointTask, Moving, Task
from .law import (
    Command,
    EstimatedModel,
    Feedback,
    KinematicLoop,
    Law,
    Truth,
    check_in_place,
)
from .posture import Posture

_DAMPING = 3.0  # K_v in bandwidths times inertia; half, twice: docs/default_law.md
# [s] 4 ms: motors that are 10 ms late make unloaded wrists ring; 16 ms: an unknown load displaces a
# UR10 by 33 mm at the start in place of 22
_LAG = 8e-3
_ARM = 0.05  # of the reach: of the load assumed for K_D; half or twice: docs/default_law.md
# of the reach; with all of it, late noisy frames disturb the start; half, twice: the last error of
# an orientation in a tracker 2 % larger, 7 % smaller
_LEVER = 0.25


@dataclass(frozen=True, eq=False)
class Separation(Law):
    """Separation of kinematic and dynamic adaptation, after H. Wang, IEEE TAC 62 (2017) 948-954.

    The kinematic estimate converges whatever the torque does, the dynamic one whatever the camera
    does. Added to Wang's law are the prediction errors of position and torque.

    Law:          tau = Y(q, qd, qd_r, qdd_r) a_d - K_D s - d, s = qd - qd_r,
                  qd_r = J_hat^+ (xd_d - alpha (x_o - x_d)) + N psi, qdd_r its exact derivative,
                  dx_o/dt = J_hat qd - beta dx_o, dx_o = x_o - x,
                  dd/dt = lambda_d (W a_d - y - d), W and y the regressor and the commanded torque
                  behind a low pass (``FilteredRegressor``): a momentum observer at the present
                  estimate. d is zero where the adaptation predicts no torque.
    Adaptation:   da_d/dt = -Gamma_d (Y^T s + ...), such as ``CompositeMemory``;
                  da_k/dt = -Gamma_k (c Y_k^T dx_o + X_k^T R epsilon),
                  epsilon = x_hat(q; a_k) - x = X_k da_k, as x is affine in the translations.
    Closed loop:  M ds/dt + C s = -K_D s + Y da_d - d; dd/dt = lambda_d (W da_d - d);
                  d(dx_o)/dt = Y_k da_k - beta dx_o;
                  d(x_o - x_d)/dt = -alpha (x_o - x_d) + J_hat s - beta dx_o.
    V:            V_d + V_k, V_d = s^T M s / 2 + d^T (lambda_d diag(K_v))^-1 d / 4 + D_d(a_d),
                  V_k = c dx_o^T dx_o / 2 + D_k(a_k),
                  dV_d/dt = -s^T K_D s - s^T (f(qd) - f(qd_r)) - s^T d
                  - d^T diag(K_v)^-1 (d - W da_d) / 2 - what the adaptation adds, with a memory
                  (rho / kappa) da^T H da; f the true friction of the joints: monotone.
                  dV_k/dt = -c beta dx_o^T dx_o - epsilon^T R epsilon. Both are equalities.
    Sign:         diag(K_v)^-1 / 2 may be any constant diagonal B > 0. With B >= K_D(q)^-1 / 2
                  everywhere dV_d/dt <= -(rho / kappa) da^T H da + (W da)^T B (W da) / 2. It is not
                  positive where W^T B W <= 2 (rho / kappa) H, that is 4 K_D R >= 1 for a prediction
                  error of weight R. A memory that is still empty does not pay for it: then V_d may
                  rise, at most as fast as without an adaptation.
    Not proved:   friction that is no parameter (Stribeck): then d follows it at lambda_d;
                  motors that are late, beyond lag;
                  joints on springs;
                  frames that are late, which are carried to now by the estimate;
                  motors at their limits: Y^T s is left out meanwhile, and d is that of the torque
                  that was sent.
    Pose:         the rotation error of the estimated orientation, which no estimate enters, takes
                  the place of x_o - x_d in its rows; its derivative is omega - omega_d + delta.
    Tracker:      a pose in unknown axes turns with omega_hat = J_hat qd of its rows, whose error is
                  Y_w da_k, so its orientation is observed as well: R_o has the angular velocity
                  omega_o = omega_hat - beta eta, eta = log(R_o R^T). log(R_o R_d^T) and omega_o
                  take the place of the measured error and of omega, lever^2 c Y_w^T eta is added
                  to g_k, c lever^2 eta^T eta / 2 to V, -c beta lever^2 eta^T eta to dV/dt. It holds
                  in |eta| < pi, which no motion leaves if V's kinematic part begins below
                  c (lever pi)^2 / 2. A constant rotation of the marker on the tool has no effect.
    Picture:      of a camera (task "image") the prediction error alone is linear in the parameters,
                  by way of the measured picture, so c is zero and dx_o leaves V. It follows
                  epsilon: r = dx_o - epsilon obeys dr/dt = -beta r - beta epsilon
                  - (dx_hat/da_k) da_k/dt.
    Noise:        qdd_r holds -alpha J^+ J qd, and s holds qd, so noise of qd has a mean in Y^T s.
                  With a finite lambda_s the regressor is Y(q, qd_r + s_f, qd_r, qdd_r + alpha J^+ J
                  (s - s_f)), s_f = s through the low pass lambda_s / (lambda_s + p), in torque and
                  adaptation alike: exact below lambda_s, free of noise above it, where M dqd/dt
                  dominates what is left out. A low pass of qd delays it by the ``lead``, so qd +
                  lead qdd_r takes its place in s, or the arm would follow a reference that is as
                  late. dV/dt is then no equality.
    Joints:       nothing is observed or predicted: Slotine and Li's law with this K_D and d.
    Assumptions:  constant parameters; J_hat of full row rank; with a lag M_hat > 0, which natural
                  adaptation keeps. Needed are q, qd and x: no task velocity, no acceleration.

    Default gains for the bandwidth w = 30 rad/s, at most 0.075 / dt: alpha = beta = w, K_v = 3 w
    diag(M) at home, with an assumed load of a tenth of the robot's mass a twentieth of its reach
    off the flange, and lag = 8 ms, or 2 dt where that is longer, but zero for a K_v of the user's
    own. What joints move together may be much lighter than what each moves by itself, as the elbow
    of an arm whose shoulder axes align. lambda_d = w, but no joint's is faster than K_D damps it
    under that load: a light wrist with a heavy load would swing.

    Attributes:
        task: the controlled coordinates, m of them, m_p positions.
        posture: what redundant joints do.
        K_v: (n, n) K_D [N m s/rad or N s/m], or what it is at most; see ``lag``.
        alpha: [1/s].
        beta: [1/s].
        c: weight of the observation error; zero by default for pictures.
        R_k: (m_p, m_p) R, weight of the prediction error of the position.
        lambda_s: decorrelation [1/s], infinite for none.
        lambda_d: (n) of the low pass F_w on the prediction error of the torque [1/s]; zero: the
            torque does not contain it.
        lag: [s], with which K_D^-1 = K_v^-1 + lag M_hat(q)^-1: no eigenvalue of M_hat^-1 K_D then
            exceeds 1 / lag, at no configuration and whatever load has been learned. Zero:
            K_D = K_v. V is the same for any K_D > 0, which may change in time.
        dynamics: with the estimated mass matrix, where there is a lag.
        lead: the time by which a low pass delays qd [s], see ``PositionObserver``.
        speeds: (n) limits that qd_r keeps [rad/s or m/s], see ``RightInverse.keeping``, and near
            singularities the feedback in u, see ``RightInverse.feedback``; None: no limits. With a
            governor they are those of the path. V has the same derivative with any differentiable
            qd_r. While the feedback would exceed them, the path waits.
        lever: length that makes a turn count as a way in the observation error of a pose in the
            axes of a tracker [m]; zero: no orientation is observed, the measured one is taken.
    """

    task: Task
    posture: Posture
    _: KW_ONLY
    K_v: Any
    alpha: float
    beta: float
    c: float = 1.0
    R_k: Any = 1.0
    lambda_s: float = math.inf
    lambda_d: Any = 0.0
    lag: float = 0.0
    dynamics: Dynamics | None = None
    lead: float = 0.0
    speeds: np.ndarray | None = None
    lever: float = 0.0

    name = "separation"
    sources = ("Wang2017",)
    uses_position_error = True
    uses_acceleration = False
    constrained = True
    velocity_error = True
    keeps_speeds = True
    joint_effects = "all"
    remembers = True
    bandwidth_powers: ClassVar[dict[str, float]] = {"Kv": 1.0, "alpha": 1.0, "lag": -1.0}
    adaptation_mode = 8.0
    # [rad/s] 15: two to four times the errors; 60: a third of them, but loops with motors that are
    # 10 ms late ring. What half and twice of the other numbers do: docs/default_law.md
    own_bandwidth = 30.0
    prediction_mode = 2.0
    joint_mode = 8.0
    kinematic_mode = 0.3
    units = ("N m s/rad", "")

    def __post_init__(self) -> None:
        """Turn gains into matrices.

        Raises:
            GainError: gains that are not positive (definite) or of the wrong size.
        """
        check_in_place(self, "alpha", "beta", "R_k")
        take_checked(self, positive, "", "lever", "c", "lag", zero=True)
        if not (isinstance(self.lambda_s, float) and self.lambda_s == math.inf):
            positive(self.lambda_s, "lambda_s")
        K_D = definite_matrix(self.K_v, self.posture.damping.size, "Kv")
        object.__setattr__(self, "K_v", K_D)
        lambda_d = joint_numbers(self.lambda_d, "lambda_d", len(K_D), error=GainError)
        object.__setattr__(self, "lambda_d", lambda_d)

    @cached_property
    def filters(self) -> PositionObserver:
        """The observer of the position, or of the pose, and of the disturbance."""
        error = None if math.isinf(self.lambda_s) else self._reference_error
        gains = self.beta, error, self.lambda_s, self.lead, self.lambda_d
        return PositionObserver(*gains, orientation=bool(self.lever))

    @classmethod
    def default_gains(cls, motion: TypicalMotion, dt: float, w: float) -> dict[str, Any]:
        """Return the default gains, as the class states them."""
        kinematics = motion.kinematics
        turns = not kinematics.calibrated and kinematics.task.size > kinematics.positions
        return {
            "Kv": _DAMPING * w * _loaded_inertia(motion.robot),
            "alpha": w,
            "beta": w,
            "c": 1.0 if kinematics.affine else 0.0,
            "R_k": 1.0,
            "lambda_s": math.inf,
            "lag": max(_LAG, 2.0 * dt),
            "dynamics": motion.dynamics,
            "lever": _LEVER * motion.robot.reach if turns else 0.0,
        }

    @classmethod
    def tuned(
        cls, motion: TypicalMotion, dt: float, share: float = 1.0, **given: Any
    ) -> Separation:
        """Return the law with its default gains; see ``Law.tuned``."""
        if given.get("Kv") is not None and given.get("lag") is None:
            given["lag"] = 0.0
        law = super().tuned(motion, dt, share, **given)
        K_D = law.K_D(motion.robot.q0, motion.dynamics.initial)
        damped = np.diag(K_D) / _loaded_inertia(motion.robot)
        return replace(law, lambda_d=np.minimum(share * motion.bandwidth, damped))

    def K_D(self, q: np.ndarray, a_d: np.ndarray) -> np.ndarray:
        """Return K_D (n, n) [N m s/rad or N s/m] at q (nq) and an estimate a_d (p)."""
        if self.dynamics is None or not self.lag:
            return self.K_v
        self.dynamics.load(a_d)
        return self._limited(self.dynamics.mass_matrix(q))

    def _limited(self, M: np.ndarray) -> np.ndarray:
        """Return (K_v^-1 + lag M^-1)^-1 (..., n, n)."""
        return np.linalg.inv(np.linalg.inv(self.K_v) + self.lag * np.linalg.inv(M))

    def of_joints(self, task: JointTask) -> Separation:
        """Return the same feedback with the joints as its task."""
        return replace(self, task=task, R_k=1.0, lever=0.0)

    def _reference(self, s: Signals) -> Moving:
        """Return u = xd_d - alpha (x_o - x_d) (m) and du/dt: dx_o/dt is known, xd is not needed.

        In the rows of an orientation its error, measured or observed, stands for x_o - x_d.
        """
        u = empty(s.dx.size)
        ud = empty(s.dx.size)
        dx = s.dx
        xd = s.xd_hat
        delta = s.delta
        if self.lever:
            dx, xd, delta = _turning(s, self.beta)
        kernels.reference(s.xd_d, dx, s.xdd_d, xd, s.filtered.dx_o, self.alpha, self.beta, u, ud)
        if delta is not None:
            ud -= self.alpha * delta
        return u, ud

    def _joint_reference(self, s: Signals, Jdot: np.ndarray) -> Moving:
        """Return qd_r = J_hat^+ u + N psi, within the speeds, and its derivative (n) for dJ_hat/dt.

        N psi is the null motion of the posture.
        """
        u, ud = self._reference(s)
        if self.speeds is not None:
            u, ud = s.inverse.feedback(self.speeds, u, ud, s.xd_d, s.xdd_d, Jdot)
        psi, psid = self.posture.null_motion(s)
        qd_r, qdd_r = s.inverse.solve_with_rate(u, psi, ud, psid, Jdot)
        if self.speeds is None:
            return qd_r, qdd_r
        return s.inverse.keeping(self.speeds, qd_r, qdd_r, psi, psid, Jdot)

    def _reference_error(self, s: Signals) -> np.ndarray:
        """Return s = qd - qd_r (n)."""
        return s.v - self._joint_reference(s, np.zeros(s.J.shape))[0]

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return tau = Y a_d - K_D s - d, and the drives of both estimates."""
        kinematic = self._kinematic_drive(s)
        a_k_rate = model.adaptation_k.value_rate(model.kinematic, kinematic)
        # dJ_hat/dt with the moving estimate
        qd_r, qdd_r = self._joint_reference(s, model.kinematics.jacobian_rate(a_k_rate))
        v = s.v
        if s.filtered.s_f.size:  # decorrelated
            noise = v - qd_r - s.filtered.s_f
            v = v - noise
            qdd_r = qdd_r + self.alpha * (noise - s.inverse.null(noise))
        # tau = Y(q, qd, qd_r, qdd_r) a_d - K_D s - F_w (W a_d - y)
        Y, feedforward = model.dynamics.slotine_li(s.q, v, qd_r, qdd_r)
        qd = s.v + self.lead * qdd_r if self.lead else s.v  # the measured one is late by the lead
        error = qd - qd_r
        if self.lag:
            M_hat = model.dynamics.mass_matrix(s.q)
            torque = empty(error.size)
            kernels.subtract_limited_damping(
                feedforward, self.K_v, M_hat, 1.0 / self.lag, error, torque
            )
        else:
            torque = feedforward - self.K_v.dot(error)
        torque -= s.filtered.disturbance
        return Command(torque, Drives(Drive(Y, error), kinematic), None, feedforward)

    def _kinematic_drive(self, s: Signals) -> Drive:
        """Return the drive of g_k = c Y_k^T (dx_o, lever eta) + X_k^T R epsilon.

        The rotation rows of Y_k count times the lever, and only where there is one.
        """
        epsilon = s.epsilon
        X_k = s.X_k
        m, p = X_k.shape
        error = empty(m)
        g_k = empty(p)
        kernels.observation_drive(
            s.Y_k, s.filtered.dx_o, self.c, X_k, epsilon, self.R_k, error, g_k
        )
        if self.lever:
            turning = self.lever * self.c * self.lever * s.filtered.eta
            error = np.append(error, turning)
            g_k = g_k + turning @ s.Y_k[m:]
            m = len(s.Y_k)
        return Drive(s.Y_k[:m], error, X_k, epsilon, self.R_k, g_k, observed=True)

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return V without the parts of the parameters; M is the true mass matrix."""
        error = self._reference_error(s)
        d = s.filtered.disturbance
        V = 0.5 * error @ (truth.M @ error) + 0.5 * self._observation(s)
        if self.lambda_d.any():
            V += 0.25 * d @ (d / (self.lambda_d * np.diag(self.K_v)))
        return V

    def _observation(self, s: Signals) -> float:
        """Return c (dx_o^T dx_o + lever^2 eta^T eta)."""
        dx_o = s.filtered.dx_o
        eta = s.filtered.eta
        return self.c * (dx_o @ dx_o + self.lever**2 * eta @ eta)

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt."""
        error = self._reference_error(s)
        epsilon = s.epsilon
        d = s.filtered.disturbance
        f = truth.friction.torque
        joints = (
            error @ (self.K_D(s.q, s.a_d) @ error) + error @ (f(s.v) - f(s.v - error)) + error @ d
        )
        if self.lambda_d.any():
            predicted = np.zeros(d.size)
            if s.filtered_torque is not None:
                predicted = s.filtered_torque.W @ (s.a_d - truth.a_d)
            joints += 0.5 * (d - predicted) @ (d / np.diag(self.K_v))
        task = self.beta * self._observation(s) + epsilon @ (self.R_k @ epsilon)
        return -joints - task

    def feedback(self, motion: TypicalMotion) -> Feedback:
        """Return the feedback of the joints.

        The null space follows its reference motion, which feels nothing of it.
        """
        M = motion.mass_matrices
        W = motion.unit_masses
        W_T = W.swapaxes(1, 2)
        D = W @ self._limited(M) @ W_T
        tracked = W @ M @ motion.right_inverses @ motion.jacobians @ W_T
        null = self.posture.frequency * (np.eye(M.shape[1]) - tracked)
        return Feedback(self.alpha * D @ tracked, D + self.alpha * tracked, null, D)

    def kinematic_loop(self) -> KinematicLoop:
        """Return the coupling of observation and prediction."""
        return KinematicLoop(self.c or 1.0, self.beta, self.R_k)


def _turning(s: Signals, beta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return dx, xd_hat and delta (6) with the rotation rows of the observed orientation R_o.

    These are log(R_o R_d^T), omega_o = omega_hat - beta eta, and the drift of the former.
    """
    eta, dx, xd, delta = s.filtered.eta, s.dx.copy(), s.xd_hat.copy(), np.zeros(s.dx.size)
    dx[3:] = pin.log3(pin.exp3(eta) @ pin.exp3(dx[3:]))
    xd[3:] -= beta * eta
    delta[3:] = rotation_drift(dx[3:], xd[3:], s.xd_d[3:])
    return dx, xd, delta


def assumed_load(robot: Robot) -> Payload:
    """Return a ball of a tenth of a robot's mass, whose radius is a twentieth of its reach."""
    mass = LOAD * robot.mass
    turning = mass * (_ARM * robot.reach) ** 2
    return Payload(mass, (0.0, 0.0, 0.0), (turning, 0.0, turning, 0.0, 0.0, turning))


@lru_cache(maxsize=1)  # asked for by each share of a bandwidth that is tried
def _loaded_inertia(robot: Robot) -> np.ndarray:
    """Return the inertia (n) that each joint moves with the load assumed for K_D [kg m^2 or kg].

    Several frames share the load.
    """
    load = assumed_load(robot)
    frames = robot.frames
    moment = np.divide(load.inertia, len(frames))
    share = Payload(load.mass / len(frames), load.com, moment)
    return joint_inertia(robot.changed(payload=dict.fromkeys(frames, share)))
