"""How exciting a motion was: what it could tell apart, and how well each estimate is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from .._table import Sheet, Table
from ..controller.controller import Controller
from ..controller.state import ControllerState, Sample
from ..models.dynamics import Dynamics
from .smoothing import measured_motion


@dataclass(frozen=True, eq=False, repr=False)
class Excitation:
    """What the data of a run tell of all parameters; ``print`` shows a table.

    Attributes:
        dynamic: of torque and motion about the dynamic parameters.
        kinematic: of measured positions about the kinematic parameters.
        units: name of a parameter -> its unit.
    """

    dynamic: Information
    kinematic: Information
    units: Mapping[str, str]

    def __repr__(self) -> str:
        """Return spectrum and rank of both, and each estimate with what it is known to."""
        return str(self._sheet())

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def _sheet(self) -> Sheet:
        parts = {"kinematic": self.kinematic, "dynamic": self.dynamic}
        words = [
            row
            for name, part in parts.items()
            if part.names
            for row in (
                (f"{name} parameters", f"{part.rank} combinations of {len(part.names)} told apart"),
                (f"{name} conditioning", _conditioning(part)),
            )
        ]
        tables = [Table(words or [("nothing", "was adapted")])]
        for part in parts.values():
            if part.names:
                tables.append(
                    Table(self._rows(part), ("parameter", "estimate", "known to", "unit"))
                )
        return Sheet("Excitation", tables)

    def _rows(self, part: Information) -> list[tuple[str, ...]]:
        return [
            (name, f"{value:.4g}", known_to(deviation), self.units.get(name, ""))
            for name, value, deviation in zip(
                part.names, part.estimate, part.deviations, strict=True
            )
        ]


def known_to(deviation: float) -> str:
    """Return an uncertainty in words: a number, or that there is none."""
    return f"+- {deviation:.2g}" if np.isfinite(deviation) else "not told apart"


def _conditioning(part: Information) -> str:
    """Return the largest over the smallest excited eigenvalue of the scaled information."""
    if not part.rank:
        return "nothing was excited"
    return f"{part.spectrum[0] / part.spectrum[part.rank - 1]:.2g}, of {part.rows} rows"


BLOCK = 0.05  # [s] over which rows of the torque are averaged, so that they are independent
_OPEN = 1e-10  # share of the largest eigenvalue below which a direction was not excited
_APART = 1e-3  # share of a direction that may lie among those not excited
_SILENT = 1e-8  # share of the largest size below which a parameter does not show
_FLOOR = 1e-9  # least noise, as a share of what is measured


@dataclass(frozen=True, eq=False)
class Information:
    """N rows about p parameters, at an estimate of them.

    Attributes:
        names: of the parameters (p).
        estimate: (p) at which the residuals were taken.
        H: (p, p) information matrix, in units of one over those of the parameters, twice.
        pull: (p) W^T S^-1 r of the residuals r = y - W a: zero where the estimate is the best.
        noise: (n) standard deviation of what no parameters explain, one a measured signal.
        rows: N.
    """

    names: tuple[str, ...]
    estimate: np.ndarray
    H: np.ndarray
    pull: np.ndarray
    noise: np.ndarray
    rows: int

    @cached_property
    def scale(self) -> np.ndarray:
        """Size (p) by which each parameter shows, the largest one's where it does not."""
        sizes = np.sqrt(np.diag(self.H))
        largest = sizes.max(initial=0.0) or 1.0
        return np.where(sizes > _SILENT * largest, sizes, largest)

    @cached_property
    def _eigen(self) -> tuple[np.ndarray, np.ndarray]:
        values, vectors = np.linalg.eigh(self.H / np.outer(self.scale, self.scale))
        return values[::-1], vectors[:, ::-1]

    @property
    def spectrum(self) -> np.ndarray:
        """Eigenvalues (p) of H scaled to a unit diagonal, descending: all one is the best."""
        return self._eigen[0]

    @property
    def rank(self) -> int:
        """How many combinations of the parameters the motion could tell apart."""
        values = self.spectrum
        return int(np.count_nonzero(values > _OPEN * values.max(initial=0.0)))

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance (p, p) of the best estimate, in the directions that were excited."""
        values, vectors = self._eigen
        kept = vectors[:, : self.rank]
        scaled = (kept / values[: self.rank]) @ kept.T
        return np.asarray(scaled / np.outer(self.scale, self.scale))

    @cached_property
    def correction(self) -> np.ndarray:
        """What the data would still have the estimate (p) move by, without what they leave open."""
        return self.covariance @ self.pull

    def refined(self) -> Information:
        """Return the information at the least-squares estimate from all rows."""
        best, still = self.estimate + self.correction, np.zeros_like(self.pull)
        return Information(self.names, best, self.H, still, self.noise, self.rows)

    def deviation(self, gradient: np.ndarray) -> np.ndarray:
        """Return how uncertain quantities are whose gradients are the rows of a matrix (k, p).

        The root of the variance and of the square of what the data would still have it move by;
        infinite where the quantity moves along what was not excited.
        """
        kept, scaled = self._eigen[1][:, : self.rank], gradient / self.scale
        outside = np.linalg.norm(scaled - scaled @ kept @ kept.T, axis=1)
        variance = np.einsum("ki,ij,kj->k", gradient, self.covariance, gradient)
        total = np.sqrt(np.maximum(variance, 0.0) + (gradient @ self.correction) ** 2)
        return np.where(outside <= _APART * np.linalg.norm(scaled, axis=1), total, np.inf)

    @cached_property
    def deviations(self) -> np.ndarray:
        """How uncertain each parameter of the estimate is (p); infinite where it is left open."""
        return self.deviation(np.eye(len(self.names)))


def torque_information(
    controller: Controller, samples: Sequence[Sample], state: ControllerState
) -> Information:
    """Return what measured motion and torque tell of the dynamic parameters at a state."""
    return information_of(
        controller.dynamics, controller.kinematics.robot.model, samples, state.a_d
    )


def information_of(
    dynamics: Dynamics, model: pin.Model, samples: Sequence[Sample], a_d: np.ndarray
) -> Information:
    """Return what measured motion and torque of a chain tell of parameters, at a_d (p).

    Torques of a joint whose dry friction is unknown are left out while it may reverse unseen: the
    jitter that noise makes it do then decides what friction is, which would bias all parameters.
    """
    dynamics.load(a_d)
    nv = model.nv
    q, v, a, tau, period, smooth = measured_motion(model, samples)
    reverses = dynamics.joints if smooth else None
    size = max(1, round(BLOCK / period)) if period else 1
    blocks = len(q) // size if dynamics.size else 0
    W, r = np.zeros((blocks, nv, dynamics.size)), np.zeros((blocks, nv))
    kept = np.ones((blocks, nv), dtype=bool)
    for k in range(blocks * size):
        W[k // size] += dynamics.regressor(q[k], v[k], a[k]) / size
        r[k // size] += (tau[k] - dynamics.torque(q[k], v[k], a[k])) / size
        if reverses is not None:
            kept[k // size] &= reverses.sliding(v[k])
    level = np.abs(tau).mean(axis=0) if blocks else np.zeros(nv)
    return _information(dynamics.names, a_d, W * kept[:, :, None], r * kept, level, kept)


def position_information(
    controller: Controller, samples: Sequence[Sample], state: ControllerState
) -> Information:
    """Return what measured positions tell of the kinematic parameters at a state."""
    kinematics, m = controller.kinematics, controller.kinematics.positions
    times = np.array([sample.t for sample in samples])
    W, r, last = [], [], None
    for k, sample in enumerate(samples if kinematics.size else ()):
        t, q, v, x, seen, *_ = sample.measurement
        if x is None or (seen is not None and seen == last):
            continue
        last = seen
        if seen is not None and seen < t:
            k = max(int(np.searchsorted(times, seen, side="right")) - 1, 0)
            share = (seen - times[k]) / (times[k + 1] - times[k])
            now, then = samples[k].measurement, samples[k + 1].measurement
            q = kinematics.between(now.q, then.q, float(np.clip(share, 0.0, 1.0)))
        kinematics.update(state.a_k, q, v)
        believed, X_k = kinematics.prediction()
        W.append(X_k)
        r.append(np.asarray(x)[:m] - believed)
    shape = len(W), m
    return _information(
        kinematics.names,
        state.a_k,
        np.array(W).reshape(*shape, kinematics.size),
        np.array(r).reshape(shape),
        np.full(m, controller.kinematics.robot.reach),
    )


def _information(
    names: tuple[str, ...],
    a: np.ndarray,
    W: np.ndarray,
    r: np.ndarray,
    level: np.ndarray,
    kept: np.ndarray | None = None,
) -> Information:
    """Return the information of rows W (N, n, p) with residuals r (N, n), zero but where ``kept``.

    The noise of each signal is what the best parameters leave, found twice: once with signals that
    count by their ``level`` (n), once with their noise.
    """
    there = np.full(r.shape[1], len(r)) if kept is None else kept.sum(axis=0)
    count, floor = int(there.sum()), _FLOOR * np.maximum(level, np.finfo(float).tiny)
    noise = np.maximum(level, np.finfo(float).tiny)
    found = _weighted(names, a, W, r, noise)
    for _ in range(2 if count else 0):
        left = r - W @ found.correction
        degrees = max(1.0 - found.rank / count, 1.0 / count)
        size = np.sum(left**2, axis=0) / np.maximum(there, 1)
        noise = np.where(there > 0, np.maximum(np.sqrt(size / degrees), floor), noise)
        found = _weighted(names, a, W, r, noise)
    return replace(found, rows=count)


def _weighted(
    names: tuple[str, ...], a: np.ndarray, W: np.ndarray, r: np.ndarray, noise: np.ndarray
) -> Information:
    rows = (W / noise[:, None]).reshape(W.shape[0] * W.shape[1], len(names))
    return Information(
        tuple(names), a, rows.T @ rows, rows.T @ (r / noise).ravel(), noise, len(rows)
    )
