"""Adaptations driven by a given gradient."""

import numpy as np

import pinadapt as pa


def along(g: np.ndarray) -> pa.adaptation.Drive:
    """Return the drive whose gradient is g (p): one row of error one."""
    return pa.adaptation.Drive(g[None], np.ones(1))


def rate_of(adaptation: pa.adaptation.Adaptation, a: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Return da/dt (p) of an estimate a (p) without memory under the gradient g (p)."""
    return adaptation.rate(pa.adaptation.Estimate(a), along(g)).value


def stepped(
    adaptation: pa.adaptation.Adaptation, a: np.ndarray, g: np.ndarray, dt: float
) -> np.ndarray:
    """Return the estimate (p) after dt [s] under the gradient g (p) held."""
    return adaptation.step(pa.adaptation.Estimate(a), along(g), dt).value
