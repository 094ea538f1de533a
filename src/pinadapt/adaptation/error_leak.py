"""A leak that grows with the tracking error: the e1 modification."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..bibliography import NARENDRA_ANNASWAMY
from .adaptation import Adaptation
from .drive import Drive
from .error_size import checked_size, error_size
from .leak import Leak


class ErrorLeak(Leak):
    """da/dt = (inner rate) - lambda |e| (a - a_0), |e| the error over its size: e1 modification.

    A ``Leak`` costs accuracy where nothing is wrong any more; this one ceases with the error, so
    that with a disturbance that vanishes the true parameters are an equilibrium, and a motion that
    excites them leads there. It leaks most while the loop is upset, and least when nobody would
    notice a drift: a small error that noise keeps up drives the estimate as far as noise over
    lambda, whatever its size.

    dV/dt gains -lambda |e| da^T Gamma^-1 (a - a_0), an equality; for a constant Gamma at most
    -lambda |e| (D(a) - D(a_0)), so both the error's and the parameters' part of dV/dt are negative
    outside of a bounded set under a bounded disturbance. K. Narendra, A. Annaswamy, *A new adaptive
    law for robust adaptation without persistent excitation*, IEEE TAC 32 (1987) 134-145, whose leak
    -Gamma nu |e| a goes to zero.

    Attributes:
        bandwidth: lambda [1/s], at an error of its size.
        size: (k) or a number, in units of the drive's e; |e| is the root mean square of e over it.
    """

    sources = (NARENDRA_ANNASWAMY,)

    def __init__(self, inner: Adaptation, bandwidth: float, size: ArrayLike) -> None:
        """Take the adaptation to wrap, any, lambda [1/s] and the error's size.

        Raises:
            GainError: one of them is not positive.
        """
        super().__init__(inner, bandwidth)
        self.size = checked_size(size, "e1")

    def leaking(self, drive: Drive) -> float:
        """Return lambda |e| [1/s] under a drive; zero where its error is disregarded."""
        e: np.ndarray | None = drive.e
        return 0.0 if e is None else self.bandwidth * error_size(e, self.size)
