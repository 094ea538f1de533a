"""Output files: complete and of one run, however writing ends; refused before the run."""

import errno
import io
import json
import os
import signal
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pinadapt._output import UNFINISHED, check_writable, one_run, whole_file, write_text
from pinadapt.cli.command_line import main
from pinadapt.cli.run import RUN_FILES
from pinadapt.description.catalogue import robots_folder
from pinadapt.exceptions import InputError
from pinadapt.simulation.simulate import record
from tests.support.loops import run

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


def forked(work):
    """Run some work in a copy of this process and return how that ended."""
    child = os.fork()
    if not child:
        try:
            work()
        finally:
            os._exit(0)
    return os.waitpid(child, 0)[1]


def killed_at(monkeypatch, name, count):
    """End this process at the ``count``-th call of a method of ``Path``."""
    method, calls = getattr(Path, name), []

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
    [("unlink", n) for n in (1, 2, 4, 6)] + [("replace", n) for n in (1, 2, 3, 8, 9, 11, 13)],
)
def test_a_process_killed_while_it_writes_leaves_whole_files_of_one_run(
    method, count, rollouts, tmp_path, monkeypatch
):
    written(rollouts[0], tmp_path)
    assert set(of_run(tmp_path)) == {"10"} and shown(tmp_path) == set(RUN_FILES)
    killed_at(monkeypatch, method, count)
    assert os.WTERMSIG(forked(lambda: written(rollouts[1], tmp_path))) == signal.SIGKILL
    monkeypatch.undo()
    assert set(of_run(tmp_path)) <= {"10"} or set(of_run(tmp_path)) <= {"15"}
    complete = shown(tmp_path) == set(RUN_FILES)
    assert complete == ("summary.json" in shown(tmp_path))
    written(rollouts[1], tmp_path)
    assert set(of_run(tmp_path)) == {"15"} and shown(tmp_path) == set(RUN_FILES)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that are copies")
def test_a_killed_run_leaves_the_files_of_the_previous_one(tmp_path, monkeypatch):
    def killed(stream, indices, *options):
        kill = lambda k: k < 50 or os.kill(os.getpid(), signal.SIGKILL)  # noqa: E731
        return record(stream, (k for k in indices if kill(k)), *options)

    assert main(command(tmp_path, "--no-html", title="first")) == 0
    monkeypatch.setattr(sys.modules["pinadapt.simulation.simulate"], "record", killed)
    second = command(tmp_path, steps=100, title="second")
    assert os.WTERMSIG(forked(lambda: main(second))) == signal.SIGKILL
    assert json.loads((tmp_path / "summary.json").read_text())["title"] == "first"
    assert {path.name for path in tmp_path.iterdir()} == {
        *PLOTS,
        *LUMPED,
        "rollout.npz",
        "summary.json",
    }


def test_an_animation_of_another_run_does_not_stay(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert main(command(tmp_path)) == 0
    assert (tmp_path / "animation.html").stat().st_size > 1e5
    assert main(command(tmp_path, "--no-html")) == 0
    assert shown(tmp_path) == {*PLOTS, *LUMPED, "rollout.npz", "summary.json", "notes.txt"}


def test_a_failed_file_leaves_the_previous_one(tmp_path):
    write_text(tmp_path / "a", "old")
    with pytest.raises(OSError), whole_file(tmp_path / "a") as file:
        file.write(b"ne")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_files_left_by_killed_processes_are_removed_later(tmp_path):
    for age in (0.0, 1e4):
        left = tmp_path / f"{UNFINISHED}{age:g}"
        left.mkdir()
        os.utime(left, (left.stat().st_atime, left.stat().st_mtime - age))
    with one_run(tmp_path, ["a"]) as beside:
        write_text(beside / "a", "a")
    assert {path.name for path in tmp_path.iterdir()} == {"a", f"{UNFINISHED}0"}


# --- a place that cannot be written ---


@pytest.mark.parametrize(
    "arguments", [["run", PLANAR], ["compare", PLANAR], ["demo"], ["zoo"]], ids=lambda a: a[0]
)
@pytest.mark.parametrize("taken", ["file", "below", "read-only"])
def test_an_out_that_cannot_be_written_is_refused_before_anything_runs(
    arguments, taken, tmp_path, capsys, monkeypatch
):
    def refuse(*_, **__):
        raise OSError(errno.EROFS, "Read-only file system")

    place = tmp_path / "out"
    if taken == "read-only":
        monkeypatch.setattr("pinadapt._output.tempfile.TemporaryFile", refuse)
    else:
        place.write_text("in the way")
        place = place / "deeper" if taken == "below" else place
    if "demo" not in arguments and "zoo" not in arguments:
        arguments = [*arguments, "--set", "controller.law=adaptive-inverse-dynamics"]
        arguments += ["--laws", "adaptive-jacobian"] if "compare" in arguments else []
    for module in ("scenario.scenario.simulate", "zoo.experiment.engine"):
        monkeypatch.setattr(f"pinadapt.{module}", lambda *_, **__: pytest.fail("it ran"))
    assert main([*arguments, "--out", str(place)]) == 2
    error = capsys.readouterr().err
    assert str(place) in error and "--out" in error and "Traceback" not in error


def test_init_refuses_a_place_that_cannot_be_written(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main(["init", "planar_2r", "--out", str(tmp_path / "file" / "a.toml")]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_checking_a_folder_leaves_no_files(tmp_path):
    check_writable(tmp_path / "new")
    assert not list(tmp_path.iterdir())
    (tmp_path / "summary.json").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        check_writable(tmp_path, RUN_FILES)


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
    assert f"No space left on device. The rollout is in {tmp_path}." in err
    assert "Traceback" not in err and shown(tmp_path) == kept


def test_a_full_disk_sends_the_rollout_elsewhere(tmp_path, capsys, monkeypatch):
    place, elsewhere = tmp_path / "out", tmp_path / "tmp"
    elsewhere.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(elsewhere))
    assert main(command(place, "--no-html", steps=10)) == 0
    with monkeypatch.context() as patch:
        full_disk(patch, [str(place)])
        assert main(command(place, "--no-html")) == 2
    saved = Path(capsys.readouterr().err.split("The rollout is in ")[1].strip().rstrip("."))
    assert saved.parent == elsewhere and len(np.load(saved / "rollout.npz")["t"]) == 20
    assert json.loads((place / "summary.json").read_text())["steps"] == 10  # whole, as it was


# --- signs ---


def test_an_ascii_pipe_gets_printable_text_and_no_progress_bar(tmp_path, monkeypatch):
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors="strict") for _ in "oe")
    monkeypatch.setattr("sys.stdout", out)
    monkeypatch.setattr("sys.stderr", err)
    assert main(command(tmp_path / "ö", "--no-html", title="Größe机")) == 0
    monkeypatch.undo()
    written, told = ((stream.seek(0), stream.read())[1] for stream in (out, err))
    assert told == "" and written.splitlines()[0] == "Gr??e?"
    assert not any(sign in written for sign in ("\r", "it/s", "%|"))
