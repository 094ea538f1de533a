"""The translations that measured positions tell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..models.task_kinematics import TaskKinematics
from ..rollout.information import Information
from .frames import Frames
from .motion import Motion

_KNOWN = 0.5  # of the reach, to which a description is taken to be known
_START, _FLOOR = 1e-2, 1e-9  # noise at first and at least, as a share of the reach
_ROUNDS = 3


class PositionRows(NamedTuple):
    """What M frames tell: r = W (a - a_0), a_0 the description's translations.

    Attributes:
        t: (M) times [s].
        W: (M, m, p) dx/da.
        r: (M, m) measured less described positions [m].
    """

    t: np.ndarray
    W: np.ndarray
    r: np.ndarray

    def split(self, t: float) -> tuple[PositionRows, PositionRows]:
        """Return the rows before a time [s], and those from it on."""
        first = self.t < t
        return tuple(  # type: ignore[return-value]
            PositionRows(self.t[part], self.W[part], self.r[part]) for part in (first, ~first)
        )


def position_rows(kinematics: TaskKinematics, motion: Motion, frames: Frames) -> PositionRows:
    """Return the rows of all frames within a motion, at the configuration of each one's time."""
    still, t, W, r = np.zeros(kinematics.nv), [], [], []
    m, p = kinematics.positions, kinematics.size
    for time, x in zip(frames.t, frames.x, strict=True):
        if not (p and motion.t[0] <= time <= motion.t[-1]):
            continue
        k = min(max(int(np.searchsorted(motion.t, time)) - 1, 0), len(motion.t) - 2)
        share = (time - motion.t[k]) / (motion.t[k + 1] - motion.t[k])
        q = kinematics.between(motion.q[k], motion.q[k + 1], float(share))
        kinematics.update(kinematics.initial, q, still)
        believed, X_k = kinematics.prediction()
        t.append(time)
        W.append(X_k)
        r.append(x[:m] - believed)
    count = len(t)
    rows = np.array(W).reshape(count, m, p), np.array(r).reshape(count, m)
    return PositionRows(np.array(t), *rows)


def position_fit(kinematics: TaskKinematics, rows: PositionRows) -> Information:
    """Return the least-squares estimate of all translations, and what is known of it.

    x is linear in them. What the motion does not tell stays as described: the description counts as
    known to half the reach, in every direction alike, so no axes matter.
    """
    m, p, reach = kinematics.positions, kinematics.size, kinematics.robot.reach
    noise, moved = np.full(m, _START * reach), np.zeros(p)
    prior = np.eye(p) / (_KNOWN * reach) ** 2
    for _ in range(_ROUNDS if len(rows.t) else 0):
        A, b = _whitened(rows, noise)
        moved = np.linalg.solve(A.T @ A + prior, A.T @ b)
        spread = np.sqrt(np.mean((rows.r - rows.W @ moved) ** 2, axis=0))
        noise = np.maximum(spread, _FLOOR * reach)
    A, b = _whitened(rows, noise)
    pull = A.T @ (b - A @ moved)
    estimate = kinematics.initial + moved
    return Information(tuple(kinematics.names), estimate, A.T @ A, pull, noise, b.size)


def _whitened(rows: PositionRows, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (M m, p) and right-hand side (M m) in units of the noise (m)."""
    size, p = rows.r.size, rows.W.shape[-1]
    return (rows.W / noise[:, None]).reshape(size, p), (rows.r / noise).ravel()
