"""How an estimate follows its drive: da/dt = -Gamma g in some metric."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from .._checks import instance
from ..reference import Reference
from .drive import Drive, Estimate


class Adaptation(ABC):
    """The law da/dt = -Gamma(a) g of an estimate a (p), g (p) the gradient of its drive.

    Every control law here proves dV/dt <= 0 with any adaptation for which ``divergence`` D obeys
    dD/dt = (a - a_true)^T (-g): the metric is free. Laws and adaptations therefore combine freely.

    A subclass states ``rate`` and ``divergence``; the others have defaults. An adaptation that
    remembers something puts it into ``Estimate.memory``, starts it in ``init`` and gives its rate
    with the value's.

    Attributes:
        name: as written in scenarios.
        sources: where it was published.
        prediction: bandwidth [1/s] of the low pass through which the dynamic estimate wants torque
            and regressor, whose prediction error it then finds in its drives without a weight; None
            where it learns from nothing but what the law drives it with.
    """

    name: str = "custom"
    sources: tuple[Reference, ...] = ()
    prediction: float | None = None

    def init(self, value: np.ndarray) -> Estimate:
        """Return the estimate to start from, ``validate(value)`` with an empty memory."""
        return Estimate(np.asarray(self.validate(value), dtype=float))

    def validate(self, value: np.ndarray) -> np.ndarray:
        """Return the initial value (p): as given, or moved (with a warning) into the domain.

        Raises:
            ParameterError: a value that cannot be used.
        """
        return value

    def contains(self, value: np.ndarray) -> bool:
        """Tell whether a value (p) is in the domain, outside of which no estimate ever is."""
        return True

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) to use at q (nq): as given, or closer to every possible truth."""
        return estimate.value

    def told(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return the estimate at a value (p) that was announced, as if begun at ``start`` (p)."""
        return estimate._replace(value=value)

    @abstractmethod
    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the time derivatives of the value (p) and of the memory."""

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after a sampling period dt [s] with the drive held: by Euler."""
        rate = self.rate(estimate, drive)
        return Estimate(*(_moved(part, r, dt) for part, r in zip(estimate, rate, strict=True)))

    @abstractmethod
    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float | None:
        """Return this adaptation's part of V (p), (p), or None where it is undefined."""

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the part of V of an estimate with its memory; None where it is undefined."""
        return self.divergence(estimate.value, truth)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return what the adaptation adds to the law's dV/dt: zero for the tracking error alone."""
        return 0.0

    def references(self) -> tuple[Reference, ...]:
        """Return the sources of this adaptation and of those inside it."""
        return self.sources

    def gain(self, value: np.ndarray) -> np.ndarray:
        """Return Gamma (p, p) at a value (p) with an empty memory."""
        start = Estimate(value)
        drives = [Drive(g[None], None, gradient=g) for g in np.eye(value.size)]
        columns = [-self.rate(start, drive).value for drive in drives]
        return np.column_stack(columns) if columns else np.zeros((0, 0))

    def gain_times(self, value: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l) at a value (p) with an empty memory, X (p, l)."""
        return self.gain(value).dot(X)

    def metric(self, estimate: Estimate) -> np.ndarray:
        """Return Gamma (p, p) at an estimate with its memory; V's metric is its inverse."""
        return self.gain(estimate.value)


class Wrapper(Adaptation):
    """An adaptation that modifies another one; what it does not override is the inner one's.

    Attributes:
        inner: the adaptation that it wraps.
    """

    def __init__(self, inner: Adaptation) -> None:
        """Take the adaptation to wrap, any."""
        self.inner = instance(inner, Adaptation, "inner")
        self.name, self.prediction = inner.name, inner.prediction

    def init(self, value: np.ndarray) -> Estimate:
        """Return the inner adaptation's start, with the value that this one validates."""
        return self.inner.init(value)._replace(value=self.validate(value))

    def validate(self, value: np.ndarray) -> np.ndarray:
        """Return the initial value (p) as the inner adaptation has it."""
        return self.inner.validate(value)

    def contains(self, value: np.ndarray) -> bool:
        """Tell whether a value (p) is in the inner adaptation's domain."""
        return self.inner.contains(value)

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) that the inner adaptation uses at q (nq)."""
        return self.inner.project(estimate, q)

    def told(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return what the inner adaptation makes of an announced value (p)."""
        return self.inner.told(estimate, value, start)

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner adaptation's rates."""
        return self.inner.rate(estimate, drive)

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the inner adaptation's estimate after dt [s]."""
        return self.inner.step(estimate, drive, dt)

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float | None:
        """Return the inner adaptation's part of V."""
        return self.inner.divergence(value, truth)

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the inner adaptation's part of V."""
        return self.inner.storage(estimate, truth)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return what the inner adaptation adds to dV/dt."""
        return self.inner.dissipation(estimate, drive, truth)

    def gain(self, value: np.ndarray) -> np.ndarray:
        """Return the inner adaptation's Gamma (p, p)."""
        return self.inner.gain(value)

    def gain_times(self, value: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return the inner adaptation's Gamma X (p, l)."""
        return self.inner.gain_times(value, X)

    def metric(self, estimate: Estimate) -> np.ndarray:
        """Return the inner adaptation's Gamma (p, p) at an estimate with its memory."""
        return self.inner.metric(estimate)

    def references(self) -> tuple[Reference, ...]:
        """Return the sources of this wrapper and of the inner adaptation."""
        return self.sources + self.inner.references()


def _moved(part: Any, rate: Any, dt: float) -> Any:
    """Return an array, or a tuple of such to any depth, moved at its rate for dt [s]."""
    if isinstance(part, tuple):
        return tuple(_moved(p, r, dt) for p, r in zip(part, rate, strict=True))
    return part + dt * rate
