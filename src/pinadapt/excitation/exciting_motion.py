"""A motion that was made to tell unknown parameters apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._table import Sheet, Table
from ..description.chain import effort_limits, position_limits, velocity_limits
from ..information.information import Excitation
from ..trajectories.periodic import FourierSeries
from .allowance import Allowance


@dataclass(frozen=True, eq=False)
class LimitUse:
    """Shares of the limits that a motion uses, 1 at a limit; zero where there is none.

    Attributes:
        joints: names (n).
        position: (n) of the way from the middle of a joint's range to its ends.
        velocity: (n).
        effort: (n) with and without the heaviest load.
        load: that one [kg], in the origin of the frame.
        clearance: least distance of a joint or the frame from the plane that the robot is mounted
            on [m], infinite where it moves along that plane.
    """

    joints: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    load: float
    clearance: float

    @classmethod
    def of(
        cls, allowed: Allowance, angles: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> LimitUse:
        """Return what N states of a motion use."""
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
        )

    def table(self) -> Table:
        """Return a row a joint, in per cent of each limit."""
        parts = zip(self.joints, self.position, self.velocity, self.effort, strict=True)
        rows = [
            (name, *(f"{share:.0%}" if share else "no limit" for share in use))
            for name, *use in parts
        ]
        return Table(rows, ("joint", "of position", "of velocity", "of effort limit"))


class RestToRest:
    """Motions x(t) = x_0 + Phi(t) theta, whose velocity and acceleration vanish at t = 0.

    Phi stacks cosines and sines of K harmonics; of their 2 K coefficients the two conditions leave
    2 K - 2 a coordinate, theta, which count by the speed that they make.

    Attributes:
        size: 2 K - 2.
        period: [s].
        times: (N) instants of a period [s] at which it is looked at.
    """

    def __init__(self, harmonics: int, period: float, samples: int) -> None:
        """Take K of at least 2, the period [s], and the number N of instants."""
        k = np.arange(1.0, harmonics + 1.0)
        conditions = np.zeros((2, 2 * harmonics))
        conditions[0, :harmonics], conditions[1, harmonics:] = k, np.ones(harmonics)
        slower = np.tile(1.0 / k, 2)  # coefficients of the same speed
        self._free = slower[:, None] * np.linalg.svd(conditions)[2][2:].T
        self._harmonics, self.period = harmonics, period
        self.size = self._free.shape[1]
        self.times = np.linspace(0.0, period, samples, endpoint=False)
        w = 2.0 * np.pi / period * k
        c, s = np.cos(np.outer(self.times, w)), np.sin(np.outer(self.times, w))
        self._way = np.hstack([c - 1.0, s]) @ self._free
        self._velocity = np.hstack([-w * s, w * c]) @ self._free
        self._acceleration = np.hstack([-w * w * c, -w * w * s]) @ self._free

    def motion(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the way from the start, velocity and acceleration (N, n) of theta (n, size)."""
        return self._way @ theta.T, self._velocity @ theta.T, self._acceleration @ theta.T

    def gathered(self, slopes: np.ndarray) -> np.ndarray:
        """Return the derivative (n, size) by theta of what has those (3, n, N) by the states."""
        parts = self._way, self._velocity, self._acceleration
        return sum(slope @ part for slope, part in zip(slopes, parts, strict=True))

    def series(self, start: np.ndarray, theta: np.ndarray) -> FourierSeries:
        """Return the motion of theta (n, size) from a start (n)."""
        cosine, sine = np.split(theta @ self._free.T, [self._harmonics], axis=1)
        return FourierSeries(start - cosine.sum(axis=1), cosine, sine, self.period)


_DIGITS = 7  # of a coefficient in a file


@dataclass(frozen=True, eq=False, repr=False)
class ExcitingMotion:
    """A motion of the joints from home and back, and what it is expected to tell.

    ``print`` shows how close it comes to each limit, what it tells apart, and each parameter with
    what it would be known to at the assumed noise: 1 % of the effort limits in the torque, averaged
    over 50 ms, and of a thousandth of the reach in a position.

    Attributes:
        trajectory: of the joints, for a robot loaded with ``task="joint"``; it repeats itself.
        duration: of the motion [s].
        excitation: what it tells of the parameters, their estimates being those believed.
        limits: how close it comes to each.
        most: how many combinations of dynamic and of kinematic parameters any motion tells apart.
        told: what it is expected to tell, given what may be expected before [nat].
    """

    trajectory: FourierSeries
    duration: float
    excitation: Excitation
    limits: LimitUse
    most: tuple[int, int]
    told: float

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
        limits, found, most = self.limits, self.excitation, self.most
        rows = [("duration", f"{self.duration:g} s, {self.trajectory.harmonics} harmonics")]
        for part, name, any_motion in (
            (found.dynamic, "dynamic", most[0]),
            (found.kinematic, "kinematic", most[1]),
        ):
            if part.names:
                apart = f"{part.rank} combinations told apart, of {any_motion} that any motion does"
                rows.append((name, apart))
        rows.append(("efforts", f"with and without a load of {limits.load:.3g} kg"))
        if np.isfinite(limits.clearance):
            rows.append(("least height", f"{limits.clearance:.3g} m off the mounting plane"))
        inner = found._sheet()
        note = "Collisions of the robot with itself or with what stands around it are not checked."
        return Sheet("Exciting motion", [Table(rows), limits.table(), *inner.tables], note)


def _written(values: np.ndarray) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") + 0.0 for value in values]
