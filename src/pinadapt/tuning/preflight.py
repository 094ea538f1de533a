"""Before the run: is the sampling period short enough for these gains on this robot?

Each part of the closed loop is linearised over a typical motion of the believed robot (see
``modes``) and sampled as the controller does it, torques and gradients held for dt. The part is
stable while the spectral radius of its transition matrix is below one. The real inertias are not
the believed ones: the check asks for it with feedback and kinematic adaptation doubled, and with
the rates of the dynamic adaptation half as large again, as bodies a third lighter would have it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle

import numpy as np
import pinocchio as pin

from .._checks import arithmetic, instance, positive
from ..controller.controller import Controller
from ..laws.acceleration_law import AccelerationLaw
from ..laws.law import Feedback, Law
from ..models.frame_kinematics import FrameKinematics
from ..models.typical_motion import TypicalMotion
from ..robot.robot import Robot
from ..robot.workspace import rounded_down
from ..tasks.joint import JointTask
from .defaults import frequency

_LOAD, _ARM = 0.1, 0.05  # of the robot's mass, of its reach off the axis: such a load ...
_ANGLE = 0.25  # [rad] ... turns no joint further than this against its position feedback


@dataclass(frozen=True)
class LightJoint:
    """A revolute joint that a load would turn away.

    The load is a tenth of the robot's mass, a twentieth of its reach off the axis.

    Attributes:
        joint: its name.
        inertia: what it is believed to move, the least over a typical motion [kg m^2].
        load: the largest load that it bears [kg].
        arm: at this distance from its axis [m].
    """

    joint: str
    inertia: float
    load: float
    arm: float

    def __str__(self) -> str:
        """Say what is light, what it bears, and what to do."""
        return (
            f"{self.joint} is believed to move only {self.inertia:.2g} kg m^2, and this law's "
            "feedback is that times an acceleration: an unknown load above "
            f"{rounded_down(self.load):.2g} kg, {1e3 * self.arm:.0f} mm off its axis, can spin it "
            "before it is learned. With such a load take the law 'separation', whose gains "
            "are torques, or believe in it from the start, its inertia included (Robot.changed, "
            "belief.payload)."
        )


def lightest_joint(motion: TypicalMotion, law: Law) -> LightJoint | None:
    """Return the joint that bears least, or None where all bear enough.

    None too where the law's gains are forces or the last body is known.

    At each state of the typical motion, the weight of the load at its distance from a joint's axis
    is divided by the believed inertia M_jj and by the least position gain: the angle at which the
    feedback balances it. On the catalogue, with 30 % wrong inertias and loads of at most the last
    body's mass, law (11) of Wang and Xie lost four joints, all of them told of here.
    """
    believed, dynamics = motion.robot, motion.dynamics
    model, n = believed.model, believed.model.nv
    if not isinstance(law, AccelerationLaw) or not law.adapts or n - 1 not in dynamics.bodies:
        return None
    rows, arm = believed.task.groups[0].rows, _ARM * believed.reach
    stiffness, data = float(np.linalg.eigvalsh(law.K_P[rows, rows])[0]), model.createData()
    angles, inertias = [], []  # (N, n) per kilogram of load, and M_jj
    for q, M in zip(motion.states.q, motion.mass_matrices, strict=True):
        inertia = np.diag(M)
        J = pin.computeJointJacobians(model, data, q).reshape(6, n)
        weight = np.linalg.norm(np.cross(J[3:].T, model.gravity.linear), axis=1)  # zero for slides
        floor = np.finfo(float).eps * inertia.max()
        angles.append(weight * arm / (np.maximum(inertia, floor) * stiffness))
        inertias.append(inertia)
    largest = np.max(angles, axis=0)
    j = int(np.argmax(largest))
    if _LOAD * pin.computeTotalMass(model) * largest[j] <= _ANGLE:
        return None
    least, load = float(np.min(inertias, axis=0)[j]), _ANGLE / float(largest[j])
    return LightJoint(believed.joint_names[j], least, load, arm)


_MARGIN, _ADAPTATION_MARGIN = 2.0, 1.5
_FEEDBACK, _DYNAMICS = "task feedback", "adaptation of the dynamics"
_SLACK = 0.95
_LEAST, _HALVINGS = 1e-6, 24  # smallest share, and how far its logarithm is bisected
_UNSTABLE = 1.0 + 1e-9  # the null space of a redundant arm moves freely


@dataclass(frozen=True)
class Finding:
    """One part of the closed loop that the sampling period makes unstable.

    Attributes:
        part: what it is.
        dt: the given period [s].
        longest: the longest period that would do [s].
        factors: what gains would have to be multiplied with at the given period, by name; empty
            where none of them helps.
    """

    part: str
    dt: float
    longest: float
    factors: dict[str, float]

    def __str__(self) -> str:
        """Say what is too fast and what to take."""
        gains = ", ".join(f"{name} by {_bound(factor)}" for name, factor in self.factors.items())
        other = (
            f", or multiply {gains}"
            if gains
            else "; the null space's damping alone is too fast, smaller gains do not help"
        )
        return (
            f"dt = {self.dt:.3g} s is too long for the {self.part}: take dt <= "
            f"{rounded_down(self.longest):.2g} s{other}."
        )


def _bound(factor: float) -> str:
    """Return a factor in words, rounded to the safe side."""
    if factor <= 1.0:
        return f"at most {rounded_down(factor):.2g}"
    return f"at least {1.0 / rounded_down(0.99 / factor):.3g}"


Radius = Callable[..., float]  # of dt [s] and factor, both by name


@arithmetic("dt")
def preflight(controller: Controller, dt: float) -> list[Finding]:
    """Return what is too fast for the sampling period dt [s]; an empty list is a go.

    A controller put together by hand, without the typical motion that ``make_controller`` gives it,
    is not checked. Where the feedback's damping alone is too fast for dt, no rate of adaptation is
    to blame and the feedback alone is told.

    Raises:
        InputError: no controller, or a period that is not positive.
    """
    instance(controller, Controller, "controller")
    dt, findings = positive(dt, "dt"), []
    for part, gains, radius in _parts(controller):
        helps = radius(dt=dt, factor=0.0) <= _UNSTABLE
        if radius(dt=dt, factor=1.0) > _UNSTABLE and (helps or part == _FEEDBACK):
            longest = _largest(lambda period, of=radius: of(dt=period, factor=1.0), dt)
            factor = (
                _largest(lambda factor, of=radius: of(dt=dt, factor=factor), 1.0) if helps else 0.0
            )
            factors = {gain: factor**power for gain, power in gains.items() if helps}
            findings.append(Finding(part, dt, longest, factors))
    return findings


def stable_share_of_adaptation(controller: Controller, dt: float) -> float:
    """Return the share of the rates of the dynamic adaptation that passes the check at dt [s]."""
    findings = [finding for finding in preflight(controller, dt) if finding.part == _DYNAMICS]
    factors = [factor for finding in findings for factor in finding.factors.values()]
    return _SLACK * min(factors) if factors else 1.0


def stable_share_of_feedback(of: Callable[[float], Sequence[Feedback]], dt: float) -> float:
    """Return the share of the feedback's bandwidth that passes the check at dt [s].

    One where it passes, and where no share does. ``of`` returns the feedback of a share.
    """

    def radius(share: float) -> float:
        return _feedback_radius(of(share), dt, 1.0)

    if not of(1.0) or radius(1.0) <= _UNSTABLE or radius(_LEAST) > _UNSTABLE:
        return 1.0
    return _SLACK * _largest(radius, 1.0)


def _largest(radius: Callable[..., float], start: float) -> float:
    """Return about the largest number below ``start`` at which the spectral radius is stable."""
    low, high = start * _LEAST, start
    for _ in range(_HALVINGS):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if radius(middle) > _UNSTABLE else (middle, high)
    return low


def _parts(controller: Controller) -> list[tuple[str, dict[str, float], Radius]]:
    """Return of each part of the loop name, gains with the powers of the factor, and radius."""
    motion = controller.motion
    if motion is None:
        return []
    parts: list[tuple[str, dict[str, float], Radius]] = []
    feedback = controller.law.feedback(motion)
    if feedback:
        powers = controller.law.bandwidth_powers
        parts.append((_FEEDBACK, powers, partial(_feedback_radius, feedback)))
    Gamma_d = _dynamic_gain(controller, motion)
    if feedback and Gamma_d.any():
        damping, effects = cycle(at.E for at in feedback), controller.law.parameter_effects(motion)
        pairs = [(Phi @ Gamma_d @ Phi.T, E) for Phi, E in zip(effects, damping, strict=False)]
        powers = {"gamma_d": 1.0, "gamma_joint": 1.0}
        parts.append((_DYNAMICS, powers, partial(_dynamic_radius, pairs)))
    Gamma_k = controller.adaptation_k.gain(motion.kinematics.initial)
    loop = controller.law.kinematic_loop()
    if loop is not None and Gamma_k.any():
        speed = frequency(motion.kinematic_regressors, Gamma_k)
        mode = speed * loop.stiffness**0.5
        if controller.law.uses_position_error:
            speed = frequency(motion.position_regressors, Gamma_k)
        decay = speed**2 * float(np.linalg.eigvalsh(loop.weight)[-1])
        radius = partial(_kinematic_radius, mode, loop.damping, decay)
        parts.append(("adaptation of the kinematics", {"gamma_k": 1.0}, radius))
    return parts


def _dynamic_gain(controller: Controller, motion: TypicalMotion) -> np.ndarray:
    """Return Gamma_d (p, p) at the start."""
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # bodies moved into the cone are told of when the run starts
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


def _kinematic_radius(mode: float, damping: float, decay: float, dt: float, factor: float) -> float:
    """Return the spectral radius of de/dt = -damping e + w a, da/dt = -w e - decay a, held.

    ``factor`` multiplies the rates of a.
    """
    w, decay = mode * (_MARGIN * factor) ** 0.5, _MARGIN * factor * decay
    transition = np.array([[1.0 - dt * damping, dt * w], [-dt * w, 1.0 - dt * decay]])
    return float(np.abs(np.linalg.eigvals(transition)).max())


_GROWTH = 1e-2  # of the bandwidth


@dataclass(frozen=True)
class WrongJacobian:
    """A believed Jacobian so far from the true one that the loop about home is unstable.

    Attributes:
        law: that does not learn it.
        mismatch: how far, in parts of itself; see ``Law.mismatch``.
        borne: how far it is proved for.
        growth: of the fastest growing mode [1/s].
    """

    law: str
    mismatch: float
    borne: float
    growth: float

    def __str__(self) -> str:
        """Say how wrong it is, and what to do."""
        return (
            f"the Jacobian is believed wrong by {self.mismatch:.2g} of itself at home. The law "
            f"'{self.law}' does not learn it and is proved for {self.borne:.2g}; the loop about "
            f"home grows at {self.growth:.2g} 1/s: the arm swings about its set point or leaves. "
            "Measure the tool, or take the law 'separation', which learns it."
        )


def jacobian_finding(controller: Controller, true: Robot) -> WrongJacobian | None:
    """Return how wrong the believed Jacobian is at the home of a true robot, if it is too wrong.

    Only a simulation can tell: it takes the true robot. The loop is linearised at rest in a set
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
