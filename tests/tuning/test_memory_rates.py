"""The rates of a memory of all torques that follow from robot, law and sensors."""

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.tuning.defaults import prior_variances
from tests.support.chains import catalogue_robot

MEMORY = "natural-memory"


def test_a_memory_starts_three_deviations_wide():
    made = pa.make_controller(catalogue_robot("ur5"), adaptation=MEMORY, dt=1e-4)
    gain = made.adaptation_d.gain(pa.adaptation.Estimate(made.dynamics.initial))
    prior = prior_variances(catalogue_robot("ur5"), made.motion.dynamics)
    P = np.diag(gain)[: prior.size] / made.adaptation_d.share
    assert np.median(P / prior) == pytest.approx(3.0**2, rel=0.1)


def noise_for(encoder):
    """Return the noise (n) of the memory of a UR5 with encoders of a resolution [rad]."""
    sensors = pa.Sensors(encoder=encoder)
    made = pa.make_controller(catalogue_robot("ur5"), adaptation=MEMORY, sensors=sensors)
    return made.adaptation_d.noise


def test_the_noise_of_a_memory_includes_that_of_encoders_in_the_regressor():
    noises = [noise_for(c) for c in (0.0, 2.0 * np.pi / 2**17, 2.0 * np.pi / 2**14)]
    assert (noises[1] > 3.0 * noises[0]).all() and (noises[2] > 3.0 * noises[1]).all()
    assert np.allclose(noise_for(1e-9), noises[0], rtol=0.01)


# --- by default ---


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        ({}, "natural-memory"),
        ({"unknown": pa.Unknown(tool=False, armature=False)}, "natural-memory"),
        ({"unknown": ["bodies", "friction"], "law": "slotine-li"}, "natural"),
        ({"unknown": pa.Unknown(friction=False)}, "natural-memory"),
        ({"unknown": pa.Unknown(friction="viscous")}, "natural-memory"),
        ({"unknown": pa.Unknown(bodies="payload")}, "natural-memory"),
        ({"unknown": pa.Unknown(bodies=["joint2"])}, "natural-memory"),
        ({"adaptation": "natural"}, "natural"),
        ({"adaptation": "none"}, "none"),
        ({"law": "computed-torque"}, "none"),
        ({"law": "middleton-goodwin"}, "natural-composite"),
        ({"law": "bounded-torque"}, "natural"),
        ({"sensors": pa.Sensors(encoder=1e-4, camera=pa.Camera(rate=30.0))}, "natural-memory"),
    ],
    ids=str,
)
def test_a_memory_is_the_default_where_the_law_remembers_parameters_of_bodies(options, kind):
    law = pa.laws.LAWS[options.get("law", "separation")]
    robot = catalogue_robot("z1", **({"task": "joint"} if law.joint_space else {}))
    made = pa.make_controller(robot, **options)
    assert made.adaptation_d.name == kind
