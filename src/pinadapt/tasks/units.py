"""The units in which people read what is computed in SI units."""

from __future__ import annotations

import math
from typing import NamedTuple


class Display(NamedTuple):
    """How a quantity is shown.

    Attributes:
        unit: to be written behind the number.
        scale: what the SI value is multiplied by.
    """

    unit: str
    scale: float


DISPLAYS = {"m": Display("mm", 1e3), "rad": Display("deg", 180.0 / math.pi)}
