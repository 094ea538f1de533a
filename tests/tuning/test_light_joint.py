"""A joint too light for an unknown load under an acceleration law is reported before the run."""

import warnings

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.laws.acceleration_law import AccelerationLaw
from pinadapt.tuning.preflight import lightest_joint
from tests.support.chains import catalogue_robot

INVERSE, FORCES = "adaptive-inverse-dynamics", "adaptive-jacobian"
ACCELERATIONS = [
    name
    for name, law in pa.laws.LAWS.items()
    if law.adapts and issubclass(law, AccelerationLaw) and not law.joint_space
]


def light(robot, **options):
    """Return the finding about a controller made for a robot."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        controller = pa.make_controller(robot, **{"law": INVERSE, **options})
    return lightest_joint(controller.motion, controller.law)


@pytest.mark.parametrize("law", ACCELERATIONS)
def test_a_light_wrist_is_named_with_the_load_that_it_tolerates(law):
    with pytest.warns(
        UserWarning,
        match="wrist_3_joint moves only .* above 0.076 kg, 88 mm off its axis",
    ):
        pa.make_controller(catalogue_robot("ur10"), law=law)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("panda", {}),
        ("scara", {}),  # its light last joint is vertical: no weight turns it
        ("planar_2r", {}),
        ("ur10", {"law": FORCES}),
        ("ur10", {"law": "separation"}),
        ("ur10", {"adaptation": "none"}),
        ("ur10", {"unknown": pa.Unknown(bodies="none")}),
        ("ur10", {"unknown": pa.Unknown(bodies=["wrist_2_joint"])}),
    ],
    ids=str,
)
def test_no_joint_is_named_where_none_can_spin(name, options):
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*believed to move only")
        pa.make_controller(catalogue_robot(name), **{"law": INVERSE, **options})


@pytest.mark.parametrize("name", ["ur10", "kinova", "tiago_arm"])
def test_the_load_turns_the_joint_a_quarter_radian_against_the_feedback(name):
    """Against rnea: the weight of the told load, off the axis, over M_jj and the least K_P."""
    robot, rng = catalogue_robot(name), np.random.default_rng(0)
    found, controller = light(robot), pa.make_controller(robot, law=INVERSE)
    j, stiffness = robot.joint_names.index(found.joint), controller.law.K_P[0, 0]
    arms = rng.standard_normal((200, 3))
    arms *= found.arm / np.linalg.norm(arms, axis=1)[:, None]
    data, largest, states = robot.model.createData(), 0.0, controller.motion.states.q
    rest = [pin.computeGeneralizedGravity(robot.model, data, q)[j] for q in states]
    least = [pin.crba(robot.model, data, q)[j, j] * stiffness for q in states]
    for arm in arms:  # in the joint's own axes
        model = robot.model.copy()
        model.inertias[j + 1] += pin.Inertia(found.load, arm, np.zeros((3, 3)))
        loaded = model.createData()
        for q, own, torque in zip(states, rest, least, strict=True):
            weight = pin.computeGeneralizedGravity(model, loaded, q)[j] - own
            largest = max(largest, abs(weight) / torque)
    assert 0.22 < largest <= 0.25 + 1e-9  # the directions are random


@pytest.fixture(scope="module")
def arm():
    """Return an xArm7, what its wrist bears, and a run of 2 s with that load so many times."""
    robot = catalogue_robot("xarm7")
    found = light(robot)

    def run(times, believed=robot, **options):
        tool, com = (
            [0.3 * found.arm, -0.4 * found.arm, found.arm],
            [0.6 * found.arm, 0.8 * found.arm, 0.0],
        )
        true = robot.changed(
            tool_translation=tool, payload=pa.Payload(mass=times * found.load, com=com)
        )
        circle = pa.trajectories.Circle(np.zeros(3), 0.08, 3.0, "yz").starting_at(
            true.position(true.q0)
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            controller = pa.make_controller(believed, **{"law": INVERSE, "dt": 2e-3, **options})
            return pa.simulate(true, controller, circle.as_given(), duration=2.0)

    return robot, found, run


def test_the_named_load_is_held_and_a_far_heavier_one_is_not(arm):
    _, _, run = arm
    held = run(1.0)
    assert held.diverged is None and held.distance[-250:].max() < 2e-4
    assert run(20.0).diverged < 0.2
