"""The setting of all contenders: a robot, its wrong model, its sensors, and shared gains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

import pinadapt as pa
from pinadapt.description.chain import velocity_limits
from pinadapt.tuning.defaults import bandwidth
from pinadapt.zoo.experiment import PERIOD, zoo_case

from .inverse_kinematics import InverseKinematics
from .nominal_robot import NominalRobot

SENSORS = {
    "perfect": pa.Sensors(),
    "camera": pa.Sensors(pa.Camera(rate=60.0, delay=0.02), encoder=2.0 * np.pi / 2**17),
}
FASTEST = 1.0  # [s], of the circles
_SPEED_SHARE = 0.8  # of the description's speed limits
_STEP = 5e-3  # [s], of the inverse kinematics that finds the largest speed


@dataclass(frozen=True, eq=False)
class Setting:
    """One robot of the zoo, as all contenders have it.

    Attributes:
        true, nominal: the true robot and the initial model.
        plane, phase: of the circle through home.
        radius: the zoo's, or less if a turn in 1 s exceeded four fifths of a velocity limit [m].
        sensors: of the robot.
    """

    true: pa.Robot
    nominal: pa.Robot
    plane: str
    phase: float
    radius: float
    sensors: pa.Sensors

    @cached_property
    def w(self) -> float:
        """The default bandwidth [rad/s]."""
        return bandwidth(self.nominal, PERIOD, pa.laws.Separation.own_bandwidth)

    @cached_property
    def model(self) -> NominalRobot:
        """Kinematics and dynamics of the nominal robot."""
        return NominalRobot(self.nominal)

    @cached_property
    def damping(self) -> np.ndarray:
        """The diagonal (n) of the default's own K_D at home [N m s/rad]."""
        controller = self.controller(adaptation="none")
        law = controller.law
        a_d = controller.dynamics.initial
        assert isinstance(law, pa.laws.Separation)
        return np.diag(law.K_D(self.nominal.q0, a_d)).copy()

    def controller(self, *, compensate_delay: bool = True, **words: Any) -> pa.Controller:
        """Return a controller for the nominal model and the sensors."""
        sensors = replace(self.sensors, compensate_delay=compensate_delay)
        return pa.make_controller(self.nominal, dt=PERIOD, sensors=sensors, **words)

    def circle(self, period: float) -> pa.trajectories.Trajectory:
        """Return the circle with a period [s] through the true robot's home."""
        start = self.true.position(self.true.q0)
        circle = pa.trajectories.Circle(
            np.zeros(start.size), self.radius, period, self.plane, self.phase
        )
        return circle.starting_at(start)

    def informed(self) -> Setting:
        """Return the same setting with the true model."""
        return replace(self, nominal=self.true)


@lru_cache
def setting(robot: str, sensors: str) -> Setting:
    """Return the setting of a robot of the catalogue with sensors by name."""
    case = zoo_case(robot)
    found = pa.reachable_circle(pa.load(robot))
    whole = Setting(
        case.true, case.estimated, found.plane, found.phase, case.radius, SENSORS[sensors]
    )
    allowed = _SPEED_SHARE * velocity_limits(case.true.model)
    excess = float((_speeds(whole, FASTEST) / allowed).max())
    return replace(whole, radius=case.radius / max(1.0, excess))


def _speeds(of: Setting, period: float) -> np.ndarray:
    """Return the largest joint speeds (n) [rad/s] on the circle of a period [s]."""
    path = of.circle(period)
    q = of.true.q0
    largest = np.zeros(of.true.model.nv)
    follow = InverseKinematics(NominalRobot(of.true), of.w)
    for t in np.arange(0.0, 1.5 * period, _STEP):
        desired = path.at(t)
        rate = follow.rate(q, desired.x_d, desired.xd_d)
        q = q + _STEP * rate
        largest = np.maximum(largest, np.abs(rate))
    return largest
