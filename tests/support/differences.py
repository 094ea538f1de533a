"""Central differences, the one way the tests differentiate."""

from collections.abc import Callable

import numpy as np

# The five-point rule errs by h^4 f5 / 30, 1e-17 for functions of order one; rounding adds 1e-12.
STEP = 1e-4


def derivative(f: Callable[[float], np.ndarray], h: float = STEP) -> np.ndarray:
    """Return df/dt at 0 by the five-point rule."""
    return (8.0 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12.0 * h)


def sampled_derivative(f: np.ndarray, h: float) -> np.ndarray:
    """Return df/dt (N - 4) at all but the outer samples of f (N), every h, by the same rule."""
    return (8.0 * (f[3:-1] - f[1:-3]) - (f[4:] - f[:-4])) / (12.0 * h)
