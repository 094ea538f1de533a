"""Kinematics of what sensors with unknown placements see: maps whose products are the parameters.

With phi(q) the position of the frame by the description and r_i = dp/da_i for the errors a of
unknown translations, each relative to its value at home, and a one at the end, all of them see y =
N phi(q) / (D phi(q)), the output map of ``linear_kinematics``. For a camera N and D are its
projection (3, 4) times (1, a); its scale is free, so the last entry of D is one and depths are
relative to that at home. For a tracker with the rotation R_c, N = (R_c, a_1 R_c, ..., a_k R_c,
x_home), and D phi is one. The products are the parameters: y is linear in N, so no rotation is
parametrised, and N phi - y D phi = 0 is linear in both, so that with the *measured* y the
prediction error is linear in the errors of N and D, exactly, however wrong they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..robot.robot import Robot
from .linear_kinematics import OFF, LinearKinematics, stacked, translated
from .translations import Words, unknown_translations


class ProjectedKinematics(LinearKinematics):
    """The estimated coordinates y = N phi(q) / (D phi(q)) of the task frame.

    The parameters are the rows of N (m_p, 4 + 3 k), then of each camera that of D without its last
    entry. For a pose a constant rotation between frame and marker has no effect.

    Attributes:
        nominal: (k) the described translations [m].
    """

    calibrated = False

    def _project(self, robot: Robot, unknown: Words, camera: Sequence[int]) -> None:
        """Take a nominal robot, its unknown translations, and the camera of each row, if any."""
        self._take(robot, robot.frame_task, unknown)
        self.translations = unknown_translations(robot, unknown)
        columns = stacked(translated(robot, self.translations))
        self.nominal = columns.initial
        self._camera = np.array(camera, dtype=int)
        of = [f"{name}_{axis}" for name in ("base", *columns.names) for axis in "xyz"]
        deep = ["depth", "depth_2"][: len(set(camera))]
        rows = self.task.labels[: self.positions]
        self.names = (
            *(f"{row}({name})" for row in rows for name in (*of, "home")),
            *(f"{row}({name})" for row in deep for name in of),
        )
        self.size = len(self.names)
        self._shape = (self.positions, len(of) + 1)
        self._below = (len(deep), len(of))
        self._split = self.positions * self._shape[1]
        small = np.repeat([1.0, OFF * robot.reach], [3, len(of) - 2])
        self.sizes = np.tile(small, self.positions)
        entries = [(j, 0, *at) for j, at in enumerate(np.ndindex(self._shape))]
        for i, c in np.ndindex(len(camera), len(of)):
            entries.append((self._split + camera[i] * len(of) + c, 1, i, c))
        self._observe(columns, np.zeros(self._shape), np.array(entries))
        self._now.update(np.zeros(self.size), robot.q0, self._still)
        self._home = self._now.motion[0, : len(of), -1].copy()
        for chain in (self._now, self._past):
            chain.columns[6:] = self._home.reshape(-1, 3).T

    def _rows_of(self, H: np.ndarray, factors: np.ndarray) -> np.ndarray:
        """Return the rows (., 4 + 3 k) of N that are rows H (., 4) of a map of positions.

        They are linear in H and in the factors (1 + k) of p and of the r_i.
        """
        blocks = np.kron(factors, H[:, :3])
        return np.column_stack([blocks, H[:, 3] + blocks.dot(self._home)])

    def _factors(self, translations: np.ndarray) -> np.ndarray:
        """Return one and the errors of translations (k) [m]."""
        return np.append(1.0, translations - self.nominal)

    def standing_at(self, y: np.ndarray) -> np.ndarray:
        """Return the parameters (p) of coordinates that stay at y (m_p), however the arm moves."""
        found = np.zeros(self.size)
        found[: self._split].reshape(self._shape)[:, -1] = y
        return found

    def initial_at(self, q: np.ndarray, x: Any) -> np.ndarray:
        """Return the estimate (p) to start from: as described, with the position measured.

        Args:
            q: (nq) measured.
            x: measured coordinates, which the first sample has.
        """
        m = self.positions
        self.update(self.initial, q, self._still)
        return self.initial + self.standing_at((x[:m] - self.p_hat) * self._now.z[:m])


def nearest_rotation(B: np.ndarray) -> np.ndarray:
    """Return the nearest rotation to B (3, 3), in which one row may be unknown and zero."""
    U, _, V = np.linalg.svd(B)
    U[:, -1] *= np.sign(np.linalg.det(U @ V))
    return U @ V
