"""What moves the true robot in a simulation, and in which steps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import isfinite

import numpy as np

from .._checks import flag, instance, positive, take_checked, whole, word
from ..controller.controller import PERIOD, Controller
from ..exceptions import InputError
from ..plants.elastic_plant import ElasticPlant
from ..plants.mujoco_plant import MujocoFile, MujocoPlant
from ..plants.pinocchio_plant import PinocchioPlant
from ..plants.plant import PlantMaker, SimulatedPlant
from ..robot.motors import Actuators
from ..robot.motors import torque_limits as limits_of
from ..robot.robot import Robot

PLANTS = {"pinocchio": PinocchioPlant, "mujoco": MujocoPlant}


@dataclass(frozen=True)
class Engine:
    """What moves the true robot, and in which steps.

    ``simulate(engine=...)`` takes a name, a ``MujocoFile``, what makes a plant, or ``Actuators`` in
    its place.

    Attributes:
        plant: "pinocchio", "mujoco", a ``MujocoFile``, which MuJoCo simulates in place of the true
            robot, or what makes a ``SimulatedPlant`` of a robot, such as a class of them.
        dt: period at which the controller is called, its torque held in between; or, if continuous,
            the integration step [s]. None: the period that the controller was made for.
        substeps: integration steps per period; None: as many as the plant needs.
        continuous: integrate plant, estimates and filters as one ordinary differential equation, by
            Runge-Kutta 4; Pinocchio only, and with perfect sensors.
        ideal_acceleration: if continuous: give the law the plant's own acceleration in place of the
            filtered one, for checking theory.
        torque_limits: whether the motors clip at the true robot's effort limits; limits of zero or
            infinity are none. They never do with the ideal acceleration, which is that of the
            unclipped torque: there the controller's own limits are left out too. A controller
            without limits is given these, so that its adaptation rests while they clip.
        actuators: of the true robot: late motors, elastic joints; None: ideal ones. What the
            controller knows of them is its own, ``Limits(actuators=...)``.

    Raises:
        InputError: unknown name, invalid values, or an ideal acceleration without ``continuous``.
    """

    plant: str | MujocoFile | PlantMaker = "pinocchio"
    dt: float | None = None
    substeps: int | None = None
    continuous: bool = False
    ideal_acceleration: bool = False
    torque_limits: bool = True
    actuators: Actuators | None = None

    def __post_init__(self) -> None:
        """Refuse invalid values."""
        instance(self.actuators, Actuators | None, "engine.actuators")
        self.maker()
        if self.dt is not None:
            positive(self.dt, "engine.dt")
        if self.substeps is not None:
            whole(self.substeps, "engine.substeps", 1)
        take_checked(self, flag, "engine.", "continuous", "ideal_acceleration", "torque_limits")
        if self.ideal_acceleration and not self.continuous:
            raise InputError("exists in continuous mode only.", where="engine.ideal_acceleration")

    @classmethod
    def of(cls, given: Engine | str | MujocoFile | PlantMaker | Actuators) -> Engine:
        """Return an engine given as one, by its plant, or by the actuators of Pinocchio's.

        Raises:
            InputError: as the class.
        """
        if isinstance(given, Actuators):
            return cls(actuators=given)
        return given if isinstance(given, cls) else cls(given)  # type: ignore[arg-type]

    def period(self, controller: Controller) -> float:
        """Return the period or integration step [s] with a controller."""
        if self.dt is not None:
            return self.dt
        return controller.period if isfinite(controller.period) else PERIOD

    def motors(self, true: Robot) -> np.ndarray | None:
        """Return the torque limits (n) of the true robot's motors [N m or N], or None."""
        return limits_of(true, self.torque_limits and not self.ideal_acceleration)

    def make(self, true: Robot, controller: Controller) -> SimulatedPlant:
        """Return the plant of a true robot.

        Raises:
            InputError: a function that takes no options or returns no ``SimulatedPlant``; a plant
                that cannot be integrated as one equation with the controller: late motors, elastic
                joints, MuJoCo; or as the plant's class.
        """
        try:
            plant = self.maker()(
                true,
                torque_limits=self.motors(true),
                compensation=controller.compensation,
                substeps=self.substeps,
            )
        except TypeError as error:
            raise InputError(
                f"{error}.",
                where="engine.plant",
                hint="A function takes a robot and the options of SimulatedPlant as keywords.",
            ) from error
        instance(plant, SimulatedPlant, "engine.plant")
        plain = isinstance(plant, PinocchioPlant) and plant.actuators.ideal
        if not plain and self.continuous:
            raise InputError(
                "only Pinocchio's equations, of ideal actuators, can be integrated as one with the "
                "controller's.",
                where="engine.continuous",
                hint='Leave it out, or take plant = "pinocchio" without actuators.',
            )
        return plant

    def maker(self) -> PlantMaker:
        """Return what makes the plant, with its actuators.

        Raises:
            InputError: no such plant, or springs with another one than Pinocchio's.
        """
        plant = self.plant
        actuators = self.actuators
        if isinstance(plant, MujocoFile):
            maker: PlantMaker = partial(MujocoPlant, mjcf=plant)
        else:
            maker = plant if callable(plant) else PLANTS[word(plant, PLANTS, "engine.plant")]
        if actuators is None or actuators.ideal:
            return maker
        if actuators.elastic and plant == "pinocchio":
            maker = ElasticPlant
        return partial(maker, actuators=actuators)
