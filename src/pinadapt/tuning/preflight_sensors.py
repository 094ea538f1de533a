"""Before the run: do camera and encoders suit what the controller was made for?

A frame that is taken for now is a delay of the position feedback by up to its age; the loop of the
typical motion with that delay, as Pade's second-order form of it, must be stable with the stiffness
doubled. Carried frames leave a delay in the kinematic adaptation alone, whose mode must be slower
than the age. Noise of the joint velocity must not exceed what filters and rates were chosen for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..controller.controller import Controller
from ..laws.law import Feedback
from ..records import SensorQuality
from ..robot.workspace import rounded_down
from .defaults import frequency
from .noise import coarseness

_MARGIN = 2.0  # of the stiffness
_UNDECLARED = 1.5  # times the noise that a controller was made for
_COARSEST = 4.0  # times that of 14 bits a turn, see remedies
_LATE = 2.0  # mode times age
_SLOWEST = 1e-6


@dataclass(frozen=True)
class SensorFinding:
    """What of the sensors does not suit the controller.

    Attributes:
        part: "camera" or "encoder".
        flaw: what is wrong, and what to take.
    """

    part: str
    flaw: str

    def __str__(self) -> str:
        """Say it."""
        return f"{self.part}: {self.flaw}"


def sensor_findings(controller: Controller, quality: SensorQuality) -> list[SensorFinding]:
    """Return what of the sensors would spoil the run; an empty list is a go.

    A controller put together by hand, without a typical motion, is not checked.
    """
    if controller.motion is None:
        return []
    found = (_held(controller, quality), _late(controller, quality), _noisy(controller, quality))
    return [finding for finding in found if finding is not None]


def _held(controller: Controller, quality: SensorQuality) -> SensorFinding | None:
    motion, age = controller.motion, quality.age
    assert motion is not None
    if controller.senses.compensator.enabled or not age or not motion.kinematics.positions:
        return None
    feedback = controller.law.feedback(motion)
    if not feedback or _stable(feedback, age):
        return None
    longest, low = age, age * _SLOWEST
    for _ in range(40):
        middle = (low * longest) ** 0.5
        low, longest = (middle, longest) if _stable(feedback, middle) else (low, middle)
    return SensorFinding(
        "camera",
        f"frames up to {1e3 * age:.3g} ms old are taken for now (carry = false), which this "
        f"feedback bears up to {1e3 * rounded_down(low):.2g} ms. Take carry = true, a faster "
        "camera, or a smaller bandwidth (alpha, Kp).",
    )


def _stable(feedback: Sequence[Feedback], delay: float) -> bool:
    """Tell whether d^2 x/dt^2 = -S x(t - delay) - (D + N) dx/dt is, at most of the states."""
    S, D, N, _ = (np.array(part) for part in zip(*feedback, strict=True))
    n, one, zero = S.shape[-1], np.broadcast_to(np.eye(S.shape[-1]), S.shape), np.zeros(S.shape)
    a, b = 12.0 / delay**2, 6.0 / delay  # x(t - delay) = x - 2 b z', z'' = -a z - b z' + x
    system = np.block(
        [
            [zero, one, zero, zero],
            [-_MARGIN * S, -(D + N), zero, 2.0 * b * _MARGIN * S],
            [zero, zero, zero, one],
            [one, zero, -a * one, -b * one],
        ]
    )
    growth = np.linalg.eigvals(system).real.max(axis=-1)
    return bool(np.median(growth) < 1e-6 * n / delay)


def _late(controller: Controller, quality: SensorQuality) -> SensorFinding | None:
    motion, loop = controller.motion, controller.law.kinematic_loop()
    assert motion is not None
    Gamma_k = controller.adaptation_k.gain(motion.kinematics.initial)
    if loop is None or not quality.age or not Gamma_k.any():
        return None
    mode = frequency(motion.kinematic_regressors, Gamma_k) * loop.stiffness**0.5
    if mode * quality.age <= _LATE:
        return None
    return SensorFinding(
        "camera",
        f"frames up to {1e3 * quality.age:.3g} ms old are too late for this kinematic adaptation: "
        f"multiply gamma_k by at most {rounded_down((mode * quality.age) ** -2.0):.2g}, or tell "
        "make_controller of the camera.",
    )


def _noisy(controller: Controller, quality: SensorQuality) -> SensorFinding | None:
    motion, made_for = controller.motion, controller.senses.quality
    assert motion is not None
    if not controller.adaptation_d.gain(controller.dynamics.initial).any():
        return None
    if coarseness(quality, motion.bandwidth) > _COARSEST:
        return SensorFinding(
            "encoder",
            f"a joint velocity with noise of {quality.v:.2g} rad/s or m/s drives the estimates "
            "away whatever the filters. Finer encoders, a velocity sensor, a longer period dt (the "
            'noise of differences falls with it) or adaptation = "none" help.',
        )
    if quality.v > _UNDECLARED * made_for.v:
        return SensorFinding(
            "encoder",
            f"the joint velocity has noise of {quality.v:.2g} rad/s or m/s, and the controller was "
            f"made for {made_for.v:.2g}: its estimates may drift. Tell make_controller of it "
            "(encoder, noise).",
        )
    return None
