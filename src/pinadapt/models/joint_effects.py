"""Effects of the joints on the dynamics: rotor inertia, viscous and Coulomb friction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy import empty

from .._checks import name_list
from .._kernels import models as kernels
from ..description.chain import effort_limits
from ..exceptions import ParameterError, did_you_mean
from ..robot.robot import Robot
from .regressor import Momentum

# Kind of coefficient -> its unit at a revolute joint, and at a prismatic one.
_UNITS = {
    "armature": ("kg m^2", "kg"),
    "viscous": ("N m s/rad", "N s/m"),
    "coulomb": ("N m", "N"),
}
KINDS = tuple(_UNITS)
ALL, NONE = "all", "none"
_SAMPLES = 100  # random states
_SPEED = 0.5  # typical joint speed and acceleration [rad/s, rad/s^2, or in m]
_OF_EFFORT = 0.02  # Coulomb friction of a motor, as a share of its effort limit,
_BRAKING = 50.0  # and the largest deceleration that it causes [rad/s^2 or m/s^2]
_SLIDING = 3.0  # thresholds of speed at which the smoothed sign is 0.995
_START = 0.1  # initial value of an unknown coefficient, as a share of the typical one


def chosen_kinds(unknown: str | Sequence[str]) -> tuple[str, ...]:
    """Return the kinds of coefficients that a user's words name, in the order of ``KINDS``.

    Args:
        unknown: "all", "none", or some of "armature", "viscous" and "coulomb".

    Raises:
        ParameterError: another word; the message suggests the nearest one.
    """
    chosen = name_list(unknown, "unknown.joint", ParameterError)
    if len(chosen) == 1:
        chosen = list({ALL: KINDS, NONE: ()}.get(chosen[0], chosen))
    for word in chosen:
        if word not in KINDS:
            raise ParameterError(
                f"'{word}' must be one of {list(KINDS)}, 'all' or 'none'."
                f"{did_you_mean(word, (*KINDS, ALL, NONE))}",
                where="unknown.joint",
            )
    return tuple(kind for kind in KINDS if kind in chosen)


class JointEffects:
    """tau = diag(armature) a + diag(viscous) v + diag(coulomb) tanh(v / threshold).

    The coefficients of the unknown kinds are parameters, one per joint. Those of the other kinds
    have their nominal values. n: joints, p: n times the number of unknown kinds.

    Attributes:
        names: one name a parameter.
        size: p.
        initial: (p) nominal values. An unknown coefficient with the nominal value zero starts from
            a tenth of the typical one: an estimate kept positive by its metric cannot leave zero.
        typical: (p) typical coefficients, the scales of their adaptation.
        units: one unit a parameter.
        armature: (n) at the loaded estimate [kg m^2 or kg].
    """

    def __init__(self, robot: Robot, unknown: str | Sequence[str] = ALL) -> None:
        """Choose the unknown kinds, as ``chosen_kinds``.

        Raises:
            ParameterError: as ``chosen_kinds``.
        """
        kinds = chosen_kinds(unknown)
        n = robot.model.nv
        self._threshold = robot.friction.threshold
        self._unknown = [KINDS.index(kind) for kind in kinds]
        self._values = coefficients(robot)
        typical = typical_coefficients(robot)
        for kind in self._unknown:
            self._values[kind] = np.where(
                self._values[kind] > 0.0, self._values[kind], _START * typical[kind]
            )
        self.names = tuple(f"{joint}.{kind}" for kind in kinds for joint in robot.joint_names)
        self.size = len(self.names)
        self.units = tuple(
            _UNITS[kind][slides] for kind in kinds for slides in robot.slides.values()
        )
        self.initial = self._values[self._unknown].ravel()
        self.typical = expected_coefficients(robot, typical)[self._unknown].ravel()
        self._kinds = np.array(self._unknown, dtype=np.int64)
        self._n = n

    @property
    def armature(self) -> np.ndarray:
        """Rotor inertias (n) at the loaded estimate [kg m^2 or kg]."""
        return self._values[0]

    def load(self, a: np.ndarray) -> None:
        """Make a (p) the estimate at which the torque is evaluated."""
        kernels.take_coefficients(a, self._kinds, self._values)

    def torque(self, v: np.ndarray, a: np.ndarray, inertial: np.ndarray) -> np.ndarray:
        """Return the torque (n) [N m or N] at the loaded estimate plus an inertial torque (n)."""
        tau = empty(self._n)
        kernels.joint_torque(self._values, v, a, self._threshold, inertial, tau)
        return tau

    def regressor(self, v: np.ndarray, a: np.ndarray, inertial: np.ndarray) -> np.ndarray:
        """Return (n, p_b + p): an inertial regressor (n, p_b), then the unknown coefficients'."""
        if not self.size:
            return inertial
        Y = empty((self._n, inertial.shape[1] + self.size))
        kernels.joint_columns(inertial, self._kinds, v, a, self._threshold, Y)
        return Y

    def sliding(self, v: np.ndarray) -> np.ndarray:
        """Tell for each joint (n) whether noise of v (n) cannot change the sign of its friction.

        That is, whether it moves faster than three thresholds, or its Coulomb friction is known.
        """
        if KINDS.index("coulomb") not in self._unknown:
            return np.ones(self._n, dtype=bool)
        return np.abs(v) > _SLIDING * self._threshold

    def robot(self, a: np.ndarray, nominal: Robot) -> Robot:
        """Return the nominal robot with the coefficients a (p)."""
        values = coefficients(nominal)
        values[self._unknown] = a.reshape(len(self._unknown), self._n)
        armature, viscous, coulomb = values
        return nominal.changed(armature=armature, viscous=viscous, coulomb=coulomb)

    def momentum(self, v: np.ndarray, inertial: Momentum) -> Momentum:
        """Return an inertial momentum and rest with those of the joints added.

        Rotors have the momentum diag(armature) v. Friction has none and belongs to the rest.
        """
        known, zero = self._values.copy(), np.zeros(self._n)
        known[self._unknown] = 0.0
        p_0, tau_0 = empty(self._n), empty(self._n)
        kernels.joint_torque(known, zero, v, self._threshold, inertial.p_0, p_0)
        kernels.joint_torque(known, v, zero, self._threshold, inertial.tau_0, tau_0)
        Y_M, Y_0 = self.regressor(zero, v, inertial.Y_M), self.regressor(v, zero, inertial.Y_0)
        return Momentum(Y_M, Y_0, p_0, tau_0)

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the coefficients (p) of a robot; None if those of a known kind differ."""
        true = coefficients(robot)
        known = [kind for kind in range(len(KINDS)) if kind not in self._unknown]
        same = np.allclose(true[known], self._values[known])
        same = same and robot.friction.threshold == self._threshold
        return true[self._unknown].ravel() if same else None


def coefficients(robot: Robot) -> np.ndarray:
    """Return armature, viscous and Coulomb coefficients (3, n) of a robot."""
    friction = robot.friction
    return np.array([robot.model.armature, friction.viscous, friction.coulomb], dtype=float)


def without_joint_effects(robot: Robot) -> Robot:
    """Return a robot with the same bodies, no rotors and no friction."""
    return robot.changed(armature=0.0, viscous=0.0, coulomb=0.0)


def typical_coefficients(robot: Robot) -> np.ndarray:
    """Return typical armature, viscous and Coulomb coefficients (3, n) for a robot of this size.

    The rotor inertia is half the inertia that the joint moves at home. Coulomb friction is a tenth
    of the joint's typical torque, viscous friction as much at a typical speed. The typical torque
    is the root mean square over seeded states around home, but at least that of the joints further
    out, since motors do not become larger towards the tip.
    """
    model, data, rng = robot.model, robot.model.createData(), np.random.default_rng(0)
    torques = []
    for _ in range(_SAMPLES):
        q = pin.integrate(model, robot.q0, rng.uniform(-0.3, 0.3, model.nv))
        v, a = _SPEED * rng.standard_normal((2, model.nv))
        torques.append(pin.rnea(model, data, q, v, a))
    torque = np.maximum.accumulate(np.sqrt(np.mean(np.square(torques), axis=0))[::-1])[::-1]
    inertia = np.diag(pin.crba(model, data, robot.q0))
    return np.array([0.5 * inertia, 0.1 * torque / _SPEED, 0.1 * torque])


def expected_coefficients(robot: Robot, typical: np.ndarray) -> np.ndarray:
    """Return typical coefficients (3, n), with the friction of large motors at light joints.

    A motor's Coulomb friction is about a fiftieth of its effort limit, however light its load. It
    is limited to the friction that decelerates the joint's inertia at home at 50 rad/s^2 (or
    m/s^2).
    """
    inertia = np.diag(pin.crba(robot.model, robot.model.createData(), robot.q0))
    efforts = effort_limits(robot.model)
    motor = np.where(np.isfinite(efforts), _OF_EFFORT * efforts, 0.0)
    coulomb = np.maximum(typical[2], np.minimum(motor, _BRAKING * inertia))
    return np.array([typical[0], coulomb / _SPEED, coulomb])
