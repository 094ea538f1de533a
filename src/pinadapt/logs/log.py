"""A recorded motion of a robot's joints with the torques of its motors, and checks of it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, takewhile
from typing import Any

import numpy as np
import pinocchio as pin

from .._checks import LARGEST, instance
from ..description.chain import configuration_from_angles, effort_limits, position_limits
from ..exceptions import LogError, did_you_mean
from ..robot.robot import Robot

_EPOCH = 1e6  # [s] beyond which times count from an epoch such as 1970; twelve days of recording
_SHORTEST, _FEWEST = 1.0, 100  # [s] and samples; half as many leave nothing to hold out
_SLOWEST = 0.2  # [s] between samples: windows of four samples have no inertia left at twice as much
_REPEATED = 0.05  # share of samples that may repeat the one before; a tenth shows in estimates
_MEASURED = 0.5  # share of the samples that must be finite, and within the joint limits
_TURNS = 4.0 * math.pi  # [rad] beyond which a joint without limits hardly turns
# Beyond a limit by more than calibration: [rad], or share of the range. Half as much refuses arms
# with another zero, twice as much takes degrees for radians.
_BEYOND, _RANGE = 0.5, 0.25
_TOO_STRONG = 5.0  # times the effort limit, rms: motors give twice; currents in mA are far above
_MOVING = 0.02  # [rad/s or m/s] rms of a velocity that can be compared; half is noise of encoders
_AVERAGED = 25  # samples over which velocities are averaged; half leaves noise of slow motions


@dataclass(frozen=True, eq=False)
class Log:
    """N samples of n joints in rad, m, N m, N and s; NaN where something was not measured.

    Attributes:
        t: (N) times [s], ascending.
        q: (N, n) one number per joint, or (N, nq) configurations as Pinocchio has them.
        tau: (N, n) torques of the joints.
        v: (N, n) velocities, or None: they are computed from q.
        joints: (n) names of the columns; none: those of the robot, in its order.
        x: (M, m) position of the frame in world axes, for a pose with a quaternion xyzw; or None.
        x_time: (M) times of x [s]; None: t.
        held: whether tau[k] was held from t[k] until the next sample, as a controller's command is;
            otherwise it was measured at t[k].
        source: file or other origin, for messages.
        assumed: what reading it had to assume, fields of an ``Intake``.
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
    assumed: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Convert everything to arrays of floats and check their sizes.

        Raises:
            LogError: not numbers, or sizes that do not match.
        """
        for name, dimensions in (("t", 1), ("q", 2), ("tau", 2), ("v", 2), ("x", 2), ("x_time", 1)):
            given = getattr(self, name)
            if given is not None:
                object.__setattr__(self, name, self._array(given, name, dimensions))
        for name in ("q", "tau", "v"):
            given = getattr(self, name)
            if given is not None and len(given) != len(self.t):
                raise LogError(f"{len(given)} rows for {len(self.t)} times.", where=self._at(name))
        if self.x is not None and len(self.x) != len(self.frames_time):
            raise LogError(
                f"{len(self.x)} rows for {len(self.frames_time)} times.",
                where=self._at("x"),
                hint="Frames of a slow camera need times of their own, x_time, or rows of NaN "
                "between them.",
            )

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.t[-1] - self.t[0]) if len(self.t) else 0.0

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
        times = self.frames_time
        finite = np.isfinite(self.x).all(axis=1) & np.isfinite(times)
        return times[finite], self.x[finite]

    def of(self, robot: Robot) -> Log:
        """Return the log with the columns of a robot's joints, in its order.

        Joints of other names are matched, see ``match_joints``; a warning says how.

        Raises:
            LogError: a joint is missing, or the columns are not as many as there are joints.
        """
        names = instance(robot, Robot, "robot").joint_names
        if self.joints and list(self.joints) != names:
            order = self._order(names)
            read = [self.joints[k] for k in order]
            parts = {name: getattr(self, name) for name in ("q", "v", "tau")}
            parts = {name: part[:, order] for name, part in parts.items() if part is not None}
            assumed = self.assumed if read == names else {**self.assumed, "joints": read}
            return replace(self, joints=tuple(names), assumed=assumed, **parts).of(robot)
        n, nq = robot.model.nv, robot.model.nq
        for name, sizes in {"q": (n, nq), "v": (n,), "tau": (n,)}.items():
            part = getattr(self, name)
            if part is not None and part.shape[1] not in sizes:
                raise LogError(
                    f"{part.shape[1]} columns, but {robot.name} has {n} joints: {names}.",
                    where=self._at(name),
                    hint="Name columns after joints, or choose the frame and locked "
                    "joints so that these are its joints.",
                )
        return self

    def configurations(self, robot: Robot) -> np.ndarray:
        """Return q (N, nq) as Pinocchio has it; NaN where a joint was not measured."""
        model: pin.Model = robot.model
        if self.q.shape[1] == model.nq:
            return self.q
        found = np.full((len(self.q), model.nq), np.nan)
        for k in np.flatnonzero(np.isfinite(self.q).all(axis=1)):
            found[k] = configuration_from_angles(model, self.q[k])
        return found

    def from_zero(self) -> Log:
        """Return the log with times from its first sample, where they count from an epoch."""
        if not len(self.t) or not self.t[0] > _EPOCH:
            return self
        x_time = None if self.x_time is None else self.x_time - self.t[0]
        return replace(self, t=self.t - self.t[0], x_time=x_time)

    def sampled(self, kept: np.ndarray) -> Log:
        """Return the log with those of its samples that are kept (N)."""
        own = () if self.x_time is None else ("x",)
        parts = {name: getattr(self, name) for name in ("t", "q", "tau", "v", "x")}
        return replace(
            self,
            **{k: part[kept] for k, part in parts.items() if part is not None and k not in own},
        )

    def after(self, t: float) -> Log:
        """Return the log from a time [s] on."""
        found = self.sampled(self.t >= t)
        if self.x is None or self.x_time is None:
            return found
        kept = self.x_time >= t
        return replace(found, x=self.x[kept], x_time=self.x_time[kept])

    def _order(self, names: Sequence[str]) -> list[int]:
        """Return the column of each of the robot's joints."""
        order = match_joints(self.joints, names, self.source)
        if order is not None:
            return order
        if not set(self.joints) & set(names):
            raise LogError(
                f"none of its joints {list(self.joints)} is one of the robot's, {list(names)}. It "
                "seems to be the log of another robot.",
                where=self.source,
                hint="Name the robot that moved, or its joints in the robot's order: "
                "--joints A,B,....",
            )
        joint = next(name for name in names if name not in self.joints)
        raise LogError(
            f"the robot's joint '{joint}' is missing; there are {list(self.joints)}."
            f"{did_you_mean(joint, self.joints)}",
            where=self.source,
            hint="Lock joints that did not move (--lock), choose another frame, or name the log's "
            "joints in the robot's order: --joints A,B,....",
        )

    def _at(self, name: str) -> str:
        return f"{self.source}: {name}"

    def _array(self, given: object, name: str, dimensions: int) -> np.ndarray:
        try:
            array = np.array(given, dtype=float)
        except (TypeError, ValueError) as error:
            raise LogError(f"expected numbers: {error}.", where=self._at(name)) from error
        if array.ndim != dimensions:
            shape = "one number per sample" if dimensions == 1 else "a row of numbers per sample"
            raise LogError(f"expected {shape}, got shape {array.shape}.", where=self._at(name))
        if (np.abs(array[np.isfinite(array)]) > LARGEST).any():
            raise LogError(f"has numbers beyond {LARGEST:g}.", where=self._at(name))
        return array


def match_joints(found: Sequence[str], wanted: Sequence[str], source: str) -> list[int] | None:
    """Return the index of each wanted joint among those found, None where they do not match.

    Names that differ only in what all of them have in common, such as ``fer_joint1`` and
    ``panda_joint1``, match. Numbers from 0 or 1 on, or if no name is alike as many others, are
    taken in their order. A warning says what was assumed.

    Args:
        found: names in a log.
        wanted: names of a robot's joints.
        source: of the log, for the warning.
    """
    found, n = list(found), len(wanted)
    if set(wanted) <= set(found):
        return [found.index(name) for name in wanted]
    if set(wanted) & set(found):
        return None
    for first in (0, 1):
        numbers = [str(first + k) for k in range(n)]
        if set(numbers) <= set(found):
            if str(first + n) in found:
                warnings.warn(
                    f"{source} has signals of more than the robot's {n} joints; the first {n} are "
                    "taken. Is it the log of another robot? --columns names them.",
                    stacklevel=2,
                )
            return [found.index(name) for name in numbers]
    order, how = _alike(found, wanted), "by their names"
    if order is None:
        order, how = list(range(n)), "in their order"
        if len(found) != n:
            return None
    pairs = ", ".join(f"{found[k]} = {name}" for k, name in zip(order, wanted, strict=True))
    warnings.warn(
        f"{source}: its joints have other names than the robot's and were matched {how}: {pairs}. "
        "--joints A,B,... names them in the robot's order.",
        stacklevel=2,
    )
    return order


def _alike(found: Sequence[str], wanted: Sequence[str]) -> list[int] | None:
    """Return the index of each wanted joint among names with another beginning or end."""
    before = len(wanted[0][: _common(wanted)].rstrip("0123456789"))
    after = _common([name[:before:-1] for name in wanted])
    keys = [name[before : len(name) - after].lower() for name in wanted]
    low, orders = [name.lower() for name in found], set[tuple[int, ...]]()
    for name in low:
        head, key, tail = name.rpartition(keys[0])
        names = [head + each + tail for each in keys]
        if key and len(keys) > 1 and set(names) <= set(low):
            orders.add(tuple(low.index(each) for each in names))
    return list(orders.pop()) if len(orders) == 1 else None


def _common(names: Sequence[str]) -> int:
    """Return how many first letters all names have in common."""
    letters = zip(*names, strict=False)
    return sum(1 for _ in takewhile(lambda each: len(set(each)) == 1, letters))


def repeated(log: Log) -> np.ndarray:
    """Return for each sample (N) whether it repeats an earlier one: the time, or all numbers.

    A sample at rest that equals the one before counts only if one of the next two differs, as that
    of a driver that is asked more often than it measures.
    """
    late = np.append(False, log.t[1:] <= np.maximum.accumulate(log.t)[:-1])
    rows = np.hstack([part for part in (log.q, log.v, log.tau) if part is not None])
    same = np.append(False, (rows[1:] == rows[:-1]).all(axis=1))
    rests = np.append(same[1:], [False]) & np.append(same[2:], [False, False])
    return np.asarray(late | (same & ~rests))


def check(log: Log, robot: Robot, *, torques: bool = True) -> None:
    """Raise an error for a log from which no parameters can be estimated.

    Without ``torques``, only times and positions are checked, and few samples will do.

    Raises:
        LogError: times that do not ascend, too few or too short a time, more than half of a signal
            not finite, torques that are all zero, or numbers that look like other units.
    """
    late = np.append(False, ~(np.diff(log.t) > 0.0)) | ~np.isfinite(log.t)
    if late.any():
        row = int(np.argmax(late))
        raise _refused(
            log,
            "t",
            f"times must ascend; sample {row} is at {log.t[row]:.6g} s. There are "
            f"{np.count_nonzero(late)} such samples.",
            "--repeated drop leaves out samples of repeated or earlier times. Otherwise name "
            "another column: --columns t=NAME.",
        )
    _check_finite(log, robot, "q")
    _check_degrees(log, robot)
    if not torques:
        return
    if len(log.t) < _FEWEST or log.duration < _SHORTEST:
        words = f"{len(log.t)} samples over {log.duration:.3g} s are too short"
        raise _refused(log, "t", f"{words}; at least {_FEWEST} and {_SHORTEST:g} s are needed.")
    if log.period > _SLOWEST:
        raise _refused(
            log,
            "t",
            f"samples are {log.period:.4g} s apart, too far for inertia to have a visible effect.",
            f"Record at {1.0 / _SLOWEST:g} Hz or more, with times in seconds. If these are "
            f"milliseconds: --rate {1e3 / log.period:.4g}.",
        )
    share = float(np.mean(repeated(log)))
    if share > _REPEATED:
        words = f"{share:.0%} of the samples repeat the one before in all numbers"
        hint = "--repeated drop leaves them out."
        raise _refused(log, "t", f"{words}, so that their times are wrong.", hint)
    _check_finite(log, robot, "tau")
    _check_velocities(log, robot)
    _check_torques(log, robot)


def _refused(log: Log, name: str, words: str, hint: str | None = None) -> LogError:
    """Return the error of a signal of a log."""
    return LogError(words, where=f"{log.source}: {name}", hint=hint)


def _check_finite(log: Log, robot: Robot, name: str) -> None:
    part = getattr(log, name)
    share = np.isfinite(part).mean(axis=0)
    if (share < _MEASURED).any():
        joint = int(np.argmin(share)) if part.shape[1] == robot.model.nv else 0
        words = f"only {share.min():.0%} of the samples of {robot.joint_names[joint]} are numbers."
        raise _refused(log, name, words)


def _check_degrees(log: Log, robot: Robot) -> None:
    """Refuse positions far outside of the limits: in degrees, or those of another robot."""
    if log.q.shape[1] != robot.model.nv:
        return
    low, high = position_limits(robot.model)
    free = ~np.isfinite(high - low)
    low, high = np.where(free, -_TURNS, low), np.where(free, _TURNS, high)
    margin = np.maximum(_BEYOND, _RANGE * (high - low))
    outside = np.mean((log.q < low - margin) | (log.q > high + margin), axis=0)
    outside[list(robot.slides.values())] = 0.0
    j = int(outside.argmax())
    if outside[j] > _MEASURED:
        least, most = np.nanmin(log.q[:, j]), np.nanmax(log.q[:, j])
        what, option = "Is this the log of another robot?", ""
        if max(-least, most) > 2.0 * math.pi:
            what = "Are these degrees, or angles of the motor before a gear?"
            option = "--degrees or --gear N reads them. "
        raise _refused(
            log,
            "q",
            f"{robot.joint_names[j]} is at {least:.4g} to {most:.4g}, and its limits are "
            f"{low[j]:.4g} and {high[j]:.4g} rad. {what}",
            f"{option}Columns without joint names must be in the robot's order.",
        )


def _check_velocities(log: Log, robot: Robot) -> None:
    """Refuse velocities that disagree with the positions: other units, signs or columns."""
    if log.v is None:
        return
    q = log.configurations(robot)
    moved = np.array([pin.difference(robot.model, *ends) for ends in pairwise(q)])
    rates, mean = moved / np.diff(log.t)[:, None], 0.5 * (log.v[1:] + log.v[:-1])
    for name, rate, velocity in zip(robot.joint_names, rates.T, mean.T, strict=True):
        both = np.isfinite(velocity) & np.isfinite(rate)
        # averages, in which the noise of differenced encoders cancels
        rate, velocity = (
            np.convolve(part[both], np.full(_AVERAGED, 1.0 / _AVERAGED), mode="same")
            for part in (rate, velocity)
        )
        if not len(rate) or float(np.sqrt(np.mean(rate**2))) < _MOVING:
            continue
        factor = float(rate @ velocity / (rate @ rate))
        if not 0.5 < factor < 2.0:  # other units are far outside
            raise _refused(
                log,
                "v",
                f"the velocity of {name} is {factor:.3g} times the rate of its positions: 57.3 "
                "where it is in degrees a second, 0.0175 where the positions are in degrees, -1 "
                "where one sign is wrong, the ratio of a gear where one is that of the motor.",
                "Convert both to rad and rad/s (m and m/s), or leave velocities out: they are then "
                "computed from the positions.",
            )


def _check_torques(log: Log, robot: Robot) -> None:
    """Refuse torques that are zero, or far above the limits: not recorded, or of other units."""
    tau = np.where(np.isfinite(log.tau), log.tau, np.nan)
    sizes, limits = np.sqrt(np.nanmean(tau**2, axis=0)), effort_limits(robot.model)
    name = robot.joint_names[int(np.argmin(sizes))]
    if not sizes.all():
        who = f"the torque of {name} is" if sizes.any() else "all torques are"
        raise _refused(
            log,
            "tau",
            f"{who} zero in all samples: not recorded.",
            f"Record the efforts of the motors; --lock {name} leaves out what did not move.",
        )
    j = int(np.argmax(sizes / limits))
    if sizes[j] > _TOO_STRONG * limits[j]:
        raise _refused(
            log,
            "tau",
            f"{robot.joint_names[j]} gives {sizes[j]:.4g} on average, and its limit is "
            f"{limits[j]:g} N m or N. Are these other units?",
            "Torques must be those of the joints, after the gears, in N m or N. --torque-gain "
            "multiplies them, with N m/A for currents.",
        )


def joined(logs: Sequence[Log], pause: float) -> Log:
    """Return logs of the same robot one after another, with a pause in between [s].

    Times of each count on from the one before. Velocities and positions of the frame are kept if
    all logs have them.

    Raises:
        LogError: torques that are held in one log and measured at their instants in another.
    """
    if len(logs) == 1:
        return logs[0]
    source = ", ".join(log.source for log in logs)
    if len({log.held for log in logs}) > 1:
        words = "torques are held in one of the logs, and measured at their instants in another."
        raise LogError(words, where=source)
    times = list(zip(logs, starts_of(logs, pause), strict=True))
    parts: dict[str, Any] = {
        "t": np.concatenate([log.t + start for log, start in times]),
        "x_time": np.concatenate([log.frames_time + start for log, start in times]),
    }
    for name in ("q", "tau", "v", "x"):
        arrays = [getattr(log, name) for log in logs]
        sizes = {None if array is None else array.shape[1] for array in arrays}
        parts[name] = np.concatenate(arrays) if len(sizes) == 1 and None not in sizes else None
    if parts["x"] is None:
        parts["x_time"] = None
    return replace(logs[0], **parts, source=source)


def starts_of(logs: Sequence[Log], pause: float) -> list[float]:
    """Return what is added to the times of each log in ``joined`` [s]."""
    shifts = [0.0]
    for before, log in pairwise(logs):
        shifts.append(float(before.t[-1]) + shifts[-1] + pause - float(log.t[0]))
    return shifts
