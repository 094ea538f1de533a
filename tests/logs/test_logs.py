"""Logs of every format are read alike; errors give the reason."""

import re
from dataclasses import replace

import numpy as np
import pytest

import pinadapt as pa
from tests.support.chains import catalogue_robot
from tests.support.recorded import recorded

STAMP = 1_700_000_000  # [s]


@pytest.fixture
def log():
    """Return a second and a half of its motion."""
    return recorded("ur5", duration=1.5, dt=4e-3, rate=25.0)


def write_csv(path, columns, mark=","):
    """Write named columns with a header; NaN as empty cells."""
    rows = np.column_stack(list(columns.values()))
    cells = [["" if np.isnan(x) else repr(float(x)) for x in row] for row in rows]
    lines = [mark.join(columns), *(mark.join(row) for row in cells)]
    path.write_text("\n".join(lines) + "\n")
    return path


def columns_of(log, labels, form="{signal}{label}"):
    """Return the columns of a log, named after a pattern."""
    columns = {"t": log.t}
    for signal in ("q", "v", "tau"):
        for j, label in enumerate(labels):
            columns[form.format(signal=signal, label=label)] = getattr(log, signal)[:, j]
    return columns


def same(read, log, parts=("t", "q", "v", "tau")):
    """Return whether two logs have the same numbers."""
    return all(np.allclose(getattr(read, part), getattr(log, part), atol=1e-12) for part in parts)


def test_an_archive_is_matched_by_the_names_of_its_joints(tmp_path, robot, log):
    order = [3, 0, 5, 1, 2, 4]
    names = np.array(robot.joint_names)[order]
    shuffled = {part: getattr(log, part)[:, order] for part in ("q", "v", "tau")}
    np.savez(tmp_path / "a.npz", t=log.t, joint_names=names, x=log.x, x_time=log.x_time, **shuffled)
    read = pa.read_log(tmp_path / "a.npz", robot)
    assert same(read, log, ("t", "q", "v", "tau", "x", "x_time")) and not read.held


@pytest.mark.parametrize("form", ["{signal}_{label}", "{label}.{signal}"])
def test_columns_are_found_by_the_names_of_joints(tmp_path, robot, log, form):
    table = columns_of(log, robot.joint_names, form)
    assert same(pa.read_log(write_csv(tmp_path / "a.csv", table), robot), log)


def test_degrees_are_read_on_request_and_what_was_desired_is_not(tmp_path, robot, log):
    turned = replace(log, q=np.degrees(log.q), v=np.degrees(log.v))
    desired = columns_of(log, range(6), "{signal}_d_{label}")
    measured = columns_of(turned, range(6), "{signal}_{label}")
    path = write_csv(tmp_path / "a.csv", desired | measured)
    assert same(pa.read_log(path, robot, import_options={"degrees": True}), log)


def test_continuous_joints_are_angles_or_configurations():
    kinova = catalogue_robot("kinova")
    log = recorded("kinova", duration=1.5, dt=4e-3)
    assert log.q.shape[1] == kinova.model.nv < kinova.model.nq
    configurations = log.configurations(kinova)
    assert np.allclose(
        replace(log, q=configurations, joints=()).configurations(kinova), configurations
    )
    read = pa.read_log(replace(log, q=configurations, joints=()), kinova)
    assert np.array_equal(read.q, configurations)


def test_a_run_is_a_log_from_the_last_change_of_its_robot_on(tmp_path, robot, blank_pictures):
    heavy = robot.changed(payload=pa.Payload(1.0, (0.0, 0.0, 0.05)))
    controller = pa.make_controller(robot, dt=4e-3)
    path = pa.reachable_circle(robot)
    rollout = pa.simulate(
        robot, controller, path, duration=1.7, events=pa.Events(changes={0.5: heavy})
    )
    rollout.save(tmp_path)
    for source in (tmp_path, tmp_path / "rollout.npz"):
        read = pa.read_log(source, robot)
        assert read.held and read.t[0] == pytest.approx(0.5, abs=2e-3)
        part = rollout.t >= read.t[0]
        assert np.array_equal(read.tau, rollout.tau[part])
        assert np.array_equal(read.x, rollout.x[part])


def flawed(log, robot):
    """Return logs that cannot be used, by words of their errors."""
    backwards = log.t.copy()
    backwards[40] = backwards[38]
    renamed = tuple(name.replace("elbow", "knee") for name in robot.joint_names)
    return {
        "ascend; sample 40": replace(log, t=backwards),
        "at least 1 s are needed": replace(log, t=1e-3 * log.t),
        "are the times in seconds? --rate": replace(log, t=1e3 * log.t),
        "the torque of shoulder_pan_joint is zero": replace(log, tau=0.0 * log.tau),
        "57.3 times the rate": replace(log, v=np.degrees(log.v)),
        "-1 times the rate": replace(log, v=-log.v),
        "only 0%": replace(log, tau=np.nan * log.tau),
        "joint 'elbow_joint' is missing": replace(log, joints=renamed),
        "5 columns, but ur5 has 6": replace(log, q=log.q[:, :5], joints=()),
    }


def test_comments_below_the_numbers_and_columns_of_one_name(tmp_path, robot, log):
    lines = write_csv(tmp_path / "a.csv", columns_of(log, range(6))).read_text().splitlines()
    path = tmp_path / "b.csv"
    path.write_text("\n".join([f"#{lines[0]}", *lines[1:], "# the end of the log"]))
    assert same(pa.read_log(path, robot), log)
    path.write_text("\n".join([f"{lines[0]},t", *(f"{line},0" for line in lines[1:])]))
    with pytest.raises(pa.LogError, match="several columns 't'"):
        pa.read_log(path, robot)
    path.write_text("\n".join([lines[0], f"s{lines[1]}", *lines[2:]]))
    with pytest.raises(pa.LogError, match="the time of sample 0 is no number"):
        pa.read_log(path, robot)
    with pytest.raises(pa.LogError, match="6 columns of the joints"):
        pa.read_log(replace(log, joints="gabcdef"), robot, import_options={"joints": [*"abcdef"]})


def test_a_log_may_have_no_torques_but_there_is_one(robot, log):
    assert np.isnan(pa.Log(log.t, log.q, None).tau).all()
    with pytest.raises(pa.LogError, match="expected a log, got none"):
        pa.identify([], robot)


def test_an_impossible_log_is_refused(robot, log):
    for words, flaw in flawed(log, robot).items():
        with pytest.raises(pa.LogError, match=f"(?i){re.escape(words)}"):
            pa.read_log(flaw, robot)
    assert pa.read_log(log, robot) is not None
    with pytest.raises(pa.LogError, match=r"q: has numbers beyond"):
        replace(log, q=1e308 + log.q)


def test_a_file_that_cannot_be_read_is_refused(tmp_path, robot, log):
    good = write_csv(tmp_path / "good.csv", columns_of(log, range(6))).read_text().splitlines()
    files = {
        "no such file": None,
        "is not a log of a known format": ("a.xyz", "1"),
        "is empty": ("a.csv", "\n"),
        "no joint positions found among the columns": (
            "a.csv",
            "\n".join(line.rpartition(",")[0] for line in good[1:]),
        ),
        "got 2 columns instead of 19": ("a.csv", "\n".join([*good[:3], "1,2"])),
        "2 cells in a row, and the header has 19": ("a.csv", "\n".join([good[0], "1,2"])),
        "tau: only 0%": (
            "a.csv",
            "\n".join([good[0].replace("tau", "weight"), *good[1:]]),
        ),
        "cannot be read": ("a.npz", "none"),
    }
    for words, given in files.items():
        path = tmp_path / (given[0] if given else "missing.csv")
        if given:
            path.write_text(given[1])
        with pytest.raises(pa.LogError, match=re.escape(words)):
            pa.read_log(path, robot)


def write_bag(path, kind, log, names, *, more=None):
    """Write a bag of joint states, including those of a gripper, and of a tracker's poses.

    Args:
        path: of the bag.
        kind: its format.
        log: what is recorded.
        names: of the joints.
        more: topics of one joint state each, by the names of its joints.
    """
    typesys = pytest.importorskip("rosbags.typesys")
    from rosbags import rosbag1, rosbag2

    ros = 1 if kind == "ros1" else 2
    stores = typesys.Stores
    store = typesys.get_typestore(stores.ROS1_NOETIC if ros == 1 else stores.ROS2_HUMBLE)
    types = store.types
    if ros == 1:
        writer = rosbag1.Writer(path)
        pack = store.serialize_ros1
    else:
        plugin = rosbag2.StoragePlugin[kind.upper()]
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        pack = store.serialize_cdr
    topics = {}

    def write(topic, kind, t, **content):
        if topic not in topics:
            topics[topic] = writer.add_connection(topic, kind, typestore=store)
        seconds = int(STAMP + t)
        extra = {"seq": 0} if ros == 1 else {}
        stamp = types["builtin_interfaces/msg/Time"](
            sec=seconds, nanosec=round((STAMP + t - seconds) * 1e9) % 10**9
        )
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **extra)
        raw = pack(types[kind](header=header, **content), kind)
        writer.write(topics[topic], int((STAMP + t) * 1e9), raw)

    def state(topic, t, joints, q, v, tau):
        parts = {"name": joints, "position": q, "velocity": v, "effort": tau}
        write(topic, "sensor_msgs/msg/JointState", t, **parts)

    with writer:
        for topic, joints in (more or {}).items():
            state(topic, 0.0, joints, *np.zeros((3, len(joints))))
        for t, *parts in zip(log.t, log.q, log.v, log.tau, strict=True):
            state(
                "/joint_states", t, ["gripper", *names], *(np.append(0.1, part) for part in parts)
            )
        turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        for t, x in zip(log.x_time, log.x, strict=True):
            point = types["geometry_msgs/msg/Point"](*map(float, x))
            pose = types["geometry_msgs/msg/Pose"](position=point, orientation=turn)
            write("/tracker", "geometry_msgs/msg/PoseStamped", t, pose=pose)
    return path


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_bags_are_matched_by_the_names_of_their_joints(tmp_path, robot, log, kind):
    path = tmp_path / ("a.bag" if kind == "ros1" else "a")
    order = [2, 1, 0, 3, 4, 5]
    shuffled = replace(log, **{part: getattr(log, part)[:, order] for part in ("q", "v", "tau")})
    twice = np.sort(np.append(np.arange(len(log.t)), [7, 9, 9]))  # a driver that repeats itself
    again = {part: getattr(shuffled, part)[twice] for part in ("t", "q", "v", "tau")}
    shuffled = replace(shuffled, **again)
    write_bag(path, kind, shuffled, [robot.joint_names[j] for j in order])
    read = pa.read_log(path, robot, import_options={"pose_topic": "/tracker"})
    for part in ("t", "q", "v", "tau", "x_time"):
        assert np.allclose(getattr(read, part), getattr(log, part), atol=2e-7), part
    assert np.allclose(read.x[:, :3], log.x) and read.x.shape[1] == 7
    assert pa.read_log(path, robot).x is None
