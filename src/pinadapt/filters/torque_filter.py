"""Torque and regressor through one low pass: the prediction error of a motion, without q̈."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .._checks import instance, numbers
from ..exceptions import InputError
from ..models.dynamics import Dynamics
from .filters import LowPass


class TorqueFilterState(NamedTuple):
    """What the filters remember; the last column belongs to the known part of the torque.

    Attributes:
        Z: (n, p + 1) low-passed lambda Y_M - Y_0.
        y: (n) low-passed torque.
        u: (n, p + 1) lambda Y_M - Y_0 that was held over the last step.
        tau: (n) torque that was held over it.
        shares: (2) of a change of u and of tau over it that are still to come.
    """

    Z: np.ndarray
    y: np.ndarray
    u: np.ndarray
    tau: np.ndarray
    shares: np.ndarray


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
        return np.asarray(self.W.dot(a_d) - self.y)


class FilteredRegressor:
    """W (n, p) and y (n) with W a_d = y at the true parameters, from q, qd and torque alone.

    The torque is affine in the parameters, M qdd + C qd + g + friction = Y a_d + tau_0, but its
    regressor needs qdd. Through F = lambda / (p + lambda) it does not: with the momentum form
    tau = d/dt (Y_M a_d) + Y_0 a_d (see ``MomentumRegressor``) and F p = lambda (1 - F),

        W = F Y = lambda Y_M - F (lambda Y_M - Y_0),        y = F (tau - tau_0).

    All filters start such that W and y are zero, so W a_d = y holds from the first instant, with no
    term that decays. As one differential equation it is exact. Sampled, the torque is taken as held
    over each period, which is what a controller does, and the rest as piecewise linear: the error
    falls with the square of the period, but where Coulomb friction turns around within one.

    Any ``Dynamics`` will do: bodies, a basis, lumped parameters, coefficients of the joints.

    J.-J. Slotine, W. Li, *Composite adaptive control of robot manipulators*, Automatica 25 (1989)
    509-519.

    Attributes:
        dynamics: of the parameters; the estimate loaded into it does not matter.
        low_pass: F, of bandwidth lambda [1/s].
    """

    def __init__(self, dynamics: Dynamics, bandwidth: float) -> None:
        """Take the dynamics and the bandwidth lambda [1/s].

        Raises:
            GainError: the bandwidth is not positive.
            InputError: no dynamics.
        """
        self.dynamics = instance(dynamics, Dynamics, "dynamics")
        self.low_pass = LowPass(bandwidth, "prediction filter")

    def init(self, q: np.ndarray, v: np.ndarray) -> TorqueFilterState:
        """Return the state at the first q (nq), v (n), at which W and y are zero."""
        Y_M, u = self._inputs(q, v)
        n = v.size
        Z = self.low_pass.bandwidth * Y_M
        return TorqueFilterState(Z, np.zeros(n), u, np.zeros(n), np.zeros(2))

    def observe(
        self,
        state: TorqueFilterState,
        q: np.ndarray,
        v: np.ndarray,
        tau: np.ndarray | None = None,
    ) -> FilteredTorque:
        """Return W and y at q (nq), v (n).

        Args:
            state: from ``init`` or ``step``.
            q: (nq) configuration now.
            v: (n) joint velocity now [rad/s or m/s].
            tau: (n) measured torque of the joints over the last period [N m or N]; None: what
                ``step`` was given.

        Raises:
            InputError: the state of another filter.
        """
        Y_M, u = self._inputs(q, v)
        if state.__class__ is not TorqueFilterState or state.Z.shape != u.shape:
            raise InputError("the filters are those of other dynamics.", where="state")
        Z, y, before, held, (share_u, share_tau) = state
        Z = Z + share_u * (u - before)
        if tau is not None:
            y, held = y + share_tau * (tau - held), tau
        W = self.low_pass.bandwidth * Y_M - Z
        now = TorqueFilterState(Z, y, u, held, np.zeros(2))
        return FilteredTorque(W[:, :-1], y - W[:, -1], now, self.low_pass.bandwidth)

    def step(self, now: FilteredTorque, tau: np.ndarray, dt: float) -> TorqueFilterState:
        """Return the state after dt [s], over which the torque tau (n) [N m or N] is held."""
        Z, y, u, _, _ = now.state
        x = self.low_pass.bandwidth * dt
        share = -math.expm1(-x)
        shares = np.array([1.0 - share / x if x > 0.0 else 0.0, share])
        return TorqueFilterState(Z + share * (u - Z), y + share * (tau - y), u, tau, shares)

    def rate(self, now: FilteredTorque, tau: np.ndarray) -> TorqueFilterState:
        """Return the time derivative of the state at the torque tau (n), as part of an ODE."""
        Z, y, u, held, shares = now.state
        return TorqueFilterState(
            self.low_pass.rate(Z, u),
            self.low_pass.rate(y, tau),
            np.zeros(u.shape),
            np.zeros(held.shape),
            np.zeros(shares.shape),
        )

    def along(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, tau: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return W (N, n, p) and y (N, n) of a recorded motion of N samples.

        Args:
            t: (N) times [s], ascending.
            q: (N, nq) configurations.
            v: (N, n) joint velocities [rad/s or m/s].
            tau: (N, n) torques [N m or N], each held until the next sample.

        Raises:
            InputError: arrays that do not belong together, or times that do not ascend.
        """
        t, q, v, tau = (
            numbers(given, name)
            for given, name in zip((t, q, v, tau), ("t", "q", "v", "tau"), strict=True)
        )
        if t.ndim != 1 or not t.size or any(len(part) != t.size for part in (q, v, tau)):
            raise InputError("expected N times with N rows of q, v and tau.", where="t")
        if v.ndim != 2 or v.shape != tau.shape or q.ndim != 2:
            raise InputError("expected one row of numbers a sample.", where="v")
        steps = np.diff(t)
        if not (steps > 0.0).all():
            raise InputError("the times must ascend.", where="t")
        state, found = self.init(q[0], v[0]), []
        for k in range(t.size):
            now = self.observe(state, q[k], v[k])
            found.append(now)
            if k < steps.size:
                state = self.step(now, tau[k], float(steps[k]))
        return np.array([now.W for now in found]), np.array([now.y for now in found])

    def _inputs(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_M and lambda Y_M - Y_0 (n, p + 1), the known parts in the last column."""
        Y_M, Y_0, p_0, tau_0 = self.dynamics.momentum(q, v)
        n, p = Y_M.shape
        momentum, u = np.empty((n, p + 1)), np.empty((n, p + 1))
        momentum[:, :p], momentum[:, p] = Y_M, p_0
        np.multiply(momentum, self.low_pass.bandwidth, out=u)
        u[:, :p] -= Y_0
        u[:, p] -= tau_0
        return momentum, u
