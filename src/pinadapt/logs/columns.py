"""The signals t, q, v, tau and x of a log, found among named columns.

A column is called after a signal and a joint: ``q_elbow``, ``elbow.position``, ``tau[3]``, or for q
the joint alone. Joints are found by their names, or by their index from 0 or 1.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .._checks import name_list
from ..exceptions import LogError, did_you_mean
from .import_options import ImportOptions
from .log import NAMES, SIGNALS, Log, joint_order

_FRAMES = (("x", "y", "z", "qx", "qy", "qz", "qw"), ("x", "y", "z"))

Table = Mapping[str, np.ndarray]


def log_of_columns(table: Table, joints: Sequence[str], options: ImportOptions, source: str) -> Log:
    """Return the log in a table of columns (N) or arrays (N, n) by name.

    Without times they count the samples; torques that are missing are NaN.

    Args:
        table: of the file.
        joints: names of the joints to read.
        options: which columns they have.
        source: of the table, for messages.

    Raises:
        LogError: no positions, or a column that is stated does not exist.
    """
    own = _Columns(table, joints, options, source)
    found: dict[str, Any] = {name: own.of_joints(name) for name in SIGNALS}
    if found["q"] is None:
        raise LogError(
            f"no joint positions found among the columns {list(table)}.",
            where=source,
            hint="Usual names are q_JOINT, JOINT.position, q0. Others are stated: --columns "
            "q=NAME,..., in a file without header q=2-8; --joints A,B,... for other joints.",
        )
    t = own.single("t")
    known = joints if own.by_name else ()
    return Log(
        np.arange(len(found["q"])) if t is None else t,
        **found,
        joints=tuple(map(str, table.get("joint_names", known))),
        x=own.of_frame(),
        x_time=own.single("x_time"),
        source=source,
    )


@dataclass
class _Columns:
    """The columns of a file, by signal and joint.

    Attributes:
        table, joints, options, source: as of ``log_of_columns``.
        by_name: whether columns were found by names of joints, so that they are in their order.
    """

    table: Table
    joints: Sequence[str]
    options: ImportOptions
    source: str
    by_name: bool = False

    @cached_property
    def _known(self) -> dict[str, np.ndarray]:
        """The columns by their names in lower case, of several the first."""
        return {name.strip().lower(): self.table[name] for name in reversed(list(self.table))}

    def single(self, signal: str) -> np.ndarray | None:
        """Return a signal of one column (N), None where there is none."""
        found = self._whole(signal, 1)
        return None if found is None else found.reshape(-1)

    def of_frame(self) -> np.ndarray | None:
        """Return coordinates of the frame (N, m), None where there are none."""
        found = self._whole("x", 2)
        names = next((names for names in _FRAMES if set(names) <= set(self._known)), None)
        return self._stacked(names) if found is None and names is not None else found

    def of_joints(self, signal: str) -> np.ndarray | None:
        """Return a signal of the joints (N, n), None where there is none."""
        if (whole := self._whole(signal, 2)) is not None:
            return whole
        labels = self._labels(signal)
        joints = [name.lower() for name in self.joints]
        if signal == "q":  # a column may be called after its joint alone
            labels = {name: name for name in joints if name in self._known} | labels
        names = list(labels)
        try:
            order = joint_order(names, joints, self.source)
        except LogError:
            if set(joints) & set(names):
                raise
            return None
        self.by_name = set(joints) <= set(names)
        return self._stacked([labels[names[k]] for k in order])

    def _whole(self, signal: str, dimensions: int) -> np.ndarray | None:
        """Return the columns that the user named for a signal, or an array called after it."""
        if signal in self.options.columns:
            stated = name_list(self.options.columns[signal], "columns")
            return self._stacked(self._written_out(stated))
        arrays = (self._known[name] for name in NAMES[signal].split() if name in self._known)
        return next((one for one in arrays if one.ndim == dimensions), None)

    def _written_out(self, names: Sequence[str]) -> list[str]:
        """Return names of columns with the * and with ranges such as ``2-8`` written out."""
        if len(names) == 1 and "*" in names[0]:
            form = re.compile("(.+)".join(map(re.escape, names[0].split("*", 1))))
            labels = {match[1]: name for name in self.table if (match := form.fullmatch(name))}
            order = joint_order(list(labels), self.joints, self.source)
            return [list(labels.values())[k] for k in order]
        found: list[str] = []
        for name in names:
            ends = re.fullmatch(r"(\d+)-(\d+)", name)
            found += map(str, range(int(ends[1]), int(ends[2]) + 1)) if ends else [name]
        return found

    def _labels(self, signal: str) -> dict[str, str]:
        """Return label of a joint -> column, of all columns that are called after a signal."""
        words = "|".join(map(re.escape, sorted(NAMES[signal].split(), key=len, reverse=True)))
        form = re.compile(rf"(?:{words})(?:[_./\[ ](.+?)\]?|(\d+))|(.+)[_./ ](?:{words})")
        return {
            next(filter(None, match.groups())): key
            for key, column in reversed(self._known.items())
            if column.ndim == 1 and (match := form.fullmatch(key))
        }

    def _stacked(self, names: Sequence[str]) -> np.ndarray:
        """Return columns (N, n) by their names.

        Raises:
            LogError: there is none of a name.
        """
        known = {**self._known, **self.table}
        for name in names:
            if name not in known:
                raise LogError(
                    f"there is no column '{name}'; there are {list(self.table)}."
                    f"{did_you_mean(name, self.table)}",
                    where=self.source,
                )
        parts = [known[name] for name in names]
        return parts[0] if len(parts) == 1 and parts[0].ndim == 2 else np.column_stack(parts)
