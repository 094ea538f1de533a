"""Least-squares fits of torques and positions in a log.

Torques. The equations of motion are averaged over windows phi(t), with the momentum p = Y_M a + p_0
integrated by parts (Shinbrot 1957), so that they need no accelerations:

    int phi tau dt = int (phi (Y_0 a + tau_0) - phi' (Y_M a + p_0)) dt.

Each window is one row W a = y for each joint. ``torque_fit`` solves the equations of all windows in
the physical cone.

Positions. The position of the task frame is linear in the unknown translations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from .._checks import vector
from ..exceptions import InputError, ParameterError, did_you_mean
from ..information.information import CERTAIN, Information, fitted, position_rows
from ..information.measured_motion import Averages, MeasuredMotion, at_times
from ..information.payload import PayloadEstimate, loaded_part, of_load
from ..models.dynamics import Dynamics
from ..models.excited import rms
from ..models.physical_fit import PhysicalSet, physical_fit, physical_set, square
from ..models.regressor import LABELS, PER_BODY
from ..models.task_kinematics import TaskKinematics
from ..robot.constraints import repeated
from ..robot.robot import Robot

# Of the description, relative to one row of noise: a third and three times of it change no held-out
# error of the real logs by 3 %. Without rows to outweigh it the description is kept.
WEIGHT = 1.0
# Weight of the description of a joint's friction, which may be many times that. Half and twice: the
# same; a thousand times triples the held-out error of a UR10.
LIGHT = 1e-6
# Share of a stated total mass that it may be off: half and twice give the same masses to 0.2 %.
_WEIGHED = 1e-3
# Deviation of the gain of each torque, for loads. Half and twice: +- 0.09 and +- 0.29 in place of
# +- 0.16 kg for 2.8 kg in test_uncertainty with gains off by 8 %.
GAIN = 0.05
TINY = np.finfo(float).tiny  # added where else something may be divided by zero
# weight of a load like the body it is on, relative to the description of a body; half, twice: the
# same held-out errors of real logs
FREE = 1e-2


def torque_fit(
    physical: PhysicalSet,
    windows: Windows,
    stated: np.ndarray,
    bounds: np.ndarray | tuple[float, float] = (-np.inf, np.inf),
    *,
    gain: float = 0.0,
) -> Information:
    """Return the physical least-squares estimate of all dynamic parameters with its information.

    The noise of a joint is the residual of its torque, found in rounds. Windows overlap, and errors
    of the model last longer than one of them: in the end the variance of a joint is multiplied by
    the sum of the residual's autocorrelation, as its rows are not independent.

    Args:
        physical: the set of physical parameters.
        windows: the rows.
        stated: [A b] (k, p + 1) of equations A a = b beside them, whitened.
        bounds: (2, p) of the parameters; one beyond its bound is stated to be there.
        gain: deviation from one of the factors by which the torques of the joints may be off.
    """
    noise, least = noise_levels(windows.tau)
    physical, a, near = replace(physical, weights=np.array([LIGHT])), physical.center, None
    for _ in range(3 if a.size else 0):
        rows = np.vstack([(windows.W / noise[:, None]).reshape(-1, a.size), stated[:, :-1]])
        y = np.append(windows.y / noise, stated[:, -1])
        a = near = physical_fit(rows, y, physical, gamma=WEIGHT, near=near)
        noise = np.maximum(rms(windows.residual(a), 0), least)
    nearest = np.clip(a, *bounds)
    beyond = np.abs(a - nearest) > _WEIGHED * np.abs(nearest)
    if not beyond.any():
        gains = np.ones(windows.tau.shape[1] if gain else 0)
        return torque_information(a, windows, stated, gains, gain).marginal(a.size)
    rows = np.eye(len(a))[beyond] / (_WEIGHED * nearest[beyond, None])
    stated = np.vstack([stated, np.insert(rows, len(a), 1.0 / _WEIGHED, axis=1)])
    return torque_fit(
        physical, windows, stated, np.where(beyond, [[-np.inf], [np.inf]], bounds), gain=gain
    )


def torque_information(
    a: np.ndarray,
    windows: Windows,
    stated: np.ndarray,
    gains: np.ndarray,
    gain: float = GAIN,
) -> Information:
    """Return the information of windows on parameters at a (p), and after them on further gains.

    A gain scales the predicted torque: noise of the measured one would look like a gain.

    Args:
        a: (p) estimate of the parameters.
        windows: the rows.
        stated: as of ``torque_fit``.
        gains: (n) by which their torques were divided; none, and there are no further ones.
        gain: deviation of the whole gains from one.
    """
    residual = windows.residual(a)
    n = len(gains)
    p = len(a)
    noise = windows.repeated * np.maximum(lasting_noise(residual), noise_levels(windows.tau)[1])
    columns = (windows.tau - residual)[:, :, None] * np.eye(len(noise))[:, :n]
    W = np.concatenate([windows.W, columns], axis=2)
    rows = [
        (W / noise[:, None]).reshape(residual.size, -1),
        np.eye(n, p + n, p) / gain,
        np.pad(stated[:, :-1], ((0, 0), (0, n))),
    ]
    y = [(residual / noise).ravel(), (1.0 / gains - 1.0) / gain, stated @ np.append(-a, 1.0)]
    whole = square(np.vstack(rows), np.concatenate(y))
    return Information(windows.names, np.append(a, np.ones(n)), *whole)


def mass_equation(dynamics: Dynamics, robot: Robot, mass: float | None) -> np.ndarray:
    """Return [A b] (1, p + 1) of a mass of the whole robot [kg], for ``torque_fit``; (0, p + 1).

    Bodies that are not among the parameters, and the base, weigh what the robot describes.

    Raises:
        ParameterError: the mass is not above theirs, or no body is among the parameters.
    """
    if mass is None:
        return np.zeros((0, dynamics.size + 1))
    masses = np.array([name.endswith(f".{LABELS[0]}") for name in dynamics.names], dtype=float)
    known = sum(body.mass for body in robot.model.inertias) - masses @ dynamics.initial
    if not (masses.any() and mass > known):
        raise ParameterError(
            f"{mass:g} kg are not more than the {known:.4g} kg of base and known bodies, or no "
            "body is unknown.",
            where="total_mass",
            hint="State the mass of the whole robot, its base included, in kg.",
        )
    return np.append(masses, mass - known)[None] / (_WEIGHED * mass)


def bounds_of_masses(
    dynamics: Dynamics, given: Mapping[str, tuple[float, float]] | None
) -> np.ndarray:
    """Return the bounds (2, p) of the parameters, from those of masses by joint [kg].

    Raises:
        InputError: numbers that are no bounds, or a joint that moves no unknown body.
    """
    found = np.outer([-np.inf, np.inf], np.ones(dynamics.size))
    end = f".{LABELS[0]}"
    places = {n.removesuffix(end): i for i, n in enumerate(dynamics.names) if n.endswith(end)}
    for name, bounds in (given or {}).items():
        low, high = vector(bounds, 2, "mass_bounds").tolist()
        if name not in places or not 0.0 < low < high:
            raise InputError(
                f"'{name}' from {low:g} to {high:g} kg are no bounds of a mass."
                f"{did_you_mean(name, places)}",
                where="mass_bounds",
                hint=f"Name joints, which move bodies, of {list(places)}; 0 < low < high.",
            )
        found[:, places[name]] = low, high
    return found


def load_fit(
    dynamics: Dynamics,
    both: tuple[Windows, Windows],
    robot: Robot,
    mass: float | None,
) -> tuple[PayloadEstimate, Information | None]:
    """Return the load that an arm carries in one log and not in another, and the torques' gains.

    Bodies of the arm and effects of its joints are common to both logs, so that what is wrong with
    their model, and their friction, cancels as far as both motions show it.

    Args:
        dynamics: of the arm, the body of the task frame among them.
        both: windows of the log with the load, and of that without.
        robot: as described, with its task frame.
        mass: of the load [kg], if it is known: gains are found then, and only then.

    Raises:
        ParameterError: that body is not among the parameters, or the torques show another mass.
    """
    carrier = loaded_part(dynamics.names, robot)
    t, W, y, tau = (np.concatenate(parts) for parts in zip(*(w[:4] for w in both), strict=True))
    load = W[:, :, carrier].copy()
    load[len(both[0].t) :] = 0.0
    physical = physical_set(dynamics, robot)
    whole = replace(
        physical,
        bodies=physical.bodies + 1,
        center=np.append(physical.center[carrier], physical.center),
        body_weights=np.append(FREE, np.ones(physical.bodies)),
    )
    names = (*LABELS, *dynamics.names)
    W = np.concatenate([load, W], axis=2)
    windows = both[0]._replace(t=t, W=W, y=y, tau=tau, names=names)
    gains = np.ones(tau.shape[1])
    stated = np.zeros((0, len(names) + 1))
    known = None
    found = torque_fit(whole, windows, stated, gain=GAIN)
    if mass is not None:
        alone = found.refined()  # which may be negative, where the logs are swapped
        shown = alone.estimate[0]
        off = alone.deviations[0]
        if abs(shown - mass) > CERTAIN * off:
            raise ParameterError(
                f"{mass:g} kg are stated, and the torques show {shown:.3g} +- {off:.2g} kg.",
                where="known_load",
                hint="State what the other log lacks, in kg. Are the logs swapped, or all gains "
                "off by more (--torque-gain)?",
            )
        stated = np.zeros((1, len(names) + 1))
        stated[0, [0, -1]] = np.array([1.0, mass]) / (_WEIGHED * mass)
        own = windows
        for _ in range(2):  # the first predicts torques with the wrong gains
            step = torque_information(found.estimate, own, stated, gains).refined()
            gains = gains * step.estimate[-len(gains) :]
            own = windows.over(gains)
            found = torque_fit(whole, own, stated, gain=GAIN)
        known = Information(
            tuple(f"{name}.gain" for name in robot.joint_names),
            gains,
            np.diag(1.0 / step.deviations[-len(gains) :]),
            0.0 * gains,
        )
    found = found.marginal(PER_BODY)
    value, gradient = of_load(robot, found.estimate)
    return PayloadEstimate(value, found.deviation(gradient)), known


def noise_levels(tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what noise (n) torques (N, n) are first assumed to have, and the least that counts."""
    level = np.maximum(rms(tau, 0), TINY)
    # A tenth and ten times the first: the same estimates of a log. Online it counts as one window:
    # half of it makes a UR10's error 38 % larger, twice of it the deviations of a new load half as
    # large again. Half and twice the second: the same.
    return 0.05 * level, 1e-4 * level


def lasting_noise(residual: np.ndarray) -> np.ndarray:
    """Return the noise (n) of rows whose residual is (N, n), each as if it were independent.

    The variance is multiplied by how many rows are worth one independent row: one plus twice the
    autocorrelation up to where it first is negative (Geyer's initial sequence).
    """
    found = np.ones(residual.shape[1])
    for j, column in enumerate((residual - residual.mean(axis=0)).T):
        size, *later = np.correlate(column, column, "full")[len(column) - 1 :]
        for product in takewhile(lambda product: product > 0.0, later[: len(column) // 2 - 1]):
            found[j] += 2.0 * product / size
    return rms(residual, 0) * np.sqrt(found)


def position_windows(
    kinematics: TaskKinematics, motion: MeasuredMotion, t: np.ndarray, x: np.ndarray
) -> Windows:
    """Return the equations of frames x (M, m) at times t (M) in a motion, windows of no length.

    Their signal is the measured less the described position, less its mean [m].
    """
    within, q, v = at_times(kinematics.robot.model, motion.t, motion.q, t)
    W, r = position_rows(kinematics, kinematics.initial, q, v, x[within])
    moved = r - r.mean(axis=0) if len(r) else r
    return Windows(t[within], W, r + W @ kinematics.initial, moved, kinematics.names)


def position_fit(kinematics: TaskKinematics, windows: Windows) -> Information:
    """Return the least-squares estimate of all translations with its information.

    What the motion does not identify stays as described.
    """
    a = kinematics.initial
    residual = windows.residual(a)
    return fitted(windows.names, a, windows.W, residual, kinematics.robot.reach).refined()


class Windows(NamedTuple):
    """Averages over N windows of a motion, or N frames.

    Attributes:
        t: (N) times of their middles [s].
        W: (N, n, p) regressor.
        y: (N, n) torque without its known part [N m or N], or position [m].
        tau: (N, n) torque, or how far the frame moved.
        names: of the parameters (p).
        length: of a window [s].
        repeated: root of n over the equations of a window that are independent.
    """

    t: np.ndarray
    W: np.ndarray
    y: np.ndarray
    tau: np.ndarray
    names: tuple[str, ...]
    length: float = 0.0
    repeated: float = 1.0

    @classmethod
    def of(
        cls,
        motion: MeasuredMotion,
        averages: Averages,
        dynamics: Dynamics,
        robot: Robot,
    ) -> Windows:
        """Take the windows of a motion that have no gap.

        Args:
            motion: the samples.
            averages: over its windows.
            dynamics: of the unknown parameters.
            robot: that moved. Under constraints, with feet that all stand, torques are what no
                constraint force changes, P tau, see ``FilteredRegressor``.
        """
        n = motion.v.shape[1]
        size = dynamics.size
        P = np.eye(n)
        constraints = robot.constrained
        found = np.zeros((len(averages.t), n * (size + 1)))
        free = np.array(motion.tau)
        for start in range(0, len(motion.t), 1000):
            part = slice(start, start + 1000)
            both = []
            for q, v, tau in zip(motion.q[part], motion.v[part], free[part], strict=True):
                Y_M, Y_0, p_0, tau_0 = dynamics.momentum(q, v)
                M = np.column_stack([Y_M, p_0])
                F = np.column_stack([Y_0, tau_0])
                if robot.constraints:
                    M, F, P = constraints.project_momentum(M, F, q, v)
                    tau[:] = P @ tau
                both.append([M.ravel(), F.ravel()])
            moving, rest = np.swapaxes(both, 0, 1)
            found += averages.phi[:, part] @ rest
            found -= averages.rate[:, part] @ moving
        whole = averages.whole
        rows = found.reshape(-1, n, size + 1)[whole]
        tau = averages.mean(free)[whole]
        return cls(
            averages.t[whole],
            rows[:, :, :size],
            tau - rows[:, :, size],
            tau,
            dynamics.names,
            averages.length,
            repeated(P),
        )

    def over(self, gains: np.ndarray) -> Windows:
        """Return the windows with the torques divided by gains (n)."""
        tau = self.tau / gains
        return self._replace(y=self.y - self.tau + tau, tau=tau)

    def between(self, first: float = -np.inf, last: float = np.inf) -> Windows:
        """Return the windows that lie wholly between two times [s]."""
        half = 0.5 * self.length
        chosen = (self.t - half >= first) & (self.t + half <= last)
        t, W, y, tau = (part[chosen] for part in self[:4])
        return self._replace(t=t, W=W, y=y, tau=tau)

    def residual(self, a: np.ndarray) -> np.ndarray:
        """Return y - W a (N, n) [N m or N] at parameters a (p)."""
        return self.y - self.W @ a
