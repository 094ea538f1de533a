"""The small records that flow between plant, trajectory and controller."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Measurement(NamedTuple):
    """What the sensors say at one sample.

    q, v, a and tau belong to the instant t; x, and xd with it, to ``x_time``, which is earlier
    where a camera is late.

    Attributes:
        t: time [s], on the clock that all measurements share.
        q: (nq) configuration, as ``pin.integrate`` has it.
        v: (nv) joint velocity [rad/s or m/s].
        x: task coordinates in world axes, from a camera or tracker, not from the model: (m) [m], or
            for a pose position [m] and unit quaternion xyzw (7), of either sign. None where there
            is none at this sample. A joint task has no use for it: there x is q.
        x_time: time of x [s]; None: t.
        xd: (m) task velocity [m/s], a pose's first three rows alone being read; needed only by the
            laws that say so.
        a: (nv) joint acceleration [rad/s^2 or m/s^2]; filtered from v when absent.
        tau: (nv) torque that the motors gave until now [N m or N], with what the arm adds by
            itself; read by the adaptations that predict the torque, which else take it to be what
            was commanded.
    """

    t: float
    q: np.ndarray
    v: np.ndarray
    x: np.ndarray | None = None
    x_time: float | None = None
    xd: np.ndarray | None = None
    a: np.ndarray | None = None
    tau: np.ndarray | None = None


class Desired(NamedTuple):
    """The desired task motion at one instant, in world axes.

    Attributes:
        x_d: (m) position [m], or for a pose position [m] and unit quaternion xyzw (7).
        xd_d: (m) velocity [m/s], linear before angular [rad/s].
        xdd_d: (m) acceleration [m/s^2], linear before angular [rad/s^2].
    """

    x_d: np.ndarray
    xd_d: np.ndarray
    xdd_d: np.ndarray
