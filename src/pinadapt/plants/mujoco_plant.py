"""A robot simulated with MuJoCo, and its numbers in a compiled MuJoCo model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..description.chain import configuration_from_angles, position_limits
from ..exceptions import DivergedError, InputError, did_you_mean
from ..records import Measurement
from ..robot.motors import Actuators, Compensation
from ..robot.robot import Robot
from ..tasks.frame import FrameTask, PoseTask
from .plant import LONGEST_STEP, SimulatedPlant, refuse_special_friction

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

    q, v, x and xd are read from MuJoCo. Torques are written to ``qfrc_applied``; actuators are not
    used.

    Attributes:
        model: the ``mujoco.MjModel``.
        data: its ``mujoco.MjData``; both can be shown in the viewer of MuJoCo.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        mjcf: MujocoFile | None = None,
        torque_limits: np.ndarray | None = None,
        compensation: Compensation | None = None,
        actuators: Actuators | None = None,
        substeps: int | None = None,
    ) -> None:
        """Build the MuJoCo model.

        Args:
            robot: the true robot, or the description that the file is matched with.
            mjcf: model file to simulate in place of the robot, or None.
            torque_limits: (nv) limits of the motor torques [N m or N], or None.
            compensation: function of q (nq): torque that the arm adds to the command, or None.
            actuators: how a commanded torque comes to the links; None: ideal ones.
            substeps: integration steps per ``step``; None: chosen.

        Raises:
            InputError: MuJoCo is not installed, less than one substep, elastic actuators, or a file
                that does not match the robot.
        """
        super().__init__(
            robot,
            torque_limits=torque_limits,
            compensation=compensation,
            actuators=actuators,
            substeps=substeps,
        )
        mj = mujoco_module()
        self.described = mjcf is None
        self._chain = chain_of(robot) if mjcf is None else mjcf.match(robot)
        self.model = self._chain.model
        self.data = mj.MjData(self.model)
        joints = list(self._chain.joints)
        self._qpos, self._dofs = self.model.jnt_qposadr[joints], self.model.jnt_dofadr[joints]
        if self.described:
            self.model.opt.integrator = mj.mjtIntegrator.mjINT_RK4
        self.model.opt.disableflags |= int(mj.mjtDisableBit.mjDSBL_AUTORESET)
        self.reset()

    def reset(self) -> None:
        """Return to the first robot, at its home pose at rest, at time 0.

        Everything else in a file returns to its initial state.
        """
        super().reset()
        mujoco_module().mj_resetData(self.model, self.data)
        self.data.qpos[self._qpos] = self.robot.home_angles
        self._t = 0.0
        self._read()

    def become(self, robot: Robot) -> None:
        """Replace the robot at the same q, v and time; the torque limits stay.

        Raises:
            InputError: the plant simulates a file, which cannot change.
            RobotError: it has another chain, frame or task.
        """
        if not self.described:
            raise InputError(
                "the robot of a MuJoCo file cannot become another one during a motion.",
                where="changes",
            )
        super().become(robot)
        self._read()

    def measure(self) -> Measurement:
        """Return what ideal sensors measure now."""
        task = self.robot.task
        if isinstance(task, FrameTask):
            chain, data = self._chain, self.data
            x, xd = task.moving(chain.placement(data), chain.velocity(data))
        else:
            x, xd = task.measured(None, self._q), self._v
        return Measurement(self._t, self._q, self._v, x, None, xd)

    def hold(self, tau: np.ndarray, dt: float) -> None:
        """Move for dt [s] under a torque tau (nv) that the motors apply [N m or N].

        Raises:
            DivergedError: the torque is not finite.
        """
        count = self.steps_in(dt)
        if not np.isfinite(tau).all():  # MuJoCo would write a log file
            raise DivergedError("the torque is not finite.", self._t)
        self.data.qfrc_applied[self._dofs] = tau
        self.model.opt.timestep = dt / count
        mujoco_module().mj_step(self.model, self.data, count)
        self._t += dt
        self._read()

    def _take(self, robot: Robot) -> None:
        """Write the parameters of a robot into the model, unless it comes from a file."""
        self.robot = robot
        if not self.described:
            self.longest_step = min(LONGEST_STEP, self.model.opt.timestep)
            return
        write_robot(self.model, robot)
        self.longest_step = 1.0 / max(1.0 / LONGEST_STEP, fastest_decay(robot))

    def _read(self) -> None:
        """Read q and v, and update what depends on them."""
        mj, model, data = mujoco_module(), self.model, self.data
        angles, self._v = data.qpos[self._qpos], data.qvel[self._dofs]
        chain = self.robot.model
        self._q = angles if chain.nq == chain.nv else configuration_from_angles(chain, angles)
        mj.mj_kinematics(model, data)
        mj.mj_comPos(model, data)
        mj.mj_comVel(model, data)


# Constraints in MuJoCo are spring-dampers with a time constant [s] and a damping ratio (solref),
# and a share of the ideal force (solimp). With these values a joint at 1 rad/s or 1 m/s exceeds
# its limit by about 1 mrad or 1 mm.
# The MuJoCo model

STIFF = [0.004, 1.0]
HARD = [0.99, 0.999, 0.001, 0.5, 2.0]

# The compiler of MuJoCo simplifies what is at the origin, in the axes or at the centre of mass of
# its body, which must not happen here. These positions [m] and quaternions wxyz are others.
_MASS = {"ipos": [0.1, 0.2, 0.3], "iquat": [0.5, 0.5, 0.5, 0.5]}
_SITE = {"pos": [0.3, 0.1, 0.2], "quat": [0.5, -0.5, 0.5, 0.5]}

_FASTEST = 0.002  # [s], least time constant: MuJoCo needs two of its steps
_SOFTEST = 0.1  # least share of the ideal force
FARTHEST = 0.3  # largest distance of the frames of file and description, relative to the arm length
WIDEST = np.cos(np.radians(30.0))  # largest angle between axes of file and description, as cosine
_FRAME = "pinadapt task frame"


class MujocoChain(NamedTuple):
    """A MuJoCo model, and which of its parts are the chain of a robot.

    Attributes:
        model: the ``mujoco.MjModel``.
        joints: ids of the joints of the chain, in the order of the robot.
        site: id of the site that is the task frame.
        base: id of the body in whose axes the task coordinates are given, 0 for the world.
    """

    model: mujoco.MjModel
    joints: tuple[int, ...]
    site: int
    base: int

    def at(self, angles: np.ndarray) -> mujoco.MjData:
        """Return new data with the kinematics at joint positions (nv) [rad or m]."""
        mj = mujoco_module()
        data = mj.MjData(self.model)
        data.qpos[self.model.jnt_qposadr[list(self.joints)]] = angles
        mj.mj_kinematics(self.model, data)
        return data

    def placement(self, data: mujoco.MjData) -> pin.SE3:
        """Return the placement of the task frame in the base."""
        frame = pin.SE3(data.site_xmat[self.site].reshape(3, 3), data.site_xpos[self.site])
        if not self.base:
            return frame
        return self._base_placement(data).actInv(frame)

    def velocity(self, data: mujoco.MjData) -> pin.Motion:
        """Return the velocity of the task frame at its origin, in the axes of the base."""
        mj, twist = mujoco_module(), np.empty(6)
        kind = mj.mjtObj.mjOBJ_SITE
        mj.mj_objectVelocity(self.model, data, kind, self.site, twist, 0)
        if self.base:
            turn = self._base_placement(data).rotation.T
            return pin.Motion(turn @ twist[3:], turn @ twist[:3])
        return pin.Motion(twist[3:], twist[:3])

    def _base_placement(self, data: mujoco.MjData) -> pin.SE3:
        return pin.SE3(data.xmat[self.base].reshape(3, 3), data.xpos[self.base])


def mujoco_module() -> ModuleType:
    """Return the module mujoco, imported at first use.

    Raises:
        InputError: it is not installed.
    """
    try:
        import mujoco
    except ImportError as error:
        raise InputError(
            "MuJoCo is not installed.",
            where="engine",
            hint='Install it: pip install "pinadapt[mujoco]".',
        ) from error
    return mujoco


def chain_of(robot: Robot) -> MujocoChain:
    """Return a model with a body and a joint for each joint of a robot, and its frame as a site.

    Names are those of the robot. There are no collisions and no actuators. ``write_robot`` writes
    the numbers.
    """
    mj, chain = mujoco_module(), robot.model
    spec = mj.MjSpec()
    spec.modelname, spec.compiler.degree = robot.name, False
    bodies = [spec.worldbody]
    for i, (axis, slides) in enumerate(joint_axes(robot), start=1):
        name = str(chain.names[i])
        body = bodies[chain.parents[i]].add_body(
            name=name, mass=1.0, inertia=[1.0] * 3, explicitinertial=True, **_MASS
        )
        body.add_joint(
            name=name,
            type=mj.mjtJoint.mjJNT_SLIDE if slides else mj.mjtJoint.mjJNT_HINGE,
            axis=axis,
            **_limits(robot, chain.joints[i].idx_v),
        )
        bodies.append(body)
    carrier = bodies[chain.frames[robot.frame_id].parentJoint]
    carrier.add_site(name=robot.frame, **_SITE)
    return MujocoChain(spec.compile(), tuple(range(chain.nv)), 0, 0)


def _limits(robot: Robot, joint: int) -> dict[str, Any]:
    """Return the position limits of a joint as arguments for MuJoCo."""
    lower, upper = (bounds[joint] for bounds in position_limits(robot.model))
    if not np.isfinite([lower, upper]).all():
        return {"limited": False}
    limits = [float(lower), float(upper)]
    return {"limited": True, "range": limits, "solref_limit": STIFF, "solimp_limit": HARD}


def write_robot(model: mujoco.MjModel, robot: Robot) -> None:
    """Write lengths, inertias, friction, rotor inertias and gravity of a robot into its model.

    They are written after compilation, as the compiler refuses what many descriptions have: bodies
    without mass, and inertias that are not physical.
    """
    refuse_special_friction(robot, "MuJoCo")
    mj, chain = mujoco_module(), robot.model
    for i in range(1, chain.njoints):
        write_place(chain.jointPlacements[i], model.body_pos[i], model.body_quat[i])
        body = chain.inertias[i]
        moments, axes = np.linalg.eigh(body.inertia)
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0
        write_place(pin.SE3(axes, body.lever), model.body_ipos[i], model.body_iquat[i])
        model.body_mass[i], model.body_inertia[i] = body.mass, moments
    frame = chain.frames[robot.frame_id]
    write_place(frame.placement, model.site_pos[0], model.site_quat[0])
    model.dof_armature[:] = chain.armature
    model.dof_damping[:] = robot.friction.viscous
    model.dof_frictionloss[:] = robot.friction.coulomb
    model.opt.gravity[:] = chain.gravity.linear
    mj.mj_setConst(model, mj.MjData(model))
    _soften(model, robot)


def _soften(model: mujoco.MjModel, robot: Robot) -> None:
    """Give Coulomb friction the slope of ``Friction`` at low velocity.

    Below its bound f, the friction torque of MuJoCo at a constant velocity v is b v / R, with
    b = 2 / (d T) and R = A (1 - d) / d, where A is the inverse inertia of the joint, T the time
    constant and d the share of the ideal force. It should be f v / threshold, hence
    T (1 - d) = 2 threshold / (A f).
    """
    friction = robot.friction
    for i in np.flatnonzero(friction.coulomb):
        product = 2.0 * friction.threshold[i] / (model.dof_invweight0[i] * friction.coulomb[i])
        constant = max(_FASTEST, product / (1.0 - _SOFTEST))
        share = 1.0 - product / constant
        model.dof_solref[i] = [constant, 1.0]
        model.dof_solimp[i, :2] = share


def joint_axes(robot: Robot, q: np.ndarray | None = None) -> list[tuple[np.ndarray, bool]]:
    """Return the axis (3) of each joint, and whether the joint is prismatic.

    Axes are given in the joint frames; with a configuration q (nq), in world axes.
    """
    model, data = robot.model, robot.model.createData()
    where = pin.LOCAL if q is None else pin.LOCAL_WORLD_ALIGNED
    pin.computeJointJacobians(model, data, pin.neutral(model) if q is None else q)
    axes = []
    for i in range(1, model.njoints):
        column = pin.getJointJacobian(model, data, i, where)[:, model.joints[i].idx_v]
        slides = bool(np.linalg.norm(column[:3]) > 0.5)
        axes.append((column[:3] if slides else column[3:], slides))
    return axes


def fastest_decay(robot: Robot) -> float:
    """Return the largest decay rate [1/s] of a motion by viscous friction at the home pose."""
    M = pin.crba(robot.model, robot.model.createData(), robot.q0)
    rates = np.linalg.eigvals(np.linalg.solve(M, np.diag(robot.friction.viscous)))
    return float(np.abs(rates).max())


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
