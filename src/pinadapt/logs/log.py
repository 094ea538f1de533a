"""A recorded motion of a robot's joints with the torques of its motors, and checks of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.ndimage import uniform_filter1d

from .._checks import LARGEST
from ..exceptions import LogError, did_you_mean
from ..information.measured_motion import differences, integrated
from ..robot.robot import Robot

SIGNALS = ("q", "v", "tau")  # of the joints
# Usual names of each signal, the likeliest first; case is ignored.
NAMES = {
    "t": "t time timestamp stamp times time_s %time",
    "q": "q position pos joint_position joint_positions actual_q angle",
    "v": "v qd dq qdot velocity vel joint_velocity joint_velocities actual_qd",
    "tau": "tau effort torque eff tau_j joint_torque joint_torques joint_effort",
    "x": "x ee_position tool_position",
    "x_time": "x_time t_x camera_time",
}
_SHORTEST = 1.0  # [s]; half as much leaves nothing to hold out
_LONGEST_PERIOD = 0.2  # [s]; windows of four samples have no inertia left at twice as much
# share of samples that may repeat the one before; a tenth shows in estimates; half, twice: the same
# verdicts on real logs and on a fifth of repeated samples
_REPEATED = 0.05
_MOVING = 0.02  # [rad/s or m/s] rms of a velocity that can be compared; half is noise of encoders
_AVERAGED = 25  # samples over which velocities are averaged; half leaves noise of slow motions


@dataclass(frozen=True, eq=False)
class Log:
    """N samples of n joints in rad, m, N m, N and s; NaN where something was not measured.

    Attributes:
        t: (N) times [s], ascending.
        q: (N, n) one number per joint, or (N, nq) configurations as Pinocchio has them.
        tau: (N, n) torques of the joints; None: not measured.
        v: (N, n) velocities, or None: they are computed from q.
        joints: (n) names of the columns; none: those of the robot, in its order.
        x: (M, m) position of the frame in world axes, for a pose with a quaternion xyzw; or None.
        x_time: (M) times of x [s]; None: t.
        held: whether tau[k] was held from t[k] until the next sample, as a controller's command is;
            otherwise it was measured at t[k].
        source: file or other origin, for messages.
    """

    t: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    v: np.ndarray | None = None
    joints: tuple[str, ...] = ()
    x: np.ndarray | None = None
    x_time: np.ndarray | None = None
    held: bool = False
    source: str = "log"

    def __post_init__(self) -> None:
        """Convert everything to arrays of floats and check their sizes.

        Raises:
            LogError: not numbers, or sizes that do not match.
        """
        if self.tau is None:
            object.__setattr__(self, "tau", np.full(np.shape(self.q), np.nan))
        for name, dimensions in (("t", 1), ("q", 2), ("tau", 2), ("v", 2), ("x", 2), ("x_time", 1)):
            given = getattr(self, name)
            if given is not None:
                object.__setattr__(self, name, self._array(given, name, dimensions))
        rows = dict.fromkeys(SIGNALS, self.t) | {"x": self.frames_time}
        for name, times in rows.items():
            given = getattr(self, name)
            if given is not None and len(given) != len(times):
                raise LogError(
                    f"{len(given)} rows for {len(times)} times.",
                    where=self._at(name),
                    hint="Frames of a slow camera need times of their own, x_time.",
                )

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(np.ptp(self.t)) if len(self.t) else 0.0

    @property
    def period(self) -> float:
        """Median time between samples [s]."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else 0.0

    @property
    def frames_time(self) -> np.ndarray:
        """Times (M) of the positions of the frame [s], those of the samples if not stated."""
        return self.t if self.x_time is None else self.x_time

    def frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times (k) [s] and coordinates (k, m) of the frames that are finite."""
        if self.x is None:
            return np.zeros(0), np.zeros((0, 0))
        finite = np.isfinite(self.x).all(axis=1) & np.isfinite(self.frames_time)
        return self.frames_time[finite], self.x[finite]

    def of(self, robot: Robot) -> Log:
        """Return the log with the columns of a robot's joints, in its order.

        Raises:
            LogError: a joint is missing, or the columns are not as many as there are joints.
        """
        names = robot.joint_names
        n = robot.model.nv
        log = self
        if np.isnan(self.tau).all():  # in as many columns as q, which may have cosines and sines
            log = replace(self, tau=np.full((len(self.t), len(self.joints) or n), np.nan))
        if self.joints and list(self.joints) != names:
            log = log.ordered(joint_order(self.joints, names, self.source))
            log = replace(log, joints=tuple(names))
        for name, part in log.signals().items():
            if part.shape[1] not in ((n, robot.model.nq) if name == "q" else (n,)):
                raise LogError(
                    f"{part.shape[1]} columns, but {robot.name} has {n} joints: {names}.",
                    where=self._at(name),
                    hint="Name columns after joints, or choose the frame and locked "
                    "joints so that these are its joints.",
                )
        return log

    def signals(self) -> dict[str, Any]:
        """Return the signals of the joints that were recorded, by name."""
        return {name: part for name in SIGNALS if (part := getattr(self, name)) is not None}

    @property
    def finite(self) -> np.ndarray:
        """Whether all signals of the joints are finite in a sample (N)."""
        return np.isfinite(np.hstack(list(self.signals().values()))).all(axis=1)

    def ordered(self, order: Sequence[int], signals: Sequence[str] = SIGNALS) -> Log:
        """Return the log with the columns of some signals in another order.

        Raises:
            LogError: not a column for each named joint.
        """
        for name, part in self.signals().items():
            if self.joints and name != "q" and part.shape[1] != len(self.joints):
                raise LogError(
                    f"{part.shape[1]} columns of the joints {list(self.joints)}.",
                    where=self._at(name),
                )
        return replace(
            self,
            **{name: part[:, order] for name, part in self.signals().items() if name in signals},
        )

    def configurations(self, robot: Robot) -> np.ndarray:
        """Return q (N, nq) as Pinocchio has it; NaN where a joint was not measured."""
        model: pin.Model = robot.model
        if self.q.shape[1] == model.nq:
            return self.q
        return integrated(model, pin.neutral(model), self.q)

    def sampled(self, kept: np.ndarray) -> Log:
        """Return the log with those of its samples that are kept (N)."""
        parts: dict[str, Any] = {name: part[kept] for name, part in self.signals().items()}
        if self.x is not None and self.x_time is None:
            parts["x"] = self.x[kept]
        return replace(self, t=self.t[kept], **parts)

    def after(self, t: float) -> Log:
        """Return the log from a time [s] on."""
        found = self.sampled(self.t >= t)
        if self.x is None or self.x_time is None:
            return found
        kept = self.x_time >= t
        return replace(found, x=self.x[kept], x_time=self.x_time[kept])

    def _at(self, name: str) -> str:
        return f"{self.source}: {name}"

    def _array(self, given: object, name: str, dimensions: int) -> np.ndarray:
        try:
            array = np.array(given, dtype=float)
        except (TypeError, ValueError) as error:
            raise LogError(f"expected numbers: {error}.", where=self._at(name)) from error
        if array.ndim != dimensions:
            raise LogError(
                f"expected an array of {dimensions} dimensions, got shape {array.shape}.",
                where=self._at(name),
            )
        if (np.abs(array[np.isfinite(array)]) > LARGEST).any():
            raise LogError(f"has numbers beyond {LARGEST:g}.", where=self._at(name))
        return array


def joint_order(found: Sequence[str], wanted: Sequence[str], source: str) -> list[int]:
    """Return the index of each wanted joint among those found: by name, or numbered from 0 or 1.

    What is no number is then not of a joint: ``q[0]``, ``q_d[0]`` are found as ``0`` and ``d[0``.

    Args:
        found: names in a log.
        wanted: names of a robot's joints.
        source: of the log, for messages.

    Raises:
        LogError: a joint is missing.
    """
    n = len(wanted)
    numbered = sum(map(str.isdigit, found))
    for names in (wanted, *([str(first + k) for k in range(n)] for first in (0, 1))):
        if set(names) <= set(found) and (names is wanted or numbered == n):
            return [list(found).index(name) for name in names]
    joint = next(name for name in wanted if name not in found)
    raise LogError(
        f"the robot's joint '{joint}' is missing; there are {list(found)}."
        f"{did_you_mean(joint, found)}",
        where=source,
        hint="Is it the log of another robot? Lock joints that did not move (--lock), choose "
        "another frame, or name the log's joints in the robot's order: --joints A,B,....",
    )


def repeated(log: Log) -> np.ndarray:
    """Return for each sample (N) whether it repeats an earlier one: the time, or all numbers.

    A sample at rest that equals the one before counts only if one of the next two differs, as that
    of a driver that is asked more often than it measures.
    """
    late = np.append(False, log.t[1:] <= np.maximum.accumulate(log.t)[:-1])
    rows = np.hstack(list(log.signals().values()))
    same = np.append(False, (rows[1:] == rows[:-1]).all(axis=1))
    rests = np.append(same[1:], [False]) & np.append(same[2:], [False, False])
    return late | (same & ~rests)


def check_times(log: Log) -> None:
    """Refuse times that are no numbers, or do not ascend.

    Raises:
        LogError: with the first such sample.
    """
    late = np.append(False, ~(np.diff(log.t) > 0.0)) | ~np.isfinite(log.t)
    if late.any():
        row = np.argmax(late)
        flaw = f"times must ascend; sample {row} is at {log.t[row]:.6g} s."
        hint = (
            "--repeated drop leaves out samples of repeated or earlier times; --columns t=NAME "
            "names another column, --rate HZ replaces the times."
        )
        if not np.isfinite(log.t[row]):
            flaw = f"the time of sample {row} is no number."
            hint = "Decimals need a point; remove a row of units, and quotes."
        raise LogError(flaw, where=f"{log.source}: t", hint=hint)


def check(log: Log, robot: Robot, *, torques: bool = True) -> None:
    """Raise an error for a log from which no parameters can be estimated.

    Without ``torques``, only times and positions are checked, and few samples will do.

    Raises:
        LogError: times that do not ascend, too short a time, more than half of a signal not finite,
            torques that are all zero, or numbers that look like other units.
    """

    def refuse(name: str, words: str, hint: str) -> None:
        raise LogError(words, where=f"{log.source}: {name}", hint=hint)

    check_times(log)
    for name in ("q", "tau") if torques else ("q",):
        part = getattr(log, name)
        share = np.isfinite(part).mean(axis=0).min()
        if share < 0.5:
            refuse(
                name,
                f"only {share:.0%} of the samples of a joint are numbers.",
                f"Decimals need a point. --columns {name}=NAME,..., in a file without header "
                f"{name}=2-8, or --topic of a bag says where they are; --lock NAME leaves out a "
                "joint.",
            )
    if not torques:
        return
    if log.duration < _SHORTEST or log.period > _LONGEST_PERIOD:
        refuse(
            "t",
            f"{log.duration:.3g} s with a sample each {log.period:.3g} s cannot show inertia; at "
            f"least {_SHORTEST:g} s are needed, and a sample each {_LONGEST_PERIOD:g} s.",
            "Are the times in seconds? --rate HZ replaces them.",
        )
    share = np.mean(repeated(log))
    if share > _REPEATED:
        refuse(
            "t",
            f"{share:.0%} of the samples repeat the one before in all numbers, so that their "
            "times are wrong.",
            "--repeated drop leaves them out.",
        )
    if log.v is not None:
        _check_velocities(log, log.v, robot)
    still = robot.motors & ~np.nan_to_num(log.tau).any(axis=0)
    if still.any():
        name = robot.joint_names[still.argmax()]
        refuse(
            "tau",
            f"the torque of {name} is zero in all samples: not recorded.",
            f"Record the efforts of the motors; --lock {name} leaves out what did not move.",
        )


def _check_velocities(log: Log, v: np.ndarray, robot: Robot) -> None:
    """Check velocities (N, n) against the positions.

    Raises:
        LogError: they disagree.
    """
    ways = differences(robot.model, log.configurations(robot))
    means = 0.5 * (v[1:] + v[:-1])
    both = np.isfinite(ways) & np.isfinite(means)
    # averages, in which the noise of differenced encoders and of times cancels
    ways, means, steps = (
        uniform_filter1d(np.where(both, part, 0.0), _AVERAGED, axis=0)
        for part in (ways, means, np.diff(log.t)[:, None])
    )
    rates = ways / np.where(steps > 0.0, steps, 1.0)
    size = np.mean(rates**2, axis=0)
    factors = np.mean(rates * means, axis=0) / np.where(size > 0.0, size, 1.0)
    wrong = (size > _MOVING**2) & ~((factors > 0.5) & (factors < 2.0))  # other units: far outside
    if wrong.any():
        j = wrong.argmax()
        raise LogError(
            f"the velocity of {robot.joint_names[j]} is {factors[j]:.3g} times the rate of its "
            "positions: other units, another sign, or the other side of a gear.",
            where=f"{log.source}: v",
            hint="Convert both to rad and rad/s (m and m/s), or leave velocities out: they are "
            "then computed from the positions.",
        )


def in_sequence(logs: Sequence[Log], pause: float) -> list[Log]:
    """Return logs whose times count on from the one before, after a pause [s]."""
    found = list[Log]()
    for log in logs:
        start = found[-1].t[-1] + pause - log.t[0] if found else 0.0
        found.append(replace(log, t=log.t + start, x_time=log.frames_time + start))
    return found


def joined(logs: Sequence[Log]) -> Log:
    """Return logs of the same robot as one, of ascending times.

    Velocities and positions of the frame are kept if all logs have them.

    Raises:
        LogError: there is none.
    """
    if not logs:
        raise LogError("expected a log, got none.", where="log")
    parts: dict[str, Any] = {"source": ", ".join(log.source for log in logs)}
    for name in ("t", *SIGNALS, "x", "x_time"):
        arrays = [getattr(log, name) for log in logs]
        sizes = {None if array is None else array.shape[1:] for array in arrays}
        parts[name] = np.concatenate(arrays) if len(sizes) == 1 and None not in sizes else None
    return replace(logs[0], **parts)
