"""``pinadapt identify``: the options of the intake, the file beside a log, and doubtful logs."""

import argparse
import json
from dataclasses import fields

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli import identify as command
from pinadapt.cli.command_line import main
from pinadapt.logs import Intake
from tests.support.paths import ROOT

LOG = ROOT / "tests" / "data" / "panda_unisa.csv"


@pytest.fixture
def copy(tmp_path):
    """Return a function that writes the log of a real arm with changed numbers."""
    names, *_ = [line for line in LOG.read_text().splitlines() if not line.startswith("#")]
    values = np.loadtxt(LOG, delimiter=",", comments="#", skiprows=5)

    def write(change=None, header=names):
        parts = {
            "t": values[:, :1],
            "q": values[:, 1:8],
            "v": values[:, 8:15],
            "tau": values[:, 15:],
        }
        if change is not None:
            parts |= change(**parts)
        path = tmp_path / "log.csv"
        np.savetxt(path, np.hstack(list(parts.values())), "%.9g", ",", header=header, comments="")
        return path

    return write


def options_of(*arguments):
    """Return the intake of arguments of the command line."""
    parser = argparse.ArgumentParser()
    command.arguments(parser)
    found = command._intake(parser.parse_args([*arguments, "--robot", "panda"]))
    return Intake.of(Intake.beside(arguments[0])) if found is None else found


def test_every_field_of_an_intake_is_an_option():
    given = options_of(
        *("none.csv", "--columns", "t=stamp", "q=pos_*", "--columns", "tau=a,b"),
        *("--files", "v=v.csv", "--joints", "a,b", "--rate", "100", "--repeated", "drop"),
        *("--degrees", "--gear", "10,-20", "--torque-gain", "a=2,b=-3", "--offset=-0.5"),
        *("--motor-side", "tau", "--flip", "a,q:b", "--topic", "/js", "--pose-topic", "/pose"),
        *("--compensated", "nominal", "--gravity=0,-9.81,0", "--accept-doubts"),
    )
    expected = Intake(
        columns={"t": ["stamp"], "q": ["pos_*"], "tau": ["a", "b"]},
        files={"v": "v.csv"},
        joints=["a", "b"],
        rate=100.0,
        repeated="drop",
        degrees=True,
        gear=[10.0, -20.0],
        motor_side=["tau"],
        torque_gain={"a": 2.0, "b": -3.0},
        flip=["a", "q:b"],
        offset=-0.5,
        topic="/js",
        pose_topic="/pose",
        compensated="nominal",
        gravity=[0.0, -9.81, 0.0],
        doubtful=True,
    )
    for one in fields(Intake):
        if one.name != "mount":
            assert getattr(given, one.name) == getattr(expected, one.name), one.name
    assert options_of("none.csv", "--mount", "wall").mount == "wall"
    assert options_of("none.csv", "--joints", "tau:a,b").joints == {"tau": ["a", "b"]}
    topics = {"q": "/js", "tau": "/motors:data"}
    assert options_of("none.csv", "--topic", "q=/js,tau=/motors:data").topic == topics
    assert options_of("none.csv") == Intake()


def test_options_override_the_file_beside_the_log(tmp_path, capsys):
    (tmp_path / "log.intake.toml").write_text('rate = 50.0\nmount = "wall"\n')
    log = str(tmp_path / "log.csv")
    assert options_of(log) == Intake(rate=50.0, mount="wall")
    assert "log.intake.toml" in capsys.readouterr().out
    assert options_of(log, "--rate", "20", "--gravity", "0,0,9") == Intake(
        rate=20.0, gravity=[0, 0, 9]
    )
    other = str(tmp_path / "other.csv")
    (tmp_path / "other.intake.toml").write_text("rate = 60.0\n")
    with pytest.raises(
        pa.InputError, match=r"options apply to all logs, but .*other\.intake\.toml states how one"
    ):
        options_of(log, other, "--degrees")
    assert options_of(log, other) == Intake(rate=50.0, mount="wall")
    assert f"{other} is read as" in capsys.readouterr().out
    (tmp_path / "other.toml").write_text("degrees = true\n")
    assert options_of(log, "--intake", str(tmp_path / "other.toml")) == Intake(degrees=True)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--gear", "many"], "a number is expected"),
        (["--torque-gain", ","], "at least one number is expected"),
        (["--gravity", "0,0,down"], "a number is expected"),
        (["--files", "tau.csv"], "name=value is expected"),
        (["--repeated", "keep"], "invalid choice"),
        (["--mount", "table"], "invalid choice"),
    ],
)
def test_wrong_options_are_refused(arguments, words, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["identify", str(LOG), "--robot", "panda", *arguments])
    assert stopped.value.code == 2 and words in capsys.readouterr().err


def test_the_file_beside_a_log_is_written_and_read_again(copy, tmp_path, capsys):
    fer = ",".join(
        ["t", *(f"{signal}_fer_joint{j}" for signal in ("q", "v", "tau") for j in range(1, 8))]
    )
    path = copy(header=fer)
    assert main(["identify", str(path), "--robot", "panda", "--write-intake"]) == 0
    printed, beside = capsys.readouterr(), tmp_path / "log.intake.toml"
    assert "fer_joint1 = panda_joint1" in printed.err.lower()
    assert f"written to {beside}" in printed.out and "fits" in printed.out
    text = beside.read_text()
    assert "Checked: the torques fit the description" in text and "panda_hand" in text
    assert list(Intake.of(beside).joints) == [f"fer_joint{j}" for j in range(1, 8)]
    robot = pa.load("panda")
    with pytest.warns(UserWarning, match="matched by their names"):
        same = pa.read_log(path, robot, intake={})
    assert np.array_equal(pa.read_log(path, robot).tau, same.tau)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["log.csv", "log.intake.toml"]
    elsewhere = tmp_path / "other.toml"
    given = ["identify", str(path), "--robot", "panda", "--intake", str(elsewhere)]
    assert main([*given, "--write-intake"]) == 0
    assert list(Intake.of(elsewhere).joints) == list(Intake.of(beside).joints)


def test_a_doubtful_log_gives_a_nonzero_exit_status(copy, tmp_path, capsys):
    path = copy(lambda t, q, v, tau: {"tau": 0.1 * tau})
    out = tmp_path / "out"
    arguments = ["identify", str(path), "--robot", "panda", "--out", str(out)]
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert "DOES NOT FIT" in printed.out and "--torque-gain=11.7" in printed.err
    assert "do not fit the description" in printed.err.splitlines()[-1]
    assert not out.exists()
    assert main([*arguments, "--write-intake"]) == 2
    assert "do not fit" in (tmp_path / "log.intake.toml").read_text()
    (tmp_path / "log.intake.toml").unlink()


@pytest.mark.slow
def test_each_of_several_logs_is_checked(copy, tmp_path, capsys):
    bad = copy(lambda t, q, v, tau: {"tau": -tau})
    for arguments in (["--test", str(bad)], ["--empty", str(bad)], []):
        logs = [str(LOG)] if arguments else [str(LOG), str(bad)]
        options = ["--dynamic", "payload", "--joint", "none", "--out", str(tmp_path / "out")]
        assert main(["identify", *logs, *arguments, "--robot", "panda", *options]) == 2
        assert f"{bad}: tau: the torques do not fit" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.usefixtures("blank_pictures")
def test_accepted_doubts_remain_in_the_last_line_and_the_exit_status(copy, tmp_path, capsys):
    path = copy(lambda t, q, v, tau: {"tau": 0.1 * tau})
    out = tmp_path / "out"
    arguments = ["identify", str(path), "--robot", "panda", "--out", str(out)]
    arguments += ["--dynamic", "payload", "--joint", "none"]
    assert main([*arguments, "--accept-doubts"]) == 2
    assert capsys.readouterr().out.splitlines()[-1].startswith("NOT TO BE TRUSTED")
    summary = json.loads((out / "summary.json").read_text())
    assert not summary["check"]["fits"] and summary["verdict"].startswith("NOT TO BE TRUSTED")
    assert Intake.of(out / "intake.toml").doubtful
    assert main([*arguments, "--torque-gain", "10"]) == 0
    assert "NOT TO BE TRUSTED" not in capsys.readouterr().out
    assert Intake.of(out / "intake.toml").torque_gain == 10.0
