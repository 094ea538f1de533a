"""A robot simulated by MuJoCo."""

from __future__ import annotations

import numpy as np

from ..description.chain import configuration_from_angles
from ..exceptions import DivergedError, InputError, did_you_mean
from ..records import Measurement
from ..robot.motors import Compensation
from ..robot.robot import Robot
from ..robot.succession import check_successor
from ..tasks.frame import FrameTask
from .mujoco_file import MujocoFile
from .mujoco_model import chain_of, fastest_decay, mujoco_module, write_robot
from .plant import LONGEST_STEP, SimulatedPlant

INTEGRATORS = {
    "runge-kutta": "mjINT_RK4",
    "implicitfast": "mjINT_IMPLICITFAST",
    "implicit": "mjINT_IMPLICIT",
    "euler": "mjINT_EULER",
}


class MujocoPlant(SimulatedPlant):
    """A robot that moves as MuJoCo says, from its home and from rest.

    Made from a robot alone it is that robot: its chain, inertias, rotor inertias, viscous friction,
    and the stops of its joint limits. Coulomb friction is MuJoCo's frictionloss, as soft as the
    smoothed sign of ``Friction``: it grows with the speed at the same slope, then is full. Made
    with a ``MujocoFile``, it is whatever that file says; the robot tells which joints, frame and
    task are meant, and where they start.

    q, v, x and xd are read from MuJoCo; torques go to ``qfrc_applied``, past any actuator.

    Attributes:
        model: the ``mujoco.MjModel``.
        data: its ``mujoco.MjData``; both may be looked at in MuJoCo's viewer.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        mjcf: MujocoFile | None = None,
        torque_limits: np.ndarray | None = None,
        compensation: Compensation | None = None,
        substeps: int | None = None,
        integrator: str | None = None,
        drawn: bool = False,
    ) -> None:
        """Make the model.

        Args:
            robot: the true robot, or the description that a file is matched with.
            mjcf: the file that says what moves; None: the robot does.
            torque_limits: (nv) bounds the motors clip at [N m or N], or None.
            compensation: what the arm's own electronics add to the torque asked for, of q (nq).
            substeps: integration steps in each ``step``.
            integrator: one of ``INTEGRATORS``; None: the file's, or "runge-kutta" without any.
            drawn: give the model the robot's visual geometry, for MuJoCo's viewer. Reading its
                meshes takes seconds. A file has its own.

        Raises:
            InputError: MuJoCo is not installed, unknown integrator, less than one substep, or a
                file that does not fit the robot.
        """
        super().__init__(
            robot, torque_limits=torque_limits, compensation=compensation, substeps=substeps
        )
        mj = mujoco_module()
        if integrator is not None and integrator not in INTEGRATORS:
            raise InputError(
                f"must be one of {list(INTEGRATORS)}, got {integrator!r}."
                f"{did_you_mean(str(integrator), INTEGRATORS)}",
                where="integrator",
            )
        self._first, self.described = robot, mjcf is None
        self._chain = chain_of(robot, drawn=drawn) if mjcf is None else mjcf.match(robot)
        self.model = self._chain.model
        self.data = mj.MjData(self.model)
        joints = list(self._chain.joints)
        self._qpos, self._dofs = self.model.jnt_qposadr[joints], self.model.jnt_dofadr[joints]
        if mjcf is None or integrator is not None:
            kind = INTEGRATORS[integrator or "runge-kutta"]
            self.model.opt.integrator = mj.mjtIntegrator.__members__[kind]
        self.model.opt.disableflags |= int(mj.mjtDisableBit.mjDSBL_AUTORESET)
        self._take(robot)
        self.reset()

    def reset(self) -> None:
        """Go home, at rest, at time 0, as the first robot; the rest as the file has it."""
        if self.robot is not self._first:
            self._take(self._first)
        mujoco_module().mj_resetData(self.model, self.data)
        self.data.qpos[self._qpos] = self.robot.home_angles
        self._t = 0.0
        self._read()

    def become(self, robot: Robot) -> None:
        """Be another robot from now on, at the same q, v and time; the motors keep their limits.

        Raises:
            InputError: what moves is a file's, which does not change.
            RobotError: it has another chain, frame or task.
        """
        if not self.described:
            raise InputError(
                "the robot of a MuJoCo file cannot become another one while it moves.",
                where="changes",
            )
        check_successor(self.robot, robot, "robot")
        self._take(robot)
        self._read()

    def measure(self) -> Measurement:
        """Return what perfect sensors say now."""
        task = self.robot.task
        if isinstance(task, FrameTask):
            x = task.of(self._chain.placement(self.data))
            xd = task.velocity_of(self._chain.velocity(self.data))
        else:
            x, xd = task.measured(None, self._q), self._v
        return Measurement(self._t, self._q, self._v, x, None, xd)

    def step(self, torque: np.ndarray, dt: float) -> None:
        """Hold what the motors give now, asked for a torque (nv) [N m or N], for dt [s].

        Raises:
            DivergedError: the torque is not finite.
        """
        count, tau = self.steps_in(dt), self.motors(torque)
        if not np.isfinite(tau).all():  # MuJoCo would write a file about it
            raise DivergedError("the torque is not finite.", self._t)
        self.data.qfrc_applied[self._dofs] = tau
        self.model.opt.timestep = dt / count
        mujoco_module().mj_step(self.model, self.data, count)
        self._t += dt
        self._read()

    def _take(self, robot: Robot) -> None:
        """Move as a robot, unless a file says how."""
        self.robot = robot
        if not self.described:
            self.longest_step = min(LONGEST_STEP, self.model.opt.timestep)
            return
        write_robot(self.model, robot)
        explicit = self.model.opt.integrator == mujoco_module().mjtIntegrator.mjINT_RK4
        stiffest = fastest_decay(robot) if explicit else 0.0
        self.longest_step = 1.0 / max(1.0 / LONGEST_STEP, stiffest)

    def _read(self) -> None:
        """Read q and v, and bring what depends on them up to date."""
        mj, model, data = mujoco_module(), self.model, self.data
        angles, self._v = data.qpos[self._qpos], data.qvel[self._dofs]
        chain = self.robot.model
        self._q = angles if chain.nq == chain.nv else configuration_from_angles(chain, angles)
        mj.mj_kinematics(model, data)
        mj.mj_comPos(model, data)
        mj.mj_comVel(model, data)
