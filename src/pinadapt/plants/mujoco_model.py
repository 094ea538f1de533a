"""The chain of a robot as a MuJoCo model: joints, bodies, inertias, friction, joint limits."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin

from ..description.chain import position_limits
from ..exceptions import InputError
from ..robot.robot import Robot
from .plant import refuse_special_friction

if TYPE_CHECKING:
    import mujoco

# Constraints in MuJoCo are spring-dampers with a time constant [s] and a damping ratio (solref),
# and a share of the ideal force (solimp). With these values a joint at 1 rad/s or 1 m/s exceeds
# its limit by about 1 mrad or 1 mm.
STIFF = [0.004, 1.0]
HARD = [0.99, 0.999, 0.001, 0.5, 2.0]

# The compiler of MuJoCo simplifies what is at the origin, in the axes or at the centre of mass of
# its body, which must not happen here. These positions [m] and quaternions wxyz are others.
_MASS = {"ipos": [0.1, 0.2, 0.3], "iquat": [0.5, 0.5, 0.5, 0.5]}
_SITE = {"pos": [0.3, 0.1, 0.2], "quat": [0.5, -0.5, 0.5, 0.5]}

_FASTEST = 0.002  # [s], least time constant: MuJoCo needs two of its steps
_SOFTEST = 0.1  # least share of the ideal force


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


def chain_of(robot: Robot, *, drawn: bool = False) -> MujocoChain:
    """Return a model with a body and a joint for each joint of a robot, and its frame as a site.

    Names are those of the robot. There are no collisions and no actuators. ``write_robot`` writes
    the numbers. With ``drawn`` the model has the visual geometry of the robot.
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
    if drawn:
        _draw(spec, bodies, robot)
    carrier.add_site(name=robot.frame, **_SITE)
    return MujocoChain(spec.compile(), tuple(range(chain.nv)), 0, 0)


def _limits(robot: Robot, joint: int) -> dict[str, Any]:
    """Return the position limits of a joint as arguments for MuJoCo."""
    lower, upper = (bounds[joint] for bounds in position_limits(robot.model))
    if not np.isfinite([lower, upper]).all():
        return {"limited": False}
    limits = [float(lower), float(upper)]
    return {"limited": True, "range": limits, "solref_limit": STIFF, "solimp_limit": HARD}


def _draw(spec: Any, bodies: Sequence[Any], robot: Robot) -> None:
    """Add the visual geometry of a robot to the bodies of a model, without mass and collisions.

    Meshes are passed as vertices, so that files may have any format. Shapes that MuJoCo does not
    have are left out.

    Args:
        spec: the ``mujoco.MjSpec``.
        bodies: the world, then one body per joint.
        robot: read only.
    """
    if robot.visual is None:
        return
    for shape in robot.visual.geometryObjects:
        form = _form(spec, str(shape.name), shape.geometry)
        if form is None:
            continue
        geom = bodies[shape.parentJoint].add_geom(
            name=str(shape.name), mass=0.0, contype=0, conaffinity=0, group=2, **form
        )
        geom.rgba = shape.meshColor
        write_place(shape.placement, geom.pos, geom.quat)


def _form(spec: Any, name: str, geometry: Any) -> dict[str, Any] | None:
    """Return a shape as arguments for MuJoCo, or None; a mesh is added to the model."""
    mj = mujoco_module()
    kinds = mj.mjtGeom
    if isinstance(geometry, coal.Box):
        return {"type": kinds.mjGEOM_BOX, "size": list(geometry.halfSide)}
    if isinstance(geometry, coal.Sphere):
        return {"type": kinds.mjGEOM_SPHERE, "size": [geometry.radius, 0.0, 0.0]}
    if isinstance(geometry, coal.Cylinder | coal.Capsule):
        round_ends = isinstance(geometry, coal.Capsule)
        kind = kinds.mjGEOM_CAPSULE if round_ends else kinds.mjGEOM_CYLINDER
        return {"type": kind, "size": [geometry.radius, geometry.halfLength, 0.0]}
    if not isinstance(geometry, coal.BVHModelBase) or geometry.num_tris < 4:
        return None
    triangles = (geometry.tri_indices(i) for i in range(geometry.num_tris))
    corners = np.array([[t[0], t[1], t[2]] for t in triangles])
    spec.add_mesh(
        name=name,
        uservert=np.array(geometry.vertices()).ravel().tolist(),
        userface=corners.ravel().tolist(),
        inertia=mj.mjtMeshInertia.mjMESH_INERTIA_SHELL,  # the mesh may be open
    )
    return {"type": kinds.mjGEOM_MESH, "meshname": name}


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
