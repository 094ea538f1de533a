"""Before the run: is the sampling period short enough for these gains on this robot?

Each part of the closed loop is linearised over a typical motion of the believed robot (see
``modes``) and sampled as the controller does it, torques and gradients held for dt. The part is
stable while the spectral radius of its transition matrix is below one. The real inertias are not
the believed ones: the check asks for it with feedback and kinematic adaptation doubled, and with
the rates of the dynamic adaptation half as large again, as bodies a third lighter would have it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from ..controller.controller import Controller
from ..laws.law import Law
from ..robot.workspace import rounded_down
from .linearised_loop import LinearisedLoop, frequency, gain_matrix, unit_mass

_MARGIN, _ADAPTATION_MARGIN = 2.0, 1.5
_FEEDBACK, _DYNAMICS = "task feedback", "adaptation of the dynamics"
_SLACK = 0.95
_UNSTABLE = 1.0 + 1e-9  # the null space of a redundant arm moves freely


@dataclass(frozen=True)
class Finding:
    """One part of the closed loop that the sampling period makes unstable.

    Attributes: part: what it is. dt: the given period [s]. longest: the longest period that would
        do [s]. factors: what gains would have to be multiplied with at the given period, by name;
        empty where none of them helps.
    """

    part: str
    dt: float
    longest: float
    factors: dict[str, float]

    def __str__(self) -> str:
        """Say what is too fast and what to take."""
        gains = ", ".join(
            f"{name} by at most {rounded_down(factor):.2g}" for name, factor in self.factors.items()
        )
        other = (
            f", or multiply {gains}"
            if gains
            else "; the null space's damping alone is too fast, smaller gains do not help"
        )
        return f"dt = {self.dt:.3g} s is too long for the {self.part}: take dt <= {rounded_down(self.longest):.2g} s{other}."


Radius = Callable[..., float]  # of dt [s] and factor, both by name


def preflight(controller: Controller, dt: float) -> list[Finding]:
    """Return what is too fast for the sampling period dt [s]; an empty list is a go.

    A controller put together by hand, without the typical motion that ``make_controller`` gives it,
    is not checked. Where the feedback's damping alone is too fast for dt, no rate of adaptation is
    to blame and the feedback alone is told.
    """
    findings = []
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


def stable_share_adaptation(controller: Controller, dt: float) -> float:
    """Return the share of the rates of the dynamic adaptation that passes the check at dt [s]; one where they pass."""
    factors = [
        factor
        for finding in preflight(controller, dt)
        if finding.part == _DYNAMICS
        for factor in finding.factors.values()
    ]
    return _SLACK * min(factors) if factors else 1.0


def stable_share_feedback(law: Law, loop: LinearisedLoop, dt: float) -> float:
    """Return the share of the feedback's bandwidth that passes the check at dt [s]; one where it passes, or where none does."""
    radius = partial(_feedback_radius, list(_feedback(law, loop)), dt)
    if radius(1.0) <= _UNSTABLE or radius(0.0) > _UNSTABLE:
        return 1.0
    return _SLACK * _largest(radius, 1.0)


def _largest(radius: Callable[..., float], start: float) -> float:
    """Return about the largest number below ``start`` at which the spectral radius is stable."""
    low, high = start * 1e-6, start
    for _ in range(40):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if radius(middle) > _UNSTABLE else (middle, high)
    return low


def _parts(controller: Controller) -> list[tuple[str, dict[str, float], Radius]]:
    """Return name, gains with the powers of the factor they take, and spectral radius of each part of the loop."""
    loop = controller.loop
    if loop is None:
        return []
    gains, size = controller.law.gains, controller.dynamics.size
    feedback = list(_feedback(controller.law, loop))
    parts: list[tuple[str, dict[str, float], Radius]] = [
        (_FEEDBACK, {"Kv": 1.0, "alpha": 1.0, "Kp": 2.0}, partial(_feedback_radius, feedback))
    ]
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # bodies moved into the cone are told of when the run starts
        start = controller.adaptation_d.admit(loop.dynamics.initial)
    Gamma_d = gain_matrix(controller.adaptation_d, start)
    if size and Gamma_d.any():
        damping = [at.D + at.N - gains.alpha * at.P for at in feedback]
        pairs = [
            (Phi @ Gamma_d @ Phi.T, damping[i % len(damping)]) for i, Phi in enumerate(loop.dynamic)
        ]
        factors = {"gamma_d": 1.0, "gamma_joint": 1.0}
        parts.append((_DYNAMICS, factors, partial(_dynamic_radius, pairs)))
    Gamma_k = gain_matrix(controller.adaptation_k, loop.kinematics.initial)
    if Gamma_k.any():
        m = loop.kinematics.task.positions
        speed = frequency(loop.kinematic, Gamma_k)
        mode = (
            speed
            * float(np.linalg.eigvalsh((gains.K_P + gains.alpha * gains.K_v)[:m, :m])[-1]) ** 0.5
        )
        decay = speed**2 * float(np.linalg.eigvalsh(gains.R_k)[-1])
        parts.append(
            (
                "adaptation of the kinematics",
                {"gamma_k": 1.0},
                partial(_kinematic_radius, mode, gains.alpha, decay),
            )
        )
    return parts


class Feedback(NamedTuple):
    """The feedback at one state, in the task's rows or, for energy-based laws, in joint coordinates of unit mass, M^1/2 v.

    Attributes:
        S: stiffness [1/s^2].
        D: damping [1/s].
        N: damping that no gain changes, the posture's [1/s].
        P: projection onto what the task feels.
    """

    S: np.ndarray
    D: np.ndarray
    N: np.ndarray
    P: np.ndarray


def _feedback(law: Law, loop: LinearisedLoop) -> Iterator[Feedback]:
    """Return the feedback at each state, or once where all are the same."""
    gains, kinematics, dynamics = law.gains, loop.kinematics, loop.dynamics
    if not law.energy_based:
        yield Feedback(gains.K_P, gains.K_v, np.zeros_like(gains.K_v), np.eye(len(gains.K_v)))
        return
    dynamics.load(dynamics.initial)
    for q, v, _ in zip(*loop.motion, strict=True):
        kinematics.update(kinematics.initial, q, v)
        J, M = kinematics.J, dynamics.mass_matrix(q)
        W = unit_mass(M)
        tracked = np.linalg.pinv(J, rcond=1e-2) @ J
        null = np.eye(len(M)) - tracked
        N = W @ null @ np.diag(law.posture.damping) @ null @ W.T
        P, J = W @ M @ tracked @ W.T, J @ W.T
        yield Feedback(J.T @ gains.K_P @ J, J.T @ gains.K_v @ J + gains.alpha * P, N, P)


def _feedback_radius(feedback: Sequence[Feedback], dt: float, factor: float) -> float:
    """Return the median spectral radius of -(S x + (D + N) dx/dt) held over dt; ``factor`` on the bandwidth of S and D."""
    radii = [
        _radius(_MARGIN * factor**2 * S, _MARGIN * (factor * D + N), dt) for S, D, N, _ in feedback
    ]
    return float(np.median(radii))


def _radius(S: np.ndarray, D: np.ndarray, dt: float) -> float:
    one = np.eye(len(S))
    transition = np.block(
        [[one - 0.5 * dt**2 * S, dt * one - 0.5 * dt**2 * D], [-dt * S, one - dt * D]]
    )
    return float(np.abs(np.linalg.eigvals(transition)).max())


def _dynamic_radius(
    pairs: Sequence[tuple[np.ndarray, np.ndarray]], dt: float, factor: float
) -> float:
    """Return the median spectral radius of de/dt = -D e + z, dz/dt = -S e, z = Phi da, held over dt; S times ``factor``."""
    radii = []
    for S, D in pairs:
        one = np.eye(len(D))
        transition = np.block(
            [[one - dt * D, dt * one], [-dt * _ADAPTATION_MARGIN * factor * S, one]]
        )
        radii.append(np.abs(np.linalg.eigvals(transition)).max())
    return float(np.median(radii))


def _kinematic_radius(mode: float, damping: float, decay: float, dt: float, factor: float) -> float:
    """Return the spectral radius of de/dt = -damping e + w a, da/dt = -w e - decay a, held over dt; rates times ``factor``."""
    w, decay = mode * (_MARGIN * factor) ** 0.5, _MARGIN * factor * decay
    transition = np.array([[1.0 - dt * damping, dt * w], [-dt * w, 1.0 - dt * decay]])
    return float(np.abs(np.linalg.eigvals(transition)).max())
