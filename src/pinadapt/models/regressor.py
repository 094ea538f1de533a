"""A chain in the ten parameters of every body: regressors, torque and mass matrix.

All come from Pinocchio. n: joints, pi (10 n): the stacked ``Inertia.toDynamicParameters`` of the
bodies, in the order of ``LABELS``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy import empty

from .._kernels import models as kernels
from .._kernels.models import PER_BODY
from ..exceptions import InputError

LABELS = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
# states that stand for all; half: errors of a Panda with late motors 40 % larger, twice: 3 % larger
SAMPLES = 30
State = tuple[np.ndarray, np.ndarray, np.ndarray]  # q (nq), v (n) and a (n)
UNITS = "kg", "kg m", "kg m", "kg m", *("kg m^2" for label in LABELS if label.startswith("I"))


class Regressor:
    """Y (n, 10 n) with M a + C v + g = Y pi, without rotor inertias and friction.

    It depends on the placements of the joints in the model, which may be any tree, also with a
    floating base: (n, 10 N) for N bodies then. Its two momentum regressors need no acceleration,
    M a + C v + g = d/dt (Y_M pi) + Y_0 pi: Y_M pi = M v is the momentum and Y_0 pi = g - C^T v,
    with dM/dt = C + C^T. Let H_i be the spatial momentum of all bodies that coordinate i moves, and
    J_i its axis, both in world axes. The torque is J_i^T (dH_i/dt + weight), hence

        (M v)_i = J_i^T H_i,        (C^T v)_i = (dJ_i/dt)^T H_i.

    J and dJ/dt come from ``pin.computeJointJacobiansTimeVariation``; H is linear in pi. The result
    is exact, without finite differences, and costs about one torque regressor.

    The momentum form M a + C v + g = d/dt (M v) - C^T v + g is that of J.-J. Slotine, W. Li,
    *Composite adaptive control of robot manipulators*, Automatica 25 (1989) 509-519, and P. Hsu,
    M. Bodson, S. Sastry, B. Paden, *Adaptive identification and control for manipulators without
    using joint accelerations*, ICRA 1987.

    Torque and mass matrix, at the loaded parameters, come from RNEA and CRBA. The parameters may be
    any numbers, but ``pin.Inertia`` cannot represent a body without mass, and CRBA cannot sum
    bodies to a mass that is not positive. For such parameters a ballast u of one kilogram a body is
    added c times and its effect subtracted: M(pi) = M(pi + c u) - c M(u), exactly, for every pi.
    """

    def __init__(self, model: pin.Model) -> None:
        """Copy a chain's model, and load its own parameters."""
        self._model, self._weightless, self._ballast = (model.copy() for _ in range(3))
        self._weightless.gravity.linear = np.zeros(3)
        n = model.nv
        self._data = model.createData()  # scratch for both
        self._ballast_data = model.createData()
        self._ballast.armature = np.zeros(n)
        self._inertias = self._model.inertias
        self._shape = (n, PER_BODY * (model.njoints - 1))
        self._inertial = np.zeros(self._shape[1])
        self._bodies = list(enumerate(self._inertial.reshape(-1, PER_BODY), 1))  # views
        for joint, _ in self._bodies:  # point masses at the joints
            self._ballast.inertias[joint] = pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3)))
        self.load(inertial_parameters(model))
        self._zero = np.zeros(n)
        self._many = n > 1  # a single row is a vector in Pinocchio
        oMi = list(self._data.oMi)[1:]
        bodies, columns = np.nonzero(moves(model)[1:])
        self._chain = (
            live_array([placement.rotation for placement in oMi]),
            live_array([placement.translation for placement in oMi]),
            live_array([motion.vector for motion in list(self._data.v)[1:]]),
            self._data.J.reshape(6, n),
            self._data.dJ.reshape(6, n),
            bodies,
            columns,
            np.array(model.gravity.linear),
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return Regressor, (self._model,), {"_pi": self._pi}

    def load(self, pi: np.ndarray) -> None:
        """Set the parameters (10 n) of all bodies; they must not change until others are set."""
        self._pi = pi
        self._c: float | None = None

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N], rotors included."""
        return self._at_loaded(pin.rnea, q, v, a)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), rotors included."""
        return self._at_loaded(pin.crba, q)

    def _at_loaded(self, algorithm: Callable[..., np.ndarray], *state: np.ndarray) -> np.ndarray:
        """Return what an algorithm of Pinocchio gives for the loaded parameters."""
        if self._c is None:
            self._c = kernels.take(self._pi, self._inertial)
            inertias = self._inertias
            from_pi = pin.Inertia.FromDynamicParameters
            for joint, pi in self._bodies:
                inertias[joint] = from_pi(pi)
        try:
            found = algorithm(self._model, self._data, *state)
        except ValueError as error:
            raise wrong_sizes(self._model, *state) from error
        if self._c:
            found = found - self._c * algorithm(self._ballast, self._ballast_data, *state)
        return found

    def __call__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y(q, v, a) (n, 10 n)."""
        try:
            return self._of(self._model, q, v, a)
        except ValueError as error:
            raise wrong_sizes(self._model, q, v, a) from error

    def _of(self, model: pin.Model, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return the regressor (n, 10 n) of a model with these joints."""
        Y = pin.computeJointTorqueRegressor(model, self._data, q, v, a)
        return Y if self._many else Y.reshape(self._shape)

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> np.ndarray:
        """Return Y (n, 10 n) with M a_r + C(q, v) v_r + g = Y pi, C the Christoffel matrix.

        C(q, u) w is bilinear and symmetric in u and w; polarisation gives it by two regressors,
        Y = Y(q, (v + v_r)/2, a_r) - Y0(q, (v - v_r)/2, 0), Y0 without gravity.
        """
        try:
            mean = 0.5 * (v + v_r)
            Y = self._of(self._model, q, mean, a_r)
            Y -= self._of(self._weightless, q, v - mean, self._zero)
        except ValueError as error:
            raise wrong_sizes(self._model, q, v, v_r, a_r) from error
        return Y

    def momentum(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_M and Y_0 (n, 10 n)."""
        try:
            pin.computeJointJacobiansTimeVariation(self._model, self._data, q, v)
        except ValueError as error:
            raise wrong_sizes(self._model, q, v) from error
        Y_M = empty(self._shape)
        Y_0 = empty(self._shape)
        kernels.momentum_columns(*self._chain, Y_M, Y_0)
        return Y_M, Y_0


@dataclass(eq=False)
class VirtualChains:
    """Torque, mass matrix and regressors of virtual chains together, in the parameters a (p).

    They are k chains without rotors, the columns (p) that count among the 10 n k of their
    regressors side by side, and the rotors (n).
    """

    _chains: Sequence[Regressor]
    _columns: Sequence[int]
    _armature: np.ndarray

    def load(self, a_d: np.ndarray) -> None:
        """Make a_d (p) the estimate, each virtual chain with its part."""
        self._a_d = a_d
        pi = np.zeros((len(self._chains), PER_BODY * self._armature.size))
        pi.put(self._columns, a_d)
        for chain, own in zip(self._chains, pi, strict=True):
            chain.load(own)

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N], by the regressor, the fastest way."""
        return self(q, v, a).dot(self._a_d) + self._armature * a

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), rotors included."""
        return sum((chain.mass_matrix(q) for chain in self._chains), np.diag(self._armature))

    def __call__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y(q, v, a) (n, p)."""
        return self._of_base([chain(q, v, a) for chain in self._chains])

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> np.ndarray:
        """Return Y_r (n, p)."""
        return self._of_base([chain.slotine_li(q, v, v_r, a_r) for chain in self._chains])

    def momentum(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_M and Y_0 (n, p)."""
        Y_M, Y_0 = zip(*(chain.momentum(q, v) for chain in self._chains), strict=True)
        return self._of_base(Y_M), self._of_base(Y_0)

    def _of_base(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """Return the base's columns (n, p) of the chains' regressors (n, 10 n)."""
        return np.hstack(parts)[:, self._columns]


def wrong_sizes(model: pin.Model, q: np.ndarray, *rates: np.ndarray) -> InputError:
    """Return the error of a q (nq), velocities or accelerations (nv) that Pinocchio refused."""
    given = [np.shape(each) for each in (q, *rates)]
    wanted = [(model.nq,), *[(model.nv,)] * len(rates)]
    return InputError(f"expected q and its rates of the shapes {wanted}, got {given}.", where="q")


def moves(model: pin.Model) -> np.ndarray:
    """Return which coordinates (N, n) move each of N joints, the world first, and its body."""
    joints = np.repeat(range(model.njoints), list(model.nvs))
    supported = np.zeros((model.njoints, model.njoints), dtype=bool)
    for joint, support in enumerate(model.supports):
        supported[joint, list(support)] = True
    return supported[:, joints]


def inertial_parameters(model: pin.Model) -> np.ndarray:
    """Return pi (10 n) of a model."""
    return np.concatenate([inertia.toDynamicParameters() for inertia in model.inertias[1:]])


def random_states(model: pin.Model, count: int) -> list[State]:
    """Return seeded states (q, v, a), up to 2 rad or m from the neutral configuration."""
    rng = np.random.default_rng(0)
    n = model.nv
    neutral = pin.neutral(model)
    return [
        (pin.integrate(model, neutral, rng.uniform(-2.0, 2.0, n)), *rng.standard_normal((2, n)))
        for _ in range(count)
    ]


class Momentum(NamedTuple):
    """tau = d/dt (Y_M a + p_0) + Y_0 a + tau_0, affine in the parameters a (p) of n joints.

    Attributes:
        Y_M: (n, p) regressor of the momentum M v, with rotors.
        Y_0: (n, p) regressor of the rest, g - C^T v + friction.
        p_0: (n) known part of the momentum [N m s or N s].
        tau_0: (n) known part of the rest [N m or N].
    """

    Y_M: np.ndarray
    Y_0: np.ndarray
    p_0: np.ndarray
    tau_0: np.ndarray


def live_array(views: Sequence[np.ndarray]) -> np.ndarray:
    """Return one array (N, ...) that shares the memory of N views at equal distances.

    Pinocchio stores placements and motions of all joints in contiguous vectors and returns a view
    of each; a kernel reads them as one array. It is valid as long as the model or data exists.

    Raises:
        ValueError: the views are not at equal distances in memory.
    """
    places = np.array([view.ctypes.data for view in views])
    first = views[0]
    distance = int(places[1] - places[0]) if len(views) > 1 else 0
    if (np.diff(places) != distance).any():
        raise ValueError("the views are not at equal distances in memory.")
    return np.lib.stride_tricks.as_strided(
        first, (len(views), *first.shape), (distance, *first.strides), writeable=False
    )
