"""The signals t, q, v, tau and x of a log, found among named columns.

A column is called after a signal and a joint: ``q_elbow``, ``elbow.position``, ``tau[3]``, or for q
the joint alone. Joints are found by their names, by their index from 0 or 1, or else by names that
are alike, see ``match_joints``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..exceptions import LogError, did_you_mean
from .log import Log, match_joints

# Usual names of each signal, the likeliest first; case is ignored.
NAMES = {
    "t": "t time timestamp stamp times time_s %time",
    "q": "q position pos joint_position joint_positions actual_q angle",
    "v": "v qd dq qdot velocity vel joint_velocity joint_velocities actual_qd",
    "tau": "tau effort torque eff tau_j joint_torque joint_torques joint_effort",
    "x": "x ee_position tool_position",
    "x_time": "x_time t_x camera_time",
}
SIDES = ("q", "v", "tau")  # signals of the joints
_FRAMES = ("x y z qx qy qz qw", "x y z", "px py pz", "x0 x1 x2", "x_0 x_1 x_2")

Table = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Selection:
    """Which joints to read from a file, and where it has them.

    Attributes:
        joints: names of the robot's joints.
        columns: signal -> names of its columns, or one with a ``*`` for each joint's name or index.
        rate: of samples without times, or with times that jitter [Hz]; None: they have times.
        topic: of the joint states in a bag; None: the only one.
        pose_topic: of the frame's pose in a bag; None: none.
        torques: whether they are needed; if not, they may be missing and are NaN then, and so may
            be the times, which count the samples then.
    """

    joints: Sequence[str]
    columns: Mapping[str, Sequence[str]] = field(default_factory=dict)
    rate: float | None = None
    topic: str | None = None
    pose_topic: str | None = None
    torques: bool = True


def log_of_columns(table: Table, selection: Selection, source: str) -> Log:
    """Return the log in a table of columns (N) or arrays (N, n) by name.

    Raises:
        LogError: a needed signal has no columns, or a name in ``selection.columns`` is unknown.
    """
    own = _Columns(table, selection, source)
    found: dict[str, Any] = {name: own.of_joints(name) for name in SIDES}
    q, tau = found["q"], found["tau"]
    if q is None:
        raise own.missing("q")
    t = np.arange(len(q)) / selection.rate if selection.rate is not None else own.single("t")
    if selection.torques and (t is None or tau is None):
        raise own.missing("t" if t is None else "tau")
    t = np.arange(float(len(q))) if t is None else t
    found["tau"] = np.full(q.shape, np.nan) if tau is None else tau
    stated = [table[name] for name in ("joint_names", "joints", "names") if name in table]
    joints = tuple(map(str, stated[0].ravel())) if stated and stated[0].dtype.kind in "US" else ()
    if not joints and own.by_name:
        joints = tuple(selection.joints)
    assumed = {"joints": own.matched} if own.matched else {}
    x, x_time = own.of_frame(), own.single("x_time")
    return Log(t, **found, joints=joints, x=x, x_time=x_time, source=source, assumed=assumed)


class _Columns:
    """The columns of a file, by signal and joint.

    Attributes:
        source: of the columns, for messages.
        matched: the log's names of the joints, in the order of the robot's, if they are others.
        by_name: whether columns were found by names of joints, so that they are in their order.
    """

    def __init__(self, table: Table, selection: Selection, source: str) -> None:
        self._table, self._selection, self.source = table, selection, source
        self._known = {name.strip().lower(): name for name in reversed(list(table))}
        self.matched, self.by_name = list[str](), False

    def single(self, signal: str) -> np.ndarray | None:
        """Return a signal of one column (N), None where there is none."""
        found = self._whole(signal, 1)
        return None if found is None else found.reshape(-1)

    def of_frame(self) -> np.ndarray | None:
        """Return coordinates of the frame (N, m), None where there are none."""
        found = self._whole("x", 2)
        names = next((one.split() for one in _FRAMES if set(one.split()) <= set(self._known)), None)
        return self._stacked(names) if found is None and names is not None else found

    def of_joints(self, signal: str) -> np.ndarray | None:
        """Return a signal of the joints (N, n), None where there is none."""
        if (whole := self._whole(signal, 2)) is not None:
            return whole
        labels, joints = self._labels(signal), [name.lower() for name in self._selection.joints]
        if signal == "q":  # a column may be called after its joint alone
            labels = {name: name for name in joints if name in self._known} | labels
        if set(joints) & set(labels) and not set(joints) <= set(labels):
            lacking = next(name for name in joints if name not in labels)
            raise LogError(
                f"no column has {signal} of joint '{lacking}', but other joints have one; the "
                f"columns are {list(self._table)}.",
                where=self.source,
                hint=f"--columns {signal}=NAME,NAME,... names them in the robot's order.",
            )
        names = list(labels)
        order = match_joints(names, joints, self.source)
        if order is None:
            column = self.single(signal) if len(joints) == 1 else None
            return None if column is None else column[:, None]
        names = [names[k] for k in order]
        self.by_name = not all(name.isdecimal() for name in names)
        self.matched = names if self.by_name and names != joints else self.matched
        return self._stacked([labels[name] for name in names])

    def missing(self, signal: str) -> LogError:
        """Return the error of a signal that has no columns."""
        what = {"t": "times", "q": "joint positions", "tau": "joint torques"}[signal]
        other = ", or --rate HZ if there are none" if signal == "t" else ""
        return LogError(
            f"no {what} found among the columns {list(self._table)}.",
            where=self.source,
            hint=f"Usual names are {', '.join(NAMES[signal].split()[:3])}. Others are stated: "
            f"--columns {signal}=NAME,..., in a file without header {signal}=2-8{other}.",
        )

    def _whole(self, signal: str, dimensions: int) -> np.ndarray | None:
        """Return the columns that the user named for a signal, or an array called after it."""
        stated = self._selection.columns.get(signal)
        if stated is not None:
            return self._stacked(self._written_out(stated), f"columns.{signal}")
        names = [self._known[name] for name in NAMES[signal].split() if name in self._known]
        arrays = (self._table[name] for name in names)
        return next((one for one in arrays if one.ndim == dimensions), None)

    def _written_out(self, names: Sequence[str]) -> list[str]:
        """Return names of columns with the * and with ranges such as ``2-8`` written out."""
        joints = self._selection.joints
        if len(names) == 1 and "*" in names[0]:
            labels = [joints, *([str(k + j) for j in range(len(joints))] for k in (0, 1))]
            filled = [[names[0].replace("*", label) for label in part] for part in labels]
            return next((part for part in filled if set(part) <= set(self._table)), filled[0])
        found: list[str] = []
        for name in names:
            ends = re.fullmatch(r"(\d+)-(\d+)", name)
            numbers = range(int(ends[1]), int(ends[2]) + 1) if ends else ()
            found += [str(k) for k in numbers] if ends else [name]
        return found

    def _labels(self, signal: str) -> dict[str, str]:
        """Return label of a joint -> column, of all columns that are called after a signal."""
        words = "|".join(map(re.escape, sorted(NAMES[signal].split(), key=len, reverse=True)))
        form = re.compile(rf"(?:{words})(?:[_./\[ ](.+?)\]?|(\d+))|(.+)[_./ ](?:{words})")
        found = {key: form.fullmatch(key) for key in reversed(self._known)}
        return {
            next(filter(None, match.groups())): key
            for key, match in found.items()
            if match is not None and self._table[self._known[key]].ndim == 1
        }

    def _stacked(self, names: Sequence[str], where: str = "") -> np.ndarray:
        """Return columns (N, n) by their names.

        Raises:
            LogError: there is none of a name.
        """
        known = {**self._known, **{name: name for name in self._table}}
        for name in names:
            if name not in known:
                raise LogError(
                    f"there is no column '{name}'; there are {list(self._table)}."
                    f"{did_you_mean(name, self._table)}",
                    where=f"{self.source}: {where}",
                )
        parts = [self._table[known[name]] for name in names]
        return parts[0] if len(parts) == 1 and parts[0].ndim == 2 else np.column_stack(parts)
