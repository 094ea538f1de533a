"""From the samples of a run to its rollout."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..controller.controller import Controller
from ..controller.state import Sample
from ..exceptions import DivergedError
from ..plants.plant import SimulatedPlant
from ..robot.succession import Succession
from ..rollout.evaluation import Evaluation
from ..rollout.rollout import Rollout


@dataclass(eq=False)
class Record:
    """What is kept of a run.

    Attributes:
        samples: one of so many.
        steps: how many there were.
        step_time: seconds that the controller spent in all of them.
        diverged: time [s] at which the loop diverged, or None.
        reason: why, or None.
        interrupted: time [s] of the last sample before somebody stopped the run, or None.
    """

    samples: list[Sample] = field(default_factory=list)
    steps: int = 0
    step_time: float = 0.0
    diverged: float | None = None
    reason: str | None = None
    interrupted: float | None = None


def record(stream: Iterator[Sample], indices: Iterable[int], every: int = 1) -> Record:
    """Take a sample for each index and keep those whose index is a multiple of ``every``.

    What there is by then is kept where the loop diverges or a ``KeyboardInterrupt`` stops it.
    """
    kept, last = Record(), 0.0
    try:
        for k, sample in zip(indices, stream, strict=False):
            kept.steps, last = kept.steps + 1, sample.t
            kept.step_time += sample.step_time
            if k % every == 0:
                kept.samples.append(sample)
    except DivergedError as error:
        kept.diverged, kept.reason = error.time, error.reason
    except KeyboardInterrupt:
        kept.interrupted = last
    return kept


def rollout_of(
    kept: Record,
    plant: SimulatedPlant,
    controller: Controller,
    robots: Succession,
    *,
    announced: Iterable[float] = (),
    title: str,
    wall_time: float,
    extent: float | None = None,
) -> Rollout:
    """Return the rollout of a record, its samples stacked.

    Args:
        kept: the record.
        plant: what was driven.
        controller: what drove it.
        robots: the true robot, and what it became.
        announced: times of announcements to the controller [s].
        title: of the rollout.
        wall_time: of the run [s].
        extent: of the desired path, see ``Trajectory.extent``.
    """
    robot, samples = robots.robots[0], kept.samples
    tau = _rows([sample.torque for sample in samples], plant.nv)
    coordinates = robot.task.coordinates
    return Rollout(
        title=title,
        robot=robot.name,
        law=controller.law.name,
        adaptation=_adaptation(controller),
        task=robot.task,
        joint_names=tuple(robot.joint_names),
        kinematic_names=controller.kinematics.names,
        dynamic_names=controller.dynamics.names,
        t=np.array([sample.t for sample in samples]),
        q=_rows([sample.truth.q for sample in samples], robot.model.nq),
        v=_rows([sample.truth.v for sample in samples], plant.nv),
        tau=tau,
        x=_rows([sample.truth.x for sample in samples], coordinates),
        x_d=_rows([sample.desired.x_d for sample in samples], coordinates),
        a_k=_rows([sample.state.kinematic.value for sample in samples], controller.kinematics.size),
        a_d=_rows([sample.state.dynamic.value for sample in samples], controller.dynamics.size),
        saturated=_saturated(tau, plant.torque_limits, controller.limits.torque),
        diverged=kept.diverged,
        reason=kept.reason,
        wall_time=wall_time,
        step_time=kept.step_time / max(kept.steps, 1),
        evaluation=Evaluation(controller, robots, samples),
        marks=_marks(robots, announced),
        interrupted=kept.interrupted,
        path_extent=extent,
    )


def _adaptation(controller: Controller) -> str:
    """Return the dynamic adaptation's name, or the kinematic one's where that alone adapts."""
    used = controller.adaptation_d if controller.dynamics.size else controller.adaptation_k
    return used.name


def _marks(robots: Succession, announced: Iterable[float]) -> tuple[tuple[float, str], ...]:
    """Return when something happened [s] and what, in order."""
    words = {time: [what] for time, what in robots.words}
    for time in announced:
        words.setdefault(time, []).append("announced")
    return tuple((time, ", ".join(words[time])) for time in sorted(words))


def _rows(arrays: Sequence[np.ndarray | None], width: int) -> np.ndarray:
    return np.array(arrays, dtype=float).reshape(len(arrays), width)


def _saturated(tau: np.ndarray, *limits: np.ndarray | None) -> np.ndarray:
    """Tell of each sample (N) whether a torque (N, nv) is at one of the limits (nv) [N m or N]."""
    at = [(np.abs(tau) >= bounds).any(axis=1) for bounds in limits if bounds is not None]
    return np.any([np.zeros(len(tau), dtype=bool), *at], axis=0)
