"""Where the frame is now, from frames of a camera that come late, seldom, or not at all.

x is affine in the unknown translations, so what a frame taken at q_c tells, X(q_c) a_k + b with
b = x_0(q_c) - x_c, is the prediction error of today's estimate at any age of the frame. The
position now is the frame carried on by the believed kinematics,

    x(t) = x_hat(q(t); a_k) - epsilon,    epsilon = X(q_c) a_k + b,

wrong by (X(q(t)) - X(q_c)) da_k, which dies with da_k. Noise of the frames goes through a low pass
of epsilon, which moves with the estimate and not with the arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..exceptions import ImplausibleError, MeasurementError
from .task_kinematics import TaskKinematics

_SAME = 1e-9  # [s] between times that are taken for one
_EMPTY, _NO_COLUMNS = np.zeros(0), np.zeros((0, 0))


class Frame(NamedTuple):
    """What the last frame of the camera told; m_p positions, p kinematic parameters.

    Attributes:
        t: when it was taken [s].
        X_k: (m_p, p) dx/da_k at the configuration of then.
        b: (m_p) the frame's prediction error is X_k a_k + b [m].
        b_smooth: (m_p) the same with the noise of the frames low-passed [m].
        turn: what turns the believed orientation into the seen one, None without orientation.
    """

    t: float
    X_k: np.ndarray
    b: np.ndarray
    b_smooth: np.ndarray
    turn: Any = None


class Sensed(NamedTuple):
    """What the sensors say at a sample, kept for the next one; m_p positions, p parameters.

    Attributes:
        q: (nq) the configuration.
        v: (n) the joint velocity, filtered where there is a filter [rad/s or m/s].
        x: the task coordinates now: measured, predicted from the last frame, or of a joint task
            those of q. None before the first frame.
        epsilon: (m_p) prediction error of the last seen position [m]; empty before the first frame.
        X_k: (m_p, p) its regressor, dx/da_k at the configuration where it was seen.
        frame: the last frame of the camera; None where it is x itself, of this sample.
        history: (t, q) of the samples since the last frame was taken, oldest first.
    """

    q: np.ndarray
    v: np.ndarray
    x: np.ndarray | None = None
    epsilon: np.ndarray = _EMPTY
    X_k: np.ndarray = _NO_COLUMNS
    frame: Frame | None = None
    history: tuple[tuple[float, np.ndarray], ...] = ()


@dataclass(frozen=True)
class Carrier:
    """Predicts the position now from the last frame of a camera.

    Attributes:
        smoothing: bandwidth of the low pass on the frames' prediction error [1/s]; infinite: none.
        carry: whether the estimated kinematics predict the motion since the last frame; else the
            last frame is taken for the present position.
        blind: how long the loop may run without a new frame [s].
    """

    smoothing: float = math.inf
    carry: bool = True
    blind: float = 1.0

    def see(
        self,
        before: Sensed,
        t_before: float,
        t: float,
        q: np.ndarray,
        v: np.ndarray,
        x: np.ndarray | None,
        x_time: float | None,
        kinematics: TaskKinematics,
    ) -> Sensed:
        """Return what is known at a sample, to which the kinematics are updated.

        Args:
            before: what was known at the sample before.
            t_before: time of that sample [s].
            t: time of this sample [s].
            q: (nq) its configuration.
            v: (n) its joint velocity [rad/s or m/s].
            x: measured coordinates, or None where none arrived.
            x_time: when they were taken [s]; None: t.
            kinematics: the estimated kinematics.

        Raises:
            MeasurementError: the frame was taken later than the sample.
            ImplausibleError: the last one is too old.
        """
        if not self.carry or before.x is None:
            x = before.x if x is None else x.copy()
            if x is None:
                return Sensed(q, v)
            return Sensed(q, v, x, kinematics.p_hat - x[: kinematics.positions], kinematics.X_k)
        frame, history = before.frame, before.history
        if frame is None:  # the sample before saw the frame itself
            history = ((t_before, before.q),)
            frame = self._frame(t_before, before.q, before.x, kinematics, None)
        history = (*history, (t, q))
        taken = t if x_time is None else x_time
        if x is not None and taken > frame.t + _SAME:
            if taken > t + _SAME:
                raise MeasurementError("x_time", x_time, f"is later than the sample's own, {t:g} s")
            history = _since(history, taken)
            q_c = _at(history, taken, kinematics)
            frame = self._frame(taken, q_c, x, kinematics, frame)
        elif t - frame.t > self.blind:
            raise ImplausibleError("x", None, f"has not been seen for {t - frame.t:.3g} s")
        moving = frame.X_k.dot(kinematics.a_k)
        x = kinematics.task.carried(kinematics.x_hat, moving + frame.b_smooth, frame.turn)
        return Sensed(q, v, x, moving + frame.b, frame.X_k, frame, history)

    def _frame(
        self,
        t: float,
        q: np.ndarray,
        x: np.ndarray,
        kinematics: TaskKinematics,
        before: Frame | None,
    ) -> Frame:
        """Return what a frame x, taken at time t [s] and configuration q (nq), tells."""
        task, a_k, (x_hat, X_k) = kinematics.task, kinematics.a_k, kinematics.at(q)
        moving = X_k.dot(a_k)
        b = task.position(x_hat) - task.position(x) - moving
        b_smooth, turn = b, task.turn(x_hat, x)
        if before is not None and math.isfinite(self.smoothing):
            rest = math.exp(-self.smoothing * (t - before.t))
            was = before.X_k.dot(a_k) + before.b_smooth
            b_smooth = rest * (was - moving) + (1.0 - rest) * b
            turn = task.turn_between(turn, before.turn, rest)
        return Frame(t, X_k, b, b_smooth, turn)


def _since(
    history: tuple[tuple[float, np.ndarray], ...], t: float
) -> tuple[tuple[float, np.ndarray], ...]:
    """Return the history from the last sample before or at time t [s]."""
    first = 0
    while first + 1 < len(history) and history[first + 1][0] <= t:
        first += 1
    return history[first:]


def _at(
    history: tuple[tuple[float, np.ndarray], ...], t: float, kinematics: TaskKinematics
) -> np.ndarray:
    """Return the configuration (nq) at time t [s], between the first two samples or the first."""
    t_0, q_0 = history[0]
    if t <= t_0 + _SAME or len(history) == 1:
        return q_0
    t_1, q_1 = history[1]
    return kinematics.between(q_0, q_1, (t - t_0) / (t_1 - t_0))
