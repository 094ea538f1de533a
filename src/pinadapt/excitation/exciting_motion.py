"""A motion that was made to tell unknown parameters apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._table import Sheet, Table
from ..rollout.excitation import Excitation
from ..trajectories.fourier_series import FourierSeries
from .limit_use import LimitUse

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
