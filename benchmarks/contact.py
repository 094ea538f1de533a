"""Pushes on the tool of an arm that carries a load: which are detected as contact, and how soon.

``python -m benchmarks.contact``: the default controller at 500 Hz, with a camera and encoders of 17
bits, learns a load, a tool and friction on a circle of 5 cm. Then, for each force along and against
each axis of the base, it follows the circle again, from what it has learned, and the force begins
to act on the tool. The loop is that of ``pinadapt drive``, with the numbers of the checklist as
they are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.realtime import PlantArm, RealtimeLoop, Safety, Scheduling

from .shared import COUNT

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
        self.force = force
        self._robot = true
        self._data = true.model.createData()
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

    def damped_after(self) -> int | None:
        """Return how long after the force the loop damped the arm [ms]; None: it did not."""
        times = [t for t, words in self.heard if words.startswith("damping: ")]
        return round(1e3 * (times[0] - BEGIN)) if times else None


def pushed(name: str) -> None:
    """Measure, and print of six directions of a force in how many it was found, and how soon."""
    robot = pa.load(name)
    load = pa.Payload(1.0, [0.02, 0.0, 0.06])
    tool = [0.02, -0.01, 0.05]
    true = robot.changed(payload=load, tool_translation=tool, viscous=0.5, coulomb=0.3)
    sensors = pa.Sensors(camera=pa.Camera(rate=30.0, delay=0.05), encoder=COUNT[17])
    controller = pa.make_controller(
        robot, unknown=pa.Unknown(tool=True), sensors=sensors, dt=PERIOD
    )
    circle = pa.trajectories.Circle(robot.position(robot.q0), 0.05, 4.0)

    def run(force: np.ndarray, seconds: float, start: dict[str, Any]) -> tuple[PushedArm, Any]:
        """Return arm and result of a run with a force (3) [N]."""
        arm = PushedArm(true, sensors, force)
        loop = RealtimeLoop(
            arm,
            controller,
            circle,
            stage="adapt",
            start=start,
            safety=Safety(),
            recorder=None,
            scheduling=Scheduling(None, None, False),
            say=arm.hear,
        )
        with arm:
            loop.run(seconds)
        return arm, loop.result

    _, learned = run(np.zeros(3), LEARNED, {})
    assert learned.state is not None and not learned.failed, learned
    start = {"a_k": learned.state.a_k, "a_d": learned.state.a_d}
    for force in FORCES:
        pushes = np.vstack([force * np.eye(3), -force * np.eye(3)])
        ends = [run(push, END, start)[0].damped_after() for push in pushes]
        times = [end for end in ends if end is not None]
        print(f"{name}, {force:g} N: {len(times)} of {len(ends)}, after {times} ms", flush=True)


if __name__ == "__main__":
    for name in ROBOTS:
        pushed(name)
