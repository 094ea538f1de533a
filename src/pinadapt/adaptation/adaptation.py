"""What an adaptation is: an estimate a moves by da/dt = -Gamma g, g the gradient of its drive."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy import empty

from .._checks import instance, whole
from ..exceptions import InputError


@dataclass(slots=True, eq=False)
class Estimate:
    """A parameter vector with the internal state of its adaptation; or the rates of both.

    States share estimates, so they are never changed; see ``with_value``.

    Attributes:
        value: (p) the parameters, floats.
        memory: internal state of the adaptation, arrays or tuples of arrays; empty for most.
    """

    value: np.ndarray
    memory: tuple = ()

    def with_value(self, value: np.ndarray) -> Estimate:
        """Return an estimate with another value (p) and this memory."""
        return Estimate(value, self.memory)


class Drive:
    """The signal that drives an adaptation: g = Y^T e + W^T R r in da/dt = -Gamma g.

    The tracking part Y^T e comes from an error of the closed loop. It contains information about
    the parameters only if the motors apply the commanded torque. The prediction part W^T R r
    compares measurements, and is valid for any torque.

    Attributes:
        Y: (k, p) regressor of the tracking error.
        e: (k) tracking error, in the coordinates of Y's rows; None: no tracking part.
        W: (l, p) regressor of the prediction error; None: no prediction part.
        residual: (l) prediction error r, predicted minus measured.
        weight: (l, l) R; None: chosen by the adaptation, see ``Adaptation.torque_bandwidth``.
        gradient: (p) g.
        observed: whether e is the error of an observer, which is valid for any torque; then
            ``without_tracking`` keeps it.
        saturated: whether a motor was at its limit; an obstacle may then hold the robot.
    """

    __slots__ = ("W", "Y", "e", "gradient", "observed", "residual", "saturated", "weight")
    _optional = ("e", "W", "residual", "weight")  # parts that may be None

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
        """Combine the parts; ``gradient`` is computed unless given."""
        self.Y, self.e, self.observed, self.saturated = Y, e, observed, False
        self.W, self.residual, self.weight = W, residual, weight
        if gradient is None:
            gradient = np.zeros(Y.shape[1]) if e is None else e.dot(Y)
            if W is not None and weight is not None and residual is not None:
                gradient = gradient + weight.dot(residual).dot(W)
        self.gradient = gradient

    def without_tracking(self) -> Drive:
        """Return the parts that are valid for any torque: prediction and observer error."""
        if self.observed:
            return self
        left = Drive(self.Y, None, self.W, self.residual, self.weight)
        left.saturated = True
        return left

    def with_prediction_error(self, W: np.ndarray, residual: np.ndarray) -> Drive:
        """Return the drive with a prediction error W (l, p), r (l), weighted by the adaptation."""
        return Drive(self.Y, self.e, W, residual, None, self.gradient)

    def weighted(self, weight: np.ndarray) -> Drive:
        """Return the drive with the weight R (l, l) of the prediction error."""
        assert self.W is not None and self.residual is not None
        change = weight if self.weight is None else weight - self.weight
        gradient = self.gradient + change.dot(self.residual).dot(self.W)
        return Drive(self.Y, self.e, self.W, self.residual, weight, gradient, self.observed)

    def scaled(self, tracking: float, prediction: float) -> Drive:
        """Return the drive with its two parts multiplied by numbers >= 0.

        In the prediction part W and r are both multiplied by the square root: r = W da still holds,
        and least squares weights the information accordingly.
        """
        e = None if self.e is None else tracking * self.e
        if self.W is None or self.residual is None:
            gradient = self.gradient if e is None else tracking * self.gradient
            return Drive(self.Y, e, gradient=gradient, observed=self.observed)
        root = math.sqrt(prediction)
        W, residual = root * self.W, root * self.residual
        return Drive(self.Y, e, W, residual, self.weight, observed=self.observed)

    def still(self) -> Drive:
        """Return a drive of zero for the same parameters."""
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
        """Return a drive of zero for ``size`` parameters."""
        return cls(np.zeros((0, size)), None, gradient=np.zeros(size))


@dataclass(slots=True, eq=False)
class Drives:
    """The drives of the two estimates.

    Attributes:
        dynamic: of the dynamic parameters.
        kinematic: of the kinematic parameters; by default of none, as in joint space.
    """

    dynamic: Drive
    kinematic: Drive = field(default_factory=lambda: Drive.none(0))

    @classmethod
    def none(cls, p_d: int, p_k: int) -> Drives:
        """Return drives of zero for p_d dynamic and p_k kinematic parameters."""
        return cls(Drive.none(p_d), Drive.none(p_k))

    def without_tracking(self) -> Drives:
        """Return the parts of both that are valid for any torque."""
        return Drives(self.dynamic.without_tracking(), self.kinematic.without_tracking())


class Adaptation(ABC):
    """The adaptation law da/dt = -Gamma(a) g of an estimate a (p), g (p) the gradient of its drive.

    The proof dV/dt <= 0 of every control law here holds for any adaptation whose ``divergence`` D
    satisfies dD/dt = -(a - a_true)^T g, whatever its metric. So any law works with any adaptation.

    A subclass implements ``rate`` and ``divergence``; the other methods have defaults. Internal
    state belongs in ``Estimate.memory``: ``init`` starts it, and ``rate`` returns its rate together
    with the value's.

    Attributes:
        name: as written in scenarios.
        sources: keys of ``references.bib``, or BibTeX entries of your own; see ``citation``.
        updates_gain: whether Gamma is part of the memory, as the gain of least squares is.
        torque_bandwidth: bandwidth [1/s] of the low pass on torque and regressor. If set, drives of
            the dynamic estimate contain the prediction error of the filtered torque, without a
            weight. None: they contain only what the control law provides.
    """

    name: str = "custom"
    sources: tuple[str, ...] = ()
    updates_gain: bool = False
    torque_bandwidth: float | None = None
    _size: int | None = None

    def init(self, value: np.ndarray) -> Estimate:
        """Return the estimate to start from, ``validate(value)`` with an empty memory."""
        return Estimate(np.asarray(self.validate(value), dtype=float))

    def validate(self, value: np.ndarray) -> np.ndarray:
        """Return the initial value (p), moved into the domain with a warning if necessary.

        Raises:
            ParameterError: the value cannot be used.
        """
        return value

    def contains(self, value: np.ndarray) -> bool:
        """Return whether a value (p) is in the domain, which no estimate ever leaves."""
        return True

    @property
    def projects(self) -> bool:
        """Whether ``project`` may return another value than the estimate's."""
        return type(self).project is not Adaptation.project

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) to use at q (nq), projected where the adaptation requires it.

        A projection must reduce the distance to every admissible truth, so that V decreases.
        """
        return estimate.value

    def reset_to(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return the estimate at an announced value (p).

        Args:
            estimate: before the announcement.
            value: (p) the announced value.
            start: (p) the new initial value, for adaptations that refer to it.
        """
        return estimate.with_value(value)

    def informed(self, estimate: Estimate, H: np.ndarray) -> Estimate:
        """Return the estimate with a memory of other data, whose best value is the estimate's.

        Adaptations without a memory of data return the estimate itself.

        Args:
            estimate: at the start.
            H: (p, p) information matrix of the other data, the inverse covariance where it has full
                rank.
        """
        return estimate

    def recorded(self, estimate: Estimate) -> Estimate:
        """Return the estimate for a record, with the memory for ``storage`` and ``project``."""
        return estimate

    @abstractmethod
    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the time derivatives of the value (p) and of the memory."""

    def value_rate(self, estimate: Estimate, drive: Drive) -> np.ndarray:
        """Return the value (p) of ``rate``, for laws whose reference contains da/dt."""
        return self.rate(estimate, drive).value

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held, here by an Euler step."""
        rate = self.rate(estimate, drive)
        return Estimate(estimate.value + dt * rate.value, _moved(estimate.memory, rate.memory, dt))

    @abstractmethod
    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float | None:
        """Return the adaptation's part of V at a value (p); None where it is undefined."""

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the adaptation's part of V at an estimate; None where it is undefined."""
        return self.divergence(estimate.value, truth)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return what the adaptation adds to the law's dV/dt, zero without a prediction error."""
        return 0.0

    def power(self, estimate: Estimate, change: np.ndarray, truth: np.ndarray) -> float:
        """Return what a change (p) of the rate of the value adds to dV/dt, da^T Gamma^-1 change."""
        error = estimate.value - truth
        return float(error @ np.linalg.solve(self.metric(estimate), change))

    def references(self) -> tuple[str, ...]:
        """Return the sources of this adaptation and of those that it wraps."""
        return self.sources

    def gain(self, value: np.ndarray) -> np.ndarray:
        """Return Gamma (p, p) at a value (p) with an empty memory."""
        start = Estimate(value)
        drives = [Drive(g[None], None, gradient=g) for g in np.eye(value.size)]
        columns = [-self.rate(start, drive).value for drive in drives]
        return np.column_stack(columns) if columns else np.zeros((0, 0))

    def gain_times(self, value: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l), a new array, at a value (p) with an empty memory, X (p, l)."""
        return self.gain(value).dot(X)

    def metric(self, estimate: Estimate) -> np.ndarray:
        """Return Gamma (p, p) at an estimate with its memory; its inverse is the metric of V."""
        return self.gain(estimate.value)


class Frozen(Adaptation):
    """da/dt = 0: no adaptation, the baseline for comparisons."""

    name = "none"

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return zero (p)."""
        return Estimate(np.zeros(estimate.value.size))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate."""
        return estimate

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float | None:
        """Return 0 for the true value; None otherwise, since no V is defined."""
        return 0.0 if np.allclose(value, truth, rtol=1e-12, atol=1e-12) else None


class Wrapper(Adaptation):
    """An adaptation that modifies another one. Methods that it does not override are the inner's.

    The memory is this one's parts, see ``_own``, and then the inner adaptation's.

    Attributes:
        inner: the wrapped adaptation.
    """

    _parts = 0

    def __init__(self, inner: Adaptation) -> None:
        """Wrap any adaptation."""
        self.inner = instance(inner, Adaptation, "inner")
        self.updates_gain = inner.updates_gain
        self.name, self.torque_bandwidth = inner.name, inner.torque_bandwidth
        self._size = inner._size

    def _own(self, start: np.ndarray) -> tuple:
        """Return this wrapper's parts of the memory, ``_parts``, for an initial value (p)."""
        return ()

    def _inner(self, estimate: Estimate) -> Estimate:
        """Return the estimate with the inner adaptation's own memory."""
        return Estimate(estimate.value, estimate.memory[self._parts :])

    def init(self, value: np.ndarray) -> Estimate:
        """Return the inner adaptation's start, with the value validated by this one."""
        inner = self.inner.init(self.validate(value))
        return _after(self._own(inner.value), inner)

    def validate(self, value: np.ndarray) -> np.ndarray:
        """Return the initial value (p) validated by the inner adaptation."""
        return self.inner.validate(value)

    def contains(self, value: np.ndarray) -> bool:
        """Return whether a value (p) is in the inner adaptation's domain."""
        return self.inner.contains(value)

    @property
    def projects(self) -> bool:
        """Whether this adaptation or the inner one projects."""
        return type(self).project is not Wrapper.project or self.inner.projects

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) that the inner adaptation uses at q (nq)."""
        return self.inner.project(self._inner(estimate), q)

    def reset_to(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return the inner adaptation's estimate at an announced value (p)."""
        return _after(self._own(start), self.inner.reset_to(self._inner(estimate), value, start))

    def informed(self, estimate: Estimate, H: np.ndarray) -> Estimate:
        """Return the estimate with the inner adaptation's memory of other data."""
        return _after(estimate.memory[: self._parts], self.inner.informed(self._inner(estimate), H))

    def recorded(self, estimate: Estimate) -> Estimate:
        """Return what a record keeps: this one's parts and those of the inner adaptation."""
        return _after(estimate.memory[: self._parts], self.inner.recorded(self._inner(estimate)))

    def _driven(self, estimate: Estimate, drive: Drive) -> Drive:
        """Return the drive of the inner adaptation."""
        return drive

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner adaptation's rates."""
        return self.inner.rate(estimate, self._driven(estimate, drive))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the inner adaptation's estimate after dt [s]."""
        return self.inner.step(estimate, self._driven(estimate, drive), dt)

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float | None:
        """Return the inner adaptation's part of V."""
        return self.inner.divergence(value, truth)

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the inner adaptation's part of V."""
        return self.inner.storage(self._inner(estimate), truth)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return what the inner adaptation adds to dV/dt, and da^T (g - g'), g' of its drive."""
        driven = self._driven(estimate, drive)
        removed = (estimate.value - truth) @ (drive.gradient - driven.gradient)
        return float(removed) + self.inner.dissipation(estimate, driven, truth)

    def gain(self, value: np.ndarray) -> np.ndarray:
        """Return the inner adaptation's Gamma (p, p)."""
        return self.inner.gain(value)

    def gain_times(self, value: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return the inner adaptation's Gamma X (p, l)."""
        return self.inner.gain_times(value, X)

    def metric(self, estimate: Estimate) -> np.ndarray:
        """Return the inner adaptation's Gamma (p, p) at an estimate with its memory."""
        return self.inner.metric(self._inner(estimate))

    def references(self) -> tuple[str, ...]:
        """Return the sources of this wrapper and of the inner adaptation."""
        return self.sources + self.inner.references()


def _after(own: tuple, inner: Estimate) -> Estimate:
    """Return an inner adaptation's estimate with a wrapper's own parts before its memory."""
    return Estimate(inner.value, (*own, *inner.memory))


def _moved(part: Any, rate: Any, dt: float) -> Any:
    """Return part + dt * rate, for arrays or nested tuples of arrays."""
    if isinstance(part, tuple):
        return tuple(_moved(p, r, dt) for p, r in zip(part, rate, strict=True))
    return part + dt * rate


class Stacked(Adaptation):
    """Adaptations of consecutive blocks of one estimate; its part of V is the sum of theirs.

    Attributes:
        parts: the adaptations, in the order of their blocks.
    """

    _size: int

    def __init__(self, parts: Sequence[tuple[Adaptation, int]]) -> None:
        """Stack pairs of an adaptation and the size of its block; the first gives the name.

        Raises:
            InputError: no pair, or something that is not a pair of adaptation and size.
        """
        for given in instance(parts, Sequence, "parts"):
            part, size = given if isinstance(given, tuple) and len(given) == 2 else (given, 0)
            instance(part, Adaptation, "parts")
            whole(size, "parts", 0)
        if not parts:
            raise InputError("expected at least one adaptation.", where="parts")
        ends = np.cumsum([0] + [size for _, size in parts])
        self.parts = [
            (part, slice(int(a), int(b)))
            for (part, _), (a, b) in zip(parts, pairwise(ends), strict=True)
        ]
        self._size, self.name = int(ends[-1]), parts[0][0].name
        self._forgetful = ((),) * len(parts)
        self.torque_bandwidth = next(
            (p.torque_bandwidth for p, _ in self.parts if p.torque_bandwidth), None
        )
        self.updates_gain = any(part.updates_gain for part, _ in self.parts)

    @property
    def projects(self) -> bool:
        """Whether a block's adaptation may move its value."""
        return any(part.projects for part, _ in self.parts)

    def init(self, value: np.ndarray) -> Estimate:
        """Return the estimate to start from; its memory holds one memory a block."""
        return self._joined(part.init(value[block]) for part, block in self.parts)

    def validate(self, value: np.ndarray) -> np.ndarray:
        """Return the initial value (p), each block validated by its adaptation."""
        return np.concatenate([part.validate(value[block]) for part, block in self.parts])

    def contains(self, value: np.ndarray) -> bool:
        """Return whether each block of a value (p) is in the domain of its adaptation."""
        return all(part.contains(value[block]) for part, block in self.parts)

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) to use at q (nq), each block projected by its adaptation."""
        value = estimate.value
        split = list(self._split(estimate))
        blocks = [part.project(own, q) for part, _, own in split]
        same = (kept is own.value for kept, (_, _, own) in zip(blocks, split, strict=True))
        return value if all(same) else np.concatenate(blocks)

    def reset_to(self, estimate: Estimate, value: np.ndarray, start: np.ndarray) -> Estimate:
        """Return the estimate with each block reset by its adaptation to an announced value."""
        return self._joined(
            part.reset_to(own, value[block], start[block])
            for part, block, own in self._split(estimate)
        )

    def recorded(self, estimate: Estimate) -> Estimate:
        """Return the estimate with the memory that the records of its blocks keep."""
        if not any(estimate.memory):
            return estimate
        return self._joined(part.recorded(own) for part, _, own in self._split(estimate))

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the rates of all blocks."""
        return self._joined(
            part.rate(own, drive.columns(block)) for part, block, own in self._split(estimate)
        )

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held."""
        value, own = estimate.value, estimate.memory or self._forgetful
        drives = [drive.columns(block) for _, block in self.parts]
        after, memories = empty(self._size), []
        for (part, block), memory, its_drive in zip(self.parts, own, drives, strict=True):
            moved = part.step(Estimate(value[block], memory), its_drive, dt)
            after[block] = moved.value
            memories.append(moved.memory)
        return Estimate(after, tuple(memories))

    def divergence(self, value: np.ndarray, truth: np.ndarray) -> float | None:
        """Return the sum of the blocks' parts of V, or None where one is undefined."""
        parts = [part.divergence(value[block], truth[block]) for part, block in self.parts]
        return (
            None if any(d is None for d in parts) else float(sum(d for d in parts if d is not None))
        )

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the sum of the blocks' parts of V, or None where one is undefined."""
        parts = [part.storage(own, truth[block]) for part, block, own in self._split(estimate)]
        known = [part for part in parts if part is not None]
        return float(sum(known)) if len(known) == len(parts) else None

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return the sum of what the blocks' adaptations add to dV/dt."""
        blocks = self._split(estimate)
        return float(sum(p.dissipation(own, drive.columns(b), truth[b]) for p, b, own in blocks))

    def gain(self, value: np.ndarray) -> np.ndarray:
        """Return Gamma (p, p) at a value (p), block by block."""
        return self.gain_times(value, np.eye(value.size))

    def gain_times(self, value: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l), block by block."""
        blocks = [part.gain_times(value[block], X[block]) for part, block in self.parts]
        return np.concatenate(blocks)

    def metric(self, estimate: Estimate) -> np.ndarray:
        """Return Gamma (p, p) at an estimate with its memory, block by block."""
        Gamma = np.zeros((self._size, self._size))
        for part, block, own in self._split(estimate):
            Gamma[block, block] = part.metric(own)
        return Gamma

    def references(self) -> tuple[str, ...]:
        """Return the sources of all parts, in their order."""
        return tuple(source for part, _ in self.parts for source in part.references())

    def _split(self, estimate: Estimate) -> Iterator[tuple[Adaptation, slice, Estimate]]:
        """Return each adaptation with its block and that block's estimate."""
        memories = estimate.memory or self._forgetful
        for (part, block), memory in zip(self.parts, memories, strict=True):
            yield part, block, Estimate(estimate.value[block], memory)

    def _joined(self, estimates: Iterable[Estimate]) -> Estimate:
        """Return the estimates of all blocks as one."""
        value, memories = np.empty(self._size), []
        for (_, block), estimate in zip(self.parts, estimates, strict=True):
            value[block] = estimate.value
            memories.append(estimate.memory)
        return Estimate(value, tuple(memories))
