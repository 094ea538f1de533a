"""Pushes on the tool of an arm that carries a load: which are detected as contact, and how soon.

``python -m benchmarks.contact [ROBOT...]``: the default controller at 500 Hz, with a
camera and encoders of 17 bits, learns a load, a tool and friction on a circle of 5 cm. Then, for
each force along and against each axis of the base, it follows the circle again, from what it has
learned, and the force begins to act on the tool. The loop is that of ``pinadapt drive``, with the
numbers of the checklist as they are.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import pinadapt as pa
from pinadapt.description.chain import effort_limits
from pinadapt.realtime import CycleLog, PlantArm, RealtimeLoop, Recorder, Safety, Scheduling

from .timing import markdown

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

    def unexplained(self) -> dict[str, Any]:
        """Learn, and return what is left unexplained without a force, of the motors' limits."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "run.mcap"
            with Recorder(path, self.controller) as recorder:
                arm, loop = self.run(np.zeros(3), LEARNED, recorder)
            residual = np.abs(CycleLog.read(path).cycles.residual).max(axis=0)
        state = loop.result.state
        assert state is not None and not loop.result.failed, loop.result
        self.start = {"a_k": state.a_k, "a_d": state.a_d}
        limits = effort_limits(self.true.model)
        share = float((residual / limits).max())
        rests = arm.first("the adaptation rests: contact")[0] is not None
        found = {"robot": self.name, "force": None, "share": share, "rests": rests}
        return {**found, "limits": [float(limits.min()), float(limits.max())]}

    def run(
        self, force: np.ndarray, seconds: float, recorder: Recorder | None = None
    ) -> tuple[PushedArm, RealtimeLoop]:
        """Return arm and loop after a run with a force (3) [N]."""
        arm = PushedArm(self.true, self.sensors, force)
        loop = RealtimeLoop(
            arm,
            self.controller,
            self.circle,
            stage="adapt",
            start=self.start,
            safety=Safety(),
            recorder=recorder,
            scheduling=Scheduling(None, None, False),
            say=arm.hear,
        )
        with arm:
            loop.run(seconds)
        return arm, loop


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table in Markdown: of six directions, in how many the arm was stopped, how soon."""
    header = ["", "limits", "unexplained", *(f"{force:g} N" for force in FORCES), "rest before"]
    lines = []
    for name in dict.fromkeys(row["robot"] for row in rows):
        own = [row for row in rows if row["robot"] == name]
        quiet = next(row for row in own if row["force"] is None)
        low, high = quiet["limits"]
        cells = [name, f"{low:.3g} to {high:.3g} N m", f"{100.0 * quiet['share']:.2g} %"]
        for force in FORCES:
            pushes = [r for r in own if r["force"] and max(map(abs, r["force"])) == force]
            told = [row["stopped_ms"] for row in pushes if row["stopped_ms"] is not None]
            times = f", in {min(told)} to {max(told)} ms" if told else ""
            fast = sum(row["check"] == "velocity" for row in pushes)
            words = f" ({fast} by `velocity`)" if fast else ""
            cells.append(f"{len(told)}{times}{words}")
        gaps = [r["stopped_ms"] - r["rested_ms"] for r in own if r.get("check") == "contact"]
        lines.append([*cells, f"{min(gaps)} to {max(gaps)} ms"])
    return markdown(header, lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=ROBOTS)
    options = parser.parse_args(arguments)
    rows: list[dict[str, Any]] = []
    for name in options.robots:
        carrier = Carrier(name)
        rows.append(carrier.unexplained())
        print(rows[-1], flush=True)
        for force in FORCES:
            for direction in np.vstack([np.eye(3), -np.eye(3)]):
                rows.append(carrier.row(force * direction))
                print(rows[-1], flush=True)
    print(report(rows))


if __name__ == "__main__":
    main()
