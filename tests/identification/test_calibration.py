"""The placements of a wrong arm are calibrated from measured positions and poses."""

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import pinadapt as pa
from benchmarks.calibration import OFFSET, measured, random_angles, wrong_arm
from pinadapt.description.chain import configuration_from_angles
from pinadapt.identification import calibrate
from pinadapt.identification.calibration import ALL, _Geometry, _MeasuredFrames, _Unknown
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
    real = wrong(name)
    rng = np.random.default_rng(seed)
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
    task = TASKS["pose"]
    rng = np.random.default_rng(0)
    q = pin.integrate(robot.model, robot.q0, rng.uniform(-1.0, 1.0, robot.model.nv))
    x = TASKS["pose"].of(robot.placement(q))
    seen = _MeasuredFrames(task, q[None], x[None])
    parts = _Unknown(robot, ALL, task, None)

    def moved(step):
        geometry = _Geometry(robot, parts, pin.SE3.Identity())
        geometry.move(step)
        at = geometry.robot("").placement(q)
        return np.concatenate([at.translation, pin.log3(at.rotation @ matrix(x[3:]).T)])

    geometry = _Geometry(robot, parts, pin.SE3.Identity())
    r, W = geometry.rows(seen)
    assert np.abs(r).max() < 1e-12 and len(geometry.unknown.names) == 6 * (robot.model.nv + 1)
    for k, name in enumerate(geometry.unknown.names):
        step = np.eye(len(geometry.unknown.names))[k]
        slope = derivative(lambda h, step=step: moved(h * step))
        assert np.abs(W[0, :, k] - slope).max() < 1e-9, name


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
    if name == "ur5":
        assert "shoulder_pan_joint.offset" in found.unidentified
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
    assert "wrist_3_joint.offset" in found.unidentified
    plain = calibrate(recorded("ur5", pose=True), catalogue_robot("ur5"))
    assert len(plain.combinations) == len(found.combinations)
    with pytest.raises(pa.LogError, match=r"turned by .* --tracker"):
        calibrate(log, catalogue_robot("ur5"))


def test_a_tool_stays_as_described_where_the_tracker_may_be_off_instead():
    """All axes of a SCARA are parallel, so a longer tool looks like a lower base."""
    robot = catalogue_robot("scara")
    rng = np.random.default_rng(0)
    log = measured(robot, random_angles(robot, rng, 60), rng, noise=NOISE, tracker=TRACKER)
    found = calibrate(log, robot, tracker=True)
    assert abs(found.estimate[found.names.index("tool.shift_z")]) < 5e-3


def test_frames_of_another_clock_are_not_trusted():
    robot = catalogue_robot("ur5")
    t = np.arange(0.0, 10.0, 0.04)
    rates = 0.7 + 0.23 * np.arange(6)
    angles = np.sin(t[:, None] * rates + np.arange(6)) + robot.home_angles
    log = replace(measured(robot, angles, np.random.default_rng(0)), t=t)
    late = replace(log, x=np.vstack([log.x[:1], log.x[:-1]]))
    found = calibrate(late, robot)
    assert not found.trusted and "timed on the clock of q" in found.verdict
    timed = calibrate(replace(late, x=late.x[1:], x_time=t[:-1]), robot)
    assert timed.after.position < 1e-6
