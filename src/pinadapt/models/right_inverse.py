"""The right inverse of the estimated Jacobian, damped near singularities, and its null space."""

from __future__ import annotations

import math

import numpy as np
from numpy import empty

from .._kernels import linear_algebra as kernels
from ..exceptions import DivergedError
from ..tasks.task import Moving

# of the speeds: from where on, and at most; no run of the zoo is so fast. Half of _WHOLE: a path
# with a slow lift is lost by 0.1 m; twice: the lift is 14 % too fast; of _NULL: the same tests
_NULL, _WHOLE = (0.45, 0.55), (1.0, 1.06)


class RightInverse:
    """J^+ = J^T (J J^T + diag mu^2)^-1 of a Jacobian J (m, n), m <= n; mu = 0 off singularities.

    A null-space velocity psi enters as r = J^+ u + (I - J^+ J) psi. Without damping J r = u: psi
    has no effect on the task. r is nearest to psi where sum |J_k r - u_k|^2 / mu_k^2 + |r - psi|^2
    is least over the levels k of rows, those with mu_k = 0 being met exactly.

    Damping starts where s = tr((J J^T)^-1)^(-1/2) falls below a threshold s_0. Since s^-2 is the
    sum of all sigma_i^-2, s is at most the smallest singular value, and at least that over sqrt(m);
    it costs nothing, as the solution needs (J J^T)^-1 anyway. Of a single level mu^2 = mu_max^2
    (1 - (s / s_0)^2) as in damped least squares, with mu_max^2 = s_0^2 / 2, the smallest value that
    ensures |J^+| <= 1 / s_0.

    Levels are the rows in their order of priority: constraints, then each task frame. s_k is that
    of what the levels before leave of the rows of level k, and mu_k^2 = mu_{k-1}^2 + mu_max^2 (1 -
    (s_k / s_0)^2), the last term where s_k < s_0. So a level misses nothing for those behind it
    while it and those before it can be met, and never counts less than they do.

    Y. Nakamura, H. Hanafusa, ASME J. Dyn. Syst. Meas. Control 108 (1986) 163-171; S. Chiaverini,
    IEEE T. Robot. Autom. 13 (1997) 398-410; of priorities B. Siciliano, J.-J. Slotine, ICAR 1991,
    1211-1216.

    Attributes:
        J: the Jacobian (m, n), with the rows of A behind those of the task.
        gram_inverse: (J J^T + diag mu^2)^-1 (m, m).
        size: number of rows of the task.
        damping: mu^2 of each row (m).
        conditioning: s.
        unique: whether J^+ is the inverse, so that there is no null space: J square, no damping.
    """

    def __init__(
        self,
        J: np.ndarray,
        threshold: float = 0.0,
        constraints: Moving | None = None,
        levels: np.ndarray | None = None,
    ) -> None:
        """Invert the Jacobian (m, n); ``threshold`` is s_0, zero for no damping.

        Under constraints A r = 0, A (k, n) and dA/dt (k, n), it is that of [J; A], with u zero in
        the rows of A; see ``moving``. ``levels`` (m) are the rows' places in the order of priority
        of the task, floats from 0; None: all alike.

        Raises:
            DivergedError: J has lost rank without damping, or is not finite.
        """
        self.size = len(J)
        self._threshold = threshold
        self._A_rate = None
        self._levels = np.zeros(len(J)) if levels is None else levels
        if constraints is not None:
            A, self._A_rate = constraints
            J = np.concatenate([J, A])
            self._rows = np.zeros(len(A))
            self._rows_rate = self._rows
            if len(A):
                self._levels = np.concatenate([self._levels + 1.0, self._rows])
        m, n = J.shape
        self.J = J
        self.damping = empty(m)
        self.gram_inverse = empty((m, m))
        self.conditioning, lost = kernels.invert_gram(
            J, threshold, self._levels, self.damping, self.gram_inverse
        )
        if lost:
            raise DivergedError(
                "the estimated Jacobian lost rank: the arm is at a singularity of the estimated "
                "kinematics. Keep the path away from the edge of the workspace, start with better "
                "kinematics, or damp the inverse (damping = 0.2)."
            )
        self._damped = self.conditioning < threshold
        self.unique = m == n and not self._damped

    def solve(self, u: np.ndarray, psi: np.ndarray) -> np.ndarray:
        """Return J^+ u + (I - J^+ J) psi (n), u (m), psi (n)."""
        if self._A_rate is not None:
            u = np.concatenate([u, self._rows])
        return psi + self.gram_inverse.dot(u - self.J.dot(psi)).dot(self.J)

    def moving(self, rows: np.ndarray, rate: np.ndarray) -> None:
        """Let A r be ``rows`` (k) in place of zero, and change at ``rate`` (k): feet in the air."""
        self._rows = rows
        self._rows_rate = rate

    def solve_with_rate(
        self,
        u: np.ndarray,
        psi: np.ndarray | None,
        ud: np.ndarray,
        psid: np.ndarray | None,
        Jdot: np.ndarray,
    ) -> Moving:
        """Return r = ``solve(u, psi)`` and dr/dt (n), where u, psi and J change at ud, psid, Jdot.

        With y = (J J^T + diag mu^2)^-1 (u - J psi), so that r = psi + J^T y,
        dr/dt = J^+ (ud - Jdot r - y d(mu^2)/dt) + (I - J^+ J) (psid + Jdot^T y).
        """
        damping_rate = self._damping_rate(Jdot)
        if self._A_rate is not None:
            u = np.concatenate([u, self._rows])
            ud = np.concatenate([ud, self._rows_rate])
            Jdot = np.concatenate([Jdot, self._A_rate])
        if psi is None or psid is None:
            psi = psid = np.zeros(self.J.shape[1])
        missed, y, r, rate = empty(u.size), empty(u.size), empty(psi.size), empty(psi.size)
        kernels.right_inverse_and_rate(
            self.J, self.gram_inverse, u, psi, ud, psid, Jdot, damping_rate, missed, y, r, rate
        )
        return r, rate

    def feedback(
        self,
        speeds: np.ndarray,
        u: np.ndarray,
        ud: np.ndarray,
        u_d: np.ndarray,
        ud_d: np.ndarray,
        Jdot: np.ndarray,
    ) -> Moving:
        """Return u and du/dt (m), the feedback u - u_d shortened to what a damped J^+ can give.

        |J^+| <= 1 / s_0 keeps joints within the speeds (n) for |u| <= s_0 max(speeds), and for
        mu_max^2 / mu^2 as much where the damping begins. Beyond a singularity a larger u gains
        nothing, but multiplies the rate of J^+ u, which is linear in the joint velocity: sampled,
        that rings. Each level is shortened by itself, and none that is not damped.
        """
        if not self._damped:
            return u, ud
        most = 0.5 * self._threshold**3 * speeds.max()  # mu_max^2 s_0 max(speeds)
        mu_2 = self.damping[: self.size]
        fed = u - u_d
        fed_rate = ud - ud_d
        x = mu_2 * fed
        x_rate = self._damping_rate(Jdot)[: self.size] * fed + mu_2 * fed_rate
        levels = self._levels[: self.size]
        for own in (levels == level for level in np.unique(levels)):
            limits = np.full(np.count_nonzero(own), most)
            f, f_rate = _shortening(limits, *_WHOLE, x[own], x_rate[own])
            fed_rate[own] = f * fed_rate[own] + f_rate * fed[own]
            fed[own] *= f
        return u_d + fed, ud_d + fed_rate

    def keeping(
        self,
        speeds: np.ndarray,
        r: np.ndarray,
        rate: np.ndarray,
        psi: np.ndarray | None,
        psid: np.ndarray | None,
        Jdot: np.ndarray,
    ) -> Moving:
        """Return r and dr/dt (n) of ``solve_with_rate``, shortened smoothly to speeds (n).

        First the null motion (I - J^+ J) psi, which the damping near a singularity lets reach the
        task, to at most 0.55 of the speeds, from 0.45 on; then r as a whole to at most 1.06, from 1
        on. Both keep their directions; r itself is returned where both are slow enough.
        """
        if psi is not None and psid is not None:
            null = self.null(psi)
            if kernels.largest_share(null, speeds) > _NULL[0]:
                still = np.zeros(self.size)
                null, null_rate = self.solve_with_rate(still, psi, still, psid, Jdot)
                feet, feet_rate = self.solve_with_rate(still, None, still, None, Jdot)
                null -= feet  # in the air, which move with ``rows``
                null_rate -= feet_rate
                short, short_rate = bound_smoothly(speeds, *_NULL, null, null_rate)
                r = r - null + short
                rate = rate - null_rate + short_rate
        return bound_smoothly(speeds, *_WHOLE, r, rate)

    def null(self, z: np.ndarray) -> np.ndarray:
        """Return (I - J^+ J) z (n), without damping the projection onto the null space."""
        if self.unique:
            return np.zeros(z.size)
        return z - self.gram_inverse.dot(self.J.dot(z)).dot(self.J)

    def _damping_rate(self, Jdot: np.ndarray) -> np.ndarray:
        """Return d(mu^2)/dt of all rows for dJ/dt (m, n) of those of the task.

        What the levels before leave of those behind is S = E^T (J J^T + diag mu^2) E, mu = 0 in its
        own rows, with E = I there and, in the rows before, minus what they do for it. mu_k^2 grows
        by -d(s_k^2)/dt / 2 = -sum_i (s_k^2 / lambda_i)^2 dlambda_i/dt / 2, lambda_i the eigenvalues
        of S.
        """
        if not self._damped:
            return self.damping
        if self._A_rate is not None:
            Jdot = np.concatenate([Jdot, self._A_rate])
        rate = np.zeros(len(self.J))
        total = 0.0
        above = 0.0
        gram = self.J @ self.J.T
        gram_rate = Jdot @ self.J.T
        gram_rate += gram_rate.T
        for level in np.unique(self._levels):
            before = self._levels < level
            own = self._levels == level
            mu_2 = self.damping[own][0]
            if mu_2 > above:
                E = np.eye(len(self.J))[:, own]
                D = np.diag(np.where(before, self.damping, 0.0))
                E[before] = -np.linalg.solve(
                    (gram + D)[np.ix_(before, before)], gram[before][:, own]
                )
                values, U = np.linalg.eigh(E.T @ (gram + D) @ E)
                values = np.maximum(values, np.finfo(float).eps * values[-1])
                ratios = 1.0 / (values * np.sum(1.0 / values))  # s^2 / lambda_i
                E = E @ U
                total -= 0.5 * ratios**2 @ np.einsum("ij,ij->j", E, (gram_rate + np.diag(rate)) @ E)
            rate[own] = total
            above = mu_2
        return rate


def bound_smoothly(
    limits: np.ndarray, knee: float, most: float, x: np.ndarray, rate: np.ndarray
) -> Moving:
    """Return x (n), shortened so that |x_i| < most limits_i, and its rate (n) changed with it.

    Both are as given where ``_shortening`` is one.
    """
    f, f_rate = _shortening(limits, knee, most, x, rate)
    return (x, rate) if f == 1.0 else (f * x, f * rate + f_rate * x)


def _shortening(
    limits: np.ndarray, knee: float, most: float, x: np.ndarray, rate: np.ndarray
) -> tuple[float, float]:
    """Return the factor by which x (n) is shortened to |x_i| < most limits_i, and its rate.

    It is one up to r = knee, r the norm of x / limits with the eighth power, which is slightly
    above the largest entry. Beyond, it is g(r) / r, with g = knee + w tanh((r - knee) / w), w =
    most - knee: twice continuously differentiable.
    """
    r = kernels.largest_share(x, limits)
    if r <= knee:
        return 1.0, 0.0
    width = most - knee
    slope = ((x / limits / r) ** 7).dot(rate / limits)  # dr/dt
    t = math.tanh((r - knee) / width)
    f = (knee + width * t) / r
    return f, (1.0 - t * t - f) * slope / r
