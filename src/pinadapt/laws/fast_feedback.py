"""Any law on a robot with elastic joints: fast feedback of the springs around it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._checks import instance, joint_numbers, take_checked
from ..exceptions import GainError, InputError, MeasurementError, RobotError
from ..models.typical_motion import joint_inertia
from ..robot.motors import Actuators
from ..robot.robot import Robot
from ..signals import Signals
from ..tasks.task import JointTask
from .law import Command, EstimatedModel, Law

# of the motor's inertia over the period, at most; half: springs ring; twice: the same
_STEP = 0.4


@dataclass(frozen=True, eq=False)
class FastFeedback:
    """Fast feedback for elastic joints, around any law; all but the torque is that law's.

    F. Ghorbel, J. Y. Hung, M. W. Spong, *Adaptive control of flexible-joint manipulators*, IEEE
    Control Systems Magazine 9(7) (1989) 9-13.

    Law:          tau = tau_s + K_f (qd - w), tau_s the torque of a law for the rigid robot at the
                  links' q and qd, w the velocity of the motors after their gears.
    Adaptation:   that of the law.
    Closed loop:  with springs K, rotors B, M_l the links' inertia, z = K (motor - link) the torque
                  of the springs:  B dw/dt = tau_s - K_f K^-1 dz/dt - z,
                  d^2z/dt^2 + K (B^-1 K_f K^-1 dz/dt + (B^-1 + M_l^-1) z) = K (B^-1 tau_s + ...).
    V:            that of the law, of the slow motion alone. dV/dt is that of the law where link and
                  motor move alike, w = qd; it is no equality elsewhere.
    Assumptions:  singular perturbation: K = K_1 / eps^2 and K_f = K_2 / eps, eps small, K_1 and K_2
                  positive diagonal. On the slow manifold z = M_l qdd + C qd + g: the robot is the
                  rigid one with the inertia M_l + B, and K_f (qd - w) = -eps K_2 K_1^-1 dz/dt is of
                  the order of eps. The deviation eta of z from the manifold obeys, in the fast time
                  t / eps, the boundary layer eta'' + K_1 B^-1 K_2 K_1^-1 eta' + K_1 (B^-1 +
                  M_l^-1) eta = 0. It is exponentially stable, uniformly in q, so that by Tikhonov's
                  theorem the motion stays within O(eps) of the rigid robot's on finite intervals.
                  Late motors are not in the proof.

    ``make_controller(robot, law=FastFeedback("separation"), limits=Limits(actuators=...))`` tunes
    the law as without it, and K_f for declared springs with ``encoders="link"``: the fast modes of
    each joint at home are damped at 1 / sqrt(2) of the critical value, K_f at most 0.4 B / dt.
    Every ``Measurement`` then needs w.

    Attributes:
        law: the law, or the name of one that ``make_controller`` makes.
        gain: K_f, a number or one per joint (n) [N m s/rad or N s/m]; None: from the springs.

    Raises:
        GainError: a gain that is not positive.
        InputError: neither a name nor a law, or a law that is such feedback already.
    """

    law: Any
    gain: Any = None

    name = "fast feedback"
    sources = ("GhorbelHungSpong1989",)

    def __post_init__(self) -> None:
        """Check the gain, and add to the name and the sources of the law."""
        instance(self.law, Law | str, "law")
        if self.gain is not None:
            take_checked(self, joint_numbers, "", "gain", zero=False, error=GainError)
        if isinstance(self.law, Law):
            object.__setattr__(self, "name", f"{self.law.name}, {type(self).name}")
            object.__setattr__(self, "sources", (*type(self).sources, *self.law.sources))

    def __getattr__(self, name: str) -> Any:
        """Return a gain, a method or another attribute of the law.

        Raises:
            AttributeError: it has none of this name.
        """
        if name.startswith("__") or "law" not in self.__dict__:
            raise AttributeError(name)
        return getattr(self.law, name)

    def adjusted(self, **values: Any) -> FastFeedback:
        """Return this feedback around the law with other values; see ``Law.adjusted``."""
        return replace(self, law=self.law.adjusted(**values))

    def of_joints(self, task: JointTask) -> FastFeedback | None:
        """Return this feedback around that of the law with the joints as its task."""
        law = self.law.of_joints(task)
        return None if law is None else replace(self, law=law)

    def gain_for(self, robot: Robot, actuators: Actuators, dt: float) -> np.ndarray:
        """Return K_f (n) [N m s/rad or N s/m] for a robot with actuators at a period dt [s].

        Raises:
            GainError: a given one has another size.
            InputError: encoders at the motors, or neither springs nor a gain.
            RobotError: a motor without inertia.
        """
        missing = actuators.encoders != "link" if actuators.elastic else self.gain is None
        if missing:
            raise InputError(
                "fast feedback needs springs, encoders at the links, and the motors' velocity.",
                where="limits.actuators",
                hint='Declare Actuators(stiffness=..., encoders="link"), or give the gain of '
                "springs that are not declared: FastFeedback(law, gain).",
            )
        if self.gain is not None:
            return joint_numbers(self.gain, "gain", robot.model.nv, error=GainError)
        B = np.array(robot.model.armature)
        K = actuators.of(robot).stiffness
        if not (B > 0.0).all():
            raise RobotError(
                f"motors need inertia, got the armature {B.tolist()} kg m^2.",
                where="armature",
                hint="Set it with Robot.changed(armature=...), or give the gain itself.",
            )
        fast = np.sqrt(K * (1.0 / B + 1.0 / (joint_inertia(robot) - B)))
        return np.minimum(np.sqrt(2.0) * fast * B, _STEP * B / dt)

    def command(self, s: Signals, model: EstimatedModel) -> Command:
        """Return the law's command, K_f (qd - w) added to its torque.

        Raises:
            MeasurementError: the motors' velocity is missing.
        """
        if s.w is None:
            raise MeasurementError("w", None, "is missing, and fast feedback needs it")
        found = self.law.command(s, model)
        return replace(found, torque=found.torque + self.gain * (s.v - s.w))
