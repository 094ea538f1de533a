"""Sweeps on every engine: the same bits, and failures that cost one case."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from multiprocessing import get_context, set_forkserver_preload
from pathlib import Path

import numpy as np
import pytest

import pinadapt as pa
from pinadapt.cli.command_line import main
from pinadapt.scenario import Scenario
from pinadapt.sweep import Cases, EngineError, Processes, execution, read, run_case, table
from pinadapt.sweep.execution import rows
from pinadapt.sweep.table import JOURNAL, Store
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
[simulation]
duration = 0.06
dt = 2e-3
noise = { q = 1e-5, x = 1e-4 }
"""
VARIED = {
    "truth.payload.mass": "uniform(0.1, 2.0)",
    "belief.inertial_scale.*": "normal(1.0, 0.1)",
    "controller.law": ["separation", "adaptive-jacobian"],
}


@pytest.fixture
def scenario(tmp_path):
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    return tmp_path / "scenario.toml"


@pytest.fixture(scope="module")
def two():
    """Two processes for the tests of this file, and those that replace them.

    They are copies of one that has imported what they need; those of the commands are new ones.
    """
    set_forkserver_preload(["numba", "pinadapt.sweep.execution", "tests.support.swept"])
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(execution, "get_context", lambda kind: get_context("forkserver"))
        engine = Processes(2, timeout=2.0)
        engine.submit(os.getpid).result()
        yield engine
        engine.shutdown()


def test_the_same_bits_in_this_process_in_two_and_in_any_order(scenario, two):
    options = {"samples": 3, "method": "sobol", "seed": 3}
    serial = pa.sweep(scenario, VARIED, executor=0, **options)
    assert (serial["status"] == "done").all() and len(set(serial["max_error_last"])) == 6
    assert pa.sweep(scenario, VARIED, executor=two, **options).same_as(serial)

    with ThreadPoolExecutor(1) as thread:
        backwards = Backwards(thread)
        assert pa.sweep(scenario, VARIED, executor=backwards, **options).same_as(serial)


class Backwards(Executor):
    """Runs two cases at a time, the later one first, after robots and controllers of its own."""

    def __init__(self, thread):
        self.thread, self.waiting, self._max_workers = thread, [], 1

    def submit(self, function, *arguments):
        returned = Future()
        self.waiting.append((returned, function, arguments))
        if len(self.waiting) == 2:
            for future, function, arguments in self.waiting[::-1]:
                future.set_result(self.thread.submit(function, *arguments).result())
            self.waiting = []
            return returned
        return returned


def test_a_kept_controller_gives_the_bits_of_a_new_one(scenario):
    kept = pa.sweep(scenario, VARIED, samples=2, executor=0)
    for number in (3, 0):
        row = next(row for row in kept.rows() if row["case"] == number)
        settings = [f"{key}={row[key]}" for key in ("truth.payload.mass",)]
        settings += [
            f"belief.inertial_scale.joint{i}={row[f'belief.inertial_scale.joint{i}']}"
            for i in (1, 2)
        ]
        settings += [f"controller.law={row['controller.law']}", f"simulation.seed={row['seed']}"]
        alone = Scenario.read(scenario, settings).run(progress=False)
        assert alone.window(False).max() == row["max_error_last"]
        assert np.abs(alone.tau).max() > 0.0


def test_other_engines_leave_hanging_cases_behind():
    table = pa.sweep(troubled, {"a": [0, 3, 4]}, executor=0, timeout=0.2)
    assert table["status"].tolist() == ["done", "timeout", "done"]


def test_a_function_has_the_seed_of_the_case_unless_it_is_varied(two):
    table = pa.sweep(doubled, {"a": [1.0, 2.0]}, repeat=3, executor=two)
    assert (table["random"] == table["seed"] % 97).all()
    assert table["twice"].tolist() == [2.0] * 3 + [4.0] * 3
    given = pa.sweep(doubled, [{"seed": 5}, {"seed": 98}], executor=0)
    assert given["random"].tolist() == [5.0, 1.0]


def test_functions_that_workers_cannot_import_are_refused(two):
    with pytest.raises(pa.InputError, match=r"cannot be sent .* executor=0"):
        pa.sweep(lambda a: a, {"a": [1]}, executor=two)
    assert pa.sweep(lambda a: a, {"a": [1]}, executor=0)["result"].tolist() == [1.0]


def test_workers_of_another_version_are_refused_with_both(monkeypatch):
    case = Cases.of({"a": [1]})[0]
    assert run_case(lambda case: {"x": 1}, case, pa.__version__)["x"] == 1
    with pytest.raises(
        EngineError, match=rf"pinadapt 0\.0\.9 asks.* has pinadapt {pa.__version__}"
    ):
        run_case(lambda case: {"x": 1}, case, "0.0.9")
    assert issubclass(EngineError, pa.InputError)  # the command's exit status is that of a refusal


def test_failures_are_rows_with_reasons_and_cost_one_case(two):
    """A worker that is ended while idle costs nothing; the first case hangs beside the others."""
    os.kill(two.submit(os.getpid).result(), signal.SIGKILL)
    time.sleep(0.3)
    table = pa.sweep(troubled, {"a": [3, 0, 1, 2, 4, 5]}, executor=two)
    assert table["status"].tolist() == ["timeout", "done", "failed", "crashed", "done", "done"]
    reasons = table["reason"].tolist()
    assert reasons[2] == "ValueError: one (swept.py:16)" and "its process ended" in reasons[3]
    assert reasons[0] == "took longer than 2 s" and not any(reasons[1:2] + reasons[4:])
    assert table["square"].tolist()[4:] == [16.0, 25.0] and table.lost.tolist().count(True) == 3


def test_few_cases_are_in_an_engine_at_a_time():
    taken = []

    def cases():
        for case in Cases.of({"a": list(range(100))}):
            taken.append(case.number)
            yield case

    with ThreadPoolExecutor(2) as threads:
        coming = rows(lambda case: {"x": 1}, cases(), threads)
        next(coming)
        assert len(taken) <= 5
        assert len(list(coming)) == 99


# --- folders ---


def test_a_folder_is_completed_and_nothing_runs_twice(tmp_path):
    marks, folder = tmp_path / "marks", tmp_path / "out"
    marks.mkdir()
    given = {"a": list(range(6)), "place": [str(marks)]}
    whole = pa.sweep(slow, given, executor=0)
    for file in marks.iterdir():
        file.unlink()
    pa.sweep(slow, given, executor=0, folder=folder)
    with Store(folder, as_csv=True) as store:  # as if cases 2 and 4 had been lost with a process
        rest = [row for row in read(folder).rows() if row["case"] not in (2, 4)]
        for path in folder.glob("table.*"):
            path.unlink()
        for row in rest:
            store.add(row)
    (folder / JOURNAL).open("ab").write(b'{"case": 2, "seed"')  # not written whole
    assert pa.sweep(slow, given, executor=0, folder=folder).same_as(whole)
    runs = {path.name: path.read_text() for path in marks.iterdir()}
    assert runs == {"0": "x", "1": "x", "2": "xx", "3": "x", "4": "xx", "5": "x"}


def test_crashed_cases_run_again_on_request(tmp_path):
    given = {"a": [0, 1, 4]}
    whole = pa.sweep(troubled, given, executor=0, folder=tmp_path)
    with Store(tmp_path) as store:
        assert len(store.join(without=("failed",))) == 2 and store.done() == {0, 2}
    assert pa.sweep(troubled, given, executor=0, folder=tmp_path).same_as(whole)
    file = (tmp_path / "sweep.toml").read_text()
    (tmp_path / "sweep.toml").write_text(f"{file}".replace("troubled", "fewer_troubles"))
    arguments = ["sweep", str(tmp_path), "--retry", "--processes", "0"]
    assert main(arguments) == 0
    assert read(tmp_path)["status"].tolist() == ["done"] * 3


def test_a_folder_of_another_sweep_is_refused(tmp_path, capsys):
    pa.sweep(doubled, {"a": [1.0]}, executor=0, folder=tmp_path)
    with pytest.raises(pa.InputError, match=r"holds another sweep; vary is different.*--force"):
        pa.sweep(doubled, {"a": [2.0]}, executor=0, folder=tmp_path)
    with Store(tmp_path), pytest.raises(pa.InputError, match="another process runs this sweep"):
        Store(tmp_path)
    text = (tmp_path / "sweep.toml").read_text().replace(pa.__version__, "0.0.9")
    (tmp_path / "sweep.toml").write_text(text)
    with pytest.raises(pa.InputError, match=r"run by pinadapt 0\.0\.9; this is"):
        pa.sweep(doubled, {"a": [1.0]}, executor=0, folder=tmp_path)


def test_a_full_disk_keeps_the_rows_before(tmp_path, monkeypatch):
    class Full:
        """A file that takes no more than two lines."""

        def __init__(self, file):
            self.file, self.left = file, 2

        def write(self, line):
            self.left -= 1
            return self.file.write(line if self.left >= 0 else line[:5])

        def __getattr__(self, name):
            return getattr(self.file, name)

    opened = Store.__init__

    def limited(self, *arguments, **options):
        opened(self, *arguments, **options)
        self._file = Full(self._file)

    monkeypatch.setattr(Store, "__init__", limited)
    with pytest.raises(OSError, match="the disk is full"):
        pa.sweep(doubled, {"a": [1.0, 2.0, 3.0]}, executor=0, folder=tmp_path)
    monkeypatch.undo()
    assert len(read(tmp_path)) == 2
    done = pa.sweep(doubled, {"a": [1.0, 2.0, 3.0]}, executor=0, folder=tmp_path)
    assert done["twice"].tolist() == [2.0, 4.0, 6.0]


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_tables_are_read_as_they_were_written(suffix, tmp_path):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    found = pa.sweep(troubled, {"a": [0, 1, 4]}, executor=0)
    found.save(tmp_path / f"table{suffix}")
    assert read(tmp_path).same_as(found)


def test_parts_are_joined_and_few_rows_are_in_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "_ROWS", 10)
    whole = pa.sweep(doubled, {"a": [float(i) for i in range(35)]}, executor=0)
    with Store(tmp_path) as store:
        for row in sorted(whole.rows(), key=lambda row: row["case"] % 7):  # in some other order
            store.add(row)
            assert len(store._waiting) < 10
        assert len(list((tmp_path / "parts").iterdir())) == 3
        assert store.done() == set(range(35)) and read(tmp_path).same_as(whole)
        assert store.join().same_as(whole)
    assert sorted(path.stem for path in tmp_path.iterdir()) == ["table"]


# --- the command ---


def swept(folder, *arguments):
    return main(["sweep", *map(str, arguments), "--processes", "0", "--out", str(folder)])


def test_the_command_writes_table_page_and_figures_and_runs_a_case_alone(
    scenario, tmp_path, capsys, blank_pictures
):
    out = tmp_path / "out"
    vary = ["truth.payload.mass=lin(0.1, 2, 3)", "simulation.noise.x=[0.0, 1e-3, 1e30]"]
    assert swept(out, scenario, "--vary", *vary, "--success", "error_share < 5") == 0
    text = capsys.readouterr().out
    assert "9 of 9 cases; success (error_share < 5) " in text and "interval" in text
    names = {path.name for path in out.iterdir()}
    assert {
        "sweep.toml",
        "report.html",
        "report.json",
        "map.png",
        "bands.png",
        "influence.png",
    } < names
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 3 and "--case 2" in page
    assert main(["sweep", str(out)]) == 0 and "9 of 9 cases" in capsys.readouterr().out
    row = next(row for row in read(out).rows() if row["case"] == 2)
    assert row["status"] != "done" and row["reason"]
    assert main(["sweep", str(out), "--case", "2"]) == 2
    assert row["reason"] in capsys.readouterr().err
    assert main(["sweep", str(out), "--case", "0"]) == 0
    summary = json.loads((out / "case-0" / "summary.json").read_text())
    assert summary["max_error_last"] == read(out)["max_error_last"][0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--vary", "truth.payload.mas=[1.0]"], "Did you mean 'mass'"),
        (
            ["--vary", "truth.payload.mass=lin(0, 1, 100000)", "simulation.seed=lin(0, 1, 10000)"],
            "",
        ),
        (["--vary", "reference.radius=[0.1]", "--case", "3"], "there are 1 cases"),
        (["--vary", "reference.radius=uniform(0.1, 0.2)"], "number of samples is missing"),
    ],
)
def test_the_command_refuses_invalid_arguments(arguments, words, scenario, tmp_path, capsys):
    assert swept(tmp_path / "out", scenario, *arguments) == 2
    error = capsys.readouterr().err
    assert words in error and "Traceback" not in error and not (tmp_path / "out").exists()


def test_the_command_asks_before_a_billion_cases(scenario, tmp_path, capsys):
    vary = ["reference.radius=lin(0.1, 0.2, 40000)", "reference.period=lin(2, 3, 40000)"]
    assert swept(tmp_path / "out", scenario, "--vary", *vary) == 2
    assert "1,600,000,000 cases are more than 1,000,000" in capsys.readouterr().err


def test_a_silent_scheduler_is_refused(scenario, tmp_path, capsys, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(execution, "_ANSWER", 0.5)
    arguments = ["--vary", "reference.radius=[0.1]", "--scheduler", "tcp://127.0.0.1:9"]
    assert swept(tmp_path / "out", scenario, *arguments) == 2
    assert "does not answer within 0.5 s" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_dask_gives_the_same_bits(scenario):
    distributed = pytest.importorskip("distributed")
    serial = pa.sweep(scenario, VARIED, samples=3, executor=0)
    here = {"processes": False, "n_workers": 1, "threads_per_worker": 1}
    with distributed.Client(dashboard_address=None, **here) as client:
        found = pa.sweep(scenario, VARIED, samples=3, executor=client.get_executor(pure=False))
    assert found.same_as(serial)


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
