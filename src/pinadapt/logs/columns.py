"""The signals t, q, v, tau and x of a log, found among named columns."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
    "t": ("t", "time", "timestamp", "stamp", "times", "time_s", "%time"),
    "q": ("q", "position", "pos", "joint_position", "joint_positions", "actual_q", "angle"),
    "v": (
        "v",
        "qd",
        "dq",
        "qdot",
        "velocity",
        "vel",
        "joint_velocity",
        "joint_velocities",
        "actual_qd",
    ),
    "tau": (
        "tau",
        "effort",
        "torque",
        "eff",
        "tau_j",
        "joint_torque",
        "joint_torques",
        "joint_effort",
    ),
    "x": ("x", "ee_position", "tool_position"),
    "x_time": ("x_time", "t_x", "camera_time"),
}
_FRAMES = (("x", "y", "z", "qx", "qy", "qz", "qw"), ("x", "y", "z"), ("px", "py", "pz"))
_SEPARATORS = ("", "_", ".", "/", "[", " ")
_GAP = 3.0  # typical intervals, beyond which nothing is interpolated
_SAME_MOTION = 0.8  # correlation of a velocity with the rate of the positions


def log_of_columns(table: Mapping[str, np.ndarray], selection: Selection, source: str) -> Log:
    """Return the log in a table of columns (N) or arrays (N, n) by name.

    Joints are found by their names (``q_elbow``, ``elbow.position``, for q also ``elbow`` alone) or
    by their index from 0 or 1 (``q0``, ``tau[3]``), else by names that are alike, see
    ``match_joints``. Columns of a file without header, called 1, 2 and so on, are taken in the
    order t, q, v, tau, with the velocities recognised as the rate of the positions. Signals of
    other files are interpolated at the times of the positions.

    Raises:
        LogError: a needed signal has no columns, or a name in ``selection.columns`` is unknown.
    """
    table, separate = dict(table), {}
    assumed: dict[str, Any] = {}
    for signal, (other, name) in selection.tables.items():
        separate[signal] = _SignalFinder(other, selection, name, only=signal)
    named = {column for names in selection.columns.values() for column in ranges(names) if names}
    if set(table) - named and all(name.isdecimal() for name in table) and not named:
        table, assumed["columns"] = _named_columns(table, selection, source)
    finder = _SignalFinder(table, selection, source)
    finder.headed = "columns" not in assumed
    q, tau, v = (
        separate.get(signal, finder).of_joints(signal, alone=signal in separate)
        for signal in ("q", "tau", "v")
    )
    if q is None:
        raise finder.missing("q")
    if tau is None:
        if selection.torques:
            raise separate.get("tau", finder).missing("tau")
        tau = np.full(q.shape, np.nan)
    t = separate.get("q", finder).times(len(q)) if "q" in separate else finder.times(len(q))
    if t is None:
        if selection.torques or not finder.headed:
            raise finder.missing("t")
        t = np.arange(float(len(q)))
    apart = {"tau", "v"} if "q" in separate else {"tau", "v"} & set(separate)
    homes = {signal: separate.get(signal, finder) for signal in apart}
    if "tau" in homes:
        tau = _of_file(t, tau, "tau", homes["tau"])
    if "v" in homes and v is not None:
        v = _of_file(t, v, "v", homes["v"])
    x, x_time = finder.of_frame(), finder.single("x_time")
    stated = tuple(selection.joints) if selection.named or finder.named else ()
    joints = _joints(table) or stated
    assumed |= {"joints": finder.matched} if finder.matched else {}
    return Log(t, q, tau, v, joints, x, x_time, source=source, assumed=assumed)


def _of_file(t: np.ndarray, values: np.ndarray, signal: str, home: _SignalFinder) -> np.ndarray:
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
    n, count = len(selection.joints), len(table)
    timed = bool((np.diff(table["1"]) > 0.0).all())
    first = 2 if timed else 1
    blocks, left = divmod(count + 1 - first, n)
    apart = [range(first + k * n, first + (k + 1) * n) for k in range(blocks)]
    within = [range(first + k, count + 1, blocks) for k in range(blocks)]
    t = table["1"] if timed else np.arange(len(table["1"])) / (selection.rate or 1.0)
    found = [
        (layout, a, b)
        for layout in (apart, within)
        for a, b in permutations(range(blocks), 2)
        if not left and _is_rate(_numbered(table, layout[a]), _numbered(table, layout[b]), t)
    ]
    without = [] if "tau" in selection.tables else ["tau"]
    usual = {1 + len(without): ["q", *without], 3: ["q", "v", "tau"]}
    parts, order = (apart, usual.get(blocks)) if not left else (apart, None)
    if found and order is not None:
        parts, a, b = found[0]
        order = ["tau"] * blocks
        order[a], order[b] = "q", "v"
    if order is None or (without and "tau" not in order):
        raise LogError(
            f"has no header, and {count} columns for {n} joints: their meaning is ambiguous.",
            where=source,
            hint="State the numbers of the columns: --columns t=1 q=2-8 tau=16-22, or begin the "
            "file with a line of names such as t,q0,q1,v0,v1,tau0,tau1.",
        )
    chosen = {"t": ["1"]} if timed else {}
    chosen |= {signal: _shortened(at) for signal, at in zip(order, parts, strict=True)}
    named = {"t": table["1"]} if timed else {}
    for signal, at in zip(order, parts, strict=True):
        named |= {f"{signal}{j}": table[str(k)] for j, k in enumerate(at)}
    words = ", ".join(f"{signal} {','.join(at)}" for signal, at in chosen.items())
    warnings.warn(
        f"{source} has no header; its columns were taken for {words}. --columns names others, such "
        "as q=2-8.",
        stacklevel=2,
    )
    return named, chosen


def _shortened(numbers: Sequence[int]) -> list[str]:
    """Return numbers of columns as text, neighbouring ones as a range such as 2-8."""
    first, last = numbers[0], numbers[-1]
    whole = len(numbers) > 1 and list(numbers) == list(range(first, last + 1))
    return [f"{first}-{last}"] if whole else [str(k) for k in numbers]


def _numbered(table: Mapping[str, np.ndarray], numbers: Iterable[int]) -> np.ndarray:
    """Return the columns (N, n) of a file without header that have some numbers."""
    return np.column_stack([table[str(k)] for k in numbers])


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


class _SignalFinder:
    """Finds signals among named columns; ``only`` is what a file of one signal has.

    Attributes:
        source: of the columns, for messages.
        matched: the log's names of the joints, in the order of the robot's, if they are others.
        named: whether columns were found by names of joints, so that they are in their order.
        headed: whether the file has a header.
    """

    def __init__(
        self,
        table: Mapping[str, np.ndarray],
        selection: Selection,
        source: str,
        only: str | None = None,
    ) -> None:
        self._table, self._selection, self.source = table, selection, source
        self._known = {name.strip().lower(): name for name in reversed(list(table))}
        self._only, self.matched, self.named, self.headed = only, list[str](), False, True
        for signal in selection.columns:
            if signal not in SIGNALS:
                raise LogError(
                    f"there is no signal '{signal}'; there are {list(SIGNALS)}."
                    f"{did_you_mean(signal, SIGNALS)}",
                    where="columns",
                )

    def times(self, count: int) -> np.ndarray | None:
        """Return the times (N) [s] of ``count`` samples, None where there are none."""
        if self._selection.rate is not None:
            return np.arange(count) / self._selection.rate
        t = self.single("t")
        first = next(iter(self._table.values()))
        if t is None and self._only and len(self._table) == len(self._selection.joints) + 1:
            return first if bool((np.diff(first) > 0.0).all()) else None
        return t

    def single(self, signal: str) -> np.ndarray | None:
        """Return a signal of one column (N), None where there is none."""
        named = self._named(signal)
        if named is not None and len(named) == 1:
            return named[0].reshape(-1)
        for name in _NAMES[signal]:
            if name in self._known:
                return self._table[self._known[name]].reshape(-1)
        return None

    def of_joints(self, signal: str, *, alone: bool = False) -> np.ndarray | None:
        """Return a signal of the joints (N, n), None where there is none.

        ``alone``: the table has nothing else but times.
        """
        named = self._named(signal)
        if named is not None:
            return _stacked(named)
        for name in _NAMES[signal]:
            array = self._table.get(self._known.get(name, ""))
            if array is not None and array.ndim == 2:
                return array
        joints, n = self._selection.joints, len(self._selection.joints)
        indices = () if self._selection.named else (_indices(n, first) for first in (0, 1))
        for labels in (joints, *indices):
            found = [self._of_joint(signal, label, labels is joints) for label in labels]
            if all(column is not None for column in found):
                self.named |= labels is joints
                after = str(int(labels[0]) + n) if labels is not joints else ""
                if after and signal == "q" and self._of_joint(signal, after, False) is not None:
                    warnings.warn(
                        f"{self.source} has positions of more than the robot's {n} joints: those "
                        f"of {list(joints)} are taken from {found[0]} to {found[-1]}. Is it the "
                        f"log of another robot? --columns {signal}=NAME,NAME,... names them.",
                        stacklevel=2,
                    )
                return _stacked([self._table[column] for column in found if column is not None])
            if any(column is not None for column in found) and labels is joints:
                lacking = labels[[column is None for column in found].index(True)]
                raise LogError(
                    f"no column has {signal} of joint '{lacking}', but other joints have one; the "
                    f"columns are {list(self._table)}.",
                    where=self.source,
                    hint=f"--columns {signal}=NAME,NAME,... names them in the robot's order.",
                )
        if len(joints) == 1 and (column := next(self._plain(signal), None)) is not None:
            return _stacked([self._table[column]])
        return self._of_other_names(signal) if not alone else self._all_of(signal)

    def _of_other_names(self, signal: str) -> np.ndarray | None:
        """Return a signal of joints with other names than the robot's, None where there is none."""
        if self._selection.named:
            return None
        labels: dict[str, str] = {}
        for key, column in reversed(self._known.items()):
            for name in sorted(_NAMES[signal], key=len, reverse=True):
                label = next(
                    (
                        key[len(name + mark) :]
                        for mark in _SEPARATORS[1:]
                        if key.startswith(name + mark)
                    ),
                    None,
                ) or next(
                    (
                        key[: -len(mark + name)]
                        for mark in _SEPARATORS[1:]
                        if key.endswith(mark + name)
                    ),
                    None,
                )
                if label and self._table[column].ndim == 1:
                    labels.setdefault(label.rstrip("]"), column)
                    break
        order = match_joints(list(labels), self._selection.joints, self.source)
        if order is None:
            return None
        self.matched, self.named = [list(labels)[k] for k in order], True
        return _stacked([self._table[labels[label]] for label in self.matched])

    def _all_of(self, signal: str) -> np.ndarray | None:
        """Return the signal of a file that has nothing else, perhaps with times before it."""
        joints, names = self._selection.joints, list(self._table)
        if all(name in self._known for name in map(str.lower, joints)):
            return _stacked([self._table[self._known[name.lower()]] for name in joints])
        timed = [name for name in names if name.strip().lower() in _NAMES["t"]]
        rest = [name for name in names if name not in timed]
        if not timed and len(rest) == len(joints) + 1:
            rest = rest[1:]
        if len(rest) == len(joints) and not all(name.isdecimal() for name in rest):
            order = match_joints(rest, joints, self.source)
            rest = [rest[k] for k in order] if order else rest
        if len(rest) != len(joints):
            return self._of_other_names(signal)
        return _stacked([self._table[name] for name in rest])

    def of_frame(self) -> np.ndarray | None:
        """Return coordinates of the frame (N, m), None where there are none."""
        named = self._named("x")
        if named is not None:
            return _stacked(named)
        for name in _NAMES["x"]:
            array = self._table.get(self._known.get(name, ""))
            if array is not None and array.ndim == 2:
                return array
        indexed = (tuple(f"x{mark}{i}" for i in range(3)) for mark in ("", "_"))
        for names in (*_FRAMES, *indexed):
            if all(name in self._known for name in names):
                return _stacked([self._table[self._known[name]] for name in names])
        return None

    def missing(self, signal: str) -> LogError:
        """Return the error of a signal that has no columns."""
        if signal == "t" and not self.headed:
            return LogError(
                "has neither a header nor a column of ascending times.",
                where=self.source,
                hint="--rate HZ states the rate, or --columns t=NUMBER the column of the times.",
            )
        what = {"t": "times", "q": "joint positions", "tau": "joint torques"}[signal]
        torque = (
            " Without torques no dynamic parameters can be estimated." if signal == "tau" else ""
        )
        return LogError(
            f"no {what} found among the columns {list(self._table)}.{torque}",
            where=self.source,
            hint=f"Usual names are {', '.join(_NAMES[signal][:3])}. Others are stated: --columns "
            f"{signal}=NAME"
            + (", or the rate if there are no times: --rate HZ." if signal == "t" else ",NAME,....")
            + (" In another file: --files tau=FILE." if signal == "tau" else ""),
        )

    def _named(self, signal: str) -> list[np.ndarray] | None:
        """Return the columns that the user named for a signal."""
        names = self._selection.columns.get(signal)
        if names is None:
            return None
        names = ranges(names)
        if len(names) == 1 and "*" in names[0]:
            names = self._of_pattern(names[0])
        for name in names:
            if name not in self._table:
                raise LogError(
                    f"there is no column '{name}'; there are {list(self._table)}."
                    f"{did_you_mean(name, self._table)}",
                    where=f"{self.source}: columns.{signal}",
                )
        return [self._table[name] for name in names]

    def _of_pattern(self, pattern: str) -> list[str]:
        """Return the columns that match a pattern, by the joints' names or by indices."""
        joints = self._selection.joints
        filled = [
            [pattern.replace("*", label) for label in labels]
            for labels in (joints, _indices(len(joints), 0), _indices(len(joints), 1))
        ]
        whole = (names for names in filled if all(name in self._table for name in names))
        return next(whole, filled[0])

    def _of_joint(self, signal: str, label: str, named: bool) -> str | None:
        """Return the column of a joint, by its name or index."""
        key = label.lower()
        forms = [form for name in _NAMES[signal] for form in _forms(name, key, named)]
        forms += [key] if named and signal == "q" else []
        return next((self._known[form] for form in forms if form in self._known), None)

    def _plain(self, signal: str) -> Iterator[str]:
        return (self._known[name] for name in _NAMES[signal] if name in self._known)


def _indices(count: int, first: int) -> list[str]:
    return [str(index) for index in range(first, first + count)]


def _forms(name: str, label: str, named: bool) -> Iterator[str]:
    """Yield possible names of a signal of a joint, such as ``q_elbow`` or ``elbow.q``."""
    for mark in _SEPARATORS:
        closing = "]" if mark == "[" else ""
        yield f"{name}{mark}{label}{closing}"
        if named and mark not in ("", "["):
            yield f"{label}{mark}{name}"


def _stacked(columns: Sequence[np.ndarray]) -> np.ndarray:
    """Return columns (N), or one array (N, n), as an array (N, n)."""
    if len(columns) == 1 and columns[0].ndim == 2:
        return columns[0]
    return np.column_stack(columns)
