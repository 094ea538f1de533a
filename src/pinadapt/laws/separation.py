"""The separation law: kinematics learned from the position, dynamics from the joints."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from numpy import empty

from .._checks import definite_matrix, positive
from .._kernels import laws as kernels
from ..adaptation.adaptation import Drive, Drives
from ..exceptions import REFUSED, ArrayError, GainError
from ..filters import PoseObserver, PositionObserver
from ..models.typical_motion import TypicalMotion, joint_inertia
from ..robot.changes import Payload
from ..robot.robot import Robot
from ..signals import Signals
from ..tasks.frame import rotation_drift
from ..tasks.task import JointTask, Task
from .law import (
    Command,
    EstimatedModel,
    Feedback,
    KinematicLoop,
    Law,
    Truth,
    check_in_place,
    merged,
)
from .posture import Posture

_DAMPING, _STEP = 3.0, 0.5  # K_v in bandwidths times inertia; at most this times inertia / dt
_LOAD, _ARM = 0.1, 0.05  # load assumed for K_D: of the robot's mass, of its reach off the flange
_HEAVY = 0.3  # of the robot's mass: the load assumed where a large error shows that there is one
_CARRIED, _MOST = 0.05, 2.5  # for late motors: least inertia, of the load's; most, of the joint's
_EAGER = 3.0  # times the delay of the motors, during which a ringing does not grow
_FAR, _TURNED = 0.01, 0.06  # errors that are large: of the reach, and [rad]
_MARGIN = 3.0  # lag over the time by which the torques may be late
_PATIENCE = 8.0  # by which beta is divided at most where torques are late by much
_DISAGREE = 6e-4  # of the reach: the error of the observation from which on it is
_UNKNOWN = 1.0  # [s] after the start, during which an unannounced load may act
_PUSH = 2.0  # times the damping, more for a joint behind a shortened reference
_OBSERVER = 1.0  # beta in bandwidths
_LEVER = 0.25  # of the reach; with all of it, late noisy frames disturb the start
_FAST = 0.5  # Y_fast in parts of the largest norm of a typical motion
_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Separation(Law):
    """Separation of kinematic and dynamic adaptation, after H. Wang, IEEE TAC 62 (2017) 948-954.

    The kinematic estimate converges whatever the torque does, the dynamic one whatever the camera
    does. Added to Wang's law is the prediction error of the position itself, epsilon.

    Law:          tau = Y(q, qd, qd_r, qdd_r) a_d - K_D s, s = qd - qd_r,
                  qd_r = J_hat^+ (xd_d - alpha (x_o - x_d)) + N psi, qdd_r its exact derivative,
                  dx_o/dt = J_hat qd - beta dx_o, dx_o = x_o - x.
    Adaptation:   da_d/dt = -Gamma_d Y^T s; da_k/dt = -Gamma_k (c Y_k^T dx_o + X_k^T R epsilon),
                  epsilon = x_hat(q; a_k) - x = X_k da_k, as x is affine in the translations.
    Closed loop:  M ds/dt + C s = -K_D s + Y da_d; d(dx_o)/dt = Y_k da_k - beta dx_o;
                  d(x_o - x_d)/dt = -alpha (x_o - x_d) + J_hat s - beta dx_o.
    V:            s^T M s / 2 + D_d(a_d) + c dx_o^T dx_o / 2 + D_k(a_k),
                  dV/dt = -s^T K_D s - s^T (f(qd) - f(qd_r)) - c beta dx_o^T dx_o
                  - epsilon^T R epsilon, f the true friction of the joints: monotone. The first two
                  terms and the last two each belong to a V of their own.
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
                  dominates what is left out. dV/dt is then no equality.
    Joints:       nothing is observed or predicted: Slotine and Li's law with this K_D.
    Assumptions:  constant parameters; J_hat of full row rank. Needed are q, qd and x: no task
                  velocity, no acceleration, no M_hat^-1.

    Default gains for the bandwidth w at the period dt: alpha = w, beta = w, K_v = 3 w diag(M) at
    home, with an assumed load of a tenth of the robot's mass a twentieth of its reach off the
    flange, and lag = 2 dt, but zero for a K_v of the user's own. What joints move together may be
    much lighter than what each moves by itself, as the elbow of an arm whose shoulder axes align.
    Beside an adaptation with a memory, which needs no fast loop, the feedback is for motors that
    are late by 10 ms, see ``tolerant``.

    Attributes:
        task: the controlled coordinates, m of them, m_p positions.
        posture: what redundant joints do.
        K_v: (n, n) K_D [N m s/rad or N s/m], or what it is at most; see ``lag``.
        alpha: [1/s].
        beta: [1/s], or what it is at most; see ``patience``.
        c: weight of the observation error; zero by default for pictures.
        R_k: (m_p, m_p) R, weight of the prediction error.
        lambda_s: decorrelation [1/s], infinite for none.
        lag: [s], with which K_D(q)^-1 = K_v^-1 + lag M_0(q)^-1: no eigenvalue of M_0^-1 K_D then
            exceeds 1 / lag, at no configuration. Zero: K_D = K_v.
        M_0: returns the nominal mass matrix (n, n) at q (nq), where there is a lag.
        late: [s], a longer lag for motors that may be late by so much: K_D^-1 = K_v^-1 + R^-1 with
            R = M_0 / late + diag(carried). Until 3 late after the start R is M_0 / lag, and goes
            over within another 3 late; not at all where a joint has a part of ``carried``. In the
            first two seconds a large task error takes it back, and so do torques that are known to
            be in time, see ``tolerant``. Zero: R stays M_0 / lag.
        far: (m) one over the task errors that are large [1/m or 1/rad].
        K_far: (n, n) in place of K_v while such an error takes the shorter lag back [N m s/rad or
            N s/m]; None: K_v.
        carried: (n) for joints that are light beside the assumed load, see ``tolerant`` [N m s/rad
            or N s/m].
        patience: by which beta is divided at most where torques may be late by more than a third
            of ``late`` and joints and position disagree, as on springs; see ``PositionObserver``.
        near: |x_o - x| from which on it is wholly divided [m].
        lead: the time by which a low pass delays qd [s], see ``PositionObserver``.
        Y_fast: norm of Y_k beyond which c is scaled down with its square, sigma = min(1, Y_fast^2 /
            |Y_k|^2): the mode of the kinematic adaptation grows with the speed, and a wrist that an
            unknown load spins would swing the estimate faster than the arm can follow it. With
            sigma c for c in V, dV/dt gains c dsigma/dt dx_o^T dx_o / 2, which the observer's own
            damping outweighs while sigma grows slower than exp(2 beta t). The prediction error,
            which needs no dx_o, goes on.
        speeds: (n) that qd_r keeps [rad/s or m/s], see ``RightInverse.keeping``; None: it is as it
            is. With a governor they are those that the path may ask for. V has the same derivative
            with any differentiable qd_r. What the error asks for beyond it has to wait, and the
            path waits with it. A joint that a load spins the other way is damped up to three times
            as much meanwhile: a term of dV/dt that is not positive.
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
    lag: float = 0.0
    M_0: Callable[[np.ndarray], np.ndarray] | None = None
    late: float = 0.0
    far: Any = 0.0
    K_far: Any = None
    carried: Any = 0.0
    patience: float = 1.0
    near: float = math.inf
    lead: float = 0.0
    Y_fast: float = math.inf
    speeds: np.ndarray | None = None
    lever: float = 0.0

    name = "separation"
    sources = ("Wang2017",)
    uses_position_error = True
    uses_acceleration = False
    velocity_error = True
    keeps_speeds = True
    joint_effects = "all"
    remembers = True
    bandwidth_powers: ClassVar[dict[str, float]] = {"Kv": 1.0, "alpha": 1.0, "lag": -1.0}
    adaptation_mode = 8.0
    memory_mode = 1.75
    joint_mode = 8.0
    kinematic_mode = 0.3
    units = ("N m s/rad", "")

    def __post_init__(self) -> None:
        """Turn gains into matrices.

        Raises:
            GainError: gains that are not positive (definite) or of the wrong size.
        """
        check_in_place(self, "alpha", "beta", "R_k")
        object.__setattr__(self, "lever", positive(self.lever, "lever", zero=True))
        object.__setattr__(self, "c", positive(self.c, "c", zero=True))
        if not (isinstance(self.lambda_s, float) and self.lambda_s == math.inf):
            positive(self.lambda_s, "lambda_s")
        K_D = definite_matrix(self.K_v, self.posture.damping.size, "Kv")
        object.__setattr__(self, "K_v", K_D)
        if positive(self.lag, "lag", zero=True) and self.M_0 is None:
            raise GainError("a lag needs the mass matrix that it belongs to.", where="M_0")
        positive(self.late, "late", zero=True)
        for name, size in (("carried", len(K_D)), ("far", self.task.size)):
            each = np.broadcast_to(np.asarray(getattr(self, name), dtype=float), size).copy()
            object.__setattr__(self, name, each)

    @cached_property
    def filters(self) -> PositionObserver | PoseObserver:
        """The observer of the position, or of the pose."""
        late, patience = (self.late / _MARGIN, self.patience) if self.late else (math.inf, 1.0)
        position = PositionObserver(
            self.beta,
            None if math.isinf(self.lambda_s) else self._reference_error,
            self.lambda_s,
            lead=self.lead,
            late=late,
            patience=patience,
            near=self.near,
        )
        return PoseObserver(position) if self.lever else position

    @cached_property
    def _eager(self) -> float:
        """How long the shorter lag holds at the start [s]: not at all with too light a joint."""
        return 0.0 if self.carried.any() else _EAGER * self.late

    @classmethod
    def tuned(
        cls, motion: TypicalMotion, dt: float, share: float = 1.0, **given: Any
    ) -> Separation:
        """Return the law with its default gains; see ``Law.tuned``."""
        w = share * motion.bandwidth
        defaults = {
            "Kv": _DAMPING * w * _loaded_inertia(motion.robot),
            "alpha": w,
            "beta": _OBSERVER * w,
            "c": 1.0 if motion.kinematics.affine else 0.0,
            "R_k": 1.0,
            "lambda_s": math.inf,
            "lag": dt / _STEP if given.get("Kv") is None else 0.0,
        }
        kinematics = motion.kinematics
        turns = not kinematics.calibrated and kinematics.task.size > kinematics.positions
        posture = Posture.of(motion.robot, given.get("posture"), w)
        patient = given.get("beta") is None and motion.kinematics.affine  # not of a picture
        gains = merged(defaults, given)
        Y_fast = max((np.linalg.norm(Y_p) for Y_p in motion.kinematic_regressors), default=0.0)
        return cls(
            motion.kinematics.task,
            posture,
            M_0=NominalInertia(motion.robot),
            Y_fast=_FAST * float(Y_fast) or math.inf,
            patience=_PATIENCE if patient else 1.0,
            near=_DISAGREE * motion.robot.reach,
            lever=_LEVER * motion.robot.reach if turns else 0.0,
            **gains,
        )

    def K_D(
        self,
        q: np.ndarray,
        age: float = math.inf,
        dx: np.ndarray | None = None,
        lateness: float = math.inf,
    ) -> np.ndarray:
        """Return K_D (n, n) at q (nq), at a time after the start [s] and a task error dx (m).

        Without an error, K_D is that of a small one; without a lateness [s], see ``Estimate``, that
        of torques that may be late.
        """
        if self.M_0 is None or not self.lag:
            return np.asarray(self.K_v)
        K, rate, carried = self._limit(age, dx, lateness)
        R = rate * self.M_0(q) + np.diag(carried)
        return np.linalg.inv(np.linalg.inv(K) + np.linalg.inv(R))

    def _settled_K_D(self, states: np.ndarray) -> np.ndarray:
        """Return K_D (N, n, n) long after the start, at configurations (N, nq)."""
        if self.M_0 is None or not self.lag:
            return np.asarray(self.K_v)
        K, rate, carried = self._limit(math.inf, None, math.inf)
        R = rate * np.array([self.M_0(q).copy() for q in states]) + np.diag(carried)
        return np.linalg.inv(np.linalg.inv(K) + np.linalg.inv(R))

    def _limit(
        self, age: float, dx: np.ndarray | None, lateness: float
    ) -> tuple[np.ndarray, float, np.ndarray]:
        """Return K (n, n), r [1/s] and d (n), at a time after the start [s].

        K_D^-1 = K^-1 + (r M_0 + diag(d))^-1.
        """
        K = self.K_v
        if not self.late:
            return K, 1.0 / self.lag, self.carried
        share, eager = 1.0, self._eager
        if age < 2.0 * eager:
            share = max(0.0, age / eager - 1.0)
        if _MARGIN * lateness < self.late:
            known = max(_MARGIN * lateness, self.lag)
            share *= (1.0 / self.lag - 1.0 / known) / (1.0 / self.lag - 1.0 / self.late)
        if dx is not None and age < 2.0 * _UNKNOWN:
            large = kernels.weighted_norm(self.far, dx) - 1.0
            if large > 0.0:
                large = min(1.0, large) * min(1.0, 2.0 - age / _UNKNOWN)
                share *= 1.0 - large
                if self.K_far is not None:
                    K = K + large * (self.K_far - K)
        carried = self.carried if share == 1.0 else share * self.carried
        return K, (1.0 - share) / self.lag + share / self.late, carried

    def tolerant(self, late: float, robot: Robot) -> Separation:
        """Return the law with the lag ``late`` [s] in place of a shorter one.

        Feedback through motors that are late by T rings where the damping of a joint exceeds about
        its inertia / T. A joint that is much lighter than the load assumed for K_v would be spun by
        such a load before it is learned: its inertia counts as a twentieth of the load's at least,
        but at most as 2.5 times its own. No joint is damped more than with the shorter lag. All
        have that one at the start, when nothing is learned and the errors of the model strike:
        within 3 T a ringing does not grow. Only where a joint counts as heavier than it is, the
        lag is the longer one from the first sample on: that joint rings before 3 T are over.

        A memory of all torques estimates by how much they may be late (``Estimate.lateness``). The
        lag becomes three times that time, but for the bounds ``lag`` and ``late``: short where the
        run itself shows that the torques are in time, long again as soon as anything rings.

        A wrist with an unannounced load may have a hundred times the inertia that the model
        gives it, and its own inertia / T brakes it within seconds only: the load spins it before it
        is learned. An error of the position beyond 1 % of the reach, or of an angle beyond 0.06
        rad, shows that. From twice as much on the shorter lag is back, wholly in the first second
        and less and less until two: later, with the load learned, a large error is rather that of
        an obstacle or of motors at their limits, and the shorter lag would only ring. With it K_v
        becomes that for a load of 30 % of the robot's mass, K_far: the load falls more slowly, and
        the tracking error, which shows the load, exaggerates less. The lag still bounds K_D.

        V does not contain K_D, so that dV/dt is an equality for any K_D(t) > 0, however it moves.
        """
        if not self.lag or late <= self.lag:
            return self
        M = pin.crba(robot.model, robot.model.createData(), robot.q0)
        own, load = 1.0 / np.diag(np.linalg.inv(M)), _loaded_inertia(robot) - np.diag(M)
        counted = np.clip(_CARRIED * load, own, min(_MOST, late / self.lag) * own)
        far = np.full(self.task.size, 1.0 / _TURNED)
        far[: self.task.positions] = 1.0 / (_FAR * robot.reach)
        more = np.sqrt(_loaded_inertia(robot, _HEAVY) / (load + np.diag(M)))
        K_far = more[:, None] * self.K_v * more
        return replace(self, late=late, far=far, K_far=K_far, carried=(counted - own) / late)

    def within(self, speeds: np.ndarray) -> Separation:
        """Return the law with these speeds (n) [rad/s or m/s], unless it has some."""
        return replace(self, speeds=speeds) if self.speeds is None else self

    def of_joints(self, task: JointTask) -> Separation:
        """Return the same feedback with the joints as its task."""
        return replace(self, task=task, R_k=1.0, far=1.0 / _TURNED, patience=1.0, lever=0.0)

    def decorrelated(self, bandwidth: float, lead: float = 0.0) -> Separation:
        """Return the law with another lambda_s [1/s], for a velocity that is late by a lead [s]."""
        return replace(self, lambda_s=bandwidth, lead=lead)

    def with_prediction_weight(self, weight: float) -> Separation:
        """Return the law with another R, a number times the identity."""
        return replace(self, R_k=weight)

    def _observing(self, s: Signals) -> float:
        """Return the present beta [1/s], that of the observer."""
        if not self.late:
            return self.beta
        return kernels.observing(
            self.beta, s.filtered.dx_o, self.near, s.lateness, self.late / _MARGIN, self.patience
        )

    def _reference(self, s: Signals) -> tuple[np.ndarray, np.ndarray]:
        """Return u = xd_d - alpha (x_o - x_d) (m) and du/dt: dx_o/dt is known, xd is not needed.

        In the rows of an orientation its error, measured or observed, stands for x_o - x_d.
        """
        u, ud = empty(s.dx.size), empty(s.dx.size)
        beta, dx, xd, delta = self._observing(s), s.dx, s.xd_hat, s.delta
        if self.lever:
            dx, xd, delta = _turning(s, beta)
        kernels.reference(s.xd_d, dx, s.xdd_d, xd, s.filtered.dx_o, self.alpha, beta, u, ud)
        if delta is not None:
            ud -= self.alpha * delta
        return u, ud

    def _reference_error(self, s: Signals) -> np.ndarray:
        """Return s = qd - qd_r (n)."""
        return np.asarray(s.v - self._reference_velocity(s)[0])

    def _reference_velocity(self, s: Signals) -> tuple[np.ndarray, np.ndarray | None]:
        """Return qd_r (n), and what it lacks to keep the speeds (n), or None where nothing."""
        psi = self.posture.null_motion_unchecked(s)[0]
        free = s.inverse.solve(self._reference(s)[0], psi)
        if self.speeds is None:
            return free, None
        still = np.zeros(free.size)
        none, fixed = None if psi is None else still, np.zeros(s.inverse.J.shape)
        kept = s.inverse.keeping(self.speeds, free, still, psi, none, fixed)[0]
        return kept, None if kept is free else free - kept

    def _push(self, s: Signals, error: np.ndarray, lacking: np.ndarray) -> np.ndarray:
        """Return the torque (n) that a joint behind a shortened reference gets [N m or N].

        It is -d_i min(|s_i|, |lacking_i|) sign(s_i) where both have opposite signs, d_i as K_D for
        the joint alone, twice: more damping only takes from V. Bounded, the reference alone would
        pull less than the whole one does.
        """
        D = np.diag(self.K_v)
        if self.M_0 is not None and self.lag:
            K, rate, carried = self._limit(s.filtered.age, s.dx, s.lateness)
            D = 1.0 / (1.0 / np.diag(K) + 1.0 / (rate * np.diag(self.M_0(s.q)) + carried))
        size = np.minimum(np.abs(error), np.abs(lacking)) * (error * lacking < 0.0)
        return np.asarray(-_PUSH * D * np.copysign(size, error))

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return tau = Y a_d - K_D s, and the drives of both estimates."""
        M_0, limit = None, None
        if self.M_0 is not None and self.lag:
            M_0, limit = self.M_0(s.q), self._limit(s.filtered.age, s.dx, s.lateness)
        u, ud = self._reference(s)
        kinematic = self._kinematic_drive(s)
        a_k_rate = model.adaptation_k.value_rate_unchecked(model.kinematic, kinematic)
        # qd_r = J_hat^+ u + N psi and its derivative, dJ_hat/dt with the moving estimate
        Jdot = model.jacobian_rate(a_k_rate)
        psi, psid = self.posture.null_motion_unchecked(s)
        qd_r, qdd_r = s.inverse.solve_with_rate(u, psi, ud, psid, Jdot)
        free = qd_r
        if self.speeds is not None:
            qd_r, qdd_r = s.inverse.keeping(self.speeds, free, qdd_r, psi, psid, Jdot)
        v, error, torque = s.v, empty(qd_r.size), empty(qd_r.size)
        if s.filtered.s_f.size:  # decorrelated
            noise = v - qd_r - s.filtered.s_f
            v, qdd_r = v - noise, qdd_r + self.alpha * (noise - s.inverse.null(noise))
        # tau = Y(q, qd, qd_r, qdd_r) a_d - K_D s
        Y, feedforward = model.slotine_li(s.q, v, qd_r, qdd_r)
        if M_0 is None or limit is None:
            kernels.subtract_damping(feedforward, self.K_v, s.v, qd_r, error, torque)
        else:
            kernels.subtract_limited_damping(
                feedforward, limit[0], M_0, *limit[1:], s.v, qd_r, error, torque
            )
        if qd_r is not free:
            torque += self._push(s, error, free - qd_r)
        return Command(torque, Drives(Drive(Y, error), kinematic), None, feedforward)

    def _kinematic_drive(self, s: Signals) -> Drive:
        """Return the drive of g_k = sigma c Y_k^T (dx_o, lever eta) + X_k^T R epsilon.

        The rotation rows of Y_k count times the lever, and only where there is one.
        """
        dx_o, epsilon, X_k = s.filtered.dx_o, s.epsilon, s.X_k
        m, p = X_k.shape
        error, g_k, Y_k = empty(m), empty(p), self._weighted(s)
        kernels.observation_drive(
            Y_k, dx_o, self.c, self.Y_fast, X_k, epsilon, self.R_k, error, g_k
        )
        if self.lever:
            turning = self._share(Y_k) * self.c * self.lever * s.filtered.eta
            error, g_k, m = np.append(error, turning), g_k + turning @ Y_k[m:], len(Y_k)
        return Drive(Y_k[:m], error, X_k, epsilon, self.R_k, g_k, observed=True)

    def _weighted(self, s: Signals) -> np.ndarray:
        """Return Y_k (m, p), its rotation rows times the lever if there is one."""
        if not self.lever:
            return s.Y_k
        Y_k: np.ndarray = s.Y_k.copy()
        Y_k[self.task.positions :] *= self.lever
        return Y_k

    def sigma(self, s: Signals) -> float:
        """Return the share of c that counts at this speed."""
        return self._share(self._weighted(s))

    def _share(self, Y_k: np.ndarray) -> float:
        """Return sigma for a weighted Y_k (m, p)."""
        return min(1.0, self.Y_fast**2 / max(float(np.vdot(Y_k, Y_k)), _TINY))

    def storage(self, s: Signals, truth: Truth) -> float:
        """Return s^T M s / 2 + sigma c (dx_o^T dx_o + lever^2 eta^T eta) / 2, M the true one."""
        error = self._reference_error(s)
        return float(0.5 * error @ (truth.M @ error) + 0.5 * self._observation(s))

    def _observation(self, s: Signals) -> float:
        """Return sigma c (dx_o^T dx_o + lever^2 eta^T eta)."""
        dx_o, eta = s.filtered.dx_o, s.filtered.eta
        turning = self.lever**2 * eta @ eta if self.lever else 0.0
        return float(self.sigma(s) * self.c * (dx_o @ dx_o + turning))

    def dissipation(self, s: Signals, truth: Truth) -> float:
        """Return dV/dt, but for what a change of sigma adds."""
        qd_r, lacking = self._reference_velocity(s)
        error, epsilon = s.v - qd_r, s.epsilon
        f = truth.friction.torque
        K_D = self.K_D(s.q, s.filtered.age, s.dx, s.lateness)
        joints = error @ (K_D @ error) + error @ (f(s.v) - f(s.v - error))
        if lacking is not None:
            joints -= error @ self._push(s, error, lacking)
        task = self._observing(s) * self._observation(s) + epsilon @ (self.R_k @ epsilon)
        return float(-joints - task)

    def feedback(self, motion: TypicalMotion) -> Sequence[Feedback]:
        """Return the feedback at each state, joints in coordinates of unit mass.

        The null space follows its reference motion, which feels nothing of it.
        """
        J, M, inverse, W = (
            np.array(each)
            for each in (
                motion.jacobians, motion.mass_matrices, motion.right_inverses, motion.unit_masses
            )
        )  # fmt: skip
        unit = W.swapaxes(1, 2)
        D, tracked = W @ self._settled_K_D(motion.states.q) @ unit, W @ M @ inverse @ J @ unit
        null = self.posture.frequency * (np.eye(M.shape[1]) - tracked)
        K_P, K_D = self.alpha * D @ tracked, D + self.alpha * tracked
        return [Feedback(*each) for each in zip(K_P, K_D, null, D, strict=True)]

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
    delta[3:] = rotation_drift(dx[3:].tolist(), xd[3:].tolist(), s.xd_d[3:].tolist())
    return dx, xd, delta


class NominalInertia:
    """M(q) (nv, nv) of the nominal robot; the adaptation does not change it."""

    def __init__(self, robot: Robot) -> None:
        """Take the robot."""
        self._robot, self._data = robot.undrawn(), robot.model.createData()

    def __call__(self, q: np.ndarray) -> np.ndarray:
        """Return M(q) (nv, nv) at a configuration q (nq); the next call writes to it."""
        try:
            return np.asarray(pin.crba(self._robot.model, self._data, q))
        except REFUSED as error:
            raise ArrayError from error

    def __reduce__(self) -> tuple[type[NominalInertia], tuple[Robot]]:
        """Copy and pickle the robot alone."""
        return NominalInertia, (self._robot,)


def _loaded_inertia(robot: Robot, share: float = _LOAD) -> np.ndarray:
    """Return the inertia (n) that each joint moves with the load assumed for K_D [kg m^2 or kg].

    Args:
        robot: without the load.
        share: the load's mass as a share of the robot's.
    """
    mass, arm = share * pin.computeTotalMass(robot.model), _ARM * robot.reach
    turning = mass * arm**2
    ball = Payload(mass, (0.0, 0.0, 0.0), (turning, 0.0, turning, 0.0, 0.0, turning))
    return joint_inertia(robot.changed(payload=ball))
