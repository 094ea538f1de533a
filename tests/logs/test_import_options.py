"""Logs in users' formats are read with a small file beside them, and state what was assumed."""

import warnings
from dataclasses import fields, replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.logs import ImportOptions
from tests.logs.test_logs import columns_of, same, write_bag, write_csv
from tests.support.recorded import recorded

GEAR = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
GEAR[5, 4] = 32.0  # a coupled wrist: motor 6 turns with joint 5


@pytest.fixture
def log():
    """Return a second and a half of its motion, without a camera."""
    return replace(recorded("ur5", duration=1.5, dt=4e-3), x=None, x_time=None)


def read(source, robot, **import_options):
    """Return a log that is read without any warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return pa.read_log(source, robot, import_options=import_options)


def samples(log, chosen):
    """Return a log with other samples."""
    return replace(log, **{part: getattr(log, part)[chosen] for part in ("t", "q", "v", "tau")})


# Columns, times, files


@pytest.mark.parametrize(("signals", "timed"), [("q tau", True), ("q v tau", False)])
def test_columns_of_a_file_without_header_are_numbered(tmp_path, robot, log, signals, timed):
    path = tmp_path / "a.csv"
    signals = signals.split()
    columns = [*([log.t] * timed), *(getattr(log, s) for s in signals)]
    np.savetxt(path, np.column_stack(columns), "%.17g", ",")
    options = {} if timed else {"rate": 250.0}
    with pytest.raises(pa.LogError, match=r"no joint positions found.*q=2-8"):
        pa.read_log(path, robot, import_options=options)
    columns = {"t": "1"} if timed else {}
    for k, signal in enumerate(signals):
        first = 1 + timed + 6 * k
        columns[signal] = [f"{first}-{first + 5}"]
    assert same(read(path, robot, columns=columns, **options), log, ("t", *signals))


def test_a_rate_replaces_missing_or_jittering_times(tmp_path, robot, log):
    table = columns_of(log, range(6))
    jitter = {**table, "t": log.t + 1e-3 * np.sin(1e3 * log.t)}
    without = {name: part for name, part in table.items() if name != "t"}
    for k, columns in enumerate((jitter, without)):
        path = write_csv(tmp_path / f"{k}.csv", columns)
        assert same(read(path, robot, rate=250.0), log)
    with pytest.raises(pa.LogError, match="--rate HZ"):
        pa.read_log(path, robot)
    assert same(read(replace(log, t=log.t**1.1), robot, rate=250.0), log)
    seen = recorded("ur5", duration=1.5, dt=4e-3, rate=25.0)
    slow = replace(seen, t=2.0 * seen.t, x_time=2.0 * seen.x_time)
    assert same(read(slow, robot, rate=250.0), seen, ("t", "x_time"))  # of late frames, too
    assert same(read(write_csv(tmp_path / "2.csv", jitter), robot), log, ("q", "v", "tau"))


# Joints


def test_joints_of_other_names_are_stated(tmp_path, robot, log):
    names = [f"left_{name}" for name in robot.joint_names]
    order = [3, 0, 5, 1, 2, 4]
    other = replace(log.ordered(order), joints=tuple(names[k] for k in order))
    assert same(read(other, robot, joints=names), log)
    table = columns_of(log.ordered(order), other.joints, "{signal}_{label}")
    path = write_csv(tmp_path / "a.csv", table)
    assert same(read(path, robot, joints=[name.lower() for name in names]), log)
    for source in (other, path):
        with pytest.raises(pa.LogError, match=r"--joints A,B"):
            pa.read_log(source, robot)
    swapped = [robot.joint_names[k] for k in order]  # columns in another order than their names
    assert same(read(log, robot, joints={"tau": swapped}), log.ordered(order, ("tau",)))
    nameless = replace(log, joints=())
    assert same(read(nameless, robot, joints=swapped), log.ordered(np.argsort(order)))


# Units, gears, signs


def test_motor_signals_are_converted_by_their_gears(robot, log):
    """Power is the same on both sides, so that tau = G^T tau_m for q_m = G q."""
    gains = np.array([0.1, 0.2, 0.1, 0.05, 0.3, 0.1])
    zero = np.array([0.0, 0.5, -0.5, 0.0, 0.0, 1.0])
    inverse = np.linalg.inv(GEAR)
    motors = replace(
        log,
        q=(log.q - zero) @ GEAR.T,
        v=log.v @ GEAR.T,
        tau=log.tau @ inverse / gains,
    )
    power = np.sum(motors.tau * gains * motors.v, axis=1)
    assert np.allclose(power, np.sum(log.tau * log.v, axis=1))
    found = read(motors, robot, gear=GEAR.tolist(), torque_gain=gains, offset=zero)
    assert same(found, log)
    assert same(read(replace(log, tau=log.tau @ inverse), robot, torque_gain=GEAR.T), log)


def test_gains_signs_and_offsets_are_given_for_some_joints(robot, log):
    scale = np.array([1.0, 10.0, 1.0, 1.0, 1.0, 1.0])
    sign = np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
    changed = replace(log, tau=log.tau / scale * sign, q=log.q * sign - 0.3, v=log.v * sign)
    options = {
        "torque_gain": {"shoulder_lift_joint": 10.0},
        "flip": ["elbow_joint", "q:elbow_joint"],
        "offset": 0.3 * sign,
    }
    found = read(changed, robot, **options)
    assert same(found, replace(log, q=log.q - 0.3 * sign + 0.3 * sign))
    assert np.allclose(read(changed, robot, torque_gain=2.0).tau, 2.0 * changed.tau)


def test_repeated_samples_are_refused_or_left_out(robot, log):
    rng = np.random.default_rng(0)
    again = np.arange(len(log.t)) - (rng.uniform(size=len(log.t)) < 0.2)
    again = np.maximum(again, 0)
    held = replace(samples(log, again), t=log.t)
    with pytest.raises(pa.LogError, match=r"samples repeat the one before.*--repeated drop"):
        pa.read_log(held, robot)
    twice = np.sort(np.append(np.arange(len(log.t)), np.arange(0, len(log.t), 5)))
    doubled = samples(log, twice)
    with pytest.raises(pa.LogError, match=r"times must ascend.*--repeated drop"):
        pa.read_log(doubled, robot)
    with pytest.warns(UserWarning, match="of 450 samples repeat earlier ones"):
        assert same(pa.read_log(doubled, robot, import_options={"repeated": "drop"}), log)
    with pytest.warns(UserWarning, match="repeat earlier ones"):
        found = pa.read_log(held, robot, import_options={"repeated": "drop"})
    kept = np.append(True, again[1:] != again[:-1])
    assert same(found, samples(held, kept))
    still = replace(samples(log, np.maximum(np.arange(len(log.t)), 100)), t=log.t)
    pa.read_log(still, robot)  # an arm at rest repeats itself


# Mounting


def test_an_arm_is_mounted_as_stated(robot):
    assert ImportOptions().mounted(robot) is robot
    for options, gravity in (
        ({"mount": "ceiling"}, (0.0, 0.0, 9.81)),
        ({"mount": "floor"}, (0.0, 0.0, -9.81)),
        ({"gravity": (9.0, 1.0, 0.0)}, (9.0, 1.0, 0.0)),
    ):
        hung = ImportOptions(**options).mounted(robot)
        assert np.allclose(hung.model.gravity.linear, gravity)
    assert robot.model.gravity.linear[2] == pytest.approx(-9.81)


# The file


def test_import_options_are_written_and_read(tmp_path):
    full = ImportOptions(
        columns={"t": "stamp", "q": ["a 1", 'b"2']},
        joints=["a", "b"],
        rate=100.0,
        repeated="drop",
        degrees=True,
        gear=[[1.0, 0.0], [0.5, -2.0]],
        torque_gain={"a": 2.0},
        flip=["q:a"],
        offset=[0.1, 0.2],
        topic="/states",
        pose_topic="/pose",
        compensated="nominal",
        gravity=[0.0, 9.81, 0.0],
        doubtful=True,
    )
    path = tmp_path / "a.toml"
    for import_options in (
        full,
        ImportOptions(),
        ImportOptions(mount="wall", joints={"tau": ["a", "b"]}),
    ):
        path.write_text(import_options.text(["What was assumed."]))
        found = ImportOptions.of(path)
        for one in fields(ImportOptions):
            value = getattr(found, one.name)
            given = getattr(import_options, one.name)
            assert np.array_equal(value, given) or list(value) == list(given), one.name


# Bags


def test_a_bag_of_several_topics_and_other_names_is_read(tmp_path, robot, log):
    log = replace(log, x=np.zeros((1, 3)), x_time=np.zeros(1))
    names = ["left_" + name for name in robot.joint_names]
    path = write_bag(tmp_path / "a", "sqlite3", log, names, more={"/gripper": ["finger"]})
    (file,) = path.glob("*.db3")
    alone = file.rename(tmp_path / "alone.db3")
    with pytest.raises(pa.LogError, match=r"no message .* has all of the joints"):
        pa.read_log(alone, robot, import_options={"topic": "/joint_states"})
    assert same(read(alone, robot, topic="/joint_states", joints=names), log, ("q", "v", "tau"))
    path = write_bag(tmp_path / "b", "mcap", log, robot.joint_names, more={"/gripper": ["finger"]})
    with pytest.raises(pa.LogError, match=r"2 topics have .*/gripper.*--topic NAME"):
        pa.read_log(path, robot)
    assert same(read(path, robot, topic="/joint_states"), log, ("q", "v", "tau"))
