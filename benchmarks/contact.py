"""Pushes on the tool of an arm that carries a load: which are detected as contact, and how soon.

``python -m benchmarks.contact [ROBOT...]``: the default controller at 500 Hz, with a
camera and encoders of 17 bits, learns a load, a tool and friction on a circle of 5 cm. Then, for
each force along and against each axis of the base, it follows the circle again, from what it has
learned, and the force begins to act on the tool. The loop is that of ``pinadapt drive``, with the
numbers of the checklist as they are.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.realtime import PlantArm, RealtimeLoop, Safety, Scheduling

ROBOTS = ("panda", "ur5", "kinova", "z1")
FORCES = (10.0, 20.0, 30.0, 50.0, 100.0)  # [N]
PERIOD, LEARNED, BEGIN, END = 2e-3, 8.0, 1.0, 1.4  # [s]


class PushedArm(PlantArm):
    """An arm on whose tool a force acts from a time on.

    Attributes:
        force: (3) in the axes of the base [N].
        heard: what the loop said, each with the time of the arm [s].
    """

    def __init__(self, true: pa.Robot, sensors: pa.Sensors, force: np.ndarray) -> None:
        """Take the true robot, the sensors and the force (3) [N]."""
        super().__init__(pa.plants.PinocchioPlant(true), PERIOD, sensors=sensors)
        self.force, self._robot, self._data = force, true, true.model.createData()
        self.heard: list[tuple[float, str]] = []

    def send(self, torque: np.ndarray) -> None:
        """Send a torque (n) [N m or N]."""
        if self._count * PERIOD >= BEGIN:
            place = self._robot.frame_id, pin.LOCAL_WORLD_ALIGNED
            q = self.plant.measure().q
            J = pin.computeFrameJacobian(self._robot.model, self._data, q, *place)[:3]
            torque = torque + J.T @ self.force
        super().send(torque)

    def hear(self, words: str) -> None:
        """Keep what the loop says."""
        self.heard.append((self._count * PERIOD, words))

    def first(self, words: str) -> tuple[int | None, str]:
        """Return what the loop first said that begins so, and how long after the force [ms]."""
        for t, said in self.heard:
            if said.startswith(words) and not said.endswith("the path rests"):
                return round(1e3 * (t - BEGIN)), said.removeprefix(words)
        return None, ""


class Carrier:
    """A robot that carries a load, and what has been learned of it."""

    def __init__(self, name: str) -> None:
        """Take the name of the robot; nothing is learned yet."""
        self.name, robot = name, pa.load(name)
        load = pa.Payload(1.0, [0.02, 0.0, 0.06])
        tool = [0.02, -0.01, 0.05]
        self.true = robot.changed(payload=load, tool_translation=tool, viscous=0.5, coulomb=0.3)
        camera = pa.Camera(rate=30.0, delay=0.05)
        self.sensors = pa.Sensors(camera=camera, encoder=2.0 * np.pi / 2**17)
        unknown = pa.Unknown(tool=True)
        self.controller = pa.make_controller(
            robot, unknown=unknown, sensors=self.sensors, dt=PERIOD
        )
        self.circle = pa.trajectories.Circle(robot.position(robot.q0), 0.05, 4.0)
        self.start: dict[str, Any] = {}

    def row(self, force: np.ndarray) -> dict[str, Any]:
        """Return what a force (3) [N] leads to."""
        arm, _ = self.run(force, END)
        stopped, why = arm.first("damping: ")
        rested, _ = arm.first("the adaptation rests: contact")
        return {
            "robot": self.name,
            "force": force.tolist(),
            "stopped_ms": stopped,
            "check": why.partition(":")[0],
            "rested_ms": rested,
        }

    def learn(self) -> None:
        """Learn without a force; later runs start from the estimates."""
        _, loop = self.run(np.zeros(3), LEARNED)
        state = loop.result.state
        assert state is not None and not loop.result.failed, loop.result
        self.start = {"a_k": state.a_k, "a_d": state.a_d}

    def run(self, force: np.ndarray, seconds: float) -> tuple[PushedArm, RealtimeLoop]:
        """Return arm and loop after a run with a force (3) [N]."""
        arm = PushedArm(self.true, self.sensors, force)
        loop = RealtimeLoop(
            arm,
            self.controller,
            self.circle,
            stage="adapt",
            start=self.start,
            safety=Safety(),
            recorder=None,
            scheduling=Scheduling(None, None, False),
            say=arm.hear,
        )
        with arm:
            loop.run(seconds)
        return arm, loop


def main() -> None:
    """Measure, and print of six directions of a force in how many it was found, and how soon."""
    for name in sys.argv[1:] or ROBOTS:
        carrier = Carrier(name)
        carrier.learn()
        for force in FORCES:
            pushes = np.vstack([force * np.eye(3), -force * np.eye(3)])
            rows = [carrier.row(push) for push in pushes]
            times = [row["stopped_ms"] for row in rows if row["stopped_ms"] is not None]
            print(f"{name}, {force:g} N: {len(times)} of {len(rows)}, after {times} ms", flush=True)


if __name__ == "__main__":
    main()
