"""What is drawn of a run: true robot, ghost of the estimated one, paths, loads, and a floor."""

from __future__ import annotations

from collections.abc import Sequence

import meshcat
import numpy as np
import pinocchio as pin
from meshcat.geometry import Cylinder, Material, Sphere
from meshcat.transformations import translation_matrix
from scipy.spatial.transform import Rotation

from .._output import Record, as_json
from ..controller.controller import Controller
from ..controller.state import Sample
from ..models.task_kinematics import TaskKinematics
from ..robot.robot import Robot, Succession
from ..tasks.frame import ImageTask
from ..tasks.task import JointTask
from .contacts import HIDDEN, DrawnContacts, chosen_forces
from .drawing import (
    Colour,
    Keyframes,
    Node,
    Window,
    draw_shapes,
    ghost,
    overlay,
    rod,
    solid,
    tube,
)

RATE = 30.0  # [1/s] frames; half or twice: a jerky robot, or a browser that falls behind


def motion_of(
    robot: Robot,
    q: np.ndarray,
    kinematics: TaskKinematics | None = None,
    a_k: np.ndarray | None = None,
) -> np.ndarray:
    """Return where a robot of n joints and k task frames is at configurations q.

    That is a motion (F, n + 1 + k, 4, 4): placements of the base, the joints and the task frames in
    the axes of the base [m]. The robot is not changed.

    Args:
        robot: the robot.
        q: (F, nq) configurations.
        kinematics: has the unknown translations of this robot; None: it has none.
        a_k: (F, p) their values at each moment [m]; None: those of the description.
    """
    robot = robot.in_base_axes
    model = robot.model.copy()
    motion = []
    data = model.createData()
    ends = robot.frame_ids
    for k, configuration in enumerate(q):
        if a_k is not None and kinematics is not None:
            kinematics.write(model, a_k[k])
        pin.framesForwardKinematics(model, data, configuration)
        placements = [*data.oMi, *(data.oMf[end] for end in ends)]
        motion.append([placement.homogeneous for placement in placements])
    return np.array(motion)


def motion_in_time(robots: Succession, t: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the motion of a robot that changes, at q (F, nq) and times t (F) [s]."""
    which = robots.index(t)
    return np.concatenate([motion_of(robots.robots[k], q[which == k]) for k in np.unique(which)])


def tips_of(robot: Robot, motion: np.ndarray) -> np.ndarray:
    """Return the origins (F, k, 3) of the task frames in a motion of a robot [m]."""
    return motion[:, robot.model.njoints :, :3, 3]


def desired_tips(true: Robot, x_d: np.ndarray, tips: np.ndarray) -> np.ndarray:
    """Return the desired positions of the tools (L, k, 3) [m], in the axes of the robot's base.

    Args:
        true: the robot; x_d are coordinates of its task.
        x_d: (L, .) desired coordinates.
        tips: (L, k, 3) or (1, k, 3) actual positions of the tools [m] in the same axes, for
            coordinates outside of the task.
    """
    task = true.task
    tracker = true.tracker or pin.SE3.Identity()
    if isinstance(task, JointTask):
        return tips_of(true, motion_of(true, np.array([true.configuration(x) for x in x_d])))
    path = np.broadcast_to(tips, (len(x_d), *tips.shape[1:]))
    if isinstance(task, ImageTask):
        nearest = [[task.nearest(*each)] for each in zip(path[:, 0], x_d, strict=True)]
        return np.array(nearest)
    path = path @ tracker.rotation.T + tracker.translation
    place = true.of_frame(true.frames[0]).frame_task.place
    path[..., place] = x_d[:, : task.positions].reshape(*path.shape[:2], -1)
    return (path - tracker.translation) @ tracker.rotation


def viewpoint(points: np.ndarray, path: np.ndarray) -> dict[str, list[float]]:
    """Return a view from where the path is, somewhat from the side and from above.

    ``target`` is the centre of the box that is in the picture [m], ``direction`` the unit vector
    from there towards the eye, in world axes, and ``box`` half the box's extent to the right,
    upwards and towards the eye [m].

    Args:
        points: (N, 3) points that must be in the picture [m].
        path: (M, 3) the tools' paths [m].
    """
    azimuth = np.arctan2(*path.mean(axis=0)[1::-1]) - np.radians(35.0)
    towards = Rotation.from_euler("ZY", [azimuth, -np.radians(30.0)]).as_matrix()
    axes = towards[:, [1, 2, 0]]  # right, upwards, towards the eye
    seen = points @ axes
    half = 0.5 * np.ptp(seen, axis=0)
    box = half + 0.3 * max(half.max(), 1e-3)  # bodies extend beyond the joints' origins
    target = axes @ (seen.min(axis=0) + half)
    return {"target": target.tolist(), "direction": axes[:, 2].tolist(), "box": box.tolist()}


class DrawnRobot:
    """One robot in the scene, below one node: its shapes are added once and then moved.

    Attributes:
        node: the robot's root in the scene.
        robot: the robot.
        size: length of the scene that thicknesses are multiplied by [m].
        loads: number of a robot in the succession, and the node of its loads at a joint.
    """

    def __init__(self, node: Node, robot: Robot, size: float, tip: Material) -> None:
        """Draw a ball at each tip.

        Args:
            node: root of the robot.
            robot: the robot.
            size: of the scene [m].
            tip: material of the balls.
        """
        self.node = node
        self.robot = robot
        self.size = size
        self._bones: list[tuple[int, int]] = []  # their ends in a motion
        self.loads: list[tuple[int, Node]] = []
        self._tips = _nodes(node, "tip", robot)
        for end in self._tips:
            end.set_object(Sphere(0.024 * size), tip)

    def place(self, motion: np.ndarray, poses: Keyframes) -> None:
        """Move all nodes to their places in a motion."""
        points = motion[:, :, :3, 3].swapaxes(0, 1)
        joints = self.robot.model.njoints
        for index in range(joints):
            poses.move(
                self.node[f"joint {index}"],
                points[index],
                Rotation.from_matrix(motion[:, index, :3, :3]),
            )
        for end, start in self._bones:
            poses.move(self.node[f"rod {end}"], *rod(points[start], points[end], 0.025 * self.size))
        for node, tip in zip(self._tips, points[joints:], strict=True):
            poses.move(node, tip)

    def stick_figure(self, material: Material) -> None:
        """Draw a ball at each joint, and a rod to it from the joint before; to the tips too."""
        model = self.robot.model
        tips = [model.frames[frame].parentJoint for frame in self.robot.frame_ids]
        _, *self._bones = enumerate([*model.parents, *tips])  # none ends at the base
        for joint in range(model.njoints):
            self.node[f"joint {joint}"]["ball"].set_object(Sphere(0.04 * self.size), material)
        for end, _ in self._bones:
            self.node[f"rod {end}"].set_object(Cylinder(1.0), material)

    def add_loads(self, number: int, robot: Robot) -> None:
        """Draw each load of the robot of this number in the succession as a ball of steel."""
        for k, (joint, load) in enumerate(robot.loads):
            node = self.node[f"joint {joint}"][f"load {number}"]
            radius = np.cbrt(0.75 / np.pi * load.mass / 7850.0)  # of steel [kg/m^3]
            node[f"{k}"].set_object(Sphere(radius), ghost(0.6, Colour.LOAD))
            node[f"{k}"].set_transform(translation_matrix(load.lever))
            self.loads.append((number, node))


def _nodes(root: Node, name: str, robot: Robot) -> list[Node]:
    """Return the nodes of what each task frame has; numbers begin with the second."""
    return [root[f"{name} {k + 1}" if k else name] for k in range(len(robot.frames))]


class Scene:
    """The true robot, the estimated one, and the desired point with its path.

    The true robot, which may change during the run, has its own colours. The estimated robot is a
    translucent ghost, visible where it differs. Each has a ball at its tips, the task frames. The
    desired path is a wide translucent green one, with the path of the true tip in red inside; loads
    are orange balls. Contacts have friction cones, and spikes for the forces that the controller
    chose. All lengths are in the axes of the robot's base.

    Attributes:
        window: that holds the messages.
        root: node of the scene.
        viewpoint: where it is seen from, see the function of this name.
        size: half the larger side of the picture [m].
        true: the true robot at first.
        robots: that one, and what it changes to.
        controller: that estimates.
        poses: moves the nodes.
        traced: (L, k, 3) paths of the true tips [m].
    """

    def __init__(
        self,
        robots: Succession,
        controller: Controller,
        t: np.ndarray,
        q: np.ndarray,
        x_d: np.ndarray,
        moments: np.ndarray,
    ) -> None:
        """Draw everything that does not move, and what moves where it is at first.

        Args:
            robots: the true robot, and what it changes to.
            controller: that estimates.
            t: (L) times of the run [s].
            q: (L, nq) configurations that must be in the picture, or (1, nq) the first.
            x_d: (L, .) desired task coordinates.
            moments: (F) that are shown [s].
        """
        self.window = Window()
        self.poses = Keyframes(moments)
        self.root = meshcat.Visualizer(window=self.window)
        self.robots = robots
        self.controller = controller
        self.true = true = robots.robots[0]
        motion = motion_in_time(robots, t[: len(q)], q)
        self.traced = tips_of(true, motion)
        path = desired_tips(true, x_d, self.traced)
        way = path.reshape(-1, 3)
        self.viewpoint = viewpoint(np.vstack([motion[:, :, :3, 3].reshape(-1, 3), way]), way)
        self.size = size = max(self.viewpoint["box"][:2])
        mark = overlay if true.contacts else ghost  # the trunk hides its frame
        self._trace = overlay(1.0, Colour.TRUE) if true.contacts else solid(Colour.TRUE)
        self._solid = DrawnRobot(self.root["true"], true, size, self._trace)
        kinematics = controller.kinematics
        self._ghost = DrawnRobot(self.root["estimated"], kinematics.robot, size, ghost(0.6))
        if true.visual is not None and true.visual.ngeoms:
            draw_shapes(self._solid.node, self._ghost.node, true.visual, true.model)
        else:
            self._solid.stick_figure(solid(Colour.BONES))
            self._ghost.stick_figure(ghost())
        for number, robot in enumerate(robots.robots):
            self._solid.add_loads(number, robot)
        self._contacts = DrawnContacts(self.root["contacts"], true, size)
        self.add_paths("desired", path, 0.012, mark(0.4, Colour.DESIRED))
        self._points = _nodes(self.root, "desired point", true)
        for point in self._points:
            point.set_object(Sphere(0.034 * size), mark(0.5, Colour.DESIRED))
        values = [kinematics.value(robot) for robot in robots.robots]
        known = kinematics.calibrated and all(value is not None for value in values)
        self._truths = values if known and kinematics.size else []
        floor = min(0.0, motion_of(true, true.q0[None])[:, :, 2, 3].min())
        self.root["/Grid"].set_transform(translation_matrix([0.0, 0.0, floor]))
        self.root["/Grid/<object>"].set_property("color", [1.0, 1.0, 1.0, 0.35])
        self.root["/Axes"].set_property("visible", False)
        for end in ("top_color", "bottom_color"):
            self.root["/Background"].set_property(end, [0.93, 0.94, 0.96])

    @property
    def legend(self) -> dict[str, Colour]:
        """Text -> colour, for what is drawn."""
        legend = {
            "true tip and its path": Colour.TRUE,
            "estimated tip, and robot where it differs": Colour.ESTIMATED,
            "desired point and path": Colour.DESIRED,
        }
        if self.true.contacts:
            legend |= {"chosen contact force": Colour.FORCE, "friction cone": Colour.CONE}
        return legend | ({"load": Colour.LOAD} if any(r.loads for r in self.robots.robots) else {})

    def show(self, samples: Sequence[Sample]) -> np.ndarray:
        """Move everything to F samples, note the curves, and return the true tips (F, k, 3) [m]."""
        kinematics = self.controller.kinematics
        poses = self.poses
        rows = [(s.t, s.truth.q, s.desired.x_d, s.state.a_k) for s in samples]
        t, q, x_d, a_k = (np.array(each) for each in zip(*rows, strict=True))
        motion = motion_in_time(self.robots, t, q)
        tips = tips_of(self.true, motion)
        self._solid.place(motion, poses)
        self._contacts.place(motion, chosen_forces(self.controller, samples), poses)
        self._ghost.place(motion_of(kinematics.robot, q, kinematics, a_k), poses)
        desired = desired_tips(self.true, x_d, tips)
        for k, node in enumerate(self._points):
            poses.move(node, desired[:, k])
        for number, node in self._solid.loads:
            carried = self.robots.index(t)[:, None] == number
            poses.move(node, np.zeros((len(t), 3)), None, np.where(carried, 1.0, HIDDEN))
        for sample in samples:
            self.window.note(("reading", sample.t), reading=self._reading(sample))
        return tips

    @property
    def units(self) -> dict[str, str]:
        """Label -> unit of each curve: errors of the task, and of estimated translations."""
        units = {f"{group.name} error": group.shown.unit for group in self.true.task.groups}
        return units | ({"error of tool and length estimates": "mm"} if self._truths else {})

    def _reading(self, sample: Sample) -> Record:
        """Return time and values of the curves at a sample, as the page takes them."""
        task = self.true.task
        assert sample.truth.x is not None  # perfect sensors see the task
        error = task.error(sample.truth.x, sample.desired.x_d)
        parts = [group.shown.scale * error[group.rows] for group in task.groups]
        if self._truths:
            parts.append(1e3 * (sample.state.a_k - self._truths[self.robots.index(sample.t)]))
        values = [float(f"{np.linalg.norm(part):.4g}") for part in parts]
        return {"t": round(sample.t, 4), "values": as_json(values)}

    def add_paths(
        self, name: str, paths: np.ndarray, radius: float = 0.005, material: Material | None = None
    ) -> list[Node]:
        """Draw paths (L, k, 3) [m], by default as of the true tips, and return their nodes.

        Fewer than two points are not drawn.
        """
        if len(paths) < 2:
            return []
        nodes = _nodes(self.root["paths"], name, self.true)
        for k, node in enumerate(nodes):
            node.set_object(tube(paths[:, k], radius * self.size), material or self._trace)
        return nodes
