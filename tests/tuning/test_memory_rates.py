"""The rates of a memory of all torques that follow from robot, law and sensors."""

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot

MEMORY, NATURAL = "natural-memory", "natural"


def test_the_tracking_error_teaches_slowly_beside_a_memory():
    """Gamma is kappa times that of the default rates, which is the memory's covariance."""
    robot = catalogue_robot("ur5")
    plain, made = (
        pa.make_controller(robot, adaptation=kind, dt=1e-4).adaptation_d
        for kind in (NATURAL, MEMORY)
    )
    start = pa.make_controller(robot).dynamics.initial
    assert made.share == pytest.approx((1.75 / 8.0) ** 2)
    assert np.allclose(made.gain(start), made.share * plain.gain(start), rtol=1e-9)


def noise_for(encoder):
    """Return the noise (n) of the memory of a UR5 with encoders of a resolution [rad]."""
    sensors = pa.Sensors(encoder=encoder)
    made = pa.make_controller(catalogue_robot("ur5"), adaptation=MEMORY, sensors=sensors)
    return made.adaptation_d.noise


def test_memory_takes_what_encoders_do_to_the_regressor_for_noise():
    noises = [noise_for(c) for c in (0.0, 2.0 * np.pi / 2**17, 2.0 * np.pi / 2**14)]
    assert (noises[1] > 3.0 * noises[0]).all() and (noises[2] > 3.0 * noises[1]).all()
    assert np.allclose(noise_for(1e-9), noises[0], rtol=0.01)
