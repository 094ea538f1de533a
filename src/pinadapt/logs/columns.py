"""The signals t, q, v, tau and x of a log, found among named columns."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..exceptions import LogError, did_you_mean
from .log import Log

SIGNALS = ("t", "q", "v", "tau", "x", "x_time")


@dataclass(frozen=True)
class Selection:
    """Which joints to read from a file, and where it has them.

    Attributes:
        joints: names of the robot's joints.
        columns: signal -> names of its columns, or one with a ``*`` for each joint's name or index.
        topic: of the joint states of a bag; None: the only one there is.
        pose_topic: of the frame's pose in a bag; None: none.
    """

    joints: Sequence[str]
    columns: Mapping[str, Sequence[str]] = field(default_factory=dict)
    topic: str | None = None
    pose_topic: str | None = None


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


def log_of_columns(table: Mapping[str, np.ndarray], selection: Selection, source: str) -> Log:
    """Return the log in a table of columns (N) or arrays (N, n) by name.

    Joints are found by their names (``q_elbow``, ``elbow.position``, for q also ``elbow`` alone) or
    by their index from 0 or 1 (``q0``, ``tau[3]``).

    Raises:
        LogError: a needed signal has no columns, or a name in ``selection.columns`` is unknown.
    """
    finder = _SignalFinder(table, selection, source)
    t, q, tau = finder.single("t"), finder.of_joints("q"), finder.of_joints("tau")
    v, x = finder.of_joints("v"), finder.of_frame()
    for signal, found in (("t", t), ("q", q), ("tau", tau)):
        if found is None:
            raise finder.missing(signal)
    x_time = finder.single("x_time")
    return Log(t, q, tau, v, _joints(table), x, x_time, source=source)  # type: ignore[arg-type]


def _joints(table: Mapping[str, np.ndarray]) -> tuple[str, ...]:
    """Return the names of the joints that an archive states, or none."""
    for name in ("joint_names", "joints", "names"):
        if name in table and table[name].dtype.kind in "US":
            return tuple(str(joint) for joint in table[name].ravel())
    return ()


class _SignalFinder:
    """Finds signals among named columns."""

    def __init__(self, table: Mapping[str, np.ndarray], selection: Selection, source: str) -> None:
        self._table, self._selection, self._source = table, selection, source
        self._known = {name.strip().lower(): name for name in reversed(list(table))}
        for signal in selection.columns:
            if signal not in SIGNALS:
                raise LogError(
                    f"there is no signal '{signal}'; there are {list(SIGNALS)}."
                    f"{did_you_mean(signal, SIGNALS)}",
                    where="columns",
                )

    def single(self, signal: str) -> np.ndarray | None:
        """Return a signal of one column (N), None where there is none."""
        named = self._named(signal)
        if named is not None and len(named) == 1:
            return named[0].reshape(-1)
        for name in _NAMES[signal]:
            if name in self._known:
                return self._table[self._known[name]].reshape(-1)
        return None

    def of_joints(self, signal: str) -> np.ndarray | None:
        """Return a signal of the joints (N, n), None where there is none."""
        named = self._named(signal)
        if named is not None:
            return _stacked(named)
        for name in _NAMES[signal]:
            array = self._table.get(self._known.get(name, ""))
            if array is not None and array.ndim == 2:
                return array
        joints, n = self._selection.joints, len(self._selection.joints)
        for labels in (joints, *(_indices(n, first) for first in (0, 1))):
            found = [self._of_joint(signal, label, labels is joints) for label in labels]
            if all(column is not None for column in found):
                after = str(int(labels[0]) + n) if labels is not joints else ""
                if after and signal == "q" and self._of_joint(signal, after, False) is not None:
                    warnings.warn(
                        f"{self._source} has positions of more than the robot's {n} joints: those "
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
                    where=self._source,
                    hint=f"--columns {signal}=NAME,NAME,... names them in the robot's order.",
                )
        if len(joints) == 1 and (column := next(self._plain(signal), None)) is not None:
            return _stacked([self._table[column]])
        return None

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
        what = {"t": "times", "q": "joint positions", "tau": "joint torques"}[signal]
        torque = (
            " Without torques no dynamic parameters can be estimated." if signal == "tau" else ""
        )
        return LogError(
            f"no {what} found among the columns {list(self._table)}.{torque}",
            where=self._source,
            hint=f"Name them like {_NAMES[signal][0]}, {', '.join(_NAMES[signal][1:3])}, or name "
            f"them: --columns {signal}=NAME"
            f"{'' if signal == 't' else ',NAME,...'}.",
        )

    def _named(self, signal: str) -> list[np.ndarray] | None:
        """Return the columns that the user named for a signal."""
        names = self._selection.columns.get(signal)
        if names is None:
            return None
        if len(names) == 1 and "*" in names[0]:
            names = self._of_pattern(names[0])
        for name in names:
            if name not in self._table:
                raise LogError(
                    f"there is no column '{name}'; there are {list(self._table)}."
                    f"{did_you_mean(name, self._table)}",
                    where=f"{self._source}: columns.{signal}",
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
