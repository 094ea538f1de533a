"""Alternatives to adaptation: PD and PID with gravity, computed torque, disturbance observer.

Robots of the zoo with friction, an unknown tool and load, and inertias 30 % off follow one circle
in 1, 2 and 5 s, with perfect sensors, and with a camera of 60 Hz that is 20 ms late and encoders of
17 bits. Integral gains, and gains that a delay requires to be lower, are the best of a small grid
on the circle of 2 s; everything else has the bandwidth of the default.

``make alternatives.table`` runs the sweep ``alternatives.toml``; a case is one contender on one
robot with one set of sensors. ``python -m benchmarks.alternatives`` draws the picture.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import pinadapt as pa

from .alternatives_report import draw
from .contenders import CONTENDERS, DEFAULT, Gains, setting
from .timing import HERE, table_rows

PERIODS = (1.0, 2.0, 5.0)  # [s]
TUNING_PERIOD = 2.0  # [s], of the circle on which gains are selected
INFORMED = (DEFAULT, "computed torque", "computed torque, observer, task integral")
_INFORMED = "informed"
FIGURES = ("rms", "max", "first", "peak", "peak_last", "chatter")  # None if the loop diverges
_DURATION, _REPEATING, _TUNING = 20.0, 8.0, 5.0  # [s]; without adaptation a loop repeats itself
_TENTH, _DT = 2.0, 1e-3  # [s]


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        robot, sensors, contender: by name.
        period: of the circle [s].
        gains: the selected gains, relative to the bandwidth.
        informed: whether the controller has the true model.
        tuning: whether the run is one of the search for gains, which is shorter.
    """

    robot: str
    sensors: str
    contender: str
    period: float
    gains: Gains
    informed: bool = False
    tuning: bool = False

    @property
    def duration(self) -> float:
        """Length of the run [s]."""
        if self.tuning:
            return _TUNING
        return _DURATION if self.contender == DEFAULT else _REPEATING


def figures(run: Run) -> dict[str, Any]:
    """Return the results of a run, errors in mm, as ``summary`` does."""
    at = setting(run.robot, run.sensors)
    at = at.informed() if run.informed else at
    controller = CONTENDERS[run.contender].make(at, **run.gains)
    known = {"radius": at.radius, "bandwidth": at.w}
    path = at.circle(run.period).as_given()  # at speed from the first sample
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of unphysical starts
        try:
            rollout = pa.simulate(
                at.true,
                controller,
                path,
                duration=run.duration,
                sensors=at.sensors,
                engine=pa.Engine(dt=_DT),
                progress=False,
            )
        except pa.MeasurementError:  # joints far above their velocity limits
            return known | dict.fromkeys(FIGURES)
    return known | summary(rollout, run.period, at.model.limits)


def summary(
    rollout: pa.Rollout, period: float, limits: np.ndarray
) -> dict[str, float] | dict[str, None]:
    """Return the figures of a rollout: errors [mm], peak torque and chatter [N m].

    The last errors are of the last tenth of 20 s, or of the last turn where that is longer. The
    peak is the largest torque relative to its effort limit (n), over the run and at the end.
    Chatter is the standard deviation of white noise with second differences as large as those of
    the torque at the end; a smooth torque has none.
    """
    if rollout.diverged is not None:
        return dict.fromkeys(FIGURES)
    last = slice(-round(max(_TENTH, period) / _DT), None)
    error = 1e3 * np.linalg.norm(rollout.error, axis=1)
    share = np.max(np.abs(rollout.tau) / limits, axis=1)
    second = np.diff(rollout.tau[last], 2, axis=0)
    return {
        "rms": _rms(error[last]),
        "max": float(error[last].max()),
        "first": _rms(error[: round(1.0 / _DT)]),
        "peak": float(share.max()),
        "peak_last": float(share[last].max()),
        "chatter": float(np.sqrt(np.mean(np.sum(second**2, axis=1)) / 6.0)),
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def best_gains(robot: str, sensors: str, contender: str) -> Gains:
    """Return the gains of the grid with least error, {} for a contender without a grid.

    If every run of the search diverges, these are the first of the grid, which diverge too.
    """
    choices = CONTENDERS[contender].choices()
    if len(choices) == 1:
        return choices[0]
    errors = [
        figures(Run(robot, sensors, contender, TUNING_PERIOD, gains, tuning=True))["rms"]
        for gains in choices
    ]
    return min(
        zip(choices, errors, strict=True), key=lambda each: np.inf if each[1] is None else each[1]
    )[0]


def measure(robot: str, sensors: str, contender: str) -> dict[str, Any]:
    """Return gains, and the figures of each circle and of the true model."""
    own = best_gains(robot, sensors, contender)
    runs = {f"{period:g}s": Run(robot, sensors, contender, period, own) for period in PERIODS}
    if contender in INFORMED:
        runs[_INFORMED] = Run(robot, sensors, contender, TUNING_PERIOD, own, informed=True)
    found = {name: figures(run) for name, run in runs.items()}
    (first, *_) = found.values()
    known = {name: first[name] for name in ("radius", "bandwidth")}
    return known | {
        "gains": own,
        **{name: {key: each[key] for key in FIGURES} for name, each in found.items()},
    }


def runs_of(rows: Iterable[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield one row a run of the rows of the table, which have one contender each."""
    for row in rows:
        gains = {
            key.removeprefix("gains."): value
            for key, value in sorted(row.items())
            if key.startswith("gains.") and value is not None
        }
        words = {name: row[name] for name in ("contender", "robot", "sensors")}
        names = [f"{period:g}s" for period in PERIODS]
        names += [_INFORMED] * (row["contender"] in INFORMED)
        for name, period in zip(names, (*PERIODS, TUNING_PERIOD), strict=False):
            found = {key: row.get(f"{name}.{key}") for key in FIGURES}
            told = {"period": period, "informed": name == _INFORMED, "gains": gains}
            yield {**words, **told, **found}


if __name__ == "__main__":
    draw(list(runs_of(table_rows("alternatives"))), HERE.parent / "docs" / "alternatives.png")
