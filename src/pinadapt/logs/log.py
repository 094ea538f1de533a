"""A recorded motion of a robot's joints with the torques of its motors, and checks of it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
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
_MEASURED = 0.5  # share of the samples that must be finite; half as many are a log of its own
_TURNS = 4.0 * math.pi  # [rad] beyond which a joint without limits hardly turns
# Beyond a limit by more than calibration: [rad], or share of the range; and share of the samples
# there. Half as much refuses arms with another zero, twice as much takes degrees for radians.
_BEYOND, _RANGE, _OUTSIDE = 0.5, 0.25, 0.5
_TOO_STRONG = 5.0  # times the effort limit, rms: motors give twice; currents in mA are far above
_MOVING = 0.02  # [rad/s or m/s] rms of a velocity that can be compared; half is noise of encoders
_AVERAGED = 25  # samples over which velocities are averaged; half leaves noise of slow motions
_FACTORS = (0.5, 2.0)  # between which a velocity agrees with the positions; units are far outside


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
        times = self.t if self.x_time is None else self.x_time
        if self.x is not None and len(self.x) != len(times):
            raise LogError(
                f"{len(self.x)} rows for {len(times)} times.",
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

    def frames(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times (k) [s] and coordinates (k, m) of the frames that are finite."""
        if self.x is None:
            return np.zeros(0), np.zeros((0, 0))
        times = self.t if self.x_time is None else self.x_time
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
            v = None if self.v is None else self.v[:, order]
            q, tau = self.q[:, order], self.tau[:, order]
            read = [self.joints[k] for k in order]
            assumed = self.assumed if read == names else {**self.assumed, "joints": read}
            found = replace(self, joints=tuple(names), q=q, v=v, tau=tau, assumed=assumed)
            return found.of(robot)
        n, nq = robot.model.nv, robot.model.nq
        parts = ("q", self.q, (n, nq)), ("v", self.v, (n,)), ("tau", self.tau, (n,))
        for name, part, sizes in parts:
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

    @property
    def frames_time(self) -> np.ndarray:
        """Times (M) of the positions of the frame [s], those of the samples if not stated."""
        return self.t if self.x_time is None else self.x_time

    def after(self, t: float) -> Log:
        """Return the log from a time [s] on."""
        kept = self.t >= t
        frames = kept if self.x_time is None else self.x_time >= t
        x = None if self.x is None else self.x[frames]
        x_time = None if self.x_time is None else self.x_time[frames]
        v = None if self.v is None else self.v[kept]
        return replace(
            self, t=self.t[kept], q=self.q[kept], tau=self.tau[kept], v=v, x=x, x_time=x_time
        )

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
    ``panda_joint1``, match. If no name is alike and there are as many, they are taken in their
    order. A warning says which joint was taken for which.

    Args:
        found: names in a log.
        wanted: names of a robot's joints.
        source: of the log, for the warning.
    """
    found, wanted = list(found), list(wanted)
    if set(wanted) <= set(found):
        return [found.index(name) for name in wanted]
    if set(wanted) & set(found):
        return None
    order, how = _alike(found, wanted), "by their names"
    if order is None and len(found) == len(wanted):
        order, how = list(range(len(wanted))), "in their order"
    if order is None:
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
    low, keys = [name.lower() for name in found], _distinct([name.lower() for name in wanted])
    if len(keys) < 2 or not all(keys):
        return None
    forms = [keys]
    if all(key.isdecimal() for key in keys):  # counted from another number
        forms += [[str(int(key) + shift) for key in keys] for shift in (-1, 1)]
    for form in forms:
        orders = set()
        for name in low:
            for at in range(len(name)):
                if name.startswith(form[0], at):
                    before, after = name[:at], name[at + len(form[0]) :]
                    names = [before + key + after for key in form]
                    if set(names) <= set(low):
                        orders.add(tuple(low.index(one) for one in names))
        if len(orders) == 1:
            return list(orders.pop())
        if orders:
            return None
    return None


def _distinct(names: Sequence[str]) -> list[str]:
    """Return names without the beginning and the end that all of them have in common."""
    before = _common(names)
    before = next((k for k in range(before, 0, -1) if not names[0][k - 1].isdigit()), 0)
    rest = [name[before:] for name in names]
    after = _common([name[::-1] for name in rest])
    return [name[: len(name) - after] for name in rest]


def _common(names: Sequence[str]) -> int:
    """Return how many first letters all names have in common."""
    columns = enumerate(zip(*names, strict=False))
    return next((k for k, letters in columns if len(set(letters)) > 1), min(map(len, names)))


def repeated(log: Log) -> np.ndarray:
    """Return for each sample (N) whether it repeats an earlier one: the time, or all numbers.

    A sample at rest that equals the one before counts only if one of the next two differs, as that
    of a driver that is asked more often than it measures.
    """
    latest = np.maximum.accumulate(log.t)
    late = np.append(False, log.t[1:] <= latest[:-1])
    parts = [log.q, log.tau] if log.v is None else [log.q, log.v, log.tau]
    rows = np.hstack(parts)
    same = np.append(False, (rows[1:] == rows[:-1]).all(axis=1))
    changed = np.append(~same[1:], True)
    changed |= np.append(changed[1:], True)
    return np.asarray(late | (same & changed))


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
        raise LogError(
            f"times must ascend; sample {row} is at {log.t[row]:.6g} s. There are "
            f"{np.count_nonzero(late)} such samples.",
            where=f"{log.source}: t",
            hint="--repeated drop leaves out samples of repeated or earlier times. Otherwise name "
            "another column: --columns t=NAME.",
        )
    _check_finite(log, robot, "q")
    _check_degrees(log, robot)
    if not torques:
        return
    if len(log.t) < _FEWEST or log.duration < _SHORTEST:
        raise LogError(
            f"{len(log.t)} samples over {log.duration:.3g} s are too short; at least {_FEWEST} and "
            f"{_SHORTEST:g} s are needed.",
            where=f"{log.source}: t",
        )
    if log.period > _SLOWEST:
        milliseconds = f" If these are milliseconds: --rate {1e3 / log.period:.4g}."
        raise LogError(
            f"samples are {log.period:.4g} s apart, too far for inertia to have a visible effect.",
            where=f"{log.source}: t",
            hint=f"Record at {1.0 / _SLOWEST:g} Hz or more, with times in seconds.{milliseconds}",
        )
    share = float(np.mean(repeated(log)))
    if share > _REPEATED:
        raise LogError(
            f"{share:.0%} of the samples repeat the one before in all numbers, so that their times "
            "are wrong.",
            where=log.source,
            hint="--repeated drop leaves them out.",
        )
    _check_finite(log, robot, "tau")
    _check_velocities(log, robot)
    _check_torques(log, robot)


def _check_finite(log: Log, robot: Robot, name: str) -> None:
    part = getattr(log, name)
    share = np.isfinite(part).mean(axis=0)
    if (share < _MEASURED).any():
        joint = int(np.argmin(share)) if part.shape[1] == robot.model.nv else 0
        raise LogError(
            f"only {share.min():.0%} of the samples of {robot.joint_names[joint]} are numbers.",
            where=f"{log.source}: {name}",
        )


def _check_degrees(log: Log, robot: Robot) -> None:
    """Refuse positions far outside of the limits: in degrees, or those of another robot."""
    if log.q.shape[1] != robot.model.nv:
        return
    low, high = position_limits(robot.model)
    slides = np.array(list(robot.slides.values()))
    free = slides | ~np.isfinite(high - low)
    low, high = np.where(free, -_TURNS, low), np.where(free, _TURNS, high)
    margin = np.maximum(_BEYOND, _RANGE * (high - low))
    outside = np.mean((log.q < low - margin) | (log.q > high + margin), axis=0) > _OUTSIDE
    if (outside & ~slides).any():
        j = int(np.argmax(outside & ~slides))
        q = log.q[np.isfinite(log.q[:, j]), j]
        what, option = "Is this the log of another robot?", ""
        if np.abs(q).max() > 2.0 * math.pi:
            what = "Are these degrees, or angles of the motor before a gear?"
            option = "--degrees or --gear N reads them. "
        raise LogError(
            f"{robot.joint_names[j]} is at {q.min():.4g} to {q.max():.4g}, and its limits are "
            f"{low[j]:.4g} and {high[j]:.4g} rad. {what}",
            where=f"{log.source}: q",
            hint=f"{option}Columns without joint names must be in the robot's order.",
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
        rate, velocity = _averages(rate[both]), _averages(velocity[both])
        if not len(rate) or float(np.sqrt(np.mean(rate**2))) < _MOVING:
            continue
        factor = float(rate @ velocity / (rate @ rate))
        if not _FACTORS[0] < factor < _FACTORS[1]:
            raise LogError(
                f"the velocity of {name} is {factor:.3g} times the rate of its positions: 57.3 "
                "where it is in degrees a second, 0.0175 where the positions are in degrees, -1 "
                "where one sign is wrong, the ratio of a gear where one is that of the motor.",
                where=f"{log.source}: v",
                hint="Convert both to rad and rad/s (m and m/s), or leave velocities out: they are "
                "then computed from the positions.",
            )


def _averages(values: np.ndarray) -> np.ndarray:
    """Return running averages, in which the noise of differenced encoders cancels."""
    return np.convolve(values, np.full(_AVERAGED, 1.0 / _AVERAGED), mode="same")


def _check_torques(log: Log, robot: Robot) -> None:
    """Refuse torques that are zero, or far above the limits: not recorded, or of other units."""
    tau = np.where(np.isfinite(log.tau), log.tau, np.nan)
    sizes, limits = np.sqrt(np.nanmean(tau**2, axis=0)), effort_limits(robot.model)
    if not sizes.all():
        name = robot.joint_names[int(np.argmin(sizes))]
        who = f"the torque of {name} is" if sizes.any() else "all torques are"
        raise LogError(
            f"{who} zero in all samples: not recorded.",
            where=f"{log.source}: tau",
            hint=f"Record the efforts of the motors; --lock {name} leaves out what did not move.",
        )
    if (sizes > _TOO_STRONG * limits).any():
        joint = int(np.argmax(sizes / limits))
        raise LogError(
            f"{robot.joint_names[joint]} gives {sizes[joint]:.4g} on average, and its limit is "
            f"{limits[joint]:g} N m or N. Are these other units?",
            where=f"{log.source}: tau",
            hint="Torques must be those of the joints, after the gears, in N m or N. --torque-gain "
            "multiplies them, with N m/A for currents.",
        )


def joined(logs: Sequence[Log], pause: float) -> Log:
    """Return logs of the same robot one after another, with a pause in between [s].

    Times of each count on from the one before. Velocities and positions of the frame are kept if
    all logs have them.

    Raises:
        LogError: torques that are held in one log and measured at their instants in another.
    """
    first, *others = logs
    if not others:
        return first
    if len({log.held for log in logs}) > 1:
        raise LogError(
            "torques are held in one of the logs, and measured at their instants in another.",
            where=", ".join(log.source for log in logs),
        )
    shifts = starts_of(logs, pause)
    parts: dict[str, Any] = {}
    for name in ("q", "tau", "v", "x"):
        arrays = [getattr(log, name) for log in logs]
        missing = any(array is None or array.shape[1] != arrays[0].shape[1] for array in arrays)
        parts[name] = None if missing else np.concatenate(arrays)
    parts["t"] = np.concatenate([log.t + shift for log, shift in zip(logs, shifts, strict=True)])
    parts["x_time"] = None
    if parts["x"] is not None:
        parts["x_time"] = np.concatenate(
            [log.frames_time + shift for log, shift in zip(logs, shifts, strict=True)]
        )
    source = ", ".join(log.source for log in logs)
    return replace(first, **parts, source=source)


def starts_of(logs: Sequence[Log], pause: float) -> list[float]:
    """Return what is added to the times of each log in ``joined`` [s]."""
    shifts = [0.0]
    for before, log in pairwise(logs):
        shifts.append(float(before.t[-1]) + shifts[-1] + pause - float(log.t[0]))
    return shifts
