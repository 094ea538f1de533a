"""What is drawn of a run: the true robot, the ghost of the believed one, paths, loads, a floor."""

from __future__ import annotations

import coal
import meshcat
import numpy as np
import pinocchio as pin
from meshcat.geometry import Sphere

from ..models.task_kinematics import TaskKinematics
from ..robot.robot import Robot
from ..robot.succession import Succession
from .figure import Figure
from .keyframes import Poses
from .motion import Motion
from .shapes import BELIEVED, BONES, DESIRED, LOAD, TRUE, ghost, solid, tube
from .window import Window

_HIDDEN = 1e-4  # scale of a load that is not there


class Scene:
    """True robots that follow each other, the believed one, and the point that they follow.

    The true robot is drawn in its own colours. The believed robot is a translucent ghost, visible
    where it differs. Each has a rod from its last joint to its tool. The desired path is green, the
    true tool and its path are red, loads are orange balls. All in world axes.
    """

    def __init__(
        self, window: Window, robots: Succession, kinematics: TaskKinematics, size: float
    ) -> None:
        """Draw everything that does not depend on the motion.

        Args:
            window: takes what is drawn.
            robots: the true robot, and what it becomes.
            kinematics: of the believed robot.
            size: half the larger side of the picture [m].
        """
        self.window, self.size, self.robots = window, size, robots
        self.root = meshcat.Visualizer(window=window)
        true, believed = robots.robots[0], kinematics.robot
        self._solid = Figure(self.root["true"], true, size)
        self._ghost = Figure(self.root["believed"], believed, size)
        visual = true.visual
        if visual is not None and len(visual.geometryObjects) > 0:
            self._solid.add_visuals(visual)
            self._ghost.share_visuals(self._solid, visual, window)
            self._ghost.stick_figure(ghost(), 0.01, _uncertain(true, kinematics))
        else:
            self._solid.stick_figure(solid(BONES), 0.025)
            self._ghost.stick_figure(ghost(), 0.025)
        self._solid.tool(solid(TRUE), 0.01)
        self._ghost.tool(ghost(0.6), 0.01)
        for number, robot in enumerate(robots.robots):
            self._solid.add_loads(number, robot.loads, ghost(0.6, LOAD))
        self._surroundings(_lowest(true))

    @property
    def legend(self) -> dict[str, int]:
        """Text -> colour of what there is."""
        legend = {
            "true tool and its path": TRUE,
            "believed tool, and robot where it differs": BELIEVED,
            "desired point and path": DESIRED,
        }
        return legend | ({"load": LOAD} if any(r.loads for r in self.robots.robots) else {})

    def place(self, t: np.ndarray, truth: Motion, belief: Motion, poses: Poses) -> None:
        """Move both robots, and show what the true one carries at the times t (F) [s]."""
        self._solid.place(truth, poses)
        self._ghost.place(belief, poses)
        carrying = self.robots.index(t)
        if len(self.robots.robots) > 1:
            for number in range(len(self.robots.robots)):
                shown = np.where(carrying == number, 1.0, _HIDDEN)[:, None]
                scale = np.repeat(shown, 3, axis=1)
                poses.move(self._solid.load(number), np.zeros((len(t), 3)), None, scale)

    def add_point(self) -> None:
        """Draw the desired point."""
        self.root["desired point"].set_object(Sphere(0.034 * self.size), ghost(0.5, DESIRED))

    def move_point(self, desired: np.ndarray, poses: Poses) -> None:
        """Move the desired point to (F, 3) [m]."""
        poses.move(self.root["desired point"], desired)

    def add_path(self, name: str, points: np.ndarray, colour: int, radius: float) -> None:
        """Draw a path (L, 3) [m], nothing of less than two points."""
        if len(points) > 1:
            self.root["paths"][name].set_object(tube(points, radius * self.size), solid(colour))

    def _surroundings(self, floor: float) -> None:
        """Draw a floor at a height [m], and the sky."""
        wanted = self.size / 8.0
        decade = 10.0 ** np.floor(np.log10(wanted))
        spacing = decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= wanted)
        # the viewer's own lines are 0.5 m apart
        grid = np.diag([2.0 * spacing, 2.0 * spacing, 1.0, 1.0])
        grid[2, 3] = floor
        self.root["/Grid"].set_transform(grid)
        self.root["/Grid/<object>"].set_property("color", [1.0, 1.0, 1.0, 0.35])
        self.root["/Axes"].set_property("visible", False)
        self.root["/Background"].set_property("top_color", [0.97, 0.98, 0.99])
        self.root["/Background"].set_property("bottom_color", [0.84, 0.87, 0.91])
        self.root["/Lights/AmbientLight/<object>"].set_property("intensity", 0.4)


def _uncertain(true: Robot, kinematics: TaskKinematics) -> list[int]:
    """Return the joints whose origin, seen from their parent, may not be where it truly is."""
    unknown = {part.joint for part in kinematics.translations if part.joint is not None}
    pairs = zip(true.model.jointPlacements, kinematics.robot.model.jointPlacements, strict=True)
    differ = {
        index
        for index, (ours, theirs) in enumerate(pairs)
        if np.abs(ours.translation - theirs.translation).max() > 1e-6
    }
    return sorted(unknown | differ)


def _lowest(robot: Robot) -> float:
    """Return the height of the lowest point of what is fixed to the world [m], of nothing zero."""
    shapes = [] if robot.visual is None else robot.visual.geometryObjects
    lowest = [_bottom(shape) for shape in shapes if shape.parentJoint == 0]
    return min(lowest, default=0.0)


def _bottom(shape: pin.GeometryObject) -> float:
    """Return the height of the lowest point of a mesh, or of the box around another shape [m]."""
    if isinstance(shape.geometry, coal.BVHModelBase):
        points = np.asarray(shape.geometry.vertices())
    else:
        shape.geometry.computeLocalAABB()
        box = shape.geometry.aabb_local
        points = np.array(np.meshgrid(*zip(box.min_, box.max_, strict=True))).reshape(3, -1).T
    return float((points @ shape.placement.rotation[2]).min() + shape.placement.translation[2])
