"""Delay compensation: the present position from camera frames that are late, rare, or missing.

x is affine in the unknown translations a_k. A frame x_c, taken at configuration q_c, therefore
gives the prediction error of the present estimate, however old the frame is:

    epsilon = X(q_c) a_k + b,    b = x_0(q_c) - x_c.

The estimated kinematics predict the motion since then:

    x(t) = x_hat(q(t); a_k) - epsilon.

The error of this x is (X(q(t)) - X(q_c)) da_k and vanishes with the parameter error da_k. Noise of
the frames is reduced by a low pass on epsilon, which adds no lag to the motion of the arm. It runs
over X(q_c) and b, so that epsilon of all frames is that of the present estimate: what an estimate
has learned since corrects x at once.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from .._checks import ROUNDING
from ..exceptions import ImplausibleError, MeasurementError
from .task_kinematics import TaskKinematics

History: TypeAlias = tuple[tuple[float, np.ndarray], ...]


class Frame(NamedTuple):
    """The last frame of the camera; m_p positions, p kinematic parameters.

    Attributes:
        t: the time at which it was taken [s].
        X_k: (m_p, p) dx/da_k at the configuration of that time.
        b: (m_p) the frame's prediction error is X_k a_k + b [m].
        X_smooth, b_smooth: the same with the noise of the frames low-passed.
        turn: rotation from the estimated to the measured orientation; None without orientation.
    """

    t: float
    X_k: np.ndarray
    b: np.ndarray
    X_smooth: np.ndarray
    b_smooth: np.ndarray
    turn: Any = None


class SensedState(NamedTuple):
    """The state of the robot according to its sensors, kept until the next sample.

    m_p: positions among the task coordinates, p: kinematic parameters.

    Attributes:
        q: (nq) the configuration.
        v: (n) the joint velocity, filtered if there is a filter [rad/s or m/s].
        x: the present task coordinates: measured, predicted from the last frame, or for a joint
            task those of q. None before the first frame.
        epsilon: (m_p) prediction error of the last measured position [m]; empty before the first
            frame.
        X_k: (m_p, p) its regressor, dx/da_k at the configuration of that measurement.
        frame: the last frame of the camera; None if x was measured at this sample.
        history: (t, q) of the samples since the last frame was taken, oldest first.
        first: sums of the first samples, see ``FirstSamples``; None once their checks are complete.
        monitor: of the samples, with which the next one is compared, see ``MonitorState``.
    """

    q: np.ndarray
    v: np.ndarray
    x: np.ndarray | None = None
    epsilon: np.ndarray = np.zeros(0)
    X_k: np.ndarray = np.zeros((0, 0))
    frame: Frame | None = None
    history: History = ()
    first: Any = None
    monitor: Any = None


@dataclass(frozen=True)
class DelayCompensator:
    """Predicts the present position from the last frame of a camera.

    Attributes:
        smoothing: bandwidth of the low pass on the frames' prediction error [1/s]; infinite: none.
        enabled: whether the estimated kinematics predict the motion since the last frame.
            Otherwise the last frame is used as the present position.
        longest_gap: the largest age of the last frame [s].
    """

    smoothing: float = math.inf
    enabled: bool = True
    longest_gap: float = 1.0

    def update(
        self,
        before: SensedState,
        t_before: float,
        t: float,
        q: np.ndarray,
        x: np.ndarray | None,
        x_time: float | None,
        kinematics: TaskKinematics,
    ) -> tuple[np.ndarray | None, np.ndarray, np.ndarray, Frame | None, History]:
        """Return x, epsilon, X_k, frame and history of the ``SensedState`` at a sample.

        The kinematics were last updated there.

        Args:
            before: the sensed state at the sample before.
            t_before: time of that sample [s].
            t: time of this sample [s].
            q: (nq) its configuration.
            x: measured coordinates; None: no frame arrived.
            x_time: the time at which they were taken [s]; None: t.
            kinematics: the estimated kinematics.

        Raises:
            MeasurementError: the frame was taken after the sample.
            ImplausibleError: no new frame for longer than ``longest_gap``.
        """
        now = x is not None and x_time is None
        now &= self.smoothing == math.inf or not kinematics.positions
        if now or not self.enabled or before.x is None:
            x = before.x if x is None else x.copy()
            if x is None:
                return None, np.zeros(0), np.zeros((0, 0)), None, ()
            error = kinematics.p_hat - x[: kinematics.positions]
            return x, error, kinematics.explaining(x), None, ()
        frame = before.frame
        history = before.history
        if frame is None:  # the position was measured at the sample before
            history = ((t_before, before.q),)
            frame = self._frame(t_before, before.q, before.x, kinematics, None)
        history = (*history, (t, q))
        taken = t if x_time is None else x_time
        if x is not None and taken > frame.t + ROUNDING:
            if taken > t + ROUNDING:
                raise MeasurementError("x_time", x_time, f"is later than the sample's own, {t:g} s")
            history, q_c = _at(history, taken, kinematics)
            frame = self._frame(taken, q_c, x, kinematics, frame)
        elif t - frame.t > self.longest_gap:
            raise ImplausibleError("x", None, f"has not been seen for {t - frame.t:.3g} s")
        X_a = frame.X_k.dot(kinematics.a_k)
        smooth = frame.X_smooth.dot(kinematics.a_k)
        x = kinematics.task.carried(kinematics.x_hat, smooth + frame.b_smooth, frame.turn)
        return x, X_a + frame.b, frame.X_k, frame, history

    def _frame(
        self,
        t: float,
        q: np.ndarray,
        x: np.ndarray,
        kinematics: TaskKinematics,
        before: Frame | None,
    ) -> Frame:
        """Return the frame x taken at time t [s] and configuration q (nq), after another one."""
        task = kinematics.task
        x_hat, X_k = kinematics.at(q, x)
        b = task.position(x_hat) - task.position(x) - X_k.dot(kinematics.a_k)
        if before is None or math.isinf(self.smoothing):
            return Frame(t, X_k, b, X_k, b, task.turn(x_hat, x))
        rest = math.exp(-self.smoothing * (t - before.t))
        X_smooth = rest * before.X_smooth + (1.0 - rest) * X_k
        b_smooth = rest * before.b_smooth + (1.0 - rest) * b
        return Frame(t, X_k, b, X_smooth, b_smooth, task.turn(x_hat, x, before.turn, rest))


def _at(history: History, t: float, kinematics: TaskKinematics) -> tuple[History, np.ndarray]:
    """Return the history from the last sample before time t [s], and the configuration (nq) at t.

    At times before all samples it is that of the first one.
    """
    history = history[max(bisect_right(history, t, key=lambda sample: sample[0]) - 1, 0) :]
    (t_0, q_0), *later = history
    if t <= t_0 + ROUNDING or not later:
        return history, q_0
    t_1, q_1 = later[0]
    share = (t - t_0) / (t_1 - t_0)
    return history, pin.interpolate(kinematics.robot.model, q_0, q_1, share)
