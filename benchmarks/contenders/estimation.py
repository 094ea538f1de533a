"""What estimators of dynamics learn from: a motion and a model linear in its parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

import pinadapt as pa
from pinadapt.identification.fits import Windows, noise_levels
from pinadapt.information.measured_motion import CUTOFF, Averages, MeasuredMotion
from pinadapt.models.physical_fit import PhysicalSet, physical_set
from pinadapt.models.regressor import PER_BODY
from pinadapt.tuning.unknowns import nominal_dynamics

# Periods in that of the filter of positions, above which their derivatives are mostly noise: of
# the logs, that of 30 Hz.
_SLOW = 0.25
# Cutoff for them, relative to one over the length of a window, which there is at half. With 0.8 and
# 2.6 recursive least squares err 81 and 59 % more on a log of 30 Hz; without it 112 %.
_BAND = 1.3
# Least eigenvalue of a physical pseudo-inertia, relative to its largest: one on the border passes,
# as solvers find it.
_BORDER = -1e-8


@dataclass(frozen=True, eq=False)
class LearningProblem:
    """A recorded motion of a robot; what is before ``split`` may be learned from.

    Attributes:
        log: the motion as recorded.
        robot: as described.
        motion: in the log; accelerations are derivatives behind a filter without delay.
        dynamics: ten parameters of each body; armature, viscous and Coulomb friction and a constant
            torque of each joint.
        windows: equations of the torque averaged over windows, of the whole motion.
        split: time from which on the motion is held out [s].
    """

    log: pa.Log
    robot: pa.Robot
    motion: MeasuredMotion
    dynamics: pa.models.Dynamics
    windows: Windows
    split: float

    @cached_property
    def learned(self) -> MeasuredMotion:
        """The motion before the split, for who needs accelerations.

        Where the log is slow, positions and torques pass the same low pass without delay, in the
        band of the windows, and velocities and accelerations are derivatives of splines.
        """
        motion = self.motion
        if motion.period > _SLOW / CUTOFF:
            t, period = np.linspace(motion.t[0], motion.t[-1], len(motion.t), retstep=True)
            low_pass = butter(4, _BAND / self.windows.length, fs=1.0 / period, output="sos")
            q, tau = (
                CubicSpline(t, sosfiltfilt(low_pass, CubicSpline(motion.t, part)(t), axis=0))
                for part in (motion.q, motion.tau)
            )
            motion = MeasuredMotion(t, q(t), q(t, 1), q(t, 2), tau(t), True)
        first = motion.t < self.split
        return MeasuredMotion._make([*(part[first] for part in motion[:-1]), motion.smoothed])

    @cached_property
    def first(self) -> Windows:
        """The windows before the split."""
        return self.windows.between(-np.inf, self.split)

    @cached_property
    def physical(self) -> PhysicalSet:
        """The physical parameters; its centre is the description."""
        return physical_set(self.dynamics, self.robot)

    @cached_property
    def noise(self) -> np.ndarray:
        """What noise (n) a torque is assumed to have: a twentieth of its size [N m or N]."""
        return noise_levels(self.first.tau)[0]

    @cached_property
    def base(self) -> np.ndarray:
        """Indices of the base parameters, in which the others are contained."""
        return np.asarray(pa.models.base_parameters(self.dynamics, self.robot).chosen)

    def rms(self, a: np.ndarray) -> float:
        """Return the held-out error of the torques at parameters a (p) [N m]."""
        left = self.windows.between(self.split, np.inf).residual(a)
        return float(np.sqrt(np.mean(left**2)))

    def rms_of(self, robot: pa.Robot) -> float:
        """Return the held-out error of the torques of a robot [N m]."""
        nothing = pa.Unknown(bodies="none", friction=False, armature=False)
        dynamics = nominal_dynamics(replace(robot, task=self.robot.task), nothing, ())
        windows = Windows.of(self.motion, Averages(self.motion.t, self.log.period), dynamics, robot)
        return float(np.sqrt(np.mean(windows.between(self.split, np.inf).y ** 2)))

    def unphysical(self, a: np.ndarray) -> int:
        """Return how many bodies at parameters a (p) no distribution of mass has."""
        values = np.linalg.eigvalsh(self.physical.matrices(a))
        return int(np.sum(values[:, 0] < _BORDER * np.abs(values).max(axis=1)))

    def load(self, a: np.ndarray) -> float:
        """Return the mass [kg] of the load on the last body that explains a (p) best.

        With other coefficients of the joints it has the torques nearest to the change of all, over
        the windows before the split.
        """
        size = self.physical.bodies * PER_BODY
        W = (self.first.W / self.noise[:, None]).reshape(-1, self.dynamics.size)
        change = W @ (a - self.dynamics.initial)
        return float(np.linalg.lstsq(W[:, size - PER_BODY :], change, rcond=1e-10)[0][0])


class Estimates(NamedTuple):
    """Parameters in time.

    Attributes:
        t: (K) times [s]; of an estimate from the whole learning part, its end.
        a: (K, p) parameters.
        seconds: of the processor.
        masses: (K) of the load, where the estimator has one of its own [kg].
    """

    t: np.ndarray
    a: np.ndarray
    seconds: float
    masses: np.ndarray | None = None

    def at(self, t: float) -> np.ndarray:
        """Return the last parameters (p) until a time [s], or the first ones."""
        return np.asarray(self.a[self._last(t)])

    def load(self, problem: LearningProblem, t: float) -> float:
        """Return the mass of the load until a time [s] in kg, see ``LearningProblem.load``."""
        if self.masses is None:
            return problem.load(self.at(t))
        return float(self.masses[self._last(t)])

    def _last(self, t: float) -> int:
        return max(int(np.searchsorted(self.t, t, side="right")) - 1, 0)
