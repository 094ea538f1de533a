"""Interrupts by Ctrl-C or signals: results are kept, the status is 130."""

import json
import signal
import sys

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.description.catalogue import robots_folder
from pinadapt.simulation.simulate import record

pytestmark = pytest.mark.slow

PLANAR = str(robots_folder() / "planar_2r" / "wang_xie_2009.toml")
SETTINGS = ["--set", "simulation.duration=0.1", "controller.law=adaptive-inverse-dynamics"]


def stopping(at):
    """Return a wrapper of a run's indices that interrupts it."""

    def indices(samples):
        for k in samples:
            if k == at:
                raise KeyboardInterrupt
            yield k

    return indices


def stop_run(monkeypatch, number, at=50):
    """Interrupt one of the next simulations."""
    simulate, count = pa.simulate, []

    def stopped(*arguments, **options):
        count.append(1)
        if len(count) == number:
            options["progress"] = stopping(at)
        return simulate(*arguments, **options)

    monkeypatch.setattr("pinadapt.scenario.scenario.simulate", stopped)


@pytest.mark.usefixtures("blank_pictures", "interruptible")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_run_with_its_outputs_and_130(number, tmp_path, monkeypatch, capsys):
    def told(stream, indices, *options):
        tell = lambda k: k != 50 or signal.raise_signal(number) is None  # noqa: E731
        return record(stream, (k for k in indices if tell(k)), *options)

    monkeypatch.setattr(sys.modules["pinadapt.simulation.simulate"], "record", told)
    assert main(["run", PLANAR, *SETTINGS, "--out", str(tmp_path)]) == 130
    out, err = capsys.readouterr()
    assert any(line.startswith("interrupted at 0.049 s") for line in out.splitlines())
    assert "Traceback" not in err
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["interrupted"] == pytest.approx(0.049) and summary["steps"] == 50
    assert len(np.load(tmp_path / "rollout.npz")["error"]) == 50
    assert (tmp_path / "animation.html").is_file() and (tmp_path / "learned.json").is_file()


@pytest.mark.usefixtures("blank_pictures")
def test_an_interrupted_comparison_keeps_the_laws_that_ran(tmp_path, monkeypatch, capsys):
    laws = ["resolved-acceleration", "adaptive-jacobian", "adaptive-inverse-dynamics"]
    arguments = ["compare", PLANAR, "--out", str(tmp_path), "--set", "simulation.duration=0.1"]
    assert main([*arguments, "--laws", laws[-1]]) == 0
    stop_run(monkeypatch, 2)
    assert main([*arguments, "--laws", ",".join(laws)]) == 130
    assert "interrupted at 0.049 s" in capsys.readouterr().out
    table = json.loads((tmp_path / "compare.json").read_text())
    assert [row["law"] for row in table] == laws[:2]
    assert [row["steps"] for row in table] == [100, 50]
    kept = {path.parent.name for path in tmp_path.glob("*/*")}  # nothing of the one before
    assert kept == set(laws[:2])
