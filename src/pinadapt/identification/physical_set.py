"""Which parameters of a believed robot are physical, and where ignorance leaves them."""

from __future__ import annotations

import numpy as np

from ..exceptions import ParameterError
from ..models.bodies import BodyDynamics
from ..models.dynamics import Dynamics
from ..models.pseudo_inertia import nearest_physical
from ..models.regressor import PER_BODY
from ..models.stacked import StackedDynamics
from ..robot.robot import Robot
from .physical_fit import PhysicalSet

_MASS, _RADIUS = 1e-3, 1e-2  # least ones: of the mean body's, of the reach


def physical_set(dynamics: Dynamics, robot: Robot) -> PhysicalSet:
    """Return the physical parameters, their centre at the description.

    Bodies that are described without mass or thinner than a hundredth of the reach are taken to be
    thicker, as no mass distribution can be drawn to what is on the border of all of them.

    Raises:
        ParameterError: the parameters are not those of bodies and joints.
    """
    inertial = dynamics.inertial if isinstance(dynamics, StackedDynamics) else dynamics
    if not isinstance(inertial, BodyDynamics):
        raise ParameterError(
            "least squares in the physical cone are for parameters of bodies and joints.",
            where="identify",
            hint="An estimator takes any dynamics: see pinadapt.Estimator.",
        )
    least_mass, least_radius = _MASS * robot.mass / robot.model.nv, _RADIUS * robot.reach
    tens = [
        nearest_physical(pi, least_mass=least_mass, least_radius=least_radius)
        for pi in inertial.initial.reshape(-1, PER_BODY)
    ]
    rest = dynamics.initial[inertial.size :]
    return PhysicalSet(len(tens), np.concatenate([*tens, rest]))
