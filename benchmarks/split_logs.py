"""Whether the two halves of recorded motions give the same parameters, within their deviations.

``python -m benchmarks.split_logs FOLDER`` identifies the robots of ``benchmarks.real_logs`` from
the first half of each log and from the second, as ``identify`` does by default: with their own
effects of the joints. Of the parameters that both halves call identifiable it prints how many
estimates of one half lie within two standard deviations of the other half's, of which there are two
for each parameter, and how many differences lie within two deviations of the difference: what one
half knows little of is far from the other half's without being wrong. The UR10's log of another
motion is compared with its first log in the same way.

The exit status is 1 if the former is less than 90 % for the halves of a log, or the latter for two
logs.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

import pinadapt as pa
from benchmarks.real_logs import chosen_logs
from pinadapt.models.joint_effects import KINDS

WANTED = 0.9
AGAIN = {"ur10": "validation_trajectory.db3"}  # another log of the same arm, beside the first one


def halves(log: pa.Log) -> tuple[pa.Log, pa.Log]:
    """Return the first and the second half of a log."""
    first = log.t < 0.5 * (log.t[0] + log.t[-1])
    return tuple(  # type: ignore[return-value]
        replace(
            log,
            t=log.t[part],
            q=log.q[part],
            tau=log.tau[part],
            v=None if log.v is None else log.v[part],
        )
        for part in (first, ~first)
    )


def differences(
    one: pa.Identification, other: pa.Identification
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the names (p) of common parameters that both call identifiable, and |difference|.

    The differences (2, p) are in units of the deviations of each.
    """
    parts = one.dynamic, other.dynamic
    names = [name for name in parts[0].names if name in parts[1].names]
    values, deviations = (
        np.array(
            [[getattr(part, what)[part.names.index(name)] for name in names] for part in parts]
        )
        for what in ("estimate", "deviations")
    )
    known = np.isfinite(deviations).all(axis=0)
    away = np.abs(values[0] - values[1])[known] / deviations[:, known]
    return tuple(name for name, good in zip(names, known, strict=True) if good), away


def row(name: str, logs: Sequence[pa.Log], robot: pa.Robot) -> tuple[float, float]:
    """Print what two logs of a robot have in common; return both shares within two deviations."""
    names, away = differences(*(pa.identify(log, robot, progress=False) for log in logs))
    joint = np.array([label.rpartition(".")[2] in KINDS for label in names])
    near, worst = away < 2.0, int(np.argmax(away.max(axis=0)))
    fair = np.mean((away**-2.0).sum(axis=0) > 0.25)  # |difference| < 2 (d_1^2 + d_2^2)^(1/2)
    print(
        f"{name} | {len(names)} | {near.mean():.1%} | {near[:, ~joint].mean():.1%} | "
        f"{near[:, joint].mean():.1%} | {fair:.1%} | {names[worst]}: {away[:, worst].max():.1f}",
        flush=True,
    )
    return float(near.mean()), float(fair)


def main() -> int:
    """Print the table; return the exit status."""
    warnings.simplefilter("ignore")
    logs, shares = chosen_logs(__doc__), []
    print(
        "log | identifiable in both | within two deviations: all | bodies | joints | "
        "of the difference | the farthest"
    )
    for name, file, robot in logs:
        log = pa.read_log(file, robot)
        shares.append(row(f"{name}, halves", halves(log), robot)[0])
        if name in AGAIN and (again := file.with_name(AGAIN[name])).exists():
            shares.append(row(f"{name}, two logs", (log, pa.read_log(again, robot)), robot)[1])
    return int(min(shares) < WANTED)


if __name__ == "__main__":
    sys.exit(main())
