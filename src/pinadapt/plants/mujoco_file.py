"""A MuJoCo model file as the true robot: its joints and frames are matched with a description."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from ..exceptions import InputError, did_you_mean
from ..robot.robot import Robot
from ..tasks.frame import FrameTask, PoseTask
from .mujoco_model import HARD, STIFF, MujocoChain, joint_axes, mujoco_module

if TYPE_CHECKING:
    import mujoco

FARTHEST = 0.3  # largest distance of the frames of file and description, relative to the arm length
WIDEST = np.cos(np.radians(30.0))  # largest angle between axes of file and description, as cosine

_FRAME = "pinadapt task frame"


@dataclass(frozen=True)
class MujocoFile:
    """A MuJoCo model file that is simulated as the true robot.

    Lengths, inertias, friction, joint limits, contacts and all else come from the file. Joints of
    the arm that are not part of the chain, such as fingers, are held at their reference position.
    Actuators and gravity compensation are switched off.

    Attributes:
        path: MJCF or URDF file.
        joints: joint name in the description -> in the file; only names that differ.
        frame: site or body that is the task frame; None: the name in the description. A joint task
            needs none.
        base: body whose frame is the world frame of the description; None: the world.
    """

    path: str | Path
    joints: Mapping[str, str] = field(default_factory=dict)
    frame: str | None = None
    base: str | None = None

    def match(self, robot: Robot) -> MujocoChain:
        """Read the file and find the chain of a robot in it.

        Raises:
            InputError: no such file, not a model, or joints or frames that are missing or do not
                match: other types, another order, other axes at the home pose.
        """
        spec = self._read()
        names = self._names(robot, [str(joint.name) for joint in spec.joints])
        site = self._site(spec, robot, names[-1])
        model = self._compiled(spec)
        if free := _other_joints(model, [model.joint(name).id for name in names]):
            self._hold(spec, model, free)
            model = self._compiled(spec)
        model.opt.disableflags |= int(mujoco_module().mjtDisableBit.mjDSBL_ACTUATION)
        model.body_gravcomp[:] = 0.0
        joints = tuple(int(model.joint(name).id) for name in names)
        found = MujocoChain(model, joints, int(model.site(site).id), self._base(model))
        _check_joints(found, robot, names)
        if isinstance(robot.task, FrameTask):
            _check_frame(found, robot)
        _warn_of_gravity(found, robot)
        return found

    def _read(self) -> Any:
        path = Path(self.path)
        if not path.is_file():
            raise InputError("no such file.", where=str(path))
        try:
            return mujoco_module().MjSpec.from_file(str(path))
        except ValueError as error:
            raise InputError(f"MuJoCo cannot read it: {error}", where=str(path)) from error

    def _names(self, robot: Robot, there: Sequence[str]) -> list[str]:
        """Return the names of the robot's joints in the file."""
        for name in self.joints:
            _known(name, robot.joint_names, "joints", "the chain")
        names = [self.joints.get(name, name) for name in robot.joint_names]
        for name in names:
            _known(
                name,
                there,
                "joints",
                str(self.path),
                "Give joints={name in the description: name in the file}.",
            )
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise InputError(
                f"several joints of the chain are matched with {twice}.", where="joints"
            )
        return names

    def _site(self, spec: Any, robot: Robot, last: str) -> str:
        """Return the name of the site that is the task frame; it is added to a body.

        A joint task does not need a frame; the body of the ``last`` joint gets the site.
        """
        if self.frame is None and not isinstance(robot.task, FrameTask):
            spec.joint(last).parent.add_site(name=_FRAME)
            return _FRAME
        name = self.frame or robot.frame
        sites, bodies = [str(site.name) for site in spec.sites], [str(b.name) for b in spec.bodies]
        _known(name, [*sites, *bodies], "frame", str(self.path), "Name one of its sites or bodies.")
        if name in sites:
            return name
        spec.body(name).add_site(name=_FRAME)
        return _FRAME

    def _compiled(self, spec: Any) -> mujoco.MjModel:
        try:
            return spec.compile()
        except ValueError as error:
            raise InputError(f"MuJoCo cannot compile it: {error}", where=str(self.path)) from error

    def _hold(self, spec: Any, model: mujoco.MjModel, joints: Sequence[int]) -> None:
        """Hold the joints of the arm that are not part of the chain at their reference position."""
        mj = mujoco_module()
        for joint in joints:
            name = str(model.joint(joint).name)
            kind = mj.mjtJoint(model.jnt_type[joint])
            if not name or kind not in (mj.mjtJoint.mjJNT_HINGE, mj.mjtJoint.mjJNT_SLIDE):
                body = str(model.body(model.jnt_bodyid[joint]).name)
                raise InputError(
                    f"the joint '{name}' of body '{body}' is not part of the chain and cannot be "
                    "held.",
                    where=str(self.path),
                    hint="Give it a name if it is a hinge or slide; else remove it.",
                )
            equality, held = mj.mjtEq.mjEQ_JOINT, mj.mjtObj.mjOBJ_JOINT
            spec.add_equality(type=equality, objtype=held, name1=name, solref=STIFF, solimp=HARD)

    def _base(self, model: mujoco.MjModel) -> int:
        if self.base is None:
            return 0
        names = [str(model.body(i).name) for i in range(model.nbody)]
        _known(self.base, names, "base", str(self.path))
        base = names.index(self.base)
        if model.body_weldid[base]:
            raise InputError(f"the body '{self.base}' moves; the base must be fixed.", where="base")
        return base


def _other_joints(model: mujoco.MjModel, joints: Sequence[int]) -> list[int]:
    """Return the joints in the same kinematic tree that are not part of the chain."""
    trees = {int(model.body_rootid[model.jnt_bodyid[joint]]) for joint in joints}
    return [
        joint
        for joint in range(model.njnt)
        if joint not in joints and int(model.body_rootid[model.jnt_bodyid[joint]]) in trees
    ]


def _check_joints(found: MujocoChain, robot: Robot, names: Sequence[str]) -> None:
    """Refuse joints that do not match those of the robot.

    Raises:
        InputError: other types, another order, or other axes at the home pose.
    """
    mj, model, data = mujoco_module(), found.model, found.at(robot.home_angles)
    turn = data.xmat[found.base].reshape(3, 3)
    previous = 0
    described = joint_axes(robot, robot.q0)
    for joint, name, ours, (axis, slides) in zip(
        found.joints, names, robot.joint_names, described, strict=True
    ):
        kind = mj.mjtJoint.mjJNT_SLIDE if slides else mj.mjtJoint.mjJNT_HINGE
        pair = f"joint '{name}' of the file and '{ours}' of the description"
        if model.jnt_type[joint] != kind:
            raise InputError(f"{pair} are of different types.", where="joints")
        if not _carries(model, previous, int(model.jnt_bodyid[joint])):
            raise InputError(
                f"{pair}: in the file it does not come after the previous joint of the chain.",
                where="joints",
            )
        previous = int(model.jnt_bodyid[joint])
        theirs = turn.T @ data.xaxis[joint]
        if axis @ theirs < WIDEST:
            raise InputError(
                f"{pair} have different axes at home, {theirs.round(3)} and {axis.round(3)}.",
                where="joints",
                hint="Correct the axis or the reference position in the file, or name as `base` "
                "the body whose frame is the world frame of the description.",
            )


def _check_frame(found: MujocoChain, robot: Robot) -> None:
    """Refuse a task frame that does not match that of the robot.

    Raises:
        InputError: at the home pose it is too far away (30 % of the arm length), or rotated by more
            than 30 degrees in a pose task.
    """
    ours, theirs = robot.placement(robot.q0), found.placement(found.at(robot.home_angles))
    model = robot.model
    parts = [*model.jointPlacements, model.frames[robot.frame_id].placement]
    length = sum(float(np.linalg.norm(part.translation)) for part in parts)
    away = float(np.linalg.norm(theirs.translation - ours.translation))
    if away > FARTHEST * length:
        raise InputError(
            f"at home the frame is at {theirs.translation.round(3)} m in the file, but at "
            f"{ours.translation.round(3)} m in the description.",
            where="frame",
            hint="Name as `base` the body whose frame is the world frame of the description.",
        )
    angle = float(np.linalg.norm(pin.log3(ours.rotation.T @ theirs.rotation)))
    if isinstance(robot.task, PoseTask) and np.cos(angle) < WIDEST:
        raise InputError(
            f"at home the frame in the file is rotated by {np.degrees(angle):.0f} degrees "
            "relative to the description.",
            where="frame",
            hint="Add a site with the axes of the description's frame to the file.",
        )


def _warn_of_gravity(found: MujocoChain, robot: Robot) -> None:
    """Warn if gravity in the file differs from the description."""
    base = found.at(robot.home_angles).xmat[found.base].reshape(3, 3)
    theirs, ours = base.T @ found.model.opt.gravity, robot.model.gravity.linear
    if np.linalg.norm(theirs - ours) > 0.05 * np.linalg.norm(ours):
        warnings.warn(
            f"gravity in the file is {theirs.round(3)}, in the description {ours.round(3)} m/s^2.",
            stacklevel=2,
        )


def _carries(model: mujoco.MjModel, carrier: int, body: int) -> bool:
    """Return whether a body is a descendant of another one; 0 is the world."""
    while body != carrier and body != 0:
        body = int(model.body_parentid[body])
    return body == carrier


def _known(
    name: str, allowed: Iterable[str], where: str, place: str, hint: str | None = None
) -> None:
    allowed = [other for other in allowed if other]
    if name not in allowed:
        raise InputError(
            f"'{name}' is not in {place}; it has {sorted(allowed)}.{did_you_mean(name, allowed)}",
            where=where,
            hint=hint,
        )
