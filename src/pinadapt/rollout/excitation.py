"""How exciting a motion was: what it could tell apart, and how well each estimate is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .._table import Sheet, Table
from .information import Information


@dataclass(frozen=True, eq=False, repr=False)
class Excitation:
    """What the data of a run tell of all parameters; ``print`` shows a table.

    Attributes:
        dynamic: of torque and motion about the dynamic parameters.
        kinematic: of measured positions about the kinematic parameters.
        units: name of a parameter -> its unit.
    """

    dynamic: Information
    kinematic: Information
    units: Mapping[str, str]

    def __repr__(self) -> str:
        """Return spectrum and rank of both, and each estimate with what it is known to."""
        return str(self._sheet())

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def _sheet(self) -> Sheet:
        parts = {"kinematic": self.kinematic, "dynamic": self.dynamic}
        words = [
            row
            for name, part in parts.items()
            if part.names
            for row in (
                (f"{name} parameters", f"{part.rank} combinations of {len(part.names)} told apart"),
                (f"{name} conditioning", _conditioning(part)),
            )
        ]
        tables = [Table(words or [("nothing", "was adapted")])]
        for part in parts.values():
            if part.names:
                tables.append(
                    Table(self._rows(part), ("parameter", "estimate", "known to", "unit"))
                )
        return Sheet("Excitation", tables)

    def _rows(self, part: Information) -> list[tuple[str, ...]]:
        return [
            (name, f"{value:.4g}", known_to(deviation), self.units.get(name, ""))
            for name, value, deviation in zip(
                part.names, part.estimate, part.deviations, strict=True
            )
        ]


def known_to(deviation: float) -> str:
    """Return an uncertainty in words: a number, or that there is none."""
    return f"+- {deviation:.2g}" if np.isfinite(deviation) else "not told apart"


def _conditioning(part: Information) -> str:
    """Return the largest over the smallest excited eigenvalue of the scaled information."""
    if not part.rank:
        return "nothing was excited"
    return f"{part.spectrum[0] / part.spectrum[part.rank - 1]:.2g}, of {part.rows} rows"
