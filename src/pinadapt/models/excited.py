"""Which combinations of the dynamic parameters a motion excites, by the torques that it takes.

Let the parameters be off by da = L z, where |z| = 1 is as far as a description may be off: 30 % of
a body in the metric of natural adaptation, a typical coefficient of a joint. Along the motion the
torques change by Y da, in shares of each joint's own root mean square by A da. The right singular
vectors of A L are combinations of the parameters that change the torques independently of each
other, and their singular values the shares. A combination is identifiable in practice if its share
is above one per cent; what is below, the motion does not excite, and no adaptation moves it much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .bodies import UNCERTAINTY
from .dynamics import Dynamics
from .physical_fit import LEAST, around
from .regressor import LABELS

# share of the torques from which a combination is identifiable in practice; half, twice: 21 and 14
# of an arm's combinations are, in place of 17; the same runs
IDENTIFIABLE = 0.01


@dataclass(frozen=True, eq=False)
class TorqueErrors:
    """Errors of the torques that parameters predict at k instants of a motion of n joints.

    Attributes:
        Y: (k, n, p) regressors.
        residual: (k, n) tau - Y a - tau_0 at the parameters ``at`` [N m or N].
        tau: (k, n) torques [N m or N].
        at: (p) parameters.
    """

    Y: np.ndarray
    residual: np.ndarray
    tau: np.ndarray
    at: np.ndarray

    @property
    def size(self) -> float:
        """Root mean square of the torques, all joints together [N m or N]."""
        return rms(self.tau)

    def error(self, a: np.ndarray) -> float:
        """Return the root mean square error of the torques at a (p) [N m or N]."""
        return rms(self.residual - self.Y @ (a - self.at))

    def relative_error(self, a: np.ndarray) -> float:
        """Return the error at a (p) with each joint in shares of its own torque, rms of both."""
        return rms((self.residual - self.Y @ (a - self.at)) / self._levels)

    def excited(self, names: Sequence[str], root: np.ndarray) -> Excited:
        """Return what the motion excites of p parameters with the scales L (p, p)."""
        A = (self.Y / self._levels[:, None]).reshape(self.tau.size, len(names))
        return Excited(tuple(names), A.T @ A / max(self.tau.size, 1), root)

    @property
    def _levels(self) -> np.ndarray:
        """Root mean square (n) of each joint's torque, at least 1 % of the largest."""
        levels = rms(self.tau, 0)
        return np.maximum(levels, max(IDENTIFIABLE * levels.max(initial=0.0), 1e-12))


def rms(values: np.ndarray, axis: int | None = None) -> Any:
    """Return the root mean square of all numbers, or along an axis."""
    found = np.sqrt(np.mean(np.square(values), axis=axis))
    return float(found) if axis is None else found


class Excited:
    """What a motion excites of p dynamic parameters.

    Attributes:
        names: of the parameters (p).
        squares: (p, p) A^T A, da^T A^T A da the mean squared change of the torques in shares of
            their size.
        root: (p, p) L, as far as parameters may be off.
        effects: share (p) by which each independent combination may change the torques, descending.
        rank: number of combinations that are identifiable in practice.
        combinations: (r, p) the identifiable ones C: z = C da, |z| = 1 as far as one may be off.
        rows: A (p, p) up to a rotation: |A da| is the change of the torques, in shares of them.
        still: whether the motion does not excite a parameter (p). It then changes the torques by
            less than one per cent if it alone is as far off as it may be, whatever the others are.
        alone: whether the motion identifies a parameter (p) by itself, whatever the others are.
            More than three quarters of its variance are then in the identifiable combinations.
    """

    def __init__(self, names: tuple[str, ...], squares: np.ndarray, root: np.ndarray) -> None:
        """Take the names of the parameters, A^T A, and L."""
        self.names = names
        self.squares = squares
        self.root = root
        values, vectors = np.linalg.eigh(root.T @ squares @ root)
        self.effects = np.sqrt(np.maximum(values[::-1], 0.0))
        self._vectors = vectors = vectors[:, ::-1]
        self.rank = rank = int(np.count_nonzero(self.effects > IDENTIFIABLE))
        every = np.linalg.solve(root.T, vectors).T
        self.combinations = every[:rank]
        self.rows = self.effects[:, None] * every
        variances = np.sum(root**2, axis=1)
        rest = root @ vectors[:, rank:]
        self.still = variances * np.diag(squares) < IDENTIFIABLE**2
        self.alone = np.sum(rest**2, axis=1) < 0.25 * variances

    def distance(self, a: np.ndarray, truth: np.ndarray) -> float:
        """Return how far the identifiable combinations of a (p) are off: |C (a - truth)|."""
        return float(np.linalg.norm(self.combinations @ (a - truth)))


def scales(dynamics: Dynamics, a: np.ndarray) -> np.ndarray:
    """Return L (p, p), as far as the parameters of a model may be off around a (p).

    Bodies by 30 % in the metric of natural adaptation, coefficients of joints by a typical one,
    combinations by 30 % of their typical values.
    """
    typical = np.abs(dynamics.typical)
    size = dynamics.inertial.size
    typical = np.maximum(typical, LEAST * typical.max(initial=0.0) or 1.0)
    typical[:size] *= UNCERTAINTY
    L = np.diag(typical)
    if dynamics.per_body:
        bodies = around(dynamics, a)
        L[:size, :size] = UNCERTAINTY * bodies.local(bodies.center)[0][:size, :size]
    return L


def names_together(names: Sequence[str]) -> str:
    """Return names of parameters as words, owners with the same parameters together."""
    owned: dict[str, list[str]] = {}
    for name in names:
        owner, _, label = name.rpartition(".")
        owned.setdefault(owner, []).append(label)
    groups: dict[str, list[str]] = {}
    for owner, labels in owned.items():
        groups.setdefault("all" if tuple(labels) == LABELS else ", ".join(labels), []).append(owner)
    return "; ".join(
        f"{labels} of {', '.join(owners)}" if owners[0] else labels
        for labels, owners in groups.items()
    )
