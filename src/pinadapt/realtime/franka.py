"""Franka Research 3 and Panda by the vendor's own client, ``pylibfranka`` (extra ``franka``).

Conventions of the Franka Control Interface, 1 kHz:

* A torque is that behind the gears, without gravity and without the friction of the motors: the
  robot adds both, gravity with the load that is set on it. So the controller is made with
  ``compensated="nominal"``, and what is wrong in the robot's own gravity is learned like any load.
* ``tau_J``, the measured torque, has gravity in it and is ``Measurement.tau``.
* The torque may change by 1000 N m/s. The time is the robot's, in milliseconds.
* ``control_command_success_rate``, the share of the last 100 commands that the robot has received,
  is ``received`` once 100 were sent; before and without control it is 0 or counts fewer.
* Above the collision thresholds the robot stops by its reflex; then, and after errors, it waits for
  a recovery. A torque that stays out for some cycles is an error too, so a killed program stops it.

This was run against ``franky-sim``, which serves the same protocol from a MuJoCo model without
limits, reflexes and errors. It is no evidence about friction, elasticity or timing of a real arm.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._checks import optional, vector
from ..exceptions import ArmError, InputError
from ..records import Measurement
from ..robot.changes import Payload
from ..robot.motors import Gravity
from ..robot.robot import Robot
from .arm import Arm, ArmFacts

TORQUE = np.repeat((87.0, 12.0), (4, 3))  # [N m], the vendor's limits
# [N m] for the reflex of the joints, and [N], [N m] for that of the flange: those of the vendor's
# examples, about twice for the first joints and the forces. Half: the 3 kg that the arm may carry
# stop it while they are not known, 25 N m stretched out; twice: nearly all that the motors give.
COLLISION = (40.0, 40.0, 38.0, 38.0, 16.0, 14.0, 12.0)
FORCES = np.repeat((40.0, 25.0), 3)
_RECOVER = (
    "Remove its cause, move the arm by hand from its limits, and acknowledge the error: "
    "FrankaArm(address, robot, recover=True), on the command line --recover."
)


class FrankaArm(Arm):
    """A Franka arm.

    Attributes:
        address: of its control box.
    """

    def __init__(
        self,
        address: str,
        robot: Robot,
        *,
        collision: ArrayLike = COLLISION,
        forces: ArrayLike = FORCES,
        load: Payload | None = None,
        recover: bool = False,
    ) -> None:
        """Connect; nothing moves.

        Args:
            address: of the control box.
            robot: its description, seven joints; the gravity that the arm adds is taken from it.
            collision: (7) torques beyond the model at which the robot's own reflex stops it [N m].
            forces: (6) the same for force and torque at the flange [N, N m].
            load: that is set on the robot, which then compensates its gravity; ``robot`` must have
                it too, see ``at_task_frame``. com and inertia are given in the axes of the flange.
                None: nothing is set.
            recover: acknowledge the error of an earlier run.

        Raises:
            InputError: pylibfranka is missing, no answer, a description of another arm, or another
                number of thresholds.
        """
        pylibfranka = optional("pylibfranka", "franka", "franka")
        if robot.model.nv != len(TORQUE):
            raise InputError(
                f"a Franka has {len(TORQUE)} joints; the description has {robot.joint_names}.",
                where="robot",
                hint="Lock the fingers, and take a frame behind the seventh joint.",
            )
        self._vendor = pylibfranka
        self._failures = (pylibfranka.FrankaException, RuntimeError)  # of which its others are
        self.address = address
        torques = vector(collision, len(TORQUE), "collision", fills=False).tolist()
        wrench = vector(forces, len(FORCES), "forces", fills=False).tolist()
        self._thresholds = torques, torques, wrench, wrench  # of contact and collision alike
        self._load = load
        self._recover = recover
        self.facts = ArmFacts.of(
            robot,
            name=f"Franka at {address}",
            period=1e-3,  # of its control interface
            torque=TORQUE,
            torque_rate=1000.0,
            compensation=Gravity(robot),
        )
        try:  # any kernel: the loop says what the system denies
            self._robot: Any = pylibfranka.Robot(address, pylibfranka.RealtimeConfig.kIgnore)
        except self._failures as error:
            raise InputError(
                f"cannot be reached: {str(error).rstrip(chr(46))}.",
                where=address,
                hint="Is this the address of the control box, and FCI activated in Desk?",
            ) from error
        self._control: Any = None
        self._commands = 0

    def read(self) -> Measurement:
        """Wait for the robot's next cycle and return its state.

        Raises:
            ArmError: the robot has stopped by a reflex or an error, or the connection broke.
        """
        self._runs()
        with self._talking():
            if self._control is None:
                state = self._robot.read_once()
            else:
                state, _ = self._control.readOnce()
                if self._commands >= 100:  # of which the robot states the share
                    self.received = float(state.control_command_success_rate)
        return Measurement(
            float(state.time.to_sec()),
            np.array(state.q),
            np.array(state.dq),
            tau=np.array(state.tau_J),
        )

    def begin(self) -> None:
        """Set collision behaviour and load, and take over the control.

        Raises:
            ArmError: the robot is in error, stopped by its user, or controlled by someone else.
        """
        vendor = self._vendor
        with self._talking():
            state = self._robot.read_once()
            mode = state.robot_mode
            failed = mode == vendor.RobotMode.Reflex or state.current_errors
            if failed and self._recover:
                self._robot.automatic_error_recovery()
            elif failed or mode != vendor.RobotMode.Idle:
                raise ArmError(
                    f"is not ready: its mode is {mode.name}, its errors {state.current_errors}.",
                    where=self.facts.name,
                    hint=f"{_RECOVER} Or release the user stop, unlock the brakes in Desk, end "
                    "other programs.",
                )
            self._robot.set_collision_behavior(*self._thresholds)
            if self._load is not None:
                seen = self._load.spatial_inertia()
                inertia = seen.inertia.ravel().tolist()
                self._robot.set_load(seen.mass, seen.lever.tolist(), inertia)
            self._control = self._robot.start_torque_control()

    def send(self, torque: np.ndarray) -> None:
        """Send a torque (7) [N m], without gravity.

        Raises:
            ArmError: as ``read``.
            InputError: not seven finite numbers.
        """
        if self._control is None:  # it has stopped
            return
        given = vector(torque, len(TORQUE), "torque", fills=False)
        with self._talking():
            self._control.writeOnce(self._vendor.Torques(given.tolist()))
            self._commands += 1

    def stop(self, reason: str) -> None:
        """Finish the motion; the robot then holds its place by its own controller and brakes."""
        control = self._control
        self._control = None
        if not self._ends(reason) or control is None:
            return
        with suppress(*self._failures):
            control.readOnce()
            torques = self._vendor.Torques([0.0] * len(TORQUE))
            torques.motion_finished = True
            control.writeOnce(torques)
            return
        with suppress(*self._failures):
            self._robot.stop()

    def close(self) -> None:
        """Give the connection back."""
        self._control = self._robot = None

    @contextmanager
    def _talking(self) -> Iterator[None]:
        """Say what an error of the vendor's client means.

        Raises:
            ArmError: it has raised one.
        """
        try:
            yield
        except self._failures as error:
            self._control = None  # the motion has ended; the client would wait for its next cycle
            kind = "does not answer"
            hint = "Is the cable in, and the control box on?"
            if isinstance(error, self._vendor.ControlException):
                kind = "has stopped the motion"
                hint = _RECOVER
            words = " ".join(str(error).split()).rstrip(".")
            raise ArmError(f"{kind}: {words}.", where=self.facts.name, hint=hint) from error


def at_task_frame(load: Payload, robot: Robot) -> Payload:
    """Return a load that is given in the axes of the flange in those of the task frame.

    Raises:
        InputError: the description has no flange, a frame whose name ends in "link8".
        RobotError: impossible mass or inertia.
    """
    model = robot.model
    flange = next((frame for frame in model.frames if frame.name.endswith("link8")), None)
    task = model.frames[robot.frame_id]
    if flange is None or flange.parentJoint != task.parentJoint:
        raise InputError(
            "has no frame '..._link8', the flange, on the body of the task frame.", where="robot"
        )
    seen = task.placement.actInv(flange.placement).act(load.spatial_inertia())
    return Payload(seen.mass, seen.lever, seen.inertia[np.tril_indices(3)])
