"""An exciting motion, the share of the limits that it uses, and the series it is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._output import Sheet, Table
from ..description.chain import effort_limits, position_limits, velocity_limits
from ..information.information import Excitation
from ..trajectories.periodic import FourierSeries
from .allowance import Allowance

_DIGITS = 7  # of a coefficient in a file


@dataclass(frozen=True, eq=False, repr=False)
class ExcitingMotion:
    """A motion of the joints from home and back, and the information expected of it.

    ``print`` shows the use of each limit, the identifiable combinations, and the uncertainty that
    each parameter would have with the assumed noise: 1 % of the effort limits in the torque,
    averaged over 50 ms, and a thousandth of the reach in a position.

    Attributes:
        trajectory: of the joints, for a robot loaded with ``task="joint"``; it repeats itself.
        duration: of the motion [s].
        excitation: information about the parameters, at their nominal values.
        limits: the share of each limit that it uses.
        identifiable: numbers of combinations of dynamic and of kinematic parameters that any motion
            can identify.
        information_gain: expected from the data, given the prior [nat].
    """

    trajectory: FourierSeries
    duration: float
    excitation: Excitation
    limits: LimitUse
    identifiable: tuple[int, int]
    information_gain: float

    def reference(self) -> dict[str, Any]:
        """Return the motion as the table ``[reference]`` of a scenario with ``task = "joint"``."""
        series = self.trajectory
        return {
            "kind": "fourier",
            "center": _written(series.center),
            "cosine": [_written(row) for row in series.cosine],
            "sine": [_written(row) for row in series.sine],
            "period": series.period,
        }

    def __repr__(self) -> str:
        """Return tables of limits and of parameters."""
        return str(self._sheet())

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def _sheet(self) -> Sheet:
        limits, found = self.limits, self.excitation
        rows = [("duration", f"{self.duration:g} s, {self.trajectory.harmonics} harmonics")]
        for part, name, most in (
            (found.dynamic, "dynamic", self.identifiable[0]),
            (found.kinematic, "kinematic", self.identifiable[1]),
        ):
            if part.names:
                share = f"all {most}" if part.rank == most else f"{part.rank} of {most}"
                rows.append((name, f"{share} identifiable combinations are excited"))
        rows.append(("efforts", f"with and without a load of {limits.load:.3g} kg"))
        if np.isfinite(limits.clearance):
            rows.append(("clearance", f"{limits.clearance:.3g} m above the mounting plane"))
        if np.isfinite(limits.apart):
            rows.append(("distance", f"{limits.apart:.3g} m between {limits.closest}"))
        note = "Collisions of the robot with its surroundings are not checked."
        if not limits.shapes:
            note = (
                "The description has no collision geometry: collisions of the robot with itself or "
                "with its surroundings are not checked."
            )
        return Sheet("Exciting motion", [Table(rows), limits.table(), *found.tables()], note)


def _written(values: np.ndarray) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") + 0.0 for value in values]


@dataclass(frozen=True, eq=False)
class LimitUse:
    """The share of each limit that a motion uses; 1 is at the limit, 0 also stands for no limit.

    Attributes:
        joints: names (n).
        position: (n) of half the range of a joint, from its middle.
        velocity: (n).
        effort: (n) the larger one with and without the heaviest load.
        load: mass of the heaviest load [kg], in the origin of the frame.
        clearance: smallest distance of a joint or the frame from the mounting plane [m]; infinite
            for a robot that moves along that plane.
        apart: smallest distance of two bodies, or of a body from the floor [m]; infinite where
            none was checked.
        closest: the names of these two.
        shapes: whether the bodies have shapes; otherwise only joints and frame stay off the floor.
    """

    joints: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    load: float
    clearance: float
    apart: float = np.inf
    closest: str = ""
    shapes: bool = False

    @classmethod
    def of(
        cls, allowed: Allowance, angles: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> LimitUse:
        """Return the shares that N states of a motion use."""
        robot = allowed.robot
        lower, upper = position_limits(robot.model)
        limited = np.isfinite(lower)
        lower, upper = np.where(limited, lower, 0.0), np.where(limited, upper, 0.0)
        middle, half = 0.5 * (lower + upper), np.where(limited, 0.5 * (upper - lower), np.inf)
        efforts = np.abs(allowed.torques(q, v, a)).max(axis=(0, 1))
        return cls(
            tuple(robot.joint_names),
            np.abs(angles - middle).max(axis=0) / half,
            np.abs(v).max(axis=0) / velocity_limits(robot.model),
            efforts / effort_limits(robot.model),
            allowed.load,
            allowed.clearance(q),
            *allowed.apart(q),
            allowed.shapes is not None and not allowed.shapes.alone,
        )

    def table(self) -> Table:
        """Return a row for each joint, in per cent of each limit."""
        parts = zip(self.joints, self.position, self.velocity, self.effort, strict=True)
        rows = [
            (name, *(f"{share:.0%}" if share else "no limit" for share in use))
            for name, *use in parts
        ]
        return Table(rows, ("joint", "of position", "of velocity", "of effort limit"))


class RestToRest:
    """Motions x(t) = x_0 + Phi(t) theta, whose velocity and acceleration vanish at t = 0.

    Phi stacks cosines and sines of K harmonics. The two conditions leave 2 K - 2 of the 2 K
    coefficients of each coordinate free: theta, scaled so that equal ones cause equal speeds.

    Attributes:
        size: 2 K - 2.
        period: [s].
        times: (N) instants of a period [s] at which motions are evaluated.
    """

    def __init__(self, harmonics: int, period: float, samples: int) -> None:
        """Take K of at least 2, the period [s], and the number N of instants."""
        k = np.arange(1.0, harmonics + 1.0)
        conditions = np.zeros((2, 2 * harmonics))
        conditions[0, :harmonics], conditions[1, harmonics:] = k, np.ones(harmonics)
        scale = np.tile(1.0 / k, 2)  # coefficients of equal speed
        self._free = scale[:, None] * np.linalg.svd(conditions)[2][2:].T
        self._harmonics, self.period = harmonics, period
        self.size = self._free.shape[1]
        self.times = np.linspace(0.0, period, samples, endpoint=False)
        w = 2.0 * np.pi / period * k
        c, s = np.cos(np.outer(self.times, w)), np.sin(np.outer(self.times, w))
        self._displacement = np.hstack([c - 1.0, s]) @ self._free
        self._velocity = np.hstack([-w * s, w * c]) @ self._free
        self._acceleration = np.hstack([-w * w * c, -w * w * s]) @ self._free

    def motion(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return displacement, velocity and acceleration (N, n) for theta (n, size)."""
        return self._displacement @ theta.T, self._velocity @ theta.T, self._acceleration @ theta.T

    def derivative(self, by_states: np.ndarray) -> np.ndarray:
        """Return a derivative (n, size) by theta from that (3, n, N) by the states."""
        parts = self._displacement, self._velocity, self._acceleration
        return sum(by_state @ part for by_state, part in zip(by_states, parts, strict=True))

    def series(self, start: np.ndarray, theta: np.ndarray) -> FourierSeries:
        """Return the motion for theta (n, size) from a start (n)."""
        cosine, sine = np.split(theta @ self._free.T, [self._harmonics], axis=1)
        return FourierSeries(start - cosine.sum(axis=1), cosine, sine, self.period)
