"""The check before a run: sampling period, actuators, sensors.

Each part of the closed loop is linearised over a typical motion of the model and sampled as the
controller does it, torques and gradients held for dt. A part is stable while the spectral radius of
its transition matrix is below one. The real inertias differ from the model's: stability is required
with feedback and kinematic adaptation doubled, and with the rates of the dynamic adaptation 1.5
times as large, as for bodies a third lighter. Where rotor inertias are learned, the true ones may
also be those of the description: beside many light links, their guess alone makes a loop too fast.
Where actuators are declared, or known of a simulated robot, their delay, bandwidth and springs are
in the loop, see ``ActuatedJoints``. A period may also leave a loop that is stable and too slow to
follow anything, motors may be too weak to hold or move the arm, and sensors worse than those that
filters and rates were chosen for.
"""

from __future__ import annotations

import math
import warnings
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import cycle
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from .._checks import arithmetic, instance, positive
from ..adaptation.adaptation import Estimate
from ..controller.controller import Controller
from ..laws.fast_feedback import FastFeedback
from ..laws.law import Feedback
from ..models.typical_motion import TypicalMotion
from ..records import SensorQuality
from ..robot.motors import Actuators, JointActuators, overloaded
from ..robot.workspace import rounded_down
from .defaults import bandwidth, frequency

_MARGIN, _ADAPTATION_MARGIN = 2.0, 1.5  # by which loops may be faster than the model's
_SLACK = 0.95  # of a share at the border of stability
_LEAST, _SHARES = 1e-6, 2**16  # smallest share of a gain, and how many up to one: 0.02 % apart
_SHORTEST = 1e-3  # of the period, at which late motors count as stable at no period
_UNSTABLE = 1.0 + 1e-9  # the null space of a redundant arm moves freely
_FREE = 1.0 + 1e-6  # of gains that are nearly zero, whose double roots are rounded
_WRONG, _AWAY = 0.3, 0.08  # of gravity, and what that may displace, of the reach or of a radian
_SLOWED = 0.25  # of a robot's bandwidth, from which on a period is to blame
_NULL = 1e-6  # relative stiffness of directions that the task does not have
_WORSE = 1.5  # times the noise or delay for which a controller was made
_RELATIVE_DAMPING = 0.01  # of springs without a stated one
_ROTOR = 0.5  # of the inertia that a joint moves, where a description has no rotors
_FEEDBACK, _DYNAMICS = "task feedback", "adaptation of the dynamics"
_ROTORLESS = f"{_FEEDBACK}, if the rotors are only those of the description"
_KINEMATICS = "adaptation of the kinematics"

Radius = Callable[..., float]  # of dt [s] and factor, both by name
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
    """Return what is too fast at the period dt [s], too slow or too weak; empty if all is well.

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
    actuators = controller.limits.actuators if actuators is None else actuators
    dt, findings = positive(dt, "dt"), list[Finding]()
    if controller.motion is None:
        return findings
    for part, gains, radius in _parts(controller, controller.motion, actuators):
        if radius(dt=dt, factor=1.0) <= _UNSTABLE or (part == _ROTORLESS and findings):
            continue
        helps = radius(dt=dt, factor=_LEAST) <= _FREE
        if helps or part in (_FEEDBACK, _ROTORLESS):
            words = "" if actuators.ideal or part == _KINEMATICS else actuators.words
            findings.append(_too_fast(part, gains if helps else {}, radius, dt, words))
    slow, limits, held = (
        _too_slow(controller, controller.motion, dt),
        controller.limits.torque,
        None,
    )
    if limits is not None and controller.compensation is None:
        held = overloaded(controller.motion.robot, limits, "the model")
    findings += [] if slow is None else [slow]
    return findings + ([] if held is None else [Finding("motors", held)])


def _too_fast(
    part: str, gains: Mapping[str, float], radius: Radius, dt: float, motors: str
) -> Finding:
    """Return a finding on a part that is unstable at dt [s], behind ``motors`` or ideal ones.

    Args:
        part: its name.
        gains: with powers of the factor, those that help.
        radius: of dt and factor.
        dt: sampling period [s].
        motors: in words, if they are not ideal.
    """
    longest, ways = 0.0, []
    if not motors or radius(dt=_SHORTEST * dt, factor=1.0) <= _UNSTABLE:
        longest = _largest(lambda period: radius(dt=period, factor=1.0), dt)
        ways.append(f"dt <= {rounded_down(longest):.2g} s")
    factors = _stable_factors(gains, radius, dt) if gains else {}
    bounds = [
        f"{name} at most {rounded_down(factor):.2g}"
        if factor <= 1.0
        else f"{name} at least {1.0 / rounded_down(0.99 / factor):.3g}"
        for name, factor in factors.items()
    ]
    if bounds:
        ways.append(f"{', '.join(bounds)} times {'its value' if bounds[1:] == [] else 'theirs'}")
    if part == _ROTORLESS:
        ways.append(
            "say that these are right: unknown=pa.Unknown(armature=False). What is guessed of "
            "unknown rotors is heavy beside these links"
        )
    words = f"dt = {dt:.3g} s is too long for the {part}"
    if motors:
        words = f"the {part} is too fast for {motors} at dt = {dt:.3g} s"
        ways.append("declare them, pa.Limits(actuators=...), in a scenario controller.actuators")
    if motors and "at the links" in motors:
        ways.append("feed the motors' velocity back besides, law=pa.laws.FastFeedback(...)")
    return Finding(part, f"{words}: take {', or '.join(ways)}.", longest, factors)


def _too_slow(controller: Controller, motion: TypicalMotion, dt: float) -> Finding | None:
    """Return a finding if the feedback, slow because of a long period, is too weak.

    Its stiffness is compared with gravity that the model has wrong: displaced by that, until it is
    learned, an arm follows nothing. With a period the displacement grows as its square.
    """
    robot, task, feedback = motion.robot, motion.kinematics.task, controller.law.feedback(motion)
    usual = bandwidth(robot, _SHORTEST * dt, controller.law.own_bandwidth)
    if not feedback or motion.bandwidth >= _SLOWED * usual:
        return None
    m, size, unit = task.size, 1.0, "rad"
    if task.positions:
        m, size, unit = task.positions, robot.reach, "m"
    model, data = robot.model, robot.model.createData()
    g = np.array([pin.computeGeneralizedGravity(model, data, q) for q in motion.states.q])
    J, M, W = (
        np.array(each) for each in (motion.jacobians, motion.mass_matrices, motion.unit_masses)
    )
    soft = np.linalg.pinv(np.array([at.S for at in feedback]), rcond=_NULL)
    if len(feedback) == 1:  # of the task
        moved = soft @ J @ np.linalg.solve(M, g[..., None])
    else:
        moved = J @ W.swapaxes(1, 2) @ soft @ W @ g[..., None]
    way = _WRONG * float(np.median(np.linalg.norm(moved[:, :m, 0], axis=1)))
    if way <= _AWAY * size:
        return None
    longest = dt * math.sqrt(_AWAY * size / way)
    words = (
        f"dt = {dt:.3g} s leaves a feedback so slow that gravity which the model has "
        f"{100 * _WRONG:.0f} % wrong displaces the arm by {way:.2g} {unit} until it is learned: "
        f"take dt <= {rounded_down(longest):.2g} s."
    )
    return Finding("bandwidth", words, longest)


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
        if controller.motion is not None and given > _WORSE * own
    ]


def stable_share_of_adaptation(controller: Controller, dt: float) -> float:
    """Return the share of the rates of the dynamic adaptation that passes the check at dt [s]."""
    motion = controller.motion
    for part, gains, radius in (
        () if motion is None else _parts(controller, motion, controller.limits.actuators)
    ):
        if part == _DYNAMICS:
            if radius(dt=dt, factor=1.0) <= _UNSTABLE or radius(dt=dt, factor=_LEAST) > _FREE:
                return 1.0
            return _SLACK * min(_stable_factors(gains, radius, dt).values())
    return 1.0


def stable_share_of_feedback(
    of: Callable[[float], Sequence[Feedback]],
    dt: float,
    motion: TypicalMotion,
    actuators: Actuators,
    K_f: np.ndarray | None = None,
) -> float:
    """Return the share of the feedback's bandwidth that passes the check at dt [s].

    One where the whole passes, and also where no share does. ``of`` returns the feedback of a
    share; K_f (n) is the gain of fast feedback, or None.
    """
    whole = of(1.0)
    if not whole:
        return 1.0
    joints = _joints(motion, actuators, K_f, len(whole) == 1)

    def radius(share: float) -> float:
        """Return the spectral radius of the loop with a share of the feedback."""
        return joints.feedback_radius(of(share), dt, 1.0)

    if radius(1.0) <= _UNSTABLE or radius(_LEAST) > _FREE:
        return 1.0
    return _SLACK * _largest(radius, 1.0)


def _stable_factors(gains: Mapping[str, float], radius: Radius, dt: float) -> dict[str, float]:
    """Return the factor of each gain, given with its power, that is stable at dt [s]."""
    factor = _largest(lambda factor: radius(dt=dt, factor=factor), 1.0)
    return {gain: factor**power for gain, power in gains.items()}


def _largest(radius: Callable[[float], float], start: float) -> float:
    """Return the largest number below an unstable ``start`` at which the radius is stable.

    It is one of a geometric progression, the next of which is unstable.
    """

    def number(k: int) -> float:
        """Return the k-th number of the progression."""
        return start * _LEAST ** (1.0 - k / _SHARES)

    found = bisect_left(range(1, _SHARES), True, key=lambda k: radius(number(k)) > _UNSTABLE)
    return number(found)


def _parts(controller: Controller, motion: TypicalMotion, actuators: Actuators) -> Iterator[Part]:
    """Yield of each part of the loop name, gains with the powers of the factor, and radius."""
    law, feedback = controller.law, controller.law.feedback(motion)
    if feedback:
        K_f, of_task = law.gain if isinstance(law, FastFeedback) else None, len(feedback) == 1
        joints = _joints(motion, actuators, K_f, of_task)
        yield _FEEDBACK, law.bandwidth_powers, partial(joints.feedback_radius, feedback)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the start of a run warns of unphysical bodies
            start = controller.adaptation_d.init(motion.dynamics.initial)
        Gamma_d = controller.adaptation_d.gain(start)
        if Gamma_d.any():
            effects = law.parameter_effects(motion)
            pairs = [
                (Phi @ Gamma_d @ Phi.T, at.E)
                for Phi, at in zip(effects, cycle(feedback), strict=False)
            ]
            powers = {"gamma_d": 1.0, "gamma_joint": 1.0}
            yield _DYNAMICS, powers, partial(joints.adaptation_radius, pairs)
        M = _described(motion)
        if M is not None and actuators.ideal:  # springs need rotors
            described = ActuatedJoints(motion, actuators, of_task=of_task, true=M)
            yield _ROTORLESS, {}, partial(described.feedback_radius, feedback)
    Gamma_k = controller.adaptation_k.gain(Estimate(motion.kinematics.initial))
    loop = law.kinematic_loop()
    if loop is not None and Gamma_k.any():
        speed = frequency(motion.kinematic_regressors, Gamma_k)
        mode = speed * loop.stiffness**0.5
        if law.uses_position_error:
            speed = frequency(motion.position_regressors, Gamma_k)
        decay = speed**2 * float(np.linalg.eigvalsh(loop.weight)[-1])
        radius = partial(_kinematic_radius, mode, loop.damping, decay)
        yield _KINEMATICS, {"gamma_k": 1.0}, radius


def _described(motion: TypicalMotion) -> np.ndarray | None:
    """Return M (N, n, n) of the description, None where the model has no other rotors."""
    model, own = motion.robot.model, np.array(motion.mass_matrices)
    data = model.createData()
    M = np.array([pin.crba(model, data, q).copy() for q in motion.states.q])
    heavier = np.trace(own - M, axis1=1, axis2=2) > _NULL * np.trace(M, axis1=1, axis2=2)
    return M if heavier.any() else None


class IdealJoints:
    """The loop of rigid joints with motors that give a torque at once, in the feedback's terms."""

    def feedback_radius(self, feedback: Sequence[Feedback], dt: float, factor: float) -> float:
        """Return the median spectral radius of -(S x + (D + N) dx/dt) held over dt, doubled.

        ``factor`` multiplies the bandwidth of S and D.
        """
        S, D, N, _ = (np.array(part) for part in zip(*feedback, strict=True))
        S, D, one = _MARGIN * factor**2 * S, _MARGIN * (factor * D + N), np.eye(S.shape[-1])
        return _median_radius(
            [[one - 0.5 * dt**2 * S, dt * one - 0.5 * dt**2 * D], [-dt * S, one - dt * D]]
        )

    def adaptation_radius(
        self, pairs: Sequence[tuple[np.ndarray, np.ndarray]], dt: float, factor: float
    ) -> float:
        """Return the median spectral radius of de/dt = -D e + z, dz/dt = -S e, z = Phi da, held.

        ``factor`` multiplies S, which has its margin.
        """
        S, D = (np.array(part) for part in zip(*pairs, strict=True))
        one = np.eye(S.shape[-1])
        return _median_radius(
            [[one - dt * D, dt * one], [-dt * _ADAPTATION_MARGIN * factor * S, one]]
        )


class ActuatedJoints:
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
        true: np.ndarray | None = None,
    ) -> None:
        """Take the model's states, and its actuators.

        Args:
            motion: of the model.
            actuators: of the robot.
            K_f: gain (n) of fast feedback, or None.
            of_task: whether feedback is one of the task; else of the joints, in coordinates of unit
                mass.
            true: M (N, n, n) of the robot where it is not the model's.

        Raises:
            InputError: actuators of another number of joints.
        """
        own, M = actuators.of(motion.robot), np.array(motion.mass_matrices)
        self._M, self._of_task = M, of_task
        self._roots = M @ np.array(motion.unit_masses).swapaxes(1, 2)  # W^-1
        self._J, self._inverse = np.array(motion.jacobians), np.array(motion.right_inverses)
        self._w = motion.bandwidth
        rotors = np.array(motion.robot.model.armature)
        self._A, self._B, motors = _chain(M if true is None else true, own, rotors)
        self._C, self._fast, n = motors, np.zeros(motors.shape), M.shape[-1]
        if actuators.elastic and actuators.encoders == "link":
            self._C = np.zeros(motors.shape)
            self._C[:, :, -2 * n : -n] = np.eye(n)
            if K_f is not None:  # fast feedback takes off the torque
                self._fast = _MARGIN * K_f[:, None] * (motors - self._C)
        self._last: tuple[float, np.ndarray, np.ndarray] | None = None

    def feedback_radius(self, feedback: Sequence[Feedback], dt: float, factor: float) -> float:
        """Return the median spectral radius of the sampled loop, as ``IdealJoints``."""
        S, D, N, _ = (np.array(part) for part in zip(*feedback, strict=True))
        K_P = _MARGIN * factor**2 * self._torque(S)
        K_D = _MARGIN * self._torque(factor * D + N)
        if self._of_task:  # the posture holds the rest
            null = self._M @ (np.eye(self._M.shape[-1]) - self._inverse @ self._J)
            K_P, K_D = K_P + 0.25 * self._w**2 * null, K_D + self._w * null
        Phi, Gamma = self._held(dt)
        gains = np.concatenate([K_D @ self._C + self._fast, K_P], axis=2)
        return _median_radius([[Phi - Gamma @ gains]])

    def adaptation_radius(
        self, pairs: Sequence[tuple[np.ndarray, np.ndarray]], dt: float, factor: float
    ) -> float:
        """Return the median spectral radius of the adaptation, as ``IdealJoints``."""
        S, E = (np.array(part) for part in zip(*pairs, strict=True))
        S = _ADAPTATION_MARGIN * factor * self._torque(S)
        k = self._A.shape[1]
        Phi, Gamma = (part[:, :k] for part in self._held(dt))
        damped = Phi[..., :k] - Gamma @ (self._torque(E) @ self._C + self._fast)
        return _median_radius([[damped, Gamma], [-dt * S @ self._C, np.eye(S.shape[-1])]])

    def _held(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the transitions over dt [s] under a held torque, of the states and displacements.

        Gains are varied at one period, so those of the last one are kept.
        """
        from scipy.linalg import expm  # slow to import, and seldom needed

        if self._last is None or self._last[0] != dt:
            (N, n, k), size = self._C.shape, self._C.shape[1] + self._C.shape[2]
            system = np.zeros((N, size + n, size + n))
            system[:, :k, :k], system[:, k:size, :k] = self._A, self._C
            system[:, :k, size:] = self._B
            moved = expm(dt * system)
            self._last = dt, moved[:, :size, :size], moved[:, :size, size:]
        return self._last[1:]

    def _torque(self, feedback: np.ndarray) -> np.ndarray:
        """Return a gain of joints of unit mass, or of the task, as a torque of the joints."""
        if self._of_task:
            return np.asarray(self._M @ self._inverse @ feedback @ self._J)
        return np.asarray(self._roots @ feedback @ self._roots.swapaxes(1, 2))


def _joints(
    motion: TypicalMotion, actuators: Actuators, K_f: np.ndarray | None, of_task: bool
) -> IdealJoints | ActuatedJoints:
    """Return the linearised joints of a robot behind its actuators."""
    if actuators.ideal:
        return IdealJoints()
    return ActuatedJoints(motion, actuators, K_f, of_task=of_task)


System: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # A, B, C, D


def _chain(
    M: np.ndarray, joints: JointActuators, rotors: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A (N, k, k), B (N, k, n) and C (N, n, k) from torques to velocities of the motors.

    The last n states are the velocities of the motors, before them those of the links where there
    are springs.
    """
    one, none = np.eye(M.shape[-1]), np.zeros(M.shape[1:])
    K, D = joints.stiffness, joints.damping
    if np.isfinite(K).all():
        own = np.diagonal(M, axis1=1, axis2=2).min(axis=0)
        motor = np.where(rotors > 0.0, rotors, _ROTOR * own)
        D = np.where(D > 0.0, D, 2.0 * _RELATIVE_DAMPING * np.sqrt(K * motor))
        links, drive = np.linalg.inv(M - np.diag(rotors)), np.diag(1.0 / motor)
        A = _blocks(
            [
                [none, -one, one],
                [links * K, -links * D, links * D],
                [-drive * K, drive * D, -drive * D],
            ]
        )
        found = A, _blocks([[none], [none], [drive]]), _blocks([[none, none, one]]), none
    else:
        found = none, np.linalg.inv(M), one, none
    if np.isfinite(joints.bandwidth).any():
        w = np.diag(np.minimum(joints.bandwidth, 1e4))
        found = _series((-w, w, one, none), found)
    if joints.delay.any():
        T = np.maximum(joints.delay, 1e-3 * joints.delay.max())
        a, b = np.diag(12.0 / T**2), np.diag(6.0 / T)
        A = _blocks([[none, one], [-a, -b]])
        found = _series((A, _blocks([[none], [one]]), _blocks([[none, -2.0 * b]]), one), found)
    A, B, C = (np.broadcast_to(part, (len(M), *part.shape[-2:])) for part in found[:3])
    return A, B, C


def _series(first: System, then: System) -> System:
    """Return a linear system whose input is another one's output, the states of that first."""
    (A, B, C, D), (E, F, G, H) = first, then
    none = np.zeros((A.shape[-1], E.shape[-1]))
    return _blocks([[A, none], [F @ C, E]]), _blocks([[B], [F @ D]]), _blocks([[H @ C, G]]), H @ D


def _blocks(rows: Sequence[Sequence[np.ndarray]]) -> np.ndarray:
    """Return a matrix of blocks, or one a state where some blocks are (N, ., .)."""
    stacks = np.broadcast_shapes(*(part.shape[:-2] for each in rows for part in each))
    return np.block(
        [[np.broadcast_to(part, (*stacks, *part.shape[-2:])) for part in each] for each in rows]
    )


def _median_radius(rows: Sequence[Sequence[np.ndarray]]) -> float:
    """Return the median spectral radius of transitions given as blocks (N, ., .)."""
    return float(np.median(np.abs(np.linalg.eigvals(_blocks(rows))).max(axis=-1)))


def _kinematic_radius(mode: float, damping: float, decay: float, dt: float, factor: float) -> float:
    """Return the spectral radius of de/dt = -damping e + w a, da/dt = -w e - decay a, held.

    ``factor`` multiplies the rates of a.
    """
    w, decay = mode * (_MARGIN * factor) ** 0.5, _MARGIN * factor * decay
    transition = np.array([[1.0 - dt * damping, dt * w], [-dt * w, 1.0 - dt * decay]])
    return _median_radius([[transition]])
