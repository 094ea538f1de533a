"""Filters of measurements: a law's memory in addition to its estimates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy import empty

from ._checks import instance, positive
from ._kernels import laws as kernels
from .exceptions import InputError
from .models.delay_compensation import SensedState
from .models.dynamics import Dynamics
from .models.task_kinematics import TaskKinematics
from .robot.constraints import Constraints
from .robot.motors import CommandsUnderway, LateTorque
from .signals import Signals
from .tasks.frame import rotation_between, turned


class Filters:
    """Filters of one law: none, unless a subclass says so.

    Their state is an array or a named tuple of arrays. Sampled, ``step`` takes it from one sample
    to the next; as part of one differential equation, ``rate`` is its derivative.
    """

    def init(self, sensed: SensedState, kinematics: TaskKinematics) -> Any:
        """Return the state at the first sample."""
        return ()

    def observe(self, state: Any, sensed: SensedState, kinematics: TaskKinematics) -> Any:
        """Return the output of the filters at a sample, ``Signals.filtered``.

        Its attribute ``a``, if it has one, is the filtered joint acceleration (n) [rad/s^2, m/s^2].
        """
        return state

    def step(self, state: Any, s: Signals, dt: float) -> Any:
        """Return the state after dt [s] with the signals held."""
        return state

    def rate(self, state: Any, s: Signals) -> Any:
        """Return the time derivative of the state."""
        return state

    def undisturbed(self, state: Any) -> Any:
        """Return the state with no disturbance of the torque, if it holds one."""
        return state


class LowPass:
    """lambda / (lambda + p) with state s: ds/dt = lambda (u - s).

    Its ``rate`` is the filtered derivative of the input, p lambda / (lambda + p) u: no sensor for
    the derivative is needed.

    Attributes:
        bandwidth: lambda [1/s].
    """

    def __init__(self, bandwidth: float, name: str = "lambda") -> None:
        """Take the bandwidth [1/s].

        Raises:
            GainError: not positive.
        """
        self.bandwidth = positive(bandwidth, name)

    def rate(self, state: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return ds/dt for input u, of the state's shape."""
        return self.bandwidth * (u - state)

    def advance(self, state: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
        """Return the state after dt [s] with the input held: exact for any dt."""
        return state - math.expm1(-self.bandwidth * dt) * (u - state)


@dataclass(slots=True, eq=False)
class FilteredMotion:
    """Output of ``MotionFilters``.

    Attributes:
        W_k, y: (m_p, p_k) and (m_p) filtered regressor and velocity, (3)-(4), y without its
            known part; positions only.
        a: (n) filtered joint acceleration.
    """

    W_k: np.ndarray
    y: np.ndarray
    a: np.ndarray


@dataclass(frozen=True, eq=False)
class MotionFilters(Filters):
    """lambda / (lambda + p) on the task velocity and its regressor, p / (lambda_a p + 1) on v.

    The position is affine in the parameters, x = X_k a_k + x_0, so its velocity need not be: with
    the same low pass F on both sides, lambda (1 - F) X_k a_k = lambda (1 - F) (x - x_0) holds for
    samples of any period, as F is linear whatever it makes of them between. In continuous time
    lambda (1 - F) X_k is Y_k through lambda / (lambda + p), as Wang and Xie have it; sampled, that
    would lag behind the difference of positions, by millimetres of a tool.

    The state is one array (m_p p_k + m_p + n), what the low passes let through: Z_k (m_p, p_k) of
    X_k, dx/da_k of the m_p positions, for the filtered kinematic regressor W_k = lambda (X_k -
    Z_k), (3); xi (m_p) of the position less its known part, for y = lambda (x - x_0 - xi), (4) [m];
    z (n) of the joint velocity, for the joint acceleration.

    Attributes:
        task_velocity: bandwidth of the low pass lambda of (3)-(4) [1/s].
        joint_velocity: 1 / lambda_a, bandwidth of that behind the acceleration [1/s].
    """

    task_velocity: float
    joint_velocity: float

    def init(self, sensed: SensedState, kinematics: TaskKinematics) -> np.ndarray:
        """Return the filters at rest, in the middle of what they pass: W_k and y are zero."""
        x: Any = sensed.x
        kinematics.update(kinematics.initial, sensed.q, sensed.v)
        X_k = kinematics.X_k
        d = x[: kinematics.positions] - kinematics.p_hat + X_k.dot(kinematics.a_k)
        return np.concatenate([X_k.ravel(), d, sensed.v])

    def observe(
        self, state: np.ndarray, sensed: SensedState, kinematics: TaskKinematics
    ) -> FilteredMotion:
        """Return filtered regressor, task velocity and joint acceleration, (3)-(4).

        Raises:
            InputError: the state of other filters.
        """
        if state.__class__ is np.ndarray and state.ndim == 1:
            X_k = kinematics.X_k
            p_hat = kinematics.p_hat
            x: Any = sensed.x
            W_k = empty(X_k.shape)
            y = empty(p_hat.size)
            a = empty(kinematics.nv)
            if kernels.filtered_rates(
                state, X_k, p_hat, kinematics.a_k, x, self.task_velocity,
                sensed.v, self.joint_velocity, W_k, y, a,
            ):  # fmt: skip
                return FilteredMotion(W_k, y, a)
        raise InputError("the filters are those of another controller.", where="state")

    def step(self, state: np.ndarray, s: Signals, dt: float) -> np.ndarray:
        """Return the state after dt [s] with X_k, x - x_0 and v held: exact for any dt."""
        filtered = s.filtered
        after = empty(state.size)
        kernels.advance(
            state, filtered.W_k, filtered.y, filtered.a,
            self.task_velocity, self.joint_velocity, dt, after,
        )  # fmt: skip
        return after

    def rate(self, state: np.ndarray, s: Signals) -> np.ndarray:
        """Return the time derivative of the state."""
        filtered = s.filtered
        return np.concatenate([filtered.W_k.ravel(), filtered.y, filtered.a])


class ObserverState(NamedTuple):
    """State of the observer.

    Attributes:
        memory: (m_p + 1) observed position x_o [m], less what the velocity at the end of the last
            step adds; and for how long it adds [s], half of that step, the lead not counted.
        s_f: (n) low-passed error of the joint velocity [rad/s or m/s]; empty where it is not used.
        disturbance: (n) low-passed prediction error of the torque [N m or N].
        R: (4) observed orientation, a quaternion xyzw, less the same; empty: none is observed.
    """

    memory: np.ndarray
    s_f: np.ndarray
    disturbance: np.ndarray
    R: np.ndarray


class ObservedPosition(NamedTuple):
    """Output of ``PositionObserver``.

    Attributes:
        dx_o: (m_p) x_o - x, observed minus measured [m].
        s_f: (n) low-passed error of the joint velocity [rad/s or m/s]; empty where it is not used.
        disturbance: (n) low-passed prediction error of the torque [N m or N]: for a true model the
            torque that others apply, of its sign.
        eta: (3) log(R_o R^T) of observed and measured orientation [rad]; empty: none is observed.
    """

    dx_o: np.ndarray
    s_f: np.ndarray
    disturbance: np.ndarray
    eta: np.ndarray


@dataclass(frozen=True, eq=False)
class PositionObserver(Filters):
    """dx_o/dt = J_hat qd - beta (x_o - x), H. Wang, IEEE TAC 62 (2017) 948-954.

    Sampled, x_o moves by the mean of the estimated velocities at both ends of a period, the later
    one as soon as it is known, and by the share 1 - exp(-beta dt) to x: its error falls with the
    square of the period. By the earlier velocity alone it would lag by dt |xdd| / (2 beta), some
    thousandths of a millimetre on a circle of 0.1 m in 3 s.

    A joint velocity behind a low pass of bandwidth lambda is late by 1 / lambda, and x_o would lag
    by |xdd| / (lambda beta). The integral of the velocity v before the low pass is that of v_f
    behind it plus v_f / lambda, so x_o is ahead of its integral by ``lead`` times J_hat v_f: it
    lags by |dJ/dt qd| / (lambda beta) only.

    Where the axes of x are unknown, an orientation R_o is observed in the same way, with the
    angular velocity omega_hat - beta eta, omega_hat = J_hat qd of the rotation rows and eta =
    log(R_o R^T). R may be that of a marker which is turned on the tool.

    Beside it runs the low pass lambda_d / (lambda_d + p) on the prediction error of the torque,
    W a_hat - y. With the true parameters it is the torque that others apply to the joints, of its
    sign: it tends to a constant one, which the law subtracts.

    Attributes:
        beta: [1/s].
        error: returns s (n) of the law, to be low-passed; None for no such filter.
        bandwidth: of this low pass [1/s].
        lead: 1 / lambda of the joint velocity's low pass [s], zero without one.
        lambda_d: of the low pass on the prediction error of the torque [1/s].
        orientation: whether R_o is observed.
    """

    beta: float
    error: Callable[[Signals], np.ndarray] | None = None
    bandwidth: float = math.inf
    lead: float = 0.0
    lambda_d: Any = 0.0
    orientation: bool = False

    def init(self, sensed: SensedState, kinematics: TaskKinematics) -> ObserverState:
        """Return the observer at the first measured position."""
        m = kinematics.positions
        n = kinematics.nv
        x = np.asarray(sensed.x)
        kinematics.update(kinematics.initial, sensed.q, sensed.v)
        ahead = self.lead * kinematics.xd_hat
        memory = np.append(x[:m] - ahead[:m], 0.0)
        R = turned(x[3:], -ahead[3:]) if self.orientation else np.zeros(0)
        s_f = np.zeros(0 if self.error is None else n)
        return ObserverState(memory, s_f, np.zeros(n), R)

    def observe(
        self, state: ObserverState, sensed: SensedState, kinematics: TaskKinematics
    ) -> ObservedPosition:
        """Return the error of the observation.

        Raises:
            InputError: the state of other filters.
        """
        m = kinematics.positions
        n = kinematics.nv
        x: Any = sensed.x
        if (
            state.__class__ is not ObserverState
            or state.memory.size != m + 1
            or state.s_f.size != (0 if self.error is None else n)
            or state.disturbance.size != n
        ):
            raise InputError("the filters are those of another controller.", where="state")
        memory, s_f, disturbance, R = state
        dx_o = empty(m)
        eta = R
        kernels.observed(memory, self.lead, kinematics.xd_hat, x, dx_o)
        if R.size:
            R_o = turned(R, (memory[-1] + self.lead) * kinematics.xd_hat[3:])
            eta = rotation_between(R_o, x[3:])
        return ObservedPosition(dx_o, s_f, disturbance, eta)

    def step(self, state: ObserverState, s: Signals, dt: float) -> ObserverState:
        """Return the state after dt [s]."""
        (memory, s_f, disturbance, R), after = state, empty(state.memory.size)
        kernels.carry(memory, s.xd_hat, s.filtered.dx_o, self.beta, dt, after)
        if self.error is not None:
            s_f = s_f - math.expm1(-self.bandwidth * dt) * (self.error(s) - s_f)
        if s.residual is not None:
            share = -np.expm1(-self.lambda_d * dt)
            disturbance = disturbance + share * (s.residual - disturbance)
        if R.size:
            R = turned(R, (memory[-1] + 0.5 * dt) * s.xd_hat[3:])
            R = turned(R, math.expm1(-self.beta * dt) * s.filtered.eta)
        return ObserverState(after, s_f, disturbance, R)

    def undisturbed(self, state: ObserverState) -> ObserverState:
        """Return the state with a disturbance of zero."""
        return state._replace(disturbance=np.zeros(state.disturbance.size))

    def rate(self, state: ObserverState, s: Signals) -> ObserverState:
        """Return dx_o/dt (m_p), ds_f/dt (n), the rate of the disturbance (n) and dR_o/dt.

        The last one is half of (omega_o, 0) times R_o.
        """
        dx_o = s.filtered.dx_o
        s_f = state.s_f
        R = state.R
        if self.error is not None:
            s_f = self.bandwidth * (self.error(s) - s_f)
        moved = np.zeros(state.memory.size)
        grown = np.zeros(state.disturbance.size)
        moved[: dx_o.size] = s.xd_hat[: dx_o.size] - self.beta * dx_o
        if s.residual is not None:
            grown = self.lambda_d * (s.residual - state.disturbance)
        if R.size:
            omega = s.xd_hat[3:] - self.beta * s.filtered.eta
            R = 0.5 * np.append(R[3] * omega + np.cross(omega, R[:3]), -omega @ R[:3])
        return ObserverState(moved, s_f, grown, R)


Free: TypeAlias = tuple[np.ndarray, np.ndarray] | tuple[()]


class TorqueFilterState(NamedTuple):
    """State of the filters; the last column belongs to the known part of the torque.

    Attributes:
        Z: (n, p + 1) low-passed lambda Y_M - Y_0, as it was before the last step.
        y: (n) low-passed torque.
        u: (n, p + 1) lambda Y_M - Y_0 that was held over the last step.
        tau: (n) torque that was held over it.
        shares: (2) that are still to come: of a change of u over it; and of a change of tau, which
            is also that of u - Z.
        underway: what declared motors have in hand; nothing where none are late.
        free: under constraints the projection P (n, n), see ``Constraints.free``, and which rows of
            A hold (k); else nothing.
    """

    Z: np.ndarray
    y: np.ndarray
    u: np.ndarray
    tau: np.ndarray
    shares: np.ndarray
    underway: CommandsUnderway | tuple[()] = ()
    free: Free = ()

    def projected(self, tau: np.ndarray) -> np.ndarray:
        """Return P tau (n), or tau where there are no constraints."""
        return self.free[0].dot(tau) if self.free else tau


class FilteredTorque(NamedTuple):
    """Output of the filters at one instant: W a = y at the true parameters a.

    Attributes:
        W: (n, p) filtered regressor.
        y: (n) filtered torque without its known part [N m or N].
        state: the filters' memory at this instant.
        bandwidth: lambda of the low pass [1/s].
    """

    W: np.ndarray
    y: np.ndarray
    state: TorqueFilterState
    bandwidth: float

    def error(self, a_d: np.ndarray) -> np.ndarray:
        """Return the prediction error W a_d - y (n) [N m or N] of an estimate a_d (p)."""
        return self.W.dot(a_d) - self.y


class FilteredRegressor:
    """W (n, p) and y (n) with W a_d = y at the true parameters, from q, qd and torque alone.

    The torque is affine in the parameters, M qdd + C qd + g + friction = Y a_d + tau_0, but its
    regressor needs qdd. Through F = lambda / (p + lambda) it does not: with the momentum form
    tau = d/dt (Y_M a_d) + Y_0 a_d (see ``Regressor``) and F p = lambda (1 - F),

        W = F Y = lambda Y_M - F (lambda Y_M - Y_0),        y = F (tau - tau_0).

    All filters start such that W and y are zero, so W a_d = y holds from the first instant, with no
    term that decays. As one differential equation it is exact. Sampled, the torque is taken as held
    over each period, which is what a controller does, and the rest as piecewise linear: the error
    falls with the square of the period, but where Coulomb friction turns around within one.

    Any ``Dynamics`` will do: bodies, a basis, lumped parameters, coefficients of the joints.

    Under constraints A v = 0 their forces A^T f are unknown, but P A^T = 0 with P = I - A^+ A, so
    that P tau = d/dt (P Y_M a_d) + (P Y_0 - dP/dt Y_M) a_d has the same form. Where feet begin or
    cease to stand, the filters start anew.

    J.-J. Slotine, W. Li, *Composite adaptive control of robot manipulators*, Automatica 25 (1989)
    509-519.

    Attributes:
        dynamics: of the parameters; the estimate loaded into it does not matter.
        low_pass: F, of bandwidth lambda [1/s].
        motors: that apply a torque later than it is commanded, or None.
        constraints: of the robot, or None.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        bandwidth: float,
        motors: LateTorque | None = None,
        constraints: Constraints | None = None,
    ) -> None:
        """Take the dynamics, the bandwidth lambda [1/s], motors that are late, and constraints.

        Raises:
            GainError: the bandwidth is not positive.
            InputError: no dynamics.
        """
        self.dynamics: Dynamics = instance(dynamics, Dynamics, "dynamics")
        self.low_pass = LowPass(bandwidth, "prediction filter")
        self.motors = motors
        self.constraints = constraints

    def init(
        self, q: np.ndarray, v: np.ndarray, stands: np.ndarray | None = None
    ) -> TorqueFilterState:
        """Return the state at the first q (nq), v (n), at which W and y are zero.

        ``stands`` (c) says which contacts stand; None: all.
        """
        fast, u, free = self._inputs(q, v, stands)
        y, tau = np.zeros((2, v.size))
        return TorqueFilterState(fast, y, u, tau, np.zeros(2), (), free)

    def _inputs(
        self, q: np.ndarray, v: np.ndarray, stands: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray, Free]:
        """Return lambda Y_M and lambda Y_M - Y_0 (n, p + 1), projected, and the projection.

        The known parts are the last column.
        """
        Y_M, Y_0, p_0, tau_0 = self.dynamics.momentum(q, v)
        M = np.concatenate([Y_M, p_0[:, None]], axis=1)
        F = np.concatenate([Y_0, tau_0[:, None]], axis=1)
        free: Free = ()
        if self.constraints is not None:
            M, F, P = self.constraints.project_momentum(M, F, q, v, stands)
            free = P, self.constraints.holding(stands)
        fast = self.low_pass.bandwidth * M
        return fast, fast - F, free

    def observe(
        self,
        state: TorqueFilterState,
        q: np.ndarray,
        v: np.ndarray,
        tau: np.ndarray | None = None,
        stands: np.ndarray | None = None,
    ) -> FilteredTorque:
        """Return W and y at q (nq), v (n).

        Args:
            state: from ``init`` or ``step``.
            q: (nq) configuration now.
            v: (n) joint velocity now [rad/s or m/s].
            tau: (n) measured torque of the joints over the last period [N m or N]; None: what
                ``step`` was given.
            stands: (c) which contacts stand; None: all.

        Raises:
            InputError: the state of another filter.
        """
        fast, u, free = self._inputs(q, v, stands)
        if state.__class__ is not TorqueFilterState or state.Z.shape != u.shape:
            raise InputError(
                "the filters are those of other dynamics.",
                where="state",
                hint="Of a recorded run only the last state has them.",
            )
        if free and state.free and not np.array_equal(free[1], state.free[1]):
            state = self.init(q, v, stands)._replace(underway=state.underway)
        Z_before, y, before, held, (share_u, share_tau), underway, _ = state
        Z = Z_before + share_tau * (before - Z_before) + share_u * (u - before)
        W = fast - Z
        if tau is not None:
            y = y + share_tau * state.projected(tau - held)
            held = tau
        if free:
            y = y + share_u * (free[0].dot(held) - state.projected(held))
        now = TorqueFilterState(Z, y, u, held, np.zeros(2), underway, free)
        return FilteredTorque(W[:, :-1], y - W[:, -1], now, self.low_pass.bandwidth)

    def step(self, now: FilteredTorque, tau: np.ndarray, dt: float) -> TorqueFilterState:
        """Return the state after dt [s], over which the torque tau (n) [N m or N] is held."""
        Z, y, u, _, _, underway, free = now.state
        if self.motors is not None and dt > 0.0:
            tau, underway = self.motors.mean(underway or None, tau, dt)
        # the share of the way to an input that is held for dt, or that changes linearly
        x = self.low_pass.bandwidth * dt
        share = -math.expm1(-x)
        shares = np.array([1.0 - share / x if x > 0.0 else 0.0, share])
        y = y + share * (now.state.projected(tau) - y)
        return TorqueFilterState(Z, y, u, tau, shares, underway, free)

    def rate(self, now: FilteredTorque, tau: np.ndarray) -> TorqueFilterState:
        """Return the time derivative of the state at the torque tau (n), as part of an ODE."""
        Z, y, u, held, shares, _, free = now.state  # nothing is underway without steps
        return TorqueFilterState(
            self.low_pass.rate(Z, u),
            self.low_pass.rate(y, now.state.projected(tau)),
            0.0 * u,
            0.0 * held,
            0.0 * shares,
            (),
            (0.0 * free[0], 0.0 * free[1]) if free else (),
        )
