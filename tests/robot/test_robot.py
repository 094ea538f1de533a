"""Loading, locking, changing and refusing robots."""

from functools import cache
from pathlib import Path

import example_robot_data
import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from pinadapt.description.catalogue import robots_folder
from pinadapt.description.chain import effort_limits
from tests.support.chains import catalogue_robot as load
from tests.support.chains import random_state
from tests.support.descriptions import arm4
from tests.support.paths import ARM4

described = cache(example_robot_data.load)


# --- any source ---


@pytest.mark.parametrize("kind", ["path", "model", "wrapper"])
def test_every_source_gives_the_same_chain(kind):
    wrapper = described("ur5")
    sources = {"path": Path(wrapper.urdf), "model": wrapper.model, "wrapper": wrapper}
    expected = load("ur5")
    robot = pa.load(sources[kind], frame="tool0")
    assert robot.joint_names == expected.joint_names
    q, v, a = random_state(expected, np.random.default_rng(0))
    assert np.allclose(robot.position(q), expected.position(q), atol=1e-12)
    tau, tau_expected = (
        pin.rnea(r.model, r.model.createData(), q, v, a) for r in (robot, expected)
    )
    assert np.allclose(tau, tau_expected, atol=1e-10)


# --- the chain is kept, the rest is locked ---


def test_panda_keeps_seven_joints_and_locks_its_fingers():
    robot = load("panda")
    assert described("panda").model.nv == 9
    assert robot.joint_names == [f"panda_joint{i}" for i in range(1, 8)]
    whole = sum(inertia.mass for inertia in described("panda").model.inertias[1:])
    assert np.isclose(
        sum(inertia.mass for inertia in robot.model.inertias[1:]), whole
    )  # the fingers still weigh


def test_continuous_joints_are_set_and_read_as_angles():
    name = "kinova"
    nq = 9
    nv = 6
    angles = np.linspace(-1.2, 1.1, nv)
    robot = load(name).at(angles)
    assert (robot.model.nq, robot.model.nv, robot.q0.size) == (nq, nv, nq)
    assert np.allclose(robot.home_angles, angles, atol=1e-12)


# --- refusals ---

REFUSED = [
    (
        lambda: pa.load(robots_folder() / "planar_2r" / "planr.urdf"),
        ["planr.urdf", "No such file"],
    ),
    (lambda: pa.load("scara", frame="tol"), ["'tol'", "Did you mean 'tool'?"]),
    (lambda: pa.load("scara", frame="base"), ["'base'", "no joint moves"]),
    (
        lambda: pa.load("scara", frame="inner_arm"),
        ["'xyz' has 3 coordinates", "'inner_arm'", "1 joint"],
    ),
    (lambda: pa.load("scara", task="xyy"), ["'xyy'", "Did you mean 'xy"]),
    (lambda: pa.load("scara", locked=["elbw"]), ["'elbw'", "Did you mean 'elbow'?"]),
    (lambda: pa.load("scara", q0=[0.0, 1.0]), ["q0", "4 numbers", "slide_joint"]),
    (lambda: pa.load("scara", gravity=[0.0, 0.0, np.nan]), ["gravity", "finite"]),
]


@pytest.mark.parametrize(("action", "words"), REFUSED)
def test_errors_name_the_cause_and_suggest_the_closest_name(action, words):
    with pytest.raises(pa.InputError) as error:
        action()
    for word in words:
        assert word in str(error.value)


MIMIC = (
    '<axis xyz="0 0 1"/><limit lower="-2"',
    '<axis xyz="0 0 1"/><mimic joint="joint3"/><limit lower="-2"',
)


def test_a_mimic_joint_in_the_chain_is_refused(tmp_path):
    with pytest.raises(pa.RobotError, match="'joint4' mimics"):
        pa.load(arm4(tmp_path, MIMIC), frame="tip")


def test_a_mimic_joint_follows_its_leader(tmp_path):
    path = arm4(tmp_path, MIMIC)
    angles = pa.load(path, task="joint", q0=[0.1, 0.2, 0.3, 0.0, 0.0, 0.0]).home_angles
    assert angles == pytest.approx([0.1, 0.2, 0.3, 0.3, 0.0, 0.0])
    with pytest.raises(pa.RobotError, match="'joint4' follows 'joint3'; lock both"):
        pa.load(path, task="joint", locked=["joint3"])


def test_a_last_body_without_mass_becomes_a_light_ball(tmp_path):
    text = ARM4.read_text()
    body = text[text.index('<link name="link4">') : text.index('<link name="finger1">')]
    path = arm4(tmp_path, (body, '<link name="link4"/>'), ('mass value="0.1"', 'mass value="0"'))
    path.write_text(path.read_text().replace("0.0001", "0"))
    with pytest.warns(UserWarning, match="a ball of aluminium: link4"):
        robot = pa.load(path, frame="tip")
    *others, last = [body.mass for body in robot.model.inertias[1:]]
    assert last == pytest.approx(0.01 * sum(others))
    assert pa.load(path, frame="tip", locked=["joint4"]).model.nv == 3


def test_a_description_without_a_joint_is_refused(tmp_path):
    path = tmp_path / "plane.urdf"
    path.write_text('<robot name="plane"><link name="plane"/></robot>')
    with pytest.raises(pa.RobotError, match="no outermost link is moved by two"):
        pa.load(path)


def test_a_robot_on_its_feet_starts_inside_its_limits():
    """The calves of this description have no zero."""
    feet = ["FL_foot", "FR_foot", "RL_foot", "RR_foot"]
    robot = pa.load(described("a1").urdf, base="free", contacts=feet)
    low, high = robot.model.lowerPositionLimit, robot.model.upperPositionLimit
    assert (low <= robot.q0).all() and (robot.q0 <= high).all()
    with pytest.raises(pa.RobotError, match=r"q0: expected 18 numbers .*FL_hip"):
        pa.load("a1", base="free", contacts=feet, q0=np.zeros(12))
    with pytest.raises(pa.RobotError, match="passive: every joint of a chain has a motor"):
        pa.load("ur5", passive=["foo"])


def test_a_joint_that_moves_without_inertia_is_named():
    model = pin.Model()
    joint = 0
    for name, body in (("first", pin.Inertia.Zero()), ("second", pin.Inertia.FromSphere(1.0, 0.1))):
        joint = model.addJoint(joint, pin.JointModelRZ(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    with pytest.raises(pa.RobotError, match=r"'first'.* have no mass or inertia"):
        pa.load(model, task="joint")
    for parent, name in ((0, "third"), (1, "fourth")):  # Pinocchio needs branch after branch
        model.addJoint(parent, pin.JointModelRZ(), pin.SE3.Identity(), name)
    with pytest.raises(pa.RobotError, match="joint 'fourth' comes after those of another branch"):
        pa.load(model, task="joint")


@pytest.mark.parametrize("what", ["negative mass", "nan mass", "nan placement", "nan gravity"])
def test_models_with_impossible_numbers_are_refused(what):
    model = described("ur5").model.copy()
    if "mass" in what:
        model.inertias[3].mass = -1.0 if "negative" in what else np.nan
    elif what == "nan placement":
        model.jointPlacements[3].translation = np.full(3, np.nan)
    else:
        model.gravity.linear = np.full(3, np.nan)
    with pytest.raises(pa.RobotError):
        pa.load(model, frame="tool0")


# --- changed() ---


LOAD = pa.Payload(
    1.5, [0.02, -0.01, 0.05], [0.010, 0.001, 0.012, 0.002, 0.003, 0.014]
)  # Ixx Ixy Iyy Ixz Iyz Izz


@pytest.mark.parametrize("tool", [None, [0.03, -0.02, 0.12]])
def test_a_payload_is_a_body_fixed_at_the_urdfs_frame(tool):
    robot = load("panda")
    inertia = np.array([[0.010, 0.001, 0.002], [0.001, 0.012, 0.003], [0.002, 0.003, 0.014]])
    by_hand = robot.model.copy()
    frame = robot.model.frames[robot.frame_id]
    body = pin.Inertia(1.5, np.array([0.02, -0.01, 0.05]), inertia)
    by_hand.appendBodyToJoint(frame.parentJoint, body, frame.placement)
    loaded = robot.changed(payload=LOAD, tool_translation=tool).model
    assert np.isclose(pin.computeTotalMass(loaded), pin.computeTotalMass(robot.model) + 1.5)
    q, v, a = random_state(robot, np.random.default_rng(2))
    tau, expected = (pin.rnea(model, model.createData(), q, v, a) for model in (loaded, by_hand))
    assert np.allclose(tau, expected, atol=1e-11)
    assert np.abs(expected - pin.rnea(robot.model, robot.model.createData(), q, v, a)).max() > 0.1


def test_changed_models_share_no_data():
    robot = pa.load("planar_2r")
    other = robot.changed()
    before = robot.model.copy()
    assert other.model == robot.model
    other.model.inertias[1] = pin.Inertia.FromSphere(5.0, 0.1)
    other.model.jointPlacements[2].translation = np.ones(3)
    assert robot.model == before


def test_effort_limits_of_zero_and_infinity_mean_no_limit():
    model = described("ur5").model.copy()
    model.effortLimit = np.array([0.0, np.inf, np.finfo(float).max, 1e308, 5.0, 28.0])
    assert effort_limits(pa.load(model, frame="tool0").model).tolist() == [np.inf] * 4 + [5.0, 28.0]
