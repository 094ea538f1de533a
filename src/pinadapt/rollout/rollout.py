"""A run, with its summary, pictures, the learned robot and its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._checks import instance, positive
from .._output import Printed, Report, whole_file, write_json
from ..controller.learned import AlongExcited, LearnedParameters
from ..controller.state import ControllerState
from ..exceptions import InputError, ParameterError
from ..information.information import (
    Excitation,
    Information,
    along_excited,
    dynamic_information,
    position_information,
)
from ..information.payload import (
    ArmPrior,
    PayloadEstimate,
    described_robot,
    payload_estimate,
    payload_of_uncertain_arm,
    whole_arm,
    whole_arm_information,
)
from ..information.tracker import FoundTracker, find_tracker
from ..models.dynamics import Dynamics
from ..robot.robot import Robot
from ..tuning.defaults import INERTIA
from . import summary
from .recording import Recording
from .summary import COMPUTED, RECORDED

if TYPE_CHECKING:
    from ..view.page import Animation


@dataclass(frozen=True, eq=False, repr=False)
class Rollout(Recording, Printed):
    """A closed loop over N samples; ``print`` shows a table.

    What was recorded, and the quantities that are computed from it, are those of ``Recording``.
    """

    @property
    def verdict(self) -> str:
        """The outcome of the run in one line: error, limits exceeded, ringing."""
        return self.numbers["verdict"]

    @cached_property
    def numbers(self) -> summary.Numbers:
        """The numbers of ``summary.json``; None stands for what is not finite."""
        return summary.summary(self)

    def summary(self) -> summary.Numbers:
        """Return a copy of ``numbers``."""
        return dict(self.numbers)

    def __str__(self) -> str:
        """Return a table of the most important numbers, and the verdict."""
        return str(self.report())

    def __repr__(self) -> str:
        """Return title and verdict."""
        return f"{self.title}: {self.verdict}"

    def report(self) -> Report:
        """Return a table of the most important numbers, and the verdict."""
        return summary.report_of(self, self.numbers)._replace(note=self.verdict)

    def save(self, folder: Path | str) -> None:
        """Write ``summary.json`` and ``rollout.npz`` into a folder, made if it is missing.

        Each is written atomically. The recorded arrays are saved first, then again with those that
        are computed from them: this takes a while, and an interruption must not lose the run.
        """
        for names in (RECORDED, RECORDED + COMPUTED):
            kept = {name: x for name in names if (x := getattr(self, name)) is not None}
            with whole_file(Path(folder) / "rollout.npz") as file:
                np.savez_compressed(file, **kept)
        write_json(Path(folder) / "summary.json", self.numbers)

    @classmethod
    def load(cls, folder: Path | str) -> Rollout:
        """Return the run that ``save``, or ``pinadapt run``, wrote into a folder.

        It has the numbers, the verdict and the plots of the run. Robots and controller are not in
        the files, so that ``animate``, ``learned``, ``excitation`` and ``payload`` need the run
        itself; ``learned.json`` and ``learned.urdf`` lie beside it.

        Raises:
            InputError: the files are missing, broken, or of another version of pinadapt.
        """
        run = object.__new__(cls)
        vars(run).update(summary.load(Path(folder)))
        return run

    def plot(self, folder: Path | str | None = None) -> Any:
        """Draw error, parameters and torque.

        Args:
            folder: into which to write them as ``.png``; made if it is missing.

        Returns:
            The paths of the files; without a folder the figures by name, which show themselves in
            Jupyter.
        """
        from ..plots.figures import Figures, draw_all

        return Figures.of(self) if folder is None else draw_all(self, Path(folder))

    def animate(self) -> Animation:
        """Return the run as an animated page, which shows itself in Jupyter.

        Raises:
            InputError: the rollout was loaded.
        """
        from ..view.page import animation_of

        return animation_of(self)

    def learned(self, *, all_estimates: bool = False) -> Robot:
        """Return the model with the last estimates as a robot; see ``Controller.learned``.

        Bodies and joints are the nearest to those at the start of the run that predict the same
        torques along its motion: what the motion did not excite is as it was. Its shape is that of
        the robot that was driven. ``learned().save("learned.urdf")`` writes it.

        Args:
            all_estimates: take every estimate as it is at the end.

        Raises:
            ParameterError: as ``Controller.learned``, or the estimates are not finite.
            InputError: the rollout was loaded, or has no sample.
        """
        evaluation = self.evaluated()
        return replace(
            evaluation.controller.learned(*self._last_estimates(all_estimates)),
            drawn=evaluation.true.robots[0].drawn,
        )

    def parameters(self, *, all_estimates: bool = False) -> LearnedParameters:
        """Return the last estimates by name, from which another controller can start.

        What the motion did not excite is as at the start of the run, as of ``learned``.

        Args:
            all_estimates: take every estimate as it is at the end.

        Raises:
            InputError: as ``learned``.
        """
        return LearnedParameters.of(
            self.evaluated().controller, *self._last_estimates(all_estimates)
        )

    def _last_estimates(self, whole: bool) -> tuple[ControllerState, AlongExcited | None]:
        """Return the last state, and what the motion of the whole run excites."""
        run = self.evaluated()
        along = None if whole else along_excited(run.controller, run.samples, since=self.last_mark)
        return run.last_state, along

    def excitation(self) -> Excitation:
        """Return which parameters the motion since the last mark can identify, and how well.

        The information matrix of the data at the last estimates, with its spectrum and rank and the
        uncertainty of each estimate. Takes about a second.

        Raises:
            InputError: as ``learned``.
        """
        evaluation = self.evaluated()
        samples = self.samples_since_last_mark()
        controller = evaluation.controller
        state = evaluation.last_state
        return Excitation(
            dynamic_information(controller.dynamics, controller.kinematics, samples, state.a_d),
            position_information(controller, samples, state),
            LearnedParameters.of(controller, state).units,
        )

    def tracker(self) -> FoundTracker:
        """Return where the tracker stands, from the frames since the last mark.

        It has the rotation and position of the base in the tracker's axes and the unknown
        translations, with deviations, see ``information.find_tracker``.

        Raises:
            InputError: as ``learned``.
            LogError: the controller has no unknown tracker, or the frames do not show it.
        """
        measurements = [sample.measurement for sample in self.samples_since_last_mark()]
        return find_tracker(self.evaluated().controller.kinematics, measurements)

    def payload(
        self, *, refined: bool = False, arm: float = 0.0, empty: Rollout | None = None
    ) -> PayloadEstimate:
        """Return the load: the estimate of the body of the task frame minus its description.

        Where other bodies were adapted too, it is the load that best explains the change of all of
        them, see ``payload_estimate``.

        Args:
            refined: take the least-squares estimate from all data since the last mark instead of
                the last online estimate, which still moves.
            arm: standard deviation of the arm's bodies around their description, adapted or not, as
                a share of their inertia: 0.05 for 5 %. It is part of the uncertainty of the load.
                Zero: that share, up to 30 %, which explains the data best.
            empty: a run of the same arm without load, from which the arm's bodies are estimated
                first, starting from the prior ``arm``, or 30 % where that is zero.

        Raises:
            ParameterError: that body was not adapted, the parameters are not those of bodies,
                or ``empty`` is a run of another arm.
            InputError: as ``learned``, or a share that is negative.
        """
        arm = positive(arm, "arm", zero=True, error=InputError)
        controller = self.evaluated().controller
        if controller.kinematics.robot.constraints:
            raise ParameterError(
                "forces of contacts and loops are not measured.",
                where="payload",
                hint='Take pa.identify(rollout, robot, unknown="payload"), or learned().',
            )
        whole = whole_arm(controller)
        described = described_robot(controller)
        found = self._whole_arm_information(whole)
        found = found.refined() if refined else found
        if empty is not None:
            without_load = instance(empty, Rollout, "empty")._whole_arm_information(whole)
            prior = ArmPrior.of(described, whole, arm or INERTIA).after(without_load.refined())
        elif arm:
            prior = ArmPrior.of(described, whole, arm)
        else:
            return payload_of_uncertain_arm(controller, whole, found)
        return payload_estimate(controller, found, prior)

    def _whole_arm_information(self, dynamics: Dynamics) -> Information:
        """Return the information of the run about all bodies of an arm."""
        evaluation = self.evaluated()
        controller = evaluation.controller
        if {name.rpartition(".")[0] for name in dynamics.names} != set(
            controller.kinematics.joint_names
        ):
            raise ParameterError(
                f"that run was of the joints {controller.kinematics.joint_names}.",
                where="empty",
                hint="Take a run of the same arm.",
            )
        return whole_arm_information(
            controller, dynamics, self.samples_since_last_mark(), evaluation.last_state
        )
