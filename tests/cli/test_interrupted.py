"""Interrupts by Ctrl-C or signals: results are kept, the status is 130."""

import json
import signal
import sys

import numpy as np
import pytest

from pinadapt.cli.command_line import main
from pinadapt.description.catalogue import robots_folder
from pinadapt.simulation.simulate import record

pytestmark = pytest.mark.slow

PLANAR = str(robots_folder() / "planar_2r" / "wang_xie_2009.toml")
SETTINGS = ["--set", "simulation.duration=0.1", "controller.law=adaptive-inverse-dynamics"]


def interrupt(monkeypatch, way, run=1):
    """Have something happen at sample 50 of one of the next runs."""
    count = iter(range(10))

    def told(stream, indices, *options):
        this = next(count) + 1 == run
        tell = lambda k: k != 50 or not this or way() is None  # noqa: E731
        return record(stream, (k for k in indices if tell(k)), *options)

    monkeypatch.setattr(sys.modules["pinadapt.simulation.simulate"], "record", told)


@pytest.mark.usefixtures("blank_pictures", "interruptible")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_run_with_its_outputs_and_130(number, tmp_path, monkeypatch, capsys):
    interrupt(monkeypatch, lambda: signal.raise_signal(number))
    assert main(["run", PLANAR, *SETTINGS, "--out", str(tmp_path)]) == 130
    out, err = capsys.readouterr()
    assert any(line.startswith("interrupted at 0.049 s") for line in out.splitlines())
    assert "Traceback" not in err
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["interrupted"] == pytest.approx(0.049) and summary["steps"] == 50
    assert len(np.load(tmp_path / "rollout.npz")["error"]) == 50
    assert (tmp_path / "animation.html").is_file() and (tmp_path / "learned.json").is_file()


@pytest.mark.usefixtures("blank_pictures", "interruptible")
def test_an_interrupted_comparison_keeps_the_laws_that_ran(tmp_path, monkeypatch, capsys):
    laws = ["resolved-acceleration", "adaptive-jacobian", "adaptive-inverse-dynamics"]
    arguments = ["compare", PLANAR, "--out", str(tmp_path), "--set", "simulation.duration=0.1"]
    assert main([*arguments, "--laws", laws[-1]]) == 0
    interrupt(monkeypatch, lambda: signal.raise_signal(signal.SIGINT), run=2)
    assert main([*arguments, "--laws", ",".join(laws)]) == 130
    assert "interrupted at 0.049 s" in capsys.readouterr().out
    table = json.loads((tmp_path / "compare.json").read_text())
    assert [row["law"] for row in table] == laws[:2]
    assert [row["steps"] for row in table] == [100, 50]
    kept = {path.parent.name for path in tmp_path.glob("*/*")}  # nothing of the one before
    assert kept == set(laws[:2])
