"""What a chain looks like."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from .chain import reduce_visual


@dataclass(frozen=True, eq=False)
class Visual:
    """The visual geometry of a chain, read from its meshes when it is first drawn.

    Attributes:
        read: returns the geometry of the whole robot, or None.
        whole: model of the whole robot.
        keep: indices of the chain's joints in it.
        q_reference: (nq) where the other joints are locked.
    """

    read: Callable[[], pin.GeometryModel | None]
    whole: pin.Model
    keep: tuple[int, ...]
    q_reference: np.ndarray

    @cached_property
    def geometry(self) -> pin.GeometryModel | None:
        """The geometry of the chain, or None where there is none."""
        visual = self.read()
        if visual is None:
            return None
        return reduce_visual(self.whole, visual, self.keep, self.q_reference)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy without the meshes, which are read again where they are needed."""
        return type(self), (self.read, self.whole, self.keep, self.q_reference)
