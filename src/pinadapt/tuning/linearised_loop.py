"""How fast the adaptation answers the error: modes of the linearised loop over a typical motion.

With e the error that drives the adaptation and Phi the matrix by which parameter errors act on it,
de/dt = ... + Phi da and d(da)/dt = -Gamma Phi^T e: without damping an oscillator of frequencies
sqrt(eig(Phi Gamma Phi^T)).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..adaptation.adaptation import Adaptation


def frequency(effects: Sequence[np.ndarray], Gamma: np.ndarray) -> float:
    """Return the median over the states of sqrt of the largest eigenvalue of Phi Gamma Phi^T."""
    largest = [np.linalg.eigvalsh(Phi @ Gamma @ Phi.T)[-1] for Phi in effects if len(Phi)]
    return float(np.sqrt(max(np.median(largest), 0.0))) if largest else 0.0


def rate_for(
    mode: float, effects: Sequence[np.ndarray], unit: Adaptation, value: np.ndarray
) -> float:
    """Return the rate gamma at which the ``frequency`` is ``mode`` [rad/s].

    Args:
        mode: the wanted frequency [rad/s].
        effects: Phi (., p) at each state.
        unit: the adaptation at rate one.
        value: (p) the estimate at which to look.
    """
    natural = frequency(effects, unit.gain(value))
    return (mode / natural) ** 2 if natural > 0.0 else 1.0
