"""What was learned from a recorded motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from .._table import Sheet
from ..adaptation.drive import Estimate
from ..controller.estimator import Estimator
from ..controller.learned import LearnedParameters
from ..controller.state import ControllerState
from ..logs.log import Log
from ..robot.robot import Robot
from ..rollout.excitation import Excitation
from ..rollout.information import Information
from ..rollout.payload_estimate import PayloadEstimate, payload_estimate
from . import report as words
from .errors import Errors, columns_rms
from .online import OnlineEstimates
from .position_fit import PositionRows
from .windows import Windows


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """What a log told of a robot; ``print`` shows a report.

    Attributes:
        log: the motion, its columns in the order of the joints.
        described: the robot as described.
        estimator: that learned online; its ``controller`` has models and names.
        windows: rows of the torque, low-passed.
        rows: rows of the positions.
        split: time [s] from which on the log was held out once.
        smooth: whether velocities were taken from the positions.
        dynamic: the dynamic parameters from the whole log, and what is known of them.
        kinematic: the translations from the whole log, likewise.
        before_split: (p_d) the dynamic parameters from what was not held out.
        position_before_split: (p_k) the translations from it.
        online: the estimates in time.
    """

    log: Log
    described: Robot
    estimator: Estimator
    windows: Windows
    rows: PositionRows
    split: float
    smooth: bool
    dynamic: Information
    kinematic: Information
    before_split: np.ndarray
    position_before_split: np.ndarray
    online: OnlineEstimates

    @property
    def state(self) -> ControllerState:
        """The state of a controller with these estimates; see ``Controller.learned``."""
        return self.online.state._replace(
            dynamic=Estimate(self.dynamic.estimate), kinematic=Estimate(self.kinematic.estimate)
        )

    @property
    def robot(self) -> Robot:
        """The robot as learned; ``robot.save("learned.urdf")`` writes it.

        Raises:
            ParameterError: a body is on the border of what is physical.
        """
        learned = self.estimator.learned(self.state)
        return replace(learned, drawn=self.described.drawn, task=self.described.task)

    def parameters(self) -> LearnedParameters:
        """Return the estimates by name, from which a controller can start."""
        return LearnedParameters.of(self.estimator.controller, self.state)

    def payload(self) -> PayloadEstimate:
        """Return the load that explains best what was learned of all bodies.

        Raises:
            ParameterError: the last body is not among the parameters.
        """
        return payload_estimate(self.estimator.controller, self.dynamic)

    def excitation(self) -> Excitation:
        """Return which combinations of the parameters the motion could tell apart."""
        return Excitation(self.dynamic, self.kinematic, self.parameters().units)

    @cached_property
    def described_parameters(self) -> np.ndarray:
        """The dynamic parameters (p_d) of the description, its friction and rotors included."""
        value = self.estimator.controller.dynamics.value(self.described)
        return self.estimator.controller.dynamics.initial if value is None else value

    @cached_property
    def torque_errors(self) -> Errors:
        """Errors of the low-passed torques of the joints (n) [N m or N]."""
        last = self.windows.between(self.split, np.inf)
        return Errors(
            columns_rms(self.windows.tau),
            columns_rms(self.windows.residual(self.described_parameters)),
            columns_rms(self.windows.residual(self.dynamic.estimate)),
            columns_rms(last.residual(self.described_parameters)),
            columns_rms(last.residual(self.before_split)),
        )

    @cached_property
    def online_held_out(self) -> np.ndarray:
        """Errors (n) of the held-out torques by the online estimate of before [N m or N]."""
        last = self.windows.between(self.split, np.inf)
        return columns_rms(last.residual(self.online.at(self.split)))

    @cached_property
    def position_errors(self) -> Errors | None:
        """Errors of the positions (m) [m], or None where none were learned from."""
        rows, start = self.rows, self.estimator.controller.kinematics.initial
        if not len(rows.t) or not self.kinematic.names:
            return None
        last = rows.split(self.split)[1]
        return Errors(
            columns_rms(rows.r - rows.r.mean(axis=0)),
            columns_rms(rows.r),
            columns_rms(rows.r - rows.W @ (self.kinematic.estimate - start)),
            columns_rms(last.r),
            columns_rms(last.r - last.W @ (self.position_before_split - start)),
        )

    @property
    def verdict(self) -> str:
        """What it came to, in one line."""
        return words.verdict(self)

    def report(self) -> str:
        """Return what was learned, how well it predicts, and what the motion left open."""
        return str(self._sheet())

    def __repr__(self) -> str:
        """Return the report."""
        return self.report()

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def _sheet(self) -> Sheet:
        return words.sheet(self)

    def summary(self) -> dict[str, Any]:
        """Return the numbers of ``summary.json``; None where no finite number is to be had."""
        return words.summary(self)

    def save(self, folder: Path | str) -> None:
        """Write ``learned.urdf``, ``learned.json``, ``estimates.npz`` and ``summary.json``.

        Raises:
            ParameterError: no URDF can have the estimates; the other files are written.
            OSError: they cannot be written.
        """
        words.save(self, Path(folder))

    def plot(self, folder: Path | str | None = None) -> Any:
        """Draw torques before and after, and the online estimates in time.

        Args:
            folder: into which to write ``torque.png`` and ``parameters.png``.

        Returns:
            The paths of the files; without a folder the two pictures, which show themselves in
            Jupyter.
        """
        from .pictures import draw, pictures_of

        return pictures_of(self) if folder is None else draw(self, Path(folder))
