"""Effects of the joints on the dynamics: rotor inertia, friction and constant torques.

A shaft is what a motor turns: one for each joint, and further ones that turn with two joints, see
``Shaft``. The torque of each is linear in its coefficients; see ``Friction`` for the equation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pinocchio as pin
from numpy import empty

from .._checks import name_list, word
from .._kernels import models as kernels
from ..description.chain import effort_limits
from ..description.floating_base import BASE_JOINTS
from ..exceptions import ParameterError
from ..robot.changes import Friction
from ..robot.robot import Robot
from .regressor import Regressor, moves

# Kind of coefficient -> its unit at a revolute joint, and at a prismatic one.
_UNITS = {
    "armature": ("kg m^2", "kg"),
    "viscous": ("N m s/rad", "N s/m"),
    "coulomb": ("N m", "N"),
    "gear_friction": ("", ""),
    "asymmetry": ("N m", "N"),
    "offset": ("N m", "N"),
}
KINDS = tuple(_UNITS)
USUAL = "armature", "viscous", "coulomb"  # "all" that is usually unknown
_SIGNED = KINDS.index("asymmetry")  # this and the following kinds may be negative
_OF_SHAFTS = len(USUAL)  # kinds that a shaft of two joints has
ALL, NONE = "all", "none"
# Typical joint speed and acceleration [rad/s, rad/s^2, or in m]; half: errors of a Panda 1.1 to 1.5
# times as large; twice: 0.6 to 0.9 times, but what is learned in a push is forgotten later.
_SPEED = 0.5
# Coulomb friction of a motor, as a share of its effort limit; half, twice: pushed errors of a Panda
# 15 % smaller, 22 % larger; an A1's of its joints half and 1.6 times.
_OF_EFFORT = 0.02
# The largest deceleration that it causes [rad/s^2 or m/s^2]; half, twice: after a push errors of a
# UR10 1.26 and 0.94 times as large, of a Solo12's joints half and 1.3 times.
_BRAKING = 50.0


def chosen_kinds(unknown: str | Sequence[str]) -> tuple[str, ...]:
    """Return the kinds of coefficients that a user's words name.

    Args:
        unknown: "all" (armature, viscous and coulomb), "none", or some of ``KINDS``; also a kind of
            one joint or shaft, as "elbow.offset".

    Raises:
        InputError: another word; the message suggests the nearest one.
    """
    chosen = name_list(unknown, "unknown.effects", ParameterError)
    if len(chosen) == 1:
        chosen = list({ALL: USUAL, NONE: ()}.get(chosen[0], chosen))
    for each in chosen:
        word(each.rpartition(".")[2], KINDS, "unknown.effects")
    return tuple(chosen)


class JointEffects:
    """The torque of all shafts, D^T f(D v, D a), D the identity above further directions.

        f = armature a + viscous v + (coulomb + gear_friction |g|) sigma(v)
            + asymmetry |sigma(v)| + offset.

    The coefficients of the unknown kinds are parameters, one per joint. Those of the other kinds
    have their nominal values. sigma is known, and g(q), the gravity torque of the model:
    see ``Friction``. n: joints, m: shafts, p: unknown coefficients.

    Attributes:
        names: one name a parameter.
        size: p.
        signed: number of parameters that may be negative, the last ones.
        initial: (p) nominal values. An unknown coefficient with the nominal value zero starts from
            a tenth of the typical one: an estimate kept positive by its metric cannot leave zero.
            Those that may be negative start from zero.
        typical: (p) typical coefficients, the scales of their adaptation.
        units: one unit a parameter.
        known: (6, m) coefficients of all kinds and shafts, zero where they are unknown.
        places: (p), (p) kind and shaft of each parameter.
        tables: column (6, m) of each coefficient among the parameters, -1 where it is known; shape
            of the friction (3, m); D (m, n); as the kernel ``add_joint_effects`` takes them.
        zero, nothing: (n) zeros, and a matrix (n, 0).
    """

    def __init__(self, robot: Robot, unknown: str | Sequence[str] = ALL) -> None:
        """Choose the unknown kinds, as ``chosen_kinds``.

        Raises:
            InputError: as ``chosen_kinds``, or a joint that does not exist.
        """
        friction = robot.friction
        self._n = robot.model.nv
        pairs = chosen_coefficients(robot, unknown)
        at = tuple(np.array(list(pairs.values()), dtype=np.int64).reshape(-1, 2).T)
        self.known = coefficients(robot)
        typical = typical_coefficients(robot)
        signed = at[0] >= _SIGNED
        stated = signed | (self.known[at] > 0.0)
        self.initial = np.where(stated, self.known[at], 0.1 * _all_shafts(robot, typical)[at])
        self.known[at] = 0.0
        columns = np.full(self.known.shape, -1, dtype=np.int64)
        columns[at] = np.arange(len(pairs))
        self.places = at
        D = np.concatenate([np.eye(self._n), friction.directions])
        self.tables = (columns, _shape(friction), D)
        self.names = tuple(pairs)
        self.size = len(pairs)
        self.signed = int(np.count_nonzero(signed))
        slides = robot.sliding.tolist()
        slides += [slides[part.joints[0]] for part in friction.shafts]
        self.units = tuple(_UNITS[KINDS[kind]][slides[shaft]] for kind, shaft in pairs.values())
        self.typical = _all_shafts(robot, expected_coefficients(robot, typical))[at]
        self.zero = np.zeros(self._n)
        self.nothing = np.zeros((self._n, 0))
        loaded = friction.loaded or KINDS.index("gear_friction") in at[0]
        self._bodies = Regressor(robot.model) if loaded else None

    def regressor(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return Y_j (n, p) at q (nq), velocity v and acceleration a (n) of the joints."""
        return self.added(self.known, q, v, a, 1.0, self.nothing, self.zero)[0]

    def added(
        self,
        values: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        one: float,
        Y_b: np.ndarray,
        tau_b: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return [Y_b, Y_j] (n, p_b + p), and tau_b with the joints' torque added (n).

        Args:
            values: (6, m) coefficients of all kinds and shafts, for the torque.
            q: (nq) configuration.
            v: (n) joint velocity [rad/s or m/s].
            a: (n) joint acceleration [rad/s^2 or m/s^2].
            one: factor of a constant torque, zero for the momentum.
            Y_b: (n, p_b) regressor of the bodies.
            tau_b: (n) torque of the bodies.
        """
        Y = empty((self._n, Y_b.shape[1] + self.size))
        tau = empty(self._n)
        load = self.zero
        if self._bodies is not None:  # something depends on what the gears carry
            load = np.abs(self._bodies.torque(q, self.zero, self.zero))
        kernels.add_joint_effects(values, *self.tables, v, a, load, one, Y_b, tau_b, Y, tau)
        return Y, tau

    def robot(self, a_j: np.ndarray, nominal: Robot) -> Robot:
        """Return the nominal robot with the coefficients a_j (p)."""
        values = coefficients(nominal)
        n = self._n
        values[self.places] = a_j
        joints = dict(zip(KINDS[1:], values[1:, :n], strict=True))
        shafts = tuple(
            replace(part, **dict(zip(USUAL, own, strict=False)))
            for part, own in zip(nominal.friction.shafts, values[:, n:].T.tolist(), strict=True)
        )
        friction = replace(nominal.friction, **joints, shafts=shafts)
        return nominal.changed(armature=values[0, :n], friction=friction)

    def value(self, robot: Robot) -> np.ndarray | None:
        """Return the coefficients (p) of a robot; None if those of a known kind differ."""
        if not np.array_equal(robot.friction.directions, self.tables[2][self._n :]):
            return None
        true = coefficients(robot)
        a_j = true[self.places]
        true[self.places] = 0.0
        same = np.allclose(_shape(robot.friction), self.tables[1], atol=0.0)
        return a_j if same and np.allclose(true, self.known) else None


def chosen_coefficients(robot: Robot, unknown: str | Sequence[str]) -> dict[str, tuple[int, int]]:
    """Return name -> (kind, shaft) of each chosen coefficient, ordered by kind, then by shaft.

    A free base has none.

    Raises:
        InputError: as ``chosen_kinds``, or a joint or shaft that does not exist, or has no such
            coefficient.
    """
    words = chosen_kinds(unknown)
    shafts = robot.friction.shafts
    names = [*robot.joint_names, *(part.name(robot.joint_names) for part in shafts)]
    every = {
        f"{names[shaft]}.{kind}": (number, shaft)
        for number, kind in enumerate(KINDS)
        for shaft in range(len(names) if number < _OF_SHAFTS else robot.model.nv)
        if names[shaft] not in BASE_JOINTS
    }
    for each in words:
        word(each, (*KINDS, *every), "unknown.effects")
    return {name: pair for name, pair in every.items() if name in words or KINDS[pair[0]] in words}


def _shape(friction: Friction) -> np.ndarray:
    """Return 1 / threshold, breakaway - 1 and 1 / fading (3, m) of all shafts."""
    of_shafts = [[part.threshold, 0.0, 1.0] for part in friction.shafts]
    shape = np.column_stack([friction.shape, *of_shafts])
    shape[0] = 1.0 / shape[0]
    return shape


def _all_shafts(robot: Robot, typical: np.ndarray) -> np.ndarray:
    """Return typical coefficients (6, m), from those of the usual kinds of the joints (3, n).

    Gears add a tenth of the torque that they carry.
    """
    joints = np.array([*typical, np.full(robot.model.nv, 0.1), typical[2], typical[2]])
    of_shafts = [joints[:, part.joints].mean(axis=1) for part in robot.friction.shafts]
    return np.column_stack([joints, *of_shafts])


def coefficients(robot: Robot) -> np.ndarray:
    """Return the coefficients (6, m) of all shafts of a robot, kinds in the order of ``KINDS``."""
    friction = robot.friction
    joints = np.array([robot.model.armature, *(getattr(friction, kind) for kind in KINDS[1:])])
    shafts = [[getattr(shaft, kind, 0.0) for kind in KINDS] for shaft in friction.shafts]
    return np.column_stack([joints, *shafts])


def without_joint_effects(robot: Robot) -> Robot:
    """Return a robot with the same bodies, no rotors and no friction."""
    return robot.changed(armature=0.0, friction=Friction())


@lru_cache(maxsize=1)  # asked for by each part of a controller
def typical_coefficients(robot: Robot) -> np.ndarray:
    """Return typical armature, viscous and Coulomb coefficients (3, n) for a robot of this size.

    The rotor inertia is half the inertia that the joint moves at home. Coulomb friction is a tenth
    of the joint's typical torque, viscous friction as much at a typical speed. The typical torque
    is the root mean square over seeded states around home, but at least that of the joints further
    out, since motors do not become larger towards the tip.
    """
    model = robot.model
    data = model.createData()
    rng = np.random.default_rng(0)
    torques = []
    for _ in range(100):
        q = pin.integrate(model, robot.q0, rng.uniform(-0.3, 0.3, model.nv))
        v, a = _SPEED * rng.standard_normal((2, model.nv))
        torques.append(pin.rnea(model, data, q, v, a))
    own = np.sqrt(np.mean(np.square(torques), axis=0))
    torque = (own[:, None] * moves(model)[1:]).max(axis=0)
    inertia = np.diag(pin.crba(model, data, robot.q0))
    return np.array([0.5 * inertia, 0.1 * torque / _SPEED, 0.1 * torque])


def expected_coefficients(robot: Robot, typical: np.ndarray) -> np.ndarray:
    """Return typical coefficients (3, n), with the friction of large motors at light joints.

    A motor's Coulomb friction is about a fiftieth of its effort limit, however light its load. It
    is limited to the friction that decelerates the joint's inertia at home at 50 rad/s^2 (or
    m/s^2).
    """
    inertia = 2.0 * typical[0]
    efforts = effort_limits(robot.model)
    motor = np.where(np.isfinite(efforts), _OF_EFFORT * efforts, 0.0)
    coulomb = np.maximum(typical[2], np.minimum(motor, _BRAKING * inertia))
    return np.array([typical[0], coulomb / _SPEED, coulomb])
