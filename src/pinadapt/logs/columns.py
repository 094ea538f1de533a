"""The signals t, q, v, tau and x of a log, found among named columns.

A column is called after a signal and a joint: ``q_elbow``, ``elbow.position``, ``tau[3]``, or for q
the joint alone. Joints are found by their names, by their index from 0 or 1, or else by names that
are alike, see ``match_joints``.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

import numpy as np

from ..exceptions import LogError, did_you_mean
from .log import Log, match_joints

SIGNALS = ("t", "q", "v", "tau", "x", "x_time")


@dataclass(frozen=True)
class Selection:
    """Which joints to read from a file, and where it has them.

    Attributes:
        joints: names of the robot's joints.
        columns: signal -> names of its columns, or one with a ``*`` for each joint's name or index.
        tables: signal -> columns of another file that has it, and that file's name.
        rate: of samples without times, or with times that jitter [Hz]; None: they have times.
        topics: signal -> its topic in a bag; without q the only one that fits.
        pose_topic: of the frame's pose in a bag; None: none.
        named: whether ``joints`` are stated names of the log's, and nothing else is looked for.
        torques: whether they are needed; if not, they may be missing and are NaN then, and so may
            be the times, which count the samples then.
    """

    joints: Sequence[str]
    columns: Mapping[str, Sequence[str]] = field(default_factory=dict)
    tables: Mapping[str, tuple[Mapping[str, np.ndarray], str]] = field(default_factory=dict)
    rate: float | None = None
    topics: Mapping[str, str] = field(default_factory=dict)
    pose_topic: str | None = None
    named: bool = False
    torques: bool = True


# Usual names of each signal, the likeliest first; case is ignored.
_NAMES = {
    "t": "t time timestamp stamp times time_s %time",
    "q": "q position pos joint_position joint_positions actual_q angle",
    "v": "v qd dq qdot velocity vel joint_velocity joint_velocities actual_qd",
    "tau": "tau effort torque eff tau_j joint_torque joint_torques joint_effort",
    "x": "x ee_position tool_position",
    "x_time": "x_time t_x camera_time",
}
_FRAMES = ("x y z qx qy qz qw", "x y z", "px py pz", "x0 x1 x2", "x_0 x_1 x_2")
_GAP = 3.0  # typical intervals, beyond which nothing is interpolated; 1.5 loses jittering samples
_SAME_MOTION = (
    0.8  # correlation of a velocity with the rate of the positions; others have below 0.5
)


def log_of_columns(table: Mapping[str, np.ndarray], selection: Selection, source: str) -> Log:
    """Return the log in a table of columns (N) or arrays (N, n) by name.

    Columns of a file without header, called 1, 2 and so on, are taken in the order t, q, v, tau,
    with the velocities recognised as the rate of the positions. Signals of other files are
    interpolated at the times of the positions.

    Raises:
        LogError: a needed signal has no columns, or a name in ``selection.columns`` is unknown.
    """
    table, assumed = dict(table), dict[str, Any]()
    for signal in selection.columns:
        if signal not in SIGNALS:
            guess = did_you_mean(signal, SIGNALS)
            what = f"there is no signal '{signal}'; there are {list(SIGNALS)}.{guess}"
            raise LogError(what, where="columns")
    if all(name.isdecimal() for name in table) and not selection.columns:
        table, assumed["columns"] = _named_columns(table, selection, source)
    own = _Columns(table, selection, source)
    homes = {
        signal: _Columns(dict(other), selection, name, only=signal)
        for signal, (other, name) in selection.tables.items()
    }
    places = {signal: homes.get(signal, own) for signal in ("q", "v", "tau")}
    parts = {signal: place.of_joints(signal) for signal, place in places.items()}
    q, v, tau = parts["q"], parts["v"], parts["tau"]
    if q is None:
        raise places["q"].missing("q")
    if tau is None:
        if selection.torques:
            raise places["tau"].missing("tau")
        tau = np.full(q.shape, np.nan)
    t = places["q"].times(len(q))
    if t is None:
        if selection.torques:
            raise own.missing("t")
        t = np.arange(float(len(q)))
    if places["tau"] is not places["q"]:
        tau = _of_file(t, tau, "tau", places["tau"])
    if v is not None and places["v"] is not places["q"]:
        v = _of_file(t, v, "v", places["v"])
    joints = _joints(table) or (tuple(selection.joints) if own.by_name or selection.named else ())
    assumed |= {"joints": own.matched} if own.matched else {}
    x, x_time = own.of_frame(), own.single("x_time")
    return Log(t, q, tau, v, joints, x, x_time, source=source, assumed=assumed)


def _of_file(t: np.ndarray, values: np.ndarray, signal: str, home: _Columns) -> np.ndarray:
    """Return values (M, n) of another file at times (N) [s]; NaN where it has none."""
    own, where = home.times(len(values)), f"{home.source}: {signal}"
    if own is not None:
        return at_times(t, values, own, where)
    if len(values) != len(t):
        raise LogError(
            f"{len(values)} rows without times, and the positions have {len(t)}.",
            where=where,
            hint="Files without times must have the same number of rows.",
        )
    return values


def at_times(t: np.ndarray, values: np.ndarray, own: np.ndarray, where: str) -> np.ndarray:
    """Return values (M, n) with times of their own (M) [s] at other times t (N).

    They are interpolated linearly between two that are at most three of their typical intervals
    apart (the median). Elsewhere they are NaN; a warning says how many.

    Args:
        t: (N) times of the positions [s].
        values: (M, n) of another signal.
        own: (M) their times [s], ascending.
        where: file or topic, for messages.

    Raises:
        LogError: the two have no time in common.
    """
    if len(own) == len(t) and np.allclose(own, t, rtol=0.0, atol=1e-9):
        return values
    if (np.diff(own) < 0.0).any():
        raise LogError("its times must ascend.", where=where)
    if len(own) < 2 or own[-1] < t[0] or own[0] > t[-1]:
        raise LogError(
            f"its times, {own[0]:.6g} to {own[-1]:.6g} s, are not those of the positions, "
            f"{t[0]:.6g} to {t[-1]:.6g} s.",
            where=where,
            hint="Record all signals by the same clock.",
        )
    found = np.column_stack([np.interp(t, own, column, np.nan, np.nan) for column in values.T])
    after = np.searchsorted(own, t).clip(1, len(own) - 1)
    longest = _GAP * float(np.median(np.diff(own)))
    far = (own[after] - own[after - 1] > longest) & (own[after] != t)
    found[far] = np.nan
    if lost := np.count_nonzero(far | (t < own[0]) | (t > own[-1])):
        warnings.warn(
            f"{where}: interpolated at the times of the positions. {lost} of {len(t)} samples have "
            f"no value: none were recorded around them within {1e3 * longest:.3g} ms.",
            stacklevel=2,
        )
    return found


def ranges(names: Sequence[str]) -> list[str]:
    """Return names with ranges of numbers, such as ``2-8``, written out."""
    found: list[str] = []
    for name in names:
        first, dash, last = name.partition("-")
        if dash and first.isdecimal() and last.isdecimal():
            found += [str(k) for k in range(int(first), int(last) + 1)]
        else:
            found.append(name)
    return found


def _named_columns(
    table: Mapping[str, np.ndarray], selection: Selection, source: str
) -> tuple[dict[str, np.ndarray], dict[str, list[str]]]:
    """Return the columns of a file without header by signal and index, and which these were.

    Raises:
        LogError: they are not a multiple of the joints, or their meaning is ambiguous.
    """
    n, columns = len(selection.joints), list(table.values())
    timed = bool((np.diff(columns[0]) > 0.0).all())
    blocks, left = divmod(len(columns) - timed, n)
    t = columns[0] if timed else np.arange(len(columns[0])) / (selection.rate or 1.0)
    parts = [np.column_stack(columns[timed + k * n : timed + (k + 1) * n]) for k in range(blocks)]
    torque = [] if "tau" in selection.tables else ["tau"]
    order = {1 + len(torque): ["q", *torque], 3: ["q", "v", "tau"]}.get(blocks)
    pairs = permutations(range(blocks), 2)
    rates = [(a, b) for a, b in pairs if _is_rate(parts[a], parts[b], t)]
    if rates and order is not None:
        order = ["tau"] * blocks
        order[rates[0][0]], order[rates[0][1]] = "q", "v"
    if order is None or left or (torque and "tau" not in order):
        raise LogError(
            f"has no header, and {len(columns)} columns for {n} joints: their meaning is "
            "ambiguous.",
            where=source,
            hint="State the numbers of the columns: --columns t=1 q=2-8 tau=16-22, or begin the "
            "file with a line of names such as t,q0,q1,v0,v1,tau0,tau1.",
        )
    named, chosen = ({"t": t}, {"t": ["1"]}) if timed else ({}, {})
    for k, (signal, part) in enumerate(zip(order, parts, strict=True)):
        named |= {f"{signal}{j}": column for j, column in enumerate(part.T)}
        first = 1 + timed + k * n
        chosen[signal] = [f"{first}-{first + n - 1}" if n > 1 else str(first)]
    words = ", ".join(f"{signal} {at[0]}" for signal, at in chosen.items())
    warnings.warn(
        f"{source} has no header; its columns were taken for {words}. --columns names others, such "
        "as q=2-8.",
        stacklevel=2,
    )
    return named, chosen


def _is_rate(q: np.ndarray, v: np.ndarray, t: np.ndarray) -> bool:
    """Return whether v (N, n) is the rate of q (N, n) at times t (N), in any unit of time."""
    moved, mean = np.diff(q, axis=0), 0.5 * (v[1:] + v[:-1]) * np.diff(t)[:, None]
    moved, mean = (np.nan_to_num(part) for part in (moved, mean))
    sizes = np.linalg.norm(moved) * np.linalg.norm(mean)
    return bool(sizes > 0.0 and np.sum(moved * mean) / sizes > _SAME_MOTION)


def _joints(table: Mapping[str, np.ndarray]) -> tuple[str, ...]:
    """Return the names of the joints that an archive states, or none."""
    for name in ("joint_names", "joints", "names"):
        if name in table and table[name].dtype.kind in "US":
            return tuple(str(joint) for joint in table[name].ravel())
    return ()


class _Columns:
    """The columns of a file, by signal and joint; ``only`` is what a file of one signal has.

    Attributes:
        source: of the columns, for messages.
        matched: the log's names of the joints, in the order of the robot's, if they are others.
        by_name: whether columns were found by names of joints, so that they are in their order.
    """

    def __init__(
        self,
        table: Mapping[str, np.ndarray],
        selection: Selection,
        source: str,
        only: str | None = None,
    ) -> None:
        self._table, self._selection, self.source, self._only = table, selection, source, only
        self._known = {name.strip().lower(): name for name in reversed(list(table))}
        self.matched, self.by_name = list[str](), False

    def times(self, count: int) -> np.ndarray | None:
        """Return the times (N) [s] of ``count`` samples, None where there are none."""
        if self._selection.rate is not None:
            return np.arange(count) / self._selection.rate
        first = next(iter(self._table.values()))
        more = self._only and len(self._table) == len(self._selection.joints) + 1
        if (t := self.single("t")) is None and more and bool((np.diff(first) > 0.0).all()):
            return first
        return t

    def single(self, signal: str) -> np.ndarray | None:
        """Return a signal of one column (N), None where there is none."""
        if (named := self._stated(signal)) is not None:
            return named.reshape(-1)
        found = next((name for name in _NAMES[signal].split() if name in self._known), None)
        return None if found is None else self._table[self._known[found]].reshape(-1)

    def of_joints(self, signal: str) -> np.ndarray | None:
        """Return a signal of the joints (N, n), None where there is none."""
        if (named := self._stated(signal)) is not None or (
            named := self._array(signal)
        ) is not None:
            return named
        labels, joints = self._labels(signal), [name.lower() for name in self._selection.joints]
        if signal in ("q", self._only):  # a column may be called after its joint alone
            labels = {name: name for name in joints if name in self._known} | labels
        if set(joints) <= set(labels):
            self.by_name = True
            return self._stacked([labels[name] for name in joints])
        if set(joints) & set(labels):
            lacking = next(name for name in joints if name not in labels)
            raise LogError(
                f"no column has {signal} of joint '{lacking}', but other joints have one; the "
                f"columns are {list(self._table)}.",
                where=self.source,
                hint=f"--columns {signal}=NAME,NAME,... names them in the robot's order.",
            )
        for first in (0, 1) if not self._selection.named else ():
            indices = [str(first + j) for j in range(len(joints))]
            if set(indices) <= set(labels):
                if str(first + len(joints)) in labels and signal == "q":
                    warnings.warn(
                        f"{self.source} has positions of more than the robot's {len(joints)} "
                        f"joints: those of {joints} are taken from {labels[indices[0]]} to "
                        f"{labels[indices[-1]]}. Is it the log of another robot? --columns "
                        f"{signal}=NAME,NAME,... names them.",
                        stacklevel=2,
                    )
                return self._stacked([labels[index] for index in indices])
        if len(joints) == 1 and (column := self.single(signal)) is not None:
            return column[:, None]
        return None if self._selection.named else self._of_other_names(signal, labels)

    def _of_other_names(self, signal: str, labels: Mapping[str, str]) -> np.ndarray | None:
        """Return a signal of joints with other names, or of a file that has nothing else."""
        joints = self._selection.joints
        order = match_joints(list(labels), joints, self.source)
        if order is not None:
            self.matched, self.by_name = [list(labels)[k] for k in order], True
            return self._stacked([labels[name] for name in self.matched])
        if signal != self._only:
            return None
        names = [name for key, name in self._known.items() if key not in _NAMES["t"].split()][::-1]
        names = names[len(names) == len(joints) + 1 :]
        if len(names) != len(joints):
            return None
        unnamed = all(name.isdecimal() for name in names)
        order = None if unnamed else match_joints(names, joints, self.source)
        return self._stacked([names[k] for k in order] if order else names)

    def of_frame(self) -> np.ndarray | None:
        """Return coordinates of the frame (N, m), None where there are none."""
        if (named := self._stated("x")) is not None or (named := self._array("x")) is not None:
            return named
        found = (names.split() for names in _FRAMES if set(names.split()) <= set(self._known))
        names = next(found, None)
        return None if names is None else self._stacked(names)

    def missing(self, signal: str) -> LogError:
        """Return the error of a signal that has no columns."""
        what = {"t": "times", "q": "joint positions", "tau": "joint torques"}[signal]
        hint = f"Usual names are {', '.join(_NAMES[signal].split()[:3])}. Others are stated: "
        hint += f"--columns {signal}=NAME"
        ends = {
            "t": ", or the rate if there are no times: --rate HZ.",
            "q": ",NAME,....",
            "tau": ",NAME,.... In another file: --files tau=FILE.",
        }
        return LogError(
            f"no {what} found among the columns {list(self._table)}.",
            where=self.source,
            hint=hint + ends[signal],
        )

    def _array(self, signal: str) -> np.ndarray | None:
        """Return an array (N, n) that is called after a signal."""
        found = (self._table.get(self._known.get(name, "")) for name in _NAMES[signal].split())
        return next((one for one in found if one is not None and one.ndim == 2), None)

    def _labels(self, signal: str) -> dict[str, str]:
        """Return label of a joint -> column, of all columns that are called after a signal."""
        words = "|".join(map(re.escape, sorted(_NAMES[signal].split(), key=len, reverse=True)))
        form = re.compile(rf"(?:{words})(?:[_./\[ ](.+?)\]?|(\d+))|(.+)[_./ ](?:{words})")
        found = {key: form.fullmatch(key) for key in reversed(self._known)}
        return {
            next(filter(None, match.groups())): key
            for key, match in found.items()
            if match is not None and self._table[self._known[key]].ndim == 1
        }

    def _stated(self, signal: str) -> np.ndarray | None:
        """Return the columns that the user named for a signal, by the * for names or indices."""
        names = self._selection.columns.get(signal)
        if names is None:
            return None
        names, joints = ranges(names), self._selection.joints
        if len(names) == 1 and "*" in names[0]:
            labels = [joints, *([str(k + j) for j in range(len(joints))] for k in (0, 1))]
            filled = [[names[0].replace("*", label) for label in part] for part in labels]
            names = next((part for part in filled if set(part) <= set(self._table)), filled[0])
        for name in names:
            if name not in self._table:
                raise LogError(
                    f"there is no column '{name}'; there are {list(self._table)}."
                    f"{did_you_mean(name, self._table)}",
                    where=f"{self.source}: columns.{signal}",
                )
        parts = [self._table[name] for name in names]
        return parts[0] if len(parts) == 1 and parts[0].ndim == 2 else np.column_stack(parts)

    def _stacked(self, names: Sequence[str]) -> np.ndarray:
        """Return columns (N, n) by their names."""
        known = {**self._known, **{name: name for name in self._table}}
        return np.column_stack([self._table[known[name]] for name in names])
