"""The check before a run: sampling period, actuators, sensors.

Each part of the closed loop is linearised over a typical motion of the model and sampled as the
controller does it, torques and gradients held for dt. A part is stable while the spectral radius of
its transition matrix is at most one. The real inertias differ from the model's: stability is
required with feedback and kinematic adaptation doubled, and with the rates of the dynamic
adaptation 1.5 times as large, as for bodies a third lighter. Where actuators are declared, or known
of a simulated robot, their delay, bandwidth and springs are in the loop, see ``LinearisedJoints``.
A period may also leave a loop that is stable and slow, motors may be too weak to hold the arm, and
sensors worse than those that filters and rates were chosen for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any, TypeAlias

import numpy as np

from .._checks import arithmetic, instance, positive
from ..adaptation.adaptation import Estimate
from ..controller.controller import Controller
from ..laws.fast_feedback import FastFeedback
from ..laws.law import Feedback
from ..models.typical_motion import TypicalMotion
from ..records import SensorQuality
from ..robot.motors import Actuators, JointActuators
from ..robot.workspace import rounded_down
from .defaults import bandwidth, frequency, quiet_start, usual_bandwidth

# by which loops, and by which adaptations may be faster than the model's, and sensors worse than
# declared; half: links lighter than described swing; twice: default gains at long periods are half
# as large
_MARGIN, _SMALL_MARGIN = 2.0, 1.5
_SLACK = 0.95  # of a share at the border of stability; 0.5: that share is halved
_LEAST = 1e-6  # smallest share of a gain, and rounding of double roots; half, twice: the same
_STABLE = 1.0 + _LEAST
# of a robot's bandwidth, from which on a period is to blame; half: found at twice the period
_SLOWED = 0.25
# of the inertia that a joint moves, where a description has no rotors; half: slower gains
_ROTOR = 0.5
_FEEDBACK, _DYNAMICS = "task feedback", "adaptation of the dynamics"

Radius = Callable[[float, float], float]  # of dt [s] and factor
Part: TypeAlias = tuple[str, Mapping[str, float], Radius]  # name, gains with powers of the factor


@dataclass(frozen=True)
class Finding:
    """What is wrong with a loop before it runs.

    Attributes:
        part: of the loop.
        words: what is wrong, and what to take instead.
        longest: the longest period at which the part is stable [s]; zero if there is none.
        factors: by name, what each gain must be multiplied with to be stable; empty if no gain
            helps.
    """

    part: str
    words: str
    longest: float = 0.0
    factors: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        """Return what is wrong, and what to take instead."""
        return self.words


@arithmetic("dt")
def preflight(
    controller: Controller, dt: float, actuators: Actuators | None = None
) -> list[Finding]:
    """Return what is too fast at the period dt [s], or too slow; empty if all is well.

    A controller put together by hand, without the typical motion that ``make_controller`` gives it,
    is not checked. If the damping of the feedback alone is too fast for dt, only the feedback is
    returned, as no rate of adaptation would help.

    Args:
        controller: to be checked.
        dt: sampling period [s].
        actuators: of the robot; None: those for which the controller was made.

    Raises:
        InputError: no controller, a period that is not positive, or actuators of another size.
    """
    instance(controller, Controller, "controller")
    instance(actuators, Actuators | None, "actuators")
    motion = controller.motion
    dt = positive(dt, "dt")
    findings = list[Finding]()
    if motion is None:
        return findings
    actuators = actuators or controller.limits.actuators
    for part, gains, radius in _parts(controller, motion, actuators):
        if radius(dt, 1.0) > _STABLE:
            helps = radius(dt, _LEAST) <= _STABLE
            if helps or part == _FEEDBACK:
                findings.append(_too_fast(part, gains if helps else {}, radius, dt, actuators))
    robot = motion.robot
    own = controller.law.own_bandwidth
    share = bandwidth(robot, dt, own) / usual_bandwidth(robot, own)
    if share < _SLOWED:
        longest = dt * share / _SLOWED
        words = (
            f"dt = {dt:.3g} s allows {100.0 * share:.2g} % of the bandwidth of a short period, too "
            f"slow to follow much: take dt <= {rounded_down(longest):.2g} s."
        )
        findings.append(Finding("bandwidth", words, longest))
    return findings


def _too_fast(
    part: str, gains: Mapping[str, float], radius: Radius, dt: float, actuators: Actuators
) -> Finding:
    """Return a finding on a part that is unstable at dt [s], with the gains that help."""
    behind = "" if actuators.ideal else f" behind {actuators.words}"
    longest = _largest(lambda period: radius(period, 1.0), dt)
    longest = longest if longest > 1e-3 * dt else 0.0
    ways = [f"dt <= {rounded_down(longest):.2g} s"] if longest else []
    factor = _largest(partial(radius, dt), 1.0) if gains else 1.0
    factors = {gain: factor**power for gain, power in gains.items()}
    if factors:
        at_most = {name: rounded_down(x) if x < 1.0 else x for name, x in factors.items()}
        ways.append(", ".join(f"{factor:.3g} {name}" for name, factor in at_most.items()))
    if behind:
        ways.append("declare the actuators, pa.Limits(actuators=...)")
    advice = ", or ".join(ways) or "other gains"
    words = f"dt = {dt:.3g} s is too long for the {part}{behind}: take {advice}."
    return Finding(part, words, longest, factors)


def sensor_findings(controller: Controller, quality: SensorQuality) -> list[Finding]:
    """Return in what sensors are worse than those for which the controller was made."""
    made_for = controller.senses.quality
    return [
        Finding(
            "sensors",
            f"{what} is {given:.2g} {unit}, and the controller was made for {own:.2g} {unit}: its "
            "estimates may drift, and its loop swing. Make it for these sensors (sensors=).",
        )
        for what, given, own, unit in (
            ("the velocity noise", quality.v, made_for.v, "rad/s or m/s"),
            ("the noise of x", quality.x, made_for.x, "m"),
        )
        if controller.motion is not None and given > _SMALL_MARGIN * own
    ]


def stable_share_of_adaptation(controller: Controller, motion: TypicalMotion, dt: float) -> float:
    """Return the share of the rates of the dynamic adaptation that passes the check at dt [s]."""
    for part, _, radius in _parts(controller, motion, controller.limits.actuators):
        if part == _DYNAMICS:
            return _stable_share(partial(radius, dt))
    return 1.0


def stable_share_of_feedback(
    of: Callable[[float], Any],
    dt: float,
    motion: TypicalMotion,
    actuators: Actuators,
    K_f: np.ndarray | None = None,
) -> float:
    """Return the share of the feedback's bandwidth that passes the check at dt [s].

    One where the whole passes, and also where no share does. ``of`` returns the feedback of a
    share, or None if unknown; K_f (n) is the gain of fast feedback, or None.
    """
    whole = of(1.0)
    if whole is None:
        return 1.0
    joints = LinearisedJoints(motion, actuators, K_f, of_task=whole.S.ndim == 2)
    return _stable_share(lambda share: joints.feedback_radius(of(share), dt, 1.0))


def _stable_share(radius: Callable[[float], float]) -> float:
    """Return the largest stable share with some slack; one if all is stable, or no share is."""
    if radius(1.0) <= _STABLE or radius(_LEAST) > _STABLE:
        return 1.0
    return _SLACK * _largest(radius, 1.0)


def _largest(radius: Callable[[float], float], start: float) -> float:
    """Return the largest number below an unstable ``start`` at which the radius is stable.

    By bisection of its logarithm, to 0.02 %; a millionth of the start if none is found.
    """
    low = _LEAST * start
    high = start
    for _ in range(16):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if radius(middle) <= _STABLE else (low, middle)
    return low


def _parts(controller: Controller, motion: TypicalMotion, actuators: Actuators) -> Iterator[Part]:
    """Yield of each part of the loop name, gains with the powers of the factor, and radius."""
    law = controller.law
    feedback = law.feedback(motion)
    if feedback is not None:
        K_f = law.gain if isinstance(law, FastFeedback) else None
        joints = LinearisedJoints(motion, actuators, K_f, of_task=feedback.S.ndim == 2)
        yield _FEEDBACK, law.bandwidth_powers, partial(joints.feedback_radius, feedback)
        start = quiet_start(controller.adaptation_d, motion.dynamics.initial)
        Gamma_d = controller.adaptation_d.gain(start)
        if Gamma_d.any():
            effects = law.parameter_effects(motion)
            S = effects @ Gamma_d @ effects.swapaxes(1, 2)
            radius = partial(joints.adaptation_radius, S, feedback.E)
            yield _DYNAMICS, {"gamma_d": 1.0, "gamma_joint": 1.0}, radius
    Gamma_k = controller.adaptation_k.gain(Estimate(motion.kinematics.initial))
    loop = law.kinematic_loop()
    if loop is not None and Gamma_k.any():
        speed = frequency(motion.kinematic_regressors, Gamma_k)
        mode = speed * loop.stiffness**0.5
        if law.uses_position_error:
            speed = frequency(motion.position_regressors, Gamma_k)
        decay = speed**2 * np.linalg.eigvalsh(loop.weight)[-1]
        radius = partial(_kinematic_radius, mode, loop.damping, decay)
        yield "adaptation of the kinematics", {"gamma_k": 1.0}, radius


def _kinematic_radius(mode: float, damping: float, decay: float, dt: float, factor: float) -> float:
    """Return the spectral radius of de/dt = -damping e + w a, da/dt = -w e - decay a, held.

    ``factor`` multiplies the rates of a.
    """
    w = mode * (_MARGIN * factor) ** 0.5
    decay = _MARGIN * factor * decay
    return _median_radius(np.array([[1.0 - dt * damping, dt * w], [-dt * w, 1.0 - dt * decay]]))


class LinearisedJoints:
    """The joints behind their actuators, linearised at rest at states of a typical motion.

    Per state, with M of the model, rotors B, M_l = M - B of the links, and u the torque commanded:

        delay       y = u - 2 b dz/dt, d^2 z/dt^2 = -a z - b dz/dt + u, a = 12 / T^2, b = 6 / T,
                    Pade's form of second order of exp(-p T)
        bandwidth   df/dt = w (y - f)
        rigid       M dv/dt = f
        elastic     M_l dv/dt = K d + D (w - v), B dw/dt = f - K d - D (w - v), dd/dt = w - v

    The torque is held over each period, which is exact. Feedback sees the joints' displacement and
    velocity at the encoders. Springs without damping are taken to have 1 % of the critical one of
    their motors, joints without described rotors to have half of what they move.
    """

    def __init__(
        self,
        motion: TypicalMotion,
        actuators: Actuators,
        K_f: np.ndarray | None = None,
        *,
        of_task: bool = False,
    ) -> None:
        """Take the model's states, and its actuators.

        Args:
            motion: of the model.
            actuators: of the robot.
            K_f: gain (n) of fast feedback, or None.
            of_task: whether feedback is one of the task; else of the joints, in coordinates of unit
                mass.

        Raises:
            InputError: actuators of another number of joints.
        """
        M = motion.mass_matrices
        rotors = motion.robot.model.armature
        self._bandwidth = motion.bandwidth
        if of_task:  # the posture holds the rest
            self._left = M @ motion.right_inverses
            self._right = motion.jacobians
            self._posture = M - self._left @ self._right
        else:
            self._left = M @ motion.unit_masses.swapaxes(1, 2)  # W^-1
            self._right = self._left.swapaxes(1, 2)
            self._posture = np.zeros(M.shape)
        own = actuators.of(motion.robot)
        moved = np.diagonal(M, axis1=1, axis2=2).min(axis=0)
        motor = np.where(rotors > 0.0, rotors, _ROTOR * moved)
        at_states = [_actuated(each, each - np.diag(rotors), motor, own) for each in M]
        self._A, self._B, motors = map(np.array, zip(*at_states, strict=True))
        self._held = lru_cache(maxsize=1)(self._transitions)  # of the last period asked for
        at_links = actuators.elastic and actuators.encoders == "link"
        self._C = np.roll(motors, -len(rotors), axis=2) if at_links else motors
        fast = np.zeros(len(rotors)) if K_f is None else _MARGIN * K_f
        self._fast = fast[:, None] * (motors - self._C)  # fast feedback takes off the torque

    def feedback_radius(self, feedback: Feedback, dt: float, factor: float) -> float:
        """Return the median spectral radius of -(S x + (D + N) dx/dt) held over dt [s], doubled.

        ``factor`` multiplies the bandwidth of S and D.
        """
        S, D, N, _ = feedback
        w = self._bandwidth
        K_P = _MARGIN * factor**2 * self._torque(S) + 0.25 * w**2 * self._posture
        K_D = _MARGIN * self._torque(factor * D + N) + w * self._posture
        Phi, Gamma = self._held(dt)
        gains = np.concatenate([K_D @ self._C + self._fast, K_P], axis=2)
        return _median_radius(Phi - Gamma @ gains)

    def adaptation_radius(self, S: np.ndarray, E: np.ndarray, dt: float, factor: float) -> float:
        """Return the median spectral radius of de/dt = -E e + z, dz/dt = -S e, z = Phi da, held.

        ``factor`` multiplies S, which has its margin; S and E are those at the states.
        """
        S = _SMALL_MARGIN * factor * self._torque(S)
        k = self._A.shape[1]
        Phi, Gamma = (part[:, :k] for part in self._held(dt))
        damped = Phi[..., :k] - Gamma @ (self._torque(E) @ self._C + self._fast)
        one = np.broadcast_to(np.eye(S.shape[-1]), S.shape)
        return _median_radius(np.block([[damped, Gamma], [-dt * S @ self._C, one]]))

    def _transitions(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the transitions over dt [s] under a held torque, of the states and displacements.

        They are (N, k + n, k + n) and (N, k + n, n), k the number of states.
        """
        from scipy.linalg import expm  # here, because scipy is slow to import

        N, n, k = self._C.shape
        system = np.zeros((N, k + 2 * n, k + 2 * n))
        system[:, :k, :k] = self._A
        system[:, k : k + n, :k] = self._C
        system[:, :k, k + n :] = self._B
        moved = expm(dt * system)[:, : k + n]
        return moved[..., : k + n], moved[..., k + n :]

    def _torque(self, feedback: np.ndarray) -> np.ndarray:
        """Return a gain of joints of unit mass, or of the task, as a torque of the joints."""
        return self._left @ feedback @ self._right


def _actuated(
    M: np.ndarray, M_l: np.ndarray, motor: np.ndarray, joints: JointActuators
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A (k, k), B (k, n) and C (n, k) from torques to velocities of the motors at a state.

    The last n states are the velocities of the motors, before them those of the links where there
    are springs.
    """
    one, none, K, D = np.eye(len(M)), np.zeros(M.shape), joints.stiffness, joints.damping
    A = none
    B = np.linalg.inv(M)
    C = one
    if np.isfinite(K).all():
        D = np.where(D > 0.0, D, 2.0 * 0.01 * np.sqrt(K * motor))
        links = np.linalg.inv(M_l)
        drive = np.diag(1.0 / motor)
        A = np.block(
            [
                [none, -one, one],
                [links * K, -links * D, links * D],
                [-drive * K, drive * D, -drive * D],
            ]
        )
        B = np.vstack([none, none, drive])
        C = np.hstack([none, none, one])
    if np.isfinite(joints.bandwidth).any():
        w = np.diag(np.minimum(joints.bandwidth, 1e4))
        A = np.block([[-w, 0.0 * C], [B, A]])
        B = np.vstack([w, 0.0 * B])
        C = np.hstack([none, C])
    if joints.delay.any():
        T = np.maximum(joints.delay, 1e-3 * joints.delay.max())
        a = np.diag(12.0 / T**2)
        b = np.diag(6.0 / T)
        A = np.block([[none, one, 0.0 * C], [-a, -b, 0.0 * C], [0.0 * B, -2.0 * B @ b, A]])
        B = np.vstack([none, one, B])
        C = np.hstack([none, none, C])
    return A, B, C


def _median_radius(transitions: np.ndarray) -> float:
    """Return the median spectral radius of transition matrices (..., k, k)."""
    return np.median(np.abs(np.linalg.eigvals(transitions)).max(axis=-1))
