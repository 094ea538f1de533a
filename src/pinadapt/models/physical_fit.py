"""Least squares in the physical cone, regularised towards the description.

    minimise  |S^-1/2 (W a - y)|^2 / 2 + gamma (sum_b D(P_b, P_b0) + sum_j w_j D(c_j, c_j0)),

P_b the pseudo-inertia of body b, c_j > 0 the coefficients of the joints, and

    D(P, P_0) = tr(P_0^-1 P) - log det(P_0^-1 P) - dim P

the Bregman divergence of -log det. It does not depend on coordinates, units or frames. It is
infinite on the border of the cone, so the estimate is always physical, and it is convex, so there
is one minimum. It is the entropic divergence between two mass distributions of T. Lee, P. M.
Wensing, F. C. Park, *Geometric robot dynamic identification: a convex programming approach*, IEEE
Trans. Robotics 36 (2020) 348-365. The objective is self-concordant, so Newton's method with a line
search finds the minimum. gamma falls to its value in steps of three, from where the description
outweighs the rows: after steps of ten Newton's method needs hundreds of steps where a body is
nearly at the border of the cone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .._checks import ROUNDING
from ..exceptions import ParameterError
from ..robot.robot import Robot
from .bodies import COEFFICIENTS, COLUMNS, nearest_physical
from .dynamics import Dynamics
from .regressor import PER_BODY

_FALL = 3.0  # of gamma, from one value to the next; its root, its square: the same fits
# of a typical parameter: what stands for one that is not positive; half, twice: the same fits
LEAST = 1e-3


@dataclass(frozen=True, eq=False)
class PhysicalSet:
    """The physical parameters, of bodies and then of joints, and the centre of the regularisation.

    The parameters are those of k bodies, then l coefficients that are positive, then others, which
    may be negative and have D = ((x - x_0) / scale)^2 / 2.

    Attributes:
        bodies: number k of bodies, of ten parameters each.
        center: (p) inside the set.
        weights: (l) w of the positive coefficients of the joints, by default ones. D grows
            with c / c_0, so a coefficient that may be many times its description needs a small w.
        body_weights: (k) factors of the bodies' D, by default ones.
        scales: (p - 10 k - l) of the coefficients that may be negative, by default none.
    """

    bodies: int
    center: np.ndarray
    weights: np.ndarray | float = 1.0
    body_weights: np.ndarray | float = 1.0
    scales: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def matrices(self, a: np.ndarray) -> np.ndarray:
        """Return P (k, 4, 4) of the bodies at a (p)."""
        inertial = a[: PER_BODY * self.bodies].reshape(self.bodies, PER_BODY)
        return (inertial @ COLUMNS).reshape(-1, 4, 4)

    @cached_property
    def _centers(self) -> tuple[np.ndarray, np.ndarray]:
        """P_0 (k, 4, 4) of the bodies at the centre, and log det P_0 (k)."""
        P_0 = self.matrices(self.center)
        return P_0, np.linalg.slogdet(P_0)[1]

    def coefficients(self, a: np.ndarray) -> np.ndarray:
        """Return the positive coefficients c (l) at a (p)."""
        return a[PER_BODY * self.bodies : a.size - self.scales.size]

    def signed(self, a: np.ndarray) -> np.ndarray:
        """Return (x - x_0) / scale of the coefficients that may be negative."""
        first = a.size - self.scales.size
        return (a[first:] - self.center[first:]) / self.scales

    def divergence(self, a: np.ndarray) -> float:
        """Return the sum of w D from the centre to a (p); infinite outside the set."""
        P = self.matrices(a)
        P_0, logs_0 = self._centers
        c = self.coefficients(a)
        try:
            L = np.linalg.cholesky(P)
        except np.linalg.LinAlgError:
            return np.inf
        if not (c > 0.0).all():
            return np.inf
        logs = 2.0 * np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
        traces = np.trace(np.linalg.solve(P_0, P), axis1=1, axis2=2)
        of_bodies = self.body_weights * (traces - logs + logs_0 - 4.0)
        shares = c / self.coefficients(self.center)
        of_joints = self.weights * (shares - np.log(shares) - 1.0)
        of_signed = 0.5 * self.signed(a) ** 2
        return of_bodies.sum() + of_joints.sum() + of_signed.sum()

    def local(self, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return T (p, p), h (p) of D(a + T u) - D(a) = h . u + |u|^2 / 2, to second order in u."""
        L = np.linalg.cholesky(self.matrices(a))
        c = self.coefficients(a)
        inverse = np.linalg.inv(L)[:, None]
        B = (inverse @ COEFFICIENTS @ inverse.swapaxes(2, 3)).reshape(-1, PER_BODY, 16)
        Q, R = np.linalg.qr(B.swapaxes(1, 2))
        near = L.swapaxes(1, 2) @ np.linalg.solve(self._centers[0], L)  # one at the centre
        push = (near - np.eye(4)).reshape(-1, 1, 16) @ Q
        roots = np.sqrt(np.broadcast_to(self.body_weights, self.bodies))[:, None, None]
        root = np.sqrt(self.weights)
        share = c / self.coefficients(self.center)
        T = np.diag(np.concatenate([np.zeros(push.size), c / root, self.scales]))
        for i, block in zip(range(0, push.size, PER_BODY), np.linalg.inv(R) / roots, strict=True):
            T[i : i + PER_BODY, i : i + PER_BODY] = block
        return T, np.concatenate([(roots * push).ravel(), root * (share - 1.0), self.signed(a)])


def physical_set(dynamics: Dynamics, robot: Robot) -> PhysicalSet:
    """Return the physical parameters of a model, centred at the description.

    A body below a thousandth of the mean mass, or with a radius of gyration below a hundredth of
    the reach, is enlarged to these values: a centre must be inside the cone, not on its border.

    Raises:
        ParameterError: the parameters are not those of bodies and joints.
    """
    if not dynamics.per_body:
        raise ParameterError(
            "least squares in the physical cone need parameters of bodies and joints.",
            where="identify",
            hint="Leave out basis and unknown lengths.",
        )
    least_mass = 1e-3 * robot.mass / robot.model.nv
    return around(dynamics, dynamics.initial, least_mass, 1e-2 * robot.reach)


def around(
    dynamics: Dynamics, a: np.ndarray, least_mass: float = 1e-6, least_radius: float = 1e-3
) -> PhysicalSet:
    """Return the physical parameters of bodies and joints, centred at a (p) or close by.

    Bodies without the margins of ``nearest_physical`` are replaced, and coefficients that are not
    positive, by a thousandth of the typical ones.
    """
    size = dynamics.inertial.size
    typical = dynamics.typical
    first = a.size - (0 if dynamics.joints is None else dynamics.joints.signed)
    inertial = [
        nearest_physical(pi, least_mass=least_mass, least_radius=least_radius)
        for pi in a[:size].reshape(-1, PER_BODY)
    ]
    positive = np.where(a > 0.0, a, LEAST * typical)[size:first]
    center = np.concatenate([*inertial, positive, a[first:]])
    return PhysicalSet(len(inertial), center, scales=typical[first:])


def physical_fit(
    A: np.ndarray,
    b: np.ndarray,
    physical: PhysicalSet,
    *,
    gamma: float,
    near: np.ndarray | None = None,
) -> np.ndarray:
    """Return the minimiser (p) of |A a - b|^2 / 2 + gamma D(a), A (k, p) and b (k) whitened.

    ``near`` is the minimiser for similar rows, if it is known; it saves time.
    """
    R, z = square(A, b)
    a = near
    weight = gamma
    if a is None:
        a = physical.center
        weight = np.linalg.norm(R @ physical.local(a)[0], 2) ** 2
    while weight > gamma:
        a, _ = _newton(R, z, physical, a, weight, 1e-3)  # a tenth, ten times: the same fits
        weight /= _FALL
    return _newton(R, z, physical, a, gamma)[0]


def nearest_with(
    rows: np.ndarray, a: np.ndarray, physical: PhysicalSet, tolerance: float
) -> np.ndarray | None:
    """Return physical parameters x (p) close to the centre with |rows (x - a)| <= tolerance.

    They minimise |rows (x - a)|^2 / 2 + gamma D(x), with the first gamma, falling in steps of ten,
    that keeps the tolerance: directions that the rows weigh little stay at the centre.

    Args:
        rows: (k, p) with k <= p.
        a: (p) the parameters, physical or not.
        physical: the set, with its centre.
        tolerance: of the rows.

    Returns:
        x, or None where no physical parameters were found within the tolerance.
    """
    x, found = physical.center, True
    target = rows @ a
    scale = np.linalg.norm(rows @ physical.local(x)[0], 2) ** 2
    for weight in scale * 0.1 ** np.arange(21):
        if np.linalg.norm(rows @ x - target) <= tolerance:
            return x
        if not found:
            break
        x, found = _newton(rows, target, physical, x, 0.1 * weight, steps=300)
    return None


def square(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return p equations equivalent to A a = b in least squares, by QR."""
    R = np.asarray(np.linalg.qr(np.column_stack([A, b]), mode="r"))
    return R[: A.shape[1], :-1], R[: A.shape[1], -1]


def sums_of(W: np.ndarray, y: np.ndarray, R: np.ndarray | float = 1.0) -> np.ndarray:
    """Return [W y]^T R [W y] (p + 1, p + 1) of rows W (n, p) and y (n), which add up over time.

    The first p rows are the normal equations A a = b, A the information. R is the weight, one
    number or (n, n). Other data with the best value a and the information A have the rows W = 1,
    y = a, with R = A.
    """
    rows = np.column_stack([W, y])
    return rows.T.dot(R).dot(rows)


def _newton(
    R: np.ndarray,
    z: np.ndarray,
    physical: PhysicalSet,
    a: np.ndarray,
    gamma: float,
    within: float = ROUNDING,
    steps: int = 3000,
) -> tuple[np.ndarray, bool]:
    """Return the minimum of |R a - z|^2 / 2 + gamma D(a), within about this share of gamma.

    The second tells whether it was found in so many steps: where the rows ask for parameters
    outside the set, each goes on along its border by hardly anything. Half, twice: the same fits.
    """

    def objective(x: np.ndarray) -> float:
        return 0.5 * np.sum((R @ x - z) ** 2) + gamma * physical.divergence(x)

    root = np.sqrt(gamma)
    value = objective(a)
    rows = np.vstack([R, root * np.eye(a.size)])
    for _ in range(steps):
        T, h = physical.local(a)
        np.matmul(R, T, out=rows[: len(R)])
        u = np.linalg.solve(*square(rows, np.concatenate([z - R @ a, -root * h])))
        step = T @ u
        fall = np.sum((rows @ u) ** 2)
        if fall <= within * gamma:
            return a, True
        share = 1.0
        while share > 1e-12:
            after = objective(a + share * step)
            if after <= value - 0.1 * share * fall:
                break
            share *= 0.5
        else:
            return a, True  # rounding prevents further progress
        a = a + share * step
        value = after
    return a, False
