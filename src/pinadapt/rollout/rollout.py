"""What a run leaves behind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._checks import instance, positive
from .._table import Sheet
from ..controller.learned import LearnedParameters
from ..controller.state import Sample
from ..exceptions import InputError, ParameterError
from ..information.information import (
    Excitation,
    Information,
    position_information,
    torque_information,
)
from ..information.payload import (
    ArmPrior,
    PayloadEstimate,
    described,
    payload_estimate,
    told_of_all,
    whole_arm,
)
from ..models.dynamics import Dynamics
from ..robot.robot import Robot
from ..tasks.task import Task
from ..tuning.defaults import INERTIA
from . import summary as report
from . import verdict
from .evaluation import Evaluation
from .limit_excess import LimitExcess
from .summary import Transient, transients

if TYPE_CHECKING:
    from ..view.animation import Animation


@dataclass(frozen=True, eq=False, repr=False)
class Rollout:
    """A closed loop over N samples, in SI units and world axes; ``print`` shows a table.

    The fields were recorded. The properties are computed from the record when they are first read.

    Attributes:
        title, robot, law, adaptation: names of what ran.
        task: the controlled coordinates.
        joint_names: one name a joint.
        kinematic_names, dynamic_names: one name a parameter.
        t: (N) time [s].
        q, v, tau: (N, nq), (N, nv), (N, nv) true configuration and velocity, torque given by the
            motors.
        x, x_d: (N, .) true and desired task coordinates.
        a_k, a_d: (N, p_k), (N, p_d) estimates.
        saturated: (N) whether a torque was at its limit.
        diverged: time [s] at which the loop diverged, or None; the arrays end there.
        reason: why it diverged, or None.
        wall_time: seconds for the whole run.
        step_time: mean seconds of one controller step; zero in continuous mode, which has no steps.
        evaluation: what the properties are computed by; None once the rollout has left its process,
            with all of them computed.
        marks: time [s] and a few words for each change of the true robot, and each time the
            controller was told something.
        interrupted: time [s] at which somebody stopped the run, or None; the arrays end there.
        path_extent: radius of the desired circle, half the diagonal of another path [m or rad],
            zero for a point; None where the motion does not say.
        unadapted: largest error in the last 10 % of the same loop without adaptation [m or rad],
            or None where it is not known.
    """

    title: str
    robot: str
    law: str
    adaptation: str
    task: Task
    joint_names: tuple[str, ...]
    kinematic_names: tuple[str, ...]
    dynamic_names: tuple[str, ...]
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    x: np.ndarray
    x_d: np.ndarray
    a_k: np.ndarray
    a_d: np.ndarray
    saturated: np.ndarray
    diverged: float | None
    reason: str | None
    wall_time: float
    step_time: float
    evaluation: Evaluation | None
    marks: tuple[tuple[float, str], ...] = ()
    interrupted: float | None = None
    path_extent: float | None = None
    unadapted: float | None = None

    @cached_property
    def error(self) -> np.ndarray:
        """Task error (N, m), how far x is from x_d: [m], for orientations and joints [rad]."""
        rows = [self.task.error(*both) for both in zip(self.x, self.x_d, strict=True)]
        return np.array(rows).reshape(len(rows), self.task.size)

    @property
    def duration(self) -> float:
        """Time [s] from the first sample to one period after the last."""
        return float(self.t[-1] - self.t[0] + np.diff(self.t[-2:]).sum()) if len(self.t) else 0.0

    @property
    def distance(self) -> np.ndarray:
        """Norm of the error in the task's first group of rows (N): position [m] or joints [rad]."""
        return np.linalg.norm(self.error[:, self.task.groups[0].rows], axis=1)

    @property
    def angle(self) -> np.ndarray | None:
        """Angle between true and desired orientation (N) [rad], or None for tasks without one."""
        if len(self.task.groups) == 1:
            return None
        return np.linalg.norm(self.error[:, self.task.groups[1].rows], axis=1)

    @cached_property
    def a_k_true(self) -> np.ndarray | None:
        """The true kinematic parameters (p_k) [m], or None where no value of them is the truth.

        Of each sample (N, p_k) where the true robot changes during the run.
        """
        return self.evaluated().a_k_true

    @cached_property
    def a_d_true(self) -> np.ndarray | None:
        """The true dynamic parameters (p_d), or None where no value of them is the truth.

        Of each sample (N, p_d) where the true robot changes during the run.
        """
        return self.evaluated().a_d_true

    @cached_property
    def kinematic_base(self) -> int:
        """How many combinations of the kinematic parameters motion can identify."""
        return self.evaluated().controller.kinematics.base()

    @cached_property
    def lyapunov(self) -> np.ndarray | None:
        """V(t) (N), or None where undefined; it jumps where the true robot changes."""
        return self.evaluated().lyapunov

    @cached_property
    def lyapunov_ends(self) -> np.ndarray | None:
        """V of the first and the last sample (2), or None where undefined."""
        evaluation = self.evaluated()
        return evaluation.storage([evaluation.samples[k] for k in (0, -1)]) if len(self.t) else None

    @cached_property
    def min_eig_M_hat(self) -> np.ndarray:
        """Smallest eigenvalue (N) of the estimated mass matrix."""
        return self.evaluated().smallest_eigenvalues

    @cached_property
    def min_singular_J_hat(self) -> np.ndarray:
        """Smallest singular value (N) of the estimated Jacobian."""
        return self.evaluated().smallest_singular_values

    @cached_property
    def damping(self) -> np.ndarray:
        """The mu^2 (N) of the estimated Jacobian's ``RightInverse``, zero where that is exact."""
        return self.evaluated().damping

    @cached_property
    def limits(self) -> LimitExcess:
        """How far each joint went beyond the limits of its description, and was asked to."""
        return self.evaluated().limits

    @cached_property
    def effort_limits(self) -> np.ndarray:
        """Effort limits (nv) of the description [N m or N], infinite where it has none."""
        return self.evaluated().effort_limits

    @property
    def damping_share(self) -> np.ndarray:
        """The largest share (N) of a task motion that damping takes, mu^2 / (s_min^2 + mu^2)."""
        whole = self.min_singular_J_hat**2 + self.damping
        return self.damping / np.maximum(whole, np.finfo(float).tiny)

    @property
    def extent(self) -> float:
        """The path's extent [m or rad]: as its motion says, or half the diagonal of what ran."""
        if self.path_extent is not None or not len(self.t):
            return self.path_extent or 0.0
        return 0.5 * float(np.linalg.norm(np.ptp(self.x_d[:, self.task.groups[0].rows], axis=0)))

    @property
    def error_share(self) -> float | None:
        """Largest error of the last 10 % in parts of the path's extent; None for a point."""
        return verdict.error_share(self)

    @property
    def grade(self) -> str:
        """The verdict in a few words: follows, or not, or when it diverged."""
        return verdict.grade(self)

    @property
    def verdict(self) -> str:
        """What the run came to, in one line: error, limits exceeded, what to try."""
        return verdict.verdict(self)

    @property
    def transients(self) -> list[Transient]:
        """How the run bears each of its marks."""
        return transients(self)

    def window(self, first: bool) -> np.ndarray:
        """Return the error norms ``distance`` (>= 1) in the first or last 10 % of the samples."""
        return report.window(self.distance, first)

    def summary(self) -> dict[str, Any]:
        """Return the numbers of ``summary.json``; None where no finite number is to be had."""
        return report.summary(self)

    def __str__(self) -> str:
        """Return a table of what matters, and the verdict."""
        return str(self._sheet())

    def __repr__(self) -> str:
        """Return a few lines: robot, law, duration, errors."""
        return str(report.brief(self))

    def _repr_html_(self) -> str:
        return self._sheet().html()

    def _sheet(self) -> Sheet:
        return report.sheet(self)._replace(note=self.verdict)

    def save(self, folder: Path | str) -> None:
        """Write ``summary.json`` and ``rollout.npz`` into a folder, made if it is missing."""
        report.save(self, Path(folder))

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

    def animate(self, *, frames_per_second: float = 30.0) -> Animation:
        """Return the run as a page that moves, which shows itself in Jupyter.

        Args:
            frames_per_second: of the animation, at most one a sample.

        Raises:
            InputError: frames_per_second is not positive, or the rollout has left its process.
            PinadaptError: meshcat's viewer cannot be used.
        """
        from ..view.animation import animation_of

        return animation_of(self, frames_per_second=frames_per_second)

    def learned(self) -> Robot:
        """Return the believed robot with the last estimates; see ``Controller.learned``.

        Its shape is that of the robot that was driven. ``learned().save("learned.urdf")`` writes
        it.

        Raises:
            ParameterError: as ``Controller.learned``, or the estimates are not finite.
            InputError: the rollout has left its process, or has no sample.
        """
        evaluation = self.evaluated()
        learned = evaluation.controller.learned(evaluation.last_state)
        return replace(learned, drawn=evaluation.true.robots[0].drawn)

    def parameters(self) -> LearnedParameters:
        """Return the last estimates by name, from which another controller can start.

        Raises:
            InputError: as ``learned``.
        """
        evaluation = self.evaluated()
        return LearnedParameters.of(evaluation.controller, evaluation.last_state)

    def excitation(self) -> Excitation:
        """Return how exciting the run was, since the last of its marks, and for what.

        The spectrum of the information matrix, the parameters that motion could tell apart, and how
        well each last estimate is known; evaluated when asked, in a second or so.

        Raises:
            InputError: as ``learned``.
        """
        evaluation, samples = self.evaluated(), self._samples_since_last_mark()
        controller, state = evaluation.controller, evaluation.last_state
        return Excitation(
            torque_information(controller, samples, state),
            position_information(controller, samples, state),
            LearnedParameters.of(controller, state).units,
        )

    def payload(
        self, *, refined: bool = False, arm: float = 0.0, empty: Rollout | None = None
    ) -> PayloadEstimate:
        """Return the load that was learned: the last body as learned less the described one.

        Where the other bodies are unknown too, the load that explains best what was learned of all
        of them, the arm being as described.

        Args:
            refined: compare not the last estimates, which still move, but the least-squares ones
                from all data since the last mark.
            arm: standard deviation by which bodies of the arm, whether adapted or not, may differ
                from their description, as a share of their inertia: 0.05 for 5 %. The uncertainty
                of the load then holds theirs.
            empty: a run of the same arm without load, which told what the arm is; what it left open
                is off by ``arm``, or by 30 % where that is zero.

        Raises:
            ParameterError: the last body is not among the parameters, or bodies do not follow from
                them, or those of ``empty`` are of another arm.
            InputError: as ``learned``, or a share that is negative.
        """
        arm = positive(arm, "arm", zero=True, error=InputError)
        evaluation, samples = self.evaluated(), self._samples_since_last_mark()
        controller, state = evaluation.controller, evaluation.last_state
        if not arm and empty is None:
            found = torque_information(controller, samples, state)
            return payload_estimate(controller, found.refined() if refined else found)
        whole = whole_arm(controller)
        prior = ArmPrior.of(described(controller), whole, arm or INERTIA)
        if empty is not None:
            prior = prior.after(instance(empty, Rollout, "empty")._told_of_all(whole).refined())
        found = self._told_of_all(whole)
        return payload_estimate(controller, found.refined() if refined else found, prior)

    def _told_of_all(self, dynamics: Dynamics) -> Information:
        """Return what the run tells of all bodies of an arm."""
        evaluation = self.evaluated()
        controller = evaluation.controller
        theirs = {name.rpartition(".")[0] for name in dynamics.names}
        if theirs != set(controller.kinematics.joint_names):
            raise ParameterError(
                f"that run was of the joints {list(controller.kinematics.joint_names)}.",
                where="empty",
                hint="Take a run of the same arm.",
            )
        return told_of_all(
            controller, dynamics, self._samples_since_last_mark(), evaluation.last_state
        )

    def _samples_since_last_mark(self) -> Sequence[Sample]:
        """Return the samples in which the robot was the one that it is at the end."""
        since = max((at for at, _ in self.marks), default=-np.inf)
        return [sample for sample in self.evaluated().samples if sample.t >= since]

    def evaluated(self) -> Evaluation:
        """Return what the properties are computed by: robots, controller and samples.

        Raises:
            InputError: the rollout has left its process and has only the numbers left.
        """
        if self.evaluation is None:
            raise InputError(
                "a rollout that was copied to another process has its numbers, but no robots.",
                where="rollout",
                hint="Animate it where it ran.",
            )
        return self.evaluation

    def __getstate__(self) -> dict[str, Any]:
        """Compute every property and leave behind what they were computed from."""
        for name, attribute in vars(type(self)).items():
            if isinstance(attribute, cached_property):
                getattr(self, name)
        return {**self.__dict__, "evaluation": None}
