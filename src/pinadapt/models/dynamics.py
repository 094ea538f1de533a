"""Dynamics that are linear in unknown parameters: what every choice of them offers to the laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from ..exceptions import ParameterError
from ..robot.robot import Robot
from .joint_effects import JointEffects, without_joint_effects
from .regressor import (
    Momentum,
    Regressor,
    State,
    VirtualChains,
    inertial_parameters,
    random_states,
)
from .translations import Translation, place


class Dynamics:
    """The estimated dynamics of a chain of n joints with p unknown parameters a_d.

    The torque is affine in the parameters: M a + C v + g = Y(q, v, a) a_d + tau_0(q, v, a), Wang
    and Xie (2009), equation (7). tau_0 is the torque of the bodies that are not adapted and of the
    rotor inertias ``model.armature``. ``load`` sets the estimate at which torque and mass matrix
    are evaluated.

    This is the block of the inertial parameters, with pi = B a_d + a known part, pi (10 n) ten
    numbers a body. Torque and mass matrix come from Pinocchio's RNEA and CRBA on a private model,
    the regressor from its joint torque regressor. ``StackedDynamics`` adds the joints.

    The parameters stand in two blocks: first ``inertial``, the parameters of bodies, then
    ``joints``, the coefficients of rotors and friction. The second block may be missing.

    Attributes:
        B: (10 n, p); None: the identity.
        names: one name a parameter.
        size: p.
        initial: (p) the values of the nominal robot.
        bodies: indices from 0 of the bodies with unknown inertias.
        per_body: whether the inertial parameters are the ten of each of ``bodies``, one body after
            the other. Otherwise they are combinations, from which no bodies follow.
        translations: the unknown joint translations that the parameters contain.
        joints: the block of the joints' coefficients. None: rotors are as described, and friction
            is zero.
    """

    names: tuple[str, ...]
    size: int
    initial: np.ndarray
    bodies: Sequence[int] = ()
    per_body: bool = False
    translations: Sequence[Translation] = ()
    joints: JointEffects | None = None

    def __init__(
        self, robot: Robot, B: np.ndarray | None = None, known: np.ndarray | None = None
    ) -> None:
        """Use the model of a nominal robot, B, and the known part (10 n), by default zero."""
        self._model: Regressor | VirtualChains = Regressor(robot.model)
        self._armature = np.array(robot.model.armature)
        self._rotors = self._armature.any()  # not where they are those of the joints' block
        self._pi = inertial_parameters(robot.model)
        self.B = B
        self._known = known
        self.size = self._pi.size if B is None else B.shape[1]

    @cached_property
    def inertial(self) -> Dynamics:
        """The block of the inertial parameters: the dynamics of the robot without ``joints``."""
        return self

    def bare(self, robot: Robot) -> Robot:
        """Return a robot without the effects that belong to the block ``joints``."""
        return robot

    @cached_property
    def typical(self) -> np.ndarray:
        """Typical values (p): ``initial``, but typical coefficients of the joints."""
        return self.initial

    @cached_property
    def units(self) -> tuple[str, ...]:
        """One unit a parameter, empty for combinations of parameters."""
        return ("",) * self.size

    def _expand(self, a_d: np.ndarray) -> np.ndarray:
        """Return pi (10 n) of the parameters a_d (p)."""
        pi = a_d if self.B is None else self.B.dot(a_d)
        return pi if self._known is None else self._known + pi

    def _reduce(self, Y: np.ndarray) -> np.ndarray:
        """Return the regressor (n, p) of a_d from that of pi, Y (n, 10 n)."""
        return Y if self.B is None else Y.dot(self.B)

    def load(self, a_d: np.ndarray) -> None:
        """Make a_d (p) the estimate at which torque and mass matrix are evaluated."""
        self._pi = pi = self._expand(a_d)
        self._model.load(pi)

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g (n) [N m or N] at the loaded estimate, physical or not."""
        return self._model.torque(q, v, a)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n) at the loaded estimate, physical or not."""
        return self._model.mass_matrix(q)

    def regressor(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y (n, p), (7)."""
        return self._reduce(self._model(q, v, a))

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_r (n, p) of Slotine and Li, and M a_r + C(q, v) v_r + g (n) at the estimate.

        C is the matrix of Christoffel symbols, for which dM/dt - 2 C is skew-symmetric. Known
        bodies and rotors count.
        """
        Y = self._model.slotine_li(q, v, v_r, a_r)
        tau = Y.dot(self._pi)
        if self._rotors:
            tau += self._armature * a_r
        return self._reduce(Y), tau

    def momentum(self, q: np.ndarray, v: np.ndarray) -> Momentum:
        """Return the torque as the rate of a momentum and a remainder, both without acceleration.

        M a + C v + g = d/dt (Y_M a_d + p_0) + Y_0 a_d + tau_0. It does not depend on the loaded
        estimate. See ``Regressor`` for the source.
        """
        Y_M, Y_0 = self._model.momentum(q, v)
        p_0 = self._armature * v if self._rotors else np.zeros(v.size)
        tau_0 = np.zeros(v.size)
        if self._known is not None:
            p_0 = p_0 + Y_M.dot(self._known)
            tau_0 = Y_0.dot(self._known)
        return Momentum(self._reduce(Y_M), self._reduce(Y_0), p_0, tau_0)

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of a robot's bodies; None if other torques differ too.

        For columns of B of which each is one of the ten parameters of a body.
        """
        a_d = self._reduce(inertial_parameters(robot.in_base_axes.model))
        (state,) = states = random_states(robot.model, 1)
        tau = self._of_bodies(robot, states)
        off = np.abs(tau - self._model(*state).dot(self._expand(a_d))).max()
        same = not robot.friction.present and off <= 1e-9 * (1.0 + np.abs(tau).max())
        return a_d if same else None

    def _of_bodies(self, robot: Robot, states: Sequence[State]) -> np.ndarray:
        """Return the torques (N n) of a robot at N states, without the nominal rotors."""
        model = robot.in_base_axes.model
        data = model.createData()
        return np.concatenate(
            [pin.rnea(model, data, q, v, a) - self._armature * a for q, v, a in states]
        )

    def values(self, robot: Robot, inertial: np.ndarray, lengths: np.ndarray) -> np.ndarray | None:
        """Return the parameters (N, p) of N robots like a given one; None if one of them has none.

        Args:
            robot: of which bodies and translations are replaced.
            inertial: (N, b, 10) parameters of ``bodies``.
            lengths: (N, k) parameters of ``translations`` [m].
        """
        found = []
        for pi, theta in zip(inertial, lengths, strict=True):
            other = self._moving(robot, pi)
            place(other.model, robot.frame_id, self.translations, theta)
            value = self.value(other)
            if value is None:
                return None
            found.append(value)
        return np.array(found).reshape(-1, self.size)

    def _moving(self, robot: Robot, inertial: np.ndarray) -> Robot:
        """Return a robot whose ``bodies`` have other parameters (b, 10)."""
        model = robot.model.copy()
        for body, pi in zip(self.bodies, inertial, strict=True):
            model.inertias[body + 1] = pin.Inertia.FromDynamicParameters(pi)
        return replace(robot, model=model)

    def robot(self, a_d: np.ndarray, nominal: Robot) -> Robot:
        """Return the nominal robot with the parameters a_d (p) in place of its own.

        Raises:
            ParameterError: the parameters do not determine bodies, or the bodies are not physical.
        """
        raise ParameterError(
            f"the {self.size} parameters are combinations, from which no bodies follow.",
            where="learned",
            hint="Save their values instead: see LearnedParameters.",
        )

    def with_load(self, a_d: np.ndarray, before: Robot, after: Robot) -> np.ndarray | None:
        """Return the estimate (p) after an announced change of the load on the last body.

        Args:
            a_d: (p) the estimate before the change.
            before: the nominal robot with the load announced before.
            after: the nominal robot with the new load.

        Returns:
            The estimate plus the difference of the two robots' parameters, which is exact because
            the parameters are affine in the inertias. None if they cannot express the load.
        """
        old = self.value(before)
        new = self.value(after)
        return None if old is None or new is None else a_d + (new - old)


class StackedDynamics(Dynamics):
    """Inertial parameters (of bodies, a basis, lumped) followed by the joints' coefficients.

    The inertial block must be made for the robot ``without_joint_effects``: all rotors and friction
    are in the joint block, where their coefficients are adapted or known. In the Slotine-Li
    regressor the joints' columns take v_r and a_r; viscous and Coulomb friction then only add
    dissipation.
    """

    joints: JointEffects

    def __init__(self, inertial: Dynamics, joints: JointEffects) -> None:
        """Stack the two blocks, made for the same chain."""
        self.inertial = inertial
        self.joints = joints
        self.names = (*inertial.names, *joints.names)
        self.units = (*inertial.units, *joints.units)
        self.size = inertial.size + joints.size
        self.initial = np.concatenate([inertial.initial, joints.initial])
        self.typical = np.concatenate([inertial.typical, joints.typical])
        self.bodies = inertial.bodies
        self.per_body = inertial.per_body
        self.translations = inertial.translations
        self._values = joints.known.copy()  # of all kinds and shafts, at the loaded estimate
        D = joints.tables[-1]
        self._shafts = np.einsum("si,sj->ijs", D, D).reshape(-1, len(D))  # D^T diag(rotors) D
        self._places = np.ravel_multi_index(joints.places, self._values.shape)
        self._values.put(self._places, joints.initial)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by the arguments: the loaded estimate is scratch, which is written."""
        return type(self), (self.inertial, self.joints)

    def bare(self, robot: Robot) -> Robot:
        """Return a robot without rotors and friction."""
        return without_joint_effects(robot)

    def load(self, a_d: np.ndarray) -> None:
        """Make a_d (p) the estimate, each block with its part."""
        if a_d.shape != (self.size,):
            raise ParameterError(f"expected {self.size} numbers, got {a_d.shape}.", where="a_d")
        size = self.inertial.size
        self._values.put(self._places, a_d[size:])
        self.inertial.load(a_d[:size])

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return M a + C v + g + friction (n)."""
        joints = self.joints
        tau = self.inertial.torque(q, v, a)
        return joints.added(self._values, q, v, a, 1.0, joints.nothing, tau)[1]

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M (n, n), rotors included."""
        M = self.inertial.mass_matrix(q)
        M += self._shafts.dot(self._values[0]).reshape(M.shape)
        return M

    def regressor(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y (n, p)."""
        joints = self.joints
        Y = self.inertial.regressor(q, v, a)
        return joints.added(joints.known, q, v, a, 1.0, Y, joints.zero)[0]

    def slotine_li(
        self, q: np.ndarray, v: np.ndarray, v_r: np.ndarray, a_r: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Y_r (n, p) and the torque M a_r + C v_r + g + friction (n) at the estimate."""
        Y, tau = self.inertial.slotine_li(q, v, v_r, a_r)
        return self.joints.added(self._values, q, v_r, a_r, 1.0, Y, tau)

    def momentum(self, q: np.ndarray, v: np.ndarray) -> Momentum:
        """Return momentum and rest of the torque.

        Rotors have the momentum diag(armature) v. Friction has none and belongs to the rest.
        """
        Y_M, Y_0, p_0, tau_0 = self.inertial.momentum(q, v)
        joints = self.joints
        known = joints.known
        zero = joints.zero
        Y_M, p_0 = joints.added(known, q, zero, v, 0.0, Y_M, p_0)
        Y_0, tau_0 = joints.added(known, q, v, zero, 1.0, Y_0, tau_0)
        return Momentum(Y_M, Y_0, p_0, tau_0)

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the parameters (p) of a robot with the same chain; None if a block has none."""
        inertial = self.inertial.value(self.bare(robot))
        joints = self.joints.value(robot)
        return None if inertial is None or joints is None else np.concatenate([inertial, joints])

    def robot(self, a_d: np.ndarray, nominal: Robot) -> Robot:
        """Return the nominal robot with the bodies and joints of the parameters a_d (p).

        Raises:
            ParameterError: as the inertial block.
        """
        size = self.inertial.size
        return self.joints.robot(a_d[size:], self.inertial.robot(a_d[:size], nominal))

    def with_load(self, a_d: np.ndarray, before: Robot, after: Robot) -> np.ndarray | None:
        """Return the estimate (p) after an announced change of load; that of the joints stays."""
        size = self.inertial.size
        inertial = self.inertial.with_load(a_d[:size], self.bare(before), self.bare(after))
        return None if inertial is None else np.concatenate([inertial, a_d[size:]])
