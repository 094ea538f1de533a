"""Output files: complete and of one run, however writing ends; refused before the run."""

import errno
import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pinadapt._output import UNFINISHED, one_run, write_text
from pinadapt.cli.command_line import main
from pinadapt.cli.run import RUN_FILES
from pinadapt.description.catalogue import robots_folder
from tests.cli.test_interrupted import interrupt
from tests.support.loops import run
from tests.support.processes import forked

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("blank_pictures")]

PLANAR = str(robots_folder() / "planar_2r" / "wang_xie_2009.toml")
PLOTS = {"error.png", "parameters.png", "torque.png"}
LEARNED = {"learned.json", "learned.urdf"}
LUMPED = {"learned.json"}  # of the planar arm, whose lumped parameters are no bodies


def command(folder, *more, steps=20, title="planar"):
    """Return the arguments of a short run."""
    settings = [f"simulation.duration={steps / 1000}", f'title="{title}"']
    return ["run", PLANAR, "--out", str(folder), *more, "--set", *settings]


def shown(folder):
    """Return the names in a folder, without temporary folders."""
    return {path.name for path in folder.iterdir() if not path.name.startswith(UNFINISHED)}


def killed_at(monkeypatch, name, count):
    """End this process at the ``count``-th call of a method of ``Path``."""
    method = getattr(Path, name)
    calls = []

    def mortal(*arguments, **options):
        calls.append(1)
        if len(calls) == count:
            os.kill(os.getpid(), signal.SIGKILL)
        return method(*arguments, **options)

    monkeypatch.setattr(Path, name, mortal)


@pytest.fixture(scope="module")
def rollouts():
    """Return two runs of different length."""
    return [replace(run("planar_2r", duration=n / 1000), title=str(n)) for n in (10, 15)]


def written(rollout, folder):
    """Write a run as the command line does, but for pictures that take long."""
    with one_run(folder, RUN_FILES) as beside:
        rollout.save(beside)
        for name in (*sorted(PLOTS | LEARNED), "animation.html"):
            write_text(beside / name, rollout.title)


def of_run(folder):
    """Return to which runs the files of a folder belong; each must be whole."""
    for name in shown(folder):
        if name == "rollout.npz":
            arrays = np.load(folder / name)
            assert len({len(arrays[key]) for key in ("t", "q", "tau", "x")}) == 1
            yield str(len(arrays["t"]))
        elif name == "summary.json":
            yield json.loads((folder / name).read_text())["title"]
        else:
            yield (folder / name).read_text()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that are copies")
@pytest.mark.parametrize(
    ("method", "count"),
    [("unlink", 1), ("unlink", 4), ("replace", 2), ("replace", 9), ("replace", 13)],
)
def test_a_process_killed_while_it_writes_leaves_whole_files_of_one_run(
    method, count, rollouts, tmp_path, monkeypatch
):
    written(rollouts[0], tmp_path)
    assert set(of_run(tmp_path)) == {"10"} and shown(tmp_path) == set(RUN_FILES)
    killed_at(monkeypatch, method, count)
    child = forked(lambda: written(rollouts[1], tmp_path))
    assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL
    monkeypatch.undo()
    assert set(of_run(tmp_path)) <= {"10"} or set(of_run(tmp_path)) <= {"15"}
    complete = shown(tmp_path) == set(RUN_FILES)
    assert complete == ("summary.json" in shown(tmp_path))
    written(rollouts[1], tmp_path)
    assert set(of_run(tmp_path)) == {"15"} and shown(tmp_path) == set(RUN_FILES)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that are copies")
def test_a_killed_run_leaves_the_files_of_the_previous_one(tmp_path, monkeypatch):
    assert main(command(tmp_path, "--no-html", title="first")) == 0
    interrupt(monkeypatch, lambda: os.kill(os.getpid(), signal.SIGKILL))
    second = command(tmp_path, steps=100, title="second")
    child = forked(lambda: main(second))
    assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL
    assert json.loads((tmp_path / "summary.json").read_text())["title"] == "first"
    assert {path.name for path in tmp_path.iterdir()} == {
        *PLOTS,
        *LUMPED,
        "rollout.npz",
        "summary.json",
    }


# --- a full disk ---


def full_disk(monkeypatch, words):
    """Make files fail whose path contains one of these words."""
    open_ = Path.open

    def limited(path, *arguments, **options):
        if any(word in str(path) for word in words):
            raise OSError(errno.ENOSPC, "No space left on device")
        return open_(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", limited)


@pytest.mark.parametrize(
    ("full", "kept"),
    [
        (["animation"], {*PLOTS, *LUMPED, "rollout.npz", "summary.json"}),
        (["torque.png"], PLOTS - {"torque.png"} | {"rollout.npz", "summary.json"}),
        (["summary.json"], {"rollout.npz"}),
    ],
)
def test_a_full_disk_keeps_complete_files(full, kept, tmp_path, capsys, monkeypatch):
    full_disk(monkeypatch, full)
    assert main(command(tmp_path)) == 2
    out, err = capsys.readouterr()
    assert out.startswith("planar\n---") and "error, last 10 %" in out  # the terminal shows it
    assert f"{tmp_path}: not all could be written: No space left on device." in err
    assert "Traceback" not in err and shown(tmp_path) == kept
