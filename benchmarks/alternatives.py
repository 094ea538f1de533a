"""Alternatives to adaptation: PD and PID with gravity, computed torque, disturbance observer.

Robots of the zoo with friction, an unknown tool and load, and inertias 30 % off follow one circle
in 1, 2 and 5 s, with perfect sensors, and with a camera of 60 Hz that is 20 ms late and encoders of
17 bits. Integral gains, and gains that a delay requires to be lower, are the best of a small grid
on the circle of 2 s; everything else has the bandwidth of the default.

``make alternatives.table`` runs the sweep ``alternatives.toml``; a case is one contender on one
robot with one set of sensors. ``python -m benchmarks.alternatives`` draws the picture.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

import pinadapt as pa

from . import alternatives_report
from .contenders import CONTENDERS, DEFAULT, Gains, setting
from .shared import HERE, Row, quiet, rms, table_rows

PERIODS = (1.0, 2.0, 5.0)  # [s]
TUNING_PERIOD = 2.0  # [s], of the circle on which gains are selected
INFORMED = (DEFAULT, "computed torque", "computed torque, observer, task integral")
_INFORMED = "informed"
FIGURES = ("rms", "max", "first", "peak", "peak_last", "chatter")  # None if the loop diverges
_DURATION, _REPEATING, _TUNING = 20.0, 8.0, 5.0  # [s]; without adaptation a loop repeats itself
_TENTH, _DT = 2.0, 1e-3  # [s]


@quiet()  # of unphysical starts
def figures(
    robot: str,
    sensors: str,
    contender: str,
    gains: Gains,
    period: float,
    *,
    informed: bool = False,
    duration: float | None = None,
) -> dict[str, float | None]:
    """Return the figures of a run, errors in mm.

    The last errors are of the last tenth of 20 s, or of the last turn where that is longer. The
    peak is the largest torque relative to its effort limit, over the run and at the end. Chatter is
    the standard deviation of white noise with second differences as large as those of the torque at
    the end; a smooth torque has none.

    Args:
        robot: by name.
        sensors: by name.
        contender: by name.
        gains: relative to the bandwidth.
        period: of the circle [s].
        informed: whether the controller has the true model.
        duration: of the run [s]; None: as long as the contender needs.
    """
    at = setting(robot, sensors)
    at = at.informed() if informed else at
    usual = _DURATION if contender == DEFAULT else _REPEATING
    try:
        rollout = pa.simulate(
            at.true,
            CONTENDERS[contender].make(at, **gains),
            at.circle(period).as_given(),  # at speed from the first sample
            duration=duration or usual,
            sensors=at.sensors,
            engine=pa.Engine(dt=_DT),
            progress=False,
        )
    except pa.MeasurementError:  # joints far above their velocity limits
        return dict.fromkeys(FIGURES)
    if rollout.diverged is not None:
        return dict.fromkeys(FIGURES)
    last = slice(-round(max(_TENTH, period) / _DT), None)
    error = 1e3 * np.linalg.norm(rollout.error, axis=1)
    share = np.max(np.abs(rollout.tau) / at.model.limits, axis=1)
    second = np.diff(rollout.tau[last], 2, axis=0)
    return {
        "rms": rms(error[last]),
        "max": float(error[last].max()),
        "first": rms(error[: round(1.0 / _DT)]),
        "peak": float(share.max()),
        "peak_last": float(share[last].max()),
        "chatter": float(np.sqrt(np.mean(np.sum(second**2, axis=1)) / 6.0)),
    }


def best_gains(robot: str, sensors: str, contender: str) -> Gains:
    """Return the gains of the grid with least error, {} for a contender without a grid.

    If every run of the search diverges, these are the first of the grid, which diverge too.
    """
    choices = CONTENDERS[contender].choices()
    if len(choices) == 1:
        return choices[0]

    def error(gains: Gains) -> float:
        run = figures(robot, sensors, contender, gains, TUNING_PERIOD, duration=_TUNING)
        return np.inf if run["rms"] is None else run["rms"]

    return min(choices, key=error)


def measure(robot: str, sensors: str, contender: str) -> dict[str, Any]:
    """Return gains, and the figures of each circle and of the true model."""
    own = best_gains(robot, sensors, contender)
    case = robot, sensors, contender, own
    found = {f"{period:g}s": figures(*case, period) for period in PERIODS}
    if contender in INFORMED:
        found[_INFORMED] = figures(*case, TUNING_PERIOD, informed=True)
    return {"gains": own, **found}


def runs_of(rows: Iterable[Row]) -> Iterator[dict[str, Any]]:
    """Yield one row a run of the rows of the table, which have one contender each."""
    for row in rows:
        words = {name: row[name] for name in ("contender", "robot", "sensors")}
        periods = {f"{period:g}s": period for period in PERIODS}
        if row["contender"] in INFORMED:
            periods[_INFORMED] = TUNING_PERIOD
        for name, period in periods.items():
            found = {key: row[f"{name}.{key}"] for key in FIGURES}
            yield {**words, "period": period, "informed": name == _INFORMED, **found}


def report(rows: Iterable[Row]) -> str:
    """Return all tables in Markdown."""
    return alternatives_report.report(runs_of(rows))


if __name__ == "__main__":
    picture = HERE.parent / "docs" / "alternatives.png"
    alternatives_report.draw(list(runs_of(table_rows("alternatives"))), picture)
