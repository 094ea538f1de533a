"""How an estimate follows its drive: da/dt = -Gamma g in some metric."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from .._checks import instance


class Estimate(NamedTuple):
    """A parameter vector with whatever its adaptation remembers of the past; also their rates.

    Attributes:
        value: (p) the parameters, floats.
        memory: arrays, or tuples of such, that only its adaptation understands; often none.
    """

    value: np.ndarray
    memory: tuple = ()


class Drive:
    """The signal that moves an estimate, by its parts: da/dt = -Gamma (Y^T e + W^T R r).

    The tracking part Y^T e comes from an error of the closed loop, and tells of the parameters only
    as far as the motors gave the torque that was asked for. The prediction part W^T R r compares
    measurements alone, whatever the torque was.

    Attributes:
        Y: (k, p) regressor of the tracking error.
        e: (k) tracking error, in the coordinates of Y's rows; None where it is to be disregarded.
        W: (l, p) regressor of the prediction, or None for no prediction.
        residual: (l) predicted minus measured, r.
        weight: (l, l) R; None where it is left to the adaptation, see
            ``Adaptation.torque_bandwidth``.
        gradient: (p) g = Y^T e + W^T R r.
        observed: whether e is the error of an observer, which holds whatever the torque is; then
            Y^T e stays where the tracking error is dropped.
    """

    __slots__ = ("W", "Y", "e", "gradient", "observed", "residual", "weight")

    def __init__(
        self,
        Y: np.ndarray,
        e: np.ndarray | None,
        W: np.ndarray | None = None,
        residual: np.ndarray | None = None,
        weight: np.ndarray | None = None,
        gradient: np.ndarray | None = None,
        observed: bool = False,
    ) -> None:
        """Take the parts, and their gradient where it is known already."""
        self.Y, self.e, self.observed = Y, e, observed
        self.W, self.residual, self.weight = W, residual, weight
        self.gradient = self._product() if gradient is None else gradient

    def _product(self) -> np.ndarray:
        """Return Y^T e + W^T R r (p)."""
        if self.W is None or self.weight is None or self.residual is None:
            return np.zeros(self.Y.shape[1]) if self.e is None else self.e.dot(self.Y)
        prediction = self.weight.dot(self.residual).dot(self.W)
        return prediction if self.e is None else self.e.dot(self.Y) + prediction

    def without_tracking(self) -> Drive:
        """Return what holds whatever the torque is: the prediction and an observer's error."""
        if self.e is None or self.observed:
            return self
        return Drive(self.Y, None, self.W, self.residual, self.weight)

    def with_prediction_error(self, W: np.ndarray, residual: np.ndarray) -> Drive:
        """Return the drive with a prediction error, which its adaptation is to weigh."""
        return Drive(self.Y, self.e, W, residual, None, self.gradient)

    def weighted(self, weight: np.ndarray) -> Drive:
        """Return a drive that predicts with the weight R (l, l) in place of its own, if any."""
        assert self.W is not None and self.residual is not None
        change = weight if self.weight is None else weight - self.weight
        gradient = self.gradient + change.dot(self.residual).dot(self.W)
        return Drive(self.Y, self.e, self.W, self.residual, weight, gradient, self.observed)

    def scaled(self, tracking: float, prediction: float) -> Drive:
        """Return the drive with both parts multiplied by numbers, zero or more.

        Of the prediction W and r are multiplied by the root, so that r = W da stays, and with it
        what a gain matrix may learn of it.
        """
        e = None if self.e is None else tracking * self.e
        if self.W is None or self.residual is None:
            gradient = self.gradient if e is None else tracking * self.gradient
            return Drive(self.Y, e, gradient=gradient, observed=self.observed)
        root = math.sqrt(prediction)
        W, residual = root * self.W, root * self.residual
        return Drive(self.Y, e, W, residual, self.weight, observed=self.observed)

    def still(self) -> Drive:
        """Return a drive that moves nothing."""
        return Drive(self.Y, None, gradient=np.zeros(self.Y.shape[1]))

    def columns(self, block: slice) -> Drive:
        """Return the drive of a block of the parameters."""
        W = None if self.W is None else self.W[:, block]
        gradient = self.gradient[block]
        return Drive(
            self.Y[:, block], self.e, W, self.residual, self.weight, gradient, self.observed
        )

    @classmethod
    def none(cls, size: int) -> Drive:
        """Return a drive that moves none of ``size`` parameters."""
        return cls(np.zeros((0, size)), None, gradient=np.zeros(size))


@dataclass(slots=True, eq=False)
class Drives:
    """The drives of both estimates.

    Attributes:
        dynamic: of the dynamic parameters.
        kinematic: of the kinematic parameters; by default for none, as in joint space.
    """

    dynamic: Drive
    kinematic: Drive = field(default_factory=lambda: Drive.none(0))

    @classmethod
    def none(cls, p_d: int, p_k: int) -> Drives:
        """Return drives that move none of p_d dynamic and p_k kinematic parameters."""
        return cls(Drive.none(p_d), Drive.none(p_k))

    def without_tracking(self) -> Drives:
        """Return what of both holds whatever the torque is."""
        return Drives(self.dynamic.without_tracking(), self.kinematic.without_tracking())


class Adaptation(ABC):
    """The law da/dt = -Gamma(a) g of an estimate a (p), g (p) the gradient of its drive.

    Every control law here proves dV/dt <= 0 with any adaptation for which ``divergence`` D obeys
    dD/dt = (a - a_true)^T (-g): the metric is free. Laws and adaptations therefore combine freely.

    A subclass states ``rate`` and ``divergence``; the others have defaults. An adaptation that
    remembers something puts it into ``Estimate.memory``, starts it in ``init`` and gives its rate
    with the value's.

    Attributes:
        name: as written in scenarios.
        sources: keys of ``references.bib``, or BibTeX entries of your own; see ``citation``.
        updates_gain: whether Gamma is part of the memory, as the gain of least squares is.
        torque_bandwidth: bandwidth [1/s] of the low pass on torque and regressor whose prediction
            error the dynamic estimate learns from; its drives then hold that error without a
            weight. None where it learns from the law's drives alone.
    """

    name: str = "custom"
    sources: tuple[str, ...] = ()
    updates_gain: bool = False
    torque_bandwidth: float | None = None

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

    def reset_to(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
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

    def power(self, estimate: Estimate, change: np.ndarray, truth: np.ndarray) -> float:
        """Return what a change (p) of the value's rate adds to dV/dt: da^T Gamma^-1 change."""
        error = estimate.value - truth
        return float(error @ np.linalg.solve(self.metric(estimate), change))

    def references(self) -> tuple[str, ...]:
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
        self.updates_gain = inner.updates_gain
        self.name, self.torque_bandwidth = inner.name, inner.torque_bandwidth

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

    def reset_to(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return what the inner adaptation makes of an announced value (p)."""
        return self.inner.reset_to(estimate, value, start)

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

    def references(self) -> tuple[str, ...]:
        """Return the sources of this wrapper and of the inner adaptation."""
        return self.sources + self.inner.references()


def _moved(part: Any, rate: Any, dt: float) -> Any:
    """Return an array, or a tuple of such to any depth, moved at its rate for dt [s]."""
    if isinstance(part, tuple):
        return tuple(_moved(p, r, dt) for p, r in zip(part, rate, strict=True))
    return part + dt * rate


class Frozen(Adaptation):
    """da/dt = 0, the baseline against which learning is measured."""

    name = "none"

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return zero (p)."""
        return Estimate(np.zeros(estimate.value.size))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate."""
        return estimate

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float | None:
        """Return 0 for a right estimate, None for a wrong one, for which no V is claimed."""
        return 0.0 if np.allclose(value, truth, rtol=1e-12, atol=1e-12) else None
