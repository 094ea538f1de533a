"""Snapshots of nested records, to tell whether somebody has written to them."""

from typing import Any

import numpy as np

import pinadapt as pa


def leaves(record: Any) -> list[Any]:
    """Return what nested tuples and estimates hold, in order."""
    if isinstance(record, pa.adaptation.Estimate):
        record = (record.value, record.memory)
    if not isinstance(record, tuple):
        return [record]
    return [leaf for part in record for leaf in leaves(part)]


def snapshot(record: tuple) -> list[Any]:
    """Return deep copies of a record's arrays and numbers."""
    return [leaf if leaf is None else np.copy(leaf) for leaf in leaves(record)]


def guarded_alike(state: pa.ControllerState) -> pa.ControllerState:
    """Return a state without what its guards keep, to be compared with one that has none."""
    return state._replace(sensed=state.sensed._replace(first=None, monitor=None))


def unchanged(record: tuple, before: list[Any]) -> bool:
    """Return whether a record is still what its snapshot says, to the bit."""
    return all(
        old is new if old is None else np.asarray(new).tobytes() == old.tobytes()
        for new, old in zip(leaves(record), before, strict=True)
    )
