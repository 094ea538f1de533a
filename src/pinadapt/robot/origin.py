"""Where the numbers of a chain come from: the text of a URDF, and the chain as that has it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pinocchio as pin

from .urdf import Urdf


@dataclass(frozen=True, eq=False)
class Origin:
    """The URDF behind a robot.

    Attributes:
        source: the URDF, or the path of one that is read when it is asked for.
        model: the chain as loaded, before anything of it was changed; never written to.
    """

    source: Urdf | Path
    model: pin.Model

    @property
    def urdf(self) -> Urdf:
        """The URDF.

        Raises:
            RobotError: its file is gone, or no longer one.
        """
        return self.source if isinstance(self.source, Urdf) else Urdf.read(self.source)
