"""Where the contenders meet: a robot, its wrong model, its sensors, and the gains all share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.description.chain import velocity_limits
from pinadapt.tuning.defaults import bandwidth
from pinadapt.zoo.case import PERIOD, TOOL_ERROR, zoo_case

from .believed_robot import BelievedRobot
from .inverse_kinematics import InverseKinematics

SENSORS: dict[str, dict[str, Any]] = {
    "perfect": {},
    "camera": {"camera": {"rate": 60.0, "delay": 0.02}, "encoder": 2.0 * np.pi / 2**17},
}
FASTEST = 1.0  # [s], of the circles
_SPEED_SHARE = 0.8  # of the description's speed limits
_STEP = 5e-3  # [s], of the inverse kinematics that looks for the largest speed


@dataclass(frozen=True, eq=False)
class Setting:
    """One robot of the zoo as the contenders find it.

    Attributes:
        true, believed: the real robot and what is believed of it.
        plane, phase: of the circle through home.
        radius: the zoo's, or less where a turn in 1 s would exceed four fifths of a speed limit.
        sensors: what they are, as ``make_controller`` and ``simulate`` take it.
    """

    true: pa.Robot
    believed: pa.Robot
    plane: str
    phase: float
    radius: float
    sensors: Mapping[str, Any]

    @cached_property
    def w(self) -> float:
        """The default bandwidth [rad/s]."""
        return bandwidth(self.believed, PERIOD)

    @cached_property
    def model(self) -> BelievedRobot:
        """What a user computes of the believed robot."""
        return BelievedRobot(self.believed)

    @cached_property
    def damping(self) -> np.ndarray:
        """The diagonal (n) of the default's own K_D at home [N m s/rad]."""
        law = self.controller(adaptation="none").law
        assert isinstance(law, pa.Separation)
        return np.diag(law.K_D(self.believed.q0)).copy()

    def controller(self, **words: Any) -> pa.Controller:
        """Return a controller for the believed robot that is told of the sensors."""
        return pa.make_controller(self.believed, dt=PERIOD, **self.sensors, **words)

    def circle(self, period: float) -> pa.Trajectory:
        """Return the circle [s] through the true robot's home."""
        start = self.true.position(self.true.q0)
        circle = pa.Circle(np.zeros(start.size), self.radius, period, self.plane, self.phase)
        return circle.starting_at(start)

    def informed(self) -> Setting:
        """Return the same with the truth believed."""
        return replace(self, believed=self.true)


@lru_cache
def setting(robot: str, sensors: str) -> Setting:
    """Return the setting of a robot of the catalogue with sensors by name."""
    case, found = zoo_case(robot), pa.reachable_circle(pa.load(robot), tool_error=TOOL_ERROR)
    whole = Setting(
        case.true, case.believed, found.plane, found.phase, case.radius, SENSORS[sensors]
    )
    allowed = _SPEED_SHARE * velocity_limits(case.true.model)
    excess = float((_speeds(whole, FASTEST) / allowed).max())
    return replace(whole, radius=case.radius / max(1.0, excess))


def _speeds(of: Setting, period: float) -> np.ndarray:
    """Return the largest joint speeds (n) [rad/s] on the circle of a period [s]."""
    path, q, largest = of.circle(period), of.true.q0, np.zeros(of.true.model.nv)
    follow = InverseKinematics(BelievedRobot(of.true), of.w)
    for t in np.arange(0.0, 1.5 * period, _STEP):
        desired = path.at(t)
        rate = follow.rate(q, desired.x_d, desired.xd_d)
        q, largest = q + _STEP * rate, np.maximum(largest, np.abs(rate))
    return largest
