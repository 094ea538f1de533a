"""Sweeps on every engine: the same bits, and failures that cost one case."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.sweep import execution, read
from pinadapt.sweep.table import JOURNAL, TABLE, append, join
from tests.support.paths import ROOT
from tests.support.swept import doubled, slow, troubled

pytestmark = pytest.mark.slow

SCENARIO = """
title = "Two joints"
[robot]
source = "planar_2r"
[truth]
payload = { mass = 0.2 }
[controller]
adaptation = "natural"
dt = 2e-3
[simulation]
duration = 0.06
[sensors]
noise = { q = 1e-5, x = 1e-4 }
"""
VARIED = {
    "truth.payload.mass": "uniform(0.1, 2.0)",
    "model.inertial_scale.*": "normal(1.0, 0.1)",
    "controller.law": ["separation", "adaptive-jacobian"],
}


@pytest.fixture
def scenario(tmp_path):
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    return tmp_path / "scenario.toml"


def test_the_same_bits_in_this_process_in_another_and_in_any_order(scenario):
    options = {"samples": 2, "method": "sobol", "seed": 3}
    serial = pa.sweep(scenario, VARIED, executor=0, **options)
    assert (serial["status"] == "done").all() and len(set(serial["max_error_last"])) == 4
    assert pa.sweep(scenario, VARIED, executor=1, **options).same_as(serial)

    with ThreadPoolExecutor(1) as thread:
        backwards = Backwards(thread)
        assert pa.sweep(scenario, VARIED, executor=backwards, **options).same_as(serial)


class Backwards(Executor):
    """Runs two cases at a time, the later one first, after robots and controllers of its own."""

    def __init__(self, thread):
        self.thread = thread
        self.waiting = []
        self._max_workers = 1

    def submit(self, function, *arguments):
        returned = Future()
        self.waiting.append((returned, function, arguments))
        if len(self.waiting) == 2:
            for future, function, arguments in self.waiting[::-1]:
                future.set_result(self.thread.submit(function, *arguments).result())
            self.waiting = []
            return returned
        return returned


def test_failures_are_rows_with_reasons_and_cost_one_case(monkeypatch):
    """A process that ends takes what ran beside it along, which runs again."""
    monkeypatch.setattr(execution, "get_context", lambda kind: get_context("forkserver"))
    table = pa.sweep(troubled, {"a": [3, 0, 1, 2, 4, 5]}, executor=2, timeout=2.0)
    assert table["status"].tolist() == ["timeout", "done", "failed", "crashed", "done", "done"]
    reasons = table["reason"].tolist()
    assert reasons[2] == "ValueError: one (swept.py:16)" and "its process ended" in reasons[3]
    assert reasons[0] == "took longer than 2 s" and not any(reasons[1:2] + reasons[4:])
    assert table["square"].tolist()[4:] == [16.0, 25.0] and table.lost.tolist().count(True) == 3


# --- folders ---


def test_a_folder_is_completed_and_nothing_runs_twice(tmp_path):
    marks = tmp_path / "marks"
    folder = tmp_path / "out"
    marks.mkdir()
    given = {"a": list(range(6)), "place": [str(marks)]}
    whole = pa.sweep(slow, given, executor=0)
    for file in marks.iterdir():
        file.unlink()
    pa.sweep(slow, given, executor=0, folder=folder)
    rest = [row for row in read(folder).rows() if row["case"] not in (2, 4)]
    (folder / TABLE).unlink()
    for row in [*rest, rest[0]]:  # as if cases 2 and 4 had been lost with a process
        append(folder, row)
    (folder / JOURNAL).open("ab").write(b'{"case": 2, "seed"')  # not written whole
    assert pa.sweep(slow, given, executor=0, folder=folder).same_as(whole)
    runs = {path.name: path.read_text() for path in marks.iterdir()}
    assert runs == {"0": "x", "1": "x", "2": "xx", "3": "x", "4": "xx", "5": "x"}


def test_crashed_cases_run_again_on_request(tmp_path):
    given = {"a": [0, 1, 4]}
    whole = pa.sweep(troubled, given, executor=0, folder=tmp_path)
    assert join(tmp_path, without=("failed",))["case"].tolist() == [0, 2]
    assert pa.sweep(troubled, given, executor=0, folder=tmp_path).same_as(whole)
    file = (tmp_path / "sweep.toml").read_text()
    (tmp_path / "sweep.toml").write_text(f"{file}".replace("troubled", "fewer_troubles"))
    arguments = ["sweep", str(tmp_path), "--retry", "--processes", "0"]
    assert main(arguments) == 0
    assert read(tmp_path)["status"].tolist() == ["done"] * 3


def test_a_full_disk_keeps_the_rows_before(tmp_path, monkeypatch):
    added = []

    def until_full(folder, row):
        if len(added) == 2:
            raise OSError("no space left on device")
        added.append(append(folder, row))

    monkeypatch.setattr(execution, "append", until_full)
    with pytest.raises(OSError, match="no space"):
        pa.sweep(doubled, {"a": [1.0, 2.0, 3.0]}, executor=0, folder=tmp_path)
    monkeypatch.undo()
    assert len(read(tmp_path)) == 2
    done = pa.sweep(doubled, {"a": [1.0, 2.0, 3.0]}, executor=0, folder=tmp_path)
    assert done["twice"].tolist() == [2.0, 4.0, 6.0]


# --- the command ---


def test_the_command_writes_table_page_and_figures_and_runs_a_case_alone(
    scenario, tmp_path, capsys, blank_pictures
):
    out = tmp_path / "out"
    vary = ["truth.payload.mass=lin(0.1, 2, 3)", "sensors.noise.x=[0.0, 1e-3, 1e30]"]
    given = [str(scenario), "--vary", *vary, "--success", "error_share < 5"]
    assert main(["sweep", *given, "--processes", "0", "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "9 of 9 cases; success (error_share < 5) " in text and "interval" in text
    names = {path.name for path in out.iterdir()}
    assert {
        "sweep.toml",
        "report.html",
        "report.json",
        "map.png",
        "bands.png",
    } < names
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 2 and "--case 2" in page
    assert main(["sweep", str(out)]) == 0 and "9 of 9 cases" in capsys.readouterr().out
    row = next(row for row in read(out).rows() if row["case"] == 2)
    assert row["status"] != "done" and row["reason"]
    assert main(["sweep", str(out), "--case", "2"]) == 2
    assert row["reason"] in capsys.readouterr().err
    assert main(["sweep", str(out), "--case", "0"]) == 0
    summary = json.loads((out / "case-0" / "summary.json").read_text())
    assert summary["max_error_last"] == read(out)["max_error_last"][0]


def running(session):
    """Yield the processes of a session that have not ended."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            yield int(folder.name)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds processes in /proc")
@pytest.mark.parametrize("how", ["terminal", "killed"])
def test_a_sweep_that_is_stopped_is_resumed_to_the_same_table(how, tmp_path, blank_pictures):
    """Killed, or by Ctrl-C: no process stays, what had a row does not run again."""
    (tmp_path / "marks").mkdir()
    file = tmp_path / "marks.toml"
    file.write_text(
        f'function = "tests.support.swept:slow"\npath = "{ROOT}"\n[vary]\n'
        f'a = "lin(0, 99, 100)"\nplace = ["{tmp_path / "marks"}"]\n'
    )
    out = tmp_path / "out"
    command = [sys.executable, "-m", "pinadapt", "sweep"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "NUMBA_DISABLE_JIT": "1"}
    process = subprocess.Popen(
        [*command, str(file), "--out", str(out), "--processes", "1"],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    while not ((out / JOURNAL).exists() and (out / JOURNAL).stat().st_size > 1000):
        assert process.poll() is None
        time.sleep(0.01)
    if how == "terminal":
        os.killpg(process.pid, signal.SIGINT)  # as Ctrl-C does: all of its processes
    else:
        process.kill()
    _, error = process.communicate(timeout=60)
    if how == "terminal":
        assert process.returncode == 130 and "Traceback" not in error
        assert "of 100 cases are kept" in error and "--resume" in error
    deadline = time.monotonic() + 30.0
    while list(running(process.pid)) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not list(running(process.pid))
    kept = len(read(out))
    assert 0 < kept < 100
    assert main(["sweep", str(out), "--resume", "--processes", "0"]) == 0
    table = read(out)
    assert table["result"].tolist() == list(range(100)) == table["case"].tolist()
    runs = sum(len(path.read_text()) for path in (tmp_path / "marks").iterdir())
    assert 100 <= runs <= 101  # one case was lost with the process


def test_the_code_of_the_page_runs(scenario, capsys):
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "sweeps.md").read_text(), re.S)
    exec(block.replace('"panda.toml"', repr(str(scenario))).replace("1.0}", "0.02}"), {})
    assert "done" in capsys.readouterr().out
