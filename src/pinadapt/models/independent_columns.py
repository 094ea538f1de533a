"""Which columns of a matrix do not depend on those before them."""

from __future__ import annotations

import numpy as np

_NEGLIGIBLE = 1e-8  # share of a column that counts as rounding; true shares lie far above


def independent_columns(
    W: np.ndarray, largest: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns (b) of W (N, p) that do not depend on those before them, and R (b, p).

    W = W[:, chosen] R. Columns count by their directions, so that units do not matter; those that
    are zero but for the rounding of sizes ``largest`` (p), by default the largest column's, are no
    columns.
    """
    sizes = np.linalg.norm(W, axis=0)
    floor = _NEGLIGIBLE * (sizes.max(initial=0.0) if largest is None else largest)
    Q, chosen = np.zeros((len(W), 0)), []
    for j in np.flatnonzero(sizes > floor):
        left = W[:, j] / sizes[j]
        for _ in range(2):  # twice is enough
            left = left - Q @ (Q.T @ left)
        length = np.linalg.norm(left)
        if length > _NEGLIGIBLE:
            Q = np.column_stack([Q, left / length])
            chosen.append(int(j))
    units = W / np.where(sizes > floor, sizes, 1.0) * (sizes > floor)
    R = np.linalg.lstsq(units[:, chosen], units, rcond=None)[0]
    R[np.abs(R) < _NEGLIGIBLE] = 0.0
    R *= sizes / sizes[chosen][:, None]
    R[:, chosen] = np.eye(len(chosen))
    return np.array(chosen, dtype=int), R
