"""The check before a run: sampling period, sensors, a nominal Jacobian, light joints.

Period: each part of the closed loop is linearised over a typical motion of the model and sampled as
the controller does it, torques and gradients held for dt. A part is stable while the spectral
radius of its transition matrix is below one. The real inertias differ from the model's: stability
is required with feedback and kinematic adaptation doubled, and with the rates of the dynamic
adaptation 1.5 times as large, as for bodies a third lighter. Where rotor inertias are learned, the
true ones may also be those of the description: beside many light links, their guess alone makes a
loop too fast. Where actuators are declared, or known of a simulated robot, their delay, bandwidth
and springs are in the loop, see ``ActuatedJoints``. A period may also leave a loop that is stable
and too slow to follow anything, and motors may be too weak to hold or move the arm.

Sensors: a frame that is used without compensation is a delay of the position feedback by up to its
age; the loop of the typical motion with that delay, in Pade's second-order form, must be stable
with the stiffness doubled. With compensated frames only the kinematic adaptation is delayed; its
mode must be slower than the age. The noise of the joint velocity must not exceed that for which
filters and rates were chosen.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import cycle
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from .._checks import arithmetic, instance, positive
from ..controller.controller import Controller
from ..laws.acceleration_law import AccelerationLaw
from ..laws.fast_feedback import FastFeedback
from ..laws.law import SYMBOLS, Feedback, Law
from ..models.linear_kinematics import FrameKinematics
from ..models.typical_motion import TypicalMotion
from ..records import SensorQuality
from ..robot.motors import Actuators, JointActuators, overloaded
from ..robot.robot import Robot
from ..robot.workspace import rounded_down
from ..tasks.task import JointTask
from .defaults import bandwidth, frequency
from .noise import coarseness

_LOAD, _ARM = 0.1, 0.05  # of the robot's mass, of its reach off the axis: such a load ...
_ANGLE = 0.25  # [rad] ... turns no joint further than this against its position feedback


@dataclass(frozen=True)
class LightJoint:
    """A revolute joint that an unknown load could turn against its feedback.

    The load is a tenth of the robot's mass, a twentieth of its reach off the axis.

    Attributes:
        joint: its name.
        inertia: that it moves in the model, the least over a typical motion [kg m^2].
        load: largest load that it tolerates [kg].
        arm: distance of that load from its axis [m].
    """

    joint: str
    inertia: float
    load: float
    arm: float

    def __str__(self) -> str:
        """Return what is light, which load it tolerates, and what to do."""
        return (
            f"{self.joint} moves only {self.inertia:.2g} kg m^2 in the model, and the feedback of "
            "this law is that times an acceleration: an unknown load above "
            f"{rounded_down(self.load):.2g} kg, {1e3 * self.arm:.0f} mm off its axis, can spin it "
            "before it is learned. With such a load take the law 'separation', whose gains are "
            "torques, or give a guess of the load and its inertia (payload=, in a scenario "
            "controller.payload)."
        )


def lightest_joint(motion: TypicalMotion, law: Law) -> LightJoint | None:
    """Return the joint that tolerates the smallest load, or None if all tolerate enough.

    None too if the law's gains are forces or the last body is known.

    At each state of the typical motion, the weight of the load at its distance from a joint's axis
    is divided by the model's inertia M_jj and by the least position gain: the angle at which the
    feedback balances it. On the catalogue, with 30 % wrong inertias and loads of at most the last
    body's mass, law (11) of Wang and Xie diverged at four joints; all are found here.
    """
    robot, dynamics = motion.robot, motion.dynamics
    model, n = robot.model, robot.model.nv
    if not isinstance(law, AccelerationLaw) or not law.adapts or n - 1 not in dynamics.bodies:
        return None
    rows, arm = robot.task.groups[0].rows, _ARM * robot.reach
    stiffness, data = float(np.linalg.eigvalsh(law.K_P[rows, rows])[0]), model.createData()
    turns = [
        pin.computeJointJacobians(model, data, q).reshape(6, n)[3:].T.copy()
        for q in motion.states.q
    ]  # the joints' axes (n, 3), zero for slides
    weights = np.linalg.norm(np.cross(turns, model.gravity.linear), axis=2)  # of 1 kg on 1 m
    inertias = np.diagonal(motion.mass_matrices, axis1=1, axis2=2)
    floors = np.finfo(float).eps * inertias.max(axis=1, keepdims=True)
    angles = weights * arm / (np.maximum(inertias, floors) * stiffness)  # (N, n) a kilogram
    largest = np.max(angles, axis=0)
    j = int(np.argmax(largest))
    if _LOAD * pin.computeTotalMass(model) * largest[j] <= _ANGLE:
        return None
    least, load = float(np.min(inertias, axis=0)[j]), _ANGLE / float(largest[j])
    return LightJoint(robot.joint_names[j], least, load, arm)


_MARGIN, _ADAPTATION_MARGIN = 2.0, 1.5
_FEEDBACK, _DYNAMICS = "task feedback", "adaptation of the dynamics"
_ROTORLESS = f"{_FEEDBACK}, if the rotors are only those of the description"
_KINEMATICS = "adaptation of the kinematics"
_SLACK, _NEARLY_NONE = 0.95, 1e-6
_SHORTEST = 1e-3  # of the period, at which late motors count as stable at no period
_LEAST, _SHARES = 1e-6, 2**16  # smallest share, and how many up to one: 0.02 % apart
_SECANTS, _FARTHEST = 12, 0.125  # evaluations before bisections; share by which one may fall
_UNSTABLE = 1.0 + 1e-9  # the null space of a redundant arm moves freely
_FREE = 1.0 + 1e-6  # of gains that are nearly zero, whose double roots are rounded
_WRONG, _AWAY = 0.3, 0.08  # of gravity, and what that may displace, of the reach or of a radian
_SLOWED = 0.25  # of a robot's bandwidth, from which on a period is to blame
_NULL = 1e-6  # relative stiffness of directions that the task does not have
_HARDLY = 0.1  # of the torque that brings the joints to their typical speed within a second


_BEHIND = (
    "; encoders behind springs need the motors' velocity besides, law=pa.laws.FastFeedback(...)"
)


@dataclass(frozen=True)
class Finding:
    """A part of the closed loop that is unstable at the sampling period.

    Attributes:
        part: what it is.
        dt: the given period [s].
        longest: the longest period at which it is stable [s]; zero if there is none.
        factors: by name, what each gain must be multiplied with to be stable at ``dt``; empty if
            no gain helps.
        values: by name, the present gains that are one number.
        actuators: in words, if they are not ideal.
        flaw: in words, where it is not that a part is too fast.
    """

    part: str
    dt: float
    longest: float
    factors: dict[str, float]
    values: dict[str, float] = field(default_factory=dict)
    actuators: str = ""
    flaw: str = ""

    def __str__(self) -> str:
        """Return what is wrong, and what to take instead."""
        if self.flaw:
            return self.flaw
        gains = [_bound(name, each, self.values.get(name)) for name, each in self.factors.items()]
        if self.actuators:
            ways = [f"dt <= {rounded_down(self.longest):.2g} s"] if self.longest else []
            ways += [f"{'all of ' if len(gains) > 1 else ''}{', '.join(gains)}"] if gains else []
            advice = f"take {', or '.join(ways)}" if ways else "no period and no gain helps"
            return (
                f"the {self.part} is too fast for {self.actuators} at dt = {self.dt:.3g} s: "
                f"{advice}. Default gains for actuators follow from "
                "pa.Limits(actuators=...), in a scenario limits.actuators"
                f"{_BEHIND if 'at the links' in self.actuators else ''}."
            )
        other = (
            f", or {', '.join(gains)}"
            if gains
            else "; smaller gains do not help, the damping of the null space is too fast by itself"
        )
        if self.part == _ROTORLESS:
            other = (
                ", or say that these are right: unknown=pa.Unknown(armature=False). What is "
                "guessed of unknown rotors is heavy beside these links"
            )
        return (
            f"dt = {self.dt:.3g} s is too long for the {self.part}: take dt <= "
            f"{rounded_down(self.longest):.2g} s{other}."
        )


def _bound(name: str, factor: float, value: float | None) -> str:
    """Return the bound on a gain of a value that a factor stands for, rounded to the safe side."""
    if factor <= 1.0:
        if value is None:
            return f"{name} at most {rounded_down(factor):.2g} of its value"
        return f"{name} <= {rounded_down(factor * value):g} (now {value:.3g})"
    if value is None:
        return f"{name} at least {1.0 / rounded_down(0.99 / factor):.3g} times its value"
    return f"{name} >= {1.0 / rounded_down(0.99 / (factor * value)):.3g} (now {value:.3g})"


def _values(law: Law, names: Iterable[str]) -> dict[str, float]:
    """Return the gains of a law that are one number, or one for all coordinates."""
    found = {}
    for name in names:
        value = np.atleast_1d(getattr(law, SYMBOLS.get(name, name), np.nan))
        if callable(getattr(law, SYMBOLS.get(name, name), None)) or value.dtype == object:
            continue
        diagonal = np.diag(value) if value.ndim == 2 else value
        single = value.ndim == 1 or np.array_equal(value, np.diag(diagonal))
        if single and np.isfinite(diagonal).all() and np.ptp(diagonal) == 0.0 and diagonal[0] > 0.0:
            found[name] = float(diagonal[0])
    return found


Radius = Callable[..., float]  # of dt [s] and factor, both by name
Part: TypeAlias = tuple[str, dict[str, float], Radius]  # name, gains with powers of the factor


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
    for part, gains, radius in (*_parts(controller, actuators), *_rotorless(controller, actuators)):
        present = radius(dt=dt, factor=1.0)
        if present <= _UNSTABLE:
            continue
        if part == _ROTORLESS and any(finding.part == _FEEDBACK for finding in findings):
            continue
        helps = radius(dt=dt, factor=_NEARLY_NONE) <= _FREE
        if helps or part in (_FEEDBACK, _ROTORLESS):
            given = helps and part != _ROTORLESS
            factors = _stable_factors(gains, radius, dt, present) if given else {}
            values = _values(controller.law, factors)
            words = "" if actuators.ideal or part == _KINEMATICS else actuators.words
            longest = _longest(radius, dt, present, late=bool(words))
            findings.append(Finding(part, dt, longest, factors, values, words))
    if controller.motion is not None:
        others = _too_slow(controller, controller.motion, dt), _too_weak(controller, dt)
        findings += [finding for finding in others if finding is not None]
    return findings


def _too_slow(controller: Controller, motion: TypicalMotion, dt: float) -> Finding | None:
    """Return a finding if the feedback, slow because of a long period, is too weak.

    Its stiffness is compared with gravity that the model has wrong: displaced by that, until it is
    learned, an arm follows nothing. With a period the displacement grows as its square.
    """
    robot, task = motion.robot, motion.kinematics.task
    feedback = controller.law.feedback(motion)
    if not feedback or motion.bandwidth >= _SLOWED * bandwidth(
        robot, _SHORTEST * dt, controller.law.own_bandwidth
    ):
        return None
    model, m = robot.model, task.positions or task.size
    size, unit = (robot.reach, "m") if task.positions else (1.0, "rad")
    data, displaced = model.createData(), []
    states = zip(
        motion.states.q, motion.jacobians, motion.mass_matrices, motion.unit_masses,
        cycle(feedback),
    )  # fmt: skip
    for q, J, M, W, (S, *_) in states:
        g = _WRONG * pin.computeGeneralizedGravity(model, data, q)
        if len(feedback) == 1:  # of the task
            dx = np.linalg.lstsq(S, J @ np.linalg.solve(M, g), rcond=_NULL)[0]
        else:
            dx = J @ W.T @ np.linalg.lstsq(S, W @ g, rcond=_NULL)[0]
        displaced.append(np.linalg.norm(dx[:m]))
    way = float(np.median(displaced))
    if way <= _AWAY * size:
        return None
    longest = dt * math.sqrt(_AWAY * size / way)
    return Finding(
        "bandwidth",
        dt,
        longest,
        {},
        flaw=f"dt = {dt:.3g} s leaves a feedback so slow that gravity which the model has "
        f"{100 * _WRONG:.0f} % wrong displaces the arm by {way:.2g} {unit} until it is learned: "
        f"take dt <= {rounded_down(longest):.2g} s.",
    )


def _too_weak(controller: Controller, dt: float) -> Finding | None:
    """Return which motors hardly move the model, or cannot hold it at home, if there are some."""
    motion, limits = controller.motion, controller.limits.torque
    if motion is None or limits is None:
        return None
    momenta = [M @ v for M, v in zip(motion.mass_matrices, motion.states.v, strict=True)]
    need = _HARDLY * np.median(np.abs(momenta), axis=0)  # within a second
    robot = motion.robot
    held = overloaded(robot, limits, "the model") if controller.compensation is None else None
    weak = [
        f"{name} ({limit:.3g} of {least:.3g})"
        for name, limit, least in zip(robot.joint_names, limits, need, strict=True)
        if limit < least
    ]
    if held is None and not weak:
        return None
    words = held or (
        f"the motors hardly move the model: {', '.join(weak)} N m or N. Are limits of torque in "
        "another unit?"
    )
    return Finding("motors", dt, 0.0, {}, flaw=words)


def _longest(radius: Radius, dt: float, present: float, late: bool) -> float:
    """Return the longest stable period up to dt [s], zero if late motors leave none.

    ``present`` is the radius at dt.
    """
    if late and radius(dt=_SHORTEST * dt, factor=1.0) > _UNSTABLE:
        return 0.0
    return _largest(lambda period: radius(dt=period, factor=1.0), dt, present)


def stable_share_of_adaptation(controller: Controller, dt: float) -> float:
    """Return the share of the rates of the dynamic adaptation that passes the check at dt [s]."""
    for part, gains, radius in _parts(controller, controller.limits.actuators):
        if part == _DYNAMICS:
            present = radius(dt=dt, factor=1.0)
            if present <= _UNSTABLE or radius(dt=dt, factor=_NEARLY_NONE) > _FREE:
                return 1.0
            return _SLACK * min(_stable_factors(gains, radius, dt, present).values())
    return 1.0


def _stable_factors(
    gains: Mapping[str, float], radius: Radius, dt: float, present: float
) -> dict[str, float]:
    """Return the factor of each gain, given with its power, that is stable at dt [s].

    ``present`` is the radius with the gains as they are.
    """
    factor = _largest(lambda factor: radius(dt=dt, factor=factor), 1.0, present)
    return {gain: factor**power for gain, power in gains.items()}


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
    whole, joints = of(1.0), None
    if whole and not actuators.ideal:
        joints = ActuatedJoints(motion, actuators, K_f, of_task=len(whole) == 1)

    def radius(share: float) -> float:
        """Return the spectral radius of the loop with a share of the feedback."""
        if joints is None:
            return _feedback_radius(of(share), dt, 1.0)
        return joints.feedback_radius(of(share), dt, 1.0)

    if not whole or (present := radius(1.0)) <= _UNSTABLE or radius(_LEAST) > _FREE:
        return 1.0
    return _SLACK * _largest(radius, 1.0, present)


def _largest(radius: Callable[..., float], start: float, present: float) -> float:
    """Return about the largest number below ``start`` at which the spectral radius is stable.

    It is one of a geometric progression of numbers, the next of which is unstable. Beyond the
    border the radius grows nearly as the number, so secants come close to it; from there, if they
    fall below it, steps that grow lead back. Bisections end the search where both are slow.

    Args:
        radius: of a number.
        start: where it is unstable.
        present: the radius there.
    """

    def share(number: float) -> int:
        """Return which number of the progression is not above another one."""
        return math.floor(_SHARES * (1.0 - math.log(number / start) / math.log(_LEAST)))

    low, high, k, step, tried = 0, _SHARES, share(0.5 * start), 0, 0
    below, (x, above), (farther, more) = 0.0, (start, present - _UNSTABLE), (start, np.inf)
    while high - low > 1:
        number, tried = start * _LEAST ** (1.0 - k / _SHARES), tried + 1
        beyond = radius(number) - _UNSTABLE
        if beyond > 0.0:
            high, step, (farther, more), (x, above) = k, 0, (x, above), (number, beyond)
        else:
            low, below = k, beyond
        middle, width = (low + high) // 2, high - low
        if tried >= _SECANTS or not above < more < np.inf:
            k = middle
            continue
        border = x - above * (farther - x) / (more - above)
        k = min(share(max(border, _FARTHEST * x)), high - 1)
        if k <= low:
            step = max(4 * step, width // 64, int(width * below / (below - above)), 1)
            k = min(low + step, middle)
    return start * _LEAST ** (1.0 - low / _SHARES)


def _parts(controller: Controller, actuators: Actuators) -> Iterator[Part]:
    """Yield of each part of the loop name, gains with the powers of the factor, and radius."""
    motion = controller.motion
    if motion is None:
        return
    feedback = controller.law.feedback(motion)
    joints, law = None, controller.law
    if feedback and not actuators.ideal:
        K_f = law.gain if isinstance(law, FastFeedback) else None
        joints = ActuatedJoints(motion, actuators, K_f, of_task=len(feedback) == 1)
    if feedback:
        powers = controller.law.bandwidth_powers
        of_feedback = _feedback_radius if joints is None else joints.feedback_radius
        yield _FEEDBACK, powers, partial(of_feedback, feedback)
    Gamma_d = _dynamic_gain(controller, motion)
    if feedback and Gamma_d.any():
        damping, effects = cycle(at.E for at in feedback), controller.law.parameter_effects(motion)
        pairs = [(Phi @ Gamma_d @ Phi.T, E) for Phi, E in zip(effects, damping, strict=False)]
        powers = {"gamma_d": 1.0, "gamma_joint": 1.0}
        of_pairs = _dynamic_radius if joints is None else joints.adaptation_radius
        yield _DYNAMICS, powers, partial(of_pairs, pairs)
    Gamma_k = controller.adaptation_k.gain(motion.kinematics.initial)
    loop = controller.law.kinematic_loop()
    if loop is not None and Gamma_k.any():
        speed = frequency(motion.kinematic_regressors, Gamma_k)
        mode = speed * loop.stiffness**0.5
        if controller.law.uses_position_error:
            speed = frequency(motion.position_regressors, Gamma_k)
        decay = speed**2 * float(np.linalg.eigvalsh(loop.weight)[-1])
        radius = partial(_kinematic_radius, mode, loop.damping, decay)
        yield _KINEMATICS, {"gamma_k": 1.0}, radius


def _rotorless(controller: Controller, actuators: Actuators) -> list[Part]:
    """Return the part of the feedback on the described robot, where the model has other rotors.

    Not with actuators: springs need rotors.
    """
    motion, law = controller.motion, controller.law
    feedback = [] if motion is None or not actuators.ideal else law.feedback(motion)
    M = _described(motion) if feedback and motion is not None else None
    if M is None or motion is None:
        return []
    radius = partial(_feedback_radius, _on(M, motion, feedback))
    return [(_ROTORLESS, law.bandwidth_powers, radius)]


def _described(motion: TypicalMotion) -> np.ndarray | None:
    """Return M (N, n, n) of the description, None where the model has no other rotors."""
    robot, believed = motion.robot, np.array(motion.mass_matrices)
    data = robot.model.createData()
    M = np.array([pin.crba(robot.model, data, q) for q in motion.states.q])
    M = np.triu(M) + np.triu(M, 1).swapaxes(1, 2)
    heavier = np.trace(believed - M, axis1=1, axis2=2) > _NULL * np.trace(M, axis1=1, axis2=2)
    return M if heavier.any() else None


def _on(M: np.ndarray, motion: TypicalMotion, feedback: Sequence[Feedback]) -> list[Feedback]:
    """Return what the torque of a feedback does to a robot with M (N, n, n) at each state."""
    J, inverse, W = (
        np.array(each) for each in (motion.jacobians, motion.right_inverses, motion.unit_masses)
    )
    moved = np.linalg.solve(
        M, np.array(motion.mass_matrices)
    )  # actual accelerations from the intended ones
    change = J @ moved @ inverse if len(feedback) == 1 else moved @ W.swapaxes(1, 2)
    back = W @ np.array(motion.mass_matrices)
    if len(feedback) == 1:
        back = np.broadcast_to(np.eye(J.shape[1]), change.shape)
    return [
        Feedback(*(left @ part @ right for part in each))
        for left, each, right in zip(change, cycle(feedback), back, strict=False)
    ]


def _dynamic_gain(controller: Controller, motion: TypicalMotion) -> np.ndarray:
    """Return Gamma_d (p, p) at the start."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the start of a run warns of unphysical bodies
        start = controller.adaptation_d.validate(motion.dynamics.initial)
    return controller.adaptation_d.gain(start)


def _feedback_radius(feedback: Sequence[Feedback], dt: float, factor: float) -> float:
    """Return the median spectral radius of -(S x + (D + N) dx/dt) held over dt.

    ``factor`` multiplies the bandwidth of S and D.
    """
    S, D, N, _ = (np.array(part) for part in zip(*feedback, strict=True))
    S, D, one = _MARGIN * factor**2 * S, _MARGIN * (factor * D + N), np.eye(S.shape[-1])
    return _median_radius(one - 0.5 * dt**2 * S, dt * one - 0.5 * dt**2 * D, -dt * S, one - dt * D)


def _dynamic_radius(
    pairs: Sequence[tuple[np.ndarray, np.ndarray]], dt: float, factor: float
) -> float:
    """Return the median spectral radius of de/dt = -D e + z, dz/dt = -S e, z = Phi da, held.

    ``factor`` multiplies S.
    """
    S, D = (np.array(part) for part in zip(*pairs, strict=True))
    one = np.eye(S.shape[-1])
    return _median_radius(one - dt * D, dt * one, -dt * _ADAPTATION_MARGIN * factor * S, one)


def _median_radius(ee: np.ndarray, ez: np.ndarray, ze: np.ndarray, zz: np.ndarray) -> float:
    """Return the median spectral radius of N transitions [[ee, ez], [ze, zz]], blocks (n, n)."""
    blocks = list(np.broadcast_arrays(ee, ez, ze, zz))
    eigenvalues = np.linalg.eigvals(np.block([blocks[:2], blocks[2:]]))
    return float(np.median(np.abs(eigenvalues).max(axis=1)))


_RELATIVE_DAMPING = 0.01  # of springs without a stated one
_ROTOR = 0.5  # of the inertia that a joint moves, where a description has no rotors


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
        own, M = actuators.of(motion.robot), np.array(motion.mass_matrices)
        self._M, self._of_task = M, of_task
        self._roots = M @ np.array(motion.unit_masses).swapaxes(1, 2)  # W^-1
        self._J = np.array(motion.jacobians)
        self._inverse = np.array(motion.right_inverses)
        self._w = motion.bandwidth
        self._A, self._B, self._C = _chain(M, own, np.array(motion.robot.model.armature))
        motors, n = self._C, M.shape[-1]
        self._fast = np.zeros(motors.shape)  # what fast feedback takes off the torque
        if actuators.elastic and actuators.encoders == "link":
            self._C = np.zeros(motors.shape)
            self._C[:, :, -2 * n : -n] = np.eye(n)
            if K_f is not None:
                self._fast = _MARGIN * K_f[:, None] * (motors - self._C)
        self._last: tuple[float, np.ndarray, np.ndarray] | None = None

    def feedback_radius(self, feedback: Sequence[Feedback], dt: float, factor: float) -> float:
        """Return the median spectral radius of the sampled loop, its gains doubled.

        ``factor`` multiplies the bandwidth of the feedback.
        """
        S, D, N, _ = (np.array(part) for part in zip(*feedback, strict=True))
        K_P = _MARGIN * factor**2 * self._torque(S)
        K_D = _MARGIN * self._torque(factor * D + N)
        if self._of_task:  # the posture holds the rest
            null = self._M @ (np.eye(self._M.shape[-1]) - self._inverse @ self._J)
            K_P, K_D = K_P + 0.25 * self._w**2 * null, K_D + self._w * null
        Phi, Gamma = self._held(dt)
        return _median_of(Phi - Gamma @ np.concatenate([K_D @ self._C + self._fast, K_P], axis=2))

    def adaptation_radius(
        self, pairs: Sequence[tuple[np.ndarray, np.ndarray]], dt: float, factor: float
    ) -> float:
        """Return the median spectral radius of de/dt = -D e + z, dz/dt = -S e behind the actuators.

        e is the error of the joints' velocity; ``factor`` multiplies S, and S has its margin.
        """
        S, E = (np.array(part) for part in zip(*pairs, strict=True))
        S = _ADAPTATION_MARGIN * factor * self._torque(S)
        Phi, Gamma = (part[:, : self._A.shape[1]] for part in self._held(dt))
        Phi = Phi[..., : self._A.shape[1]]
        damped = Phi - Gamma @ (self._torque(E) @ self._C + self._fast)
        top = np.concatenate([damped, Gamma], axis=2)
        one = np.broadcast_to(np.eye(S.shape[-1]), S.shape)
        return _median_of(
            np.concatenate([top, np.concatenate([-dt * S @ self._C, one], axis=2)], axis=1)
        )

    def _held(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the transitions over dt [s] under a held torque, of the states and displacements.

        Gains are varied at one period, so those of the last one are kept.
        """
        if self._last is None or self._last[0] != dt:
            A, B, C = self._A, self._B, self._C
            n, size = C.shape[1:]
            placed = np.block([[A, np.zeros((len(A), size, n))], [C, np.zeros((len(A), n, n))]])
            self._last = (dt, *_held(placed, np.pad(B, ((0, 0), (0, n), (0, 0))), dt))
        return self._last[1:]

    def _torque(self, feedback: np.ndarray) -> np.ndarray:
        """Return a gain of joints of unit mass, or of the task, as a torque of the joints."""
        if self._of_task:
            return np.asarray(self._M @ self._inverse @ feedback @ self._J)
        return np.asarray(self._roots @ feedback @ self._roots.swapaxes(1, 2))


def _chain(
    M: np.ndarray, joints: JointActuators, rotors: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A (N, k, k), B (N, k, n) and C (N, n, k) from torques to velocities of the motors.

    The last n states are the velocities of the motors, before them those of the links where there
    are springs.
    """
    N, n = len(M), M.shape[-1]
    elastic, late = bool(np.isfinite(joints.stiffness).all()), bool(joints.delay.any())
    slow = bool(np.isfinite(joints.bandwidth).any())
    one, none = np.eye(n), np.zeros((n, n))
    size = (2 * late + slow + (3 if elastic else 1)) * n
    A, B = np.zeros((N, size, size)), np.zeros((N, size, n))
    at = 0
    Y, U = np.zeros((n, size)), one  # torque behind the delay: Y x + U u
    if late:
        T = np.maximum(joints.delay, 1e-3 * joints.delay.max())
        a, b = 12.0 / T**2, 6.0 / T
        z, zd = slice(0, n), slice(n, 2 * n)
        A[:, z, zd] = one
        A[:, zd, z], A[:, zd, zd], B[:, zd] = -np.diag(a), -np.diag(b), one
        Y[:, zd], at = -2.0 * np.diag(b), 2 * n
    if slow:
        f = slice(at, at + n)
        w = np.diag(np.minimum(joints.bandwidth, 1e4))
        A[:, f], B[:, f] = w @ Y, w @ U
        A[:, f, f] -= w
        Y, U, at = np.zeros((n, size)), none, at + n
        Y[:, f] = one
    v = slice(size - n, size)
    if not elastic:
        moved = np.linalg.inv(M)
        A[:, v], B[:, v] = A[:, v] + moved @ Y, moved @ U
    else:
        own = np.diagonal(M, axis1=1, axis2=2).min(axis=0)
        motor = np.where(rotors > 0.0, rotors, _ROTOR * own)
        links = np.linalg.inv(M - np.diag(np.where(rotors > 0.0, rotors, 0.0)))
        K, D = joints.stiffness, joints.damping
        D = np.where(D > 0.0, D, 2.0 * _RELATIVE_DAMPING * np.sqrt(K * motor))
        d, link = slice(at, at + n), slice(at + n, at + 2 * n)
        A[:, d, v], A[:, d, link] = one, -one
        A[:, link, d], A[:, link, v] = links @ np.diag(K), links @ np.diag(D)
        A[:, link, link] = -A[:, link, v]
        drive = np.diag(1.0 / motor)
        A[:, v] += drive @ Y
        B[:, v] = drive @ U
        A[:, v, d] -= np.diag(K / motor)
        A[:, v, v] -= np.diag(D / motor)
        A[:, v, link] += np.diag(D / motor)
    C = np.zeros((N, n, size))
    C[:, :, v] = one
    return A, B, C


def _held(A: np.ndarray, B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the transitions (N, k, k) and (N, k, n) over dt [s] under a held input."""
    from scipy.linalg import expm  # slow to import, and seldom needed

    N, k, n = B.shape
    moved = expm(dt * np.concatenate([np.concatenate([A, B], 2), np.zeros((N, n, k + n))], 1))
    return moved[:, :k, :k], moved[:, :k, k:]


def _median_of(transitions: np.ndarray) -> float:
    """Return the median spectral radius of transitions (N, k, k)."""
    return float(np.median(np.abs(np.linalg.eigvals(transitions)).max(axis=1)))


def _kinematic_radius(mode: float, damping: float, decay: float, dt: float, factor: float) -> float:
    """Return the spectral radius of de/dt = -damping e + w a, da/dt = -w e - decay a, held.

    ``factor`` multiplies the rates of a.
    """
    w, decay = mode * (_MARGIN * factor) ** 0.5, _MARGIN * factor * decay
    transition = np.array([[1.0 - dt * damping, dt * w], [-dt * w, 1.0 - dt * decay]])
    return float(np.abs(np.linalg.eigvals(transition)).max())


_UNDECLARED = 1.5  # times the noise for which a controller was made
_COARSEST = 4.0  # times the noise of 14 bits a turn, see ``noise_settings``
_LATE = 2.0  # mode times age
_SLOWEST = 1e-6


@dataclass(frozen=True)
class SensorFinding:
    """A sensor that is too slow, late or noisy for the controller.

    Attributes:
        part: "camera" or "encoder".
        flaw: what is wrong, and what to do.
    """

    part: str
    flaw: str

    def __str__(self) -> str:
        """Return one line."""
        return f"{self.part}: {self.flaw}"


def sensor_findings(controller: Controller, quality: SensorQuality) -> list[SensorFinding]:
    """Return the sensors with which the loop would be unstable or drift; empty if there are none.

    A controller without a typical motion, put together by hand, is not checked.
    """
    if controller.motion is None:
        return []
    found = (check(controller, quality) for check in (_uncompensated, _late, _noisy))
    return [finding for finding in found if finding is not None]


def _uncompensated(controller: Controller, quality: SensorQuality) -> SensorFinding | None:
    motion, age = controller.motion, quality.age
    assert motion is not None
    if controller.senses.compensator.enabled or not age or not motion.kinematics.positions:
        return None
    feedback = controller.law.feedback(motion)
    if not feedback or _stable_with_delay(feedback, age):
        return None
    longest, low = age, age * _SLOWEST
    for _ in range(40):
        middle = (low * longest) ** 0.5
        low, longest = (middle, longest) if _stable_with_delay(feedback, middle) else (low, middle)
    return SensorFinding(
        "camera",
        f"frames up to {1e3 * age:.3g} ms old are used without compensation; this feedback is "
        f"stable up to {1e3 * rounded_down(low):.2g} ms. Compensate the delay "
        "(compensate_delay=True, in a scenario carry = true), or take a faster camera or a smaller "
        "bandwidth (alpha, Kp).",
    )


def _stable_with_delay(feedback: Sequence[Feedback], delay: float) -> bool:
    """Return whether d^2 x/dt^2 = -S x(t - delay) - (D + N) dx/dt is mostly stable."""
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
        f"multiply gamma_k by at most {rounded_down((mode * quality.age) ** -2.0):.2g}, or make "
        "the controller for this camera (sensors=).",
    )


def _noisy(controller: Controller, quality: SensorQuality) -> SensorFinding | None:
    motion, made_for = controller.motion, controller.senses.quality
    assert motion is not None
    if not controller.adaptation_d.gain(controller.dynamics.initial).any():
        return None
    if coarseness(quality, motion.bandwidth) > _COARSEST:
        return SensorFinding(
            "encoder",
            f"with velocity noise of {quality.v:.2g} rad/s or m/s the estimates drift, whatever "
            "the filters. Use finer encoders, a velocity sensor, a longer period dt (the noise of "
            'differences decreases with it), or adaptation = "none".',
        )
    if quality.v > _UNDECLARED * made_for.v:
        return SensorFinding(
            "encoder",
            f"the velocity noise is {quality.v:.2g} rad/s or m/s, and the controller was made for "
            f"{made_for.v:.2g}: its estimates may drift. Make it for these sensors (sensors=).",
        )
    return None


_GROWTH = 1e-2  # of the bandwidth


@dataclass(frozen=True)
class WrongJacobian:
    """A nominal Jacobian so far from the true one that the loop about home is unstable.

    Attributes:
        law: that does not learn it.
        mismatch: its relative error; see ``Law.mismatch``.
        proved: the relative error for which the law is proved.
        growth: of the fastest growing mode [1/s].
    """

    law: str
    mismatch: float
    proved: float
    growth: float

    def __str__(self) -> str:
        """Return how wrong it is, and what to do."""
        return (
            f"the relative error of the model's Jacobian at home is {self.mismatch:.2g}. The law "
            f"'{self.law}' does not adapt it and is proved up to {self.proved:.2g}; the loop about "
            f"home is unstable, its fastest mode grows at {self.growth:.2g} 1/s. Measure the tool, "
            "or take the law 'separation', which adapts it."
        )


def jacobian_finding(controller: Controller, true: Robot) -> WrongJacobian | None:
    """Return the error of the model's Jacobian at the home of a true robot, if it is too large.

    Only a simulation knows: it takes the true robot. The loop is linearised at rest in a set
    point at home, with the true mass matrix and Jacobian and the torque Z a_d as a state of its
    own: M qdd = z - J_hat^T K_P J dq - K_v qd, dz/dt = -Z Gamma Z^T y.
    """
    kinematics, law = controller.kinematics, controller.law
    if not law.set_point or isinstance(true.task, JointTask):
        return None
    rest = np.zeros(kinematics.nv)
    kinematics.update(kinematics.initial, true.q0, rest)
    truth = FrameKinematics(true)
    truth.update(truth.initial, true.q0, rest)
    J_hat, J = kinematics.J, truth.J
    found, loop, motion = law.mismatch(J_hat, J), law.set_point_loop(J_hat, J), controller.motion
    if found is None or loop is None or motion is None or found[0] <= found[1]:
        return None
    n, M = kinematics.nv, pin.crba(true.model, true.model.createData(), true.q0)
    Z = controller.dynamics.regressor(true.q0, rest, rest)
    gain = controller.adaptation_d.gain_times(controller.dynamics.initial, Z.T)
    G, one, none = Z @ gain, np.eye(n), np.zeros((n, n))
    A = np.block(
        [
            [none, one, none],
            [
                -np.linalg.solve(M, loop.stiffness),
                -np.linalg.solve(M, loop.damping),
                np.linalg.inv(M),
            ],
            [-G @ loop.drive, -G, none],
        ]
    )
    growth = float(np.linalg.eigvals(A).real.max())
    if growth <= _GROWTH * motion.bandwidth:
        return None
    return WrongJacobian(law.name, *found, growth)
