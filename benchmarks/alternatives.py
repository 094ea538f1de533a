"""Alternatives to adaptation: PD and PID with gravity, computed torque, disturbance observer.

Robots of the zoo with friction, an unknown tool and load, and inertias 30 % off follow one circle
in 1, 2 and 5 s, with perfect sensors, and with a camera of 60 Hz that is 20 ms late and encoders of
17 bits. Integral gains, and gains that a delay requires to be lower, are the best of a small grid
on the circle of 2 s; everything else has the bandwidth of the default.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import pinadapt as pa

from .alternatives_report import draw, report
from .contenders import CONTENDERS, DEFAULT, SENSORS, Gains, setting
from .timing import HERE, save

ROBOTS, PERIODS = ("panda", "ur5"), (1.0, 2.0, 5.0)
TUNING_PERIOD = 2.0  # [s], of the circle on which gains are selected
INFORMED = (DEFAULT, "computed torque", "computed torque, observer, task integral")
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
        warnings.simplefilter("ignore")  # of a light joint, and of unphysical starts
        try:
            rollout = pa.simulate(
                at.true,
                controller,
                path,
                duration=run.duration,
                sensors=at.sensors,
                engine=pa.Engine(dt=_DT),
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


def figures_of(
    robot: str,
    sensors: str,
    contender: str,
    period: float,
    gains: Gains,
    informed: bool,
    tuning: bool,
) -> dict[str, Any]:
    """Return the results of a run as a case of a sweep."""
    return figures(Run(robot, sensors, contender, period, gains, informed, tuning))


def swept(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return the results of runs, on all cores."""
    table = pa.sweep(figures_of, [asdict(run) for run in runs])
    if table.lost.any():
        raise RuntimeError(str(table))
    names = ("radius", "bandwidth", *FIGURES)
    return [{name: each.get(name) for name in names} for each in table.rows()]


def tuned(robots: Sequence[str]) -> dict[tuple[str, str, str], Gains]:
    """Return the gains of each robot, sensors and contender with least error, {} without choice."""
    best: dict[tuple[str, str, str], tuple[float, Gains]] = {}
    runs = [
        Run(robot, sensors, name, TUNING_PERIOD, gains, tuning=True)
        for (robot, sensors), (name, contender) in product(
            product(robots, SENSORS), CONTENDERS.items()
        )
        if sensors in contender.sensors and contender.grid
        for gains in contender.choices()
    ]
    for run, found in zip(runs, swept(runs), strict=True):
        key, error = (run.robot, run.sensors, run.contender), found["rms"]
        if error is not None and (key not in best or error < best[key][0]):
            best[key] = error, run.gains
    return {key: gains for key, (_, gains) in best.items()}


def planned(gains: Mapping[tuple[str, str, str], Gains], robots: Sequence[str]) -> Iterable[Run]:
    """Yield all runs, the longest first."""
    for name, contender in reversed(CONTENDERS.items()):
        for robot, sensors in product(robots, contender.sensors):
            own = gains.get(
                (robot, sensors, name), contender.choices()[0]
            )  # diverges, if none was found
            yield from (Run(robot, sensors, name, period, own) for period in PERIODS)
            if name in INFORMED:
                yield Run(robot, sensors, name, TUNING_PERIOD, own, informed=True)


def measure(robots: Sequence[str]) -> list[dict[str, Any]]:
    """Return one row per run."""
    runs = list(planned(tuned(robots), robots))
    return [row(run, found) for run, found in zip(runs, swept(runs), strict=True)]


def row(run: Run, found: Mapping[str, Any]) -> dict[str, Any]:
    """Return a run with its results as one flat row with a name."""
    suffix = ", informed" if run.informed else ""
    name = f"{run.robot}, {run.sensors}, {run.period:g} s, {run.contender}{suffix}"
    words = {"contender": run.contender, "robot": run.robot, "sensors": run.sensors}
    return {
        "name": name,
        **words,
        "period": run.period,
        "informed": run.informed,
        "gains": run.gains,
        **found,
    }


def main() -> None:
    """Run all, print the tables, save and draw them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", default=",".join(ROBOTS), help="names, separated by commas")
    parser.add_argument("--save", type=Path, default=HERE / "alternatives.json")
    parser.add_argument("--plot", type=Path, default=HERE.parent / "docs" / "alternatives.png")
    options = parser.parse_args()
    rows = measure(options.robots.split(","))
    print(report(rows))
    save(options.save, rows)
    draw(rows, options.plot)


if __name__ == "__main__":
    main()
