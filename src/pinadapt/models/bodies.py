"""Dynamics in the inertial parameters of bodies, ten per body, and their pseudo-inertias."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from .._checks import instance, name_list
from .._kernels import models as kernels
from ..description.chain import are_physical
from ..exceptions import ParameterError, RobotError
from ..robot.changes import joint_id
from ..robot.robot import Robot
from .dynamics import Dynamics
from .regressor import LABELS, PER_BODY, UNITS, Momentum, Regressor, inertial_parameters

_VISIBLE = 1e-4  # a body's least radius over the distance of its centre of mass from the joint


class InertialModel:
    """A private Pinocchio model whose ten parameters per body may be any numbers.

    RNEA and CRBA are linear in the parameters pi, but ``pin.Inertia`` cannot represent a body
    without mass, and CRBA cannot sum bodies to a mass that is not positive. For such parameters a
    ballast u of one kilogram a body is added c times and its effect subtracted:
    M(pi) = M(pi + c u) - c M(u), exactly, for every pi.
    """

    def __init__(self, model: pin.Model) -> None:
        """Copy a chain's model."""
        self._model, self._ballast_model = model.copy(), model.copy()
        self._data, self._ballast_data = self._model.createData(), self._ballast_model.createData()
        self._inertias, self._ballast_model.armature = self._model.inertias, np.zeros(model.nv)
        self._pi, self._written, self._c = inertial_parameters(model), True, 0.0
        self._tens = self._pi.copy()
        self._bodies = list(enumerate(self._tens.reshape(-1, PER_BODY), 1))  # views
        self._ballast = np.tile(np.eye(PER_BODY)[0], model.nv)  # point masses at the joints
        for joint in range(1, model.njoints):
            point = pin.Inertia.FromDynamicParameters(self._ballast[:PER_BODY])
            self._ballast_model.inertias[joint] = point

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: Pinocchio's data is scratch."""
        return type(self), (self._model,)

    def load(self, pi: np.ndarray) -> None:
        """Set the parameters (10 n) of all bodies; they must not change until others are set."""
        self._pi, self._written = pi, False

    def _write(self) -> None:
        """Write the parameters into the model, before a torque or a mass matrix is computed."""
        self._c = kernels.take(self._pi, self._ballast, self._tens)
        inertias, from_ten = self._inertias, pin.Inertia.FromDynamicParameters
        for joint, ten in self._bodies:
            inertias[joint] = from_ten(ten)
        self._written = True

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N], rotors included."""
        if not self._written:
            self._write()
        tau = pin.rnea(self._model, self._data, q, v, a)
        if self._c:
            tau -= self._c * pin.rnea(self._ballast_model, self._ballast_data, q, v, a)
        return tau

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), rotors included."""
        if not self._written:
            self._write()
        M = pin.crba(self._model, self._data, q)
        if self._c:
            M = M - self._c * pin.crba(self._ballast_model, self._ballast_data, q)
        return M


class InertialDynamics(Dynamics):
    """Dynamics in parameters a_d in which pi (10 n) is affine, pi the ten parameters of each body.

    Torque and mass matrix come from Pinocchio's RNEA and CRBA on a private model, the regressor
    from its joint torque regressor. Subclasses define how pi follows from a_d (``expand``) and how
    the regressor of a_d follows from that of pi (``reduce``).
    """

    def __init__(self, robot: Robot) -> None:
        """Copy the model of a nominal robot."""
        instance(robot, Robot, "robot", RobotError)
        self._model = InertialModel(robot.model)
        self._regressor = Regressor(robot.model)
        self._armature = np.array(robot.model.armature)
        self._rotors = bool(self._armature.any())
        self._pi = inertial_parameters(robot.model)
        self._gravity = np.array(robot.model.gravity.linear)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore from a copy, whose model has to load the estimate again."""
        self.__dict__.update(state)
        self._model.load(self._pi)

    def differs_only_in_bodies(self, robot: Robot) -> bool:
        """Return whether a robot has the nominal rotors and gravity, and no friction."""
        rotors = np.allclose(robot.model.armature, self._armature)
        return (
            not robot.friction.present
            and rotors
            and np.allclose(robot.model.gravity.linear, self._gravity)
        )

    @abstractmethod
    def expand(self, a_d: np.ndarray) -> np.ndarray:
        """Return pi (10 n) of the parameters a_d (p)."""

    @abstractmethod
    def reduce(self, Y: np.ndarray) -> np.ndarray:
        """Return the regressor (n, p) of a_d from that of pi, Y (n, 10 n)."""

    def load(self, a_d: np.ndarray) -> None:
        """Write the estimate a_d (p) into the private model."""
        self._pi = pi = self.expand(a_d)
        self._model.load(pi)

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) by RNEA."""
        return self._model.torque(q, v, a)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n) by CRBA."""
        return self._model.mass_matrix(q)

    def regressor(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y (n, p)."""
        return self.reduce(self._regressor(q, v, a))

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_r (n, p) and the torque M a_r + C v_r + g (n), with known bodies and rotors."""
        Y, tau = self._regressor.slotine_li_torque(self._pi, q, v, v_r, a_r)
        if self._rotors:
            tau = tau + self._armature * a_r
        return self.reduce(Y), tau

    def momentum(self, q: np.ndarray, v: np.ndarray) -> Momentum:
        """Return the torque as the rate of a momentum and a rest, with known bodies and rotors.

        See ``MomentumRegressor`` for the source.
        """
        Y_M, Y_0 = self._regressor.momentum(q, v)
        p_0 = self._armature * v if self._rotors else np.zeros(v.size)
        known, tau_0 = self._known, np.zeros(v.size)
        if known is not None:
            p_0, tau_0 = p_0 + Y_M.dot(known), Y_0.dot(known)
        return Momentum(self.reduce(Y_M), self.reduce(Y_0), p_0, tau_0)

    @cached_property
    def _known(self) -> np.ndarray | None:
        """The part of pi (10 n) that does not depend on a_d; None if there is none."""
        known = self.expand(np.zeros(self.size))
        return known if known.any() else None


class ChosenParameters(InertialDynamics):
    """Dynamics in some of the parameters pi (10 n); the others are known."""

    def __init__(self, robot: Robot, columns: np.ndarray, *, known: bool = True) -> None:
        """Choose the parameters by their indices in pi (p); the others are nominal, or zero."""
        super().__init__(robot)
        self._columns, self.size = columns, len(columns)
        self._all = self.size == self._pi.size
        self._others = self._pi if known else np.zeros(self._pi.size)
        self.initial = self._pi[columns].copy()

    def expand(self, a_d: np.ndarray) -> np.ndarray:
        """Return pi (10 n) with the parameters a_d (p) in it."""
        if self._all:
            return a_d
        pi = self._others.copy()
        pi[self._columns] = a_d
        return pi

    def reduce(self, Y: np.ndarray) -> np.ndarray:
        """Return the columns (n, p) of the chosen parameters."""
        return Y if self._all else Y[:, self._columns]

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of a robot's bodies."""
        return inertial_parameters(robot.model)[self._columns]


ALL, PAYLOAD, NONE = "all", "payload", "none"


def chosen_bodies(robot: Robot, unknown: str | Sequence[str]) -> list[int]:
    """Return the indices, from 0, of the bodies that a user's words name.

    Args:
        robot: with the bodies.
        unknown: "all", "payload" (the last body), "none", or names of the joints that move them.

    Raises:
        RobotError: unknown joint.
    """
    n = robot.model.nv
    known = {ALL: list(range(n)), PAYLOAD: [n - 1], NONE: []}
    if isinstance(unknown, str) and unknown in known:
        return known[unknown]
    names = name_list(unknown, "unknown.bodies")
    return sorted(
        {joint_id(robot.model, name, "unknown.bodies", (ALL, PAYLOAD, NONE)) - 1 for name in names}
    )


class BodyDynamics(ChosenParameters):
    """Dynamics in the ten inertial parameters [m, mc, I about the joint] of chosen bodies.

    Attributes:
        bodies: indices of the adapted bodies, from 0, ascending.
    """

    per_body = True

    def __init__(self, robot: Robot, unknown: str | Sequence[str] = ALL) -> None:
        """Choose bodies: "all", "payload", "none" or the names of the joints that move them.

        Raises:
            RobotError: unknown joint.
        """
        instance(robot, Robot, "robot", RobotError)
        self.bodies, names = chosen_bodies(robot, unknown), robot.joint_names
        first = PER_BODY * np.array(self.bodies, dtype=int)
        super().__init__(robot, (first[:, None] + np.arange(PER_BODY)).ravel())
        self.names = tuple(f"{names[body]}.{label}" for body in self.bodies for label in LABELS)
        self._last = robot.model.nv - 1
        self._placements = [placement.copy() for placement in robot.model.jointPlacements]

    @property
    def units(self) -> tuple[str, ...]:
        """One unit a parameter."""
        return UNITS * len(self.bodies)

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the ten parameters of each adapted body; None if anything else differs."""
        robot = robot.in_base_axes
        pi, known = inertial_parameters(robot.model), np.ones(len(self._others), dtype=bool)
        known[self._columns] = False
        same = np.allclose(pi[known], self._others[known], rtol=1e-9, atol=1e-12)
        same = same and self.differs_only_in_bodies(robot)
        pairs = list(zip(self._placements, robot.model.jointPlacements, strict=True))
        base, true_base = pairs[1]  # the torque depends on the rotation of the base alone
        same = same and np.allclose(base.rotation, true_base.rotation, atol=1e-9)
        same = same and all(ours.isApprox(theirs, 1e-9) for ours, theirs in pairs[2:])
        return pi[self._columns] if same else None

    def values(self, robot: Robot, tens: np.ndarray, lengths: np.ndarray) -> np.ndarray | None:
        """Return the ten parameters of each adapted body (N, p): those given."""
        return tens.reshape(-1, self.size)

    def robot(self, a_d: np.ndarray, nominal: Robot) -> Robot:
        """Return the nominal robot with the bodies of the parameters a_d (p).

        Raises:
            ParameterError: some of the bodies are not physical.
        """
        return with_bodies(nominal, dict(zip(self.bodies, a_d.reshape(-1, PER_BODY), strict=True)))

    def with_load(self, a_d: np.ndarray, before: Robot, after: Robot) -> np.ndarray | None:
        """Return the estimate (p) whose last body is the nominal one with the new load.

        The estimate of the last body is replaced, because it may contain the previous load.
        """
        described = self.value(after)
        if described is None or self._last not in self.bodies:
            return None if described is None else a_d.copy()
        return np.concatenate([a_d[:-PER_BODY], described[-PER_BODY:]])


# The pseudo-inertia of a body, a matrix linear in its ten parameters:
# P = [[Sigma, mc], [mc^T, m]], Sigma = tr(I)/2 1 - I. A body is physical, so that a mass
# distribution has its parameters, if and only if P is positive definite (Wensing, Kim, Slotine
# 2018).


def _coefficients() -> np.ndarray:
    """Return F (10, 4, 4), P = sum_i pi_i F_i, pi = [m, mc, Ixx, Ixy, Iyy, Ixz, Iyz, Izz]."""
    F = np.zeros((PER_BODY, 4, 4))
    F[0, 3, 3] = 1.0
    for axis in range(3):
        F[1 + axis, axis, 3] = F[1 + axis, 3, axis] = 1.0
    for index, (i, j) in {4: (0, 0), 5: (0, 1), 6: (1, 1), 7: (0, 2), 8: (1, 2), 9: (2, 2)}.items():
        F[index, i, j] -= 1.0
        if i == j:
            F[index, :3, :3] += 0.5 * np.eye(3)
        else:
            F[index, j, i] -= 1.0
    return F


COEFFICIENTS = _coefficients()
UNCERTAINTY = 0.3  # as far as a described body may be off, in the metric of natural adaptation


def pseudo_inertia(pi: np.ndarray) -> np.ndarray:
    """Return P (4, 4) of the ten parameters pi (10) of a body."""
    return np.tensordot(pi, COEFFICIENTS, axes=1)


def ten_parameters(P: np.ndarray) -> np.ndarray:
    """Return the ten parameters (..., 10) of bodies with pseudo-inertias P (..., 4, 4)."""
    xx, yy, zz = P[..., 0, 0], P[..., 1, 1], P[..., 2, 2]
    first = [P[..., 3, 3], P[..., 0, 3], P[..., 1, 3], P[..., 2, 3]]
    second = [yy + zz, -P[..., 0, 1], xx + zz, -P[..., 0, 2], -P[..., 1, 2], xx + yy]
    return np.stack([*first, *second], axis=-1)


def nearest_physical(pi: np.ndarray, *, least_mass: float, least_radius: float) -> np.ndarray:
    """Return ten physical parameters (10) close to pi (10), or pi if it has the margins below.

    The mass becomes at least ``least_mass`` [kg], the eigenvalues of the second moment about the
    centre of mass at least mass times ``least_radius`` squared [m]. The centre of mass is kept; if
    it is far away, the radius is at least 1e-4 of its distance, as rounding would hide a smaller
    one.
    """
    m = max(float(pi[0]), least_mass)
    c = pi[1:4] / pi[0] if pi[0] > 0.0 else np.zeros(3)
    radius = max(least_radius, _VISIBLE * float(np.linalg.norm(c)))
    P = pseudo_inertia(pi)
    about_com = P[:3, :3] - pi[0] * np.outer(c, c)
    eigenvalues, vectors = np.linalg.eigh(about_com)
    eigenvalues = np.maximum(eigenvalues, m * radius**2)
    Sigma = (vectors * eigenvalues) @ vectors.T + m * np.outer(c, c)
    return ten_parameters(np.block([[Sigma, m * c[:, None]], [m * c, m]]))


def unphysical_bodies(a_d: np.ndarray, names: Sequence[str]) -> list[str]:
    """Return the names of the bodies with unphysical parameters, stacked in a_d (10 k)."""
    physical = are_physical(a_d.reshape(-1, PER_BODY))
    return [name for name, is_one in zip(names, physical, strict=True) if not is_one]


def with_bodies(robot: Robot, tens: Mapping[int, np.ndarray]) -> Robot:
    """Return a robot with bodies replaced: index from 0 -> ten parameters (10).

    Raises:
        ParameterError: some of them are not physical.
    """
    names = [robot.joint_names[body] for body in tens]
    stacked = np.concatenate([np.zeros(0), *tens.values()])
    if unphysical := unphysical_bodies(stacked, names):
        raise ParameterError(
            f"the bodies moved by {unphysical} have inertias that no mass distribution has.",
            where="learned",
            hint='Adaptation "natural" keeps bodies physical; "gradient" does not.',
        )
    model = robot.model.copy()
    for body, ten in tens.items():
        model.inertias[body + 1] = pin.Inertia.FromDynamicParameters(ten)
    return replace(robot, model=model)
