"""A robot simulated with MuJoCo, and its numbers in a compiled MuJoCo model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from .._checks import optional, word
from ..description.chain import axis_of, configuration_from_angles, frame_named, is_slide
from ..description.floating_base import BASE_JOINTS
from ..description.mjcf import mjcf_text
from ..exceptions import InputError
from ..records import Measurement
from ..robot.constraints import Contact
from ..robot.robot import Robot
from ..tasks.frame import FrameTask, PoseTask
from ..tasks.task import Moving, Task
from .plant import LONGEST_STEP, SimulatedPlant, refuse_missing

if TYPE_CHECKING:
    import mujoco


class MujocoPlant(SimulatedPlant):
    """A robot simulated with MuJoCo, from its home pose at rest.

    Without a file, the MuJoCo model has the chain, inertias, rotor inertias, viscous friction and
    joint limits of the robot. Coulomb friction becomes frictionloss, softened to match
    ``Friction``: it increases with the velocity at the same slope up to its full value. With a
    ``MujocoFile``, all parameters are those of the file; the robot defines joints, frame, task and
    home pose.

    The method is the classical one of Runge and Kutta, or that of the file.

    q and v are read from MuJoCo, with a file x and xd too. Torques are written to ``qfrc_applied``;
    actuators are not used.

    Attributes:
        model: the ``mujoco.MjModel``.
        data: its ``mujoco.MjData``; both can be shown in the viewer of MuJoCo.
    """

    def __init__(self, robot: Robot, *, mjcf: MujocoFile | None = None, **options: Any) -> None:
        """Build the MuJoCo model.

        Args:
            robot: the true robot, or the description that the file is matched with.
            mjcf: model file to simulate in place of the robot, or None.
            options: of ``SimulatedPlant``.

        Raises:
            InputError: MuJoCo is not installed, a file that does not match the robot, or as of
                ``SimulatedPlant``.
        """
        super().__init__(robot, **options)
        mj = mujoco_module()
        self.described = mjcf is None
        self._chain = chain_of(robot) if mjcf is None else mjcf.match(robot)
        self.model = self._chain.model
        joints = self._chain.joints
        self.data = mj.MjData(self.model)
        self._qpos = self.model.jnt_qposadr[joints]
        self._dofs = self.model.jnt_dofadr[joints]
        if self.described:
            self.model.opt.integrator = mj.mjtIntegrator.mjINT_RK4
        flags = mj.mjtDisableBit
        self.model.opt.disableflags |= int(flags.mjDSBL_AUTORESET) | int(flags.mjDSBL_ACTUATION)
        self.reset()

    def reset(self) -> None:
        """Return to the first robot, at its home pose at rest, at time 0.

        Everything else in a file returns to its initial state.
        """
        super().reset()
        mujoco_module().mj_resetData(self.model, self.data)
        self.data.qpos[self._qpos] = self.robot.home_angles
        self._read()

    def measure(self) -> Measurement:
        """Return what ideal sensors measure now."""
        task = self.robot.task
        if self.described or not task.positions:
            x, xd = self._motion(self._q, self._v)
        else:
            x, xd = self._chain.moving(task, self.data)
        return Measurement(self._t, self._q, self._v, x, None, xd)

    def hold(self, tau: np.ndarray, dt: float) -> None:
        """Move for dt [s] under a torque tau (nv) that the motors apply [N m or N]."""
        count = self.steps_in(dt)
        self.data.qfrc_applied[self._dofs] = tau
        self.model.opt.timestep = dt / count
        mujoco_module().mj_step(self.model, self.data, count)
        self._t += dt
        self._read()

    def _take(self, robot: Robot) -> None:
        """Write its parameters into the model too, unless that comes from a file."""
        super()._take(robot)
        if self.described:
            write_robot(self.model, robot)
            M = pin.crba(self._model, self._data, robot.q0)
            decays = np.linalg.eigvals(np.linalg.solve(M, np.diag(robot.friction.viscous)))
            self.longest_step = 1.0 / max(1.0 / LONGEST_STEP, np.abs(decays).max())
        else:
            self.longest_step = min(LONGEST_STEP, self.model.opt.timestep)

    def _read(self) -> None:
        """Read q and v."""
        self._q = configuration_from_angles(self._model, self.data.qpos[self._qpos])
        self._v = self.data.qvel[self._dofs]


# The MuJoCo model

_TOE = 1e-4  # [m] radius of what touches the ground; half or double: a foot moves by as much
_NO_SLIP = 10.0  # stiffness of friction over that of contact; half: feet creep twice as fast
# Constraints in MuJoCo are spring-dampers with a time constant [s] (first of solref), and shares of
# the ideal force at and beyond the limit (first two of solimp). With these values a joint at 1
# rad/s or 1 m/s exceeds its limit by about 1 mrad or 1 mm; with half or twice of the time constant
# by half or twice of it.
_STIFF, _HARD = 0.004, (0.99, 0.999)

_FRAME = "pinadapt task frame"


class MujocoChain(NamedTuple):
    """A MuJoCo model, and which of its parts are the chain of a robot.

    Attributes:
        model: the ``mujoco.MjModel``.
        joints: ids of the joints of the chain, in the order of the robot.
        site: of a file: id of the site that is the task frame.
        base: of a file: id of the body in whose axes the task coordinates are given.
    """

    model: mujoco.MjModel
    joints: list[int]
    site: int = 0
    base: int = 0

    def placement(self, data: mujoco.MjData) -> pin.SE3:
        """Return the placement of the task frame in the base."""
        frame = pin.SE3(data.site_xmat[self.site].reshape(3, 3), data.site_xpos[self.site])
        base = pin.SE3(data.xmat[self.base].reshape(3, 3), data.xpos[self.base])
        return base.actInv(frame)

    def moving(self, task: Task, data: mujoco.MjData) -> Moving:
        """Return x and the task velocity (m) in the axes of the base, after updating the data."""
        assert isinstance(task, FrameTask)
        mj = mujoco_module()
        twist = np.empty(6)
        for update in (mj.mj_kinematics, mj.mj_comPos, mj.mj_comVel):
            update(self.model, data)
        mj.mj_objectVelocity(self.model, data, mj.mjtObj.mjOBJ_SITE, self.site, twist, 0)
        turn = data.xmat[self.base].reshape(3, 3).T
        motion = np.append(turn @ twist[3:], turn @ twist[:3])
        return task.moving(self.placement(data), motion)


mujoco_module = cache(partial(optional, "mujoco", "mujoco", "engine"))


def chain_of(robot: Robot) -> MujocoChain:
    """Return a model with a body and a joint for each joint of a robot, and its contacts.

    It is that of ``Robot.mjcf``, but for the inertias: ``write_robot`` writes them.
    """
    chain = robot.model.copy()
    # The compiler of MuJoCo simplifies what is at the centre of mass and in the main axes of its
    # body, which must not happen here: this centre [m] and inertia are others.
    body = pin.Inertia(1.0, np.array([0.1, 0.2, 0.3]), np.eye(3) + 0.1)
    for i in range(1, chain.njoints):
        chain.inertias[i] = body
    spec = mujoco_module().MjSpec.from_string(
        mjcf_text(replace(robot, model=chain), free_joint=False)
    )
    if robot.contacts:
        _add_contacts(spec, robot)
    model = spec.compile()
    _stiffen(model.jnt_solref, model.jnt_solimp)
    _stiffen(model.geom_solref, model.geom_solimp)
    return MujocoChain(model, list(range(chain.nv)))


def _stiffen(solref: np.ndarray, solimp: np.ndarray) -> None:
    """Make constraints with these parameters (2) and (5), or rows of them, stiff."""
    solref[..., 0] = _STIFF
    solimp[..., :2] = _HARD


def _add_contacts(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add the ground, and small spheres that touch it: one a point foot, four a sole."""
    mj = mujoco_module()
    spec.option.cone = mj.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = _NO_SLIP
    least = min(contact.friction for contact in robot.contacts)
    spec.worldbody.add_geom(
        type=mj.mjtGeom.mjGEOM_PLANE, size=[1.0, 1.0, 0.1], friction=[least, 0.0, 0.0]
    )
    for contact in robot.contacts:
        frame = frame_named(robot.model, contact.frame)
        for corner in contact.corners:
            spec.bodies[frame.parentJoint - robot.model.njoints].add_geom(
                type=mj.mjtGeom.mjGEOM_SPHERE,
                size=[_TOE, 0.0, 0.0],
                pos=frame.placement.act(corner),
                mass=0.0,
                friction=[contact.friction, 0.0, 0.0],
            )


def write_robot(model: mujoco.MjModel, robot: Robot) -> None:
    """Write lengths, inertias, friction, rotor inertias and gravity of a robot into its model.

    They are written after compilation, as the compiler refuses what many descriptions have: bodies
    without mass, and inertias that are not physical.
    """
    refuse_missing(robot, "MuJoCo", Contact)
    mj = mujoco_module()
    chain = robot.model
    for i, body in enumerate(model.jnt_bodyid, 1):
        write_place(chain.jointPlacements[i], model.body_pos[body], model.body_quat[body])
        write_inertia(model, body, chain.inertias[i])
    model.dof_armature[:] = chain.armature
    model.dof_damping[:] = robot.friction.viscous
    model.dof_frictionloss[:] = robot.friction.coulomb
    model.opt.gravity[:] = chain.gravity.linear
    mj.mj_setConst(model, mj.MjData(model))
    _soften(model, robot)


def write_inertia(model: mujoco.MjModel, body: int, inertia: pin.Inertia) -> None:
    """Write the inertia of a body, in the body's axes, into a model."""
    moments, axes = np.linalg.eigh(inertia.inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    write_place(pin.SE3(axes, inertia.lever), model.body_ipos[body], model.body_iquat[body])
    model.body_mass[body] = inertia.mass
    model.body_inertia[body] = moments


def inertia_in(model: mujoco.MjModel, body: int, frame: int) -> pin.Inertia:
    """Return the inertia of a body in the axes of another one, both where they are at ``qpos0``."""
    mj = mujoco_module()
    data = mj.MjData(model)
    mj.mj_kinematics(model, data)
    place = pin.SE3(data.ximat[body].reshape(3, 3), data.xipos[body])
    axes = pin.SE3(data.xmat[frame].reshape(3, 3), data.xpos[frame])
    moments = np.diag(model.body_inertia[body])
    return axes.actInv(place).act(pin.Inertia(model.body_mass[body], np.zeros(3), moments))


def _soften(model: mujoco.MjModel, robot: Robot) -> None:
    """Give Coulomb friction the slope of ``Friction`` at low velocity.

    Below its bound f, the friction torque of MuJoCo at a constant velocity v is b v / R, with
    b = 2 / (d T) and R = A (1 - d) / d, where A is the inverse inertia of the joint, T the time
    constant and d the share of the ideal force. It should be f v / threshold, hence
    T (1 - d) = 2 threshold / (A f).
    """
    friction = robot.friction
    dry = friction.coulomb > 0.0
    product = 2.0 * friction.threshold[dry] / (model.dof_invweight0 * friction.coulomb)[dry]
    constant = np.maximum(2.0 * LONGEST_STEP, product / 0.9)  # MuJoCo needs two steps and d >= 0.1
    model.dof_solref[dry, 0] = constant
    model.dof_solref[dry, 1] = 1.0
    model.dof_solimp[dry, :2] = (1.0 - product / constant)[:, None]


def write_place(placement: pin.SE3, pos: np.ndarray, quat: np.ndarray) -> None:
    """Write a placement into a position (3) and a quaternion wxyz (4)."""
    pos[:] = placement.translation
    mujoco_module().mju_mat2Quat(quat, placement.rotation.flatten())


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
                match: other types, or other axes or places at the home pose; a free base.
            RobotError: the robot has several task frames.
        """
        robot.check_single_frame()
        path = str(self.path)
        if BASE_JOINTS[0] in robot.joint_names:
            raise InputError(
                "has a fixed base, and the robot a free one.",
                where=path,
                hint='Take engine="mujoco", which simulates the description.',
            )
        try:
            spec = mujoco_module().MjSpec.from_file(path)
            names = self._names(robot, [joint.name for joint in spec.joints])
            site = self._site(spec, robot) if robot.task.positions else ""
            self._hold(spec, spec.compile(), names)
            model = spec.compile()
        except InputError:
            raise
        except ValueError as error:
            raise InputError(f"MuJoCo cannot read it: {error}", where=path) from error
        model.body_gravcomp[:] = 0.0
        joints = [model.joint(name).id for name in names]
        number = model.site(site).id if site else 0
        bodies = (body.name for body in spec.bodies)
        base = model.body(word(self.base or "world", bodies, "base")).id
        if model.body_weldid[base]:
            raise InputError(f"the body '{self.base}' moves; the base must be fixed.", where="base")
        found = MujocoChain(model, joints, number, base)
        _check_alike(found, robot, names)
        return found

    def _names(self, robot: Robot, there: Sequence[str]) -> list[str]:
        """Return the names of the robot's joints in the file."""
        for name in self.joints:
            word(name, robot.joint_names, "joints")
        names = [word(self.joints.get(name, name), there, "joints") for name in robot.joint_names]
        if len(set(names)) < len(names):
            raise InputError(f"two joints of the chain have one name in {names}.", where="joints")
        return names

    def _site(self, spec: Any, robot: Robot) -> str:
        """Return the name of the site that is the task frame; it is added to a body."""
        sites, bodies = ([each.name for each in all] for all in (spec.sites, spec.bodies))
        name = word(self.frame or robot.frame, [*sites, *bodies], "frame")
        if name in sites:
            return name
        spec.body(name).add_site(name=_FRAME)
        return _FRAME

    def _hold(self, spec: Any, model: mujoco.MjModel, names: Sequence[str]) -> None:
        """Hold the arm's joints other than those with ``names`` at their reference position."""
        mj = mujoco_module()
        roots = model.body_rootid[model.jnt_bodyid]
        arm = {roots[model.joint(name).id] for name in names}
        for joint in range(model.njnt):
            name = model.joint(joint).name
            if name not in names and roots[joint] in arm:
                held = spec.add_equality(
                    type=mj.mjtEq.mjEQ_JOINT, objtype=mj.mjtObj.mjOBJ_JOINT, name1=name
                )
                _stiffen(held.solref, held.solimp)


# Between file and description: largest angle of axes and frames, as its cosine, and largest
# distance of the frames relative to the arm's length. Half of them refuse some true arms that
# differ, twice accept an axis that is another joint's.
WIDEST, FARTHEST = np.cos(np.radians(30.0)), 0.3


def _check_alike(found: MujocoChain, robot: Robot, names: Sequence[str]) -> None:
    """Refuse joints or a task frame that do not match those of the robot.

    Raises:
        InputError: joints of other types, or with other axes at the home pose; or there the frame
            is too far away (30 % of the arm length), or turned by more than 30 degrees in a pose
            task.
    """
    mj = mujoco_module()
    model = found.model
    chain = robot.model
    data = mj.MjData(model)
    ours = chain.createData()
    data.qpos[model.jnt_qposadr[found.joints]] = robot.home_angles
    mj.mj_kinematics(model, data)
    pin.framesForwardKinematics(chain, ours, robot.q0)
    turn = data.xmat[found.base].reshape(3, 3)
    hint = "Correct the file, or name as `base` the body whose frame is the description's world."
    for i, (joint, name) in enumerate(zip(found.joints, names, strict=True), start=1):
        axis = ours.oMi[i].rotation @ axis_of(chain, i)
        theirs = turn.T @ data.xaxis[joint]
        kind = mj.mjtJoint.mjJNT_SLIDE if is_slide(chain.joints[i]) else mj.mjtJoint.mjJNT_HINGE
        if model.jnt_type[joint] != kind or axis @ theirs < WIDEST:
            raise InputError(
                f"joint '{name}' of the file and '{chain.names[i]}' of the description differ in "
                f"type or in axis at home, {theirs.round(3)} and {axis.round(3)}.",
                where="joints",
                hint=hint,
            )
    if not robot.task.positions:
        return
    away = ours.oMf[robot.frame_id].actInv(found.placement(data))
    turned = np.cos(np.linalg.norm(pin.log3(away.rotation))) < WIDEST
    far = np.linalg.norm(away.translation) > FARTHEST * robot.reach
    if far or (turned and isinstance(robot.task, PoseTask)):
        raise InputError(
            "at home the frame in the file is elsewhere than in the description, by\n"
            f"{away.homogeneous.round(3)}.",
            where="frame",
            hint=hint,
        )
