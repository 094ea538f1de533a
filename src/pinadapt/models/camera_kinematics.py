"""Kinematics of the picture of the task frame in fixed cameras, whose projections are unknown.

A camera sees the frame at y = (N phi(q)) / z with the depth z = D phi(q), in the notation of
``projected_kinematics``: the unknown projection (3, 4) times the unknown translations.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .._checks import instance
from ..exceptions import RobotError
from ..robot.robot import Robot
from ..tasks.frame import ImageTask
from .linear_kinematics import BOUND
from .projected_kinematics import ProjectedKinematics
from .translations import Words

CAMERA = "camera"
# of 1 / reach: change of the relative depth by a motion [1/m]; half: last errors of a SCARA 1.2 to
# 2.1 times as large; twice: 0.9 times, and the largest of a UR5 1.4 times
_NEAR = 0.5
# reaches: bounds of the picture at home, from a corner of the image or elsewhere; half, twice: the
# same
_FAR = 100.0


class CameraKinematics(ProjectedKinematics):
    """The estimated kinematics of a picture, y = N phi(q) / (D phi(q)).

    A picture does not separate a translation from the camera's scale, so none is written or read.

    C. C. Cheah, C. Liu, J.-J. E. Slotine, *Adaptive Jacobian vision based control for robots with
    uncertain depth information*, Automatica 46 (2010) 1228-1233; H. Wang, *Adaptive visual tracking
    for robotic systems without image-space velocity measurement*, Automatica 55 (2015) 294-301.
    """

    task: ImageTask
    affine = False

    def __init__(self, robot: Robot, unknown: Words = ()) -> None:
        """Choose the unknown translations of a nominal robot, as ``unknown_translations``.

        Raises:
            ParameterError, RobotError: as ``unknown_translations``.
        """
        task = instance(robot.frame_task, ImageTask, "robot.task", RobotError)
        self._project(robot, unknown, [camera for camera, _ in task.picks])
        self.initial = self.parameters(self.task, self.nominal)
        deep = self.sizes[: self._below[1]] * _NEAR / robot.reach
        self.sizes = np.concatenate([self.sizes, np.tile(deep, self._below[0])])
        wide = BOUND * self.sizes
        wide[: self._split].reshape(self._shape)[:, -1] = _FAR * robot.reach
        self.bounds = np.array([self.initial - wide, self.initial + wide])

    def parameters(self, task: ImageTask, translations: np.ndarray) -> np.ndarray:
        """Return the parameters (p) of the cameras of a task and of translations (k) [m]."""
        factors = self._factors(translations)
        above, below = (self._rows_of(H, factors) for H in task.projections)
        depth = below[:, -1:]
        first = np.unique(self._camera, return_index=True)[1]
        return np.concatenate([(above / depth).ravel(), (below / depth)[first, :-1].ravel()])

    def _described(self, robot: Robot) -> np.ndarray:
        """Return the parameters (p) of the cameras of a robot, as ``Robot.filmed_by`` gives."""
        task: Any = robot.task
        return self.parameters(task, self.nominal + self.displacement(robot.model))

    def seen(self, a_k: np.ndarray) -> Robot:
        """Return the nominal robot with the cameras of an estimate a_k (p)."""
        self._past.update(a_k, self.robot.q0, self._still)
        cameras = np.zeros((self._below[0], 3, 4))
        places = [row for _, row in self.task.picks], [2] * self.positions
        for rows, place in zip(self._past.maps, places, strict=True):
            translation = rows[:, -1] - rows[:, :3].dot(self._home[:3])
            cameras[self._camera, place] = np.column_stack([rows[:, :3], translation])
        task = ImageTask.seen_by(self.task, list(cameras), self.task.pixel)
        return replace(self.robot, task=task)
