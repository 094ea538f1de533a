"""What a law states of its linearised closed loop, for default rates and the check before a run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Feedback(NamedTuple):
    """The feedback of a law at one state: d^2 x/dt^2 = -S x - (D + N) dx/dt.

    x is the task error, or the joints' in coordinates of unit mass, M^1/2 v, as the law has it.

    Attributes:
        S: stiffness [1/s^2].
        D: damping [1/s].
        N: damping that no gain changes, such as the posture's [1/s].
        E: damping of the error that drives the adaptation [1/s].
    """

    S: np.ndarray
    D: np.ndarray
    N: np.ndarray
    E: np.ndarray


class SetPointLoop(NamedTuple):
    """A law at rest in a set point, moved from there by dq: tau = g - stiffness dq - damping qd.

    Attributes:
        stiffness: (n, n) [N m/rad or N/m], not symmetric where the believed Jacobian is wrong.
        damping: (n, n) [N m s/rad or N s/m].
        drive: (n, n) dy/dq of the error y that drives the estimate with qd [1/s].
    """

    stiffness: np.ndarray
    damping: np.ndarray
    drive: np.ndarray


class KinematicLoop(NamedTuple):
    """How the kinematic estimate couples with the task error: de/dt = -damping e + w a, and back.

    Attributes:
        stiffness: k with w^2 = k eig(Y_p Gamma_k Y_p^T).
        damping: [1/s].
        weight: (m_p, m_p) R_k, by which the prediction error decays.
    """

    stiffness: float
    damping: float
    weight: np.ndarray
