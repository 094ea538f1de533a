"""How well estimates predict the torques of a motion, and which of them the motion excites."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..controller.controller import Controller
from ..controller.learned import AlongExcited
from ..controller.state import Sample
from ..models.excited import Excited, TorqueSums, names_together, scales
from .information import BLOCK, CUTOFF
from .measured_motion import instants_of_samples

_INSTANTS = 400  # at most, of which the torques are taken


@dataclass(frozen=True, eq=False)
class MotionTorques:
    """The torques of a motion, as estimates of p dynamic parameters predict them.

    Attributes:
        excited: which combinations of the parameters the motion excites.
        sums: of the torques, from which follow their errors at any estimate.
        first, last: (p) the estimates at the first and at the last sample.
    """

    excited: Excited
    sums: TorqueSums
    first: np.ndarray
    last: np.ndarray

    def share(self, a: np.ndarray) -> float:
        """Return the rms error of the torques of the whole motion at a (p), relative to them."""
        return self.sums.error(a) / (self.sums.size or np.finfo(float).tiny)

    def left(self, a: np.ndarray, truth: np.ndarray) -> float | None:
        """Return the error of the identifiable combinations at a (p) relative to the first one's.

        None where that is zero.
        """
        start = self.excited.distance(self.first, truth)
        return self.excited.distance(a, truth) / start if start > 0.0 else None


_LOOKED_AT = 30  # additions between two looks at what a growing motion excites


class GrowingTorques:
    """The torques of a motion that goes on, from one looked-at sample to the next.

    Accelerations are the change of the velocity in between, torques their mean, so neither needs
    the samples in between.
    """

    def __init__(self, controller: Controller, start: np.ndarray) -> None:
        """Begin a motion at which the estimate is ``start`` (p)."""
        self._dynamics, self._model = controller.dynamics, controller.kinematics.robot.model
        self._start, self._root = start, scales(controller.dynamics, start)
        self._sums = TorqueSums(self._model.nv, start)
        self._added = 0
        self.excited: Excited | None = None

    def add(self, before: Sample, after: Sample, torque: np.ndarray) -> None:
        """Add the true motion from one sample to another, with its mean torque (n)."""
        (t, q, v, *_), (t_after, q_after, v_after, *_) = before.truth, after.truth
        middle = pin.integrate(self._model, q, 0.5 * pin.difference(self._model, q, q_after))
        state = middle, 0.5 * (v + v_after), (v_after - v) / (t_after - t)
        self._dynamics.load(self._start)
        Y = self._dynamics.regressor(*state)
        self._sums.add(Y[None], (torque - self._dynamics.torque(*state))[None], torque[None])
        if self._added % _LOOKED_AT == 0:
            self.excited = self._sums.excited(self._dynamics.names, self._root)
        self._added += 1

    def share(self, a: np.ndarray) -> float | None:
        """Return the rms error of the torques so far at a (p), relative to them."""
        return self._sums.error(a) / self._sums.size if self._sums.size > 0.0 else None

    def left(self, a: np.ndarray, truth: np.ndarray) -> float | None:
        """Return the error at a (p) of what is excited so far, relative to that of the start."""
        if self.excited is None:
            return None
        start = self.excited.distance(self._start, truth)
        return self.excited.distance(a, truth) / start if start > 0.0 else None


@dataclass(frozen=True)
class TorquePrediction:
    """What estimates of dynamic parameters are worth along a motion, in numbers.

    Attributes:
        rms: of the torques, all joints together [N m or N].
        error_first, error_last: rms error of the torques that the first and the last estimate
            predict [N m or N].
        identifiable: number of combinations of the parameters that the motion excites.
        identifiable_error: their error at the last estimate relative to the first, in the metric of
            ``Excited``. None where the truth is unknown, or was known at first.
        not_excited: names of the parameters that hardly change the torques.
    """

    rms: float
    error_first: float
    error_last: float
    identifiable: int
    identifiable_error: float | None
    not_excited: tuple[str, ...]

    @property
    def share_first(self) -> float:
        """The first error relative to the torques."""
        return self.error_first / (self.rms or np.finfo(float).tiny)

    @property
    def share_last(self) -> float:
        """The last error relative to the torques."""
        return self.error_last / (self.rms or np.finfo(float).tiny)

    def not_excited_words(self) -> str:
        """Return the names of what is not excited, whole bodies and kinds together."""
        return names_together(self.not_excited)

    @classmethod
    def of(cls, torques: MotionTorques, truth: np.ndarray | None) -> TorquePrediction:
        """Take the numbers of a motion, with the true parameters (p) or None."""
        excited, left = torques.excited, None
        if truth is not None:
            left = torques.left(torques.last, truth)
        still = [name for name, no in zip(excited.names, excited.still, strict=True) if no]
        errors = torques.sums.error(torques.first), torques.sums.error(torques.last)
        return cls(torques.sums.size, *errors, excited.rank, left, tuple(still))


def motion_torques(controller: Controller, samples: Sequence[Sample]) -> MotionTorques | None:
    """Return the torques that were measured along a motion, at up to 400 instants.

    Takes about 20 ms for seven joints. None without dynamic parameters, with fewer than three
    samples, or where estimates or torques are not finite.
    """
    dynamics = controller.dynamics
    if not dynamics.size or len(samples) < 3:
        return None
    first, last = samples[0].state.a_d, samples[-1].state.a_d
    model = controller.kinematics.robot.model
    motion = instants_of_samples(model, samples, cutoff=CUTOFF, window=BLOCK, most=_INSTANTS)
    finite = all(np.isfinite(part).all() for part in (first, last, *motion[1:5]))
    if not (finite and len(motion.t)):
        return None
    states = list(zip(motion.q, motion.v, motion.a, strict=True))
    dynamics.load(last)
    Y = np.array([dynamics.regressor(*state) for state in states])
    predicted = np.array([dynamics.torque(*state) for state in states])
    sums = TorqueSums(model.nv, last)
    sums.add(Y, motion.tau - predicted, motion.tau)
    return MotionTorques(sums.excited(dynamics.names, scales(dynamics, first)), sums, first, last)


def along_excited(
    controller: Controller, samples: Sequence[Sample], *, since: float = -np.inf
) -> AlongExcited | None:
    """Return what a motion excites, for ``Controller.learned``; None as of ``motion_torques``.

    Args:
        controller: that adapted.
        samples: of the whole motion.
        since: time of the last change of the robot [s]; the error of the torques is that of the
            later samples.
    """
    whole = motion_torques(controller, samples)
    later = [sample for sample in samples if sample.t >= since]
    last = whole if len(later) == len(samples) else motion_torques(controller, later)
    if whole is None or last is None:
        return None
    return AlongExcited(whole.excited, last.sums.relative_error(last.last))
