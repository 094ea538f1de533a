"""The placements of a wrong arm are calibrated from measured positions and poses."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from benchmarks.calibration import OFFSET, measured, random_angles, wrong_arm
from pinadapt.cli.command_line import main
from pinadapt.description.chain import configuration_from_angles
from pinadapt.identification import calibrate
from pinadapt.identification.calibration import ALL, _Geometry, _MeasuredFrames, _unknown_placements
from pinadapt.tasks.frame import TASKS, matrix
from tests.support.chains import catalogue_robot, mixed_robot
from tests.support.differences import derivative

NOISE = 2e-4  # m
TRACKER = pin.SE3(pin.exp3(np.array([1.0, 2.0, -0.7])), np.array([1.0, -2.0, 0.5]))


@cache
def wrong(name):
    return wrong_arm(catalogue_robot(name), np.random.default_rng(0))


def recorded(name, count=80, seed=1, **options):
    """Return a log of a wrong arm at random configurations, with encoders that are off."""
    real, rng = wrong(name), np.random.default_rng(seed)
    angles = random_angles(catalogue_robot(name), rng, count)
    return measured(real, angles, rng, **{"noise": NOISE, "offsets": OFFSET, **options})


def true_errors(found, log):
    """Return how far each frame of a log (N) is from the calibrated robot [m]."""
    base = pin.SE3.Identity() if found.tracker is None else found.tracker
    model = found.robot.model
    seen = [
        base.act(found.robot.placement(configuration_from_angles(model, q)).translation)
        for q in log.q
    ]
    return np.linalg.norm(log.x[:, :3] - seen, axis=1)


@pytest.mark.parametrize("robot", [catalogue_robot("ur5"), mixed_robot()], ids=["ur5", "mixed"])
def test_rows_are_the_derivatives_of_the_measured_coordinates(robot):
    """The mixed chain has a slide, a continuous joint, and axes in any direction."""
    task, rng = TASKS["pose"], np.random.default_rng(0)
    q = pin.integrate(robot.model, robot.q0, rng.uniform(-1.0, 1.0, robot.model.nv))
    x = TASKS["pose"].of(robot.placement(q))
    seen = _MeasuredFrames(
        task, q[None], np.zeros((1, robot.model.nv)), x[None], np.zeros(robot.model.nv)
    )
    parts = _unknown_placements(robot, ALL, task, None)

    def moved(step):
        geometry = _Geometry(robot, parts, pin.SE3.Identity())
        geometry.move(step)
        at = geometry.robot(robot, "").placement(q)
        return np.concatenate([at.translation, pin.log3(at.rotation @ matrix(x[3:]).T)])

    geometry = _Geometry(robot, parts, pin.SE3.Identity())
    r, W, J = geometry.rows(seen)
    assert np.abs(r).max() < 1e-12 and len(geometry.names) == 6 * (robot.model.nv + 1)
    for k, name in enumerate(geometry.names):
        step = np.eye(len(geometry.names))[k]
        slope = derivative(lambda h, step=step: moved(h * step))
        assert np.abs(W[0, :, k] - slope).max() < 1e-9, name
        if name.endswith("offset"):
            joint = robot.joint_names.index(name.removesuffix(".offset"))
            assert np.abs(W[0, :, k] - J[0, :, joint]).max() < 1e-12


@pytest.mark.parametrize(("name", "told"), [("ur5", 4 * 6 + 3), ("scara", 4 * 3 + 2 + 3)])
def test_a_wrong_arm_is_calibrated_to_the_noise_of_the_tracker(name, told, tmp_path):
    """All four numbers of a revolute joint, both of a prismatic one, tool and base are found."""
    found = calibrate(recorded(name, 150), catalogue_robot(name))
    assert found.trusted and found.before.position > 10e-3
    assert found.after.position < 1.25 * np.sqrt(3.0) * NOISE
    assert found.noise[0] == pytest.approx(NOISE, rel=0.15) and found.noise[1] is None
    other = recorded(name, 30, seed=2, noise=0.0)
    errors = true_errors(found, other)
    assert np.sqrt(np.mean(errors**2)) < NOISE and errors.max() < 4.0 * NOISE
    assert len(found.combinations) in (told, told - 1)
    assert len(found.names) == len(found.combinations) + len(found.unidentified)
    first, *_ = catalogue_robot(name).joint_names
    if name == "ur5":
        assert "shoulder_lift_joint.turn_x" in found.unidentified[f"{first}.offset"]
    found.save(tmp_path)
    read = pa.load(tmp_path / "learned.urdf", frame=found.robot.frame)
    assert "calibrated" in (tmp_path / "learned.urdf").read_text()
    for q in other.q[:5]:
        q = configuration_from_angles(read.model, q)
        off = read.placement(q).homogeneous - found.robot.placement(q).homogeneous
        assert np.abs(off).max() < 1e-12


def test_the_tracker_may_stand_anywhere_and_measure_poses():
    log = recorded("ur5", pose=True, tracker=TRACKER)
    found = calibrate(log, catalogue_robot("ur5"), tracker=True)
    other = recorded("ur5", 30, seed=2, noise=0.0, tracker=TRACKER)
    errors = true_errors(found, other)
    off = found.tracker.actInv(TRACKER)  # the first joint is off, too
    assert np.linalg.norm(off.translation) < 0.02 and np.linalg.norm(pin.log3(off.rotation)) < 0.1
    assert errors.max() < 1e-3 and found.after.turn < 3e-3 and found.before.turn > 0.02
    assert found.noise[1] == pytest.approx(1e-3, rel=0.2)
    assert found.unidentified["wrist_3_joint.offset"] == ("tool.turn_z",)
    assert "tracker" in str(found) and found._repr_html_().startswith("<div>")
    plain = calibrate(recorded("ur5", pose=True), catalogue_robot("ur5"))
    assert len(plain.combinations) == len(found.combinations)
    with pytest.raises(pa.LogError, match=r"turned by .* --tracker"):
        calibrate(log, catalogue_robot("ur5"))


@pytest.mark.parametrize("name", ["ur5", "scara"])
def test_offsets_of_encoders_alone(name):
    """For an arm that is exact otherwise, estimates err as their standard deviations state."""
    robot, rng = catalogue_robot(name), np.random.default_rng(3)
    offsets = rng.uniform(-0.02, 0.02, robot.model.nv)
    angles = random_angles(robot, rng, 60)
    log = measured(robot, angles, rng, noise=NOISE, offsets=offsets)
    found = calibrate(log, robot, unknown="offsets")
    values, deviations = np.array(list(found.offsets.values())).T
    seen = [name not in found.unidentified for name in found.names]
    assert list(found.offsets) == robot.joint_names and np.count_nonzero(seen) >= len(seen) - 1
    off = ((values - offsets) / deviations)[seen]
    assert np.abs(off).max() < 4.0 and deviations[seen].max() < 3e-3
    exact = measured(robot, angles, rng, offsets=offsets)
    values = np.array(
        [value for value, _ in calibrate(exact, robot, unknown="offsets").offsets.values()]
    )
    assert np.abs(values - offsets)[seen].max() < 1e-8


def test_noise_of_encoders_is_separated_from_that_of_the_tracker():
    robot, rng = catalogue_robot("ur5"), np.random.default_rng(4)
    angles = random_angles(robot, rng, 100)
    log = measured(robot, angles, rng, noise=NOISE)
    log = replace(log, q=angles + 2e-3 * rng.standard_normal(angles.shape))
    plain, stated = calibrate(log, robot), calibrate(log, robot, encoder=2e-3)
    assert plain.noise[0] > 3.0 * NOISE
    assert stated.noise[0] == pytest.approx(NOISE, rel=0.5)
    exact = recorded("ur5", 30, seed=2, noise=0.0)
    exact = measured(robot, exact.q, rng)
    assert np.mean(true_errors(stated, exact)) < np.mean(true_errors(plain, exact))


def test_impossible_frames_are_left_out():
    log, rng = recorded("ur5", 120), np.random.default_rng(5)
    x = log.x.copy()
    lost = rng.choice(len(x), 8, replace=False)
    x[lost] += rng.uniform(0.05, 0.5, (8, 1))
    found = calibrate(replace(log, x=x), catalogue_robot("ur5"))
    assert found.outliers == 8 and found.frames == 112
    assert found.after.position < 1.3 * np.sqrt(3.0) * NOISE


def test_frames_of_another_clock_are_named():
    robot = catalogue_robot("ur5")
    t = np.arange(0.0, 10.0, 0.04)
    rates = 0.7 + 0.23 * np.arange(6)
    angles = np.sin(t[:, None] * rates + np.arange(6)) + robot.home_angles
    log = replace(measured(robot, angles, np.random.default_rng(0)), t=t)
    late = replace(log, x=np.vstack([log.x[:1], log.x[:-1]]))
    found = calibrate(late, robot)
    assert not found.trusted and "ms before their time stamps would explain more" in found.verdict
    assert found.late[0] == pytest.approx(0.04, rel=0.1)
    timed = calibrate(replace(late, x=late.x[1:], x_time=t[:-1]), robot)
    assert timed.after.position < 1e-6


def changed(**parts):
    return lambda log: replace(log, **{name: f(log) for name, f in parts.items()})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (changed(x=lambda log: 1e3 * log.x), "millimetres"),
        (changed(x=lambda log: log.x * [1.0, -1.0, 1.0]), "only a mirror explains"),
        (changed(x=lambda log: 1e-3 * log.x), "does not move with the arm"),
        (changed(x=lambda log: np.nan * log.x), "no positions or poses"),
        (changed(x=lambda _: None), "no positions or poses"),
        (changed(x=lambda log: np.hstack([log.x, log.x[:, :2]])), "5 coordinates"),
        (changed(q=lambda log: 0.0 * log.q), "moves its frame by"),
        (changed(q=lambda log: np.degrees(log.q)), "degrees"),
        (changed(x=lambda log: np.where(np.arange(80)[:, None] < 9, log.x, np.nan)), "too few"),
    ],
)
def test_logs_that_show_no_geometry_are_refused(change, words):
    with pytest.raises(pa.LogError, match=words):
        calibrate(change(recorded("ur5")), catalogue_robot("ur5"))


def test_a_correct_arm_is_reported_as_such():
    robot, rng = catalogue_robot("scara"), np.random.default_rng(6)
    found = calibrate(measured(robot, random_angles(robot, rng, 60), rng, noise=NOISE), robot)
    assert found.trusted and "the description is as good" in found.verdict


def test_a_log_of_something_else_is_not_trusted():
    log = recorded("ur5")
    found = calibrate(replace(log, x=log.x[::-1]), catalogue_robot("ur5"))
    assert not found.trusted and "NOT TO BE TRUSTED" in found.verdict


def test_options_are_checked():
    log, robot = recorded("ur5"), catalogue_robot("ur5")
    for options, words in (
        ({"unknown": "elbow"}, "Did you mean 'elbow_joint'"),
        ({"unknown": []}, "nothing is unknown"),
        ({"held_out": 0.6}, "at most a half"),
        ({"encoder": -1e-3}, "must not be negative"),
    ):
        with pytest.raises(pa.InputError, match=words):
            calibrate(log, robot, **options)


def test_the_command_reads_logs_without_torques_and_times(tmp_path, capsys):
    log = recorded("scara", pose=True)
    names = catalogue_robot("scara").joint_names
    header = ",".join([*(f"q_{name}" for name in names), *"xyz", "qx", "qy", "qz", "qw"])
    path, out = tmp_path / "poses.csv", tmp_path / "out"
    np.savetxt(path, np.hstack([log.q, log.x]), "%.9g", ",", header=header, comments="")
    assert main(["calibrate", str(path), "--robot", "scara", "--out", str(out)]) == 0
    assert "identified by this motion" in capsys.readouterr().out
    numbers = json.loads((out / "summary.json").read_text())
    assert numbers["trusted"] and numbers["after"]["position"] < 1e-3
    assert len(numbers["combinations"]) + len(numbers["unidentified"]) == len(numbers["parameters"])
    assert (out / "learned.urdf").is_file()
