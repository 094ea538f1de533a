"""Logs in users' formats are read with a small file beside them, and state what was assumed."""

import re
import warnings
from dataclasses import fields, replace

import numpy as np
import pytest

import pinadapt as pa
from pinadapt._output import toml
from pinadapt.logs import Intake
from tests.logs.test_logs import columns_of, same, write_bag, write_csv
from tests.support.chains import catalogue_robot
from tests.support.recorded import recorded

GEAR = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
GEAR[5, 4] = 32.0  # a coupled wrist: motor 6 turns with joint 5


@pytest.fixture
def robot():
    """Return a robot with six joints."""
    return catalogue_robot("ur5")


@pytest.fixture
def log():
    """Return a second and a half of its motion, without a camera."""
    return replace(recorded("ur5", duration=1.5, dt=4e-3), x=None, x_time=None)


def read(source, robot, **intake):
    """Return a log that is read without any warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return pa.read_log(source, robot, intake=intake)


def rows_of(columns, *, header=True):
    """Return lines of a text file with columns (N, k), named or not."""
    lines = [",".join(repr(float(x)) for x in row) for row in np.column_stack(columns)]
    return "\n".join(lines) + "\n"


# Columns, times, files


@pytest.mark.parametrize(
    ("signals", "timed"),
    [("q v tau", True), ("q tau", True), ("tau q v", True), ("q v tau", False)],
)
def test_a_file_without_header_is_recognised(tmp_path, robot, log, signals, timed):
    path, signals = tmp_path / "a.csv", signals.split()
    path.write_text(rows_of([*([log.t] * timed), *(getattr(log, s) for s in signals)]))
    options = {} if timed else {"rate": 250.0}
    with pytest.warns(UserWarning, match="has no header; its columns were taken for"):
        found = pa.read_log(path, robot, intake=options)
    assert same(found, log, ("t", *signals))
    first = 1 + timed + 6 * signals.index("q")
    assert found.assumed["columns"]["q"] == [f"{first}-{first + 5}"]
    assert same(read(path, robot, **options, **found.assumed), log, ("t", *signals))


def test_columns_of_a_file_without_header_may_alternate_or_be_named(tmp_path, robot, log):
    path = tmp_path / "a.csv"
    triples = np.dstack([log.q, log.v, log.tau]).reshape(len(log.t), -1)
    path.write_text(rows_of([log.t, triples]))
    with pytest.warns(UserWarning, match="q 2,5,8,11,14,17, v 3,6"):
        found = pa.read_log(path, robot)
    assert same(found, log)
    path.write_text(rows_of([log.t, log.tau, log.t, log.q]))
    with pytest.raises(pa.LogError, match="14 columns for 6 joints: their meaning is ambiguous"):
        pa.read_log(path, robot)
    found = read(path, robot, columns={"t": "1", "q": "9-14", "tau": "2-7"})
    assert same(found, log, ("t", "q", "tau")) and found.v is None


def test_a_rate_replaces_missing_or_jittering_times(tmp_path, robot, log):
    table = columns_of(log, range(6))
    jitter = {**table, "t": log.t + 1e-3 * np.sin(1e3 * log.t)}
    without = {name: part for name, part in table.items() if name != "t"}
    for k, columns in enumerate((jitter, without)):
        path = write_csv(tmp_path / f"{k}.csv", columns)
        assert same(read(path, robot, rate=250.0), log)
    with pytest.raises(pa.LogError, match=r"no times found.*--rate HZ"):
        pa.read_log(path, robot)
    (tmp_path / "bare.csv").write_text(rows_of([log.q, log.v, log.tau]))
    with (
        pytest.raises(pa.LogError, match=r"neither a header nor a column of .*times.*--rate HZ"),
        pytest.warns(UserWarning, match="q 1-6, v 7-12, tau 13-18"),
    ):
        pa.read_log(tmp_path / "bare.csv", robot)
    assert same(read(replace(log, t=log.t**1.1), robot, rate=250.0), log)
    assert same(read(write_csv(tmp_path / "2.csv", jitter), robot), log, ("q", "v", "tau"))


@pytest.mark.parametrize("named", [True, False])
def test_signals_may_be_in_files_of_their_own(tmp_path, robot, log, named):
    late = slice(60, 340)
    times = {"q": log.t[late], "v": log.t, "tau": log.t}
    for signal, t in times.items():
        values = getattr(log, signal)[late if signal == "q" else slice(None)]
        if named:
            columns = dict(zip(robot.joint_names, values.T, strict=True))
            write_csv(tmp_path / f"{signal}.csv", {"time": t, **columns})
        else:
            (tmp_path / f"{signal}.csv").write_text(rows_of([t, values]))
    files = {"v": "v.csv", "tau": "tau.csv"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = pa.read_log(tmp_path / "q.csv", robot, intake={"files": files})
    assert same(found, Part(log, late))
    with pytest.raises(pa.LogError, match=r"no joint torques found.*--files tau=FILE"):
        pa.read_log(
            tmp_path / "q.csv",
            robot,
            intake={"columns": {"q": "2-7", "t": "1"}} if not named else None,
        )


class Part:
    """A part of a log, by its samples."""

    def __init__(self, log, samples):
        """Take the samples."""
        self.t, self.q, self.v, self.tau = (
            getattr(log, s)[samples] for s in ("t", "q", "v", "tau")
        )


def test_files_that_do_not_go_together_are_refused(tmp_path, robot, log):
    table = columns_of(log, range(6))
    path = write_csv(tmp_path / "a.csv", table)
    torques = {name: part for name, part in table.items() if name.startswith("tau")}
    write_csv(tmp_path / "later.csv", {"t": log.t + 100.0, **torques})
    write_csv(tmp_path / "fewer.csv", {name: part[5:] for name, part in torques.items()})
    for words, files in (
        ("are not those of the positions", {"tau": "later.csv"}),
        ("rows without times, and the positions have", {"tau": "fewer.csv"}),
        ("no such file", {"tau": "none.csv"}),
        ("text files and npz archives only", {"tau": "a.bag"}),
        ("must be one of", {"torque": "later.csv"}),
    ):
        (tmp_path / "a.bag").write_bytes(b"")
        with pytest.raises(pa.InputError, match=words):
            pa.read_log(path, robot, intake={"files": files})


# Joints


@pytest.mark.parametrize("form", ["left_{}", "{}_state", "UR5/{}"])
def test_joints_of_other_names_are_matched_with_a_warning(tmp_path, robot, log, form):
    names = [form.format(name) for name in robot.joint_names]
    order = [3, 0, 5, 1, 2, 4]
    shuffled = {part: getattr(log, part)[:, order] for part in ("q", "v", "tau")}
    other = replace(log, joints=tuple(names[k] for k in order), **shuffled)
    with pytest.warns(UserWarning, match=f"{names[2]} = elbow_joint".replace("/", ".")):
        found = pa.read_log(other, robot)
    assert same(found, log) and found.assumed["joints"] == names
    assert same(read(other, robot, joints=names), log)
    table = columns_of(replace(log, **shuffled), [names[k] for k in order], "{signal}_{label}")
    path = write_csv(tmp_path / "a.csv", table)
    with pytest.warns(UserWarning, match="matched by their names"):
        found = pa.read_log(path, robot)
    assert same(found, log)
    assert same(read(path, robot, joints=[name.lower() for name in names]), log)


def test_numbered_joints_are_matched_from_any_number():
    robot, log = catalogue_robot("panda"), recorded("panda", duration=1.5, dt=4e-3)
    for form, first in (("fer_joint{}", 1), ("J{}", 0), ("axis{}_act", 1)):
        names = tuple(form.format(k + first) for k in range(7))
        with pytest.warns(UserWarning, match=f"{names[0]} = panda_joint1"):
            assert same(pa.read_log(replace(log, joints=names), robot), log)


def test_names_that_have_nothing_in_common_are_taken_in_their_order(robot, log):
    names = ("base", "arm", "forearm", "hand", "palm", "tip")
    with pytest.warns(UserWarning, match="matched in their order: base = shoulder_pan_joint"):
        assert same(pa.read_log(replace(log, joints=names), robot), log)


def test_joints_are_put_into_the_stated_order(tmp_path, robot, log):
    order, names = [1, 0, 2, 3, 5, 4], robot.joint_names
    mixed = replace(log, **{part: getattr(log, part)[:, order] for part in ("q", "v", "tau")})
    stated = [names[k] for k in order]
    assert same(read(replace(mixed, joints=()), robot, joints=stated), log)
    assert same(
        read(write_csv(tmp_path / "a.csv", columns_of(mixed, range(6))), robot, joints=stated), log
    )
    torques = replace(log, tau=log.tau[:, order], joints=())
    assert same(read(torques, robot, joints={"tau": stated}), log)


def test_stated_joints_are_names_of_columns_that_have_none(tmp_path, robot, log):
    """Where columns have names, they are those of the log in the robot's order."""
    order, names = [3, 0, 5, 1, 2, 4], robot.joint_names
    mixed = replace(log, **{part: getattr(log, part)[:, order] for part in ("q", "v", "tau")})
    unnamed = write_csv(tmp_path / "a.csv", columns_of(mixed, range(6)))
    for source in (replace(mixed, joints=()), unnamed):
        assert same(read(source, robot, joints=[names[k] for k in order]), log)
    wrong = write_csv(tmp_path / "b.csv", columns_of(mixed, names, "{signal}_{label}"))
    stated = [names[order.index(k)] for k in range(6)]
    for source in (replace(mixed, joints=tuple(names)), wrong):
        assert same(read(source, robot, joints=stated), log)


# Units, gears, signs


def test_motor_signals_are_converted_by_their_gears(robot, log):
    """Power is the same on both sides, so that tau = G^T tau_m for q_m = G q."""
    gains, zero = (
        np.array([0.1, 0.2, 0.1, 0.05, 0.3, 0.1]),
        np.array([0.0, 0.5, -0.5, 0.0, 0.0, 1.0]),
    )
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
    sides = replace(log, tau=log.tau @ inverse)
    assert same(read(sides, robot, gear=GEAR, motor_side=["tau"]), log)


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
    held = replace(log, q=log.q[again], v=log.v[again], tau=log.tau[again])
    with pytest.raises(pa.LogError, match=r"samples repeat the one before.*--repeated drop"):
        pa.read_log(held, robot)
    twice = np.sort(np.append(np.arange(len(log.t)), np.arange(0, len(log.t), 5)))
    doubled = replace(log, **{part: getattr(log, part)[twice] for part in ("t", "q", "v", "tau")})
    with pytest.raises(pa.LogError, match=r"times must ascend.*--repeated drop"):
        pa.read_log(doubled, robot)
    with pytest.warns(UserWarning, match="of 450 samples repeat earlier ones"):
        assert same(pa.read_log(doubled, robot, intake={"repeated": "drop"}), log)
    with pytest.warns(UserWarning, match="repeat earlier ones"):
        found = pa.read_log(held, robot, intake={"repeated": "drop"})
    kept = np.append(True, again[1:] != again[:-1])
    assert same(found, Part(held, kept))
    still = replace(
        log,
        **{
            part: getattr(log, part)[np.maximum(np.arange(len(log.t)), 100)]
            for part in ("q", "v", "tau")
        },
    )
    pa.read_log(still, robot)  # an arm at rest repeats itself


def test_a_joint_that_was_not_recorded_is_named(tmp_path, robot, log):
    silent = replace(log, tau=log.tau * (np.arange(6) != 2))
    with pytest.raises(pa.LogError, match=r"torque of elbow_joint is zero in all samples.*--lock"):
        pa.read_log(silent, robot)
    table = columns_of(log, robot.joint_names)
    table.pop("tauelbow_joint")
    with pytest.raises(pa.LogError, match="no column has tau of joint 'elbow_joint'"):
        pa.read_log(write_csv(tmp_path / "a.csv", table), robot)
    short = np.column_stack([log.t, log.q[:, :5], log.v[:, :5], log.tau[:, :5]])
    (tmp_path / "b.csv").write_text(rows_of([short]))
    with pytest.raises(pa.LogError, match="16 columns for 6 joints"):
        pa.read_log(tmp_path / "b.csv", robot)


def test_positions_and_velocities_of_motors_are_recognised(robot, log):
    with pytest.raises(pa.LogError, match=r"motor before a gear\? --degrees or --gear N"):
        pa.read_log(replace(log, q=100.0 * log.q, v=None), robot)
    with pytest.raises(pa.LogError, match="that of the motor, before a gear of 101"):
        pa.read_log(replace(log, v=101.0 * log.v), robot)


# Mounting


def test_an_arm_is_mounted_as_stated(robot):
    assert Intake().mounted(robot) is robot
    for options, gravity in (
        ({"mount": "ceiling"}, (0.0, 0.0, 9.81)),
        ({"mount": "floor"}, (0.0, 0.0, -9.81)),
        ({"gravity": (9.0, 1.0, 0.0)}, (9.0, 1.0, 0.0)),
    ):
        hung = Intake(**options).mounted(robot)
        assert np.allclose(hung.model.gravity.linear, gravity)
    assert robot.model.gravity.linear[2] == pytest.approx(-9.81)


# The file


def test_an_intake_is_written_and_read(tmp_path):
    full = Intake(
        columns={"t": "stamp", "q": ["a 1", 'b"2']},
        files={"tau": "tau.csv"},
        joints=["a", "b"],
        rate=100.0,
        repeated="drop",
        degrees=True,
        gear=[[1.0, 0.0], [0.5, -2.0]],
        motor_side=["tau"],
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
    for intake in (full, Intake(), Intake(mount="wall", joints={"tau": ["a", "b"]})):
        path.write_text(intake.text(["What was assumed."]))
        found = Intake.of(path)
        expected = {**intake.files} and {"tau": str(tmp_path / "tau.csv")}
        for one in fields(Intake):
            value, given = getattr(found, one.name), getattr(intake, one.name)
            if one.name == "files":
                given = expected or {}
            assert np.array_equal(value, given) or list(value) == list(given), one.name
    keys = {line.split("=")[0].strip("# ") for line in Intake().text().splitlines() if "=" in line}
    assert keys == {one.name for one in fields(Intake)}
    examples = [line.lstrip("# ") for line in Intake().text().splitlines() if "=" in line]
    assert set(toml.loads("\n".join(examples))) == keys


def test_the_file_beside_a_log_is_used(tmp_path, robot, log):
    path = write_csv(tmp_path / "run.csv", columns_of(replace(log, tau=0.1 * log.tau), range(6)))
    (tmp_path / "run.intake.toml").write_text("torque_gain = 10.0\n")
    assert same(pa.read_log(path, robot), log)
    assert same(pa.read_log(path, robot, intake={}), replace(log, tau=0.1 * log.tau))


def test_a_wrong_intake_is_refused_by_name(tmp_path, robot, log):
    (tmp_path / "bad.toml").write_text("rate = = 3")
    (tmp_path / "key.toml").write_text("rates = 3")
    for words, given in (
        ("not valid TOML", tmp_path / "bad.toml"),
        ("no key 'rates'.*Did you mean 'rate'", tmp_path / "key.toml"),
        ("no such file", tmp_path / "none.toml"),
        ("intake.rate: must be positive", {"rate": -1.0}),
        ("intake.repeated: must be one of", {"repeated": "keep"}),
        ("intake.degrees: expected True or False", {"degrees": 1}),
        ("intake.mount: must be one of", {"mount": "table"}),
        ("intake.mount: gravity says already", {"mount": "wall", "gravity": (0.0, 0.0, -9.81)}),
        ("intake.gravity", {"gravity": (0.0, 9.81)}),
        ("intake.motor_side: must be one of", {"motor_side": ["torque"]}),
        ("intake.compensated: must be one of", {"compensated": "mine"}),
        ("intake.columns: expected a mapping", {"columns": ["q"]}),
        ("intake.flip: there is no joint 'elbow'.*elbow_joint", {"flip": ["elbow"]}),
        ("neither a joint nor q:JOINT", {"flip": ["v:elbow_joint"]}),
        ("intake.torque_gain: there is no joint 'elbow'", {"torque_gain": {"elbow": 2.0}}),
        ("intake.torque_gain.*expected 6 numbers", {"torque_gain": [1.0, 2.0]}),
        ("intake.gear.*6 x 6 matrix", {"gear": [[1.0, 2.0], [3.0, 4.0]]}),
        ("intake.gear: these gears cannot be inverted", {"gear": [1.0, 1.0, 0.0, 1.0, 1.0, 1.0]}),
        ("intake.offset.*expected 6 numbers", {"offset": [1.0]}),
        ("intake.joints: 2 names, and ur5 has 6", {"joints": ["elbow_joint", "wrist_1_joint"]}),
        ("intake.joints: there is no joint 'knee'", {"joints": ["knee", *robot.joint_names[1:]]}),
        ("intake.joints: must be one of", {"joints": {"x": robot.joint_names}}),
    ):
        with pytest.raises(pa.LogError, match=words):
            pa.read_log(log, robot, intake=given)


def test_configurations_are_not_converted():
    kinova = catalogue_robot("kinova")
    log = recorded("kinova", duration=1.5, dt=4e-3)
    whole = replace(log, q=log.configurations(kinova), joints=(), v=None, x=None, x_time=None)
    for options in (
        {"degrees": True},
        {"gear": 10.0},
        {"offset": 0.1},
        {"flip": ["q:" + kinova.joint_names[0]]},
    ):
        with pytest.raises(pa.LogError, match="configurations with cosines and sines"):
            pa.read_log(whole, kinova, intake=options)
    assert np.allclose(pa.read_log(whole, kinova, intake={"torque_gain": 2.0}).tau, 2.0 * whole.tau)


# Bags


def test_a_bag_of_several_topics_and_other_names_is_read(tmp_path, robot, log):
    log = replace(log, x=np.zeros((1, 3)), x_time=np.zeros(1))
    names = ["left_" + name for name in robot.joint_names]
    path = write_bag(tmp_path / "a", "sqlite3", log, names, more={"/gripper": ["finger"]})
    (file,) = path.glob("*.db3")
    alone = file.rename(tmp_path / "alone.db3")
    with pytest.warns(UserWarning, match="left_elbow_joint = elbow_joint"):
        found = pa.read_log(alone, robot, intake={"topic": "/joint_states"})
    assert same(found, log, ("q", "v", "tau"))
    assert found.assumed["joints"] == names
    assert same(read(alone, robot, topic="/joint_states", joints=names), log, ("q", "v", "tau"))
    path = write_bag(tmp_path / "b", "mcap", log, robot.joint_names, more={"/gripper": ["finger"]})
    with pytest.warns(UserWarning, match=r"those of '/joint_states'; /gripper lack"):
        found = pa.read_log(path, robot)
    assert same(found, log, ("q", "v", "tau")) and found.assumed == {"topic": "/joint_states"}


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_torques_of_another_topic_are_interpolated(tmp_path, robot, log, kind):
    log = replace(log, x=np.zeros((1, 3)), x_time=np.zeros(1))
    kept = np.arange(0, len(log.t), 2)  # half the rate
    kept = kept[(kept < 100) | (kept > 120)]  # and a gap
    slow = replace(log, t=log.t[kept], q=log.q[kept], v=log.v[kept], tau=log.tau[kept])
    path = tmp_path / ("a.bag" if kind == "ros1" else "a")
    names = robot.joint_names
    write_bag(path, kind, log, names, effort=False, torques=slow, late=0.25)
    inside = (log.t <= slow.t[-1]) & ((log.t <= log.t[100 - 2]) | (log.t >= log.t[122]))
    expected = np.column_stack([np.interp(log.t, slow.t, column) for column in slow.tau.T])
    expected[~inside] = np.nan
    with pytest.warns(UserWarning) as told:
        found = pa.read_log(path, robot)  # the only topics that go together
    said = " ".join(str(each.message) for each in told)
    assert "those of '/joint_states', the torques those of '/efforts'" in said
    lost = np.count_nonzero(~inside)
    assert f"{lost} of {len(log.t)} samples have no value" in said and "within 24 ms" in said
    assert np.allclose(found.tau, expected, atol=1e-4, equal_nan=True)
    assert found.assumed["topic"] == {"q": "/joint_states", "tau": "/efforts"}
    with pytest.warns(UserWarning, match="less the 250 ms by which"):
        found = pa.read_log(path, robot, intake={"topic": {"tau": "/currents"}})
    assert np.allclose(found.tau, expected, atol=1e-4, equal_nan=True)
    assert np.allclose(found.q, log.q) and np.allclose(found.v, log.v)


def test_topics_of_a_bag_are_listed_where_the_choice_is_open(tmp_path, robot, log):
    log = replace(log, x=np.zeros((1, 3)), x_time=np.zeros(1))
    names, path = robot.joint_names, tmp_path / "a"
    write_bag(path, "mcap", log, names, more={"/wrist": names[3:], "/other": names}, torques=log)
    listed = (
        r"/currents:data \(6 numbers\); /efforts \(efforts\); /joint_states \(positions, "
        r"velocities, efforts\); /other \(positions, .*/wrist \(not of all joints.*--topic q=NAME"
    )
    with pytest.raises(pa.LogError, match="several topics fit.*" + listed):
        pa.read_log(path, robot)
    with pytest.raises(pa.LogError, match=r"'/effort' is not a topic.*Did you mean '/efforts'"):
        read(path, robot, topic={"tau": "/effort"})
    with pytest.raises(pa.LogError, match=r"no field 'dta' of 6 numbers.*/currents:data"):
        read(path, robot, topic={"q": "/joint_states", "tau": "/currents:dta"})
    with pytest.raises(pa.LogError, match=r"intake\.topic.*Did you mean 'tau'"):
        read(path, robot, topic={"tua": "/efforts"})
    chosen = {"q": "/joint_states", "tau": "/efforts"}
    assert same(read(path, robot, topic=chosen), log, ("q", "v", "tau"))
    text = Intake(topic=chosen).text()
    (tmp_path / "b.toml").write_text(text)
    assert Intake.of(tmp_path / "b.toml").topics == chosen


def test_a_trajectory_with_efforts_is_a_log(tmp_path, robot, log):
    typesys = pytest.importorskip("rosbags.typesys")
    from rosbags import rosbag2

    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    types, kind = store.types, "trajectory_msgs/msg/JointTrajectory"
    points = [
        types["trajectory_msgs/msg/JointTrajectoryPoint"](
            positions=log.q[k],
            velocities=log.v[k],
            accelerations=np.zeros(0),
            effort=log.tau[k],
            time_from_start=types["builtin_interfaces/msg/Duration"](
                sec=int(t), nanosec=round(1e9 * (t - int(t)))
            ),
        )
        for k, t in enumerate(log.t)
    ]
    header = types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id=""
    )
    message = types[kind](header=header, joint_names=robot.joint_names, points=points)
    with rosbag2.Writer(tmp_path / "a", version=9) as writer:
        topic = writer.add_connection("/plan", kind, typestore=store)
        writer.write(topic, 1, store.serialize_cdr(message, kind))
    assert same(pa.read_log(tmp_path / "a", robot), log)


def test_former_arguments_say_what_has_replaced_them(robot, log):
    with pytest.raises(pa.InputError, match=re.escape("'degrees' is now intake={")):
        pa.read_log(log, robot, degrees=True)
