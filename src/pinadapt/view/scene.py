"""What is drawn of a run: true robot, ghost of the estimated one, paths, loads, and a floor."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import coal
import meshcat
import numpy as np
import pinocchio as pin
from meshcat.geometry import Cylinder, Material, Sphere

from ..description.chain import configuration_from_angles
from ..models.task_kinematics import TaskKinematics
from ..robot.robot import Robot, Succession
from ..tasks.frame import FrameTask, ImageTask
from .drawing import (
    BONES,
    DESIRED,
    ESTIMATED,
    LOAD,
    TRUE,
    Node,
    Poses,
    Window,
    draw_shapes,
    ghost,
    rod,
    scaled_placement,
    solid,
    tube,
)


@dataclass(frozen=True, eq=False)
class ChainMotion:
    """Where a chain of n joints is at F moments.

    Attributes:
        joints: (F, n + 1, 4, 4) placements of the universe and the joints [m], world axes.
        origins: (F, n + 1, 3) origin of each joint [m], in the axes of its parent joint.
        tool: (F, 3) origin of the task frame [m], in the axes of the joint that carries it.
        parents: (n + 1) parent joint of each joint.
        last: index of the joint that carries the tool.
    """

    joints: np.ndarray
    origins: np.ndarray
    tool: np.ndarray
    parents: tuple[int, ...]
    last: int

    @property
    def tip(self) -> np.ndarray:
        """The task frame's origin (F, 3) [m], world axes."""
        carrier = self.joints[:, self.last]
        return np.einsum("fij,fj->fi", carrier[:, :3, :3], self.tool) + carrier[:, :3, 3]

    @property
    def points(self) -> np.ndarray:
        """All joint origins and tips (F (n + 2), 3) [m], world axes."""
        return np.vstack([self.joints[:, :, :3, 3].reshape(-1, 3), self.tip])


def motion_of(
    robot: Robot,
    q: np.ndarray,
    kinematics: TaskKinematics | None = None,
    a_k: np.ndarray | None = None,
) -> ChainMotion:
    """Return where the joints of a robot are at configurations q, in the axes of its base.

    The robot is not changed.

    Args:
        robot: the robot.
        q: (F, nq) configurations.
        kinematics: has the unknown translations of this robot; None: it has none.
        a_k: (F, p) their values at each moment [m]; None: those of the description.
    """
    robot = robot.in_base_axes
    model = robot.model.copy()
    data = model.createData()
    frame = model.frames[robot.frame_id]
    joints, origins, tool = [], [], []
    for k, configuration in enumerate(q):
        if a_k is not None and kinematics is not None:
            kinematics.write(model, a_k[k])
        pin.forwardKinematics(model, data, configuration)
        joints.append([placement.homogeneous for placement in data.oMi])
        origins.append([placement.translation.copy() for placement in data.liMi])
        tool.append(frame.placement.translation.copy())
    parents = tuple(int(parent) for parent in model.parents)
    return ChainMotion(
        np.array(joints), np.array(origins), np.array(tool), parents, int(frame.parentJoint)
    )


def motion_in_time(robots: Succession, t: np.ndarray, q: np.ndarray) -> ChainMotion:
    """Return where the joints of a robot that changes are, at q (F, nq) and times t (F) [s]."""
    which = robots.index(t)
    motions = [motion_of(robots.robots[k], q[which == k]) for k in np.unique(which)]
    parts = zip(*((motion.joints, motion.origins, motion.tool) for motion in motions), strict=True)
    joints, origins, tool = (np.concatenate(part) for part in parts)
    return replace(motions[0], joints=joints, origins=origins, tool=tool)


def desired_tip(true: Robot, x_d: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Return the desired positions of the tool (L, 3) [m], in the axes of the robot's base.

    Args:
        true: the robot; x_d are coordinates of its task.
        x_d: (L, .) desired coordinates.
        tip: (L, 3) or (3) actual positions of the tool [m] in the same axes, for coordinates
            outside of the task.
    """
    if isinstance(true.task, ImageTask):
        tips = np.broadcast_to(tip, (len(x_d), 3))
        return np.array([true.task.nearest(*each) for each in zip(tips, x_d, strict=True)])
    if isinstance(true.task, FrameTask):
        path, tracker = np.array(np.broadcast_to(tip, (len(x_d), 3))), true.tracker
        if tracker is not None:
            path = path @ tracker.rotation.T + tracker.translation
        path[:, true.task.place] = x_d[:, : true.task.positions]
        return path if tracker is None else (path - tracker.translation) @ tracker.rotation
    return motion_of(true, np.array([configuration_from_angles(true.model, x) for x in x_d])).tip


def estimated_axes(true: Robot, kinematics: TaskKinematics, a_k: np.ndarray) -> np.ndarray | None:
    """Return by which placements (F, 4, 4) a controller errs about the tracker; None without one.

    A point that the tracker sees at one place of the base's axes seems to the controller to be at
    that place moved by the placement. The placement is the identity for a tracker that is known.

    Args:
        true: the robot.
        kinematics: of the controller.
        a_k: (F, p) estimates.
    """
    if kinematics.calibrated or not kinematics.affine:
        return None
    true_placement = pin.SE3.Identity() if true.tracker is None else true.tracker
    placements = []
    for estimate in a_k:
        tracker = kinematics.seen(estimate).tracker
        assert tracker is not None
        placements.append((tracker.inverse() * true_placement).homogeneous)
    return np.array(placements)


_STEEL = 7850.0  # [kg/m^3]


class DrawnRobot:
    """One robot in the scene, below one node: its shapes are added once and then moved.

    Attributes:
        node: the robot's root in the scene.
        robot: the robot.
        size: length of the scene that thicknesses are multiplied by [m].
    """

    def __init__(self, node: Node, robot: Robot, size: float) -> None:
        """Take the root node, the robot, and the size of the scene [m]; draw nothing yet."""
        self.node, self.robot, self.size = node, robot, size
        self._last = int(robot.model.frames[robot.frame_id].parentJoint)
        self._rods: list[tuple[Node, int | None, float]] = []

    def joint(self, index: int) -> Node:
        """Return the node that moves with a joint; joint 0 is the base."""
        return self.node[f"joint {index}"]

    def place(self, motion: ChainMotion, poses: Poses) -> None:
        """Move all nodes to their places in a motion."""
        for index in range(motion.joints.shape[1]):
            poses.move_rigidly(self.joint(index), motion.joints[:, index])
        for node, end, radius in self._rods:
            ends = motion.tool if end is None else motion.origins[:, end]
            poses.move(node, *rod(ends, radius))
        poses.move(self.joint(self._last)["tip"], motion.tool)

    def add_visuals(self, visual: pin.GeometryModel) -> None:
        """Draw the shapes of the description in their own colours."""
        draw_shapes(self.node, visual, self.robot.model)

    def share_visuals(self, other: DrawnRobot, visual: pin.GeometryModel, window: Window) -> None:
        """Draw the shapes of another robot as a ghost; the page stores them only once."""
        for index, shape in enumerate(visual.geometryObjects):
            place = self._shape(index, shape)
            place.set_transform(scaled_placement(shape))
            window.copy(other._shape(index, shape), place, as_ghost=True)

    def stick_figure(
        self, material: Material, thickness: float, joints: Iterable[int] | None = None
    ) -> None:
        """Draw a sphere at each joint, and a rod to it from its parent; None: at all joints."""
        ball = Sphere(1.6 * thickness * self.size)
        parents = [int(parent) for parent in self.robot.model.parents]
        for index in range(len(parents)) if joints is None else joints:
            self.joint(index)["ball"].set_object(ball, material)
            if index:
                self._rod(self.joint(parents[index])[f"rod {index}"], index, material, thickness)

    def tool(self, material: Material, thickness: float) -> None:
        """Draw a rod from the last joint to the tool, and a sphere at the tool."""
        carrier = self.joint(self._last)
        self._rod(carrier["tool"], None, material, thickness)
        carrier["tip"].set_object(Sphere(2.4 * thickness * self.size), material)

    def load(self, number: int) -> Node:
        """Return the node of the loads of the robot of this number in the succession."""
        return self.joint(self._last)[f"load {number}"]

    def add_loads(self, number: int, loads: Iterable[pin.Inertia], material: Material) -> None:
        """Draw each load (in axes of the last joint) as a steel ball of the same mass."""
        for k, load in enumerate(loads):
            ball = self.load(number)[f"{k}"]
            ball.set_object(Sphere(float(np.cbrt(0.75 / np.pi * load.mass / _STEEL))), material)
            place = np.eye(4)
            place[:3, 3] = load.lever
            ball.set_transform(place)

    def _shape(self, number: int, shape: pin.GeometryObject) -> Node:
        return self.joint(int(shape.parentJoint))[f"shape {number}"]

    def _rod(self, node: Node, index: int | None, material: Material, thickness: float) -> None:
        node.set_object(Cylinder(1.0), material)
        self._rods.append((node, index, thickness * self.size))


_HIDDEN = 1e-4  # scale of a load that is not carried at the moment


class Scene:
    """The true robot, the estimated one, and the desired point with its path.

    The true robot, which may change during the run, has its own colours. The estimated robot is a
    translucent ghost, visible where it differs. Each has a rod from its last joint to its tool. The
    desired path is green, the true tool and its path are red, loads are orange balls. All lengths
    are in the axes of the robot's base. Where the axes of x are unknown (a tracker), the blue path
    is the desired one where the controller takes it to be.
    """

    def __init__(
        self, window: Window, robots: Succession, kinematics: TaskKinematics, size: float
    ) -> None:
        """Draw everything that does not depend on the motion.

        Args:
            window: receives what is drawn.
            robots: the true robot, and what it changes to.
            kinematics: of the estimated robot.
            size: half the larger side of the picture [m].
        """
        self.window, self.size, self.robots = window, size, robots
        self.root = meshcat.Visualizer(window=window)
        true, estimated = robots.robots[0], kinematics.robot
        self._solid = DrawnRobot(self.root["true"], true, size)
        self._ghost = DrawnRobot(self.root["estimated"], estimated, size)
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
        """Text -> colour, for what is drawn."""
        legend = {
            "true tool and its path": TRUE,
            "estimated tool, and robot where it differs": ESTIMATED,
            "desired point and path": DESIRED,
        }
        return legend | ({"load": LOAD} if any(r.loads for r in self.robots.robots) else {})

    def place(
        self, t: np.ndarray, truth: ChainMotion, estimated: ChainMotion, poses: Poses
    ) -> None:
        """Move both robots, and show the loads of the true one at the times t (F) [s]."""
        self._solid.place(truth, poses)
        self._ghost.place(estimated, poses)
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

    def add_estimated_path(self, points: np.ndarray, radius: float) -> None:
        """Draw the desired path (L, 3) [m] a second time, where the controller estimates it."""
        if len(points) > 1:
            material = ghost(0.7, ESTIMATED)
            self.root["estimated path"].set_object(tube(points, radius * self.size), material)

    def move_estimated_path(self, placements: np.ndarray, poses: Poses) -> None:
        """Move the path of ``add_estimated_path`` by placements (F, 4, 4) of ``estimated_axes``."""
        poses.move_rigidly(self.root["estimated path"], placements)

    def add_path(self, name: str, points: np.ndarray, colour: int, radius: float) -> None:
        """Draw a path (L, 3) [m]; fewer than two points are not drawn."""
        if len(points) > 1:
            self.root["paths"][name].set_object(tube(points, radius * self.size), solid(colour))

    def _surroundings(self, floor: float) -> None:
        """Draw a floor at this height [m], and the background."""
        wanted = self.size / 8.0
        decade = 10.0 ** np.floor(np.log10(wanted))
        spacing = decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= wanted)
        # the viewer draws its lines 0.5 m apart
        grid = np.diag([2.0 * spacing, 2.0 * spacing, 1.0, 1.0])
        grid[2, 3] = floor
        self.root["/Grid"].set_transform(grid)
        self.root["/Grid/<object>"].set_property("color", [1.0, 1.0, 1.0, 0.35])
        self.root["/Axes"].set_property("visible", False)
        self.root["/Background"].set_property("top_color", [0.97, 0.98, 0.99])
        self.root["/Background"].set_property("bottom_color", [0.84, 0.87, 0.91])
        self.root["/Lights/AmbientLight/<object>"].set_property("intensity", 0.4)


def _uncertain(true: Robot, kinematics: TaskKinematics) -> list[int]:
    """Return the joints whose estimated origin in the parent's axes may differ from the true."""
    unknown = {part.joint for part in kinematics.translations if part.joint is not None}
    pairs = zip(true.model.jointPlacements, kinematics.robot.model.jointPlacements, strict=True)
    differ = {
        index
        for index, (ours, theirs) in enumerate(pairs)
        if np.abs(ours.translation - theirs.translation).max() > 1e-6
    }
    return sorted(unknown | differ)


def _lowest(robot: Robot) -> float:
    """Return the height of the lowest point of the base's shapes [m], zero without any."""
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
