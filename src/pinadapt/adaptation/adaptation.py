"""What an adaptation is: an estimate a moves by da/dt = -Gamma g, g the gradient of its drive."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import instance, joint_numbers, whole
from ..exceptions import GainError, InputError


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


@dataclass(slots=True, eq=False)
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
        gradient: (p) g, computed unless given.
        observed: whether e is the error of an observer, which is valid for any torque; then
            ``without_tracking`` keeps it.
        saturated: whether a motor was at its limit; an obstacle may then hold the robot.
    """

    Y: np.ndarray
    e: np.ndarray | None
    W: np.ndarray | None = None
    residual: np.ndarray | None = None
    weight: np.ndarray | None = None
    gradient: Any = None
    observed: bool = False
    saturated: bool = False

    def __post_init__(self) -> None:
        """Combine the parts."""
        if self.gradient is not None:
            return
        e, W, R, r = self.e, self.W, self.weight, self.residual
        self.gradient = np.zeros(self.Y.shape[1]) if e is None else e.dot(self.Y)
        if W is not None and R is not None and r is not None:
            self.gradient = self.gradient + R.dot(r).dot(W)

    def without_tracking(self) -> Drive:
        """Return the parts that are valid for any torque: prediction and observer error."""
        if self.observed:
            return self
        return Drive(self.Y, None, self.W, self.residual, self.weight, saturated=True)

    def with_prediction_error(self, W: np.ndarray, residual: np.ndarray) -> Drive:
        """Return the drive with a prediction error W (l, p), r (l), weighted by the adaptation."""
        return Drive(self.Y, self.e, W, residual, None, self.gradient)

    def weighted(self, weight: np.ndarray) -> Drive:
        """Return the drive with the weight R (l, l) of the prediction error."""
        assert self.W is not None and self.residual is not None
        change = weight if self.weight is None else weight - self.weight
        gradient = self.gradient + change.dot(self.residual).dot(self.W)
        return replace(self, weight=weight, gradient=gradient)

    def scaled(self, tracking: float, prediction: float) -> Drive:
        """Return the drive with its two parts multiplied by numbers >= 0.

        In the prediction part W and r are both multiplied by the square root: r = W da still holds,
        and least squares weights the information accordingly.
        """
        e = None if self.e is None else tracking * self.e
        if self.W is None or self.residual is None:
            gradient = self.gradient if e is None else tracking * self.gradient
            return replace(self, e=e, gradient=gradient)
        root = math.sqrt(prediction)
        return replace(self, e=e, W=root * self.W, residual=root * self.residual, gradient=None)

    def columns(self, block: slice) -> Drive:
        """Return the drive of a block of the parameters."""
        W = None if self.W is None else self.W[:, block]
        return Drive(
            self.Y[:, block],
            self.e,
            W,
            self.residual,
            self.weight,
            self.gradient[block],
            self.observed,
            self.saturated,
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

    The proof dV/dt <= 0 of every control law here holds for any adaptation whose ``storage`` D
    satisfies dD/dt = -(a - a_true)^T g, whatever its metric. So any law works with any adaptation.

    A subclass implements ``rate`` and ``storage``; the other methods have defaults. Internal
    state belongs in ``Estimate.memory``: ``init`` starts it, and ``rate`` returns its rate together
    with the value's.

    Attributes:
        name: as written in scenarios.
        sources: keys of ``references.bib``, or BibTeX entries of your own; see ``citation``.
        torque_bandwidth: bandwidth [1/s] of the low pass on torque and regressor. If set, drives of
            the dynamic estimate contain the prediction error of the filtered torque, without a
            weight. None: they contain only what the control law provides.
    """

    name: str = "custom"
    sources: tuple[str, ...] = ()
    torque_bandwidth: float | None = None

    def init(self, value: np.ndarray, information: np.ndarray | None = None) -> Estimate:
        """Return the estimate to start from, moved into the domain with a warning if necessary.

        Args:
            value: (p) initial, or announced during a run.
            information: (p, p) matrix of other data, whose best value it is: the inverse covariance
                where that has full rank. Adaptations without a memory of data ignore it.

        Raises:
            ParameterError: the value cannot be used.
        """
        return Estimate(value)

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

        def moved(part: np.ndarray, rate: np.ndarray) -> np.ndarray:
            return part + dt * rate

        memory = mapped(moved, estimate.memory, rate.memory) if rate.memory else ()
        return Estimate(moved(estimate.value, rate.value), memory)

    @abstractmethod
    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return D, the adaptation's part of V, at an estimate; None where it is undefined."""

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return what the adaptation adds to the law's dV/dt, zero without a prediction error."""
        return 0.0

    def gain(self, estimate: Estimate) -> np.ndarray:
        """Return Gamma (p, p) at an estimate; its inverse is the metric of V."""
        return self.gain_times(estimate, np.eye(estimate.value.size))

    def gain_times(self, estimate: Estimate, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l), a new array, at an estimate, X (p, l)."""
        drives = (Drive(g[None], None, gradient=g) for g in X.T)
        columns = [-self.rate(estimate, drive).value for drive in drives]
        return np.column_stack(columns) if columns else np.zeros(X.shape)


def mapped(change: Callable[..., np.ndarray], part: Any, *others: Any) -> Any:
    """Return estimates and nested tuples with arrays and floats changed, the rest as it is.

    The others are made of the same parts, which ``change`` gets beside the first one's.
    """
    if isinstance(part, np.ndarray):
        return change(part, *others)
    if isinstance(part, float):
        return change(np.array(part), *others).item()
    if isinstance(part, Estimate):
        return Estimate(change(part.value), mapped(change, part.memory))
    if not isinstance(part, tuple):
        return part
    pieces = [mapped(change, *each) for each in zip(part, *others, strict=True)]
    return type(part)(*pieces) if hasattr(part, "_fields") else tuple(pieces)


def positive_numbers(given: ArrayLike, where: str, size: int | None = None) -> np.ndarray:
    """Return a positive number or a list of them as an array, with a size as one of that size.

    Raises:
        GainError: one of them is not positive, or no number, or they are of another size.
    """
    return joint_numbers(given, where, size, zero=False, error=GainError)


class Frozen(Adaptation):
    """da/dt = 0: no adaptation, the baseline for comparisons."""

    name = "none"

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return zero (p)."""
        return Estimate(np.zeros(estimate.value.size))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate."""
        return estimate

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return 0 for the true value; None otherwise, since no V is defined."""
        return 0.0 if np.allclose(estimate.value, truth, rtol=1e-12, atol=1e-12) else None


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
        self.name = inner.name
        self.torque_bandwidth = inner.torque_bandwidth
        self.sources = (*self.sources, *inner.sources)

    def _own(self, start: np.ndarray) -> tuple:
        """Return this wrapper's parts of the memory, ``_parts``, for an initial value (p)."""
        return ()

    def _inner(self, estimate: Estimate) -> Estimate:
        """Return the estimate with the inner adaptation's own memory."""
        if not self._parts:
            return estimate
        return Estimate(estimate.value, estimate.memory[self._parts :])

    def _outer(self, own: tuple, inner: Estimate) -> Estimate:
        """Return an inner adaptation's estimate with these own parts before its memory."""
        return Estimate(inner.value, (*own, *inner.memory)) if self._parts else inner

    def init(self, value: np.ndarray, information: np.ndarray | None = None) -> Estimate:
        """Return the inner adaptation's start, with this one's parts before its memory."""
        inner = self.inner.init(value, information)
        return self._outer(self._own(inner.value), inner)

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

    def recorded(self, estimate: Estimate) -> Estimate:
        """Return what a record keeps: this one's parts and those of the inner adaptation."""
        inner = self.inner.recorded(self._inner(estimate))
        return self._outer(estimate.memory[: self._parts], inner)

    def _driven(self, estimate: Estimate, drive: Drive) -> Drive:
        """Return the drive of the inner adaptation."""
        return drive

    def _added(self, estimate: Estimate, drive: Drive) -> np.ndarray | None:
        """Return what is added to the inner rate of the value (p), None for nothing."""
        return None

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the inner adaptation's rates, and what this one adds to the value's."""
        rate = self.inner.rate(self._inner(estimate), self._driven(estimate, drive))
        still = tuple(np.zeros(part.shape) for part in estimate.memory[: self._parts])
        added = self._added(estimate, drive)
        return self._outer(still, rate if added is None else rate.with_value(rate.value + added))

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the inner adaptation's estimate after dt [s]."""
        inner = self.inner.step(self._inner(estimate), self._driven(estimate, drive), dt)
        return self._outer(estimate.memory[: self._parts], inner)

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the inner adaptation's part of V."""
        return self.inner.storage(self._inner(estimate), truth)

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return what the inner adaptation adds to dV/dt, and what this one changes.

        That is da^T (g - g') for the drive g' of the inner one, and the power of what is added.
        """
        inner = self._inner(estimate)
        driven = self._driven(estimate, drive)
        error = estimate.value - truth
        added = self._added(estimate, drive)
        changed = error @ (drive.gradient - driven.gradient)
        if added is not None:
            changed += error @ np.linalg.solve(self.inner.gain(inner), added)
        return self.inner.dissipation(inner, driven, truth) + changed

    def gain_times(self, estimate: Estimate, X: np.ndarray) -> np.ndarray:
        """Return the inner adaptation's Gamma X (p, l)."""
        return self.inner.gain_times(self._inner(estimate), X)


class Stacked(Adaptation):
    """Adaptations of consecutive blocks of one estimate; its part of V is the sum of theirs.

    Attributes:
        parts: the adaptations, in the order of their blocks.
    """

    def __init__(self, parts: Sequence[tuple[Adaptation, int]]) -> None:
        """Stack pairs of an adaptation and the size of its block; the first gives the name.

        Raises:
            InputError: no pair, or something that is not an adaptation and a size.
        """
        if not parts:
            raise InputError("expected at least one adaptation.", where="parts")
        self.parts: list[tuple[Adaptation, slice]] = []
        end = 0
        for part, size in parts:
            start = end
            end = end + whole(size, "parts", 0)
            self.parts.append((instance(part, Adaptation, "parts"), slice(start, end)))
        self.name = parts[0][0].name
        self.sources = tuple(source for part, _ in parts for source in part.sources)
        bandwidths = (part.torque_bandwidth for part, _ in parts)
        self.torque_bandwidth = next(filter(None, bandwidths), None)

    @property
    def projects(self) -> bool:
        """Whether a block's adaptation may move its value."""
        return any(part.projects for part, _ in self.parts)

    def init(self, value: np.ndarray, information: np.ndarray | None = None) -> Estimate:
        """Return the estimate to start from; its memory holds one memory a block."""
        return self._joined([part.init(value[block]) for part, block in self.parts])

    def contains(self, value: np.ndarray) -> bool:
        """Return whether each block of a value (p) is in the domain of its adaptation."""
        return all(part.contains(value[block]) for part, block in self.parts)

    def project(self, estimate: Estimate, q: np.ndarray) -> np.ndarray:
        """Return the value (p) to use at q (nq), each block projected by its adaptation."""
        return np.concatenate([part.project(own, q) for part, _, own in self._split(estimate)])

    def rate(self, estimate: Estimate, drive: Drive) -> Estimate:
        """Return the rates of all blocks."""
        rates = [part.rate(own, drive.columns(block)) for part, block, own in self._split(estimate)]
        return self._joined(rates)

    def step(self, estimate: Estimate, drive: Drive, dt: float) -> Estimate:
        """Return the estimate after dt [s] with the drive held."""
        before = estimate.value
        value = np.empty(before.size)
        after = []
        for (part, block), own in zip(self.parts, self._memories(estimate), strict=True):
            moved = part.step(Estimate(before[block], own), drive.columns(block), dt)
            value[block] = moved.value
            after.append(moved.memory)
        return Estimate(value, tuple(after))

    def storage(self, estimate: Estimate, truth: np.ndarray) -> float | None:
        """Return the sum of the blocks' parts of V, or None where one is undefined."""
        stored = [part.storage(own, truth[b]) for part, b, own in self._split(estimate)]
        return None if None in stored else sum(filter(None, stored))

    def dissipation(self, estimate: Estimate, drive: Drive, truth: np.ndarray) -> float:
        """Return the sum of what the blocks' adaptations add to dV/dt."""
        return sum(
            part.dissipation(own, drive.columns(block), truth[block])
            for part, block, own in self._split(estimate)
        )

    def gain_times(self, estimate: Estimate, X: np.ndarray) -> np.ndarray:
        """Return Gamma X (p, l), block by block."""
        return np.concatenate(
            [part.gain_times(own, X[block]) for part, block, own in self._split(estimate)]
        )

    def _memories(self, estimate: Estimate) -> tuple[Any, ...]:
        """Return the memory of each block."""
        memories = estimate.memory or ((),) * len(self.parts)
        if len(memories) != len(self.parts):
            raise InputError("the estimate is that of another adaptation.", where="state")
        return memories

    def _split(self, estimate: Estimate) -> list[tuple[Adaptation, slice, Estimate]]:
        """Return each adaptation with its block and that block's estimate."""
        return [
            (part, block, Estimate(estimate.value[block], own))
            for (part, block), own in zip(self.parts, self._memories(estimate), strict=True)
        ]

    def _joined(self, blocks: Sequence[Estimate]) -> Estimate:
        """Return the estimates of all blocks as one."""
        value = np.concatenate([block.value for block in blocks])
        return Estimate(value, tuple(block.memory for block in blocks))
