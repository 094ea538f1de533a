"""Neighbours in Pinocchio's memory as one array."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def live_array(views: Sequence[np.ndarray]) -> np.ndarray:
    """Return one live array (N, ...) over N views of one shape that lie at equal distances.

    Pinocchio keeps placements and motions of all joints in vectors, and gives out a view on each;
    a kernel takes them together. The array is valid as long as the model or data is.

    Raises:
        ValueError: the views lie elsewhere.
    """
    places = np.array([view.__array_interface__["data"][0] for view in views])
    first, distance = views[0], int(places[1] - places[0]) if len(views) > 1 else 0
    if (np.diff(places) != distance).any() or any(v.strides != first.strides for v in views):
        raise ValueError("these views are not neighbours in memory.")
    return np.lib.stride_tricks.as_strided(
        first, (len(views), *first.shape), (distance, *first.strides), writeable=False
    )
