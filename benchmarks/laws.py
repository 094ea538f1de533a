"""The laws compared: tracking error, and cost of a step.

``make laws.table`` runs the sweep ``laws.toml`` and writes ``laws.csv``: the robots of
robots/panda/tool_and_load.toml under every law: tool, load, all inertias and friction unknown,
natural adaptation, default gains, 1 kHz.
Task-space laws follow the file's circle with perfect sensors and with the file's camera;
joint-space laws, which see no tool, swing every joint by 0.2 rad in 3 s with perfect sensors;
set-point laws move to the point of the circle opposite to home, 0.2 m away, and stay there. Errors
are the largest of the last tenth of 10 s; the cost of a step is in calls of the Panda's forward
dynamics, ``pin.aba``, timed alternately with it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.scenario.scenario import Scenario

from .shared import CAMERA, HERE, in_turn, quiet

SCENARIO = HERE.parent / "robots" / "panda" / "tool_and_load.toml"
DURATION = 10.0  # [s]
ROUNDS, CALLS = 3000, 16
UNDISTURBED = 0.1  # quantile of the times that other processes do not disturb
SWING, PERIOD = 0.2, 3.0  # [rad], [s]


class Case:
    """The robots, the motion and the controllers of one law."""

    def __init__(self, law: str, scenario: Scenario) -> None:
        """Take the law and the scenario whose robots it moves."""
        self.law = law
        self.joints = pa.laws.LAWS[law].joint_space
        robots = scenario.true, scenario.estimated
        self.true, self.model = map(in_joint_space, robots) if self.joints else robots
        self.path: pa.trajectories.Trajectory = scenario.trajectory
        if self.joints:
            swing = pa.trajectories.Sinusoid(self.true.home_angles + SWING, SWING, PERIOD)
            point = pa.trajectories.Hold(self.true.home_angles + SWING)
            self.path = point if pa.laws.LAWS[law].set_point else swing
        elif pa.laws.LAWS[law].set_point:
            assert isinstance(self.path, pa.trajectories.Circle)
            self.path = pa.trajectories.Hold(self.path.at(0.5 * self.path.period).x_d)

    def controller(self, sensors: pa.Sensors | None = None) -> pa.Controller:
        """Return a controller with default gains, and without a memory of torques."""
        return pa.make_controller(
            self.model,
            law=self.law,
            adaptation="natural" if self.law == pa.laws.DEFAULT else None,
            unknown=pa.Unknown(friction=True, armature=True),
            sensors=sensors,
        )

    def error(self, sensors: pa.Sensors | None = None) -> float | None:
        """Return the largest error of the last tenth [m or rad]; None if the loop diverges."""
        controller = self.controller(sensors)
        path = self.path.as_given()  # at speed, or a step of the set point, from the first sample
        rollout = pa.simulate(self.true, controller, path, duration=DURATION)
        return None if rollout.diverged else float(rollout.summary()["max_error_last"])

    def cost(self) -> float:
        """Return the time of a step in calls of ``pin.aba``."""
        model = self.true.model
        data = self.true.model.createData()
        rest = np.zeros(7)
        controller = self.controller()
        plant = pa.plants.PinocchioPlant(self.true)
        measurement = plant.measurement(self.true.q0, rest + 0.1)
        desired = self.path.at(0.1)
        state = controller.step(controller.init(measurement), measurement, desired, 1e-3)[1]

        def step() -> None:
            controller.step(state, measurement, desired, 1e-3)

        def dynamics() -> None:
            for _ in range(CALLS):
                pin.aba(model, data, self.true.q0, rest, rest)

        times = in_turn({"step": step, "aba": dynamics}, ROUNDS)
        step, aba = (np.quantile(times[name], UNDISTURBED) for name in ("step", "aba"))
        return CALLS * float(step / aba)


def in_joint_space(robot: pa.Robot) -> pa.Robot:
    """Return the same robot with its joints as the task."""
    joints = pa.load(robot.model, task="joint", q0=robot.q0)
    friction = robot.friction
    return joints.changed(viscous=friction.viscous, coulomb=friction.coulomb)


@quiet()
def measure(law: str) -> dict[str, Any]:
    """Return the figures of a law."""
    case = Case(law, Scenario.read(SCENARIO, ["controller.adaptation=natural"]))
    return {
        "unit": "rad" if case.joints else "m",
        "error": case.error(),
        "error_camera": None if case.joints else case.error(pa.Sensors(CAMERA)),
        "step_ratio": case.cost(),
    }
