"""What moves an estimate, and the estimate with what its adaptation remembers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


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
        weight: (l, l) R; None where it is left to the adaptation, see ``Adaptation.prediction``.
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

    def predicting(self, W: np.ndarray, residual: np.ndarray) -> Drive:
        """Return the drive with a prediction error, for its adaptation to weigh: as yet by zero."""
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
        return _Columns(self, block)


class _Columns(Drive):
    """The drive of a block of the parameters; most adaptations read no more than its gradient."""

    __slots__ = ("_block", "_whole")

    def __init__(self, whole: Drive, block: slice) -> None:
        """Take the whole drive and the block."""
        self._whole, self._block, self.gradient = whole, block, whole.gradient[block]

    @property
    def e(self) -> np.ndarray | None:  # type: ignore[override]
        """The tracking error (k) of the whole, or None."""
        return self._whole.e

    @property
    def residual(self) -> np.ndarray | None:  # type: ignore[override]
        """The prediction error (l) of the whole, or None."""
        return self._whole.residual

    @property
    def weight(self) -> np.ndarray | None:  # type: ignore[override]
        """The weight (l, l) of the whole's prediction, or None."""
        return self._whole.weight

    @property
    def observed(self) -> bool:  # type: ignore[override]
        """Whether e is the error of an observer."""
        return self._whole.observed

    @property
    def Y(self) -> np.ndarray:  # type: ignore[override]
        """Columns (k, p) of the regressor of the tracking error."""
        return self._whole.Y[:, self._block]

    @property
    def W(self) -> np.ndarray | None:  # type: ignore[override]
        """Columns (l, p) of the regressor of the prediction, or None."""
        return None if self._whole.W is None else self._whole.W[:, self._block]


@dataclass(slots=True, eq=False)
class Drives:
    """The drives of both estimates.

    Attributes:
        dynamic: of the dynamic parameters.
        kinematic: of the kinematic parameters.
    """

    dynamic: Drive
    kinematic: Drive

    def without_tracking(self) -> Drives:
        """Return what of both holds whatever the torque is."""
        return Drives(self.dynamic.without_tracking(), self.kinematic.without_tracking())
