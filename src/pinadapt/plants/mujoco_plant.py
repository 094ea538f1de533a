"""A robot simulated with MuJoCo."""

from __future__ import annotations

import numpy as np

from ..description.chain import configuration_from_angles
from ..exceptions import DivergedError, InputError, did_you_mean
from ..records import Measurement
from ..robot.motors import Actuators, Compensation
from ..robot.robot import Robot
from ..robot.succession import check_successor
from ..tasks.frame import FrameTask
from .mujoco_model import MujocoFile, chain_of, fastest_decay, mujoco_module, write_robot
from .plant import LONGEST_STEP, SimulatedPlant

INTEGRATORS = {
    "runge-kutta": "mjINT_RK4",
    "implicitfast": "mjINT_IMPLICITFAST",
    "implicit": "mjINT_IMPLICIT",
    "euler": "mjINT_EULER",
}


class MujocoPlant(SimulatedPlant):
    """A robot simulated with MuJoCo, from its home pose at rest.

    Without a file, the MuJoCo model has the chain, inertias, rotor inertias, viscous friction and
    joint limits of the robot. Coulomb friction becomes frictionloss, softened to match
    ``Friction``: it increases with the velocity at the same slope up to its full value. With a
    ``MujocoFile``, all parameters are those of the file; the robot defines joints, frame, task and
    home pose.

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
        integrator: str | None = None,
        drawn: bool = False,
    ) -> None:
        """Build the MuJoCo model.

        Args:
            robot: the true robot, or the description that the file is matched with.
            mjcf: model file to simulate in place of the robot, or None.
            torque_limits: (nv) limits of the motor torques [N m or N], or None.
            compensation: function of q (nq): torque that the arm adds to the command, or None.
            actuators: how a commanded torque comes to the links; None: ideal ones.
            substeps: integration steps per ``step``; None: chosen.
            integrator: one of ``INTEGRATORS``; None: that of the file, "runge-kutta" without one.
            drawn: add the visual geometry of the robot for the viewer of MuJoCo, which takes
                seconds; files have their own.

        Raises:
            InputError: MuJoCo is not installed, unknown integrator, less than one substep, elastic
                actuators, or a file that does not match the robot.
        """
        super().__init__(
            robot,
            torque_limits=torque_limits,
            compensation=compensation,
            actuators=actuators,
            substeps=substeps,
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
        """Return to the first robot, at its home pose at rest, at time 0.

        Everything else in a file returns to its initial state.
        """
        super().reset()
        if self.robot is not self._first:
            self._take(self._first)
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
        check_successor(self.robot, robot, "robot")
        self._take(robot)
        self._read()

    def measure(self) -> Measurement:
        """Return what ideal sensors measure now."""
        task = self.robot.task
        if isinstance(task, FrameTask):
            x = task.of(self._chain.placement(self.data))
            xd = task.velocity_of(self._chain.velocity(self.data))
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
        explicit = self.model.opt.integrator == mujoco_module().mjtIntegrator.mjINT_RK4
        stiffest = fastest_decay(robot) if explicit else 0.0
        self.longest_step = 1.0 / max(1.0 / LONGEST_STEP, stiffest)

    def _read(self) -> None:
        """Read q and v, and update what depends on them."""
        mj, model, data = mujoco_module(), self.model, self.data
        angles, self._v = data.qpos[self._qpos], data.qvel[self._dofs]
        chain = self.robot.model
        self._q = angles if chain.nq == chain.nv else configuration_from_angles(chain, angles)
        mj.mj_kinematics(model, data)
        mj.mj_comPos(model, data)
        mj.mj_comVel(model, data)
