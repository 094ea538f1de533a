"""One integration step of a robot: midpoint rule, friction implicit, exponentially fitted."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numpy import empty

from .._compiled import compile_all, compiled
from ..robot.robot import Robot


class FittedMidpoint:
    """Second order in the step h, two forward dynamics a step, stable for any friction.

    Friction is stiff: near rest tau_f = viscous v + coulomb tanh(v / threshold) has the slope
    coulomb / threshold, and a light wrist comes to rest within microseconds. Written with its
    secant, tau_f = D(v) v with D_i = viscous_i + coulomb_i tanh(v_i / threshold) / v_i, even and
    bounded, it is taken implicitly. Both stages start at v and solve, D at the best known velocity,

        (M + theta h D) a = tau - C v - g - D v,

    which the articulated-body algorithm does when theta h D is added to the rotor inertias: first
    with h / 2 at the start, which gives the state at the middle, then with h there. The step ends
    at v + h a, and q moves with v + theta h a.

    theta_i = 1 / (1 - exp(-z_i)) - 1 / z_i, z_i = h D_i / M_ii, fits the exponential decay of one
    joint under viscous friction exactly (W. Liniger, R. A. Willoughby, *Efficient integration
    methods for stiff systems of ordinary differential equations*, SIAM J. Numer. Anal. 7 (1970)
    47-66). It is 1/2 + z_i / 12 for small z_i, hence the second order, and tends to 1 for large
    ones, hence L-stability. As theta_i >= 1/2 always, friction alone never makes the velocity grow,
    whatever couples the joints, so that M_ii may be that of the home configuration.
    """

    def __init__(self, robot: Robot) -> None:
        """Copy the model; its rotor inertias are scratch from then on."""
        self._robot = robot
        self._model = robot.model.copy()
        self._data = self._model.createData()
        self._armature = self._model.armature  # a view, to write into
        rotors = np.array(self._armature)
        inertia = np.diag(pin.crba(self._model, self._data, robot.q0)).copy()
        friction, self._present = robot.friction, robot.friction.present
        self._theta, self._drive = np.full((2, self._model.nv), 0.5)
        joints = friction.viscous, friction.coulomb, friction.threshold
        self._constants = (*joints, inertia, rotors)
        self._fitted = self._armature, self._drive, self._theta
        self._none = np.zeros(self._model.nv)
        compile_all()

    def __call__(
        self, q: np.ndarray, v: np.ndarray, tau: np.ndarray, h: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return q (nq) and v (nv) after h [s] under a held torque tau (nv)."""
        model, half, integrate = self._model, 0.5 * h, pin.integrate
        solve = self._damped if self._present else self._free
        after, middle, way = empty(v.size), empty(v.size), empty(v.size)
        _moved(v, solve(q, v, v, tau, half), self._none, half, middle, way)
        a = solve(integrate(model, q, way), middle, v, tau, h)
        _moved(v, a, self._theta, h, after, way)
        return integrate(model, q, way), after

    def __reduce__(self) -> tuple[type[FittedMidpoint], tuple[Robot]]:
        """Pickle the robot alone: a copied view would no longer be one."""
        return FittedMidpoint, (self._robot,)

    def _free(
        self, q: np.ndarray, v: np.ndarray, start: np.ndarray, tau: np.ndarray, h: float
    ) -> np.ndarray:
        """Return a (nv) of a robot without friction."""
        return pin.aba(self._model, self._data, q, v, tau)

    def _damped(
        self, q: np.ndarray, v: np.ndarray, start: np.ndarray, tau: np.ndarray, h: float
    ) -> np.ndarray:
        """Return a (nv), terms at q, v, for a step of h [s] that begins at velocity ``start``."""
        _fit(*self._constants, h, v, start, tau, *self._fitted)
        return pin.aba(self._model, self._data, q, v, self._drive)


@compiled(
    "void(f8[:], f8[:], f8, f8[:], f8[:], f8, f8[:], f8[:], f8[:], f8[:], f8[:], f8[:])", fills=3
)
def _fit(
    viscous: np.ndarray,
    coulomb: np.ndarray,
    threshold: float,
    inertia: np.ndarray,
    rotors: np.ndarray,
    h: float,
    v: np.ndarray,
    start: np.ndarray,
    tau: np.ndarray,
    armature: np.ndarray,
    drive: np.ndarray,
    theta: np.ndarray,
) -> None:
    """Write rotors + theta h D, tau - D start and theta (nv) of ``FittedMidpoint``."""
    for i in range(len(v)):
        x = v[i] / threshold
        ratio = 1.0 - x * x / 3.0 if abs(x) < 1e-4 else math.tanh(x) / x
        D = viscous[i] + coulomb[i] / threshold * ratio
        z = h * D / inertia[i]
        theta[i] = 0.5 + z / 12.0 if z < 1e-3 else -1.0 / math.expm1(-z) - 1.0 / z
        armature[i] = rotors[i] + theta[i] * h * D
        drive[i] = tau[i] - D * start[i]


@compiled("void(f8[:], f8[:], f8[:], f8, f8[:], f8[:])", fills=2)
def _moved(
    v: np.ndarray, a: np.ndarray, theta: np.ndarray, h: float, after: np.ndarray, way: np.ndarray
) -> None:
    """Write the velocity v + h a after h [s] and the way h (v + theta h a) until then (nv)."""
    for i in range(len(v)):
        after[i] = v[i] + h * a[i]
        way[i] = h * (v[i] + theta[i] * (h * a[i]))
