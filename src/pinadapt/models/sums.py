"""The information of measured signals: sums of squares of the rows of W a = y, n rows at a time.

With the weight R, the sums [W y]^T R [W y] (p + 1, p + 1) add up over time. Their first p rows are
the normal equations A a = b, A the information matrix; with the last entry they give the squared
residual of any estimate, (a, -1)^T [W y]^T R [W y] (a, -1).
"""

from __future__ import annotations

import numpy as np


def sums_of(W: np.ndarray, y: np.ndarray, R: np.ndarray | float = 1.0) -> np.ndarray:
    """Return the sums (p + 1, p + 1) of rows W (n, p) and y (n).

    R is the weight, one number or (n, n). Data with the best value a and the information A have the
    rows W = 1, y = a with R = A.
    """
    rows = np.column_stack([W, y])
    return np.asarray(rows.T.dot(R).dot(rows))
