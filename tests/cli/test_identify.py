"""``pinadapt identify``: import options, the file beside a log, and doubtful logs."""

import argparse

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli import identify as command
from pinadapt.cli.command_line import main
from pinadapt.logs import ImportOptions
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
    """Return the import options of arguments of the command line."""
    parser = argparse.ArgumentParser()
    command.identify_arguments(parser)
    found = command._import_options(parser.parse_args([*arguments, "--robot", "panda"]))
    return ImportOptions.of(ImportOptions.beside(arguments[0])) if found is None else found


def test_options_override_the_file_beside_the_log(tmp_path):
    (tmp_path / "log.import_options.toml").write_text('rate = 50.0\nmount = "wall"\n')
    log = str(tmp_path / "log.csv")
    assert options_of(log) == ImportOptions(rate=50.0, mount="wall")
    assert options_of(log, "--rate", "20", "--gravity", "0,0,9") == ImportOptions(
        rate=20.0, gravity=[0, 0, 9]
    )
    other = str(tmp_path / "other.csv")
    (tmp_path / "other.import_options.toml").write_text("rate = 60.0\n")
    with pytest.raises(
        pa.InputError,
        match=r"options apply to all logs, but .*other\.import_options\.toml states",
    ):
        options_of(log, other, "--degrees")
    assert options_of(log, other) == ImportOptions(rate=50.0, mount="wall")


def test_a_doubtful_log_gives_a_nonzero_exit_status(copy, tmp_path, capsys):
    path = copy(lambda t, q, v, tau: {"tau": 0.1 * tau})
    out = tmp_path / "out"
    arguments = ["identify", str(path), "--robot", "panda", "--out", str(out)]
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert "DOES NOT FIT" in printed.out and "--torque-gain=11.7" in printed.err
    assert "do not fit the description" in printed.err.splitlines()[-1]
    assert not out.exists()
    assert main([*arguments, "--write-import-options"]) == 2
    beside = tmp_path / "log.import_options.toml"
    assert not beside.exists()
    assert main([*arguments, "--write-import-options", "--accept-doubts"]) == 2
    assert "do not fit" in beside.read_text()
    beside.unlink()
